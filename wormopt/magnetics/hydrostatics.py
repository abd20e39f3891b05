"""A layer of magnetic fluid at rest near a coil: magnetisation, pressure, surface balance.

SI units. The pressure is p = P - rho g z + mu0 int_0^H M dH with one constant P. The surface z =
h(x) is at rest where p + mu0 M_n² / 2 = gamma times its curvature, with zero pressure outside. The
effect of the fluid on the field of the coil is neglected. Functions take numbers, arrays or CasADi
expressions, except for `flat_layer_pull`, which solves an equation and takes no expressions. Laws
of magnetisation are functions of H², so H = 0 is no special case. Langevin's function and its
integral are power series in y² below y = 1, and closed forms without cancellation or overflow
above. Both branches are evaluated where they are finite, so derivatives by CasADi are those of the
chosen branch.

Sources: section 3.5 of Zimmermann et al. 2007; R. E. Rosensweig, Ferrohydrodynamics, 1985, chapter
5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from scipy.special import zeta

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import MU0, check_number
from wormopt.magnetics.winding import Coil
from wormopt.quantities import GRAVITY

Direction = Literal["vertical", "along"]
Side = Literal["below", "above"]

_HALVINGS = 64  # more than a float has digits
# The series go like (y / pi)^(2 k): at y = 1 this many terms leave 1e-17.
_TERMS = 17


@dataclass(frozen=True)
class Linear:
    """Linear magnetisation M = chi H.

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
    """Langevin's law M = M_s (coth y - 1 / y), y = 3 chi H / M_s.

    It holds for particles without interaction. Raises ArgumentError if a parameter is not above 0.
    """

    chi: float  # initial susceptibility
    saturation: float  # M_s in strong fields, A/m

    def __post_init__(self) -> None:
        check_number("chi", self.chi)
        check_number("saturation", self.saturation)

    def ratio(self, square: Any) -> Any:
        """M / H, decreasing from chi; `square` is H² in A²/m²."""
        return 3 * self.chi * langevin_ratio(self._y2(square))

    def energy(self, square: Any) -> Any:
        """Integral of M over H from 0: M_s² / (3 chi) ln(sinh y / y); `square` is H² in A²/m²."""
        return self.saturation**2 / (3 * self.chi) * log_sinh_ratio(self._y2(square))

    def _y2(self, square: Any) -> Any:
        return (3 * self.chi / self.saturation) ** 2 * square


Magnetisation = Linear | Langevin
"""Magnetisation law of a fluid, as functions of H²."""


@dataclass(frozen=True)
class Fluid:
    """A magnetic fluid.

    Raises ArgumentError if a parameter is not above 0.
    """

    density: float  # kg/m³
    surface_tension: float  # N/m
    magnetisation: Magnetisation
    gravity: float = GRAVITY  # m/s²

    def __post_init__(self) -> None:
        for name in ("density", "surface_tension", "gravity"):
            check_number(name, getattr(self, name))

    @property
    def weight(self) -> float:
        """Weight per volume, in N/m³."""
        return self.density * self.gravity

    @property
    def capillary_length(self) -> float:
        """Capillary length in m, below which surface tension flattens a surface."""
        return (self.surface_tension / self.weight) ** 0.5


def pressure(fluid: Fluid, z: Any, square: Any, level: Any) -> Any:
    """Pressure in the fluid at height `z` (m), relative to that outside, in Pa.

    `square`: H² there, A²/m². `level`: the constant P over the weight per volume, m, which is the
    height of a surface without field and curvature.
    """
    return fluid.weight * (level - z) + MU0 * fluid.magnetisation.energy(square)


def pull(fluid: Fluid, field: tuple[Any, Any], slope: Any, across: Any = 0.0) -> Any:
    """Contribution of the field to the pressure at the surface in Pa: mu0 int M dH + mu0 M_n² / 2.

    The second term is the jump of the stress across the surface. `field`: H along x and z, A/m;
    `slope`: h'; `across`: H along y, A/m.
    """
    along, up = field
    square = along * along + up * up + across * across
    normal2 = (up - slope * along) ** 2 / (1 + slope * slope)
    law = fluid.magnetisation
    return MU0 * (law.energy(square) + law.ratio(square) ** 2 * normal2 / 2)


def flat_layer_pull(fluid: Fluid, field: tuple[Any, Any], slope: Any) -> Any:
    """`pull` (Pa) with the field of a flat thin layer, to estimate the neglected effect.

    Across the layer H + M equals H outside, along it H does; M/H is that inside. `field`: H outside
    along x and z, A/m; `slope`: h'.
    """
    along, up = field
    root = (1 + slope * slope) ** 0.5
    normal, tangent = (up - slope * along) / root, (along + slope * up) / root
    inside = _inside(fluid.magnetisation, normal, tangent)
    # in the frame of the surface, where the slope is 0
    return pull(fluid, (tangent, inside), 0.0)


def _inside(law: Magnetisation, normal: Any, tangent: Any) -> Any:
    """Root H of H (1 + M/H) = normal, M/H at H² + tangent²; by bisection, as H + M rises with H."""
    wanted = np.abs(normal)
    low, high = np.zeros_like(wanted), wanted
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        short = middle * (1 + law.ratio(middle * middle + tangent * tangent)) < wanted
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.copysign((low + high) / 2, normal)


