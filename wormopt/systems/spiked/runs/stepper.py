"""Runs scenes of kind ``stepper``: step commands of a gait, and the motion they produce."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.motion import agreement, cross_check, gait_arrays, motion_facts
from wormopt.systems.spiked.reference import gait_of_shape
from wormopt.systems.spiked.scenes.stepper import StepperScene
from wormopt.systems.spiked.stepper.bristles import BristleMotion, ratchet
from wormopt.systems.spiked.stepper.stepper import Demand, Stepper, demand
from wormopt.systems.spiked.stepper.steps import (
    Steps,
    c_text,
    csv_text,
    in_ticks,
    quantisation_error,
    read_csv,
    step_times,
    turning_times,
)

_ACCEPTED = 1e-9  # share of the distance (motion) or of the link rates (speeds)
_ROUNDING = 1e-6  # share of a microstep: a length has up to a million of them
_SHOWN = 8  # steps before and after a reversal in the close-up of the picture
_ASSUMED = {
    "bristles": "a mass slips back by bristles.backslip from its foremost position; then its "
    "bristles hold against any force",
    "load": "load and drag pull the worm back until bristles hold: no mass glides, and masses have "
    "no inertia in the stepped motion",
    "motors": "all links have the same motor; within the limits of rate and acceleration no step "
    "is lost at any force",
    "rods": "rods are rigid, without play",
}


def run(scene: Scene[StepperScene], report: Report) -> Result:
    """Convert the scene's gait to steps, replay them, and compute the motion they produce.

    The result is "failed" if the replay differs from the gait by more than rounding, or if the
    second route differs. Raises SolveError if the gait is too fast, moves no motor or does
    not fit the timer; SceneError for a bad file or a jump.
    """
    table, begin = scene.table, time.perf_counter()
    report("inverting lengths", 0.0)
    gait = gait_of_shape(table.gait, scene)
    stepper = Stepper(**msgspec.structs.asdict(table.motor))
    asked, steps = _commands(scene, gait, stepper)
    report("crawling", 0.4)
    worm = table.worm
    plant = worm.worm
    loads = plant.loads(plant.load_range[1])
    ideal = crawl(gait, plant.masses, plant.drag, loads, table.gait.sharing)
    again = cross_check(ideal)
    report("moving by steps", 0.7)
    bristles = table.bristles
    moved = ratchet(steps, bristles.backslip, bristles.settle_time)
    held = ratchet(steps, 0.0, bristles.settle_time)
    # from the text of the table, in steps
    error = float(quantisation_error(gait, read_csv(csv_text(steps))).max()) / steps.travel
    bound, late = 0.5 + stepper.hysteresis + _ROUNDING, _ticks(steps, table.tick, scene)
    return conclude(
        scene,
        {
            **_demanded(asked, stepper),
            "speed": moved.speed,
            "advance": moved.speed * gait.period,
            "speed_ideal": ideal.speed,
            "speed_without_backslip": held.speed,
            "speed_lost": ideal.speed - moved.speed,
            "step_count": steps.counts,
            "travel_per_step": stepper.travel,
            "step_interval_min": steps.interval_min,
            "backslip": bristles.backslip,
            "settle_time": bristles.settle_time,
            "tick": table.tick,
            "mode_sequence": ideal.resting_sequence,
            "quantisation_error": error * stepper.travel,
            "recheck_speed_error": abs(again.speed - ideal.speed),
        },
        {
            "step_time": steps.time,
            "step_motor": steps.motor,
            "step_direction": steps.direction,
            "length_start": steps.start,
            **_signals(stepper, steps, ideal, moved, bristles.settle_time),
            **gait_arrays(gait),
            **_close_up(gait, steps),
        },
        checks=(*_checks(error, bound, late, moved), *agreement(ideal, again)),
        facts={
            "replay": {
                "method": "steps.csv is read back; its rows are counted on both sides of each step",
                "error_in_steps": error,
                "accepted": bound,
            },
            "tick_error": late,
            "period_error": moved.period_error,
            "ideal": motion_facts(ideal, again),
            "assumptions": _ASSUMED,
        },
        warnings=(
            *_warnings(table, stepper, ideal, moved),
            *_short_pauses(stepper, asked, steps),
        ),
        timings={"solve": time.perf_counter() - begin},
    )


def _commands(scene: Scene[StepperScene], gait: Gait, stepper: Stepper) -> tuple[Demand, Steps]:
    """Demand of the gait on the motors, and their steps; errors include the demand."""
    try:
        asked = demand(gait, stepper)
    except ArgumentError as error:
        raise SceneError(scene.name, [("gait.file", str(error))]) from None
    known = conclude(scene, _demanded(asked, stepper))
    try:
        steps = step_times(gait, stepper)
    except SolveError as error:
        partial = known.failed(str(error))
        raise SolveError(error.reason, error.suggestion, partial, error.code) from None
    except ArgumentError as error:
        raise SceneError(scene.name, [("motor.microsteps", str(error))]) from None
    if not len(steps.time):
        reason = f"no length changes by half a microstep of {stepper.travel:g} m: no motor steps"
        suggestion = "give a gait with a longer stroke, or increase motor.microsteps"
        raise SolveError(reason, suggestion, known.failed(reason), "no_steps")
    return asked, steps


def _ticks(steps: Steps, tick: float, scene: Scene[StepperScene]) -> float:
    """Largest error of the timer's instants, in ticks, from the sum of its delays."""
    try:
        _, delays = in_ticks(steps, tick)
    except ArgumentError as error:
        raise SceneError(scene.name, [("tick", str(error))]) from None
    late = [
        np.abs(np.cumsum(delay[:-1]) - steps.of_motor(j)[0] / tick)
        for j, delay in enumerate(delays)
    ]
    return max(float(one.max()) for one in late if one.size)


