"""Thin film of magnetic fluid under a travelling wave: flow and field of lubrication, (27)-(31).

The surface z = h(xi), xi = t - x, travels forward with speed 1, all numbers scaled by (25). The
mean of h is 1. The film then carries Q = h + C; C is fixed by the field being periodic. Functions
take numbers, arrays or CasADi expressions alike and check nothing. Shapes: `CosineWave` in closed
form here, any other in `wormopt.worms.film_shapes`, units in `wormopt.worms.film_units`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError

__all__ = [
    "CosineWave",
    "Peak",
    "field_slope",
    "flow",
    "library_of",
    "peak_near",
    "pressure_gradient",
    "square_wave_flow",
    "stream_function",
    "surface_velocity",
    "velocities",
]

Expression = Any
"""A float, an array, or a CasADi expression."""

_STEPS = 50


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


def square_wave_flow(delta: Expression) -> Expression:
    """Least upper bound of the mean flow of all shapes within 1 - delta and 1 + delta at W = 0.

    The square wave has it, which lubrication cannot describe at its jumps.

    Parameters
    ----------
    delta : float, ndarray or casadi.SX
        Half of the height of the wave, 0 to 1.

    Returns
    -------
    float, ndarray or casadi.SX
        (3 delta² + delta⁴) / (1 + 3 delta²).

    Examples
    --------
    >>> square_wave_flow(1.0)
    1.0
    """
    square = delta * delta
    return square * (3 + square) / (1 + 3 * square)


@dataclass(frozen=True)
class Peak:
    """Where the field function D is largest.

    Parameters
    ----------
    value : float
        (mu - 1) D / (8 pi) there: the least (mu - 1) H0² / (8 pi) for which H² is nowhere negative.
    xi : float
        Where, from 0 to 2 pi.
    """

    value: float
    xi: float


@dataclass(frozen=True)
class CosineWave:
    """The shape h = 1 + delta cos(xi), all in closed form.

    Parameters
    ----------
    delta : float or casadi.SX
        Amplitude; a number must be above 0 and below 1.

    Raises
    ------
    ArgumentError
        If the amplitude is a number that is not.

    Examples
    --------
    >>> wave = CosineWave(0.5)
    >>> round(wave.constant, 6), round(wave.mean_flow, 6)
    (-0.666667, 0.333333)
    >>> round(wave.peak().value, 6)
    1.86339
    """

    delta: Any

    def __post_init__(self) -> None:
        if _symbolic(self.delta):
            return
        fine = isinstance(self.delta, Real) and 0 < float(self.delta) < 1
        if not fine or isinstance(self.delta, bool):
            raise ArgumentError(f"delta must be a number above 0 and below 1, not {self.delta!r}")
        object.__setattr__(self, "delta", float(self.delta))

    @property
    def constant(self) -> Any:
        """C = -2 (1 - delta²) / (2 + delta²)."""
        square = self.delta * self.delta
        return -2 * (1 - square) / (2 + square)

    @property
    def mean_flow(self) -> Any:
        """1 + C = 3 delta² / (2 + delta²), without its cancellation."""
        square = self.delta * self.delta
        return 3 * square / (2 + square)

    def height(self, xi: Expression, order: int = 0) -> Expression:
        """Thickness h, or a derivative of it by xi.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x.
        order : int, optional
            Of the derivative.

        Returns
        -------
        float, ndarray or casadi.SX

        Examples
        --------
        >>> CosineWave(0.5).height(0.0), CosineWave(0.5).height(0.0, 2)
        (1.5, -0.5)
        """
        library = library_of(xi)
        wave = library.sin(xi) if order % 2 else library.cos(xi)
        sign = -1 if order % 4 in (1, 2) else 1
        return (0 if order else 1) + sign * self.delta * wave

    def pressure(self, xi: Expression) -> Expression:
        """Pressure in the film less its mean over xi, 3 int d xi (1 / h² + C / h³).

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase.

        Returns
        -------
        float, ndarray or casadi.SX
            It does not depend on W.

        Examples
        --------
        >>> round(CosineWave(0.5).pressure(2.0), 6)
        1.732069
        """
        library, delta = library_of(xi), self.delta
        h, c = self.height(xi), library.cos(xi)
        square = delta * delta
        return 3 * delta * library.sin(xi) * (2 + delta * c) / ((2 + square) * h * h)

    def field_function(self, xi: Expression, tension: Expression = 0.0) -> Expression:
        """(mu - 1) D / (8 pi) of (31), with the mean 0.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase.
        tension : float or casadi.SX, optional
            Number W of surface tension.

        Returns
        -------
        float, ndarray or casadi.SX
            (mu - 1) (H0² - H²) / (8 pi).

        Examples
        --------
        >>> CosineWave(0.5).field_function(0.0, tension=2.0)
        -1.0
        """
        return self.pressure(xi) + tension * self.height(xi, 2)

    def peak(self, tension: float = 0.0) -> Peak:
        """Maximum of the field function.

        Its slope times h³ is a polynomial of degree 8 in exp(i xi) over its fourth power. The
        maximum is at the phase of one of its zeros, and nowhere is the function larger.

        Parameters
        ----------
        tension : float, optional
            Number W of surface tension, 0 or above.

        Returns
        -------
        Peak

        Examples
        --------
        >>> peak = CosineWave(0.5).peak(tension=1.0)
        >>> round(peak.value, 6), round(peak.xi, 6)
        (2.212585, 2.383186)
        """
        h = np.array([self.delta / 2, 1.0, self.delta / 2])  # times exp(i xi)
        flow_ = np.array([self.delta / 2, self.mean_flow, self.delta / 2])
        bend = np.polymul([1.0, 0.0, -1.0], np.polymul(h, np.polymul(h, h))) / 2j
        slope = np.polyadd(tension * self.delta * bend, 3 * np.polymul([1.0, 0, 0, 0], flow_))
        roots = np.roots(slope)
        phases = np.angle(roots[roots != 0])
        best = phases[np.argmax(self.field_function(phases, tension))]
        return peak_near(self, float(best), tension)


def peak_near(wave: Any, xi: float, tension: float) -> Peak:
    """Climb from near a maximum of the field function onto it, by Newton's method.

    Parameters
    ----------
    wave : CosineWave or another shape
        Which wave.
    xi : float
        Phase near the maximum.
    tension : float
        Number W.

    Returns
    -------
    Peak
        To round-off.

    Examples
    --------
    >>> round(peak_near(CosineWave(0.5), 2.3, 0.0).xi - math.acos(-2 / 3), 12)
    0.0
    """
    C = wave.constant

    def slope(at: float) -> float:
        h = wave.height(at)
        return float(-field_slope(h, wave.height(at, 3), C, tension))

    for _ in range(_STEPS):
        h, h1 = wave.height(xi), wave.height(xi, 1)
        bend = -3 * h1 * (2 * h + 3 * C) / h**4 + tension * wave.height(xi, 4)
        step = -slope(xi) / bend if bend < 0 else 0.0
        if not step or abs(slope(xi + step)) >= abs(slope(xi)):
            break
        xi += float(step)
    return Peak(float(wave.field_function(xi, tension)), xi % (2 * math.pi))


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
    if not _symbolic(value):
        return math if isinstance(value, Real) else np
    import casadi  # only who has expressions has loaded it already

    return casadi


def _symbolic(value: object) -> bool:
    return type(value).__module__.startswith("casadi")
