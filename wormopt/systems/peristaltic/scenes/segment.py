"""Scenes of kind "peristaltic-segment": one membrane segment, its coil and its tube."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.scene.types import NonNegative, Pair, Positive, Table, says, wrong_order
from wormopt.systems.coils import SIScene

Part = Annotated[float, Meta(ge=0, le=1, description="a number from 0 to 1")]
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, 1 at most")]
Angle = Annotated[
    float, Meta(gt=0, lt=1.5707, description="a number above 0, below 1.5707 (90 deg)")
]
Count = Annotated[int, Meta(ge=11, le=1000, description="a whole number from 11 to 1000")]


class SegmentTable(Table, frozen=True, kw_only=True):
    """The segment, a thin tube of rubber closed by rings."""

    length: Annotated[Positive, says("length", "*L* of a segment, unstressed")]
    radius: Annotated[Positive, says("length", "*R* of a segment, unstressed, and of its rings")]
    wall: Annotated[Positive, says("length", "*h* of the rubber, small against the radius")]
    shear_modulus: Annotated[Positive, says("stress", "*G* of the rubber, *E*/3")]
    neo_hookean: Annotated[
        Part, says("share", "*a* of Mooney's energy *a I*<sub>1</sub> + (1 − *a*) *I*<sub>2</sub>")
    ] = 1.0

    def faults_in(self, where: str, tube: float) -> Iterator[Fault]:
        """Yield a fault unless it fits into a tube of a radius, the key `where`."""
        if tube <= self.radius:
            yield (
                where,
                f"a segment of radius {self.radius:g} m does not fit into a tube of {tube:g} m; "
                f"write more than {self.radius:g}",
            )


class IdealCoilTable(Table, frozen=True, kw_only=True):
    """The coil as the theory has it: an even field over a share of the segment, none beyond."""

    pressure: Annotated[
        NonNegative, says("stress", "magnetic pressure μ<sub>0</sub>χ*H*²/2 in the fluid")
    ]
    share: Annotated[Share, says("share", "of the segment's length, that lies in the field")] = 0.5


class FluidTable(Table, frozen=True, kw_only=True):
    """The magnetic fluid in it."""

    density: Annotated[Positive, says("density", "of the fluid")] = 1200.0
    chi: Annotated[Positive, says("1", "susceptibility")] = 0.35


class TubeTable(Table, frozen=True, kw_only=True):
    """A rigid tube that the segment swells against."""

    radius: Annotated[Positive, says("length", "of its bore; above `segment.radius`")]
    friction: Annotated[NonNegative, says("1", "Coulomb's coefficient on the membrane")] = 0.3


class WindingTable(Table, frozen=True, kw_only=True):
    """A real coil round the middle of the segment, to compare with."""

    ampere_turns: Annotated[Positive, says("current", "current times turns")]
    inner_radius: Annotated[Positive, says("length", "above that of segment and tube")]
    outer_radius: Annotated[Positive, says("length", "of the winding")]
    length: Annotated[Positive, says("length", "along the segment")]


class InflationTable(Table, frozen=True, kw_only=True):
    """A pressure inside that is given: segments that share their fluid, or a pump."""

    pressure: Annotated[Positive, says("stress", "up to the limit of inflation")]
    fibre_angle: Annotated[
        Angle | None,
        says("angle", "of fibres to the axis that do not stretch; none if left out"),
    ] = None
    fill: Annotated[
        Share | None,
        says(
            "share",
            "volume of a sealed segment over the largest between the fibres; needs `fibre_angle`",
        ),
    ] = None


class SegmentScene(SIScene, frozen=True, kw_only=True):
    """One segment of a peristaltic worm: its strokes, its limits, its hold on a tube.

    A sealed tube of rubber full of magnetic fluid, which a coil pulls together. How far it goes
    freely, against a load and until it fills a tube; how hard it then presses on the wall and what
    that holds; whether such segments can move at all; what a real coil does of it; and what a given
    pressure does to a segment that is not sealed: cylinder, true membrane, fibres. Theory and
    assumptions: [theory-peristaltic.md](../theory-peristaltic.md#1-the-segment). Only
    `units = "SI"`.

    The trust report names its `assumptions` and checks stretches and wall force against the
    energy, the true membrane by its first integral. `warnings` say why a segment does not move,
    with the numbers that would do, and where it is too soft for the weight of its fluid.
    """

    scalars: ClassVar = {
        "stroke": ("share", "free: shortening by the coil over the length"),
        "stroke_loaded": ("share", "against the load both ways; 0 if the coil is too weak"),
        "swelling": ("length", "growth of the radius on the free stroke"),
        "moves": ("1", "whether it fills the tube, holds the load and pushes itself on"),
        "normal_force": ("force", "on the wall of the tube; 0 if it does not reach it"),
        "holding": ("force", "friction that this can hold"),
        "holding_loaded": ("force", "the same while the load pulls the ends apart"),
        "stretch": ("share", "length over unstressed length, by the coil"),
        "stretch_extended": ("share", "the same, lengthening without field against the load"),
        "stretch_loaded": ("share", "the same, shortening in the coil against the load"),
        "stretch_deepest": ("share", "that this pressure reaches with the best coil"),
        "loading": ("1", "κ = *pR*/(*Gh*) of the coil's pressure"),
        "coil_pull": ("force", "of the coil at the unstressed length"),
        "barrel_radius": ("length", "largest, between rings and with a parabola as meridian"),
        "weight": ("force", "of the fluid"),
        "head": ("stress", "pressure of the fluid's weight over the segment's width"),
        "drag": ("force", "friction of one relaxed segment on the tube, by its weight"),
        "gap": ("length", "between the unstressed segment and the wall"),
        "stretch_contact": ("share", "at which it fills the tube"),
        "surplus": ("force", "pull along the axis that the wall takes; below 0 it is off the wall"),
        "return_force": ("force", "by which the rubber pushes its ends apart from the wall on"),
        "pressure_to_wall": ("stress", "at which it begins to touch"),
        "modulus_to_wall": ("stress", "shear modulus at which this pressure just reaches the wall"),
        "winding_pressure": ("stress", "magnetic pressure in the middle of the real coil"),
        "winding_share": ("share", "of the ideal coil that pulls like the real one"),
        "winding_stretch": ("share", "by the real coil"),
        "inflated_hoop": ("share", "radius over unstressed radius, of a cylinder at the pressure"),
        "inflated_stretch": ("share", "length over unstressed length, likewise"),
        "pressure_max": ("stress", "limit of inflation, where the cylinder swells by itself"),
        "membrane_hoop": ("share", "radius over that of the rings in the middle of the membrane"),
        "membrane_stretch": ("share", "length over unstressed length of the membrane"),
        "membrane_volume": ("share", "its volume over that unstressed"),
        "fibre_stretch": ("share", "length over unstressed length between fibres"),
        "fibre_angle": ("angle", "of the fibres at the pressure"),
        "fill_angle_low": ("angle", "of fibres round a sealed segment, least"),
        "fill_angle_high": ("angle", "the same, largest"),
    }  # fmt: skip
    variables: ClassVar = {
        "pressure": ("stress", ("pressure",), "magnetic pressure of the coil"),
        "free_stroke": ("share", ("pressure",), "stroke without load"),
        "loaded_stroke": ("share", ("pressure",), "stroke against the load"),
        "deepest_stroke": ("share", ("pressure",), "stroke with the best coil"),
        "axial_stretch": ("share", ("axial_stretch",), "length over unstressed length"),
        "return_forces": ("force", ("axial_stretch",), "push of the rubber on the ends"),
        "coil_pulls": ("force", ("axial_stretch",), "pull of the ideal coil"),
        "winding_pulls": ("force", ("axial_stretch",), "pull of the real coil"),
        "field_place": ("length", ("field_place",), "place on the axis from the coil's middle"),
        "field_pressure": ("stress", ("field_place",), "magnetic pressure of the real coil"),
        "membrane_place": ("length", ("membrane_point",), "place from the middle of the membrane"),
        "membrane_radius": ("length", ("membrane_point",), "its radius there"),
    }

    kind: Literal["peristaltic-segment"]
    want: Annotated[
        tuple[Literal["segment", "stroke"], ...],
        says(
            "", "`segment`: its shapes, in coil and tube; `stroke`: over pressure, and the forces"
        ),
    ] = ()
    segment: Annotated[SegmentTable, says("", "the segment")]
    coil: Annotated[IdealCoilTable, says("", "the coil")]
    fluid: Annotated[FluidTable, says("", "the fluid")] = FluidTable()
    load: Annotated[
        NonNegative, says("force", "drag on the ends that the segment works against, and holds")
    ] = 0.0
    tube: Annotated[TubeTable | None, says("", "the tube; none if left out")] = None
    winding: Annotated[WindingTable | None, says("", "the real coil; none if left out")] = None
    inflation: Annotated[
        InflationTable | None, says("", "a pressure that is given; none if left out")
    ] = None
    stretches: Annotated[Pair, says("share", "stretches over which forces are drawn")] = (0.85, 1.1)
    points: Annotated[Count, says("count", "of the curves")] = 101
    gravity: Annotated[Positive, says("acceleration", "of the fall")] = GRAVITY

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("stretches", self.stretches, may_be_equal=False)
        segment, tube, winding, inflation = self.segment, self.tube, self.winding, self.inflation
        if segment.wall >= segment.radius / 2:
            yield (
                "segment.wall",
                f"{segment.wall:g} m is no thin wall of a radius of {segment.radius:g} m; write "
                f"less than {segment.radius / 2:g}",
            )
        if tube:
            yield from segment.faults_in("tube.radius", tube.radius)
        outside = max(segment.radius, tube.radius if tube else 0.0)
        if winding and winding.inner_radius <= outside:
            yield (
                "winding.inner_radius",
                f"{winding.inner_radius:g} m is not outside of segment and tube; write more than "
                f"{outside:g}",
            )
        if winding and winding.outer_radius <= winding.inner_radius:
            yield (
                "winding.outer_radius",
                f"{winding.outer_radius:g} m is not above winding.inner_radius; write more than "
                f"{winding.inner_radius:g}",
            )
        if inflation and inflation.fill is not None and inflation.fibre_angle is None:
            yield "inflation.fill", "is of a segment with fibres; write inflation.fibre_angle"
