"""A gear box: gears from slow to fast, transitions between neighbours, all strokes in a table.

In the shortest transition from one gear to another resting masses stay at rest. A worm leaves gear
A at one phase and enters gear B at another. Lengths and rates at both ends are given, and so are
the displacements of the masses relative to each other. The masses with the smallest displacement
rest throughout, on spikes that hold them before and after. Velocities of the others are piecewise
linear, so all limits are linear in them at a fixed duration. Bisection finds the smallest feasible
duration, for pairs of phases in the order of a lower bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog
from scipy.sparse import coo_array, csr_array, eye_array, hstack, vstack

from wormopt.errors import ArgumentError, SolveError
from wormopt.systems.gears.gear import Gear, Limits, Stroke

Matrix = Any  # a sparse matrix; the type stubs are incomplete

# Smaller differences of displacements or velocities, in units of the links' own, are ignored.
_ALIKE = 1e-9
# Relative accuracy of the duration; factor between durations that are tried, and the longest one
# relative to the bound.
_FOUND, _STEP, _LONGEST = 1e-4, 1.3, 40.0


@dataclass(frozen=True, eq=False)
class Transition:
    """Strokes from the start of stroke `leaves` of one gear to that of `enters` of another."""

    leaves: int
    enters: int
    resting: tuple[int, ...]  # throughout
    strokes: tuple[Stroke, ...]  # empty if both gears meet
    complete: bool  # whether all pairs of phases were tried

    @property
    def duration(self) -> float:
        """Duration of the transition."""
        return float(sum(stroke.duration for stroke in self.strokes))


@dataclass(frozen=True, eq=False)
class _Task:
    """A pair of phases with the lengths and velocities at its ends."""

    leaves: int
    enters: int
    resting: tuple[int, ...]
    way: np.ndarray  # (n+1,) displacement of each mass
    first: np.ndarray  # (n+1,) velocities at the start
    last: np.ndarray  # (n+1,) velocities at the end
    length: np.ndarray  # (n,) at the start
    bound: float  # lower bound on the duration

    @property
    def still(self) -> bool:
        """Whether all masses rest at both ends: then longer durations are feasible if one is."""
        return not (np.any(self.first) or np.any(self.last))


def shortest_transition(
    before: Gear,
    after: Gear,
    limits: Limits,
    load: tuple[float, float],
    *,
    resting: int = 1,
    arcs: int = 12,
    most: int = 150,
) -> Transition:
    """Find the shortest transition from one gear to another.

    Limits hold at every load on each mass in the range `load`; at least `resting` masses rest. No
    further pair of phases is tried after `most` linear programs.
    """
    tasks = sorted(_tasks(before, after, limits, load[1], resting), key=_hopeless)
    programs = _Programs(before.mass, before.drag, limits, load, arcs)
    best: tuple[float, _Task, np.ndarray] | None = None
    tried = 0
    for task in tasks:
        if task.bound == 0.0:
            return Transition(task.leaves, task.enters, task.resting, (), complete=True)
        # where forces limit the motion, the bound by the links alone may be far too short
        longest = max(_LONGEST * task.bound, before.period, after.period)
        if best is not None:
            longest = best[0] * (1 - _FOUND)
        if task.bound >= longest or tried >= most:
            break
        solve = partial(programs.solve, task)
        duration, nodes, looks = _least_duration(solve, task.bound, longest, task.still)
        tried += looks
        if nodes is not None:
            best = duration, task, nodes
    if best is None:
        where = "" if tried < most else ", among the pairs of phases that were tried,"
        raise SolveError(
            f"there is no transition from {before.name} to {after.name}{where} within the limits",
            "increase limits.rate, limits.acceleration or the range limits.length, or remove one "
            "of the gears",
        )
    duration, task, nodes = best
    strokes = tuple(_strokes(task, nodes, duration))
    return Transition(task.leaves, task.enters, task.resting, strokes, complete=tried < most)


def _hopeless(task: _Task) -> tuple[float, int]:
    """Order of trials: by the bound, then by the number of resting masses."""
    return round(task.bound, 9), -len(task.resting)


def _least_duration(
    solve: Callable[[float], np.ndarray | None], bound: float, longest: float, still: bool
) -> tuple[float, np.ndarray | None, int]:
    """Smallest feasible duration, its solution, and the number of programs solved."""
    # Longer is not always feasible: a mass that moves at an end may have no room to slow down. So
    # durations are increased step by step until one is feasible, and the step is then bisected. If
    # all masses are `still` at both ends, the longest duration decides whether any is feasible.
    low, high, looks = bound, bound, 0
    found = None
    if still:
        looks = 1
        if solve(longest) is None:
            return longest, None, looks
    while found is None and low < longest:
        low, high = high, min(max(_STEP * high, bound * (1 + _FOUND)), longest)
        found, looks = solve(high), looks + 1
        if high >= longest:
            break
    while found is not None and high - low > _FOUND * high:
        middle = (low + high) / 2
        better, looks = solve(middle), looks + 1
        low, high, found = (low, middle, better) if better is not None else (middle, high, found)
    return high, found, looks


def _tasks(before: Gear, after: Gear, limits: Limits, load: float, least: int) -> Iterator[_Task]:
    """Pairs of phases with enough masses at rest throughout."""
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
            # if momentum does not decrease, spikes carry the load on all masses on average
            heavy = (
                len(way) * load > limits.spike * rests.sum() and before.mass @ (last - first) >= 0
            )
            if rests.sum() < least or heavy:
                continue
            resting = tuple(np.flatnonzero(rests).tolist())
            bound = _bound(way, first, last, limits)
            yield _Task(a, b, resting, way, first, last, before.lengths[a], bound)


def _bound(way: np.ndarray, first: np.ndarray, last: np.ndarray, limits: Limits) -> float:
    """Smallest time in which each link alone could make its change."""
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


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows bounded by a side: coefficients of velocities by the step, plain, and times the step.

    There are few coefficients of the initial link lengths and of the largest spike load.
    """

    by_step: Matrix
    plain: Matrix
    times_step: Matrix
    side: np.ndarray
    length: Matrix | None = None
    peak: float = 0.0

    def wide(self, links: int) -> tuple[Matrix, Matrix, Matrix, np.ndarray]:
        """Extend the rows to all unknowns: lengths, velocities, peak."""
        count = len(self.side)
        length = self.length if self.length is not None else csr_array((count, links))
        peak, none = csr_array(np.full((count, 1), self.peak)), csr_array((count, 1))
        still = csr_array((count, links))
        return (
            hstack([still, self.by_step, none]),
            hstack([length, self.plain, peak]),
            hstack([still, self.times_step, none]),
            self.side,
        )