def balance(fluid: Fluid, field: tuple[Any, Any], z: Any, slope: Any, bend: Any, level: Any) -> Any:
    """Residual of the balance of stresses across the surface z = h(x) of fluid below it.

    Over the weight per volume, in m; 0 where the surface is at rest. `field`: H along x and z, A/m;
    `z`, `slope`, `bend`: h, h', h''; `level` as for `pressure`.
    """
    curvature = -bend / (1 + slope * slope) ** 1.5
    stress = pull(fluid, field, slope) - fluid.surface_tension * curvature
    return level - z + stress / fluid.weight


def log_sinh_ratio(y2: Any) -> Any:
    """ln(sinh y / y), the integral of Langevin's function from 0; `y2` is y² ≥ 0."""
    return _either(y2, lambda small: small * _sum(small, _series), _log_sinh)


def langevin_ratio(y2: Any) -> Any:
    """Langevin's function over its argument, (coth y - 1 / y) / y; `y2` is y² ≥ 0.

    It is 1/3 at 0, and decreases.
    """

    # twice the derivative of the integral with respect to y²
    def near(small: Any) -> Any:
        return _sum(small, lambda k: 2 * k * _series(k))

    return _either(y2, near, _coth)


def _series(k: int) -> float:
    """Coefficient of y^(2k) in ln(sinh y / y), from Euler's product for sinh."""
    return -((-1) ** k) * float(zeta(2 * k)) / (k * math.pi ** (2 * k))


def _sum(y2: Any, coefficient: Callable[[int], float]) -> Any:
    """Coefficients 1, 2, ... times powers 0, 1, ..., by Horner's rule."""
    found = 0.0
    for k in range(_TERMS, 0, -1):
        found = found * y2 + coefficient(k)
    return found


def _either(y2: Any, near: Callable[[Any], Any], far: Callable[[Any], Any]) -> Any:
    if isinstance(y2, ca.SX):
        small: ca.SX = y2 < 1
        inner, outer = ca.if_else(small, y2, ca.SX(0)), ca.if_else(small, ca.SX(1), y2)
        return ca.if_else(small, near(inner), far(outer))
    return np.where(np.less(y2, 1), near(np.minimum(y2, 1)), far(np.maximum(y2, 1)))[()]


def _log_sinh(y2: Any) -> Any:
    kit: Any = ca if isinstance(y2, ca.SX) else np
    y = y2**0.5
    return y - kit.log(2 * y) + kit.log(1 - kit.exp(-2 * y))


def _coth(y2: Any) -> Any:
    kit: Any = ca if isinstance(y2, ca.SX) else np
    y = y2**0.5
    decayed = kit.exp(-2 * y)
    return ((1 + decayed) / (1 - decayed) - 1 / y) / y


@dataclass(frozen=True)
class Placed:
    """A coil under or over a layer whose bottom is at z = 0; its middle is at x = 0.

    Raises ArgumentError if the distance is not above 0, or the side or axis is unknown.
    """

    coil: Coil
    axis: Direction  # "vertical": along z; "along": along x
    side: Side  # "below" or "above"
    distance: float  # bottom of the layer to the nearest point of the coil, m

    def __post_init__(self) -> None:
        check_number("distance", self.distance)
        if self.side not in ("below", "above"):
            raise ArgumentError(f'side is "{self.side}"; write "below" or "above"')
        if self.axis not in ("vertical", "along"):
            raise ArgumentError(f'axis is "{self.axis}"; write "vertical" or "along"')

    @property
    def middle(self) -> float:
        """Height of the middle of the coil in m."""
        size = self.coil.length / 2 if self.axis == "vertical" else self.coil.outer
        return (self.distance + size) * (1 if self.side == "above" else -1)

    @property
    def section(self) -> tuple[tuple[float, float, float, float], ...]:
        """Both halves of the winding in the plane: left end, lower end, width, height, in m."""
        deep, long = self.coil.outer - self.coil.inner, self.coil.length
        return tuple(
            (away, self.middle - long / 2, deep, long)
            if self.axis == "vertical"
            else (-long / 2, self.middle + away, long, deep)
            for away in (-self.coil.outer, self.coil.inner)
        )

    def clearance(self, x: Any, z: Any) -> Any:
        """Distance of points from the winding; `x`, `z` in m."""
        away, s = self._seen(x, z)
        return self.coil.clearance(away * away, s)

    def field(self, x: Any, z: Any, nodes: int | None = None) -> tuple[Any, Any]:
        """Field (Hx, Hz) per ampere-turn in the plane y = 0, in 1/m; `x`, `z` in m.

        `nodes`: of the quadrature over the winding, for expressions, see `Coil.nodes`; without it,
        `x` and `z` must be numbers.
        """
        away, s = self._seen(x, z)
        if nodes is None:
            axial, radial = self.coil.field(away * away, s)
        else:
            axial, radial = self.coil.expression(away * away, s, nodes)
        return (radial * away, axial) if self.axis == "vertical" else (axial, radial * away)

    def _seen(self, x: Any, z: Any) -> tuple[Any, Any]:
        """Distances from the axis and along it."""
        up = z - self.middle
        return (x, up) if self.axis == "vertical" else (up, x)
