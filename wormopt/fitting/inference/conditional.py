"""Some unknowns fitted anew while others are held: from a neighbour, in few simulations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import TOLD, triangle

_STEPS, _TRIALS = 3, 30  # of Gauss and Newton, and simulations of a search where these fail


@dataclass(frozen=True, eq=False)
class Point:
    """Coordinates (n,), residuals there and their Jacobian, as n + 1 rows of the same products."""

    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray

    @property
    def squares(self) -> float:
        """Sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)


def shortened(theta: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray) -> Point:
    """Make a point of all rows."""
    rows = triangle(np.column_stack([jacobian, residuals]))
    return Point(theta, rows[:, -1], rows[:, :-1])


def refit(
    task: FitTask, moved: np.ndarray, free: np.ndarray, near: Point | None, settled: float
) -> Point:
    """Fit what is `free` (n,) from `moved` (n,), until the squares would fall by no more.

    Begins where the Jacobian of the neighbour `near` leads to, or at it where nothing has moved.
    Raises SolveError where motions cannot be followed.
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
    """None where the motion cannot be followed."""
    try:
        return shortened(theta, *task.residuals(theta))
    except (SolveError, ArgumentError):
        return None


def _step(
    task: FitTask, moved: np.ndarray, near: Point, free: np.ndarray
) -> tuple[np.ndarray, float]:
    """Where all is best by the neighbour's Jacobian, and how much the squares fall by it."""
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
            # from NaN a search shrinks back
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
