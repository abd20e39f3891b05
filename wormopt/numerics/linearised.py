"""A bilinear program and its linearisations, each solved from the last basis."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import highspy
import numpy as np
from scipy import sparse

from wormopt.numerics.bilinear_rows import BilinearRows
from wormopt.numerics.linear_program import simplex, solve


@dataclass(frozen=True, eq=False)
class Point:
    """A feasible point of a bilinear program."""

    x: np.ndarray  # (columns,) values of the unknowns
    value: float  # the objective there


@dataclass(frozen=True, eq=False)
class Excess:
    """Columns for costs: each is at least the value that its row demands, and 0.

    A row has the lower side 0, and products of its column with held columns only.
    """

    columns: np.ndarray  # of each cost
    rows: np.ndarray  # of each cost
    factors: np.ndarray  # columns with mutual products in the rows, kept near the linearisation


class Linearised:
    """A bilinear program that can be linearised anywhere; see `BilinearProgram` for parameters."""

    def __init__(
        self,
        rows: BilinearRows,
        held: np.ndarray,
        gain: int,
        per: int | None = None,
        excess: Excess | None = None,
        tolerance: float = 1e-9,
    ) -> None:
        self.upper = np.array(rows.upper)
        self.lower = np.zeros(len(self.upper))
        self.row_lower, self.row_upper = rows.sides()
        self.held, self._gain, self._per = held, gain, per
        self._excess = excess or Excess(*[np.empty(0, int)] * 3)
        self._guarded = np.concatenate([held, self._excess.factors]).astype(np.int32)
        self._assemble(rows)
        # with an excess the optimum is no vertex, so that `sharpen` cannot remove the rest
        self._tolerance = tolerance if excess is None else 1e-10
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
        self._row = np.repeat(np.arange(rows.count), np.diff(self._starts))
        excess = self._excess
        self._excess_entries = np.searchsorted(places, excess.rows * n + excess.columns)

    def jacobian(self, x: np.ndarray) -> sparse.csr_array:
        """Derivatives of all rows, shape (rows, columns)."""
        shape = (len(self._starts) - 1, len(self.upper))
        return sparse.csr_array((self._entries(x), self._indices, self._starts), shape)

    def _entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of the Jacobian; setting up the matrix takes longer than using it."""
        return self._constant + self._slopes @ x

    def _times(self, entries: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.bincount(self._row, entries * x[self._indices], len(self.row_lower))

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values of all rows at `x` (columns,)."""
        return self._times(self._constant + 0.5 * (self._slopes @ x), x)

    def value(self, x: np.ndarray) -> float:
        """Objective at `x` (columns,)."""
        return self._value(self.values(x))

    def _value(self, values: np.ndarray) -> float:
        return float(values[self._gain] / (1.0 if self._per is None else values[self._per]))

    def violation(self, x: np.ndarray) -> float:
        """Largest excess over any side of a row or bound of a column."""
        values = self.values(x)
        rows = np.maximum(self.row_lower - values, values - self.row_upper)
        return float(max(rows.max(), np.maximum(self.lower - x, x - self.upper).max(), 0.0))

    def slope(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the objective at `x`."""
        return self._slope(self._entries(x), self.values(x))

    def _slope(self, entries: np.ndarray, values: np.ndarray) -> np.ndarray:
        gain = self._dense(entries, self._gain)
        if self._per is None:
            return gain
        time = self._dense(entries, self._per)
        return (gain - self._value(values) * time) / float(values[self._per])

    def _dense(self, entries: np.ndarray, row: int) -> np.ndarray:
        own = slice(self._starts[row], self._starts[row + 1])
        dense = np.zeros(len(self.upper))
        dense[self._indices[own]] = entries[own]
        return dense

    def repaired(self, x: np.ndarray) -> np.ndarray:
        """The point with every excess at the least value that its row allows."""
        columns, rows = self._excess.columns, self._excess.rows
        if not len(columns):
            return x
        x = x.copy()
        x[columns] = 0.0
        slopes = self._entries(x)[self._excess_entries]
        missing = np.maximum(-self.values(x)[rows], 0.0)
        # arcs without duration have no slope and no excess but rounding
        x[columns] = np.where(slopes > _NO_SLOPE, missing / np.maximum(slopes, _NO_SLOPE), 0.0)
        return x

    def _step(self, x: np.ndarray, radius: np.ndarray | float, factors: float = np.inf) -> Any:
        """Solve the program linearised at x, held columns near it; None without a solution.

        The factors of an excess stay within a share of their bounds.
        """
        entries, values, highs = self._entries(x), self.values(x), _solver()
        shift, columns = self._times(entries, x) - values, self._guarded
        lower, upper = self.lower.copy(), self.upper.copy()
        near = np.clip(x[columns], lower[columns], upper[columns])
        own = factors * self.upper[self._excess.factors]
        radius = np.concatenate([np.broadcast_to(radius, len(self.held)), own])
        lower[columns] = np.maximum(lower[columns], near - radius)
        upper[columns] = np.minimum(upper[columns], near + radius)
        size = len(self.row_lower) + len(upper)
        highs.passModel(  # as arrays: a tenth of the time that a HighsLp takes
            len(upper),
            len(self.row_lower),
            len(self._indices),
            int(highspy.MatrixFormat.kRowwise),
            int(highspy.ObjSense.kMaximize),
            0.0,
            self._slope(entries, values),
            lower,
            upper,
            self.row_lower + shift,
            self.row_upper + shift,
            self._starts[:-1],
            self._indices,
            entries,
            np.zeros(len(upper), np.int32),
        )
        highs.setOptionValue("primal_feasibility_tolerance", self._tolerance)
        if self._basis is not None:
            highs.setBasis(self._basis)
        self.programs += 1
        status, pivots = solve(highs, int(min(_MOST_WORK / size, _MOST_PIVOTS * size)))
        self.work += (pivots + _PIVOTS_OF_SETTING_UP) * size
        if status != highspy.HighsModelStatus.kOptimal:
            return None
        self._basis = highs.getBasis()
        return highs.getSolution()

    def restore(self, x: np.ndarray, factors: float = np.inf) -> Point | None:
        """Best point with the held columns of `x`; None if there is none.

        With an excess, best to first order with its factors within a share, `factors`, of
        their bounds.
        """
        found = self._step(self.repaired(x), 0.0, factors)
        if found is None:
            return None
        return self.point(np.array(found.col_value))

    def point(self, x: np.ndarray) -> Point:
        """A feasible `x` with its value."""
        x = self.repaired(x)
        return Point(x, self.value(x))


_PIVOTS_OF_SETTING_UP = 20
# Work limit of the simplex method: a second, where usual programs take milliseconds; and pivots
# times rows and columns, which a small program that cycles exceeds by millions within that time.
_MOST_WORK, _MOST_PIVOTS = 5e8, 100
_NO_SLOPE = 1e-12

# Values are of order 1, and exact edge weights take longer than the pivots that they save.
_OF_SMALL_PROGRAMS = {"simplex_scale_strategy": 0, "simplex_dual_edge_weight_strategy": 1}

_OF_THREAD = threading.local()


def _solver() -> Any:
    """The solver of this thread: programs are many, and each solver takes a megabyte."""
    if not hasattr(_OF_THREAD, "highs"):
        _OF_THREAD.highs = simplex(**_OF_SMALL_PROGRAMS)
    return _OF_THREAD.highs
