"""Scenes of kind "material": an elastic composite with a magnetic fluid in it, in a field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_order,
)

Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]
Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]

_GIVEN, _MEASURED = ("mu_r", "lame_eta"), ("u0", "youngs_modulus_eff")


class MaterialTable(Table, frozen=True, kw_only=True):
    """A material, by what it is or by what was measured in the field.

    Parameters
    ----------
    field : float
        Field H in A/m.
    mu_r, lame_eta : float, optional
        Relative permeability of the unstrained material, second Lamé coefficient in Pa.
    u0, youngs_modulus_eff : float, optional
        Strain by the field alone and Young's modulus in the field (Pa), instead of the two above.
    lame_lambda : float, optional
        First Lamé coefficient in Pa.
    """

    field: NonNegative
    mu_r: Permeability | None = None
    lame_eta: Positive | None = None
    u0: Positive | None = None
    youngs_modulus_eff: Positive | None = None
    lame_lambda: Positive | None = None

    @property
    def measured(self) -> bool:
        """Whether the material is to be identified from what was measured."""
        return self.u0 is not None

    def faults_of_material(self, key: str) -> Iterator[Fault]:
        """Yield a fault unless the material is given in exactly one way, and completely."""
        given, measured = (
            [name for name in names if getattr(self, name) is not None]
            for names in (_GIVEN, _MEASURED)
        )
        if given and measured:
            yield key, f"{', '.join(given + measured)}: {_EITHER}, not both"
        elif not given and not measured:
            yield key, f"says no material; {_EITHER}"
        else:
            names, others = (_GIVEN, _MEASURED) if given else (_MEASURED, _GIVEN)
            for name in sorted(set(names) - set(given + measured)):
                yield f"{key}.{name}", f"missing; write it, or {' and '.join(others)} instead"
        if measured and not self.field:
            yield f"{key}.field", "0; u0 and youngs_modulus_eff are measured in a field above 0"


_EITHER = "write mu_r and lame_eta, or u0 and youngs_modulus_eff"


class SampleTable(Table, frozen=True, kw_only=True):
    """A bar of the material.

    Parameters
    ----------
    length : float
        Length without load and field, in m.
    area : float
        Cross section, in m².
    """

    length: Positive
    area: Positive


class MaterialScene(SceneTable, frozen=True, kw_only=True):
    """What a material does in a field: its strain, its modulus, its line of stress over strain.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"material"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units; the permeability of vacuum is.
    want : tuple of str
        Pictures to draw.
    material : MaterialTable
        The material and the field.
    sample : SampleTable, optional
        A bar of which to tell the stiffness.
    strain : tuple of float, optional
        Range of the lines; from 0 to 0.1, or to past u0 where that is more, if left out.
    """

    kind: Literal["material"]
    want: tuple[Literal["stress_strain"], ...] = ()
    material: MaterialTable
    sample: SampleTable | None = None
    strain: Range | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        yield from self.material.faults_of_material("material")
        if self.strain is not None:
            yield from wrong_order("strain", self.strain, may_be_equal=False)
            if self.strain[0] <= -1:
                yield "strain[0]", f"{self.strain[0]:g} leaves nothing of the bar; stay above -1"


def faults_of_units(units: str) -> Iterator[Fault]:
    """Yield a fault where a scene with a magnetic field is not in SI units."""
    if units != "SI":
        yield (
            "units",
            'the permeability of vacuum has units: write units = "SI", with A/m, Pa and m',
        )
