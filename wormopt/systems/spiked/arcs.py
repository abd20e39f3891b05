"""The period of a driven worm with spikes, cut into arcs on which (7) can hold no surprise.

Given the gait, the velocity of the masses at w = 0 and sigma are known functions of time. They
are sampled beforehand, and each piece of the gait is cut where the resting mass changes and
where sigma changes its sign.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from wormopt.model.gait import Gait

Vectorised = Callable[[np.ndarray], np.ndarray]
"""Maps times (m,) to values (m,) or (rows, m)."""

Spell = tuple[float, float, tuple[int, ...]]
"""Start and end of a stretch of time, and the masses that rest in it."""

# Relative to the largest rate or force: below it masses rest together and sigma counts as 0,
# so that gaits that ride on sigma = 0 do not flicker between the modes.
TIE = 1e-9
_SAMPLES = 129  # per smooth interval; extrema between samples are found from their parabola


@dataclass(frozen=True, eq=False)
class DrivenWorm:
    """Gait and worm as functions of the time s since a piece of the gait began."""

    gait: Gait  # link lengths
    mass: np.ndarray  # (n+1,) point masses, head first
    drag: float  # viscous drag k of every mass
    load: float  # load Γ of every mass

    def spans(self, piece: int, s: np.ndarray, derivative: int) -> np.ndarray:
        """S_i = x_0 - x_i of (2), or its `derivative` (0 to 2), (n+1, m) at times `s` (m,)."""
        links = self.gait.on_piece(piece, s, derivative)
        return np.vstack([np.zeros(links.shape[1]), np.cumsum(links, axis=0)])

    def velocities(self, piece: int, s: np.ndarray) -> np.ndarray:
        """Velocity of every mass at w = 0, that is max_j S_j' - S_i', shape (n+1, m).

        0 for the masses that rest, positive for the others; `s` (m,) are times in the piece.
        """
        rates = self.spans(piece, s, 1)
        return rates.max(axis=0) - rates

    def held(self, piece: int, leader: int, s: np.ndarray) -> np.ndarray:
        """Velocity of the head and sigma of (7) while mass `leader` rests, shape (2, m)."""
        rates, accelerations = self.spans(piece, s, 1), self.spans(piece, s, 2)
        momentum_rate = self.mass @ (accelerations[leader] - accelerations) / len(self.mass)
        drag = self.drag * (rates[leader] - rates.mean(axis=0))
        return np.array([rates[leader], momentum_rate + drag + self.load])

    def momentum(self, piece: int, s: float) -> float:
        """Mean of m_i v_i over the masses at w = 0; it jumps at corners of the gait."""
        return float(self.mass @ self.velocities(piece, np.array([s]))[:, 0]) / len(self.mass)

    def duration(self, piece: int) -> float:
        """Duration of a piece of the gait."""
        return float(self.gait.breaks[piece + 1] - self.gait.breaks[piece])

    @cached_property
    def rate_scale(self) -> float:
        """Largest velocity in the period; 1 if nothing moves."""
        grids = [np.linspace(0, self.duration(q), _SAMPLES) for q in range(self.gait.pieces)]
        return max(self.velocities(q, s).max() for q, s in enumerate(grids)) or 1.0

    @cached_property
    def force_scale(self) -> float:
        """Largest sum of the forces of which sigma consists; 1 if there are none."""
        largest = 0.0
        for piece in range(self.gait.pieces):
            s = np.linspace(0, self.duration(piece), _SAMPLES)
            largest = max(largest, float(np.abs(self.spans(piece, s, 2)).max()))
        return largest * self.mass.max() + self.drag * self.rate_scale + self.load or 1.0


@dataclass(frozen=True)
class Arc:
    """Interval of a piece on which the same mass leads and sigma keeps its sign."""

    piece: int  # index of the piece of the gait
    start: float  # since the piece began
    end: float  # since the piece began
    resting: tuple[int, ...]  # masses that rest at w = 0, ascending
    pulls: bool  # sigma < 0: only gliding is possible

    @property
    def leader(self) -> int:
        """A mass that rests at w = 0."""
        return self.resting[0]


def cut_piece(worm: DrivenWorm, piece: int) -> Iterator[Arc]:
    """Cut a piece where the resting mass changes and where sigma changes its sign.

    Arcs come in order of time and together make up the piece.
    """
    end, shortest = worm.duration(piece), 1e-13 * worm.gait.period
    samples = _samples(lambda s: worm.velocities(piece, s), 0.0, end)
    for a, b, resting in _resting(worm, piece, samples):
        if b - a <= shortest:
            continue

        def sigma(s: np.ndarray, leader: int = resting[0]) -> np.ndarray:
            return worm.held(piece, leader, s)[1]

        for cut, (start, stop) in enumerate(pairwise(_sign_changes(sigma, a, b, worm))):
            if stop > start:
                yield Arc(piece, float(start), float(stop), resting, pulls=cut % 2 == 1)


def _samples(rows: Vectorised, a: float, b: float) -> np.ndarray:
    """Sample times in [a, b], those of the minima of all rows among them.

    A row that dips between two samples shows by the parabola through three of them, whose
    lowest point is right to fourth order in the spacing.
    """
    s = np.linspace(a, b, _SAMPLES)
    values = np.atleast_2d(rows(s))
    left, middle, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
    bend = left - 2 * middle + right
    bent = bend > 1e-12 * np.abs(values).max()
    row, at = np.nonzero((middle <= left) & (middle <= right) & bent)
    shift = 0.5 * (left - right)[row, at] / bend[row, at]
    return np.union1d(s, s[at + 1] + shift * (s[1] - s[0]))


def _resting(worm: DrivenWorm, piece: int, samples: np.ndarray) -> list[Spell]:
    """Intervals of a piece and the masses that rest throughout them at w = 0."""
    spells = _spells(worm, piece, samples)
    for _ in range(worm.gait.links):
        # a third mass may lead for an instant where two others change places
        ends = np.array([end for _, end, _ in spells])
        lag = worm.velocities(piece, ends)[
            [leader for _, _, (leader, *_) in spells], range(len(ends))
        ]
        missed = np.setdiff1d(ends[lag > 2 * TIE * worm.rate_scale], samples)
        if len(missed) == 0:
            break
        samples = np.union1d(samples, missed)
        spells = _spells(worm, piece, samples)
    return spells


def _spells(worm: DrivenWorm, piece: int, samples: np.ndarray) -> list[Spell]:
    rests = worm.velocities(piece, samples) <= TIE * worm.rate_scale
    spells: list[Spell] = []
    start, together = float(samples[0]), rests[:, 0]
    for k in range(1, len(samples)):
        if np.any(together & rests[:, k]):
            together = together & rests[:, k]
            continue
        pair = int(np.argmax(together)), int(np.argmax(rests[:, k]))
        switch = _overtaking(worm, piece, pair, samples[k - 1], samples[k])
        spells.append((start, switch, tuple(map(int, np.flatnonzero(together)))))
        start, together = switch, rests[:, k]
    spells.append((start, float(samples[-1]), tuple(map(int, np.flatnonzero(together)))))
    return spells


def _overtaking(worm: DrivenWorm, piece: int, pair: tuple[int, int], a: float, b: float) -> float:
    """When the second mass of a pair takes over the lead in S_i' from the first."""
    old, new = pair

    def lead(s: float) -> float:
        rates = worm.spans(piece, np.array([s]), 1)[:, 0]
        return float(rates[new] - rates[old])

    return _root(lead, a, b) if lead(a) < 0 else float(a)


