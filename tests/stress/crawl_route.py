"""Crawls once more: a gait's own formulas, quadrature between their roots, steps of Moreau.

Shares nothing with `crawl` but the numbers of a `Gait`. Mass i is at x_0 - S_i. While one mass
rests, it is the one whose S_i' is largest, and everything is explicit; parts on which the same
mass rests are found as roots of Chebyshev interpolants. Where the spikes would have to pull, or
where the worm is thrown, implicit Euler steps of the velocity of the head follow it, and
Richardson's extrapolation of two step sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import linprog

from tests.stress.verdict import Undecided
from wormopt.model.gait import Gait

Rows = Callable[[np.ndarray], np.ndarray]
"""Functions of the time since a piece began: (m,) to (rows, m)."""

_DEGREE, _ROUNDING = 14, 1e-12
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Part:
    """Where one mass rests, if any does, and all functions are smooth."""

    piece: int
    start: float  # since the piece began
    stop: float
    leader: int  # the mass that rests
    resting: int = 1  # how many do


@dataclass(frozen=True, eq=False)
class Crawling:
    """A worm of given masses under a gait."""

    gait: Gait
    mass: np.ndarray  # (n+1,)
    drag: float
    load: float

    def links(self, piece: int, s: np.ndarray, order: int) -> np.ndarray:
        """Derivatives of the lengths (n, m), `s` after a piece began."""
        gait, s = self.gait, np.asarray(s, float)
        values = [
            np.polynomial.Polynomial(row).deriv(order)(s) if order else np.polyval(row[::-1], s)
            for row in gait.polynomial[piece]
        ]
        found = np.array([np.broadcast_to(value, s.shape) for value in values])
        if gait.omega is None or gait.cosine is None or gait.sine is None:
            return found
        omega = gait.omega[piece]
        turning = (1j * omega) ** order * np.exp(1j * omega * s)
        return found + np.real((gait.cosine[piece] - 1j * gait.sine[piece])[:, None] * turning)

    def spans(self, piece: int, s: np.ndarray, order: int) -> np.ndarray:
        """Derivatives of S_i (n+1, m)."""
        found = self.links(piece, s, order)
        return np.vstack([np.zeros(found.shape[1]), np.cumsum(found, axis=0)])

    @property
    def widths(self) -> np.ndarray:
        """How long each piece is."""
        return np.diff(self.gait.breaks)

    @cached_property
    def parts(self) -> list[Part]:
        """All parts of a period in order."""
        return [part for piece in range(len(self.widths)) for part in self._parts_of(piece)]

    def _parts_of(self, piece: int) -> Iterator[Part]:
        width = float(self.widths[piece])
        turn = 0.0 if self.gait.omega is None else abs(float(self.gait.omega[piece])) * width
        edges = np.linspace(0.0, width, 1 + max(1, int(np.ceil(turn))))
        for a, b in pairwise(edges):
            rows = _interpolant(lambda s: self.spans(piece, s, 1), a, b)
            size, cuts = np.abs(rows).max(), [a, b]
            for i, j in combinations(range(rows.shape[1]), 2):
                gap = rows[:, i] - rows[:, j]
                if np.abs(gap).max() > 1e-11 * size:
                    cuts += list(_roots(gap, a, b))
            for start, stop in pairwise(_apart(cuts, 1e-11 * width)):
                spans = self.spans(piece, np.linspace(start, stop, 5)[1:-1], 1)
                leader = int(np.argmax(spans[:, 1]))
                level = np.abs(spans - spans[leader]).max(axis=1) < 1e-9 * self.rate_size
                yield Part(piece, start, stop, leader, int(level.sum()))

    # -- while one mass rests --------------------------------------------------------------------

    def resting(self, part: Part) -> tuple[Rows, Rows]:
        """Velocities and accelerations (n+1, m) of the masses."""

        def of(order: int) -> Rows:
            def rows(s: np.ndarray) -> np.ndarray:
                spans = self.spans(part.piece, s, order)
                return spans[part.leader] - spans

            return rows

        return of(1), of(2)

    def load_on(self, part: Part) -> Rows:
        """Load of all spikes together (1, m)."""
        v, a = self.resting(part)

        def rows(s: np.ndarray) -> np.ndarray:
            needed = self.mass @ a(s) + self.drag * v(s).sum(axis=0)
            return (needed + len(self.mass) * self.load)[None]

        return rows

    def forces(self, part: Part) -> Rows:
        """Actuator forces (n, m) while the leader alone carries the load."""
        v, a = self.resting(part)

        def rows(s: np.ndarray) -> np.ndarray:
            surplus = -self.drag * v(s) - self.load - self.mass[:, None] * a(s)
            surplus[part.leader] += self.load_on(part)(s)[0]
            return np.cumsum(surplus, axis=0)[:-1]

        return rows

    @cached_property
    def least_load(self) -> float:
        """Smallest load of all spikes that kinematics asks for."""
        return float(self.extremes(self.load_on)[0][0])

    def load_of_one(self, part: Part) -> Rows:
        """Load of each spike that carries (1, m), alike for all masses that rest."""
        together = self.load_on(part)
        return lambda s: together(s) / part.resting

    @cached_property
    def rate_size(self) -> float:
        """Largest |S_i'|, about."""
        return max(np.abs(self.spans(q, np.linspace(0, h, 9), 1)).max() for q, h in self._pieces)

    @cached_property
    def force_size(self) -> float:
        """Size of the forces at play."""
        sizes = [np.abs(self.links(q, np.linspace(0, h, 9), 2)).max() for q, h in self._pieces]
        rates = [np.abs(self.links(q, np.linspace(0, h, 9), 1)).max() for q, h in self._pieces]
        return float(self.load + self.mass.mean() * max(sizes) + self.drag * max(rates))

    @property
    def _pieces(self) -> list[tuple[int, float]]:
        return list(enumerate(self.widths))

    @cached_property
    def rests(self) -> bool:
        """Whether a mass rests at any time: no spike has to pull, nothing throws the worm."""
        return self.least_load >= -_ROUNDING * self.force_size and not self.thrown

    @property
    def thrown(self) -> bool:
        """Whether the mean velocity jumps down anywhere."""
        for q, width in self._pieces:
            after = (q + 1) % len(self.widths)
            before = self.spans(q, np.array([width]), 1)[:, 0]
            then = self.spans(after, np.array([0.0]), 1)[:, 0]
            jump = self._common(then) - self._common(before)
            if jump < -1e-10 * self.rate_size:
                return True
        return False

    def _common(self, spans: np.ndarray) -> float:
        return float(spans.max() - self.mass @ spans / self.mass.sum())

    @property
    def work(self) -> float:
        """Work that actuators do in a period, nothing recovered, while one mass rests alone."""
        total = 0.0
        for part in self.parts:
            forces = self.forces(part)

            def power(s: np.ndarray, p: Part = part, of: Rows = forces) -> np.ndarray:
                return np.maximum(-of(s) * self.links(p.piece, s, 1), 0.0).sum(axis=0)

            both = _interpolant(
                lambda s, p=part, of=forces: np.vstack([of(s), self.links(p.piece, s, 1)]),
                part.start,
                part.stop,
            )
            turns = [t for row in both.T if np.any(row) for t in _roots(row, part.start, part.stop)]
            cuts = np.unique([part.start, *turns, part.stop])
            total += sum(_integral(power, a, b) for a, b in pairwise(cuts))
        return total

    @property
    def advance(self) -> float:
        """Distance of a period, by quadrature if a mass always rests."""
        total = 0.0
        for part in self.parts:

            def rate(s: np.ndarray, p: Part = part) -> np.ndarray:
                return self.spans(p.piece, s, 1)[p.leader]

            total += _integral(rate, part.start, part.stop)
        return total

    def extremes(self, of: Callable[[Part], Rows]) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value of rows over the period."""
        low, high = [], []
        for part in self.parts:
            values = _candidates(of(part), part.start, part.stop)
            low.append(values.min(axis=1))
            high.append(values.max(axis=1))
        return np.min(low, axis=0), np.max(high, axis=0)

    def extremes_of_links(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value (n,) of a derivative of the lengths."""
        return self.extremes(lambda part: lambda s: self.links(part.piece, s, order))

    @property
    def gap(self) -> tuple[float, float]:
        """Largest jumps of lengths and of rates from piece to piece."""
        found = []
        for order in (0, 1):
            ends = [self.links(q, np.array([width]), order) for q, width in self._pieces]
            starts = [self.links(q, np.zeros(1), order) for q, _ in self._pieces]
            found.append(float(np.abs(np.array(ends) - np.roll(starts, -1, axis=0)).max()))
        return found[0], found[1]

    # -- whether or not one does -----------------------------------------------------------------

    @property
    def stepped(self) -> tuple[float, float]:
        """Mean speed by steps of Moreau, and how far that of fewer steps is off."""
        by = {count: self._by_steps(count) for count in (1000, 2000, 8000, 16000)}
        few, many = 2 * by[2000] - by[1000], 2 * by[16000] - by[8000]
        # releases and stops fall somewhere within a step, so that errors do not fall evenly
        return many, max(abs(many - few), 2 * abs(by[16000] - by[8000]))

    def _by_steps(self, steps: int) -> float:
        """Mean speed of the periodic motion by implicit Euler."""
        spans, h = self._grid(steps)
        lead, common = spans.max(axis=0), self.mass @ spans
        mass, masses = float(self.mass.sum()), len(self.mass)
        drift = h * (self.drag * spans.sum(axis=0) - masses * self.load)
        push = (np.diff(common, prepend=common[-1]) + drift).tolist()
        slow = (mass + h * masses * self.drag).tolist()
        floor, last, w = lead.tolist(), float(lead[-1]), 0.0
        for _ in range(400):
            u, speeds = last + w, []
            for f, p, d in zip(floor, push, slow, strict=True):
                u = max(f, (mass * u + p) / d)
                speeds.append(u)
            after = u - last
            if abs(after - w) <= 1e-12 * np.abs(lead).max():
                u = np.array(speeds)
                before = np.append(u[-1], u[:-1])
                return float(h @ (u + before) / 2) / self.gait.period
            w = after
        raise Undecided("the worm does not come to a periodic motion")

    def _grid(self, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """S_i' at the ends of steps (n+1, m), and their sizes; at breaks steps of no length."""
        columns, sizes = [], []
        for q, width in self._pieces:
            count = max(4, round(steps * width / self.gait.period))
            columns.append(self.spans(q, np.linspace(0.0, width, count + 1), 1))
            sizes.append(np.append(0.0, np.full(count, width / count)))
        return np.hstack(columns), np.concatenate(sizes)


def _interpolant(rows: Rows, a: float, b: float) -> np.ndarray:
    """Chebyshev coefficients (degree + 1, rows) of functions on [a, b]."""
    x = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    values = rows((a + b) / 2 + (b - a) / 2 * x)
    found = chebyshev.chebvander(x, _DEGREE).T @ values.T * 2 / (_DEGREE + 1)
    found[0] /= 2
    return found


def _roots(coefficients: np.ndarray, a: float, b: float) -> np.ndarray:
    trimmed = chebyshev.chebtrim(coefficients, 1e-13 * np.abs(coefficients).max())
    found = chebyshev.chebroots(trimmed)
    real = np.real(found[np.abs(np.imag(found)) < 1e-7])
    inside = real[np.abs(real) < 1.0]
    return (a + b) / 2 + (b - a) / 2 * inside


def _candidates(rows: Rows, a: float, b: float) -> np.ndarray:
    """Values of functions at the ends of [a, b] and wherever one of them may be extreme."""
    times = [a, b]
    for column in _interpolant(rows, a, b).T:
        slope = chebyshev.chebder(column)
        if np.abs(slope).max() > 0:
            times += list(_roots(slope, a, b))
    return rows(np.array(times))


def _apart(cuts: list[float], least: float) -> list[float]:
    """Cuts in order, without those nearer than `least` to the one before or to the last."""
    first, *others, last = sorted(cuts)
    kept = [first]
    for cut in others:
        if min(cut - kept[-1], last - cut) > least:
            kept.append(cut)
    return [*kept, last]


def _integral(rate: Callable[[np.ndarray], np.ndarray], a: float, b: float) -> float:
    return float(rate((a + b) / 2 + (b - a) / 2 * _NODES) @ _WEIGHTS) * (b - a) / 2


def most_speed(contraction: np.ndarray, extension: np.ndarray, resting: int) -> float:
    """Bound on the speed that rates and resting masses leave: a linear program over sets."""
    n = len(contraction)
    sets = list(combinations(range(n + 1), resting))
    width = n + 2  # share of time and distances of n + 1 masses, by set
    rows, equal, to = [], [], []
    for z, held in enumerate(sets):
        at = z * width
        for j in range(n):
            for sign, rate in ((1.0, extension[j]), (-1.0, contraction[j])):
                row = np.zeros(len(sets) * width)
                row[at + 1 + j], row[at + 2 + j], row[at] = sign, -sign, -rate
                rows.append(row)
        for i in held:
            row = np.zeros(len(sets) * width)
            row[at + 1 + i] = 1.0
            equal.append(row)
            to.append(0.0)
    total = np.zeros(len(sets) * width)
    total[::width] = 1.0
    equal.append(total)
    to.append(1.0)
    for i in range(n):
        row = np.zeros(len(sets) * width)
        row[1 + i :: width], row[2 + i :: width] = 1.0, -1.0
        equal.append(row)
        to.append(0.0)
    gain = np.zeros(len(sets) * width)
    gain[1::width] = -1.0
    found = linprog(gain, rows, np.zeros(len(rows)), np.array(equal), to, method="highs")
    if not found.success:
        raise Undecided(f"linear program: {found.message}")
    return -float(found.fun)
