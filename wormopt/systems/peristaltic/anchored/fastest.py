"""The fastest gait of a worm that anchors, and a bound that no gait exceeds.

Which segments are anchored in which phase is a table of zeros and ones; given it, durations,
lengths and ways obey linear limits only. The speed, advance A over period T, is maximised as
Dinkelbach does: where the maximum of A - v T over all gaits is 0, v is the largest speed; where it
is more, the gait that reaches it is faster than v. Over all tables the maximum is a mixed program,
and branch and bound proves it; for one table it is a linear program.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.numerics.linear_program import LinearProgram, Maximum, Rows
from wormopt.numerics.mixed_program import Mixed, maximise_mixed
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.anchored.ceilings import ModeBound, mode_bound
from wormopt.systems.peristaltic.anchored.gait import AnchoredGait, order_of, table_of, wave_order
from wormopt.systems.shared.sequences import Sequence_

# Gains of this share of the speed end the search.
_SAME = 1e-8
# Weights of the rings are as good as this.
_ROUNDING = 1e-8
# A column of zeros and ones is one from here on.
_HALF = 0.5
# Linear programs that one order takes at most; they square what is missing.
_ROUNDS = 20


@dataclass(frozen=True)
class AnchorLimits:
    """What a gait must keep to.

    A segment is anchored while it is short, and rests then. Where a phase ends, every segment
    that is anchored neither before nor after is at least the clearance longer. So each flight,
    the time between two rests, has a phase in which the segment lifts, and one in which it lands.

    Parameters
    ----------
    segments, anchors : int
        Number N of segments, and of those anchored at any time, at least.
    stroke, clearance : float
        Longest less shortest length; length above the shortest of a segment that moves.
    rate : (float, float)
        Largest rates of contraction and extension.

    Raises
    ------
    ArgumentError
        Where no gait keeps to them.

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
                f"at most N - 2 = {self.segments - 2} can be"
            )
        if not 0 < self.clearance <= self.stroke or min(self.rate) <= 0:
            raise ArgumentError(
                f"the clearance {self.clearance:g} must be above 0 and at most the stroke "
                f"{self.stroke:g}, and rates above 0"
            )

    @cached_property
    def ceiling(self) -> ModeBound:
        """No gait of any number of phases is faster: the mode program of clamped segments."""
        return mode_bound(self.segments, self.anchors, self.rate)

    @property
    def shortest_period(self) -> float:
        """No cycle that advances is shorter: a segment lifts and lands in it."""
        return sum(self.clearance / rate for rate in self.rate)


@dataclass(frozen=True, eq=False)
class Fastest:
    """A designed gait, and how much better any could be."""

    gait: AnchoredGait
    ceiling: float  # no gait of any number of phases is faster, by rates and anchors alone
    bound: float  # no gait of at most so many phases is faster
    phases: int
    nodes: int  # of all trees

    @property
    def gap(self) -> float:
        """By which share of its speed a gait of at most so many phases could be faster."""
        return max(0.0, self.bound / self.gait.speed - 1)


class _Program:
    """All gaits of so many phases as a mixed program, in strokes and strokes over largest rate.

    Columns from 0: durations, lengths as a phase begins, ways, and whether anchored. No phase
    need last longer than a whole stroke at the lower rate: no length changes by more.
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
        """What the mode program says of each phase; branch and bound is done the sooner by it.

        Head and tail may be exchanged where time may run backward.
        """
        bound, rate = self._limits.ceiling, self._limits.rate
        speed = bound.speed / self._unit * (1 + _ROUNDING)
        for weights in (bound.weights, bound.weights[::-1])[: 2 if rate[0] == rate[1] else 1]:
            ways = [(self.x[:, i], float(w)) for i, w in enumerate(weights)]
            self.rows.add([*ways, (self.h, -speed)], -np.inf, 0.0)

    def _cost(self, speed: float) -> np.ndarray:
        cost = np.zeros(len(self.upper))
        cost[self.x[:, 0]] = 1.0
        cost[self.h] = -speed / self._unit
        return cost

    def any_order(self, speed: float, seconds: float) -> Mixed:
        """Greatest advance less `speed` times period, over all orders."""
        whole = self.a.ravel()
        cost = self._cost(speed)
        return maximise_mixed(cost, self.rows, self.lower, self.upper, whole, seconds)

    def of_order(self, order: Sequence_, speed: float) -> Maximum:
        """The same of one order."""
        return self._held(order, self._cost(speed)).maximise()

    def longest(self, order: Sequence_, speed: float) -> Maximum:
        """Longest period of one order at a speed."""
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
        """Segments anchored in each phase of a point."""
        return order_of(x[self.a] > _HALF)

    def gait(self, order: Sequence_, x: np.ndarray) -> AnchoredGait:
        """The gait of a point, in the unit of the limits."""
        stroke = self._limits.stroke
        durations = np.maximum(x[self.h], 0.0) * stroke / self._unit
        return AnchoredGait(order, durations, x[self.l] * stroke, x[self.x] * stroke)


def fastest_of_order(limits: AnchorLimits, order: Sequence_) -> AnchoredGait | None:
    """Fastest gait of one order, of the longest period of such; None where it does not advance."""
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
    """Design the fastest gait of at most so many phases, and bound what any could do.

    Parameters
    ----------
    limits : AnchorLimits
        What it keeps to.
    phases : int
        Most phases of a cycle.
    seconds : float, optional
        After which the bound stands as it is.
    report : callable, optional
        Called with what is done and the share of it that is behind.

    Returns
    -------
    Fastest
        Its ``gait``, never slower than `anchored_wave`; ``bound``, ``ceiling`` and ``gap``.

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
    """Waves of enough short segments and the accordion of two blocks, as fast as they can be."""
    n, k = limits.segments, limits.anchors
    head, tail, every = tuple(range(k)), tuple(range(n - k, n)), tuple(range(n))
    orders = [wave_order(n, short) for short in range(k + 1, n)]
    for order in [*orders, (head, head, every, tail, tail)]:
        gait = fastest_of_order(limits, order)
        if gait is not None:
            yield gait
