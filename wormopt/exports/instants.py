"""Instants with a fixed step: exact multiples of its decimal form."""

from __future__ import annotations

import math
from decimal import Decimal

import numpy as np

from wormopt.errors import ArgumentError

_MOST = 1_000_000


def multiples(step: float, first: float, last: float) -> list[Decimal]:
    """All k * step from `first` to `last`, both included but for round-off.

    The step is the shortest decimal that reads as it: three times 0.1 are 0.3. Raises
    ArgumentError if it is not positive, or there are none, or more than a million.
    """
    if not (isinstance(step, int | float) and math.isfinite(step) and step > 0):
        raise ArgumentError(f"the step must be positive, not {step!r}")
    slack = 1e-12 * max(abs(first), abs(last))
    low, high = math.ceil((first - slack) / step), math.floor((last + slack) / step)
    if high - low >= _MOST:
        raise ArgumentError(f"a step of {step:g} gives more than {_MOST} instants; take a larger")
    if high < low:
        raise ArgumentError(f"no multiple of {step:g} lies between {first:g} and {last:g}")
    exact = Decimal(repr(float(step)))
    return [k * exact for k in range(low, high + 1)]


def times(step: float, first: float, last: float) -> np.ndarray:
    """Instants of `multiples` as numbers."""
    return np.array([float(t) for t in multiples(step, first, last)])
