"""Programs whose rows are sums of linear terms and of products of two unknowns.

With one factor of every product held, such a program is linear. So is its linearisation, and
with the held factors fixed both are the same linear program. `BilinearProgram.climb` alternates:
a linearised step within a trust region finds better factors, the linear program with these held
makes the step feasible again. Where the optimum is a vertex, steps become Newton steps and
`BilinearProgram.sharpen` ends at machine precision.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import highspy
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from wormopt.numerics.linear_program import Columns, Term, simplex, solve

# First and second factor, one per row or one for all, and the coefficient.
Product = tuple["np.ndarray | int", "np.ndarray | int", "np.ndarray | float"]


@dataclass
class BilinearRows(Columns):
    """Rows of a bilinear program under construction, added in blocks, and its columns."""

    count: int = 0  # rows so far
    _sides: list[tuple[int, Any, Any]] = field(default_factory=list)
    _linear: list[tuple[Any, ...]] = field(default_factory=list)
    _products: list[tuple[Any, ...]] = field(default_factory=list)

    def add(
        self,
        linear: Sequence[Term],
        products: Sequence[Product],
        lower: np.ndarray | float,
        upper: np.ndarray | float,
    ) -> np.ndarray:
        """Add the rows lower <= linear terms + products <= upper; returns their numbers.

        Terms (columns, coefficients) and products (columns, columns, coefficients) are
        broadcast; those with a column -1 are left out. Sides may be infinite.
        """
        terms = (*linear, *products)
        factors = (factor for term in terms for factor in term[:-1])
        size = max((f.size for f in factors if isinstance(f, np.ndarray)), default=1)
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
    """Columns of a list of terms, numbers broadcast to the rows, without omitted ones."""
    edges = np.cumsum([0, *(len(term[0]) for term in terms)]).tolist()
    parts = [np.empty(edges[-1], int) for _ in range(width - 1)] + [np.empty(edges[-1])]
    for term, *ends in zip(terms, edges, edges[1:], strict=False):
        for part, value in zip(parts, term, strict=True):
            part[slice(*ends)] = value
    there = np.all([part >= 0 for part in parts[1:-1]], axis=0)
    return [part[there] for part in parts]


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
        """Solve the program linearised at x, held columns near it; None without a solution."""
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


# Trust regions, as shares of each held factor.
_FIRST, _SHRINK, _LARGEST, _SMALLEST = 0.5, 0.25, 1.0, 1e-7
_REACH = 4.0
# Least share of their mean to which steps are limited.
_SHORTEST_STEP = 0.02


@dataclass(frozen=True)
class Climb:
    """Stopping criteria of a climb."""

    tolerance: float = 1e-4  # least relative gain that a linearised step must predict
    steps: int = 60  # most steps
    # stop if this value is out of reach at four times the gain that a full step predicts
    enough: float = -np.inf


class BilinearProgram(Linearised):
    """Maximise row `gain`, or its ratio to the positive row `per`, of a bilinear program.

    `held` are columns held in turn: at least one factor of every product.
    `excess` are costs that are products of columns not held. `tolerance`: errors of rows in the
    linear programs, which `sharpen` removes.
    """

    def climb(
        self, start: Point, until: Climb, stop: Callable[[Point], bool] = lambda _: False
    ) -> Point:
        """Improve a feasible point until a linearised step predicts no more gain.

        Feasible to the solver's tolerance, never worse than `start`, which `restore` returns.
        `stop`, called after each step, returns whether to give up.
        """
        best, radius = start, _FIRST
        for _ in range(until.steps):
            sizes = best.x[self.held]
            sizes = np.maximum(sizes, _SHORTEST_STEP * sizes.mean())
            found = self._step(best.x, radius * sizes, radius)
            promised, better = 0.0, None
            if found is not None:
                x = np.array(found.col_value)
                slope = self.slope(best.x)
                promised = float(slope @ (x - best.x))
                if promised <= until.tolerance * abs(best.value):
                    break
                # with twice the radius a step would promise twice as much at most
                if best.value + _REACH * promised / radius < until.enough:
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

    def sharpen(
        self, point: Point, radius: float = 1e-3, lost: float = 1e-8
    ) -> tuple[Point, np.ndarray]:
        """Move onto the active rows and bounds by Newton's method, to rounding.

        Returns the point, unchanged if sharpening would violate other rows, and multipliers
        (rows,): gain per unit by which a side moves. `radius`: trust region of the active-set
        step; `lost`: share of the value that exact limits may cost, unless nothing else is exact.
        """
        multipliers, exact = np.zeros(len(self.row_lower)), list[Point]()
        for near in (radius, 1e-3 * radius):
            found = self._step(point.x, near * np.maximum(point.x[self.held], 1e-12))
            if found is None:
                break
            multipliers = np.array(found.row_dual)
            x = self._on_active(np.array(found.col_value))
            sharp = point if x is None else Point(x, self.value(x))
            if sharp.value < point.value - lost * abs(point.value):
                exact += [sharp] if self.violation(sharp.x) <= 10 * _SHARP else []
                sharp = point  # the trust region limited the step
            if self.violation(sharp.x) <= 10 * _SHARP:
                return sharp, multipliers
        inner = self.inside(point, _MARGIN)
        return inner or max(exact, key=lambda p: p.value, default=point), multipliers

    def _on_active(self, x: np.ndarray) -> np.ndarray | None:
        """Rows and bounds at their sides in the last basis, and those that this would break."""
        active, free = _nonbasic(self._basis.row_status), ~_nonbasic(self._basis.col_status)
        at_upper = np.array([s == _UPPER for s in self._basis.row_status])
        for _ in range(_ROUNDS):
            sides = np.where(at_upper, self.row_upper, self.row_lower)
            found = self._projected(x, sides, active, free)
            if found is None:
                return None
            values = self.values(found)
            above = ~active & (values > self.row_upper + _SHARP)
            below = ~active & (values < self.row_lower - _SHARP)
            outside = free & ((found < self.lower - _SHARP) | (found > self.upper + _SHARP))
            x = np.clip(found, self.lower, self.upper)
            if not (above.any() or below.any() or outside.any()):
                return x
            active, at_upper = active | above | below, (at_upper & ~below) | above
            free = free & ~outside
        return None

    def inside(
        self, point: Point, margin: float, columns: np.ndarray | float | None = None
    ) -> Point | None:
        """The best nearby point a little within all sides of rows and columns; None if none.

        Equations are exact. Held columns stay, or move a little if no such point is left. `margin`
        from the sides must exceed the solver's error; `columns`: that of each column, if another.
        """
        columns = margin if columns is None else columns
        for radius in (0.0, _INWARD * np.sqrt(margin)):
            found = self._within(point.x, margin, columns, radius)
            if found is not None:
                return found
        return None

    def _within(
        self, x: np.ndarray, margin: float, columns: np.ndarray | float, radius: float
    ) -> Point | None:
        """Move to the best point within all sides; held columns move by this share."""
        moving = np.ones(len(self.lower), bool)
        moving[self.held] = radius > 0
        open_rows = self.row_lower < self.row_upper
        room = margin * (open_rows & (abs(self.jacobian(x)[:, moving]).sum(axis=1) > 0))
        sides, bounds = (self.row_lower, self.row_upper), (self.lower, self.upper)
        within = columns * (moving & (bounds[1] - bounds[0] > 4 * columns))
        inner = bounds[0] + within, bounds[1] - within
        self.row_lower, self.row_upper = sides[0] + room, sides[1] - room
        self.lower, self.upper = inner
        try:
            near = radius * np.maximum(x[self.held], x[self.held].mean())
            found = self._step(self.repaired(x), near)
        finally:
            self.row_lower, self.row_upper = sides
            self.lower, self.upper = bounds
        if found is None:
            return None
        x = np.clip(self.repaired(np.array(found.col_value)), *inner)
        free = (x > inner[0]) & (x < inner[1]) & moving
        exact = self._projected(x, sides[0], ~open_rows, free)
        if exact is None:
            return None
        x = np.clip(exact, self.lower, self.upper)
        return Point(x, self.value(x)) if self.violation(x) <= 10 * _SHARP else None

    def _projected(
        self, x: np.ndarray, sides: np.ndarray, active: np.ndarray, free: np.ndarray
    ) -> np.ndarray | None:
        """The nearest point at which active rows are at their sides; None if there is none."""
        x = x.copy()
        weights = sparse.diags_array(1.0 / (x[free] ** 2 + _SMALL**2))
        for _ in range(_NEWTON_STEPS):
            off = self.values(x)[active] - sides[active]
            if not np.all(np.isfinite(off)):
                return None
            matrix = self.jacobian(x)[active][:, free]
            loose = sparse.diags_array(np.full(len(off), -_LOOSE))
            system = sparse.block_array([[weights, matrix.T], [matrix, loose]], format="csc")
            try:
                step = splu(system).solve(np.concatenate([np.zeros(free.sum()), -off]))
            except (RuntimeError, ValueError):  # contradictory rows
                return None
            x[free] += step[: free.sum()]
        return x

    def linearise(self, x: np.ndarray) -> Any:
        """Solve the program linearised at its optimum `x`, held columns near it.

        The basis is kept: afterwards each `gain` at `x` takes a few pivots.
        """
        sizes = x[self.held]
        return self._step(x, _NEAR * np.maximum(sizes, _SHORTEST_STEP * sizes.mean()))

    def gain(self, moved: BilinearProgram, x: np.ndarray) -> float:
        """First-order gain of a small change of sides, bounds and coefficients.

        `moved` is linearised at the old optimum `x`: its multipliers fit the change even if
        the old ones are not unique. NaN without a point nearby.
        """
        if len(moved.row_lower) != len(self.row_lower):
            return np.nan
        moved._basis = self._basis
        found = moved.linearise(x)
        if found is None:
            return np.nan
        row, column = np.array(found.row_dual), np.array(found.col_dual)
        column[self.held] = 0.0  # belongs to the trust region, not to the program
        gained = _worth(row, moved.row_lower, moved.row_upper)
        gained -= _worth(row, self.row_lower, self.row_upper)
        gained += _worth(column, moved.lower, moved.upper) - _worth(column, self.lower, self.upper)
        gained -= float(row @ (moved.values(x) - self.values(x)))
        return gained + moved.value(x) - self.value(x)


def _worth(multipliers: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """Value of sides at their multipliers, whose signs select the lower or upper side."""
    sides = np.where(multipliers > 0, upper, lower)
    return float(multipliers @ np.where(np.isfinite(sides), sides, 0.0))


def _nonbasic(status: Sequence[Any]) -> np.ndarray:
    return np.array([s != highspy.HighsBasisStatus.kBasic for s in status])


_UPPER = highspy.HighsBasisStatus.kUpper
_NEWTON_STEPS, _ROUNDS = 3, 4
_NEAR = 1e-3  # share by which held columns may move where a program is linearised at its optimum
# Unknowns below this size may move as far as one of this size; error of rows implied by others.
_SMALL, _LOOSE = 1e-3, 1e-13
_SHARP, _MARGIN = 1e-13, 4e-9
# Share of the root of a margin by which held columns move: its square is a hundredth of the margin.
_INWARD = 0.1
