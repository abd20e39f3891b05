"""A segment wound with inextensible fibres in both directions at one angle to its axis.

At the angle al the stretch is cos al / cos al0 and the hoop stretch sin al / sin al0, where al0 is
the angle of the unstressed segment: the angle determines length, radius and volume. The volume,
proportional to cos al sin² al, is largest at tan² al = 2, where pressure has no pull. A sealed
round segment is therefore locked. It moves only if it is filled to less than the largest volume,
and is then flattened. Angles are in rad. Source: docs/theory-peristaltic.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.numerics.roots import root
from wormopt.systems.peristaltic.segment.rubber import density, slopes
from wormopt.systems.peristaltic.segment.segment import Segment

NEUTRAL = math.atan(math.sqrt(2))
"""Angle of the largest volume, 54.7356 degrees."""


@dataclass(frozen=True)
class Fibres:
    """A membrane segment between fibres at an angle to the axis, in rad, when unstressed.

    Raises ArgumentError if the angle is not between 0 and a right angle.
    """

    segment: Segment
    angle: float

    def __post_init__(self) -> None:
        if not 0 < self.angle < math.pi / 2:
            raise ArgumentError(
                f"the angle of the fibres is {math.degrees(self.angle):g} degrees; it must be "
                "between 0 and 90"
            )

    def stretches(self, angle: Any) -> tuple[Any, Any]:
        """Return axial stretch and hoop stretch at an angle (rad, number or expression)."""
        return ca.cos(angle) / math.cos(self.angle), ca.sin(angle) / math.sin(self.angle)

    def energy(self, angle: Any) -> Any:
        """Return the elastic energy of the membrane, in J."""
        segment = self.segment
        w = density(*self.stretches(angle), segment.neo_hookean)
        return segment.length * segment.stiffness * w

    def volume(self, angle: Any) -> Any:
        """Return the volume of the round segment, in m³."""
        stretch, hoop = self.stretches(angle)
        return self.segment.volume * stretch * hoop**2

    def pull(self, angle: Any, pressure: Any) -> Any:
        """Return the pull of a pressure (Pa) on the ends, in N: -d(p V)/d length.

        p (b² / 4 pi n²)(3 cos² al - 1) for fibres of length b with n turns.
        """
        section = math.pi * (self.segment.radius / math.sin(self.angle)) ** 2
        return pressure * section * (3 * ca.cos(angle) ** 2 - 1)

    def elastic_pull(self, angle: Any) -> Any:
        """Return the pull of the membrane on the ends, in N: derivative of `energy` by length."""
        along, around = slopes(*self.stretches(angle), self.segment.neo_hookean)
        narrowing = 1 / (ca.tan(angle) * math.tan(self.angle))  # of the hoop, by the stretch
        return self.segment.stiffness * (along - around * narrowing)

    def angle_at(self, pressure: float, load: float = 0.0) -> float:
        """Return the equilibrium angle, in rad, under a pressure (Pa) and a load (N) on the ends.

        The segment shares its fluid; the membrane is bonded to the fibres. Raises ArgumentError if
        the angle is 0 or a right angle to machine accuracy.
        """

        def surplus(angle: float) -> float:
            return float(self.elastic_pull(angle) + self.pull(angle, pressure) - load)

        low, high = 1e-6 * self.angle, math.pi / 2 - 1e-6 * (math.pi / 2 - self.angle)
        if not surplus(high) <= 0 <= surplus(low):
            raise ArgumentError(
                f"{pressure:g} Pa turn fibres of {math.degrees(self.angle):g} degrees all along or "
                "around the segment; write a lower pressure, or an angle nearer to 45 degrees"
            )
        return root(surplus, low, high, xtol=1e-15 * self.angle)


def fill_at(angle: Any) -> Any:
    """Return the volume of a round segment over the largest, at a fibre angle in rad."""
    return 1.5 * math.sqrt(3) * ca.cos(angle) * ca.sin(angle) ** 2


def range_of_fill(fill: float) -> tuple[float, float]:
    """Return the range of angles of a sealed segment, in rad, at a volume over the largest.

    At 1 both are `NEUTRAL`: it is locked. Raises ArgumentError unless 0 < fill <= 1.
    """
    if not 0 < fill <= 1:
        raise ArgumentError(f"a fill of {fill:g} does not fit between the fibres; write 0 to 1")
    if fill == 1:
        return NEUTRAL, NEUTRAL

    def surplus(angle: float) -> float:
        return float(fill_at(angle)) - fill

    return root(surplus, 0.0, NEUTRAL), root(surplus, NEUTRAL, math.pi / 2)
