"""Second route to the best times of switching: phases with free durations, by collocation."""

from __future__ import annotations

import casadi as ca
import numpy as np

from wormopt.model.modes import ModeSequence
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.switching.switching import (
    ANCHORED,
    OFF,
    Aim,
    Switched,
    SwitchedWorm,
    SwitchLimits,
)

# it begins at an optimum
_SOLVER = Ipopt(tolerance=1e-12, mu_init=1e-9, warm=True)
_ROUNDS = 4


def switching_problem(
    worm: SwitchedWorm, aim: Aim, limits: SwitchLimits, holding: np.ndarray
) -> Problem:
    """Return the problem: largest displacement per time, or per time that coils are on.

    `holding`: the segments that touch the wall.
    """
    model = worm.model
    n, contact = worm.segments, worm.ground.contact
    ends = Ends.of(model, n + len(holding))
    way, on = ends.end[-1] - ends.start[-1], ends.integrals[:n]
    integrands = model["coil"]
    size = model.x[0].nominal
    bounds = [
        Constraint("start", ends.start[-1], 0.0, 0.0, size),
        Constraint("limits.duty", on / ends.duration, upper=limits.duty),
        Constraint("limits.dwell", on, limits.dwell, nominal=worm.time),
        Constraint("limits.dwell", ends.duration - on, limits.dwell, nominal=worm.time),
    ]
    if limits.speed is not None:
        slowest = limits.speed
        bounds.append(Constraint("objective.speed", way / ends.duration, slowest, nominal=slowest))
    if contact is not None:
        # the length is constant at the wall, so its mean there gives it in one equation
        above = (model["anchored"] * (model["length"] - contact))[holding.tolist()]
        integrands = ca.vertcat(integrands, above)
        area = size * worm.time
        bounds.append(Constraint("ground.contact", ends.integrals[n:], 0.0, 0.0, area))
    return Problem(
        model,
        ends,
        -way / (ends.duration if aim == "speed" else ca.sum1(on)) / worm.speed,
        limits.period,
        periodic=["length"],
        integrands=integrands,
        boundary_constraints=bounds,
    )


def polish(
    worm: SwitchedWorm,
    aim: Aim,
    limits: SwitchLimits,
    found: Switched,
    mesh: Mesh,
    tolerance: float,
    report: Report = silent,
) -> Optimum:
    """Optimise the times of an order again, from those found; `mesh` is that of one phase.

    Raises SolveError if this fails.
    """
    order, durations = found.lasting
    given = _inputs(worm, order)
    active = tuple(tuple((2 * state - 1).tolist()) for state in given)
    phases = Mesh.even(len(order), mesh.total, mesh.collocation)
    best = optimise(
        switching_problem(worm, aim, limits, np.flatnonzero((order == ANCHORED).any(axis=0))),
        phases,
        FixedModes(ModeSequence(((),) * len(order)), active),
        guess_of(worm, order, durations, found.start),
        solver=_SOLVER,
        report=report,
    )
    return refine(best, tolerance, rounds=_ROUNDS, solver=_SOLVER, report=report)


def guess_of(
    worm: SwitchedWorm, order: np.ndarray, durations: np.ndarray, start: np.ndarray
) -> Guess:
    """Return the lengths of a switched motion over its arcs, without its displacement."""
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    targets = np.where(order != OFF, worm.on, worm.off)
    taus = np.where(order != OFF, worm.tau_on, worm.tau_off)
    taus = np.where(order == ANCHORED, np.inf, taus)
    inputs = _inputs(worm, order)
    begins = [start]
    for target, tau, d in zip(targets, taus, durations, strict=True):
        begins.append(target + (begins[-1] - target) * np.exp(-d / tau))

    def arc_of(t: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(durations) - 1)

    def states(t: np.ndarray) -> np.ndarray:
        k = arc_of(t)
        fade = np.exp(-(t - breaks[k])[:, None] / taus[k])
        lengths = targets[k] + (np.array(begins)[k] - targets[k]) * fade
        return np.vstack([lengths.T, 0 * t])

    return Guess(
        float(breaks[-1]), states, lambda t: inputs[arc_of(t)].T.astype(float), phases=durations
    )


def _inputs(worm: SwitchedWorm, order: np.ndarray) -> np.ndarray:
    """Return inputs of the Model, arc by arc: coils on, and anchored segments in a tube."""
    coils, anchored = (order != OFF).astype(int), (order == ANCHORED).astype(int)
    return coils if worm.ground.contact is None else np.hstack([coils, anchored])
