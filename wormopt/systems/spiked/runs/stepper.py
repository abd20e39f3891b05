"""Scenes of kind ``stepper``: a gait as step commands, chapter 2.5, and the worm they move."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.files import gait_variables
from wormopt.systems.spiked.runs.motion import disagreements, motion_trust, recheck
from wormopt.systems.spiked.runs.reference import gait_of_shape
from wormopt.systems.spiked.runs.step_files import step_variables
from wormopt.systems.spiked.scenes.stepper import StepperScene
from wormopt.systems.spiked.stepper.bristles import BristleMotion, ratchet
from wormopt.systems.spiked.stepper.stepper import Demand, Stepper, demand
from wormopt.systems.spiked.stepper.steps import (
    Steps,
    csv_text,
    in_ticks,
    quantisation_error,
    read_csv,
    step_times,
    turning_times,
)

_ACCEPTED = 1e-9  # of the way (motion) or of the links' rates (speeds)
_ROUNDING = 1e-6  # of a microstep: lengths are up to a million of them
_SHOWN = 8  # steps before and after a turn, in the picture's close-up
_ASSUMED = {
    "bristles": "a mass slips back by bristles.backslip from the foremost place it has been at, "
    "then its bristles hold whatever pulls",
    "load": "load and drag pull the worm back until bristles hold: no mass glides, masses have "
    "no inertia in the stepped motion",
    "motors": "every link has one motor of the same kind; no step is lost within the limits of "
    "rate and acceleration, whatever the force",
    "rods": "rods are stiff, without play",
}


def run(scene: Scene[StepperScene], report: Report) -> Result:
    """Turn the scene's gait into steps, replay them, and move the worm by them.

    "failed" where the replay leaves the gait beyond rounding, or a second route disagrees.
    SolveError: too fast, moves no motor, or misfits the timer; SceneError: bad file or jump.
    """
    table = scene.table
    begin = time.perf_counter()
    report("inverting lengths", 0.0)
    gait = gait_of_shape(table.gait, scene)
    stepper = Stepper(**msgspec.structs.asdict(table.motor))
    asked, steps = _commands(scene, gait, stepper)
    report("crawling", 0.4)
    worm = table.worm
    ideal = crawl(gait, worm.masses, worm.drag, worm.worm.load_range[1], table.gait.sharing)
    again = recheck(ideal)
    report("moving by steps", 0.7)
    bristles = table.bristles
    moved = ratchet(steps, bristles.backslip, bristles.settle_time)
    held = ratchet(steps, 0.0, bristles.settle_time)
    error, bound = _replay(gait, steps), 0.5 + stepper.hysteresis + _ROUNDING
    late = _ticks(steps, table.tick, scene)
    scalars = _scalars(table, stepper, asked, steps, moved)
    scalars |= _speeds(ideal, moved, held)
    scalars["quantisation_error"] = Scalar(error * stepper.travel, "m")
    scalars["recheck_speed_error"] = Scalar(abs(again.speed - ideal.speed), "m s-1")
    faults = list(_faults(error, bound, late, moved))
    faults += disagreements(ideal, again)
    trust = {
        "replay": {
            "method": "steps.csv read back, its rows counted, both sides of every step",
            "error_in_steps": error,
            "accepted": bound,
        },
        "tick_error": late,
        "period_error": moved.period_error,
        "ideal": dict(motion_trust(ideal, again)),
        "assumptions": dict(_ASSUMED),
        "warnings": [
            *_warnings(table, stepper, ideal, moved),
            *_short_pauses(stepper, asked, steps),
        ],
    }
    return Result(
        scene.name,
        table.kind,
        scene.title,
        "failed" if faults else "ok",
        scalars=scalars,
        variables=(*step_variables(steps), *_variables(gait, stepper, steps, ideal, moved, table)),
        trust=trust,
        timings_s={"solve": time.perf_counter() - begin},
        reason="; ".join(faults),
        scene_text=scene.text,
    )


def _commands(scene: Scene[StepperScene], gait: Gait, stepper: Stepper) -> tuple[Demand, Steps]:
    """What the gait asks of the motors, and their steps; or a refusal that says what it asks."""
    try:
        asked = demand(gait, stepper)
    except ArgumentError as error:
        raise SceneError(scene.name, [("gait.file", str(error))]) from None
    failed = Result(
        scene.name, scene.table.kind, scene.title, "failed",
        scalars=_demanded(asked, stepper), scene_text=scene.text,
    )  # fmt: skip
    try:
        steps = step_times(gait, stepper)
    except SolveError as error:
        partial = replace(failed, reason=str(error))
        raise SolveError(error.reason, error.suggestion, partial, error.code) from None
    except ArgumentError as error:
        raise SceneError(scene.name, [("motor.microsteps", str(error))]) from None
    if not len(steps.time):
        reason = f"no length changes by half a microstep of {stepper.travel:g} m: no motor steps"
        suggestion = "take a gait with a longer stroke, or more microsteps"
        raise SolveError(reason, suggestion, replace(failed, reason=reason), "no_steps")
    return asked, steps


def _ticks(steps: Steps, tick: float, scene: Scene[StepperScene]) -> float:
    """Largest error of the timer's instants, in ticks, by adding up its delays."""
    try:
        _, delays = in_ticks(steps, tick)
    except ArgumentError as error:
        raise SceneError(scene.name, [("tick", str(error))]) from None
    late = [
        np.abs(np.cumsum(delay[:-1]) - steps.of_motor(j)[0] / tick)
        for j, delay in enumerate(delays)
    ]
    return max(float(one.max()) for one in late if one.size)


