"""A capsule on rough ground that a mass inside it drives."""

from __future__ import annotations

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal

__all__ = ["capsule"]


def capsule(*, share: float, friction: float, stroke: float) -> Model:
    """Build v' = f - mu u, w' = u: a body on the ground, and a mass that moves in it.

    The momentum of the whole per mass, v + mu w, changes by friction alone, f per mass of the
    whole. The input is the relative acceleration u = w'; impulses of it are jumps of w.

    Parameters
    ----------
    share : float
        Share mu of the inner mass in the whole, between 0 and 1.
    friction : float
        Dry friction per mass of the whole, alike both ways, positive.
    stroke : float
        How far the inner mass may go, positive.

    Returns
    -------
    Model
        States ``position`` and ``velocity`` of the body, ``inner_position`` and
        ``inner_velocity`` relative to it; input ``inner_acceleration``; parameter ``share``;
        output ``momentum`` per mass.

    Raises
    ------
    ArgumentError
        If a number is not positive, or the share not below 1.

    Examples
    --------
    >>> body = capsule(share=0.3, friction=2.0, stroke=0.5)
    >>> body.n_x, body.x[2].upper
    (4, 0.5)
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
