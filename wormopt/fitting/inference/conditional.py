"""Fits of some unknowns with others fixed, from a neighbour in few simulations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import TOLD, triangle

_STEPS, _TRIALS = 3, 30  # of Gauss-Newton, and simulations of a search if these fail


@dataclass(frozen=True, eq=False)
class Point:
    """Coordinates (n,), residuals and Jacobian, as n + 1 rows with the same products."""

    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray

    @property
    def squares(self) -> float:
        """Sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)


def shortened(theta: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray) -> Point:
    """Make a point from all rows."""
    rows = triangle(np.column_stack([jacobian, residuals]))
    return Point(theta, rows[:, -1], rows[:, :-1])


def refit(
    task: FitTask, moved: np.ndarray, free: np.ndarray, near: Point | None, settled: float
) -> Point:
    """Fit unknowns `free` (n,) from `moved` (n,), until the squares hardly decrease.

    Starts at the prediction of the Jacobian of the neighbour `near`, or at it if nothing has moved.
    Raises SolveError if motions cannot be simulated.
    """
    point = near
    if near is not None and not np.array_equal(moved, near.theta):
        point = point_at(task, _step(task, moved, near, free)[0])
    point = point or point_at(task, moved)
    if point is None:
        held = ", ".join(n for n, is_free in zip(task.names, free, strict=True) if not is_free)
        raise SolveError(f"the motion cannot be followed along {held or 'all unknowns'}")
    for _ in range(_STEPS):
        guess, gain = _step(task, point.theta, point, free)
        if gain <= settled:
            return point
        trial = point_at(task, guess)
        if trial is None or trial.squares >= point.squares:
            break
        point = trial
    return _searched(task, point, free, settled)


def point_at(task: FitTask, theta: np.ndarray) -> Point | None:
    """Point at coordinates; None if the motion cannot be simulated."""
    try:
        return shortened(theta, *task.residuals(theta))
    except (SolveError, ArgumentError):
        return None


def _step(
    task: FitTask, moved: np.ndarray, near: Point, free: np.ndarray
) -> tuple[np.ndarray, float]:
    """Minimum by the neighbour's Jacobian, and the decrease of the squares."""
    scale = task.nominal[free]
    columns = near.jacobian[:, free] * scale
    rise = near.residuals + near.jacobian @ (moved - near.theta)
    step = np.linalg.lstsq(columns, -rise, rcond=TOLD)[0]
    guess = moved.copy()
    guess[free] += step * scale
    inside = np.clip(guess, *task.bounds)
    step = (inside - moved)[free] / scale
    return inside, float(-step @ columns.T @ (2 * rise + columns @ step))


def _searched(task: FitTask, start: Point, free: np.ndarray, settled: float) -> Point:
    seen = {start.theta[free].tobytes(): start}
    blank = Point(start.theta, start.residuals * np.nan, start.jacobian)

    def at(x: np.ndarray) -> Point:
        if x.tobytes() not in seen:
            theta = start.theta.copy()
            theta[free] = x
            # NaN makes a search shrink its step
            seen[x.tobytes()] = point_at(task, theta) or blank
        return seen[x.tobytes()]

    how: dict[str, Any] = {
        "jac": lambda x: at(x).jacobian[:, free],
        "bounds": tuple(bound[free] for bound in task.bounds),
        "x_scale": task.nominal[free],
        "ftol": float(max(settled / max(start.squares, settled), 1e-14)),
        "xtol": 1e-10,
        "gtol": None,
        "max_nfev": _TRIALS,
    }
    least = optimize.least_squares(lambda x: at(x).residuals, start.theta[free], **how)
    found = at(least.x)
    return found if found.squares <= start.squares else start
