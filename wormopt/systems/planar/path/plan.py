"""Paths through the plane: the cheapest steps of a library, with amplitudes that meet a goal.

A* over exact poses finds the sequence of steps; their amplitudes then end it in the goal at the
least cost.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial, reduce

import numpy as np
from scipy.optimize import least_squares, minimize

from wormopt.errors import SolveError
from wormopt.numerics.chebyshev import Series, resolve
from wormopt.progress import Report
from wormopt.systems.planar.path.steps import Family, GaitStep, Library, chained
from wormopt.systems.planar.path.task import Cost, PathTask, Tolerance, cost_of, rest_fault, wrapped
from wormopt.systems.planar.poses import compose, inverse, rotate

# Cells are larger by this share, so that steps of round lengths do not end on sides of cells, and
# costs closer than this share count as equal: neither then depends on round-off.
_ODD, _APART = 1.00371, 1e-9


@dataclass(frozen=True)
class Route:
    """Steps of a library from the start to near the goal."""

    steps: tuple[int, ...]  # numbers in the library
    cost: float
    end: np.ndarray  # pose reached, (3,)


@dataclass(eq=False)
class Looked:
    """Progress of a search."""

    poses: int = 0
    pruned: int = 0
    blocked: int = 0
    exhausted: bool = False
    nearest: float = np.inf  # distance from the goal of the place nearest to it


def routes(
    task: PathTask,
    library: Library,
    capture: Tolerance,
    looked: Looked,
    *,
    cost: Cost = "steps",
    cell: tuple[float, float] = (0.0, 0.0),
    most: int,
    report: Report | None = None,
) -> Iterator[Route]:
    """Yield sequences of steps that end within `capture` of the goal, the cheapest first.

    Steps are checked against obstacles when they are expanded. `looked` is kept up to date. Ends if
    nothing is left, or at `most` poses.
    """
    steps = library.steps
    costs = np.array([cost_of(step, cost) for step in steps])
    moves = np.array([step.displacement for step in steps])
    bound = _bound(task, library, capture, costs, moves)
    unit = _APART * float(costs[costs > 0].min(initial=1.0))
    order = 0
    root = _Node(np.array(task.start), 0.0, -1, -1, 0)
    nodes: list[_Node] = []
    key = _keys(task, root.pose[None], cell, 0)[0]
    queue = [(float(bound(root.pose[None])[0]), 0, root, key)]
    seen: set[tuple[float, ...]] = set()
    while queue and looked.poses < most:
        _, _, node, key = heapq.heappop(queue)
        if key is not None and key in seen:
            looked.pruned += 1
            continue
        if node.step >= 0:
            before = nodes[node.before].pose
            if task.step_room(before, steps[node.step], library.radius) < 0:
                looked.blocked += 1
                continue
        if key is not None:
            seen.add(key)
        passed = _passed(task, node.passed, node.pose)
        node = _Node(node.pose, node.cost, node.before, node.step, passed)
        nodes.append(node)
        looked.poses += 1
        if report is not None and looked.poses % 1000 == 0:
            report(f"{looked.poses} poses, cost {node.cost:.4g}", None)
        off = task.off(node.pose)
        looked.nearest = min(looked.nearest, float(np.hypot(off[0], off[1])))
        if passed == len(task.via) and bool(capture.met(off)):
            yield Route(_steps_to(nodes, node), node.cost, node.pose)
        after = compose(node.pose, moves)
        least = np.round((node.cost + costs + bound(after)) / unit) * unit
        keys = _keys(task, after, cell, passed)
        for k in range(len(steps)):
            if np.isfinite(least[k]):
                order += 1
                child = _Node(after[k], node.cost + costs[k], len(nodes) - 1, k, passed)
                heapq.heappush(queue, (float(least[k]), order, child, keys[k]))
    looked.exhausted = not queue


def least_steps(task: PathTask, library: Library, capture: Tolerance) -> float:
    """Return a lower bound of the number of steps from the start to the goal."""
    moves = np.array([step.displacement for step in library.steps])
    bound = _bound(task, library, capture, np.ones(len(moves)), moves)
    return float(bound(np.array([task.start]))[0])


@dataclass(frozen=True, eq=False)
class _Node:
    pose: np.ndarray
    cost: float
    before: int
    step: int
    passed: int  # number of via points passed


def _passed(task: PathTask, k: int, pose: np.ndarray) -> int:
    """Return the number of via points passed at a pose, k of them before it."""
    while k < len(task.via) and np.hypot(*(pose[:2] - task.via[k])) <= task.via_radius:
        k += 1
    return k


def _steps_to(nodes: list[_Node], node: _Node) -> tuple[int, ...]:
    found = []
    while node.step >= 0:
        found.append(node.step)
        node = nodes[node.before]
    return tuple(reversed(found))


def _keys(
    task: PathTask, poses: np.ndarray, cell: tuple[float, float], passed: int
) -> list[tuple[float, ...] | None]:
    """Return the cells of poses (m, 3) after `passed` via points; None for each without cells."""
    if cell[0] <= 0 or cell[1] <= 0:
        return [None] * len(poses)
    # the start is in the middle of a cell, so rotations do not matter
    off = compose(inverse(task.start), poses) / _ODD
    off[:, 2] = wrapped(off[:, 2])
    return [(*place, passed) for place in np.rint(off / [cell[0], *cell]).tolist()]


def _bound(
    task: PathTask, library: Library, capture: Tolerance, costs: np.ndarray, moves: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Return lower bounds (m,) of the cost from poses (m, 3) to the goal.

    Every mass has a distance to go, and no step moves it farther per cost than the best one does.
    The same holds for the heading.
    """
    rest = np.vstack([[0.0, 0.0], library.rest])
    ends = np.array([compose(move, _lifted(rest))[:, :2] for move in moves])
    ways = np.linalg.norm(ends - rest, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        price = np.nanmin(np.where(ways > 0, costs[:, None] / ways, np.inf), axis=0)
        turns = np.abs(moves[:, 2])
        turn_price = np.nanmin(np.where(turns > 0, costs / turns, np.inf))
    aims = compose(task.goal, _lifted(rest))[:, :2]
    loose = capture.place + capture.angle * np.linalg.norm(rest, axis=-1)

    def bound(poses: np.ndarray) -> np.ndarray:
        now = compose(poses[:, None], _lifted(rest)[None])[..., :2]
        left = np.maximum(np.linalg.norm(now - aims, axis=-1) - loose, 0.0)
        turn = np.maximum(np.abs(wrapped(poses[:, 2] - task.goal[2])) - capture.angle, 0.0)
        with np.errstate(invalid="ignore"):  # nothing to gain, at no end of cost
            by_way = np.where(left > 0, left * price, 0.0).max(axis=1)
            return np.maximum(by_way, np.where(turn > 0, turn * turn_price, 0.0))

    return bound


def _lifted(points: np.ndarray) -> np.ndarray:
    """Points (m, 2) as poses (m, 3) that do not turn."""
    return np.column_stack([points, np.zeros(len(points))])


_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Fitted:
    """A family with displacement and cost as series in the amplitude."""

    family: Family
    cost: Cost

    @property
    def ends(self) -> tuple[float, float]:
        """Least and largest amplitude."""
        return self.family.amplitudes[0], self.family.amplitudes[-1]

    @cached_property
    def series(self) -> Series | None:
        """x, y, angle and cost; None where there is but one amplitude."""
        low, high = self.ends
        return None if high <= low else resolve(self._values, low, high, self.family.degree)

    @cached_property
    def slopes(self) -> Series | None:
        """Their derivatives."""
        return None if self.series is None else self.series.derivative()

    def _values(self, amplitudes: np.ndarray) -> np.ndarray:
        steps = [self.family.make(float(a)) for a in amplitudes]
        return np.array([[*step.displacement, cost_of(step, self.cost)] for step in steps]).T

    @cached_property
    def _only(self) -> np.ndarray:
        return self._values(np.array(self.family.amplitudes[:1]))[:, 0]

    def at(self, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
        """x, y, angle and cost, and their derivatives by the amplitude."""
        if self.series is None or self.slopes is None:
            return self._only, np.zeros(4)
        a = np.array([amplitude])
        return self.series(a)[:, 0], self.slopes(a)[:, 0]


def polished(
    task: PathTask,
    route: Sequence[Fitted],
    amplitudes: np.ndarray,
    *,
    by_cost: bool,
    accuracy: float,
) -> list[GaitStep] | None:
    """Return steps of a route that end in the goal to `accuracy`; None if no amplitudes do.

    `amplitudes` (m,) are the start. The result is a local minimum of the cost, or the nearest
    amplitudes if `by_cost` is False. Series approximate the steps; the last digits come from the
    steps themselves.
    """
    bounds = np.array([fit.ends for fit in route])
    free = np.sum(bounds[:, 1] > bounds[:, 0])
    begin = _reaching(task, route, amplitudes, bounds) if free else amplitudes
    if begin is None:
        return None
    if free < 3:  # too few to choose from: they meet all three conditions or do not
        return _exactly(task, route, begin, bounds, accuracy)
    width = np.maximum(bounds[:, 1] - bounds[:, 0], 1e-12)
    scale = max(float(sum(fit.at(a)[0][3] for fit, a in zip(route, amplitudes, strict=True))), 1e-9)

    def aim(a: np.ndarray) -> tuple[float, np.ndarray]:
        off = (a - amplitudes) / width
        if not by_cost:
            return float(off @ off), 2 * off / width
        found = [fit.at(x) for fit, x in zip(route, a, strict=True)]
        # a small penalty of the distance separates amplitudes of equal cost
        value = sum(f[3] for f, _ in found) / scale + 1e-6 * float(off @ off)
        return float(value), np.array([d[3] for _, d in found]) / scale + 2e-6 * off / width

    found = minimize(
        aim, begin, jac=True, method="SLSQP", bounds=bounds,
        constraints={
            "type": "eq",
            "fun": lambda a: task.off(_end(task, route, a)[0]),
            "jac": lambda a: _end(task, route, a)[1],
        },
        options={"maxiter": 40, "ftol": 1e-10},
    )  # fmt: skip
    if np.abs(task.off(_end(task, route, found.x)[0])).max() > 1e-5:
        return None
    return _exactly(task, route, np.clip(found.x, *bounds.T), bounds, accuracy)


def _reaching(
    task: PathTask, route: Sequence[Fitted], amplitudes: np.ndarray, bounds: np.ndarray
) -> np.ndarray | None:
    """Return amplitudes with which the series end in the goal; None if none are found."""
    free = bounds[:, 1] > bounds[:, 0]
    a = amplitudes.copy()

    def filled(x: np.ndarray) -> np.ndarray:
        a[free] = x
        return a

    low, high = bounds[free].T
    found = least_squares(
        lambda x: task.off(_end(task, route, filled(x))[0]),
        np.clip(amplitudes[free], low + 1e-3 * (high - low), high - 1e-3 * (high - low)),
        jac=lambda x: _end(task, route, filled(x))[1][:, free],  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        max_nfev=20,
        gtol=1e-6,
    )
    return None if np.abs(found.fun).max() > 1e-2 else filled(found.x).copy()


def _exactly(
    task: PathTask, route: Sequence[Fitted], a: np.ndarray, bounds: np.ndarray, accuracy: float
) -> list[GaitStep] | None:
    """Correct amplitudes by the least change, with the steps themselves."""
    for _ in range(_ROUNDS):
        steps = [fit.family.make(float(x)) for fit, x in zip(route, a, strict=True)]
        off = task.off(chained(task.start, steps)[-1])
        if np.abs(off).max() <= accuracy:
            return steps
        J = _end(task, route, a)[1]
        room = (a > bounds[:, 0]) & (a < bounds[:, 1])
        change = np.zeros_like(a)
        change[room] = -np.linalg.pinv(J[:, room]) @ off
        a = np.clip(a + change, *bounds.T)
    return None


def _end(task: PathTask, route: Sequence[Fitted], a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the end pose (3,) by the series, and its derivatives by the amplitudes (3, m)."""
    found = [fit.at(x) for fit, x in zip(route, a, strict=True)]
    poses = [np.array(task.start)]
    for value, _ in found:
        x, y, angle = poses[-1]
        poses.append(np.array([*(np.array([x, y]) + rotate(angle, value[:2])), angle + value[2]]))
    end = poses[-1]
    J = np.zeros((3, len(found)))
    for k, (_, slope) in enumerate(found):
        lever = end[:2] - poses[k + 1][:2]
        J[:2, k] = rotate(poses[k][2], slope[:2]) + slope[2] * np.array([-lever[1], lever[0]])
        J[2, k] = slope[2]
    return end, J


_ROUTES = 200  # routes whose amplitudes are optimised before the plan stops


@dataclass(frozen=True, eq=False)
class PlannedPath:
    """Result of `plan_path`: successive steps that lead to a goal without contact.

    Parameters
    ----------
    task : PathTask
        The task.
    library : Library
        Library of the steps.
    steps : tuple of GaitStep
        The steps, with their final amplitudes.
    poses : ndarray, shape (m + 1, 3)
        Poses before the first step and after each.
    route : Route
        Result of the search, before amplitudes change.
    looked : Looked
        Progress of the search.
    tried : int
        Number of routes whose amplitudes were optimised.
    room : float
        Least distance from anything, less radius and clearance, over all instants.
    """

    task: PathTask
    library: Library
    steps: tuple[GaitStep, ...]
    poses: np.ndarray
    route: Route
    looked: Looked
    tried: int
    room: float

    def cost(self, kind: Cost) -> float:
        """Return the total number of steps, work or time."""
        return float(sum(cost_of(step, kind) for step in self.steps))

    @property
    def off(self) -> np.ndarray:
        """End less the goal: x, y and angle, (3,)."""
        return self.task.off(self.poses[-1])


def plan_path(
    task: PathTask,
    library: Library,
    capture: Tolerance | tuple[float, float],
    *,
    cost: Cost = "steps",
    cell: tuple[float, float] = (0.0, 0.0),
    most: int = 200_000,
    accuracy: float = 1e-10,
    report: Report | None = None,
) -> PlannedPath:
    """Find steps of a library that lead from a pose to another without contact.

    Theory: docs/theory-planar.md, section 8.

    Parameters
    ----------
    task : PathTask
        Start, goal, obstacles, via points.
    library : Library
        Gaits, each with a few amplitudes.
    capture : Tolerance or (float, float)
        Distance and angle (rad) from the goal at which the search with the amplitudes of the
        library ends; from there amplitudes are optimised until the path meets the goal.
    cost : {"steps", "work", "time"}, optional
        Quantity to minimise.
    cell : (float, float), optional
        Length and angle (rad) of cells in which only the cheapest pose is kept. With (0, 0) the
        search is exact, but long searches do not end.
    most : int, optional
        Number of poses after which the search stops.
    accuracy : float, optional
        Accuracy of the final pose, in x, y and angle.
    report : callable, optional
        Called with the progress.

    Returns
    -------
    PlannedPath

    Raises
    ------
    SolveError
        If the body touches an obstacle at start or goal, the goal is too far, or no path is found.

    Notes
    -----
    The search is A* over exact poses. Its lower bound of the remaining cost: no mass moves farther
    per cost than in its best step. Without cells the route is the best of the library within
    `capture`; with cells it may be worse. The final amplitudes are a local optimum.

    Examples
    --------
    Either the tail or the head is pinned: links that stretch in between push the worm forward.

    >>> import wormopt as wo
    >>> P, worm = wo.planar, wo.planar.chain_shape(2)
    >>> push = P.Phase(0.5, P.Constraints(pins=(2,), skids=(0,)))
    >>> pull = P.Phase(1.0, P.Constraints(pins=(0,), skids=(2,)))
    >>> ahead = P.gait_family(
    ...     "ahead", worm, (0.6, 0.6, 0.0), [(0.4, 0.4, 0.0)], (0.5, 1.0), held=[push, pull]
    ... )
    >>> near = {"place": 1e-9, "angle": 1e-9}
    >>> task = P.PathTask((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), near)
    >>> path = P.plan_path(task, P.Library([ahead]), (0.3, 0.1), cost="time")
    >>> len(path.steps), path.poses[-1].round(9).tolist()
    (2, [1.5, 0.0, 0.0])
    """
    if fault := rest_fault(task, library):
        raise SolveError(fault, "move the pose or the obstacle", code="touching")
    looked, capture = Looked(), Tolerance.of(capture)
    if (least := least_steps(task, library, capture)) > most:
        raise SolveError(
            f"the goal is {least:.3g} or more steps away, but the search has {most} poses at most",
            "give a nearer goal, larger steps or more poses",
            code="too_far",
        )
    fits = [Fitted(family, cost) for family in library.families]
    tried, short = 0, set()
    found = routes(task, library, capture, looked, cost=cost, cell=cell, most=most, report=report)
    for route in found:
        if not route.steps and task.tolerance.met(task.off(task.start)):
            return _planned(task, library, [], np.inf, route, looked, tried)
        gaits = tuple(library.owners[k] for k in route.steps)
        if gaits in short:
            continue
        tried += 1
        if report is not None:
            report(f"{looked.poses} poses, route {tried} near the goal: amplitudes", None)
        fitting = _fitting(task, library, fits, route, accuracy)
        if fitting is None:
            short.add(gaits)  # no amplitudes of these gaits reach the goal, wherever they begin
        elif fitting:
            return _planned(task, library, *fitting[0], route, looked, tried)
        if tried >= _ROUTES:
            break
    raise _none(looked, tried, cell)


def _planned(
    task: PathTask, library: Library, steps: list[GaitStep], room: float, route: Route,
    looked: Looked, tried: int,
) -> PlannedPath:  # fmt: skip
    poses = chained(task.start, steps)
    return PlannedPath(task, library, tuple(steps), poses, route, looked, tried, room)


def _fitting(
    task: PathTask, library: Library, fits: list[Fitted], route: Route, accuracy: float
) -> list[tuple[list[GaitStep], float]] | None:
    """Return steps of a route that end in the goal without contact, and their room."""
    if not route.steps:
        return None
    own = [fits[library.owners[k]] for k in route.steps]
    first = np.array([library.steps[k].amplitude for k in route.steps])
    for by_cost in (True, False):
        steps = polished(task, own, first, by_cost=by_cost, accuracy=accuracy)
        if steps is None:
            return None
        poses = chained(task.start, steps)
        room = _room(task, library, steps, poses)
        if room >= 0 and reduce(partial(_passed, task), poses, 0) == len(task.via):
            return [(steps, room)]
    return []


def _room(task: PathTask, library: Library, steps: list[GaitStep], poses: np.ndarray) -> float:
    """Return the least room over all instants, bounded from below, including far obstacles."""
    rooms = [
        float((task.room(step.placed(pose), library.radius) - step.margins).min())
        for pose, step in zip(poses, steps, strict=False)
    ]
    return min(rooms, default=np.inf)


def _none(looked: Looked, tried: int, cell: tuple[float, float]) -> SolveError:
    if tried:
        why = f"{tried} routes end near the goal, but no amplitudes meet it without contact"
        mend = "give more amplitudes, smaller ones too, or a wider capture"
    elif looked.exhausted:
        why = f"no sequence of steps leads to the goal; all {looked.poses} poses were searched"
        mend = "add steps to the library, or more room"
    else:
        why = (
            f"{looked.poses} poses were searched, none near the goal; the nearest is "
            f"{looked.nearest:.3g} away"
        )
        mend = "give more poses, larger cells, a wider capture, or larger steps"
    if looked.exhausted and cell[0] > 0:
        mend += "; or smaller cells"
    return SolveError(why, mend, code="no_path")
