"""Gait design as a mixed-integer linear program on equal steps, solved by HiGHS.

Velocities are linear within steps, a binary tells of every mass and step whether it rests. Arrays
hold at all times: rates, forces and accelerations are extreme at nodes, and the length of a link
within a step lies in the hull of its Bernstein coefficients. The period must be given, so several
are tried, whole parts of the longest among them; those that do well on few steps are refined.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import highspy
import numpy as np
from scipy import sparse

from wormopt.bench.design_cases import Arrays, Case
from wormopt.bench.design_motion import Course, Motion

_STEPS = (12, 24, 48, 96)
_ACCEPTED = 1e-6  # excess over limits that solvers leave
_OPTIONS = {
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
    begin, limits = time.perf_counter(), Arrays.of(case)
    course: Course = []

    def known(motion: Motion) -> None:
        better = not course or motion.speed > course[-1][1]
        if better and motion.worst(limits) <= _ACCEPTED:
            course.append((time.perf_counter() - begin, motion.speed))
            if tell is not None:
                tell(motion)

    tries: list[tuple[float, Motion | None]] = [(period, None) for period in _periods(limits)]
    for level, steps in enumerate(_STEPS):
        solved: list[tuple[float, Motion]] = []
        for k, (period, start) in enumerate(tries):
            left = begin + seconds - time.perf_counter()
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


def solve_grid(
    limits: Arrays, grid: Grid, seconds: float, known: Tell, start: Motion | None = None
) -> Motion | None:
    """Solve the program of one grid; return the best motion.

    `known` is given every better motion as it is found; `start` has half as many steps.
    """
    solver: Any = highspy.Highs()  # its stubs lack half of its methods
    solver.silent()
    for option, value in {**_OPTIONS, "time_limit": seconds}.items():
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
    """Columns: velocities at all nodes, lengths there, and who rests in each step."""
    N, n, masses = grid.steps, limits.links, limits.links + 1
    matrix, low, high = _rows(limits, grid)
    program: Any = highspy.HighsLp()
    program.sense_ = highspy.ObjSense.kMaximize
    program.num_row_, program.num_col_ = len(low), N * (3 * n + 2)
    head = np.zeros(masses)
    head[0] = 1 / N
    program.col_cost_ = np.concatenate([np.tile(head, N), np.zeros(N * (n + masses))])
    zero, one = np.zeros(N * masses), np.ones(N * masses)
    program.col_lower_ = np.concatenate([zero, np.tile(limits.length[:, 0], N), zero])
    fastest = np.tile(limits.fastest, N)
    program.col_upper_ = np.concatenate([fastest, np.tile(limits.length[:, 1], N), one])
    program.row_lower_, program.row_upper_ = low, high
    program.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    program.a_matrix_.start_, program.a_matrix_.index_ = matrix.indptr, matrix.indices
    program.a_matrix_.value_ = matrix.data
    kinds = [highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger]
    program.integrality_ = [kinds[0]] * (N * (masses + n)) + [kinds[1]] * (N * masses)
    return program


def _rows(limits: Arrays, grid: Grid) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Stack all limits, each of which is repeated in every step."""
    N, n = grid.steps, limits.links
    widths = (N * (n + 1), N * n, N * (n + 1))
    matrix: list[Any] = []
    sides: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for limit in _limits_of_steps(limits, grid):
        rows = next(part.shape[0] for part in limit.parts if part is not None)
        row = [
            sparse.csr_matrix((rows, width)) if part is None else part
            for part, width in zip(limit.parts, widths, strict=True)
        ]
        matrix.append(sparse.hstack(row))
        for known, side in zip(sides, (limit.low, limit.high), strict=True):
            known.append(np.tile(np.broadcast_to(side, rows // N), N))
    low, high = map(np.concatenate, sides)
    return sparse.csr_matrix(sparse.vstack(matrix)), low, high


class _Limit(NamedTuple):
    """Coefficients of velocities, lengths and rests, None where they are zero, and both sides."""

    parts: tuple[Any, Any, Any]
    low: float | np.ndarray
    high: float | np.ndarray


def _limits_of_steps(limits: Arrays, grid: Grid) -> Iterator[_Limit]:
    N, n, dt, inf = grid.steps, limits.links, grid.period / grid.steps, np.inf
    here = np.eye(N)
    there = np.roll(here, 1, axis=1)  # at the next node
    every, total = sparse.kron(here, np.eye(n)), np.ones((1, n + 1))
    rates = np.eye(n, n + 1) - np.eye(n, n + 1, 1)
    rate, change = sparse.kron(here, rates), sparse.kron(there - here, rates)
    reach, fastest = limits.acceleration * dt, limits.fastest
    yield _Limit((rate, None, None), -limits.contraction, limits.extension)
    yield _Limit((change, None, None), -reach, reach)
    grown = sparse.kron(there + here, -dt / 2 * rates)
    yield _Limit((grown, sparse.kron(there - here, np.eye(n)), None), 0.0, 0.0)
    # the middle Bernstein coefficient
    yield _Limit((dt / 2 * rate, every, None), limits.length[:, 0], limits.length[:, 1])
    yield _Limit((None, None, sparse.kron(here, total)), float(limits.resting), inf)
    for at in (here, there):
        still = sparse.kron(here, np.diag(fastest))
        yield _Limit((sparse.kron(at, np.eye(n + 1)), None, still), -inf, fastest)
        force = sparse.kron(there - here, limits.mass[None, :] / dt)
        force += sparse.kron(at, limits.drag * total)
        yield _Limit((force, None, None), -limits.static_load, inf)
        if np.isfinite(limits.spike_load):
            shared = sparse.kron(here, -limits.spike_load * total)
            yield _Limit((force, None, shared), -inf, -limits.static_load)


def _motion(values: np.ndarray, limits: Arrays, grid: Grid) -> Motion:
    """Velocities that the solver leaves to masses at rest are none."""
    N, masses = grid.steps, limits.links + 1
    velocities = np.maximum(values[: N * masses].reshape(N, masses), 0.0)
    rests = values[-N * masses :].reshape(N, masses) > 0.5
    velocities[rests | np.roll(rests, 1, axis=0)] = 0.0
    lengths = values[N * masses : N * masses + limits.links]
    return Motion(np.full(N, grid.period / N), velocities, lengths)


def _halved(motion: Motion) -> np.ndarray:
    """Columns of the same motion on twice as many steps."""
    v, h = motion.velocities, motion.durations[0] / 2
    velocities = np.stack([v, (v + np.roll(v, -1, axis=0)) / 2], axis=1).reshape(-1, v.shape[1])
    later = np.roll(velocities, -1, axis=0)
    changes = -np.diff(velocities + later) * h / 2
    lengths = motion.lengths + np.vstack([0 * motion.lengths, np.cumsum(changes, axis=0)[:-1]])
    rests = np.maximum(velocities, later) == 0.0
    return np.concatenate([velocities.ravel(), lengths.ravel(), rests.ravel().astype(float)])
