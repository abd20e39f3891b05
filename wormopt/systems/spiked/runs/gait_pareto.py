"""Scenes of kind ``gait-pareto``: the front of the best gaits between speed and a cost."""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.progress import Report
from wormopt.quantities import Variable
from wormopt.result import Check, Result, conclude
from wormopt.scene.scene import Scene
from wormopt.systems.shared.checkpoints import checkpoints
from wormopt.systems.spiked.design.design import objective_of
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.runs.gait_design import COST_SCALARS, of_design, refused
from wormopt.systems.spiked.runs.motion import Findings
from wormopt.systems.spiked.scenes.gait_design import GaitParetoScene
from wormopt.systems.spiked.sequences import Sequence_
from wormopt.systems.spiked.task import Objective


def run(scene: Scene[GaitParetoScene], report: Report) -> Result:
    """Find the fastest gait, then the cheapest one at each of several lower speeds.

    Each search starts from the next faster gait's sequence; points are cached for reruns.
    Raises SolveError where no fastest gait is found, Interrupted with the points so far.
    """
    clock = perf_counter()
    saved = checkpoints("fronts", __name__) / scene.key
    points, lost = [], []
    total = scene.table.pareto.points
    try:
        points.append(_point(scene, saved, total, None, [], report))
        # The fastest gait need not be the cheapest of its speed: the next is almost as fast.
        speeds = points[0].speed * np.array([0.99, *np.arange(total - 2, 0, -1) / (total - 1)])
        for k, speed in zip(range(total - 1, 0, -1), speeds.tolist(), strict=True):
            try:
                points.append(_point(scene, saved, k, speed, [points[-1].sequence], report))
            except SolveError as error:
                lost.append(f"no gait at speed {speed:.6g}: {error}")
    except KeyboardInterrupt:
        if not points:
            raise Interrupted from None
        partial = _front(scene, points, lost, perf_counter() - clock)
        reason = f"interrupted after {len(points)} of {total} points; run again to go on"
        raise Interrupted(partial.failed(reason)) from None
    shutil.rmtree(saved, ignore_errors=True)
    return _front(scene, points, lost, perf_counter() - clock)


@dataclass(frozen=True)
class _Point:
    """One designed gait of the front."""

    result: Result
    cost: str

    @property
    def speed(self) -> float:
        return float(self.result.scalars["speed"].value)

    @property
    def sequence(self) -> Sequence_:
        return tuple(tuple(phase) for phase in self.result.trust["solver"]["sequence"])

    @property
    def value(self) -> float:
        return float(self.result.scalars[self.cost].value)


def _point(
    scene: Scene[GaitParetoScene],
    saved: Path,
    index: int,
    speed: float | None,
    hints: list[Sequence_],
    report: Report,
) -> _Point:
    """Design one gait, or read it back from an earlier run of the same scene."""
    table = scene.table
    against, total = table.pareto.against, table.pareto.points
    name = COST_SCALARS[against]
    folder = saved / f"point_{index}"
    done = (total - index) / total
    with suppress(OSError, ValueError):  # not there, or damaged: design it again
        return _Point(Result.load(folder), name)

    def on(text: str, fraction: float | None) -> None:
        report(f"point {total - index + 1} of {total}: {text}", done + (fraction or 0.0) / total)

    goal = Objective() if speed is None else Objective(against, speed)
    try:
        found = designed(table.task(goal), table.search.search, on, hints)
    except SolveError as error:
        raise refused(error, scene) from None
    if found.ended == "interrupted":
        raise KeyboardInterrupt
    cost = {name: objective_of(found.motion, against)}
    result = (of_design(table, found) | Findings(cost)).result(scene)
    unfinished = folder.with_suffix(".part")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    result.save(unfinished)
    shutil.rmtree(folder, ignore_errors=True)
    unfinished.rename(folder)
    return _Point(result, name)


def _front(
    scene: Scene[GaitParetoScene], points: list[_Point], lost: list[str], seconds: float
) -> Result:
    """Result of the whole front: a point counts if it is accepted and none dominates it."""
    against = scene.table.pareto.against
    points = sorted(points, key=lambda p: p.speed)
    ok = np.array([p.result.status == "ok" for p in points])
    speed, value = np.array([p.speed for p in points]), np.array([p.value for p in points])
    beaten = np.array(
        [np.any(value[i + 1 :][ok[i + 1 :]] < value[i] * (1 - 1e-9)) for i in range(len(points))]
    )
    accepted = ok & ~beaten
    knee = points[_knee(speed, value, accepted)].result
    lost_points, reason = int(np.sum(~accepted)), "no point of the front was accepted"
    some_count = Check("points that do not count", lost_points, len(points) - 1, reason)
    unit = knee.scalars[points[0].cost].unit
    front = conclude(
        scene,
        {
            **knee.scalars,
            "front_objective": against,
            "front_points": int(accepted.sum()),
            "speed_max": float(speed.max()),
        },
        {
            **{variable.name: variable for variable in knee.variables},
            "front_speed": speed,
            "front_value": Variable(
                "front_value", unit, ("point",), value, against.replace("_", " ")
            ),
            "front_accepted": accepted,
        },
        checks=(*knee.checks, some_count),
        facts={**knee.trust, "dominated": int(np.sum(beaten))},
        warnings=[*knee.trust["warnings"], *lost],
        timings={"front": seconds},
    )
    return front if some_count.passed else front.failed(reason)


def _knee(speed: np.ndarray, value: np.ndarray, accepted: np.ndarray) -> int:
    """Index of the accepted point farthest below the line that joins the front's ends."""
    candidates = np.flatnonzero(accepted) if accepted.any() else np.arange(len(speed))
    if len(candidates) < 3:
        return int(candidates[-1])
    x, y = speed[candidates], value[candidates]
    x, y = (x - x[0]) / (np.ptp(x) or 1.0), (y - y[0]) / (np.ptp(y) or 1.0)
    return int(candidates[np.argmax(x * y[-1] - y)])
