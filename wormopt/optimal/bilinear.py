"""Programs whose rows are sums of linear terms and of products of two unknowns.

With one factor of every product held, such a program is linear. So is its linearisation, and
with the held factors fixed both are the same linear program. `BilinearProgram.climb` takes turns:
a linearised step within a trust region finds better factors, the linear program with these held
makes the step feasible again. Where the optimum is a vertex, steps become Newton steps and
`BilinearProgram.sharpen` ends at machine precision.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import highspy
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from wormopt.optimal.linear import Term

__all__ = ["BilinearProgram", "BilinearRows", "Climb", "Excess", "Point"]

# First and second factor, one per row or one for all, and the coefficient.
Product = tuple["np.ndarray | int", "np.ndarray | int", "np.ndarray | float"]

_SHRINK, _LARGEST, _SMALLEST = 0.25, 1.0, 1e-7
# Steps are never held to less than this share of their mean.
_SHORTEST_STEP = 0.02


@dataclass
class BilinearRows:
    """Rows of a bilinear program in the making, added in blocks, and its columns.

    Examples
    --------
    >>> rows = BilinearRows()
    >>> x = rows.columns(np.array([2.0, 2.0]))
    >>> rows.add([(x[0], 1.0)], [(x[0], x[1], 1.0)], -np.inf, 3.0)  # x0 + x0 x1 <= 3
    array([0])
    """

    count: int = 0
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    _sides: list[tuple[int, Any, Any]] = field(default_factory=list)
    _linear: list[tuple[Any, ...]] = field(default_factory=list)
    _products: list[tuple[Any, ...]] = field(default_factory=list)

    def columns(self, upper: np.ndarray) -> np.ndarray:
        """Number new columns from 0 to these bounds; -1 where the bound is 0: no column."""
        kept = upper > 0.0
        number = np.where(kept, len(self.upper) - 1 + np.cumsum(kept).reshape(upper.shape), -1)
        self.upper.extend(upper[kept].tolist())
        self.lower.extend([0.0] * int(kept.sum()))
        return number

    def add(
        self,
        linear: Sequence[Term],
        products: Sequence[Product],
        lower: np.ndarray | float,
        upper: np.ndarray | float,
    ) -> np.ndarray:
        """Add the rows lower <= linear terms + products <= upper; give their numbers.

        Columns, factors and coefficients are broadcast against each other. Terms with a column
        or factor -1 are left out: what they stand for is zero.
        """
        terms = (*linear, *products)
        size = max((np.size(factor) for term in terms for factor in term[:-1]), default=1)
        rows = np.arange(self.count, self.count + size)
        self._linear += [(rows, *term) for term in linear]
        self._products += [(rows, *term) for term in products]
        self._sides.append((size, lower, upper))
        self.count += size
        return rows

    def terms(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """All linear terms and all products: rows, columns or both factors, coefficients."""
        return _stacked(self._linear, 3), _stacked(self._products, 4)

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper sides of all rows."""
        lower, upper = (
            np.concatenate([np.full(side[0], side[k]) for side in self._sides]) for k in (1, 2)
        )
        return lower, upper


def _stacked(terms: list[tuple[Any, ...]], width: int) -> list[np.ndarray]:
    """Columns of a list of terms, numbers broadcast to the rows, without those that are zero."""
    sizes = [len(term[0]) for term in terms]
    parts = []
    for k in range(width):
        given = [term[k] for term in terms]
        arrays = [
            v if np.ndim(v) else np.full(size, v) for v, size in zip(given, sizes, strict=True)
        ]
        parts.append(np.concatenate(arrays) if arrays else np.empty(0, int))
    there = np.all([part >= 0 for part in parts[1:-1]], axis=0)
    return [part[there] for part in parts]


@dataclass(frozen=True, eq=False)
class Point:
    """A feasible point of a bilinear program.

    Parameters
    ----------
    x : ndarray, shape (columns,)
        Values of the unknowns.
    value : float
        The objective there.
    """

    x: np.ndarray
    value: float


