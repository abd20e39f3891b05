"""Two masses on rough ground that push each other (Chernousko's pair), and their best cycle."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.ocp.motion import Guess
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.swinging.scenes.internal_mass import PairTable


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


def pair_problem(table: PairTable) -> Problem:
    """Optimal-control problem: the mean speed of a slow stroke and an instantaneous return.

    The problem covers the slow stroke; its mode keeps the big mass at rest.
    """
    slow = _slow(table)
    ratio, (low, high) = ca.SX.sym("ratio"), table.ratios
    model = pair(
        friction=table.friction,
        ratio=ratio,
        mass=table.mass,
        gravity=table.gravity,
        length_nominal=table.stroke,
    )
    ends, size = Ends.of(model), table.stroke
    return Problem(
        model,
        ends,
        -advance(table, ratio) / ends.duration,
        (1e-3 * slow, 10 * slow / math.sqrt(1 - high**2)),  # what presses with little more is slow
        boundary_constraints=[
            Constraint("start", ends.start[:2], 0.0, 0.0, size),
            Constraint("rest at the start", ends.start[3], 0.0, 0.0, model.x[1].nominal),
            Constraint("stroke", ends.end[1] - ends.end[0], size, size, size),
            Constraint("rest at the end", ends.end[3], 0.0, 0.0, model.x[1].nominal),
        ],
        design=[Signal("mass_ratio", ratio, "share", math.sqrt(low * high), low, high)],
        nominal=advance(table, high) / slow,
    )


def advance(table: PairTable, ratio: Any) -> Any:
    """Displacement of the big mass in the return, which conserves the zero momentum."""
    return table.stroke * ratio / (1 + ratio)


def _slow(table: PairTable) -> float:
    """Usual duration of the slow stroke, with the heaviest small mass."""
    return 2 * math.sqrt(table.stroke * table.ratios[1] / (table.friction * table.gravity))


def pair_guess(table: PairTable) -> Guess:
    """First guess: a stroke at constant velocity."""
    slow = _slow(table)
    speed = table.stroke / slow
    return Guess(slow, lambda t: np.vstack([0 * t, speed * t, 0 * t, 0 * t + speed]))
