"""A capsule on rough ground that a mass inside it drives."""

from __future__ import annotations

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal


def capsule(*, share: float, friction: float, stroke: float) -> Model:
    """Build v' = f - mu u, w' = u: a body on the ground, and a mass that moves in it.

    Momentum v + mu w, per mass of the whole as f is, changes by friction alone. `share`
    is mu, below 1. The input u is the relative acceleration; impulses of it are jumps of w.
    """
    if not (0 < share < 1 and friction > 0 and stroke > 0):
        raise ArgumentError("share must be between 0 and 1, friction and stroke positive")
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
