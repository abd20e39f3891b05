"""Scenes of kind "material": an elastic composite in a field. Also the base of SI scenes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive
from wormopt.study.types import Finite, SceneTable, wrong_order

Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]
Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]

_GIVEN, _MEASURED = ("mu_r", "lame_eta"), ("u0", "youngs_modulus_eff")
_EITHER = "write mu_r and lame_eta, or u0 and youngs_modulus_eff"


class SIScene(SceneTable):
    """A scene whose values are in SI units."""

    why_si: ClassVar = (
        'the permeability of vacuum has units; write units = "SI", with A/m, Pa and m'
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if self.units != "SI":
            yield "units", self.why_si


class MaterialTable(Given):
    """The material, by its parameters or by measurements in the field.

    Both descriptions together are refused, as is half of one, and measurements with `field` 0.
    """

    field: float = number("magnetic_field", "*H*, across the bar", least=0)
    mu_r: float | None = number(
        "1", "relative permeability of the unstrained material", above=1, default=None
    )
    lame_eta: float | None = positive(
        "stress", "second Lamé coefficient *η* (shear modulus)", default=None
    )
    u0: float | None = positive(
        "share", "measured strain by the field alone, instead of these two", default=None
    )
    youngs_modulus_eff: float | None = positive(
        "stress",
        "measured Young's modulus in the field; with `u0` it identifies `mu_r` and `lame_eta`",
        default=None,
    )
    lame_lambda: float | None = positive(
        "stress",
        "first Lamé coefficient *λ*, unknown if left out; used only to check the assumption "
        "*λ* ≫ *η*",
        default=None,
    )

    @property
    def measured(self) -> bool:
        """Return whether measurements identify the material."""
        return self.u0 is not None

    def faults(self) -> Iterator[Fault]:
        """Yield a fault unless the material is given completely in exactly one way."""
        given, measured = (
            [name for name in names if getattr(self, name) is not None]
            for names in (_GIVEN, _MEASURED)
        )
        if given and measured:
            yield "material", f"{', '.join(given + measured)}: {_EITHER}, not both"
        elif not given and not measured:
            yield "material", f"is not given; {_EITHER}"
        else:
            names, others = (_GIVEN, _MEASURED) if given else (_MEASURED, _GIVEN)
            for name in sorted(set(names) - set(given + measured)):
                yield f"material.{name}", f"missing; write it, or {' and '.join(others)} instead"
        if measured and not self.field:
            yield "material.field", "is 0, but u0 and youngs_modulus_eff need a field above 0"


class SampleTable(Given):
    """A bar of the material."""

    length: float = positive("length", "length without load and field")
    area: float = positive("area", "cross section")


class MaterialScene(SIScene):
    """Strain, modulus and stress-strain line of a magneto-elastic material in a field.

    An elastic composite with a magnetic fluid is in a field across it. The scene computes its
    elongation, its modulus, and its stress-strain lines with and without field. The material is
    given by its parameters, or identified from measurements; for any measurement exactly one
    material exists. Theory: [theory-magnetics.md](../theory-magnetics.md#1-material). `units` must
    be `"SI"`.

    A field in which 1 + 2*G*/3 is not positive is refused (exit code 2); the message gives the
    allowed field and permeability. Measurements that no material reproduces to twelve digits are
    refused too.

    For an identified material the trust report has `identification`. Its `residual` is the largest
    relative difference of computed and measured *u*<sub>0</sub> and *E*<sub>eff</sub>; its `roots`
    lists every root with a verdict. For a given material the report has `recheck`: the material is
    identified again from its own *u*<sub>0</sub> and *E*<sub>eff</sub> (unknown without field).
    `validity` has the values behind the assumptions: `must_be_positive` 1 + 2*G*/3, `field_share`
    of the largest field, `lame_ratio` *λ*/*η*, `largest_strain`. `warnings` complete the report.
    """

    scalars: ClassVar = {
        "field": ("magnetic_field", "*H*"),
        "u0": ("share", "strain by the field alone"),
        "youngs_modulus_eff": ("stress", "Young's modulus in the field"),
        "youngs_modulus": ("stress", "Young's modulus without field, 3*η*"),
        "modulus_change": ("share", "relative change of the modulus by the field, never positive"),
        "permeability": ("1", "*μ*<sub>r</sub>"),
        "lame_eta": ("stress", "*η*"),
        "lame_lambda": ("stress", "*λ*, unknown if not given"),
        "poisson_ratio": ("1", "*λ*/(2(*λ* + *η*)), unknown if *λ* is not given"),
        "softening": ("1", "*G*, between −3/2 and 0"),
        "largest_field": ("magnetic_field", "field below which the formulas hold"),
        "small_strain": ("share", "largest strain that counts as small"),
        "stiffness": (
            "stiffness",
            "*E*<sub>eff</sub> *S*<sub>0</sub>/*l*<sub>0</sub>, with `[sample]`",
        ),
        "stiffness_without_field": ("stiffness", "3*η S*<sub>0</sub>/*l*<sub>0</sub>, the same"),
    }
    variables: ClassVar = {
        "strain": ("share", ("strain",), "strain along the bar"),
        "stress_with_field": ("stress", ("strain",), "stress with field"),
        "stress_without_field": ("stress", ("strain",), "stress without field"),
    }

    kind: Literal["material"]
    want: tuple[Literal["stress_strain"], ...] = entry(
        "`stress_strain`: figure 12 of Zimmermann et al. 2007 (WLLS)", default=()
    )
    material: MaterialTable = entry("the material and the field")
    sample: SampleTable | None = entry(
        "a bar whose stiffness is computed; none if left out", default=None
    )
    strain: Range | None = entry(
        "range of the lines, above −1; if left out, from 0 to 0.1 or beyond *u*<sub>0</sub>, "
        "whichever is more",
        quantity="share",
        default=None,
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.material.faults()
        if self.strain is not None:
            yield from wrong_order("strain", self.strain, may_be_equal=False)
            if self.strain[0] <= -1:
                yield "strain[0]", f"{self.strain[0]:g} leaves nothing of the bar; stay above -1"
