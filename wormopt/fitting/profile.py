"""Profile likelihoods: intervals of an unknown if all others compensate its change.

Along an unknown the others are fitted again, from predictions of neighbouring points. With z the
signed root of the increase of -2 log(likelihood), the confidence interval ends where z² is the
threshold; z is nearly linear, so that a few points determine the ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtri, fdtri

from wormopt.errors import ArgumentError, Interrupted, SolveError, UnknownNameError
from wormopt.fitting.estimate import Fit, check_fit, check_level
from wormopt.fitting.information import DETERMINED, triangle
from wormopt.fitting.noise import rows_estimated
from wormopt.fitting.task import FitTask
from wormopt.numerics.roots import root
from wormopt.progress import Report, silent
from wormopt.shown import SHORT, lines, text

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
        raise SolveError(f"the fit cannot be repeated along {held or 'all unknowns'}")
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
    step = np.linalg.lstsq(columns, -rise, rcond=DETERMINED)[0]
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
    least = least_squares(lambda x: at(x).residuals, start.theta[free], **how)
    found = at(least.x)
    return found if found.squares <= start.squares else start


_POINTS, _MOST = 4, 40  # on each side: number of points for linear z, and the largest number
_FAR = 1e3  # sizes of an unknown at which its interval is open
_MISSES = 4  # how often a step is shortened because motions fail
_END = 2e-3  # tolerance of an end, relative to half the interval
_SETTLED = 1e-4  # in thresholds, what a refit may leave of the squares
_LOWER = 1e-2  # in thresholds, decrease of the squares that is a better fit


@dataclass(frozen=True, eq=False)
class Profile:
    """Least misfit along one unknown, and the confidence interval that follows."""

    name: str  # the unknown
    level: float  # confidence level of the interval
    threshold: float  # rise of the squares at the interval's ends
    values: np.ndarray  # (m,) values of the unknown, ascending
    rises: np.ndarray  # (m,) increase of the sum of squared residuals over the best one
    numbers: np.ndarray  # (m, n) all unknowns there
    best: float  # value of the unknown that is best
    interval: tuple[float, float]  # its ends; the unknown's bound, or infinite, where it is open
    open: tuple[bool, bool]  # whether the readings do not end it below, and above
    # by how much the squares were below those of the fit: above 0 the fit is not the best
    fell: float

    def __repr__(self) -> str:
        ends = " to ".join(text(end, SHORT) for end in self.interval)
        return lines(f"Profile of {self.name}: {100 * self.level:g} % from {ends}", *self.words)

    @property
    def words(self) -> tuple[str, ...]:
        """Statements about anomalies."""
        sides = zip(("below", "above"), self.open, self.interval, strict=True)
        statements = [
            f"the readings do not bound {self.name} {side}"
            + (f"; its bound {text(end, SHORT)} does" if np.isfinite(end) else "")
            for side, is_open, end in sides
            if is_open
        ]
        if self.fell > 0:
            statements.append(
                f"along {self.name} a better fit was found, with a sum of squares less by "
                f"{text(self.fell, SHORT)}; fit again from {self.name} = {text(self.best, SHORT)}"
            )
        return tuple(statements)


def profile(
    found: Fit,
    names: Sequence[str] | None = None,
    *,
    level: float = 0.95,
    report: Report = silent,
) -> dict[str, Profile]:
    """Compute profile-likelihood confidence intervals, which need not be symmetric.

    Parameters
    ----------
    found : Fit
        The fit.
    names : sequence of str, optional
        Names of unknowns; all if left out.
    level : float, optional
        Confidence level.
    report : callable, optional
        Receives the share that is done.

    Returns
    -------
    dict of str to Profile
        By the names of the unknowns. Priors count like readings. With a robust loss the intervals
        are valid only if the loss describes the noise.

    Raises
    ------
    ArgumentError
        If the level is not between 0 and 1, or a name is unknown.
    Interrupted
        If the user stopped it; `partial` holds the profiles made so far.

    Notes
    -----
    Thresholds are quantiles of chi² with one degree of freedom where the noise is known, else of
    F. D. M. Bates and D. G. Watts, Nonlinear Regression Analysis, 1988, section 6.1.

    Examples
    --------
    A little is left after a decay; how much more could have gone?

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x,
    ...                  p=[wo.Signal("rate", rate, value=1.0)])
    >>> run = wo.Recording([0.0, 1.0], {"x": [1.0, 0.1]}, noise={"x": 0.05})
    >>> found = wo.fit(wo.FitTask(decay, [run], [wo.Unknown("rate")]), seeds=1)
    >>> [round(end, 2) for end in profile(found)["rate"].interval]  # -log(0.1 ± 1.96 * 0.05)
    [1.62, 6.21]
    """
    check_fit(found)
    check_level(level)
    chosen = found.names if names is None else tuple(names)
    unknown = [name for name in chosen if name not in found.names]
    if unknown:
        raise UnknownNameError("the fit", "unknown", unknown, found.names)
    threshold = _threshold(found, level)
    start = shortened(found.theta, found.residuals, found.jacobian)
    made: dict[str, Profile] = {}
    try:
        for number, name in enumerate(chosen):
            report(f"profile of {name}", number / len(chosen))
            line = _Line(found.task, found.names.index(name), threshold)
            made[name] = _profile(line, start, level)
    except KeyboardInterrupt:
        raise Interrupted(made) from None
    return made


def _threshold(found: Fit, level: float) -> float:
    """Quantile of the increase of squares; estimated noise is as uncertain as its readings."""
    if not found.estimated:
        return float(chdtri(1, 1 - level))
    readings = sum(len(rows_estimated(found.task, signal)) for signal in found.estimated)
    return float(fdtri(1, max(readings - len(found.theta), 1), level))


def _profile(line: _Line, start: Point, level: float) -> Profile:
    """Both sides, restarted from any better point."""
    least = start
    while True:
        best = line.refit(None, least)
        below, above = (line.side(best, sign) for sign in (-1, 1))
        points = [*reversed(below[0]), best, *above[0]]
        least = min(points, key=lambda point: point.squares)
        if least.squares >= best.squares - _LOWER * line.threshold:
            break
    task, k = line.task, line.index
    numbers = np.array([task.values(point.theta) for point in points])
    ends = (below[1], above[1])
    bounds = (task.bounds[0][k], task.bounds[1][k])
    reached = [b if e is None else e for e, b in zip(ends, bounds, strict=True)]
    low, high = (task.coordinates[k].value(v) for v in reached)
    low = 0.0 if abs(low) < np.finfo(float).tiny else low  # of positive unknowns
    fell = start.squares - best.squares
    return Profile(
        task.names[k],
        level,
        line.threshold,
        numbers[:, k],
        np.array([point.squares - best.squares for point in points]),
        numbers,
        float(task.values(best.theta)[k]),
        (low, high),
        (ends[0] is None, ends[1] is None),
        fell if fell > _LOWER * line.threshold else 0.0,
    )


@dataclass(frozen=True, eq=False)
class _Line:
    """Points along one unknown, each fitted in the others."""

    task: FitTask
    index: int
    threshold: float

    def side(self, best: Point, sign: int) -> tuple[list[Point], float | None]:
        """Points from the best outwards, and the interval's end; None if it is open."""
        k, target = self.index, np.sqrt(self.threshold)
        size = max(abs(best.theta[k]), self.task.nominal[k])
        bound = self.task.bounds[0 if sign < 0 else 1][k]
        step = min(self._error(best) * target / _POINTS, size)
        points, last, misses = [], best, 0
        while len(points) < _MOST and sign * (bound - last.theta[k]) > 0:
            step = min(step, abs(bound - last.theta[k]))
            value = last.theta[k] + sign * step
            point = self._tried(value, last, best)
            if point is None:  # perhaps closer
                step, misses = step / 4, misses + 1
                if misses > _MISSES:
                    break
                continue
            points.append(point)
            if self._z(point, best) >= target:
                inner, end = self._end(last, point, best)
                return sorted([*points, *inner], key=lambda p: sign * p.theta[k]), end
            if abs(value - best.theta[k]) > _FAR * size:
                break
            gain = self._z(point, best) - self._z(last, best)
            step *= np.clip(target / _POINTS / gain, 0.5, 3.0) if gain > 0 else 3.0
            last = point
        return points, None

    def _tried(self, value: float, last: Point, best: Point) -> Point | None:
        """Refit from the neighbour, at the end also from the best; None if motions fail."""
        found = None
        for near in (last, best):
            with suppress(SolveError):
                point = self.refit(value, near)
                found = point if found is None or point.squares < found.squares else found
            if found is not None and self._z(found, best) < np.sqrt(self.threshold):
                break
        return found

    def refit(self, value: float | None, near: Point) -> Point:
        """Fit all others at a value of this unknown, or all of them if it is None."""
        free = np.ones(len(near.theta), bool)
        moved = near.theta.copy()
        if value is not None:
            free[self.index], moved[self.index] = False, value
        return refit(self.task, moved, free, near, _SETTLED * self.threshold)

    def _z(self, point: Point, best: Point) -> float:
        return float(np.sqrt(max(point.squares - best.squares, 0.0)))

    def _error(self, best: Point) -> float:
        """Standard error of the unknown that the others cannot compensate."""
        others = np.delete(best.jacobian * self.task.nominal, self.index, axis=1)
        column = best.jacobian[:, self.index]
        made_up = others @ np.linalg.lstsq(others, column, rcond=DETERMINED)[0]
        left = float(np.linalg.norm(column - made_up))
        return 1 / left if left > DETERMINED * np.linalg.norm(column) else np.inf

    def _end(self, inside: Point, outside: Point, best: Point) -> tuple[list[Point], float]:
        """Crossing of z with the threshold's root, and the points evaluated."""
        k, target, seen = self.index, np.sqrt(self.threshold), [inside, outside]

        def above(value: float) -> float:
            near = min(seen, key=lambda point: abs(point.theta[k] - value))
            if near.theta[k] != value:
                near = self.refit(value, near)
                seen.append(near)
            return self._z(near, best) - target

        ends = float(inside.theta[k]), float(outside.theta[k])
        end = ends[1]  # rather too far if motions between fail
        with suppress(SolveError):
            end = root(above, *ends, xtol=_END * abs(ends[1] - best.theta[k]))
        return seen[2:], end
