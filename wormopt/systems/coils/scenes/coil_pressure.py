"""Scenes of kind "coil-pressure": a layer of magnetic fluid at rest at an excited coil."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, Positive, SceneTable, Table, extreme_numbers
from wormopt.systems.coils.scenes.material import faults_of_units

Degree = Annotated[int, Meta(ge=64, le=512, description="a whole number from 64 to 512")]
Resolution = Annotated[float, Meta(ge=1e-10, le=1e-3, description="a number from 1e-10 to 1e-3")]


class FluidTable(Table, frozen=True, kw_only=True):
    """A magnetic fluid.

    Parameters
    ----------
    chi : float
        Susceptibility; with ``saturation``, the initial one.
    density : float
        In kg/m³.
    surface_tension : float
        In N/m.
    saturation : float, optional
        Saturation magnetisation in A/m; magnetisation is linear in the field if left out.
    """

    chi: Positive
    density: Positive = 1200.0
    surface_tension: Positive = 0.03
    saturation: Positive | None = None


class LayerTable(Table, frozen=True, kw_only=True):
    """The tank, a long trough across the plane that is computed, and how full it is.

    Parameters
    ----------
    thickness : float
        Of the layer without field, in m.
    width : float
        Of the tank, in m; the coil is in the middle.
    walls : {"upright", "pinned"}
        Whether the surface meets the walls at a right angle, or at the height without field.
    """

    thickness: Positive
    width: Positive
    walls: Literal["upright", "pinned"] = "upright"


class CoilTable(Table, frozen=True, kw_only=True):
    """The coil, without iron.

    Parameters
    ----------
    ampere_turns : float
        Current times turns, in A.
    inner_radius, outer_radius, length : float
        Of the winding, in m.
    distance : float
        From the bottom of the layer to the nearest point of the coil, in m.
    side : {"below", "above"}
        Where the coil is.
    axis : {"vertical", "along"}
        Direction of its axis: up, or along the width of the tank.
    """

    ampere_turns: NonNegative = 3000.0
    inner_radius: Positive = 5e-3
    outer_radius: Positive = 15e-3
    length: Positive = 20e-3
    distance: Positive = 2e-3
    side: Literal["below", "above"] = "below"
    axis: Literal["vertical", "along"] = "vertical"


class ResolutionTable(Table, frozen=True, kw_only=True):
    """How finely the surface is described.

    Parameters
    ----------
    tolerance : float
        Largest of the last coefficients of its polynomial, over the thickness.
    degree : int
        Largest degree of that polynomial.
    """

    tolerance: Resolution = 1e-7
    degree: Degree = 256


class CoilPressureScene(SceneTable, frozen=True, kw_only=True):
    """Shape and pressure of a layer of magnetic fluid at a coil.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"coil-pressure"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units; the permeability of vacuum is.
    want : tuple of str
        Pictures to draw.
    fluid : FluidTable
        The fluid.
    layer : LayerTable
        The tank.
    coil : CoilTable
        The coil.
    surface : ResolutionTable
        How finely the surface is described.
    gravity : float
        In m/s².
    stated_pressure : float, optional
        Change of pressure that was measured or stated, in Pa.
    """

    kind: Literal["coil-pressure"]
    want: tuple[Literal["coil_pressure"], ...] = ()
    fluid: FluidTable
    layer: LayerTable
    coil: CoilTable = CoilTable()
    surface: ResolutionTable = ResolutionTable()
    gravity: Positive = 9.81
    stated_pressure: Positive | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        coil, layer = self.coil, self.layer
        if coil.inner_radius >= coil.outer_radius:
            yield (
                "coil.inner_radius",
                f"{coil.inner_radius:g} is not below coil.outer_radius = {coil.outer_radius:g}; "
                "the winding lies between them",
            )
        if coil.side == "above" and coil.distance <= layer.thickness:
            yield (
                "coil.distance",
                f"the coil lies inside the fluid: {coil.distance:g} m above the bottom of a layer "
                f"{layer.thickness:g} m thick; write more than layer.thickness",
            )
