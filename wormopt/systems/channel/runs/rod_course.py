"""One motion of a rod in a channel, step by step, and what it comes to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from time import perf_counter

import casadi as ca
import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model, pack
from wormopt.progress import Report, silent
from wormopt.simulation.moreau import Steps
from wormopt.systems.channel.runs.rod_case import (
    RodCase,
    fields_of,
    marcher_of,
    numbers_of,
    rod_of,
    schedule_of,
    start_of,
    step_of,
)
from wormopt.systems.channel.runs.rod_means import Mean, differ, mean_velocity

# What of the field's work may be lost to rounding and steps, and how deep walls may be entered.
_ENERGY, _DEPTH = 0.01, 0.05
# Velocities are compared with no less than this share of the field's: a rod may stand still. What
# is not known to this share of itself is not compared at all.
_STILL, _KNOWN = 0.01, 0.5
# Steps after which nobody waits any more: some minutes.
_MOST_STEPS = 2e7


@dataclass(frozen=True)
class RodPoint:
    """Outcome of one motion."""

    rate: float  # coil switches per second
    velocity: float  # mean, m/s, positive with the field; NaN: motion lost
    error: float  # half the width of its 95 % interval, m/s; NaN: lost
    settled: bool  # both halves of the time that counts agree in mean
    energy_error: float  # largest error of the energy balance, over all work of the field
    penetration: float  # deepest into a wall, over room of the centre line
    field_error: float  # largest error of the series of H², over largest H²
    # of a segment just before coils change, m; NaN where the rod never lay over a block
    arc_length: float
    seconds: float  # computing time spent
    reason: str = ""  # why the motion was lost; empty otherwise

    @classmethod
    def lost(cls, rate: float, reason: str) -> RodPoint:
        """Point of a motion that was lost at `rate` switches per second."""
        unknown = math.nan
        return cls(rate, unknown, unknown, False, unknown, unknown, unknown, unknown, 0.0, reason)

    @property
    def direction(self) -> int:
        """1 with the field, -1 against it, 0 where it is not sure."""
        return Mean(self.velocity, self.error, self.settled).direction


@dataclass(frozen=True, eq=False)
class RodCourse:
    """A motion and its outcome."""

    steps: Steps
    centre: np.ndarray  # (m,) mean place of the rod, m
    count: int  # number of nodes
    point: RodPoint


def follow(case: RodCase, report: Report = silent) -> RodCourse:
    """Follow a straight rod in the middle of the channel as the coils are switched.

    Raises SolveError if states are no longer numbers or steps too many, and Interrupted.
    """
    begin, rod, marcher = perf_counter(), rod_of(case.worm, case.mesh), marcher_of(case)
    numbers, step = numbers_of(case), step_of(case)
    _check_steps(case, step)
    try:
        steps = marcher.march(
            case.end, start_of(case, marcher), p=numbers, schedule=schedule_of(case),
            step=step, report=report,
        )  # fmt: skip
    except SolveError as lost:
        suggestion = "write a shorter mesh.step, or fewer coils.ampere_turns"
        raise SolveError(lost.reason, suggestion, None, lost.code) from None
    except Interrupted:
        raise Interrupted from None
    centre = rod.weights @ steps.states[: rod.count] / rod.length
    mean = mean_velocity(steps.time, centre, case.cycle, case.course.settle)
    across = steps.states[rod.count : 2 * rod.count]
    point = RodPoint(
        rate=case.rate,
        velocity=mean.value,
        error=mean.error,
        settled=mean.settled,
        energy_error=_energy_error(marcher.model, steps, numbers),
        penetration=max(float(np.abs(across).max()) / case.room - 1, 0.0),
        field_error=max(field.error for field in fields_of(case)),
        arc_length=_segment_length(case, rod.count, steps),
        seconds=perf_counter() - begin,
    )
    return RodCourse(steps, centre, rod.count, point)


def _check_steps(case: RodCase, step: float) -> None:
    """Refuse motions that would take for ever: stiff or light rods, a clock that hardly ticks."""
    count = max(case.end / step, 10 * case.end * case.rate)
    if not count <= _MOST_STEPS:
        raise SolveError(
            f"{case.end:.3g} s at {case.rate:g} switches a second take {count:.2g} steps, more "
            f"than {_MOST_STEPS:g}: the longest stable step is {step:.2g} s",
            "write a smaller worm.youngs_modulus or worm.damping_time, a larger worm.density, "
            "fewer course.cycles, or a shorter course.duration",
            None,
            "too_many_steps",
        )


def finer(case: RodCase, elements: int | None = None, share: float = 0.5) -> RodCase:
    """The same motion on another mesh, or with shorter steps.

    With `elements`, steps are the longest this mesh allows; else they shrink by `share`.
    """
    if elements is not None:
        return case.varied(mesh={"elements": elements, "step": None})
    return case.varied(mesh={"step": share * step_of(case)})


def faults_of_motion(point: RodPoint) -> Iterator[str]:
    """Yield what is wrong with a motion by itself."""
    where = f"at {point.rate:g} switches a second"
    if point.reason:
        yield f"{where} {point.reason}"
        return
    if not point.energy_error <= _ENERGY:
        yield (
            f"{where} the balance of energy is off by {point.energy_error:.2g} of the field's "
            "work; write a shorter mesh.step"
        )
    if not point.penetration <= _DEPTH:
        yield (
            f"{where} walls are entered by {point.penetration:.2g} of the room; write a shorter "
            "mesh.step"
        )


def change_of(case: RodCase, point: RodPoint, others: Iterable[RodPoint]) -> float | None:
    """Largest change of a mean velocity with other steps and meshes, over its reference value.

    Errors are not taken off; None where there are no `others`.
    """
    changes = [abs(other.velocity - point.velocity) for other in others]
    return max(changes) / _compared_with(case, point) if changes else None


def _compared_with(case: RodCase, point: RodPoint) -> float:
    return max(abs(point.velocity), _STILL * case.field_speed)


def faults_of_recheck(
    case: RodCase, point: RodPoint, other: RodPoint, accepted: float, what: str
) -> Iterator[str]:
    """Yield a fault if the mean velocity changes with step or mesh; `what` says which.

    `accepted`: largest change beyond the errors, over the velocity, or over a hundredth of
    the field's.
    """
    size = _compared_with(case, point)
    errors = math.hypot(point.error, other.error)
    change = differ(point.velocity, point.error, other.velocity, other.error)
    if not errors <= _KNOWN * size:
        yield (
            f"at {point.rate:g} switches a second the mean velocity is known to {errors:.2g} m/s "
            f"only, too little to compare it {what}; write a longer course.duration"
        )
    elif not change <= accepted * size:
        yield (
            f"at {point.rate:g} switches a second the mean velocity changes by {change:.2g} m/s "
            f"{what}; write more mesh.elements, a shorter mesh.step or a longer course.duration"
        )


def _energy_error(model: Model, steps: Steps, numbers: dict[str, float]) -> float:
    """Largest difference of the energy from what has been done on the rod."""
    energy = ca.Function(
        "energy",
        [pack(model.x), pack(model.p)],
        [model.output("strain_energy") + model.output("kinetic_energy")],
    )
    count = steps.states.shape[1]
    p = np.array([numbers[signal.name] for signal in model.p])
    stored = np.array(energy.map(count)(steps.states, np.tile(p[:, None], count))).ravel()
    done = sum(steps.work.values())
    scale = np.abs(np.diff(steps.work["load_power"])).sum()
    return float(np.abs(stored - stored[0] - done).max() / scale) if scale else 0.0


def _segment_length(case: RodCase, count_of_nodes: int, steps: Steps) -> float:
    """Mean length of the rod from coil to coil of a block just before the coils change, in m.

    NaN where the rod never reached over a block. Durations that coils are on are rounded to
    whole switches.
    """
    found = []
    n, pitch = count_of_nodes, case.coils.pitch
    count = round(case.pattern.duration)
    repeat = case.pattern.every * pitch
    switches = np.arange(round(steps.time[-1] * case.rate))
    late = switches[switches > case.course.settle * len(switches)]
    for k in late:
        look = np.searchsorted(steps.time, (k + 1) / case.rate * (1 - 1e-9)) - 1
        x, y = steps.states[:n, look], steps.states[n : 2 * n, look]
        first = (k - count + 1) * pitch
        first += repeat * round((x.mean() - first - (count - 1) * pitch / 2) / repeat)
        last = first + (count - 1) * pitch
        if x.min() < first and last < x.max() and count > 1:
            found.append(_length_between(x, y, first, last) / (count - 1))
    return float(np.mean(found)) if found else float("nan")


def _length_between(x: np.ndarray, y: np.ndarray, first: float, last: float) -> float:
    """Length of a polyline from the first place along the row to the last."""
    arc = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    inside = np.flatnonzero((x[:-1] - first) * (x[1:] - first) <= 0)
    beyond = np.flatnonzero((x[:-1] - last) * (x[1:] - last) <= 0)
    i, j = inside[0], beyond[-1]
    ends = [
        np.interp((place - x[k]) / (x[k + 1] - x[k]), [0.0, 1.0], arc[k : k + 2])
        for k, place in ((i, first), (j, last))
    ]
    return float(abs(ends[1] - ends[0]))
