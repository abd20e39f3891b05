"""Linear programs that are solved repeatedly, with bounds that are safe against rounding.

A solver's optimal value is only as accurate as its tolerances. But *any* multipliers give an
upper bound on the maximum, a sum of a few terms with known rounding errors. So the solver
proposes multipliers and the bound is computed here (Neumaier and Shcherbina, Safe bounds in linear
and mixed-integer linear programming, 2004). Whole columns are searched by branch and bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import highspy
import numpy as np

# Columns, one per row or one for all, with their coefficients.
Term = tuple["np.ndarray | int", "np.ndarray | float"]

# Time and pivot limits of a method for one program: usual programs take milliseconds and hundreds
# of pivots.
_LONGEST, _MOST_PIVOTS = 30.0, 200_000
# Rounding error of a computed coefficient, in unit roundoffs.
_COEFFICIENT_ULPS = 8
_ULP = float(np.finfo(float).eps)


class _Silent(highspy.Highs):
    """HiGHS without output: version 1.16 prints a banner before options can be set."""

    def enableCallbacks(self) -> None:
        """Enable callbacks; called first by the constructor."""
        self.silent()
        super().enableCallbacks()


def silent_highs() -> Any:
    """Return an empty HiGHS that prints nothing; its stubs lack half of its methods."""
    highs: Any = _Silent()
    highs.silent()  # earlier versions do not enable callbacks in the constructor
    return highs


def simplex(**options: float | str) -> Any:
    """Return an empty, silent HiGHS with one thread and the simplex method.

    Without presolve: programs differ little, and the last basis saves more.
    """
    highs = silent_highs()
    for option, value in (_OPTIONS | options).items():
        highs.setOptionValue(option, value)
    return highs


def solve(highs: Any, pivots: int = _MOST_PIVOTS) -> tuple[Any, int]:
    """Solve within limits; returns the status and the number of pivots.

    If the simplex method cycles or fails, interior points follow: they take some fifty steps
    where it takes millions.
    """
    highs.setOptionValue("simplex_iteration_limit", pivots)
    status = _solve_by(highs, "simplex")
    taken = max(int(highs.getInfo().simplex_iteration_count), 0)
    if status in _UNDECIDED:
        highs.clearSolver()
        status = _solve_by(highs, "ipm")
    return status, taken


def _solve_by(highs: Any, method: str) -> Any:
    highs.setOptionValue("solver", method)
    highs.setOptionValue("time_limit", highs.getRunTime() + _LONGEST)  # of all its runs
    return highs.getModelStatus() if highs.run() != _FAILED else highspy.HighsModelStatus.kUnknown


_FAILED = highspy.HighsStatus.kError
_UNDECIDED = {
    highspy.HighsModelStatus.kIterationLimit,
    highspy.HighsModelStatus.kTimeLimit,
    highspy.HighsModelStatus.kSolveError,
    highspy.HighsModelStatus.kUnknown,
}
_OPTIONS: dict[str, float | str] = {
    "threads": 1,
    "presolve": "off",
    "primal_feasibility_tolerance": 1e-9,
    "dual_feasibility_tolerance": 1e-9,
}


def interior_point(
    cost: np.ndarray,
    entries: tuple[np.ndarray, np.ndarray, np.ndarray],
    upper: np.ndarray,
    largest: float,
    seconds: float,
) -> np.ndarray:
    """Minimise cost x within A x <= upper and |x| <= largest, to some seven digits or for a time.

    `entries` are rows, columns and values of A; duplicates are added up. x is 0 if the solver
    finds nothing.
    """
    from scipy.sparse import csc_array

    row, column, value = entries
    matrix = csc_array((value, (row, column)), shape=(len(upper), len(cost)))
    model: Any = highspy.HighsLp()
    model.num_row_, model.num_col_ = matrix.shape
    model.col_cost_ = cost
    model.col_lower_, model.col_upper_ = np.full((2, len(cost)), [[-largest], [largest]])
    model.row_lower_, model.row_upper_ = np.full(len(upper), -highspy.kHighsInf), upper
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_, model.a_matrix_.index_ = matrix.indptr, matrix.indices
    model.a_matrix_.value_ = matrix.data
    highs = silent_highs()
    left = max(0.0, seconds)
    options = {"solver": "ipm", "run_crossover": "off", "threads": 1, "time_limit": left}
    for option, given in options.items():
        highs.setOptionValue(option, given)
    highs.HandleUserInterrupt = True
    highs.passModel(model)
    working = highs.startSolve()
    try:
        while working.is_alive():  # a join without timeout would delay Ctrl-C
            working.join(0.1)
    except KeyboardInterrupt:
        highs.cancelSolve()
        while working.is_alive():  # a thread left behind would abort the process
            with suppress(KeyboardInterrupt):
                working.join(0.1)
        raise
    return np.array(highs.getSolution().col_value or np.zeros(len(cost)))


@dataclass
class Columns:
    """Columns of a program under construction, from 0 to a bound each."""

    upper: list[float] = field(default_factory=list)  # bounds of the columns so far

    def columns(self, upper: np.ndarray) -> np.ndarray:
        """Number new columns from 0 to these bounds; -1 for the bound 0: no column."""
        kept = upper > 0.0
        number = np.where(kept, len(self.upper) - 1 + np.cumsum(kept).reshape(upper.shape), -1)
        self.upper.extend(upper[kept].tolist())
        return number


@dataclass
class Rows(Columns):
    """Rows of a linear program under construction, added in blocks, and its columns."""

    count: int = 0  # rows so far
    _entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    _sides: list[np.ndarray] = field(default_factory=list)

    def add(
        self,
        terms: Sequence[Term],
        lower: np.ndarray | float,
        upper: np.ndarray | float,
    ) -> np.ndarray:
        """Add the rows lower <= sum of coefficient times column <= upper; returns their numbers.

        Columns and coefficients are broadcast; terms of column -1 are left out. Sides may be
        infinite.
        """
        size = max([p.size for term in terms for p in term if isinstance(p, np.ndarray)], default=1)
        rows = np.arange(self.count, self.count + size)
        row, column = np.empty((2, len(terms), size), int)
        row[:], value = rows, np.empty((len(terms), size))
        for k, (columns, coefficients) in enumerate(terms):
            column[k], value[k] = columns, coefficients
        sides = np.empty((2, size))
        sides[0], sides[1] = lower, upper
        self._entries.append((row.ravel(), column.ravel(), value.ravel()))
        self._sides.append(sides)
        self.count += size
        return rows

    def assemble(self, columns: int) -> tuple[np.ndarray, ...]:
        """Assemble the blocks row by row: starts (rows + 1,), column, value, lower, upper.

        Entries of a row are in the order of columns; duplicates are added up.
        """
        row, column, value = (np.concatenate(part) for part in zip(*self._entries, strict=True))
        kept = column >= 0
        place = row[kept] * columns + column[kept]
        order = np.argsort(place, kind="stable")
        place, value = place[order], value[kept][order]
        first = np.flatnonzero(np.diff(place, prepend=-1))
        row, column = np.divmod(place[first], columns)
        starts = np.searchsorted(row, np.arange(self.count + 1)).astype(np.int32)
        sides = np.concatenate(self._sides, axis=1)
        value = np.add.reduceat(value, first) if first.size else value
        return starts, column.astype(np.int32), value, *sides


@dataclass(frozen=True, eq=False)
class Maximum:
    """Bound and solution of a linear program."""

    bound: float  # proven upper bound; minus infinity if infeasible
    x: np.ndarray  # solution to the solver's tolerances; empty if none
    row_duals: np.ndarray  # gain per unit by which a side moves


class LinearProgram:
    """Maximise a linear cost (n,) within rows and bounds, repeatedly with more rows.

    The basis is kept, so that a few rows take a few steps of the dual simplex method.
    Column bounds must be finite, as the proven bound requires. Not thread-safe.
    """

    def __init__(self, cost: np.ndarray, rows: Rows, lower: np.ndarray, upper: np.ndarray) -> None:
        if not (np.all(np.isfinite(lower)) and np.all(np.isfinite(upper))):
            raise ValueError("every column of the program needs finite bounds")
        self._cost, self._lower, self._upper = cost, lower.copy(), upper.copy()
        self._row, self._column = np.empty((2, 0), np.int32)
        self._value, self._row_lower, self._row_upper = np.empty((3, 0))
        # Devex: programs are small, exact weights costly. Presolve would lose the proof of
        # infeasibility.
        self._highs = simplex(simplex_dual_edge_weight_strategy=1)
        model: Any = highspy.HighsLp()
        model.num_row_, model.num_col_ = 0, len(cost)
        model.sense_ = highspy.ObjSense.kMaximize
        model.col_cost_, model.col_lower_, model.col_upper_ = cost, lower, upper
        self._highs.passModel(model)
        self.extend(rows)

    def extend(self, rows: Rows) -> np.ndarray:
        """Add rows at the end; returns their numbers."""
        starts, column, value, lower, upper = rows.assemble(len(self._cost))
        self._highs.addRows(rows.count, lower, upper, len(value), starts[:-1], column, value)
        row = np.repeat(np.arange(rows.count), np.diff(starts)) + len(self._row_lower)
        self._row, self._column = np.append(self._row, row), np.append(self._column, column)
        self._value = np.append(self._value, value)
        self._row_lower = np.append(self._row_lower, lower)
        self._row_upper = np.append(self._row_upper, upper)
        self._most_terms = int(np.bincount(self._column).max(initial=0))
        return np.arange(len(self._row_lower) - rows.count, len(self._row_lower))

    def maximise(self) -> Maximum:
        """Solve, and bound the maximum independently of the solver's status.

        Minus infinity if infeasibility is proven in spite of rounding; if the solver fails the
        bound is weak but valid.
        """
        nothing = np.empty(0)
        status, _ = solve(self._highs)
        if status == highspy.HighsModelStatus.kInfeasible:
            # a ray of multipliers proves it: along it the bound of any cost decreases without limit
            _, exists, ray = self._highs.getDualRay()
            ray = np.array(ray) if exists else np.zeros(len(self._row_lower))
            empty = min(self._bound(0.0 * self._cost, y) for y in (ray, -ray)) < 0.0
            return Maximum(-np.inf if empty else self._crude(), nothing, nothing)
        solution = self._highs.getSolution()
        if not solution.dual_valid or len(solution.row_dual) != len(self._row_lower):
            return Maximum(self._crude(), nothing, nothing)
        duals = np.array(solution.row_dual)
        bound = min(self.bound(duals), self._crude())
        return Maximum(bound, np.array(solution.col_value), duals)

    def _crude(self) -> float:
        """Bound without multipliers."""
        ends = np.maximum(self._cost * self._lower, self._cost * self._upper)
        size = np.abs(self._cost) @ np.maximum(np.abs(self._lower), np.abs(self._upper))
        return float(ends.sum() + 2 * (len(ends) + _COEFFICIENT_ULPS) * _ULP * size)

    def bound(self, duals: np.ndarray) -> float:
        """Bound the maximum from above by any row multipliers y (rows,), rounding included.

        c x = y A x + (c - y A) x is at most the sum of the largest values of both parts, row
        and column wise. True even if coefficients are a few roundoffs off.
        """
        return self._bound(self._cost, duals)

    def _bound(self, cost: np.ndarray, duals: np.ndarray) -> float:
        has_side = np.where(duals > 0, self._row_upper, -self._row_lower) < np.inf
        y = np.where(has_side, duals, 0.0)
        side = np.where(y > 0, self._row_upper, np.where(y < 0, self._row_lower, 0.0))
        parts, columns = y[self._row] * self._value, len(cost)
        left = cost - np.bincount(self._column, parts, columns)
        value = y @ side + np.maximum(left * self._lower, left * self._upper).sum()
        # The error of a sum is at most as many roundoffs of its absolute values as it has terms.
        reach = np.maximum(np.abs(self._lower), np.abs(self._upper))
        sizes = abs(cost) + np.bincount(self._column, abs(parts), columns)
        size = abs(y) @ abs(side) + sizes @ reach
        ulps = len(y) + len(cost) + self._most_terms + _COEFFICIENT_ULPS
        total = float(value + 2 * ulps * _ULP * size)
        return total if np.isfinite(total) else np.inf  # infinite multipliers


# Tolerance of rows and integer columns, and gap of the best point.
TOLERANCE = 1e-9
MISSED = 1e-8


@dataclass(frozen=True, eq=False)
class Mixed:
    """Bounds of the maximum of a mixed program."""

    bound: float  # no point is better, to the solver's tolerances
    x: np.ndarray  # best point found; empty if none
    value: float  # its objective; -inf if none
    nodes: int  # of the tree


def maximise_mixed(
    cost: np.ndarray,
    rows: Rows,
    lower: np.ndarray,
    upper: np.ndarray,
    whole: np.ndarray,
    seconds: float,
) -> Mixed:
    """Maximise a linear cost (n,) within rows and bounds; columns `whole` are integers.

    After `seconds` it returns what it has. One thread makes it reproducible.
    """
    starts, column, value, row_lower, row_upper = rows.assemble(len(cost))
    model: Any = highspy.HighsLp()
    model.num_row_, model.num_col_ = rows.count, len(cost)
    model.sense_ = highspy.ObjSense.kMaximize
    model.col_cost_, model.col_lower_, model.col_upper_ = cost, lower, upper
    model.row_lower_, model.row_upper_ = row_lower, row_upper
    matrix = model.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kRowwise
    matrix.start_, matrix.index_, matrix.value_ = starts, column, value
    kinds = [highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger]
    model.integrality_ = [kinds[int(j)] for j in np.isin(np.arange(len(cost)), whole)]
    solver = silent_highs()
    options: dict[str, float | int] = {
        "threads": 1,
        "time_limit": max(seconds, 0.1),
        "mip_feasibility_tolerance": TOLERANCE,
        "primal_feasibility_tolerance": TOLERANCE,
        "mip_rel_gap": 0.0,
        "mip_abs_gap": MISSED,
    }
    for option, number in options.items():
        solver.setOptionValue(option, number)
    solver.passModel(model)
    solver.run()
    info, solution = solver.getInfo(), solver.getSolution()
    found = bool(solution.value_valid)
    return Mixed(
        float(info.mip_dual_bound),
        np.array(solution.col_value) if found else np.empty(0),
        float(info.objective_function_value) if found else -np.inf,
        int(info.mip_node_count),
    )
