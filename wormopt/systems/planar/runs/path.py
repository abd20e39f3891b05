"""Runs of kind ``planar-path``: build the library, plan, simulate the plan, report."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.body.obstacles import Block, Capsule, Disc, Obstacle, Wall
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.kinematic.constraints import Constraints
from wormopt.systems.planar.kinematic.loads import loads
from wormopt.systems.planar.kinematic.motion import KinematicMotion, Phase
from wormopt.systems.planar.path.gaits import gait_family
from wormopt.systems.planar.path.plan import PlannedPath, plan_path
from wormopt.systems.planar.path.simulate import Course, least_distance, simulate_path
from wormopt.systems.planar.path.steps import Family, GaitStep, Library
from wormopt.systems.planar.path.task import Corridor, PathTask, Tolerance, wrapped
from wormopt.systems.planar.scenes.path import (
    BlockTable,
    CapsuleTable,
    DiscTable,
    GaitTable,
    PlanarPathScene,
    WallTable,
    rates_of,
)

# Accepted difference of plan and simulation, over the size of the path; the simulation of crawls
# is of order 2 where masses stop.
_AGREED, _CRAWLS_AGREED = 1e-7, 2e-5
_LOOKS = 25  # instants of a step that the result keeps
_WELL = 1e5  # accepted condition number of the constraints


def run(scene: Scene[PlanarPathScene], report: Report) -> Result:
    """Plan the path; status "failed" if its simulation misses the goal or touches an obstacle.

    Raises SolveError if there is no path, or if a gait of the library meets a singular shape.
    """
    table, begin = scene.table, time.perf_counter()
    library = Library(tuple(_families(table)), table.radius)
    assert library.steps
    made, search = time.perf_counter(), table.search
    capture = Tolerance(search.capture.place, search.capture.angle)
    last = ["before the search began"]

    def told(text: str, fraction: float | None = None) -> None:
        last[0] = text
        report(text, fraction)

    try:
        path = plan_path(
            _task(table), library, capture, cost=search.cost,
            cell=(search.cell.place, search.cell.angle), most=search.poses, report=told,
        )  # fmt: skip
    except SolveError as error:
        if error.code == "too_far":
            message = f"{error.reason}; {error.suggestion} (search.poses)"
            raise SceneError(scene.name, [("course.goal", message)]) from None
        partial = _unplanned(scene, error.reason)
        raise SolveError(error.reason, error.suggestion, partial, error.code) from None
    except KeyboardInterrupt:
        raise Interrupted(_unplanned(scene, f"interrupted; {last[0]}")) from None
    planned = time.perf_counter()
    report("simulating", None)
    again = simulate_path(path, lengths=table.body.sizes, heading=table.body.heading)
    found = _Recheck(path, again)
    return conclude(
        scene,
        _scalars(path, found, table),
        _variables(path),
        checks=_checks(path, found, table),
        facts={"search": _told(path, table)},
        timings={
            "library": made - begin,
            "plan": planned - made,
            "recheck": time.perf_counter() - planned,
        },
        attributes={"step_names": [step.name for step in path.steps], **_drawn(table)},
    )


def _unplanned(scene: Scene[PlanarPathScene], reason: str) -> Result:
    checks = [Check("path", None, 0.0, reason)]
    return conclude(scene, {}, checks=checks, attributes=_drawn(scene.table)).failed(reason)


def _families(table: PlanarPathScene) -> Iterator[Family]:
    for gait in table.gaits:
        yield _family(table, gait, gait.name, 1.0)
        if gait.mirrored:
            yield _family(table, gait, gait.mirrored, -1.0)


def _family(table: PlanarPathScene, gait: GaitTable, name: str, side: float) -> Family:
    shape, rest, rates = table.body.shape(), np.array(table.rest), rates_of(table)
    sides = np.ones(len(rest))
    sides[len(rest) - (table.body.links - 1) :] = side
    changes, ground = sides * np.array(gait.changes), table.ground.friction()
    phases = [Phase(held.until, Constraints(held.pins, held.skids)) for held in gait.held]
    return gait_family(
        name, shape, sides * rest, changes, gait.amplitudes,
        ground=ground, held=phases or None, rates=rates,
    )  # fmt: skip


def _task(table: PlanarPathScene) -> PathTask:
    course = table.course
    corridor = course.corridor and Corridor(np.array(course.corridor.line), course.corridor.width)
    return PathTask(
        np.array(course.start),
        np.array(course.goal),
        Tolerance(course.tolerance.place, course.tolerance.angle),
        [_obstacle(each) for each in table.obstacles],
        course.clearance,
        [(x, y) for x, y in course.via],
        course.via_radius,
        corridor,
    )


def _obstacle(table: DiscTable | BlockTable | CapsuleTable | WallTable) -> Obstacle:
    if isinstance(table, DiscTable):
        x, y = table.centre
        return Disc((x, y), table.radius)
    if isinstance(table, BlockTable):
        return Block(tuple((x, y) for x, y in table.corners))
    if isinstance(table, WallTable):
        x, y = table.point
        return Wall((x, y), table.angle)
    (x0, y0), (x1, y1) = table.start, table.end
    return Capsule((x0, y0), (x1, y1), table.radius)


class _Recheck:
    """Results of the simulation."""

    def __init__(self, path: PlannedPath, course: Course) -> None:
        task = path.task
        off = task.off(course.pose)
        self.place, self.angle = float(np.hypot(off[0], off[1])), float(off[2])
        gap = course.pose - path.poses[-1]
        self.apart = float(max(np.hypot(gap[0], gap[1]), abs(wrapped(gap[2]))))
        room = least_distance(course.places, task.obstacles) - path.library.radius - task.clearance
        if task.corridor is not None:
            room = min(room, float(task.corridor.room(course.places).min()))
        self.room = room


def _held(path: PlannedPath) -> list[KinematicMotion]:
    """Return the motions of the steps that pins and skids determine."""
    return [step.motion for step in path.steps if isinstance(step.motion, KinematicMotion)]


def _scalars(path: PlannedPath, found: _Recheck, table: PlanarPathScene) -> dict[str, Any]:
    motions = _held(path)
    return {
        "steps": len(path.steps),
        "work": path.cost("work"),
        "time": path.cost("time"),
        "cost_searched": path.route.cost,
        "room": path.room,
        "room_simulated": found.room,
        "off_place": found.place,
        "off_angle": found.angle,
        "pin_load": max((_pin_load(m, table) for m in motions), default=0.0),
        "condition": max((m.condition for m in motions), default=1.0),
        "poses_looked": path.looked.poses,
        "routes_polished": path.tried,
    }


def _pin_load(motion: KinematicMotion, table: PlanarPathScene) -> float:
    return loads(motion, table.ground.friction()).pin_load


def _checks(path: PlannedPath, found: _Recheck, table: PlanarPathScene) -> Iterator[Check]:
    near = table.course.tolerance
    missed = "simulated in Cartesian coordinates, the path ends {:.3g} away from the goal"
    yield Check("place by simulation", found.place, near.place, missed.format(found.place))
    turned = f"simulated in Cartesian coordinates, the path ends {found.angle:.3g} off in angle"
    yield Check("angle by simulation", found.angle, near.angle, turned)
    size = max(1.0, float(np.abs(path.poses[:, :2]).max()))
    agreed = _AGREED if len(_held(path)) == len(path.steps) else _CRAWLS_AGREED
    yield Check("plan and simulation", found.apart / size, agreed, "plan and simulation differ")
    touch = "in the simulation the body touches an obstacle; write more course.clearance"
    yield Check("room by simulation", found.room, 0.0, touch, found.room >= 0)
    condition = max((motion.condition for motion in _held(path)), default=1.0)
    ill = f"the constraints are nearly singular: condition number {condition:.3g}"
    yield Check("condition of what holds", condition, _WELL, ill)
    if table.pin_load is not None:
        load = max((_pin_load(motion, table) for motion in _held(path)), default=0.0)
        over = f"a pin carries {load:.4g}; write pin_load = {load:.4g}, or weaker friction"
        yield Check("load of a pin", load, table.pin_load, over)


def _told(path: PlannedPath, table: PlanarPathScene) -> str:
    cell = table.search.cell
    return (
        f"best route of the library by {table.search.cost}, except routes through poses within "
        f"{cell.place:g} and {cell.angle:g} rad of a cheaper one ({path.looked.pruned} left "
        "out); its amplitudes are a local optimum that meets the goal"
    )


def _variables(path: PlannedPath) -> dict[str, Any]:
    places, pinned, instants = _course(path)
    return {
        "instant": instants,
        "x": places[..., 0].T,
        "y": places[..., 1].T,
        "pinned": pinned.T.astype(float),
        "amplitude": np.array([step.amplitude for step in path.steps]),
        "step_work": np.array([step.work for step in path.steps]),
        "step_time": np.array([step.time for step in path.steps]),
        "pose_x": path.poses[:, 0],
        "pose_y": path.poses[:, 1],
        "pose_angle": path.poses[:, 2],
    }


def _course(path: PlannedPath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (m, n, 2), pins (m, n) and instants (m,) of the whole path."""
    n, start = len(path.library.rest), path.task.start
    if not path.steps:
        places = start[:2] + rotate(start[2], path.library.rest)
        return places[None], np.zeros((1, n)), np.zeros(1)
    places, pinned, instants, begun = [], [], [], 0.0
    for pose, step in zip(path.poses, path.steps, strict=False):
        pick = np.unique(np.linspace(0, len(step.tau) - 1, _LOOKS).round().astype(int))
        places.append(step.placed(pose)[pick])
        pinned.append([_at_rest(step, tau, n) for tau in step.tau[pick]])
        instants.append(begun + step.clock[pick])
        begun += step.time
    return np.concatenate(places), np.concatenate(pinned), np.concatenate(instants)


def _at_rest(step: GaitStep, tau: float, n: int) -> np.ndarray:
    """Return which masses do not move just after a phase."""
    if isinstance(step.motion, KinematicMotion):
        return np.isin(np.arange(n), step.motion.held_at(tau).pins)
    phases = step.motion.phases
    return next(phase.rest for phase in phases if tau < phase.end or phase is phases[-1])


def _drawn(table: PlanarPathScene) -> dict[str, Any]:
    """Return the parts of the scene that plots need."""
    course = table.course
    return {
        "radius": table.radius,
        "start": course.start,
        "goal": course.goal,
        "tolerance": course.tolerance.place,
        "via": course.via,
        "corridor": course.corridor and [course.corridor.line, course.corridor.width],
        "obstacles": [msgspec.to_builtins(each) for each in table.obstacles],
    }
