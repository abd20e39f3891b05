"""Scenes of kind ``membrane``: the thickness between actuation and loss of fluid."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, Context, Decimal
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import brentq

from wormopt.errors import SolveError
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.magnetics.membrane import Membrane
from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.coils.scenes.membrane import MembraneScene

_THIN = 0.1  # wall over radius up to which the stress counts as even over the wall
# Logarithms of thicknesses are found to this; limits may be off by as much of themselves.
_ACCEPTED = 1e-7
_FREE = (-80.0, 80.0)
_ASSUMED = {
    "free ends": "the ends of the tube are free to shorten, and no stress acts along it; closed "
    "ends that the pressure pulls apart would leave a hoop strain of (1 - nu/2) p R / (E h)"
}


@dataclass(frozen=True, eq=False)
class Choice:
    """Programs over the logarithm of the thickness; IPOPT solves them."""

    membrane: Membrane  # the tube
    lifetime: float  # s
    limits: Mapping[str, float]  # largest "loss", "stress" and "strain"

    def widest(self, span: tuple[float, float], **limits: float) -> tuple[float, float]:
        """Thickness in m of most strain within limits, and largest relative excess over one.

        `span` is of the thickness's logarithm; limits left out do not count.
        """
        measured = ("loss", "stress", "strain")
        logs = np.array([np.log(limits[name]) if name in limits else np.inf for name in measured])
        low, high = np.array(span[:1]), np.array(span[1:])
        bounds = Bounds(low, high, np.full(3, -np.inf), logs, np.zeros(0))
        start = np.array([np.clip(np.log(1e-4), *span)])
        found = self._program.solve(start, bounds, Ipopt(tolerance=1e-11))
        return float(np.exp(found.w[0])), found.violation

    def measures(self, thickness: Any) -> tuple[Any, Any, Any]:
        """Loss, stress and strain at a thickness in m, of numbers and expressions."""
        tube = self.membrane
        loss = tube.loss_share(thickness, self.lifetime)
        return loss, tube.stress(thickness), tube.strain(thickness)

    @property
    def _program(self) -> NonlinearProgram:
        return self.__dict__.setdefault("_made", self._make())

    def _make(self) -> NonlinearProgram:
        w, none = ca.MX.sym("log_thickness"), ca.MX.sym("none", 0)
        found = [ca.log(value) for value in self.measures(ca.exp(w))]
        return NonlinearProgram(w, none, -found[2], ca.vertcat(*found))


def run(scene: Scene[MembraneScene], report: Report) -> Result:
    """Find the best thickness, and the front of strain and loss.

    Status "failed" where the best thickness is not that of its strictest limit. Raises
    SolveError if no thickness meets all limits; it says what each asks for.
    """
    table, begin = scene.table, time.perf_counter()
    tube, fluid = table.membrane, table.fluid
    membrane = Membrane(
        tube.radius, tube.youngs_modulus, fluid.pressure, tube.diffusivity,
        tube.concentration_drop, fluid.density, table.contact_strain,
    )  # fmt: skip
    limits = {"loss": table.loss_max, "stress": tube.stress_max, "strain": tube.strain_max}
    choice = Choice(membrane, table.lifetime, limits)
    span = tuple(float(np.log(size)) for size in table.thickness)
    report("choosing the thickness", 0.0)
    single = {name: choice.widest(_FREE, **{name: limit})[0] for name, limit in limits.items()}
    best, violation = choice.widest((span[0], span[1]), **limits)
    front = _front(choice, table, report)
    strictest = max(single, key=lambda name: single[name])
    binding = strictest if single[strictest] >= table.thickness[0] else "thickness"
    error = abs(best / _by_brackets(choice, table.thickness) - 1)
    result = Result(
        scene.name,
        table.kind,
        scene.title,
        scalars=_scalars(choice, table, best, binding, single),
        variables=front,
        trust={
            "violation": violation,
            "recheck_error": error,
            "accepted": _ACCEPTED,
            "assumptions": dict(_ASSUMED),
            "warnings": list(_warnings(choice, best)),
        },
        timings_s={"solve": time.perf_counter() - begin},
        scene_text=scene.text,
    )
    if not violation <= _ACCEPTED:
        raise _refused(result, table, single, strictest)
    if not error <= _ACCEPTED:
        reason = f"the best thickness is off by {error:.2g} from where the limits begin to hold"
        return replace(result, status="failed", reason=reason)
    return result


def _by_brackets(choice: Choice, thickness: tuple[float, ...]) -> float:
    """Thinnest membrane within all limits, by bracketing where they begin to hold."""
    limits = list(choice.limits.values())

    def excess(w: float) -> float:
        return float(np.max(np.log(choice.measures(np.exp(w))) - np.log(limits)))

    low, high = np.log(thickness)
    if excess(low) <= 0:
        return thickness[0]
    if excess(high) > 0:
        return np.inf
    return float(np.exp(brentq(excess, low, high, xtol=1e-14)))  # pyright: ignore


def _refused(
    result: Result, table: MembraneScene, single: dict[str, float], strictest: str
) -> SolveError:
    keys = {"loss": "loss_max", "stress": "membrane.stress_max", "strain": "membrane.strain_max"}
    needed = {name: _rounded_up(size) for name, size in single.items()}
    asks = ", ".join(f"{keys[name]} for {size:g} m" for name, size in needed.items())
    reason = (
        f"no thickness up to {table.thickness[1]:g} m meets all limits; at least, they ask: {asks}"
    )
    suggestion = f"raise {keys[strictest]}"
    if needed[strictest] < table.membrane.radius:
        suggestion += f", or thickness[1] to {needed[strictest]:g}"
    if strictest == "loss":
        suggestion += ", or take a shorter lifetime"
    partial = replace(result, status="failed", reason=reason)
    return SolveError(reason, suggestion, partial, "infeasible")


def _rounded_up(size: float) -> float:
    """Least number of three digits that is enough where `size` is, to what is accepted."""
    enough = Decimal(size * (1 - _ACCEPTED / 2))
    return float(Context(prec=3, rounding=ROUND_CEILING).plus(enough))


def _front(choice: Choice, table: MembraneScene, report: Report) -> tuple[Variable, ...]:
    """Most strain for each allowed loss, from what the thinnest loses to what the thickest does."""
    low, high = table.thickness
    losses = choice.measures(high)[0], choice.measures(low)[0]
    found = []
    for k, allowed in enumerate(np.geomspace(*losses, table.points)):
        report("front", k / table.points)
        # on the ends of the range the limit is the thickness itself: no room for rounding
        span = (float(np.log(low)), float(np.log(high)))
        found.append(choice.widest(span, loss=allowed * (1 + 1e-12))[0])
    thickness = np.array(found)
    loss, stress, strain = choice.measures(thickness)
    limits = choice.limits
    within = (
        (loss <= limits["loss"] * (1 + _ACCEPTED))
        & (stress <= limits["stress"] * (1 + _ACCEPTED))
        & (strain <= limits["strain"] * (1 + _ACCEPTED))
    )
    columns = {
        "front_thickness": (thickness, "length", "thickness"),
        "front_loss": (loss, "share", "share of the fluid lost within the lifetime"),
        "front_strain": (strain, "share", "strain"),
        "front_contact_pressure": (
            choice.membrane.contact_pressure(thickness), "stress", "pressure on the ground",
        ),
        "front_within": (within, "count", "whether all limits hold"),
    }  # fmt: skip
    return tuple(
        Variable(name, unit_of(kind, "SI"), ("point",), values, text)
        for name, (values, kind, text) in columns.items()
    )


def _scalars(
    choice: Choice, table: MembraneScene, best: float, binding: str, single: dict[str, float]
) -> dict[str, Scalar]:
    loss, stress, strain = choice.measures(best)
    membrane = choice.membrane
    found: dict[str, tuple[Any, str]] = {
        "thickness_best": (best, "length"),
        "limited_by": (binding, "count"),
        "strain": (strain, "share"),
        "stress": (stress, "stress"),
        "loss_share": (loss, "share"),
        "loss_rate": (membrane.loss_rate(best), "mass_rate_per_length"),
        "contact_pressure": (membrane.contact_pressure(best), "stress"),
        "bending_stiffness": (membrane.bending_stiffness(best), "bending_stiffness"),
        "lifetime": (table.lifetime, "time"),
        "loss_max": (table.loss_max, "share"),
        "stress_max": (table.membrane.stress_max, "stress"),
        "strain_max": (table.membrane.strain_max, "share"),
        **{f"thickness_for_{name}": (size, "length") for name, size in single.items()},
    }
    return {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in found.items()}


def _warnings(choice: Choice, best: float) -> Iterator[str]:
    membrane = choice.membrane
    strain = membrane.strain(best)
    if strain > SMALL_STRAIN * (1 + _ACCEPTED):
        yield f"a strain of {strain:.2g} is not small; above {SMALL_STRAIN:g} the law is a guess"
    if best > _THIN * membrane.radius:
        yield (
            f"the wall is {best / membrane.radius:.2g} of the radius; above {_THIN:g} the stress "
            "is not even over it, and the membrane not thin"
        )
    left = membrane.contact_pressure(best)
    if left <= 0:
        yield (
            "at contact_strain the membrane holds all of the pressure: nothing is left to push "
            "against the ground"
        )