def _replay(gait: Gait, steps: Steps) -> float:
    """Largest distance of the lengths counted from the table's text to the gait's, in steps."""
    read = read_csv(csv_text(steps))
    return float(quantisation_error(gait, read).max()) / read.travel


def _demanded(asked: Demand, stepper: Stepper) -> dict[str, Scalar]:
    decides = asked.strictest
    return {
        "turn_rate_max": Scalar(asked.rate, "s-1"),
        "step_rate_max": Scalar(asked.rate * stepper.pulses_per_turn, "s-1"),
        "acceleration_max": Scalar(asked.acceleration, unit_of("rate_change", "SI")),
        "period": Scalar(asked.period, "s"),
        "period_min": Scalar(asked.period_min, "s"),
        "period_limited_by": Scalar(f"motor.{decides.name}"),
        "turn_rate_limit": Scalar(stepper.rate_max, "s-1"),
        "acceleration_limit": Scalar(stepper.acceleration_max, unit_of("rate_change", "SI")),
        "start_rate": Scalar(stepper.start_rate, "s-1"),
    }


def _scalars(
    table: StepperScene, stepper: Stepper, asked: Demand, steps: Steps, moved: BristleMotion
) -> dict[str, Scalar]:
    return {
        "speed": Scalar(moved.speed, "m s-1"),
        "step_count": Scalar(steps.counts),
        "travel_per_step": Scalar(stepper.travel, "m"),
        "step_interval_min": Scalar(steps.interval_min, "s"),
        **_demanded(asked, stepper),
        "backslip": Scalar(table.bristles.backslip, "m"),
        "settle_time": Scalar(table.bristles.settle_time, "s"),
        "tick": Scalar(table.tick, "s"),
    }


def _speeds(ideal: Crawl, moved: BristleMotion, held: BristleMotion) -> dict[str, Scalar]:
    return {
        "advance": Scalar(moved.speed * ideal.gait.period, "m"),
        "speed_ideal": Scalar(ideal.speed, "m s-1"),
        "speed_without_backslip": Scalar(held.speed, "m s-1"),
        "speed_lost": Scalar(ideal.speed - moved.speed, "m s-1"),
        "mode_sequence": Scalar(ideal.resting_sequence),
    }


def _faults(
    error: float,
    bound: float,
    late: float,
    moved: BristleMotion,
) -> Iterator[str]:
    if not error <= bound:
        yield f"the replayed steps leave the gait by {error:.4g} microsteps"
    if not late <= 0.5 * (1 + 1e-6):
        yield f"ticks are off by {late:.3g} of themselves"
    size = float(np.abs(moved.position).max())
    if not moved.period_error <= _ACCEPTED * size:
        yield f"the stepped motion does not close, by {moved.period_error:.2g} m"


