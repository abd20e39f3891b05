"""Scenes of kind "membrane": how thick the skin of a worm filled with magnetic fluid should be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    NonNegative,
    Pair,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_order,
)
from wormopt.systems.coils.scenes.material import faults_of_units

Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Count = Annotated[int, Meta(ge=3, le=1000, description="a whole number from 3 to 1000")]


class TubeTable(Table, frozen=True, kw_only=True):
    """The membrane, a tube.

    Parameters
    ----------
    radius : float
        In m.
    youngs_modulus : float
        In Pa.
    diffusivity : float
        Of the carrier liquid in the membrane, in m²/s.
    concentration_drop : float
        Of that liquid, from the inner to the outer face of the membrane, in kg/m³.
    stress_max, strain_max : float
        Largest hoop stress in Pa, and largest strain, at the full pressure.
    """

    radius: Positive = 4e-3
    youngs_modulus: Positive = 5e5
    diffusivity: Positive = 1e-11
    concentration_drop: Positive = 0.15
    stress_max: Positive = 5e4
    strain_max: Positive = 0.1


class FillingTable(Table, frozen=True, kw_only=True):
    """The fluid in it.

    Parameters
    ----------
    pressure : float
        By the magnetic field, above that outside, in Pa.
    density : float
        In kg/m³.
    """

    pressure: Positive
    density: Positive = 1200.0


class MembraneScene(SceneTable, frozen=True, kw_only=True):
    """The best thickness of a membrane, between actuation and loss of fluid.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"membrane"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    membrane : TubeTable
        The membrane.
    fluid : FillingTable
        The fluid.
    lifetime : float
        How long the fluid must last, in s.
    loss_max : float
        Largest share of it that may be lost within that time.
    thickness : tuple of float
        Smallest and largest thickness that can be made, in m.
    contact_strain : float
        Strain at which the tube touches the ground or the channel.
    points : int
        Points of the front.
    """

    kind: Literal["membrane"]
    want: tuple[Literal["membrane"], ...] = ()
    membrane: TubeTable = TubeTable()
    fluid: FillingTable
    lifetime: Positive
    loss_max: Share = 0.1
    thickness: Pair = (2e-5, 2e-3)
    contact_strain: NonNegative = 0.02
    points: Count = 41

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        yield from wrong_order("thickness", self.thickness, may_be_equal=False)
        if self.thickness[1] >= self.membrane.radius:
            yield (
                "thickness[1]",
                f"{self.thickness[1]:g} m is no thin wall of a tube of radius "
                f"{self.membrane.radius:g} m; write less than membrane.radius",
            )
