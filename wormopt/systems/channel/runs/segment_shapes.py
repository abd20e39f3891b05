"""Runs of kind ``segment-shapes``: a segment between two coils, assumed, exact, and of a rod.

Results and plots treat every `SegmentShape` alike, in the order of `run`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.progress import Report
from wormopt.result import Result, Unchecked
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.channel import rod_rest
from wormopt.systems.channel.closed_forms import (
    ChannelWorm,
    segment_count,
    velocity_per_frequency,
    warnings_of_count,
    warnings_of_susceptibility,
)
from wormopt.systems.channel.rod_rest import RodAtRest, Sweep
from wormopt.systems.channel.scenes.channel import SegmentShapesScene
from wormopt.systems.channel.segments import (
    ACCEPTED,
    SegmentShape,
    assumed_shapes,
    distances_between,
    elastic_shape,
)

_ASSUMED = {
    "sine, beam, line": "centre lines (eqs 33-35 of Zimmermann et al.), not computed from forces",
    "point_contact": "elastica; the walls push across the channel only, and nothing pulls along it",
    "sleeve": "elastica; its length between the walls is free, and its bending energy is the least",
    "elastica": "inextensible and thin; the field acts at the walls only; theta = 0 there",
    "cross-section": "solid and round for forces and energies, I = pi d_w^4 / 64",
}


def run(scene: Scene[SegmentShapesScene], report: Report) -> Result:
    """Compare shapes of a segment.

    Status "failed" if two routes to an elastica disagree. Raises SolveError if there is no
    elastica under an assumption, or if it is not resolved.
    """
    table, begin = scene.table, time.perf_counter()
    worm = table.worm.worm()
    report("measuring assumed shapes", 0.0)
    shapes = [*assumed_shapes(worm)]
    assumed = {shape.name: shape.curve for shape in shapes}
    for index, closing in enumerate(table.exact):
        report(f"bending the elastica: {closing}", (1 + 2 * index) / 5)
        shapes.append(elastic_shape(worm, closing, table.degree))
    rod, sweep = None, None
    if table.rod is not None and worm.youngs_modulus is not None:
        rod = rod_rest.rest_of(worm, table.rod, report)
        if table.rod.sweep:
            sweep = rod_rest.sweep_of(worm, table.rod, assumed, report)
        shapes.append(_shape_of(rod))
    solved = time.perf_counter() - begin
    report("comparing", 0.8)
    apart = distances_between(shapes)
    return conclude(
        scene,
        _scalars(worm, shapes, apart) | _scalars_of_rod(rod, sweep, shapes, apart),
        _variables(shapes, apart, table.points) | _variables_of_rod(rod, sweep),
        checks=[check for shape in shapes for check in shape.checks],
        facts={
            **{shape.name: shape.facts for shape in shapes if shape.facts},
            "accepted": ACCEPTED,
            "assumptions": _ASSUMED | ({} if rod is None else rod_rest.ASSUMED),
        },
        warnings=(
            *_warnings(worm, shapes), *_warnings_of_rod(rod, table),
            *(sweep.warnings if sweep else ()),
        ),
        timings={"solve": solved},
        attributes={} if rod is None else {
            "pitch": worm.pitch, "coils_on": rod.table.on, "coil_outer": rod.table.outer,
            "coil_clearance": rod.table.clearance,
        },
    )  # fmt: skip


def _shape_of(rod: RodAtRest) -> SegmentShape:
    bending, curvature = rod.bending
    rest = rod.rest
    facts = {
        "residual": rest.residual, "imbalance": rest.imbalance, "violation": rest.violation,
        "complementarity": rest.complementarity, "softest": rest.softest,
        "stiffest": rest.stiffest, "stable": rest.stable, "iterations": rest.iterations,
        "field_error": rod.field_error, "mesh_change": rod.mesh_change, "minimum": "local",
    }  # fmt: skip
    return SegmentShape("rod", True, rod.curve, bending, curvature, spans=rod.reached,
                        facts=facts, checks=tuple(rod.checks()))  # fmt: skip


def _scalars(worm: ChannelWorm, shapes: list[SegmentShape], apart: np.ndarray) -> dict[str, Any]:
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
    found = {
        "shapes": [shape.name for shape in shapes],
        "arc_length": lengths,
        "segments": counts,
        "velocity_per_frequency": velocities,
        "curvature_max": curvatures,
        "surface_strain": _times(curvatures, worm.body / 2),
        "angle_max": [shape.curve.steepest() for shape in shapes],
        "rise": worm.rise,
        "body": worm.body,
        "channel": worm.channel,
        "bending_stiffness": stiffness,
        **_closest(shapes, apart),
    }
    for name in ("energy", "reaction", "tension"):
        values = [getattr(shape, name) for shape in shapes]
        found |= {f"{name}_over_stiffness": values, name: _times(values, stiffness)}
    return found


def _times(values: list[float | None], factor: float | None) -> list[float | None]:
    return [None if v is None or factor is None else v * factor for v in values]


def _closest(shapes: list[SegmentShape], apart: np.ndarray) -> dict[str, Any]:
    """Return for each exact shape the assumed one with the least largest distance."""
    assumed = [k for k, shape in enumerate(shapes) if not shape.exact]
    exact = [k for k, shape in enumerate(shapes) if shape.exact]
    best = {e: min(assumed, key=lambda k, e=e: apart[e, k, 0]) for e in exact if shapes[e].spans}
    far = [apart[e, best[e]] if e in best else (None, None) for e in exact]
    return {
        "exact_shapes": [shapes[e].name for e in exact],
        "closest_shape": [shapes[best[e]].name if e in best else None for e in exact],
        "closest_distance": [most for most, _ in far],
        "closest_distance_rms": [mean for _, mean in far],
    }


def _variables(shapes: list[SegmentShape], apart: np.ndarray, count: int) -> dict[str, Any]:
    share = np.linspace(0.0, 1.0, count)
    x, y, theta = np.array([shape.curve.points(share) for shape in shapes]).swapaxes(0, 1)
    return {
        "share": share,
        "x": x,
        "y": y,
        "theta": theta,
        "distance_max": apart[..., 0],
        "distance_rms": apart[..., 1],
        "exact": np.array([shape.exact for shape in shapes]),
    }


def _scalars_of_rod(
    rod: RodAtRest | None, sweep: Sweep | None, shapes: list[SegmentShape], apart: np.ndarray
) -> dict[str, Any]:
    if rod is None:
        return {}
    table, own, other = rod.table, rod.rest.energy, rod.other_energy
    upper, lower = (float(part.sum()) for part in rod.walls)
    assumed = [k for k, shape in enumerate(shapes) if not shape.exact]
    best = min(assumed, key=lambda k: apart[-1, k, 0])
    return {
        "rod_reaches_walls": rod.reached,
        "rod_arc_lengths": list(rod.lengths),
        "rod_stretch": rod.stretch,
        "rod_compression_max": rod.compression,
        "rod_force_upper": upper,
        "rod_force_lower": lower,
        "rod_energy": own,
        "rod_energy_on_one_wall": other,
        "rod_preferred": None if other is None else own < other,
        "assumed_susceptibility": table.susceptibility,
        "assumed_poisson_ratio": table.poisson_ratio,
        **table.assumed,
        "coils_on": table.on,
        **({"sweep_closest_shape": sweep.closest} if sweep else {}),
        "closest_shape_rod": shapes[best].name if rod.reached else None,
        "closest_distance_rod": apart[-1, best, 0] if rod.reached else None,
    }


def _variables_of_rod(rod: RodAtRest | None, sweep: Sweep | None) -> dict[str, np.ndarray]:
    """Return positions of the nodes and the forces on them, with the lower wall at y = 0."""
    if rod is None:
        return {}
    x, y, angle = rod.rest.places.reshape(3, -1)
    upper, lower = rod.walls
    found = {
        "rod_x": x,
        "rod_y": y + rod.worm.channel / 2,
        "rod_angle": angle,
        "rod_force_upper_at": upper,
        "rod_force_lower_at": lower,
        "rod_node_length": rod.rod.weights,
    }
    if sweep is None:
        return found
    return found | {
        "sweep": sweep.turns,
        "sweep_arc_length": sweep.lengths,
        "sweep_distance": sweep.apart,
    }


def _warnings_of_rod(rod: RodAtRest | None, table: SegmentShapesScene) -> Iterator[str]:
    if rod is None:
        if table.rod is not None:
            yield (
                "rod: not computed, because the modulus of this body is unknown; write "
                "worm.youngs_modulus"
            )
        return
    if not rod.reached:
        yield (
            f"rod: {rod.table.ampere_turns:g} ampere-turns do not bend it from wall to wall; "
            "write more in rod.ampere_turns"
        )
    yield from warnings_of_susceptibility(rod.table.susceptibility, "rod: ")


def _warnings(worm: ChannelWorm, shapes: list[SegmentShape]) -> Iterator[str]:
    for shape in shapes:
        if not shape.spans:
            continue
        count = segment_count(worm.length, shape.curve.length, worm.rule)
        yield from warnings_of_count(shape.name, worm, count, shape.curve.length)
        strain = (shape.curvature or 0.0) * worm.body / 2
        if strain >= 1:
            yield Unchecked(
                f"{shape.name}: at the walls the radius of curvature is at most half the "
                "thickness, so the body would penetrate itself"
            )
        elif shape.exact and strain > SMALL_STRAIN:
            yield (
                f"{shape.name}: at the walls the surface strain of the body is {strain:.2g}; "
                f"the law is for small strain, and above {SMALL_STRAIN:g} its forces are "
                "uncertain"
            )
