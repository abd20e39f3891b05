"""What judges have in common: roots, least values, and whether what cannot be is refused."""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.optimize import brentq, minimize_scalar

from wormopt.errors import WormoptError

Function = Callable[[float], float]

STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
"""Where to look for a derivative, and what each look counts, over the step."""


def refused(call: Callable[[], object], *words: str) -> float:
    """0 if a call is refused by a reason with all of these words, else infinite."""
    try:
        call()
    except WormoptError as error:
        return 0.0 if all(word in str(error) for word in words) else math.inf
    return math.inf


def zero(f: Function, low: float, high: float) -> float:
    """Root of a function whose sign changes."""
    return float(brentq(f, low, high, xtol=1e-14 * max(abs(low), abs(high))))  # pyright: ignore


def least(f: Function, low: float, high: float, digits: float = 1e-9) -> tuple[float, float]:
    """Where a function is least, and its value there."""
    wide = digits * (high - low)
    found = minimize_scalar(f, bounds=(low, high), method="bounded", options={"xatol": wide})
    return float(found.x), float(found.fun)  # pyright: ignore[reportAttributeAccessIssue]
