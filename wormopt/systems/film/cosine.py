"""Thin film of magnetic fluid in a travelling cosine wave, in closed form.

The equations are 27 to 31 of Zimmermann et al. 2007, in the scales of eq. 25. The surface z =
h(xi), xi = t - x, travels forward with speed 1. The mean of h is 1. The flow of the film is Q = h +
C, where C follows from the periodicity of the field. The flow at a place is in
`wormopt.systems.film.lubrication`, also available from here. Other shapes are in
`wormopt.systems.film.shapes`, units in `wormopt.systems.film.units`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.film.lubrication import Expression, field_slope, library_of, symbolic

_STEPS = 50


def square_wave_flow(delta: Expression) -> Expression:
    """Least upper bound of the mean flow of all shapes within 1 ± delta at W = 0.

    (3 delta² + delta⁴) / (1 + 3 delta²), attained by the square wave, whose jumps lubrication
    theory cannot describe. `delta` is 0 to 1.
    """
    square = delta * delta
    return square * (3 + square) / (1 + 3 * square)


@dataclass(frozen=True)
class Peak:
    """Maximum of the field function D.

    `value` is the least (mu - 1) H0² / (8 pi) for which H² is nowhere negative.
    """

    value: float  # (mu - 1) D / (8 pi) there
    xi: float  # phase, 0 to 2 pi


class Shape:
    """A shape h(xi) of the surface with mean 1: its constant C, and the field that holds it."""

    @property
    def constant(self) -> Any:
        """The constant C with which the field is periodic."""
        raise NotImplementedError

    @property
    def mean_flow(self) -> Any:
        """Mean flow 1 + C."""
        return 1 + self.constant

    def height(self, xi: Expression, order: int = 0) -> Expression:
        """Thickness h, or a derivative of it with respect to xi.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x in rad.
        order : int, optional
            Order of the derivative; 0: the thickness.

        Returns
        -------
        float, ndarray or casadi.SX
            Thickness over its mean, or its derivative.

        Examples
        --------
        >>> CosineWave(0.5).height(0.0), CosineWave(0.5).height(0.0, 2)
        (1.5, -0.5)
        """
        return self._height(xi, order)

    def pressure(self, xi: Expression) -> Expression:
        """Pressure in the film minus its mean over xi, 3 int d xi (1 / h² + C / h³).

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x in rad.

        Returns
        -------
        float, ndarray or casadi.SX
            Pressure in units of P, independent of W.

        Examples
        --------
        >>> round(CosineWave(0.5).pressure(2.0), 6)
        1.732069
        """
        return self._pressure(xi)

    def inverse(self, xi: Expression, length: float = 0.0) -> Expression:
        """Mean of 1 / h over a length of film, or 1 / h itself for length 0.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x in rad, in the middle of the length.
        length : float, optional
            Length in units of 1 / k: 2 pi is a wavelength.

        Returns
        -------
        float, ndarray or casadi.SX
            Mean of 1 / h.

        Examples
        --------
        >>> round(CosineWave(0.6).inverse(1.0, 2 * math.pi), 12)  # the mean, 1 / sqrt(1 - delta²)
        1.25
        """
        return self._mean_inverse(xi, length) if length else 1 / self.height(xi)

    def field_function(self, xi: Expression, tension: Expression = 0.0) -> Expression:
        """Field function (mu - 1) D / (8 pi) with mean 0, where H² = H0² - D (eqs. 30 and 31).

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x in rad.
        tension : float or casadi.SX, optional
            Surface tension W.

        Returns
        -------
        float, ndarray or casadi.SX
            Field function in units of P.

        Examples
        --------
        >>> CosineWave(0.5).field_function(0.0, tension=2.0)
        -1.0
        """
        return self.pressure(xi) + tension * self.height(xi, 2)

    def least_field(self, xi: np.ndarray, tension: float = 0.0) -> np.ndarray:
        """Least (mu - 1) H² / (8 pi) over P that makes the wave, at phases (n,)."""
        return np.maximum(self.peak(tension).value - self.field_function(xi, tension), 0.0)

    def peak(self, tension: float = 0.0) -> Peak:
        """Maximum of the field function.

        Parameters
        ----------
        tension : float, optional
            Surface tension W, 0 or above.

        Returns
        -------
        Peak
            Value of the maximum and its phase in rad.

        Examples
        --------
        >>> peak = CosineWave(0.5).peak(tension=1.0)
        >>> round(peak.value, 6), round(peak.xi, 6)
        (2.212585, 2.383186)
        """
        found = (peak_near(self, xi, tension) for xi in self._summits(tension))
        return max(found, key=lambda peak: peak.value)

    def _height(self, xi: Expression, order: int) -> Expression:
        raise NotImplementedError

    def _pressure(self, xi: Expression) -> Expression:
        raise NotImplementedError

    def _mean_inverse(self, xi: Expression, length: float) -> Expression:
        raise NotImplementedError

    def _summits(self, tension: float) -> Iterable[float]:
        """Phases near which the maximum of the field function may be."""
        raise NotImplementedError


@dataclass(frozen=True)
class CosineWave(Shape):
    """The travelling wave h = 1 + delta cos(xi), with all quantities in closed form.

    Source: eqs. 27 to 31 of Zimmermann et al. 2007.

    Parameters
    ----------
    delta : float or casadi.SX
        Amplitude over the mean thickness; a number must be above 0 and below 1.

    Raises
    ------
    ArgumentError
        If the amplitude is a number outside this range.

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
        if symbolic(self.delta):
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
        """Mean flow 1 + C = 3 delta² / (2 + delta²), without cancellation."""
        square = self.delta * self.delta
        return 3 * square / (2 + square)

    def _height(self, xi: Expression, order: int) -> Expression:
        library = library_of(xi)
        wave = library.sin(xi) if order % 2 else library.cos(xi)
        sign = -1 if order % 4 in (1, 2) else 1
        return (0 if order else 1) + sign * self.delta * wave

    def _pressure(self, xi: Expression) -> Expression:
        library, delta = library_of(xi), self.delta
        h, c = self.height(xi), library.cos(xi)
        square = delta * delta
        return 3 * delta * library.sin(xi) * (2 + delta * c) / ((2 + square) * h * h)

    def _mean_inverse(self, xi: Expression, length: float) -> Expression:
        library, both = library_of(xi), library_of(self.delta)
        root = both.sqrt(1 - self.delta * self.delta)
        # 1 / h = (1 + 2 sum_k (-e)^k cos(k xi)) / root with e = (1 - root) / delta; the sum's
        # integral is the phase of (1 + e exp(i right)) (1 + e exp(-i left)), less half the length
        e = self.delta / (1 + root)
        along, across = library.cos(xi), 2 * e * math.sin(length / 2)
        turn = (library.arctan2 if library is np else library.atan2)(
            across * along + e * e * math.sin(length),
            1 + 2 * e * along * math.cos(length / 2) + e * e * math.cos(length),
        )
        return (1 - 2 * turn / length) / root

    def _summits(self, tension: float) -> Iterable[float]:
        """The slope times h³ is a polynomial of degree 8 in exp(i xi) over its fourth power."""
        h = np.array([self.delta / 2, 1.0, self.delta / 2])  # times exp(i xi)
        flow_ = np.array([self.delta / 2, self.mean_flow, self.delta / 2])
        bend = np.polymul([1.0, 0.0, -1.0], np.polymul(h, np.polymul(h, h))) / 2j
        slope = np.polyadd(tension * self.delta * bend, 3 * np.polymul([1.0, 0, 0, 0], flow_))
        roots = np.roots(slope)
        phases = np.angle(roots[roots != 0])
        return (float(phases[np.argmax(self.field_function(phases, tension))]),)


def peak_near(wave: Shape, xi: float, tension: float) -> Peak:
    """Maximum of the field function near phase `xi`, by Newton's method, to round-off."""
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
