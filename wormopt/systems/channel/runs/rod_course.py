"""Motions of a rod in a channel by time stepping, with statistics, singly or in parallel.

Motions need not be regular. Batch means estimate the error of their mean velocities: means over
several whole repeats of the switching scatter about their common mean. Student's distribution
gives the confidence interval from this scatter.

Source: A. M. Law, Simulation Modeling and Analysis (2015), 9.5.3.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

import casadi as ca
import numpy as np
from scipy.special import stdtrit

from wormopt.errors import Interrupted, SolveError
from wormopt.model.model import Model, pack
from wormopt.numerics.workers import Workers
from wormopt.progress import Report, silent
from wormopt.result import Check
from wormopt.simulation.moreau import StepRecord
from wormopt.systems.channel.runs.rod_case import RodCase
from wormopt.systems.shared.checkpoints import forget as forget_file
from wormopt.systems.shared.checkpoints import keep

_BATCHES, _CONFIDENCE = 8, 0.95
# Accepted error of the field's work by round-off and steps, and accepted depth in walls.
_ENERGY, _DEPTH = 0.01, 0.05
# Velocities are compared relative to at least this share of the field's, because a rod may stand
# still. A velocity with a relative error above the second share is not compared.
_STILL, _KNOWN = 0.01, 0.5
# Largest number of steps: some minutes.
_MOST_STEPS = 2e7


@dataclass(frozen=True)
class Mean:
    """A mean velocity, positive with the field."""

    value: float  # m/s
    error: float  # half the width of its 95 % interval, m/s
    settled: bool  # both halves after `settle` agree within errors

    @property
    def direction(self) -> int:
        """Return 1 with the field, -1 against it, 0 if the interval contains both."""
        return 0 if not abs(self.value) > self.error else int(math.copysign(1, self.value))


def mean_velocity(time: np.ndarray, centre: np.ndarray, cycle: float, settle: float) -> Mean:
    """Return the mean velocity over whole repeats, from `time` and `centre` (m,).

    Skips the initial share `settle` of the time; at least four repeats of duration `cycle` must be
    left.
    """
    repeats = math.floor((1 - settle) * time[-1] / cycle * (1 + 1e-9))
    batches = max(min(_BATCHES, repeats), 2)
    size = max(repeats // batches, 1) * cycle
    ends = time[-1] - size * np.arange(batches, -1, -1)
    parts = np.diff(np.interp(ends, time, centre)) / size
    halves = [_interval(part) for part in (parts[: batches // 2], parts[batches // 2 :])]
    value, error = _interval(parts)
    return Mean(value, error, not differ(*halves[0], *halves[1]))


def _interval(parts: np.ndarray) -> tuple[float, float]:
    """Return the mean of batches, and half the width of its interval."""
    spread = float(np.std(parts, ddof=1)) if len(parts) > 1 else 0.0
    factor = float(stdtrit(max(len(parts) - 1, 1), (1 + _CONFIDENCE) / 2))
    return float(np.mean(parts)), factor * spread / math.sqrt(len(parts))


def differ(one: float, one_error: float, other: float, other_error: float) -> float:
    """Return the difference of two means beyond their errors, or 0."""
    return max(abs(one - other) - math.hypot(one_error, other_error), 0.0)


# -- one motion ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RodPoint:
    """Results of one motion."""

    rate: float  # coil switches per second
    velocity: float  # mean, m/s, positive with the field; NaN if the motion failed
    error: float  # half the width of its 95 % interval, m/s; NaN if it failed
    settled: bool  # both halves of the averaged time agree in mean
    energy_error: float  # largest error of the energy balance, over the work of the field
    penetration: float  # largest depth in a wall, over the room of the centre line
    field_error: float  # largest error of the series of H², over the largest H²
    # length of a segment just before coils change, m; NaN if the rod never lay over a block
    arc_length: float
    seconds: float  # computing time spent
    reason: str = ""  # why the motion failed; empty otherwise

    @classmethod
    def lost(cls, rate: float, reason: str) -> RodPoint:
        """Return the point of a motion that failed at `rate` switches per second."""
        unknown = math.nan
        return cls(rate, unknown, unknown, False, unknown, unknown, unknown, unknown, 0.0, reason)

    @property
    def direction(self) -> int:
        """Return 1 with the field, -1 against it, 0 if it is not certain."""
        return Mean(self.velocity, self.error, self.settled).direction


@dataclass(frozen=True, eq=False)
class RodCourse:
    """A motion and its results."""

    steps: StepRecord
    centre: np.ndarray  # (m,) mean place of the rod, m
    count: int  # number of nodes
    point: RodPoint


def follow(case: RodCase, report: Report = silent) -> RodCourse:
    """Simulate a rod that starts straight in the middle of the channel.

    Raises SolveError if states are not finite or steps are too many, and Interrupted.
    """
    begin, rod, marcher, step = perf_counter(), case.rod, case.marcher, case.step
    _check_steps(case, step)
    try:
        steps = marcher.march(
            case.end, case.start, p=case.numbers, schedule=case.schedule, step=step, report=report
        )
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
        energy_error=_energy_error(marcher.model, steps, case.numbers),
        penetration=max(float(np.abs(across).max()) / case.room - 1, 0.0),
        field_error=max(field.error for field in case.fields),
        arc_length=_segment_length(case, rod.count, steps),
        seconds=perf_counter() - begin,
    )
    return RodCourse(steps, centre, rod.count, point)


def _check_steps(case: RodCase, step: float) -> None:
    """Refuse motions with too many steps: stiff or light rods, or very slow switching."""
    count = max(case.end / step, 10 * case.end * case.rate)
    if not count <= _MOST_STEPS:
        raise SolveError(
            f"{case.end:.3g} s at {case.rate:g} switches per second take {count:.2g} steps, more "
            f"than {_MOST_STEPS:g}: the longest stable step is {step:.2g} s",
            "write a smaller worm.youngs_modulus or worm.damping_time, a larger worm.density, "
            "fewer course.cycles, or a shorter course.duration",
            None,
            "too_many_steps",
        )


def finer(case: RodCase, elements: int | None = None, share: float = 0.5) -> RodCase:
    """Return the same motion on another mesh, or with shorter steps.

    With `elements`, steps are the longest that this mesh allows; else they shrink by `share`.
    """
    if elements is not None:
        return case.varied(mesh={"elements": elements, "step": None})
    return case.varied(mesh={"step": share * case.step})


def checks_of_motion(point: RodPoint, what: str = "") -> Iterator[Check]:
    """Yield checks of a single motion; `what` names how it was computed."""
    named, told = (f" {what}", f"{what}: ") if what else ("", "")
    where = f"{told}at {point.rate:g} switches per second"
    if point.reason:
        yield Check(f"motion{named}", None, 0.0, f"{where} {point.reason}")
        return
    yield Check(
        f"energy balance{named}",
        point.energy_error,
        _ENERGY,
        f"{where} energy is not balanced, by {point.energy_error:.2g} of the field's work; "
        "write a shorter mesh.step",
    )
    yield Check(
        f"depth in walls{named}",
        point.penetration,
        _DEPTH,
        f"{where} walls are penetrated by {point.penetration:.2g} of the room; write a shorter "
        "mesh.step",
    )


def change_of(case: RodCase, point: RodPoint, others: Iterable[RodPoint]) -> float | None:
    """Return the largest relative change of a mean velocity with other steps and meshes.

    Errors are not subtracted; None without `others`.
    """
    changes = [abs(other.velocity - point.velocity) for other in others]
    return max(changes) / _compared_with(case, point) if changes else None


def _compared_with(case: RodCase, point: RodPoint) -> float:
    return max(abs(point.velocity), _STILL * case.field_speed)


def checks_of_change(
    case: RodCase, point: RodPoint, other: RodPoint, accepted: float, what: str
) -> Iterator[Check]:
    """Yield checks that the mean velocity is independent of step or mesh; `what` names which.

    `accepted`: largest change beyond the errors, over the velocity, or over a hundredth of
    the field's.
    """
    size, where = _compared_with(case, point), f"at {point.rate:g} switches per second"
    errors = math.hypot(point.error, other.error)
    known = Check(
        f"error of the mean velocity {what}",
        errors,
        _KNOWN * size,
        f"{where} the error of the mean velocity is {errors:.2g} m/s, too large to compare it "
        f"{what}; write a longer course.duration",
    )
    yield known
    if known.passed:
        change = differ(point.velocity, point.error, other.velocity, other.error)
        yield Check(
            f"mean velocity {what}",
            change,
            accepted * size,
            f"{where} the mean velocity changes by {change:.2g} m/s {what}; write more "
            "mesh.elements, a shorter mesh.step or a longer course.duration",
        )


def _energy_error(model: Model, steps: StepRecord, numbers: dict[str, float]) -> float:
    """Return the largest difference of the energy from the work on the rod."""
    energy = ca.Function(
        "energy",
        [pack(model.x), pack(model.p)],
        [model["strain_energy"] + model["kinetic_energy"]],
    )
    count = steps.states.shape[1]
    p = np.array([numbers[signal.name] for signal in model.p])
    stored = np.array(energy.map(count)(steps.states, np.tile(p[:, None], count))).ravel()
    done = sum(steps.work.values())
    scale = np.abs(np.diff(steps.work["load_power"])).sum()
    return float(np.abs(stored - stored[0] - done).max() / scale) if scale else 0.0


def _segment_length(case: RodCase, count_of_nodes: int, steps: StepRecord) -> float:
    """Return the mean rod length from coil to coil of a block just before coils change, in m.

    NaN if the rod never reached over a block. Durations of coils are rounded to whole switches.
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
    """Return the length of a polyline between two positions along the row."""
    arc = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    inside = np.flatnonzero((x[:-1] - first) * (x[1:] - first) <= 0)
    beyond = np.flatnonzero((x[:-1] - last) * (x[1:] - last) <= 0)
    i, j = inside[0], beyond[-1]
    ends = [
        np.interp((place - x[k]) / (x[k + 1] - x[k]), [0.0, 1.0], arc[k : k + 2])
        for k, place in ((i, first), (j, last))
    ]
    return float(abs(ends[1] - ends[0]))