def _warnings(
    table: StepperScene, stepper: Stepper, ideal: Crawl, moved: BristleMotion
) -> Iterator[str]:
    if ideal.glides or ideal.drops:
        yield (
            "the gait makes the worm glide: load and drag do not hold it back, as the stepped "
            "motion assumes; speed_ideal counts the glide"
        )
    runs = sum(len(turning_times(ideal.gait, j)) for j in range(ideal.gait.links))
    if moved.speed > ideal.speed + runs * stepper.travel / ideal.gait.period:
        yield (
            "faster than the ideal gait: links that should shorten and lengthen together step "
            "in turns, and bristles that hold at once make way of it; a backslip of "
            f"{stepper.travel:g} m or more ends that"
        )
    if table.bristles.backslip == 0:
        yield "bristles.backslip is 0: real bristles lose about that much at every handover"
    if moved.speed <= _ACCEPTED * ideal.drive.rate_scale:
        yield "the worm makes no way: backslip eats the strokes"


def _short_pauses(stepper: Stepper, asked: Demand, steps: Steps) -> Iterator[str]:
    """Name the motors whose pulses at a turn come faster than the gait's largest rate.

    On a run of a length that cannot be; at a turn two opposite pulses lie as little as twice the
    hysteresis apart, of which the limits on the gait's own rates know nothing.
    """
    for j, interval in enumerate(steps.intervals_min):
        largest = float(asked.rate[j]) * stepper.pulses_per_turn
        times = 1 / (interval * largest) if interval > 0 else np.inf
        at_once = interval * stepper.start_rate * stepper.pulses_per_turn >= 1
        if np.isfinite(interval) and times > 1 + _ACCEPTED and not at_once:
            yield (
                f"motor {j + 1} reverses with two pulses {interval:.3g} s apart, {times:.3g} times "
                "as fast as the gait's largest rate and faster than motor.start_rate: it may "
                "lose them; take a larger motor.hysteresis, or a gait that rounds off its turns"
            )


def _variables(
    gait: Gait,
    stepper: Stepper,
    steps: Steps,
    ideal: Crawl,
    moved: BristleMotion,
    table: StepperScene,
) -> Iterator[Variable]:
    sampled = ideal.sample()
    t = sampled["time"]
    if table.bristles.settle_time:
        position = np.array([np.interp(t, moved.time, row) for row in moved.position])
    else:
        position = moved.position[:, np.searchsorted(moved.time, t, side="right") - 1]
    rows: dict[str, tuple[str, tuple[str, ...], Any, str]] = {
        "time": ("s", ("time",), t, "time"),
        "length": ("m", ("link", "time"), sampled["length"], "length of the gait"),
        "commanded": ("m", ("link", "time"), steps.lengths(t), "commanded length"),
        "turn_rate": ("s-1", ("link", "time"), sampled["rate"] / stepper.lead, "rate of the motor"),
        "position": ("m", ("mass", "time"), position, "position of the mass, stepped"),
        "position_ideal": ("m", ("mass", "time"), sampled["position"], "position in the gait"),
    }
    for name, (unit, dims, values, text) in rows.items():
        yield Variable(name, unit, dims, values, text)
    yield from gait_variables(gait, "SI")
    yield from _close_up(gait, steps)


def _close_up(gait: Gait, steps: Steps) -> Iterator[Variable]:
    """One link about a turn: the reversal of a motor with the least pause."""
    motors = [(j, *steps.of_motor(j)) for j in range(steps.links)]
    _, j, k = min(
        (float(at[k + 1] - at[k]), j, int(k))
        for j, at, direction in motors
        for k in np.flatnonzero(np.diff(direction))
    )
    at, _ = steps.of_motor(j)
    first, last = at[max(0, k + 1 - _SHOWN)], at[min(len(at) - 1, k + _SHOWN)]
    margin = 0.03 * (last - first)
    first, last = max(0.0, first - margin), min(steps.period, last + margin)
    t = np.unique(np.concatenate([np.linspace(first, last, 401), at[(at >= first) & (at <= last)]]))
    yield Variable("turn_time", "s", ("turn_time",), t, "time about a turn")
    yield Variable("turn_length", "m", ("turn_time",), gait(t)[j], "length of the gait")
    yield Variable("turn_commanded", "m", ("turn_time",), steps.lengths(t)[j], "commanded length")
    yield Variable("turn_link", "1", ("turn",), np.array([j + 1]), "link shown")
