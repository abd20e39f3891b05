"""Predictive tracking of a chain: the plan, and decisions for nominal and other plants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from wormopt.control.estimation import Estimation
from wormopt.control.predictive import MpcOptions, MpcPlan, plan_mpc
from wormopt.control.reference import Reference
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.systems.chain.optimal_tracking import followed_by_lqr, tracking_problem
from wormopt.systems.chain.scenes.predictive import EstimationTable, PredictiveTable
from wormopt.systems.chain.tables import LeastError, TubeTable

# Ratio of the first to the last width of the smooth law: the guess is close to the optimum.
_WIDER = 2.0
# Collocation points on each arc.
_DEGREE = 2


def plan_tracking(
    plant: Model,
    reference: Reference,
    end: float,
    table: PredictiveTable,
    *,
    p: Mapping[str, ArrayLike] | None = None,
) -> MpcPlan:
    """Plan the motion from 0 to `end` on arcs of one decision each; `p` are other parameters.

    Raises SolveError if no plan is found.
    """
    bounded, free = limited(plant, table.force), limited(plant, None)
    objective = LeastError(input_weight=table.input_weight)
    problem = tracking_problem(bounded, reference, end, objective, TubeTable(radius=1.0))
    breaks = problem.model.breaks(end)
    mesh = Mesh.over(breaks, table.period, Collocation(_DEGREE, "radau"))
    guess = Guess.of(followed_by_lqr(free, reference, end, 1 / table.input_weight))
    contact = Regularised(table.v_reg, _WIDER * table.v_reg, ratio=1 / _WIDER)
    return plan_mpc(problem, mesh, contact, guess, p=p)


def limited(plant: Model, force: float | None) -> Model:
    """The plant with a limit on the size of its inputs, or without one."""
    limit = np.inf if force is None else force
    return replace(plant, u=[replace(u, lower=-limit, upper=limit) for u in plant.u])


def course_of(plan: MpcPlan) -> Gait:
    """Inputs of a plan as a function of time."""
    return Gait(plan.times, plan.inputs[:, :, None])


def real_time(table: PredictiveTable) -> MpcOptions:
    """Decisions of one step."""
    return MpcOptions(_arcs(table.horizon, table))


def converged(table: PredictiveTable) -> MpcOptions:
    """Decisions that iterate until they converge."""
    return MpcOptions(_arcs(table.horizon, table), table.steps)


def learning(table: EstimationTable | None, predictive: PredictiveTable) -> Estimation | None:
    """Estimation settings of a scene, in decisions instead of time."""
    if table is None:
        return None
    return Estimation(
        table.parameters,
        _arcs(table.window, predictive),
        table.noise,
        table.spread,
        np.inf if table.memory is None else table.memory / predictive.period,
    )


def _arcs(time: float, table: PredictiveTable) -> int:
    return max(1, round(time / table.period))
