"""Scenes of kinds "channel-worm" and "segment-shapes": a magnetisable body in a channel."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import entry, positive, whole
from wormopt.study.types import Positive
from wormopt.systems.channel.scenes.rod import (
    ASSUMED_COILS,
    Coils,
    Elements,
    Poisson,
    Share,
    WindingTable,
)
from wormopt.systems.channel.scenes.rod import Degree as ElementDegree
from wormopt.systems.channel.tables import ChannelBody
from wormopt.systems.coils import SIScene

Closings = Annotated[
    tuple[Literal["point_contact", "sleeve"], ...],
    Meta(min_length=1, max_length=2, description='a list of "point_contact" and "sleeve"'),
]
Degree = Annotated[int, Meta(ge=16, le=512, description="a whole number from 16 to 512")]
On = Annotated[int, Meta(ge=2, le=10, description="a whole number from 2 to 10")]
Sweep = Annotated[
    tuple[Positive, ...],
    Meta(max_length=24, description="a list of up to 24 finite numbers above 0, ascending"),
]


class BodyScene(SIScene):
    """A body in a channel."""

    why_si: ClassVar = 'the bodies of the scene are in m and Pa; write units = "SI"'

    worm: ChannelBody = entry("the body")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)


class RestTable(WindingTable):
    """The body as a rod at rest in the field of coils.

    Values that Zimmermann et al. do not publish are assumptions, with the defaults of
    [`rod-motion`](rod-motion.md). The result lists them.
    """

    susceptibility: float = positive(
        "1", "magnetisation over the field without the body, *assumed*", default=2.0
    )
    poisson_ratio: Poisson = entry(
        "Poisson's ratio, 0.5 for constant volume, *assumed*", quantity="1", default=0.5
    )
    on: int = whole(2, 10, "number of active coils in a block", default=3)
    every: Coils = entry(
        "number of coils after which the pattern repeats", quantity="count", default=7
    )
    elements: Elements = entry("finite elements of the rod", quantity="count", default=48)
    degree: ElementDegree = entry("degree of their polynomials", quantity="count", default=2)
    field_tolerance: Share = entry(
        "terms of the field's series below this share of the largest are left out",
        quantity="share",
        default=1e-3,
    )
    sweep: Sweep = entry(
        "further ampere-turns at which the rest is computed, ascending; about 2 s each",
        quantity="ampere_turns",
        default=(),
    )

    def faults(self, worm: ChannelBody) -> Iterator[Fault]:
        """Yield rods and coils that cannot be built, as key path and message."""
        if self.inner >= self.outer:
            yield "rod.inner", f"{self.inner:g} is not below rod.outer = {self.outer:g}; write less"
        pitch, body = worm.size("pitch"), worm.size("length")
        if pitch is not None and self.outer > pitch:
            yield (
                "rod.outer",
                f"{self.outer:g} is above worm.pitch = {pitch:g}, so coils of one side, two "
                f"pitches apart, overlap; write at most {pitch:g}",
            )
        if self.on >= self.every:
            yield (
                "rod.every",
                f"{self.every} coils are too few for blocks of {self.on}; write at least "
                f"{self.on + 1}",
            )
        if pitch is not None and body is not None and body / self.elements > pitch / 4:
            least = int(-(-4 * body // pitch))
            yield (
                "rod.elements",
                f"{self.elements} are too few for {body / pitch:.3g} pitches of coils; write at "
                f"least {least}",
            )
        if list(self.sweep) != sorted(set(self.sweep)):
            yield "rod.sweep", "the numbers do not ascend; write them in order, each once"


class SegmentShapesScene(BodyScene):
    """Shapes of a segment between two coils: three assumed ones and the elastica.

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

    scalars: ClassVar = {
        "shapes": ("1", "names of the shapes; lists below are in this order"),
        "arc_length": ("length", "*l*<sub>s</sub>"),
        "segments": ("count", "*k*<sub>s</sub>"),
        "velocity_per_frequency": ("length", "eq. 32 of Zimmermann et al. over the frequency"),
        "energy_over_stiffness": (
            "curvature", "bending energy over *EI*; unknown for the line, which has kinks",
        ),
        "energy": ("energy", "bending energy"),
        "reaction_over_stiffness": (
            "curvature_squared", "`reaction` over *EI*",
        ),
        "reaction": (
            "force", "wall force *V* across the channel; positive if the wall pushes",
        ),
        "tension_over_stiffness": ("curvature_squared", "`tension` over *EI*"),
        "tension": ("force", "tension *N* along the channel"),
        "curvature_max": ("curvature", "largest curvature"),
        "surface_strain": ("share", "`curvature_max` times half the thickness of the body"),
        "angle_max": ("angle", "largest angle"),
        "rise": ("length", "*d* − *d*<sub>w</sub>"),
        "channel": ("length", "*d*"),
        "body": ("length", "*d*<sub>w</sub>"),
        "bending_stiffness": (
            "bending_stiffness", "*EI*, with *I* = π*d*<sub>w</sub>⁴/64",
        ),
        "exact_shapes": ("1", "names of the exact shapes"),
        "closest_shape": ("1", "for each exact shape, the assumed one with the least distance"),
        "closest_distance": ("length", "largest distance between both shapes"),
        "closest_distance_rms": ("length", "root mean square distance between both shapes"),
        "closest_shape_rod": (
            "1",
            "assumed shape closest to the rod's; unknown if the rod is not bent from wall to wall",
        ),
        "closest_distance_rod": ("length", "largest distance of both; unknown in the same case"),
        "rod_reaches_walls": (
            "1",
            "whether the rod touches the walls within half a coil distance of both coils of the "
            "segment",
        ),
        "rod_arc_lengths": (
            "length", "length of all segments of the block; `arc_length` has the middle one",
        ),
        "rod_stretch": (
            "share",
            "length of the segment less that of the same piece of the body without load",
        ),
        "rod_compression_max": (
            "share",
            "largest shortening of any fibre; at 1 cross sections penetrate each other, and the "
            "rod is refused as crushed (exit code 3)",
        ),
        "rod_force_upper": ("force", "resultant force of the upper wall"),
        "rod_force_lower": ("force", "resultant force of the lower wall"),
        "rod_energy": ("energy", "elastic and magnetic energy of the bent rod"),
        "rod_energy_on_one_wall": (
            "energy",
            "energy of a rod along the wall of the first coil; unknown if it does not stay there",
        ),
        "rod_preferred": ("1", "whether the bent rod has less energy"),
        "assumed_susceptibility": ("1", "`rod.susceptibility`"),
        "assumed_poisson_ratio": ("1", "`rod.poisson_ratio`"),
        "coils_on": ("count", "`rod.on`"),
        "sweep_closest_shape": ("1", "closest assumed shape at each value of `rod.sweep`"),
    } | ASSUMED_COILS  # fmt: skip
    variables: ClassVar = {
        "share": ("share", ("share",), "share of the length of the segment"),
        "x": ("length", ("shape", "share"), "position along the channel"),
        "y": ("length", ("shape", "share"), "height of the centre line"),
        "theta": ("angle", ("shape", "share"), "angle against the channel"),
        "distance_max": (
            "length", ("shape", "other_shape"), "largest distance at the same share",
        ),
        "distance_rms": (
            "length", ("shape", "other_shape"), "root mean square of that distance",
        ),
        "exact": ("count", ("shape",), "1 if computed from forces, else 0"),
        "rod_x": (
            "length", ("node",), "node position along the channel, from the middle of the block",
        ),
        "rod_y": ("length", ("node",), "height of the node"),
        "rod_angle": ("angle", ("node",), "angle of the cross section at the node"),
        "rod_force_upper_at": ("force", ("node",), "force of the upper wall on the node"),
        "rod_force_lower_at": ("force", ("node",), "force of the lower wall on the node"),
        "rod_node_length": ("length", ("node",), "length of rod lumped at the node"),
        "sweep": ("ampere_turns", ("sweep",), "ampere-turns"),
        "sweep_arc_length": ("length", ("sweep",), "length of the segment"),
        "sweep_distance": (
            "length", ("assumed", "sweep"), "largest distance from the assumed shapes",
        ),
    }  # fmt: skip

    kind: Literal["segment-shapes"]
    want: tuple[Literal["segment_shapes"], ...] = entry(
        "`segment_shapes`: centre lines between the walls, distances, the rod at rest", default=()
    )
    exact: Closings = entry(
        "`point_contact`: walls push across the channel and nothing pulls along it; `sleeve`: "
        "the length is free and has the least energy",
        default=("point_contact", "sleeve"),
    )
    degree: int = whole(16, 512, "largest degree of the polynomials", default=256)
    points: int = whole(11, 10001, "number of points of each centre line", default=201)
    rod: RestTable | None = entry(
        "the body at rest in the field of coils; not computed if left out", default=None
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        for word in sorted(set(self.exact)):
            if self.exact.count(word) > 1:
                yield "exact", f'"{word}" is listed twice; write it once'
        if self.rod is not None:
            yield from self.rod.faults(self.worm)
