"""Scenes of kind "peristaltic-segment": one membrane segment, its coil and its tube."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.coils import SIScene

Part = Annotated[float, Meta(ge=0, le=1, description="a number from 0 to 1")]
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, 1 at most")]
Angle = Annotated[
    float, Meta(gt=0, lt=1.5707, description="a number above 0, below 1.5707 (90 deg)")
]
Count = Annotated[int, Meta(ge=11, le=1000, description="a whole number from 11 to 1000")]


class SegmentTable(Given):
    """The segment, a thin tube of rubber closed by rings."""

    length: float = positive("length", "unstressed length *L*")
    radius: float = positive("length", "unstressed radius *R*, also of the rings")
    wall: float = positive("length", "thickness *h* of the wall, small against the radius")
    shear_modulus: float = positive("stress", "shear modulus *G* of the rubber, *E*/3")
    neo_hookean: float = number(
        "share",
        "*a* of the Mooney-Rivlin energy *a I*<sub>1</sub> + (1 − *a*) *I*<sub>2</sub>",
        least=0,
        most=1,
        default=1.0,
    )

    def faults_in(self, where: str, tube: float) -> Iterator[Fault]:
        """Yield a fault, with the key `where`, unless the segment fits into a tube of a radius."""
        if tube <= self.radius:
            yield (
                where,
                f"a segment of radius {self.radius:g} m does not fit into a tube of {tube:g} m; "
                f"write more than {self.radius:g}",
            )


class IdealCoilTable(Given):
    """An ideal coil: a uniform field over a share of the segment, none beyond."""

    pressure: float = number(
        "stress", "magnetic pressure μ<sub>0</sub>χ*H*²/2 in the fluid", least=0
    )
    share: float = number(
        "share", "share of the segment's length in the field", above=0, most=1, default=0.5
    )


class FluidTable(Given):
    """The magnetic fluid in the segment."""

    density: float = positive("density", "density of the fluid", default=1200.0)
    chi: float = positive("1", "susceptibility", default=0.35)


class TubeTable(Given):
    """A rigid tube around the segment."""

    radius: float = positive("length", "inner radius; above `segment.radius`")
    friction: float = number("1", "Coulomb coefficient on the membrane", least=0, default=0.3)


class WindingTable(Given):
    """A real coil around the middle of the segment, for comparison."""

    ampere_turns: float = positive("current", "current times turns")
    inner_radius: float = positive("length", "inner radius; above segment and tube")
    outer_radius: float = positive("length", "outer radius of the winding")
    length: float = positive("length", "length along the segment")


class InflationTable(Given):
    """A given inner pressure, for segments that share their fluid or have a pump."""

    pressure: float = positive("stress", "pressure, up to the limit of inflation")
    fibre_angle: float | None = number(
        "angle",
        "angle of inextensible fibres to the axis; no fibres if left out",
        above=0,
        below=1.5707,
        default=None,
    )
    fill: float | None = number(
        "share",
        "volume of a sealed segment over the largest with these fibres; needs `fibre_angle`",
        above=0,
        most=1,
        default=None,
    )


class SegmentScene(SIScene):
    """One segment of a peristaltic worm: strokes, limits, and hold in a tube.

    The segment is a sealed rubber tube full of magnetic fluid, which a coil shortens. The scene
    computes its stroke without load, against a load, and up to the wall of a tube. It computes the
    normal force on the wall, the load that this force holds, and whether such segments can move.
    A real coil is compared with the ideal one. A given pressure is applied to a segment that is
    not sealed: as a cylinder, a true membrane, and with fibres. Theory and assumptions:
    [theory-peristaltic.md](../theory-peristaltic.md#1-the-segment). Only `units = "SI"`.

    The trust report names its `assumptions`. It checks stretches and wall force against the
    energy, and the true membrane by its first integral. `warnings` state why a segment does not
    move and which values suffice, and whether it is too soft for the weight of its fluid.
    """

    scalars: ClassVar = {
        "stroke": ("share", "free stroke: shortening by the coil over the length"),
        "stroke_loaded": ("share", "stroke against the load both ways; 0 if the coil is too weak"),
        "swelling": ("length", "growth of the radius over the free stroke"),
        "moves": ("1", "whether it fills the tube, holds the load and pushes itself forward"),
        "normal_force": ("force", "normal force on the tube wall; 0 if it does not reach it"),
        "holding": ("force", "friction limit by this normal force"),
        "holding_loaded": ("force", "the same while the load pulls the ends apart"),
        "stretch": ("share", "length over unstressed length, in the coil"),
        "stretch_extended": ("share", "the same, extended without field against the load"),
        "stretch_loaded": ("share", "the same, shortened in the coil against the load"),
        "stretch_deepest": ("share", "least stretch at this pressure with the best coil"),
        "loading": ("1", "κ = *pR*/(*Gh*) of the coil's pressure"),
        "coil_pull": ("force", "pull of the coil at the unstressed length"),
        "barrel_radius": ("length", "largest radius between rings for a parabolic meridian"),
        "weight": ("force", "weight of the fluid"),
        "head": ("stress", "hydrostatic pressure of the fluid over the segment's width"),
        "drag": ("force", "friction of one relaxed segment on the tube, by its weight"),
        "gap": ("length", "distance between the unstressed segment and the wall"),
        "stretch_contact": ("share", "stretch at which it fills the tube"),
        "surplus": ("force", "axial pull carried by the wall; negative if it does not touch"),
        "return_force": ("force", "push of the rubber on its ends, from contact with the wall"),
        "pressure_to_wall": ("stress", "magnetic pressure at which it begins to touch"),
        "modulus_to_wall": ("stress", "shear modulus at which this pressure just reaches the wall"),
        "winding_pressure": ("stress", "magnetic pressure in the middle of the real coil"),
        "winding_share": ("share", "share of the ideal coil that pulls like the real one"),
        "winding_stretch": ("share", "stretch in the real coil"),
        "inflated_hoop": ("share", "radius over unstressed radius of a cylinder at the pressure"),
        "inflated_stretch": ("share", "length over unstressed length of that cylinder"),
        "pressure_max": ("stress", "limit of inflation, where the cylinder becomes unstable"),
        "membrane_hoop": ("share", "radius in the middle of the membrane over that of the rings"),
        "membrane_stretch": ("share", "length over unstressed length of the membrane"),
        "membrane_volume": ("share", "volume over unstressed volume of the membrane"),
        "fibre_stretch": ("share", "length over unstressed length with fibres"),
        "fibre_angle": ("angle", "angle of the fibres at the pressure"),
        "fill_angle_low": ("angle", "least angle of fibres around a sealed segment"),
        "fill_angle_high": ("angle", "largest angle of fibres around a sealed segment"),
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
        "field_place": ("length", ("field_place",), "axial distance from the coil's middle"),
        "field_pressure": ("stress", ("field_place",), "magnetic pressure of the real coil"),
        "membrane_place": ("length", ("membrane_point",), "distance from the membrane's middle"),
        "membrane_radius": ("length", ("membrane_point",), "radius of the membrane"),
    }

    kind: Literal["peristaltic-segment"]
    want: tuple[Literal["segment", "stroke"], ...] = entry(
        "`segment`: shapes in coil and tube; `stroke`: stroke over pressure, and the forces",
        default=(),
    )
    segment: SegmentTable = entry("the segment")
    coil: IdealCoilTable = entry("the coil")
    fluid: FluidTable = entry("the fluid", default=FluidTable())
    load: float = number(
        "force", "drag on the ends, which the segment must overcome and hold", least=0, default=0.0
    )
    tube: TubeTable | None = entry("the tube; none if left out", default=None)
    winding: WindingTable | None = entry("the real coil; none if left out", default=None)
    inflation: InflationTable | None = entry("a given pressure; none if left out", default=None)
    stretches: Pair = entry(
        "range of stretches in the plot of forces",
        quantity="share",
        default=(
            0.85,
            1.1,
        ),
    )
    points: int = whole(11, 1000, "number of points of the curves", default=101)
    gravity: float = positive("acceleration", "acceleration of gravity", default=GRAVITY)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("stretches", self.stretches, may_be_equal=False)
        segment, tube, winding, inflation = self.segment, self.tube, self.winding, self.inflation
        if segment.wall >= segment.radius / 2:
            yield (
                "segment.wall",
                f"{segment.wall:g} m is not thin for a radius of {segment.radius:g} m; write "
                f"less than {segment.radius / 2:g}",
            )
        if tube:
            yield from segment.faults_in("tube.radius", tube.radius)
        outside = max(segment.radius, tube.radius if tube else 0.0)
        if winding and winding.inner_radius <= outside:
            yield (
                "winding.inner_radius",
                f"{winding.inner_radius:g} m is not outside segment and tube; write more than "
                f"{outside:g}",
            )
        if winding and winding.outer_radius <= winding.inner_radius:
            yield (
                "winding.outer_radius",
                f"{winding.outer_radius:g} m is not above winding.inner_radius; write more than "
                f"{winding.inner_radius:g}",
            )
        if inflation and inflation.fill is not None and inflation.fibre_angle is None:
            yield "inflation.fill", "needs fibres; write inflation.fibre_angle"
