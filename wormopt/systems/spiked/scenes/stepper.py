"""Scenes of kind "stepper": a gait as commands for stepping motors on threaded rods."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, Positive, SceneTable, Table, says
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.scenes.gait import GivenGait, WormTable

Count = Annotated[int, Meta(ge=1, le=100_000, description="a whole number from 1 to 100000")]
Slack = Annotated[float, Meta(ge=0, le=0.4, description="a number from 0 to 0.4")]
Tick = Annotated[float, Meta(ge=1e-9, le=1, description="a number of seconds from 1e-9 to 1")]


class MotorTable(Table, frozen=True, kw_only=True):
    """A stepping motor on a threaded rod; every link has one of its kind."""

    lead: Annotated[Positive, says("length", "way along the rod per turn")]
    steps_per_turn: Annotated[Count, says("count", "full steps")] = 200
    microsteps: Annotated[Count, says("count", "per full step")] = 1
    rate_max: Annotated[Positive, says("rate", "largest rate, turns per time")]
    acceleration_max: Annotated[
        Positive, says("rate_change", "largest change of the rate, turns per time squared")
    ]
    start_rate: Annotated[
        NonNegative,
        says("rate", "up to which the motor starts, stops and reverses at once"),
    ] = 0.0
    hysteresis: Annotated[
        Slack,
        says(
            "share",
            "of a microstep, by which a length must pass the middle between two positions",
        ),
    ] = 0.05

    @property
    def length_rate(self) -> float:
        """Largest rate of a length."""
        return self.lead * self.rate_max

    @property
    def length_acceleration(self) -> float:
        """Largest acceleration of a length."""
        return self.lead * self.acceleration_max

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        if self.start_rate > self.rate_max:
            yield (
                "motor.start_rate",
                f"{self.start_rate:g} is above motor.rate_max = {self.rate_max:g}; "
                "write at most that",
            )


class BristleTable(Table, frozen=True, kw_only=True):
    """The bristles under the masses."""

    backslip: Annotated[
        NonNegative, says("length", "by which a mass slips back before the bristles hold")
    ] = 0.0
    settle_time: Annotated[
        NonNegative, says("time", "that a link takes for a step, at an even rate; 0 is at once")
    ] = 0.0


class StepperScene(SceneTable, frozen=True, kw_only=True):
    """A gait as step commands, and the worm they move.

    Commands for stepping motors on threaded rods, the prototype of section 2.5, and the motion of
    the worm on bristles that slip back a little. Explained in [prototype.md](../prototype.md).
    Only `units = "SI"`. Files besides those of every result: `steps.csv`, `steps.c`. Mass, drag
    and load serve the ideal gait.

    Refused: a `start_rate` above `rate_max`; a `settle_time` not below the period; and, found when
    it runs, more than two million steps of a motor, two steps of a motor on one tick, a period of
    more ticks than 32 bits hold, a gait whose lengths jump. Exit code 3: a gait too fast for the
    motors, with the smallest period; a gait that moves no motor.

    The trust report: `replay` (`steps.csv` read back and counted: `error_in_steps`, `accepted`),
    `tick_error` (share of a tick; at most 1/2), `period_error` (m, by which the motion does not
    close), `ideal` (that of the gait), `assumptions`, `warnings`: the worm glides, no backslip was
    given, steps in turns carry the worm on, no way is made, a motor reverses with pulses that
    follow each other faster than the gait's largest rate and `start_rate`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "of the stepped worm: mean speed"),
        "advance": ("length", "of the stepped worm: way per period"),
        "speed_ideal": ("speed", "of the gait, as kind `gait` finds it"),
        "speed_without_backslip": ("speed", "stepped, with bristles that hold at once"),
        "speed_lost": ("speed", "`speed_ideal` less `speed`"),
        "step_count": ("count", "of each motor in a period, both directions"),
        "travel_per_step": ("length", "per microstep"),
        "quantisation_error": (
            "length",
            "largest distance of a commanded length from the gait's, over all time",
        ),
        "step_interval_min": (
            "time",
            "shortest between two steps of one motor, the first after the last a period later",
        ),
        "step_rate_max": ("rate", "largest rate of each motor, microsteps per second"),
        "turn_rate_max": ("rate", "the same in turns per second"),
        "acceleration_max": (
            "rate_change",
            "largest acceleration of each motor above `start_rate`, turns/s²; unknown (infinite) "
            "at a jump of the rate",
        ),
        "period": ("time", "of the gait"),
        "period_min": ("time", "smallest period that the motors can follow"),
        "period_limited_by": ("1", "the key that sets it"),
        "turn_rate_limit": ("rate", "as given"),
        "acceleration_limit": ("rate_change", "as given"),
        "start_rate": ("rate", "as given"),
        "backslip": ("length", "as given"),
        "settle_time": ("time", "as given"),
        "tick": ("time", "as given"),
        "mode_sequence": ("1", "resting masses of the ideal gait"),
        "recheck_speed_error": ("speed", "of the ideal gait, between both routes"),
    }
    variables: ClassVar = {
        "step_time": ("time", ("step",), "time of the step"),
        "step_motor": ("1", ("step",), "motor, of the link of its number"),
        "step_direction": ("1", ("step",), "1 lengthens the link"),
        "length_start": ("length", ("link",), "length at time 0"),
        "time": ("time", ("time",), "time"),
        "length": ("length", ("link", "time"), "length of the gait"),
        "commanded": ("length", ("link", "time"), "commanded length"),
        "turn_rate": ("rate", ("link", "time"), "rate of the motor"),
        "position": ("length", ("mass", "time"), "position of the mass, stepped"),
        "position_ideal": ("length", ("mass", "time"), "position in the gait"),
        "turn_time": ("time", ("turn_time",), "time about a turn"),
        "turn_length": ("length", ("turn_time",), "length of the gait"),
        "turn_commanded": ("length", ("turn_time",), "commanded length"),
        "turn_link": ("1", ("turn",), "link shown, the first is 0"),
        **GAIT,
    }

    kind: Literal["stepper"]
    want: Annotated[
        tuple[Literal["steps"], ...],
        says(
            "",
            "`steps`: lengths, a close-up of the turn of one link, rates of the motors, places of "
            "the masses",
        ),
    ] = ()
    worm: Annotated[WormTable, says("", "the worm")]
    gait: Annotated[GivenGait, says("", "`shape` decides which other keys there are")]
    motor: Annotated[MotorTable, says("", "the motor of every link")]
    bristles: Annotated[BristleTable, says("", "what holds the masses")] = field(
        default_factory=BristleTable
    )
    tick: Annotated[
        Tick, says("time", "of the timer for which `steps.c` is made", usual=(1e-9, 1.0))
    ] = 1e-6

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        if self.units != "SI":
            yield "units", 'motors are commanded in s and m: write units = "SI"'
        yield from self.worm.faults(self.units)
        yield from self.gait.faults(self.worm.links, folder)
        yield from self.motor.faults()
        period = self.gait.period
        if period is not None and self.bristles.settle_time >= period:
            yield (
                "bristles.settle_time",
                f"{self.bristles.settle_time:g} s is not below the period of {period:g} s; "
                "write less",
            )
