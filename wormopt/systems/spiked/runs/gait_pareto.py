"""Runs scenes of kind ``gait-pareto``: the Pareto front between speed and a cost."""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.shared.checkpoints import checkpoints
from wormopt.systems.shared.sequences import Sequence_, canonical
from wormopt.systems.spiked.design.design import Design, objective_of
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.design_results import COST_SCALARS, of_design, refused
from wormopt.systems.spiked.motion import Findings
from wormopt.systems.spiked.scenes.gait_design import GaitParetoScene
from wormopt.systems.spiked.search.orders import is_mirror_symmetric
from wormopt.systems.spiked.task import Objective

# A limit binds if its slack is smaller than this share of its size.
_BINDS = 1e-6


def run(scene: Scene[GaitParetoScene], report: Report) -> Result:
    """Find the fastest gait, then the cheapest one at each of several lower speeds.

    Each search starts from the sequence of the next faster gait; points are cached for reruns.
    Raises SolveError if no fastest gait is found, Interrupted with the points so far.
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
        reason = f"interrupted after {len(points)} of {total} points; run again to continue"
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
        told = f"{total - index} of {total} points done: {text}"
        report(told, done + (fraction or 0.0) / total)

    goal = Objective() if speed is None else Objective(against, speed)
    try:
        found = designed(table.task(goal), table.search.search, on, hints)
    except SolveError as error:
        raise refused(error, scene) from None
    if found.ended == "interrupted":
        raise KeyboardInterrupt
    cost = {name: objective_of(found.motion, against)}
    known = Findings(cost, attributes={"binding": _binding(found)})
    result = (of_design(table, found) | known).result(scene)
    unfinished = folder.with_suffix(".part")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    result.save(unfinished)
    shutil.rmtree(folder, ignore_errors=True)
    unfinished.rename(folder)
    return _Point(result, name)


def _binding(found: Design) -> str:
    """List the limits that bind a gait, except those that every gait meets exactly."""
    exact = {"limits.resting", "limits.tick", "closed"}
    if np.size(found.task.limits.period) == 1:
        exact.add("limits.period")
    binding = [key for key, excess in found.violations.items() if excess > -_BINDS]
    return ", ".join(key.removeprefix("limits.") for key in binding if key not in exact)


def _front(
    scene: Scene[GaitParetoScene], points: list[_Point], lost: list[str], seconds: float
) -> Result:
    """Result of the whole front; a point is on it if it is accepted and not dominated."""
    against, unit = scene.table.pareto.against, points[0].result.scalars[points[0].cost].unit
    points = sorted(points, key=lambda p: p.speed)
    ok = np.array([p.result.status == "ok" for p in points])
    speed, value = np.array([p.speed for p in points]), np.array([p.value for p in points])
    beaten = np.array(
        # a faster gait of the same cost is better too
        [np.any(value[i + 1 :][ok[i + 1 :]] <= value[i] * (1 + 1e-9)) for i in range(len(points))]
    )
    accepted, order = ok & ~beaten, _orders(scene.table, points)
    at = _knee(speed, value, accepted)
    knee = points[at].result
    lost_points, reason = int(np.sum(~accepted)), "no point of the front was accepted"
    some_count = Check("points that do not count", lost_points, len(points) - 1, reason)
    scalars = {
        "front_objective": against,
        "front_points": int(accepted.sum()),
        "front_knee": at,
        "front_jumps": int(np.count_nonzero(np.diff(order[accepted]))),
        "speed_max": float(speed.max()),
        "front_speeds": speed.tolist(),
        "front_values": Scalar(value.tolist(), unit),
        "front_counted": accepted.tolist(),
        "front_sequences": [p.sequence for p in points],
        "front_resting": [p.result.scalars["resting_min"].value for p in points],
        "front_binding": [p.result.attributes["binding"] for p in points],
    }
    variables = {
        "front_speed": speed,
        "front_value": Variable("front_value", unit, ("point",), value, against.replace("_", " ")),
        "front_accepted": accepted,
        "front_order": order,
        **_gaits([p.result for p in points]),
    }
    front = conclude(
        scene,
        {**knee.scalars, **scalars},
        {variable.name: variable for variable in knee.variables} | variables,
        checks=(*knee.checks, some_count),
        facts={**knee.trust, "dominated": int(np.sum(beaten))},
        warnings=[*_warnings([p.result for p in points], at), *lost],
        timings={"front": seconds},
        attributes={"table": _table(scene, points, accepted, order, at)},
    )
    return front if some_count.passed else front.failed(reason)


def _orders(table: GaitParetoScene, points: list[_Point]) -> np.ndarray:
    """Number each point's resting sequence; equal up to rotation and mirroring."""
    mirror = is_mirror_symmetric(table.task(Objective()))
    words = [canonical(p.sequence, table.worm.links + 1, mirror=mirror) for p in points]
    numbers = {word: k for k, word in enumerate(dict.fromkeys(words))}
    return np.array([numbers[word] for word in words])


