"""Scenes of kind ``track-predictive``: predictive control beside the open-loop optimum and LQR."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.estimation import places
from wormopt.control.loop import with_reference
from wormopt.control.lqr import lqr
from wormopt.control.predictive import Decisions, Plan
from wormopt.control.receding import Receded, recede
from wormopt.control.reference import Reference, gait_reference
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report, silent
from wormopt.result import Check, Result
from wormopt.scene.conclude import conclude
from wormopt.scene.scene import Scene
from wormopt.simulation.options import Exact, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.copies import Draw, drawn_plants, numbers_of
from wormopt.systems.chain.measured import balance, chain_checks, judged, judged_numbers
from wormopt.systems.chain.predictive_tracking import (
    converged,
    course_of,
    learning,
    plan_tracking,
    real_time,
)
from wormopt.systems.chain.runs.chains import chain_for, draw_links
from wormopt.systems.chain.runs.predictive_tables import table_of
from wormopt.systems.chain.scenes.track_predictive import SHOWN, TrackPredictiveScene
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.shared.optimum import refused
from wormopt.systems.shared.proof import CrossCheck, accepted_error, cross_check
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import fitted, gait_arrays, sample, simulate_whole
from wormopt.systems.spiked import gait_of_shape

OPEN, LQR = "open-loop optimum", "LQR, feed-forward"
REAL_TIME, CONVERGED, ADAPTED = "predictive, real time", "predictive, converged", "with estimation"
KNOWN = ("open-loop optimum, plant known", "predictive, real time, plant known")
# Where the model is right, predictive control may cost so much more than the open loop, as a share.
_AS_GOOD = 1e-6
# Plants that are not as believed are simulated less exactly: they differ by far more.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)
# Numbers of a motion that was given up.
_LOST: dict[str, Any] = dict.fromkeys((*JUDGED, "cost"), np.nan)


@dataclass(frozen=True, eq=False)
class Task:
    """What is tracked, and how it is judged."""

    scene: Scene[TrackPredictiveScene]
    gait: Gait
    plant: Model
    reference: Reference
    plan: Plan

    def judged(self, course: Gait | None) -> Model:
        """The worm under a course of inputs, or under LQR; measured."""
        if course is None:
            weight = 1 / self.scene.table.predictive.input_weight
            loop = lqr(self.plant, self.reference, error_weight=weight)
        else:
            loop = drive(with_reference(self.plant, self.reference), course)
        return judged(loop, self.scene.table.tube)

    def cost(self, numbers: Mapping[str, Any]) -> float:
        """Integral of |e|^2 + rho |u|^2."""
        weight = self.scene.table.predictive.input_weight
        return numbers["error_integral"] + weight * numbers["input_integral"]

    def told(self, motion: Trajectory) -> dict[str, Any]:
        """Numbers of a motion, with its cost."""
        numbers = judged_numbers(motion, self.scene.table.tube)
        return numbers | {"cost": self.cost(numbers)}


@dataclass(frozen=True, eq=False)
class Row:
    """One controller on the worm as it is believed, and on the plants."""

    name: str
    motion: Trajectory
    second: CrossCheck | None
    numbers: dict[str, Any]
    receded: Receded | None  # None for those that decide nothing
    drawn: list[dict[str, Any]] = field(default_factory=list)  # one for each plant
    learnt: list[Receded] = field(default_factory=list)  # decisions for each plant


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[TrackPredictiveScene], report: Report) -> Result:
    """Plan, let every controller move the worm and the plants, and compare.

    "failed" where decisions replayed as one motion end elsewhere, a second route disagrees, or
    predictive control is worse than the open loop although its model is right. Raises SceneError
    for a gait's file, SolveError without plan or motion.
    """
    table, clock = scene.table, time.perf_counter()
    try:
        task = _task(scene)
        planned = time.perf_counter()
        right = [
            _replay(task, course, tolerance_of(table.tolerance), Smooth(table.predictive.v_reg))
            for course in _right(task)
        ]
        rows = [_row(task, name, decisions, report) for name, decisions in _controllers(task)]
    except SolveError as error:
        raise refused(scene, error) from None
    simulated = time.perf_counter()
    draws = _draws(task)
    for k, draw in enumerate(draws):
        report("other plants", 0.5 + 0.5 * k / len(draws))
        for row in rows:
            if row.name != CONVERGED:  # takes ten times as long, and learns nothing either
                _on_plant(task, row, draw)
    known = [_known(task, draw) for draw in draws]
    timings = {
        "plan": planned - clock,
        "simulate": simulated - planned,
        "plants": time.perf_counter() - simulated,
    }
    return _result(task, rows, [task.told(each)["cost"] for each in right], draws, known, timings)


def _task(scene: Scene[TrackPredictiveScene]) -> Task:
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    plant = chain_for(table.worm, table.start, draw_links(table.worm, table.time.end), gait)
    reference = gait_reference(gait, plant.t, shift=table.reference.shift % gait.period)
    plan = plan_tracking(plant, reference, table.time.end, table.predictive)
    return Task(scene, gait, plant, reference, plan)


def _controllers(task: Task) -> Iterator[tuple[str, Decisions | None]]:
    table = task.scene.table
    yield from ((OPEN, None), (LQR, None), (REAL_TIME, real_time(table.predictive)))
    if table.estimation is not None:
        yield f"{REAL_TIME}, {ADAPTED}", real_time(table.predictive)
    yield CONVERGED, converged(table.predictive)


def _right(task: Task) -> Iterator[Gait]:
    """Inputs where the worm obeys the law that is believed: open loop, in real time, converged."""
    table = task.scene.table.predictive
    yield course_of(task.plan)
    for decisions in (real_time(table), converged(table)):
        yield _decided(task, decisions, contact=Smooth(table.v_reg)).inputs


def _decided(
    task: Task,
    decisions: Decisions,
    *,
    learns: bool = False,
    p: Draw | None = None,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    plan: Plan | None = None,
) -> Receded:
    table = task.scene.table
    return recede(
        task.plant,
        plan or task.plan,
        decisions,
        estimation=learning(table.estimation, table.predictive) if learns else None,
        p=p,
        contact=contact,
        tolerance=tolerance_of(table.tolerance) if p is None else _LOOSE,
    )


def _replay(
    task: Task, course: Gait | None, tolerance: Tolerance, contact: Treatment
) -> Trajectory:
    """Simulate inputs, or LQR, as one motion."""
    span = task.scene.table.time
    return simulate_whole(task.judged(course), span.end, span.samples, contact, tolerance, silent)


def _row(task: Task, name: str, decisions: Decisions | None, report: Report) -> Row:
    table = task.scene.table
    report(name, 0.3)
    receded = decisions and _decided(task, decisions, learns=name.endswith(ADAPTED))
    course = receded.inputs if receded else course_of(task.plan) if name == OPEN else None
    motion = _replay(task, course, tolerance_of(table.tolerance), Exact())
    second = None
    if table.tolerance.recheck and course is not None:
        driven = drive(with_reference(task.plant, task.reference), course)
        second = cross_check(driven, motion, tolerance_of(table.tolerance), report=silent)
    return Row(name, motion, second, task.told(motion), receded)


def _draws(task: Task) -> list[Draw]:
    plants = task.scene.table.plants
    if plants is None:
        return []
    return drawn_plants(task.plant, plants.spread, plants.seed, plants.members)


def _on_plant(task: Task, row: Row, draw: Draw) -> None:
    """Move a plant that is not as believed by a controller that does not know."""
    if row.receded is None:
        row.drawn.append(_simulated(task, course_of(task.plan) if row.name == OPEN else None, draw))
        return
    decisions = dict(_controllers(task))[row.name] or Decisions()
    try:
        receded = _decided(task, decisions, learns=row.name.endswith(ADAPTED), p=draw)
    except SolveError:
        row.drawn.append(_LOST)
        return
    row.learnt.append(receded)
    row.drawn.append(_simulated(task, receded.inputs, draw))


def _simulated(task: Task, course: Gait | None, draw: Draw) -> dict[str, Any]:
    """Numbers of a plant under a course of inputs or LQR; not numbers where it is given up."""
    end = task.scene.table.time.end
    with suppress(SolveError):
        times = np.linspace(0.0, end, 501)
        motion = simulate(task.judged(course), end, p=draw, times=times, tolerance=_LOOSE)
        return task.told(motion)
    return _LOST


def _known(task: Task, draw: Draw) -> list[dict[str, Any]]:
    """Open loop and in real time by somebody who knows the plant."""
    table = task.scene.table
    with suppress(SolveError):
        plan = plan_tracking(task.plant, task.reference, table.time.end, table.predictive, p=draw)
        receded = _decided(task, real_time(table.predictive), p=draw, plan=plan)
        return [_simulated(task, course, draw) for course in (course_of(plan), receded.inputs)]
    return [_LOST, _LOST]


# -- what is said of it ----------------------------------------------------------------------------


def _result(
    task: Task,
    rows: Sequence[Row],
    right: Sequence[float],
    draws: Sequence[Draw],
    known: Sequence[Sequence[dict[str, Any]]],
    timings: dict[str, float],
) -> Result:
    scene = task.scene
    scalars = _scalars(task, rows, right, draws)
    drawn = {row.name: row.drawn for row in rows if row.drawn}
    drawn |= {name: [each[k] for each in known] for k, name in enumerate(KNOWN)}
    return conclude(
        scene,
        scalars,
        _signals(task, rows, draws),
        checks=_checks(task, rows, scalars["excess"]),
        facts={
            "treatment": "smooth law in the optimiser, exact in every simulation",
            "recheck": {
                "error": {row.name: row.second and row.second.error for row in rows},
                "accepted": accepted_error(tolerance_of(scene.table.tolerance)),
            },
            "plan": {"violation": task.plan.violation, "steps": task.plan.steps},
        },
        warnings=_warnings(task, rows),
        timings=timings,
        attributes={
            "controllers": [row.name for row in rows],
            "parameters": _names(task),
            "table": table_of(scene.table, [r.name for r in rows], scalars, drawn),
        },
    )


def _scalars(
    task: Task, rows: Sequence[Row], right: Sequence[float], draws: Sequence[Draw]
) -> dict[str, Any]:
    table, receded = task.scene.table, [row.receded for row in rows]
    seconds = [each and each.seconds for each in receded]
    errors = [row.second.error for row in rows if row.second and row.second.error is not None]

    def quantile(share: float) -> list[float | None]:
        return [None if s is None else float(np.quantile(s, share)) for s in seconds]

    return {name: [row.numbers[name] for row in rows] for name in (*JUDGED, "cost")} | {
        "tube_radius": table.tube.radius,
        "objective_found": task.plan.objective,
        "plan_steps": task.plan.steps,
        "right_cost": right,
        "excess": max(right[1:]) / right[0] - 1,
        "decisions": len(task.plan.times) - 1,
        "decisions_unsolved": [each and each.unsolved for each in receded],
        "decision_period": table.predictive.seconds * float(np.diff(task.plan.times).min()),
        "decision_median": quantile(0.5),
        "decision_most": quantile(0.95),
        "decision_worst": quantile(1.0),
        "decision_processor": [each and float(np.median(each.processor)) for each in receded],
        "decision_steps": [
            each and float(np.mean([d.steps for d in each.decisions])) for each in receded
        ],
        "parameter_error": _parameter_errors(task, rows, draws),
        "recheck_error": max(errors, default=None),
    }


def _names(task: Task) -> list[str]:
    """Estimated parameters, by name and number."""
    estimation = task.scene.table.estimation
    sizes = {s.name: s.size for s in task.plant.p}
    names = () if estimation is None else estimation.parameters
    return [
        f"{name} {k}" if sizes[name] > 1 else name for name in names for k in range(sizes[name])
    ]


def _estimates(task: Task, rows: Sequence[Row], draws: Sequence[Draw]) -> np.ndarray:
    """Estimated parameters over the plants' own, (parameters, members, decisions)."""
    estimation = task.scene.table.estimation
    learnt = next((row.learnt for row in rows if row.name.endswith(ADAPTED)), [])
    if estimation is None or not draws or len(learnt) < len(draws):
        return np.zeros((0, 0, 0))
    own = numbers_of(task.plant)
    chosen = places(task.plan.stages, estimation.parameters)
    true = [
        np.concatenate([draw.get(name, own[name]) for name in estimation.parameters])
        for draw in draws
    ]
    found = [
        each.parameters[chosen] / numbers[:, None]
        for each, numbers in zip(learnt, true, strict=True)
    ]
    return np.array(found).transpose(1, 0, 2)


