"""Gaits of planar worms as problems of optimal control: rates of the shape are the inputs.

On dry ground the twist is an algebraic variable: the potential, smoothed over a width that is a
parameter, has no slope there.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from wormopt.model.model import Model, Output, Signal
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.ground import Dry

_TURNED = 2 * np.pi
"""Most that a cycle turns; far above what gaits do."""


def planar_plant(aim: PlanarAim) -> Model:
    """Body whose shape is driven by its rates; pose is that of the head."""
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
    spans, fast = aim.ranges, aim.rates * (1.0 if aim.timed else np.inf)
    sizes = [max(abs(low), abs(high)) for low, high in spans]
    speed = float(np.max(aim.rates))
    states = [
        Signal(name, shape.s[i], nominal=sizes[i], lower=spans[i, 0], upper=spans[i, 1])
        for i, name in enumerate(shape.names)
    ]
    inputs = [
        Signal(
            f"{name} rate", shape.rates[i], nominal=aim.rates[i], lower=-fast[i], upper=fast[i]
        )
        for i, name in enumerate(shape.names)
    ]
    dry = isinstance(aim.ground, Dry)
    return Model(
        "planar worm",
        x=[*states, Signal("position", position), Signal("heading", heading)],
        ode=ode,
        u=inputs,
        z=[Signal("twist", shape.twist, nominal=speed)] if dry else [],
        alg=_stationary(aim, width) if dry else ca.SX(0, 1),
        p=[Signal("width", width, value=1.0)] if dry else [],
        outputs=[
            Output("power", power, "power"),
            Output("along", along, "length"),
            Output("across", across, "length"),
        ],
    )


def _stationary(aim: PlanarAim, width: ca.SX) -> ca.SX:
    """Slope of the potential by the twist, over the largest resistance."""
    assert isinstance(aim.ground, Dry)
    potential = aim.ground.potential(aim.shape, width)
    return ca.gradient(potential, aim.shape.twist) / (aim.ground.most * aim.shape.n_points)


def _explicit(aim: PlanarAim, shape: Shape) -> ca.SX:
    """Twist on linear drag: the power is quadratic."""
    hessian, slope = ca.hessian(aim.ground.potential(shape, ca.SX(0)), shape.twist)
    at_rest = ca.substitute(slope, shape.twist, ca.SX.zeros(3))
    return -ca.inv_minor(hessian) @ at_rest


def gait_problem(aim: PlanarAim) -> Problem:
    """State the best gait or course for an aim."""
    plant = planar_plant(aim)
    ends = Ends.of(plant, 1)
    n_s = len(aim.shape.names)
    first, last = (part[n_s:] for part in (ends.start, ends.end))
    begin, work, time = ends.start[:n_s], ends.integrals[0], ends.duration
    usual = aim.duration_usual
    held = [Constraint("start", ca.vertcat(first[0]), 0.0, 0.0)]
    free_side = aim.limits.half_width is not None
    straight = aim.purpose in ("speed", "efficiency")
    if not (straight and free_side):
        held.append(Constraint("start", first[1], 0.0, 0.0))
    if straight:
        held.append(Constraint("start", first[2], -np.pi, np.pi))
        held.append(Constraint("no way aside", last[1] - first[1], 0.0, 0.0))
    elif aim.purpose == "turn":
        held.append(Constraint("start", first[2], 0.0, 0.0))
        held += _in_place(aim, begin, last)
    else:
        held.append(Constraint("start", first[2], 0.0, 0.0))
        held.append(Constraint("pose", last, aim.step, aim.step))
    if aim.start is not None:
        held.append(Constraint("start shape", begin, aim.start, aim.start))
    if aim.limits.effort is not None:
        effort = aim.limits.effort
        held.append(Constraint("limits.effort", work, upper=effort, nominal=effort))
    objective = {
        "speed": lambda: -last[0] / time,
        "turn": lambda: -last[2] / time,
        "work": lambda: work,
        "efficiency": lambda: -100 * last[0] ** 2 / (time * work),
    }[aim.purpose]()
    along = []
    if aim.limits.half_width is not None:
        room = aim.limits.half_width - aim.limits.radius
        along.append(Constraint("limits.half_width", plant["across"], -room, room, room))
    span = (usual / 50, 5 * usual) if aim.timed else (usual, usual)
    if aim.purpose == "efficiency":
        span = (usual, usual)
    periodic = list(aim.shape.names) if aim.closed else []
    return Problem(
        plant,
        ends,
        objective,
        span,
        periodic=[*periodic, "heading"] if straight else periodic,
        integrands=plant["power"],
        path_constraints=along,
        boundary_constraints=held,
    )


def _in_place(aim: PlanarAim, begin: ca.SX, last: ca.SX) -> list[Constraint]:
    """The pivot, seen at the start, is where it was."""
    if aim.pivot == "any":
        return []
    points = ca.substitute(aim.shape.points, aim.shape.s, begin)
    place = ca.sum2(points) / points.size2() if aim.pivot == "centre" else points[:, aim.pivot]
    c, s = ca.cos(last[2]), ca.sin(last[2])
    moved = last[:2] + ca.vertcat(c * place[0] - s * place[1], s * place[0] + c * place[1])
    return [Constraint("in place", moved - place, 0.0, 0.0)]
