"""Scenes of kind ``rod-frequency``: how fast a rod crawls over the frequency of its coils."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from platformdirs import user_cache_path

from wormopt.errors import Interrupted, SolveError
from wormopt.gaits.compass import Look, compass
from wormopt.linear.modes import vibration_modes
from wormopt.progress import Report
from wormopt.result import Result, Scalar, Variable, unit_of
from wormopt.scenes.rod_frequency import RodFrequencyScene
from wormopt.scenes.scene import Scene
from wormopt.studies.rod_parts import (
    ASSUMED,
    RodCase,
    assumed_scalars,
    rod_of,
    stable_step,
)
from wormopt.studies.rod_runs import RodPoint, kept, rod_points
from wormopt.version import VERSION
from wormopt.worms.channel import SHAPES, ChannelWorm
from wormopt.worms.channel_rod import channel_rod

__all__ = ["run"]

_MODES = 4
# The velocity has rolled off where it is below this share of what the slowest switching promises;
# the rod stands still where it is slower than this share of the field.
_ROLLED, _STILL = 0.5, 0.002
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


@dataclass(eq=False)
class _Found:
    """What has been found, stage by stage."""

    curve: list[RodPoint] = field(default_factory=list)
    refined: list[RodPoint] = field(default_factory=list)
    centres: list[Look] = field(default_factory=list)
    changed: dict[tuple[str, float, float], tuple[float, RodPoint]] = field(default_factory=dict)
    again: dict[str, RodPoint] = field(default_factory=dict)

    @property
    def all_points(self) -> list[RodPoint]:
        others = [point for _, point in self.changed.values()]
        return [*self.curve, *self.refined, *others, *self.again.values()]

    @property
    def best(self) -> RodPoint:
        """Fastest motion against the field among those of the curve and near its best."""
        known = [point for point in (*self.curve, *self.refined) if math.isfinite(point.velocity)]
        return min(known, key=lambda point: point.velocity)


def run(scene: Scene[RodFrequencyScene], report: Report) -> Result:
    """Follow the rod at all frequencies, seek the best one, and see what all of it hangs on.

    Every motion is kept in the user's cache folder as soon as it is done, so that a run that was
    stopped goes on where it was.

    Parameters
    ----------
    scene : Scene
        Of kind ``rod-frequency``.
    report : callable
        Told what goes on.

    Returns
    -------
    Result
        Status "failed" where a motion is lost or does not balance its energy, or where the best
        velocity depends on step or mesh.

    Raises
    ------
    SolveError
        If no motion could be followed.
    Interrupted
        If the user stops it; what has been found is its partial result.
    """
    table, begin = scene.table, perf_counter()
    folder = user_cache_path("wormopt") / "checkpoints" / f"{VERSION}-{scene.key}"
    case = RodCase(
        table.worm, table.channel, table.coils, table.switching, table.mesh, table.course, 1.0
    )
    found = _Found()
    try:
        _explore(table, case, folder, found, report)
    except KeyboardInterrupt:
        cases = [replace(case, rate=rate) for rate in table.rates]
        found.curve = [point for point in (kept(one, folder) for one in cases) if point]
        if not found.curve:
            raise
        reason = "interrupted; run again to go on"
        partial = _result(scene, case, found, perf_counter() - begin)
        raise Interrupted(replace(partial, status="failed", reason=reason)) from None
    shutil.rmtree(folder, ignore_errors=True)
    return _result(scene, case, found, perf_counter() - begin)


def _explore(
    table: RodFrequencyScene, case: RodCase, folder: Path, found: _Found, report: Report
) -> None:
    """Go through all stages, the results of which are put into what is found."""
    cases = [replace(case, rate=rate) for rate in table.rates]
    found.curve = rod_points(cases, folder, report, "velocity over frequency")
    lost = [point.reason for point in found.curve if point.reason]
    if len(lost) == len(found.curve):
        raise SolveError(lost[0], "write a shorter mesh.step")
    if table.search:
        near = [replace(case, rate=rate) for rate in _near_best(found, table.search.refine)]
        found.refined = rod_points(near, folder, report, "best frequency")
    best = replace(case, rate=found.best.rate)
    if table.search and table.search.rounds:
        found.centres = _best_pattern(best, table.search.rounds, folder, report)
    if table.sensitivity:
        _change(table, case, folder, found, report)
    finer = {
        "elements": best.varied(mesh={"elements": math.ceil(1.5 * case.mesh.elements)}),
        "step": best.varied(mesh={"step": 0.4 * stable_step(best)}),
    }
    points = rod_points(list(finer.values()), folder, report, "again, more finely")
    found.again = dict(zip(finer, points, strict=True))


def _near_best(found: _Found, count: int) -> list[float]:
    """Frequencies between the neighbours of the best one."""
    rates = [point.rate for point in found.curve]
    k = rates.index(found.best.rate)
    low, high = rates[max(k - 1, 0)], rates[min(k + 1, len(rates) - 1)]
    between = np.geomspace(low, high, count + 2)[1:-1]
    return [float(f"{rate:.4g}") for rate in between if rate not in rates]


def _best_pattern(case: RodCase, rounds: int, folder: Path, report: Report) -> list[Look]:
    """Seek frequency, duration and shift of the switching by compass search."""

    def look(points: Sequence[dict[str, float]]) -> list[Look]:
        cases = [
            replace(
                case.varied(pattern={"duration": point["duration"], "shift": point["shift"]}),
                rate=math.exp(point["rate"]),
            )
            for point in points
        ]
        looks = rod_points(cases, folder, report, "best pattern")
        return [
            Look(point, -np.inf if one.reason else -one.velocity, one.error)
            for point, one in zip(points, looks, strict=True)
        ]

    most = case.pattern.every - 1.0
    start = {
        "rate": math.log(case.rate),
        "duration": case.pattern.duration,
        "shift": case.pattern.shift,
    }
    bounds = {
        "rate": (math.log(case.rate / 4), math.log(4 * case.rate)),
        "duration": (1.5, min(5.0, most - 0.6)),
        "shift": (-0.6, 0.6),
    }
    return compass(look, start, _STEPS, bounds, rounds)


def _change(
    table: RodFrequencyScene, case: RodCase, folder: Path, found: _Found, report: Report
) -> None:
    """Change doubtful numbers one at a time."""
    assert table.sensitivity is not None
    todo: dict[tuple[str, float, float], tuple[float, RodCase]] = {}
    for rate in table.sensitivity.rates:
        own = replace(case, rate=rate)
        todo["none", 1.0, rate] = 1.0, own
        for name in table.sensitivity.parameters:
            for factor in table.sensitivity.factors:
                todo[name, factor, rate] = _changed(own, name, factor)
    cases = [one for _, one in todo.values()]
    points = rod_points(cases, folder, report, "sensitivity")
    taken = [factor for factor, _ in todo.values()]
    found.changed = dict(zip(todo, zip(taken, points, strict=True), strict=True))


def _changed(case: RodCase, name: str, factor: float) -> tuple[float, RodCase]:
    """Change one number; also tells by how much, where there is no room for all of it."""
    table, key = _TABLES[name], name.removeprefix("coil_")
    old = getattr(getattr(case, table), key)
    new = old * factor
    if name == "coil_outer":
        new = min(max(new, 1.05 * case.coils.inner), case.coils.pitch)
    return new / old, case.varied(**{table: {key: new}})


def _result(
    scene: Scene[RodFrequencyScene], case: RodCase, found: _Found, seconds: float
) -> Result:
    faults = list(_faults(scene.table, case, found))
    slowest = [point.seconds for point in found.all_points]
    return Result(
        scene.name,
        scene.table.kind,
        scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(scene.table, case, found),
        variables=tuple(_variables(scene.table, found)),
        trust={
            "energy_error": max(point.energy_error for point in found.all_points),
            "penetration_max": max(point.penetration for point in found.all_points),
            "recheck_velocity_error": max(_rechecks(found), default=None),
            "accepted": scene.table.accepted * found.best.rate * case.coils.pitch,
            "motions": len(found.all_points),
            "assumptions": dict(ASSUMED),
            "warnings": list(_warnings(scene.table, found)),
        },
        timings_s={"all": seconds, "slowest_motion": max(slowest)},
        scene_text=scene.text,
        attributes={
            "measured": [[one.rate, one.velocity, one.text] for one in scene.table.measured],
            "parameters": list(scene.table.sensitivity.parameters)
            if scene.table.sensitivity else [],
        },
    )  # fmt: skip


def _rechecks(found: _Found) -> list[float]:
    """Changes of the best velocity by mesh and step, beyond what is uncertain in it."""
    best = found.best
    return [
        max(
            abs(point.velocity - best.velocity) - 2 * math.hypot(point.error, best.error),
            0.0,
        )
        for point in found.again.values()
    ]


def _faults(table: RodFrequencyScene, case: RodCase, found: _Found) -> Iterator[str]:
    for point in found.curve:
        if point.reason:
            yield f"at {point.rate:g} switches a second {point.reason}; write a shorter mesh.step"
    worst = max(found.all_points, key=lambda point: point.energy_error)
    if worst.energy_error > 0.01:
        yield (
            f"at {worst.rate:g} switches a second the balance of energy is off by "
            f"{worst.energy_error:.2g}; write a shorter mesh.step"
        )
    for change in _rechecks(found):
        if not change <= table.accepted * found.best.rate * case.coils.pitch:
            yield (
                f"the best velocity changes by {change:.2g} m/s on a finer mesh or by half the "
                "step; write more mesh.elements or a longer course.duration"
            )


def _still(point: RodPoint, case: RodCase) -> bool:
    """Whether the rod is slower than a small share of the field, for sure."""
    return abs(point.velocity) + 2 * point.error <= _STILL * point.rate * case.coils.pitch


def _scalars(table: RodFrequencyScene, case: RodCase, found: _Found) -> dict[str, Scalar]:
    curve, best = found.curve, found.best
    slope = curve[0].velocity / curve[0].rate
    rolled = [
        point.rate for point in curve if point.velocity / point.rate > _ROLLED * slope
    ]  # both are negative where the rod goes against the field
    worm = ChannelWorm(
        case.coils.pitch, case.channel.diameter, case.worm.diameter, case.worm.length
    )
    values: dict[str, tuple[Any, str]] = {
        "velocity_mean": ([point.velocity for point in curve], "speed"),
        "velocity_error": ([point.error for point in curve], "speed"),
        "direction": ([_sign(point) for point in curve], "count"),
        "frequency_best": (best.rate, "rate"),
        "velocity_best": (best.velocity, "speed"),
        "velocity_best_error": (best.error, "speed"),
        "velocity_per_frequency_slow": (slope, "length"),
        "velocity_per_frequency_32": (
            [-worm.velocity_per_frequency(shape) for shape in SHAPES], "length",
        ),
        "arc_length_slow": (curve[0].arc_length, "length"),
        "energy_error": (max(point.energy_error for point in found.all_points), "share"),
        "rolloff_frequency": (rolled[0] if rolled else None, "rate"),
        "standstill_frequencies": ([p.rate for p in curve if _still(p, case)], "rate"),
        "forward_frequencies": ([p.rate for p in curve if _sign(p) > 0], "rate"),
        **{name: (list(found_), "rate") for name, found_ in _eigenfrequencies(case).items()},
        **_pattern_scalars(found),
        **_sensitivity_scalars(table, found),
    }  # fmt: skip
    scalars = {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in values.items()}
    return scalars | assumed_scalars(case)


def _sign(point: RodPoint) -> int:
    return 0 if abs(point.velocity) <= 2 * point.error else int(np.sign(point.velocity))


def _eigenfrequencies(case: RodCase) -> dict[str, np.ndarray]:
    """Of the whole rod, free and pinned at its ends, and of one pitch of it, in Hz."""
    rod = rod_of(case.worm, case.mesh)
    whole = channel_rod(rod, case.channel.diameter, case.channel.friction)
    pitch = replace(rod, length=case.coils.pitch)
    part = channel_rod(pitch, case.channel.diameter, case.channel.friction)
    ends = {"across": [0, rod.count - 1]}
    free = vibration_modes(whole, count=_MODES + 3).frequencies
    return {
        "eigenfrequencies": free[free > 0][:_MODES],
        "eigenfrequencies_pinned": _above_zero(vibration_modes(whole, ends, count=_MODES + 1)),
        "eigenfrequencies_segment": _above_zero(vibration_modes(part, ends, count=2)),
    }


def _above_zero(modes: Any) -> np.ndarray:
    return modes.frequencies[modes.frequencies > 0][:_MODES]


def _pattern_scalars(found: _Found) -> dict[str, tuple[Any, str]]:
    if not found.centres:
        return {}
    first, last = found.centres[0], found.centres[-1]
    return {
        "pattern_rate": (math.exp(last.point["rate"]), "rate"),
        "pattern_duration": (last.point["duration"], "count"),
        "pattern_shift": (last.point["shift"], "count"),
        "pattern_velocity": (-last.value, "speed"),
        "pattern_velocity_error": (last.error, "speed"),
        "pattern_gain": (last.value / first.value - 1, "share"),
    }


def _sensitivity_scalars(table: RodFrequencyScene, found: _Found) -> dict[str, tuple[Any, str]]:
    if not table.sensitivity or not found.changed:
        return {}
    names = []
    for rate in table.sensitivity.rates:
        base = found.changed["none", 1.0, rate][1].velocity
        spread = {
            name: max(
                abs(found.changed[name, factor, rate][1].velocity - base)
                for factor in table.sensitivity.factors
            )
            for name in table.sensitivity.parameters
        }
        names.append(max(spread, key=lambda name: np.nan_to_num(spread[name], nan=np.inf)))
    return {
        "sensitive_rates": (list(table.sensitivity.rates), "rate"),
        "sensitive_to": (names, "count"),
    }


def _variables(table: RodFrequencyScene, found: _Found) -> Iterator[Variable]:
    for name, points in (("curve", found.curve), ("refined", found.refined)):
        if points:
            columns = {
                "rate": ("s-1", [point.rate for point in points], "switches a second"),
                "velocity": ("m s-1", [point.velocity for point in points], "mean velocity"),
                "error": ("m s-1", [point.error for point in points], "its standard error"),
                "arc_length": ("m", [point.arc_length for point in points], "of a segment"),
            }
            for key, (unit, values, text) in columns.items():
                yield Variable(f"{name}_{key}", unit, (name,), np.array(values), text)
    if table.sensitivity and found.changed:
        own = table.sensitivity
        shape = (len(own.parameters), len(own.factors), len(own.rates))
        rows = [found.changed[n, f, r] for n in own.parameters for f in own.factors
                for r in own.rates]  # fmt: skip
        dims = ("parameter", "factor", "sensitive_rate")
        yield Variable(dims[2], "s-1", dims[2:], np.array(own.rates), "switches a second")
        base = [found.changed["none", 1.0, rate][1] for rate in own.rates]
        for key, pick in (("velocity", "velocity"), ("error", "error")):
            unit, text = "m s-1", f"{key} of the mean motion"
            values = np.array([getattr(point, pick) for _, point in rows]).reshape(shape)
            yield Variable(f"changed_{key}", unit, dims, values, text)
            plain = np.array([getattr(point, pick) for point in base])
            yield Variable(f"unchanged_{key}", unit, dims[2:], plain, text)
        taken = np.array([factor for factor, _ in rows]).reshape(shape)
        yield Variable("changed_factor", "1", dims, taken, "by what the number was changed")
    if found.centres:
        dims = ("centre",)
        for key in ("duration", "shift"):
            values = [look.point[key] for look in found.centres]
            yield Variable(f"centre_{key}", "1", dims, np.array(values), f"{key} in switches")
        rates = [math.exp(look.point["rate"]) for look in found.centres]
        yield Variable("centre_rate", "s-1", dims, np.array(rates), "switches a second")
        speeds = [-look.value for look in found.centres]
        yield Variable("centre_velocity", "m s-1", dims, np.array(speeds), "mean velocity")


def _warnings(table: RodFrequencyScene, found: _Found) -> Iterator[str]:
    unsure = [
        point.rate
        for point in found.curve
        if point.error > 0.1 * abs(point.velocity) and abs(point.velocity) > 1e-3
    ]
    if unsure:
        rates = ", ".join(f"{rate:g}" for rate in unsure)
        yield (
            f"the motion is irregular at {rates} switches a second: its mean is known to a tenth "
            "at best; write a longer course.duration"
        )
    if table.worm.susceptibility > 1:
        yield (
            f"a susceptibility of {table.worm.susceptibility:g} changes the field in and near the "
            "body, which the pull by the field without it leaves out"
        )
