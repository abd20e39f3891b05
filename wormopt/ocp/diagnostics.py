"""Explains why a nonlinear program was not solved: its point, or limits that cannot all be met.

Conflicting limits are found by slack that is added to each named limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Signal
from wormopt.model.modes import ModeSequence
from wormopt.model.values import by_name
from wormopt.ocp.contact import Complementarity, Regularised, Treatment
from wormopt.ocp.motion import Motion
from wormopt.ocp.nlp import Bounds, Ipopt, Solution
from wormopt.ocp.problem import Constraint, Problem
from wormopt.ocp.transcription import Transcription


def with_input_limits(problem: Problem) -> Problem:
    """Write the limits of inputs as bounds, named like the inputs."""
    free = [replace(s, lower=-np.inf, upper=np.inf) for s in problem.model.u]
    limits = [
        Constraint(s.name, s.symbol, s.lower, s.upper, s.nominal)
        for s in problem.model.u
        if np.isfinite(s.lower) or np.isfinite(s.upper)
    ]
    return replace(
        problem,
        model=replace(problem.model, u=free),
        path_constraints=[*problem.path_constraints, *limits],
    )


def elastic(problem: Problem, *, equalities: bool = False) -> Problem:
    """Relax every inequality at a price, and minimise the total relaxation.

    `equalities`: also every equality. Adds a design constant "slack <name>" per name of a bound,
    in units of its nominal size; positive ones name the limits in conflict.
    """
    names = sorted(
        {
            b.name
            for b in (*problem.path_constraints, *problem.boundary_constraints)
            if equalities or not _is_equality(b)
        }
    )
    slack = {name: Signal(f"slack {name}", ca.SX.sym("slack"), "1", 1.0, 0.0) for name in names}

    def give(bound: Constraint) -> list[Constraint]:
        if not equalities and _is_equality(bound):
            return [bound]
        low, high = bound.scaled
        size = slack[bound.name].symbol
        expression = bound.expression / bound.nominal
        parts = []
        if np.any(np.isfinite(low)):
            parts.append(Constraint(bound.name, expression + size, low.tolist()))
        if np.any(np.isfinite(high)):
            parts.append(Constraint(bound.name, expression - size, upper=high.tolist()))
        return parts

    return replace(
        problem,
        minimise=ca.sum1(ca.vertcat(ca.SX(0), *(s.symbol for s in slack.values()))),
        nominal=1.0,
        path_constraints=[part for b in problem.path_constraints for part in give(b)],
        boundary_constraints=[part for b in problem.boundary_constraints for part in give(b)],
        design=[*problem.design, *slack.values()],
    )


def _is_equality(bound: Constraint) -> bool:
    low, high = bound.scaled
    return bool(np.all(low == high))


# Scaled variables larger than at the start by this factor: the objective is unbounded.
_BEYOND = 1e6

FEASIBLE = 1e-6
"""Largest violation, in nominal sizes, of a solution."""

# Slack, in nominal sizes, below which a limit is not in conflict, and its accuracy.
_GIVES_WAY, _MET = 1e-5, 1e-5


def failure(
    program: Transcription,
    solution: Solution,
    bounds: Bounds,
    start: np.ndarray,
    level: ModeSequence | float,
    seconds: float | None,
    *,
    explain: bool = True,
) -> SolveError:
    """Explain a failed solve that started at `start` (n_w,).

    Returns the SolveError, with the motion reached as ``partial``. `explain`: search for limits in
    conflict; each of these solves gets as many `seconds` as one of the problem.
    """
    partial = Motion.of(program, solution.w, bounds)
    if solution.status == "Invalid_Number_Detected" or not np.all(np.isfinite(start)):
        return SolveError(
            "the equations have no finite value at the first guess or near it",
            "write another guess",
            partial,
            "bad_guess",
        )
    if solution.late:
        return SolveError(
            f"not solved within the time limit: {_worst(program, solution, bounds)} after "
            f"{solution.iterations} iterations",
            "allow more time, or use fewer arcs",
            partial,
            "late",
        )
    known = solution.violation <= FEASIBLE or not explain
    if gives := {} if known else _conflict(program, level, start, partial.p, seconds):
        # The sizes are a local optimum at the last solved level: two digits are reliable.
        listed = " and ".join(f"{name} by about {size:.2g}" for name, size in gives.items())
        return SolveError(
            f"no motion meets all limits; the smallest change that allows one is {listed}",
            "relax that, or a limit in conflict with it",
            partial,
            "infeasible",
        )
    if (
        np.max(np.abs(solution.w)) > _BEYOND * max(1.0, np.max(np.abs(start)))
        or solution.status == "Diverging_Iterates"
    ):
        return SolveError(
            "the objective decreases without bound",
            "limit the inputs, the states or the duration",
            partial,
            "unbounded",
        )
    where = "" if isinstance(level, ModeSequence) else f" at level {level:.3g}"
    return SolveError(
        f"not solved{where}: {_worst(program, solution, bounds)} "
        f"({solution.status}, {solution.iterations} iterations)",
        "try another guess, more or fewer arcs, or a slower homotopy (ratio nearer to 1)",
        partial,
        "not_solved",
    )


def _conflict(
    program: Transcription,
    level: ModeSequence | float,
    start: np.ndarray,
    p: np.ndarray,
    seconds: float | None,
    *,
    equalities: bool = False,
) -> dict[str, float]:
    """Limits that must be relaxed for any motion to exist near the start, in their own units."""
    # Equalities are relaxed if requested, or if there are several and relaxing inequalities alone
    # is not enough.
    problem = with_input_limits(program.problem)
    loose = elastic(problem, equalities=equalities)
    more = len(elastic(problem, equalities=True).design) > len(loose.design) + 1
    if len(loose.design) == len(problem.design):
        return _conflict(program, level, start, p, seconds, equalities=True) if more else {}
    treatment = program.treatment
    relaxed = Transcription(loose, program.mesh, treatment)
    n = len(loose.design) - len(problem.design)
    w = np.concatenate([np.where(np.isfinite(start), start, 0.0), np.zeros(n)])
    objective = 0.0
    for each in _levels_from(treatment, level):  # the sharper the law, the more must be relaxed
        bounds = relaxed.bounds(each, p=by_name(problem.parameters, p))
        if each == level:  # excessive slack meets every limit at the start
            g = relaxed.nlp.constraints(w, bounds)
            w[-n:] = 1.0 + np.max(np.maximum(bounds.lbg - g, g - bounds.ubg), initial=0.0)
        # the successful barrier is a matter of luck
        for barrier in (0.1,) if equalities else (0.1, 1e-3):
            patient = Ipopt(tolerance=1e-7, iterations=1000, mu_init=barrier, seconds=seconds)
            answer = relaxed.nlp.solve(w, bounds, patient)
            if answer.violation <= _MET:
                break
        else:
            if each == level and more:
                return _conflict(program, level, start, p, seconds, equalities=True)
            break
        w, objective = answer.w, answer.objective
    if objective < _GIVES_WAY:
        return {}
    nominal = {
        b.name: b.nominal for b in (*problem.path_constraints, *problem.boundary_constraints)
    }
    names = [s.name.removeprefix("slack ") for s in loose.design[-n:]]
    return {
        name: float(size) * nominal[name]
        for name, size in zip(names, w[-n:], strict=True)
        if size > _GIVES_WAY
    }


def _levels_from(
    treatment: Treatment, level: ModeSequence | float
) -> Sequence[ModeSequence | float]:
    """Level at which a solve failed, and those that would have followed."""
    if isinstance(level, ModeSequence) or not isinstance(treatment, Regularised | Complementarity):
        return (level,)
    return [each for each in treatment.levels if each <= level]


def _worst(program: Transcription, solution: Solution, bounds: Bounds) -> str:
    """The largest violation, in words."""
    if solution.violation <= FEASIBLE:
        return "all limits hold, but the objective is not minimal"
    g = program.nlp.constraints(solution.w, bounds)
    excess = np.maximum(bounds.lbg - g, g - bounds.ubg)
    row = int(np.argmax(excess))
    return f"{program.name_of(row)} is violated by {excess[row]:.2g} nominal sizes"