@dataclass(frozen=True, eq=False)
class _Programs:
    """Linear programs of pairs of phases at a given duration.

    Unknowns are the initial link lengths, the velocities of all masses at the nodes of equal arcs,
    node by node, and the largest spike load, which is minimised. The conditions of a pair of
    phases are bounds on the unknowns, so the rows are assembled once for all pairs with the same
    resting masses.
    """

    mass: np.ndarray
    drag: float
    limits: Limits
    load: tuple[float, float]
    arcs: int
    _known: dict[tuple[int, ...], tuple[Matrix, Matrix, Matrix, np.ndarray]] = field(
        default_factory=dict
    )

    def solve(self, task: _Task, duration: float) -> np.ndarray | None:
        """Velocities (arcs + 1, n+1) at all nodes; None if this duration is infeasible."""
        step, masses = duration / self.arcs, len(self.mass)
        by_step, plain, times_step, side = self._rows(task.resting)
        weights = np.ones((1, self.arcs + 1))
        weights[0, [0, -1]] = 0.5  # the trapezoidal rule, which is exact here
        ways, width = _kron(weights, eye_array(masses)), plain.shape[1]
        found = linprog(
            np.eye(width)[-1],
            A_ub=by_step / step + plain + times_step * step,
            b_ub=side,
            A_eq=hstack([csr_array((masses, masses - 1)), ways, csr_array((masses, 1))]),
            b_eq=task.way / step,
            bounds=self._bounds(task),
            method="highs-ds",
        )
        if not found.success:
            return None
        return found.x[masses - 1 : -1].reshape(self.arcs + 1, masses)

    def _bounds(self, task: _Task) -> np.ndarray:
        velocity = np.zeros((2, self.arcs + 1, len(self.mass)))
        velocity[1] = np.inf
        velocity[1, :, list(task.resting)] = 0.0
        velocity[:, 0], velocity[:, -1] = task.first, task.last
        peak = np.array([[-np.inf], [self.limits.spike]])
        length = np.tile(task.length, (2, 1))
        return np.hstack([length, velocity.reshape(2, -1), peak]).T

    def _rows(self, resting: tuple[int, ...]) -> tuple[Matrix, Matrix, Matrix, np.ndarray]:
        """Rows of all unknowns, stored for the next pair of phases."""
        if resting not in self._known:
            links = len(self.mass) - 1
            blocks = [*_link_rows(links, self.limits, self.arcs), *self._force_rows(resting)]
            *parts, sides = zip(*(block.wide(links) for block in blocks), strict=True)
            stacked = [csr_array(vstack(part)) for part in parts]
            self._known[resting] = (stacked[0], stacked[1], stacked[2], np.concatenate(sides))
        return self._known[resting]

    def _force_rows(self, resting: tuple[int, ...]) -> Iterator[_Rows]:
        """Rows: no gliding at the smallest load, limits of spikes and actuators at the largest."""
        masses, arcs = len(self.mass), self.arcs
        share = np.zeros(masses)
        share[list(resting)] = 1 / len(resting)
        # mu_j is the load of spikes ahead of the link minus the needs of the masses there
        split = np.cumsum(share[:, None] - np.eye(masses), axis=0)[:-1]
        every, each = _kron(eye_array(arcs), np.ones((1, masses))), _kron(eye_array(arcs), split)
        none = csr_array((arcs, (arcs + 1) * masses))
        nothing = csr_array((arcs * (masses - 1), (arcs + 1) * masses))
        least, most = (np.full(arcs, masses * load) for load in self.load)
        for inertia, slowing in _needs(self.mass, self.drag, arcs):
            total = every @ inertia, every @ slowing
            yield _Rows(-total[0], -total[1], none, least)
            yield _Rows(*total, none, -most, peak=-len(resting))
            if not np.isfinite(self.limits.actuator):
                continue
            force = each @ inertia, each @ slowing
            for known in (np.tile(split.sum(axis=1) * load, arcs) for load in self.load):
                yield _Rows(*force, nothing, self.limits.actuator - known)
                yield _Rows(-force[0], -force[1], nothing, self.limits.actuator + known)


