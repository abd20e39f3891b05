"""The fastest gait of a worm that anchors, and upper bounds of every gait's speed.

A table of zeros and ones states which segments are anchored in which phase. For a given table
durations, lengths and displacements satisfy linear constraints only. Dinkelbach's method maximises
the speed, advance A over period T: if the maximum of A - v T over all gaits is 0, v is the highest
speed; if it is positive, the maximising gait is faster than v. Over all tables the maximum is a
mixed-integer program with a proof by branch and bound; for one table it is a linear program.

The mode program bounds the speed by rates of lengths and the number of anchors alone: each set of
anchored segments has a share of time and a displacement of every ring, and all rings have the same
total advance. It ignores the order of the sets, the stroke and the clearance, so it bounds gaits
with any number of phases. It is the mode program of worms with spikes with another rule of rest;
`mid` lets an anchored segment change its length about its resting middle.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import comb

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.numerics.linear_program import LinearProgram, Maximum, Mixed, Rows, maximise_mixed
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.anchored import AnchoredGait, order_of, table_of, wave_order
from wormopt.systems.peristaltic.segment import Anchoring
from wormopt.systems.shared.sequences import Sequence_

# Largest number of sets; 12 segments with any subset at rest have fewer.
_MOST_SETS = 1000


@dataclass(frozen=True, eq=False)
class ModeBound:
    """Result of `mode_bound`: no motion of any set of anchors has a larger weighted velocity."""

    speed: float  # upper bound of the mean speed; the least bound to about 1e-9
    weights: np.ndarray  # (N + 1,) of the rings, with sum 1


def mode_bound(
    segments: int, anchors: int, rate: tuple[float, float], anchoring: Anchoring = "clamp"
) -> ModeBound:
    """Return an upper bound of the mean speed, rigorous under round-off.

    Theory: docs/theory-peristaltic.md, section 3.

    Parameters
    ----------
    segments : int
        Number of segments N.
    anchors : int
        Least number of anchored segments at any time, 1 to N.
    rate : (float, float)
        Largest rates at which a length shrinks and grows.
    anchoring : {"clamp", "mid"}, optional
        Resting part of an anchored segment: both of its rings, or its middle.

    Returns
    -------
    ModeBound
        The bound in the unit of the rates.

    Raises
    ------
    ArgumentError
        If the number of anchors is not 1 to N, or there are too many sets of them.

    Examples
    --------
    >>> bounds = [mode_bound(5, 2, (1.0, 1.0), how) for how in ("clamp", "mid")]
    >>> [round(bound.speed, 6) for bound in bounds]
    [0.666667, 1.0]
    """
    if not 1 <= anchors <= segments:
        raise ArgumentError(f"{anchors} of {segments} segments anchored; write 1 to {segments}")
    if comb(segments, anchors) > _MOST_SETS:
        raise ArgumentError(f"{segments} segments have too many sets of {anchors} anchors to list")
    unit = max(rate)
    sets = list(combinations(range(segments), anchors))
    rows, count = Rows(), len(sets)
    (speed,) = rows.columns(np.array([float(segments)]))
    shares = rows.columns(np.ones(count))
    rings = range(segments + 1)
    free = np.array([[not _rests(i, rest, anchoring) for i in rings] for rest in sets])
    moves = rows.columns(np.where(free, 1.0, 0.0))  # from -N to N, below
    for j in range(segments):
        grows = [(moves[:, j], 1.0), (moves[:, j + 1], -1.0)]
        rows.add([*grows, (shares, -rate[1] / unit)], -np.inf, 0.0)
        rows.add([*grows, (shares, rate[0] / unit)], 0.0, np.inf)
    if anchoring == "mid":
        held = np.array([(k, j) for k, rest in enumerate(sets) for j in rest])
        rows.add([(moves[held[:, 0], held[:, 1] + d], 1.0) for d in (0, 1)], 0.0, 0.0)
    alike = np.concatenate(
        [
            rows.add(
                [*((move, 1.0) for move in moves[:, i].tolist()), (int(speed), -1.0)], 0.0, 0.0
            )
            for i in rings
        ]
    )
    rows.add([(share, 1.0) for share in shares.tolist()], 1.0, 1.0)
    upper = np.array(rows.upper)
    upper[moves[free]] = segments
    lower = np.where(np.isin(np.arange(len(upper)), moves[free]), -upper, 0.0)
    cost = np.zeros(len(upper))
    cost[speed] = 1.0
    found = LinearProgram(cost, rows, lower, upper).maximise()
    weights = found.row_duals[alike]
    return ModeBound(found.bound * unit, weights / weights.sum())


def _rests(ring: int, rest: tuple[int, ...], anchoring: Anchoring) -> bool:
    return anchoring == "clamp" and (ring in rest or ring - 1 in rest)


# Relative gain in speed below which the search ends.
_SAME = 1e-8
# Accuracy of the weights of the rings.
_ROUNDING = 1e-8
# Value from which a binary column counts as one.
_HALF = 0.5
# Largest number of linear programs of one order; each squares the error.
_ROUNDS = 20


@dataclass(frozen=True)
class AnchorLimits:
    """Limits of a gait of a worm that anchors.

    A segment is anchored, and rests, while it is short. At the end of a phase every segment that is
    anchored neither before nor after is longer by at least the clearance. Each flight, the time
    between two rests, therefore has a phase in which the segment lifts and one in which it lands.

    Parameters
    ----------
    segments, anchors : int
        Number N of segments, and least number of anchored ones at any time.
    stroke, clearance : float
        Longest less shortest length; length of a moving segment above the shortest.
    rate : (float, float)
        Largest rates of contraction and extension.

    Raises
    ------
    ArgumentError
        If no gait satisfies them.

    Examples
    --------
    >>> limits = AnchorLimits(5, 2, stroke=1.0, clearance=0.5, rate=(1.0, 1.0))
    >>> round(limits.ceiling.speed, 6), limits.shortest_period
    (0.666667, 1.0)
    """

    segments: int
    anchors: int
    stroke: float
    clearance: float
    rate: tuple[float, float]

    def __post_init__(self) -> None:
        if not 1 <= self.anchors <= self.segments - 2:
            raise ArgumentError(
                f"{self.anchors} of {self.segments} segments anchored leave none to move; "
                f"give at most N - 2 = {self.segments - 2}"
            )
        if not 0 < self.clearance <= self.stroke or min(self.rate) <= 0:
            raise ArgumentError(
                f"the clearance {self.clearance:g} must be above 0 and at most the stroke "
                f"{self.stroke:g}, and rates above 0"
            )

    @cached_property
    def ceiling(self) -> ModeBound:
        """Upper bound for any number of phases: the mode program of clamped segments."""
        return mode_bound(self.segments, self.anchors, self.rate)

    @property
    def shortest_period(self) -> float:
        """Least duration of a cycle that advances: a segment lifts and lands in it."""
        return sum(self.clearance / rate for rate in self.rate)


@dataclass(frozen=True, eq=False)
class Fastest:
    """Result of `fastest`: a designed gait, and upper bounds of the speed."""

    gait: AnchoredGait
    ceiling: float  # upper bound for any number of phases, by rates and anchors alone
    bound: float  # upper bound for the given number of phases
    phases: int
    nodes: int  # of all trees of branch and bound

    @property
    def gap(self) -> float:
        """Relative increase in speed still possible with the given number of phases."""
        return max(0.0, self.bound / self.gait.speed - 1)


class _Program:
    """All gaits with a number of phases as a mixed program, in strokes and strokes over rate.

    Columns from 0: durations, initial lengths of phases, displacements, and anchors. No phase needs
    to last longer than a whole stroke at the lower rate, because no length changes by more.
    """

    def __init__(self, limits: AnchorLimits, phases: int) -> None:
        self._limits, self.phases = limits, phases
        n, ones = limits.segments, np.ones(phases * limits.segments)
        self._unit = max(limits.rate)
        contraction, extension = (rate / self._unit for rate in limits.rate)
        clearance = limits.clearance / limits.stroke
        self.rows = rows = Rows()
        self.h = rows.columns(np.full(phases, 1 / min(contraction, extension)))
        self.l = rows.columns(ones).reshape(phases, n)
        most = float(n - limits.anchors)  # strokes that a ring moves in a phase
        self.x = rows.columns(np.full((phases, n + 1), most))
        self.a = rows.columns(ones).reshape(phases, n)
        begin, end = self.l.ravel(), np.roll(self.l, -1, axis=0).ravel()
        last, here, after = (np.roll(self.a, k, axis=0).ravel() for k in (1, 0, -1))
        rings = self.x[:, :-1].ravel(), self.x[:, 1:].ravel()
        duration = np.repeat(self.h, n)
        change = [(rings[0], 1.0), (rings[1], -1.0)]
        rows.add([*change, (begin, 1.0), (end, -1.0)], 0.0, 0.0)
        rows.add([*change, (duration, -extension)], -np.inf, 0.0)
        rows.add([*change, (duration, contraction)], 0.0, np.inf)
        for ring in rings:  # at rest where anchored
            rows.add([(ring, 1.0), (here, most)], -np.inf, most)
            rows.add([(ring, 1.0), (here, -most)], -most, np.inf)
        for length in (begin, end):  # short where anchored
            rows.add([(length, 1.0), (here, 1.0)], -np.inf, 1.0)
        rows.add([(begin, 1.0), (here, clearance), (last, clearance)], clearance, np.inf)
        rows.add([(last, 1.0), (after, 1.0), (here, -1.0)], -np.inf, 1.0)  # no flight of one phase
        rows.add([(self.a[:, j], 1.0) for j in range(n)], float(limits.anchors), np.inf)
        self._add_ceiling()
        self.upper = np.array(rows.upper)
        self.lower = np.where(np.isin(np.arange(len(self.upper)), self.x), -self.upper, 0.0)

    def _add_ceiling(self) -> None:
        """Add the bound of the mode program for each phase, which speeds up branch and bound."""
        bound, rate = self._limits.ceiling, self._limits.rate
        speed = bound.speed / self._unit * (1 + _ROUNDING)
        for weights in (bound.weights, bound.weights[::-1])[: 2 if rate[0] == rate[1] else 1]:
            moves = [(self.x[:, i], float(w)) for i, w in enumerate(weights)]
            self.rows.add([*moves, (self.h, -speed)], -np.inf, 0.0)

    def _cost(self, speed: float) -> np.ndarray:
        cost = np.zeros(len(self.upper))
        cost[self.x[:, 0]] = 1.0
        cost[self.h] = -speed / self._unit
        return cost

    def any_order(self, speed: float, seconds: float) -> Mixed:
        """Return the largest advance less `speed` times period, over all orders."""
        whole = self.a.ravel()
        cost = self._cost(speed)
        return maximise_mixed(cost, self.rows, self.lower, self.upper, whole, seconds)

    def of_order(self, order: Sequence_, speed: float) -> Maximum:
        """Return the largest advance less `speed` times period of one order."""
        return self._held(order, self._cost(speed)).maximise()

    def longest(self, order: Sequence_, speed: float) -> Maximum:
        """Return the longest period of one order at a speed."""
        lasts = np.where(np.isin(np.arange(len(self.upper)), self.h), 1.0, 0.0)
        program, rows, cost = self._held(order, lasts), Rows(), self._cost(speed)
        rows.add([(int(k), float(cost[k])) for k in np.flatnonzero(cost)], -1e-12, np.inf)
        program.extend(rows)
        return program.maximise()

    def _held(self, order: Sequence_, cost: np.ndarray) -> LinearProgram:
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[self.a] = upper[self.a] = table_of(order, self._limits.segments)
        return LinearProgram(cost, self.rows, lower, upper)

    def order(self, x: np.ndarray) -> Sequence_:
        """Return the segments anchored in each phase of a point."""
        return order_of(x[self.a] > _HALF)

    def gait(self, order: Sequence_, x: np.ndarray) -> AnchoredGait:
        """Return the gait of a point, in the unit of the limits."""
        stroke = self._limits.stroke
        durations = np.maximum(x[self.h], 0.0) * stroke / self._unit
        return AnchoredGait(order, durations, x[self.l] * stroke, x[self.x] * stroke)


def fastest_of_order(limits: AnchorLimits, order: Sequence_) -> AnchoredGait | None:
    """Return the fastest gait of one order with the longest period, or None without advance."""
    program, speed, best = _Program(limits, len(order)), 0.0, None
    for _ in range(_ROUNDS):
        found = program.of_order(order, speed)
        if not found.x.size:
            break
        gait = program.gait(order, found.x)
        if gait.period <= 0 or gait.speed <= speed * (1 + _SAME**2):
            break
        best, speed = gait, gait.speed
    if best is None:
        return None
    found = program.longest(order, speed)
    longest = program.gait(order, found.x) if found.x.size else best
    return longest if longest.speed >= speed * (1 - _SAME) else best


def fastest(
    limits: AnchorLimits, phases: int, seconds: float = 50.0, report: Report = silent
) -> Fastest:
    """Design the fastest gait with a limited number of phases, and bound the speed of any gait.

    Theory: docs/theory-peristaltic.md, section 3.

    Parameters
    ----------
    limits : AnchorLimits
        Limits of the gait.
    phases : int
        Largest number of phases in a cycle.
    seconds : float, optional
        Time in s after which the proof of the bound stops.
    report : callable, optional
        Called with the current step and the share completed.

    Returns
    -------
    Fastest
        ``gait``, never slower than `anchored_wave`; ``bound``, ``ceiling`` and ``gap``.

    Examples
    --------
    >>> found = fastest(AnchorLimits(3, 1, 1.0, 0.5, (1.0, 1.0)), phases=6)
    >>> round(found.gait.speed, 6), round(found.ceiling, 6)
    (0.5, 0.5)
    """
    end, nodes = time.monotonic() + seconds, 0
    best = max(_constructed(limits), key=lambda gait: gait.speed)
    most = bound = limits.ceiling.speed
    program = _Program(limits, phases)
    while best.speed < most * (1 - _SAME) and (left := end - time.monotonic()) > 0:
        report("searching", min(1 - left / seconds, 1.0))
        found = program.any_order(best.speed, left)
        nodes += found.nodes
        slack = max(found.bound, 0.0) * limits.stroke / limits.shortest_period
        bound = min(bound, best.speed + slack)
        better = found.x.size and fastest_of_order(limits, program.order(found.x))
        if not better or better.speed <= best.speed * (1 + _SAME):
            break
        best = better
    return Fastest(best, most, max(bound, best.speed), phases, nodes)


def _constructed(limits: AnchorLimits) -> Iterator[AnchoredGait]:
    """Yield the fastest waves of enough short segments, and the accordion of two blocks."""
    n, k = limits.segments, limits.anchors
    head, tail, every = tuple(range(k)), tuple(range(n - k, n)), tuple(range(n))
    orders = [wave_order(n, short) for short in range(k + 1, n)]
    for order in [*orders, (head, head, every, tail, tail)]:
        gait = fastest_of_order(limits, order)
        if gait is not None:
            yield gait
