"""Periods and loads at which kinematics alone determines the motion of a gait shape.

The same shape at q times the rate needs a mean spike load of q^2 inertia + q drag + load. Two
functions of time therefore give, for every period, the loads without gliding and the loads that
break a spike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from wormopt.model.given import check_number
from wormopt.numerics.chebyshev import Series, resolve
from wormopt.numerics.roots import root
from wormopt.systems.spiked.stretches import Drive, Stretch, exact_degree, kinematic_stretches


@dataclass(frozen=True, eq=False)
class Region:
    """Loads that a shape of gait needs at each period without gliding (w = 0); see `Drive`."""

    drive: Drive  # its gait at any period; its load is not used

    @cached_property
    def _needs(self) -> tuple[tuple[int, Series], ...]:
        """Masses at rest, and the parts of sigma by inertia and by drag, stretch by stretch."""
        drive, degree = self.drive, exact_degree(self.drive.gait)

        def parts(cell: Stretch, s: np.ndarray) -> np.ndarray:
            v, a = drive.kinematic(cell.piece, cell.leader, s)
            return np.vstack([drive.mass @ a / len(drive.mass), drive.drag * v.mean(axis=0)])

        return tuple(
            (len(cell.resting), resolve(partial(parts, cell), cell.start, cell.stop, degree))
            for cell in kinematic_stretches(drive)
        )

    def _extremes(self, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Masses at rest, and smallest and largest sigma without load, of every stretch."""
        q = self.drive.gait.period / period
        ends = []
        for _, parts in self._needs:
            rows = np.array([q**2, q]) @ parts.coefficients
            ends.append(Series(parts.a, parts.b, rows[None]).extremes())
        low, high = np.array(ends)[:, :, 0].T
        return np.array([resting for resting, _ in self._needs]), low, high

    def least_load(self, period: float) -> float:
        """Smallest load without gliding at this period; negative if no load is needed."""
        return -float(self._extremes(period)[1].min())

    def least_period(self, load: float) -> float:
        """Smallest period at which `load` is enough: 0 if all are, inf if none is.

        ArgumentError if the load is negative: it would be enough for fast gaits, not slow ones.
        """
        check_number("load", load, least=0.0)
        low, high = zip(*(parts.extremes() for _, parts in self._needs), strict=True)
        inertia, drag = -min(row[0] for row in low), max(row[1] for row in high)
        if inertia <= 0:
            return 0.0
        if drag == load == 0:
            return math.inf
        # Drag only helps: full drag at the largest inertia gives the shortest period, no drag
        # the longest.
        period = self.drive.gait.period
        short = 2 * inertia * period / (drag + math.sqrt(drag**2 + 4 * inertia * load))
        long = period * math.sqrt(inertia / load) if load else 1e9 * short
        if drag == 0:
            return long

        def left_over(exponent: float) -> float:
            return load - self.least_load(math.exp(exponent))

        ends = math.log(short / 2), math.log(2 * long)
        # Without load nothing holds the worm where W0 comes to rest, even in a slow gait.
        return math.exp(root(left_over, *ends)) if left_over(ends[1]) >= 0 else math.inf

    def spike_loads(self, period: float, loads: np.ndarray) -> np.ndarray:
        """Largest load on one spike without gliding, by loads (m,), with equal sharing."""
        counts, _, high = self._extremes(period)
        share = len(self.drive.mass) / counts
        return ((high + loads[:, None]) * share).max(axis=1)

    def total_load(self, period: float, load: float) -> float:
        """Largest load on all spikes together without gliding."""
        return len(self.drive.mass) * (float(self._extremes(period)[2].max()) + load)

    def most_load(self, period: float, strength: float) -> float:
        """Load at which a spike carries its `strength` without gliding; more breaks it."""
        counts, _, high = self._extremes(period)
        return float((strength * counts / len(self.drive.mass) - high).min())