def _parameter_errors(
    task: Task, rows: Sequence[Row], draws: Sequence[Draw]
) -> list[list[float]] | None:
    """By name of the parameter: as believed, and at the end."""
    shares, names = _estimates(task, rows, draws), _names(task)
    if not shares.size:
        return None
    off = np.log(shares[:, :, [0, -1]]) ** 2
    kinds = list(dict.fromkeys(name.split(" ")[0] for name in names))
    rows_of = [[k for k, name in enumerate(names) if name.split(" ")[0] == kind] for kind in kinds]
    return [np.sqrt(off[chosen].mean(axis=(0, 1))).tolist() for chosen in rows_of]


def _signals(task: Task, rows: Sequence[Row], draws: Sequence[Draw]) -> dict[str, Any]:
    table = task.scene.table
    sampled = []
    for row in rows:
        model = row.motion.system.model
        sampled.append(sample(row.motion, {name: model[name] for name in SHOWN}))
    arrays = {name: np.array([each[name] for each in sampled]) for name in SHOWN}
    none = np.full(len(task.plan.times) - 1, np.nan)
    found: dict[str, Any] = {
        "time": rows[0].motion.time,
        "reference": rows[0].motion["reference"],
        **fitted(arrays, table.variables),
        "decision_time": task.plan.times[:-1],
        "decision_seconds": np.array([r.receded.seconds if r.receded else none for r in rows]),
        **gait_arrays(task.gait),
    }
    if draws:
        for name in ("cost", "error_peak", "distance"):
            none = [_LOST] * len(draws)
            values = [[each[name] for each in row.drawn or none] for row in rows]
            found[f"drawn_{name}"] = np.array(values)
    estimates = _estimates(task, rows, draws)
    return found | ({"estimated": estimates} if estimates.size else {})