def _link_rows(links: int, limits: Limits, arcs: int) -> Iterator[_Rows]:
    """Rows of rates, accelerations and lengths of the links."""
    link = eye_array(links, links + 1) - eye_array(links, links + 1, k=1)
    rate: Matrix = csr_array(_kron(eye_array(arcs + 1), link))
    bend: Matrix = csr_array(_kron(_change(arcs), link))
    for sign in (1.0, -1.0):
        none = csr_array(rate.shape)
        yield _Rows(none, sign * rate, none, np.full(rate.shape[0], limits.rate))
        none = csr_array(bend.shape)
        yield _Rows(sign * bend, none, none, np.full(bend.shape[0], limits.acceleration))
    # lengths are quadratics on an arc: within their Bernstein coefficients
    below = np.tril(np.ones((arcs, arcs)), -1)
    grown = below @ (np.eye(arcs, arcs + 1) + np.eye(arcs, arcs + 1, k=1)) / 2
    for part in (grown[1:], grown + np.eye(arcs, arcs + 1) / 2):
        rows: Matrix = csr_array(_kron(part, link))
        none, begin = csr_array(rows.shape), _kron(np.ones((len(part), 1)), eye_array(links))
        for sign, side in ((1.0, limits.length[1]), (-1.0, -limits.length[0])):
            yield _Rows(none, none, sign * rows, np.full(rows.shape[0], side), sign * begin)


def _needs(mass: np.ndarray, drag: float, arcs: int) -> Iterator[tuple[Matrix, Matrix]]:
    """Inertia (over the step) and drag of every mass at the start and the end of every arc."""
    for end in (0, 1):
        slowing = _kron(eye_array(arcs, arcs + 1, k=end), drag * eye_array(len(mass)))
        yield csr_array(_kron(_change(arcs), np.diag(mass))), csr_array(slowing)


def _change(arcs: int) -> Matrix:
    return eye_array(arcs, arcs + 1, k=1) - eye_array(arcs, arcs + 1)


def _strokes(task: _Task, nodes: np.ndarray, duration: float) -> Iterator[Stroke]:
    """Strokes of a solution; arcs with the same acceleration are merged."""
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


