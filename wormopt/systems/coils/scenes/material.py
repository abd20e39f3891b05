"""Scenes of kind "material": an elastic composite in a field. The base of scenes in SI units."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_order,
)

Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]
Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]

_GIVEN, _MEASURED = ("mu_r", "lame_eta"), ("u0", "youngs_modulus_eff")
_EITHER = "write mu_r and lame_eta, or u0 and youngs_modulus_eff"


class SIScene(SceneTable, frozen=True, kw_only=True):
    """A scene whose numbers are in SI units."""

    why_si: ClassVar = (
        'the permeability of vacuum has units: write units = "SI", with A/m, Pa and m'
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if self.units != "SI":
            yield "units", self.why_si


class MaterialTable(Table, frozen=True, kw_only=True):
    """The material, by what it is or by what was measured in the field.

    Refused: both ways of telling the material, or half of one; measurements with `field` 0.
    """

    field: Annotated[NonNegative, says("magnetic_field", "*H*, across the bar")]
    mu_r: Annotated[
        Permeability | None, says("1", "relative permeability of the unstrained material")
    ] = None
    lame_eta: Annotated[
        Positive | None, says("stress", "second Lamé coefficient *η* (shear modulus)")
    ] = None
    u0: Annotated[
        Positive | None, says("share", "instead of these two: strain by the field alone,")
    ] = None
    youngs_modulus_eff: Annotated[
        Positive | None,
        says(
            "stress",
            "and Young's modulus in the field, from which `mu_r` and `lame_eta` are identified",
        ),
    ] = None
    lame_lambda: Annotated[
        Positive | None,
        says(
            "stress",
            "first Lamé coefficient *λ*, unknown if left out; enters no formula, but with it "
            "*λ* ≫ *η* is checked",
        ),
    ] = None

    @property
    def measured(self) -> bool:
        """Whether the material is to be identified from what was measured."""
        return self.u0 is not None

    def faults(self) -> Iterator[Fault]:
        """Yield a fault unless the material is given in exactly one way, and completely."""
        given, measured = (
            [name for name in names if getattr(self, name) is not None]
            for names in (_GIVEN, _MEASURED)
        )
        if given and measured:
            yield "material", f"{', '.join(given + measured)}: {_EITHER}, not both"
        elif not given and not measured:
            yield "material", f"says no material; {_EITHER}"
        else:
            names, others = (_GIVEN, _MEASURED) if given else (_MEASURED, _GIVEN)
            for name in sorted(set(names) - set(given + measured)):
                yield f"material.{name}", f"missing; write it, or {' and '.join(others)} instead"
        if measured and not self.field:
            yield "material.field", "0; u0 and youngs_modulus_eff are measured in a field above 0"


class SampleTable(Table, frozen=True, kw_only=True):
    """A bar of the material."""

    length: Annotated[Positive, says("length", "without load and field")]
    area: Annotated[Positive, says("area", "cross section")]


class MaterialScene(SIScene, frozen=True, kw_only=True):
    """What a material does in a field: its strain, its modulus, its line of stress over strain.

    An elastic composite with a magnetic fluid in it, in a field across it: by how much it
    lengthens, how stiff it is, and its line of stress over strain with the field and without. The
    material is given, or identified from what was measured; there is exactly one for any
    measurement. Theory: [theory-magnetics.md](../theory-magnetics.md#1-material). `units` must be
    `"SI"`.

    Refused besides (exit code 2): a field in which 1 + 2*G*/3 is not positive, with the field and
    the permeability that would be allowed; measurements that no material has to twelve digits.

    The trust report has `identification` (`residual`: largest relative difference of
    *u*<sub>0</sub> and *E*<sub>eff</sub>, computed from what was identified, from what was
    measured; `roots`: every root, with a verdict) or, of a given material, `recheck` (it is
    identified again from its own *u*<sub>0</sub> and *E*<sub>eff</sub>; unknown without field);
    `validity` (the numbers behind the assumptions: `must_be_positive` 1 + 2*G*/3, `field_share` of
    the largest field, `lame_ratio` *λ*/*η*, `largest_strain`); `warnings`.
    """

    scalars: ClassVar = {
        "field": ("magnetic_field", "*H*"),
        "u0": ("share", "strain by the field alone"),
        "youngs_modulus_eff": ("stress", "Young's modulus in the field"),
        "youngs_modulus": ("stress", "without it, 3*η*"),
        "modulus_change": ("share", "by how much of itself the field changes it, never upward"),
        "permeability": ("1", "*μ*<sub>r</sub>"),
        "lame_eta": ("stress", "*η*"),
        "lame_lambda": ("stress", "*λ*, unknown where it is not given"),
        "poisson_ratio": ("1", "*λ*/(2(*λ* + *η*)), unknown likewise"),
        "softening": ("1", "*G*, between −3/2 and 0"),
        "largest_field": ("magnetic_field", "below it the formulas hold"),
        "small_strain": ("share", "largest strain that counts as small"),
        "stiffness": (
            "stiffness",
            "*E*<sub>eff</sub> *S*<sub>0</sub>/*l*<sub>0</sub>, with `[sample]`",
        ),
        "stiffness_without_field": ("stiffness", "3*η S*<sub>0</sub>/*l*<sub>0</sub>, likewise"),
    }
    variables: ClassVar = {
        "strain": ("share", ("strain",), "strain along the bar"),
        "stress_with_field": ("stress", ("strain",), "with field"),
        "stress_without_field": ("stress", ("strain",), "without"),
    }

    kind: Literal["material"]
    want: Annotated[
        tuple[Literal["stress_strain"], ...],
        says("", "`stress_strain`: the chapter's figure 12"),
    ] = ()
    material: Annotated[MaterialTable, says("", "the material and the field")]
    sample: Annotated[
        SampleTable | None, says("", "a bar of which to tell the stiffness; none if left out")
    ] = None
    strain: Annotated[
        Range | None,
        says(
            "share",
            "range of the lines, above −1; from 0 to 0.1, or to past *u*<sub>0</sub> where that "
            "is more, if left out",
        ),
    ] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.material.faults()
        if self.strain is not None:
            yield from wrong_order("strain", self.strain, may_be_equal=False)
            if self.strain[0] <= -1:
                yield "strain[0]", f"{self.strain[0]:g} leaves nothing of the bar; stay above -1"
