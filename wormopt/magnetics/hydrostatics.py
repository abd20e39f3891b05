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

_HALVINGS = 64  # more than a float has digits


@dataclass(frozen=True)
class Linear:
    """Magnetisation M = chi H.

    Raises ArgumentError if chi is not above 0.
    """

    chi: float  # susceptibility

    def __post_init__(self) -> None:
        check_number("chi", self.chi)

    def ratio(self, square: Any) -> Any:
        """M / H, the same in every field; `square` is H² in A²/m²."""
        return self.chi + 0 * square

    def energy(self, square: Any) -> Any:
        """Integral of M over H from 0: chi H² / 2; `square` is H² in A²/m²."""
        return self.chi * square / 2


@dataclass(frozen=True)
class Langevin:
    """M = M_s (coth y - 1 / y), y = 3 chi H / M_s: particles that do not feel each other.

    Raises ArgumentError if a number is not above 0.
    """

    chi: float  # initial susceptibility
    saturation: float  # M_s in strong fields, A/m

    def __post_init__(self) -> None:
        check_number("chi", self.chi)
        check_number("saturation", self.saturation)

    def ratio(self, square: Any) -> Any:
        """M / H, falling from chi; `square` is H² in A²/m²."""
        return 3 * self.chi * langevin_ratio(self._y2(square))

    def energy(self, square: Any) -> Any:
        """Integral of M over H from 0: M_s² / (3 chi) ln(sinh y / y); `square` is H² in A²/m²."""
        return self.saturation**2 / (3 * self.chi) * log_sinh_ratio(self._y2(square))

    def _y2(self, square: Any) -> Any:
        return (3 * self.chi / self.saturation) ** 2 * square


Magnetisation = Linear | Langevin
"""How a fluid takes magnetisation, as functions of H²."""


@dataclass(frozen=True)
class Fluid:
    """A magnetic fluid.

    Raises ArgumentError if a number is not above 0.
    """

    density: float  # kg/m³
    surface_tension: float  # N/m
    magnetisation: Magnetisation
    gravity: float = 9.81  # m/s²

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
    """Pressure in the fluid at height `z` (m), above that outside, in Pa.

    `square`: H² there, A²/m². `level`: the constant P over the weight per volume, m, where
    a surface without field and curvature would be.
    """
    return fluid.weight * (level - z) + MU0 * fluid.magnetisation.energy(square)


def pull(fluid: Fluid, field: tuple[Any, Any], slope: Any) -> Any:
    """What the field adds to the pressure at the surface: mu0 int M dH + mu0 M_n² / 2, in Pa.

    The second part is the jump of the stress across the surface.
    `field`: H along x and z, A/m; `slope`: h'.
    """
    along, up = field
    square = along * along + up * up
    normal2 = (up - slope * along) ** 2 / (1 + slope * slope)
    law = fluid.magnetisation
    return MU0 * (law.energy(square) + law.ratio(square) ** 2 * normal2 / 2)


def flat_layer_pull(fluid: Fluid, field: tuple[Any, Any], slope: Any) -> Any:
    """`pull` (Pa) with the field weakened as in a flat thin layer, to judge what is neglected.

    Across the layer H + M stays what H is outside, along it H does; M/H is that inside.
    `field`: H outside along x and z, A/m; `slope`: h'.
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
    """Residual of the balance of stresses across the surface z = h(x) of fluid below it.

    Over the weight per volume, in m; 0 where the surface rests. `field`: H along x and z,
    A/m; `z`, `slope`, `bend`: h, h', h''; `level` as for `pressure`.
    """
    curvature = -bend / (1 + slope * slope) ** 1.5
    stress = pull(fluid, field, slope) - fluid.surface_tension * curvature
    return level - z + stress / fluid.weight
