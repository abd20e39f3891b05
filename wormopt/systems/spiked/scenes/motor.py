"""The ``[motor]`` table: stepping motors on threaded rods, one per link."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, Positive, Table

Count = Annotated[int, Meta(ge=1, le=100_000, description="a whole number from 1 to 100000")]


class MotorTable(Table, frozen=True, kw_only=True):
    """A stepping motor on a threaded rod; every link has one of its kind.

    Parameters
    ----------
    lead : float
        Way along the rod per turn.
    steps_per_turn : int
        Full steps per turn.
    microsteps : int
        Microsteps per full step.
    rate_max : float
        Largest rate, turns per time.
    acceleration_max : float
        Largest change of the rate, turns per time squared.
    start_rate : float
        Up to this rate the motor starts, stops and reverses at once.
    hysteresis : float
        Share of a microstep by which a length must pass the middle between two positions.

    Examples
    --------
    >>> motor = MotorTable(lead=2e-3, rate_max=5.0, acceleration_max=20.0)
    >>> motor.length_rate, motor.length_acceleration
    (0.01, 0.04)
    """

    lead: Positive
    steps_per_turn: Count = 200
    microsteps: Count = 1
    rate_max: Positive
    acceleration_max: Positive
    start_rate: NonNegative = 0.0
    hysteresis: Annotated[float, Meta(ge=0, le=0.4, description="a number from 0 to 0.4")] = 0.05

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
