"""What waves within limits of thickness and field carry: the supremum of flow, the best cosine.

All numbers scaled by (25), the mean thickness 1. Fields are (mu - 1) H² / (8 pi) over the unit of
pressure; their range, from least to largest, does not depend on H0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar

from wormopt.errors import ArgumentError
from wormopt.model.values import numbers
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.lubrication import field_slope
from wormopt.systems.film.shapes import field_function, flow_constant, grid

__all__ = [
    "Sampled",
    "check_thickness",
    "field_needs",
    "fitting_cosine",
    "largest_flow",
    "sampled",
]

_NODES = 4096
# A wave that just holds a float misses it by no more than round-off and quadrature leave.
_HELD = 1e-6
# The amplitude of a cosine wave is sought between these shares of the largest one. Below the least
# the needs count as proportional to it; they grow faster, so that limits are kept all the same.
_LEAST, _TOP = 1e-7, 1 - 1e-12


def check_thickness(thickness: tuple[float, float]) -> tuple[float, float]:
    """Refuse bounds of the thickness between which there is no wave of mean 1.

    Parameters
    ----------
    thickness : tuple of float
        Least and largest h.

    Returns
    -------
    tuple of float

    Raises
    ------
    ArgumentError
        If the least is not above 0 and below 1, or the largest not above 1.
    """
    found = numbers("thickness", thickness).ravel()
    if found.size != 2 or not (0 < found[0] < 1 < found[1] < math.inf):
        raise ArgumentError(
            f"thickness must be [least, largest] with 0 < least < 1 < largest, not {thickness!r}: "
            "the mean thickness is 1"
        )
    return float(found[0]), float(found[1])


def largest_flow(thickness: tuple[float, float]) -> float:
    """Least upper bound of the mean flow of all waves between two thicknesses, at any field.

    C >= c means that the mean of h^-2 + c h^-3 is not positive. That function of h is first
    concave, then convex, and falls at the larger thickness or is concave up to it, so that its
    lower convex envelope is a chord: the mean is least for a square wave between both bounds.

    Parameters
    ----------
    thickness : tuple of float
        Least and largest h, around the mean 1.

    Returns
    -------
    float
        1 + C of the square wave, C = -(s b^-2 + (1 - s) a^-2) / (s b^-3 + (1 - s) a^-3) with
        the share s = (1 - a) / (b - a) of the larger thickness b.

    Raises
    ------
    ArgumentError
        If the mean 1 is not between them.

    Examples
    --------
    >>> from wormopt.systems.film.cosine import square_wave_flow
    >>> abs(largest_flow((0.5, 1.5)) - square_wave_flow(0.5)) < 1e-15
    True
    """
    a, b = check_thickness(thickness)
    thick = (1 - a) / (b - a)
    share = np.array([1 - thick, thick])
    h = np.array([a, b])
    return float(1 - (share @ h**-2) / (share @ h**-3))


def field_needs(delta: float, tension: float) -> tuple[float, float]:
    """Range of the field that a cosine wave needs, and the steepest slope of it.

    Parameters
    ----------
    delta : float
        Amplitude.
    tension : float
        Number W of surface tension.

    Returns
    -------
    range, slope : float
        Of (mu - 1) H² / (8 pi).

    Examples
    --------
    >>> [round(value, 6) for value in field_needs(0.5, 0.0)]
    [3.72678, 4.0]
    """
    wave, xi = CosineWave(delta), grid(_NODES)
    D = wave.field_function(xi, tension)
    h, third = wave.height(xi), wave.height(xi, 3)
    slope = field_slope(h, third, wave.constant, tension)
    return _top(D) + _top(-D), max(_top(slope), _top(-slope))


def fitting_cosine(
    tension: float,
    thickness: tuple[float, float],
    field: float,
    gradient: float = math.inf,
) -> float:
    """Amplitude of the largest cosine wave within limits.

    Parameters
    ----------
    tension : float
        Number W of surface tension.
    thickness : tuple of float
        Least and largest h.
    field : float
        Largest range of the field, positive.
    gradient : float, optional
        Largest slope of the field by the phase.

    Returns
    -------
    float
        Its field and slope grow with the amplitude, so that there is one root; in proportion
        where it is tiny.

    Raises
    ------
    ArgumentError
        If the mean 1 is not between the thicknesses, or a limit is not above 0.

    Examples
    --------
    >>> round(fitting_cosine(0.1, (0.4, 2.0), field_needs(0.5, 0.1)[0]), 9)
    0.5
    """
    a, b = check_thickness(thickness)
    if not (field > 0 and gradient > 0):
        raise ArgumentError(
            f"field and gradient must be above 0, not {field!r} and {gradient!r}: every wave "
            "needs some of both"
        )

    def excess(delta: float) -> float:
        needed, steep = field_needs(delta, tension)
        return max(needed / field, steep / gradient) - 1

    top = min(1 - a, b - 1) * _TOP
    if excess(top) <= 0:
        return top
    least = _LEAST * top
    over = excess(least)
    if over >= 0:
        return least / (1 + over)
    return float(root_scalar(excess, bracket=(least, top), xtol=1e-10 * least).root)


@dataclass(frozen=True, eq=False)
class Sampled:
    """A wave by values of its thickness alone.

    Parameters
    ----------
    thickness : ndarray, shape (nodes,)
        On `grid`.
    constant : float
        C, by quadrature.
    field : ndarray, shape (nodes,)
        (mu - 1) H² / (8 pi), least 0, by quadrature of (30) and second differences.
    mean : float
        Mean thickness.
    margin : float
        Largest thickness + 3 C: a small float is held where it is not negative.
    drift : float
        Mean velocity of a small float over that of the wave; 1 if it is held.
    """

    thickness: np.ndarray
    constant: float
    field: np.ndarray
    mean: float
    margin: float
    drift: float


def sampled(h: np.ndarray, tension: float) -> Sampled:
    """Tell what a wave does from its thickness on a grid, which may have corners in its slope.

    Second differences blur a jump of the curvature over two points, and do not overshoot there as
    harmonics would.

    Parameters
    ----------
    h : ndarray, shape (nodes,)
        Thickness on `grid`.
    tension : float
        Number W of surface tension.

    Returns
    -------
    Sampled

    Examples
    --------
    >>> wave = CosineWave(0.5)
    >>> found = sampled(wave.height(grid(4096)), 0.1)
    >>> round(found.constant, 9), round(float(np.ptp(found.field)), 5), round(found.drift, 9)
    (-0.666666667, 3.72715, 0.61814603)
    """
    C, apart = float(flow_constant(h)), 2 * np.pi / len(h)
    bend = (np.roll(h, 1) - 2 * h + np.roll(h, -1)) / apart**2
    field = -(np.asarray(field_function(h)) + tension * bend)
    margin = _top(h) + 3 * C
    # the surface is slower than the wave by (-3 C - h) / (2 h)
    held = margin >= -_HELD
    drift = 1.0 if held else float(1 - 1 / np.mean(2 * h / (-3 * C - h)))
    return Sampled(h, C, field - field.min(), float(h.mean()), margin, drift)


def _top(values: np.ndarray) -> float:
    """Maximum of a smooth periodic function, by a parabola through the three largest values."""
    k = int(np.argmax(values))
    left, middle, right = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = left - 2 * middle + right
    return float(middle - (right - left) ** 2 / (8 * bend) if bend < 0 else middle)
