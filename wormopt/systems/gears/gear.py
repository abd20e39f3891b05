"""A gear: a gait with its forces as functions of the load, and its admissible loads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import resolve
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.stroke import Stroke, loads, strokes_of

# Accepted excess of link limits by rounding, as a share.
_KEPT = 1e-9
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True, eq=False)
class Limits:
    """Load limits of spikes and actuators, and limits on the links."""

    spike: float  # load of a spike; inf if unlimited
    actuator: float  # force of an actuator, both directions; inf if unlimited
    rate: float  # rate of a link length, both directions
    acceleration: float  # acceleration of a link length, both directions
    length: tuple[float, float]  # range of every link

    def times(self, share: float) -> Limits:
        """The limits with a share of the loads."""
        return Limits(
            share * self.spike, share * self.actuator, self.rate, self.acceleration, self.length
        )


@dataclass(frozen=True, eq=False)
class Gear:
    """A polynomial gait as a gear of a worm, with equal sharing and the same load on all masses.

    All forces are affine in the load on each mass, so loads 0 and 1 determine them for all loads.
    Raises ArgumentError for a gait with harmonics, with corners, or without masses at rest.
    """

    name: str
    gait: Gait
    mass: np.ndarray  # (n+1,)
    drag: float  # of each mass, as assumed

    def __post_init__(self) -> None:
        if self.gait.degree is None:
            raise ArgumentError(
                f"{self.name}: the gait has harmonics, but a gear needs a polynomial gait; "
                'write profile = "quintic" or "trapezoid"'
            )
        widths = np.diff(self.gait.breaks)
        jumps = [
            self.gait.on_piece(q, np.zeros(1), 1)
            - self.gait.on_piece(q - 1, widths[q - 1 :][:1], 1)
            for q in range(self.gait.pieces)
        ]
        size = float(np.abs(self.gait.polynomial[:, :, 0]).max()) / self.gait.period
        if float(np.abs(jumps).max()) > 1e-9 * size:
            raise ArgumentError(
                f"{self.name}: link rates jump, but a gear needs smooth lengths; round the corners"
            )

    @cached_property
    def strokes(self) -> tuple[Stroke, ...]:
        """Strokes of a cycle."""
        return tuple(strokes_of(self.gait, self.mass))

    @cached_property
    def lengths(self) -> np.ndarray:
        """Link lengths at the start of every stroke, (strokes, n)."""
        begins = np.cumsum([0.0, *(stroke.duration for stroke in self.strokes[:-1])])
        return self.gait(begins).T

    @property
    def resting(self) -> int:
        """Smallest number of masses at rest."""
        return min(len(stroke.resting) for stroke in self.strokes)

    @property
    def period(self) -> float:
        """Time of a cycle."""
        return self.gait.period

    @property
    def advance(self) -> float:
        """Distance travelled per cycle."""
        return float(sum(stroke.way[0] for stroke in self.strokes))

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.advance / self.period

    @cached_property
    def _forces(self) -> tuple[_Forces, ...]:
        return tuple(_forces(self.mass, self.drag, stroke) for stroke in self.strokes)

    def spike_peak(self, load: float) -> float:
        """Largest load of a spike."""
        return max((q.high[0] + q.slope[0] * load) / q.resting for q in self._forces)

    def actuator_peak(self, load: float) -> float:
        """Largest actuator force, either direction."""
        return max(
            float(np.max(np.maximum(q.high + q.slope * load, -q.low - q.slope * load)[1:]))
            for q in self._forces
        )

    @cached_property
    def least(self) -> float:
        """Smallest load on each mass without gliding."""
        return max(0.0, *(-q.low[0] / q.slope[0] for q in self._forces))

    def bears(self, limits: Limits) -> tuple[float, float]:
        """Largest load on each mass within the limit of spikes, and within that of actuators.

        Negative infinity if actuators violate their limit already at the smallest load.
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
        """Whether the faster gear `other` carries every load that this one does."""
        most = min(self.bears(limits)), min(other.bears(limits))
        return other.speed > self.speed and most[0] <= most[1] and self.least >= other.least

    def spike_mean(self, load: float) -> float:
        """Mean over a cycle of the total load of all spikes, from the balance of impulses."""
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
    """Extremes of forces in a stroke without load, and their slopes by the load on each mass.

    The first row is the total load of all spikes; the others are the actuators.
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


def faults_of_links(gear: Gear, limits: Limits) -> Iterator[str]:
    """Yield how a gear violates the limits of its links."""
    ends = [np.linspace(0.0, w, 65) for w in np.diff(gear.gait.breaks)]
    size = limits.length[1]
    for name, order, low, high in (
        ("length", 0, *limits.length),
        ("rate", 1, -limits.rate, limits.rate),
        ("acceleration", 2, -limits.acceleration, limits.acceleration),
    ):
        values = [gear.gait.on_piece(q, s, order) for q, s in enumerate(ends)]
        least, most = min(v.min() for v in values), max(v.max() for v in values)
        if least < low - _KEPT * size or most > high + _KEPT * max(size, abs(high)):
            yield (
                f"its {name} goes from {least:.4g} to {most:.4g}, outside limits.{name}; write a "
                "longer period or a wider limit"
            )
