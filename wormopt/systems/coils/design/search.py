"""Search for the best pattern, with every value of one coil's waveform and the rate free.

An evolution strategy starts from the best blocks and the best mean-field waves; a compass search
follows. The result is a local optimum: a better pattern may exist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wormopt.numerics.compass import Look, Point, compass
from wormopt.numerics.evolution import evolve
from wormopt.numerics.workers import Workers
from wormopt.progress import Report
from wormopt.systems.coils.design.pattern import Pattern
from wormopt.systems.coils.design.task import Judged, Task
from wormopt.systems.coils.tables import DesignSearch

# Values are relative to the limit; a unit of the rate's variable is two of its logarithm.
_RATE_UNIT, _FIRST_STEP = 2.0, 0.2
_COMPASS_STEP, _ROUNDS = 0.05, 2


@dataclass(frozen=True, eq=False)
class Found:
    """Result of one start."""

    start: Judged
    end: Judged
    course: np.ndarray  # best value after each generation


def starts_of(rivals: Sequence[Judged], count: int) -> list[Judged]:
    """Return the best of each sort, then the next best, `count` in all, or one of each sort."""
    first = {one.name: one for one in reversed(rivals)}
    others = [one for one in rivals if one not in first.values()]
    return [*first.values(), *others[: max(0, count - len(first))]]


def search(
    task: Task, starts: Sequence[Judged], effort: DesignSearch, workers: Workers, report: Report
) -> list[Found]:
    """Return the searches from every start, best first."""
    found = []
    for k, start in enumerate(starts):
        report(f"search {k + 1} of {len(starts)}, from the best {start.name}", k / len(starts))
        found.append(_from(task, start, effort, effort.seed + k, workers))
    return sorted(found, key=lambda one: -one.end.value)


def _from(task: Task, start: Judged, effort: DesignSearch, seed: int, workers: Workers) -> Found:
    seen: dict[bytes, Judged] = {}

    def judge(points: np.ndarray) -> list[Judged]:
        jobs = [(start.name, _pattern(task, start, point)) for point in points]
        found = list(workers.map(task.judge, jobs))
        seen.update(zip((point.tobytes() for point in points), found, strict=True))
        return found

    free = len(start.pattern.values)
    first = np.append(start.pattern.values / task.limit, np.log(start.pattern.rate) / _RATE_UNIT)
    low, high = np.full(free + 1, -1.0), np.full(free + 1, 1.0)
    low[-1], high[-1] = np.log(task.rates) / _RATE_UNIT
    evolved = evolve(
        lambda points: np.array([one.value for one in judge(points)]), first, _FIRST_STEP,
        (low, high), effort.generations, size=effort.size, seed=seed,
    )  # fmt: skip
    names = [str(k) for k in range(free + 1)]

    def look(points: Sequence[Point]) -> list[Look]:
        found = judge(np.array([[point[name] for name in names] for point in points]))
        return [Look(p, one.value, 0.0) for p, one in zip(points, found, strict=True)]

    bounds = {name: (float(low[k]), float(high[k])) for k, name in enumerate(names)}
    last = compass(
        look, dict(zip(names, evolved.point.tolist(), strict=True)),
        dict.fromkeys(names, _COMPASS_STEP), bounds, _ROUNDS,
    )[-1]  # fmt: skip
    point = np.array([last.point[name] for name in names])
    return Found(start, seen[point.tobytes()], evolved.course)


def _pattern(task: Task, start: Judged, point: np.ndarray) -> Pattern:
    rate = float(np.exp(_RATE_UNIT * point[-1]))
    return replace(start.pattern, values=task.limit * point[:-1], rate=rate)


def neighbours(task: Task, pattern: Pattern, share: float, workers: Workers) -> list[Judged]:
    """Return results of patterns with one value changed by a share of the limit, or the rate.

    All are within the limits, like the design.
    """
    jobs = []
    for sign in (share, -share):
        jobs += [
            replace(pattern, values=pattern.values + sign * task.limit * one)
            for one in np.eye(len(pattern.values))
        ]
        jobs.append(pattern.paced(1 + sign, task.rates))
    return list(workers.map(task.judge, [("neighbour", job) for job in jobs]))
