"""Scenes of kind ``material``: what a magneto-elastic composite does in a field."""

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
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.coils.scenes.material import MaterialScene, MaterialTable, SampleTable

_POINTS = 201
# The material found again from u0 and E_eff may differ by so much of mu_r - 1 and of eta.
_FOUND_AGAIN = 1e-9


@dataclass(frozen=True)
class MaterialFound:
    """The material of a scene."""

    material: MagnetoElastic  # given, or identified
    trust: dict[str, Any]  # how it was identified, or found again from its own u0 and E_eff
    warnings: tuple[str, ...] = ()
    fault: str = ""  # why it is not to be trusted; empty if it is


def run(scene: Scene[MaterialScene], report: Report) -> Result:
    """Strain, modulus and lines of stress over strain, with the field and without.

    Status "failed" where the material is not found again from its strain and modulus. Raises
    SceneError like `material_of`.
    """
    table, begin = scene.table, time.perf_counter()
    report("identifying" if table.material.measured else "evaluating", None)
    found = material_of(scene, table.material)
    identified = time.perf_counter() - begin
    material, field = found.material, table.material.field
    strain = _strains(table, material.field_strain(field))
    warnings = [*material.warnings(field, strain), *found.warnings]
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if found.fault else "ok",
        reason=found.fault,
        scalars=_scalars(material, field, table.sample),
        variables=_lines(material, field, strain),
        trust={**found.trust, "validity": _validity(material, field, strain), "warnings": warnings},
        timings_s={"identify": identified},
        scene_text=scene.text,
    )


def material_of(scene: Scene[Any], table: MaterialTable, key: str = "material") -> MaterialFound:
    """Make the material of a scene, or identify it; `key` is the key path of its table.

    Raises SceneError if the formulas do not hold in the field, or no material has what was
    measured.
    """
    try:
        if table.u0 is not None and table.youngs_modulus_eff is not None:
            found = identify_material(
                table.u0, table.youngs_modulus_eff, table.field, lame_lambda=table.lame_lambda
            )
            return MaterialFound(found.material, _trust(found))
        assert table.mu_r is not None
        assert table.lame_eta is not None
        material = MagnetoElastic(table.mu_r, table.lame_eta, table.lame_lambda)
        material.softening(table.field)
    except ArgumentError as error:
        raise SceneError(scene.name, [(key, str(error))]) from None
    return _found_again(material, table.field)


def _trust(found: Identification) -> dict[str, Any]:
    return {
        "identification": {
            "residual": found.residual,
            "accepted": ACCEPTED,
            "roots": [_root(root) for root in found.roots],
        }
    }


def _root(root: Root) -> dict[str, Any]:
    mu_r = root.mu_r.real if not root.mu_r.imag else [root.mu_r.real, root.mu_r.imag]
    found = {"mu_r": mu_r, "lame_eta": root.lame_eta, "softening": root.softening}
    return {**found, "verdict": root.refused or "is the material"}


def _found_again(material: MagnetoElastic, field: float) -> MaterialFound:
    """Identify a given material from its own u0 and E_eff."""
    if not field:
        return MaterialFound(material, {"recheck": None})
    u0, modulus = material.field_strain(field), material.youngs_modulus(field)
    try:
        again = identify_material(u0, modulus, field).material
    except ArgumentError as error:
        return MaterialFound(material, {"recheck": None}, (f"not found again: {error}",))
    error = max(
        abs((again.mu_r - 1) / (material.mu_r - 1) - 1), abs(again.lame_eta / material.lame_eta - 1)
    )
    fault = ""
    if not error <= _FOUND_AGAIN:
        fault = (
            f"from its own u0 and E_eff the material is found again with an error of {error:.2g}, "
            f"where {_FOUND_AGAIN:g} is accepted"
        )
    residual = forward_residual(again.mu_r, again.lame_eta, u0, modulus, field)
    recheck = {"error": error, "accepted": _FOUND_AGAIN, "residual": residual}
    return MaterialFound(material, {"recheck": recheck}, fault=fault)


def _strains(table: MaterialScene, u0: float) -> np.ndarray:
    low, high = table.strain or (0.0, SMALL_STRAIN if u0 < SMALL_STRAIN else 1.25 * u0)
    return np.linspace(low, high, _POINTS)


def _scalars(
    material: MagnetoElastic, field: float, sample: SampleTable | None
) -> dict[str, Scalar]:
    modulus, without = material.youngs_modulus(field), material.youngs_modulus()
    found: dict[str, tuple[float | None, str]] = {
        "field": (field, "magnetic_field"),
        "u0": (material.field_strain(field), "share"),
        "youngs_modulus_eff": (modulus, "stress"),
        "youngs_modulus": (without, "stress"),
        "modulus_change": (modulus / without - 1, "share"),
        "permeability": (material.mu_r, "share"),
        "lame_eta": (material.lame_eta, "stress"),
        "lame_lambda": (material.lame_lambda, "stress"),
        "poisson_ratio": (material.poisson_ratio, "share"),
        "softening": (material.softening(field), "share"),
        "largest_field": (material.largest_field, "magnetic_field"),
        "small_strain": (SMALL_STRAIN, "share"),
    }
    if sample is not None:
        bar = (sample.length, sample.area)
        found["stiffness"] = (material.stiffness(*bar, field), "stiffness")
        found["stiffness_without_field"] = (material.stiffness(*bar), "stiffness")
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}


def _lines(material: MagnetoElastic, field: float, strain: np.ndarray) -> tuple[Variable, ...]:
    pascal = unit_of("stress", "SI")
    return (
        Variable("strain", "1", ("strain",), strain, "strain along the bar"),
        Variable(
            "stress_with_field", pascal, ("strain",), material.stress(strain, field), "with field"
        ),
        Variable("stress_without_field", pascal, ("strain",), material.stress(strain), "without"),
    )


def _validity(material: MagnetoElastic, field: float, strain: np.ndarray) -> dict[str, Any]:
    """Numbers behind the assumptions of the formulas."""
    ratio = material.lame_lambda / material.lame_eta if material.lame_lambda else "unknown"
    return {
        "must_be_positive": 1 + 2 * material.softening(field) / 3,
        "field_share": field / material.largest_field,
        "lame_ratio": ratio,
        "largest_strain": float(np.max(np.abs(strain))),
        "small_strain": SMALL_STRAIN,
    }
