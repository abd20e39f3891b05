"""Objective of the currents: the fastest float, or a given speed with least power."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wormopt.systems.coils.design.pattern import Form, Pattern
from wormopt.systems.coils.design.rides import Rides
from wormopt.systems.coils.tables import Copper

Seek = Literal["speed", "power"]
# Penalty: a relative shortfall of the speed counts as this multiple of it in power of all coils.
_PENALTY = 10.0


@dataclass(frozen=True, eq=False)
class Judged:
    """A pattern, and its results."""

    pattern: Pattern
    name: str  # sort of the pattern, or of its origin
    speed: float  # m/s, mean of the float; -inf if the simulation fails
    power: float  # W, mean
    value: float  # objective, to maximise


@dataclass(frozen=True)
class Task:
    """Objective and limits."""

    rides: Rides
    copper: Copper
    seek: Seek
    form: Form
    per_step: int  # values per step
    rates: tuple[float, float]  # steps per second
    speed: float | None = None  # m/s, required; for seek = "power"
    slew: float | None = None  # ampere-turns per second

    @property
    def limit(self) -> float:
        """Largest ampere-turns of a coil."""
        return self.rides.row.coil.ampere_turns

    def judge(self, job: tuple[str, Pattern]) -> Judged:
        """Simulate film and float under a pattern, scaled to its limits."""
        name, pattern = job[0], job[1].kept(self.limit, self.slew)
        speed = self.rides.speed(pattern)
        power = self.copper.power(self.rides.row, pattern)
        return Judged(pattern, name, speed, power, self.value(speed, power))

    def value(self, speed: float, power: float) -> float:
        """Return the objective: the speed, or the power saved if the speed is met."""
        if self.seek == "speed" or not np.isfinite(speed):
            return speed
        assert self.speed is not None
        most = self.copper.resistance(self.rides.row) * self.rides.row.count * self.limit**2
        return -power / most - _PENALTY * max(0.0, 1 - speed / self.speed)


def best(found: Iterable[Judged]) -> Judged:
    """Return the one of the largest value."""
    return max(found, key=lambda one: one.value)
