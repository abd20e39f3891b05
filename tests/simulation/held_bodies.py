"""Bodies whose contacts share what they hold, and whether modes are consistent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product

import casadi as ca
import numpy as np

from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.planar_friction import Elliptic

FORWARD, BACKWARD = np.array([0.5, 1.0, 0.8]), np.array([1.0, 0.4, 0.8])


@cache
def rigid(n: int) -> Model:
    """Contacts on one rigid body: v' = b + r t + G f, so that to hold one changes the others."""
    t, v, f = ca.SX.sym("t"), ca.SX.sym("v", n), ca.SX.sym("f", n)
    b, r, G = ca.SX.sym("b", n), ca.SX.sym("r", n), ca.SX.sym("G", n, n)
    laws = (Coulomb(*each) for each in zip(FORWARD[:n], BACKWARD[:n], strict=True))
    return Model(
        f"rigid {n}",
        x=[Signal("v", v, value=0.0)],
        ode=b + r * t + G @ f,
        t=t,
        p=[
            Signal("b", b, value=0.0),
            Signal("r", r, value=0.0),
            Signal("G", ca.vec(G), value=np.eye(n).ravel().tolist()),
        ],
        contacts=[Contact(f"foot {i}", v[i], f[i], law) for i, law in enumerate(laws)],
    )


def consistent(load: np.ndarray, G: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """All modes at velocity 0 that the laws allow, with accelerations and how clearly."""
    n, found = len(load), []
    for modes in map(np.array, product((-1, 0, 1), repeat=len(load))):
        force = np.where(modes > 0, -FORWARD[:n], BACKWARD[:n]) * (modes != 0)
        rest = modes == 0
        if rest.any():
            known = load + G @ force
            force[rest] = np.linalg.solve(G[np.ix_(rest, rest)], -known[rest])
        a = load + G @ force
        room = np.where(rest, np.minimum(BACKWARD[:n] - force, force + FORWARD[:n]), modes * a)
        if room.min() > 0:
            found.append((modes, np.where(rest, 0.0, a), float(room.min())))
    return found


Load = Callable[[ca.SX], ca.SX]


def body(
    points: np.ndarray,
    laws: Sequence[Elliptic],
    load: Load,
    v0: tuple[float, ...] = (0.0, 0.0, 0.0),
    *,
    inertia: float | None = None,
    p: Sequence[Signal] = (),
) -> Model:
    """A rigid body with a mass 1 at every point; forces and moment act on it, time is a place."""
    q, w, f = ca.SX.sym("q", 4), ca.SX.sym("w", 4), ca.SX.sym("f", 2 * len(points))
    mass = float(len(points))
    inertia = float(np.sum(points**2)) if inertia is None else inertia
    c, s = ca.cos(q[2]), ca.sin(q[2])
    push = load(q[3])
    force, moment, grounds = push[:2], push[2], []
    for k, (a, b) in enumerate(points):
        arm = ca.vertcat(c * a - s * b, s * a + c * b)
        across = ca.vertcat(-arm[1], arm[0])
        ahead, left = ca.vertcat(c, s), ca.vertcat(-s, c)  # the heading is the body's
        own = f[2 * k] * ahead + f[2 * k + 1] * left
        velocity = w[:2] + w[2] * across
        force, moment = force + own, moment + ca.dot(across, own)
        along = ca.vertcat(ca.dot(ahead, velocity), ca.dot(left, velocity))
        grounds.append(Contact(f"point {k}", along, f[2 * k : 2 * k + 2], laws[k]))
    ode = ca.vertcat(w, force / mass, moment / inertia, 0)
    states = [Signal("place", q, value=0.0), Signal("rate", w, value=[*v0, 1.0])]
    return Model("body", states, ode, contacts=grounds, p=p)


ROD = np.array([[0.5, 0.0], [-0.5, 0.0]])
