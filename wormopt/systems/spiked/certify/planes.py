"""Planes that enclose the products of the relaxation, for any box of shares and periods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Values = tuple["np.ndarray | float", ...]


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of a box."""

    low: np.ndarray  # smallest share of the period, by phase
    high: np.ndarray  # largest share of the period, by phase
    a: float  # shortest period
    b: float  # longest period

    def of(self, phase: np.ndarray) -> Sides:
        """The sides for things that belong to the phases `phase`."""
        return Sides(self.low[phase], self.high[phase], self.a, self.b)


@dataclass(frozen=True, eq=False)
class Plane:
    """Rows sum(coefficients · columns) ≤ side, where coefficients and side depend on the box."""

    phase: np.ndarray  # of each row
    columns: tuple[np.ndarray, ...]  # of the rows
    # coefficients (as many as columns) and side, for a box
    of: Callable[[Sides], tuple[Values, np.ndarray | float]]


def of_shares(g: np.ndarray, h: np.ndarray, e: np.ndarray, period: int, room: int) -> list[Plane]:
    """Bound g = e² T, h = e T and the room 1 / T from above; all arguments are columns.

    `g`, `h` and `e` have one column per phase.
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
    """Enclose the products y = e c (columns) in their phases; `most` are largest values of c."""
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
    """Enclose z = h q: h, which is in the box, multiplies 0 ≤ q ≤ e v_max; h e is g.

    `z`, `q`, `g`, `e` are columns, `phase` their phases, `most` the largest v_max.
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
