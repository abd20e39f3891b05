"""Scenes of kinds "coil-pressure" and "membrane": magnetic fluid at rest, and its membrane."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, Pair, Positive, wrong_order
from wormopt.study.given import Given, says
from wormopt.systems.coils.scenes.material import SIScene

Degree = Annotated[int, Meta(ge=64, le=512, description="a whole number from 64 to 512")]
Resolution = Annotated[float, Meta(ge=1e-10, le=1e-3, description="a number from 1e-10 to 1e-3")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Count = Annotated[int, Meta(ge=3, le=1000, description="a whole number from 3 to 1000")]


class FluidTable(Given):
    """A magnetic fluid."""

    chi: Annotated[Positive, says("1", "susceptibility; with `saturation`, the initial one")]
    density: Annotated[Positive, says("density", "density of the fluid")] = 1200.0
    surface_tension: Annotated[Positive, says("surface_tension", "surface tension")] = 0.03
    saturation: Annotated[
        Positive | None,
        says(
            "magnetic_field",
            "saturation magnetisation, for Langevin's law; if left out, magnetisation is linear in "
            "the field",
        ),
    ] = None


class LayerTable(Given):
    """The tank, a long trough across the computed plane, and its filling."""

    thickness: Annotated[Positive, says("length", "thickness of the layer without field")]
    width: Annotated[Positive, says("length", "width of the tank; the coil is in its middle")]
    walls: Annotated[
        Literal["upright", "pinned"],
        says("", "condition at the walls: a right angle, or the height without field"),
    ] = "upright"


class CoilTable(Given):
    """The coil, without iron."""

    ampere_turns: Annotated[NonNegative, says("current", "current times turns")] = 3000.0
    inner_radius: Annotated[Positive, says("length", "inner radius of the winding")] = 5e-3
    outer_radius: Annotated[Positive, says("length", "outer radius of the winding")] = 15e-3
    length: Annotated[Positive, says("length", "length of the winding")] = 20e-3
    distance: Annotated[
        Positive,
        says(
            "length",
            "distance from the bottom of the layer to the nearest point of the coil; above "
            "`layer.thickness` for a coil above",
        ),
    ] = 2e-3
    side: Annotated[Literal["below", "above"], says("", "side of the layer with the coil")] = (
        "below"
    )
    axis: Annotated[
        Literal["vertical", "along"],
        says("", "direction of the coil's axis: up, or along the width of the tank"),
    ] = "vertical"


class ResolutionTable(Given):
    """Resolution of the surface."""

    tolerance: Annotated[
        Resolution,
        says("share", "largest of the polynomial's last coefficients, over the thickness"),
    ] = 1e-7
    degree: Annotated[Degree, says("count", "largest degree of the polynomial")] = 256


class CoilPressureScene(SIScene):
    """Shape and pressure of a layer of magnetic fluid at a coil.

    The layer rests in a tank over or under one coil. The scene computes the shape of its surface,
    the pressure on the bottom and inside, and the field. The current is raised from 0. If no
    surface rests at the full current, the result states the current at which rest ends (exit
    code 3). Theory and assumptions: [theory-hydrostatics.md](../theory-hydrostatics.md). Only
    `units = "SI"`.

    The trust report has `degree` and `tail` (last coefficients), and `defect` (error of the balance
    between the points, over the thickness). It has `volume_error`, `force_imbalance` (of the fluid,
    over its weight), `field_error`, and the `accepted` values of these. It also has `growth_rate`
    (of the slowest deviation; must be below 0), `demagnetisation`, and `warnings`.
    """

    scalars: ClassVar = {
        "pressure_max": ("stress", "highest pressure on the bottom"),
        "pressure_change_max": ("stress", "`pressure_max` less `pressure_without_field`"),
        "pressure_without_field": ("stress", "pressure on the bottom without field"),
        "surface_rise_max": ("length", "highest point, relative to the layer without field"),
        "surface_drop_max": ("length", "lowest point, relative to the layer without field"),
        "slope_max": ("1", "largest \\|*h*′\\|"),
        "field_bottom_max": ("magnetic_field", "largest *H* at the bottom"),
        "field_surface_max": ("magnetic_field", "largest *H* at the surface"),
        "induction_bottom_max": (
            "induction",
            "largest μ<sub>0</sub>(*H* + *M*) at the bottom",
        ),
        "magnetic_force": (
            "force_per_length",
            "upward force of the field on the fluid, per depth of the trough",
        ),
        "capillary_length": ("length", "√(γ/ρ*g*)"),
        "volume_error": ("share", "relative difference of the volume by quadrature to the layer's"),
        "demagnetisation": ("share", "estimate of the neglected effect; a warning above 0.1"),
        "ampere_turns": ("current", "ampere-turns at which the shown surface rests"),
        "stated_pressure": ("stress", "`stated_pressure` of the scene"),
        "pressure_over_stated": ("share", "`pressure_change_max` over `stated_pressure`"),
        "field_for_stated": ("magnetic_field", "field with this pressure in the fluid"),
        "induction_for_stated": ("induction", "μ<sub>0</sub> times this field"),
    }
    variables: ClassVar = {
        "x": ("length", ("x",), "position along the bottom"),
        "surface": ("length", ("x",), "height of the surface"),
        "pressure": ("stress", ("x",), "pressure on the bottom"),
        "field_bottom": ("magnetic_field", ("x",), "H at the bottom"),
        "field_surface": ("magnetic_field", ("x",), "H at the surface"),
        "share": ("share", ("share",), "height over that of the surface"),
        "inside_x": ("length", ("inside_x",), "position along the bottom"),
        "inside_z": ("length", ("share", "inside_x"), "height"),
        "inside_pressure": ("stress", ("share", "inside_x"), "pressure in the fluid"),
        "map_x": ("length", ("map_x",), "position along the bottom"),
        "map_z": ("length", ("map_z",), "height"),
        # around coil and fluid; not a number in the winding
        "induction_x": ("induction", ("map_z", "map_x"), "induction along x"),
        "induction_z": ("induction", ("map_z", "map_x"), "induction along z"),
        "branch_current": ("current", ("branch",), "current of the branch"),
        "branch_highest": ("length", ("branch",), "highest point of the surface"),
        "branch_lowest": ("length", ("branch",), "lowest point of the surface"),
    }

    kind: Literal["coil-pressure"]
    want: Annotated[
        tuple[Literal["coil_pressure"], ...],
        says("", "`coil_pressure`: figure 25 of Zimmermann et al.; no induction in the winding"),
    ] = ()
    fluid: Annotated[FluidTable, says("", "the fluid")]
    layer: Annotated[LayerTable, says("", "the tank and its layer")]
    coil: Annotated[CoilTable, says("", "the coil")] = CoilTable()
    surface: Annotated[ResolutionTable, says("", "resolution of the surface")] = ResolutionTable()
    gravity: Annotated[Positive, says("acceleration", "acceleration of gravity")] = 9.80665
    stated_pressure: Annotated[
        Positive | None,
        says("stress", "stated or measured change of pressure for comparison; none if left out"),
    ] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        coil, layer = self.coil, self.layer
        if coil.inner_radius >= coil.outer_radius:
            yield (
                "coil.inner_radius",
                f"{coil.inner_radius:g} is not below coil.outer_radius = {coil.outer_radius:g}; "
                "write a radius below coil.outer_radius",
            )
        if coil.side == "above" and coil.distance <= layer.thickness:
            yield (
                "coil.distance",
                f"the coil lies inside the fluid, {coil.distance:g} m above the bottom of a layer "
                f"of {layer.thickness:g} m; write more than layer.thickness",
            )


class TubeTable(Given):
    """The membrane, a tube."""

    radius: Annotated[Positive, says("length", "radius of the tube")] = 4e-3
    youngs_modulus: Annotated[Positive, says("stress", "Young's modulus of the membrane")] = 5e5
    diffusivity: Annotated[
        Positive, says("diffusivity", "diffusivity of the carrier liquid in the membrane")
    ] = 1e-11
    concentration_drop: Annotated[
        Positive,
        says("density", "difference of that liquid's density from the inner to the outer face"),
    ] = 0.15
    stress_max: Annotated[Positive, says("stress", "hoop stress at the full pressure")] = 5e4
    strain_max: Annotated[Positive, says("share", "strain at the full pressure")] = 0.1


class FillingTable(Given):
    """The fluid in the membrane."""

    pressure: Annotated[Positive, says("stress", "magnetic pressure, above the pressure outside")]
    density: Annotated[Positive, says("density", "density of the fluid")] = 1200.0


class MembraneScene(SIScene):
    """The best thickness of a membrane, a compromise between actuation and loss of fluid.

    The skin of a worm filled with magnetic fluid should be thin for large strain and force, but
    thick to keep the fluid. The scene computes the best thickness within limits, and the Pareto
    front of strain and loss. Theory:
    [theory-hydrostatics.md](../theory-hydrostatics.md#2-the-membrane). Only
    `units = "SI"`.

    The trust report names its `assumptions`, among them that the tube's ends are free. It has
    `violation` of limits, `recheck_error` (against a closed form), `accepted`, and `warnings`:
    strains that are not small, a wall above a tenth of the radius, no pressure left to push. The
    exit code is 3 if no thickness meets all limits; the message gives the need of each limit.
    """

    scalars: ClassVar = {
        "thickness_best": ("length", "thickness with the largest strain within all limits"),
        "limited_by": (
            "1",
            "limit that determines it: `loss`, `stress`, `strain`, or `thickness` if the thinnest "
            "allowed meets all limits",
        ),
        "thickness_for_loss": ("length", "least thickness for `loss_max` alone"),
        "thickness_for_stress": ("length", "least thickness for `membrane.stress_max` alone"),
        "thickness_for_strain": ("length", "least thickness for `membrane.strain_max` alone"),
        "strain": ("share", "strain at the best thickness"),
        "stress": ("stress", "hoop stress at the best thickness"),
        "loss_share": ("share", "share of fluid lost within the lifetime at the best thickness"),
        "loss_rate": ("mass_rate_per_length", "initial rate of loss"),
        "contact_pressure": ("stress", "pressure left to push against the channel"),
        "bending_stiffness": ("bending_stiffness", "bending stiffness of the tube as a beam"),
        "lifetime": ("time", "`lifetime` of the scene"),
        "loss_max": ("share", "`loss_max` of the scene"),
        "stress_max": ("stress", "`membrane.stress_max`"),
        "strain_max": ("share", "`membrane.strain_max`"),
    }
    variables: ClassVar = {
        "front_thickness": ("length", ("point",), "thickness"),
        "front_loss": ("share", ("point",), "share of the fluid lost within the lifetime"),
        "front_strain": ("share", ("point",), "strain"),
        "front_contact_pressure": ("stress", ("point",), "pressure on the ground"),
        "front_within": ("count", ("point",), "1 if all limits hold, else 0"),
    }

    kind: Literal["membrane"]
    want: Annotated[
        tuple[Literal["membrane"], ...],
        says("", "`membrane`: strain over loss, and remaining pressure over thickness"),
    ] = ()
    membrane: Annotated[TubeTable, says("", "the membrane")] = TubeTable()
    fluid: Annotated[FillingTable, says("", "the fluid")]
    lifetime: Annotated[Positive, says("time", "required lifetime of the fluid")]
    loss_max: Annotated[Share, says("share", "largest share of fluid lost in that time")] = 0.1
    thickness: Annotated[
        Pair,
        says("length", "least and largest thickness that can be made, below `membrane.radius`"),
    ] = (2e-5, 2e-3)
    contact_strain: Annotated[
        NonNegative, says("share", "strain at which the worm touches the ground or its channel")
    ] = 0.02
    points: Annotated[Count, says("count", "number of points of the front")] = 41

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("thickness", self.thickness, may_be_equal=False)
        if self.thickness[1] >= self.membrane.radius:
            yield (
                "thickness[1]",
                f"{self.thickness[1]:g} m is no thin wall of a tube of radius "
                f"{self.membrane.radius:g} m; write less than membrane.radius",
            )
