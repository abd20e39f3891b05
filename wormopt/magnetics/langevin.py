"""Langevin's function and its integral as functions of y², exact near 0 with their derivatives.

Below y = 1 both are power series, above it closed forms in which nothing cancels or overflows.
Both branches are evaluated where they are finite, so that derivatives by CasADi are those of the
branch that is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import zeta

# The series go like (y / pi)^(2 k): at y = 1 this many terms leave 1e-17.
_TERMS = 17


def log_sinh_ratio(y2: Any) -> Any:
    """ln(sinh y / y), the integral of Langevin's function from 0; `y2` is y² ≥ 0."""
    return _either(y2, lambda small: small * _sum(small, _series), _log_sinh)


def langevin_ratio(y2: Any) -> Any:
    """Langevin's function over its argument, (coth y - 1 / y) / y; `y2` is y² ≥ 0.

    It is 1/3 at 0, and falls.
    """

    # twice the derivative of the integral by y²
    def near(small: Any) -> Any:
        return _sum(small, lambda k: 2 * k * _series(k))

    return _either(y2, near, _coth)


def _series(k: int) -> float:
    """Coefficient of y^(2k) in ln(sinh y / y), from Euler's product for sinh."""
    return -((-1) ** k) * float(zeta(2 * k)) / (k * math.pi ** (2 * k))


def _sum(y2: Any, coefficient: Callable[[int], float]) -> Any:
    """Coefficients 1, 2, ... times powers 0, 1, ..., by Horner's rule."""
    found = 0.0
    for k in range(_TERMS, 0, -1):
        found = found * y2 + coefficient(k)
    return found


def _either(y2: Any, near: Callable[[Any], Any], far: Callable[[Any], Any]) -> Any:
    if isinstance(y2, ca.SX):
        small: ca.SX = y2 < 1
        inner, outer = ca.if_else(small, y2, ca.SX(0)), ca.if_else(small, ca.SX(1), y2)
        return ca.if_else(small, near(inner), far(outer))
    return np.where(np.less(y2, 1), near(np.minimum(y2, 1)), far(np.maximum(y2, 1)))[()]


def _log_sinh(y2: Any) -> Any:
    kit: Any = ca if isinstance(y2, ca.SX) else np
    y = y2**0.5
    return y - kit.log(2 * y) + kit.log(1 - kit.exp(-2 * y))


def _coth(y2: Any) -> Any:
    kit: Any = ca if isinstance(y2, ca.SX) else np
    y = y2**0.5
    decayed = kit.exp(-2 * y)
    return ((1 + decayed) / (1 - decayed) - 1 / y) / y
