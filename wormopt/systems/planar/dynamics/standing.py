"""A worm among compliant obstacles, for any treatment of the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.model.model import Model, Output, pack
from wormopt.model.values import signal_values
from wormopt.simulation.walls import smooth_walls

_TOUCHES = 1e-3  # of the usual force: push of an obstacle that is just touched
_DAMPED = 2.1  # times sqrt(m / k): above 2 a mass does not bounce


@dataclass(frozen=True)
class Yielding:
    """Compliance of obstacles."""

    stiffness: float  # force per depth, positive
    mass: float  # largest mass that hits one
    v_reg: float = math.inf  # width of velocities over which their friction is steep


def let_give_way(worm: Model, obstacles: Yielding) -> Model:
    """Let obstacles push by explicit forces; the worm keeps the contacts with its ground.

    Masses enter obstacles by force over stiffness, and do not bounce. Friction on obstacles is
    smooth, and 0 by default: masses creep with it, which is incompatible with exact contact,
    because the direction of friction turns faster for slower masses. Adds outputs ``wall_force``
    and ``wall_gap``, one for each mass and obstacle, and ``wall_power`` on the worm.
    """
    k = obstacles.stiffness
    touching = [contact for contact in worm.contacts if contact.gap is not None]
    soft = smooth_walls(
        worm,
        k,
        smoothing=(_TOUCHES * touching[0].nominal_force) ** 2 / k,
        relaxation=_DAMPED * math.sqrt(obstacles.mass / k),
    )
    pressed, push = soft.z[-1].symbol, soft["wall_force"]
    rubbing = [c.law.smooth(c.velocity, obstacles.v_reg) for c in touching]  # type: ignore[union-attr,call-arg]
    old = ca.vertcat(*(c.force for c in touching), pressed)
    new = ca.vertcat(*(ca.substitute(f, pressed, push) for f in rubbing), push)
    names = {contact.name for contact in touching}
    rates = ca.jtimes(ca.vertcat(*(c.gap for c in touching)), pack(worm.x), worm.ode)  # type: ignore[misc]
    sliding = ca.vertcat(*(c.velocity for c in touching))
    power = ca.dot(push, rates) + ca.dot(new[: len(touching)], sliding)
    outputs = [replace(o, expression=ca.substitute(o.expression, old, new)) for o in soft.outputs]
    return replace(
        soft,
        z=soft.z[:-1],
        alg=ca.SX(0, 1),
        ode=ca.substitute(soft.ode, old, new),
        outputs=[
            *outputs,
            Output("wall_gap", ca.vertcat(*(c.gap for c in touching)), "length"),  # type: ignore[misc]
            Output("wall_power", power, "power"),
        ],
        contacts=[contact for contact in soft.contacts if contact.name not in names],
    )


def gaps_at_start(worm: Model) -> np.ndarray:
    """Return distances (obstacles, masses) of the masses from obstacles at the start."""
    gaps = [contact.gap for contact in worm.contacts if contact.gap is not None]
    function = ca.Function("gaps", [pack(worm.x)], [ca.vertcat(*gaps)])
    start = signal_values(worm.x, None, "state", fill=0.0)
    return np.array(function(start)).reshape(-1, worm.x[0].size // 2)
