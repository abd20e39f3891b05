"""Plane curves along their length, and how far two of them are apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wormopt.numerics.chebyshev import Series, resolve


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve by the share of its length, 0 to 1."""

    length: float
    points: Callable[[np.ndarray], np.ndarray]  # shares (m,) to x, y and angle of tangent (3, m)
    breaks: tuple[float, ...] = (0.0, 1.0)  # shares from 0 to 1 between which it is smooth

    def steepest(self) -> float:
        """Largest angle of the tangent."""
        pieces = pairwise(self.breaks)
        return max(
            float(resolve(lambda s: self.points(s)[2:], a, b).extremes()[1][0]) for a, b in pieces
        )


def graph_curve(height: Callable[[np.ndarray], np.ndarray], span: float) -> Curve:
    """Curve of a smooth function y = height(x), 0 <= x <= span, with span > 0.

    `height` maps places (m,) to heights (m,).
    """
    slope = resolve(lambda x: height(x)[None], 0.0, span).derivative()
    stretch = resolve(lambda x: np.hypot(1.0, slope(x)), 0.0, span)
    along = stretch.primitive()
    length = float(along(np.array([span]))[0, 0])

    def points(share: np.ndarray) -> np.ndarray:
        wanted = length * np.asarray(share, dtype=float)
        x = wanted * span / length
        for _ in range(60):
            step = (along(x)[0] - wanted) / stretch(x)[0]
            x = np.clip(x - step, 0.0, span)
            if np.abs(step).max(initial=0.0) <= 1e-15 * span:
                break
        return np.array([x, height(x), np.arctan(slope(x)[0])])

    return Curve(length, points)


def distances(one: Curve, other: Curve) -> tuple[float, float]:
    """Largest and root mean square distance of points at the same share of the length.

    No less than the distance of a point of one from the nearest point of the other.
    """

    def squares(share: np.ndarray) -> np.ndarray:
        apart = one.points(share)[:2] - other.points(share)[:2]
        return (apart**2).sum(axis=0)[None]

    breaks = sorted({*one.breaks, *other.breaks})
    pieces: list[Series] = [resolve(squares, a, b) for a, b in pairwise(breaks)]
    largest = max(float(series.extremes()[1][0]) for series in pieces)
    mean = sum(float(series.integral()[0]) for series in pieces)
    return float(np.sqrt(max(largest, 0.0))), float(np.sqrt(max(mean, 0.0)))
