"""Mean velocities of motions that need not be regular, and how sure they are: batch means.

Means over several whole repeats of the switching, one after another, scatter about the mean of
them all; Student's distribution tells from their scatter how far that may be from the truth.

Source: A. M. Law, Simulation Modeling and Analysis (2015), 9.5.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

_BATCHES, _CONFIDENCE = 8, 0.95


@dataclass(frozen=True)
class Mean:
    """A mean velocity, positive with the field."""

    value: float  # m/s
    error: float  # half the width of its 95 % interval, m/s
    settled: bool  # both halves of what counts agree within errors

    @property
    def direction(self) -> int:
        """1 with the field, -1 against it, 0 where the interval holds both."""
        return 0 if not abs(self.value) > self.error else int(math.copysign(1, self.value))


def mean_velocity(time: np.ndarray, centre: np.ndarray, cycle: float, settle: float) -> Mean:
    """Mean velocity over whole repeats, of `time` and `centre` (m,).

    Skips the share `settle` of the time at the beginning; at least four repeats of duration
    `cycle` must be left.
    """
    repeats = math.floor((1 - settle) * time[-1] / cycle * (1 + 1e-9))
    batches = max(min(_BATCHES, repeats), 2)
    size = max(repeats // batches, 1) * cycle
    ends = time[-1] - size * np.arange(batches, -1, -1)
    parts = np.diff(np.interp(ends, time, centre)) / size
    halves = [_interval(part) for part in (parts[: batches // 2], parts[batches // 2 :])]
    value, error = _interval(parts)
    return Mean(value, error, not differ(*halves[0], *halves[1]))


def _interval(parts: np.ndarray) -> tuple[float, float]:
    """Mean of batches, and half the width of its interval."""
    spread = float(np.std(parts, ddof=1)) if len(parts) > 1 else 0.0
    factor = float(stdtrit(max(len(parts) - 1, 1), (1 + _CONFIDENCE) / 2))
    return float(np.mean(parts)), factor * spread / math.sqrt(len(parts))


def differ(one: float, one_error: float, other: float, other_error: float) -> float:
    """Difference of two means beyond what their errors explain; 0 where they need not differ."""
    return max(abs(one - other) - math.hypot(one_error, other_error), 0.0)
