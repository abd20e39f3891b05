"""Patterns of currents that travel along a row of coils.

All coils have one waveform, delayed by one step from coil to coil: the pattern moves by a coil per
step. It has `per_step` values per step, which hold, or are corners of a polyline. A current between
two corners lies between theirs and its slope is that of the chord, so limits at the corners are
limits at all times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wormopt.model.gait import Gait

Form = Literal["ramps", "steps"]


@dataclass(frozen=True, eq=False)
class Pattern:
    """Waveform of one coil over a period, after which the pattern repeats."""

    values: np.ndarray  # (repeat * per_step,) ampere-turns of coil 0, equidistant from time 0 on
    rate: float  # steps per second
    per_step: int  # values per step
    form: Form = "ramps"  # corners of a polyline, or values that hold

    @property
    def repeat(self) -> int:
        """Number of coils after which the pattern repeats."""
        return len(self.values) // self.per_step

    def at(self, k: np.ndarray, count: int) -> np.ndarray:
        """Return ampere-turns (count, len(k)) of the coils, values k."""
        own = k - self.per_step * np.arange(count)[:, None]
        return self.values[own % len(self.values)]

    def pieces(self, count: int, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ampere-turns (count, pieces) at the start of each piece, slopes, and durations.

        Slopes are in ampere-turns per second, durations in s; the last piece ends at `time`.
        """
        whole = 1 / (self.rate * self.per_step)
        k = np.arange(max(1, math.ceil(time / whole - 1e-9)))
        begin = self.at(k, count)
        growth = self.at(k + 1, count) - begin if self.form == "ramps" else np.zeros_like(begin)
        lengths = np.full(len(k), whole)
        lengths[-1] = time - whole * k[-1]
        return begin, growth / whole, lengths

    def course(self, count: int) -> Gait:
        """Return the ampere-turns of all coils over a period."""
        begin, slopes, lengths = self.pieces(count, self.repeat / self.rate)
        breaks = lengths[0] * np.arange(len(self.values) + 1)
        return Gait(breaks, np.stack([begin.T, slopes.T], axis=2))

    @property
    def largest(self) -> float:
        """Largest ampere-turns, at all times."""
        return float(np.abs(self.values).max())

    @property
    def slew(self) -> float:
        """Largest slope of a current, in ampere-turns per second; infinite if it jumps."""
        jump = float(np.abs(np.diff(self.values, append=self.values[0])).max())
        if self.form == "steps":
            return np.inf if jump else 0.0
        return jump * self.rate * self.per_step

    @property
    def square(self) -> float:
        """Mean square of a coil's ampere-turns over a period."""
        one = self.values
        if self.form == "steps":
            return float(np.mean(one**2))
        other = np.roll(one, -1)
        return float(np.mean(one**2 + one * other + other**2) / 3)

    def later(self, share: float) -> Pattern:
        """Return the pattern delayed by a share of its period, to the nearest value."""
        return replace(self, values=np.roll(self.values, round(share * len(self.values))))

    def paced(self, share: float, rates: tuple[float, float]) -> Pattern:
        """Return the pattern at a multiple of its rate, within the range of rates."""
        return replace(self, rate=float(np.clip(share * self.rate, *rates)))

    def kept(self, limit: float, slew: float | None = None) -> Pattern:
        """Return the pattern within limits: too large values cut, too steep ones scaled to 0."""
        kept = replace(self, values=np.clip(self.values, -limit, limit))
        if slew is None or kept.slew <= slew:
            return kept
        return replace(kept, values=kept.values * (slew / kept.slew))


def block(on: int, amount: float, rate: float, repeat: int, per_step: int, form: Form) -> Pattern:
    """Return blocks of active coils: jumps as `magnetics.switched_course`, or ramps of a piece."""
    behind = -np.arange(repeat * per_step) % (repeat * per_step)
    lit = behind < on * per_step if form == "ramps" else (-(-behind // per_step)) % repeat < on
    return Pattern(np.where(lit, amount, 0.0), rate, per_step, form)
