"""Scenes of kind "stepper": a gait as commands for stepping motors on threaded rods."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import SceneTable
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.tables import GivenGait, WormTable


class MotorTable(Given):
    """A stepping motor on a threaded rod; all links have the same motor."""

    lead: float = positive("length", "travel along the rod per turn")
    steps_per_turn: int = whole(1, 100000, "full steps per turn", default=200)
    microsteps: int = whole(1, 100000, "microsteps per full step", default=1)
    rate_max: float = positive("rate", "largest rate, turns per time")
    acceleration_max: float = positive(
        "rate_change", "largest change of the rate, turns per time squared"
    )
    start_rate: float = number(
        "rate",
        "rate up to which the motor starts, stops and reverses without a ramp",
        least=0,
        default=0.0,
    )
    hysteresis: float = number(
        "share",
        "hysteresis as a share of a microstep: distance by which a length must pass the "
        "middle between two positions before the motor steps",
        least=0,
        most=0.4,
        default=0.05,
    )

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
                f"{self.start_rate:g} is above motor.rate_max = {self.rate_max:g}; write at most "
                "motor.rate_max",
            )


class BristleTable(Given):
    """The bristles under the masses."""

    backslip: float = number(
        "length", "distance a mass slips back before the bristles hold", least=0, default=0.0
    )
    settle_time: float = number(
        "time", "duration of a link's step at a constant rate; 0 is immediate", least=0, default=0.0
    )


class StepperScene(SceneTable):
    """A gait as step commands, and the motion that they produce.

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

    scalars: ClassVar = {
        "speed": ("speed", "mean speed of the stepped worm"),
        "advance": ("length", "distance travelled by the stepped worm per period"),
        "speed_ideal": ("speed", "mean speed of the ideal gait, as in kind `gait`"),
        "speed_without_backslip": ("speed", "mean speed of the stepped worm without backslip"),
        "speed_lost": ("speed", "`speed_ideal` minus `speed`"),
        "step_count": ("count", "steps of each motor per period, both directions"),
        "travel_per_step": ("length", "change of length per microstep"),
        "quantisation_error": (
            "length",
            "largest difference between commanded length and gait, over all time",
        ),
        "step_interval_min": (
            "time",
            "shortest interval between two steps of one motor, across the end of the period too",
        ),
        "step_rate_max": ("rate", "largest rate of each motor, microsteps per second"),
        "turn_rate_max": ("rate", "largest rate of each motor, turns per second"),
        "acceleration_max": (
            "rate_change",
            "largest acceleration of each motor above `start_rate`, turns/s²; unknown (infinite) "
            "at a jump of the rate",
        ),
        "period": ("time", "period of the gait"),
        "period_min": ("time", "smallest period that the motors can follow"),
        "period_limited_by": ("1", "the key that limits `period_min`"),
        "turn_rate_limit": ("rate", "`motor.rate_max`"),
        "acceleration_limit": ("rate_change", "`motor.acceleration_max`"),
        "start_rate": ("rate", "`motor.start_rate`"),
        "backslip": ("length", "`bristles.backslip`"),
        "settle_time": ("time", "`bristles.settle_time`"),
        "tick": ("time", "`tick` of the timer"),
        "mode_sequence": ("1", "resting masses of the ideal gait, phase by phase"),
        "recheck_speed_error": ("speed", "difference in ideal speed between the two routes"),
    }
    variables: ClassVar = {
        "step_time": ("time", ("step",), "time of the step"),
        "step_motor": ("1", ("step",), "motor; motor j drives link j"),
        "step_direction": ("1", ("step",), "1: the link lengthens, -1: it shortens"),
        "length_start": ("length", ("link",), "length at time 0"),
        "time": ("time", ("time",), "time"),
        "length": ("length", ("link", "time"), "length of the gait"),
        "commanded": ("length", ("link", "time"), "commanded length"),
        "turn_rate": ("rate", ("link", "time"), "rate of the motor"),
        "position": ("length", ("mass", "time"), "position of the mass, stepped"),
        "position_ideal": ("length", ("mass", "time"), "position of the mass, ideal gait"),
        "turn_time": ("time", ("turn_time",), "time near a reversal"),
        "turn_length": ("length", ("turn_time",), "length of the gait near a reversal"),
        "turn_commanded": ("length", ("turn_time",), "commanded length near a reversal"),
        "turn_link": ("1", ("turn",), "link shown; the first is 0"),
        **GAIT,
    }

    kind: Literal["stepper"]
    want: tuple[Literal["steps"], ...] = entry(
        "`steps`: lengths, a close-up of one link at a reversal, motor rates, positions of "
        "the masses",
        default=(),
    )
    worm: WormTable = entry("the worm")
    gait: GivenGait = entry("the gait; `shape` selects the other keys")
    motor: MotorTable = entry("the motor of every link")
    bristles: BristleTable = entry("the bristles under the masses", default=BristleTable)
    tick: float = number(
        "time",
        "tick of the timer that runs `steps.c`",
        least=1e-09,
        most=1,
        usual=(1e-09, 1.0),
        default=1e-6,
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        if self.units != "SI":
            yield (
                "units",
                f'"{self.units}", but motors are commanded in s and m; write units = "SI"',
            )
        yield from self.worm.faults(self.units)
        yield from self.gait.faults(self.worm.links, folder)
        yield from self.motor.faults()
        period = self.gait.period
        if period is not None and self.bristles.settle_time >= period:
            yield (
                "bristles.settle_time",
                f"{self.bristles.settle_time:g} s is not below the period of {period:g} s; write "
                "a smaller value",
            )
