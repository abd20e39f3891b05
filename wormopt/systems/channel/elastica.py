"""Exact shape of a segment: an inextensible elastica from one wall of the channel to the other.

The angle theta of the centre line against the channel is 0 at both walls. In between

    E I theta'' = -V cos theta + N sin theta,

V being the force of a wall on the body, positive where it pushes, and N the tension along the
channel. What closes the problem is an assumption:

- ``point_contact``: the walls push across the channel only and the ends are free of force, N = 0.
- ``sleeve``: the length between the walls is free and takes the least bending energy. Energy falls
  with length at the rate E I theta'(0)² / 2 + N, the Hamiltonian, which then is 0.
- ``length``: the length is given, and N is whatever holds it.

Everything here is scaled: lengths by the span L, forces by E I / L², energies by E I / L.
"""

from __future__ import annotations

from typing import Literal, get_args

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.boundary import BoundaryProblem

Closing = Literal["point_contact", "sleeve", "length"]
CLOSINGS: tuple[Closing, ...] = get_args(Closing)
STATES = ("theta", "curvature", "x", "y", "energy")


def elastica(closing: Closing) -> BoundaryProblem:
    """State the problem of one segment, closed by an assumption.

    States `STATES` over the share of the arc length; unknowns l_s, V and N; given is the rise,
    and with "length" l_s after it. Raises ArgumentError if there is no such assumption.
    """
    if closing not in CLOSINGS:
        raise ArgumentError(f"closing must be one of {', '.join(CLOSINGS)}, not {closing!r}")
    y, start, end = (ca.SX.sym(name, len(STATES)) for name in ("y", "start", "end"))
    p, given = ca.SX.sym("p", 3), ca.SX.sym("given", 1 + (closing == "length"))
    theta, curvature, _, _, _ = ca.vertsplit(y)
    length, reaction, tension = ca.vertsplit(p)
    bend = -reaction * ca.cos(theta) + tension * ca.sin(theta)
    ode = length * ca.vertcat(curvature, bend, ca.cos(theta), ca.sin(theta), curvature**2 / 2)
    closes = {
        "point_contact": tension,
        "sleeve": tension + start[1] ** 2 / 2,
        "length": length - given[-1],
    }
    zero = ca.vertcat(
        start[0], start[2], start[3], start[4], end[0], end[2] - 1, end[3] - given[0],
        closes[closing],
    )  # fmt: skip
    return BoundaryProblem(y, p, given, ode, start, end, zero, STATES)


def slender_guess(closing: Closing, rise: float, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Beam (34), which the elastica tends to as the rise over the span tends to 0.

    Gives the states (5, m) at the shares `s` (m,) of the length, and the numbers l_s, V and N.
    """
    curvature = 6 * rise * (1 - 2 * s)
    energy = 3 * rise**2 * (1 - (1 - 2 * s) ** 3)
    y = [6 * rise * s * (1 - s), curvature, s, rise * s * s * (3 - 2 * s), energy]
    tension = -18 * rise**2 if closing == "sleeve" else 0.0
    return np.array(y), np.array([1 + 0.6 * rise**2, 12 * rise, tension])
