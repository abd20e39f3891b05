"""Paths through the plane: the cheapest steps of a library, with amplitudes that meet a goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.systems.planar.path.polish import Fitted, polished
from wormopt.systems.planar.path.search import Looked, Route, SearchOptions, least_steps, routes
from wormopt.systems.planar.path.steps import GaitStep, Library, chained
from wormopt.systems.planar.path.task import Cost, PathTask, Tolerance, cost_of, rest_fault

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
    >>> task = P.PathTask((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (1e-9, 1e-9))
    >>> path = P.plan_path(task, P.Library([ahead]), (0.3, 0.1), cost="time")
    >>> [round(step.amplitude, 6) for step in path.steps], path.poses[-1].round(9).tolist()
    ([0.625, 0.625, 0.625], [1.5, 0.0, 0.0])
    """
    if fault := rest_fault(task, library):
        raise SolveError(fault, "move the pose or the obstacle", code="touching")
    options, looked, capture = SearchOptions(cost, cell, most), Looked(), Tolerance.of(capture)
    if (least := least_steps(task, library, capture)) > most:
        raise SolveError(
            f"the goal is {least:.3g} or more steps away, but the search has {most} poses at most",
            "give a nearer goal, larger steps or more poses",
            code="too_far",
        )
    fits = [Fitted(family, options.cost) for family in library.families]
    tried, short = 0, set()
    for route in routes(task, library, capture, options, looked, report):
        if not route.steps and task.tolerance.met(task.off(task.start)):
            return _planned(task, library, [], np.inf, route, looked, tried)
        gaits = tuple(library.owners[k] for k in route.steps)
        if gaits in short:
            continue
        tried += 1
        if report is not None:
            report(f"{looked.poses} poses, route {tried} near the goal: amplitudes", None)
        found = _fitting(task, library, fits, route, accuracy)
        if found is None:
            short.add(gaits)  # no amplitudes of these gaits reach the goal, wherever they begin
        elif found:
            return _planned(task, library, *found[0], route, looked, tried)
        if tried >= _ROUTES:
            break
    raise _none(looked, tried, options)


def _planned(
    task: PathTask, library: Library, steps: list[GaitStep], room: float, route: Route,
    looked: Looked, tried: int,
) -> PlannedPath:  # fmt: skip
    poses = chained(task.start, steps)
    return PlannedPath(task, library, tuple(steps), poses, route, looked, tried, room)


def _fitting(
    task: PathTask, library: Library, fits: list[Fitted], route: Route, accuracy: float
) -> list[tuple[list[GaitStep], float]] | None:
    """Return steps of a route that end in the goal without contact, and their room.

    Amplitudes of least cost are tried first. Empty if all touch, None if no amplitudes reach it.
    """
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
        if room >= 0 and _comes_by(task, poses):
            return [(steps, room)]
    return []


def _room(task: PathTask, library: Library, steps: list[GaitStep], poses: np.ndarray) -> float:
    """Return the least room over all instants, bounded from below, including far obstacles."""
    rooms = [
        float((task.room(step.placed(pose), library.radius) - step.margins).min())
        for pose, step in zip(poses, steps, strict=False)
    ]
    return min(rooms, default=np.inf)


def _comes_by(task: PathTask, poses: np.ndarray) -> bool:
    """Return whether poses pass all via points in order."""
    k = 0
    for pose in poses:
        while k < len(task.via) and np.hypot(*(pose[:2] - task.via[k])) <= task.via_radius:
            k += 1
    return k == len(task.via)


def _none(looked: Looked, tried: int, options: SearchOptions) -> SolveError:
    if tried:
        why = f"{tried} routes end near the goal, but no amplitudes meet it without contact"
        mend = "give more amplitudes, or a wider capture"
    elif looked.exhausted:
        why = f"no sequence of steps leads to the goal; all {looked.poses} poses were searched"
        mend = "add steps to the library, or more room"
    else:
        why = (
            f"{looked.poses} poses were searched, none near the goal; the nearest is "
            f"{looked.nearest:.3g} away"
        )
        mend = "give more poses, larger cells, a wider capture, or larger steps"
    if looked.exhausted and options.cell[0] > 0:
        mend += "; or smaller cells"
    return SolveError(why, mend, code="no_path")
