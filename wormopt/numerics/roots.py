"""Brent's method: R. P. Brent, Algorithms for Minimization without Derivatives, 1973, chapter 4.

The steps are those of SciPy, whose import takes longer than most motions.
"""

from __future__ import annotations

import math
from collections.abc import Callable

# Smallest relative error of a root.
_RELATIVE = 4 * 2.0**-52


def root(
    function: Callable[[float], float], low: float, high: float, *, xtol: float = 1e-15
) -> float:
    """Root of `function` between `low` and `high`, where it has opposite signs, to `xtol`.

    ValueError if the signs are not opposite, or a value is NaN.
    """
    other, at = float(low), float(high)  # ends of the bracket; the value at `at` is the smaller
    f_other, f_at = float(function(other)), float(function(at))
    if f_other == 0:
        return other
    if f_at != 0 and not min(f_other, f_at) < 0 < max(f_other, f_at):
        raise ValueError(f"values {f_other:g} and {f_at:g} at the ends have no opposite signs")
    before, f_before = other, f_other
    step = last = at - before
    while True:
        if abs(f_other) < abs(f_at):
            before, at, other = at, other, at
            f_before, f_at, f_other = f_at, f_other, f_at
        least, half = (xtol + _RELATIVE * abs(at)) / 2, (other - at) / 2
        if f_at == 0 or abs(half) < least:
            return at
        guess = math.inf
        if abs(last) > least and abs(f_at) < abs(f_before):
            if before == other:
                guess = -f_at * (at - before) / (f_at - f_before)
            else:
                near, far = (f_before - f_at) / (before - at), (f_other - f_at) / (other - at)
                if size := far * near * (f_other - f_before):  # 0 where it underflows
                    guess = -f_at * (f_other * far - f_before * near) / size
        if 2 * abs(guess) < min(abs(last), 3 * abs(half) - least):
            last, step = step, guess
        else:
            last = step = half
        before, f_before = at, f_at
        at += step if abs(step) > least else math.copysign(least, half)
        f_at = float(function(at))
        if math.isnan(f_at):
            raise ValueError(f"the value at {at:g} is NaN")
        if min(f_before, f_at) < 0 < max(f_before, f_at):
            other, f_other = before, f_before
            step = last = at - before
