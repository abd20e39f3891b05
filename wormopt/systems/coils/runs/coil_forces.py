"""Checks of a fluid at rest at a coil, by ways that its surface was not found by."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import root_scalar

from wormopt.magnetics.hydrostatics import Fluid, flat_layer_pull, pressure, pull
from wormopt.magnetics.material import MU0
from wormopt.magnetics.placed import Placed
from wormopt.systems.coils.scenes.coil_pressure import CoilPressureScene
from wormopt.systems.coils.settle import Settled

ACCEPTED = {"defect": 1e-4, "volume_error": 1e-9, "force_imbalance": 1e-6, "field_error": 1e-7}
"""Largest values of what the trust report holds, for a result that is trusted."""
_DEMAGNETISED = 0.1
_STRONG = 10.0  # tesla; more than any magnet in a laboratory but for the largest
_PANELS, _IN_PANEL, _UP = 24, 8, 14  # Gauss points along a panel of x, and over the height


@dataclass(frozen=True, eq=False)
class Rested:
    """A fluid at rest."""

    fluid: Fluid
    placed: Placed  # the coil and where it is
    settled: Settled  # the surface
    current: float  # ampere-turns at which it rests, A

    @property
    def level(self) -> float:
        """The constant of the pressure over the weight per volume, in m."""
        return float(self.settled.y[-1])

    def surface(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Height of the surface at places (m,), in m, or a derivative of it."""
        return self.settled.equations.at(self.settled.y, x, order)

    def field(self, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Components Hx and Hz, in A/m, at places off the winding, in m."""
        Hx, Hz = self.placed.field(x, z)
        return self.current * Hx, self.current * Hz

    def magnetisation(self, Hx: np.ndarray, Hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Components Mx and Mz of M, which is along H; all in A/m."""
        ratio = np.asarray(self.fluid.magnetisation.ratio(Hx**2 + Hz**2))
        return ratio * Hx, ratio * Hz

    def pressure(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Pressure in the fluid, in Pa, at places in m."""
        Hx, Hz = self.field(x, z)
        return np.asarray(pressure(self.fluid, z, Hx**2 + Hz**2, self.level))

    @cached_property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Gauss points in panels over the width, and weights."""
        nodes, weights = np.polynomial.legendre.leggauss(_IN_PANEL)
        left, right = self.settled.equations.profile.ends
        edges = np.linspace(left, right, _PANELS + 1)
        half = (right - left) / (2 * _PANELS)
        places = (edges[:-1] + half)[:, None] + half * nodes
        return places.ravel(), np.tile(half * weights, _PANELS)

    @cached_property
    def force(self) -> float:
        """Force of the field on the fluid upwards, per depth of the trough, in N/m.

        It is the integral of mu0 (M grad) H_z over the fluid, by Gauss's quadrature.
        """
        x, along = self.quadrature
        nodes, up = np.polynomial.legendre.leggauss(_UP)
        half = self.surface(x) / 2
        z = half[:, None] * (1 + nodes)
        density = self._pull_upwards(np.repeat(x, _UP), z.ravel()).reshape(z.shape)
        return float(along @ (half * (density @ up)))

    def _pull_upwards(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """mu0 (M_x d/dx + M_z d/dz) H_z."""
        place = ca.SX.sym("place", 2)
        nearest = float(np.min(self.placed.clearance(x, z)))
        Hx, Hz = self.placed.field(place[0], place[1], self.placed.coil.nodes(nearest))
        steep = ca.Function("steep", [place], [ca.vertcat(Hx, Hz, ca.gradient(Hz, place))])
        Hx, Hz, by_x, by_z = self.current * np.array(steep(np.vstack([x, z])))
        Mx, Mz = self.magnetisation(Hx, Hz)
        return MU0 * (Mx * by_x + Mz * by_z)


def checks_of(rested: Rested, table: CoilPressureScene) -> dict[str, Any]:
    """Trust report of a fluid at rest.

    Numbers that shall be small, ``growth_rate`` that shall be below 0, warnings in words.
    """
    settled, fluid = rested.settled, rested.fluid
    x, weights = rested.quadrature
    h, slope = rested.surface(x), rested.surface(x, 1)
    field = rested.field(x, h)
    demagnetised = _demagnetised(fluid, field, slope)
    ends = np.array(settled.equations.profile.ends)
    volume = table.layer.thickness * table.layer.width
    return {
        "degree": settled.equations.n,
        "tail": settled.equations.tail(settled.y),
        "defect": settled.equations.defect(settled.y, settled.load),
        "volume_error": float(abs(weights @ h / volume - 1)),
        "force_imbalance": _imbalance(rested, h, slope, field, ends),
        "field_error": _field_error(rested, x, h),
        "growth_rate": float(settled.equations.rates_of_growth(settled.y, settled.load)[0].real),
        "accepted": ACCEPTED,
        "demagnetisation": demagnetised,
        "warnings": list(_warnings(fluid, demagnetised, table)),
    }


def field_of_pressure(fluid: Fluid, pressure: float) -> float:
    """H, in A/m, at which mu0 times the integral of M over H is `pressure` > 0, in Pa."""

    def excess(size: float) -> float:
        return math.log(MU0 * float(fluid.magnetisation.energy(math.exp(2 * size))) / pressure)

    # the integral goes at least like H, at most like H²
    return math.exp(root_scalar(excess, bracket=(-60.0, 120.0), xtol=1e-14).root)


def _imbalance(
    rested: Rested, h: np.ndarray, slope: np.ndarray, field: Any, ends: np.ndarray
) -> float:
    """Pressure on the bottom less everything that rests on it, over the weight.

    The jump of the stress is written out from M and the normal of the surface, not by `pull`: a
    fault there would move the surface and its check alike.
    """
    fluid, (x, weights) = rested.fluid, rested.quadrature
    bottom = weights @ rested.pressure(x, np.zeros_like(x))
    weight = fluid.weight * float(weights @ h)
    Mx, Mz = rested.magnetisation(*field)
    steep = np.arctan(slope)
    jump = MU0 / 2 * (Mz * np.cos(steep) - Mx * np.sin(steep)) ** 2
    at_walls = rested.surface(ends, 1)
    drawn = fluid.surface_tension * float(np.diff(at_walls / np.hypot(1, at_walls))[0])
    return float(abs(bottom - weight + rested.force + weights @ jump + drawn) / weight)


def _field_error(rested: Rested, x: np.ndarray, h: np.ndarray) -> float:
    """How far the balance's field is from one of more digits, over its largest value."""
    equations, profile = rested.settled.equations, rested.settled.equations.profile
    given = [profile.x, profile.h, profile.slope, profile.bend, profile.level, profile.load]
    rest = ca.Function("rest", given, [profile.balance])
    level, load = rested.level, rested.settled.load
    slope, bend = equations.at(rested.settled.y, x, 1), equations.at(rested.settled.y, x, 2)
    wanted = np.array(rest(*(np.atleast_2d(v) for v in (x, h, slope, bend)), level, load)).ravel()
    curvature = -bend / (1 + slope**2) ** 1.5
    stress = pull(rested.fluid, rested.field(x, h), slope)
    fluid = rested.fluid
    exact = level - h + (stress - fluid.surface_tension * curvature) / fluid.weight
    size = max(float(np.max(np.abs(stress))) / fluid.weight, profile.mean)
    return float(np.max(np.abs(wanted - exact)) / size)


def _demagnetised(fluid: Fluid, field: Any, slope: np.ndarray) -> float:
    """Share by which the field's pull changes if the fluid weakens it as a flat layer does."""
    neglecting = np.asarray(pull(fluid, field, slope))
    size = float(np.max(neglecting))
    if not size:
        return 0.0
    change = np.abs(np.asarray(flat_layer_pull(fluid, field, slope)) - neglecting)
    return float(np.max(change) / size)


def _warnings(fluid: Fluid, demagnetised: float, table: CoilPressureScene) -> Iterator[str]:
    if demagnetised > _DEMAGNETISED:
        yield (
            f"the field of the coil is taken as if there were no fluid; by the estimate of a flat "
            f"layer the fluid weakens its pull on the surface by up to {demagnetised:.0%}"
        )
    stated = table.stated_pressure
    if stated is not None:
        needed = MU0 * field_of_pressure(fluid, stated)
        if needed > _STRONG:
            yield (
                f"stated_pressure = {stated:g} Pa would take a field of {needed:.3g} T in this "
                "fluid, far beyond that of any coil; check its unit"
            )
