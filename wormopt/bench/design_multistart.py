"""Gait design by IPOPT from many random starts, over orders of resting masses.

Arcs of free duration with velocities linear within them. Six a phase are enough for two links
without drag in the benchmarks; with more links or drag ten gain up to half a percent. One program
serves all orders of so many phases: which masses rest stands in its bounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.bench.design_cases import Arrays, Case
from wormopt.bench.design_motion import Course, Motion

_ACCEPTED = 1e-7  # excess over limits that the solver leaves
_SHORTEST = 1e-7  # duration of an arc, as a part of the longest cycle
_CYCLES = 6
_KEPT = 8  # starts worth another try near them
_OPTIONS = {
    "expand": True,
    "print_time": False,
    "show_eval_warnings": False,
    "error_on_fail": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 250,
        "tol": 1e-8,
        "constr_viol_tol": 1e-9,
        "bound_relax_factor": 0.0,
        "mu_strategy": "adaptive",
    },
}

Word = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Start:
    """Where a solve begins, but for random numbers."""

    word: Word  # masses that rest, phase after phase
    cycles: int  # repetitions of the word in a period


@dataclass(frozen=True)
class Found:
    """The best gait of many starts."""

    speed: float  # mean over the cycle
    start: Start  # order of resting masses, and cycles a period
    motion: Motion  # one cycle

    @property
    def phases(self) -> list[float]:
        """Durations of the phases."""
        return self.motion.durations.reshape(len(self.start.word), -1).sum(axis=1).tolist()


def by_multistart(
    case: Case,
    seconds: float,
    seed: int = 0,
    phases: Sequence[int] = (2, 3, 4),
    tell: Callable[[Found], None] | None = None,
    arcs: int = 6,
) -> Course:
    """Design a gait from random starts until the time is over; the last solve is finished.

    A third of the starts are random in order and cycles, the others vary one of the best.
    Gaits that exceed a limit by more than 1e-7 of its size do not count.
    """
    begin, limits, rng = time.perf_counter(), Arrays.of(case), np.random.default_rng(seed)
    programs: dict[int, _Program] = {}
    course: Course = []
    kept: dict[Start, float] = {}
    while time.perf_counter() - begin < seconds:
        start = _next(limits, kept, phases, rng)
        count = len(start.word)
        if count not in programs:
            programs[count] = _Program(limits, count, arcs)
        motion = programs[count].solve(start, rng)
        if motion is None or motion.worst(limits) > _ACCEPTED:
            continue
        speed = motion.speed
        kept[start] = max(speed, kept.get(start, 0.0))
        kept = dict(sorted(kept.items(), key=lambda entry: -entry[1])[:_KEPT])
        if not course or speed > course[-1][1]:
            course.append((time.perf_counter() - begin, speed))
            if tell is not None:
                tell(Found(speed, start, motion))
    return course


def best_by_multistart(
    case: Case,
    seconds: float,
    seed: int = 0,
    phases: Sequence[int] = (2, 3, 4, 5, 6),
    arcs: int = 10,
) -> Found | None:
    """Look for the best gait, as a referee of other designers; None if no start led to one.

    `phases`: numbers of phases a cycle; `arcs`: of every phase.
    """
    found: list[Found] = []
    by_multistart(case, seconds, seed, phases, found.append, arcs)
    return found[-1] if found else None


def _next(
    limits: Arrays, kept: dict[Start, float], phases: Sequence[int], rng: np.random.Generator
) -> Start:
    if len(kept) < 2 or rng.random() < 0.3:
        word = _random_word(limits, phases, rng)
        return Start(word, int(rng.integers(1, _CYCLES + 1)))
    near = list(kept)[min(int(rng.geometric(0.4)) - 1, len(kept) - 1)]
    cycles = min(max(near.cycles + int(rng.integers(-1, 2)), 1), _CYCLES)
    changed = near.word
    for _ in range(int(rng.integers(4))):
        changed = _changed(limits, changed, rng) or near.word
    allowed = len(changed) in phases and _moves(changed)
    return Start(_turned(changed) if allowed else near.word, cycles)


def _random_word(limits: Arrays, phases: Sequence[int], rng: np.random.Generator) -> Word:
    """Of any count of phases, as not all of them allow a gait."""
    while True:
        count = int(rng.choice(np.asarray(phases)))
        word = tuple(_random_set(limits, rng) for _ in range(count))
        if _moves(word):
            return _turned(word)


def _random_set(limits: Arrays, rng: np.random.Generator) -> tuple[int, ...]:
    """A quarter of them larger than need be, where that may help."""
    sets = limits.resting_sets()
    larger = [s for s in sets if len(s) > limits.resting]
    chosen = larger if larger and rng.random() < 0.25 else sets[: len(sets) - len(larger)]
    return chosen[int(rng.integers(len(chosen)))]


def _changed(limits: Arrays, word: Word, rng: np.random.Generator) -> Word:
    """Put a phase in, take one out, or replace one."""
    place, new = int(rng.integers(len(word))), _random_set(limits, rng)
    skip, insert = [(0, (new,)), (1, ()), (1, (new,))][int(rng.integers(3))]
    return word[:place] + insert + word[place + skip :]


def _moves(word: Word) -> bool:
    """Whether neighbours differ and no mass rests all the time."""
    differ = all(a != b for a, b in zip(word, word[1:] + word[:1], strict=True))
    return differ and not set.intersection(*map(set, word))


def _turned(word: Word) -> Word:
    """The same for all rotations."""
    return min(word[k:] + word[:k] for k in range(len(word)))


class _Program:
    """Nonlinear program of all orders of so many phases: durations, velocities, lengths."""

    def __init__(self, limits: Arrays, phases: int, arcs: int) -> None:
        self._limits, self._each, self._arcs = limits, arcs, arcs * phases
        K, n = self._arcs, limits.links
        h, v = ca.SX.sym("h", K), ca.SX.sym("v", n + 1, K)
        lengths, shares = ca.SX.sym("l", n, K), ca.SX.sym("shares", K)
        total = ca.sum1(h)
        later = ca.horzcat(v[:, 1:], v[:, 0])
        self._rows: list[tuple[ca.SX, np.ndarray, np.ndarray]] = []
        self._add_links(h, v, later, lengths)
        self._add_forces(h, v, later, shares)
        way = ca.dot(h, (v[0, :] + later[0, :]).T) / 2
        stacked = [row for row, _, _ in self._rows]
        program = {
            "x": ca.vertcat(h, ca.vec(v), ca.vec(lengths)),
            "p": shares,
            "f": -way / total,
            "g": ca.vertcat(*stacked, total),
        }
        self._solver = ca.nlpsol("design", "ipopt", program, _OPTIONS)

    def _add(self, row: ca.SX, low: float | np.ndarray, high: float | np.ndarray) -> None:
        size, repeated = row.numel(), row.shape[1]
        least, most = (
            np.tile(np.broadcast_to(side, size // repeated), repeated) for side in (low, high)
        )
        self._rows.append((ca.vec(row), least, most))

    def _add_links(self, h: ca.SX, v: ca.SX, later: ca.SX, lengths: ca.SX) -> None:
        limits, n = self._limits, self._limits.links
        rate, next_rate = v[:-1, :] - v[1:, :], later[:-1, :] - later[1:, :]
        width = ca.repmat(h.T, n, 1)
        reach = width * ca.repmat(ca.DM(limits.acceleration), 1, self._arcs)
        end = ca.horzcat(lengths[:, 1:], lengths[:, 0])
        self._add(rate, -limits.contraction, limits.extension)
        self._add(next_rate - rate - reach, -np.inf, 0.0)
        self._add(rate - next_rate - reach, -np.inf, 0.0)
        self._add(lengths + width * (rate + next_rate) / 2 - end, 0.0, 0.0)
        # the middle Bernstein coefficient bounds a length within its arc
        self._add(lengths + width * rate / 2, limits.length[:, 0], limits.length[:, 1])

    def _add_forces(self, h: ca.SX, v: ca.SX, later: ca.SX, shares: ca.SX) -> None:
        limits = self._limits
        gained = ca.mtimes(ca.DM(limits.mass).T, later - v) + limits.static_load * h.T
        for at in (v, later) if limits.drag > 0 else (v,):
            given = gained + limits.drag * h.T * ca.sum1(at)
            self._add(given, 0.0, np.inf)
            if np.isfinite(limits.spike_load):
                self._add(given - limits.spike_load * (shares * h).T, -np.inf, 0.0)

    def solve(self, start: Start, rng: np.random.Generator) -> Motion | None:
        """Solve from random durations and velocities."""
        limits, K, n = self._limits, self._arcs, self._limits.links
        shortest, longest = (p / start.cycles for p in limits.period)
        rests = np.zeros((K, n + 1), bool)
        for k, masses in enumerate(start.word):
            rests[k * self._each : (k + 1) * self._each, list(masses)] = True
        fastest = np.where(rests | np.roll(rests, 1, axis=0), 0.0, limits.fastest).ravel()
        parts = np.repeat(rng.dirichlet(np.full(len(start.word), 3.0)), self._each)
        parts *= rng.uniform(0.5, 1.5, K)
        durations = parts / parts.sum() * rng.uniform(shortest, longest)
        least = np.full(K, _SHORTEST * longest)
        low, middle, high = (
            np.tile(f(limits.length, axis=1), K) for f in (np.min, np.mean, np.max)
        )
        answer = self._solver(
            x0=np.concatenate([durations, fastest * rng.uniform(0.0, 0.5, len(fastest)), middle]),
            p=rests.sum(axis=1),
            lbx=np.concatenate([least, 0.0 * fastest, low]),
            ubx=np.concatenate([np.full(K, longest), fastest, high]),
            lbg=np.concatenate([*(row[1] for row in self._rows), [shortest]]),
            ubg=np.concatenate([*(row[2] for row in self._rows), [longest]]),
        )
        x = np.array(answer["x"]).ravel()
        if not np.all(np.isfinite(x)):
            return None
        velocities = np.maximum(x[K : K * (n + 2)].reshape(K, n + 1), 0.0)
        return Motion(x[:K], velocities, x[K * (n + 2) : K * (n + 2) + n])
