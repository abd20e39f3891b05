"""Runs of kind ``planar-swim``: a given or optimal stroke on viscous ground."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.body.se2 import circle_of, rotate
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.scenes.swim import PlanarSwimScene
from wormopt.systems.planar.swimming.balance import stepped
from wormopt.systems.planar.swimming.best import BestStroke, best_stroke
from wormopt.systems.planar.swimming.heights import Frame, heights, small_efficiency
from wormopt.systems.planar.swimming.spectral import spectral_stroke
from wormopt.systems.planar.swimming.stroke import Swim, swim
from wormopt.systems.planar.swimming.swimmer import Swimmer
from wormopt.systems.shared.optimum import refused

_AGREED, _STEPPED, _STRAIGHT = 1e-7, 1e-8, 1e-5
_INSTANTS, _GRID = 401, 81


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PlanarSwimScene], report: Report) -> Result:
    """Compute the given or the best stroke; status "failed" if a second route ends elsewhere.

    Raises SolveError if no stroke is found.
    """
    table, begin = scene.table, time.perf_counter()
    swimmer = _swimmer(table)
    best = None if table.stroke else _searched(scene, swimmer, report)
    stroke: Stroke = best.stroke if best else table.stroke.stroke()  # type: ignore[union-attr]
    done = swim(swimmer, stroke)
    searched = time.perf_counter()
    spectral, reason = _again(table, swimmer, best, done)
    again = stepped(swimmer, stroke)
    off = float(np.abs(again[:3] - done.displacement).max() / (1 + done.length))
    circle = circle_of(done.displacement)
    straight = table.search.maximise == "efficiency" or best is None
    return conclude(
        scene,
        {
            "distance": done.distance,
            "displacement": done.displacement[:2].tolist(),
            "turn": done.turn,
            "circle_radius": circle.radius if circle and abs(done.turn) > _STRAIGHT else None,
            "action": done.action,
            "efficiency": done.efficiency,
            "efficiency_ceiling": swimmer.ceiling,
            "efficiency_spectral": spectral,
            "efficiency_small": small_efficiency(swimmer, done) if table.n_s == 2 else None,
            "starts_found": list(best.tried) if best else None,
            "recheck_error": off,
        },
        _variables(table, swimmer, stroke, done),
        checks=_checks(done, best, spectral, reason, off, swimmer),
        facts={"second_way": reason, "quadrature_change": done.error, "frame": table.frame},
        warnings=_warnings(best, done, reason, straight=straight),
        timings={"search": searched - begin, "recheck": time.perf_counter() - searched},
    )


def _swimmer(table: PlanarSwimScene) -> Swimmer:
    ground = table.ground
    return Swimmer(
        table.body.shape(),
        rods=(ground.along, ground.across),
        masses=(ground.mass_along, ground.mass_across),
    )


def _searched(scene: Scene[PlanarSwimScene], swimmer: Swimmer, report: Report) -> BestStroke:
    table, given = scene.table, scene.table.mesh
    mesh = Mesh.even(
        1, given.arcs, Collocation(given.degree, given.scheme), max(0, given.degree - 1)
    )
    lower, upper = table.bounds
    try:
        return best_stroke(
            swimmer, lower, upper, maximise=table.search.maximise, starts=table.search.starts,
            mesh=mesh, tolerance=given.tolerance, report=report,
        )  # fmt: skip
    except SolveError as error:
        raise refused(scene, error) from None


def _again(
    table: PlanarSwimScene, swimmer: Swimmer, best: BestStroke | None, done: Swim
) -> tuple[float | None, str]:
    """Return the efficiency by harmonics, and the method or why there is none."""
    if best is None or table.search.maximise != "efficiency":
        return None, "none: no efficiency was optimised"
    if _touches(table, done):
        return None, "none: the stroke reaches a limit of its shape"
    try:
        found = spectral_stroke(swimmer, best.harmonics, done.drag)
    except SolveError as error:
        return None, f"failed: {error.reason}"
    return found.efficiency, "harmonics at even phases, by sequential quadratic programming"


def _touches(table: PlanarSwimScene, done: Swim) -> bool:
    lower, upper = map(np.array, table.bounds)
    near = 1e-5 * (upper - lower)
    return bool(np.any(done.shapes < lower + near) or np.any(done.shapes > upper - near))


def _checks(
    done: Swim, best: BestStroke | None, spectral: float | None, reason: str, off: float,
    swimmer: Swimmer,
) -> Iterator[Check]:  # fmt: skip
    yield Check(
        "balance of forces, stepped", off, _STEPPED,
        f"by stepped force balances in the plane the stroke ends {off:.2g} elsewhere",
    )  # fmt: skip
    if best is not None:
        advice = f"the stroke turns the body by {done.turn:.2g}; write a smaller mesh.tolerance"
        yield Check("no turn", abs(done.turn), _STRAIGHT, advice)
        excess = max(0.0, done.drag * done.distance**2 / done.action - swimmer.ceiling)
        yield Check("efficiency below its ceiling", excess, 0.0, "efficiency above its upper bound")
    if spectral is not None:
        apart = abs(spectral * done.action / (done.drag * done.distance**2) - 1)
        advice = f"by harmonics the efficiency is {spectral:.9g}; write more mesh.arcs"
        yield Check("efficiency by harmonics", apart, _AGREED, advice)
    elif reason.startswith("failed"):
        yield Check("efficiency by harmonics", None, _AGREED, reason)


def _warnings(best: BestStroke | None, done: Swim, reason: str, *, straight: bool) -> Iterator[str]:
    if best is None:
        if abs(done.turn) > _STRAIGHT:
            yield (
                "the stroke turns the body: its displacement depends on frame and start, and "
                "repeated strokes lie on a circle"
            )
        return
    yield "a local optimum; write more search.starts to begin near other shapes"
    if reason.startswith("none"):
        yield f"no second route to this stroke: {reason.removeprefix('none: ')}"
    if not straight:
        yield (
            "where limits of the shape are active the stroke has corners, which the mesh resolves "
            f"to {best.optimum.defects.max():.1g} of the states' sizes; the distance may be larger "
            "by as much"
        )


def _variables(
    table: PlanarSwimScene, swimmer: Swimmer, stroke: Stroke, done: Swim
) -> dict[str, Any]:
    instants = np.linspace(0.0, 1.0, _INSTANTS)
    phase = np.interp(instants, done.time, done.phase)
    shapes, rates = stroke.at(phase)
    poses = np.stack([np.interp(phase, done.phase, column) for column in done.poses.T], axis=-1)
    points = np.stack([np.asarray(swimmer.shape.kinematics(s)[0]).T for s in shapes])
    placed = poses[:, None, :2] + rotate(poses[:, None, 2], points)
    _, G = swimmer.local(shapes)
    power = np.einsum("mi,mij,mj->m", rates, G, rates)
    found = {
        "instant": instants,
        "shape": shapes.T,
        "x": placed[..., 0].T,
        "y": placed[..., 1].T,
        "power": power / power.mean() if power.mean() > 0 else power,
    }
    return found | (_heights(swimmer, table.frame, done) if table.n_s == 2 else {})


def _heights(swimmer: Swimmer, frame: Frame, done: Swim) -> dict[str, Any]:
    """Return the curvature over a square of angles slightly larger than the stroke."""
    low, high = done.shapes.min(axis=0), done.shapes.max(axis=0)
    middle, reach = (low + high) / 2, 1.15 * max(float((high - low).max()) / 2, 0.1)
    reach = min(reach, max(float(np.pi - np.abs(middle).max()) - 1e-3, 0.1))
    axes = [np.linspace(m - reach, m + reach, _GRID) for m in middle]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    seen = heights(swimmer, frame, reach, middle=tuple(middle.tolist()))
    values = seen.at(grid).T.reshape(3, _GRID, _GRID)
    return {"height_s1": axes[0], "height_s2": axes[1], "height": values}
