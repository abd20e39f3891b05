"""Descent from one start: over smooth contact of decreasing width, then as the task requires."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.shooting import Shooting
from wormopt.fitting.stretches import lifted, states_read
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import held_at, offset_of, triangle
from wormopt.simulation.options import Smooth

ARRIVED = 1e-3
"""Standard errors within which a fit has converged."""
# Widths of the smooth law, in typical contact speeds.
_WIDTHS = (1.0, 0.2)
# Default number of nodes, and standard deviation of jumps, in nominal sizes of states.
_NODES, _MANY_NODES, _JUMPS = 6, 20, (0.1, 0.01, 1e-3)
# Most steps; least relative gain of a step if only a start is needed.
_LOOKS, _LOOKS_ROUGH, _GAIN_ROUGH = 100, 20, 1e-1
# Number of restarts of a trust region that shrank at a kink, or reached a bound.
_REGIONS = 4
# Distance in standard errors, of one unknown alone, at which a bound is reached.
_NEAR_A_BOUND = 0.3


@dataclass(frozen=True)
class Descent:
    """End of one descent."""

    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    offset: float
    evaluations: int

    @property
    def cost(self) -> float:
        """Half the sum of squares."""
        return float(self.residuals @ self.residuals) / 2


class Squares(Protocol):
    """Residuals whose sum of squares is minimised."""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest coordinates."""
        ...

    def residuals(self, theta: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their Jacobian; SolveError if the motion fails."""
        ...


Seen = Callable[[Descent], None]


class _Arrived(Exception):
    """The descent has converged."""


def descend(
    task: Squares,
    theta: np.ndarray,
    seen: Seen = lambda _: None,
    *,
    rough: bool = False,
) -> Descent:
    """Follow Gauss-Newton steps in a trust region until convergence or small gains.

    `seen` gets every point on the path; `rough`: only a start for the next descent is needed.
    Raises SolveError if the motion at the start cannot be simulated.
    """
    best = _look(task, _inside(task, theta), 0)
    for _ in range(_REGIONS):
        before = best
        best = _settled(task, _region(task, best, seen, rough))
        spent = best.evaluations >= _LOOKS
        if rough or spent or best.offset < ARRIVED or best.cost > before.cost * (1 - 1e-6):
            break
    return best


def _region(task: Squares, begin: Descent, seen: Seen, rough: bool) -> Descent:
    """Use SciPy's trust region; points that cannot be simulated are rejected.

    Coordinates at a bound stay there.
    """
    from scipy.optimize import least_squares

    free = ~_held(task, begin)
    if begin.offset < ARRIVED or not free.any():
        return begin
    points = {begin.theta.tobytes(): begin}
    best, count = begin, begin.evaluations

    def at(part: np.ndarray) -> Descent | None:
        nonlocal best, count
        theta = begin.theta.copy()
        theta[free] = part
        key = theta.tobytes()
        if key not in points:
            count += 1
            points.clear()  # residuals and slopes are requested for one point after the other
            try:
                points[key] = _look(task, theta, 0)
            except (SolveError, ArgumentError):
                return None
        if points[key].cost <= best.cost:
            best = points[key]
            seen(best)
        return points[key]

    # SciPy sees n + 1 rows with the same products: it is slow on tall thin matrices.
    def residuals(part: np.ndarray) -> np.ndarray:
        point = at(part)
        return np.full(free.sum() + 1, np.inf) if point is None else _short(point, free)[:, -1]

    def jacobian(part: np.ndarray) -> np.ndarray:
        point = at(part)
        assert point is not None
        if point.offset < ARRIVED:
            raise _Arrived
        return _short(point, free)[:, :-1]

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


def _short(point: Descent, free: np.ndarray) -> np.ndarray:
    """Jacobian with residuals as last column, as few rows with the same products."""
    return triangle(np.column_stack([point.jacobian[:, free], point.residuals]))


def _settled(task: Squares, found: Descent) -> Descent:
    """Move coordinates near a bound, and pushing against it, to the bound: steps never reach it."""
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


def _look(task: Squares, theta: np.ndarray, count: int) -> Descent:
    residuals, jacobian = task.residuals(theta)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        raise SolveError("the motion or its derivatives grow beyond all numbers", "")
    free = ~held_at(task.bounds, theta, jacobian.T @ residuals)
    return Descent(theta, residuals, jacobian, offset_of(residuals, jacobian, free), count + 1)


def _held(task: Squares, at: Descent) -> np.ndarray:
    return held_at(task.bounds, at.theta, at.jacobian.T @ at.residuals)


def _inside(task: Squares, theta: np.ndarray) -> np.ndarray:
    """Move strictly between the bounds, as SciPy requires of a start."""
    lower, upper = task.bounds
    room = np.minimum(upper - lower, np.maximum(1.0, np.abs(theta)))
    return np.clip(theta, lower + 1e-10 * room, upper - 1e-10 * room)


@dataclass(frozen=True)
class Way:
    """First stage of a descent, before contact is that of the task and runs are whole."""

    widths: tuple[float, ...] = ()  # of smooth contact, in typical contact speeds
    nodes: int = 0  # number of nodes of each run


def ways_of(task: FitTask, nodes: int | None) -> tuple[Way, ...]:
    """First stages to try in turn: they fail for different problems.

    The last is expensive, for when all others have left more than noise.
    """
    if nodes:
        return (Way(nodes=nodes), Way(nodes=nodes))
    rough = isinstance(task.contact, Smooth) or not task.model.contacts
    over = () if rough else (Way(_WIDTHS), Way(_WIDTHS[:1]))
    if nodes is None and all(_is_read(shooting) for shooting in task.shootings):
        return (Way(nodes=_NODES), *over[:1], Way(), Way(nodes=_MANY_NODES))
    return (*over, Way(), over[0] if over else Way())


def _is_read(shooting: Shooting) -> bool:
    """Whether readings determine all states."""
    if shooting.model.delays:
        return False
    middle = float(np.median(shooting.run.times))
    return bool(np.isfinite(states_read(shooting.model, shooting.run, middle)).all())


def approach(task: FitTask, theta: np.ndarray, speed: float, way: Way, seen: Seen) -> Descent:
    """Descend on a problem with wide valleys, then on the task.

    Valleys are wide over smooth contact, or in short stretches between nodes.
    """
    count = 0
    with suppress(SolveError, ArgumentError):  # such as too stiff: continue from the point reached
        for found in _led(task, theta, speed, way):
            theta, count = found.theta[: len(theta)], count + found.evaluations
    found = descend(task, theta, seen)
    return replace(found, evaluations=found.evaluations + count)


def _led(task: FitTask, theta: np.ndarray, speed: float, way: Way) -> Iterator[Descent]:
    for width in way.widths:
        found = descend(replace(task, contact=Smooth(width * speed)), theta, rough=True)
        theta = found.theta
        yield found
    if not way.nodes:
        return
    whole, w = lifted(task, theta, way.nodes)
    for jump in _JUMPS:
        found = descend(replace(whole, jump=jump), w, rough=True)
        w = found.theta
        yield found


def contact_speed(task: FitTask, theta: np.ndarray) -> float:
    """Typical speed over the ground, the unit of widths of smooth contact."""
    if not task.model.contacts:
        return 1.0
    usual = float(np.mean([c.nominal_speed for c in task.model.contacts]))
    try:
        motions = task.motions(theta)
    except SolveError:
        return usual
    speeds = [m.observe(m.system.model.contact_velocities) for m in motions]
    return float(np.sqrt(np.mean(np.concatenate([np.ravel(v) for v in speeds]) ** 2))) or usual
