"""One start led downhill: over ever steeper smooth contact, then as exact as asked."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import held_at, offset_of
from wormopt.simulation.options import Smooth

ARRIVED = 1e-3
"""Standard errors within which a fit is at the bottom."""
# Widths of the smooth law, in typical contact speeds.
_WIDTHS = (1.0, 0.2)
# Steps at most, and the share of the cost that a step shall gain where a start is all one wants.
_LOOKS, _LOOKS_ROUGH, _GAIN_ROUGH = 100, 25, 1e-2
# A trust region that shrank at a kink, or came to a bound, is opened again so many times.
_REGIONS = 4
# Standard errors, of one number alone, from which a bound counts as reached.
_NEAR_A_BOUND = 0.3


@dataclass(frozen=True)
class Descent:
    """Where one way downhill ended."""

    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    offset: float
    evaluations: int

    @property
    def cost(self) -> float:
        """Half the sum of squares."""
        return float(self.residuals @ self.residuals) / 2


Seen = Callable[[Descent], None]


class _Arrived(Exception):
    """The bottom is near enough."""


def descend(
    task: FitTask,
    theta: np.ndarray,
    seen: Seen = lambda _: None,
    *,
    rough: bool = False,
) -> Descent:
    """Follow Gauss-Newton steps in a trust region to the bottom, or until little is gained.

    `seen` is shown every point on the way; `rough`: a start for what follows will do. Raises
    SolveError where the motion at the start cannot be followed.
    """
    best = _look(task, _inside(task, theta), 0)
    for _ in range(_REGIONS):
        before = best
        best = _settled(task, _region(task, best, seen, rough))
        if rough or best.offset < ARRIVED or best.cost > before.cost * (1 - 1e-6):
            break
    return best


def _region(task: FitTask, begin: Descent, seen: Seen, rough: bool) -> Descent:
    """Take SciPy's trust region; what cannot be simulated is no way to go.

    What lies at a bound stays there.
    """
    from scipy.optimize import least_squares

    best, count, free = begin, begin.evaluations, ~_held(task, begin)
    if begin.offset < ARRIVED or not free.any():
        return begin

    def whole(part: np.ndarray) -> np.ndarray:
        theta = begin.theta.copy()
        theta[free] = part
        return theta

    def residuals(part: np.ndarray) -> np.ndarray:
        nonlocal count
        if np.array_equal(part, begin.theta[free]):
            return begin.residuals
        count += 1
        try:
            return task.misfit(whole(part))
        except (SolveError, ArgumentError):
            return np.full(len(begin.residuals), np.inf)

    def jacobian(part: np.ndarray) -> np.ndarray:
        nonlocal best, count
        if not np.array_equal(part, begin.theta[free]):
            count += 1
            best = _look(task, whole(part), 0)
            seen(best)
        if best.offset < ARRIVED:
            raise _Arrived
        return best.jacobian[:, free]

    with suppress(_Arrived):
        least_squares(
            residuals,
            begin.theta[free],
            jacobian,  # pyright: ignore[reportArgumentType]
            bounds=tuple(bound[free] for bound in task.bounds),
            x_scale="jac",
            max_nfev=_LOOKS_ROUGH if rough else _LOOKS,
            ftol=_GAIN_ROUGH if rough else 1e-12,
            xtol=1e-12,
            gtol=1e-15,
        )
    return replace(best, evaluations=count)


def _settled(task: FitTask, found: Descent) -> Descent:
    """Put what comes near a bound and pushes against it right there: steps never reach it."""
    lower, upper = task.bounds
    gradient = found.jacobian.T @ found.residuals
    length = np.linalg.norm(found.jacobian, axis=0)
    near = _NEAR_A_BOUND / np.where(length > 0, length, np.inf)
    low = (found.theta - lower < near) & (gradient > 0)
    high = (upper - found.theta < near) & (gradient < 0)
    theta = np.where(low, lower, np.where(high, upper, found.theta))
    if np.array_equal(theta, found.theta):
        return found
    try:
        there = _look(task, theta, found.evaluations)
    except SolveError:
        return found
    return there if there.cost <= found.cost * (1 + 1e-9) else found


def _look(task: FitTask, theta: np.ndarray, count: int) -> Descent:
    residuals, jacobian = task.residuals(theta)
    free = ~held_at(task.bounds, theta, jacobian.T @ residuals)
    return Descent(theta, residuals, jacobian, offset_of(residuals, jacobian, free), count + 1)


def _held(task: FitTask, at: Descent) -> np.ndarray:
    return held_at(task.bounds, at.theta, at.jacobian.T @ at.residuals)


def _inside(task: FitTask, theta: np.ndarray) -> np.ndarray:
    """SciPy wants to begin strictly between the bounds."""
    lower, upper = task.bounds
    room = np.minimum(upper - lower, np.maximum(1.0, np.abs(theta)))
    return np.clip(theta, lower + 1e-10 * room, upper - 1e-10 * room)


def smoothed(task: FitTask, speed: float) -> list[FitTask]:
    """Make tasks of smooth contact, ever steeper; none where nothing touches the ground."""
    if not task.model.contacts or isinstance(task.contact, Smooth):
        return []
    return [replace(task, contact=Smooth(width * speed)) for width in _WIDTHS]


def approach(task: FitTask, theta: np.ndarray, speed: float, seen: Seen) -> Descent:
    """Lead a start downhill over smooth contact, whose valleys are wide, to the task's own."""
    count = 0
    for smooth in smoothed(task, speed):
        try:
            found = descend(smooth, theta, rough=True)
        except SolveError:  # too stiff, say: go on from where it began
            continue
        theta, count = found.theta, count + found.evaluations
    found = descend(task, theta, seen)
    return replace(found, evaluations=found.evaluations + count)


def contact_speed(task: FitTask, theta: np.ndarray) -> float:
    """Typical speed over the ground, by which smooth contact is wide or steep."""
    usual = float(np.mean([c.nominal_speed for c in task.model.contacts] or [1.0]))
    try:
        motions = task.motions(theta)
    except SolveError:
        return usual
    speeds = [m.observe(m.system.model.contact_velocities) for m in motions]
    return float(np.sqrt(np.mean(np.concatenate([np.ravel(v) for v in speeds]) ** 2))) or usual
