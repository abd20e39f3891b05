"""Planar stops and crawls: the error of each solver at each setting, and what it costs.

The error counts in the places at the end, and for motions that end at rest also in the time of the
stop. Solvers run in turn, round after round; the median of their times counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from tests.benchmarks import planar_crawl
from tests.benchmarks.memory import growth, megabytes
from tests.benchmarks.planar_mujoco import by_mujoco
from tests.benchmarks.planar_rivals import Solver, by_scipy, by_smoothing
from tests.benchmarks.planar_tasks import TASKS, Task
from tests.benchmarks.run import (
    OWN,
    Found,
    aligned,
    axes,
    compared,
    curves,
    finite,
    least,
    save,
    seconds,
    timed,
    why,
)
from wormopt.progress import Report
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate

_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_STEPS = (1e-2, 1e-3, 1e-4)
_ROUNDS, _SLOW = 5, 3.0  # runs of each; seconds from which a solver is asked once, and no further
_PREFIX = "planar_"
_GOAL = 1e-6  # error in places at which times are compared
_CRAWL = "crawl"
Asked = Task | planar_crawl.CrawlTask


@dataclass
class _Row:
    """A solver at a setting."""

    solver: str
    setting: float
    run: Solver
    memory: float | None  # bytes by which the solver's first run made the process grow
    times: list[float] = field(default_factory=list)
    error: float = math.nan
    stop_error: float = math.nan

    def ask(self, task: Asked) -> float:
        """Run it once more; the seconds it took."""
        time, (end, stop) = timed(self.run, self.setting)
        self.times.append(time)
        self.error = float(np.abs(end[: len(task.end)] - task.end).max())
        self.stop_error = abs(stop - task.stop)
        return time

    @property
    def told(self) -> Found:
        """Ready for JSON."""
        return {"solver": self.solver, "setting": self.setting, "error": finite(self.error),
                "stop_error": finite(self.stop_error), "seconds": median(self.times),
                "memory": self.memory}  # fmt: skip


def _wormopt(task: Task) -> Solver:
    model = task.build()

    def run(tolerance: float) -> tuple[np.ndarray, float]:
        asked = Tolerance(tolerance, 0.1 * tolerance)
        motion = simulate(model, task.span, tolerance=asked)
        last = motion.events[-1].time if motion.events and not math.isnan(task.stop) else math.nan
        return motion.end, last

    return run


def _solvers(task: Task) -> dict[str, tuple[Any, tuple[float, ...]]]:
    """What makes each solver, and its settings."""
    # explicit steps after a release would be many thousand
    methods = ("DOP853", "Radau", "LSODA") if task.name != "triangle" else ("Radau", "LSODA")
    found: dict[str, Any] = {OWN: (_wormopt, _TOLERANCES)}
    found |= {f"SciPy {m}, events": (partial(by_scipy, method=m), _TOLERANCES) for m in methods}
    if task.worm is not None:
        found["SciPy Radau, steep"] = by_smoothing, _TOLERANCES
    found["MuJoCo, tuned"] = by_mujoco, _STEPS
    found["MuJoCo as it comes"] = partial(by_mujoco, tuned=False), _STEPS
    return found


def measured(name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Go down the ladder of every solver, then repeat all rows in turn.

    `quick`: three settings, no repetition.
    """
    crawls = name == _PREFIX + _CRAWL
    task: Asked = planar_crawl.THREE_LINKS if crawls else TASKS[name.removeprefix(_PREFIX)]
    rows, missing = list[_Row](), list[str]()
    told: Found = {"title": task.title, "source": task.source, "stop": finite(task.stop)}
    solvers = _solvers(task) if isinstance(task, Task) else planar_crawl.solvers()
    for k, (solver, (make, settings)) in enumerate(solvers.items()):
        report(f"{name}: {solver}", k / len(solvers) / _ROUNDS)
        try:
            run = make(task)
        except ImportError as error:
            missing.append(f"{solver}: not installed: {error.name}")
            continue
        memory = None
        for n, setting in enumerate(settings[: 3 if quick else None]):
            try:
                if n == 0:  # compiles
                    _, memory = growth(partial(run, setting))
                row = _Row(solver, setting, run, memory)
                slow = row.ask(task) > (0.5 if quick else _SLOW)
            except Exception as error:
                missing.append(f"{solver} failed at {setting:.0e}: {why(error)[:150]}")
                continue
            rows.append(row)
            if slow:
                break
        yield told | {"rows": [row.told for row in rows], "missing": missing}
    for turn in range(1, 1 if quick else _ROUNDS):
        report(f"{name}: round {turn}", turn / _ROUNDS)
        for row in rows:
            if row.times[0] < _SLOW:
                row.ask(task)
        yield told | {"rows": [row.told for row in rows], "missing": missing}


def ratios(found: Mapping[str, Any]) -> dict[str, float]:
    """Our fastest run over that of every other solver, of those that are good enough."""
    return compared(least((r["solver"], r["seconds"]) for r in found["rows"] if _good(r)))


def lines(found: Mapping[str, Any]) -> list[str]:
    """Errors and times in a table."""
    own = [r["seconds"] for r in found["rows"] if r["solver"] == OWN and _good(r)]
    rows = [("solver", "setting", "error of places", "of the stop", "time", "ours/theirs",
             "memory")]  # fmt: skip
    for r in found["rows"]:
        off = "" if r["stop_error"] is None else f"{r['stop_error']:.0e}"
        error = "not a number" if r["error"] is None else f"{r['error']:.1e}"
        ratio = f"{min(own) / r['seconds']:.3g}" if own and _good(r) else ""
        rows.append((r["solver"], f"{r['setting']:.4g}", error, off, seconds(r["seconds"]), ratio,
                     megabytes(r["memory"])))  # fmt: skip
    told = [f"{found['case']}: {found['title']}", f"  reference: {found['source']}"]
    told += aligned(*rows)
    crawls = found["case"] == _PREFIX + _CRAWL
    what = "instants in a stroke" if crawls else "relative tolerances, of MuJoCo time steps"
    told.append(f"  settings are {what}; ours/theirs: our fastest run over theirs,")
    told.append(f"  of those with errors of at most {_GOAL:.0e}")
    return told + [f"  {reason}" for reason in found["missing"]]


def _good(row: Mapping[str, Any]) -> bool:
    return row["error"] is not None and row["error"] <= _GOAL


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw error against time of every solver to a PNG file."""
    figure, left = axes("time of a warm run (s)", "error of the places at the end")
    curves(left, [r for r in found["rows"] if r["error"]], "solver", "seconds", "error")
    beside = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "fontsize": 7.5}
    save(figure, path, f"{found['case']}: {found['title']}", **beside)
