"""Programs whose rows are sums of linear terms and of products of two unknowns.

With one factor of every product held, such a program is linear. So is its linearisation, and
with the held factors fixed both are the same linear program. `BilinearProgram.climb` alternates:
a linearised step within a trust region finds better factors, the linear program with these held
makes the step feasible again. Where the optimum is a vertex, steps become Newton steps and
`BilinearProgram.sharpen` ends at machine precision.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import highspy
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from wormopt.numerics.linearised import Linearised, Point

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
    # stop if this value is out of reach at four times the gain that a step predicts
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
                if best.value + _REACH * promised < until.enough:
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
        step; `lost`: share of the value that exact limits may cost.
        """
        multipliers = np.zeros(len(self.row_lower))
        for near in (radius, 1e-3 * radius):
            found = self._step(point.x, near * np.maximum(point.x[self.held], 1e-12))
            if found is None:
                break
            multipliers = np.array(found.row_dual)
            x = self._on_active(np.array(found.col_value))
            sharp = point if x is None else Point(x, self.value(x))
            if sharp.value < point.value - lost * abs(point.value):
                sharp = point  # the trust region limited the step
            if self.violation(sharp.x) <= 10 * _SHARP:
                return sharp, multipliers
        return self.inside(point, _MARGIN) or point, multipliers

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

    def inside(self, point: Point, margin: float) -> Point | None:
        """The best nearby point a little within all sides, equations exact; None if none.

        Held columns stay, or move a little if no such point is left. `margin` from the sides
        must exceed the solver's error.
        """
        for radius in (0.0, _INWARD * np.sqrt(margin)):
            found = self._within(point.x, margin, radius)
            if found is not None:
                return found
        return None

    def _within(self, x: np.ndarray, margin: float, radius: float) -> Point | None:
        """Move to the best point within all sides; held columns move by this share."""
        moving = np.ones(len(self.lower), bool)
        moving[self.held] = radius > 0
        open_rows = self.row_lower < self.row_upper
        room = margin * (open_rows & (abs(self.jacobian(x)[:, moving]).sum(axis=1) > 0))
        sides = self.row_lower, self.row_upper
        self.row_lower, self.row_upper = sides[0] + room, sides[1] - room
        try:
            near = radius * np.maximum(x[self.held], x[self.held].mean())
            found = self._step(self.repaired(x), near)
        finally:
            self.row_lower, self.row_upper = sides
        if found is None:
            return None
        x = np.clip(self.repaired(np.array(found.col_value)), self.lower, self.upper)
        free = (x > self.lower + margin) & (x < self.upper - margin) & moving
        exact = self._projected(x, sides[0], ~open_rows, free)
        if exact is None:
            return None
        x = np.clip(exact, self.lower, self.upper)
        return Point(x, self.value(x)) if self.violation(x) <= 10 * _SHARP else None

    def _projected(
        self, x: np.ndarray, sides: np.ndarray, active: np.ndarray, free: np.ndarray
    ) -> np.ndarray | None:
        """The nearest point at which active rows are at their sides; None if there is none.

        At a vertex this is Newton's method; elsewhere the smallest steps are taken.
        """
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

    def gain(self, moved: BilinearProgram, x: np.ndarray, radius: float = 1e-3) -> float:
        """First-order gain of a small change of sides, bounds and coefficients.

        `moved` is linearised at the old optimum `x`: its multipliers fit the change even if
        the old ones are not unique. NaN without a point nearby; `radius`: share of held factors.
        """
        if len(moved.row_lower) != len(self.row_lower):
            return np.nan
        sizes = x[self.held]
        moved._basis = self._basis
        near = radius * np.maximum(sizes, _SHORTEST_STEP * sizes.mean())
        found = moved._step(x, near)
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
# Unknowns below this size may move as far as one of this size; error of rows implied by others.
_SMALL, _LOOSE = 1e-3, 1e-13
_SHARP, _MARGIN = 1e-13, 4e-9
# Share of the root of a margin by which held columns move: its square is a hundredth of the margin.
_INWARD = 0.1
