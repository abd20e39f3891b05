"""Ladders: every solver goes down its settings, from coarse to fine, towards a known answer.

What most benchmarks share: error against time, the first run and repeated ones apart, and by how
much the first run made the memory grow. A benchmark says what is asked in a `Task`, which is all
that its module holds: ``task(name, quick)``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np

from tests.benchmarks import LADDERS
from tests.benchmarks.memory import growth, megabytes
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
    why,
)
from wormopt.model.model import Model, Signal
from wormopt.progress import Report
from wormopt.simulation.simulate import simulate

_ROUNDS, _QUICK_ROUNDS = 5, 2
_LONGEST, _QUICK_LONGEST = 10.0, 0.5  # s of a run after which a solver is asked for no more
_REPEATED = 3.0  # s below which a run is repeated once
_SLOW = 0.3  # s below which it is in every round; else a solver at the goal is asked for no more
_WRONG = 0.3  # error, over the answer, of what is no answer

Run = Callable[[float], np.ndarray]
"""Answers at a setting."""


@dataclass(frozen=True)
class Way:
    """A solver: how it is made ready, and its settings from coarse to fine."""

    name: str
    make: Callable[[], Run]  # ImportError where what it needs is not installed
    settings: tuple[float, ...]


@dataclass(frozen=True)
class Target:
    """A ratio of times at the goal that wormopt has to keep."""

    than: tuple[str, ...]  # solvers; the fastest of them counts
    most: float  # largest time of wormopt over theirs


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked, the answer, and who is asked."""

    title: str
    source: str  # where the answer comes from
    what: str  # what the error is that of
    setting: str  # what settings are
    goal: float  # error at which times are compared
    answer: np.ndarray
    ways: Sequence[Way]
    scale: float = 1.0  # what errors are told in
    far: float = math.inf  # error over setting of what is no answer
    targets: Sequence[Target] = ()

    def error(self, found: np.ndarray) -> float:
        """Largest error over the scale, infinite for what is no number."""
        error = float(np.abs(np.asarray(found) - self.answer).max()) / self.scale
        return error if math.isfinite(error) else math.inf


@dataclass
class Step:
    """A solver at a setting."""

    setting: float
    error: float
    times: list[float]


@dataclass
class Record:
    """What one solver did."""

    way: Way
    run: Run | None = None
    first: float = math.nan  # s to make it ready and run once
    memory: float | None = None  # bytes by which that made the process grow
    steps: list[Step] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    missing: str = ""

    @property
    def told(self) -> Found:
        """Ready for JSON."""
        steps = [
            {"setting": s.setting, "error": s.error, "time_s": median(s.times),
             "runs": len(s.times)} for s in self.steps
        ]  # fmt: skip
        return {"solver": self.way.name, "first_s": finite(self.first), "memory": self.memory,
                "points": steps, "failures": self.failures, "missing": self.missing}  # fmt: skip


def task_of(name: str, quick: bool = False) -> Task:
    """Look up what a benchmark asks."""
    found: Task = import_module(f"tests.benchmarks.{LADDERS[name]}").task(name, quick)
    return found


