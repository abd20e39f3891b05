"""Optimal tracking: the problem, its first guess from a simulated LQR, and its solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.control.loop import Reference, TrackingError, input_of, with_reference
from wormopt.control.lqr import lqr
from wormopt.errors import ArgumentError, SolveError
from wormopt.lazy import on_use
from wormopt.model.gait import Gait
from wormopt.model.model import Model, pack
from wormopt.model.schedule import Schedule
from wormopt.model.values import nominal_of, signal_values
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import FEASIBLE, Optimum, optimise
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.tables import (
    Grid,
    LeastError,
    LeastInput,
    Relaxation,
    Tube,
)

with on_use():  # slow to import, and only crawls need it
    from scipy.interpolate import CubicHermiteSpline

# Default weight of the error in the LQR that starts the solves, in usual sizes.
_STIFF = 1e3
# With more arcs, a solve takes longer than the default of `relaxation.time_limit`.
_ARCS = 10_000
# Weight of an arc of the first guess in the scaled objective, and the least mean squares, in
# nominal sizes, used for scaling.
_AN_ARC, _LEAST = 10, 1e-6
_SOLVER = Ipopt(tolerance=1e-7, iterations=300)
_ADVICE = {
    "late": "write a larger relaxation.time_limit, fewer mesh.arcs or a smaller time.end",
    "not_solved": "write a larger relaxation.last, another number of mesh.arcs, or wider limits",
}
# `optimise` starts close to a solution, so these settings of the solver suffice.
_WARM = replace(_SOLVER, mu_init=1e-3)


def tracking_problem(
    plant: Model,
    reference: Reference,
    end: float,
    objective: LeastError | LeastInput,
    tube: Tube,
) -> Problem:
    """State optimal tracking from the plant's initial state to the time `end`.

    The plant has the input ``input`` and the output ``length``; the tube holds under `LeastInput`.
    Integrals of the problem are those of |e|^2 and |u|^2.
    """
    error = TrackingError.of(plant, reference)
    model = with_reference(plant, reference)
    ends = Ends.of(plant, 2)
    missed, spent = ends.integrals[0], ends.integrals[1]
    along = []
    if isinstance(objective, LeastError):
        cost = missed + objective.input_weight * spent
    else:
        cost = spent
        active = _active_from(tube.capture, end)
        model = replace(model, schedules=[*model.schedules, active])
        radius = (1 - objective.margin) * tube.radius
        along = [Constraint("tube", active.symbol * error.square / radius**2, upper=1.0)]
    u = input_of(plant, error.value.numel()).symbol
    start = signal_values(plant.x, None, "state")
    return Problem(
        model,
        ends,
        cost,
        (end, end),
        integrands=ca.vertcat(error.square, ca.sumsqr(u)),
        path_constraints=along,
        boundary_constraints=[Constraint("start", ends.start, start, start)],
    )


def _active_from(capture: float, end: float) -> Schedule:
    """1 from the time of capture on, 0 before: the value is constant on each arc."""
    symbol, begin = ca.SX.sym("tube_asked"), ca.SX.sym("tube_asked_begin")
    breaks = np.array([0.0, capture, end]) if capture > 0 else np.array([0.0, end])
    values = np.array([[0.0], [1.0]])[-len(breaks) + 1 :]
    return Schedule("tube_asked", symbol, begin, breaks, values)


def followed_by_lqr(
    plant: Model, reference: Reference, end: float, error_weight: float
) -> Trajectory:
    """Simulate an LQR with feed-forward exactly: a motion near the reference as first guess.

    `error_weight` is that of |e|^2, relative to the squared correction to the feed-forward.
    """
    try:
        loop = lqr(plant, reference, error_weight=error_weight)
    except ArgumentError as error:
        raise SolveError(
            f"no LQR exists as first guess: {error}",
            "choose units in which masses, damping and stiffness are closer to 1",
        ) from None
    return simulate(loop, end, dense=True)


def scaled(problem: Problem, near: Trajectory, arcs: int) -> Problem:
    """Scale a `tracking_problem` by a motion near the optimum, so solves are equal in all units."""
    model, end = problem.model, near.end_time
    seen = near.at((np.arange(arcs) + 0.5) / arcs * end)
    mean = [float(np.mean(np.sum(seen[name] ** 2, axis=0))) for name in ("error", "input")]
    usual = _usual(model)
    sizes = end * np.maximum(mean, _LEAST * np.square(usual))
    tallies = problem.ends.integrals
    cost = ca.Function("cost", [tallies], [problem.minimise])
    return replace(
        problem,
        integrands=problem.integrands / sizes,
        minimise=ca.substitute(problem.minimise, tallies, tallies * sizes),
        nominal=float(cost(sizes)) / (_AN_ARC * arcs),
    )


def _usual(plant: Model) -> np.ndarray:
    """Nominal sizes of a link's length and of its input."""
    return np.array([nominal_of(plant.x)[0], nominal_of(plant.u)[0]])


