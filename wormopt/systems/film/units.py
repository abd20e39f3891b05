"""A film of magnetic fluid in SI units: the scales of eq. 25 of Zimmermann et al. 2007."""

from __future__ import annotations

import math
from collections.abc import Iterator

from wormopt.errors import ArgumentError
from wormopt.quantities import GRAVITY
from wormopt.result import left_out
from wormopt.study import Given, number, on_use, positive

with on_use():
    import numpy as np

    from wormopt.magnetics import pressure as magnetic
    from wormopt.model.values import numbers

# Quantities that must be small give a warning above this value.
_SMALL = 0.1


class Fluid(Given):
    """Fluid, film and travelling wave in SI units, and their scales.

    Source: eq. 25 of Zimmermann et al. 2007.

    Raises
    ------
    ArgumentError
        If a value is not a number, or out of its range.

    Examples
    --------
    >>> oil = Fluid(
    ...     mu_r=1.05, viscosity=0.01, density=1100.0, surface_tension=0.03,
    ...     depth="0.1 mm", wavelength="10 mm", frequency=10.0,
    ... )
    >>> round(oil.eps, 6), round(oil.tension, 6), round(oil.pressure, 3)
    (0.062832, 0.046756, 25.33)
    >>> oil.field([0.0, 1.86339]).round(3).tolist()
    [0.0, 38761.188]
    """

    mu_r: float = number("1", "relative permeability", above=1)
    viscosity: float = positive("viscosity", "dynamic viscosity")
    density: float = positive("density", "density of the fluid")
    surface_tension: float = number("surface_tension", "surface tension; 0: none", least=0)
    depth: float = positive("length", "mean thickness of the film")
    wavelength: float = positive("length", "wavelength of the wave")
    frequency: float = positive("angular_frequency", "frequency of the wave")

    @property
    def wave_number(self) -> float:
        """Wave number k in rad/m; lengths along the film are in units of 1/k."""
        return 2 * math.pi / self.wavelength

    @property
    def eps(self) -> float:
        """eps, depth times wave number, which must be small."""
        return self.depth * self.wave_number

    @property
    def speed(self) -> float:
        """U_c = omega / k in m/s, speed of the wave and unit of velocities along the film."""
        return self.frequency / self.wave_number

    @property
    def pressure(self) -> float:
        """P = eta omega / eps² in Pa, unit of pressures."""
        return self.viscosity * self.frequency / self.eps**2

    @property
    def reynolds(self) -> float:
        """Reynolds number Re = rho U_c d / eta; inertia has the relative size eps Re."""
        return self.density * self.speed * self.depth / self.viscosity

    @property
    def tension(self) -> float:
        """Dimensionless surface tension W = gamma d k² / P."""
        return self.surface_tension * self.depth * self.wave_number**2 / self.pressure

    @property
    def gravity(self) -> float:
        """Weight of the film rho g d over P, which lubrication theory neglects here."""
        return self.density * GRAVITY * self.depth / self.pressure

    def field(self, pressure: object) -> np.ndarray:
        """Field H of a magnetic pressure.

        Parameters
        ----------
        pressure : array_like, any shape
            (mu - 1) H² / (8 pi) in units of P, as in the formulas of the film; 0 or above.

        Returns
        -------
        ndarray
            Field in A/m, same shape.

        Raises
        ------
        ArgumentError
            If the pressure is not a number or negative.
        """
        given = numbers("pressure", pressure)
        if not np.all(given >= 0):
            raise ArgumentError(
                "pressure is below 0, which no field has; write H0² of at least D_max"
            )
        return np.asarray(magnetic.field_of(self.mu_r, given * self.pressure))

    def gaussian_field(self, pressure: object) -> np.ndarray:
        """Field H of a magnetic pressure, in oersted.

        Parameters
        ----------
        pressure : array_like, any shape
            (mu - 1) H² / (8 pi) in units of P; 0 or above.

        Returns
        -------
        ndarray
            Field in Oe, same shape.
        """
        return self.field(pressure) / magnetic.OERSTED

    def warnings(self) -> Iterator[str]:
        """Yield a warning for each parameter that is not as small as the theory assumes.

        A value above 1 leaves a result unchecked.

        Yields
        ------
        str
            Warning.

        Examples
        --------
        >>> oil = Fluid(
        ...     mu_r=1.05, viscosity=0.01, density=1100.0, surface_tension=0.03,
        ...     depth=1e-4, wavelength=0.01, frequency=10.0,
        ... )
        >>> list(oil.warnings()), len(list(oil.vary(mu_r=2.0, depth=1e-3).warnings()))
        ([], 4)
        """
        inertia = self.eps * self.reynolds
        for value, name, what in (
            (
                self.eps,
                "eps = depth times wave number",
                "lubrication theory neglects relative errors of order eps²",
            ),
            (
                inertia,
                "eps Re",
                "lubrication theory neglects inertia, which has this relative size",
            ),
            (self.mu_r - 1, "mu_r - 1", "the effect of the fluid on the field is neglected"),
            (self.gravity, "rho g d / P", "the weight of the fluid is neglected"),
        ):
            if value > _SMALL:
                text = f"{name} is {value:.3g}, not small against 1: {what}"
                yield left_out(value, text)