def measured(name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Measure a benchmark of `LADDERS`."""
    task = task_of(name, quick)
    head = {"title": task.title, "source": task.source, "what": task.what,
            "setting": task.setting, "goal": task.goal}  # fmt: skip

    def told(said: str, share: float | None = None) -> None:
        report(f"{name}: {said}", share)

    # First runs compile all but what is compiled once a machine: this is loaded now, and other
    # compiled code is looked for in a new folder.
    x = ca.SX.sym("x")
    simulate(Model("decay", x=[Signal("x", x, value=1.0)], ode=-x), 1.0)
    with TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):
        for records in measure(task, quick, told):
            found = head | {"solvers": [record.told for record in records]}
            yield found | {"targets": [_kept(target, found) for target in task.targets]}


def _kept(target: Target, found: Found) -> Found:
    """What has become of a target: our time over that of the fastest of its solvers."""
    ratio = max((r for name, r in ratios(found).items() if name in target.than), default=None)
    met = None if ratio is None else ratio <= target.most
    return {"than": list(target.than), "most": target.most, "ratio": ratio, "met": met}


def measure(task: Task, quick: bool, report: Report) -> Iterator[list[Record]]:
    """Ask all; first each in turn down its ladder, then all of them round after round.

    Yields the same list again, better known each time. `quick`: fewer rounds, and nobody who has
    taken half a second is asked for more.
    """
    records = [Record(way) for way in task.ways]
    rounds = _QUICK_ROUNDS if quick else _ROUNDS
    for k, record in enumerate(records):
        report(record.way.name, k / len(records) / rounds)
        _descend(task, record, _QUICK_LONGEST if quick else _LONGEST)
        yield records
    for turn in range(1, rounds):
        report(f"round {turn}", turn / rounds)
        for record in records:
            for step in record.steps:
                if record.run is not None and step.times[0] < (_REPEATED if turn == 1 else _SLOW):
                    step.times.append(timed(record.run, step.setting)[0])
        yield records


def _descend(task: Task, record: Record, longest: float) -> None:
    """Make a solver ready, run it once for its first time, then at each setting."""
    way = record.way

    def start() -> np.ndarray:
        record.run = way.make()
        return record.run(way.settings[0])

    try:
        (record.first, _), record.memory = growth(lambda: timed(start))
    except ImportError as error:
        record.missing = f"not installed: {error.name}"
        return
    except Exception as error:  # whatever a peer does wrong
        if record.run is None:
            record.failures.append(f"{way.settings[0]:.4g}: {why(error)}")
            return
    assert record.run is not None
    for setting in way.settings:
        try:
            time, answer = timed(record.run, setting)
            if time < _REPEATED:  # what is built once for a setting does not count
                time, answer = timed(record.run, setting)
        except Exception as error:
            record.failures.append(f"{setting:.4g}: {why(error)}")
            continue
        error = task.error(answer)
        most = _WRONG * max(float(np.abs(task.answer).max()), task.scale)
        if error * task.scale > most or error > task.far * setting:
            record.failures.append(f"{setting:.4g}: wrong without a word, error {error:.1e}")
        else:
            record.steps.append(Step(setting, error, [time]))
        if time > (_SLOW if error < task.goal / 3 else longest):
            return


# -- telling -------------------------------------------------------------------------------------


def time_at(points: Sequence[Mapping[str, Any]], error: float) -> float | None:
    """Interpolate the time of an error on the log-log curve of undominated points.

    None where no point is as good; where all are better, the time of the fastest.
    """
    front: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda p: (p["time_s"], p["error"])):
        if not front or point["error"] < front[-1][1]:
            front.append((point["time_s"], max(point["error"], 1e-300)))
    for k, (time, reached) in enumerate(front):
        if reached > error:
            continue
        if k == 0:
            return time
        before, worse = front[k - 1]
        share = math.log(worse / error) / math.log(worse / reached)
        return round(math.exp((1 - share) * math.log(before) + share * math.log(time)), 12)
    return None


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our time over that of each other solver, at the goal."""
    return compared({s["solver"]: time_at(s["points"], found["goal"]) for s in found["solvers"]})


def lines(found: Mapping[str, Any]) -> list[str]:
    """The solvers in a table, each at the goal and at its best, their failures, the targets."""
    ratio, goal = ratios(found), found["goal"]
    rows = [("solver", "first run", "memory", f"time at {goal:.0e}", "ours/theirs", "best error",
             "in")]  # fmt: skip
    for s in found["solvers"]:
        best = min(s["points"], key=lambda p: p["error"], default=None)
        if s["missing"] or best is None:
            continue
        rows.append((s["solver"], seconds(s["first_s"]), megabytes(s["memory"]),
                     seconds(time_at(s["points"], goal), "not reached"),
                     f"{ratio[s['solver']]:.3g}" if s["solver"] in ratio else "",
                     f"{best['error']:.1e}", seconds(best["time_s"])))  # fmt: skip
    told = [f"{found['case']}: {found['title']}", f"  answer: {found['source']}"]
    told += [*aligned(*rows), f"  error: {found['what']}; settings: {found['setting']}"]
    for s in found["solvers"]:
        told += [f"  {s['solver']}: {s['missing']}"] if s["missing"] else []
        told += [f"  {s['solver']} failed at {failure}" for failure in s["failures"]]
    for target in found["targets"]:
        than, at, met = " or ".join(target["than"]), target["ratio"], target["met"]
        end = "unknown" if at is None else f"{at:.4g}, {'met' if met else 'missed'}"
        told.append(f"  target: at most {target['most']:.4g} of {than}: {end}")
    return told


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw error against time of every solver to a PNG file."""
    figure, left = axes("time of a repeated run (s)", f"error: {found['what']}")
    left.axhline(found["goal"], color="#999999", linewidth=0.8, linestyle="--")
    for k, s in enumerate(found["solvers"]):
        points = [p | {"error": max(p["error"], 1e-17)} for p in s["points"]]
        if points:
            width = 2.2 if s["solver"] == OWN else 1.0
            curve(left, k, points, "time_s", "error", label=s["solver"], linewidth=width,
                  linestyle="-" if k < 8 else "--")  # fmt: skip
    beside = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "fontsize": 7.5}
    save(figure, path, f"{found['case']}: {found['title']}", **beside)
