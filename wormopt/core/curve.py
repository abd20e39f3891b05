"""Plane curves along their length, and how far two of them are apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wormopt.core.chebyshev import Series, resolve

__all__ = ["Curve", "distances", "graph_curve"]


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve by the share of its length, 0 to 1.

    Parameters
    ----------
    length : float
        Its length.
    points : callable
        Of shares (m,): x, y and the angle of its tangent, shape (3, m).
    """

    length: float
    points: Callable[[np.ndarray], np.ndarray]


def graph_curve(height: Callable[[np.ndarray], np.ndarray], span: float) -> Curve:
    """Curve of a smooth function y = height(x), 0 <= x <= span.

    Parameters
    ----------
    height : callable
        Of places (m,) to heights (m,).
    span : float
        Above 0.

    Returns
    -------
    Curve

    Examples
    --------
    >>> ramp = graph_curve(lambda x: 0.75 * x, 4.0)
    >>> round(ramp.length, 12), ramp.points(np.array([0.5]))[:2, 0].round(12).tolist()
    (5.0, [2.0, 1.5])
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

    Parameters
    ----------
    one, other : Curve
        In any order.

    Returns
    -------
    largest, mean : float
        No less than the distance of a point of one from the nearest point of the other.

    Examples
    --------
    >>> flat, ramp = (graph_curve(lambda x, k=k: k * x, 1.0) for k in (0.0, 1.0))
    >>> [round(d, 9) for d in distances(flat, ramp)]
    [1.0, 0.577350269]
    """

    def squares(share: np.ndarray) -> np.ndarray:
        apart = one.points(share)[:2] - other.points(share)[:2]
        return (apart**2).sum(axis=0)[None]

    series: Series = resolve(squares, 0.0, 1.0)
    ends = series.extremes(0)
    return float(np.sqrt(max(ends[1], 0.0))), float(np.sqrt(max(series.integral()[0], 0.0)))
