"""Runs of kind ``rod-motion``: simulation of a magnetisable rod that crawls in a channel."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import Interrupted
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.channel.runs.rod_case import ASSUMED, RodCase
from wormopt.systems.channel.runs.rod_course import (
    RodCourse,
    RodPoint,
    change_of,
    checks_of_change,
    checks_of_motion,
    finer,
    follow,
)
from wormopt.systems.channel.scenes.rod import ConvergenceTable, RodMotionScene

_FRAMES, _SAMPLES = 144, 1200
_Again = tuple[str, float, RodPoint]


def run(scene: Scene[RodMotionScene], report: Report) -> Result:
    """Simulate the rod, and again with other steps and meshes.

    Status "failed" if energy is not balanced, walls are penetrated too far, or the velocity depends
    on steps or mesh. Raises SolveError if states are not finite, or Interrupted.
    """
    table, begin = scene.table, perf_counter()
    case = RodCase(
        table.worm, table.channel, table.coils, table.switching.pattern, table.mesh, table.course,
        table.switching.rate,
    )  # fmt: skip
    course, again = follow(case, report), []
    try:
        for kind, value, other in _others(case, table.convergence):
            report(f"again with {kind} {value:g}", None)
            again.append((kind, value, follow(other).point))
    except KeyboardInterrupt:
        reason = "interrupted before the motion was repeated with other steps and meshes"
        partial = _result(scene, case, course, again, perf_counter() - begin)
        raise Interrupted(partial.failed(reason)) from None
    return _result(scene, case, course, again, perf_counter() - begin)


def _others(case: RodCase, table: ConvergenceTable) -> Iterator[tuple[str, float, RodCase]]:
    """Yield motions for comparison, with another step or mesh."""
    for share in table.steps:
        yield "step", share, finer(case, share=share)
    for elements in table.elements:
        yield "elements", elements, finer(case, elements)


def _result(
    scene: Scene[RodMotionScene],
    case: RodCase,
    course: RodCourse,
    again: list[_Again],
    seconds: float,
) -> Result:
    point, coils = course.point, case.coils
    return conclude(
        scene,
        _scalars(case, course, again),
        _histories(course) | _frames(case, course) | _convergence(again),
        checks=_checks(case, point, again, scene.table.convergence.accepted),
        facts={
            "energy_error": point.energy_error,
            "penetration_share": point.penetration,
            "field_error": point.field_error,
            "velocity_error": point.error,
            "recheck_velocity_change": change_of(case, point, (one for _, _, one in again)),
            "accepted": scene.table.convergence.accepted,
            "assumptions": ASSUMED,
        },
        warnings=_warnings(case, point),
        timings={"motion": point.seconds, "all": seconds},
        attributes={
            "channel": case.channel.diameter,
            "body": case.worm.diameter,
            "pitch": coils.pitch,
            "every": case.pattern.every,
            "coil": [coils.inner, coils.outer, coils.length, coils.clearance],
        },
    )


def _checks(
    case: RodCase, point: RodPoint, again: list[_Again], accepted: float
) -> Iterator[Check]:
    yield from checks_of_motion(point)
    for kind, value, other in again:
        what = f"with {kind} {value:g}"
        yield from checks_of_motion(other, what)
        yield from checks_of_change(case, point, other, accepted, what)


def _scalars(case: RodCase, course: RodCourse, again: list[_Again]) -> dict[str, Any]:
    steps, point = course.steps, course.point
    return {
        "velocity_mean": point.velocity,
        "velocity_error": point.error,
        "direction": point.direction,
        "velocity_per_frequency": point.velocity / case.rate,
        "field_speed": case.field_speed,
        "rate": case.rate,
        "arc_length": point.arc_length,
        "pressed_max": float(steps.pressed.max(initial=0.0)),
        "pressed_mean": float(np.mean(steps.pressed.sum(axis=0))),
        "penetration_max": point.penetration * case.room,
        "energy_error": point.energy_error,
        "field_error": point.field_error,
        "field_work": float(steps.work["load_power"][-1]),
        "friction_work": float(steps.work["friction"][-1]),
        "damping_work": float(steps.work["damping_power"][-1]),
        "wall_work": float(steps.work["walls"][-1]),
        "step_count": steps.n_steps,
        "velocity_again": [other.velocity for _, _, other in again],
    } | case.assumed


def _histories(course: RodCourse) -> dict[str, np.ndarray]:
    """Return the displacement of the rod, and the works on it, at a limited number of times."""
    steps = course.steps
    kept = np.unique(np.linspace(0, len(steps.time) - 1, _SAMPLES).astype(int))
    works = {f"work_{name.removesuffix('_power')}": done[kept] for name, done in steps.work.items()}
    return {"time": steps.time[kept], "centre": course.centre[kept]} | works


def _frames(case: RodCase, course: RodCourse) -> dict[str, np.ndarray]:
    """Return shapes over the last two repeats of the pattern, wall forces, and active coils."""
    blocks, steps = case.blocks, course.steps
    since = max(steps.time[-1] - 2 * case.cycle, 0.0)
    kept = np.searchsorted(steps.time, np.linspace(since, steps.time[-1], _FRAMES))
    kept = np.clip(kept, 1, len(steps.time) - 1)
    time = steps.time[kept]
    x, y, angle = np.split(steps.states[: 3 * course.count, kept].T, 3, axis=1)
    inside = np.mod(time - 1e-9 * case.cycle, blocks.breaks[-1])
    piece = np.searchsorted(blocks.breaks, inside, side="right") - 1
    turn = np.round((time - inside) / blocks.breaks[-1]) * 2 * case.pattern.every
    return {
        "frame": time,
        "rod_x": x,
        "rod_y": y,
        "rod_angle": angle,
        "pressed_upper": steps.pressed[::2, kept - 1].T,
        "pressed_lower": steps.pressed[1::2, kept - 1].T,
        "first_coil": blocks.first[piece] + turn,
        "coils_on": blocks.count[piece],
    }


def _convergence(again: list[_Again]) -> dict[str, np.ndarray]:
    found = {}
    for kind in ("step", "elements"):
        rows = [(value, other) for name, value, other in again if name == kind]
        if rows:
            found[f"{kind}_again"] = np.array([value for value, _ in rows])
            found[f"velocity_by_{kind}"] = np.array([other.velocity for _, other in rows])
            found[f"error_by_{kind}"] = np.array([other.error for _, other in rows])
    return found


def _warnings(case: RodCase, point: RodPoint) -> Iterator[str]:
    if point.error > 0.1 * abs(point.velocity):
        yield (
            f"the error of the mean velocity is {point.error:.2g} m/s; write a longer "
            "course.duration"
        )
    if not point.settled:
        yield (
            "the mean velocity of the first half differs from that of the second, so it has not "
            "converged; write a larger course.settle or a longer course.duration"
        )
    yield from case.warnings()