def _kron(one: Matrix | np.ndarray, other: Matrix | np.ndarray) -> Matrix:
    # SciPy makes a matrix from dense arrays, with a warning since 1.18
    return sparse.kron(coo_array(one), coo_array(other))


@dataclass(frozen=True, eq=False)
class Row:
    """A stroke in the table of a gear box, and its possible successors, by row number."""

    stroke: Stroke
    gear: int  # current gear, or the gear that a transition leads to
    shifting: bool  # whether it belongs to a transition
    ends_cycle: bool  # whether a cycle of the gear ends with it
    follows: int  # next row while the gear is kept
    slower: int | None = None  # next row towards the next slower gear
    faster: int | None = None  # next row towards the next faster gear


@dataclass(frozen=True, eq=False)
class GearBox:
    """Gears from the slowest to the fastest, with transitions between neighbours."""

    gears: tuple[Gear, ...]
    up: tuple[Transition, ...]  # from gear k to k + 1
    down: tuple[Transition, ...]  # from gear k + 1 to k

    @property
    def mass(self) -> np.ndarray:
        """Point masses (n+1,)."""
        return self.gears[0].mass

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """All strokes: the cycles of all gears in order, then the transitions."""
        starts = np.cumsum([0, *(len(gear.strokes) for gear in self.gears)]).tolist()
        after = {("up", k): starts[k + 1] + t.enters for k, t in enumerate(self.up)}
        after |= {("down", k): starts[k] + t.enters for k, t in enumerate(self.down)}
        begins, count = {}, starts[-1]
        for name, transitions in (("up", self.up), ("down", self.down)):
            for k, transition in enumerate(transitions):
                none = not transition.strokes
                begins[name, k] = after[name, k] if none else count
                count += len(transition.strokes)
        rows = []
        for k, gear in enumerate(self.gears):
            length = len(gear.strokes)
            for q, stroke in enumerate(gear.strokes):
                then = (q + 1) % length
                slower = k > 0 and self.down[k - 1].leaves == then
                faster = k + 1 < len(self.gears) and self.up[k].leaves == then
                rows.append(
                    Row(
                        stroke,
                        k,
                        shifting=False,
                        ends_cycle=then == 0,
                        follows=starts[k] + then,
                        slower=begins["down", k - 1] if slower else None,
                        faster=begins["up", k] if faster else None,
                    )
                )
        for name, transitions in (("up", self.up), ("down", self.down)):
            for k, transition in enumerate(transitions):
                into = k + 1 if name == "up" else k
                for q, stroke in enumerate(transition.strokes):
                    last = q + 1 == len(transition.strokes)
                    follows = after[name, k] if last else len(rows) + 1
                    rows.append(Row(stroke, into, shifting=True, ends_cycle=False, follows=follows))
        return tuple(rows)

    def first_row(self, gear: int) -> int:
        """First row of the cycle of a gear."""
        return sum(len(each.strokes) for each in self.gears[:gear])

    @property
    def degree(self) -> int:
        """Largest degree of a velocity."""
        return max(row.stroke.velocity.shape[1] for row in self.rows) - 1


def gear_box(gears: Sequence[Gear], limits: Limits, *, resting: int = 1, arcs: int = 12) -> GearBox:
    """Sort gears by speed, and design the transitions between neighbours.

    A transition meets the limits at all loads that both gears carry.
    """
    ordered = tuple(sorted(gears, key=lambda gear: gear.speed))
    up, down = [], []
    for slow, fast in pairwise(ordered):
        if fast.speed <= slow.speed * (1 + 1e-9):
            raise ArgumentError(f"{slow.name} and {fast.name} are equally fast; remove one")
        load = max(slow.least, fast.least), min(*slow.bears(limits), *fast.bears(limits))
        if not load[0] < load[1]:
            raise ArgumentError(
                f"{slow.name} and {fast.name} have no common load: one needs at least "
                f"{load[0]:.4g} on each mass to avoid gliding, but both carry only {load[1]:.4g}; "
                "give one a longer period"
            )
        up.append(shortest_transition(slow, fast, limits, load, resting=resting, arcs=arcs))
        down.append(shortest_transition(fast, slow, limits, load, resting=resting, arcs=arcs))
    return GearBox(ordered, tuple(up), tuple(down))