# -- many motions ----------------------------------------------------------------------------------


def rod_points(cases: Sequence[RodCase], folder: Path, report: Report, text: str) -> list[RodPoint]:
    """Simulate several rods on all cores, in the order of `cases`; `text` names the purpose.

    Motions in `folder` are reused and new ones saved there, also on KeyboardInterrupt.
    """
    found = {case: point for case in cases if (point := kept(case, folder))}
    # the slowest switching takes longest
    todo = sorted({case for case in cases if case not in found}, key=lambda case: case.rate)
    if todo:
        report(text, len(found) / (len(found) + len(todo)))
    follow_one = partial(_follow_and_keep, folder=folder)
    with Workers(min(len(todo), os.cpu_count() or 1) or 1) as workers:
        for k, point in workers.as_completed(follow_one, todo):
            found[todo[k]] = point
            report(text, len(found) / len(set(cases)))
    return [found[case] for case in cases]


def kept(case: RodCase, folder: Path) -> RodPoint | None:
    """Return the results of a motion from `folder`; None if missing or damaged."""
    with suppress(OSError, ValueError, TypeError):
        return RodPoint(**json.loads(_file(case, folder).read_text(encoding="utf-8")))
    return None


def forget(cases: Sequence[RodCase], folder: Path) -> None:
    """Remove saved motions from `folder`, because a result has them now."""
    for case in cases:
        forget_file(_file(case, folder))


def _file(case: RodCase, folder: Path) -> Path:
    return folder / f"{hashlib.sha256(case.key.encode()).hexdigest()[:32]}.json"


def _follow_and_keep(case: RodCase, folder: Path) -> RodPoint:
    try:
        point = follow(case).point
    except SolveError as lost:
        point = RodPoint.lost(case.rate, str(lost))
    # Python's JSON supports NaN, which failed motions contain
    keep(_file(case, folder), json.dumps(asdict(point)).encode())
    return point
