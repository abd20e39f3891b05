"""A stroke: masses that move by polynomials in time while others rest on their spikes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from wormopt.model.gait import Gait
from wormopt.numerics.roots import root
from wormopt.systems.gears.ground import Ground
from wormopt.systems.spiked import Drive, periodic_stretches


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
