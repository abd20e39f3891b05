"""One segment: a sealed rubber tube full of magnetic fluid, in a coil, free or in a rigid tube.

The tube is a thin incompressible membrane of unstressed length L, radius R, wall h and shear
modulus G. At the stretch lam = l / L a sealed cylinder has the hoop stretch lam^(-1/2), so that
the membrane is in simple tension and the pressure inside is 0 whatever lam is: a uniform pressure
does nothing to it. A coil pulls because its field is stronger within than at the segment's ends.
Forces along the axis are positive where they pull the ends together. Functions of the stretch take
numbers, arrays or CasADi expressions. Source: chapter 3.5; docs/theory-peristaltic.md.
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
"""What of a segment holds on: its middle, or the rings at both of its ends."""
# Logarithm of the largest stretch that is looked for, and of the least with the other sign.
_FARTHEST = 20.0


def checked(stretch: Any) -> Any:
    """Give a stretch back: numbers are refused unless above 0, expressions pass."""
    if isinstance(stretch, float | int | np.ndarray) and not np.all(np.asarray(stretch) > 0):
        raise ArgumentError(f"a stretch is above 0, 1 where unstressed, not {stretch!r}")
    return stretch


@dataclass(frozen=True)
class Segment:
    """A sealed cylinder of membrane in its coil; SI units.

    Parameters
    ----------
    length, radius, wall : float
        L, R and h of the unstressed membrane, m.
    shear_modulus : float
        G, Pa; a third of Young's modulus.
    coil_share : float, optional
        Share c of L that lies in the coil's field.
    neo_hookean : float, optional
        a of Mooney's energy a I1 + (1 - a) I2.

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
        """Pressure against the wall, kappa = p R / (G h).

        Parameters
        ----------
        pressure : float, ndarray or expression
            Magnetic pressure of the field in the fluid, Pa.

        """
        return pressure * self.radius / (self.shear_modulus * self.wall)

    def radius_at(self, stretch: Any) -> Any:
        """Radius of the sealed cylinder, R lam^(-1/2), in m.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.

        """
        return self.radius * checked(stretch) ** -0.5

    def energy(self, stretch: Any) -> Any:
        """Elastic energy of the sealed membrane, in J; 0 unstretched.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.

        """
        hoop = checked(stretch) ** -0.5
        return self.length * self.stiffness * density(stretch, hoop, self.neo_hookean)

    def elastic_pull(self, stretch: Any) -> Any:
        """Pull of the sealed membrane, in N: derivative of `energy` by the length.

        Parameters
        ----------
        stretch : float, ndarray or expression
            l / L, above 0.

        """
        a, stretch = self.neo_hookean, checked(stretch)
        return self.stiffness * (stretch - stretch**-2) * (a + (1 - a) / stretch)

    def coil_pull(self, stretch: Any, pressure: Any) -> Any:
        """Pull of the coil, in N: p pi R² c / lam², 0 once the segment lies in the even field.

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
        """Energy of the fluid in the coil's field, in J; its derivative by the length pulls.

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
        """Stretch at rest; the coil's share where it pulls the ends into itself.

        Parameters
        ----------
        pressure : float, optional
            Magnetic pressure, Pa.
        load : float, optional
            Force that pulls the ends apart, N.

        Raises
        ------
        ArgumentError
            If the pressure is below 0, or the rubber too soft for any stretch.

        """
        least = self.coil_share if pressure else 0.0
        return self._rest(pressure * self.coil_share, 2, load, least)

    def deepest_stretch(self, pressure: float) -> float:
        """Least stretch that any coil reaches: the best is as long as the segment it leaves.

        lam³ + kappa lam / 2 = 1 if neo-Hookean.

        Parameters
        ----------
        pressure : float
            Magnetic pressure, Pa.

        Raises
        ------
        ArgumentError
            If the pressure is below 0, or the rubber too soft for any stretch.

        """
        return self._rest(pressure, 1)

    def _rest(self, pressure: float, power: int, load: float = 0.0, least: float = 0.0) -> float:
        """Stretch at rest, `least` or above, where the coil pulls by p pi R² / lam^power."""
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
                f"rubber of {self.shear_modulus:g} Pa would be stretched to next to nothing or "
                "without end; write a larger modulus, or a smaller pressure or load"
            )
        return math.exp(root(surplus, low, high))


@dataclass(frozen=True)
class Tube:
    """A rigid tube that swollen segments hold on to; SI units.

    Parameters
    ----------
    radius : float
        R_t, m.
    friction : float
        Coulomb's coefficient between membrane and tube.

    Raises
    ------
    ArgumentError
        If a number is out of range.

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
        """Stretch (R / R_t)² at which a sealed segment fills the tube.

        Parameters
        ----------
        segment : Segment
            Thinner than the tube.

        Raises
        ------
        ArgumentError
            If it is not.

        """
        if not segment.radius < self.radius:
            raise ArgumentError(
                f"a segment of radius {segment.radius:g} m does not fit into a tube of radius "
                f"{self.radius:g} m; radius must be below {self.radius:g}"
            )
        return (segment.radius / self.radius) ** 2

    def surplus(self, segment: Segment, pressure: Any, pull: Any = 0.0) -> Any:
        """Axial force, in N, that the wall takes from a segment that fills the tube.

        Below 0 it is off the wall.

        Parameters
        ----------
        segment : Segment
            Thinner than the tube.
        pressure, pull : float, ndarray or expression
            Magnetic pressure, Pa; axial force by which the neighbours pull it apart, N.

        """
        stretch = self.stretch_at_contact(segment)
        return segment.coil_pull(stretch, pressure) + segment.elastic_pull(stretch) - pull

    def normal_force(self, segment: Segment, pressure: Any, pull: Any = 0.0) -> Any:
        """Normal force between wall and segment, (2 l_c / R_t) times the `surplus`, in N.

        Parameters
        ----------
        segment, pressure, pull : Any
            As of `surplus`.

        """
        length = segment.length * self.stretch_at_contact(segment)
        return 2 * length / self.radius * self.surplus(segment, pressure, pull)
