"""Event-located integration of the bimodal system (eq. 7), as a second route to every motion.

For a given gait, the velocities of the masses at w = 0 and sigma are known functions of time. They
are sampled first, and the period is cut into arcs on which one mass leads and sigma keeps its
sign. On an arc with sigma < 0 the worm glides throughout. On an arc with sigma >= 0 a glide slows
down monotonically and ends at most once; then the spikes hold. No event can therefore be missed
between two steps. The double zero of w at the start of a glide is the end of an arc, never inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.numerics.roots import root

Vectorised = Callable[[np.ndarray], np.ndarray]
"""Function of times (m,) with values (m,) or (rows, m)."""

Spell = tuple[float, float, tuple[int, ...]]
"""Start and end of an interval, and the masses at rest in it."""

# Relative to the largest rate or force: smaller differences of velocities, and smaller sigma, count
# as 0, so that gaits with sigma = 0 do not flicker between the modes.
_TIE = 1e-9
_SAMPLES = 129  # per smooth interval; extrema between samples are found from a parabola
_MOST_PERIODS = 50
# Points at which an extreme is sought, and again between the neighbours of the best: 1 / 16 each.
_POINTS, _ZOOMS = 33, 7
_QUADRATURE = 1e-14  # relative to the integral of the largest value
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


@dataclass(frozen=True, eq=False)
class BimodalMotion:
    """Periodic motion of a worm with spikes."""

    advance: float  # distance per period
    speed: float  # advance / period
    # start, end in [0, T); a glide past T ends before it starts; (0, T): it never ends
    glides: tuple[tuple[float, float], ...]
    # (time, masses at rest from then on); the first at 0
    switches: tuple[tuple[float, frozenset[int]], ...]
    lambda_min: float  # of lambda in eq. 7, the mean spike load over masses, without impulses
    lambda_max: float  # as lambda_min
    lambda_mean: float  # over the period, impulses included
    impulses: tuple[tuple[float, float], ...]  # (time, size) on the spikes, summed over the masses
    resting_min: int  # smallest number of masses at rest on any interval


def integrate(
    gait: Gait,
    mass: Sequence[float],
    drag: float,
    load: float,
    *,
    rtol: float = 1e-13,
) -> BimodalMotion:
    """Integrate eq. 7 from w = 0 until periodic, and return the last period. Raises SolveError.

    With unequal masses, mean(m) w' + k w + sigma = lambda and sigma = p' + k W0 + Γ, where p is the
    mean of m_i v_i at w = 0. Without load and drag, w + const is a solution too. `rtol` must be at
    least 3e-14.
    """
    if len(mass) != gait.links + 1:
        raise ArgumentError(f"{len(mass)} masses for {gait.links} links; write {gait.links + 1}")
    worm = DrivenWorm(gait, np.asarray(mass, dtype=float), drag, load)
    arcs = [arc for piece in range(gait.pieces) for arc in cut_piece(worm, piece)]
    w = 0.0
    for _ in range(_MOST_PERIODS):
        track = _Track(worm, w, rtol)
        for arc in arcs:
            track.run(arc)
        track.cross_corner(gait.pieces - 1, 0)
        if abs(track.w - w) <= 100 * rtol * worm.rate_scale:
            return track.motion()
        w = track.w
    raise SolveError(
        f"the worm's motion is not periodic after {_MOST_PERIODS} periods of the gait",
        "increase worm.drag or worm.load",
    )


class _Track:
    """State of the integration over one period: position and velocity, loads and spells so far."""

    def __init__(self, worm: DrivenWorm, w: float, rtol: float) -> None:
        self.worm, self.w, self.rtol = worm, w, rtol
        self.x = self.load_integral = 0.0
        self.lambdas: list[float] = []
        self.impulses: list[tuple[float, float]] = []
        self.spells: list[Spell] = []
        self.piece = 0

    def run(self, arc: Arc) -> None:
        """Move along an arc; glide first if the worm glides or sigma is negative."""
        if arc.piece != self.piece:
            self.cross_corner(self.piece, arc.piece)
        held = self._glide(arc) if self.w > 0 or arc.pulls else arc.start
        if held < arc.end:
            self._hold(arc, held)

    def cross_corner(self, piece: int, following: int) -> None:
        """Keep the momentum between pieces, unless the spikes push."""
        worm, self.piece = self.worm, following
        jump = worm.momentum(following, 0.0) - worm.momentum(piece, worm.duration(piece))
        jump /= float(worm.mass.mean())
        if self.w == 0 and abs(jump) <= _TIE * worm.rate_scale:
            return
        push, self.w = max(0.0, jump - self.w), max(0.0, self.w - jump)
        if push > _TIE * worm.rate_scale:
            size = push * float(worm.mass.sum())
            self.impulses.append((float(worm.gait.breaks[following]), size))
            self.load_integral += size / len(worm.mass)

    def _glide(self, arc: Arc) -> float:
        """Glide along an arc; returns the end of the glide, at the latest that of the arc."""
        from scipy.integrate import solve_ivp  # slow to import, and designed gaits never glide

        worm = self.worm
        mass = worm.mass.mean()

        def slope(s: float, state: np.ndarray) -> tuple[float, float]:
            w = float(state[1])
            lead, sigma = worm.held(arc.piece, arc.leader, np.array([s]))[:, 0]
            return lead + w, -(worm.drag * w + sigma) / mass

        def stop(_: float, state: np.ndarray) -> float:
            return state[1]

        # attributes that scipy reads; no glide ends while sigma < 0
        vars(stop).update(terminal=True, direction=-1)
        solution = solve_ivp(
            slope,
            (arc.start, arc.end),
            (0.0, self.w),
            method="DOP853",
            events=None if arc.pulls else stop,
            rtol=self.rtol,
            atol=self.rtol * worm.rate_scale * np.array([worm.gait.period, 1.0]),
        )
        if solution.status < 0:
            raise SolveError(
                f"a glide of the worm could not be integrated ({solution.message})", "increase rtol"
            )
        end = float(solution.t[-1])
        self.x += float(solution.y[0, -1])
        self.w = max(0.0, float(solution.y[1, -1])) if solution.status == 0 else 0.0
        self.lambdas.append(0.0)
        self._log(arc, arc.start, end, ())
        return end

    def _hold(self, arc: Arc, start: float) -> None:
        """Rest on the spikes: w = 0, so position and load are integrals of known functions."""
        # The integrals are computed by quadrature, not as differences of lengths and momenta, so
        # lambda_mean = k speed + Gamma remains an independent check.
        worm = self.worm

        def known(s: np.ndarray) -> np.ndarray:
            return worm.held(arc.piece, arc.leader, s)

        scale = np.array([worm.rate_scale, worm.force_scale])
        way, load = _integral(known, (start, arc.end), scale)
        self.x += float(way)
        self.load_integral += float(load)
        flat = _TIE * worm.force_scale
        self.lambdas += _extremes(lambda s: known(s)[1], (start, arc.end), flat)
        self._log(arc, start, arc.end, arc.resting)

    def _log(self, arc: Arc, start: float, end: float, resting: tuple[int, ...]) -> None:
        begin = float(self.worm.gait.breaks[arc.piece])
        self.spells.append((begin + start, begin + end, resting))

    def motion(self) -> BimodalMotion:
        """Make the periodic motion from the recorded spells."""
        period = self.worm.gait.period
        switches = _switches(self.spells, 1e-9 * period)
        return BimodalMotion(
            advance=self.x,
            speed=self.x / period,
            glides=_glides(switches, period),
            switches=switches,
            lambda_min=min(self.lambdas),
            lambda_max=max(self.lambdas),
            lambda_mean=self.load_integral / period,
            impulses=tuple(self.impulses),
            resting_min=min(len(resting) for _, resting in switches),
        )


def _integral(rows: Vectorised, ends: tuple[float, float], scale: np.ndarray) -> np.ndarray:
    """Integrate rows by Gauss quadrature, with more panels until only round-off changes."""
    (a, b), before = ends, np.full(len(scale), np.inf)
    for panels in (1, 2, 4, 8, 16, 32, 64, 128):
        width = (b - a) / panels
        s = a + width * (np.arange(panels)[:, None] + (_NODES + 1) / 2)
        value = width / 2 * (rows(s.ravel()) @ np.tile(_WEIGHTS, panels))
        if np.all(np.abs(value - before) <= _QUADRATURE * scale * (b - a)):
            break
        before = value
    return value


def _extremes(function: Vectorised, ends: tuple[float, float], flat: float) -> list[float]:
    """Smallest and largest value on an interval; variation below `flat` is ignored."""
    first = np.linspace(*ends, _POINTS)
    values = function(first)
    found = []
    for sign in (1.0, -1.0):
        s, near = first, sign * values
        best = float(near.min())
        for _ in range(_ZOOMS if np.ptp(values) > flat else 0):
            at = int(np.argmin(near))  # the extreme may be between an end and its neighbour
            s = np.linspace(s[max(at - 1, 0)], s[min(at + 1, _POINTS - 1)], _POINTS)
            near = sign * function(s)
            best = min(best, float(near.min()))
        found.append(sign * best)
    return found


def _switches(spells: list[Spell], shortest: float) -> tuple[tuple[float, frozenset[int]], ...]:
    """Times at which the resting set changes, without spells below a length."""
    switches: list[tuple[float, frozenset[int]]] = []
    for start, end, masses in spells:
        resting = frozenset(masses)
        if end - start > shortest and (not switches or switches[-1][1] != resting):
            switches.append((start if switches else 0.0, resting))
    return tuple(switches)


def _glides(
    switches: Sequence[tuple[float, frozenset[int]]], period: float
) -> tuple[tuple[float, float], ...]:
    """Glides of the period; a glide across its end is one glide, not two."""
    ends = [*(time for time, _ in switches[1:]), period]
    glides = [(begin, end) for (begin, rest), end in zip(switches, ends, strict=True) if not rest]
    if len(glides) > 1 and glides[0][0] == 0.0 and glides[-1][1] == period:
        glides = [*glides[1:-1], (glides[-1][0], glides[0][1])]
    return tuple(glides)


@dataclass(frozen=True, eq=False)
class DrivenWorm:
    """Gait and worm as functions of the time s since a piece of the gait began."""

    gait: Gait  # link lengths
    mass: np.ndarray  # (n+1,) point masses, head first
    drag: float  # viscous drag k of every mass
    load: float  # load Γ of every mass

    def spans(self, piece: int, s: np.ndarray, derivative: int) -> np.ndarray:
        """S_i = x_0 - x_i (eq. 2), or its `derivative` (0 to 2), (n+1, m) at times `s` (m,)."""
        links = self.gait.on_piece(piece, s, derivative)
        return np.vstack([np.zeros(links.shape[1]), np.cumsum(links, axis=0)])

    def velocities(self, piece: int, s: np.ndarray) -> np.ndarray:
        """Velocity of every mass at w = 0, which is max_j S_j' - S_i', shape (n+1, m).

        0 for masses at rest, positive for the others; `s` (m,) are times in the piece.
        """
        rates = self.spans(piece, s, 1)
        return rates.max(axis=0) - rates

    def held(self, piece: int, leader: int, s: np.ndarray) -> np.ndarray:
        """Velocity of the head and sigma of eq. 7 while mass `leader` rests, shape (2, m)."""
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

    def _sampled(self) -> Iterator[tuple[int, np.ndarray]]:
        for piece in range(self.gait.pieces):
            yield piece, np.linspace(0, self.duration(piece), _SAMPLES)

    @cached_property
    def rate_scale(self) -> float:
        """Largest velocity in the period; 1 if nothing moves."""
        return max(self.velocities(q, s).max() for q, s in self._sampled()) or 1.0

    @cached_property
    def force_scale(self) -> float:
        """Largest sum of the forces in sigma; 1 if there are none."""
        largest = max(float(np.abs(self.spans(q, s, 2)).max()) for q, s in self._sampled())
        return largest * self.mass.max() + self.drag * self.rate_scale + self.load or 1.0


@dataclass(frozen=True)
class Arc:
    """Interval of a piece on which the same mass leads and sigma keeps its sign."""

    piece: int  # index of the piece of the gait
    start: float  # since the piece began
    end: float  # since the piece began
    resting: tuple[int, ...]  # masses at rest at w = 0, ascending
    pulls: bool  # sigma < 0: the worm can only glide

    @property
    def leader(self) -> int:
        """A mass at rest at w = 0."""
        return self.resting[0]


def cut_piece(worm: DrivenWorm, piece: int) -> Iterator[Arc]:
    """Cut a piece where the resting mass changes and where sigma changes its sign."""
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
    """Sample times in [a, b], including those of the minima of all rows."""
    # A row that dips between two samples is found from the parabola through three of them, whose
    # minimum is accurate to fourth order in the spacing.
    s = np.linspace(a, b, _SAMPLES)
    values = np.atleast_2d(rows(s))
    left, middle, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
    bend = left - 2 * middle + right
    bent = bend > 1e-12 * np.abs(values).max()
    row, at = np.nonzero((middle <= left) & (middle <= right) & bent)
    shift = 0.5 * (left - right)[row, at] / bend[row, at]
    return np.union1d(s, s[at + 1] + shift * (s[1] - s[0]))


def _resting(worm: DrivenWorm, piece: int, samples: np.ndarray) -> list[Spell]:
    """Intervals of a piece, and the masses at rest throughout them at w = 0."""
    spells = _spells(worm, piece, samples)
    for _ in range(worm.gait.links):
        # a third mass may lead for an instant where two others exchange the lead
        ends = np.array([end for _, end, _ in spells])
        lag = worm.velocities(piece, ends)[
            [leader for _, _, (leader, *_) in spells], range(len(ends))
        ]
        missed = np.setdiff1d(ends[lag > 2 * _TIE * worm.rate_scale], samples)
        if len(missed) == 0:
            break
        samples = np.union1d(samples, missed)
        spells = _spells(worm, piece, samples)
    return spells


def _spells(worm: DrivenWorm, piece: int, samples: np.ndarray) -> list[Spell]:
    tie = _TIE * worm.rate_scale
    rests = worm.velocities(piece, samples) <= tie
    spells: list[Spell] = []
    start, together = float(samples[0]), rests[:, 0]
    for k in range(1, len(samples)):
        if np.any(together & rests[:, k]):
            together = together & rests[:, k]
            continue
        pair = int(np.argmax(together)), int(np.argmax(rests[:, k]))
        switch = _overtaking(worm, piece, pair, samples[k - 1], samples[k])
        spells.append((start, switch, tuple(map(int, np.flatnonzero(together)))))
        # of masses that lead together at the sample, not all need to lead from the switch on
        now = rests[:, k] & (worm.velocities(piece, np.array([switch]))[:, 0] <= tie)
        start, together = switch, now if now.any() else rests[:, k]
    spells.append((start, float(samples[-1]), tuple(map(int, np.flatnonzero(together)))))
    return spells


def _overtaking(worm: DrivenWorm, piece: int, pair: tuple[int, int], a: float, b: float) -> float:
    """Time at which the second mass of a pair takes the lead in S_i' from the first."""
    old, new = pair

    def lead(s: float) -> float:
        rates = worm.spans(piece, np.array([s]), 1)[:, 0]
        return float(rates[new] - rates[old])

    return root(lead, a, b, xtol=1e-16) if lead(a) < 0 else float(a)


def _sign_changes(sigma: Vectorised, a: float, b: float, worm: DrivenWorm) -> list[float]:
    """Ends of alternating intervals in [a, b]: sigma >= 0 (may be empty), < 0, >= 0, ..."""
    tie = _TIE * worm.force_scale
    s = _samples(sigma, a, b)
    values = sigma(s)
    sign = np.sign(np.where(np.abs(values) <= tie, 0.0, values))
    sign[0] = sign[0] or 1.0
    for k in np.flatnonzero(sign == 0):  # within round-off of 0 the mode does not change
        sign[k] = sign[k - 1]
    cuts = [a] if sign[0] > 0 else [a, a]
    for k in np.flatnonzero(np.diff(sign)):
        # Sample k is the last of the old sign or within round-off of 0. In the latter case sigma
        # may have been 0 for a while, and only then the sample itself is the cut.
        last, least = (k, 0.0) if values[k] * sign[k] > 0 else (k - 1, tie)
        crosses = last >= 0 and values[last] * sign[k] > least
        ends = (s[last], s[last + 1])
        cuts.append(root(lambda t: sigma(np.array([t]))[0], *ends, xtol=1e-16) if crosses else s[k])
    return [*cuts, b]
