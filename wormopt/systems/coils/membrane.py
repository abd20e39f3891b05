"""Kind "membrane": thin it stretches and pushes, thick it keeps the magnetic fluid inside.

The tube has the radius R, a wall h_m that is small against R, and the inner pressure p of the
fluid: hoop stress p R / h_m, strain p R / (E h_m). The ends are free to shorten, so no stress acts
along the tube; ends that the pressure pulls apart would leave a hoop strain of (1 - nu / 2) p R /
(E h_m) with Poisson's ratio nu. Fluid diffuses through it at the rate D dc / h_m per area. All
functions take numbers, arrays or CasADi expressions. Loss, stress and strain all fall with
thickness, so the best membrane is the thinnest within its limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.result import left_out
from wormopt.shown import enough
from wormopt.study import (
    Given,
    check,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    scalars,
    signal,
    stage,
    warnings,
    whole,
)
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.shared.studies import SIStudy

with on_use():
    import numpy as np

    from wormopt.magnetics.material import SMALL_STRAIN, check_number
    from wormopt.numerics.roots import root

_THIN = 0.1  # wall over radius up to which the stress counts as uniform over the wall
# Tolerance of logarithms of thicknesses; limits may be exceeded by the same relative amount.
_ACCEPTED = 1e-7
_ASSUMED = {
    "free ends": "the ends of the tube are free to shorten, and no stress acts along it; closed "
    "ends that the pressure pulls apart would leave a hoop strain of (1 - nu/2) p R / (E h)"
}
_KEYS = {"loss": "loss_max", "stress": "membrane.stress_max", "strain": "membrane.strain_max"}
_LEAST = {
    f"thickness_for_{name}": ("length", f"least thickness for `{key}` alone")
    for name, key in _KEYS.items()
}
_GIVEN = {
    "lifetime": ("time", "`lifetime` of the scene"),
    "loss_max": ("share", "`loss_max` of the scene"),
    "stress_max": ("stress", "`membrane.stress_max`"),
    "strain_max": ("share", "`membrane.strain_max`"),
}


@dataclass(frozen=True)
class Membrane:
    """A membrane tube filled with a fluid, with ends free to shorten, in SI units.

    Raises ArgumentError if a value is not above 0, or the contact strain negative.
    """

    radius: float  # R, m
    youngs_modulus: float  # E, Pa
    pressure: float  # p of the fluid above that outside, Pa
    diffusivity: float  # D of the carrier liquid in the membrane, m²/s
    concentration_drop: float  # dc of that liquid, inner to outer face, kg/m³
    fluid_density: float  # kg/m³
    contact_strain: float = 0.0  # at which it touches the ground or channel

    def __post_init__(self) -> None:
        for name in (
            "radius", "youngs_modulus", "pressure", "diffusivity", "concentration_drop",
            "fluid_density",
        ):  # fmt: skip
            check_number(name, getattr(self, name))
        if self.contact_strain:
            check_number("contact_strain", self.contact_strain)

    def stress(self, thickness: Any) -> Any:
        """Return the hoop stress p R / h_m, in Pa, of a membrane of thickness h_m (m)."""
        return self.pressure * self.radius / thickness

    def strain(self, thickness: Any) -> Any:
        """Return the hoop strain of a tube with free ends, p R / (E h_m), h_m in m."""
        return self.stress(thickness) / self.youngs_modulus

    def contact_pressure(self, thickness: Any) -> Any:
        """Return the pressure left at the contact strain e: p - E e h_m / R, h_m in m."""
        held = self.youngs_modulus * self.contact_strain / self.radius
        return self.pressure - held * thickness

    def bending_stiffness(self, thickness: Any) -> Any:
        """Return the bending stiffness of the tube as a beam, pi E R³ h_m, in N m²; h_m in m."""
        return math.pi * self.youngs_modulus * self.radius**3 * thickness

    def loss_rate(self, thickness: Any) -> Any:
        """Return mass lost per time and length, D A dc / h_m with A = 2 pi R, in kg/(s m)."""
        wall = 2 * math.pi * self.radius
        return self.diffusivity * wall * self.concentration_drop / thickness

    def loss_share(self, thickness: Any, lifetime: Any) -> Any:
        """Return the share of fluid lost within `lifetime` (s), 2 D dc t / (R h_m rho), h_m in m.

        It uses the initial rate, which does not grow: an upper bound of the loss.
        """
        filling = math.pi * self.radius**2 * self.fluid_density
        return self.loss_rate(thickness) * lifetime / filling


@dataclass(frozen=True, eq=False)
class Choice:
    """Choice of the thickness with the largest strain within limits."""

    membrane: Membrane
    lifetime: float  # s
    limits: Mapping[str, float]  # largest "loss", "stress" and "strain"

    def measures(self, thickness: Any) -> dict[str, Any]:
        """Return loss, stress and strain at a thickness in m."""
        tube = self.membrane
        return {
            "loss": tube.loss_share(thickness, self.lifetime),
            "stress": tube.stress(thickness),
            "strain": tube.strain(thickness),
        }

    def widest(self, span: tuple[float, float], **limits: float) -> tuple[float, float]:
        """Return the thickness in m of largest strain within limits, and the largest excess.

        `span` is that of the thickness's logarithm; limits left out do not count. The excess over
        a limit is relative.
        """
        low, high = span

        def excess(log_thickness: float) -> float:
            found = self.measures(math.exp(log_thickness))
            return max(math.log(found[name] / limit) for name, limit in limits.items())

        best = low
        if excess(low) > 0:
            best = high if excess(high) > 0 else root(excess, low, high)
        return math.exp(best), max(excess(best), 0.0)

    def least(self) -> dict[str, float]:
        """Return the least thickness in m for each limit.

        It is a closed form and a second route: all limited quantities are proportional to 1 over
        the thickness.
        """
        at_one = self.measures(1.0)
        return {name: at_one[name] / limit for name, limit in self.limits.items()}

    def within(self, thickness: np.ndarray, accepted: float) -> np.ndarray:
        """Return whether thicknesses (m,) meet all limits, up to a share `accepted` of them."""
        found = self.measures(thickness)
        fits = [found[name] <= limit * (1 + accepted) for name, limit in self.limits.items()]
        return np.all(fits, axis=0)


class Tube(Given):
    """The membrane, a tube."""

    radius: float = positive("length", "radius of the tube", default=4e-3)
    youngs_modulus: float = positive("stress", "Young's modulus of the membrane", default=5e5)
    diffusivity: float = positive(
        "diffusivity", "diffusivity of the carrier liquid in the membrane", default=1e-11
    )
    concentration_drop: float = positive(
        "density",
        "difference of that liquid's density from the inner to the outer face",
        default=0.15,
    )
    stress_max: float = positive("stress", "hoop stress at the full pressure", default=5e4)
    strain_max: float = positive("share", "strain at the full pressure", default=0.1)


class Filling(Given):
    """The fluid in the membrane."""

    pressure: float = positive("stress", "magnetic pressure, above the pressure outside")
    density: float = positive("density", "density of the fluid", default=1200.0)


@dataclass(frozen=True)
class Front:
    """Thicknesses of the largest strain for each allowed loss, from the thickest wall."""

    front_thickness: np.ndarray = signal("length", "point", "thickness")
    front_loss: np.ndarray = signal("share", "point", "share of the fluid lost within the lifetime")
    front_strain: np.ndarray = signal("share", "point", "strain")
    front_contact_pressure: np.ndarray = signal("stress", "point", "pressure on the ground")
    front_within: np.ndarray = signal("count", "point", "1 if all limits hold, else 0")


class MembraneThickness(SIStudy, kind="membrane"):
    """Choose the thickness of a membrane: strain against loss of fluid, Pareto front.

    The skin of a worm filled with magnetic fluid should be thin for large strain and force, but
    thick to keep the fluid. The scene computes the best thickness within limits, and the Pareto
    front of strain and loss. Theory:
    [theory-hydrostatics.md](../theory-hydrostatics.md#2-the-membrane). Only
    `units = "SI"`.

    The trust report names its `assumptions`, among them that the tube's ends are free. It has
    `violation` of limits, `recheck_error` (against a closed form), `accepted`, and `warnings`:
    strains that are not small, a wall above a tenth of the radius, no pressure left to push. The
    exit code is 3 if no thickness meets all limits; the message gives the need of each limit.
    """

    pictures: ClassVar = {"membrane": "strain over loss, and remaining pressure over thickness"}
    headline: ClassVar = (
        "thickness_best", "limited_by", "thickness_for_loss", "thickness_for_stress",
        "thickness_for_strain",
    )  # fmt: skip

    membrane: Tube = entry("the membrane", default=Tube)
    fluid: Filling = entry("the fluid")
    lifetime: float = positive("time", "required lifetime of the fluid")
    loss_max: float = number(
        "share", "largest share of fluid lost in that time", above=0, below=1, default=0.1
    )
    thickness: Pair = entry(
        "least and largest thickness that can be made, below `membrane.radius`",
        quantity="length",
        default=(2e-5, 2e-3),
    )
    contact_strain: float = number(
        "share", "strain at which the worm touches the ground or its channel", least=0, default=0.02
    )
    samples: int = whole(3, 1000, "number of points of the front", default=41)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from wrong_order("thickness", self.thickness, may_be_equal=False)
        if self.thickness[1] >= self.membrane.radius:
            yield (
                "thickness[1]",
                f"{self.thickness[1]:g} m is not thin for a tube of radius "
                f"{self.membrane.radius:g} m; write less than membrane.radius",
            )

    @cached_property
    def choice(self) -> Choice:
        """The membrane and its limits."""
        tube, fluid = self.membrane, self.fluid
        membrane = Membrane(
            tube.radius, tube.youngs_modulus, fluid.pressure, tube.diffusivity,
            tube.concentration_drop, fluid.density, self.contact_strain,
        )  # fmt: skip
        limits = {"loss": self.loss_max, "stress": tube.stress_max, "strain": tube.strain_max}
        return Choice(membrane, self.lifetime, limits)

    @property
    def tube(self) -> Membrane:
        """The membrane as the formulas take it."""
        return self.choice.membrane

    @property
    def span(self) -> tuple[float, float]:
        """Logarithms of the least and largest thickness."""
        thinnest, thickest = self.thickness
        return math.log(thinnest), math.log(thickest)

    @cached_property
    def needed(self) -> dict[str, float]:
        """Least thickness for each limit alone."""
        return self.choice.least()

    @property
    def strictest(self) -> str:
        """Limit that needs the thickest membrane."""
        return max(self.needed, key=lambda name: self.needed[name])

    @stage
    def best_thickness(self) -> tuple[float, float]:
        """Best thickness, and by how much it exceeds a limit."""
        return self.choice.widest(self.span, **self.choice.limits)

    @stage
    def thicknesses(self) -> np.ndarray:
        """Thicknesses of the largest strain for each allowed loss."""
        most, least = (self.choice.measures(size)["loss"] for size in self.thickness)
        found = np.empty(self.samples)
        for k, allowed in enumerate(np.geomspace(least, most, self.samples)):
            self.report("front", k / self.samples)
            found[k], _ = self.choice.widest(self.span, loss=allowed)
        return found

    @parts(Front)
    def front(self) -> Front:
        choice, thickness = self.choice, self.thicknesses
        found, left = choice.measures(thickness), self.tube.contact_pressure(thickness)
        within = choice.within(thickness, _ACCEPTED)
        return Front(thickness, found["loss"], found["strain"], left, within)

    @scalar("length", "thickness with the largest strain within all limits")
    def thickness_best(self) -> float:
        return self.best_thickness[0]

    @scalar(
        "1",
        "limit that determines it: `loss`, `stress`, `strain`, or `thickness` if the thinnest "
        "allowed meets all limits",
    )
    def limited_by(self) -> str:
        return self.strictest if self.needed[self.strictest] >= self.thickness[0] else "thickness"

    @scalars(_LEAST)
    def least(self) -> dict[str, float]:
        return {f"thickness_for_{name}": size for name, size in self.needed.items()}

    @scalars(_GIVEN)
    def given(self) -> dict[str, float]:
        limits = {f"{name}_max": limit for name, limit in self.choice.limits.items()}
        return limits | {"lifetime": self.lifetime}

    @scalar("share", "strain at the best thickness")
    def strain(self) -> float:
        return self.tube.strain(self.thickness_best)

    @scalar("stress", "hoop stress at the best thickness")
    def stress(self) -> float:
        return self.tube.stress(self.thickness_best)

    @scalar("share", "share of fluid lost within the lifetime at the best thickness")
    def loss_share(self) -> float:
        return self.tube.loss_share(self.thickness_best, self.lifetime)

    @scalar("mass_rate_per_length", "initial rate of loss")
    def loss_rate(self) -> float:
        return self.tube.loss_rate(self.thickness_best)

    @scalar("stress", "pressure left to push against the channel")
    def contact_pressure(self) -> float:
        return self.tube.contact_pressure(self.thickness_best)

    @scalar("bending_stiffness", "bending stiffness of the tube as a beam")
    def bending_stiffness(self) -> float:
        return self.tube.bending_stiffness(self.thickness_best)

    # -- the trust report --------------------------------------------------------------------------

    @property
    def conflict(self) -> SolveError:
        """The error if no thickness meets all limits."""
        needed = {name: enough(size, 3, _ACCEPTED / 2) for name, size in self.needed.items()}
        asks = ", ".join(f"{_KEYS[name]} for {size:g} m" for name, size in needed.items())
        unmet = [name for name in _KEYS if self.needed[name] > self.thickness[1] * (1 + _ACCEPTED)]
        suggestion = f"raise {' and '.join(_KEYS[name] for name in unmet)}"
        if needed[self.strictest] < self.membrane.radius:
            suggestion += f", or thickness[1] to {needed[self.strictest]:g}"
        if unmet == ["loss"]:
            suggestion += ", or write a shorter lifetime"
        return SolveError(
            f"no thickness up to {self.thickness[1]:g} m meets all limits; each needs at least: "
            f"{asks}",
            suggestion,
            code="infeasible",
        )

    def unsolved(self) -> SolveError | None:
        return None if self.best_thickness[1] <= _ACCEPTED else self.conflict

    @check(_ACCEPTED, "{conflict.reason:s}")
    def limits(self) -> float:
        return self.best_thickness[1]

    @check(
        _ACCEPTED, "the best thickness differs by {value:.2g} from the strictest limit's"
    )  # fmt: skip
    def thickness_in_closed_form(self) -> float:
        return abs(self.thickness_best / max(self.thickness[0], *self.needed.values()) - 1)

    @facts
    def assumptions(self) -> dict[str, Any]:
        return {
            "violation": self.limits,
            "recheck_error": self.thickness_in_closed_form,
            "accepted": _ACCEPTED,
            "assumptions": _ASSUMED,
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        if self.strain > SMALL_STRAIN * (1 + _ACCEPTED):
            yield left_out(
                self.strain,
                f"a strain of {self.strain:.2g} is not small; above {SMALL_STRAIN:g} the law is "
                "uncertain",
            )
        wall = self.thickness_best / self.membrane.radius
        if wall > _THIN:
            yield left_out(
                wall,
                f"the wall is {wall:.2g} of the radius; above {_THIN:g} the membrane is not thin, "
                "and its stress is not uniform over the wall",
            )
        if self.contact_pressure <= 0:
            yield (
                "at contact_strain the membrane carries the whole pressure: none is left to push "
                "against the ground"
            )
