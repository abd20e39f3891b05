"""A gear: a gait, what it loads by the slope it climbs, and what slope it bears."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import resolve
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.stroke import Stroke, loads, strokes_of

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True, eq=False)
class Limits:
    """What spikes and actuators bear, and how links may move."""

    spike: float  # load of a spike; inf without a limit
    actuator: float  # force of an actuator, both ways; inf without a limit
    rate: float  # of a link length, both ways
    acceleration: float  # of a link length, both ways
    length: tuple[float, float]  # of every link

    def times(self, share: float) -> Limits:
        """The same with a share of the loads."""
        return Limits(
            share * self.spike, share * self.actuator, self.rate, self.acceleration, self.length
        )


@dataclass(frozen=True, eq=False)
class Gear:
    """A gait of polynomials as a worm's gear, under equal sharing and an even load.

    All forces are affine in the load on each mass, so what holds at loads 0 and 1 holds for all.
    Raises ArgumentError for a gait with harmonics, corners, or none at rest.
    """

    name: str
    gait: Gait
    mass: np.ndarray  # (n+1,)
    drag: float  # of each mass, as believed

    def __post_init__(self) -> None:
        if self.gait.degree is None:
            raise ArgumentError(f"{self.name}: a gear needs a gait of polynomials, no harmonics")
        widths = np.diff(self.gait.breaks)
        jumps = [
            self.gait.on_piece(q, np.zeros(1), 1)
            - self.gait.on_piece(q - 1, widths[q - 1 :][:1], 1)
            for q in range(self.gait.pieces)
        ]
        size = float(np.abs(self.gait.polynomial[:, :, 0]).max()) / self.gait.period
        if float(np.abs(jumps).max()) > 1e-9 * size:
            raise ArgumentError(f"{self.name}: link rates jump; a gear needs smooth lengths")

    @cached_property
    def strokes(self) -> tuple[Stroke, ...]:
        """Strokes of a cycle."""
        return tuple(strokes_of(self.gait, self.mass))

    @cached_property
    def lengths(self) -> np.ndarray:
        """Link lengths at the begin of every stroke, (strokes, n)."""
        begins = np.cumsum([0.0, *(stroke.duration for stroke in self.strokes[:-1])])
        return self.gait(begins).T

    @property
    def resting(self) -> int:
        """Fewest masses at rest at any time."""
        return min(len(stroke.resting) for stroke in self.strokes)

    @property
    def period(self) -> float:
        """Time of a cycle."""
        return self.gait.period

    @property
    def advance(self) -> float:
        """Way of a cycle."""
        return float(sum(stroke.way[0] for stroke in self.strokes))

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.advance / self.period

    @cached_property
    def _forces(self) -> tuple[_Forces, ...]:
        """Forces in every stroke."""
        return tuple(_forces(self.mass, self.drag, stroke) for stroke in self.strokes)

    def spike_peak(self, load: float) -> float:
        """Largest load of a spike."""
        return max((q.high[0] + q.slope[0] * load) / q.resting for q in self._forces)

    def actuator_peak(self, load: float) -> float:
        """Largest force of an actuator, either way."""
        return max(
            float(np.max(np.maximum(q.high + q.slope * load, -q.low - q.slope * load)[1:]))
            for q in self._forces
        )

    @cached_property
    def least(self) -> float:
        """Least load on each mass at which none glides."""
        return max(0.0, *(-q.low[0] / q.slope[0] for q in self._forces))

    def bears(self, limits: Limits) -> tuple[float, float]:
        """Largest load on each mass that spikes bear, and that actuators bear.

        Negative infinity for actuators that break their limit at the least load already.
        """
        spike = min((limits.spike * q.resting - q.high[0]) / q.slope[0] for q in self._forces)
        actuator = math.inf
        for q in self._forces:
            for most, slope in ((q.high[1:], q.slope[1:]), (-q.low[1:], -q.slope[1:])):
                grows = slope > 1e-12
                room = (limits.actuator - most[grows]) / slope[grows]
                actuator = min(actuator, float(np.min(room, initial=math.inf)))
        fine = self.actuator_peak(self.least) <= limits.actuator * (1 + 1e-12)
        return float(spike), actuator if fine else -math.inf

    def outdone(self, other: Gear, limits: Limits) -> bool:
        """Whether a faster gear bears every load that this one does."""
        most = min(self.bears(limits)), min(other.bears(limits))
        return other.speed > self.speed and most[0] <= most[1] and self.least >= other.least

    def spike_mean(self, load: float) -> float:
        """Mean over a cycle of the load of all spikes together: the balance of impulses."""
        return len(self.mass) * (self.drag * self.speed + load)

    def actuator_square(self, load: float) -> float:
        """Mean over a cycle of the sum of squared actuator forces."""
        still, one, none = np.zeros(len(self.mass)), np.ones(1), np.zeros(1)
        ground = Ground(none, load * one, self.drag * one, none)
        found = 0.0
        for stroke in self.strokes:
            s = stroke.duration * (_NODES + 1) / 2
            force = loads(self.mass, ground, stroke, s, still).actuator
            found += stroke.duration / 2 * float((force**2).sum(axis=0) @ _WEIGHTS)
        return found / self.period


@dataclass(frozen=True, eq=False)
class _Forces:
    """Extremes in a stroke at no load, and by how much they grow with the load on each mass.

    Rows are the load of all spikes together, then the actuators.
    """

    low: np.ndarray  # (1 + n,)
    high: np.ndarray  # (1 + n,)
    slope: np.ndarray  # (1 + n,)
    resting: int


def _forces(mass: np.ndarray, drag: float, stroke: Stroke) -> _Forces:
    still, one, none = np.zeros(len(mass)), np.ones(1), np.zeros(1)

    def at(load: float, s: np.ndarray) -> np.ndarray:
        ground = Ground(none, load * one, drag * one, none)
        found = loads(mass, ground, stroke, s, still)
        return np.vstack([found.total, found.actuator])

    degree = max(stroke.velocity.shape[1] - 1, 1)
    low, high = resolve(lambda s: at(0.0, s), 0.0, stroke.duration, degree).extremes()
    slope = (at(1.0, none) - at(0.0, none))[:, 0]
    return _Forces(low, high, slope, len(stroke.resting))
