"""What currents are wanted for: the fastest float, or a speed of it with least power."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wormopt.systems.coils.design.pattern import Copper, Form, Pattern
from wormopt.systems.coils.design.rides import Rides

Seek = Literal["speed", "power"]
# A speed too low by a share counts as so many times that share of all power that the coils take.
_PENALTY = 10.0


@dataclass(frozen=True, eq=False)
class Judged:
    """A pattern, and what it does."""

    pattern: Pattern
    name: str  # which sort of pattern it is, or from which it came
    speed: float  # m/s, mean of the float; -inf where the film cannot be followed
    power: float  # W, mean
    value: float  # the larger, the better


@dataclass(frozen=True)
class Task:
    """What is sought, and within which limits."""

    rides: Rides
    copper: Copper
    seek: Seek
    form: Form
    per_step: int  # values a step
    rates: tuple[float, float]  # steps a second
    speed: float | None = None  # m/s, wanted; for seek = "power"
    slew: float | None = None  # ampere-turns a second

    @property
    def limit(self) -> float:
        """Largest ampere-turns of a coil."""
        return self.rides.row.coil.ampere_turns

    def judge(self, job: tuple[str, Pattern]) -> Judged:
        """Follow film and float under a pattern, drawn within its limits."""
        name, pattern = job[0], job[1].kept(self.limit, self.slew)
        speed = self.rides.speed(pattern)
        power = self.copper.power(self.rides.row, pattern)
        return Judged(pattern, name, speed, power, self.value(speed, power))

    def value(self, speed: float, power: float) -> float:
        """How good it is: the speed, or the power saved where the speed is kept."""
        if self.seek == "speed" or not np.isfinite(speed):
            return speed
        assert self.speed is not None
        most = self.copper.resistance(self.rides.row) * self.rides.row.count * self.limit**2
        return -power / most - _PENALTY * max(0.0, 1 - speed / self.speed)


def best(found: Iterable[Judged]) -> Judged:
    """The one of the largest value."""
    return max(found, key=lambda one: one.value)
