"""A thin membrane around a magnetic fluid: thin it stretches and pushes, thick it keeps the fluid.

The tube has the radius R, a wall h_m that is small against R, and the inner pressure p of the
fluid: hoop stress p R / h_m, strain p R / (E h_m). The ends are free to shorten, so no stress acts
along the tube; ends that the pressure pulls apart would leave a hoop strain of (1 - nu / 2) p R /
(E h_m) with Poisson's ratio nu. Fluid diffuses through it at the rate D dc / h_m per area. All
functions take numbers, arrays or CasADi expressions. Loss, stress and strain all fall with
thickness, so the best membrane is the thinnest within its limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.magnetics.material import check_number
from wormopt.numerics.roots import root


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

    def least(self, thinnest: float) -> float:
        """Return the least thickness in m, from `thinnest` on, within all limits.

        It is a closed form and a second route: all limited quantities are proportional to 1 over
        the thickness.
        """
        at_one = self.measures(1.0)
        return max(thinnest, *(at_one[name] / limit for name, limit in self.limits.items()))

    def within(self, thickness: np.ndarray, accepted: float) -> np.ndarray:
        """Return whether thicknesses (m,) meet all limits, up to a share `accepted` of them."""
        found = self.measures(thickness)
        fits = [found[name] <= limit * (1 + accepted) for name, limit in self.limits.items()]
        return np.all(fits, axis=0)