def _sign_changes(sigma: Vectorised, a: float, b: float, worm: DrivenWorm) -> list[float]:
    """Ends of alternating intervals in [a, b]: sigma >= 0 (perhaps empty), < 0, >= 0, ..."""
    tie = TIE * worm.force_scale
    s = _samples(sigma, a, b)
    values = sigma(s)
    sign = np.sign(np.where(np.abs(values) <= tie, 0.0, values))
    sign[0] = sign[0] or 1.0
    for k in np.flatnonzero(sign == 0):  # within round-off of 0 the mode is kept
        sign[k] = sign[k - 1]
    cuts = [a] if sign[0] > 0 else [a, a]
    for k in np.flatnonzero(np.diff(sign)):
        # Sample k is the last of the old sign or within round-off of 0; in the latter case sigma
        # may have lain at 0 for long, and only then the sample itself is the cut.
        last, least = (k, 0.0) if values[k] * sign[k] > 0 else (k - 1, tie)
        crosses = last >= 0 and values[last] * sign[k] > least
        ends = (s[last], s[last + 1])
        cuts.append(_root(lambda t: sigma(np.array([t]))[0], *ends) if crosses else s[k])
    return [*cuts, b]


def _root(function: Callable[[float], float], a: float, b: float) -> float:
    from scipy.optimize import root_scalar

    return float(root_scalar(function, bracket=(a, b), method="brentq", xtol=1e-16).root)
