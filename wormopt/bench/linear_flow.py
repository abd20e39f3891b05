"""Exact motion of a driven chain in closed form: between events it is a linear flow.

A second route that shares nothing with `simulate`: z' = G z with a constant matrix for every choice
of modes, z(t + s) = exp(G s) z by its power series, which converges to rounding within a step of
length 1/|G|. Events are roots of the resulting polynomials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import matrix_balance

from wormopt.bench.driven_chain import DrivenChain

_ORDER = 24
_GRID = np.linspace(0.0, 1.0, 9)
_POWERS = _GRID[:, None] ** np.arange(_ORDER + 1)
_WIDEST = 40  # size of z up to which powers of G are kept


@dataclass(frozen=True)
class Happening:
    """A velocity that becomes zero, or a mass that is let go."""

    time: float
    mass: int  # its index
    kind: str  # "reversal", "stick" or "release"


@dataclass(frozen=True, eq=False)
class Motion:
    """What a second route found."""

    states: np.ndarray  # (n_x, m) at the sample times
    end: np.ndarray  # (n_x,) state at the end
    happenings: Sequence[Happening] = ()  # in order of time
    steps: int = 0  # work done


@dataclass(frozen=True, eq=False)
class _Regime:
    """The linear system of one choice of modes."""

    G: np.ndarray
    margins: np.ndarray  # rows that times z are positive until an event
    owner: np.ndarray  # whose they are

    @cached_property
    def size(self) -> float:
        balanced = matrix_balance(self.G, permute=False)[0]
        return float(max(np.abs(balanced).sum(axis=1).max(), 1e-3))

    @cached_property
    def powers(self) -> np.ndarray:
        """G^k / (size^k k!), stacked."""
        terms = [np.eye(len(self.G))]
        for k in range(1, _ORDER + 1):
            terms.append(self.G @ terms[-1] / (self.size * k))
        return np.concatenate(terms)

    def series(self, z: np.ndarray, h: float) -> np.ndarray:
        """Coefficients of z(theta h) by powers of theta, shape (order + 1, len(z))."""
        if len(z) <= _WIDEST:
            scale = (h * self.size) ** np.arange(_ORDER + 1)
            return (self.powers @ z).reshape(_ORDER + 1, -1) * scale[:, None]
        C = np.empty((_ORDER + 1, len(z)))
        C[0] = z
        for k in range(_ORDER):
            C[k + 1] = self.G @ C[k] * (h / (k + 1))
        return C


class _Flow:
    """The automaton; one object per run."""

    def __init__(self, chain: DrivenChain, start: np.ndarray, rest: float) -> None:
        self.chain, self.rest = chain, rest
        self.n = chain.links + 1
        self.x, self.t = start.copy(), 0.0
        self.modes = np.zeros(self.n)
        self.let_go = np.zeros(self.n, dtype=bool)  # just now
        self.happenings: list[Happening] = []
        hold = np.array([grip.hold for grip in chain.grips])
        self.least, self.largest = hold[:, 0], hold[:, 1]
        self.slip = np.array([(-g.forward, g.backward) for g in chain.grips])
        # What rounding can make of a force. A mass is let go when its force is out of bounds by
        # more than that, so that its acceleration then has the right sign.
        self.slack = 1e-13 * max(
            1.0, float(np.max(chain.stiffness) * np.max(np.abs(start[: self.n])))
        )
        self.free = [chain.generator(piece) for piece in range(chain.gait.pieces)]
        self.regime = lru_cache(maxsize=256)(self._regime)

    def _regime(self, piece: int, modes: tuple[float, ...]) -> _Regime:
        G, n = self.free[piece].copy(), self.n
        rows, owner = [], []
        for i, mode in enumerate(modes):
            if mode != 0:
                G[n + i, 2 * n] += self.slip[i][0 if mode > 0 else 1] / self.chain.mass[i]
                rows.append(mode * np.eye(1, len(G), n + i)[0])
                owner.append(i)
                continue
            needed = -self.chain.mass[i] * self.free[piece][n + i]
            G[n + i] = 0.0
            for bound, sign in ((self.least[i], 1.0), (self.largest[i], -1.0)):
                if np.isfinite(bound):
                    row = sign * needed
                    row[2 * n] -= sign * bound - self.slack
                    rows.append(row)
                    owner.append(i)
        return _Regime(G, np.array(rows), np.array(owner))

    def decide(self, piece: int, z: np.ndarray, event: int) -> None:
        """Choose modes by velocities and, at rest, by the force that rest would need."""
        n, before = self.n, self.modes.copy()
        force = -self.chain.mass * (self.free[piece][n : 2 * n] @ z)
        for i in range(n):
            v, least, largest = z[n + i], self.least[i], self.largest[i]
            resting = before[i] == 0 and v == 0
            if self.let_go[i] and i != event:  # at this very instant
                continue
            if i != event and abs(v) > self.rest:
                self.modes[i] = np.sign(v)
                continue
            z[n + i] = self.x[n + i] = 0.0
            held = least - self.slack <= force[i] <= largest + self.slack
            if held and not (resting and i == event):
                self.modes[i] = 0.0
                continue
            self.modes[i] = 1.0 if force[i] - least < largest - force[i] else -1.0
            self.let_go[i] = resting

    def record(self, before: np.ndarray, event: int) -> None:
        for i in np.flatnonzero((before != self.modes) | (np.arange(self.n) == event)):
            rests, rested = self.modes[i] == 0, before[i] == 0
            kind = "release" if rested else "stick" if rests else "reversal"
            self.happenings.append(Happening(self.t, int(i), kind))

    def first_event(self, regime: _Regime, C: np.ndarray) -> tuple[float, int]:
        """Where in the step the first event is, 2 if there is none, and whose it is."""
        polynomials = C @ regime.margins.T
        values = _POWERS @ polynomials
        # A polynomial within a step is tame: far from 0 everywhere it needs no closer look.
        lowest = values.min(axis=0)
        first, event = 2.0, -1
        for row in np.flatnonzero(lowest <= values.max(axis=0) - lowest):
            root = _first_root(polynomials[:, row])
            if root < first:
                first, event = root, int(regime.owner[row])
        return first, event


def _first_root(p: np.ndarray) -> float:
    """First zero in (0, 1] at which a polynomial falls below 0; 2 if there is none.

    A zero at 0, of a mass that has just begun to move, is divided out.
    """
    q = np.append(p[1:], 0.0) if p[0] == 0 else p
    if q[0] < 0:
        return 0.0
    values, slope = _POWERS @ q, q[1:] * np.arange(1, len(q))
    slopes = _POWERS[:, :-1] @ slope
    for k in range(1, len(_GRID)):
        if values[k] < 0:
            return _falls(q, _GRID[k - 1], _GRID[k])
        if slopes[k - 1] < 0 < slopes[k]:  # a dip in between
            bottom = _falls(-slope, _GRID[k - 1], _GRID[k])
            if np.polyval(q[::-1], bottom) < 0:
                return _falls(q, _GRID[k - 1], bottom)
    return 2.0


def _falls(q: np.ndarray, a: float, b: float) -> float:
    """Zero of a polynomial that falls through 0 between a and b, by Newton within a bracket."""
    exponents = np.arange(len(q))
    slope = q[1:] * exponents[1:]
    if q @ a**exponents <= 0:
        return float(a)
    c = 0.5 * (a + b)
    for _ in range(100):
        value = float(q @ c**exponents)
        if value > 0:
            a = c
        else:
            b = c
        steep = float(slope @ c ** exponents[:-1])
        newton = c - value / steep if steep else a
        if abs(newton - c) <= 1e-16:
            break
        c = newton if a < newton < b else 0.5 * (a + b)
        if c in (a, b):
            break
    return float(c)


def linear_flow(
    chain: DrivenChain,
    span: float,
    times: np.ndarray,
    *,
    start: np.ndarray | None = None,
    reach: float = 1.0,
    rest: float = 1e-14,
    max_steps: int = 2_000_000,
) -> Motion:
    """Follow a driven chain from 0 to `span`; `times` (m,) ascend, `start` is (2 n + 2,).

    `reach`: step times norm of the generator; 1 leaves only rounding. `rest`: speed at rest.
    Raises RuntimeError after `max_steps`, or if events follow without time passing.
    """
    flow = _Flow(chain, chain.start if start is None else start, rest)
    n, gait = flow.n, chain.gait
    states, sampled, steps, still = np.empty((2 * n, len(times))), 0, 0, 0
    powers, exponents = np.arange(gait.polynomial.shape[2]), np.arange(_ORDER + 1)
    cycle, piece, s, fresh, event = 0, 0, 0.0, True, -1
    while True:
        begin = cycle * gait.period + gait.breaks[piece]
        length = min(cycle * gait.period + gait.breaks[piece + 1], span) - begin
        omega = 0.0 if gait.omega is None else gait.omega[piece]
        z = np.concatenate([flow.x, s**powers, [np.cos(omega * s), np.sin(omega * s)]])
        if fresh:
            before = flow.modes.copy()
            flow.decide(piece, z, event)
            if steps:
                flow.record(before, event)
        regime = flow.regime(piece, tuple(flow.modes))
        h = min(reach / regime.size, length - s)
        C = regime.series(z, h)
        theta, event = flow.first_event(regime, C)
        fresh, end = theta <= 1.0, min(theta, 1.0)
        stop = s + end * h if fresh or h < length - s else length
        while sampled < len(times) and times[sampled] <= begin + stop:
            at = min(max((times[sampled] - begin - s) / h, 0.0), end) if h else 0.0
            states[:, sampled] = at**exponents @ C[:, : 2 * n]
            sampled += 1
        flow.x = end**exponents @ C[:, : 2 * n]
        flow.x[n:][flow.modes == 0] = 0.0
        still = still + 1 if end * h <= 1e-15 * max(span, 1.0) else 0
        if not still:
            flow.let_go[:] = False
        if fresh:
            flow.x[n + event] = 0.0
        s, flow.t, steps = stop, begin + stop, steps + 1
        if still > 20 * n or steps > max_steps:
            raise RuntimeError(f"the closed form is given up at t = {flow.t:g}")
        if not fresh and s >= length:
            if begin + length >= span:
                break
            cycle, piece = (cycle + 1, 0) if piece + 1 == gait.pieces else (cycle, piece + 1)
            s, fresh, event = 0.0, True, -1
    states[:, sampled:] = flow.x[:, None]
    return Motion(states, flow.x, flow.happenings, steps)
