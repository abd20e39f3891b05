"""Why a problem has no solution: give every named limit some slack and see which need it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.core.model import Signal
from wormopt.optimal.problem import Bound, Problem

__all__ = ["elastic"]


def elastic(problem: Problem) -> Problem:
    """Let every inequality give way at a price, and ask for the least giving way in all.

    Parameters
    ----------
    problem : Problem
        Possibly infeasible.

    Returns
    -------
    Problem
        With one design constant "slack <name>" per name of a bound, in units of its nominal
        size; those that come out positive name the limits in conflict.

    Examples
    --------
    >>> import casadi as ca
    >>> from wormopt.core.model import Model
    >>> from wormopt.optimal.problem import Ends
    >>> v = ca.SX.sym("v")
    >>> model = Model("cart", x=[Signal("position", ca.SX.sym("q"))], ode=v, u=[Signal("v", v)])
    >>> ends = Ends.of(model)
    >>> far = Bound("distance", ends.end - ends.start, 5.0)
    >>> slow = Bound("speed", v, -1.0, 1.0)
    >>> problem = Problem(model, ends, ca.SX(0), (1.0, 1.0), along=[slow], at_ends=[far])
    >>> [s.name for s in elastic(problem).design]
    ['slack distance', 'slack speed']
    """
    names = sorted({b.name for b in (*problem.along, *problem.at_ends) if not _is_equality(b)})
    slack = {name: Signal(f"slack {name}", ca.SX.sym("slack"), "1", 1.0, 0.0) for name in names}

    def give(bound: Bound) -> list[Bound]:
        if _is_equality(bound):
            return [bound]
        low, high = bound.scaled
        size = slack[bound.name].symbol
        expression = bound.expression / bound.nominal
        parts = []
        if np.any(np.isfinite(low)):
            parts.append(Bound(bound.name, expression + size, low.tolist()))
        if np.any(np.isfinite(high)):
            parts.append(Bound(bound.name, expression - size, upper=high.tolist()))
        return parts

    return replace(
        problem,
        minimise=ca.sum1(ca.vertcat(ca.SX(0), *(s.symbol for s in slack.values()))),
        along=[part for b in problem.along for part in give(b)],
        at_ends=[part for b in problem.at_ends for part in give(b)],
        design=[*problem.design, *slack.values()],
    )


def _is_equality(bound: Bound) -> bool:
    low, high = bound.scaled
    return bool(np.all(low == high))
