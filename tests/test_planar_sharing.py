"""Rigid bodies that rest on several contacts: how they share a load, when and where to they slip.

References: the kinematic theorem of limit analysis over centres of rotation, closed forms, the
smooth law and Moreau-Jean stepping.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

from wormopt.model.model import Contact, Model, Signal
from wormopt.model.planar_friction import Elliptic, PlanarLaw
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

ROUTES: tuple[Route, ...] = ("native", "python")
Load = Callable[[ca.SX], ca.SX]


def body(
    points: np.ndarray,
    laws: list[PlanarLaw],
    load: Load,
    v0: tuple[float, ...] = (0.0, 0.0, 0.0),
    *,
    inertia: float | None = None,
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
    return Model("body", states, ode, contacts=grounds)


def critical(points: np.ndarray, laws: list[PlanarLaw], load: np.ndarray) -> float:
    """Factor of a load at which a body slips: least power of friction at unit power of the load."""
    law_power = [
        lambda v, law=law: np.hypot(
            (law.forward if v[0] >= 0 else law.backward) * v[0], law.sideways * v[1]
        )
        for law in laws
    ]

    def power(V: np.ndarray) -> float:
        at = [V[:2] + V[2] * np.array([-b, a]) for a, b in points]
        return sum(psi(v) for psi, v in zip(law_power, at, strict=True))

    unit = load / (load @ load)
    basis = np.linalg.svd(load[None, :])[2][1:].T
    near: np.ndarray = np.zeros(2)
    best = np.inf
    rng = np.random.default_rng(0)
    for start in [np.zeros(2), *rng.normal(size=(12, 2))]:
        options = {"xatol": 1e-13, "fatol": 1e-15, "maxiter": 4000}
        y = start
        for _ in range(3):
            found = minimize(
                lambda y: power(unit + basis @ y), y, method="Nelder-Mead", options=options
            )
            y = found.x
        if found.fun < best:
            best, near = found.fun, y
    assert np.isfinite(near).all()
    return float(best)


ROD = np.array([[0.5, 0.0], [-0.5, 0.0]])
TRIPOD = np.array([[0.0, 1.0], [-0.9, -0.5], [0.8, -0.6]])
RING = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(12) / 12])


def releases(motion: Trajectory) -> dict[str, float]:
    return {e.name: e.time for e in motion.events if e.kind == "release"}


@pytest.mark.parametrize("route", ROUTES)
def test_a_rod_pulled_along_holds_what_both_ends_hold(route: Route):
    """Ends of 1 and 3 share a load until 4; then x'' = (t - 4) / 2."""
    laws: list[PlanarLaw] = [Elliptic(F, F, F) for F in (1.0, 3.0)]
    rod = body(ROD, laws, lambda t: ca.vertcat(t, 0, 0))
    motion = simulate(rod, 5.0, route=route)
    assert releases(motion) == pytest.approx({"point 0": 4.0, "point 1": 4.0}, abs=1e-9)
    assert motion.end[[0, 4]] == pytest.approx([1 / 12, 1 / 4], abs=1e-9)
    assert motion.end[[1, 2]] == pytest.approx([0, 0], abs=1e-12)


@pytest.mark.parametrize("load", [(1.0, 0.4, 0.1), (0.3, 1.0, 0.0), (1.0, 1.0, 0.4)])
def test_a_rod_slips_where_two_ellipses_part(load: tuple[float, ...]):
    """Across, statics tells the forces; along, the ends hold together what these leave."""
    laws: list[PlanarLaw] = [Elliptic(1.0, 1.0, 2.0), Elliptic(1.5, 1.5, 1.2)]
    rod = body(ROD, laws, lambda t: t * ca.DM(load))
    (first, *_) = sorted(releases(simulate(rod, 6.0, route="python")).values())
    across = np.array([load[1] / 2 + load[2], load[1] / 2 - load[2]])
    held = [
        law.forward * np.sqrt(1 - (first * f / law.sideways) ** 2)
        for law, f in zip(laws, across, strict=True)
    ]
    assert sum(held) == pytest.approx(first * load[0], abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_a_tripod_slips_at_the_load_of_limit_analysis(seed: int):
    check_critical(TRIPOD, seed)


@pytest.mark.slow
@pytest.mark.parametrize("points", [ROD, TRIPOD, RING], ids=["rod", "tripod", "ring"])
@pytest.mark.parametrize("seed", range(3, 9))
def test_bodies_slip_at_the_load_of_limit_analysis(points: np.ndarray, seed: int):
    check_critical(points, seed)


def check_critical(points: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    laws: list[PlanarLaw] = [Elliptic(*rng.uniform(0.5, 2.0, 3)) for _ in points]
    load = rng.normal(size=3)
    limit = critical(points, laws, load)
    motion = simulate(
        body(points, laws, lambda t: t * ca.DM(load)), limit + 0.02, route="python"
    )
    assert min(releases(motion).values()) == pytest.approx(limit, rel=1e-7)
