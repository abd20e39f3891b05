"""A chain driven by a gait, told three times, and its motion in closed form.

As a Model, as NumPy code and as a linear system: the three share the numbers and nothing else, so
that what is wrong in one is not wrong in all. The closed form shares nothing with `simulate`:
between events z' = G z with a constant matrix for every choice of modes, z(t + s) = exp(G s) z by
its power series, which converges to rounding within a step of length 1/|G|. Events are roots of the
resulting polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import matrix_balance

from wormopt.control.loop import FeedForward, TrackingError, close, gait_reference
from wormopt.model.friction import Coulomb, Law, Spike
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.roots import root
from wormopt.systems.chain.build import chain

_ORDER = 24
_GRID = np.linspace(0.0, 1.0, 9)
_POWERS = _GRID[:, None] ** np.arange(_ORDER + 1)
_WIDEST = 40  # size of z up to which powers of G are kept
_REST = 1e-14  # speed of a mass at rest

Rates = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Grip:
    """Dry friction of one mass in numbers; a spike where backward forces are infinite."""

    forward: float  # sliding force F+
    backward: float  # sliding force F-
    stick_forward: float | None = None  # largest force at rest; None: sliding force
    stick_backward: float | None = None  # largest force at rest; None: sliding force

    @classmethod
    def spike(cls) -> Grip:
        """No friction forward, no way backward."""
        return cls(0.0, np.inf)

    @property
    def hold(self) -> tuple[float, float]:
        """Least and largest force at rest."""
        ahead = self.forward if self.stick_forward is None else self.stick_forward
        behind = self.backward if self.stick_backward is None else self.stick_backward
        return -ahead, behind

    def law(self) -> Law:
        """The same as a Law."""
        if np.isinf(self.backward):
            return Spike()
        return Coulomb(self.forward, self.backward, self.stick_forward, self.stick_backward)


@dataclass(frozen=True, eq=False)
class Plant:
    """Masses on dry ground."""

    rates: Rates  # (t, y, friction forces) -> y'; a mass's force accelerates no other mass
    start: np.ndarray  # (n_y,) state at time 0
    velocity: np.ndarray  # (masses,) indices of their velocities in the state
    mass: np.ndarray  # (masses,)
    grips: Sequence[Grip]  # friction of each mass
    breaks: Callable[[float], np.ndarray]  # (span) -> times within at which rates are not smooth


@dataclass(frozen=True)
class Happening:
    """A velocity that becomes zero, or a mass that is let go."""

    time: float
    mass: int  # its index
    kind: str  # "reversal", "stick" or "release"

    @classmethod
    def of(cls, time: float, mass: int, before: float, after: float) -> Happening:
        """What a change of modes is; mode 0 is rest."""
        kind = "release" if before == 0 else "stick" if after == 0 else "reversal"
        return cls(time, mass, kind)


@dataclass(frozen=True, eq=False)
class Motion:
    """What a second route found."""

    states: np.ndarray  # (n_x, m) at the sample times
    end: np.ndarray  # (n_x,) state at the end
    happenings: Sequence[Happening] = ()  # in order of time


@dataclass(frozen=True, eq=False)
class DrivenChain:
    """n+1 masses, n links whose rest lengths a gait commands, u_j = c_j (y_ref,j - l0_j), (11)."""

    mass: np.ndarray  # (n+1,)
    stiffness: np.ndarray  # (n,)
    damping: np.ndarray  # (n,)
    gait: Gait  # commanded lengths; jumps are allowed
    grips: Sequence[Grip]  # friction of each mass
    drag: float = 0.0  # viscous, on every mass
    position: np.ndarray | None = None  # (n+1,) start; None: commanded lengths, tail at 0

    @classmethod
    def alike(
        cls, gait: Gait, grip: Grip, stiffness: float = 40.0, damping: float = 2.0, drag: float = 0
    ) -> DrivenChain:
        """A chain of masses 1 and links that are all alike."""
        n = gait.links
        numbers = np.ones(n + 1), np.full(n, stiffness), np.full(n, damping)
        return cls(*numbers, gait, [grip] * (n + 1), drag)

    @property
    def links(self) -> int:
        """Number of links n."""
        return len(self.stiffness)

    @property
    def start(self) -> np.ndarray:
        """Positions and velocities at time 0, shape (2 n + 2,)."""
        lengths = self.gait(np.zeros(1))[:, 0]
        stretched = np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
        x = stretched if self.position is None else self.position
        return np.concatenate([x, np.zeros(self.links + 1)])

    def worm(self, rest_length: float) -> Model:
        """Build the Model of the chain alone, by the package's builders."""
        return chain(
            self.links,
            mass=self.mass,
            stiffness=self.stiffness,
            damping=self.damping,
            rest_length=rest_length,
            drag=self.drag,
            law=[grip.law() for grip in self.grips],
            position=self.start[: self.links + 1],
        )

    def model(self) -> Model:
        """Build the Model of the chain under its command."""
        worm = self.worm(0.0)
        reference = gait_reference(self.gait, worm.t)
        force, believed = FeedForward(self.stiffness, 0.0).force(reference)
        error = TrackingError.of(worm, reference)
        return close(worm, reference, error, force, name="command", parameters=believed)

    def plant(self) -> Plant:
        """The same in NumPy, with the times at which the gait has breaks."""
        masses, gait = self.links + 1, self.gait

        def breaks(span: float) -> np.ndarray:
            cycles = np.arange(np.ceil(span / gait.period)) * gait.period
            times = (cycles[:, None] + gait.breaks[None, :-1]).ravel()
            return times[(times > 0) & (times < span)]

        velocity = np.arange(masses, 2 * masses)
        return Plant(self.rates, self.start, velocity, self.mass, self.grips, breaks)

    def rates(self, t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Time derivatives of `y` = positions and velocities (2 n + 2,), in plain NumPy.

        `force` (n+1,): friction on each mass.
        """
        masses = self.links + 1
        x, v = y[:masses], y[masses:]
        pull = self.stiffness * (x[:-1] - x[1:] - self.commanded(t))
        pull += self.damping * (v[:-1] - v[1:])
        net = force - self.drag * v
        net[:-1] -= pull
        net[1:] += pull
        return np.concatenate([v, net / self.mass])

    def commanded(self, t: float) -> np.ndarray:
        """Lengths (n,) that the gait commands at time t."""
        gait = self.gait
        since = t % gait.period
        piece = min(int(np.searchsorted(gait.breaks, since, side="right")) - 1, gait.pieces - 1)
        s = since - gait.breaks[piece]
        value = np.zeros(self.links)
        for column in gait.polynomial[piece].T[::-1]:
            value = value * s + column
        omega, cosine, sine = self.harmonic(piece)
        return value + cosine * np.cos(omega * s) + sine * np.sin(omega * s)

    def harmonic(self, piece: int) -> tuple[float, np.ndarray | float, np.ndarray | float]:
        """Angular frequency and amplitudes (n,) of cosine and sine, 0 where there are none."""
        gait = self.gait
        if gait.omega is None or gait.cosine is None or gait.sine is None:
            return 0.0, 0.0, 0.0
        return float(gait.omega[piece]), gait.cosine[piece], gait.sine[piece]

    def generator(self, piece: int) -> np.ndarray:
        """Matrix G of z' = G z on a piece of the gait, all masses sliding without friction.

        z holds positions, velocities, the powers 1, s, s^2, ... of the time since the piece
        began, cos(omega s) and sin(omega s): 2 n + 4 + powers entries.
        """
        masses, powers = self.links + 1, self.gait.polynomial.shape[2]
        size = 2 * masses + powers + 2
        omega, cosine, sine = self.harmonic(piece)
        links = np.eye(self.links, masses) - np.eye(self.links, masses, 1)
        lengths = np.zeros((self.links, size))  # l - y_ref of z
        lengths[:, :masses] = links
        lengths[:, 2 * masses : -2] = -self.gait.polynomial[piece]
        lengths[:, -2], lengths[:, -1] = -cosine, -sine
        pull = self.stiffness[:, None] * lengths
        pull[:, masses : 2 * masses] += self.damping[:, None] * links
        G = np.zeros((size, size))
        G[:masses, masses : 2 * masses] = np.eye(masses)
        G[masses : 2 * masses] = -(links.T @ pull) / self.mass[:, None]
        G[masses : 2 * masses, masses : 2 * masses] -= np.diag(self.drag / self.mass)
        for power in range(1, powers):
            G[2 * masses + power, 2 * masses + power - 1] = power
        G[-2, -1], G[-1, -2] = -omega, omega
        return G


# -- closed form ---------------------------------------------------------------------------------


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

    def __init__(self, worm: DrivenChain, start: np.ndarray) -> None:
        self.worm, self.n = worm, worm.links + 1
        self.x, self.t = start.copy(), 0.0
        self.modes = np.zeros(self.n)
        self.let_go = np.zeros(self.n, dtype=bool)  # just now
        self.happenings: list[Happening] = []
        self.least, self.largest = np.array([grip.hold for grip in worm.grips]).T
        self.slip = np.array([(-g.forward, g.backward) for g in worm.grips])
        # What rounding can make of a force. A mass is let go when its force is out of bounds by
        # more than that, so that its acceleration then has the right sign.
        largest = float(np.max(worm.stiffness) * np.max(np.abs(start[: self.n])))
        self.slack = 1e-13 * max(1.0, largest)
        self.free = [worm.generator(piece) for piece in range(worm.gait.pieces)]
        self.regime = lru_cache(maxsize=256)(self._regime)

    def _regime(self, piece: int, modes: tuple[float, ...]) -> _Regime:
        G, n = self.free[piece].copy(), self.n
        rows, owner = [], []
        for i, mode in enumerate(modes):
            if mode != 0:
                G[n + i, 2 * n] += self.slip[i][0 if mode > 0 else 1] / self.worm.mass[i]
                rows.append(mode * np.eye(1, len(G), n + i)[0])
                owner.append(i)
                continue
            needed = -self.worm.mass[i] * self.free[piece][n + i]
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
        force = -self.worm.mass * (self.free[piece][n : 2 * n] @ z)
        for i in range(n):
            v, least, largest = z[n + i], self.least[i], self.largest[i]
            resting = before[i] == 0 and v == 0
            if self.let_go[i] and i != event:  # at this very instant
                continue
            if i != event and abs(v) > _REST:
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
            self.happenings.append(Happening.of(self.t, int(i), before[i], self.modes[i]))

    def first_event(self, regime: _Regime, C: np.ndarray) -> tuple[float, int]:
        """Where in the step the first event is, 2 if there is none, and whose it is."""
        polynomials = C @ regime.margins.T
        values = _POWERS @ polynomials
        # A polynomial within a step is tame: far from 0 everywhere it needs no closer look.
        lowest = values.min(axis=0)
        first, event = 2.0, -1
        for row in np.flatnonzero(lowest <= values.max(axis=0) - lowest):
            place = _first_root(polynomials[:, row])
            if place < first:
                first, event = place, int(regime.owner[row])
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
    """Zero of a polynomial that falls through 0 between a and b."""
    exponents = np.arange(len(q))

    def value(c: float) -> float:
        return float(q @ c**exponents)

    if value(a) <= 0:
        return a
    return root(value, a, b) if value(b) < 0 else b


def linear_flow(
    worm: DrivenChain,
    span: float,
    times: np.ndarray,
    *,
    start: np.ndarray | None = None,
    reach: float = 1.0,
    max_steps: int = 2_000_000,
) -> Motion:
    """Follow a driven chain from 0 to `span`; `times` (m,) ascend, `start` is (2 n + 2,).

    `reach`: step times norm of the generator; 1 leaves only rounding.
    Raises RuntimeError after `max_steps`, or if events follow without time passing.
    """
    flow = _Flow(worm, worm.start if start is None else start)
    n, gait = flow.n, worm.gait
    states, sampled, steps, still = np.empty((2 * n, len(times))), 0, 0, 0
    powers, exponents = np.arange(gait.polynomial.shape[2]), np.arange(_ORDER + 1)
    cycle, piece, s, fresh, event = 0, 0, 0.0, True, -1
    while True:
        begin = cycle * gait.period + gait.breaks[piece]
        length = min(cycle * gait.period + gait.breaks[piece + 1], span) - begin
        omega = worm.harmonic(piece)[0]
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
    return Motion(states, flow.x, flow.happenings)
