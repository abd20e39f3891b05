"""Scenes of kind ``rod-motion``: how a magnetisable rod crawls in a channel, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import Interrupted
from wormopt.progress import Report
from wormopt.result import Result, Scalar, Variable, unit_of
from wormopt.scenes.rod_motion import ConvergenceTable, RodMotionScene
from wormopt.scenes.scene import Scene
from wormopt.studies.rod_parts import (
    ASSUMED,
    RodCase,
    RodCourse,
    assumed_scalars,
    blocks_of,
    direction,
    follow,
    segment_length,
)

__all__ = ["run"]

_FRAMES, _SAMPLES = 144, 1200
# What of the field's work may be lost to rounding and steps, and how deep walls may be entered.
_ENERGY, _DEPTH = 0.01, 0.05


def run(scene: Scene[RodMotionScene], report: Report) -> Result:
    """Follow the rod, and again with other steps and meshes.

    Parameters
    ----------
    scene : Scene
        Of kind ``rod-motion``.
    report : callable
        Told what goes on.

    Returns
    -------
    Result
        Status "failed" where energy is not balanced, walls are entered too far, or the mean
        velocity depends on steps or mesh.

    Raises
    ------
    SolveError
        If the motion is no longer a number.
    Interrupted
        If the user stops it after the motion has been found; it is the partial result.
    """
    table, begin = scene.table, perf_counter()
    case = RodCase(
        table.worm, table.channel, table.coils, table.switching.pattern, table.mesh, table.course,
        table.switching.rate,
    )  # fmt: skip
    course = follow(case, report)
    again: list[tuple[str, float, RodCourse]] = []
    try:
        for kind, value, other in _others(case, course, table.convergence):
            report(f"again with {kind} {value:g}", None)
            again.append((kind, value, follow(other)))
    except KeyboardInterrupt:
        reason = "interrupted before the motion was computed again with other steps and meshes"
        partial = _result(scene, case, course, again, perf_counter() - begin)
        raise Interrupted(replace(partial, status="failed", reason=reason)) from None
    return _result(scene, case, course, again, perf_counter() - begin)


def _others(
    case: RodCase, course: RodCourse, table: ConvergenceTable
) -> Iterator[tuple[str, float, RodCase]]:
    """Motions to compare with: the same but for the step, or the mesh."""
    step = float(np.diff(course.steps.time).max()) * (len(course.steps.time) - 1)
    step /= course.steps.n_steps
    for share in table.steps:
        yield "step", share, case.varied(mesh={"step": share * step})
    for elements in table.elements:
        yield "elements", elements, case.varied(mesh={"elements": elements, "step": None})


def _result(
    scene: Scene[RodMotionScene],
    case: RodCase,
    course: RodCourse,
    again: list[tuple[str, float, RodCourse]],
    seconds: float,
) -> Result:
    faults = list(_faults(case, course, again, scene.table.convergence.accepted))
    return Result(
        scene.name,
        scene.table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(case, course, again),
        variables=(*_histories(course), *_frames(case, course), *_convergence(again)),
        trust={
            "energy_error": course.energy_error,
            "penetration_share": course.penetration / _room(case),
            "field_error": course.field_error,
            "velocity_error": course.velocity_error,
            "recheck_velocity_error": max(_changes(course, again), default=None),
            "accepted": scene.table.convergence.accepted * case.field_speed,
            "assumptions": dict(ASSUMED),
            "warnings": list(_warnings(case, course)),
        },
        timings_s={"motion": course.seconds, "all": seconds},
        scene_text=scene.text,
        attributes={"channel": case.channel.diameter, "body": case.worm.diameter,
                    "pitch": case.coils.pitch, "every": case.pattern.every,
                    "coil": [case.coils.inner, case.coils.outer, case.coils.length,
                             case.coils.clearance]},
    )  # fmt: skip


def _room(case: RodCase) -> float:
    return (case.channel.diameter - case.worm.diameter) / 2


def _changes(course: RodCourse, again: list[tuple[str, float, RodCourse]]) -> list[float]:
    """Changes of the mean velocity beyond what its own uncertainty explains."""
    return [
        max(
            abs(other.velocity - course.velocity)
            - 2 * float(np.hypot(other.velocity_error, course.velocity_error)),
            0.0,
        )
        for _, _, other in again
    ]


def _faults(
    case: RodCase,
    course: RodCourse,
    again: list[tuple[str, float, RodCourse]],
    accepted: float,
) -> Iterator[str]:
    if not course.energy_error <= _ENERGY:
        yield (
            f"the balance of energy is off by {course.energy_error:.2g} of the field's work; "
            "write a shorter mesh.step"
        )
    depth = course.penetration / _room(case)
    if not depth <= _DEPTH:
        yield f"walls are entered by {depth:.2g} of the room; write a shorter mesh.step"
    for (kind, value, _), change in zip(again, _changes(course, again), strict=True):
        if not change <= accepted * case.field_speed:
            yield (
                f"the mean velocity changes by {change:.2g} m/s with {kind} {value:g}; write more "
                "mesh.elements, a shorter mesh.step or a longer course.duration"
            )


def _scalars(
    case: RodCase, course: RodCourse, again: list[tuple[str, float, RodCourse]]
) -> dict[str, Scalar]:
    pressed = course.steps.pressed
    segment = segment_length(case, course)
    found: dict[str, tuple[Any, str]] = {
        "velocity_mean": (course.velocity, "speed"),
        "velocity_error": (course.velocity_error, "speed"),
        "direction": (direction(course), "count"),
        "velocity_per_frequency": (course.velocity / case.rate, "length"),
        "field_speed": (case.field_speed, "speed"),
        "rate": (case.rate, "rate"),
        "arc_length": (segment, "length"),
        "pressed_max": (float(pressed.max(initial=0.0)), "force"),
        "pressed_mean": (float(np.mean(pressed.sum(axis=0))), "force"),
        "penetration_max": (course.penetration, "length"),
        "energy_error": (course.energy_error, "share"),
        "field_error": (course.field_error, "share"),
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
    blocks, steps, n = blocks_of(case), course.steps, course.rod.count
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


def _convergence(again: list[tuple[str, float, RodCourse]]) -> Iterator[Variable]:
    for kind in ("step", "elements"):
        rows = [(value, other) for name, value, other in again if name == kind]
        if rows:
            dim = (f"{kind}_again",)
            speeds = [other.velocity for _, other in rows]
            errors = [other.velocity_error for _, other in rows]
            yield Variable(dim[0], "1", dim, np.array([value for value, _ in rows]), kind)
            yield Variable(f"velocity_by_{kind}", "m s-1", dim, np.array(speeds), "mean velocity")
            yield Variable(f"error_by_{kind}", "m s-1", dim, np.array(errors), "its error")


def _warnings(case: RodCase, course: RodCourse) -> Iterator[str]:
    if course.velocity_error > 0.1 * abs(course.velocity):
        yield (
            f"the mean velocity is known to {course.velocity_error:.2g} m/s only; write a longer "
            "course.duration"
        )
    if case.worm.susceptibility > 1:
        yield (
            f"a susceptibility of {case.worm.susceptibility:g} changes the field in and near the "
            "body, which the pull by the field without it leaves out"
        )
