"""A block on the ground, driven by a bounded force: the smallest system with a contact."""

from __future__ import annotations

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Contact, Model, Output, Signal


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
