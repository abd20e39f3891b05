"""Exact motion of a driven chain in closed form: between events it is a linear flow.

A second route that shares nothing with `simulate`: z' = G z with a constant matrix for every choice
of modes, z(t + s) = exp(G s) z by its power series, which converges to rounding within a step of
length 1/|G|. Events are roots of the resulting polynomials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import matrix_balance

from wormopt.bench.driven_chain import DrivenChain

__all__ = ["Happening", "Motion", "linear_flow"]

_ORDER = 24
_GRID = np.linspace(0.0, 1.0, 9)
_POWERS = _GRID[:, None] ** np.arange(_ORDER + 1)


@dataclass(frozen=True)
class Happening:
    """A velocity that becomes zero, or a mass that is let go.

    Parameters
    ----------
    time : float
        When.
    mass : int
        Which.
    kind : {"reversal", "stick", "release"}
        What.
    """

    time: float
    mass: int
    kind: str


@dataclass(frozen=True, eq=False)
class Motion:
    """What a second route found.

    Parameters
    ----------
    states : ndarray, shape (n_x, m)
        At the sample times.
    end : ndarray, shape (n_x,)
        At the end.
    happenings : sequence of Happening
        In order of time.
    steps : int
        Work done.
    """

    states: np.ndarray
    end: np.ndarray
    happenings: Sequence[Happening] = ()
    steps: int = 0


class _Flow:
    """The automaton; one object per run."""

    def __init__(self, chain: DrivenChain, start: np.ndarray, reach: float, rest: float) -> None:
        self.chain, self.reach, self.rest = chain, reach, rest
        self.masses = chain.links + 1
        self.x, self.t = start.copy(), 0.0
        self.modes = np.zeros(self.masses)
        self.let_go = np.zeros(self.masses, dtype=bool)  # v = 0 and, up to rounding, v' = 0
        self.happenings: list[Happening] = []
        hold = np.array([grip.hold for grip in chain.grips])
        self.least, self.largest = hold[:, 0], hold[:, 1]
        self.slip = np.array([(-g.forward, g.backward) for g in chain.grips])
        self.matrices = cache(self._matrices)
        self.free = cache(chain.generator)

    def _matrices(self, piece: int, modes: tuple[float, ...]) -> tuple[np.ndarray, float]:
        """Generator with friction, and its size."""
        G, n = self.free(piece).copy(), self.masses
        for i, mode in enumerate(modes):
            if mode == 0:
                G[n + i] = 0.0
            else:
                G[n + i, 2 * n] += self.slip[i][0 if mode > 0 else 1] / self.chain.mass[i]
        balanced = matrix_balance(G, permute=False)[0]
        return G, float(max(np.abs(balanced).sum(axis=1).max(), 1e-3))

    def holding(self, piece: int, z: np.ndarray) -> np.ndarray:
        """Force that each mass would need to stay at rest."""
        n = self.masses
        return -self.chain.mass * (self.free(piece)[n : 2 * n] @ z)

    def decide(self, piece: int, z: np.ndarray, event: int = -1) -> None:
        """Choose modes by velocities and, at rest, by forces."""
        n, before = self.masses, self.modes.copy()
        force = self.holding(piece, z)
        for i in range(n):
            v = z[n + i]
            resting = before[i] == 0 and v == 0
            if self.let_go[i] and i != event:  # at this very instant
                continue
            if i != event and abs(v) > self.rest:
                self.modes[i] = np.sign(v)
                continue
            z[n + i] = self.x[n + i] = 0.0
            least, largest = self.least[i], self.largest[i]
            if (least <= force[i] <= largest) and not (resting and i == event):
                self.modes[i] = 0.0
                continue
            middle = force[i] - least < largest - force[i]
            self.modes[i] = 1.0 if middle else -1.0
            self.let_go[i] = resting and i == event
            if resting and i != event and least - 1e-12 <= force[i] <= largest + 1e-12:
                self.let_go[i] = True

    def record(self, before: np.ndarray, event: int) -> None:
        for i in np.flatnonzero((before != self.modes) | (np.arange(self.masses) == event)):
            rests, rested = self.modes[i] == 0, before[i] == 0
            kind = "release" if rested else "stick" if rests else "reversal"
            self.happenings.append(Happening(self.t, int(i), kind))

    def margins(self, piece: int, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Polynomials that are positive until an event, and whose they are."""
        n = self.masses
        moving, resting = np.flatnonzero(self.modes), np.flatnonzero(self.modes == 0)
        rows = [self.modes[moving, None] * C[:, n + moving].T]
        owner = [moving]
        if len(resting):
            force = -self.chain.mass[resting, None] * (self.free(piece)[n + resting] @ C.T)
            for bound, sign in ((self.least, 1.0), (self.largest, -1.0)):
                known = np.isfinite(bound[resting])
                distance = sign * force[known]
                distance[:, 0] -= sign * bound[resting[known]]
                rows.append(distance)
                owner.append(resting[known])
        return np.vstack(rows), np.concatenate(owner)


