"""One segment: a sealed rubber tube full of magnetic fluid, in a coil, free or in a rigid tube.

The tube is a thin incompressible membrane of unstressed length L, radius R, wall h and shear
modulus G. At the stretch lam = l / L a sealed cylinder has the hoop stretch lam^(-1/2), so the
membrane is in simple tension and the inner pressure is 0 for any lam: a uniform pressure does not
deform it. A coil pulls because its field is stronger inside than at the segment's ends. Axial
forces are positive if they pull the ends together. Functions of the stretch take numbers, arrays or
CasADi expressions. Source: section 3.5 of K. Zimmermann et al., "Worm-like Locomotion Systems
(WLLS)", 2007; docs/theory-peristaltic.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import check_number
from wormopt.numerics.roots import root
from wormopt.systems.peristaltic.segment.rubber import density

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


@dataclass(frozen=True)
class Tube:
    """A rigid tube that swollen segments grip, in SI units.

    Parameters
    ----------
    radius : float
        R_t, m.
    friction : float
        Coulomb coefficient between membrane and tube.

    Raises
    ------
    ArgumentError
        If a value is out of range.

    Examples
    --------
    >>> segment, tube = Segment(20e-3, 5e-3, 0.3e-3, 20e3), Tube(5.05e-3, 0.3)
    >>> round(tube.stretch_at_contact(segment), 6), round(tube.normal_force(segment, 564.0), 6)
    (0.980296, 0.09069)
    """

    radius: float
    friction: float

    def __post_init__(self) -> None:
        check_number("radius", self.radius)
        if not 0 <= self.friction < math.inf:
            raise ArgumentError(f"friction must be 0 or above, not {self.friction!r}")

    def stretch_at_contact(self, segment: Segment) -> float:
        """Return the stretch (R / R_t)² at which a sealed segment fills the tube.

        Parameters
        ----------
        segment : Segment
            Segment, thinner than the tube.

        Raises
        ------
        ArgumentError
            If the segment is not thinner.
        """
        if not segment.radius < self.radius:
            raise ArgumentError(
                f"a segment of radius {segment.radius:g} m does not fit into a tube of radius "
                f"{self.radius:g} m; radius must be below {self.radius:g}"
            )
        return (segment.radius / self.radius) ** 2

    def surplus(self, segment: Segment, pressure: Any, pull: Any = 0.0) -> Any:
        """Return the axial force, in N, that the wall carries if a segment fills the tube.

        A negative value means no contact.

        Parameters
        ----------
        segment : Segment
            Segment, thinner than the tube.
        pressure, pull : float, ndarray or expression
            Magnetic pressure, Pa; axial force by which the neighbours pull it apart, N.
        """
        stretch = self.stretch_at_contact(segment)
        return segment.coil_pull(stretch, pressure) + segment.elastic_pull(stretch) - pull

    def normal_force(self, segment: Segment, pressure: Any, pull: Any = 0.0) -> Any:
        """Return the normal force between wall and segment, (2 l_c / R_t) times `surplus`, in N.

        Parameters
        ----------
        segment, pressure, pull : Any
            See `surplus`.
        """
        length = segment.length * self.stretch_at_contact(segment)
        return 2 * length / self.radius * self.surplus(segment, pressure, pull)
