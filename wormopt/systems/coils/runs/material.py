"""Runs of kind ``material``: a magneto-elastic composite in a field."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.magnetics.identify import (
    ACCEPTED,
    Identification,
    Root,
    forward_residual,
    identify_material,
)
from wormopt.magnetics.material import SMALL_STRAIN, MagnetoElastic
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.scenes.material import MaterialScene, SampleTable

_POINTS = 201
# Accepted errors of the material identified again from u0 and E_eff, over mu_r - 1 and eta.
_FOUND_AGAIN = 1e-9


@dataclass(frozen=True)
class MaterialFound:
    """The material of a scene."""

    material: MagnetoElastic  # given, or identified
    facts: dict[str, Any]  # its identification, or that from its own u0 and E_eff
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()


def run(scene: Scene[MaterialScene], report: Report) -> Result:
    """Return strain, modulus and stress-strain lines with and without field.

    Status "failed" if strain and modulus do not identify the same material. Raises SceneError as
    `material_of` does.
    """
    table, begin = scene.table, time.perf_counter()
    report("identifying" if table.material.measured else "evaluating", None)
    found = material_of(scene)
    identified = time.perf_counter() - begin
    material, field = found.material, table.material.field
    u0 = material.field_strain(field)
    low, high = table.strain or (0.0, SMALL_STRAIN if u0 < SMALL_STRAIN else 1.25 * u0)
    strain = np.linspace(low, high, _POINTS)
    return conclude(
        scene,
        _scalars(material, field, table.sample),
        {
            "strain": strain,
            "stress_with_field": material.stress(strain, field),
            "stress_without_field": material.stress(strain),
        },
        checks=found.checks,
        facts=found.facts | {"validity": _validity(material, field, strain)},
        warnings=(*material.warnings(field, strain), *found.warnings),
        timings={"identify": identified},
    )


def material_of(scene: Scene[MaterialScene]) -> MaterialFound:
    """Return the material of a scene, given or identified.

    Raises SceneError if the formulas do not hold in the field, or no material reproduces the
    measurements.
    """
    table = scene.table.material
    try:
        if table.u0 is not None and table.youngs_modulus_eff is not None:
            return _identified(
                identify_material(
                    table.u0, table.youngs_modulus_eff, table.field, lame_lambda=table.lame_lambda
                )
            )
        assert table.mu_r is not None
        assert table.lame_eta is not None
        material = MagnetoElastic(table.mu_r, table.lame_eta, table.lame_lambda)
        material.softening(table.field)
    except ArgumentError as error:
        raise SceneError(scene.name, [("material", str(error))]) from None
    return _found_again(material, table.field)


def _identified(found: Identification) -> MaterialFound:
    roots = [_root(root) for root in found.roots]
    facts = {"residual": found.residual, "accepted": ACCEPTED, "roots": roots}
    check = Check("identification", found.residual, ACCEPTED)
    return MaterialFound(found.material, {"identification": facts}, (check,))


def _root(root: Root) -> dict[str, Any]:
    mu_r = root.mu_r.real if not root.mu_r.imag else [root.mu_r.real, root.mu_r.imag]
    found = {"mu_r": mu_r, "lame_eta": root.lame_eta, "softening": root.softening}
    return {**found, "verdict": root.refused or "is the material"}


def _found_again(material: MagnetoElastic, field: float) -> MaterialFound:
    """Identify a given material again from its own u0 and E_eff."""
    if not field:
        return MaterialFound(material, {"recheck": None})
    u0, modulus = material.field_strain(field), material.youngs_modulus(field)
    try:
        again = identify_material(u0, modulus, field).material
    except ArgumentError as error:
        warnings = (f"not found again: {error}",)
        return MaterialFound(material, {"recheck": None}, warnings=warnings)
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
    return MaterialFound(material, {"recheck": recheck}, (check,))


def _scalars(material: MagnetoElastic, field: float, sample: SampleTable | None) -> dict[str, Any]:
    modulus, without = material.youngs_modulus(field), material.youngs_modulus()
    found = {
        "field": field,
        "u0": material.field_strain(field),
        "youngs_modulus_eff": modulus,
        "youngs_modulus": without,
        "modulus_change": modulus / without - 1,
        "permeability": material.mu_r,
        "lame_eta": material.lame_eta,
        "lame_lambda": material.lame_lambda,
        "poisson_ratio": material.poisson_ratio,
        "softening": material.softening(field),
        "largest_field": material.largest_field,
        "small_strain": SMALL_STRAIN,
    }
    if sample is None:
        return found
    bar = (sample.length, sample.area)
    return found | {
        "stiffness": material.stiffness(*bar, field),
        "stiffness_without_field": material.stiffness(*bar),
    }


def _validity(material: MagnetoElastic, field: float, strain: np.ndarray) -> dict[str, Any]:
    """Return values behind the assumptions of the formulas."""
    ratio = material.lame_lambda / material.lame_eta if material.lame_lambda else "unknown"
    return {
        "must_be_positive": 1 + 2 * material.softening(field) / 3,
        "field_share": field / material.largest_field,
        "lame_ratio": ratio,
        "largest_strain": float(np.max(np.abs(strain))),
        "small_strain": SMALL_STRAIN,
    }
