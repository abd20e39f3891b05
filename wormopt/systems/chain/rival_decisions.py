"""Predictive control in a comparison: decisions for the nominal plant and for all others.

The decisions are kept as inputs over time for each plant, so they are evaluated like all others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from wormopt.control.estimation import Estimation
from wormopt.control.predictive import MpcPlan
from wormopt.control.receding import MpcRun, run_mpc
from wormopt.control.reference import gait_reference
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.simulation.options import Tolerance
from wormopt.systems.chain.copies import Draw
from wormopt.systems.chain.predictive_tracking import learning, plan_tracking, real_time
from wormopt.systems.chain.rivals import plant_of
from wormopt.systems.chain.scenes.compare_tracking import CompareScene
from wormopt.systems.chain.scenes.predictive import PredictiveTable

REAL_TIME, LEARNING = "predictive", "predictive + estimation"
"""Names of the controllers in tables and pictures."""

# Between decisions the simulation is less exact than the later simulation of all decisions.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)


@dataclass(frozen=True, eq=False)
class DecisionJob:
    """Work of one process."""

    name: str
    table: CompareScene
    gait: Gait  # the reference
    draws: Sequence[Draw]


@dataclass(frozen=True, eq=False)
class Decided:
    """Inputs decided; None where a simulation failed."""

    believed: Gait | None  # for the worm as it is believed; None: there is no plan
    others: tuple[Gait | None, ...]
    unsolved: int = 0  # decisions, of all plants, whose quadratic program was not solved
    # time that decisions take, in s, the time between them, or why there is no plan
    numbers: dict[str, float | str] = field(default_factory=dict)


def decision_jobs(
    table: CompareScene, gaits: Sequence[Gait], draws: Sequence[Draw]
) -> Iterator[DecisionJob]:
    """Jobs of all predictive controllers of a scene, reference by reference."""
    if table.predictive is not None:
        for gait in gaits:
            if table.estimation is not None:
                yield DecisionJob(LEARNING, table, gait, draws)
            yield DecisionJob(REAL_TIME, table, gait, draws)


def decide(job: DecisionJob) -> Decided:
    """Plan, then decide for the nominal plant and each other plant. It raises no exception."""
    table = job.table.predictive
    assert table is not None
    learns = learning(job.table.estimation, table) if job.name == LEARNING else None
    plant = plant_of(job.table, job.gait)
    try:
        reference = gait_reference(job.gait, plant.t)
        plan = plan_tracking(plant, reference, job.table.time.end, table)
        believed = _decided(plant, plan, table, learns, None)
    except SolveError as error:
        return Decided(None, (None,) * len(job.draws), numbers={"reason": str(error)})
    others = [_other(plant, plan, table, learns, draw) for draw in job.draws]
    unsolved = sum(each.unsolved for each in (believed, *others) if each)
    median, most, worst = np.quantile(believed.seconds, (0.5, 0.95, 1.0)).tolist()
    numbers: dict[str, float | str] = {
        "decision_median_s": median,
        "decision_95_s": most,
        "decision_worst_s": worst,
        "decision_processor_s": float(np.median(believed.processor)),
        "decision_period_s": table.seconds * float(np.diff(plan.times).min()),
    }
    courses = tuple(each and each.inputs for each in others)
    return Decided(believed.inputs, courses, unsolved, numbers)


def _decided(
    plant: Model,
    plan: MpcPlan,
    table: PredictiveTable,
    learns: Estimation | None,
    draw: Draw | None,
) -> MpcRun:
    return run_mpc(plant, plan, real_time(table), estimation=learns, p=draw, tolerance=_LOOSE)


def _other(
    plant: Model, plan: MpcPlan, table: PredictiveTable, learns: Estimation | None, draw: Draw
) -> MpcRun | None:
    try:
        return _decided(plant, plan, table, learns, draw)
    except SolveError:
        return None
