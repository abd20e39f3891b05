"""Other ways to design a gait: a mixed-integer linear program, and IPOPT from many starts.

The former, solved by HiGHS, takes equal steps: velocities are linear within steps, a binary tells
of every mass and step whether it rests. Arrays hold at all times: rates, forces and accelerations
are extreme at nodes, and the length of a link within a step lies in the hull of its Bernstein
coefficients. The period must be given, so several are tried, whole parts of the longest among them;
those that do well on few steps are refined.

The latter takes arcs of free duration with velocities linear within them, over orders of resting
masses. Six a phase are enough for two links without drag in the benchmarks; with more links or drag
ten gain up to half a percent. One program serves all orders of so many phases: which masses rest
stands in its bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import highspy
import numpy as np
from scipy import sparse

from tests.benchmarks.design_cases import Arrays, Case, Course, Motion
from wormopt.numerics.linear_program import silent_highs

# -- HiGHS on equal steps ------------------------------------------------------------------------

_STEPS = (12, 24, 48, 96)
_MILP_ACCEPTED = 1e-6  # excess over limits that solvers leave
_HIGHS = {
    "threads": 1,
    "mip_rel_gap": 1e-5,
    "primal_feasibility_tolerance": 1e-9,
    "mip_feasibility_tolerance": 1e-9,
}

Tell = Callable[[Motion], None]


@dataclass(frozen=True)
class Grid:
    """Equal steps of a cycle."""

    steps: int
    period: float  # of the cycle


def by_milp(case: Case, seconds: float, tell: Tell | None = None) -> Course:
    """Design a gait on finer and finer grids until the time is over.

    `tell` is given every better motion. Returns (seconds, best speed) pairs; motions that
    exceed a limit by more than 1e-6 of its size do not count.
    """
    begin, limits = perf_counter(), Arrays.of(case)
    course: Course = []

    def known(motion: Motion) -> None:
        better = not course or motion.speed > course[-1][1]
        if better and motion.worst(limits) <= _MILP_ACCEPTED:
            course.append((perf_counter() - begin, motion.speed))
            if tell is not None:
                tell(motion)

    tries: list[tuple[float, Motion | None]] = [(period, None) for period in _periods(limits)]
    for level, steps in enumerate(_STEPS):
        solved: list[tuple[float, Motion]] = []
        for k, (period, start) in enumerate(tries):
            left = begin + seconds - perf_counter()
            if left <= 0:
                return course
            share = left / (len(tries) - k + _later(len(tries), level))
            best = solve_grid(limits, Grid(steps, period), share, known, start)
            if best is not None:
                solved.append((period, best))
        solved.sort(key=lambda entry: -entry[1].speed)
        tries = [*solved[: math.ceil(len(tries) / 2)]]
    return course


def _later(count: int, level: int) -> int:
    """How many programs the finer levels solve, the better half each time."""
    return sum(math.ceil(count / 2**k) for k in range(1, len(_STEPS) - level))


def _periods(limits: Arrays) -> list[float]:
    shortest, longest = limits.period
    if shortest == longest:
        return [longest / cycles for cycles in (1, 2, 3, 4)]
    return [p / cycles for cycles in (1, 2) for p in np.geomspace(longest, shortest, 3).tolist()]


def milp_bound(limits: Arrays, grid: Grid, seconds: float) -> float:
    """Upper bound on the speed of gaits on one grid."""
    solver = silent_highs()
    for option, value in {**_HIGHS, "time_limit": seconds}.items():
        solver.setOptionValue(option, value)
    solver.passModel(_program(limits, grid))
    solver.run()
    return float(solver.getInfo().mip_dual_bound)


def solve_grid(
    limits: Arrays, grid: Grid, seconds: float, known: Tell, start: Motion | None = None
) -> Motion | None:
    """Solve the program of one grid; return the best motion.

    `known` is given every better motion as it is found; `start` has half as many steps.
    """
    solver = silent_highs()
    for option, value in {**_HIGHS, "time_limit": seconds}.items():
        solver.setOptionValue(option, value)
    solver.passModel(_program(limits, grid))
    if start is not None:
        guess: Any = highspy.HighsSolution()
        guess.col_value = _halved(start)
        solver.setSolution(guess)
    best: list[Motion] = []

    def improved(event: Any) -> None:
        best.append(_motion(np.array(event.data_out.mip_solution), limits, grid))
        known(best[-1])

    solver.cbMipImprovingSolution.subscribe(improved)
    solver.run()
    return max(best, key=lambda motion: motion.speed, default=None)


def _program(limits: Arrays, grid: Grid) -> Any:
    """Columns of every step: velocities and lengths where it begins, and who rests in it."""
    N, n = grid.steps, limits.links
    rows = zip(*_limits_of_step(limits, grid.period / N), strict=True)
    here, there, low, high = (np.concatenate(part) for part in rows)
    following = np.roll(np.eye(N), 1, axis=1)
    here, there = (
        sparse.kron(sparse.coo_array(steps), part)
        for steps, part in ((np.eye(N), here), (following, there))
    )
    matrix = sparse.csr_array(here + there)
    program: Any = highspy.HighsLp()
    program.sense_ = highspy.ObjSense.kMaximize
    program.num_row_, program.num_col_ = N * len(low), N * (3 * n + 2)
    program.col_cost_ = np.tile(np.eye(1, 3 * n + 2)[0] / N, N)  # velocity of the head
    least, most = limits.length.T
    program.col_lower_ = np.tile(np.concatenate([np.zeros(n + 1), least, np.zeros(n + 1)]), N)
    program.col_upper_ = np.tile(np.concatenate([limits.fastest, most, np.ones(n + 1)]), N)
    program.row_lower_, program.row_upper_ = np.tile(low, N), np.tile(high, N)
    program.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    program.a_matrix_.start_, program.a_matrix_.index_ = matrix.indptr, matrix.indices
    program.a_matrix_.value_ = matrix.data
    real, whole = highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger
    program.integrality_ = ([real] * (2 * n + 1) + [whole] * (n + 1)) * N
    return program


def _limits_of_step(limits: Arrays, dt: float) -> Iterator[tuple[np.ndarray, ...]]:
    """Coefficients of a step's own columns and of the next step's, and both sides."""
    n, inf = limits.links, np.inf
    v, length, rests = np.split(np.eye(3 * n + 2), [n + 1, 2 * n + 1])
    rate, resting = v[:-1] - v[1:], rests.sum(axis=0)
    half, reach = dt / 2 * rate, limits.acceleration * dt

    def limit(here: np.ndarray, there: np.ndarray, low: Any, high: Any) -> tuple[np.ndarray, ...]:
        sides = (np.broadcast_to(side, len(here)) for side in (low, high))
        return here, there, *sides

    yield limit(rate, 0 * rate, -limits.contraction, limits.extension)
    yield limit(-rate, rate, -reach, reach)
    yield limit(-length - half, length - half, 0.0, 0.0)
    # the middle Bernstein coefficient
    yield limit(length + half, 0 * half, limits.length[:, 0], limits.length[:, 1])
    yield limit(resting[None, :], 0 * resting[None, :], limits.resting, inf)
    gained = limits.mass[None, :] @ v / dt
    for here, there in ((1, 0), (0, 1)):  # where the step begins, and where it ends
        still = limits.fastest[:, None] * rests
        yield limit(here * v + still, there * v, -inf, limits.fastest)
        slowed = limits.drag * v.sum(axis=0)
        force, later = here * slowed - gained, there * slowed + gained
        yield limit(force, later, -limits.static_load, inf)
        if np.isfinite(limits.spike_load):
            yield limit(force - limits.spike_load * resting, later, -inf, -limits.static_load)


def _motion(values: np.ndarray, limits: Arrays, grid: Grid) -> Motion:
    """Velocities that the solver leaves to masses at rest are none."""
    n = limits.links
    v, lengths, rest = np.split(values.reshape(grid.steps, -1), [n + 1, 2 * n + 1], axis=1)
    rests = rest > 0.5
    still = rests | np.roll(rests, 1, axis=0)
    velocities = np.where(still, 0.0, np.maximum(v, 0.0))
    return Motion(np.full(grid.steps, grid.period / grid.steps), velocities, lengths[0])


def _halved(motion: Motion) -> np.ndarray:
    """Columns of the same motion on twice as many steps."""
    v, h = motion.velocities, motion.durations[0] / 2
    velocities = np.stack([v, (v + np.roll(v, -1, axis=0)) / 2], axis=1).reshape(-1, v.shape[1])
    later = np.roll(velocities, -1, axis=0)
    changes = -np.diff(velocities + later) * h / 2
    lengths = motion.lengths + np.vstack([0 * motion.lengths, np.cumsum(changes, axis=0)[:-1]])
    rests = np.maximum(velocities, later) == 0.0
    return np.hstack([velocities, lengths, rests]).ravel()


# -- IPOPT from many starts ----------------------------------------------------------------------

_ACCEPTED = 1e-7  # excess over limits that the solver leaves
_SHORTEST = 1e-7  # duration of an arc, as a part of the longest cycle
_CYCLES = 6
_KEPT = 8  # starts worth another try near them
_IPOPT = {
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
    begin, limits, rng = perf_counter(), Arrays.of(case), np.random.default_rng(seed)
    programs: dict[int, _Program] = {}
    course: Course = []
    kept: dict[Start, float] = {}
    while perf_counter() - begin < seconds:
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
            course.append((perf_counter() - begin, speed))
            if tell is not None:
                tell(Found(speed, start, motion))
    return course


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
        self._solver = ca.nlpsol("design", "ipopt", program, _IPOPT)

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