def _gaits(results: list[Result]) -> dict[str, np.ndarray]:
    """Stack the gaits of all points in one array each, padded with NaN."""
    breaks = [result["gait_breaks"].values for result in results]
    pieces = [result["gait_polynomial"].values for result in results]
    most = np.max([piece.shape for piece in pieces], axis=0)
    all_breaks = np.full((len(results), most[0] + 1), np.nan)
    all_pieces = np.full((len(results), *most), np.nan)
    for k, (at, piece) in enumerate(zip(breaks, pieces, strict=True)):
        all_breaks[k, : len(at)] = at
        all_pieces[k, : len(piece)] = 0.0  # powers missing in this gait
        all_pieces[k, : len(piece), :, : piece.shape[2]] = piece
    return {"front_gait_breaks": all_breaks, "front_gait_polynomial": all_pieces}


def _warnings(results: list[Result], knee: int) -> list[str]:
    """Warnings of the gait at the knee, and further warnings of other points."""
    own = results[knee].trust["warnings"]
    others = [
        f"point {k}: {told}"
        for k, result in enumerate(results)
        for told in result.trust["warnings"]
        if told not in own
    ]
    return [*own, *others]


def _table(
    scene: Scene[GaitParetoScene],
    points: list[_Point],
    accepted: np.ndarray,
    order: np.ndarray,
    knee: int,
) -> str:
    """The front in Markdown, from the slowest point to the fastest."""
    cost = points[0].cost
    units = [f" ({unit})" if unit != "1" else "" for unit in (
        points[0].result.scalars["speed"].unit, points[0].result.scalars[cost].unit
    )]  # fmt: skip
    name = scene.table.pareto.against.replace("_", " ")
    head = ("point", f"speed{units[0]}", f"{name}{units[1]}", "resting masses, phase by phase",
            "cycles", "limits that bind", "")  # fmt: skip
    rows, before = [], None
    for k, point in enumerate(points):
        notes = ["knee"] * (k == knee)
        if not accepted[k]:
            failed = point.result.status != "ok"
            notes.append("not accepted" if failed else "dominated by a faster gait")
        else:
            notes += ["new resting sequence"] * (before not in (None, order[k]))
            before = order[k]
        masses = ", ".join("+".join(map(str, resting)) for resting in point.sequence)
        cycles, binding = point.result.scalars["cycles"].value, point.result.attributes["binding"]
        numbers = (str(k), f"{point.speed:.6g}", f"{point.value:.6g}")
        rows.append((*numbers, masses, str(cycles), binding, "; ".join(notes)))
    widths = [max(3, *map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [head, tuple("-" * width for width in widths), *rows]
    return "".join(
        f"| {' | '.join(cell.ljust(w) for cell, w in zip(line, widths, strict=True))} |\n"
        for line in lines
    )


def _knee(speed: np.ndarray, value: np.ndarray, accepted: np.ndarray) -> int:
    """Index of the accepted point farthest below the line that joins the front's ends."""
    candidates = np.flatnonzero(accepted) if accepted.any() else np.arange(len(speed))
    if len(candidates) < 3:
        return int(candidates[-1])
    x, y = speed[candidates], value[candidates]
    x, y = (x - x[0]) / (np.ptp(x) or 1.0), (y - y[0]) / (np.ptp(y) or 1.0)
    return int(candidates[np.argmax(x * y[-1] - y)])
