"""Scenes of kinds "coil-pressure" and "membrane": magnetic fluid at rest, and its membrane."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.shared.si import SIScene

Resolution = Annotated[float, Meta(ge=1e-10, le=1e-3, description="a number from 1e-10 to 1e-3")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]


class FluidTable(Given):
    """A magnetic fluid."""

    chi: float = positive("1", "susceptibility; with `saturation`, the initial one")
    density: float = positive("density", "density of the fluid", default=1200.0)
    surface_tension: float = positive("surface_tension", "surface tension", default=0.03)
    saturation: float | None = positive(
        "magnetic_field",
        "saturation magnetisation, for Langevin's law; if left out, magnetisation is linear in "
        "the field",
        default=None,
    )


class LayerTable(Given):
    """The tank, a long trough across the computed plane, and its filling."""

    thickness: float = positive("length", "thickness of the layer without field")
    width: float = positive("length", "width of the tank; the coil is in its middle")
    walls: Literal["upright", "pinned"] = entry(
        "condition at the walls: a right angle, or the height without field", default="upright"
    )


class CoilTable(Given):
    """The coil, without iron."""

    ampere_turns: float = number("current", "current times turns", least=0, default=3000.0)
    inner_radius: float = positive("length", "inner radius of the winding", default=5e-3)
    outer_radius: float = positive("length", "outer radius of the winding", default=15e-3)
    length: float = positive("length", "length of the winding", default=20e-3)
    distance: float = positive(
        "length",
        "distance from the bottom of the layer to the nearest point of the coil; above "
        "`layer.thickness` for a coil above",
        default=2e-3,
    )
    side: Literal["below", "above"] = entry("side of the layer with the coil", default="below")
    axis: Literal["vertical", "along"] = entry(
        "direction of the coil's axis: up, or along the width of the tank", default="vertical"
    )


class ResolutionTable(Given):
    """Resolution of the surface."""

    tolerance: float = number(
        "share",
        "largest of the polynomial's last coefficients, over the thickness",
        least=1e-10,
        most=0.001,
        default=1e-7,
    )
    degree: int = whole(64, 512, "largest degree of the polynomial", default=256)


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
    want: tuple[Literal["coil_pressure"], ...] = entry(
        "`coil_pressure`: figure 25 of Zimmermann et al.; no induction in the winding", default=()
    )
    fluid: FluidTable = entry("the fluid")
    layer: LayerTable = entry("the tank and its layer")
    coil: CoilTable = entry("the coil", default=CoilTable())
    surface: ResolutionTable = entry("resolution of the surface", default=ResolutionTable())
    gravity: float = positive("acceleration", "acceleration of gravity", default=9.80665)
    stated_pressure: float | None = positive(
        "stress",
        "stated or measured change of pressure for comparison; none if left out",
        default=None,
    )

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

    radius: float = positive("length", "radius of the tube", default=4e-3)
    youngs_modulus: float = positive("stress", "Young's modulus of the membrane", default=5e5)
    diffusivity: float = positive(
        "diffusivity", "diffusivity of the carrier liquid in the membrane", default=1e-11
    )
    concentration_drop: float = positive(
        "density",
        "difference of that liquid's density from the inner to the outer face",
        default=0.15,
    )
    stress_max: float = positive("stress", "hoop stress at the full pressure", default=5e4)
    strain_max: float = positive("share", "strain at the full pressure", default=0.1)


class FillingTable(Given):
    """The fluid in the membrane."""

    pressure: float = positive("stress", "magnetic pressure, above the pressure outside")
    density: float = positive("density", "density of the fluid", default=1200.0)


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
    want: tuple[Literal["membrane"], ...] = entry(
        "`membrane`: strain over loss, and remaining pressure over thickness", default=()
    )
    membrane: TubeTable = entry("the membrane", default=TubeTable())
    fluid: FillingTable = entry("the fluid")
    lifetime: float = positive("time", "required lifetime of the fluid")
    loss_max: float = number(
        "share", "largest share of fluid lost in that time", above=0, below=1, default=0.1
    )
    thickness: Pair = entry(
        "least and largest thickness that can be made, below `membrane.radius`",
        quantity="length",
        default=(2e-5, 2e-3),
    )
    contact_strain: float = number(
        "share", "strain at which the worm touches the ground or its channel", least=0, default=0.02
    )
    points: int = whole(3, 1000, "number of points of the front", default=41)

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
