"""A segment in a real coil: the field along it, its pull, and the equivalent share c.

The fluid's magnetic energy is -(V / l) times the integral of p_m over the length l. The pull on the
ends is therefore the section V / l times (mean of p_m along the segment less p_m at its ends). p_m
is taken on the axis, in the middle of the coil; the fluid does not change the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.pressure import magnetic_pressure
from wormopt.magnetics.winding import Coil
from wormopt.numerics.roots import root
from wormopt.systems.peristaltic.segment.segment import Segment

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
