"""The worm with spikes, (1)-(7), as a Model driven by its link accelerations."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from wormopt.model.friction import Spike
from wormopt.model.model import Contact, Model, Output, Signal


def spiked_worm(
    mass: Sequence[float],
    drag: float,
    load: float,
    *,
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build the chain of n+1 point masses (head first), n link lengths prescribed, (1)-(7).

    States: ``position``, ``velocity`` of the head, ``length``, ``rate``; inputs l_j'';
    outputs ``reaction_mean`` (lambda of (7)), ``actuator_force``, ``power``; a spike each.
    """
    n = len(mass) - 1
    speed = length_nominal / time_nominal
    force = sum(mass) / len(mass) * speed / time_nominal
    position, velocity = ca.SX.sym("x0"), ca.SX.sym("v0")
    length, rate, acceleration = (ca.SX.sym(s, n) for s in ("l", "dl", "ddl"))
    reaction = ca.SX.sym("reaction", n + 1)

    span_rate = ca.vertcat(0, ca.cumsum(rate))  # S_i', (2)
    span_acceleration = ca.vertcat(0, ca.cumsum(acceleration))
    v = velocity - span_rate
    momentum = ca.sum1(reaction) - drag * ca.sum1(v) - load * (n + 1)
    head_acceleration = (momentum + ca.dot(ca.DM(mass), span_acceleration)) / sum(mass)
    # Recursion from the head down, (3): mu_{i+1} = mu_i + reaction_i - k v_i - Gamma - m_i v_i'.
    surplus = reaction - drag * v - load - ca.DM(mass) * (head_acceleration - span_acceleration)
    actuator_force = ca.cumsum(surplus)[:n]

    return Model(
        name=f"spiked worm of {n} links",
        x=[
            Signal("position", position, "length", length_nominal),
            Signal("length", length, "length", length_nominal),
            Signal("velocity", velocity, "speed", speed),
            Signal("rate", rate, "speed", speed),
        ],
        ode=ca.vertcat(velocity, rate, head_acceleration, acceleration),
        u=[Signal("acceleration", acceleration, "acceleration", speed / time_nominal)],
        outputs=[
            Output("reaction_mean", ca.sum1(reaction) / (n + 1), "force"),
            Output("actuator_force", actuator_force, "force"),
            Output("power", -actuator_force * rate, "power"),
        ],
        contacts=[
            Contact(f"mass {i}", v[i], reaction[i], Spike(scale=force), force, speed)
            for i in range(n + 1)
        ],
    )
