"""Gears: gaits with their forces and admissible loads, their strokes, and the ground on the route.

In a stroke masses move by polynomials in time while others rest on their spikes. The ground has
load, drag and towed load by position.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import resolve
from wormopt.numerics.roots import root
from wormopt.systems.spiked import Drive, periodic_stretches


@dataclass(frozen=True, eq=False)
class Ground:
    """Loads of the ground by position: linear between knots, constant beyond the ends.

    `load` and `drag` act on every mass at its position, `towed` on the tail at its position.
    Raises ArgumentError if places do not increase or shapes differ.
    """

    place: np.ndarray  # (k,) knots, ascending
    load: np.ndarray  # (k,) force against forward motion on each mass
    drag: np.ndarray  # (k,) viscous drag of each mass
    towed: np.ndarray  # (k,) force against forward motion on the tail alone

    def __post_init__(self) -> None:
        for name in ("place", "load", "drag", "towed"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        if self.place.ndim != 1 or not len(self.place) or np.any(np.diff(self.place) <= 0):
            raise ArgumentError("places are missing or do not increase; write increasing numbers")
        if any(len(getattr(self, name)) != len(self.place) for name in ("load", "drag", "towed")):
            raise ArgumentError("load, drag and towed need one number for each place")

    def at(self, name: str, place: np.ndarray) -> np.ndarray:
        """Value of "load", "drag" or "towed" at positions of any shape."""
        return np.interp(place, self.place, getattr(self, name))

    def expression(self, name: str, place: ca.SX) -> ca.SX:
        """Value of "load", "drag" or "towed" as an expression of a column of symbols."""
        values = getattr(self, name)
        slopes = np.diff(values) / np.diff(self.place) if len(values) > 1 else np.zeros(0)
        changes = np.diff(slopes, prepend=0.0, append=0.0)
        found = ca.SX(place.shape[0], 1) + float(values[0])
        for knot, change in zip(self.place.tolist(), changes.tolist(), strict=True):
            if change:
                found += change * ca.fmax(place - knot, 0)
        return found

    def pull(self, place: np.ndarray) -> np.ndarray:
        """Force against forward motion on masses at positions (n+1, ...), with the towed load."""
        found = self.at("load", place)
        found[-1] += self.at("towed", place[-1])
        return found

    def pull_expression(self, place: ca.SX) -> ca.SX:
        """Force against forward motion as an expression of a column of symbols (n+1, 1)."""
        found = self.expression("load", place)
        found[-1] += self.expression("towed", place[-1])
        return found


@dataclass(frozen=True, eq=False)
class Stroke:
    """Velocities of the masses during an interval in which the same masses rest."""

    duration: float
    velocity: np.ndarray  # (n+1, degree + 1) by ascending power of the time since it began
    resting: tuple[int, ...]  # masses at rest, ascending

    def at(self, s: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Displacement, velocity or acceleration (n+1, m) at times `s`; `derivative` -1, 0, 1."""
        powers = np.arange(self.velocity.shape[1])
        if derivative < 0:
            return (self.velocity / (powers + 1)) @ s[None] ** (powers[:, None] + 1)
        if derivative == 0:
            return self.velocity @ s[None] ** powers[:, None]
        return (self.velocity * powers)[:, 1:] @ s[None] ** powers[:-1, None]

    @property
    def way(self) -> np.ndarray:
        """Displacement of every mass (n+1,)."""
        return self.at(np.array([self.duration]), -1)[:, 0]

    def until(self, way: float) -> float:
        """Time at which the mean of the masses has moved by `way`, at most that of the stroke."""

        def short(s: float) -> float:
            return float(self.at(np.array([s]), -1).mean()) - way

        if short(self.duration) <= 0:
            return self.duration
        return root(short, 0.0, self.duration) if way > 0 else 0.0


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces at m times."""

    total: np.ndarray  # (m,) of all spikes together; the worm would glide below 0
    spike: np.ndarray  # (n+1, m) of each spike
    actuator: np.ndarray  # (n, m) of each actuator, positive in tension


def loads(
    mass: np.ndarray, ground: Ground, stroke: Stroke, s: np.ndarray, begin: np.ndarray
) -> Loads:
    """Forces in a stroke at times `s` (m,), with masses at `begin` (n+1,) at its start.

    Resting masses share the load equally.
    """
    place = begin[:, None] + stroke.at(s, -1)
    need = mass[:, None] * stroke.at(s, 1) + ground.at("drag", place) * stroke.at(s)
    need += ground.pull(place)
    total, spike = need.sum(axis=0), np.zeros_like(need)
    spike[list(stroke.resting)] = total / len(stroke.resting)
    return Loads(total, spike, np.cumsum(spike - need, axis=0)[:-1])


def strokes_of(gait: Gait, mass: np.ndarray) -> Iterator[Stroke]:
    """Cut a polynomial gait into strokes where its resting masses change.

    Resting masses do not depend on the load, so a load is used at which the worm never glides.
    """
    widths = np.diff(gait.breaks)
    fastest = max(
        float(np.abs(gait.on_piece(q, np.linspace(0, w, 9), 2)).max()) for q, w in enumerate(widths)
    )
    holding = 2 * gait.links * float(mass.sum()) * fastest
    for part in periodic_stretches(Drive(gait, mass, 0.0, holding, "equal"))[0]:
        rates = gait.polynomial[part.piece][:, 1:] * np.arange(1, gait.polynomial.shape[2])
        spans = np.vstack([np.zeros(rates.shape[1]), np.cumsum(rates, axis=0)])
        velocity = np.array([_moved(row, part.start) for row in spans[part.leader] - spans])
        velocity[list(part.resting)] = 0.0
        yield Stroke(part.stop - part.start, velocity, part.resting)


def _moved(coefficients: np.ndarray, start: float) -> np.ndarray:
    """Coefficients of a polynomial in the time since `start`."""
    found = Polynomial(coefficients)(Polynomial([start, 1.0])).coef  # type: ignore[operator]
    return np.pad(found, (0, len(coefficients) - len(found)))


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
