"""The shortest way from one gear into another, by which masses at rest stay at rest.

A worm leaves gear A at a phase and enters gear B at another. Lengths and rates at both ends are
given, and with them how far each mass has to go beside the others: those that go least rest
throughout, on spikes that held them before and hold them after. Velocities of the others are
piecewise linear, so that all limits are linear in them while the duration is held; the least
duration of which there is a solution is found by bisection, for the phases in the order of a bound
from below.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, eye_array, hstack, kron, vstack

from wormopt.errors import SolveError
from wormopt.systems.gears.gear import Gear, Limits
from wormopt.systems.gears.stroke import Stroke

Matrix = Any  # a sparse one, of which the stubs know too little

# Masses whose ways or velocities differ by less, in units of the links' own, go alike.
_ALIKE = 1e-9
# Relative width at which the duration counts as found; factor from one that is tried to the next,
# and longest that is tried, by the bound.
_FOUND, _STEP, _LONGEST = 1e-4, 1.3, 40.0


@dataclass(frozen=True, eq=False)
class Transition:
    """From the begin of stroke `leaves` of one gear to the begin of stroke `enters` of another."""

    leaves: int
    enters: int
    resting: tuple[int, ...]  # throughout
    strokes: tuple[Stroke, ...]  # none where both gears meet
    complete: bool  # whether no pair of phases was left out

    @property
    def duration(self) -> float:
        """How long it lasts."""
        return float(sum(stroke.duration for stroke in self.strokes))


@dataclass(frozen=True, eq=False)
class _Task:
    """A pair of phases: what lengths and velocities are at its ends."""

    leaves: int
    enters: int
    resting: tuple[int, ...]
    way: np.ndarray  # (n+1,) of each mass
    first: np.ndarray  # (n+1,) velocities at the begin
    last: np.ndarray  # (n+1,) and at the end
    length: np.ndarray  # (n,) at the begin
    bound: float  # no transition is shorter


def shortest_transition(
    before: Gear,
    after: Gear,
    limits: Limits,
    load: tuple[float, float],
    *,
    resting: int = 1,
    arcs: int = 12,
    most: int = 400,
) -> Transition:
    """Find the shortest transition from one gear into another.

    Limits hold at every load on each mass in the range `load`; at least `resting` masses rest.
    After `most` linear programs no further pair of phases is looked at. Raises SolveError if there
    is none.
    """
    tasks = sorted(_tasks(before, after, limits, load[1], resting), key=lambda task: task.bound)
    best: tuple[float, _Task, np.ndarray] | None = None
    tried = 0
    for task in tasks:
        if task.bound == 0.0:
            return Transition(task.leaves, task.enters, task.resting, (), complete=True)
        longest = _LONGEST * task.bound if best is None else best[0] * (1 - _FOUND)
        if task.bound >= longest or tried >= most:
            break
        program = _Program(task, before.mass, before.drag, limits, load, arcs)
        duration, nodes, looks = _least_duration(program, task.bound, longest)
        tried += looks
        if nodes is not None:
            best = duration, task, nodes
    if best is None:
        raise SolveError(
            f"there is no transition from {before.name} to {after.name} within the limits",
            "give links more rate, acceleration or length, or leave one of the gears out",
        )
    duration, task, nodes = best
    strokes = tuple(_strokes(task, nodes, duration))
    return Transition(task.leaves, task.enters, task.resting, strokes, complete=tried < most)


def _least_duration(
    program: _Program, bound: float, longest: float
) -> tuple[float, np.ndarray | None, int]:
    """Least duration of which there is a solution, that solution, and how many programs it took.

    Longer is not always possible: a mass that moves at an end may have no room to slow down. So
    durations are tried in steps, until one does, and the step halved.
    """
    low, high, looks = bound, bound, 0
    found = None
    while found is None and low < longest:
        low, high = high, min(max(_STEP * high, bound * (1 + _FOUND)), longest)
        found, looks = program.solve(high), looks + 1
        if high >= longest:
            break
    while found is not None and high - low > _FOUND * high:
        middle = (low + high) / 2
        better, looks = program.solve(middle), looks + 1
        low, high, found = (low, middle, better) if better is not None else (middle, high, found)
    return high, found, looks


def _tasks(before: Gear, after: Gear, limits: Limits, load: float, least: int) -> Iterator[_Task]:
    """Pairs of phases by which enough masses can rest throughout."""
    begins = [np.array([gear.strokes[k].velocity[:, 0] for k in range(len(gear.strokes))])
              for gear in (before, after)]  # fmt: skip
    stroke = limits.length[1] - limits.length[0]
    spans = [np.pad(np.cumsum(gear.lengths, axis=1), ((0, 0), (1, 0))) for gear in (before, after)]
    for a, (here, first) in enumerate(zip(spans[0], begins[0], strict=True)):
        for b, (there, last) in enumerate(zip(spans[1], begins[1], strict=True)):
            way = np.max(there - here) - (there - here)
            way[way < _ALIKE * stroke] = 0.0
            still = _ALIKE * limits.rate
            rests = (way == 0) & (np.abs(first) <= still) & (np.abs(last) <= still)
            # where momentum does not fall, spikes carry the load on all masses in the mean
            heavy = (
                len(way) * load > limits.spike * rests.sum() and before.mass @ (last - first) >= 0
            )
            if rests.sum() < least or heavy:
                continue
            resting = tuple(np.flatnonzero(rests).tolist())
            bound = _bound(way, first, last, limits)
            yield _Task(a, b, resting, way, first, last, before.lengths[a], bound)


def _bound(way: np.ndarray, first: np.ndarray, last: np.ndarray, limits: Limits) -> float:
    """Least time in which each link could make its change, did it not heed the others."""
    change, r0, r1 = -np.diff(way), -np.diff(first), -np.diff(last)
    most = limits.acceleration
    surplus = change - (r0 + r1) * np.abs(r1 - r0) / (2 * most)
    sign = np.sign(
        np.where(np.abs(surplus) < _ALIKE * (limits.length[1] - limits.length[0]), 0, surplus)
    )
    top = sign * np.sqrt(np.maximum(sign * most * change + (r0**2 + r1**2) / 2, 0.0))
    quick = np.where(sign == 0, np.abs(r1 - r0) / most, sign * (2 * top - r0 - r1) / most)
    bound = max(float(np.max(quick)), float(np.max(np.abs(change))) / limits.rate)
    return bound if bound > _ALIKE * np.sqrt(1 / most) else 0.0


class _Program:
    """The linear program of a pair of phases, once its duration is given.

    Unknowns are velocities of the masses that move at the inner nodes of arcs of equal length,
    and the largest load of a spike, which is made small. Rows are A / step + B + C step.
    """

    def __init__(
        self,
        task: _Task,
        mass: np.ndarray,
        drag: float,
        limits: Limits,
        load: tuple[float, float],
        arcs: int,
    ) -> None:
        self.arcs, self.limits = arcs, limits
        masses, moving = len(mass), np.setdiff1d(np.arange(len(mass)), task.resting)
        # velocities at all nodes, stacked node by node, are lift @ unknowns + ends
        inner = eye_array(arcs + 1, arcs - 1, k=-1)
        self.lift: Matrix = csr_matrix(kron(inner, csr_matrix(np.eye(masses)[:, moving])))
        ends = np.zeros((arcs + 1, masses))
        ends[0], ends[-1] = task.first, task.last
        self.ends = ends.ravel()
        blocks = [
            *_link_rows(task, limits, arcs),
            *_force_rows(task, mass, drag, limits, load, arcs),
        ]
        peaks = _peak_rows(task, mass, drag, load, arcs)
        self.side = np.concatenate([*(side for *_, side in blocks), *(side for *_, side in peaks)])
        matrices = [*zip(*blocks, *peaks, strict=True)][:3]
        self.parts = [(m @ self.lift, m @ self.ends) for m in map(_stacked, matrices)]
        # every row of `peaks` is to be below the last unknown
        counted = [len(side) for *_, side in (*blocks, *peaks)]
        last = np.repeat([0.0] * len(blocks) + [-1.0] * len(peaks), counted)
        self.last = csr_matrix(last[:, None])
        weights = np.ones(arcs + 1)
        weights[[0, -1]] = 0.5  # the rule of trapezoids, which is exact here
        ways: Matrix = csr_matrix(kron(weights[None], csr_matrix(np.eye(masses)[moving])))
        self.ways, self.goals = (ways @ self.lift, ways @ self.ends), task.way[moving]

    def solve(self, duration: float) -> np.ndarray | None:
        """Velocities (arcs + 1, n+1) at all nodes; None if there are none of this duration."""
        step = duration / self.arcs
        (a, at), (b, bt), (c, ct) = self.parts
        count = self.lift.shape[1]
        found = linprog(
            np.append(np.zeros(count), 1.0),
            A_ub=hstack([a / step + b + c * step, self.last]),
            b_ub=self.side - (at / step + bt + ct * step),
            A_eq=hstack([step * self.ways[0], csr_matrix((len(self.goals), 1))]),
            b_eq=self.goals - step * self.ways[1],
            bounds=[*[(0.0, None)] * count, (None, self.limits.spike)],
            method="highs-ds",
        )
        if not found.success:
            return None
        return (self.lift @ found.x[:-1] + self.ends).reshape(self.arcs + 1, -1)


Block = tuple[Matrix, Matrix, Matrix, np.ndarray]
"""Rows A / step + B + C step and the side that they stay below."""


def _link_rows(task: _Task, limits: Limits, arcs: int) -> Iterator[Block]:
    """Rates, accelerations and lengths of the links."""
    links = len(task.length)
    link = eye_array(links, links + 1) - eye_array(links, links + 1, k=1)
    rate: Matrix = csr_matrix(kron(eye_array(arcs + 1), link))
    bend: Matrix = csr_matrix(kron(_change(arcs), link))
    for sign in (1.0, -1.0):
        none = csr_matrix(rate.shape)
        yield none, sign * rate, none, np.full(rate.shape[0], limits.rate)
        none = csr_matrix(bend.shape)
        yield sign * bend, none, none, np.full(bend.shape[0], limits.acceleration)
    # lengths are quadratics on an arc: within their Bernstein coefficients
    below = np.tril(np.ones((arcs, arcs)), -1)
    grown = below @ (np.eye(arcs, arcs + 1) + np.eye(arcs, arcs + 1, k=1)) / 2
    for part in (grown[1:], grown + np.eye(arcs, arcs + 1) / 2):
        rows: Matrix = csr_matrix(kron(part, link))
        start, none = np.tile(task.length, len(part)), csr_matrix(rows.shape)
        yield none, none, rows, limits.length[1] - start
        yield none, none, -rows, start - limits.length[0]


def _force_rows(
    task: _Task,
    mass: np.ndarray,
    drag: float,
    limits: Limits,
    load: tuple[float, float],
    arcs: int,
) -> Iterator[Block]:
    """The worm does not glide at the least load; actuators bear the largest and the least."""
    share = np.zeros(len(mass))
    share[list(task.resting)] = 1 / len(task.resting)
    # mu_j is what spikes ahead of the link carry, less what masses there need
    split = np.cumsum(share[:, None] - np.eye(len(mass)), axis=0)[:-1]
    every, each = kron(eye_array(arcs), np.ones((1, len(mass)))), kron(eye_array(arcs), split)
    for inertia, slowing in _needs(mass, drag, arcs):
        rows = -(every @ inertia), -(every @ slowing)
        yield *rows, csr_matrix(rows[0].shape), np.full(arcs, len(mass) * load[0])
        if not np.isfinite(limits.actuator):
            continue
        rows = each @ inertia, each @ slowing
        none = csr_matrix(rows[0].shape)
        for known in (np.tile(split.sum(axis=1) * given, arcs) for given in load):
            yield *rows, none, limits.actuator - known
            yield -rows[0], -rows[1], none, limits.actuator + known


def _peak_rows(
    task: _Task, mass: np.ndarray, drag: float, load: tuple[float, float], arcs: int
) -> list[Block]:
    """Loads of a spike at both ends of every arc, at the largest load."""
    count = len(task.resting)
    every = kron(eye_array(arcs), np.ones((1, len(mass)))) / count
    known = np.full(arcs, -len(mass) * load[1] / count)
    return [
        (every @ inertia, every @ slowing, csr_matrix((arcs, inertia.shape[1])), known)
        for inertia, slowing in _needs(mass, drag, arcs)
    ]


def _needs(mass: np.ndarray, drag: float, arcs: int) -> Iterator[tuple[Matrix, Matrix]]:
    """Inertia (by the step) and drag of every mass at the begin and at the end of every arc."""
    for end in (0, 1):
        slowing = kron(eye_array(arcs, arcs + 1, k=end), drag * eye_array(len(mass)))
        yield csr_matrix(kron(_change(arcs), np.diag(mass))), csr_matrix(slowing)


def _stacked(parts: Any) -> Matrix:
    return csr_matrix(vstack(parts))


def _change(arcs: int) -> Matrix:
    return eye_array(arcs, arcs + 1, k=1) - eye_array(arcs, arcs + 1)


def _strokes(task: _Task, nodes: np.ndarray, duration: float) -> Iterator[Stroke]:
    """Arcs of a solution, those that go on alike in one."""
    step = duration / (len(nodes) - 1)
    nodes = nodes.copy()
    nodes[:, list(task.resting)] = 0.0
    slopes = np.diff(nodes, axis=0) / step
    size = float(np.abs(slopes).max()) or 1.0
    begins = [0, *(1 + np.flatnonzero(np.abs(np.diff(slopes, axis=0)).max(axis=1) > 1e-9 * size))]
    for begin, end in zip(begins, [*begins[1:], len(slopes)], strict=True):
        yield Stroke(
            (end - begin) * step,
            np.stack([nodes[begin], (nodes[end] - nodes[begin]) / ((end - begin) * step)], axis=1),
            task.resting,
        )
