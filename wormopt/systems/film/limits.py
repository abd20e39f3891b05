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

_NODES = 4096
# A wave that just holds a float misses it by no more than round-off and quadrature leave.
_HELD = 1e-6
# The amplitude of a cosine wave is sought between these shares of the largest one. Below the least
# the needs count as proportional to it; they grow faster, so that limits are kept all the same.
_LEAST, _TOP = 1e-7, 1 - 1e-12


def check_thickness(thickness: tuple[float, float]) -> tuple[float, float]:
    """Return bounds (least, largest) of h; raises ArgumentError unless 0 < least < 1 < largest."""
    found = numbers("thickness", thickness).ravel()
    if found.size != 2 or not (0 < found[0] < 1 < found[1] < math.inf):
        raise ArgumentError(
            f"thickness must be [least, largest] with 0 < least < 1 < largest, not {thickness!r}: "
            "the mean thickness is 1"
        )
    return float(found[0]), float(found[1])


def largest_flow(thickness: tuple[float, float]) -> float:
    """Least upper bound of the mean flow 1 + C of all waves with a ≤ h ≤ b, at any field.

    A square wave is best: the lower convex envelope of h^-2 + c h^-3 is a chord. Its C is
    -(s b^-2 + (1 - s) a^-2) / (s b^-3 + (1 - s) a^-3), s = (1 - a) / (b - a) the share of b.
    """
    a, b = check_thickness(thickness)
    thick = (1 - a) / (b - a)
    share = np.array([1 - thick, thick])
    h = np.array([a, b])
    return float(1 - (share @ h**-2) / (share @ h**-3))


def field_needs(delta: float, tension: float) -> tuple[float, float]:
    """Range and steepest slope of (mu - 1) H² / (8 pi) that a cosine wave needs."""
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
    """Amplitude of the largest cosine wave within limits of thickness, field range and slope.

    Field and slope grow with the amplitude, so the root is unique; linear where it is tiny.
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
    """What a wave does, from values of its thickness alone."""

    thickness: np.ndarray  # (nodes,) on `grid`
    constant: float  # C, by quadrature
    # (nodes,) (mu - 1) H² / (8 pi), least 0, by quadrature of (30) and second differences
    field: np.ndarray
    mean: float  # mean thickness
    margin: float  # largest thickness + 3 C; a small float is held if ≥ 0
    drift: float  # of a small float over the wave's speed; 1 if held


def sampled(h: np.ndarray, tension: float) -> Sampled:
    """What a wave does, from its thickness `h` (nodes,) on `grid`; its slope may have corners.

    Second differences blur a curvature jump over two points, without harmonics' overshoot.
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
