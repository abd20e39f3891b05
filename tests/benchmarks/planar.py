"""Planar stops and crawls: time against error of the places at the end, beside SciPy and MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tests.benchmarks import planar_crawl
from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.planar_mujoco import by_mujoco
from tests.benchmarks.planar_rivals import Solver, by_scipy, by_smoothing
from tests.benchmarks.planar_tasks import TASKS, Stop
from tests.benchmarks.run import OWN
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate

_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_STEPS = (1e-2, 1e-3, 1e-4)

Makers = dict[str, tuple[Callable[[Any], Solver], tuple[float, ...]]]
"""What makes each solver, and its settings."""


def task(name: str, quick: bool) -> Task:
    """A motion that ends at rest, or a stroke; `quick`: three settings of each solver."""
    motion = name.removeprefix("planar_")
    crawls = motion == "crawl"
    asked = planar_crawl.THREE_LINKS if crawls else TASKS[motion]
    makers = planar_crawl.solvers() if crawls else _solvers(TASKS[motion])
    ways = [
        Way(solver, partial(_ends, make, asked), settings[: 3 if quick else None])
        for solver, (make, settings) in makers.items()
    ]
    setting = "instants in a stroke" if crawls else "relative tolerance, of MuJoCo the time step"
    return Task(asked.title, asked.source, "places at the end", setting, 1e-6, asked.end, ways)


def _ends(make: Callable[[Any], Solver], asked: Stop | planar_crawl.CrawlTask) -> Run:
    run = make(asked)
    return lambda setting: run(setting)[0][: len(asked.end)]


def _wormopt(stop: Stop) -> Solver:
    model = stop.build()

    def run(tolerance: float) -> tuple[np.ndarray, float]:
        motion = simulate(model, stop.span, tolerance=Tolerance(tolerance, 0.1 * tolerance))
        return motion.end, math.nan

    return run


def _solvers(stop: Stop) -> Makers:
    # explicit steps after a release would be many thousand
    methods = ("DOP853", "Radau", "LSODA") if stop.name != "triangle" else ("Radau", "LSODA")
    found: Makers = {OWN: (_wormopt, _TOLERANCES)}
    found |= {f"SciPy {m}, events": (partial(by_scipy, method=m), _TOLERANCES) for m in methods}
    if stop.worm is not None:
        found["SciPy Radau, steep"] = by_smoothing, _TOLERANCES
    found["MuJoCo, tuned"] = by_mujoco, _STEPS
    found["MuJoCo as it comes"] = partial(by_mujoco, tuned=False), _STEPS
    return found
