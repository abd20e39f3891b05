"""A thin membrane round a magnetic fluid: thin it stretches and pushes, thick it keeps the fluid.

A tube of the radius R and the wall h_m, small against R, under the pressure p of the fluid: hoop
stress p R / h_m, strain p R / (E h_m). The ends are free to shorten, so that no stress acts along
the tube; ends that the pressure pulls apart would leave a hoop strain of (1 - nu / 2) p R / (E h_m)
with Poisson's ratio nu. Fluid diffuses through it at the rate D dc / h_m per area.
All functions take numbers, arrays or CasADi expressions and check nothing; `Membrane` checks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from wormopt.magnetics.material import check_number

__all__ = ["Membrane"]


@dataclass(frozen=True)
class Membrane:
    """A tube of membrane filled with a fluid, its ends free to shorten; SI units.

    Parameters
    ----------
    radius : float
        R, in m.
    youngs_modulus : float
        E, in Pa.
    pressure : float
        p of the fluid above that outside, in Pa.
    diffusivity : float
        D of the carrier liquid in the membrane, in m²/s.
    concentration_drop : float
        dc of that liquid in the membrane from its inner to its outer face, in kg/m³.
    fluid_density : float
        Of the fluid, in kg/m³.
    contact_strain : float, optional
        Strain at which the tube touches the ground or the channel.

    Raises
    ------
    ArgumentError
        If a number is not above 0, or the contact strain below it.

    Examples
    --------
    >>> tube = Membrane(2.5e-3, 2e5, 2200.0, 2e-11, 10.0, 1200.0)
    >>> round(tube.strain(1e-4), 6), round(tube.stress(1e-4))
    (0.275, 55000)
    """

    radius: float
    youngs_modulus: float
    pressure: float
    diffusivity: float
    concentration_drop: float
    fluid_density: float
    contact_strain: float = 0.0

    def __post_init__(self) -> None:
        for name in (
            "radius", "youngs_modulus", "pressure", "diffusivity", "concentration_drop",
            "fluid_density",
        ):  # fmt: skip
            check_number(name, getattr(self, name))
        if self.contact_strain:
            check_number("contact_strain", self.contact_strain)

    def stress(self, thickness: Any) -> Any:
        """Hoop stress p R / h_m.

        Parameters
        ----------
        thickness : float, ndarray or casadi.SX
            h_m in m.
        """
        return self.pressure * self.radius / thickness

    def strain(self, thickness: Any) -> Any:
        """Strain by which the pressure widens a tube with free ends, p R / (E h_m).

        Parameters
        ----------
        thickness : float, ndarray or casadi.SX
            h_m in m.
        """
        return self.stress(thickness) / self.youngs_modulus

    def contact_pressure(self, thickness: Any) -> Any:
        """What is left of the pressure for the ground at the contact strain e: p - E e h_m / R.

        Parameters
        ----------
        thickness : float, ndarray or casadi.SX
            h_m in m.
        """
        held = self.youngs_modulus * self.contact_strain / self.radius
        return self.pressure - held * thickness

    def bending_stiffness(self, thickness: Any) -> Any:
        """Bending stiffness of the tube as a beam, pi E R³ h_m, in N m².

        Parameters
        ----------
        thickness : float, ndarray or casadi.SX
            h_m in m.
        """
        return math.pi * self.youngs_modulus * self.radius**3 * thickness

    def loss_rate(self, thickness: Any) -> Any:
        """Mass lost per time and length of the tube, D A dc / h_m with A = 2 pi R, in kg/(s m).

        Parameters
        ----------
        thickness : float, ndarray or casadi.SX
            h_m in m.
        """
        wall = 2 * math.pi * self.radius
        return self.diffusivity * wall * self.concentration_drop / thickness

    def loss_share(self, thickness: Any, lifetime: Any) -> Any:
        """Share of the fluid that is lost within a time, at the rate of the beginning.

        Parameters
        ----------
        thickness : float, ndarray or casadi.SX
            h_m in m.
        lifetime : float, ndarray or casadi.SX
            In s.

        Returns
        -------
        float, ndarray or casadi.SX
            2 D dc t / (R h_m rho); the rate does not grow, so it is no less than what is lost.
        """
        filling = math.pi * self.radius**2 * self.fluid_density
        return self.loss_rate(thickness) * lifetime / filling
