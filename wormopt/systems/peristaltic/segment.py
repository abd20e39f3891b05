"""One segment: a sealed rubber tube full of magnetic fluid, in a coil, free or in a rigid tube.

The tube is a thin incompressible membrane, Mooney-Rivlin or neo-Hookean, of unstressed length L,
radius R, wall h and shear modulus G. Its elastic energy per unstressed area and over G h / 2 is
a I1 + (1 - a) I2 - 3; a = 1 is neo-Hookean. At the stretch lam = l / L a sealed cylinder has the
hoop stretch lam^(-1/2), so the membrane is in simple tension and the inner pressure is 0 for any
lam: a uniform pressure does not deform it. A coil pulls because its field is stronger inside than
at the segment's ends. Axial forces are positive if they pull the ends together. Functions of the
axial stretch and of the `hoop` stretch around take numbers, arrays or CasADi expressions. Source:
section 3.5 of K. Zimmermann et al., "Worm-like Locomotion Systems (WLLS)", 2007;
docs/theory-peristaltic.md.

In a real coil the fluid's magnetic energy is -(V / l) times the integral of p_m over the length l.
The pull on the ends is therefore the section V / l times (mean of p_m along the segment less p_m at
its ends). p_m is taken on the axis, in the middle of the coil; the fluid does not change the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import check_number
from wormopt.magnetics.pressure import magnetic_pressure
from wormopt.magnetics.winding import Coil
from wormopt.numerics.roots import root


def density(stretch: Any, hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the energy w per unstressed area over G h; 0 if unstressed."""
    x, y, a = stretch**2, hoop**2, neo_hookean
    first, second = x + y + 1 / (x * y), 1 / x + 1 / y + x * y
    return (a * first + (1 - a) * second - 3) / 2


def slopes(stretch: Any, hoop: Any, neo_hookean: Any = 1.0) -> tuple[Any, Any]:
    """Return derivatives of `density` by stretch and hoop: tensions over G h per length."""
    x, y, a, b = stretch**2, hoop**2, neo_hookean, 1 - neo_hookean
    along = stretch * (a * (1 - 1 / (x * x * y)) + b * (y - 1 / (x * x)))
    around = hoop * (a * (1 - 1 / (x * y * y)) + b * (x - 1 / (y * y)))
    return along, around


def curvatures(stretch: Any, hoop: Any, neo_hookean: Any = 1.0) -> tuple[Any, Any, Any]:
    """Return second derivatives of `density`: by stretch twice, by both, by hoop twice."""
    x, y, a, b = stretch**2, hoop**2, neo_hookean, 1 - neo_hookean
    along = a * (1 + 3 / (x * x * y)) + b * (y + 3 / (x * x))
    both = stretch * hoop * (2 * a / (x * x * y * y) + 2 * b)
    around = a * (1 + 3 / (x * y * y)) + b * (x + 3 / (y * y))
    return along, both, around


Anchoring = Literal["mid", "clamp"]
"""Anchoring part of a segment: its middle, or the rings at both ends."""
# Bound of the logarithm of the stretch in the search, for both signs.
_FARTHEST = 20.0


def checked(stretch: Any) -> Any:
    """Return a stretch; refuse numbers that are not above 0."""
    if isinstance(stretch, float | int | np.ndarray) and not np.all(np.asarray(stretch) > 0):
        raise ArgumentError(f"a stretch must be above 0 (1 if unstressed), not {stretch!r}")
    return stretch