def optimal_input(
    plant: Model,
    reference: Reference,
    end: float,
    objective: LeastError | LeastInput,
    tube: Tube,
    grid: Grid,
    relaxation: Relaxation,
    *,
    period: float,
    report: Report = silent,
) -> Optimum:
    """Find the optimal input of `tracking_problem` with contact as a complementarity.

    The grid is relative to `period`, that of the reference. Raises SolveError if none is found.
    """
    if end > _ARCS * period / grid.arcs:
        raise SolveError(
            f"mesh.arcs = {grid.arcs} a period of {period:g} makes {end * grid.arcs / period:.3g} "
            f"arcs until time.end, but at most {_ARCS:g} are allowed; write a smaller time.end or "
            "fewer arcs"
        )
    problem = tracking_problem(plant, reference, end, objective, tube)
    breaks = problem.model.breaks(end)
    mesh = Mesh.over(breaks, period / grid.arcs, Collocation(grid.degree, "radau"))
    if isinstance(objective, LeastError):
        weight = 1 / objective.input_weight
    else:
        length, force = _usual(plant)
        weight = _STIFF * (force / length) ** 2
    near = followed_by_lqr(plant, reference, end, weight)
    if isinstance(objective, LeastInput) and tube.capture == 0:
        _refuse_start_outside(near, (1 - objective.margin) * tube.radius)
    problem = scaled(problem, near, mesh.total)
    treatment = Complementarity(relaxation.last, relaxation.first)
    # An LQR is close to the motion with the least error, but not to that with the least input.
    solver = _WARM if isinstance(objective, LeastError) else _SOLVER
    solver = replace(solver, seconds=relaxation.time_limit)
    try:
        return optimise(problem, mesh, treatment, Guess.of(near), solver=solver, report=report)
    except SolveError as error:
        if error.code not in _ADVICE:
            raise
        raise SolveError(error.reason, _ADVICE[error.code], error.partial, error.code) from None


def _refuse_start_outside(near: Trajectory, radius: float) -> None:
    off = float(np.linalg.norm(near.at(np.zeros(1))["error"]))
    if off > radius:
        raise SolveError(
            f"the initial error {off:.4g} is outside the tube ({radius:.4g}, minus "
            "objective.margin), but tube.capture = 0 requires it to be inside from the start",
            "write a larger tube.capture or tube.radius, or another start.position",
            code="infeasible",
        )


def knowing(
    optimum: Optimum, p: Mapping[str, ArrayLike], seconds: float | None = None
) -> Motion | None:
    """Find the optimal motion of a plant with other parameters, from that of the nominal plant.

    `optimum` is with complementarity; a solve takes at most `seconds`. None if no motion is found
    in that time.
    """
    program, w = optimum.motion.program, optimum.solution.w
    solution = optimum.solution
    bounds = optimum.bounds
    for level in [each.level for each in optimum.levels][-2:]:
        bounds = program.bounds(level, p=p)
        solution = program.nlp.solve(w, bounds, replace(_WARM, seconds=seconds))
        w = solution.w
    if not (solution.success and solution.violation <= FEASIBLE):
        return None
    return Motion.of(program, w, bounds)


def lengths_of(motion: Motion, parts: int = 1) -> Gait:
    """Link lengths of an optimal motion of a chain over time, with `parts` cubics per arc.

    Lengths and rates are those of the motion where cubics meet.
    """
    model, breaks = motion.program.problem.model, motion.breaks
    kept = breaks[np.append(np.diff(breaks) > 1e-9 * motion.duration, True)]
    kept[0] = 0.0
    t = np.append((kept[:-1, None] + np.outer(np.diff(kept), np.arange(parts) / parts)), kept[-1])
    states = motion.states(t)
    known = signal_values(model.p, None, "parameter")
    observe = ca.Function("links", [pack(model.x), pack(model.p)], [model["length"], model["rate"]])
    length, rate = (np.array(part) for part in observe(states, known))
    powers = CubicHermiteSpline(t, length, rate, axis=1).c[::-1]
    return Gait(t, np.moveaxis(powers, 0, -1))
