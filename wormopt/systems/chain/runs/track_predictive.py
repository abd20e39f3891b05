"""Run scenes of kind ``track-predictive``: predictive control, open-loop optimum and LQR."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.loop import with_reference
from wormopt.control.predictive import MpcOptions, MpcPlan
from wormopt.control.receding import MpcRun, run_mpc
from wormopt.control.reference import gait_reference
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.progress import Report, silent
from wormopt.result import Result
from wormopt.simulation.options import Exact, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.scene import Scene
from wormopt.systems.chain.copies import Draw, drawn_plants
from wormopt.systems.chain.loops import chain_for, draw_links
from wormopt.systems.chain.predictive_tracking import (
    converged,
    course_of,
    learning,
    limited,
    plan_tracking,
    real_time,
)
from wormopt.systems.chain.runs.predictive_results import result_of
from wormopt.systems.chain.runs.predictive_task import (
    ADAPTED,
    CONVERGED,
    LOST,
    LQR,
    OPEN,
    REAL_TIME,
    Row,
    Task,
)
from wormopt.systems.chain.scenes.track_predictive import TrackPredictiveScene
from wormopt.systems.shared.optimum import refused
from wormopt.systems.shared.proof import cross_check
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import simulate_whole
from wormopt.systems.spiked import gait_of_shape

# Drawn plants are simulated less exactly, since they differ by far more.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[TrackPredictiveScene], report: Report) -> Result:
    """Plan, apply every controller to the worm and the plants, and compare.

    The result is "failed" if decisions replayed as one motion end elsewhere, a second route
    disagrees, or predictive control is worse than the open loop with a true model. Raises
    SceneError for a gait's file, SolveError without plan or motion.
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
    return result_of(task, rows, [task.told(each)["cost"] for each in right], draws, known, timings)


def _task(scene: Scene[TrackPredictiveScene]) -> Task:
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    plant = chain_for(table.worm, table.start, draw_links(table.worm, table.time.end), gait)
    reference = gait_reference(gait, plant.t, shift=table.reference.shift % gait.period)
    plan = plan_tracking(plant, reference, table.time.end, table.predictive)
    return Task(scene, gait, limited(plant, table.predictive.force), reference, plan)


def _controllers(task: Task) -> Iterator[tuple[str, MpcOptions | None]]:
    table = task.scene.table
    yield from ((OPEN, None), (LQR, None), (REAL_TIME, real_time(table.predictive)))
    if table.estimation is not None:
        yield f"{REAL_TIME}, {ADAPTED}", real_time(table.predictive)
    yield CONVERGED, converged(table.predictive)


def _right(task: Task) -> Iterator[Gait]:
    """Inputs on a plant with the smooth law of the model: open loop, in real time, converged."""
    table = task.scene.table.predictive
    yield course_of(task.plan)
    for decisions in (real_time(table), converged(table)):
        yield _decided(task, decisions, contact=Smooth(table.v_reg)).inputs


def _decided(
    task: Task,
    decisions: MpcOptions,
    *,
    learns: bool = False,
    p: Draw | None = None,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    plan: MpcPlan | None = None,
) -> MpcRun:
    table = task.scene.table
    return run_mpc(
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


def _row(task: Task, name: str, decisions: MpcOptions | None, report: Report) -> Row:
    table = task.scene.table
    report(name, 0.3)
    receded = decisions and _decided(task, decisions, learns=name.endswith(ADAPTED))
    course = receded.inputs if receded else course_of(task.plan) if name == OPEN else None
    motion = _replay(task, course, tolerance_of(table.tolerance), Exact())
    second = None
    if course is not None:
        driven, asked = drive(with_reference(task.plant, task.reference), course), table.tolerance
        second = cross_check(
            driven, motion, tolerance_of(asked), recheck=asked.recheck, report=silent
        )
    return Row(name, motion, second, task.told(motion), receded)


def _draws(task: Task) -> list[Draw]:
    plants = task.scene.table.plants
    if plants is None:
        return []
    return drawn_plants(task.plant, plants.spread, plants.seed, plants.members)


def _on_plant(task: Task, row: Row, draw: Draw) -> None:
    """Simulate a drawn plant with a controller that does not know it."""
    if row.receded is None:
        row.drawn.append(_simulated(task, course_of(task.plan) if row.name == OPEN else None, draw))
        return
    decisions = dict(_controllers(task))[row.name] or MpcOptions()
    try:
        receded = _decided(task, decisions, learns=row.name.endswith(ADAPTED), p=draw)
    except SolveError:
        row.drawn.append(LOST)
        return
    row.learnt.append(receded)
    row.drawn.append(_simulated(task, receded.inputs, draw))


def _simulated(task: Task, course: Gait | None, draw: Draw) -> dict[str, Any]:
    """Quantities of a plant with inputs over time or LQR; NaN where the simulation fails."""
    end = task.scene.table.time.end
    with suppress(SolveError):
        times = np.linspace(0.0, end, 501)
        motion = simulate(task.judged(course), end, p=draw, times=times, tolerance=_LOOSE)
        return task.told(motion)
    return LOST


def _known(task: Task, draw: Draw) -> list[dict[str, Any]]:
    """Open-loop and real-time control with the true parameters of the plant."""
    table = task.scene.table
    with suppress(SolveError):
        plan = plan_tracking(task.plant, task.reference, table.time.end, table.predictive, p=draw)
        receded = _decided(task, real_time(table.predictive), p=draw, plan=plan)
        return [_simulated(task, course, draw) for course in (course_of(plan), receded.inputs)]
    return [LOST, LOST]
