"""A gear: a gait, what it loads by the slope it climbs, and what slope it bears."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.stroke import Loads, Stroke, loads, strokes_of

# Within a stroke forces are polynomials of low degree; their extremes are looked for here.
_LOOKS = np.sort(np.append((1 - np.cos(np.pi * np.arange(33) / 32)) / 2, [1 / 3, 2 / 3]))
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
            self.gait.on_piece(q, np.zeros(1), 1) - self.gait.on_piece(q - 1, widths[q - 1 :][:1], 1)
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
    def _ends(self) -> tuple[tuple[Loads, Loads], ...]:
        """Forces at the looks of every stroke at loads 0 and 1."""
        still = np.zeros(len(self.mass))
        one, none = np.ones(1), np.zeros(1)
        return tuple(
            (
                loads(self.mass, Ground(none, none, self.drag * one, none), q, s, still),
                loads(self.mass, Ground(none, one, self.drag * one, none), q, s, still),
            )
            for q in self.strokes
            for s in [_LOOKS * q.duration]
        )

    def spike_peak(self, load: float) -> float:
        """Largest load of a spike."""
        return max(float(_between(a.spike, b.spike, load).max()) for a, b in self._ends)

    def actuator_peak(self, load: float) -> float:
        """Largest force of an actuator, either way."""
        return max(float(np.abs(_between(a.actuator, b.actuator, load)).max()) for a, b in self._ends)

    @cached_property
    def least(self) -> float:
        """Least load on each mass at which none glides."""
        return max(0.0, *(float(np.max(-a.total / (b.total - a.total))) for a, b in self._ends))

    def bears(self, limits: Limits) -> tuple[float, float]:
        """Largest load on each mass that spikes bear, and that actuators bear.

        Negative infinity where the limit is broken at any load.
        """
        spike = min(_highest(a.spike, b.spike, limits.spike) for a, b in self._ends)
        actuator = min(_highest(a.actuator, b.actuator, limits.actuator) for a, b in self._ends)
        low = min(_highest(-a.actuator, -b.actuator, limits.actuator) for a, b in self._ends)
        borne = min(actuator, low)
        start = max(self.least, 0.0)
        fine = borne >= start and self.actuator_peak(start) <= limits.actuator * (1 + 1e-12)
        return spike, borne if fine else -np.inf

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


def _between(at_0: np.ndarray, at_1: np.ndarray, load: float) -> np.ndarray:
    return at_0 + load * (at_1 - at_0)


def _highest(at_0: np.ndarray, at_1: np.ndarray, limit: float) -> float:
    """Largest load at which values that grow with it stay below a limit."""
    if not np.isfinite(limit):
        return np.inf
    slope = at_1 - at_0
    grows = slope > 1e-12
    return float(np.min((limit - at_0[grows]) / slope[grows], initial=np.inf))
