"""Brent's method."""

from __future__ import annotations

from collections.abc import Callable


def root(
    function: Callable[[float], float], low: float, high: float, *, xtol: float = 1e-15
) -> float:
    """Root of `function` between `low` and `high`, where it has opposite signs, to `xtol`."""
    from scipy.optimize import brentq  # slow to import, and most scenes need none

    found = brentq(function, low, high, xtol=xtol)
    return float(found)  # pyright: ignore[reportArgumentType]  one number without full_output
