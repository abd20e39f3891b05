"""Explains why a problem has no solution: adds slack to named limits and finds which need it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.model.model import Signal
from wormopt.ocp.problem import Constraint, Problem


def with_input_limits(problem: Problem) -> Problem:
    """Write the limits of inputs as bounds, named like the inputs.

    `elastic` may then relax these limits too.
    """
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