@dataclass(frozen=True)
class Climb:
    """When a climb is over.

    Parameters
    ----------
    tolerance : float
        A linearised step that promises less than this share of the value ends it.
    steps : int
        Most steps.
    radius : float
        First trust region, as a share of each held factor.
    enough : float
        Give up where this value seems out of reach: at ``reach`` times what a step promises.
    reach : float
        See ``enough``.
    """

    tolerance: float = 1e-4
    steps: int = 60
    radius: float = 0.5
    enough: float = -np.inf
    reach: float = 4.0


@dataclass(frozen=True, eq=False)
class Excess:
    """Columns that stand for costs: each is at least what its row demands, and 0.

    Parameters
    ----------
    columns, rows : ndarray of int
        Column and row of each cost. The row has side 0 below, and knows products of the column
        with held ones only.
    factors : ndarray of int
        Columns whose products with each other are in the rows. They are kept near where the
        rows were linearised, and the costs are then set to what the rows say exactly.
    """

    columns: np.ndarray
    rows: np.ndarray
    factors: np.ndarray


class BilinearProgram:
    """Maximise the ratio of two rows, or one row, of a bilinear program.

    Parameters
    ----------
    rows : BilinearRows
        Rows and columns.
    held : ndarray of int
        Columns that are held in turn: one factor of every product at least.
    gain : int
        Row whose value is maximised,
    per : int, optional
        divided by that of this one, which is positive.
    excess : Excess, optional
        Costs that are products of columns not held.

    Examples
    --------
    The largest x y on a line x + y <= 2, from x = 0.5.

    >>> rows = BilinearRows()
    >>> x = rows.columns(np.array([2.0, 2.0]))
    >>> _ = rows.add([(x[0], 1.0), (x[1], 1.0)], [], -np.inf, 2.0)
    >>> area = rows.add([], [(x[0], x[1], 1.0)], -np.inf, np.inf)
    >>> program = BilinearProgram(rows, x[:1], int(area[0]))
    >>> start = program.restore(np.array([0.5, 0.0]))
    >>> program.climb(start, Climb(tolerance=1e-9)).value.__round__(6)
    1.0
    """

    def __init__(
        self,
        rows: BilinearRows,
        held: np.ndarray,
        gain: int,
        per: int | None = None,
        excess: Excess | None = None,
    ) -> None:
        self.lower, self.upper = np.array(rows.lower), np.array(rows.upper)
        self.row_lower, self.row_upper = rows.sides()
        self.held, self._gain, self._per = held, gain, per
        self._excess = excess or Excess(*[np.empty(0, int)] * 3)
        self._guarded = np.concatenate([held, self._excess.factors]).astype(np.int32)
        self._assemble(rows)
        self._highs: Any = highspy.Highs()  # its stubs lack half of its methods
        self._highs.silent()
        for option, value in _OPTIONS.items():
            self._highs.setOptionValue(option, value)
        if excess is not None:  # no vertex, so that `sharpen` cannot remove what is left
            self._highs.setOptionValue("primal_feasibility_tolerance", 1e-10)
        self._basis: Any = None
        self.programs = 0  # linear programs solved
        self.work = 0  # their pivots, times rows and columns

    def _assemble(self, rows: BilinearRows) -> None:
        """Lay out the Jacobian: constant entries, and those proportional to an unknown."""
        n = len(self.upper)
        (row, column, constant), (at, first, second, weight) = rows.terms()
        keys = np.concatenate([row, at, at]) * n + np.concatenate([column, first, second])
        places, place = np.unique(keys, return_inverse=True)
        self._indices = (places % n).astype(np.int32)
        self._starts = np.searchsorted(places // n, np.arange(rows.count + 1)).astype(np.int32)
        of_linear, of_products = place[: len(row)], place[len(row) :]
        self._constant = np.bincount(of_linear, constant, len(places))
        entries = (np.tile(weight, 2), (of_products, np.concatenate([second, first])))
        self._slopes = sparse.csr_array(entries, (len(places), n))
        excess = self._excess
        self._excess_entries = np.searchsorted(places, excess.rows * n + excess.columns)

    def jacobian(self, x: np.ndarray) -> sparse.csr_array:
        """Derivatives of all rows, shape (rows, columns)."""
        return self._matrix(self._constant + self._slopes @ x)

    def _matrix(self, data: np.ndarray) -> sparse.csr_array:
        shape = (len(self._starts) - 1, len(self.upper))
        return sparse.csr_array((data, self._indices, self._starts), shape)

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values of all rows."""
        return self._matrix(self._constant + 0.5 * (self._slopes @ x)) @ x

    def value(self, x: np.ndarray) -> float:
        """Objective."""
        values = self.values(x)
        return float(values[self._gain] / (1.0 if self._per is None else values[self._per]))

    def violation(self, x: np.ndarray) -> float:
        """Largest excess over any side of a row or bound of a column."""
        values = self.values(x)
        rows = np.maximum(self.row_lower - values, values - self.row_upper)
        return float(max(rows.max(), np.maximum(self.lower - x, x - self.upper).max(), 0.0))

    def slope(self, x: np.ndarray, jacobian: sparse.csr_array) -> np.ndarray:
        """Gradient of the objective."""
        gain = self._dense(jacobian, self._gain)
        if self._per is None:
            return gain
        time = self._dense(jacobian, self._per)
        return (gain - self.value(x) * time) / float(self.values(x)[self._per])

    def _dense(self, jacobian: sparse.csr_array, row: int) -> np.ndarray:
        entries = slice(self._starts[row], self._starts[row + 1])
        dense = np.zeros(len(self.upper))
        dense[self._indices[entries]] = jacobian.data[entries]
        return dense

    def repaired(self, x: np.ndarray) -> np.ndarray:
        """The same point with every excess at the least that its row allows."""
        columns, rows = self._excess.columns, self._excess.rows
        if not len(columns):
            return x
        x = x.copy()
        x[columns] = 0.0
        slopes = (self._constant + self._slopes @ x)[self._excess_entries]
        missing = np.maximum(-self.values(x)[rows], 0.0)
        # arcs without duration have neither a slope nor anything missing but rounding
        x[columns] = np.where(slopes > _NO_SLOPE, missing / np.maximum(slopes, _NO_SLOPE), 0.0)
        return x

    def _step(self, x: np.ndarray, radius: np.ndarray | float, factors: float = np.inf) -> Any:
        """Solve the program linearised at x with the held columns near it; None if there is none.

        The factors of an excess stay within a share of their bounds.
        """
        jacobian = self.jacobian(x)
        self._load(jacobian, self.slope(x, jacobian), jacobian @ x - self.values(x))
        columns = self._guarded
        low, high = self.lower[columns], self.upper[columns]
        near = np.clip(x[columns], low, high)
        own = factors * self.upper[self._excess.factors]
        radius = np.concatenate([np.broadcast_to(radius, len(self.held)), own])
        low, high = np.maximum(low, near - radius), np.minimum(high, near + radius)
        self._highs.changeColsBounds(len(columns), columns, low, high)
        if self._basis is not None:
            self._highs.setBasis(self._basis)
        self.programs += 1
        self._highs.run()
        pivots = self._highs.getInfo().simplex_iteration_count
        self.work += (pivots + _PIVOTS_OF_SETTING_UP) * sum(jacobian.shape)
        if self._highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            return None
        self._basis = self._highs.getBasis()
        return self._highs.getSolution()

    def _load(self, matrix: sparse.csr_array, cost: np.ndarray, shift: np.ndarray) -> None:
        model: Any = highspy.HighsLp()
        model.num_row_, model.num_col_ = matrix.shape
        model.sense_ = highspy.ObjSense.kMaximize
        model.col_cost_ = cost
        model.col_lower_, model.col_upper_ = self.lower, self.upper
        model.row_lower_, model.row_upper_ = self.row_lower + shift, self.row_upper + shift
        model.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        model.a_matrix_.start_ = self._starts
        model.a_matrix_.index_ = self._indices
        model.a_matrix_.value_ = matrix.data
        self._highs.passModel(model)

    def restore(self, x: np.ndarray, factors: float = np.inf) -> Point | None:
        """Best point with the held columns of x; None where there is none.

        With an excess, the best to first order with its factors within a share of their bounds.
        """
        found = self._step(self.repaired(x), 0.0, factors)
        if found is None:
            return None
        return self.point(np.array(found.col_value))

    def point(self, x: np.ndarray) -> Point:
        """A feasible x with its value."""
        x = self.repaired(x)
        return Point(x, self.value(x))

    def climb(
        self, start: Point, until: Climb, stop: Callable[[Point], bool] = lambda _: False
    ) -> Point:
        """Improve a feasible point until a linearised step promises nothing more.

        Parameters
        ----------
        start : Point
            From `restore`.
        until : Climb
            When to end.
        stop : callable, optional
            Asked after each step whether to give up.

        Returns
        -------
        Point
            Feasible to the solver's tolerance, never worse than the start.
        """
        best, radius = start, until.radius
        for _ in range(until.steps):
            sizes = best.x[self.held]
            sizes = np.maximum(sizes, _SHORTEST_STEP * sizes.mean())
            found = self._step(best.x, radius * sizes, radius)
            promised, better = 0.0, None
            if found is not None:
                x = np.array(found.col_value)
                slope = self.slope(best.x, self.jacobian(best.x))
                promised = float(slope @ (x - best.x))
                if promised <= until.tolerance * abs(best.value):
                    break
                if best.value + until.reach * promised < until.enough:
                    break
                better = self.restore(x, radius)
            gained = -np.inf if better is None else better.value - best.value
            if better is not None and gained > 0:
                best = better
                share = gained / promised
                radius = (
                    min(2 * radius, _LARGEST) if share > 0.5 else radius * min(1.0, 4 * share + 0.2)
                )
            else:
                radius *= _SHRINK
            if radius < _SMALLEST or stop(best):
                break
        return best

    def sharpen(self, point: Point, radius: float = 1e-3) -> tuple[Point, np.ndarray]:
        """Solve the equations of the active rows and bounds by Newton's method.

        Parameters
        ----------
        point : Point
            Near a local optimum.
        radius : float, optional
            Trust region of the step that finds what is active.

        Returns
        -------
        point : Point
            On its active rows to rounding, or as it was where that would leave the rest.
        multipliers : ndarray, shape (rows,)
            Gain in the objective per unit by which the side of each row is moved.
        """
        found = self._step(point.x, radius * np.maximum(point.x[self.held], 1e-12))
        if found is None:
            return point, np.zeros(len(self.row_lower))
        multipliers = np.array(found.row_dual)
        x = np.array(found.col_value)
        basis = self._basis
        held_rows = _nonbasic(basis.row_status)
        free = ~_nonbasic(basis.col_status)
        at_upper = np.array([s == highspy.HighsBasisStatus.kUpper for s in basis.row_status])
        sides = np.where(at_upper, self.row_upper, self.row_lower)[held_rows]
        for _ in range(_NEWTON_STEPS):
            off = self.values(x)[held_rows] - sides
            if not np.all(np.isfinite(off)):
                return point, multipliers
            matrix = self.jacobian(x)[held_rows][:, free].tocsc()
            try:
                x[free] -= splu(matrix).solve(off)
            except (RuntimeError, ValueError):  # singular: the basis is no vertex here
                return point, multipliers
        sharp = Point(x, self.value(x))
        worse = sharp.value < point.value - 1e-7 * abs(point.value)
        if worse or self.violation(x) > max(_SHARP, 1e-3 * self.violation(point.x)):
            return point, multipliers
        return sharp, multipliers


def _nonbasic(status: Sequence[Any]) -> np.ndarray:
    return np.array([s != highspy.HighsBasisStatus.kBasic for s in status])


_NEWTON_STEPS = 4
_PIVOTS_OF_SETTING_UP = 20
_SHARP = 1e-12
_NO_SLOPE = 1e-12

_OPTIONS = {
    "threads": 1,
    "solver": "simplex",
    "presolve": "off",
    "primal_feasibility_tolerance": 1e-9,
    "dual_feasibility_tolerance": 1e-9,
}
