"""Kind "material": a magneto-elastic composite in a field."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault
from wormopt.result import Check
from wormopt.study import (
    Given,
    array,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    stage,
    value,
    warnings,
)
from wormopt.study.types import Finite, wrong_order
from wormopt.systems.shared.studies import SIStudy, refused_at

with on_use():
    import numpy as np

    from wormopt.magnetics.material import (
        ACCEPTED,
        SMALL_STRAIN,
        Identification,
        MagnetoElastic,
        Root,
        forward_residual,
        identify_material,
    )

Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]

_GIVEN, _MEASURED = ("mu_r", "lame_eta"), ("u0", "youngs_modulus_eff")
_EITHER = "write mu_r and lame_eta, or u0 and youngs_modulus_eff"
_POINTS = 201
# Accepted errors of the material identified again from u0 and E_eff, over mu_r - 1 and eta.
_FOUND_AGAIN = 1e-9


class MaterialInField(Given):
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

    def faults_of_keys(self) -> Iterator[Fault]:
        given, measured = (
            [name for name in names if getattr(self, name) is not None]
            for names in (_GIVEN, _MEASURED)
        )
        if given and measured:
            yield "", f"{', '.join(given + measured)}: {_EITHER}, not both"
        elif not given and not measured:
            yield "", f"is not given; {_EITHER}"
        else:
            names, others = (_GIVEN, _MEASURED) if given else (_MEASURED, _GIVEN)
            for name in sorted(set(names) - set(given + measured)):
                yield name, f"missing; write it, or {' and '.join(others)} instead"
        if measured and not self.field:
            yield "field", "is 0, but u0 and youngs_modulus_eff need a field above 0"


class Sample(Given):
    """A bar of the material."""

    length: float = positive("length", "length without load and field")
    area: float = positive("area", "cross section")


@dataclass(frozen=True)
class FoundMaterial:
    """A material, given or identified."""

    material: MagnetoElastic
    facts: dict[str, Any]  # its identification, or that from its own u0 and E_eff
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Moduli:
    """Parameters of a material, its strain and modulus in a field."""

    field: float = value("magnetic_field", "*H*", headline=True)
    u0: float = value("share", "strain by the field alone", headline=True)
    youngs_modulus_eff: float = value("stress", "Young's modulus in the field", headline=True)
    youngs_modulus: float = value("stress", "Young's modulus without field, 3*η*", headline=True)
    modulus_change: float = value(
        "share", "relative change of the modulus by the field, never positive", headline=True
    )
    permeability: float = value("1", "*μ*<sub>r</sub>")
    lame_eta: float = value("stress", "*η*")
    lame_lambda: float | None = value("stress", "*λ*, unknown if not given")
    poisson_ratio: float | None = value("1", "*λ*/(2(*λ* + *η*)), unknown if *λ* is not given")
    softening: float = value("1", "*G*, between −3/2 and 0")
    largest_field: float = value("magnetic_field", "field below which the formulas hold")
    small_strain: float = value("share", "largest strain that counts as small")


class Material(SIStudy, kind="material"):
    """Compute or identify the strain and modulus of a magneto-elastic composite.

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

    pictures: ClassVar = {"stress_strain": "figure 12 of Zimmermann et al. 2007 (WLLS)"}

    material: MaterialInField = entry("the material and the field")
    sample: Sample | None = entry(
        "a bar whose stiffness is computed; none if left out", default=None
    )
    strain: Range | None = entry(
        "range of the lines, above −1; if left out, from 0 to 0.1 or beyond *u*<sub>0</sub>, "
        "whichever is more",
        quantity="share",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if self.strain is not None:
            yield from wrong_order("strain", self.strain, may_be_equal=False)
            if self.strain[0] <= -1:
                yield "strain[0]", f"{self.strain[0]:g} leaves no bar; write a strain above -1"

    @stage
    def identification(self) -> FoundMaterial:
        """The material; SceneError if the formulas do not hold, or no material fits."""
        given = self.material
        with refused_at(self, "material"):
            if given.u0 is not None and given.youngs_modulus_eff is not None:
                return _identified(
                    identify_material(
                        given.u0, given.youngs_modulus_eff, given.field,
                        lame_lambda=given.lame_lambda,
                    )
                )  # fmt: skip
            assert given.mu_r is not None
            assert given.lame_eta is not None
            material = MagnetoElastic(given.mu_r, given.lame_eta, given.lame_lambda)
            material.softening(given.field)
        return _found_again(material, given.field)

    @property
    def found(self) -> MagnetoElastic:
        """The material, given or identified."""
        return self.identification.material

    @array("share", "strain", "strain along the bar", name="strain")
    def strains(self) -> np.ndarray:
        u0 = self.moduli.u0
        low, high = self.strain or (0.0, SMALL_STRAIN if u0 < SMALL_STRAIN else 1.25 * u0)
        return np.linspace(low, high, _POINTS)

    @array("stress", "strain", "stress with field")
    def stress_with_field(self) -> np.ndarray:
        return self.found.stress(self.strains, self.material.field)

    @array("stress", "strain", "stress without field")
    def stress_without_field(self) -> np.ndarray:
        return self.found.stress(self.strains)

    @parts(Moduli)
    def moduli(self) -> Moduli:
        return moduli(self.found, self.material.field)

    @cached_property
    def bar(self) -> tuple[float, float]:
        """Length and cross section of the sample."""
        assert self.sample
        return self.sample.length, self.sample.area

    @scalar(
        "stiffness", "*E*<sub>eff</sub> *S*<sub>0</sub>/*l*<sub>0</sub>, with `[sample]`",
        when="sample",
    )  # fmt: skip
    def stiffness(self) -> float:
        return self.found.stiffness(*self.bar, self.material.field)

    @scalar("stiffness", "3*η S*<sub>0</sub>/*l*<sub>0</sub>, the same", when="sample")
    def stiffness_without_field(self) -> float:
        return self.found.stiffness(*self.bar)

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def identified(self) -> tuple[Check, ...]:
        return self.identification.checks

    @facts
    def validity(self) -> dict[str, Any]:
        """The identification, and values behind the assumptions of the formulas."""
        one = self.moduli
        return self.identification.facts | {
            "validity": {
                "must_be_positive": 1 + 2 * one.softening / 3,
                "field_share": one.field / one.largest_field,
                "lame_ratio": one.lame_lambda / one.lame_eta if one.lame_lambda else "unknown",
                "largest_strain": float(np.max(np.abs(self.strains))),
                "small_strain": one.small_strain,
            }
        }

    @warnings
    def assumptions(self) -> Iterator[str]:
        yield from self.found.warnings(self.material.field, self.strains)
        yield from self.identification.warnings


def moduli(material: MagnetoElastic, field: float) -> Moduli:
    """Return parameters of a material, its strain and modulus in a field."""
    modulus, without = material.youngs_modulus(field), material.youngs_modulus()
    return Moduli(
        field=field,
        u0=material.field_strain(field),
        youngs_modulus_eff=modulus,
        youngs_modulus=without,
        modulus_change=modulus / without - 1,
        permeability=material.mu_r,
        lame_eta=material.lame_eta,
        lame_lambda=material.lame_lambda,
        poisson_ratio=material.poisson_ratio,
        softening=material.softening(field),
        largest_field=material.largest_field,
        small_strain=SMALL_STRAIN,
    )


def _identified(found: Identification) -> FoundMaterial:
    roots = [_root(root) for root in found.roots]
    facts = {"residual": found.residual, "accepted": ACCEPTED, "roots": roots}
    check = Check("identification", found.residual, ACCEPTED)
    return FoundMaterial(found.material, {"identification": facts}, (check,))


def _root(root: Root) -> dict[str, Any]:
    mu_r = root.mu_r.real if not root.mu_r.imag else [root.mu_r.real, root.mu_r.imag]
    found = {"mu_r": mu_r, "lame_eta": root.lame_eta, "softening": root.softening}
    return {**found, "verdict": root.refused or "is the material"}


def _found_again(material: MagnetoElastic, field: float) -> FoundMaterial:
    """Identify a given material again from its own u0 and E_eff."""
    if not field:
        return FoundMaterial(material, {"recheck": None})
    u0, modulus = material.field_strain(field), material.youngs_modulus(field)
    try:
        again = identify_material(u0, modulus, field).material
    except ArgumentError as error:
        warnings = (f"not found again: {error}",)
        return FoundMaterial(material, {"recheck": None}, warnings=warnings)
    error = max(
        abs((again.mu_r - 1) / (material.mu_r - 1) - 1), abs(again.lame_eta / material.lame_eta - 1)
    )
    advice = (
        f"identified again from its own u0 and E_eff the material has an error of {error:.2g}; "
        f"{_FOUND_AGAIN:g} is accepted"
    )
    residual = forward_residual(again.mu_r, again.lame_eta, u0, modulus, field)
    recheck = {"error": error, "accepted": _FOUND_AGAIN, "residual": residual}
    check = Check("material found again", error, _FOUND_AGAIN, advice)
    return FoundMaterial(material, {"recheck": recheck}, (check,))
