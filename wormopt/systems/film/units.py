"""A film of magnetic fluid in SI units: the scales of (25), and what lubrication leaves out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import check_number
from wormopt.magnetics.pressure import OERSTED, field_of
from wormopt.model.values import numbers
from wormopt.quantities import GRAVITY
from wormopt.result import left_out

# Numbers that shall be small against 1 are warned of above this.
_SMALL = 0.1


@dataclass(frozen=True)
class Fluid:
    """Fluid, film and travelling wave in SI units, and the scales of (25).

    Parameters
    ----------
    mu_r : float
        Relative permeability, above 1.
    viscosity : float
        Dynamic viscosity eta, Pa s.
    density : float
        rho, kg/m³.
    surface_tension : float
        gamma, N/m; 0 or above.
    depth : float
        Mean thickness d, m.
    wavelength : float
        2 pi / k, m.
    frequency : float
        Angular frequency omega of the wave, rad/s.

    Raises
    ------
    ArgumentError
        If a number is none, or out of its range.

    Examples
    --------
    >>> oil = Fluid(1.05, 0.01, 1100.0, 0.03, 1e-4, 0.01, 10.0)
    >>> round(oil.eps, 6), round(oil.tension, 6), round(oil.pressure, 3)
    (0.062832, 0.046756, 25.33)
    >>> oil.field([0.0, 1.86339]).round(3).tolist()
    [0.0, 38761.188]
    """

    mu_r: float
    viscosity: float
    density: float
    surface_tension: float
    depth: float
    wavelength: float
    frequency: float

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == "surface_tension" and value == 0:
                continue
            least = 1.0 if each.name == "mu_r" else 0.0
            object.__setattr__(self, each.name, check_number(each.name, value, above=least))

    @property
    def wave_number(self) -> float:
        """k, rad/m: lengths along the film are in units of 1/k."""
        return 2 * math.pi / self.wavelength

    @property
    def eps(self) -> float:
        """Depth times wave number, which shall be small."""
        return self.depth * self.wave_number

    @property
    def speed(self) -> float:
        """U_c = omega / k, m/s: speed of the wave and unit of velocities along the film."""
        return self.frequency / self.wave_number

    @property
    def pressure(self) -> float:
        """P = eta omega / eps², Pa: unit of pressures."""
        return self.viscosity * self.frequency / self.eps**2

    @property
    def reynolds(self) -> float:
        """Re = rho U_c d / eta; inertia is of the share eps Re."""
        return self.density * self.speed * self.depth / self.viscosity

    @property
    def tension(self) -> float:
        """W = gamma d k² / P."""
        return self.surface_tension * self.depth * self.wave_number**2 / self.pressure

    @property
    def gravity(self) -> float:
        """Weight of the film rho g d over P, which lubrication leaves out here."""
        return self.density * GRAVITY * self.depth / self.pressure

    def field(self, pressure: object) -> np.ndarray:
        """Field H that acts with a pressure.

        Parameters
        ----------
        pressure : array_like, any shape
            (mu - 1) H² / (8 pi) as the film's formulas have it, in units of P; 0 or above.

        Returns
        -------
        ndarray
            In A/m.

        Raises
        ------
        ArgumentError
            If it is no number or negative.
        """
        given = numbers("pressure", pressure)
        if not np.all(given >= 0):
            raise ArgumentError("no field acts with a pressure below 0; take H0² at least D_max")
        return np.asarray(field_of(self.mu_r, given * self.pressure))

    def gaussian_field(self, pressure: object) -> np.ndarray:
        """Give the same in oersted.

        Parameters
        ----------
        pressure : array_like, any shape
            As for `field`.

        Returns
        -------
        ndarray
        """
        return self.field(pressure) / OERSTED

    def warnings(self) -> Iterator[str]:
        """Say which numbers are not as small as the theory takes them to be.

        Above 1 they leave a result unchecked.

        Yields
        ------
        str

        Examples
        --------
        >>> list(Fluid(1.05, 0.01, 1100.0, 0.03, 1e-4, 0.01, 10.0).warnings())
        []
        >>> len(list(Fluid(2.0, 0.001, 1100.0, 0.03, 1e-3, 0.01, 10.0).warnings()))
        4
        """
        inertia = self.eps * self.reynolds
        for value, name, what in (
            (self.eps, "eps = depth times wave number", "lubrication leaves out shares of eps²"),
            (inertia, "eps Re", "lubrication leaves out inertia, a share of this size"),
            (self.mu_r - 1, "mu_r - 1", "the field is taken as if the fluid were not there"),
            (self.gravity, "rho g d / P", "the weight of the fluid is left out"),
        ):
            if value > _SMALL:
                text = f"{name} is {value:.3g}, not small against 1: {what}"
                yield left_out(value, text)