def _checks(task: Task, rows: Sequence[Row], excess: float) -> Iterator[Check]:
    tolerance = tolerance_of(task.scene.table.tolerance)
    for row in rows:
        yield from chain_checks(row.second, balance(row.motion), tolerance, row.name)
        if row.receded is not None:
            yield _replayed(task, row)
    advice = (
        "the model is right, and yet predictive control costs more than the open loop, by a share "
        f"of {excess:.2g}; write a smaller predictive.period, or a larger predictive.v_reg"
    )
    name = "as good as the open loop where the model is right"
    yield Check(name, max(excess, 0.0), _AS_GOOD, advice)


def _replayed(task: Task, row: Row) -> Check:
    """Whether what was simulated from decision to decision is what the whole simulation says."""
    assert row.receded is not None
    sizes = np.concatenate([np.full(s.size, s.nominal) for s in task.plant.x])
    whole = row.motion.states[: task.plant.n_x, -1]
    off = np.abs(row.receded.states[:, -1] - whole) / np.maximum(sizes, np.abs(whole))
    error, accepted = float(off.max()), accepted_error(tolerance_of(task.scene.table.tolerance))
    advice = (
        f"{row.name}: simulated as one motion, the decisions lead elsewhere, by {error:.2g} of the "
        f"states' size where {accepted:.2g} is accepted; write a smaller tolerance.relative"
    )
    return Check(f"{row.name}: decisions replayed", error, accepted, advice)


def _warnings(task: Task, rows: Sequence[Row]) -> Iterator[str]:
    period = task.scene.table.predictive.seconds * float(np.diff(task.plan.times).min())
    for row in rows:
        if row.receded is None:
            continue
        seconds, processor = (
            float(np.median(each)) for each in (row.receded.seconds, row.receded.processor)
        )
        if seconds > period:
            busy = processor < period
            yield (
                f"{row.name}: the median decision takes {seconds:.3g} s on this machine, longer "
                f"than the {period:.3g} s between decisions"
                + (f"; {processor:.3g} s of the processor, which is busy" if busy else "")
            )
        if row.receded.unsolved:
            yield f"{row.name}: {row.receded.unsolved} decisions were not solved"
        lost = sum(not np.isfinite(each["cost"]) for each in row.drawn)
        if lost:
            yield f"{row.name}: {lost} of the plants could not be simulated"
    if not task.scene.table.tolerance.recheck:
        yield "not rechecked by a second route: tolerance.recheck is false"
