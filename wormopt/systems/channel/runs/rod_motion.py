"""Scenes of kind ``rod-motion``: how a magnetisable rod crawls in a channel, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import Interrupted
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.channel.runs.rod_case import (
    ASSUMED,
    RodCase,
    assumed_scalars,
    blocks_of,
    warnings_of_case,
)
from wormopt.systems.channel.runs.rod_course import (
    RodCourse,
    RodPoint,
    change_of,
    faults_of_motion,
    faults_of_recheck,
    finer,
    follow,
)
from wormopt.systems.channel.scenes.rod_motion import ConvergenceTable, RodMotionScene

_FRAMES, _SAMPLES = 144, 1200
_Again = tuple[str, float, RodPoint]


def run(scene: Scene[RodMotionScene], report: Report) -> Result:
    """Follow the rod, and again with other steps and meshes.

    Status "failed": energy not balanced, walls entered too far, or velocity depends on steps
    or mesh. Raises SolveError if states are no longer numbers, or Interrupted.
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
        reason = "interrupted before the motion was computed again with other steps and meshes"
        partial = _result(scene, case, course, again, perf_counter() - begin)
        raise Interrupted(replace(partial, status="failed", reason=reason)) from None
    return _result(scene, case, course, again, perf_counter() - begin)


def _others(case: RodCase, table: ConvergenceTable) -> Iterator[tuple[str, float, RodCase]]:
    """Motions to compare with: the same but for the step, or the mesh."""
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
    faults = list(_faults(case, course.point, again, scene.table.convergence.accepted))
    point = course.point
    return Result(
        scene.name,
        scene.table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(case, course, again),
        variables=(*_histories(course), *_frames(case, course), *_convergence(again)),
        trust={
            "energy_error": point.energy_error,
            "penetration_share": point.penetration,
            "field_error": point.field_error,
            "velocity_error": point.error,
            "recheck_velocity_change": change_of(case, point, (one for _, _, one in again)),
            "accepted": scene.table.convergence.accepted,
            "assumptions": dict(ASSUMED),
            "warnings": list(_warnings(case, point)),
        },
        timings_s={"motion": point.seconds, "all": seconds},
        scene_text=scene.text,
        attributes={
            "channel": case.channel.diameter,
            "body": case.worm.diameter,
            "pitch": case.coils.pitch,
            "every": case.pattern.every,
            "coil": [
                case.coils.inner, case.coils.outer, case.coils.length, case.coils.clearance
            ],
        },
    )  # fmt: skip


def _faults(case: RodCase, point: RodPoint, again: list[_Again], accepted: float) -> Iterator[str]:
    yield from faults_of_motion(point)
    for kind, value, other in again:
        what = f"with {kind} {value:g}"
        yield from (f"{what}: {fault}" for fault in faults_of_motion(other))
        yield from faults_of_recheck(case, point, other, accepted, what)


def _scalars(case: RodCase, course: RodCourse, again: list[_Again]) -> dict[str, Scalar]:
    pressed = course.steps.pressed
    point = course.point
    found: dict[str, tuple[Any, str]] = {
        "velocity_mean": (point.velocity, "speed"),
        "velocity_error": (point.error, "speed"),
        "direction": (point.direction, "count"),
        "velocity_per_frequency": (point.velocity / case.rate, "length"),
        "field_speed": (case.field_speed, "speed"),
        "rate": (case.rate, "rate"),
        "arc_length": (point.arc_length, "length"),
        "pressed_max": (float(pressed.max(initial=0.0)), "force"),
        "pressed_mean": (float(np.mean(pressed.sum(axis=0))), "force"),
        "penetration_max": (point.penetration * case.room, "length"),
        "energy_error": (point.energy_error, "share"),
        "field_error": (point.field_error, "share"),
        "field_work": (float(course.steps.work["load_power"][-1]), "energy"),
        "friction_work": (float(course.steps.work["friction"][-1]), "energy"),
        "damping_work": (float(course.steps.work["damping_power"][-1]), "energy"),
        "wall_work": (float(course.steps.work["walls"][-1]), "energy"),
        "step_count": (course.steps.n_steps, "count"),
        "velocity_again": ([other.velocity for _, _, other in again], "speed"),
    }
    scalars = {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}
    return scalars | assumed_scalars(case)


def _histories(course: RodCourse) -> Iterator[Variable]:
    """The way of the rod, and what has been done on it, at not too many times."""
    steps = course.steps
    kept = np.unique(np.linspace(0, len(steps.time) - 1, _SAMPLES).astype(int))
    yield Variable("time", "s", ("time",), steps.time[kept], "time")
    yield Variable("centre", "m", ("time",), course.centre[kept], "mean place of the rod")
    for name, what in (
        ("load_power", "done by the field"),
        ("damping_power", "done by the material's damping"),
        ("friction", "done by friction"),
        ("walls", "done by impacts"),
    ):
        short = name.removesuffix("_power")
        yield Variable(f"work_{short}", "J", ("time",), steps.work[name][kept], what)


def _frames(case: RodCase, course: RodCourse) -> Iterator[Variable]:
    """Shapes over the last two repeats of the pattern, forces on the walls, coils that are on."""
    blocks, steps, n = blocks_of(case), course.steps, course.count
    since = max(steps.time[-1] - 2 * case.cycle, 0.0)
    kept = np.searchsorted(steps.time, np.linspace(since, steps.time[-1], _FRAMES))
    kept = np.clip(kept, 1, len(steps.time) - 1)
    time = steps.time[kept]
    yield Variable("frame", "s", ("frame",), time, "time of a shape")
    for k, (name, unit) in enumerate((("x", "m"), ("y", "m"), ("angle", "rad"))):
        part = steps.states[k * n : (k + 1) * n, kept].T
        yield Variable(f"rod_{name}", unit, ("frame", "node"), part, f"{name} of the nodes")
    for k, wall in enumerate(("upper", "lower")):
        part = steps.pressed[k::2, kept - 1].T
        yield Variable(f"pressed_{wall}", "N", ("frame", "node"), part, f"force on the {wall} wall")
    inside = np.mod(time - 1e-9 * case.cycle, blocks.breaks[-1])
    piece = np.searchsorted(blocks.breaks, inside, side="right") - 1
    turn = np.round((time - inside) / blocks.breaks[-1]) * 2 * case.pattern.every
    first = blocks.first[piece] + turn
    yield Variable("first_coil", "1", ("frame",), first, "first coil of a block that is on")
    yield Variable("coils_on", "1", ("frame",), blocks.count[piece], "coils of a block")


def _convergence(again: list[_Again]) -> Iterator[Variable]:
    for kind in ("step", "elements"):
        rows = [(value, other) for name, value, other in again if name == kind]
        if rows:
            dim = (f"{kind}_again",)
            speeds = [other.velocity for _, other in rows]
            errors = [other.error for _, other in rows]
            yield Variable(dim[0], "1", dim, np.array([value for value, _ in rows]), kind)
            yield Variable(f"velocity_by_{kind}", "m s-1", dim, np.array(speeds), "mean velocity")
            yield Variable(f"error_by_{kind}", "m s-1", dim, np.array(errors), "its error")


def _warnings(case: RodCase, point: RodPoint) -> Iterator[str]:
    if point.error > 0.1 * abs(point.velocity):
        yield (
            f"the mean velocity is known to {point.error:.2g} m/s only; write a longer "
            "course.duration"
        )
    if not point.settled:
        yield (
            "the mean velocity of the first half differs from that of the second: the motion has "
            "not settled; write a larger course.settle or a longer course.duration"
        )
    yield from warnings_of_case(case)