@dataclass(frozen=True)
class Segment:
    """A sealed membrane cylinder in its coil, in SI units.

    Theory: docs/theory-peristaltic.md, section 1.

    Parameters
    ----------
    length, radius, wall : float
        L, R and h of the unstressed membrane, m.
    shear_modulus : float
        G, Pa; a third of Young's modulus.
    coil_share : float, optional
        Share c of L that lies in the coil's field.
    neo_hookean : float, optional
        a of the Mooney-Rivlin energy a I1 + (1 - a) I2.

    Raises
    ------
    ArgumentError
        If a size is not above 0, or a share outside 0 to 1.

    Examples
    --------
    >>> segment = Segment(20e-3, 5e-3, 0.3e-3, 20e3)
    >>> round(segment.stretch_at(564.0), 6), round(segment.deepest_stretch(564.0), 6)
    (0.959191, 0.921839)
    """

    length: float
    radius: float
    wall: float
    shear_modulus: float
    coil_share: float = 0.5
    neo_hookean: float = 1.0

    def __post_init__(self) -> None:
        for name in ("length", "radius", "wall", "shear_modulus"):
            check_number(name, getattr(self, name))
        for name in ("coil_share", "neo_hookean"):
            if not 0 <= getattr(self, name) <= 1:
                raise ArgumentError(f"{name} must be from 0 to 1, not {getattr(self, name)!r}")

    @property
    def stiffness(self) -> float:
        """2 pi R G h, in N: a third of the axial stiffness at small strain."""
        return 2 * math.pi * self.radius * self.shear_modulus * self.wall

    @property
    def volume(self) -> float:
        """Volume of the fluid, in m³."""
        return math.pi * self.radius**2 * self.length

    def loading(self, pressure: Any) -> Any:
        """Return the pressure relative to the wall, kappa = p R / (G h).

        Parameters
        ----------
        pressure : float, ndarray or expression
            Magnetic pressure of the field in the fluid, Pa.
        """
        return pressure * self.radius / (self.shear_modulus * self.wall)

    def radius_at(self, stretch: Any) -> Any:
        """Return the radius of the sealed cylinder, R lam^(-1/2), in m.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.
        """
        return self.radius * checked(stretch) ** -0.5

    def energy(self, stretch: Any) -> Any:
        """Return the elastic energy of the sealed membrane, in J; 0 if unstressed.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.
        """
        hoop = checked(stretch) ** -0.5
        return self.length * self.stiffness * density(stretch, hoop, self.neo_hookean)

    def elastic_pull(self, stretch: Any) -> Any:
        """Return the pull of the sealed membrane, in N: derivative of `energy` by the length.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.
        """
        a, stretch = self.neo_hookean, checked(stretch)
        return self.stiffness * (stretch - stretch**-2) * (a + (1 - a) / stretch)

    def coil_pull(self, stretch: Any, pressure: Any) -> Any:
        """Return the pull of the coil, in N: p pi R² c / lam², 0 if the segment is in the field.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.
        pressure : float, ndarray or expression
            Magnetic pressure of the field in the fluid, Pa.
        """
        share, stretch = math.pi * self.radius**2 * self.coil_share, checked(stretch)
        return (stretch >= self.coil_share) * (pressure * share / stretch**2)

    def magnetic_energy(self, stretch: Any, pressure: Any) -> Any:
        """Return the energy of the fluid in the coil's field, in J; its derivative is the pull.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.
        pressure : float, ndarray or expression
            Magnetic pressure of the field in the fluid, Pa.
        """
        inside = self.coil_share / checked(stretch)
        return -pressure * self.volume * ((inside <= 1) * inside + (inside > 1))

    def stretch_at(self, pressure: float = 0.0, load: float = 0.0) -> float:
        """Return the equilibrium stretch; the coil's share if the coil pulls the ends into itself.

        Parameters
        ----------
        pressure : float, optional
            Magnetic pressure, Pa.
        load : float, optional
            Force that pulls the ends apart, N.

        Raises
        ------
        ArgumentError
            If the pressure is below 0, or the rubber is too soft for an equilibrium.
        """
        least = self.coil_share if pressure else 0.0
        return self._rest(pressure * self.coil_share, 2, load, least)

    def deepest_stretch(self, pressure: float) -> float:
        """Return the least stretch of any coil: the best coil has the length of the segment.

        lam³ + kappa lam / 2 = 1 if neo-Hookean.

        Parameters
        ----------
        pressure : float
            Magnetic pressure, Pa.

        Raises
        ------
        ArgumentError
            If the pressure is below 0, or the rubber is too soft for an equilibrium.
        """
        return self._rest(pressure, 1)

    def _rest(self, pressure: float, power: int, load: float = 0.0, least: float = 0.0) -> float:
        """Return the equilibrium stretch, at least `least`, for a pull p pi R² / lam^power."""
        if not 0 <= pressure < math.inf:
            raise ArgumentError(f"pressure must be 0 or above and finite, not {pressure!r}")

        def surplus(log_stretch: float) -> float:
            stretch = math.exp(log_stretch)
            coil = pressure * math.pi * self.radius**2 / stretch**power
            return self.elastic_pull(stretch) + coil - load

        low, high = math.log(least) if least else -_FARTHEST, _FARTHEST
        if least and surplus(low) >= 0:
            return least
        if surplus(low) > 0 or surplus(high) < 0:
            raise ArgumentError(
                f"rubber of {self.shear_modulus:g} Pa would shrink to nothing or stretch without "
                "limit; write a larger modulus, or a smaller pressure or load"
            )
        return math.exp(root(surplus, low, high))


# Gauss points over half of the segment.
_POINTS = 24


@dataclass(frozen=True)
class WoundSegment:
    """A sealed cylinder in the middle of a coil, with a fluid of susceptibility chi.

    Raises ArgumentError if the segment does not fit into the coil.
    """

    segment: Segment
    coil: Coil
    chi: float

    def __post_init__(self) -> None:
        if not self.segment.radius < self.coil.inner:
            raise ArgumentError(
                f"a segment of radius {self.segment.radius:g} m does not fit into a coil of inner "
                f"radius {self.coil.inner:g} m; inner must be above {self.segment.radius:g}"
            )

    def pressure(self, place: Any, ampere_turns: Any) -> Any:
        """Return the magnetic pressure, in Pa, on the axis at a distance from the middle, in m."""
        axial, _ = self.coil.expression(0.0, place, self.coil.nodes(self.coil.inner))
        return magnetic_pressure(1 + self.chi, axial * ampere_turns)

    def coil_pull(self, stretch: Any, ampere_turns: Any) -> Any:
        """Return the pull of the coil, in N, at a stretch (a number or expression)."""
        half = stretch * self.segment.length / 2
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        mean = sum(
            weight / 2 * self.pressure(half * (1 + node) / 2, ampere_turns)
            for node, weight in zip(nodes.tolist(), weights.tolist(), strict=True)
        )
        section = math.pi * self.segment.radius**2 / stretch
        return section * (mean - self.pressure(half, ampere_turns))

    def share(self, stretch: Any) -> Any:
        """Return the share c of L of the ideal coil with equal pull and middle pressure."""
        section = math.pi * self.segment.radius**2
        return self.coil_pull(stretch, 1.0) * stretch**2 / (section * self.pressure(0.0, 1.0))

    def stretch_at(self, ampere_turns: float, load: float = 0.0) -> float:
        """Return the equilibrium stretch at a current and a load (N) that pulls the ends apart."""

        def surplus(log_stretch: float) -> float:
            stretch = math.exp(log_stretch)
            pull = self.segment.elastic_pull(stretch) + self.coil_pull(stretch, ampere_turns)
            return float(pull) - load

        return math.exp(root(surplus, -20.0, 20.0))
