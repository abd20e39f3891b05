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
# Relative width at which the duration counts as found.
_FOUND = 1e-4


@dataclass(frozen=True, eq=False)
class Transition:
    """From the begin of stroke `leaves` of one gear to the begin of stroke `enters` of another."""

    leaves: int
    enters: int
    resting: tuple[int, ...]  # throughout
    strokes: tuple[Stroke, ...]  # none where both gears meet
    tried: int  # linear programs solved

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
) -> Transition:
    """Find the shortest transition from one gear into another.

    Limits hold at every load on each mass in the range `load`; at least `resting` masses rest.
    Raises SolveError if there is none.
    """
    tasks = sorted(_tasks(before, after, limits, load[1], resting), key=lambda task: task.bound)
    best: tuple[float, _Task, np.ndarray] | None = None
    tried = 0
    for task in tasks:
        if best is not None and task.bound >= best[0] * (1 - _FOUND):
            break
        if task.bound == 0.0:
            return Transition(task.leaves, task.enters, task.resting, (), tried)
        program = _Program(task, before.mass, before.drag, limits, load, arcs)
        high = task.bound if best is None else best[0] * (1 - _FOUND)
        found = program.solve(high)
        tried += 1
        while found is None and best is None and high < 64 * task.bound:
            high *= 4
            found = program.solve(high)
            tried += 1
        if found is None:
            continue
        low = task.bound
        while high - low > _FOUND * high:
            middle = (low + high) / 2
            better = program.solve(middle)
            tried += 1
            if better is None:
                low = middle
            else:
                high, found = middle, better
        best = high, task, found
    if best is None:
        raise SolveError(
            f"there is no transition from {before.name} to {after.name} within the limits",
            "give links more rate, acceleration or length, or leave one of the gears out",
        )
    duration, task, nodes = best
    return Transition(
        task.leaves, task.enters, task.resting, tuple(_strokes(task, nodes, duration)), tried
    )


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
    and the largest load of a spike, which is made small.
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
        self.task, self.mass, self.drag, self.limits = task, mass, drag, limits
        self.load, self.arcs = load, arcs
        moving = np.setdiff1d(np.arange(len(mass)), task.resting)
        self.inner = arcs - 1
        pick = csr_matrix(
            (np.ones(len(moving)), (moving, np.arange(len(moving)))), (len(mass), len(moving))
        )
        # nodes (n+1, arcs + 1), stacked node by node, are lift @ unknowns + ends
        place = csr_matrix(
            (np.ones(self.inner), (np.arange(1, arcs), np.arange(self.inner))),
            (arcs + 1, self.inner),
        )
        self.lift: Matrix = csr_matrix(kron(place, pick))
        ends = np.zeros((arcs + 1, len(mass)))
        ends[0], ends[-1] = task.first, task.last
        self.ends = ends.ravel()

    def solve(self, duration: float) -> np.ndarray | None:
        """Velocities (arcs + 1, n+1) at all nodes; None if there are none of this duration."""
        rows, sides = zip(*self._rows(duration), strict=True)
        whole: Matrix = csr_matrix(vstack(rows))
        peak, peaks = self._peaks(duration)
        way, goals = self._ways(duration)
        free = csr_matrix((whole.shape[0] + way.shape[0], 1))  # the peak stands in none of these
        limits = hstack([whole @ self.lift, free[: whole.shape[0]]])
        loads = hstack([peak @ self.lift, csr_matrix(-np.ones((len(peaks), 1)))])
        found = linprog(
            np.append(np.zeros(self.lift.shape[1]), 1.0),
            A_ub=vstack([limits, loads]),
            b_ub=np.concatenate([*sides, peaks]) - vstack([whole, peak]) @ self.ends,
            A_eq=hstack([way @ self.lift, free[whole.shape[0] :]]),
            b_eq=goals - way @ self.ends,
            bounds=[*[(0.0, None)] * self.lift.shape[1], (None, self.limits.spike)],
            method="highs-ds",
        )
        if not found.success:
            return None
        nodes = self.lift @ found.x[:-1] + self.ends
        return nodes.reshape(self.arcs + 1, -1)

    def _ways(self, duration: float) -> tuple[Matrix, np.ndarray]:
        """Ways of the masses that move, by the rule of trapezoids, which is exact here."""
        weights = np.full(self.arcs + 1, duration / self.arcs)
        weights[[0, -1]] /= 2
        moving = np.setdiff1d(np.arange(len(self.mass)), self.task.resting)
        pick = csr_matrix(np.eye(len(self.mass))[moving])
        return csr_matrix(kron(weights[None], pick)), self.task.way[moving]

    def _rows(self, duration: float) -> Iterator[tuple[Matrix, np.ndarray]]:
        """Limits as rows @ nodes <= side."""
        masses, arcs, limits = len(self.mass), self.arcs, self.limits
        step, links = duration / arcs, masses - 1
        link = csr_matrix(eye_array(links, masses) - eye_array(links, masses, k=1))
        change = csr_matrix(eye_array(arcs, arcs + 1, k=1) - eye_array(arcs, arcs + 1))
        rate: Matrix = csr_matrix(kron(eye_array(arcs + 1), link))
        bend: Matrix = csr_matrix(kron(change / step, link))
        for rows, most in ((rate, limits.rate), (bend, limits.acceleration)):
            yield rows, np.full(rows.shape[0], most)
            yield -rows, np.full(rows.shape[0], most)
        # lengths are quadratics on an arc: within their Bernstein coefficients
        below = np.tril(np.ones((arcs, arcs)), -1)
        grown = step / 2 * (below @ (np.eye(arcs, arcs + 1) + np.eye(arcs, arcs + 1, k=1)))
        middle = grown + step / 2 * np.eye(arcs, arcs + 1)
        for part in (grown[1:], middle):
            rows = csr_matrix(kron(part, link))
            start = np.tile(self.task.length, len(part))
            yield rows, limits.length[1] - start
            yield -rows, start - limits.length[0]
        yield from self._forces(step)

    def _forces(self, step: float) -> Iterator[tuple[Matrix, np.ndarray]]:
        """The worm does not glide at the least load; actuators bear the largest and the least."""
        low, high = self.load
        for end in (0, 1):
            need = self._need(step, end)
            total = csr_matrix(kron(eye_array(self.arcs), np.ones((1, len(self.mass))))) @ need
            yield -total, np.full(self.arcs, len(self.mass) * low)
            if not np.isfinite(self.limits.actuator):
                continue
            share = np.zeros(len(self.mass))
            share[list(self.task.resting)] = 1 / len(self.task.resting)
            # mu_j is what spikes ahead of the link carry, less what masses there need
            split = np.cumsum(share[:, None] - np.eye(len(self.mass)), axis=0)[:-1]
            force = csr_matrix(kron(eye_array(self.arcs), split)) @ need
            for load in (low, high):
                known = np.tile(split.sum(axis=1) * load, self.arcs)
                yield force, self.limits.actuator - known
                yield -force, self.limits.actuator + known

    def _need(self, step: float, end: int) -> Matrix:
        """Inertia and drag of every mass at one end of every arc, (arcs (n+1), nodes)."""
        change = csr_matrix(
            eye_array(self.arcs, self.arcs + 1, k=1) - eye_array(self.arcs, self.arcs + 1)
        )
        inertia = kron(change / step, np.diag(self.mass))
        drag = kron(eye_array(self.arcs, self.arcs + 1, k=end), self.drag * np.eye(len(self.mass)))
        return csr_matrix(inertia + drag)

    def _peaks(self, duration: float) -> tuple[Matrix, np.ndarray]:
        """Loads of a spike at both ends of every arc, at the largest load."""
        sum_ = csr_matrix(kron(eye_array(self.arcs), np.ones((1, len(self.mass)))))
        count = len(self.task.resting)
        rows = [sum_ @ self._need(duration / self.arcs, end) / count for end in (0, 1)]
        known = np.full(2 * self.arcs, -len(self.mass) * self.load[1] / count)
        return csr_matrix(vstack(rows)), known


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
