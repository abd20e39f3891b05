"""What the velocities of a rod over the frequency say: scalars and signals of a result."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wormopt.analysis.vibration import Modes, vibration_modes
from wormopt.numerics.compass import Look
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.systems.channel.channel_rod import channel_rod
from wormopt.systems.channel.closed_forms import SHAPES, ChannelWorm
from wormopt.systems.channel.runs.rod_case import RodCase, assumed_scalars, rod_of
from wormopt.systems.channel.runs.rod_course import RodPoint
from wormopt.systems.channel.scenes.rod_frequency import RodFrequencyScene

_MODES = 4
# The velocity has rolled off where it is below this share of what the slowest switching promises;
# the rod stands still where it is slower than this share of the best velocity, errors included.
_ROLLED, _STILL = 0.5, 0.02


@dataclass(eq=False)
class Response:
    """Motions of a rod, stage by stage."""

    case: RodCase  # the rod, at any frequency
    curve: list[RodPoint]  # over the frequencies of the scene
    refined: list[RodPoint] = field(default_factory=list)  # near the best of these
    patterns: list[RodPoint] = field(default_factory=list)  # with other patterns
    centres: list[Look] = field(default_factory=list)  # of the search for a pattern
    # by (number, factor, frequency): factor taken, motion
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
        """Fastest motion against the field among those of the curve and near its best."""
        known = [point for point in (*self.curve, *self.refined) if not point.reason]
        return min(known, key=lambda point: point.velocity)

    def stands(self, point: RodPoint) -> bool:
        """Whether the rod certainly stands still, error included."""
        slow = _STILL * abs(self.best.velocity)
        return not point.direction and abs(point.velocity) + point.error <= slow


def response_scalars(table: RodFrequencyScene, found: Response) -> dict[str, Scalar]:
    """Scalars of the result."""
    curve, best, case = found.curve, found.best, found.case
    first = curve[0] if curve[0].rate == table.rates[0] else RodPoint.lost(table.rates[0], "")
    slope = first.velocity / first.rate
    worm = ChannelWorm(
        case.coils.pitch, case.channel.diameter, case.worm.diameter, case.worm.length
    )
    values: dict[str, tuple[Any, str]] = {
        "velocity_mean": ([point.velocity for point in curve], "speed"),
        "velocity_error": ([point.error for point in curve], "speed"),
        "direction": ([point.direction for point in curve], "count"),
        "frequency_best": (best.rate, "rate"),
        "velocity_best": (best.velocity, "speed"),
        "velocity_best_error": (best.error, "speed"),
        "velocity_per_frequency_slow": (slope, "length"),
        "velocity_per_frequency_32": (
            [-worm.velocity_per_frequency(shape) for shape in SHAPES], "length",
        ),
        "arc_length_slow": (first.arc_length, "length"),
        "energy_error": (max(p.energy_error for p in found.points if not p.reason), "share"),
        "rolloff_frequency": (_rolloff(found, first), "rate"),
        "standstill_frequencies": ([p.rate for p in curve if found.stands(p)], "rate"),
        "forward_frequencies": ([p.rate for p in curve if p.direction > 0], "rate"),
        **{name: (list(rates), "rate") for name, rates in _eigenfrequencies(case).items()},
        **_pattern_scalars(found),
        **_sensitivity_scalars(table, found),
    }  # fmt: skip
    scalars = {name: Scalar(value, unit_of(kind, "SI")) for name, (value, kind) in values.items()}
    return scalars | assumed_scalars(case)


def _rolloff(found: Response, first: RodPoint) -> float | None:
    """First frequency whose velocity is well below the first slope, against the field."""
    if first.direction != -1:
        return None
    least = _ROLLED * first.velocity / first.rate
    rolled = [p.rate for p in found.curve if p.velocity / p.rate > least]
    return rolled[0] if rolled else None


def _eigenfrequencies(case: RodCase) -> dict[str, np.ndarray]:
    """Of the whole rod, free and pinned at its ends, and of one pitch of it, in Hz."""
    rod = rod_of(case.worm, case.mesh)
    whole = channel_rod(rod, case.channel.diameter, case.channel.friction)
    pitch = replace(rod, length=case.coils.pitch)
    part = channel_rod(pitch, case.channel.diameter, case.channel.friction)
    ends = {"across": [0, rod.count - 1]}
    return {
        "eigenfrequencies": _above_zero(vibration_modes(whole, count=_MODES + 3)),
        "eigenfrequencies_pinned": _above_zero(vibration_modes(whole, ends, count=_MODES + 1)),
        "eigenfrequencies_segment": _above_zero(vibration_modes(part, ends, count=2)),
    }


def _above_zero(modes: Modes) -> np.ndarray:
    return modes.frequencies[modes.frequencies > 0][:_MODES]


def _pattern_scalars(found: Response) -> dict[str, tuple[Any, str]]:
    if not found.centres:
        return {}
    first, last = found.centres[0], found.centres[-1]
    return {
        "pattern_rate": (math.exp(last.point["rate"]), "rate"),
        "pattern_duration": (last.point["duration"], "count"),
        "pattern_shift": (last.point["shift"], "count"),
        "pattern_velocity": (-last.value, "speed"),
        "pattern_velocity_error": (last.error, "speed"),
        "pattern_gain": (last.value / first.value - 1 if first.value > 0 else None, "share"),
    }


def _sensitivity_scalars(table: RodFrequencyScene, found: Response) -> dict[str, tuple[Any, str]]:
    if not table.sensitivity or not found.changed:
        return {}
    rates = table.sensitivity.rates
    return {
        "sensitive_rates": (list(rates), "rate"),
        "sensitive_to": ([_largest_change(found, rate) for rate in rates], "count"),
    }


def _largest_change(found: Response, rate: float) -> str | None:
    """Number whose change moves the velocity most; None where no move is beyond its error."""
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


def response_variables(table: RodFrequencyScene, found: Response) -> Iterator[Variable]:
    """Yield the signals of the result."""
    for name, points in (("curve", found.curve), ("refined", found.refined)):
        if points:
            columns = {
                "rate": ("s-1", [point.rate for point in points], "switches a second"),
                "velocity": ("m s-1", [point.velocity for point in points], "mean velocity"),
                "error": ("m s-1", [point.error for point in points], "half of its 95 % interval"),
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
