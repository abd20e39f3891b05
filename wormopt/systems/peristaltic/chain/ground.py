"""What a worm of segments crawls on: rough ground, a viscous film, or a tube that gives way.

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
        Friction against sliding that way over the weight; one number, or one per contact.

    Examples
    --------
    >>> DryGround(0.1, 0.3).law(0, 2.0).backward
    0.6

    """

    forward: Any
    backward: Any

    def law(self, contact: int, weight: Any) -> Coulomb:
        """Friction of a contact.

        Parameters
        ----------
        contact : int
            Which, from 0 at the head.
        weight : Any
            That it carries, N.

        """
        ahead, behind = (_of(given, contact) * weight for given in (self.forward, self.backward))
        return Coulomb(ahead, behind)


@dataclass(frozen=True)
class DragGround:
    """Viscous ground: the middles of segments are braked by c0 (l / L)^a times their velocity.

    Parameters
    ----------
    coefficient : float
        c0, N s/m.
    exponent : float, optional
        a: above 0 long segments hold on, below 0 short and thick ones, at 0 none.

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
        """Drag of a segment.

        Parameters
        ----------
        stretch : Any
            Its length over the unstressed one.

        """
        return Viscous(self.coefficient * stretch**self.exponent)


@dataclass(frozen=True)
class Bed:
    """A tube whose wall gives way by p = k (r - R_t), so that forces on it follow from the state.

    A segment of volume V at the radius r is pushed longer by p pi r² and pressed on by
    p 2 pi r l = 2 p V / r; energy is kept. The rigid tube is the limit of great k.

    Parameters
    ----------
    tube : Tube
        At rest.
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
        """Pressure of the wall on a sealed segment, in Pa; 0 off the wall.

        Parameters
        ----------
        segment : Segment
            Sealed, thinner than the tube.
        stretch : float, ndarray or expression
            Its length over the unstressed one.

        """
        depth = segment.radius_at(stretch) - self.tube.radius
        return self.stiffness * depth * (depth > 0)

    def push(self, segment: Segment, stretch: Any) -> Any:
        """Axial force by which the wall lengthens the segment, in N.

        Parameters
        ----------
        segment, stretch : Any
            As of `pressure`.

        """
        area = math.pi * segment.radius_at(stretch) ** 2
        return area * self.pressure(segment, stretch)

    def normal_force(self, segment: Segment, stretch: Any) -> Any:
        """Force of the wall on the segment's whole surface, in N.

        Parameters
        ----------
        segment, stretch : Any
            As of `pressure`.

        """
        pressure = self.pressure(segment, stretch)
        return 2 * segment.volume * pressure / segment.radius_at(stretch)

    def energy(self, segment: Segment, stretch: Any) -> Any:
        """Energy of the wall, 2 V k (d - R_t log(1 + d / R_t)) at the depth d, in J.

        Parameters
        ----------
        segment, stretch : Any
            As of `pressure`.

        """
        room = self.tube.radius
        depth = segment.radius_at(stretch) - room
        depth = depth * (depth > 0)
        return 2 * segment.volume * self.stiffness * (depth - room * ca.log1p(depth / room))

    def law(self, weight: Any, pressed: Any) -> Coulomb:
        """Friction of a contact.

        Parameters
        ----------
        weight, pressed : Any
            That it carries; that the wall presses with, N.

        """
        limit = self.tube.friction * (weight + pressed)
        return Coulomb(limit, limit)


Ground = DryGround | DragGround | Bed


def _of(given: Any, contact: int) -> Any:
    """Number of one contact, of one number for all or one for each."""
    several = isinstance(given, Sequence) or (isinstance(given, ca.SX) and given.numel() > 1)
    return given[contact] if several else given
