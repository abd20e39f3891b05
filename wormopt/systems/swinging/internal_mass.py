"""Models of two masses that push each other, and of a capsule with an internal mass."""

from __future__ import annotations

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal


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


def pair(
    *,
    friction: float,
    ratio: float | ca.SX,
    mass: float = 1.0,
    gravity: float = 1.0,
    length_nominal: float = 1.0,
) -> Model:
    """Build the model M X'' = -u + M g c_0, m x'' = u + m g c_1 with m = ratio M.

    Contact forces are per weight, c = force / (mass g): one law for both masses, for every `ratio`,
    which may be a symbol. Source: F. L. Chernousko, Doklady Physics 47 (2002) 49-52.
    """
    numbers = [friction, mass, gravity, *([] if isinstance(ratio, ca.SX) else [ratio])]
    if not min(numbers) > 0:
        raise ArgumentError("friction, ratio, mass and gravity must be positive")
    x, v, c = (ca.SX.sym(name, 2) for name in ("x", "v", "c"))
    u, big, weight = (ca.SX.sym(name) for name in ("u", "M", "g"))
    law = Coulomb(friction, friction)
    speed = (friction * gravity * length_nominal) ** 0.5
    return Model(
        "pair of masses",
        x=[
            Signal("position", x, "length", length_nominal, value=(0.0, 0.0)),
            Signal("velocity", v, "speed", speed, value=(0.0, 0.0)),
        ],
        ode=ca.vertcat(v, -u / big + weight * c[0], u / (ratio * big) + weight * c[1]),
        u=[Signal("force", u, "force", friction * mass * gravity, value=0.0)],
        p=[
            Signal("mass", big, "mass", lower=TINY, value=mass),
            Signal("gravity", weight, "acceleration", lower=TINY, value=gravity),
            *([Signal("mass_ratio", ratio, "share")] if isinstance(ratio, ca.SX) else []),
        ],
        outputs=[
            Output("distance", x[1] - x[0], "length"),
            Output("center_of_mass", (x[0] + ratio * x[1]) / (1 + ratio), "length"),
        ],
        contacts=[
            Contact(f"{name} mass", v[i], c[i], law, friction, speed)
            for i, name in enumerate(("big", "small"))
        ],
    )
