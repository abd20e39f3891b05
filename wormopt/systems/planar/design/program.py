"""Gaits of planar worms as optimal control problems over a phase from 0 to 1.

Inputs are the derivatives of the shape by the phase and, if time matters, the pace: no rate exceeds
its limit. The displacement does not depend on the pace. On dry ground the twist is an algebraic
variable at which the potential, smoothed over a width that is a parameter, has no slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Model, Output, Signal
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.ground import Dry
from wormopt.systems.planar.design.starts import guess_from


def planar_plant(aim: PlanarAim) -> Model:
    """Return the body whose shape is driven by its rates; the pose is that of the head."""
    shape, width = aim.shape, ca.SX.sym("width")
    position, heading = ca.SX.sym("position", 2), ca.SX.sym("heading")
    twist = shape.twist if isinstance(aim.ground, Dry) else _explicit(aim, shape)
    c, s = ca.cos(heading), ca.sin(heading)
    ode = ca.vertcat(
        shape.rates,
        c * twist[0] - s * twist[1],
        s * twist[0] + c * twist[1],
        twist[2],
    )
    power = ca.substitute(aim.ground.power(shape, width), shape.twist, twist)
    across = position[1] + (s * shape.points[0, :] + c * shape.points[1, :]).T
    along = position[0] + (c * shape.points[0, :] - s * shape.points[1, :]).T
    spans = aim.ranges
    sizes = np.abs(spans).max(axis=1)
    usual = 2 * (spans[:, 1] - spans[:, 0])
    states = [
        Signal(name, shape.s[i], nominal=sizes[i], lower=spans[i, 0], upper=spans[i, 1])
        for i, name in enumerate(shape.names)
    ]
    inputs = [
        Signal(f"{name} rate", shape.rates[i], nominal=usual[i])
        for i, name in enumerate(shape.names)
    ]
    if aim.timed:
        pace, clock = ca.SX.sym("pace"), ca.SX.sym("clock")
        inputs.append(Signal("pace", pace, "time", aim.duration_usual, lower=0.0))
        clocks = [Signal("clock", clock, "time", aim.duration_usual)]
        ode = ca.vertcat(ode, pace)
    else:
        clocks = []
    dry = isinstance(aim.ground, Dry)
    return Model(
        "planar worm",
        x=[
            *states,
            Signal("position", position, "length", aim.length),
            Signal("heading", heading),
            *clocks,
        ],
        ode=ode,
        u=inputs,
        z=_twists(aim, shape) if dry else [],
        alg=_stationary(aim, width) if dry else ca.SX(0, 1),
        p=[Signal("width", width, value=1.0)] if dry else [],
        outputs=[
            Output("power", power, "power"),
            Output("along", along, "length"),
            Output("across", across, "length"),
        ],
    )


def _twists(aim: PlanarAim, shape: Shape) -> list[Signal]:
    speed = 2 * float(aim.reaches.max())
    return [
        Signal("velocity", shape.twist[:2], "speed", speed),
        Signal("turning", shape.twist[2], "rate", speed / aim.length),
    ]


def _stationary(aim: PlanarAim, width: ca.SX) -> ca.SX:
    """Return the slope of the potential by the twist, over the largest resistance."""
    assert isinstance(aim.ground, Dry)
    potential = aim.ground.potential(aim.shape, width)
    sizes = ca.DM([1.0, 1.0, 1.0 / aim.length]) / (aim.ground.most * aim.shape.n_points)
    return ca.gradient(potential, aim.shape.twist) * sizes


def _explicit(aim: PlanarAim, shape: Shape) -> ca.SX:
    """Return the twist on linear drag, where the power is quadratic."""
    hessian, slope = ca.hessian(aim.ground.potential(shape, ca.SX(0)), shape.twist)
    at_rest = ca.substitute(slope, shape.twist, ca.SX.zeros(3))
    return -ca.inv_minor(hessian) @ at_rest


def gait_problem(aim: PlanarAim) -> Problem:
    """Return the optimal control problem of an objective."""
    plant = planar_plant(aim)
    ends = Ends.of(plant, 1)
    n_s = len(aim.shape.names)
    first, last = (part[n_s:] for part in (ends.start, ends.end))
    begin, work = ends.start[:n_s], ends.integrals[0] * aim.usual_work
    time = ends.end[-1] if aim.timed else ca.SX(1)
    held = [Constraint("start", first[0], 0.0, 0.0, aim.length)]
    free_side = aim.limits.half_width is not None
    straight = aim.purpose == "speed"
    if not (straight and free_side):
        held.append(Constraint("start", first[1], 0.0, 0.0, aim.length))
    if straight:
        held.append(Constraint("start", first[2], -np.pi, np.pi))
        held.append(Constraint("no way aside", last[1] - first[1], 0.0, 0.0, aim.length))
    elif aim.purpose == "turn":
        held.append(Constraint("start", first[2], 0.0, 0.0))
        held += _in_place(aim, begin, last)
    else:
        held.append(Constraint("start", first[2], 0.0, 0.0))
        held.append(Constraint("pose", last[:2], aim.step[:2], aim.step[:2], aim.length))
        held.append(Constraint("pose", last[2], aim.step[2], aim.step[2]))
    if aim.timed:
        held.append(Constraint("start", first[3], 0.0, 0.0, aim.duration_usual))
        held.append(Constraint("shortest", time, aim.shortest, nominal=aim.duration_usual))
    if aim.start is not None:
        held.append(Constraint("start shape", begin, aim.start, aim.start))
    if aim.limits.effort is not None:
        effort = aim.limits.effort
        held.append(Constraint("limits.effort", work, upper=effort, nominal=effort))
    objective = {
        "speed": lambda: -last[0] / time,
        "turn": lambda: -last[2] / time,
        "work": lambda: work,
    }[aim.purpose]()
    objective = objective / aim.usual
    along = []
    if aim.limits.half_width is not None:
        room = aim.limits.half_width - aim.limits.radius
        along.append(Constraint("limits.half_width", plant["across"], -room, room, room))
    if aim.timed:
        along += _within_rates(aim, plant)
    periodic = list(aim.shape.names) if aim.closed else []
    return Problem(
        plant,
        ends,
        objective,
        (1.0, 1.0),
        periodic=[*periodic, "heading"] if straight else periodic,
        integrands=plant["power"] * (aim.work_factor / aim.usual_work),
        path_constraints=along,
        boundary_constraints=held,
    )


def _in_place(aim: PlanarAim, begin: ca.SX, last: ca.SX) -> list[Constraint]:
    """Require that the pivot, in the frame at the start, returns."""
    if aim.pivot == "any":
        return []
    points = ca.substitute(aim.shape.points, aim.shape.s, begin)
    place = ca.sum2(points) / points.size2() if aim.pivot == "centre" else points[:, int(aim.pivot)]
    c, s = ca.cos(last[2]), ca.sin(last[2])
    moved = last[:2] + ca.vertcat(c * place[0] - s * place[1], s * place[0] + c * place[1])
    return [Constraint("in place", moved - place, 0.0, 0.0, aim.length)]


def _within_rates(aim: PlanarAim, plant: Model) -> list[Constraint]:
    """Require that no shape variable exceeds its rate."""
    pace, rates = plant["pace"], ca.SX(ca.DM(aim.rates))
    change = aim.shape.rates / rates
    usual = aim.duration_usual
    return [
        Constraint("limits of rates", pace - sign * change, 0.0, nominal=usual) for sign in (1, -1)
    ]


# -- solutions with increasingly steep friction ----------------------------------------------------

# Widths of the smoothed potential, in resistances times the widest range of shape.
_WIDTHS = (1.0, 0.3, 0.1, 0.03, 0.01)
_ITERATIONS = 200
_DEGREE = 4


@dataclass(frozen=True, eq=False)
class Relaxed:
    """Result of the programs of one start."""

    corners: np.ndarray  # (k, n_s)
    objective: float  # of the last solved program, NaN if none
    optimum: Optimum | None


def relaxed(aim: PlanarAim, problem: Problem, first: np.ndarray) -> Relaxed:
    """Return the best corners near `first` by smoothed friction, at the last solved width."""
    mesh = Mesh.even(1, aim.corners, Collocation(_DEGREE))
    guess, best = guess_from(aim, first), None
    dry = isinstance(aim.ground, Dry)
    size = float(aim.reaches.max())
    for width in _WIDTHS if dry else (1.0,):
        solver = Ipopt(
            tolerance=1e-8, iterations=_ITERATIONS, mu_init=0.1 if best is None else 1e-3
        )
        given = {"width": width * size * aim.ground.mean} if isinstance(aim.ground, Dry) else None
        try:
            best = optimise(problem, mesh, FixedModes(), guess, p=given, solver=solver)
        except SolveError as error:
            if error.code == "infeasible" and best is None:
                raise
            break
        guess = best.motion.guess
    if best is None:
        return Relaxed(first, float("nan"), None)
    edges = best.motion.breaks if aim.closed is False else best.motion.breaks[:-1]
    corners = best.motion.states(edges)[: len(aim.shape.names)].T
    return Relaxed(corners, best.objective, best)
