"""Kind "stepper": a gait as commands for stepping motors on threaded rods."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    arrays,
    check,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.systems.shared.declared import GAIT, gait_arrays
from wormopt.systems.shared.studies import refused_at
from wormopt.systems.spiked.gait_problem import SceneWorm
from wormopt.systems.spiked.shapes import GivenGait
from wormopt.systems.spiked.stepper.stepper import Demand, Motor, Stepper, demand

with on_use():
    import numpy as np

    from wormopt.model.gait import Gait
    from wormopt.result import Result
    from wormopt.systems.spiked.bimodal import BimodalMotion
    from wormopt.systems.spiked.construct import gait_of_shape
    from wormopt.systems.spiked.crawl import Crawl, crawl
    from wormopt.systems.spiked.motion import agreement, cross_check, motion_facts
    from wormopt.systems.spiked.stepper.bristles import BristleMotion, ratchet
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
_KEYS = {  # that are scalars too, for pictures
    "turn_rate_limit": ("rate", "motor.rate_max"),
    "acceleration_limit": ("rate_change", "motor.acceleration_max"),
    "start_rate": ("rate", "motor.start_rate"),
    "backslip": ("length", "bristles.backslip"),
    "settle_time": ("time", "bristles.settle_time"),
}
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


class Bristles(Given):
    """The bristles under the masses."""

    backslip: float = number(
        "length", "distance a mass slips back before the bristles hold", least=0, default=0.0
    )
    settle_time: float = number(
        "time", "duration of a link's step at a constant rate; 0 is immediate", least=0, default=0.0
    )


@dataclass(frozen=True)
class Commands:
    """Steps of all motors in order of time."""

    step_count: np.ndarray = value("count", "steps of each motor per period, both directions")
    step_interval_min: float = value(
        "time", "shortest interval between two steps of one motor, across the end of the period too"
    )
    step_time: np.ndarray = signal("time", "step", "time of the step")
    step_motor: np.ndarray = signal("1", "step", "motor; motor j drives link j")
    step_direction: np.ndarray = signal("1", "step", "1: the link lengthens, -1: it shortens")
    length_start: np.ndarray = signal("length", "link", "length at time 0")


@dataclass(frozen=True)
class Signals:
    """Lengths and positions, stepped and ideal, at the times of the ideal gait."""

    time: np.ndarray = signal("time", "time", "time")
    length: np.ndarray = signal("length", "link time", "length of the gait")
    commanded: np.ndarray = signal("length", "link time", "commanded length")
    turn_rate: np.ndarray = signal("rate", "link time", "rate of the motor")
    position: np.ndarray = signal("length", "mass time", "position of the mass, stepped")
    position_ideal: np.ndarray = signal("length", "mass time", "position of the mass, ideal gait")


@dataclass(frozen=True)
class Reversal:
    """Samples of one link near a reversal."""

    turn_time: np.ndarray = signal("time", "turn_time", "time near a reversal")
    turn_length: np.ndarray = signal("length", "turn_time", "length of the gait near a reversal")
    turn_commanded: np.ndarray = signal("length", "turn_time", "commanded length near a reversal")
    turn_link: np.ndarray = signal("1", "turn", "link shown; the first is 0")


class StepperCommands(Study, kind="stepper"):
    """Convert a gait into stepping-motor commands and simulate the resulting motion.

    The commands drive stepping motors on threaded rods, like the prototype in section 2.5 of
    Zimmermann et al. 2007 [1]. The worm moves on bristles that slip back a little. See
    [prototype](../prototype.md). `units` must be `"SI"`. Additional files: `steps.csv`, `steps.c`.
    Mass, drag and load affect the ideal gait only.

    Refused: a `start_rate` above `rate_max`; a `settle_time` not below the period. Refused at run
    time: more than two million steps of a motor; two steps of a motor on one tick; a period with
    more ticks than 32 bits hold; a gait whose lengths jump. Exit code 3: a gait too fast for the
    motors (the message gives the smallest period); a gait that moves no motor.

    The trust report contains `replay` (`steps.csv` is read back and counted: `error_in_steps`,
    `accepted`), `tick_error` (share of a tick, at most 1/2), `period_error` (m, distance by which
    the motion does not close), `ideal` (trust report of the gait), `assumptions` and `warnings`.
    Warnings: the worm glides; no backslip is given; alternating steps carry the worm forward; the
    worm does not advance; a motor reverses with pulses that follow each other faster than the
    gait's largest rate and `start_rate`.
    """

    pictures: ClassVar = {
        "steps": "lengths, a close-up of one link at a reversal, motor rates, positions of the "
        "masses"
    }
    exports: ClassVar = {
        "steps.csv": "wormopt.systems.spiked.stepper_commands:as_csv",
        "steps.c": "wormopt.systems.spiked.stepper_commands:as_c",
    }

    worm: SceneWorm = entry("the worm")
    gait: GivenGait = entry("the gait; `shape` selects the other keys")
    motor: Motor = entry("the motor of every link")
    bristles: Bristles = entry("the bristles under the masses", default=Bristles)
    tick: float = number(
        "time",
        "tick of the timer that runs `steps.c`",
        least=1e-09,
        most=1,
        usual=(1e-09, 1.0),
        default=1e-6,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.units != "SI":
            yield (
                "units",
                f'"{self.units}", but motors are commanded in s and m; write units = "SI"',
            )
        yield from self.worm.faults_in_scene(self.units)
        yield from self.gait.faults(self.worm.links, self.folder)
        period = self.gait.period
        if period is not None and self.bristles.settle_time >= period:
            yield (
                "bristles.settle_time",
                f"{self.bristles.settle_time:g} s is not below the period of {period:g} s; write "
                "a smaller value",
            )

    # -- commands ----------------------------------------------------------------------------------

    @cached_property
    def lengths(self) -> Gait:
        """Lengths of the links that the motors follow."""
        return gait_of_shape(self.gait, self.scene)

    @stage
    def demand(self) -> Demand:
        with refused_at(self, "gait.file"):
            return demand(self.lengths, self.motor)

    @stage
    def steps(self) -> Steps:
        self.demand.refuse(self.motor)
        with refused_at(self, "motor.microsteps"):
            steps = step_times(self.lengths, self.motor)
        if not len(steps.time):
            raise SolveError(
                f"no length changes by half a microstep of {steps.travel:g} m: no motor steps",
                "give a gait with a longer stroke, or increase motor.microsteps",
                code="no_steps",
            )
        return steps

    @cached_property
    def tick_error(self) -> float:
        """Largest error of the timer's instants, in ticks, from the sum of its delays."""
        with refused_at(self, "tick"):
            _, delays = in_ticks(self.steps, self.tick)
        late = [
            np.abs(np.cumsum(delay[:-1]) - self.steps.of_motor(j)[0] / self.tick)
            for j, delay in enumerate(delays)
        ]
        return max(float(one.max()) for one in late if one.size)

    @stage
    def replay_error(self) -> float:
        """Largest difference between gait and commands read back from their table, in steps."""
        again = read_csv(csv_text(self.steps))
        return float(quantisation_error(self.lengths, again).max()) / self.steps.travel

    @property
    def replay_accepted(self) -> float:
        """Error of the commands that rounding to steps explains, in steps."""
        return 0.5 + self.motor.hysteresis + _ROUNDING

    # -- motion ------------------------------------------------------------------------------------

    @stage
    def ideal(self) -> Crawl:
        plant = self.worm
        loads = plant.loads(plant.load_range[1])
        return crawl(self.lengths, plant.masses, plant.drag, loads, self.gait.sharing)

    @stage
    def second_route(self) -> BimodalMotion:
        return cross_check(self.ideal)

    @stage
    def motion(self) -> BristleMotion:
        return ratchet(self.steps, self.bristles.backslip, self.bristles.settle_time)

    @stage
    def motion_without_backslip(self) -> BristleMotion:
        return ratchet(self.steps, 0.0, self.bristles.settle_time)

    # -- results -----------------------------------------------------------------------------------

    @parts(Demand)
    def demands(self) -> Demand:
        return self.demand

    @scalar("rate", "largest rate of each motor, microsteps per second")
    def step_rate_max(self) -> np.ndarray:
        return self.demand.turn_rate_max * self.motor.pulses_per_turn

    @scalar("time", "smallest period that the motors can follow")
    def period_min(self) -> float:
        return self.demand.period_min

    @scalar("1", "the key that limits `period_min`")
    def period_limited_by(self) -> str:
        return f"motor.{self.demand.strictest.name}"

    @scalars({name: (quantity, f"`{key}`") for name, (quantity, key) in _KEYS.items()})
    def settings(self) -> Mapping[str, float]:
        return {name: attrgetter(key)(self) for name, (_, key) in _KEYS.items()}

    @scalar("length", "change of length per microstep")
    def travel_per_step(self) -> float:
        return self.motor.travel

    @parts(Commands)
    def commands(self) -> Commands:
        steps = self.steps
        return Commands(
            step_count=steps.counts,
            step_interval_min=steps.interval_min,
            step_time=steps.time,
            step_motor=steps.motor,
            step_direction=steps.direction,
            length_start=steps.start,
        )

    @scalar(
        "length",
        "largest difference between commanded length and gait, over all time",
        name="quantisation_error",
    )
    def largest_error(self) -> float:
        return self.replay_error * self.motor.travel

    @scalar("speed", "mean speed of the stepped worm", headline=True)
    def speed(self) -> float:
        return self.motion.speed

    @scalar("length", "distance travelled by the stepped worm per period", headline=True)
    def advance(self) -> float:
        return self.speed * self.lengths.period

    @scalar("speed", "mean speed of the ideal gait, as in kind `gait`", headline=True)
    def speed_ideal(self) -> float:
        return self.ideal.speed

    @scalar("speed", "mean speed of the stepped worm without backslip", headline=True)
    def speed_without_backslip(self) -> float:
        return self.motion_without_backslip.speed

    @scalar("speed", "`speed_ideal` minus `speed`", headline=True)
    def speed_lost(self) -> float:
        return self.speed_ideal - self.speed

    @scalar("time", "`tick` of the timer", name="tick")
    def timer_tick(self) -> float:
        return self.tick

    @scalar("1", "resting masses of the ideal gait, phase by phase")
    def mode_sequence(self) -> Any:
        return self.ideal.resting_sequence

    @scalar("speed", "difference in ideal speed between the two routes")
    def recheck_speed_error(self) -> float:
        return abs(self.second_route.speed - self.ideal.speed)

    @parts(Signals)
    def signals(self) -> Signals:
        sampled, moved = self.ideal.sample(), self.motion
        t = sampled["time"].reshape(-1)
        if self.bristles.settle_time:
            position = np.array([np.interp(t, moved.time, row) for row in moved.position])
        else:
            position = moved.position[:, np.searchsorted(moved.time, t, side="right") - 1]
        return Signals(
            time=t,
            length=sampled["length"],
            commanded=self.steps.lengths(t),
            turn_rate=sampled["rate"] / self.motor.lead,
            position=position,
            position_ideal=sampled["position"],
        )

    @arrays(GAIT)
    def pieces_of_gait(self) -> Mapping[str, Any]:
        return gait_arrays(self.lengths)

    @parts(Reversal)
    def reversal(self) -> Reversal:
        """The one with the shortest pause of all motors."""
        steps = self.steps
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
        shown = at[(at >= first) & (at <= last)]
        t = np.unique(np.concatenate([np.linspace(first, last, 401), shown]))
        return Reversal(
            turn_time=t,
            turn_length=self.lengths(t)[j],
            turn_commanded=steps.lengths(t)[j],
            turn_link=np.array([j]),
        )

    @check("replay_accepted", "the replayed steps differ from the gait by {value:.4g} microsteps")
    def replayed_steps(self) -> float:
        return self.replay_error

    @check(0.5 * (1 + 1e-6), "steps are off by {value:.3g} ticks")
    def ticks(self) -> float:
        return self.tick_error

    @property
    def closing_accepted(self) -> float:
        """Distance by which the motion may fail to close: rounding."""
        return _ACCEPTED * float(np.abs(self.motion.position).max())

    @check(
        "closing_accepted",
        "the stepped motion does not close after a period, by {value:.2g}",
        "length",
    )
    def closing_of_the_stepped_motion(self) -> float:
        return self.motion.period_error

    @checks
    def agreements(self) -> Iterator[Check]:
        yield from agreement(self.ideal, self.second_route)

    @facts
    def evidence(self) -> Mapping[str, Any]:
        return {
            "replay": {
                "method": "steps.csv is read back; its rows are counted on both sides of each step",
                "error_in_steps": self.replay_error,
                "accepted": self.replay_accepted,
            },
            "tick_error": self.tick_error,
            "period_error": self.motion.period_error,
            "ideal": motion_facts(self.ideal, self.second_route),
            "assumptions": _ASSUMED,
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        ideal, speed = self.ideal, self.speed
        if ideal.glides or ideal.drops:
            yield (
                "the worm glides with this gait: load and drag do not hold it back, as the stepped "
                "motion assumes; speed_ideal includes the glide"
            )
        runs = sum(len(turning_times(ideal.gait, j)) for j in range(ideal.gait.links))
        travel = self.motor.travel
        if speed > ideal.speed + runs * travel / ideal.gait.period:
            yield (
                "the stepped worm is faster than the ideal gait: links that should shorten and "
                "lengthen together step alternately, and bristles without backslip turn this into "
                f"advance; a backslip of {travel:g} m or more prevents it"
            )
        if self.bristles.backslip == 0:
            yield "bristles.backslip is 0: real bristles slip back at every handover"
        if speed <= _ACCEPTED * ideal.drive.rate_scale:
            yield "the worm does not advance: backslip cancels the strokes"
        yield from short_pauses(self.motor, self.demand, self.steps)


def short_pauses(stepper: Stepper, needed: Demand, steps: Steps) -> Iterator[str]:
    """Warn of motors whose pulses at a reversal are faster than the gait's largest rate."""
    # Away from reversals this cannot happen. At a reversal two opposite pulses are as little as
    # twice the hysteresis apart, which the limits on the gait's own rates do not cover.
    for j, interval in enumerate(steps.intervals_min):
        largest = float(needed.turn_rate_max[j]) * stepper.pulses_per_turn
        times = 1 / (interval * largest) if interval > 0 else np.inf
        at_once = interval * stepper.start_rate * stepper.pulses_per_turn >= 1
        if np.isfinite(interval) and times > 1 + _ACCEPTED and not at_once:
            yield (
                f"motor {j} reverses with two pulses {interval:.3g} s apart, {times:.3g} times as "
                "fast as the gait's largest rate and faster than motor.start_rate: it may lose "
                "steps; increase motor.hysteresis, or use a gait with smoother reversals"
            )


# -- files ---------------------------------------------------------------------------------------


def _steps_of(result: Result) -> Steps:
    """Commands in a ``stepper`` result."""
    return Steps(
        result.scalars["period"].value,
        result.scalars["travel_per_step"].value,
        result["length_start"].values,
        result["step_time"].values,
        result["step_motor"].values.astype(int),
        result["step_direction"].values.astype(int),
    )


def as_csv(result: Result) -> str | None:
    """Text of ``steps.csv``; None if the result is not ok: no motor runs with it."""
    return csv_text(_steps_of(result)) if result.status == "ok" else None


def as_c(result: Result) -> str | None:
    """Text of ``steps.c``; None if the result is not ok: no motor runs with it."""
    if result.status != "ok":
        return None
    return c_text(_steps_of(result), result.scalars["tick"].value)
