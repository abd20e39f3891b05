"""Contacts that slide in the plane: stops, directions of release, pivots; two routes, three laws.

B1, B2 and B3 are closed forms or quadratures of the planar theory note, found by two computations.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from on_routes import STEPPING, event_times
from scipy.integrate import quad, solve_ivp

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, NoSlip, Viscous
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic, PlanarLaw
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

Load = Callable[[ca.SX], ca.SX]


def turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def still(t: ca.SX) -> ca.SX:
    return ca.SX.zeros(2)


def along_x(t: ca.SX) -> ca.SX:
    return ca.SX([1.0, 0.0])


def blocks(
    laws: list[PlanarLaw], v0: object, load: Load = still, *, angle: float = 0.0, mass: float = 1.0
) -> Model:
    """Masses beside each other; all that is said of them is turned by an angle."""
    n, R = len(laws), ca.DM(turn(angle)) if angle else ca.DM.eye(2)
    r, v, f = (ca.SX.sym(name, 2 * n) for name in "rvf")
    t = ca.SX.sym("t")
    own = [slice(2 * i, 2 * i + 2) for i in range(n)]
    pushes = ca.vertcat(*(R @ (f[each] + load(t)) / mass for each in own))
    start = (turn(angle) @ np.array(v0, dtype=float).reshape(n, 2).T).T.ravel()
    grounds = [
        Contact(f"mass {i}", R.T @ v[own[i]] if angle else v[own[i]], f[own[i]], laws[i])
        for i in range(n)
    ]
    heat = -sum(ca.dot(v[own[i]], R @ f[own[i]]) for i in range(n))
    work = sum(ca.dot(v[own[i]], R @ load(t)) for i in range(n))
    q = ca.SX.sym("q")  # energy put in and not lost
    return Model(
        "blocks",
        [
            Signal("position", r, value=0.0),
            Signal("velocity", v, value=start.tolist()),
            Signal("energy", q, value=0.0),
        ],
        ca.vertcat(v, pushes, work - heat),
        t=t,
        contacts=grounds,
        outputs=[Output("kinetic", mass * ca.sumsqr(v) / 2)],
    )


def stops(motion: Trajectory) -> list[float]:
    return [event.time for event in motion.events if event.kind == "stick"]


# -- stops -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("F", "time", "place"), [(2.0, 2 / 3, (1 / 12, 4 / 15)), (1.5, 1.2, (0.2, 0.375))]
)
def test_a_pushed_block_stops(route: Route, F: float, time: float, place: tuple[float, float]):
    """B1: (F + f cos a0) s0 / (F² - f²)."""
    motion = simulate(blocks([Elliptic(F, F, F)], [0, 1], along_x), 3.0, route=route)
    assert stops(motion) == pytest.approx([time], abs=5e-10)
    assert motion.end[:4] == pytest.approx([*place, 0, 0], abs=1e-12)


def elliptic_stop(forward: float, sideways: float) -> tuple[float, np.ndarray]:
    """B2 by quadrature: v_t = exp(-Ft² T), v_n = exp(-Fn² T), dt = psi dT."""
    a, b = forward**2, sideways**2

    def psi(T: float) -> float:
        return float(np.sqrt(a * np.exp(-2 * a * T) + b * np.exp(-2 * b * T)))

    parts = [lambda T: 1.0, lambda T: np.exp(-a * T), lambda T: np.exp(-b * T)]
    found = [
        quad(lambda T, part=part: psi(T) * part(T), 0, 60, epsabs=1e-13, limit=200)[0]
        for part in parts
    ]
    return found[0], np.array(found[1:])


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5])
def test_a_block_on_elliptic_ground_stops(route: Route, angle: float):
    time, place = elliptic_stop(1.0, 2.0)
    assert time == pytest.approx(1.21151159553, abs=1e-11)
    assert place == pytest.approx([0.682087730931, 0.327797363691], abs=1e-12)
    law = Elliptic(1.0, 3.0, sideways=2.0)
    motion = simulate(blocks([law], [1, 1], angle=angle), 3.0, route=route)
    assert stops(motion) == pytest.approx([time], abs=5e-10)
    assert motion.end[:2] == pytest.approx(turn(angle) @ place, abs=2e-12)
    assert motion.end[2:4] == pytest.approx([0, 0], abs=1e-20)


def turned_about(law: Elliptic, v0: tuple[float, float], end: float) -> tuple[float, np.ndarray]:
    """When a block pushed by 1 ceases to slide backward, and its velocity at the end."""

    def push(t: float, v: np.ndarray, along: float) -> list[float]:
        size = np.hypot(along * v[0], law.sideways * v[1])
        return [1 - along**2 * v[0] / size, -(law.sideways**2) * v[1] / size]

    def standing(t: float, v: np.ndarray, along: float) -> float:
        return v[0]

    standing.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    sharp = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    back = solve_ivp(push, (0, end), v0, args=(law.backward,), events=standing, **sharp)
    time, v = back.t[-1], [0.0, back.y[1, -1]]
    return time, solve_ivp(push, (time, end), v, args=(law.forward,), **sharp).y[:, -1]


def test_no_long_step_goes_over_the_bend_between_forward_and_backward(route: Route):
    """The force bends where a block's velocity along its heading is 0: each block has its time.

    The step that goes over it changes that velocity by a millionth of the speed at most.
    """
    law, starts = Elliptic(1.0, 3.0, sideways=2.0), [(-0.5, 5.0), (-0.8, 4.0)]
    motion = simulate(blocks([law, law], starts, along_x), 1.0, route=route, dense=True)
    assert motion.dense is not None
    assert motion.n_steps < 150
    states = motion.dense(motion.dense.time)
    for i, start in enumerate(starts):
        time, end = turned_about(law, start, 1.0)
        along, across = states[4 + 2 * i : 6 + 2 * i]
        (over,) = np.flatnonzero(along[:-1] * along[1:] < 0)
        assert motion.dense.time[over : over + 2] == pytest.approx([time] * 2, abs=1e-5)
        assert along[over + 1] - along[over] < 1.001e-6 * across[over]
        assert motion.end[4 + 2 * i : 6 + 2 * i] == pytest.approx(end, abs=1e-9)


def test_equal_blocks_stop_at_once(route: Route):
    motion = simulate(blocks([Elliptic(1.0, 1.0, 2.0)] * 3, [1, 1] * 3), 3.0, route=route)
    assert stops(motion) == pytest.approx([1.21151159553] * 3, abs=5e-10)
    assert [event.name for event in motion.events] == ["mass 0", "mass 1", "mass 2"]


@pytest.mark.parametrize("miss", [1e-2, 1e-4, 1e-6])
def test_a_near_miss_is_no_stop(miss: float):
    """A block pushed back along its way: its speed falls to about the miss, and rises again.

    Without friction to speak of the motion is a parabola.
    """
    law = Elliptic(1e-12, 1e-12, 1e-12)
    motion = simulate(blocks([law], [-1, miss], along_x), 2.0)
    assert motion.events == ()
    assert motion.end[:4] == pytest.approx([0, 2 * miss, 1, miss], abs=1e-9)


TRIPOD_END = (0.79073130637, 0.17443620545, 0.82493561311)


def tripod(v0: tuple[float, ...]) -> Model:
    """Three masses 1 on a rigid circle of radius 1, pushed about by the ground alone."""
    q, w, f = ca.SX.sym("q", 3), ca.SX.sym("w", 3), ca.SX.sym("f", 6)
    force, moment, grounds = ca.SX(2, 1), ca.SX(0), []
    for k in range(3):
        angle = q[2] + np.pi / 2 + 2 * np.pi * k / 3
        across = ca.vertcat(-ca.sin(angle), ca.cos(angle))
        own = f[2 * k : 2 * k + 2]
        force, moment = force + own, moment + ca.dot(across, own)
        grounds.append(Contact(f"mass {k}", w[:2] + w[2] * across, own, Elliptic(1, 1, 1)))
    states = [Signal("place", q, value=[0.0, 0.0, 0.0]), Signal("rate", w, value=v0)]
    return Model("tripod", states, ca.vertcat(w, force / 3, moment / 3), contacts=grounds)


def test_a_tripod_stops_on_one_foot_and_pivots(route: Route):
    """B3: contacts of a rigid body act on each other, and at the end share what they hold."""
    motion = simulate(tripod((1.0, 0.0, 1.0)), 3.0, route=route)
    assert [event.name for event in motion.events] == ["mass 0", "mass 1", "mass 2"]
    assert stops(motion) == pytest.approx([1.370717870, 1.65717084601, 1.65717084601], abs=5e-10)
    assert motion.end == pytest.approx(
        [0.79073130637, 0.17443620545, 0.82493561311, 0, 0, 0], abs=1e-10
    )


@pytest.mark.parametrize("nominal", [(1.0, 1e-4), (1e-4, 1.0)])
def test_a_foot_that_another_stops_rests_with_it(route: Route, nominal: tuple[float, float]):
    """Feet of a sled stop at once, also where one would count as stopped at a lower speed only."""
    q, w, f = ca.SX.sym("q", 2), ca.SX.sym("w", 2), ca.SX.sym("f", 4)
    feet = [
        Contact(f"foot {k}", w, f[2 * k : 2 * k + 2], Elliptic(F, F, F), nominal_speed=speed)
        for k, (F, speed) in enumerate(zip((1.0, 2.0), nominal, strict=True))
    ]
    states = [Signal("place", q, value=0.0), Signal("rate", w, value=[0.6, 0.8])]
    sled = Model("sled", states, ca.vertcat(w, f[:2] + f[2:]), contacts=feet)
    motion = simulate(sled, 1.0, route=route)
    assert stops(motion) == pytest.approx([1 / 3] * 2, abs=5e-10)  # speed 1, slowed by 1 + 2
    assert motion.end == pytest.approx([0.6 / 6, 0.8 / 6, 0.0, 0.0], abs=1e-10)


def test_a_tripod_by_time_stepping():
    steps, errors = [2e-2, 1e-2, 5e-3], []
    scheme = MoreauJean(tripod((1.0, 0.0, 1.0)))
    for step in steps:
        found = scheme.march(2.0, np.array([0, 0, 0, 1.0, 0, 1.0]), step=step)
        errors.append(np.abs(found.states[:3, -1] - TRIPOD_END).max())
        assert found.work["friction"][-1] == pytest.approx(-3.0, abs=1e-12)
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.15)
    assert errors[-1] < 5e-4


# -- releases --------------------------------------------------------------------------------


def wandering(t: ca.SX) -> ca.SX:
    """A load that grows from nothing, past what is held, turns, and falls again."""
    return ca.vertcat(2.5 * ca.sin(t), 1.5 * ca.sin(1.7 * t))


def circling(t: ca.SX) -> ca.SX:
    return 2 * ca.tanh(t) * ca.vertcat(ca.cos(2 * t), ca.sin(2 * t))


LAWS = [Elliptic(1, 1, 1), Elliptic(1, 3, 2), Elliptic(1, 2, 0.5), AnisotropicCoulomb(1, 3, 2)]


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("law", "load"),
    [
        (LAWS[1], wandering),
        *(
            pytest.param(law, load, marks=pytest.mark.slow)
            for law in LAWS
            for load in (wandering, circling)
        ),
    ],
)
def test_both_routes_agree_and_keep_the_balance_of_energy(law: PlanarLaw, load: Load):
    model = blocks([law], [0, 0], load, angle=0.4)
    one, other = (simulate(model, 6.0, route=route) for route in STEPPING)
    assert one.end == pytest.approx(other.end, abs=2e-10)
    assert [e.kind for e in one.events] == [e.kind for e in other.events]
    assert len(one.events) > 0
    assert event_times(one) == pytest.approx(event_times(other), abs=5e-9)
    assert one["kinetic"][0, -1] == pytest.approx(one["energy"][0, -1], abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=str)
def test_onset_from_a_load_that_grows_and_turns(law: PlanarLaw):
    """A sharper onset, at a sharper tolerance, changes nothing to speak of."""
    model = blocks([law], [0, 0], wandering)
    usual, sharp = (
        simulate(model, 2.0, tolerance=tolerance)
        for tolerance in (Tolerance(), Tolerance(1e-13, 1e-14))
    )
    assert usual.end == pytest.approx(sharp.end, abs=3e-10)


def test_release_is_where_the_load_leaves_the_ellipse():
    motion = simulate(blocks([Elliptic(1, 3, 2)], [0, 0], wandering), 0.5, dense=True)
    (event,) = motion.events
    x, y = 2.5 * np.sin(event.time), 1.5 * np.sin(1.7 * event.time)
    assert event.kind == "release"
    assert np.hypot(x / 1, y / 2) == pytest.approx(1.0, abs=1e-10)
    later = motion.at(np.array([event.time + 1e-4]))["velocity"][:, 0]
    normal = np.array([x / 1, y / 4])  # of the ellipse where it was left
    across = later @ [-normal[1], normal[0]]
    assert across / np.linalg.norm(later) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("load", [(3.0, 2.0), (-5.0, 1.0), (0.3, 4.0)])
def test_a_sudden_load_pulls_off_toward_the_acceleration(route: Route, load: tuple[float, float]):
    """From rest under a constant load the way is straight: a = load + force, force against a."""
    law = Elliptic(1.0, 3.0, sideways=2.0)
    motion = simulate(blocks([law], [0, 0], lambda t: ca.SX(load)), 2.0, route=route)
    a = motion.end[2:4] / 2.0
    assert motion.end[:2] == pytest.approx(2.0 * a, abs=1e-11)
    assert a == pytest.approx(
        np.array(load) + np.array(ca.DM(law.slip_force(ca.SX(a)))).ravel(), abs=1e-11
    )


def test_held_force_is_the_load():
    model = blocks([Elliptic(1.0, 3.0, sideways=2.0)], [0, 0], lambda t: ca.SX([0.5, 1.5]))
    motion = simulate(model, 1.0)
    assert motion.events == ()
    assert motion.observe(model.forces)[:, -1] == pytest.approx([-0.5, -1.5], abs=1e-14)
    assert motion.stick_intervals() == [("mass 0", 0.0, 1.0)]


def test_smooth_law_tends_to_the_exact_one():
    model = blocks([Elliptic(1.0, 3.0, sideways=2.0)], [1, 1], along_x)
    end = simulate(model, 1.0).end[:4]
    widths, errors = [4e-3, 2e-3, 1e-3], []
    for width in widths:
        motion = simulate(model, 1.0, contact=Smooth(width), tolerance=Tolerance(1e-9, 1e-11))
        errors.append(np.abs(motion.end[:4] - end).max())
    assert np.polyfit(np.log(widths), np.log(errors), 1)[0] > 0.9
    assert errors[-1] < 5e-3


@pytest.mark.compiled
def test_smooth_routes_agree():
    model = blocks([Elliptic(1.0, 3.0, sideways=2.0)], [0, 0], wandering)
    loose = Tolerance(1e-9, 1e-11)
    routes: tuple[Route, ...] = ("native", "python", "cvodes")
    ends = [
        simulate(model, 3.0, contact=Smooth(1e-2), route=route, tolerance=loose).end
        for route in routes
    ]
    assert ends[1] == pytest.approx(ends[0], abs=1e-8)
    assert ends[2] == pytest.approx(ends[0], abs=1e-6)


# -- the line is a special case --------------------------------------------------------------


def chain(seed: int, *, planar: bool, angle: float = 0.0) -> Model:
    """Masses on a line, springs, dampers and actuators between; on it or in the plane."""
    rng = np.random.default_rng(seed)
    n, dim = 2 + seed % 4, 2 if planar else 1
    stiffness, damping = rng.uniform(5, 15), rng.uniform(0.2, 2)
    amplitude, phase = rng.uniform(1, 4, n - 1), rng.uniform(0, 6, n - 1)
    forces, mass = rng.uniform(0.3, 2, (n, 3)), rng.uniform(0.5, 2, n)
    t = ca.SX.sym("t")
    r, v, f = (ca.SX.sym(name, dim * n) for name in "rvf")
    R = ca.DM(turn(angle)) if planar else ca.DM(1)
    own = [slice(dim * i, dim * i + dim) for i in range(n)]
    push = [R @ f[each] for each in own]
    for j in range(n - 1):
        way, rate = r[own[j]] - r[own[j + 1]], v[own[j]] - v[own[j + 1]]
        length = ca.norm_2(way) if planar else way
        pull = stiffness * (length - 1) + damping * ca.dot(way / length, rate)
        pull = (pull - amplitude[j] * ca.sin(2 * t + phase[j])) * way / length
        push[j], push[j + 1] = push[j] - pull, push[j + 1] + pull
    start = np.outer(np.arange(n)[::-1], turn(angle)[:, 0] if planar else [1.0]).ravel()
    grounds = [
        Contact(
            f"mass {i}",
            R.T @ v[own[i]] if angle else v[own[i]],
            f[own[i]],
            Elliptic(*forces[i]) if planar else Coulomb(*forces[i, :2]),
        )
        for i in range(n)
    ]
    states = [Signal("position", r, value=start.tolist()), Signal("velocity", v, value=0.0)]
    ode = ca.vertcat(v, *(push[i] / mass[i] for i in range(n)))
    return Model("chain", states, ode, t=t, contacts=grounds)


@pytest.mark.parametrize(
    ("seed", "angle", "route"),
    [
        (4, 0.6, "native"),
        (8, 0.0, "python"),
        *(
            pytest.param(k, 0.6 * (k % 2), STEPPING[k % 3 == 0], marks=pytest.mark.slow)
            for k in range(24)
        ),
    ],
)
def test_a_straight_chain_is_the_chain_on_the_line(seed: int, angle: float, route: Route):
    line = simulate(chain(seed, planar=False), 8.0)
    plane = simulate(chain(seed, planar=True, angle=angle), 8.0, route=route)
    projected = plane.end.reshape(-1, 2) @ turn(angle)
    assert projected[:, 0] == pytest.approx(line.end, abs=1e-9)
    assert np.abs(projected[:, 1]).max() < 1e-11
    assert [(e.name, e.kind) for e in plane.events] == [(e.name, e.kind) for e in line.events]
    assert event_times(plane) == pytest.approx(event_times(line), abs=2e-9)


# -- what neither slides nor lets go ---------------------------------------------------------


def sled(v0: tuple[float, ...], friction: float = 0.2) -> Model:
    """A blade: it glides along its heading, turns at will and is held across."""
    q, w, f = ca.SX.sym("q", 3), ca.SX.sym("w", 3), ca.SX.sym("f", 2)
    e = ca.vertcat(ca.cos(q[2]), ca.sin(q[2]))
    n = ca.vertcat(-e[1], e[0])
    grounds = [
        Contact("along", ca.dot(e, w[:2]), f[0], Coulomb(friction, friction)),
        Contact("skid", ca.dot(n, w[:2]), f[1], NoSlip()),
    ]
    states = [Signal("place", q, value=[0.0, 0.0, 0.0]), Signal("rate", w, value=v0)]
    return Model("sled", states, ca.vertcat(w, f[0] * e + f[1] * n, 0), contacts=grounds)


@pytest.mark.parametrize("sideways", [0.0, 0.3])
def test_a_skid_follows_its_heading(route: Route, sideways: float):
    """v = 1 - t / 5 along the angle t / 2; what it has across at the start is lost at once."""
    motion = simulate(sled((1.0, sideways, 0.5)), 8.0, route=route)
    place = [quad(lambda t, g=g: (1 - t / 5) * g(t / 2), 0, 5)[0] for g in (np.cos, np.sin)]
    assert motion.end == pytest.approx([*place, 4.0, 0, 0, 0.5], abs=1e-10)
    assert stops(motion) == pytest.approx([5.0], abs=1e-10)


def test_a_pin_lets_a_bar_swing(route: Route):
    """Held at one end both ways, a bar turns about it with the moment of inertia there."""
    q, w, f = ca.SX.sym("q", 3), ca.SX.sym("w", 3), ca.SX.sym("f", 2)
    arm = ca.vertcat(-ca.sin(q[2]), ca.cos(q[2])) / 2
    moment = 0.1 - ca.dot(arm, f)
    grounds = [Contact(f"pin {i}", w[i] - w[2] * arm[i], f[i], NoSlip()) for i in range(2)]
    states = [Signal("place", q, value=[0.5, 0.0, 0.0]), Signal("rate", w, value=0.0)]
    bar = Model("bar", states, ca.vertcat(w, f, 12 * moment), contacts=grounds)
    motion = simulate(bar, 2.0, route=route)
    angle = 0.1 / (1 / 12 + 1 / 4) * 2.0
    assert motion.end[2] == pytest.approx(angle, abs=1e-10)
    assert motion.end[:2] == pytest.approx([np.cos(angle) / 2, np.sin(angle) / 2], abs=1e-9)


def test_drag_in_the_plane_is_two_laws_along_lines():
    r, v, f = (ca.SX.sym(name, 2) for name in "rvf")
    grounds = [Contact("t", v[0], f[0], Viscous(0.5)), Contact("n", v[1], f[1], Viscous(5.0))]
    states = [Signal("position", r, value=[0.0, 0.0]), Signal("velocity", v, value=[1.0, 1.0])]
    motion = simulate(Model("drop", states, ca.vertcat(v, f), contacts=grounds), 1.0)
    assert motion.end[2:] == pytest.approx(np.exp([-0.5, -5.0]), abs=1e-11)


def test_a_law_that_is_not_associated_is_told():
    one, other = (
        simulate(blocks([law] * 2, [1, 1, 1, 1]), 0.1)
        for law in (AnisotropicCoulomb(1, 1, 2), Elliptic(1, 1, 2))
    )
    assert len(one.warnings) == 1
    assert "AnisotropicCoulomb" in one.warnings[0]
    assert other.warnings == ()


# -- refusals --------------------------------------------------------------------------------


def test_sizes_must_fit_the_law():
    v, f = ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    state = [Signal("velocity", v)]
    with pytest.raises(ArgumentError, match="must be scalars"):
        Model("m", state, f, contacts=[Contact("c", v, f, Coulomb(1, 1))])
    with pytest.raises(ArgumentError, match="columns of 2"):
        Model("m", state, f, contacts=[Contact("c", v[0], f[0], Elliptic(1, 1, 1))])


@pytest.mark.parametrize("treatment", [FixedModes(), Complementarity()])
def test_programs_say_what_they_do_not_treat(treatment: FixedModes | Complementarity):
    model = blocks([Elliptic(1, 1, 1)], [0, 0])
    with pytest.raises(ArgumentError, match=r"Regularised"):
        treatment.close(model)
    assert Regularised().close(model).forces.shape == (2, 1)


def test_only_the_law_of_most_power_is_stepped_over():
    r, v, f = (ca.SX.sym(name, 2) for name in "rvf")
    states = [Signal("position", r), Signal("velocity", v)]
    ground = Contact("mass", v, f, AnisotropicCoulomb(1, 1, 2))
    with pytest.raises(ArgumentError, match="Elliptic"):
        MoreauJean(Model("block", states, ca.vertcat(v, f), contacts=[ground]))


def test_numbers_of_a_law_are_checked_when_they_are_parameters():
    r, v, f = (ca.SX.sym(name, 2) for name in "rvf")
    F = ca.SX.sym("F")
    states = [Signal("position", r, value=0.0), Signal("velocity", v, value=1.0)]
    ground = Contact("mass", v, f, Elliptic(F, F, F))
    numbers = [Signal("F", F, value=1.0)]
    model = Model("block", states, ca.vertcat(v, f), p=numbers, contacts=[ground])
    assert stops(simulate(model, 3.0)) == pytest.approx([np.sqrt(2)], abs=1e-9)
    assert stops(simulate(model, 3.0, p={"F": 2.0})) == pytest.approx([np.sqrt(0.5)], abs=1e-9)
    with pytest.raises(ArgumentError, match="positive"):
        simulate(model, 3.0, p={"F": -1.0})


# -- worms -----------------------------------------------------------------------------------


def worm(n: int, rng: np.random.Generator) -> Model:
    """Masses in an arc, springs, dampers and actuators between; headings follow the body."""
    t = ca.SX.sym("t")
    r, v, f = (ca.SX.sym(name, 2 * n) for name in "rvf")
    own = [slice(2 * i, 2 * i + 2) for i in range(n)]
    pushes, grounds = [], []
    for i in range(n):
        way = r[own[max(i - 1, 0)]] - r[own[min(i + 1, n - 1)]]
        e = way / ca.norm_2(way)
        across = ca.vertcat(-e[1], e[0])
        velocity = ca.vertcat(ca.dot(e, v[own[i]]), ca.dot(across, v[own[i]]))
        law = Elliptic(*rng.uniform(0.3, 3, 3))
        grounds.append(Contact(f"mass {i}", velocity, f[own[i]], law))
        side = rng.uniform(-2, 2) * ca.sin(rng.uniform(1, 3) * t + rng.uniform(0, 6))
        pushes.append(f[2 * i] * e + (f[2 * i + 1] + side) * across)
    for j in range(n - 1):
        way, rate = r[own[j]] - r[own[j + 1]], v[own[j]] - v[own[j + 1]]
        length = ca.norm_2(way)
        drive = rng.uniform(0, 8) * ca.sin(2 * t - rng.uniform(0, 6))
        pull = (20 * (length - 1) + 2 * ca.dot(way / length, rate) - drive) * way / length
        pushes[j], pushes[j + 1] = pushes[j] - pull, pushes[j + 1] + pull
    angles = np.linspace(0, min(2.0, 0.3 * n), n)
    places = np.column_stack([np.cumsum(np.cos(angles)), np.cumsum(np.sin(angles))])[::-1]
    states = [
        Signal("position", r, value=places.ravel().tolist()),
        Signal("velocity", v, value=rng.normal(size=2 * n).tolist()),
    ]
    return Model("worm", states, ca.vertcat(v, *pushes), t=t, contacts=grounds)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_worms_by_both_routes_and_a_sharper_tolerance(seed: int):
    rng = np.random.default_rng(seed)
    model = worm(int(rng.integers(2, 5)), rng)
    native, python = (simulate(model, 3.0, route=route) for route in STEPPING)
    sharp = simulate(model, 3.0, tolerance=Tolerance(1e-12, 1e-13))
    assert native.end == pytest.approx(python.end, abs=1e-8)
    assert native.end == pytest.approx(sharp.end, abs=1e-8)


@pytest.mark.slow
def test_a_step_costs_as_many_masses_as_there_are():
    """Cost per step and mass of 200 masses is at most 1.5 times that of 50, best of three."""
    costs = []
    for n in (50, 200):
        model = worm(n, np.random.default_rng(0))
        motion = simulate(model, 0.3, route="native")  # compiles
        spent = []
        for _ in range(3):
            begin = time.process_time()
            simulate(model, 0.3, route="native")
            spent.append(time.process_time() - begin)
        costs.append(min(spent) / (motion.n_steps + motion.n_rejected) / n)
    assert costs[1] < 1.5 * costs[0]
