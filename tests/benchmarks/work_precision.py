"""Work against precision: what each solver needs for which error, in fair turns.

Every solver first goes down a ladder of tolerances, from which its first run, its errors and its
failures are known. Then all of them run in turn, round after round in one process, and the median
counts: whatever slows the machine down slows down all.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np

from tests.benchmarks.cases import GOAL, WORK_PRECISION, Case, Target
from tests.benchmarks.memory import growth, megabytes
from tests.benchmarks.peers import SOLVERS, Run
from tests.benchmarks.run import (
    OWN,
    Found,
    aligned,
    axes,
    compared,
    curve,
    finite,
    save,
    seconds,
    timed,
)
from wormopt.model.model import Model, Signal
from wormopt.progress import Report
from wormopt.simulation.simulate import simulate

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
    memory: float | None = None  # bytes by which the first run made the process grow

    @property
    def time(self) -> float:
        """Seconds to the error `GOAL`, NaN where it is not reached."""
        return time_at(self.points, GOAL)


_QUICK = Effort(rounds=3, longest=0.5, slow=0.1, per_decade=1)


def measured(name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Measure a case; compiles first what is compiled once a machine, for first runs to be fair."""
    case, x = WORK_PRECISION[name], ca.SX.sym("x")
    simulate(Model("decay", x=[Signal("x", x, value=1.0)], ode=-x), 1.0)
    for records in measure(case, _QUICK if quick else Effort(), report):
        yield {
            "title": case.title,
            "source": case.source,
            "goal": GOAL,
            "solvers": [_described(record) for record in records],
            "targets": [_kept(target, records) for target in case.targets],
        }


def _described(record: Record) -> Found:
    return {
        "solver": record.solver,
        "first_s": finite(record.first),
        "memory": record.memory,
        "time_s": finite(record.time),
        "points": [
            {"tolerance": p.tolerance, "error": p.error, "time_s": p.time, "runs": len(p.times)}
            for p in record.points
        ],
        "failures": record.failures,
        "missing": record.missing,
    }


def _kept(target: Target, records: Sequence[Record]) -> Found:
    """Time of wormopt at the goal over that of the fastest solver of a target, where known."""
    times = {record.solver: record.time for record in records}
    known = [times[name] for name in target.than if not math.isnan(times.get(name, math.nan))]
    ratio = finite(times.get(OWN, math.nan) / min(known, default=math.nan))
    met = None if ratio is None else ratio <= target.most
    return {"than": list(target.than), "most": target.most, "ratio": ratio, "met": met}


# -- measuring -----------------------------------------------------------------------------------


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
    # compiled code is looked for in a new folder, so that first runs are first runs
    with TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):
        for k, record in enumerate(records):
            report(f"{case.name}: {record.solver}", k / len(records) / effort.rounds)
            _, record.memory = growth(lambda r=record: _start(case, r, runs))
            if record.solver in runs:
                _descend(case, record, runs[record.solver], effort)
            yield records
    for turn in range(1, effort.rounds):
        report(f"{case.name}: round {turn}", turn / effort.rounds)
        for record in records:
            for point in record.points:
                near = GOAL / 100 <= point.error <= 100 * GOAL
                fast = point.times[0] < effort.slow
                if (near or fast) and (turn <= 2 or (near and fast)):
                    point.times.append(timed(runs[record.solver], point.tolerance)[0])
        yield records


def _start(case: Case, record: Record, runs: dict[str, Run]) -> None:
    """Make a solver ready and run it once, which is told apart."""
    begin = perf_counter()
    try:
        run = runs[record.solver] = SOLVERS[record.solver](case)
        run(1e-4)
        record.first = perf_counter() - begin
    except ImportError as error:
        record.missing = f"not installed: {error.name}"
    except Exception as error:
        record.failures.append(_reason(1e-4, error))


def _descend(case: Case, record: Record, run: Run, effort: Effort) -> None:
    """Ladder of tolerances of one solver that is warm."""
    for decade in range(4, 14):
        time = _attempt(case, record, run, 10.0**-decade)
        reached = min((p.error for p in record.points), default=math.inf)
        slow = time > effort.slow
        if time > effort.longest or (slow and reached < GOAL / 3) or reached < 1e-12:
            break
    # more tolerances near the goal, where it is fast there
    near = [p for p in record.points if GOAL / 30 <= p.error <= 30 * GOAL and p.time < effort.slow]
    decades = sorted({round(-math.log10(p.tolerance)) + k for p in near for k in (-1, 0)})
    share = effort.per_decade
    between = [10.0 ** -(d + k / share) for d in decades if 4 <= d < 13 for k in range(1, share)]
    for tolerance in between:
        _attempt(case, record, run, tolerance)
    record.points.sort(key=lambda p: -p.tolerance)


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


# -- telling -------------------------------------------------------------------------------------


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our time at the goal over that of every other solver."""
    return compared({s["solver"]: s["time_s"] for s in found["solvers"]})


def lines(found: Mapping[str, Any]) -> list[str]:
    """The solvers in a table, their failures, and the targets."""
    known = [s for s in found["solvers"] if not s["missing"]]
    own = next((s["time_s"] for s in known if s["solver"] == OWN), None)
    rows = [
        (
            "solver",
            "first run",
            "memory",
            f"time at {GOAL:.0e}",
            "ours/theirs",
            "best error",
            "failed",
        )
    ]
    for s in known:
        best = min((p["error"] for p in s["points"]), default=None)
        rows.append(
            (
                s["solver"],
                seconds(s["first_s"]),
                megabytes(s["memory"]),
                seconds(s["time_s"], "not reached"),
                f"{own / s['time_s']:.4f}" if own and s["time_s"] else "",
                "" if best is None else f"{best:.0e}",
                str(len(s["failures"]) or ""),
            )
        )
    told = [f"{found['case']}: {found['title']}", f"  reference: {found['source']}"]
    told += aligned(*rows)
    for s in found["solvers"]:
        told += [f"  {s['solver']}: {s['missing']}"] if s["missing"] else []
        told += [f"  {s['solver']} failed at {failure}" for failure in s["failures"]]
    for target in found["targets"]:
        than, ratio, met = " or ".join(target["than"]), target["ratio"], target["met"]
        end = "unknown" if ratio is None else f"{ratio:.4g}, {'met' if met else 'missed'}"
        told.append(f"  target: at most {target['most']:.4g} of {than}: {end}")
    return told


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw error against time of every solver to a PNG file."""
    from matplotlib.ticker import LogLocator

    figure, left = axes("time of a warm run (s)", "error in positions and velocities")
    left.axhline(GOAL, color="#999999", linewidth=0.8, linestyle="--")
    for k, s in enumerate(found["solvers"]):
        points = [p for p in s["points"] if p["error"] > 0]
        width, style = 2.2 if s["solver"] == OWN else 1.0, "-" if k < 8 else "--"
        if points:
            curve(left, k, points, "time_s", "error", label=s["solver"], linewidth=width,
                  linestyle=style)  # fmt: skip
    left.yaxis.set_major_locator(LogLocator(numticks=20))  # every decade has its label
    left.text(1.0, GOAL, "compared here ", transform=left.get_yaxis_transform(), color="#666666",
              fontsize=7.5, ha="right", va="bottom")  # fmt: skip
    beside = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "fontsize": 7.5}
    save(figure, path, f"{found['case']}: {found['title']}", **beside)
