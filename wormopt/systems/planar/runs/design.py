"""Runs of kind ``planar-design``: the best gait of a body in the plane."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.body.se2 import circle_of
from wormopt.systems.planar.design.gaits import (
    CLOSED,
    PlanarDesign,
    crossings,
    design_stroke,
    widest,
)
from wormopt.systems.planar.design.ground import Dry
from wormopt.systems.planar.design.polygons import Steps
from wormopt.systems.planar.scenes.design import PlanarDesignScene
from wormopt.systems.shared.optimum import refused

# Accepted difference of both motions, over the path of the shape; accepted excess of the limits.
_AGREED = {True: 3e-4, False: 1e-7}
_KEPT, _STILL = 1e-9, 1e-6
_PARTS = 24


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PlanarDesignScene], report: Report) -> Result:
    """Find the best gait; status "failed" if a second route ends elsewhere.

    Raises SceneError if the objective is inconsistent, SolveError if no gait is found.
    """
    search, begin = scene.table.search, time.perf_counter()
    try:
        aim = scene.table.planar_aim
    except ArgumentError as error:  # faults that no table finds without numerics
        raise SceneError(scene.name, [("aim", str(error))]) from None
    try:
        design = design_stroke(aim, starts=search.starts, seed=search.seed, report=report)
    except SolveError as error:
        raise refused(scene, error) from None
    solved = time.perf_counter()
    off = _elsewhere(design)
    ratio = design.work_bound
    circle = circle_of(design.displacement) if aim.purpose != "speed" else None
    rate = float(design.displacement[2]) / design.duration
    return conclude(
        scene,
        {
            "displacement": design.displacement[:2].tolist(),
            "turn": float(design.displacement[2]),
            "distance": design.distance,
            "duration": design.duration,
            "speed": design.distance / design.duration,
            "turn_rate": rate,
            "work": design.work,
            "work_per_distance": design.work / design.distance if design.distance else None,
            "work_bound": ratio,
            "work_over_bound": design.work / ratio if ratio else None,
            "turn_bound": design.turn_bound if aim.purpose == "turn" else None,
            "turn_over_bound": rate / design.turn_bound
            if aim.purpose == "turn" and design.turn_bound
            else None,
            "circle_radius": circle.radius if circle else None,
            "half_width": widest(design),
            "starts_found": list(design.tried),
            "miss": float(np.abs(design.misses).max(initial=0.0)),
            "recheck_error": off,
        },
        _variables(design),
        checks=_checks(design, off),
        facts={"stroke": _stroke(design)},
        warnings=_warnings(design),
        timings={"search": solved - begin, "recheck": time.perf_counter() - solved},
    )


def _elsewhere(design: PlanarDesign) -> float:
    """Return the difference to the end at fixed instants, over the path of the shape."""
    aim, corners = design.aim, design.corners
    steps = Steps(aim.shape, aim.ground, parts=_PARTS, points=6)
    total = steps.sides(corners, aim.closed).total
    whole = np.vstack([corners, corners[:1]]) if aim.closed else corners
    way = float(np.abs(np.diff(whole, axis=0)).sum())
    return float(np.abs(total - design.displacement).max()) / way


def _checks(design: PlanarDesign, off: float) -> Iterator[Check]:
    aim, (low, high) = design.aim, design.aim.ranges.T
    yield Check(
        "motion by another way", off, _AGREED[isinstance(aim.ground, Dry)],
        f"at fixed instants the motion ends {off:.2g} elsewhere",
    )  # fmt: skip
    miss = float(np.abs(design.misses).max(initial=0.0))
    yield Check("what should vanish", miss, CLOSED, f"the requirements are missed by {miss:.2g}")
    over = float(np.maximum(low - design.corners, design.corners - high).max())
    yield Check("limits of the shape", max(0.0, over), _KEPT, "the shape exceeds its limits")
    if aim.limits.half_width is not None:
        over = widest(design) - aim.limits.half_width
        advice = f"the body leaves the passage by {over:.2g}; write more search.corners"
        yield Check("passage", max(0.0, over), _STILL, advice)
    if design.work_bound is not None:
        over = max(0.0, design.work_bound - design.work)
        yield Check("work above its bound", over, _KEPT * design.work, "work below its lower bound")
    if aim.limits.effort is not None:
        over = max(0.0, design.work - aim.limits.effort)
        limit = _AGREED[True] * aim.limits.effort
        yield Check("effort", over, limit, f"the gait exceeds limits.effort by {over:.2g}")


def _stroke(design: PlanarDesign) -> str:
    """Return the gait as `--set` takes it for scenes that move a given stroke."""
    rows = ",".join(f"[{','.join(map(repr, row))}]" for row in design.corners.tolist())
    return f'stroke={{course="polygon",corners=[{rows}]}}'


def _warnings(design: PlanarDesign) -> Iterator[str]:
    yield "a local optimum at this number of corners; write more search.starts to try others"
    crossed = list(crossings(design.places()[3]))
    if crossed:
        first, second = crossed[0]
        yield f"links {first} and {second} cross; write a narrower limits.angle"
    bound = design.turn_bound
    if bound and design.aim.purpose == "turn" and design.value > bound * (1 + 1e-9):
        yield (
            "exceeds the bound of two links one of which always rests, because changes of length "
            "also turn the body"
        )


def _variables(design: PlanarDesign) -> dict[str, Any]:
    t, shapes, _, places = design.places()
    return {
        "time": t,
        "shape": shapes.T,
        "x": places[..., 0].T,
        "y": places[..., 1].T,
        "rest": _resting(places).T,
        "corner": design.corners,
    }


def _resting(places: np.ndarray) -> np.ndarray:
    """Return which masses (m, masses) stay in place until the next instant."""
    ways = np.linalg.norm(np.diff(places, axis=0, append=places[-1:]), axis=-1)
    ways[-1] = ways[-2]
    return (ways < 1e-5 * np.maximum(ways.max(axis=1, keepdims=True), 1e-12)).astype(float)
