"""A block on the ground, driven by a bounded force, and its best way somewhere."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.ocp.motion import Guess
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.block.scenes import SlideScene
from wormopt.systems.chain import law_of

# No motion takes longer than so many times a plain one, see `_plain_time`.
_LONGEST = 10.0


def block(
    law: Law,
    *,
    mass: float = 1.0,
    force: float = float("inf"),
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build x' = v, m v' = u + friction, |u| <= force, with one contact.

    States ``position``, ``velocity``; input ``force``; output ``energy``; parameters ``mass``
    and the law's. Solvers scale by `*_nominal`. ArgumentError if mass or force is not positive.
    """
    if not (mass > 0 and force > 0):
        raise ArgumentError(f"mass and force must be positive, not {mass:g} and {force:g}")
    x, v, u, f, m = (ca.SX.sym(name) for name in ("x", "v", "u", "friction", "mass"))
    (lifted,), friction = lift([law])
    speed = length_nominal / time_nominal
    size = force if force < float("inf") else mass * speed / time_nominal
    return Model(
        "block",
        x=[
            Signal("position", x, "length", length_nominal, value=0.0),
            Signal("velocity", v, "speed", speed, value=0.0),
        ],
        ode=ca.vertcat(v, (u + f) / m),
        u=[Signal("force", u, "force", size, lower=-force, upper=force, value=0.0)],
        p=[Signal("mass", m, "mass", lower=TINY, value=mass), *friction],
        outputs=[Output("energy", m * v**2 / 2, "energy")],
        contacts=[Contact("block", v, f, lifted, size, speed)],
    )


def problem_of(table: SlideScene) -> Problem:
    """What to optimise; names of bounds are keys of the scene."""
    slow = _plain_time(table)
    model = _model(table, slow)
    effort = table.minimise == "effort"
    ends = Ends.of(model, int(effort))
    sizes = np.array([s.nominal for s in model.x])
    at_ends = [
        Constraint(f"{name}.{signal.name}", state[k] / sizes[k], value / sizes[k], value / sizes[k])
        for name, place, state in (("start", table.start, ends.start), ("end", table.end, ends.end))
        for k, signal, value in zip(
            range(2), model.x, (place.position, place.velocity), strict=False
        )
    ]
    longest = _LONGEST * slow
    if table.time is not None:
        at_ends.append(Constraint("time", ends.duration, upper=table.time, nominal=table.time))
        longest = max(longest, 2 * table.time)
    # integrals are variables of the program: of the size of 1
    size = model.u[0].nominal ** 2 * slow if effort else slow
    return Problem(
        model,
        ends,
        size * ends.integrals[0] if effort else ends.duration,
        (1e-6 * slow, longest),
        integrands=ca.sumsqr(model["force"]) / size if effort else ca.SX(0, 1),
        boundary_constraints=at_ends,
        nominal=size,
    )


def _model(table: SlideScene, slow: float) -> Model:
    way = abs(table.end.position - table.start.position)
    speeds = abs(table.start.velocity) + abs(table.end.velocity)
    return block(
        law_of(table.block.friction),
        mass=table.block.mass,
        force=table.block.force,
        length_nominal=max(way, speeds * slow / 4),
        time_nominal=slow,
    )


def _plain_time(table: SlideScene) -> float:
    """Time of a plain way: stop, go from rest to rest, gather speed; none is much slower."""
    weakest = _least_net_force(law_of(table.block.friction), table.block.force)
    a, b = weakest / table.block.mass, table.block.force / table.block.mass
    v0, v1 = table.start.velocity, table.end.velocity
    way = abs(table.end.position - table.start.position) + v0**2 / (2 * b) + v1**2 / (2 * a)
    return abs(v0) / b + abs(v1) / a + math.sqrt(2 * way * (1 / a + 1 / b))


def _least_net_force(law: Law, force: float) -> float:
    """Least of what is left of the drive against friction, of the directions where any is."""
    left = (force - abs(float(law.slip_force(0.0, d))) for d in law.directions)
    return min((net for net in left if net > 0), default=force)


def cubic_guess(table: SlideScene) -> Guess:
    """Cubic from one place and velocity to the other."""
    duration = _plain_time(table) if table.time is None else table.time
    start, end = table.start, table.end
    way = end.position - start.position
    p, q = duration * start.velocity, duration * end.velocity
    cubic = np.polynomial.Polynomial([start.position, p, 3 * way - 2 * p - q, p + q - 2 * way])
    slope = cubic.deriv()
    return Guess(
        duration, lambda t: np.vstack([cubic(t / duration), slope(t / duration) / duration])
    )
