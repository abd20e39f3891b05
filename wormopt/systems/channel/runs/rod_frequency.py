"""Runs of kind ``rod-frequency``: velocity of a rod over the frequency of its coils."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.analysis.vibration import VibrationModes, vibration_modes
from wormopt.errors import Interrupted, SolveError
from wormopt.numerics.compass import Look, compass
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.channel.closed_forms import SHAPES, ChannelWorm
from wormopt.systems.channel.rod_model import channel_rod
from wormopt.systems.channel.runs.rod_case import ASSUMED, RodCase
from wormopt.systems.channel.runs.rod_course import (
    RodPoint,
    change_of,
    checks_of_change,
    checks_of_motion,
    finer,
    follow,
    forget,
    kept,
    rod_points,
)
from wormopt.systems.channel.scenes.rod_frequency import RodFrequencyScene, SensitivityTable
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
_MODES = 4
# The velocity has rolled off below this share of that extrapolated from the slowest switching; the
# rod stands still below this share of the best velocity, errors included.
_ROLLED, _STILL = 0.5, 0.02


def run(scene: Scene[RodFrequencyScene], report: Report) -> Result:
    """Simulate the rod at all frequencies, find the best one, and its sensitivities.

    Motions are cached, so a stopped run resumes. Status "failed" if a motion fails, or if the best
    velocity depends on step or mesh. Raises SolveError if all motions fail.
    """
    table, begin = scene.table, perf_counter()
    case = RodCase(
        table.worm, table.channel, table.coils, table.switching, table.mesh, table.course, 1.0
    )
    folder = checkpoints("rods", follow.__module__)
    study = _Study(table, case, folder, report)
    try:
        found = study.explore()
    except KeyboardInterrupt:
        found = Response(case, study.kept_curve())
        if not any(not point.reason for point in found.curve):
            raise Interrupted from None
        partial = _result(scene, found, perf_counter() - begin)
        raise Interrupted(partial.failed("interrupted; run again to resume")) from None
    forget(study.followed, folder)
    return _result(scene, found, perf_counter() - begin)


@dataclass(eq=False)
class Response:
    """Motions of a rod, stage by stage."""

    case: RodCase  # the rod, at any frequency
    curve: list[RodPoint]  # over the frequencies of the scene
    refined: list[RodPoint] = field(default_factory=list)  # near the best of these
    patterns: list[RodPoint] = field(default_factory=list)  # with other patterns
    centres: list[Look] = field(default_factory=list)  # of the search for a pattern
    # by (parameter, factor, frequency): actual factor, motion
    changed: dict[tuple[str, float, float], tuple[float, RodPoint]] = field(default_factory=dict)
    # the best motion on another mesh, and with another step
    again: dict[str, RodPoint] = field(default_factory=dict)

    @property
    def points(self) -> list[RodPoint]:
        """All motions."""
        others = [point for _, point in self.changed.values()]
        return [*self.curve, *self.refined, *self.patterns, *others, *self.again.values()]

    @property
    def best(self) -> RodPoint:
        """Return the fastest motion against the field on the curve and near its best point."""
        known = [point for point in (*self.curve, *self.refined) if not point.reason]
        return min(known, key=lambda point: point.velocity)

    def stands(self, point: RodPoint) -> bool:
        """Return whether the rod certainly stands still, error included."""
        slow = _STILL * abs(self.best.velocity)
        return not point.direction and abs(point.velocity) + point.error <= slow


class _Study:
    """Stages of the study, each with several motions."""

    def __init__(
        self, table: RodFrequencyScene, case: RodCase, folder: Path, report: Report
    ) -> None:
        self.followed: list[RodCase] = []
        self._table, self._case, self._folder, self._report = table, case, folder, report

    def kept_curve(self) -> list[RodPoint]:
        """Return the saved points of the curve."""
        cases = (replace(self._case, rate=rate) for rate in self._table.rates)
        return [point for one in cases if (point := kept(one, self._folder))]

    def explore(self) -> Response:
        """Run all stages."""
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
        """Find frequency, duration and shift of the switching by compass search."""

        def look(points: Sequence[dict[str, float]]) -> list[Look]:
            cases = [
                replace(
                    case.varied(pattern={"duration": point["duration"], "shift": point["shift"]}),
                    # rounded, so that the same frequency is the same motion again
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
        """Change assumed parameters one at a time."""
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
    """Return frequencies between the neighbours of the best one."""
    rates = [point.rate for point in found.curve]
    k = rates.index(found.best.rate)
    low, high = rates[max(k - 1, 0)], rates[min(k + 1, len(rates) - 1)]
    between = np.geomspace(low, high, count + 2)[1:-1]
    return [float(f"{rate:.4g}") for rate in between if rate not in rates]


def _changed(case: RodCase, name: str, factor: float) -> tuple[float, RodCase]:
    """Return the changed parameter and the actual factor, which the available room may limit."""
    table, key = _TABLES[name], name.removeprefix("coil_")
    old = getattr(getattr(case, table), key)
    new = old * factor
    if name == "coil_outer":
        new = min(max(new, 1.05 * case.coils.inner), case.coils.pitch)
    return new / old, case.varied(**{table: {key: new}})


def _result(scene: Scene[RodFrequencyScene], found: Response, seconds: float) -> Result:
    table, best = scene.table, found.best
    points = [point for point in found.points if not point.reason]
    case = replace(found.case, rate=best.rate)
    return conclude(
        scene,
        _scalars(table, found),
        _variables(table, found),
        checks=_checks(table, found, case),
        facts={
            "energy_error": max(point.energy_error for point in points),
            "penetration_share": max(point.penetration for point in points),
            "field_error": max(point.field_error for point in points),
            "recheck_velocity_change": change_of(case, best, found.again.values()),
            "accepted": table.accepted,
            "motions": len(found.points),
            "assumptions": ASSUMED,
        },
        warnings=(*_warnings(found), *found.case.warnings()),
        timings={"all": seconds, "slowest_motion": max(point.seconds for point in points)},
        attributes={
            "measured": [[one.rate, one.velocity, one.text] for one in table.measured],
            "parameters": list(table.sensitivity.parameters) if table.sensitivity else [],
        },
    )


def _checks(table: RodFrequencyScene, found: Response, best: RodCase) -> Iterator[Check]:
    """Yield the checks of failed motions, of the worst others, and of the best one refined."""
    fine: dict[str, Check] = {}
    for number, point in enumerate(dict.fromkeys(found.points)):
        for check in checks_of_motion(point):
            if not check.passed:
                yield replace(check, name=f"{check.name} of motion {number}")
            elif (check.value or 0.0) >= (fine.get(check.name, check).value or 0.0):
                fine[check.name] = check
    yield from fine.values()
    for what, point in found.again.items():
        if not point.reason:
            yield from checks_of_change(best, found.best, point, table.accepted, what)


def _warnings(found: Response) -> Iterator[str]:
    known = [point for point in found.curve if not point.reason]
    unsure = [p.rate for p in known if p.error > max(0.1 * abs(p.velocity), 1e-3)]
    for rates, text in (
        (unsure, "the motion is irregular at {}: the error of its mean exceeds a tenth"),
        ([p.rate for p in known if not p.settled], "the mean has not converged at {}"),
    ):
        if rates:
            listed = ", ".join(f"{rate:g}" for rate in rates)
            yield text.format(f"{listed} switches per second") + "; write a longer course.duration"


# -- contents of the result ------------------------------------------------------------------------


def _scalars(table: RodFrequencyScene, found: Response) -> dict[str, Any]:
    curve, best, case = found.curve, found.best, found.case
    first = curve[0] if curve[0].rate == table.rates[0] else RodPoint.lost(table.rates[0], "")
    worm = ChannelWorm(
        case.coils.pitch, case.channel.diameter, case.worm.diameter, case.worm.length
    )
    values = {
        "velocity_mean": [point.velocity for point in curve],
        "velocity_error": [point.error for point in curve],
        "direction": [point.direction for point in curve],
        "frequency_best": best.rate,
        "velocity_best": best.velocity,
        "velocity_best_error": best.error,
        "velocity_per_frequency_slow": first.velocity / first.rate,
        "velocity_per_frequency_32": [-worm.velocity_per_frequency(shape) for shape in SHAPES],
        "arc_length_slow": first.arc_length,
        "energy_error": max(p.energy_error for p in found.points if not p.reason),
        "rolloff_frequency": _rolloff(found, first),
        "standstill_frequencies": [p.rate for p in curve if found.stands(p)],
        "forward_frequencies": [p.rate for p in curve if p.direction > 0],
        **_eigenfrequencies(case),
        **_pattern(found),
    }
    if table.sensitivity and found.changed:
        rates = list(table.sensitivity.rates)
        values["sensitive_rates"] = rates
        values["sensitive_to"] = [_largest_change(found, rate) for rate in rates]
    return values | case.assumed


def _rolloff(found: Response, first: RodPoint) -> float | None:
    """Return the first frequency with a velocity far below the initial slope, against the field."""
    if first.direction != -1:
        return None
    least = _ROLLED * first.velocity / first.rate
    rolled = [p.rate for p in found.curve if p.velocity / p.rate > least]
    return rolled[0] if rolled else None


def _eigenfrequencies(case: RodCase) -> dict[str, list[float]]:
    """Return those of the rod, free and with pinned ends, and of one pitch of it, in Hz."""
    rod = case.rod
    whole, part = (
        channel_rod(one, case.channel.diameter, case.channel.friction)
        for one in (rod, replace(rod, length=case.coils.pitch))
    )
    ends = {"across": [0, rod.count - 1]}
    return {
        "eigenfrequencies": _above_zero(vibration_modes(whole, count=_MODES + 3, rigid=3)),
        "eigenfrequencies_pinned": _above_zero(
            vibration_modes(whole, ends, count=_MODES + 1, rigid=1)
        ),
        "eigenfrequencies_segment": _above_zero(vibration_modes(part, ends, count=2, rigid=1)),
    }


def _above_zero(modes: VibrationModes) -> list[float]:
    return modes.frequencies[modes.frequencies > 0][:_MODES].tolist()


def _pattern(found: Response) -> dict[str, Any]:
    if not found.centres:
        return {}
    first, last = found.centres[0], found.centres[-1]
    return {
        "pattern_rate": math.exp(last.point["rate"]),
        "pattern_duration": last.point["duration"],
        "pattern_shift": last.point["shift"],
        "pattern_velocity": -last.value,
        "pattern_velocity_error": last.error,
        "pattern_gain": last.value / first.value - 1 if first.value > 0 else None,
    }


def _largest_change(found: Response, rate: float) -> str | None:
    """Return the parameter with the largest effect on the velocity, None if all are in error."""
    base = found.changed["none", 1.0, rate][1]
    moves = {
        name: abs(point.velocity - base.velocity)
        for (name, _, where), (_, point) in sorted(
            found.changed.items(), key=lambda item: abs(item[1][1].velocity - base.velocity)
        )
        if where == rate
        and abs(point.velocity - base.velocity) > math.hypot(point.error, base.error)
    }
    return max(moves, key=lambda name: moves[name], default=None)


def _variables(table: RodFrequencyScene, found: Response) -> dict[str, np.ndarray]:
    values: dict[str, Any] = {}
    for name, points in (("curve", found.curve), ("refined", found.refined)):
        if points:
            for key in ("rate", "velocity", "error", "arc_length"):
                values[f"{name}_{key}"] = [getattr(point, key) for point in points]
    if table.sensitivity and found.changed:
        values |= _changes(table.sensitivity, found)
    if found.centres:
        values["centre_rate"] = [math.exp(look.point["rate"]) for look in found.centres]
        values["centre_duration"] = [look.point["duration"] for look in found.centres]
        values["centre_shift"] = [look.point["shift"] for look in found.centres]
        values["centre_velocity"] = [-look.value for look in found.centres]
    return values


def _changes(own: SensitivityTable, found: Response) -> dict[str, Any]:
    """Return motions with changed parameters, by parameter, factor and rate, and unchanged ones."""
    shape = (len(own.parameters), len(own.factors), len(own.rates))
    rows = [
        found.changed[name, factor, rate]
        for name in own.parameters
        for factor in own.factors
        for rate in own.rates
    ]
    base = [found.changed["none", 1.0, rate][1] for rate in own.rates]
    values: dict[str, Any] = {
        "sensitive_rate": list(own.rates),
        "changed_factor": np.reshape([factor for factor, _ in rows], shape),
    }
    for key in ("velocity", "error"):
        changed = [getattr(point, key) for _, point in rows]
        values[f"changed_{key}"] = np.reshape(changed, shape)
        values[f"unchanged_{key}"] = [getattr(point, key) for point in base]
    return values
