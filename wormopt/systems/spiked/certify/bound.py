"""Bounds on the objective of every gait, refined until the gap is small, with certificates."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from msgspec import structs

from wormopt.model.given import fields_of, per
from wormopt.progress import Report
from wormopt.systems.spiked.certify.certificate import Certificate
from wormopt.systems.spiked.certify.program import OF_STROKES, Level, Outer, Program, size_of
from wormopt.systems.spiked.certify.statement import Statement, rounded_up
from wormopt.systems.spiked.gait_problem import Certify, Cost, GaitProblem, Objective
from wormopt.systems.spiked.search.orders import ceiling_of

Ending = Literal["gap reached", "time limit", "finest program", "interrupted"]

# Levels of the programs, each a few times as large as the previous one.
_LEVELS = tuple(
    Level(*numbers)
    for numbers in (
        (1, 1, 2), (1, 1, 3), (1, 1, 4), (1, 2, 4), (2, 2, 3), (2, 3, 3), (2, 4, 3), (3, 4, 3),
        (3, 6, 3), (4, 6, 3), (4, 8, 3), (6, 8, 3), (6, 12, 3), (8, 16, 3), (12, 24, 3),
    )
)  # fmt: skip
# Estimated coefficients of programs: solved in a tenth of a second; always solved; too many.
_AT_ONCE, _SMALL, _LARGE = 1.5e5, 3e5, 1e8
_AT_ONCE_TIME = 0.1
# Share of the time for shorter strokes.
_OF_STROKES_TIME = 0.25
# Exponent of a program's time over its size.
_GROWTH = 1.3
# Precision of the highest provable cost, as a share of the wanted or remaining gap.
_NEAR = 0.1


@dataclass(frozen=True)
class Bounded:
    """A bound on the objective of every gait of a task."""

    bound: float  # no gait is faster, or cheaper
    certificate: Certificate | None  # None: from rates and resting masses alone
    source: str  # how it was found, in words
    history: tuple[tuple[float, float], ...]  # (seconds, bound) at each improvement
    ending: Ending = "finest program"
    outer: Outer | None = field(default=None, repr=False)  # larger programs continue from here


def at_once(task: GaitProblem) -> Bounded | None:
    """Bound the speed by small programs, with the same result on all machines; None for a cost."""
    if task.objective.minimise is not None:
        return None
    begun = time.perf_counter()
    found = [(time.perf_counter() - begun, each) for each in _small(task)]
    reached = dict[float, float]()  # when each bound was known
    for seconds, each in found:
        reached.setdefault(each.bound, seconds)
    return replace(found[-1][1], history=tuple((s, bound) for bound, s in reached.items()))


def bounded(
    task: GaitProblem, value: float, wanted: Certify, report: Report, known: Bounded | None = None
) -> Bounded:
    """Bound every gait of a task, until no gait can be better than `value` by the wanted gap."""
    begun, found, history = time.perf_counter(), None, list(known.history if known else ())
    until, cost = begun + wanted.time_limit, task.objective.minimise
    course = (
        _of_cost(task, cost, value, wanted.gap, until) if cost else _of_speed(task, known, until)
    )
    begun -= history[-1][0] if history else 0.0
    widest = 0.0
    try:
        for found in course:
            if not history or found.bound != history[-1][1]:
                history.append((time.perf_counter() - begun, found.bound))
            gap = gap_of(value, found.bound, cost is not None)
            widest = max(widest, gap if gap < math.inf else 0.0)
            report(f"certifying: gap {gap:.2g}", _fraction(gap, widest, wanted.gap))
            if gap <= wanted.gap:
                found = replace(found, ending="gap reached")
                break
    except KeyboardInterrupt:
        if found is None:
            raise
        found = replace(found, ending="interrupted")
    assert found is not None
    return replace(found, history=tuple(history))


def _small(task: GaitProblem, until: float = math.inf) -> Iterator[Bounded]:
    """Improving bounds on the speed: by rates, by mean rates, by small linear programs."""
    best = Bounded(ceiling_of(task), None, "by rates and resting masses", ())
    if task.limits.acceleration is None:
        yield best
        return
    outer = Outer(Statement.of(task))
    yield (best := replace(best, outer=outer))
    if outer.mesh is not None and size_of(outer, OF_STROKES) <= _AT_ONCE:
        outer.shorten(until - time.perf_counter())
    if (found := _by_mean_rates(outer, best)) is not best:
        yield (best := found)
    if outer.is_single:
        return
    for level in _levels(outer, until, most=_AT_ONCE):
        if level and (found := _by_program(outer, level, until, best)) is not best:
            yield (best := found)


def _of_speed(task: GaitProblem, known: Bounded | None, until: float) -> Iterator[Bounded]:
    """Improving bounds on the speed, starting from `known`."""
    best = known
    for best in [known] if known else _small(task, until):
        yield best
    assert best is not None
    if best.outer is None or best.outer.is_single:
        return
    outer = copy(best.outer)
    if outer.mesh is not None and size_of(outer, OF_STROKES) > _AT_ONCE:
        outer.shorten(_OF_STROKES_TIME * (until - time.perf_counter()))
        yield (best := _by_mean_rates(outer, best))
    for level in _levels(outer, until, least=_AT_ONCE):
        if level is None:
            yield replace(best, ending="time limit")
            return
        yield (best := _by_program(outer, level, until, best))


def _by_mean_rates(outer: Outer, best: Bounded) -> Bounded:
    bound = outer.statement.mean_rates(outer.strokes, outer.starts, outer.brakes)
    if bound >= best.bound:
        return best
    return _certified(outer, bound, outer.proof(outer.mesh), "by the mean rates of links")


def _by_program(outer: Outer, level: Level, until: float, best: Bounded) -> Bounded:
    bound, proof = Program(outer, level).solve(until - time.perf_counter())
    if bound >= best.bound:
        return best
    return _certified(outer, bound, proof, f"by a linear program, level {tuple(level)}")


def _levels(
    outer: Outer, until: float, least: float = 0.0, most: float = _LARGE
) -> Iterator[Level | None]:
    """Levels with sizes above `least` that can be solved in time, estimated from the last one."""
    if outer.mesh is None:
        return
    seconds, before = _AT_ONCE_TIME, _AT_ONCE
    for level in _LEVELS:
        size = size_of(outer, level)
        if size > most:
            return
        if size <= least:
            continue
        expected = seconds * (size / before) ** _GROWTH if size > _SMALL else 0.0
        begun = time.perf_counter()
        if begun + expected > until:
            yield None
            return
        yield level
        seconds, before = time.perf_counter() - begun, size


def _certified(outer: Outer, bound: float, proof: dict[str, Any], source: str) -> Bounded:
    """Write a bound and its proof."""
    whole = rounded_up(bound)
    certificate = Certificate.of(fields_of(outer.statement), proof, whole)
    above = math.nextafter(float(whole), math.inf)
    return Bounded(above, certificate, source, (), outer=outer)


def _of_cost(
    task: GaitProblem, cost: Cost, value: float, gap: float, until: float
) -> Iterator[Bounded]:
    """Increasing peaks below which no gait reaches the required speed.

    If no gait within a lowered limit has the required speed, every gait has a higher peak.
    """
    required = task.objective.speed
    assert required is not None
    best = Bounded(0.0, None, "no peak is below 0", ())
    yield best
    first = Outer(Statement.of(task))
    for level in _levels(first, until):
        if level is None:
            yield replace(best, ending="time limit")
            return
        high = value
        while time.perf_counter() < until:
            if high - best.bound <= _NEAR * max(gap * value, value - best.bound):
                break
            middle = float(f"{(best.bound + high) / 2:.6g}")
            outer = Outer(Statement.of(_lowered(task, cost, middle)))
            outer.shorten(until - time.perf_counter())
            bound, proof = Program(outer, level).solve(until - time.perf_counter())
            source = f"by a linear program, level {tuple(level)}"
            proven = _certified(outer, max(bound, _NEAR * required), proof, source)
            if proven.bound < required:
                best = replace(proven, bound=middle)
                yield best
            else:
                high = middle
        yield best


def _lowered(task: GaitProblem, cost: str, most: float) -> GaitProblem:
    key = cost.removeprefix("peak_")  # of the limit
    given, count = getattr(task.limits, key), task.worm.links + (key == "spike_load")
    lowered = most if given is None else tuple(min(most, each) for each in per(given, count))
    limits = structs.replace(task.limits, **{key: lowered})
    return structs.replace(task, limits=limits, objective=Objective())


def gap_of(value: float, bound: float, cost: bool) -> float:
    """Largest possible improvement by any gait, as a share of its value, for a proven bound.

    `cost`: whether the value is a cost, which is minimised.
    """
    if not value > 0.0:  # a worm at rest can be better by any share
        return math.inf
    return (value - bound) / value if cost else (bound - value) / value


def _fraction(gap: float, widest: float, wanted: float) -> float | None:
    """Progress from the first gap to the wanted one, on a logarithmic scale."""
    if not wanted < gap < math.inf or widest <= wanted:
        return None
    return math.log(widest / gap) / math.log(widest / wanted)
