"""A capsule on rough ground driven by an internal mass, and its optimal cycle."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.ocp.motion import Guess
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.swinging.scenes.internal_mass import CapsuleTable


def capsule(*, share: float, friction: float, stroke: float) -> Model:
    """Build the model v' = f - mu u, w' = u: a body on the ground, and a mass that moves in it.

    Only friction changes the momentum v + mu w, which like f is per total mass. `share` is mu,
    below 1. The input u is the relative acceleration; its impulses are jumps of w.
    """
    if not (0 < share < 1 and friction > 0 and stroke > 0):
        raise ArgumentError("share must be between 0 and 1, friction and stroke must be positive")
    x, v, s, w, u, f, mu = (ca.SX.sym(name) for name in ("x", "v", "s", "w", "u", "f", "mu"))
    inner = (friction * stroke / share) ** 0.5
    speed = share * inner
    return Model(
        "capsule",
        x=[
            Signal("position", x, "length", share * stroke, value=0.0),
            Signal("velocity", v, "speed", speed, value=0.0),
            Signal("inner_position", s, "length", stroke, 0.0, stroke, value=0.0),
            Signal("inner_velocity", w, "speed", inner, value=0.0),
        ],
        ode=ca.vertcat(v, f - mu * u, w, u),
        u=[Signal("inner_acceleration", u, "acceleration", inner**2 / stroke, value=0.0)],
        p=[Signal("share", mu, lower=TINY, upper=1.0, value=share)],
        outputs=[Output("momentum", v + mu * w, "speed")],
        contacts=[Contact("body", v, f, Coulomb(friction, friction), friction, speed)],
    )


def capsule_problem(table: CapsuleTable) -> Problem:
    """Optimal-control problem: the mean speed of a periodic cycle.

    Relative acceleration is by impulses only. The momentum is 0 at the cycle's ends: the body is at
    rest where the inner mass is.
    """
    model, slow = _coasting(table), _slow(table)
    ends = Ends.of(model)
    sizes = [signal.nominal for signal in model.x]
    return Problem(
        model,
        ends,
        -(ends.end[0] - ends.start[0]) / ends.duration,
        (1e-3 * slow, 10 * slow),
        periodic=["velocity", "inner_position", "inner_velocity"],
        boundary_constraints=[
            Constraint("start", ends.start[0], 0.0, 0.0, sizes[0]),
            Constraint("inner start", ends.start[2], 0.0, 0.0, sizes[2]),
            Constraint("momentum", ends.end[1] + table.share * ends.end[3], 0.0, 0.0, sizes[1]),
        ],
        impulses=True,
        nominal=table.share * table.stroke / slow,
    )


def _coasting(table: CapsuleTable) -> Model:
    model = capsule(share=table.share, friction=table.friction, stroke=table.stroke)
    return replace(model, u=[replace(signal, lower=0.0, upper=0.0) for signal in model.u])


def _slow(table: CapsuleTable) -> float:
    """Usual duration of a cycle."""
    return 2 * math.sqrt(table.share * table.stroke / table.friction)


def capsule_guess(table: CapsuleTable) -> Guess:
    """First guess: to and fro at constant relative velocity."""
    duration, stroke = _slow(table), table.stroke
    inner = 2 * stroke / duration
    speed = table.share * inner / 2

    def states(t: np.ndarray) -> np.ndarray:
        sign = np.where(t < duration / 2, 1, -1)
        inside = stroke - inner * np.abs(t - duration / 2)
        return np.vstack([0 * t, -speed * sign, inside, inner * sign])

    return Guess(duration, states)
