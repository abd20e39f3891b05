"""Runs of kind ``membrane``: the thickness between actuation and loss of fluid."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.progress import Report
from wormopt.result import Check, Result, left_out
from wormopt.shown import enough
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.coils.membrane import Choice, Membrane
from wormopt.systems.coils.scenes.hydrostatics import MembraneScene

_THIN = 0.1  # wall over radius up to which the stress counts as uniform over the wall
# Tolerance of logarithms of thicknesses; limits may be exceeded by the same relative amount.
_ACCEPTED = 1e-7
_FREE = (-80.0, 80.0)
_ASSUMED = {
    "free ends": "the ends of the tube are free to shorten, and no stress acts along it; closed "
    "ends that the pressure pulls apart would leave a hoop strain of (1 - nu/2) p R / (E h)"
}


def run(scene: Scene[MembraneScene], report: Report) -> Result:
    """Find the best thickness, and the front of strain and loss.

    Status "failed" if the best thickness is not that of its strictest limit. Raises SolveError if
    no thickness meets all limits; the message gives the thickness each needs.
    """
    table, begin = scene.table, time.perf_counter()
    tube, fluid = table.membrane, table.fluid
    membrane = Membrane(
        tube.radius, tube.youngs_modulus, fluid.pressure, tube.diffusivity,
        tube.concentration_drop, fluid.density, table.contact_strain,
    )  # fmt: skip
    limits = {"loss": table.loss_max, "stress": tube.stress_max, "strain": tube.strain_max}
    choice = Choice(membrane, table.lifetime, limits)
    thinnest, thickest = table.thickness
    span = math.log(thinnest), math.log(thickest)
    report("choosing the thickness", 0.0)
    single = {name: choice.widest(_FREE, **{name: limit})[0] for name, limit in limits.items()}
    best, violation = choice.widest(span, **limits)
    strictest = max(single, key=lambda name: single[name])
    error = abs(best / choice.least(thinnest) - 1)
    reason, suggestion = _conflict(table, single, strictest)
    result = conclude(
        scene,
        _scalars(choice, table, best)
        | {"limited_by": strictest if single[strictest] >= thinnest else "thickness"}
        | {f"thickness_for_{name}": size for name, size in single.items()},
        _front(choice, table, span, report),
        checks=[
            Check("limits", violation, _ACCEPTED, reason),
            Check(
                "thickness in closed form",
                error,
                _ACCEPTED,
                f"the best thickness differs by {error:.2g} from the strictest limit's",
            ),
        ],
        facts={
            "violation": violation,
            "recheck_error": error,
            "accepted": _ACCEPTED,
            "assumptions": _ASSUMED,
        },
        warnings=_warnings(choice, best),
        timings={"solve": time.perf_counter() - begin},
    )
    if not violation <= _ACCEPTED:
        raise SolveError(reason, suggestion, result.failed(reason), "infeasible")
    return result


def _conflict(table: MembraneScene, single: dict[str, float], strictest: str) -> tuple[str, str]:
    """Return reason and suggestion if no thickness meets all limits."""
    keys = {"loss": "loss_max", "stress": "membrane.stress_max", "strain": "membrane.strain_max"}
    needed = {name: enough(size, 3, _ACCEPTED / 2) for name, size in single.items()}
    asks = ", ".join(f"{keys[name]} for {size:g} m" for name, size in needed.items())
    reason = (
        f"no thickness up to {table.thickness[1]:g} m meets all limits; each needs at least: {asks}"
    )
    suggestion = f"raise {keys[strictest]}"
    if needed[strictest] < table.membrane.radius:
        suggestion += f", or thickness[1] to {needed[strictest]:g}"
    if strictest == "loss":
        suggestion += ", or write a shorter lifetime"
    return reason, suggestion


def _front(
    choice: Choice, table: MembraneScene, span: tuple[float, float], report: Report
) -> dict[str, np.ndarray]:
    """Return the largest strain for each allowed loss, from the thinnest to the thickest wall."""
    most, least = (choice.measures(size)["loss"] for size in table.thickness)
    found = []
    for k, allowed in enumerate(np.geomspace(least, most, table.points)):
        report("front", k / table.points)
        found.append(choice.widest(span, loss=allowed)[0])
    thickness = np.array(found)
    measures = choice.measures(thickness)
    return {
        "front_thickness": thickness,
        "front_loss": measures["loss"],
        "front_strain": measures["strain"],
        "front_contact_pressure": choice.membrane.contact_pressure(thickness),
        "front_within": choice.within(thickness, _ACCEPTED),
    }


def _scalars(choice: Choice, table: MembraneScene, best: float) -> dict[str, Any]:
    measures, membrane = choice.measures(best), choice.membrane
    return {
        "thickness_best": best,
        "strain": measures["strain"],
        "stress": measures["stress"],
        "loss_share": measures["loss"],
        "loss_rate": membrane.loss_rate(best),
        "contact_pressure": membrane.contact_pressure(best),
        "bending_stiffness": membrane.bending_stiffness(best),
        "lifetime": table.lifetime,
        **{f"{name}_max": limit for name, limit in choice.limits.items()},
    }


def _warnings(choice: Choice, best: float) -> Iterator[str]:
    membrane = choice.membrane
    strain = membrane.strain(best)
    if strain > SMALL_STRAIN * (1 + _ACCEPTED):
        text = f"a strain of {strain:.2g} is not small; above {SMALL_STRAIN:g} the law is uncertain"
        yield left_out(strain, text)
    if best > _THIN * membrane.radius:
        yield left_out(
            best / membrane.radius,
            f"the wall is {best / membrane.radius:.2g} of the radius; above {_THIN:g} the membrane "
            "is not thin, and its stress is not uniform over the wall",
        )
    left = membrane.contact_pressure(best)
    if left <= 0:
        yield (
            "at contact_strain the membrane carries the whole pressure: none is left to push "
            "against the ground"
        )
