"""Kind "segment-shapes": a segment between two coils, assumed, exact, and of a rod.

Results and plots treat every `SegmentShape` alike, in the order of `SegmentShapes.shapes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.result import Check, Unchecked
from wormopt.study import (
    attributes,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.systems.channel.rod_rest import RodAtRest, Sweep
from wormopt.systems.channel.tables import ASSUMED_COILS, BodyStudy, RodOverCoils, of_table

with on_use():
    import numpy as np

    from wormopt.magnetics.material import SMALL_STRAIN
    from wormopt.systems.channel.closed_forms import (
        segment_count,
        velocity_per_frequency,
        warnings_of_count,
        warnings_of_susceptibility,
    )
    from wormopt.systems.channel.rod_rest import ASSUMED as ASSUMED_OF_ROD
    from wormopt.systems.channel.rod_rest import rest_of, sweep_of
    from wormopt.systems.channel.segments import (
        ACCEPTED,
        SegmentShape,
        assumed_shapes,
        distances_between,
        elastic_shape,
    )

Closings = Annotated[
    tuple[Literal["point_contact", "sleeve"], ...],
    Meta(min_length=1, max_length=2, description='a list of "point_contact" and "sleeve"'),
]
_ASSUMED = {
    "sine, beam, line": "centre lines (eqs 33-35 of Zimmermann et al.), not computed from forces",
    "point_contact": "elastica; the walls push across the channel only, and nothing pulls along it",
    "sleeve": "elastica; its length between the walls is free, and its bending energy is the least",
    "elastica": "inextensible and thin; the field acts at the walls only; theta = 0 there",
    "cross-section": "solid and round for forces and energies, I = pi d_w^4 / 64",
}


@dataclass(frozen=True)
class Shapes:
    """Lengths, energies and forces of all shapes, in the order of `shapes`."""

    names: list[str] = value("1", "names of the shapes; lists below are in this order",
                             name="shapes")  # fmt: skip
    arc_length: list[float] = value("length", "*l*<sub>s</sub>")
    segments: list[int | None] = value("count", "*k*<sub>s</sub>")
    velocity_per_frequency: list[float | None] = value(
        "length", "eq. 32 of Zimmermann et al. over the frequency"
    )
    energy_over_stiffness: list[float | None] = value(
        "curvature", "bending energy over *EI*; unknown for the line, which has kinks"
    )
    energy: list[float | None] = value("energy", "bending energy")
    reaction_over_stiffness: list[float | None] = value("curvature_squared", "`reaction` over *EI*")
    reaction: list[float | None] = value(
        "force", "wall force *V* across the channel; positive if the wall pushes"
    )
    tension_over_stiffness: list[float | None] = value("curvature_squared", "`tension` over *EI*")
    tension: list[float | None] = value("force", "tension *N* along the channel")
    curvature_max: list[float | None] = value("curvature", "largest curvature")
    surface_strain: list[float | None] = value(
        "share", "`curvature_max` times half the thickness of the body"
    )
    angle_max: list[float] = value("angle", "largest angle")
    is_exact: np.ndarray = signal(
        "count", "shape", "1 if computed from forces, else 0", name="exact"
    )
    share: np.ndarray = signal("share", "share", "share of the length of the segment")
    x: np.ndarray = signal("length", "shape share", "position along the channel")
    y: np.ndarray = signal("length", "shape share", "height of the centre line")
    theta: np.ndarray = signal("angle", "shape share", "angle against the channel")


@dataclass(frozen=True)
class Distances:
    """Distances of all shapes from each other at the same share of their lengths."""

    exact_shapes: list[str] = value("1", "names of the exact shapes")
    closest_shape: list[str | None] = value(
        "1", "for each exact shape, the assumed one with the least distance"
    )
    closest_distance: list[float | None] = value("length", "largest distance between both shapes")
    closest_distance_rms: list[float | None] = value(
        "length", "root mean square distance between both shapes"
    )
    distance_max: np.ndarray = signal(
        "length", "shape other_shape", "largest distance at the same share"
    )
    distance_rms: np.ndarray = signal(
        "length", "shape other_shape", "root mean square of that distance"
    )


@dataclass(frozen=True)
class RodForces:
    """Energies of the rod at rest, and forces on its nodes, with the lower wall at y = 0."""

    rod_force_upper: float = value("force", "resultant force of the upper wall")
    rod_force_lower: float = value("force", "resultant force of the lower wall")
    rod_energy: float = value("energy", "elastic and magnetic energy of the bent rod")
    rod_preferred: bool | None = value("1", "whether the bent rod has less energy")
    rod_x: np.ndarray = signal(
        "length", "node", "node position along the channel, from the middle of the block"
    )
    rod_y: np.ndarray = signal("length", "node", "height of the node")
    rod_angle: np.ndarray = signal("angle", "node", "angle of the cross section at the node")
    rod_force_upper_at: np.ndarray = signal("force", "node", "force of the upper wall on the node")
    rod_force_lower_at: np.ndarray = signal("force", "node", "force of the lower wall on the node")
    rod_node_length: np.ndarray = signal("length", "node", "length of rod lumped at the node")


class SegmentShapes(BodyStudy, kind="segment-shapes"):
    """Compare assumed shapes of a segment between two coils with the exact elastica.

    The assumed shapes are eqs 33–35 of Zimmermann et al. 2007 [[1]](../references.md). The elastica
    is the exact shape of an elastic body, under two assumptions. The scene computes lengths, wall
    forces, energies and distances. Theory:
    [theory-channel.md](../theory-channel.md#2-exact-segment-shapes). Only `units = "SI"`. With
    `[rod]` the rest of the body in the field of coils is also computed, and `rod` is a further
    exact shape; its `theta` is the angle of the cross sections. Without a known modulus the rod is
    left out, with a warning.

    Distances are between points at the same share of the length. Distances of a sweep are NaN if
    the rod is not bent from wall to wall. They are also NaN, with a warning, if its rest is not
    stable or not balanced. The mesh is refined at `rod.ampere_turns` only.

    For each elastica the trust report has `degree`, `residual`, `tail` (last coefficients),
    `defect` (between the points), and `recheck_error` (against elliptic integrals). It also has
    `accepted`, `assumptions` and `warnings`. Warnings report surface strains above a tenth, and
    bodies that would penetrate themselves.

    For the `rod` the report has `residual` (unbalanced slope of the energy) and `imbalance`
    (accelerations by the equations of motion), both relative; `violation` of walls in m and
    `complementarity` of gaps and forces; the least and largest stiffness along the walls,
    `softest` and `stiffest`, and whether the rest is `stable`; `iterations`; `field_error` of the
    series; `mesh_change` of the length with two thirds of the elements; `minimum` is "local". The
    status is `failed` if the imbalance is above 1e-6, the rest is not stable, or the change is
    above 0.005. The exit code is 3 if the rod finds no rest or does not reach over the coils. It is
    also 3 if a `sleeve` leaves the walls (rises above 1.669 coil distances), or if the degree is
    too small.
    """

    pictures: ClassVar = {
        "segment_shapes": "centre lines between the walls, distances, the rod at rest",
    }
    headline: ClassVar = (
        "shapes", "arc_length", "segments", "velocity_per_frequency", "energy_over_stiffness",
    )  # fmt: skip

    exact: Closings = entry(
        "`point_contact`: walls push across the channel and nothing pulls along it; `sleeve`: "
        "the length is free and has the least energy",
        default=("point_contact", "sleeve"),
    )
    degree: int = whole(16, 512, "largest degree of the polynomials", default=256)
    samples: int = whole(11, 10001, "number of points of each centre line", default=201)
    rod: RodOverCoils | None = entry(
        "the body at rest in the field of coils; not computed if left out", default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        for word in sorted(set(self.exact)):
            if self.exact.count(word) > 1:
                yield "exact", f'"{word}" is listed twice; write it once'
        if self.rod is not None:
            yield from of_table("rod", self.rod.faults_in(self.worm))

    @property
    def has_rod(self) -> bool:
        """Whether the body is computed as a rod: its modulus must be known."""
        return self.rod is not None and self.body.youngs_modulus is not None

    @property
    def has_sweep(self) -> bool:
        """Whether it is computed for several ampere-turns."""
        return self.has_rod and bool(self.rod and self.rod.sweep)

    @cached_property
    def assumed(self) -> list[SegmentShape]:
        """The assumed shapes."""
        return list(assumed_shapes(self.body))

    @stage
    def elastica(self) -> list[SegmentShape]:
        return [elastic_shape(self.body, closing, self.degree) for closing in self.exact]

    @stage
    def rest(self) -> RodAtRest | None:
        if not (self.has_rod and self.rod):
            return None
        return rest_of(self.body, self.rod, self.report)

    @stage
    def rests_over_currents(self) -> Sweep | None:
        if not (self.has_sweep and self.rod):
            return None
        curves = {shape.name: shape.curve for shape in self.assumed}
        return sweep_of(self.body, self.rod, curves, self.report)

    @cached_property
    def all_shapes(self) -> list[SegmentShape]:
        """All shapes: the assumed ones, the elastica, and the rod."""
        shapes = [*self.assumed, *self.elastica]
        return shapes if self.rest is None else [*shapes, _shape_of(self.rest)]

    # -- results -----------------------------------------------------------------------------------

    @parts(Shapes)
    def of_shapes(self) -> Shapes:
        worm, shapes = self.body, self.all_shapes
        lengths = [shape.curve.length for shape in shapes]
        counts = [self.count_of(shape) for shape in shapes]
        curvatures = [shape.curvature for shape in shapes]
        over_stiffness = {
            name: [getattr(shape, name) for shape in shapes]
            for name in ("energy", "reaction", "tension")
        }
        share = np.linspace(0.0, 1.0, self.samples)
        x, y, theta = np.array([shape.curve.points(share) for shape in shapes]).swapaxes(0, 1)
        return Shapes(
            names=[shape.name for shape in shapes],
            arc_length=lengths,
            segments=counts,
            velocity_per_frequency=[
                None if count is None else velocity_per_frequency(worm.pitch, length, count)
                for length, count in zip(lengths, counts, strict=True)
            ],
            curvature_max=curvatures,
            surface_strain=_times(curvatures, worm.body / 2),
            angle_max=[shape.curve.steepest() for shape in shapes],
            is_exact=np.array([shape.exact for shape in shapes]),
            share=share,
            x=x,
            y=y,
            theta=theta,
            **{f"{name}_over_stiffness": found for name, found in over_stiffness.items()},
            **{n: _times(found, worm.bending_stiffness) for n, found in over_stiffness.items()},
        )

    def count_of(self, shape: SegmentShape) -> int | None:
        """Return the number of segments of a shape; None if it does not span the walls."""
        worm = self.body
        return segment_count(worm.length, shape.curve.length, worm.rule) if shape.spans else None

    @parts(Distances)
    def distances(self) -> Distances:
        shapes, apart = self.all_shapes, distances_between(self.all_shapes)
        exact = [k for k, shape in enumerate(shapes) if shape.exact]
        assumed = range(len(self.assumed))
        best = {e: min(assumed, key=lambda k, e=e: apart[e, k, 0]) for e in exact
                if shapes[e].spans}  # fmt: skip
        far = [apart[e, best[e]] if e in best else (None, None) for e in exact]
        return Distances(
            exact_shapes=[shapes[e].name for e in exact],
            closest_shape=[shapes[best[e]].name if e in best else None for e in exact],
            closest_distance=[most for most, _ in far],
            closest_distance_rms=[mean for _, mean in far],
            distance_max=apart[..., 0],
            distance_rms=apart[..., 1],
        )

    @scalar("length", "*d* − *d*<sub>w</sub>")
    def rise(self) -> float:
        return self.body.rise

    @scalar("length", "*d*", name="channel")
    def channel_diameter(self) -> float:
        return self.body.channel

    @scalar("length", "*d*<sub>w</sub>", name="body")
    def body_diameter(self) -> float:
        return self.body.body

    @scalar("bending_stiffness", "*EI*, with *I* = π*d*<sub>w</sub>⁴/64")
    def bending_stiffness(self) -> float | None:
        return self.body.bending_stiffness

    # -- the rod -----------------------------------------------------------------------------------

    @parts(RodAtRest, when="has_rod")
    def rod_at_rest(self) -> RodAtRest:
        assert self.rest is not None
        return self.rest

    @parts(RodForces, when="has_rod")
    def of_rod(self) -> RodForces:
        rod = self.rod_at_rest
        own, other = rod.rest.energy, rod.other_energy
        x, y, angle = rod.rest.places.reshape(3, -1)
        upper, lower = rod.walls
        return RodForces(
            rod_force_upper=float(upper.sum()),
            rod_force_lower=float(lower.sum()),
            rod_energy=own,
            rod_preferred=None if other is None else own < other,
            rod_x=x,
            rod_y=y + rod.worm.channel / 2,
            rod_angle=angle,
            rod_force_upper_at=upper,
            rod_force_lower_at=lower,
            rod_node_length=rod.rod.weights,
        )

    @scalar(
        "1",
        "assumed shape closest to the rod's; unknown if the rod is not bent from wall to wall",
        when="has_rod",
    )
    def closest_shape_rod(self) -> str | None:
        return self.distances.closest_shape[-1]

    @scalar(
        "length",
        "largest distance of that shape from the rod's; unknown if that shape is",
        when="has_rod",
    )
    def closest_distance_rod(self) -> float | None:
        return self.distances.closest_distance[-1]

    @scalars(
        {
            "assumed_susceptibility": ("1", "`rod.susceptibility`"),
            "assumed_poisson_ratio": ("1", "`rod.poisson_ratio`"),
            "coils_on": ("count", "`rod.on`"),
        }
        | ASSUMED_COILS,
        when="has_rod",
    )
    def given_of_rod(self) -> Mapping[str, Any]:
        table = self.rod_at_rest.table
        return {
            "assumed_susceptibility": table.susceptibility,
            "assumed_poisson_ratio": table.poisson_ratio,
            "coils_on": table.on,
            **table.assumed,
        }

    @parts(Sweep, when="has_sweep")
    def swept_rod(self) -> Sweep:
        assert self.rests_over_currents is not None
        return self.rests_over_currents

    @attributes
    def drawn(self) -> dict[str, Any]:
        if self.rest is None:
            return {}
        table = self.rest.table
        return {
            "pitch": self.body.pitch, "coils_on": table.on, "coil_outer": table.outer_radius,
            "coil_clearance": table.clearance,
        }  # fmt: skip

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def of_exact_shapes(self) -> Iterator[Check]:
        yield from (check for shape in self.all_shapes for check in shape.checks)

    @facts
    def found(self) -> dict[str, Any]:
        return {
            **{shape.name: shape.facts for shape in self.all_shapes if shape.facts},
            "accepted": ACCEPTED,
            "assumptions": _ASSUMED | (ASSUMED_OF_ROD if self.has_rod else {}),
        }

    @warnings
    def of_segments(self) -> Iterator[str]:
        worm = self.body
        for shape in self.all_shapes:
            if (count := self.count_of(shape)) is None:
                continue
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

    @warnings
    def of_rest(self) -> Iterator[str]:
        if self.rod is not None and self.rest is None:
            yield (
                "rod: not computed, because the modulus of this body is unknown; write "
                "worm.youngs_modulus"
            )
        if self.rod is None or self.rest is None:
            return
        if not self.rest.reached:
            yield (
                f"rod: {self.rod.ampere_turns:g} ampere-turns do not bend it from wall to wall; "
                "write more in rod.ampere_turns"
            )
        yield from warnings_of_susceptibility(self.rod.susceptibility, "rod: ")
        if self.rests_over_currents is not None:
            yield from self.rests_over_currents.left_out


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


def _times(values: list[float | None], factor: float | None) -> list[float | None]:
    return [None if v is None or factor is None else v * factor for v in values]
