"""Scenes of kind ``segment-shapes``: a segment between two coils, assumed, exact, and of a rod.

What is told and drawn of one `SegmentShape` is told of all of them, in the order of `run`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

import numpy as np

from wormopt.errors import SolveError
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.numerics.boundary_values import BoundarySolution, solve_boundary
from wormopt.numerics.chebyshev import resolve
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.channel.closed_forms import (
    SHAPES,
    ChannelWorm,
    segment_count,
    velocity_per_frequency,
)
from wormopt.systems.channel.curve import Curve, distances
from wormopt.systems.channel.elastica import elastica, slender_guess
from wormopt.systems.channel.elastica_exact import SLEEVE_RISE, exact_elastica
from wormopt.systems.channel.runs import rod_rest
from wormopt.systems.channel.runs.channel_worm import assumed_curve, body_of, warnings_of_count
from wormopt.systems.channel.runs.rod_rest import RodAtRest
from wormopt.systems.channel.scenes.channel import SegmentShapesScene

# The elastica is followed from the slender beam of this rise over the span.
_SLENDER = 0.2
# Two routes to the elastica may differ by so much of length, force, energy and place.
_ACCEPTED = 1e-10
_ASSUMED = {
    "sine, beam, line": "centre lines (33), (34), (35), not computed from forces",
    "point_contact": "elastica; the walls push across the channel only, and nothing pulls along it",
    "sleeve": "elastica; its length between the walls is free, and its bending energy the least",
    "elastica": "inextensible and thin; the field acts at the walls only; theta = 0 there",
    "cross-section": "solid and round for forces and energies, I = pi d_w^4 / 64",
}


@dataclass(frozen=True, eq=False)
class SegmentShape:
    """What is known of one shape; lengths in m."""

    name: str
    exact: bool  # computed from forces
    curve: Curve  # centre line, from (0, body / 2)
    energy: float | None = None  # bending energy over E I, 1/m; None: not finite
    curvature: float | None = None  # largest, 1/m
    reaction: float | None = None  # wall force across the channel, over E I, 1/m²
    tension: float | None = None  # along the channel, over E I, 1/m²
    spans: bool = True  # goes from wall to wall; else it is no segment
    trust: dict[str, Any] = field(default_factory=dict)  # how it was found
    fault: str = ""  # why it is not to be trusted; empty if it is


def run(scene: Scene[SegmentShapesScene], report: Report) -> Result:
    """Compare shapes of a segment.

    Status "failed" where two routes to an elastica differ. Raises SolveError if there is no
    elastica under an assumption, or it is not resolved.
    """
    table, begin = scene.table, time.perf_counter()
    worm = body_of(table.worm)
    shapes = [*_assumed(worm, report), *_elasticas(worm, table, report)]
    rod = _rod_of(worm, table, report)
    assumed = {shape.name: shape.curve for shape in shapes if not shape.exact}
    swept, swept_variables, swept_warnings = {}, (), []
    if rod is not None:
        swept, swept_variables, swept_warnings = rod_rest.sweep_of(worm, rod.table, assumed, report)
        shapes.append(_shape_of(rod))
    solved = time.perf_counter() - begin
    report("comparing", 0.8)
    apart = _apart(shapes)
    faults = [shape.fault for shape in shapes if shape.fault]
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(worm, shapes, apart) | _scalars_of_rod(rod, shapes, apart, swept),
        variables=(*_variables(shapes, apart, table.points), *_rod_variables(rod, swept_variables)),
        trust={
            **{shape.name: shape.trust for shape in shapes if shape.trust},
            "accepted": _ACCEPTED,
            "assumptions": _ASSUMED | ({} if rod is None else rod_rest.ASSUMED),
            "warnings": [
                *_warnings(worm, shapes), *_warnings_of_rod(rod, table), *swept_warnings,
            ],
        },
        timings_s={"solve": solved},
        scene_text=scene.text,
        attributes={} if rod is None else {
            "pitch": worm.pitch, "coils_on": rod.table.on, "coil_outer": rod.table.outer,
            "coil_clearance": rod.table.clearance,
        },
    )  # fmt: skip


def _rod_of(worm: ChannelWorm, table: SegmentShapesScene, report: Report) -> RodAtRest | None:
    if table.rod is None or worm.youngs_modulus is None:
        return None
    return rod_rest.rest_of(worm, table.rod, report)


def _shape_of(rod: RodAtRest) -> SegmentShape:
    bending, curvature = rod.bending
    return SegmentShape("rod", True, rod.curve, bending, curvature, spans=rod.reached,
                        trust=rod.trust(), fault=rod.fault)  # fmt: skip


def _assumed(worm: ChannelWorm, report: Report) -> Iterator[SegmentShape]:
    report("measuring assumed shapes", 0.0)
    for shape in SHAPES:
        curve = assumed_curve(worm, shape)
        # a broken line has kinks, of which curvature and energy are infinite
        energy, curvature = (None, None) if shape == "line" else _bending(curve)
        yield SegmentShape(shape, False, curve, energy, curvature)


def _bending(curve: Curve) -> tuple[float, float]:
    """Energy over E I, and largest curvature."""
    angle = resolve(lambda s: curve.points(s)[2:], 0.0, 1.0).derivative()
    squares = resolve(lambda s: angle(s) ** 2, 0.0, 1.0)
    energy = float(squares.integral()[0]) / (2 * curve.length)
    return energy, float(np.max(np.abs(angle.extremes()))) / curve.length


def _elasticas(
    worm: ChannelWorm, table: SegmentShapesScene, report: Report
) -> Iterator[SegmentShape]:
    for index, closing in enumerate(table.exact):
        report(f"bending the elastica: {closing}", (1 + 2 * index) / 5)
        yield _elastica(worm, closing, table.degree)


def _elastica(
    worm: ChannelWorm, closing: Literal["point_contact", "sleeve"], degree: int
) -> SegmentShape:
    pitch, rise = worm.pitch, worm.rise / worm.pitch
    if closing == "sleeve" and rise > SLEEVE_RISE:
        raise SolveError(
            f"a segment that may take any length leaves the walls where it rises by more than "
            f"{SLEEVE_RISE:.5g} coil distances; this one rises by {rise:.5g}, and the walls would "
            "have to pull",
            'write exact = ["point_contact"], or a thicker body, a narrower channel',
            code="no_contact",
        )
    slender = min(rise, _SLENDER)
    try:
        found = solve_boundary(
            elastica(closing), lambda s: slender_guess(closing, slender, s), [[slender], [rise]],
            most=degree,
        )  # fmt: skip
    except SolveError as error:
        raise SolveError(
            f"{closing}: {error.reason}", "raise degree, or take a less steep segment",
            code=error.code,
        ) from None  # fmt: skip

    def points(share: np.ndarray) -> np.ndarray:
        theta, _, x, y, _ = found.at(share)
        return np.array([pitch * x, pitch * y + worm.body / 2, theta])

    length, reaction, tension = (float(number) for number in found.p)
    error = _recheck(found, closing, rise)
    return SegmentShape(
        closing, True, Curve(pitch * length, points),
        energy=float(found.at([1.0])[4, 0]) / pitch,
        curvature=float(np.abs(found.at(np.linspace(0, 1, 101))[1]).max()) / pitch,
        reaction=reaction / pitch**2,
        tension=tension / pitch**2,
        trust={
            "degree": found.degree, "residual": found.residual, "tail": found.tail,
            "defect": found.defect, "recheck_error": error,
        },
        fault=_fault(closing, max(error, found.residual, found.defect)),
    )  # fmt: skip


def _fault(name: str, error: float) -> str:
    if error <= _ACCEPTED:
        return ""
    return f"{name}: off by {error:.2g} from its equations or from the elliptic integrals"


def _recheck(
    found: BoundarySolution, closing: Literal["point_contact", "sleeve"], rise: float
) -> float:
    """Largest difference from the elliptic integrals: of numbers, and of places over the span."""
    exact = exact_elastica(closing, rise)
    share = np.linspace(0, 1, 51)
    states = found.at(share)
    pairs = [
        (found.p[0], exact.length), (found.p[1], exact.reaction), (states[4, -1], exact.energy),
        (states[1, 0], exact.curvature),
    ]  # fmt: skip
    size = abs(exact.reaction) + abs(exact.tension)
    scale = [exact.length, size, exact.energy, exact.curvature]
    errors = [abs(a - b) / c for (a, b), c in zip(pairs, scale, strict=True)]
    errors.append(abs(found.p[2] - exact.tension) / size)
    return float(max(*errors, np.abs(states[2:4] - exact.points(share)[:2]).max()))


def _apart(shapes: list[SegmentShape]) -> np.ndarray:
    """Largest and root mean square distance of each from each."""
    found = np.zeros((len(shapes), len(shapes), 2))
    for i, j in combinations(range(len(shapes)), 2):
        found[i, j] = found[j, i] = distances(shapes[i].curve, shapes[j].curve)
    return found


def _scalars(worm: ChannelWorm, shapes: list[SegmentShape], apart: np.ndarray) -> dict[str, Scalar]:
    stiffness = worm.bending_stiffness
    lengths = [shape.curve.length for shape in shapes]
    counts = [
        segment_count(worm.length, shape.curve.length, worm.rule) if shape.spans else None
        for shape in shapes
    ]
    velocities = [
        None if count is None else velocity_per_frequency(worm.pitch, length, count)
        for length, count in zip(lengths, counts, strict=True)
    ]
    curvatures = [shape.curvature for shape in shapes]
    found: dict[str, tuple[Any, str]] = {
        "shapes": ([shape.name for shape in shapes], "count"),
        "arc_length": (lengths, "length"),
        "segments": (counts, "count"),
        "velocity_per_frequency": (velocities, "length"),
        "curvature_max": (curvatures, "curvature"),
        "surface_strain": (_times(curvatures, worm.body / 2), "share"),
        "angle_max": ([shape.curve.steepest() for shape in shapes], "angle"),
        "rise": (worm.rise, "length"),
        "body": (worm.body, "length"),
        "channel": (worm.channel, "length"),
        "bending_stiffness": (stiffness, "bending_stiffness"),
        **_closest(shapes, apart),
    }
    for name, over, quantity in (
        ("energy", "curvature", "energy"), ("reaction", "curvature_squared", "force"),
        ("tension", "curvature_squared", "force"),
    ):  # fmt: skip
        values = [getattr(shape, name) for shape in shapes]
        found[f"{name}_over_stiffness"] = (values, over)
        found[name] = (_times(values, stiffness), quantity)
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}


def _times(values: list[float | None], factor: float | None) -> list[float | None]:
    return [None if v is None or factor is None else v * factor for v in values]


def _closest(shapes: list[SegmentShape], apart: np.ndarray) -> dict[str, tuple[Any, str]]:
    """For each exact shape the assumed one whose largest distance is the least."""
    assumed = [k for k, shape in enumerate(shapes) if not shape.exact]
    exact = [k for k, shape in enumerate(shapes) if shape.exact]
    best = {e: min(assumed, key=lambda k, e=e: apart[e, k, 0]) for e in exact if shapes[e].spans}
    far = [apart[e, best[e]] if e in best else (None, None) for e in exact]
    return {
        "exact_shapes": ([shapes[e].name for e in exact], "count"),
        "closest_shape": ([shapes[best[e]].name if e in best else None for e in exact], "count"),
        "closest_distance": ([most for most, _ in far], "length"),
        "closest_distance_rms": ([mean for _, mean in far], "length"),
    }


def _variables(shapes: list[SegmentShape], apart: np.ndarray, count: int) -> tuple[Variable, ...]:
    share = np.linspace(0.0, 1.0, count)
    x, y, theta = np.array([shape.curve.points(share) for shape in shapes]).swapaxes(0, 1)
    along, pairs, m = ("shape", "share"), ("shape", "other_shape"), unit_of("length", "SI")
    exact = [shape.exact for shape in shapes]
    return (
        Variable("share", "1", ("share",), share, "share of the length of the segment"),
        Variable("x", m, along, x, "place along the channel"),
        Variable("y", m, along, y, "height of the centre line"),
        Variable("theta", unit_of("angle", "SI"), along, theta, "angle against the channel"),
        Variable("distance_max", m, pairs, apart[..., 0], "largest distance at the same share"),
        Variable("distance_rms", m, pairs, apart[..., 1], "root mean square of that distance"),
        Variable("exact", "1", ("shape",), np.array(exact), "whether computed from forces"),
    )


def _scalars_of_rod(
    rod: RodAtRest | None,
    shapes: list[SegmentShape],
    apart: np.ndarray,
    swept: dict[str, tuple[Any, str]],
) -> dict[str, Scalar]:
    if rod is None:
        return {}
    assumed = [k for k, shape in enumerate(shapes) if not shape.exact]
    best = min(assumed, key=lambda k: apart[-1, k, 0])
    told = rod.scalars() | swept
    told["closest_shape_rod"] = (shapes[best].name if rod.reached else None, "count")
    told["closest_distance_rod"] = (apart[-1, best, 0] if rod.reached else None, "length")
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in told.items()}


def _rod_variables(rod: RodAtRest | None, swept: tuple[Variable, ...]) -> Iterator[Variable]:
    if rod is not None:
        yield from rod.variables()
        yield from swept


def _warnings_of_rod(rod: RodAtRest | None, table: SegmentShapesScene) -> Iterator[str]:
    if rod is None:
        if table.rod is not None:
            yield (
                "rod: left out, since the modulus of this body is not known; write "
                "worm.youngs_modulus"
            )
        return
    if not rod.reached:
        yield (
            f"rod: {rod.table.ampere_turns:g} ampere-turns do not bend it from wall to wall; "
            "write more in rod.ampere_turns"
        )
    if rod.table.susceptibility > 1:
        yield (
            f"rod: a susceptibility of {rod.table.susceptibility:g} changes the field in and near "
            "the body, which the pull by the field without it leaves out"
        )


def _warnings(worm: ChannelWorm, shapes: list[SegmentShape]) -> Iterator[str]:
    for shape in shapes:
        if not shape.spans:
            continue
        count = segment_count(worm.length, shape.curve.length, worm.rule)
        yield from warnings_of_count(shape.name, worm, count, shape.curve.length)
        strain = (shape.curvature or 0.0) * worm.body / 2
        if strain >= 1:
            yield (
                f"{shape.name}: at the walls the body is bent more sharply than it is thick and "
                "would run into itself"
            )
        elif shape.exact and strain > SMALL_STRAIN:
            yield (
                f"{shape.name}: at the walls the surface of the body is strained by {strain:.2g}; "
                f"its law is that of small strain, and above {SMALL_STRAIN:g} its forces are a "
                "guess"
            )
