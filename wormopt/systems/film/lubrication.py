"""Lubrication flow of a film in a travelling wave: eqs. 27 to 29 of Zimmermann et al. 2007.

The surface z = h(xi), xi = t - x, travels forward with speed 1, in the scales of eq. 25; the flow
of the film is Q = h + C. Functions take numbers, arrays or CasADi expressions and do not check
them.
"""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np

Expression = Any
"""A float, an array, or a CasADi expression."""


def flow(h: Expression, constant: Expression) -> Expression:
    """Flow Q = h + C past a place (eq. 28): volume per time and width, forward positive."""
    return h + constant


def pressure_gradient(h: Expression, constant: Expression) -> Expression:
    """Pressure gradient F = p_x = -3 Q / h³ (eq. 28); negative pushes the fluid forward."""
    return -3 * flow(h, constant) / (h * h * h)


def velocities(
    z: Expression, h: Expression, slope: Expression, constant: Expression
) -> tuple[Expression, Expression]:
    """Velocities u along and w upward at height z over the ground (eq. 27 with h z²/2 in w).

    `slope`: derivative of h with respect to xi; `constant`: C.
    """
    F = pressure_gradient(h, constant)
    # With respect to x, which is minus the derivative with respect to xi.
    h_x, F_x = -slope, -3 * slope * (2 * h + 3 * constant) / (h * h * h * h)
    u = F * z * (z / 2 - h)
    return u, z * z * (F * h_x / 2 + F_x * (h / 2 - z / 6))


def surface_velocity(h: Expression, constant: Expression) -> Expression:
    """Velocity of the fluid along its surface, u_s = 3 Q / (2 h); `constant`: C."""
    return 3 * flow(h, constant) / (2 * h)


def stream_function(z: Expression, h: Expression, constant: Expression) -> Expression:
    """Flow below z in the wave's frame: integral of u - 1 from the ground (0) to z; C at z = h."""
    return pressure_gradient(h, constant) * z * z * (z / 6 - h / 2) - z


def field_slope(
    h: Expression, third: Expression, constant: Expression, tension: Expression = 0.0
) -> Expression:
    """Derivative of (mu - 1) H² / (8 pi) with respect to xi.

    Source: eq. 29 of Zimmermann et al. 2007 with C / h³.

    Parameters
    ----------
    h : float, ndarray or casadi.SX
        Thickness over its mean.
    third : float, ndarray or casadi.SX
        Third derivative of the thickness with respect to xi.
    constant : float or casadi.SX
        The constant C of the flow Q = h + C.
    tension : float or casadi.SX, optional
        Surface tension W.

    Returns
    -------
    float, ndarray or casadi.SX
        Slope in units of P.

    Examples
    --------
    >>> field_slope(1.0, 0.5, -0.5, tension=2.0)
    -2.5
    """
    return pressure_gradient(h, constant) - tension * third


def library_of(value: Expression) -> Any:
    """Module with the functions for a value: math, numpy, or casadi for its expressions."""
    if not symbolic(value):
        return math if isinstance(value, Real) else np
    import casadi  # Expressions exist only if casadi is loaded.

    return casadi


def symbolic(value: object) -> bool:
    """Whether a value is a CasADi expression."""
    return type(value).__module__.startswith("casadi")
