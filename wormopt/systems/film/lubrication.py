"""Lubrication flow of a film under a travelling wave, place by place: (27)-(29).

The surface z = h(xi), xi = t - x, travels forward with speed 1, all numbers scaled by (25); the
film passes on Q = h + C. Functions take numbers, arrays or CasADi expressions and check nothing.
"""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np

__all__ = [
    "Expression",
    "field_slope",
    "flow",
    "library_of",
    "pressure_gradient",
    "stream_function",
    "surface_velocity",
    "symbolic",
    "velocities",
]

Expression = Any
"""A float, an array, or a CasADi expression."""


def flow(h: Expression, constant: Expression) -> Expression:
    """Q = h + C: what a film passes on at a place, (28).

    Parameters
    ----------
    h : float, ndarray or casadi.SX
        Thickness there.
    constant : float or casadi.SX
        C.

    Returns
    -------
    float, ndarray or casadi.SX
        Volume per time and width, forward positive.

    Examples
    --------
    >>> flow(1.5, -0.75)
    0.75
    """
    return h + constant


def pressure_gradient(h: Expression, constant: Expression) -> Expression:
    """F = p_x = -3 Q / h³, (28).

    Parameters
    ----------
    h, constant : float, ndarray or casadi.SX
        As for `flow`.

    Returns
    -------
    float, ndarray or casadi.SX
        Where it is negative the fluid is pushed forward.

    Examples
    --------
    >>> pressure_gradient(1.0, -0.5)
    -1.5
    """
    return -3 * flow(h, constant) / (h * h * h)


def velocities(
    z: Expression, h: Expression, slope: Expression, constant: Expression
) -> tuple[Expression, Expression]:
    """Give u and w at height z over the ground, (27) with h z²/2 in w.

    Parameters
    ----------
    z : float, ndarray or casadi.SX
        Height, 0 to h.
    h, slope : float, ndarray or casadi.SX
        Thickness and its derivative by xi.
    constant : float or casadi.SX
        C.

    Returns
    -------
    u, w : float, ndarray or casadi.SX
        Velocity along and upward.

    Examples
    --------
    >>> u, w = velocities(1.0, 1.0, 0.5, -0.5)
    >>> u, w == (1 - u) * 0.5  # the surface moves with the fluid: w = h_t + u h_x
    (0.75, True)
    """
    F = pressure_gradient(h, constant)
    # By x, which is minus the derivative by xi.
    h_x, F_x = -slope, -3 * slope * (2 * h + 3 * constant) / (h * h * h * h)
    u = F * z * (z / 2 - h)
    return u, z * z * (F * h_x / 2 + F_x * (h / 2 - z / 6))


def surface_velocity(h: Expression, constant: Expression) -> Expression:
    """u_s = 3 Q / (2 h): velocity of the fluid along its surface.

    Parameters
    ----------
    h, constant : float, ndarray or casadi.SX
        As for `flow`.

    Returns
    -------
    float, ndarray or casadi.SX

    Examples
    --------
    >>> surface_velocity(1.5, -0.5)
    1.0
    """
    return 3 * flow(h, constant) / (2 * h)


def stream_function(z: Expression, h: Expression, constant: Expression) -> Expression:
    """Flow below z as seen from the wave: 0 on the ground, C on the surface, constant on paths.

    Parameters
    ----------
    z, h, constant : float, ndarray or casadi.SX
        As for `velocities`.

    Returns
    -------
    float, ndarray or casadi.SX
        Integral of u - 1 from the ground to z.

    Examples
    --------
    >>> stream_function(1.5, 1.5, -0.5)
    -0.5
    """
    return pressure_gradient(h, constant) * z * z * (z / 6 - h / 2) - z


def field_slope(
    h: Expression, third: Expression, constant: Expression, tension: Expression = 0.0
) -> Expression:
    """Derivative of (mu - 1) H² / (8 pi) by xi, (29) with C / h³.

    Parameters
    ----------
    h, third : float, ndarray or casadi.SX
        Thickness and its third derivative.
    constant : float or casadi.SX
        C.
    tension : float or casadi.SX, optional
        Number W of surface tension.

    Returns
    -------
    float, ndarray or casadi.SX

    Examples
    --------
    >>> field_slope(1.0, 0.5, -0.5, tension=2.0)
    -2.5
    """
    return pressure_gradient(h, constant) - tension * third


def library_of(value: Expression) -> Any:
    """Module whose functions take such a value: math, numpy, or casadi for its expressions.

    Parameters
    ----------
    value : float, ndarray or casadi.SX
        Any value.

    Returns
    -------
    module

    Examples
    --------
    >>> library_of(1.0).__name__, library_of(np.ones(2)).__name__
    ('math', 'numpy')
    """
    if not symbolic(value):
        return math if isinstance(value, Real) else np
    import casadi  # only who has expressions has loaded it already

    return casadi


def symbolic(value: object) -> bool:
    """Whether a value is an expression of CasADi.

    Parameters
    ----------
    value : object
        Any value.

    Returns
    -------
    bool

    Examples
    --------
    >>> symbolic(1.0)
    False
    """
    return type(value).__module__.startswith("casadi")
