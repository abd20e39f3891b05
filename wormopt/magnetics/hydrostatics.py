"""Layers of magnetic fluid at rest in a field: near a coil, or flat with ripples.

SI units. The pressure is p = P - rho g z + mu0 int_0^H M dH with one constant P. The surface z =
h(x) is at rest where p + mu0 M_n² / 2 = gamma times its curvature, with zero pressure outside. The
effect of the fluid on the field of the coil is neglected. Functions take numbers, arrays or CasADi
expressions, except for `flat_layer_pull`, which solves an equation and takes no expressions. Laws
of magnetisation are functions of H², so H = 0 is no special case. Langevin's function and its
integral are power series in y² below y = 1, and closed forms without cancellation or overflow
above. Both branches are evaluated where they are finite, so derivatives by CasADi are those of the
chosen branch.

Ripples: a flat layer of thickness d lies on nonmagnetic ground, with air above; its permeability
is mu_r = 1 + M/H. A ripple a cos(k x) of its surface distorts the field; the potential problem of
first order has the closed solution below. In lubrication theory the ripple changes at the rate

    sigma = -d³ k² / (3 eta) [rho g + gamma k² - mu0 k (M_n² Lambda_n - M_t² Lambda_t) - pull_h],

with T = tanh(k d), D = 2 + (mu_r + 1 / mu_r) T, Lambda_n = (mu_r T + 1) / D for the magnetisation
across the layer, Lambda_t = (1 + T / mu_r) / D for that along x, and `pull_h` the contribution of
the coils' own gradient. In a deep layer the flat surface becomes unstable at the magnetisation of
Cowley and Rosensweig, mu0 M² = 2 (1 + 1 / mu_r) sqrt(rho g gamma).

Sources: section 3.5 of Zimmermann et al. 2007; M. D. Cowley, R. E. Rosensweig, J. Fluid Mech. 30,
1967; R. E. Rosensweig, Ferrohydrodynamics, 1985, chapters 5 and 7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np
from scipy.optimize import minimize_scalar
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
    """Langevin's function over its argument, (coth y - 1 / y) / y; `y2` is y² ≥ 0."""
    # It is 1/3 at 0, and decreases.

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


# Newton's steps: M/H decreases, so they approach from below and double their digits.
_STEPS = 7


def flat_field(law: Magnetisation, H: Sequence[Any], slope: Any) -> tuple[Any, Any, Any]:
    """Field inside a flat layer, by components along its slope, along y, and across it; A/m.

    `H`: field outside along x, y, z. Along the surface H is continuous, across it H + M is.
    """
    along, y, up = H
    root = (1 + slope * slope) ** 0.5
    tangent, normal = (along + slope * up) / root, (up - slope * along) / root
    if isinstance(law, Linear):
        return tangent, y, normal / (1 + law.chi)
    side = tangent * tangent + y * y
    found = _field_inside(law)(_row(normal), _row(side))
    if isinstance(found, ca.SX):
        return tangent, y, found.T
    return tangent, y, np.array(found).reshape(np.shape(normal))


def _row(values: Any) -> Any:
    return values.T if isinstance(values, ca.SX) else np.ravel(values)[None, :]


@lru_cache(maxsize=16)
def _field_inside(law: Magnetisation) -> ca.Function:
    """Root H of H (1 + M/H) = normal, M/H at H² + side, by Newton's method."""
    normal, side, square = (ca.SX.sym(name) for name in ("normal", "side", "square"))
    ratio = law.ratio(square)
    known = ca.Function("law", [square], [ratio, ca.gradient(ratio, square)])
    inside = normal / (1 + law.ratio(0.0))
    for _ in range(_STEPS):
        ratio, fall = known(inside**2 + side)
        inside -= (inside * (1 + ratio) - normal) / (1 + ratio + 2 * inside**2 * fall)
    return ca.Function("inside", [normal, side], [inside], {"cse": True})


def field_stiffness(fluid: Fluid, depth: Any, k: Any, across: Any, along: Any = 0.0) -> Any:
    """Contribution of the distorted field to the pull on a ripple, over its height, in Pa/m.

    `across`, `along`: field inside, A/m.
    """
    ratio = fluid.magnetisation.ratio(across**2 + along**2)
    mu, T = 1 + ratio, np.tanh(k * depth)
    shared = MU0 * ratio**2 * k / (2 + (mu + 1 / mu) * T)
    return shared * ((mu * T + 1) * across**2 - (1 + T / mu) * along**2)


def growth_rate(
    fluid: Fluid,
    viscosity: float,
    depth: float,
    k: Any,
    *,
    across: float = 0.0,
    along: float = 0.0,
    gradient: float = 0.0,
) -> Any:
    """Growth rate of a ripple with wave number `k` (1/m) in a thin layer, in 1/s.

    `across`, `along`: uniform field inside, A/m; `gradient`: of the coils' pull over the height,
    Pa/m.
    """
    stiffness = fluid.weight + fluid.surface_tension * k**2 - gradient
    stiffness = stiffness - field_stiffness(fluid, depth, k, across, along)
    return -(depth**3) * k**2 / (3 * viscosity) * stiffness


def normal_field_number(fluid: Fluid, depth: float, across: float) -> float:
    """Largest share of the restoring force of ripples that a field across a layer compensates.

    Weight and surface tension restore the flat surface, which is unstable above 1 (Rosensweig).
    `across`: field inside, A/m.
    """
    if across == 0:
        return 0.0

    def share(log: float) -> float:
        k = np.exp(log) / fluid.capillary_length
        restoring = fluid.weight + fluid.surface_tension * k**2
        return -float(field_stiffness(fluid, depth, k, across) / restoring)

    # The share increases with k and then decreases, with its maximum within a decade of the
    # capillary length.
    found: Any = minimize_scalar(share, bounds=(-4.0, 4.0), method="bounded")
    return -float(found.fun)
