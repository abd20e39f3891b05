"""Search for the cheapest sequence of steps to a pose: A* over exact poses."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.progress import Report
from wormopt.systems.planar.body.se2 import compose, inverse
from wormopt.systems.planar.path.steps import Library
from wormopt.systems.planar.path.task import Cost, PathTask, Tolerance, cost_of, wrapped

# Cells are larger by this share, so that steps of round lengths do not end on sides of cells, and
# costs closer than this share count as equal: neither then depends on round-off.
_ODD, _APART = 1.00371, 1e-9


@dataclass(frozen=True)
class SearchOptions:
    """Options of a search.

    Parameters
    ----------
    cost : {"steps", "work", "time"}, optional
        Quantity to minimise.
    cell : (float, float), optional
        Length and angle of cells in which only the cheapest pose is kept. The result is then the
        best of the library, except paths through poses beside a cheaper one in their cell. With
        (0, 0) the search is exact, but long searches do not end.
    most : int, optional
        Number of poses after which the search stops.
    """

    cost: Cost = "steps"
    cell: tuple[float, float] = (0.0, 0.0)
    most: int = 200_000


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
    options: SearchOptions,
    looked: Looked,
    report: Report | None = None,
) -> Iterator[Route]:
    """Yield sequences of steps that end within `capture` of the goal, the cheapest first.

    Steps are checked against obstacles when they are expanded. `looked` is kept up to date. Ends if
    nothing is left, or at `options.most`.
    """
    steps = library.steps
    costs = np.array([cost_of(step, options.cost) for step in steps])
    moves = np.array([step.displacement for step in steps])
    bound = _bound(task, library, capture, costs, moves)
    unit = _APART * float(costs[costs > 0].min(initial=1.0))
    order = 0
    root = _Node(task.start, 0.0, -1, -1, 0)
    nodes: list[_Node] = []
    queue: list[tuple[float, int, _Node]] = [(float(bound(task.start[None])[0]), 0, root)]
    seen: set[tuple[int, ...]] = set()
    while queue and looked.poses < options.most:
        _, _, node = heapq.heappop(queue)
        key = _key(task, node, options.cell)
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
        passed = _passed(task, node)
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
        for k in range(len(steps)):
            if np.isfinite(least[k]):
                order += 1
                child = _Node(after[k], node.cost + costs[k], len(nodes) - 1, k, passed)
                heapq.heappush(queue, (float(least[k]), order, child))
    looked.exhausted = not queue


def least_steps(task: PathTask, library: Library, capture: Tolerance) -> float:
    """Return a lower bound of the number of steps from the start to the goal."""
    moves = np.array([step.displacement for step in library.steps])
    bound = _bound(task, library, capture, np.ones(len(moves)), moves)
    return float(bound(task.start[None])[0])


@dataclass(frozen=True, eq=False)
class _Node:
    pose: np.ndarray
    cost: float
    before: int
    step: int
    passed: int  # number of via points passed


def _passed(task: PathTask, node: _Node) -> int:
    """Return the number of via points that a pose has passed."""
    k = node.passed
    while k < len(task.via) and np.hypot(*(node.pose[:2] - task.via[k])) <= task.via_radius:
        k += 1
    return k


def _steps_to(nodes: list[_Node], node: _Node) -> tuple[int, ...]:
    found = []
    while node.step >= 0:
        found.append(node.step)
        node = nodes[node.before]
    return tuple(reversed(found))


def _key(task: PathTask, node: _Node, cell: tuple[float, float]) -> tuple[int, ...] | None:
    """Return the cell of a pose; the start is in the middle of one, so rotations do not matter."""
    if cell[0] <= 0 or cell[1] <= 0:
        return None
    off = compose(inverse(task.start), node.pose) / _ODD
    x, y = np.rint(off[:2] / cell[0])
    return (int(x), int(y), round(float(wrapped(off[2])) / cell[1]), node.passed)


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
