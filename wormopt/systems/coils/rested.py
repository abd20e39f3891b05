"""A fluid at rest at a coil, and checks of its balance by independent formulas."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.magnetics.hydrostatics import Fluid, Placed, flat_layer_pull, pressure, pull
from wormopt.magnetics.material import MU0
from wormopt.numerics.roots import root
from wormopt.systems.coils.profile import Settled

_PANELS, _IN_PANEL, _UP = 24, 8, 14  # Gauss points along a panel of x, and over the height


@dataclass(frozen=True, eq=False)
class Rested:
    """A fluid at rest."""

    fluid: Fluid
    placed: Placed  # the coil and its place
    settled: Settled  # the surface
    current: float  # ampere-turns at which it rests, A

    @property
    def level(self) -> float:
        """Constant of the pressure over the weight per volume, in m."""
        return float(self.settled.y[-1])

    def surface(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Return the height of the surface at positions (m,), in m, or a derivative of it."""
        return self.settled.equations.at(self.settled.y, x, order)

    def field(self, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return components Hx and Hz, in A/m, at places off the winding, in m."""
        Hx, Hz = self.placed.field(x, z)
        return self.current * Hx, self.current * Hz

    def magnetisation(self, Hx: np.ndarray, Hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return components Mx and Mz of M, which is along H; all in A/m."""
        ratio = np.asarray(self.fluid.magnetisation.ratio(Hx**2 + Hz**2))
        return ratio * Hx, ratio * Hz

    def pressure(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the pressure in the fluid, in Pa, at places in m."""
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
        """Upward force of the field on the fluid, per depth of the trough, in N/m.

        It is the integral of mu0 (M grad) H_z over the fluid, by Gauss quadrature.
        """
        x, along = self.quadrature
        nodes, up = np.polynomial.legendre.leggauss(_UP)
        half = self.surface(x) / 2
        z = half[:, None] * (1 + nodes)
        density = self._pull_upwards(np.repeat(x, _UP), z.ravel()).reshape(z.shape)
        return float(along @ (half * (density @ up)))

    def _pull_upwards(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return mu0 (M_x d/dx + M_z d/dz) H_z."""
        place = ca.SX.sym("place", 2)
        nearest = float(np.min(self.placed.clearance(x, z)))
        Hx, Hz = self.placed.field(place[0], place[1], self.placed.coil.nodes(nearest))
        steep = ca.Function("steep", [place], [ca.vertcat(Hx, Hz, ca.gradient(Hz, place))])
        Hx, Hz, by_x, by_z = self.current * np.array(steep(np.vstack([x, z])))
        Mx, Mz = self.magnetisation(Hx, Hz)
        return MU0 * (Mx * by_x + Mz * by_z)

    @cached_property
    def _at_surface(self) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Height, slope and field (A/m) at the points of the quadrature."""
        x, _ = self.quadrature
        h = self.surface(x)
        return h, self.surface(x, 1), self.field(x, h)

    @property
    def volume_error(self) -> float:
        """Relative difference of the volume by quadrature to that of the layer."""
        profile, (_, weights) = self.settled.equations.profile, self.quadrature
        volume = profile.mean * (profile.ends[1] - profile.ends[0])
        return float(abs(weights @ self._at_surface[0] / volume - 1))

    @property
    def force_imbalance(self) -> float:
        """Pressure on the bottom less all forces on it, over the weight.

        The jump of the stress is computed from M and the normal of the surface, not by `pull`: an
        error there would affect both the surface and its check.
        """
        fluid, (x, weights), (h, slope, field) = self.fluid, self.quadrature, self._at_surface
        bottom = weights @ self.pressure(x, np.zeros_like(x))
        weight = fluid.weight * float(weights @ h)
        Mx, Mz = self.magnetisation(*field)
        steep = np.arctan(slope)
        jump = MU0 / 2 * (Mz * np.cos(steep) - Mx * np.sin(steep)) ** 2
        at_walls = self.surface(np.array(self.settled.equations.profile.ends), 1)
        drawn = fluid.surface_tension * float(np.diff(at_walls / np.hypot(1, at_walls))[0])
        return float(abs(bottom - weight + self.force + weights @ jump + drawn) / weight)

    @property
    def field_error(self) -> float:
        """Error of the balance's field against one with more digits, over its largest value."""
        equations, (x, _), (h, slope, field) = (
            self.settled.equations, self.quadrature, self._at_surface,
        )  # fmt: skip
        profile, fluid = equations.profile, self.fluid
        given = [profile.x, profile.h, profile.slope, profile.bend, profile.level, profile.load]
        rest = ca.Function("rest", given, [profile.balance])
        bend = equations.at(self.settled.y, x, 2)
        places = (np.atleast_2d(values) for values in (x, h, slope, bend))
        wanted = np.array(rest(*places, self.level, self.settled.load)).ravel()
        curvature = -bend / (1 + slope**2) ** 1.5
        stress = pull(fluid, field, slope)
        exact = self.level - h + (stress - fluid.surface_tension * curvature) / fluid.weight
        size = max(float(np.max(np.abs(stress))) / fluid.weight, profile.mean)
        return float(np.max(np.abs(wanted - exact)) / size)

    @property
    def demagnetisation(self) -> float:
        """Relative change of the field's pull if the fluid weakens it as a flat layer does."""
        _, slope, field = self._at_surface
        neglecting = np.asarray(pull(self.fluid, field, slope))
        size = float(np.max(neglecting))
        if not size:
            return 0.0
        change = np.abs(np.asarray(flat_layer_pull(self.fluid, field, slope)) - neglecting)
        return float(np.max(change) / size)


def field_of_pressure(fluid: Fluid, pressure: float) -> float:
    """Return H, in A/m, at which mu0 times the integral of M over H is `pressure` > 0, in Pa."""

    def excess(size: float) -> float:
        return math.log(MU0 * float(fluid.magnetisation.energy(math.exp(2 * size))) / pressure)

    # the integral goes at least like H, at most like H²
    return math.exp(root(excess, -60.0, 120.0, xtol=1e-14))
