"""Work against precision: what each solver needs for which error, in fair turns.

Every solver first goes down a ladder of tolerances, from which its first run, its errors and its
failures are known. Then all of them run in turn, round after round in one process, and the median
counts: whatever slows the machine down slows down all.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter

import numpy as np

from wormopt.bench.cases import GOAL, Case, Target
from wormopt.bench.peers import SOLVERS, Run
from wormopt.progress import Report

_FAR_OFF = 1e5  # error over tolerance beyond which an answer is called wrong


@dataclass(frozen=True)
class Effort:
    """How much work measuring may be."""

    rounds: int = 9  # runs of all that is fast and near the goal; of the others at most three
    longest: float = 10.0  # s of a run after which a solver is not asked for more
    slow: float = 0.3  # s from which a run is slow, and repeated near the goal only
    # tolerances near the goal, fast runs; else 1. A single error is luck, by 10 and more
    per_decade: int = 4


@dataclass
class Point:
    """What one solver did at one tolerance."""

    tolerance: float  # relative
    error: float  # largest, in positions and velocities
    times: list[float]  # s, of each run

    @property
    def time(self) -> float:
        """Median of the seconds."""
        return median(self.times)


@dataclass
class Record:
    """What one solver did on one case."""

    solver: str
    first: float = math.nan  # s of its first run with compilation and the like; NaN: none
    points: list[Point] = field(default_factory=list)  # by falling tolerance
    # runs that ended in an error or a wrong answer
    failures: list[str] = field(default_factory=list)
    missing: str = ""  # why it could not be used at all

    @property
    def time(self) -> float:
        """Seconds to the error `GOAL`, NaN where it is not reached."""
        return time_at(self.points, GOAL)


def time_at(points: Sequence[Point], error: float) -> float:
    """Interpolate the time of an error on the log-log curve of undominated points.

    NaN where no point is as good; where all are better, the time of the fastest.
    """
    front: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda p: (p.time, p.error)):
        if not front or point.error < front[-1][1]:
            front.append((point.time, max(point.error, 1e-300)))
    for k, (time, reached) in enumerate(front):
        if reached > error:
            continue
        if k == 0:
            return time
        before, worse = front[k - 1]
        share = math.log(worse / error) / math.log(worse / reached)
        return round(math.exp((1 - share) * math.log(before) + share * math.log(time)), 12)
    return math.nan


def measure(
    case: Case, effort: Effort, report: Report, solvers: Sequence[str] | None = None
) -> Iterator[list[Record]]:
    """Measure solvers on a case, by default all that can take it.

    Yields the same list again, better known each time: who stops early has something.
    """
    names = case.solvers if solvers is None else solvers
    records = [Record(name) for name in names]
    runs: dict[str, Run] = {}
    with _empty_cache():
        for k, record in enumerate(records):
            report(f"{case.name}: {record.solver}", k / len(records) / effort.rounds)
            _descend(case, record, runs, effort)
            yield records
    for turn in range(1, effort.rounds):
        report(f"{case.name}: round {turn + 1}", turn / effort.rounds)
        for record in records:
            for point in record.points:
                if _again(point, turn, effort):
                    point.times.append(_timed(runs[record.solver], point.tolerance)[0])
        yield records


def _again(point: Point, turn: int, effort: Effort) -> bool:
    near = GOAL / 100 <= point.error <= 100 * GOAL
    fast = point.times[0] < effort.slow
    return (near or fast) and (turn <= 2 or (near and fast))


def _timed(run: Run, tolerance: float) -> tuple[float, np.ndarray]:
    begin = perf_counter()
    found = run(tolerance)
    return perf_counter() - begin, found


def _descend(case: Case, record: Record, runs: dict[str, Run], effort: Effort) -> None:
    """Ladder of tolerances of one solver; the first run is its own, the others are warm."""
    begin = perf_counter()
    try:
        run = runs[record.solver] = SOLVERS[record.solver](case)
        run(1e-4)
        record.first = perf_counter() - begin
    except ImportError as error:
        record.missing = f"not installed: {error.name}"
        return
    except Exception as error:
        record.failures.append(_reason(1e-4, error))
        if record.solver not in runs:
            return
    for decade in range(4, 14):
        time = _attempt(case, record, runs[record.solver], 10.0**-decade)
        reached = min((p.error for p in record.points), default=math.inf)
        slow = time > effort.slow
        if time > effort.longest or (slow and reached < GOAL / 3) or reached < 1e-12:
            break
    for tolerance in _between(record.points, effort):
        _attempt(case, record, runs[record.solver], tolerance)
    record.points.sort(key=lambda p: -p.tolerance)


def _between(points: Sequence[Point], effort: Effort) -> list[float]:
    """More tolerances near the goal, for solvers that are fast there."""
    near = [p for p in points if GOAL / 30 <= p.error <= 30 * GOAL and p.time < effort.slow]
    decades = sorted({round(-math.log10(p.tolerance)) + k for p in near for k in (-1, 0)})
    share = effort.per_decade
    return [10.0 ** -(d + k / share) for d in decades if 4 <= d < 13 for k in range(1, share)]


def _attempt(case: Case, record: Record, run: Run, tolerance: float) -> float:
    begin = perf_counter()
    try:
        run(tolerance)  # what is built once for each tolerance is not part of the warm run
        if perf_counter() - begin < 2.0:
            begin = perf_counter()
        found = run(tolerance)
    except Exception as error:
        record.failures.append(_reason(tolerance, error))
        return perf_counter() - begin
    time = perf_counter() - begin
    error = float(np.abs(found - case.reference).max())
    if not error <= _FAR_OFF * tolerance:
        record.failures.append(f"{tolerance:.0e}: wrong by {error:.0e} without a word")
    if math.isfinite(error):
        record.points.append(Point(tolerance, error, [time]))
    return time


def _reason(tolerance: float, error: Exception) -> str:
    return f"{tolerance:.0e}: {type(error).__name__}: {' '.join(str(error).split())[:100]}"


@contextmanager
def _empty_cache() -> Iterator[None]:
    """Let compiled code be looked for in a new folder, so that first runs are first runs."""
    before = os.environ.get("XDG_CACHE_HOME")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ["XDG_CACHE_HOME"]
            else:
                os.environ["XDG_CACHE_HOME"] = before


def ratio(records: Mapping[str, Record], target: Target) -> float:
    """Time of wormopt at the goal over that of the fastest of a target's solvers.

    NaN where one of both did not come to the goal.
    """
    times = [records[name].time for name in target.than if name in records]
    known = [time for time in times if not math.isnan(time)]
    if "wormopt" not in records or not known:
        return math.nan
    return records["wormopt"].time / min(known)