def _first_root(p: np.ndarray, touching: bool, let_go: bool) -> float:
    """First zero in (0, 1] at which the polynomial falls below 0; 2 if there is none."""
    lost = 2 if let_go else 1 if touching else 0
    q = np.append(p[lost:], np.zeros(lost))  # the root at 0 is divided out
    if lost == 0 and q[0] < 0:
        return 0.0
    values = _POWERS @ q
    slopes = _POWERS[:, :-1] @ (q[1:] * np.arange(1, len(q)))
    for k in range(1, len(_GRID)):
        if values[k] < 0:
            return _bisect(q, _GRID[k - 1], _GRID[k])
        if slopes[k - 1] < 0 < slopes[k]:  # a dip in between
            bottom = _bisect(-q[1:] * np.arange(1, len(q)), _GRID[k - 1], _GRID[k])
            if np.polyval(q[::-1], bottom) < 0:
                return _bisect(q, _GRID[k - 1], bottom)
    return 2.0


def _bisect(q: np.ndarray, a: float, b: float) -> float:
    """Zero of a polynomial that falls through 0 between a and b."""
    q = q[::-1]
    slope = np.polyder(q)
    if np.polyval(q, a) <= 0:
        return float(a)
    for _ in range(100):
        middle = 0.5 * (a + b)
        newton = middle - np.polyval(q, middle) / (np.polyval(slope, middle) or 1e-300)
        if middle in (a, b):
            break
        for c in (middle, newton):
            if a < c < b:
                if np.polyval(q, c) > 0:
                    a = c
                else:
                    b = c
    return float(b)


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
    """Follow a driven chain from 0 to ``span``.

    Parameters
    ----------
    chain : DrivenChain
        What moves.
    span : float
        Last time.
    times : ndarray, shape (m,)
        Sample times, ascending.
    start : ndarray, shape (2 n + 2,), optional
        Positions and velocities at 0 instead of the chain's own.
    reach : float, optional
        Length of a step times the norm of the generator; 1 leaves nothing but rounding.
    rest : float, optional
        Speed below which a mass counts as at rest at an event of another one.
    max_steps : int, optional
        Steps after which it is given up.

    Returns
    -------
    Motion

    Raises
    ------
    RuntimeError
        If it is given up, or events follow each other without time passing.
    """
    flow = _Flow(chain, chain.start if start is None else start, reach, rest)
    n, gait = flow.masses, chain.gait
    states, sampled, steps, cycle, piece, still = np.empty((2 * n, len(times))), 0, 0, 0, 0, 0
    powers = gait.polynomial.shape[2]
    fresh, event = True, -1
    s = 0.0
    while True:
        begin = cycle * gait.period + gait.breaks[piece]
        length = min(cycle * gait.period + gait.breaks[piece + 1], span) - begin
        omega = 0.0 if gait.omega is None else gait.omega[piece]
        forcing = np.append(s ** np.arange(powers), [np.cos(omega * s), np.sin(omega * s)])
        z = np.concatenate([flow.x, forcing])
        if fresh:
            before = flow.modes.copy()
            flow.decide(piece, z, event)
            if steps:
                flow.record(before, event)
            fresh, event = False, -1
        G, size = flow.matrices(piece, tuple(flow.modes))
        h = min(reach / size, length - s)
        C = np.empty((_ORDER + 1, len(z)))
        C[0] = z
        for k in range(_ORDER):
            C[k + 1] = G @ C[k] * (h / (k + 1))
        polynomials, owner = flow.margins(piece, C)
        theta = 2.0
        values = _POWERS @ polynomials.T
        # A polynomial within a step is tame: far from 0 everywhere it needs no closer look.
        spread = values.max(axis=0) - values.min(axis=0)
        for row in np.flatnonzero(values.min(axis=0) <= spread):
            i = owner[row]
            touching = flow.modes[i] != 0 and z[n + i] == 0
            root = _first_root(polynomials[row], touching, touching and bool(flow.let_go[i]))
            if root < theta:
                theta, event = root, int(i)
        fresh = theta <= 1.0
        end = min(theta, 1.0)
        now = flow.t
        stop = s + end * h
        while sampled < len(times) and times[sampled] <= begin + stop:
            at = min(max((times[sampled] - now) / h, 0.0), end) if h else 0.0
            states[:, sampled] = at ** np.arange(_ORDER + 1) @ C[:, : 2 * n]
            sampled += 1
        flow.x = end ** np.arange(_ORDER + 1) @ C[:, : 2 * n]
        flow.x[n:][flow.modes == 0] = 0.0
        if end * h > 0:
            flow.let_go[:] = False
        still = still + 1 if end * h <= 1e-15 * max(span, 1.0) else 0
        if fresh and flow.modes[event] != 0:
            flow.x[n + event] = 0.0
        s = stop
        flow.t = begin + s
        steps += 1
        if still > 20 * n or steps > max_steps:
            raise RuntimeError(f"the closed form is given up at t = {flow.t:g}")
        if not fresh and s >= length * (1 - 1e-15):
            if begin + length >= span:
                break
            cycle, piece = (cycle + 1, 0) if piece + 1 == gait.pieces else (cycle, piece + 1)
            s, fresh = 0.0, True
    states[:, sampled:] = flow.x[:, None]
    return Motion(states, flow.x, flow.happenings, steps)
