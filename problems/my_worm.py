"""A user-defined model for own_model.toml: a capsule that an internal mass shakes forward."""

import casadi as ca

from wormopt import Contact, Coulomb, Model, Output, Signal


def build(
    mass: float = 1.0,
    inner_mass: float = 0.3,
    stroke: float = 0.5,
    frequency: float = 6.0,
    forward: float = 1.0,
    backward: float = 3.0,
) -> Model:
    """Build a capsule on dry ground whose inner mass moves by stroke/2 * sin(frequency * t)."""
    t, x, v = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("v")
    force = ca.SX.sym("force")  # friction force of the ground; the ode is affine in it
    inside = stroke / 2 * ca.sin(frequency * t)
    relative = ca.jacobian(ca.jacobian(inside, t), t)  # acceleration of the inner mass
    return Model(
        "capsule",
        x=[
            Signal("position", x, unit="length", value=0.0),  # value: initial position
            Signal("velocity", v, unit="speed", value=0.0),
        ],
        ode=ca.vertcat(v, (force - inner_mass * relative) / (mass + inner_mass)),
        t=t,
        outputs=[Output("inner_position", x + inside, unit="length")],
        contacts=[Contact("capsule", v, force, Coulomb(forward, backward))],
    )
