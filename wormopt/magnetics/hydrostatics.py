"""A layer of magnetic fluid at rest in the field of a coil: pressure, and balance at its surface.

SI units. The pressure is p = P - rho g z + mu0 int_0^H M dH with one constant P; the surface
z = h(x) rests where p + mu0 M_n² / 2 = gamma times its curvature, the pressure outside being 0.
The fluid does not change the field of the coil. All functions take numbers, arrays or CasADi
expressions, but for `flat_layer_pull`, which solves an equation and takes no expressions. Laws of
magnetisation are functions of H², so that H = 0 is no special case.

Sources: chapter 3.5; R. E. Rosensweig, Ferrohydrodynamics, 1985, chapter 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.magnetics.langevin import langevin_ratio, log_sinh_ratio
from wormopt.magnetics.material import MU0, check_number

__all__ = [
    "Fluid",
    "Langevin",
    "Linear",
    "Magnetisation",
    "balance",
    "flat_layer_pull",
    "pressure",
    "pull",
]

_HALVINGS = 64  # more than a float has digits


@dataclass(frozen=True)
class Linear:
    """M = chi H.

    Parameters
    ----------
    chi : float
        Susceptibility, above 0.

    Raises
    ------
    ArgumentError
        If it is not.

    Examples
    --------
    >>> Linear(0.35).energy(1e10)
    1750000000.0
    """

    chi: float

    def __post_init__(self) -> None:
        check_number("chi", self.chi)

    def ratio(self, square: Any) -> Any:
        """M / H, the same in every field.

        Parameters
        ----------
        square : float, ndarray or casadi.SX
            H² in A²/m².
        """
        return self.chi + 0 * square

    def energy(self, square: Any) -> Any:
        """Integral of M over H from 0: chi H² / 2.

        Parameters
        ----------
        square : float, ndarray or casadi.SX
            H² in A²/m².
        """
        return self.chi * square / 2


@dataclass(frozen=True)
class Langevin:
    """M = M_s (coth y - 1 / y), y = 3 chi H / M_s: particles that do not feel each other.

    Parameters
    ----------
    chi : float
        Initial susceptibility, above 0.
    saturation : float
        Magnetisation M_s in strong fields, in A/m, above 0.

    Raises
    ------
    ArgumentError
        If one of them is not.

    Examples
    --------
    In strong fields all particles are aligned.

    >>> fluid = Langevin(chi=0.35, saturation=2e4)
    >>> round(fluid.ratio(1e16) * 1e8)
    19996
    """

    chi: float
    saturation: float

    def __post_init__(self) -> None:
        check_number("chi", self.chi)
        check_number("saturation", self.saturation)

    def ratio(self, square: Any) -> Any:
        """M / H, falling from chi.

        Parameters
        ----------
        square : float, ndarray or casadi.SX
            H² in A²/m².
        """
        return 3 * self.chi * langevin_ratio(self._y2(square))

    def energy(self, square: Any) -> Any:
        """Integral of M over H from 0: M_s² / (3 chi) ln(sinh y / y).

        Parameters
        ----------
        square : float, ndarray or casadi.SX
            H² in A²/m².
        """
        return self.saturation**2 / (3 * self.chi) * log_sinh_ratio(self._y2(square))

    def _y2(self, square: Any) -> Any:
        return (3 * self.chi / self.saturation) ** 2 * square


Magnetisation = Linear | Langevin
"""How a fluid takes magnetisation, as functions of H²."""


@dataclass(frozen=True)
class Fluid:
    """A magnetic fluid.

    Parameters
    ----------
    density : float
        In kg/m³.
    surface_tension : float
        In N/m.
    magnetisation : Linear or Langevin
        Its law.
    gravity : float, optional
        In m/s².

    Raises
    ------
    ArgumentError
        If a number is not above 0.

    Examples
    --------
    >>> water = Fluid(density=1000.0, surface_tension=0.072, magnetisation=Linear(0.1))
    >>> round(1e3 * water.capillary_length, 3)
    2.709
    """

    density: float
    surface_tension: float
    magnetisation: Magnetisation
    gravity: float = 9.81

    def __post_init__(self) -> None:
        for name in ("density", "surface_tension", "gravity"):
            check_number(name, getattr(self, name))

    @property
    def weight(self) -> float:
        """Weight per volume, in N/m³."""
        return self.density * self.gravity

    @property
    def capillary_length(self) -> float:
        """Length over which surface tension flattens a surface, in m."""
        return (self.surface_tension / self.weight) ** 0.5


def pressure(fluid: Fluid, z: Any, square: Any, level: Any) -> Any:
    """Pressure in the fluid, above that outside.

    Parameters
    ----------
    fluid : Fluid
        Which.
    z : float, ndarray or casadi.SX
        Height, in m.
    square : float, ndarray or casadi.SX
        H² there, in A²/m².
    level : float, ndarray or casadi.SX
        The constant P over the weight per volume, in m: where a surface without field and
        curvature would be.

    Returns
    -------
    float, ndarray or casadi.SX
        In Pa.

    Examples
    --------
    At a depth of 10 mm, without field and in one of 100 kA/m:

    >>> fluid = Fluid(1200.0, 0.03, Linear(0.35))
    >>> [round(pressure(fluid, 0.0, H**2, 0.01), 2) for H in (0.0, 1e5)]
    [117.72, 2316.83]
    """
    return fluid.weight * (level - z) + MU0 * fluid.magnetisation.energy(square)


def pull(fluid: Fluid, field: tuple[Any, Any], slope: Any) -> Any:
    """What the field adds to the pressure at the surface: mu0 int M dH + mu0 M_n² / 2.

    Parameters
    ----------
    fluid : Fluid
        Which.
    field : (float, float), of ndarray or of casadi.SX
        Components of H along x and z, in A/m.
    slope : float, ndarray or casadi.SX
        h'.

    Returns
    -------
    float, ndarray or casadi.SX
        In Pa. The second part is the jump of the stress across the surface.

    Examples
    --------
    A field across the surface pulls by 1 + chi times what one along it does.

    >>> fluid = Fluid(1200.0, 0.03, Linear(0.5))
    >>> round(pull(fluid, (0.0, 1e4), 0.0) / pull(fluid, (1e4, 0.0), 0.0), 12)
    1.5
    """
    along, up = field
    square = along * along + up * up
    normal2 = (up - slope * along) ** 2 / (1 + slope * slope)
    law = fluid.magnetisation
    return MU0 * (law.energy(square) + law.ratio(square) ** 2 * normal2 / 2)


def flat_layer_pull(fluid: Fluid, field: tuple[Any, Any], slope: Any) -> Any:
    """`pull` with the field weakened as in a flat thin layer, to judge what is neglected.

    Across the layer H + M stays what H is outside, along it H does. M/H is that of the field
    inside, so that the field across the layer is the root of an equation.

    Parameters
    ----------
    fluid : Fluid
        Which.
    field : (float, float) or of ndarray
        Components of H outside along x and z, in A/m.
    slope : float or ndarray
        h'.

    Returns
    -------
    float or ndarray
        In Pa.

    Examples
    --------
    >>> fluid = Fluid(1200.0, 0.03, Linear(0.5))
    >>> exact = 2e-7 * 3.141592653589793 * 0.5 / 1.5 * 1e4**2
    >>> round(float(flat_layer_pull(fluid, (0.0, 1e4), 0.0)) / exact, 12)
    1.0
    """
    along, up = field
    root = (1 + slope * slope) ** 0.5
    normal, tangent = (up - slope * along) / root, (along + slope * up) / root
    inside = _inside(fluid.magnetisation, normal, tangent)
    # turned into the frame of the surface, where it has no slope
    return pull(fluid, (tangent, inside), 0.0)


def _inside(law: Magnetisation, normal: Any, tangent: Any) -> Any:
    """Root H of H (1 + M/H) = normal, M/H at H² + tangent²; by halving, as H + M rises with H."""
    wanted = np.abs(normal)
    low, high = np.zeros_like(wanted), wanted
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        short = middle * (1 + law.ratio(middle * middle + tangent * tangent)) < wanted
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.copysign((low + high) / 2, normal)


def balance(fluid: Fluid, field: tuple[Any, Any], z: Any, slope: Any, bend: Any, level: Any) -> Any:
    """What is left of the balance of stresses across the surface z = h(x) of fluid below it.

    Parameters
    ----------
    fluid : Fluid
        Which.
    field : (float, float), of ndarray or of casadi.SX
        Components of H there along x and z, in A/m.
    z, slope, bend : float, ndarray or casadi.SX
        h, h' and h''.
    level : float, ndarray or casadi.SX
        As for `pressure`.

    Returns
    -------
    float, ndarray or casadi.SX
        Over the weight per volume, in m; 0 where the surface rests.

    Examples
    --------
    >>> balance(Fluid(1200.0, 0.03, Linear(0.5)), (0.0, 0.0), 0.01, 0.0, 0.0, 0.01)
    0.0
    """
    curvature = -bend / (1 + slope * slope) ** 1.5
    stress = pull(fluid, field, slope) - fluid.surface_tension * curvature
    return level - z + stress / fluid.weight
