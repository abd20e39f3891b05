"""Memory of a motion: signals of the past as Chebyshev series on pieces of time.

A Model with delays is simulated as one with schedules: the coefficients of its memory are constant
on pieces of time, and the past is a polynomial there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from wormopt.model.schedule import Delay, Schedule

DEGREE = 11
"""Of the polynomials; their local error is far below that of steps of order 8."""
_NODES = chebyshev.chebpts1(DEGREE + 1)
_FIT = np.linalg.inv(chebyshev.chebvander(_NODES, DEGREE)).T
# Points between the nodes at which a fit is checked.
_TRIED = np.array([-0.998, -0.93, -0.7, -0.37, 0.06, 0.43, 0.76, 0.95, 0.999])
_TRIAL = chebyshev.chebvander(_TRIED, DEGREE).T
_PLACES = (np.append(_NODES, _TRIED) + 1) / 2
# For a single step.
_HALVINGS = 4
# Jumps of a derivative that have passed this often through the equations are beyond the order of
# the steps: every pass smooths them at least once.
GENERATIONS = 8

Course = Callable[[np.ndarray], np.ndarray]
"""Values (m, k) of a signal at times (k,)."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A signal on a piece of time."""

    begin: float
    end: float
    values: np.ndarray  # (1 + m (DEGREE + 1),) as `Memory.symbol`
    # how often the jump of a derivative at `begin` has passed through the equations
    generation: int


@dataclass(frozen=True, eq=False)
class Memory:
    """The past of one Delay as a schedule."""

    delay: Delay

    @cached_property
    def symbol(self) -> ca.SX:
        """Length of the piece, then the coefficients of the first row, of the second, ..."""
        m = self.delay.symbol.numel()
        return ca.SX.sym(self.delay.name, 1 + m * (DEGREE + 1))  # type: ignore[no-any-return]

    @cached_property
    def begin(self) -> ca.SX:
        """When the piece begins."""
        return ca.SX.sym(f"{self.delay.name}_begin")  # type: ignore[no-any-return]

    def value(self, t: ca.SX) -> ca.SX:
        """The past as an expression of time and `symbol` (Clenshaw's sum)."""
        m = self.delay.symbol.numel()
        s = 2 * (t - self.begin) / self.symbol[0] - 1
        rows = ca.reshape(self.symbol[1:], DEGREE + 1, m).T
        above, sums = ca.SX(m, 1), rows[:, DEGREE]
        for k in range(DEGREE - 1, 0, -1):
            above, sums = sums, rows[:, k] + 2 * s * sums - above
        return rows[:, 0] + s * sums - above

    def schedule(self, pieces: list[Piece], lag: float) -> Schedule:
        """Schedule of these pieces, delayed by `lag`."""
        start = pieces[0].begin
        breaks = np.array([0.0, *(piece.end - start for piece in pieces)])
        values = np.array([piece.values for piece in pieces])
        return Schedule(self.delay.name, self.symbol, self.begin, breaks, values, start=start + lag)


def recalled(expression: ca.SX, memories: Sequence[Memory], t: ca.SX) -> ca.SX:
    """Replace signals of the past by their polynomials."""
    if not memories:
        return expression
    past = ca.vertcat(*(memory.delay.symbol for memory in memories))
    return ca.substitute(expression, past, ca.vertcat(*(memory.value(t) for memory in memories)))


def fitted(
    course: Course,
    begin: float,
    end: float,
    knots: np.ndarray,
    allowed: float,
    generation: int,
    halvings: int = _HALVINGS,
) -> list[Piece]:
    """Pieces of a signal that is smooth, up to rounding, except at `knots`, the ends of steps.

    Their error is at most `allowed`, if halving a step so often suffices. Each step is examined:
    steps are short where the signal is narrow.
    """
    length = end - begin
    inner = knots[(knots > begin + 1e-9 * length) & (knots < end - 1e-9 * length)]
    edges = np.concatenate([[begin], inner, [end]])
    middles = (edges[:-1] + edges[1:]) / 2
    values = course(np.append(begin + _PLACES * length, middles))
    coefficients = values[:, : DEGREE + 1] @ _FIT
    trial = np.hstack([_TRIAL, chebyshev.chebvander(2 * (middles - begin) / length - 1, DEGREE).T])
    error = np.abs(coefficients @ trial - values[:, DEGREE + 1 :]).max(initial=0.0)
    if not error > allowed or (halvings == 0 and not len(inner)):
        return [Piece(begin, end, np.append(length, coefficients.ravel()), generation)]
    middle = (begin + end) / 2
    cut = float(inner[np.argmin(np.abs(inner - middle))]) if len(inner) else middle
    left = halvings - (len(inner) == 0)
    first = fitted(course, begin, cut, inner, allowed, generation, left)
    return first + fitted(course, cut, end, inner, allowed, GENERATIONS, left)
