"""Planes that enclose the products of the relaxation, for any box of shares and periods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["Plane", "Sides", "of_drags", "of_meetings", "of_shares"]

Values = tuple["np.ndarray | float", ...]


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of a box.

    Parameters
    ----------
    low, high : ndarray
        Smallest and largest share of the period of each phase.
    a, b : float
        Shortest and longest period.
    """

    low: np.ndarray
    high: np.ndarray
    a: float
    b: float

    def of(self, phase: np.ndarray) -> Sides:
        """Give the sides for things that belong to phases.

        Parameters
        ----------
        phase : ndarray of int
            Phases of the things.
        """
        return Sides(self.low[phase], self.high[phase], self.a, self.b)


@dataclass(frozen=True, eq=False)
class Plane:
    """Rows sum of coefficients times columns <= side, both of which depend on the box.

    Parameters
    ----------
    phase : ndarray of int
        To which phase each row belongs.
    columns : tuple of ndarray of int
        Columns of the rows.
    of : callable
        Coefficients, as many as columns, and side, for sides of a box.
    """

    phase: np.ndarray
    columns: tuple[np.ndarray, ...]
    of: Callable[[Sides], tuple[Values, np.ndarray | float]]


def of_shares(g: np.ndarray, h: np.ndarray, e: np.ndarray, period: int, room: int) -> list[Plane]:
    """Bound g = e² T, h = e T and the room 1 / T from above.

    Parameters
    ----------
    g, h, e : ndarray of int
        Columns, one of each phase.
    period, room : int
        Columns.
    """
    phase, t = np.arange(len(e)), np.full(len(e), period)
    chord = Plane(phase[:1], (t[:1], np.array([room])), lambda s: ((1.0, s.a * s.b), s.a + s.b))
    return [
        Plane(phase, (g, e, t), _square_at_shortest),
        Plane(phase, (g, e, t), _square_at_longest),
        Plane(phase, (h, e, t), lambda s: ((1.0, -s.a, -s.high), -s.high * s.a)),
        Plane(phase, (h, e, t), lambda s: ((1.0, -s.b, -s.low), -s.low * s.b)),
        chord,
    ]


def of_meetings(
    phase: np.ndarray, y: np.ndarray, c: np.ndarray, e: np.ndarray, most: np.ndarray
) -> list[Plane]:
    """Enclose y = e c.

    Parameters
    ----------
    phase : ndarray of int
        Phases of the products.
    y, c, e : ndarray of int
        Columns.
    most : ndarray
        Largest values of c.
    """
    return [
        Plane(phase, (y, c), lambda s: ((1.0, -s.high), 0.0)),
        Plane(phase, (y, c), lambda s: ((-1.0, s.low), 0.0)),
        Plane(phase, (y, c, e), lambda s: ((1.0, -s.low, -most), -most * s.low)),
        Plane(phase, (y, c, e), lambda s: ((-1.0, s.high, most), most * s.high)),
    ]


def of_drags(
    phase: np.ndarray,
    z: np.ndarray,
    q: np.ndarray,
    g: np.ndarray,
    e: np.ndarray,
    most: np.ndarray,
) -> list[Plane]:
    """Enclose z = h q: h, which is in the box, multiplies 0 <= q <= e v_max; h e is g.

    Parameters
    ----------
    phase : ndarray of int
        Phases of the products.
    z, q, g, e : ndarray of int
        Columns.
    most : ndarray
        Largest velocities v_max.
    """
    columns = (z, g, e, q)
    return [
        Plane(phase, (z, q), lambda s: ((1.0, -s.high * s.b), 0.0)),
        Plane(phase, (z, q), lambda s: ((-1.0, s.low * s.a), 0.0)),
        Plane(phase, columns, lambda s: _left_over(1.0, s.low * s.a, most)),
        Plane(phase, columns, lambda s: _left_over(-1.0, s.high * s.b, most)),
    ]


def _square_at_shortest(s: Sides) -> tuple[Values, np.ndarray]:
    """Keep g below a times the secant of e², and what longer periods add at most."""
    ends = s.low + s.high
    return (1.0, -s.a * ends, -(s.high**2)), -s.a * s.low * s.high - s.high**2 * s.a


def _square_at_longest(s: Sides) -> tuple[Values, np.ndarray]:
    """Keep g below b times the secant of e², less what shorter periods take at least."""
    ends = s.low + s.high
    return (1.0, -s.b * ends, -(s.low**2)), -s.b * s.low * s.high - s.low**2 * s.b


def _left_over(sign: float, h: np.ndarray, most: np.ndarray) -> tuple[Values, float]:
    """Sign times (z - v_max g + h (v_max e - q)) is not positive."""
    return (sign, -sign * most, sign * h * most, -sign * h), 0.0