def _demanded(asked: Demand, stepper: Stepper) -> dict[str, Any]:
    return {
        "turn_rate_max": asked.rate,
        "step_rate_max": asked.rate * stepper.pulses_per_turn,
        "acceleration_max": asked.acceleration,
        "period": asked.period,
        "period_min": asked.period_min,
        "period_limited_by": f"motor.{asked.strictest.name}",
        "turn_rate_limit": stepper.rate_max,
        "acceleration_limit": stepper.acceleration_max,
        "start_rate": stepper.start_rate,
    }


def _checks(error: float, bound: float, late: float, moved: BristleMotion) -> Iterator[Check]:
    advice = f"the replayed steps differ from the gait by {error:.4g} microsteps"
    yield Check("replayed steps", error, bound, advice)
    yield Check("ticks", late, 0.5 * (1 + 1e-6), f"steps are off by {late:.3g} ticks")
    size, off = float(np.abs(moved.position).max()), moved.period_error
    advice = f"the stepped motion does not close after a period, by {off:.2g} m"
    yield Check("closing of the stepped motion", off, _ACCEPTED * size, advice)


def _warnings(
    table: StepperScene, stepper: Stepper, ideal: Crawl, moved: BristleMotion
) -> Iterator[str]:
    if ideal.glides or ideal.drops:
        yield (
            "the worm glides with this gait: load and drag do not hold it back, as the stepped "
            "motion assumes; speed_ideal includes the glide"
        )
    runs = sum(len(turning_times(ideal.gait, j)) for j in range(ideal.gait.links))
    if moved.speed > ideal.speed + runs * stepper.travel / ideal.gait.period:
        yield (
            "the stepped worm is faster than the ideal gait: links that should shorten and "
            "lengthen together step alternately, and bristles without backslip turn this into "
            "advance; "
            f"a backslip of {stepper.travel:g} m or more prevents it"
        )
    if table.bristles.backslip == 0:
        yield "bristles.backslip is 0: real bristles slip back at every handover"
    if moved.speed <= _ACCEPTED * ideal.drive.rate_scale:
        yield "the worm does not advance: backslip cancels the strokes"


def _short_pauses(stepper: Stepper, asked: Demand, steps: Steps) -> Iterator[str]:
    """Warn of motors whose pulses at a reversal are faster than the gait's largest rate.

    Away from reversals this cannot happen. At a reversal two opposite pulses are as little as
    twice the hysteresis apart, which the limits on the gait's own rates do not cover.
    """
    for j, interval in enumerate(steps.intervals_min):
        largest = float(asked.rate[j]) * stepper.pulses_per_turn
        times = 1 / (interval * largest) if interval > 0 else np.inf
        at_once = interval * stepper.start_rate * stepper.pulses_per_turn >= 1
        if np.isfinite(interval) and times > 1 + _ACCEPTED and not at_once:
            yield (
                f"motor {j} reverses with two pulses {interval:.3g} s apart, {times:.3g} times as "
                "fast as the gait's largest rate and faster than motor.start_rate: it may lose "
                "steps; increase motor.hysteresis, or use a gait with smoother reversals"
            )


def _signals(
    stepper: Stepper, steps: Steps, ideal: Crawl, moved: BristleMotion, settle_time: float
) -> dict[str, np.ndarray]:
    sampled = ideal.sample()
    t = sampled["time"].reshape(-1)
    if settle_time:
        position = np.array([np.interp(t, moved.time, row) for row in moved.position])
    else:
        position = moved.position[:, np.searchsorted(moved.time, t, side="right") - 1]
    return {
        "time": t,
        "length": sampled["length"],
        "commanded": steps.lengths(t),
        "turn_rate": sampled["rate"] / stepper.lead,
        "position": position,
        "position_ideal": sampled["position"],
    }


def _close_up(gait: Gait, steps: Steps) -> dict[str, np.ndarray]:
    """Samples of one link near the reversal with the shortest pause of all motors."""
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
    return {
        "turn_time": t,
        "turn_length": gait(t)[j],
        "turn_commanded": steps.lengths(t)[j],
        "turn_link": np.array([j]),
    }


# -- files ---------------------------------------------------------------------------------------


def steps_of_result(result: Result) -> Steps | None:
    """Commands in a ``stepper`` result; None if the run did not get that far."""
    if "step_time" not in result:
        return None
    return Steps(
        result.scalars["period"].value,
        result.scalars["travel_per_step"].value,
        result["length_start"].values,
        result["step_time"].values,
        result["step_motor"].values.astype(int),
        result["step_direction"].values.astype(int),
    )


def as_csv(result: Result) -> str | None:
    """Text of ``steps.csv``; None without steps.

    Also None if the result failed, so that no motor runs with it.
    """
    steps = _trusted(result)
    return None if steps is None else csv_text(steps)


def as_c(result: Result) -> str | None:
    """Text of ``steps.c``; None without steps.

    Also None if the result failed, so that no motor runs with it.
    """
    steps = _trusted(result)
    return None if steps is None else c_text(steps, result.scalars["tick"].value)


def _trusted(result: Result) -> Steps | None:
    return steps_of_result(result) if result.status == "ok" else None
