"""Boundary value problems: equations along [0, 1], solved by one polynomial at Legendre points.

Unknowns are the states at the start and at the points, and the unknown parameters. States are
integrals of their rates, whose matrix stays well conditioned at any degree. Derivatives are
those of the equations, by CasADi, times that matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from wormopt.errors import ArgumentError, SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.numerics.newton import newton


@dataclass(frozen=True, eq=False)
class BoundaryProblem:
    """States y(s) with dy/ds = ode(y, p, given), 0 <= s <= 1, and conditions at the ends.

    Raises ArgumentError unless there are n_y + n_p conditions.
    """

    y: ca.SX  # (n_y, 1) symbols of the states
    p: ca.SX  # (n_p, 1) symbols of unknown numbers
    given: ca.SX  # (n_given, 1) symbols of the parameters of continuation
    ode: ca.SX  # (n_y, 1) in y, p and given
    start: ca.SX  # (n_y, 1) symbols of the states at 0
    end: ca.SX  # (n_y, 1) symbols of the states at 1
    conditions: ca.SX  # (n_y + n_p, 1) in start, end, p and given; 0 for solutions
    names: tuple[str, ...]  # of the states

    def __post_init__(self) -> None:
        n_y, n_p = self.y.numel(), self.p.numel()
        if self.conditions.numel() != n_y + n_p:
            raise ArgumentError(
                f"{n_y} states and {n_p} unknown numbers need {n_y + n_p} conditions, "
                f"not {self.conditions.numel()}"
            )
        sizes = {self.ode.numel(), self.start.numel(), self.end.numel(), len(self.names), n_y}
        if sizes != {n_y}:
            raise ArgumentError("ode, start, end and names must have one entry for each state")


Guess = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
_LAST_STEP = 1e-12
_LEAST_MOVE = 1e-4


@dataclass(frozen=True, eq=False)
class BoundarySolution:
    """States along [0, 1] and the parameters that were unknown."""

    start: np.ndarray  # (n_y,) states at 0
    rates: np.ndarray  # (degree, n_y) Legendre coefficients of dy/ds in 2 s - 1
    p: np.ndarray  # (n_p,) unknown numbers
    residual: float  # largest residual of the equations and conditions
    tail: float  # largest last coefficient over the largest of all
    defect: float  # largest residual between the points over the largest of all coefficients
    degree: int  # of the polynomials

    def at(self, s: Any) -> np.ndarray:
        """States (n_y, m) at places `s` (m,) from 0 to 1."""
        series = legendre.legint(self.rates, lbnd=-1, axis=0) / 2
        return self.start[:, None] + legendre.legval(2 * np.asarray(s, dtype=float) - 1, series)


class _Equations:
    """Residual and Jacobian of a problem at the Legendre points of one degree."""

    def __init__(self, problem: BoundaryProblem, degree: int) -> None:
        self.n_y, self.n_p, self.degree = problem.y.numel(), problem.p.numel(), degree
        points = Collocation(degree)
        self.tau, self.A, self.B = points.tau, points.A, points.B
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None
        inner = [problem.y, problem.p, problem.given]
        slopes = [ca.jacobian(problem.ode, by) for by in inner[:2]]
        self.rate = ca.Function("rate", inner, [problem.ode, *map(ca.vec, slopes)])
        ends = [problem.start, problem.end, problem.p, problem.given]
        by_ends = [ca.densify(ca.jacobian(problem.conditions, by)) for by in ends[:3]]
        self.ends = ca.Function("ends", ends, [problem.conditions, *by_ends])

    def pieces(self, z: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual and Jacobian at z, the states at the start and the points, and the numbers."""
        n_y, n_p, m = self.n_y, self.n_p, self.degree
        y0, y, p = z[:n_y], z[n_y : n_y * (m + 1)].reshape(m, n_y), z[n_y * (m + 1) :]
        f, by_y, by_p = (self._dense(part) for part in self.rate(y.T, *self._tile(p, given)))
        slopes = by_y.T.reshape(m, n_y, n_y).swapaxes(1, 2)  # columns first in CasADi
        numbers = by_p.T.reshape(m, n_p, n_y).swapaxes(1, 2)
        inside = y - y0 - self.A @ f.T
        rows = n_y * m
        matrix = np.zeros((rows + n_y + n_p, len(z)))
        matrix[:rows, :n_y] = np.tile(-np.eye(n_y), (m, 1))
        blocks = np.einsum("ij,jkl->ikjl", self.A, slopes).reshape(rows, rows)
        matrix[:rows, n_y : n_y + rows] = np.eye(rows) - blocks
        matrix[:rows, n_y + rows :] = -np.einsum("ij,jkl->ikl", self.A, numbers).reshape(rows, -1)
        found = self.ends(y0, y0 + f @ self.B, p, given)
        rest, by_start, by_end, by_number = (self._dense(part) for part in found)
        to_end = np.einsum("j,jkl->kjl", self.B, slopes).reshape(n_y, rows)
        matrix[rows:, :n_y] = by_start + by_end
        matrix[rows:, n_y : n_y + rows] = by_end @ to_end
        matrix[rows:, n_y + rows :] = by_number + by_end @ np.einsum("j,jkl->kl", self.B, numbers)
        return np.concatenate([inside.ravel(), rest.ravel()]), matrix

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Residuals at sets of unknowns, see `wormopt.numerics.roots`."""
        return np.array([self._at(z, given)[0] for z, given in zip(x, p, strict=True)])

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Jacobians there."""
        return np.array([self._at(z, given)[1] for z, given in zip(x, p, strict=True)])

    def _at(self, z: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pieces, kept for the Jacobian."""
        if self._last is None or not np.array_equal(self._last[0], z):
            self._last = z.copy(), self.pieces(z, given)
        return self._last[1]

    def solved(self, z: np.ndarray, given: np.ndarray) -> np.ndarray | None:
        """Solution near z, or None."""
        self._last, self.nominal = None, np.full(len(z), np.abs(z).max() or 1.0)
        (z,), (found,) = newton(self, z[None], given, last_step=_LAST_STEP)
        return z if found else None

    def solution(self, z: np.ndarray, given: np.ndarray) -> BoundarySolution:
        """States as polynomials, with their residuals."""
        n_y, m = self.n_y, self.degree
        y0, y, p = z[:n_y], z[n_y : n_y * (m + 1)].reshape(m, n_y), z[n_y * (m + 1) :]
        rate = self._dense(self.rate(y.T, *self._tile(p, given))[0]).T
        series = np.linalg.solve(legendre.legvander(2 * self.tau - 1, m - 1), rate)
        size = np.abs(series).max() or 1.0
        found = BoundarySolution(
            y0, series, p, float(np.abs(self.pieces(z, given)[0]).max()),
            float(np.abs(series[-max(4, m // 16) :]).max() / size), 0.0, m,
        )  # fmt: skip
        between = np.linspace(0.0, 1.0, m)
        wanted = self._dense(self.rate(found.at(between), *self._tile(p, given))[0])
        off = np.abs(legendre.legval(2 * between - 1, series) - wanted).max()
        return replace(found, defect=float(off / size))

    def _tile(self, p: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # CasADi maps a function over columns if one argument has more of them
        return p.reshape(-1, 1), given.reshape(-1, 1)

    @staticmethod
    def _dense(part: Any) -> np.ndarray:
        return np.array(ca.densify(part))


def solve_boundary(
    problem: BoundaryProblem,
    guess: Guess,
    given: Sequence[Sequence[float]],
    *,
    degree: int = 16,
    most: int = 256,
    tolerance: float = 1e-13,
) -> BoundarySolution:
    """Solve a problem, following its solution along the sets of given numbers to the last.

    `guess` maps places (m,) to states (n_y, m) and p (n_p,); `degree` doubles up to `most`
    until the tail is resolved. Raises SolveError: "no_start", "lost" or "unresolved".
    """
    path = [np.array(numbers, dtype=float) for numbers in given]
    equations = _Equations(problem, degree)
    z = equations.solved(_packed(guess, equations), path[0])
    if z is None:
        raise SolveError("no solution was found near the first guess", code="no_start")
    for begin, end in pairwise(path):
        z = _followed(equations, z, begin, end)
    while (found := equations.solution(z, path[-1])).tail > tolerance and 2 * degree <= most:
        degree *= 2
        equations = _Equations(problem, degree)
        z = equations.solved(_packed(lambda s, f=found: (f.at(s), f.p), equations), path[-1])
        if z is None:
            raise SolveError("no solution was found on a finer mesh", code="unresolved")
    if found.tail > tolerance:
        raise SolveError(
            f"polynomials of the degree {degree} do not resolve the solution", code="unresolved"
        )
    return found


def _packed(guess: Guess, equations: _Equations) -> np.ndarray:
    y, p = guess(np.concatenate([[0.0], equations.tau]))
    return np.concatenate([y.T.ravel(), p])


def _followed(
    equations: _Equations, z: np.ndarray, begin: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """Solution at the end of a straight line; the next guess is on the secant of the last two."""
    share, step, slope = 0.0, 1.0, np.zeros_like(z)
    while share < 1:
        step = min(step, 1 - share)
        found = equations.solved(z + step * slope, begin + (share + step) * (end - begin))
        if found is None:
            step /= 2
            if step < _LEAST_MOVE:
                raise SolveError(f"the continuation ended at {share:.3g} of the path", code="lost")
            continue
        slope, z, share = (found - z) / step, found, share + step
        step *= 1.5
    return z
