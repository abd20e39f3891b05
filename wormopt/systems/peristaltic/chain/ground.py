"""Grounds of a worm of segments: dry ground, a viscous film, or a tube with a compliant wall.

Forces are in N, lengths in m; functions take numbers, arrays or CasADi expressions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from wormopt.magnetics.material import check_number
from wormopt.model.friction import Coulomb, Viscous
from wormopt.systems.peristaltic.segment.segment import Segment, Tube


@dataclass(frozen=True, eq=False)
class DryGround:
    """Open ground with dry friction.

    Parameters
    ----------
    forward, backward : float, sequence or expression
        Friction coefficients against forward and backward motion; one value, or one per contact.

    Examples
    --------
    >>> DryGround(0.1, 0.3).law(0, 2.0).backward
    0.6
    """

    forward: Any
    backward: Any

    def law(self, contact: int, weight: Any) -> Coulomb:
        """Return the friction law of a contact.

        Parameters
        ----------
        contact : int
            Index of the contact, from 0 at the head.
        weight : Any
            Weight on the contact, N.
        """
        ahead, behind = (_of(given, contact) * weight for given in (self.forward, self.backward))
        return Coulomb(ahead, behind)


@dataclass(frozen=True)
class DragGround:
    """Viscous ground: drag c0 (l / L)^a times velocity at the middles of segments.

    Parameters
    ----------
    coefficient : float
        c0, N s/m.
    exponent : float, optional
        a: if positive long segments grip, if negative short and thick ones, at 0 none.

    Raises
    ------
    ArgumentError
        If c0 is not above 0.

    Examples
    --------
    >>> DragGround(0.2, -1.0).law(0.5)
    Viscous(drag=0.4)
    """

    coefficient: float
    exponent: float = 1.0

    def __post_init__(self) -> None:
        check_number("coefficient", self.coefficient)

    def law(self, stretch: Any) -> Viscous:
        """Return the drag law of a segment.

        Parameters
        ----------
        stretch : Any
            Length over unstressed length.
        """
        return Viscous(self.coefficient * stretch**self.exponent)


@dataclass(frozen=True)
class Bed:
    """A tube with a compliant wall, p = k (r - R_t), so that the state determines wall forces.

    The wall lengthens a segment of volume V and radius r with the force p pi r², and presses on it
    with p 2 pi r l = 2 p V / r; energy is conserved. The rigid tube is the limit of large k.

    Parameters
    ----------
    tube : Tube
        The undeformed tube.
    stiffness : float
        k, Pa/m.

    Raises
    ------
    ArgumentError
        If k is not above 0.

    Examples
    --------
    >>> segment, bed = Segment(20e-3, 5e-3, 0.3e-3, 20e3), Bed(Tube(5.05e-3, 0.3), 1e8)
    >>> bed.pressure(segment, 1.0) == 0, round(bed.pressure(segment, 0.98), 1)
    (True, 76.3)
    """

    tube: Tube
    stiffness: float

    def __post_init__(self) -> None:
        check_number("stiffness", self.stiffness)

    def pressure(self, segment: Segment, stretch: Any) -> Any:
        """Return the pressure of the wall on a sealed segment, in Pa; 0 without contact.

        Parameters
        ----------
        segment : Segment
            Sealed segment, thinner than the tube.
        stretch : float, ndarray or expression
            Length over unstressed length.
        """
        depth = segment.radius_at(stretch) - self.tube.radius
        return self.stiffness * depth * (depth > 0)

    def push(self, segment: Segment, stretch: Any) -> Any:
        """Return the axial force by which the wall lengthens the segment, in N.

        Parameters
        ----------
        segment, stretch : Any
            See `pressure`.
        """
        area = math.pi * segment.radius_at(stretch) ** 2
        return area * self.pressure(segment, stretch)

    def normal_force(self, segment: Segment, stretch: Any) -> Any:
        """Return the force of the wall on the segment's whole surface, in N.

        Parameters
        ----------
        segment, stretch : Any
            See `pressure`.
        """
        pressure = self.pressure(segment, stretch)
        return 2 * segment.volume * pressure / segment.radius_at(stretch)

    def energy(self, segment: Segment, stretch: Any) -> Any:
        """Return the energy of the wall, 2 V k (d - R_t log(1 + d / R_t)) at the depth d, in J.

        Parameters
        ----------
        segment, stretch : Any
            See `pressure`.
        """
        room = self.tube.radius
        depth = segment.radius_at(stretch) - room
        depth = depth * (depth > 0)
        return 2 * segment.volume * self.stiffness * (depth - room * ca.log1p(depth / room))

    def law(self, weight: Any, pressed: Any) -> Coulomb:
        """Return the friction law of a contact.

        Parameters
        ----------
        weight, pressed : Any
            Weight on the contact, and normal force of the wall, N.
        """
        limit = self.tube.friction * (weight + pressed)
        return Coulomb(limit, limit)


Ground = DryGround | DragGround | Bed


def _of(given: Any, contact: int) -> Any:
    """Return the value of one contact, from one value for all or one for each."""
    several = isinstance(given, Sequence) or (isinstance(given, ca.SX) and given.numel() > 1)
    return given[contact] if several else given
