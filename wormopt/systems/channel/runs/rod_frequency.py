"""Scenes of kind ``rod-frequency``: how fast a rod crawls over the frequency of its coils."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.numerics.compass import Look, compass
from wormopt.progress import Report
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.channel.runs.rod_case import ASSUMED, RodCase, warnings_of_case
from wormopt.systems.channel.runs.rod_course import (
    RodPoint,
    change_of,
    faults_of_motion,
    faults_of_recheck,
    finer,
)
from wormopt.systems.channel.runs.rod_response import Response, response_scalars, response_variables
from wormopt.systems.channel.runs.rod_runs import forget, kept, rod_points
from wormopt.systems.channel.scenes.rod_frequency import RodFrequencyScene
from wormopt.systems.shared.checkpoints import checkpoints

_STEPS = {"rate": 0.25, "duration": 0.5, "shift": 0.3}
_TABLES = {
    "youngs_modulus": "worm",
    "density": "worm",
    "damping_time": "worm",
    "susceptibility": "worm",
    "friction": "channel",
    "coil_outer": "coils",
    "coil_clearance": "coils",
}


def run(scene: Scene[RodFrequencyScene], report: Report) -> Result:
    """Follow the rod at all frequencies, seek the best one, and see what it all depends on.

    Motions are cached, so a stopped run resumes. Status "failed": a motion lost or faulty,
    or the best velocity depends on step or mesh. Raises SolveError if all are lost.
    """
    table, begin = scene.table, perf_counter()
    case = RodCase(
        table.worm, table.channel, table.coils, table.switching, table.mesh, table.course, 1.0
    )
    study = _Study(table, case, checkpoints("rods"), report)
    try:
        found = study.explore()
    except KeyboardInterrupt:
        found = Response(case, study.kept_curve())
        if not any(not point.reason for point in found.curve):
            raise Interrupted from None
        reason = "interrupted; run again to go on"
        partial = _result(scene, found, perf_counter() - begin)
        raise Interrupted(replace(partial, status="failed", reason=reason)) from None
    forget(study.followed, checkpoints("rods"))
    return _result(scene, found, perf_counter() - begin)


class _Study:
    """The stages of the study; all of them follow rods and keep what these come to."""

    def __init__(
        self, table: RodFrequencyScene, case: RodCase, folder: Path, report: Report
    ) -> None:
        self.followed: list[RodCase] = []
        self._table, self._case, self._folder, self._report = table, case, folder, report

    def kept_curve(self) -> list[RodPoint]:
        """What is known of the curve so far."""
        cases = (replace(self._case, rate=rate) for rate in self._table.rates)
        return [point for one in cases if (point := kept(one, self._folder))]

    def explore(self) -> Response:
        """Go through all stages."""
        table, case = self._table, self._case
        curve = self._points(
            [replace(case, rate=rate) for rate in table.rates], "velocity over frequency"
        )
        if all(point.reason for point in curve):
            raise SolveError(curve[0].reason, "write a shorter mesh.step")
        found = Response(case, curve)
        if table.search:
            rates = _near_best(found, table.search.refine)
            found.refined = self._points([replace(case, rate=r) for r in rates], "best frequency")
        best = replace(case, rate=found.best.rate)
        if table.search and table.search.rounds:
            found.centres = self._best_pattern(best, table.search.rounds, found)
        if table.sensitivity:
            self._change(found)
        others = {
            "on a finer mesh": finer(best, math.ceil(1.5 * case.mesh.elements)),
            "with half the step": finer(best),
        }
        points = self._points(list(others.values()), "again, more finely")
        found.again = dict(zip(others, points, strict=True))
        return found

    def _points(self, cases: Sequence[RodCase], text: str) -> list[RodPoint]:
        self.followed += cases
        return rod_points(cases, self._folder, self._report, text)

    def _best_pattern(self, case: RodCase, rounds: int, found: Response) -> list[Look]:
        """Seek frequency, duration and shift of the switching by compass search."""

        def look(points: Sequence[dict[str, float]]) -> list[Look]:
            cases = [
                replace(
                    case.varied(pattern={"duration": point["duration"], "shift": point["shift"]}),
                    # so many digits that the same frequency is the same motion again
                    rate=float(f"{math.exp(point['rate']):.4g}"),
                )
                for point in points
            ]
            looks = self._points(cases, "best pattern")
            found.patterns += looks
            return [
                Look(point, -math.inf if one.reason else -one.velocity, one.error)
                for point, one in zip(points, looks, strict=True)
            ]

        start = {
            "rate": math.log(case.rate),
            "duration": case.pattern.duration,
            "shift": case.pattern.shift,
        }
        bounds = {
            "rate": (math.log(case.rate / 4), math.log(4 * case.rate)),
            "duration": (1.5, min(5.0, case.pattern.every - 1.6)),
            "shift": (-0.6, 0.6),
        }
        return compass(look, start, _STEPS, bounds, rounds)

    def _change(self, found: Response) -> None:
        """Change doubtful numbers one at a time."""
        assert self._table.sensitivity is not None
        todo: dict[tuple[str, float, float], tuple[float, RodCase]] = {}
        for rate in self._table.sensitivity.rates:
            own = replace(self._case, rate=rate)
            todo["none", 1.0, rate] = 1.0, own
            for name in self._table.sensitivity.parameters:
                for factor in self._table.sensitivity.factors:
                    todo[name, factor, rate] = _changed(own, name, factor)
        points = self._points([one for _, one in todo.values()], "sensitivity")
        taken = [factor for factor, _ in todo.values()]
        found.changed = dict(zip(todo, zip(taken, points, strict=True), strict=True))


def _near_best(found: Response, count: int) -> list[float]:
    """Frequencies between the neighbours of the best one."""
    rates = [point.rate for point in found.curve]
    k = rates.index(found.best.rate)
    low, high = rates[max(k - 1, 0)], rates[min(k + 1, len(rates) - 1)]
    between = np.geomspace(low, high, count + 2)[1:-1]
    return [float(f"{rate:.4g}") for rate in between if rate not in rates]


def _changed(case: RodCase, name: str, factor: float) -> tuple[float, RodCase]:
    """Change one number; also tells by how much, where there is no room for all of it."""
    table, key = _TABLES[name], name.removeprefix("coil_")
    old = getattr(getattr(case, table), key)
    new = old * factor
    if name == "coil_outer":
        new = min(max(new, 1.05 * case.coils.inner), case.coils.pitch)
    return new / old, case.varied(**{table: {key: new}})


def _result(scene: Scene[RodFrequencyScene], found: Response, seconds: float) -> Result:
    table = scene.table
    faults = list(_faults(table, found))
    points = [point for point in found.points if not point.reason]
    best = replace(found.case, rate=found.best.rate)
    return Result(
        scene.name,
        table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=response_scalars(table, found),
        variables=tuple(response_variables(table, found)),
        trust={
            "energy_error": max(point.energy_error for point in points),
            "penetration_share": max(point.penetration for point in points),
            "field_error": max(point.field_error for point in points),
            "recheck_velocity_change": change_of(best, found.best, found.again.values()),
            "accepted": table.accepted,
            "motions": len(found.points),
            "assumptions": dict(ASSUMED),
            "warnings": [*_warnings(found), *warnings_of_case(found.case)],
        },
        timings_s={"all": seconds, "slowest_motion": max(point.seconds for point in points)},
        scene_text=scene.text,
        attributes={
            "measured": [[one.rate, one.velocity, one.text] for one in table.measured],
            "parameters": list(table.sensitivity.parameters) if table.sensitivity else [],
        },
    )


def _faults(table: RodFrequencyScene, found: Response) -> Iterator[str]:
    for point in dict.fromkeys(found.points):
        yield from faults_of_motion(point)
    best = replace(found.case, rate=found.best.rate)
    for what, point in found.again.items():
        if not point.reason:
            yield from faults_of_recheck(best, found.best, point, table.accepted, what)


def _warnings(found: Response) -> Iterator[str]:
    known = [point for point in found.curve if not point.reason]
    unsure = [p.rate for p in known if p.error > max(0.1 * abs(p.velocity), 1e-3)]
    for rates, text in (
        (unsure, "the motion is irregular at {}: its mean is not known to a tenth"),
        ([p.rate for p in known if not p.settled], "the motion has not settled at {}"),
    ):
        if rates:
            listed = ", ".join(f"{rate:g}" for rate in rates)
            yield text.format(f"{listed} switches a second") + "; write a longer course.duration"
