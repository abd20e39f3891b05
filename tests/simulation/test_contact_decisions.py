"""Which contacts rest: the only choice that the laws allow, found by trying them all."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from effort import examples
from held_bodies import BACKWARD, FORWARD, ROD, body, consistent, rigid
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from on_routes import event_times, listed
from scipy.integrate import solve_ivp

from wormopt.model.friction import Coulomb, NoSlip
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.planar_friction import Elliptic
from wormopt.model.schedule import Schedule
from wormopt.simulation import routes
from wormopt.simulation.automaton import _cubics, _least_between
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory


def matrices(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n))
    return A @ A.T + 0.3 * np.eye(n), random.normal(size=n) * 3


@settings(max_examples=examples(30))
@given(st.integers(2, 3), st.integers(0, 2**32 - 1))
def test_a_body_set_free_moves_in_the_only_way_that_the_laws_allow(route: Route, n: int, seed: int):
    G, load = matrices(n, seed)
    ((_, a, clearly),) = consistent(load, G)  # one and no more, as G is positive definite
    assume(clearly > 1e-3)
    motion = simulate(rigid(n), 1e-3, p={"b": load, "G": G.ravel(order="F")}, route=route)
    assert motion.end == pytest.approx(1e-3 * a, abs=1e-14)
    assert not motion.events  # it began so


@pytest.mark.parametrize(
    ("units", "nominal"),
    [
        *((3 * (unit,), 3 * (1.0,)) for unit in (1e-12, 1e-6, 1e6)),
        *((units, units) for units in ((1e-7, 1.0, 1e7), (1e7, 1e-7, 1.0))),
    ],
)
@pytest.mark.parametrize(("n", "seed"), [(2, 8), (2, 26), (3, 130)])
def test_what_is_caught_again_does_not_depend_on_units(
    n: int, seed: int, units: tuple[float, ...], nominal: tuple[float, ...], route: Route
):
    """Here one contact that cannot be held at first can when another has been let go.

    Nominal speeds tell units of velocities that are far apart.
    """
    G, load = matrices(n, seed)
    ((_, a, _),) = consistent(load, G)
    each = np.array(units[:n])
    contacts = zip(rigid(n).contacts, nominal, strict=False)
    contacts = [replace(contact, nominal_speed=unit) for contact, unit in contacts]
    p = {"b": each * load, "G": (each[:, None] * G).ravel(order="F")}
    motion = simulate(replace(rigid(n), contacts=contacts), 1e-3, p=p, route=route)
    assert motion.end / each == pytest.approx(1e-3 * a, abs=1e-14)
    assert not motion.events


@pytest.mark.usefixtures("unaided")
@pytest.mark.parametrize("held", [[0, 1], [0, 2], [1, 2]])
@pytest.mark.parametrize("struck", [[0, 1], [0], [1]])
def test_what_is_held_is_stopped_by_impulses_also_where_another_is_struck(
    held: list[int], struck: list[int], route: Route
):
    """Of three velocities two are held, and nothing else touches the ground."""
    v, f, t = ca.SX.sym("v", 3), ca.SX.sym("f", 2), ca.SX.sym("t")
    G = np.array([[2.0, 0.8, 0.3], [0.8, 1.0, 0.2], [0.3, 0.2, 1.5]])
    grounds = [Contact(f"ground {i}", v[i], f[k], NoSlip()) for k, i in enumerate(held)]
    before, kick = np.ones(3), np.array([0.3, -0.2, 0.1])
    before[held] = 0.0
    hits = [held[k] for k in struck]
    kick[[i for i in held if i not in hits]] = 0.0
    states, given = [Signal("v", v)], ca.SX.sym("given", 3)  # a parameter: compiled once for each
    switch = Switch("kick", t - 0.5, v + given)
    push, p = ca.DM(G[:, held]) @ f, [Signal("given", given)]
    body = Model("body", states, push, t=t, p=p, contacts=grounds, switches=[switch])
    motion = simulate(body, 1.0, x0={"v": before}, p={"given": kick}, route=route)
    impulse = np.linalg.solve(G[np.ix_(held, held)], -kick[held])
    assert motion.end == pytest.approx(before + kick + G[:, held] @ impulse, abs=1e-12)
    hit = [(f"ground {i}", "impact") for i in hits]
    assert [(e.name, e.kind) for e in motion.events] == [("kick", "switch"), *hit]


@pytest.mark.parametrize(
    ("route", "n"),
    [("native", 7), ("python", 12), pytest.param("native", 12, marks=pytest.mark.slow)],
)
def test_many_that_act_on_each_other_are_let_go_one_by_one(route: Route, n: int):
    """Each contact is pushed with more than it holds: as many decisions at one instant."""
    v, f = ca.SX.sym("v", n), ca.SX.sym("f", n)
    G, push = np.eye(n) + 0.01, np.linspace(3.0, 4.0, n)
    grounds = [Contact(f"foot {i}", v[i], f[i], Coulomb(1.0, 1.0)) for i in range(n)]
    states = [Signal("v", v, value=0.0)]
    model = Model("many", states, ca.DM(push) + ca.DM(G) @ f, contacts=grounds)
    motion = simulate(model, 1.0, route=route)
    assert motion.end == pytest.approx(push - G.sum(1), rel=1e-12)
    assert not motion.events


@pytest.mark.parametrize(("way", "friction"), [(1.0, 4.0), (-1.0, 2.0)])
def test_a_belt_that_starts_at_once_takes_what_rests_on_it_along(
    route: Route, way: float, friction: float
):
    """Its velocity is scheduled: 0, from t = 1/2 on `way`."""
    t, v, f, belt, begin = (ca.SX.sym(name) for name in ("t", "v", "f", "belt", "begin"))
    speeds = Schedule("belt", belt, begin, np.array([0.0, 0.5, 2.0]), np.array([[0.0], [way]]))
    ground = [Contact("block", v - belt, f, Coulomb(2.0, 4.0))]
    states = [Signal("v", v, value=0.0)]
    model = Model("belt", states, f, t=t, schedules=[speeds], contacts=ground)
    motion = simulate(model, 2.0, route=route)
    told = [(event.kind, event.mode) for event in motion.events]
    assert told == [("release", -way), ("stick", 0)]
    times = [event.time for event in motion.events]
    assert times == pytest.approx([0.5, 0.5 + 1 / friction], abs=1e-12)
    assert motion.end == pytest.approx([way], abs=1e-12)


def test_modes_are_told_where_they_change_and_nowhere_else(route: Route):
    """Eleven blocks slide for 1 s, one for 3; nothing comes of the schedule and the switch."""
    v, f = ca.SX.sym("v", 12), ca.SX.sym("f", 12)
    t, c, begin = (ca.SX.sym(name) for name in ("t", "c", "begin"))
    model = Model(
        "braked",
        x=[Signal("v", v, value=[*11 * [1.0], 3.0])],
        ode=f + c,
        t=t,
        contacts=[Contact(f"block {i}", v[i], f[i], Coulomb(1.0, 1.0)) for i in range(12)],
        schedules=[Schedule("c", c, begin, np.array([0.0, 0.3]), np.zeros((1, 1)), True)],
        switches=[Switch("nothing", ca.sin(7 * t), v)],
    )
    motion = simulate(model, 2.0, route=route)
    assert motion.modes[:, 0] == pytest.approx([0.0, 1.0], abs=1e-12)
    assert motion.modes[:, 1:].tolist() == [12 * [1], [*11 * [0], 1]]


def two_feet(v: ca.SX, f: ca.SX, name: str = "foot") -> list[Contact]:
    own = [slice(2 * i, 2 * i + 2) for i in (0, 1)]
    return [Contact(f"{name} {i}", v[s], f[s], Elliptic(1, 1, 1)) for i, s in enumerate(own)]


@cache
def feet() -> Model:
    """Two feet in the plane whose forces act on each other: v' = b + G f."""
    v, f, b = (ca.SX.sym(name, 4) for name in "vfb")
    G = ca.SX.sym("G", 4, 4)
    states, p = [Signal("v", v, value=0.0)], [Signal("b", b), Signal("G", ca.vec(G))]
    return Model("feet", states, b + G @ f, p=p, contacts=two_feet(v, f))


def set_free(G: np.ndarray, load: np.ndarray, route: Route) -> int:
    """Feet go straight on, each against a force of 1, or are held by less; how many rest."""
    span, p = 1e-2, {"b": load, "G": G.ravel(order="F")}
    motion = simulate(feet(), span, p=p, route=route)
    a = motion.end / span
    moves = np.repeat(motion.modes[0, 1:3] != 0, 2)
    speeds = np.repeat(np.linalg.norm(a.reshape(2, 2), axis=1), 2)
    force = -a / np.where(moves, speeds, 1.0)
    rest = ~moves
    force[rest] = np.linalg.solve(G[np.ix_(rest, rest)], -(load + G @ (force * moves))[rest])
    assert a == pytest.approx(load + G @ force, abs=1e-9 * np.abs(load).max())
    assert np.linalg.norm(force.reshape(2, 2), axis=1).max() < 1 + 1e-9
    assert not motion.events
    onsets = motion.modes[0, 3:].reshape(2, 4)
    assert not onsets[rest[::2]].any()  # what rests has no direction
    assert onsets[:, 2] * span == pytest.approx([0.0, 0.0], abs=1e-6)  # nor turns what slips
    return int(rest.sum())


@pytest.mark.usefixtures("unaided")
def test_feet_begin_to_slip_the_way_they_go_on(route: Route):
    """What one motion has come to is nothing to the next."""
    resting = []
    for seed in (*range(1, 13), *range(12, 0, -1)):
        random = np.random.default_rng(seed)
        A, load = random.normal(size=(4, 4)), seed * random.normal(size=4) / 2
        resting.append(set_free(A @ A.T + 0.5 * np.eye(4), load, route))
    assert set(resting) == {0, 2, 4}


@pytest.mark.usefixtures("unaided")
@pytest.mark.parametrize("seed", [66, 77, 86, 95, 117, 118, 119, 163, 168, 186])
def test_feet_that_act_strongly_on_each_other_go_straight_on(seed: int, route: Route):
    """Another that begins to slip, or is caught again, turns a foot by up to a right angle."""
    random = np.random.default_rng(seed)
    A, load = random.normal(size=(4, 4)), (seed % 12 + 1) * random.normal(size=4) / 2
    set_free(A @ A.T + 0.02 * np.eye(4), load, route)


@pytest.mark.usefixtures("unaided")
@pytest.mark.parametrize("seed", [38, 58, 141, 321, 371, 0, 1, 15, 68, 79])
def test_feet_turn_by_more_than_a_right_angle_where_few_motions_are_light(seed: int, route: Route):
    """Motions whose inertias differ by up to ten thousand times."""
    set_free(*light_in_few_ways(seed), route)


def light_in_few_ways(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrix of two feet with eigenvalues from 1e-4 to 1, and a load beyond what they hold."""
    random = np.random.default_rng(seed)
    Q, load = np.linalg.qr(random.normal(size=(4, 4)))[0], 10 * random.normal(size=4)
    return Q @ np.diag(np.logspace(-4, 0, 4)) @ Q.T, load


@pytest.mark.compiled
def test_directions_hard_to_find_are_found_in_the_end(monkeypatch: pytest.MonkeyPatch):
    """Compiled steps that find none leave it to those in Python."""
    asked, in_python = list[bool](), routes._in_python
    monkeypatch.setattr(
        routes, "_in_python", lambda *given: asked.append(True) or in_python(*given)
    )
    for seed in (22, 60, 77, 106, 256):
        set_free(*light_in_few_ways(seed), "native")
    assert asked


@pytest.mark.compiled
def test_compiled_steps_leave_it_to_others_to_part_a_shared_load(monkeypatch: pytest.MonkeyPatch):
    """Ends of 1 and 3 let go at 4 in all; how they share less is open, so who goes first."""
    asked: list[float] = []
    monkeypatch.setattr(routes, "_in_python", lambda task, report: asked.append(1) or 1 / 0)
    laws = [Elliptic(F, F, F) for F in (1.0, 3.0)]
    rod = body(ROD, laws, lambda t: ca.vertcat(t, 0, 0))
    assert simulate(rod, 1.9, route="native").end[:3] == pytest.approx([0, 0, 0], abs=1e-12)
    with pytest.raises(ZeroDivisionError):
        simulate(rod, 3.0, route="native")
    assert asked == [1]


@cache
def pushed(order: int) -> Model:
    """Two feet in the plane whose forces act on each other, pushed to and fro."""
    t, G = ca.SX.sym("t"), ca.SX.sym("G", 4, 4)
    v, f, c, e = (ca.SX.sym(name, 4) for name in "vfce")
    numbers = [Signal("c", c), Signal("e", e), Signal("G", ca.vec(G))]
    ode = G @ (f + c * ca.sin(t) + e * ca.cos(t))
    states = [Signal("v", v, value=0.0)]
    return Model("pushed", states, ode, t=t, p=numbers, contacts=two_feet(v, f)[::order])


SWINGING = [(61, -1), (106, 1), (106, -1), (430, 1)]  # seeds and orders


@pytest.mark.usefixtures("unaided")
@pytest.mark.parametrize(
    ("seed", "order", "route"),
    [
        *((seed, order, "native") for seed, order in SWINGING),
        (*SWINGING[1], "python"),
        *(pytest.param(*SWINGING[i], "python", marks=pytest.mark.slow) for i in (0, 2, 3)),
    ],
)
def test_what_is_held_is_not_let_go_by_a_force_that_swings_round(
    seed: int, order: int, route: Route
):
    """A foot's force swings round where it all but stops, and the other rests.

    Over any time the mean force is one that the ground can hold, and takes the power of sliding.
    """
    random = np.random.default_rng(seed)
    A, (c, e) = random.normal(size=(4, 4)), random.normal(size=(2, 4))
    G, end, n = A @ A.T + 0.1 * np.eye(4), 14.3, 14_300
    p = {"c": c, "e": e, "G": G.ravel(order="F")}
    t = np.linspace(0.0, end, n + 1)
    motion = simulate(pushed(order), end, p=p, route=route, times=t)
    v, push = motion["v"], e[:, None] * np.sin(t) - c[:, None] * np.cos(t)
    force = (np.diff(np.linalg.solve(G, v) - push) * n / end).reshape(2, 2, n)
    middle = ((v[:, 1:] + v[:, :-1]) / 2).reshape(2, 2, n)
    assert np.linalg.norm(force, axis=1).max() < 1 + 1e-6
    power = np.linalg.norm(middle, axis=1)
    assert (power + (force * middle).sum(axis=1)).sum() < 1e-5 * power.sum()
    last = dict[str, float]()
    for event in motion.events:
        assert event.time > last.get(event.name, -1.0) + 1e-6
        last[event.name] = event.time


@pytest.mark.parametrize("turning", [0.6, -2.0])
def test_an_onset_turns_as_its_load_does(route: Route, turning: float):
    """Load (2, b t) against a force of 1: v = (t, b t^2 / 3) to second order, turning by b / 3."""
    v, f, t, b = ca.SX.sym("v", 2), ca.SX.sym("f", 2), ca.SX.sym("t"), ca.SX.sym("b")
    foot = [Contact("foot", v, f, Elliptic(1.0, 1.0, 1.0))]
    numbers, states = [Signal("b", b, value=turning)], [Signal("v", v, value=0.0)]
    model = Model("foot", states, f + ca.vertcat(2, b * t), t=t, p=numbers, contacts=foot)
    motion = simulate(model, 0.01, route=route)
    (_, _, *direction, half, begun), (end, *_) = motion.modes
    assert [*direction, half, begun] == pytest.approx([1.0, 0.0, turning / 6, 0.0], rel=1e-6)
    assert end > 1e-3  # as the direction is right until then
    assert motion.end == pytest.approx([0.01, turning * 1e-4 / 3], rel=1e-3)
    too_fast = simulate(model, 1e-5, p={"b": 1e8 * turning}, route=route)
    assert len(too_fast.modes) == 2  # it ends while the foot is slow, and that is no stop
    assert not too_fast.events


@pytest.mark.parametrize("order", [1, -1])
def test_one_stops_while_another_begins_to_slip(route: Route, order: int):
    """Block 0 is let go by a load t at t = 1, block 1 has slowed down from 1.2 at 1.2."""
    v, f, t = ca.SX.sym("v", 4), ca.SX.sym("f", 4), ca.SX.sym("t")
    states = [Signal("v", v, value=[0.0, 0.0, 0.0, 1.2])]
    ode, contacts = f + ca.vertcat(t, 0, 0, 0), two_feet(v, f, "block")[::order]
    motion = simulate(Model("blocks", states, ode, t=t, contacts=contacts), 1.3, route=route)
    assert listed(motion) == [("block 0", "release", 1), ("block 1", "stick", 0)]
    assert event_times(motion) == pytest.approx([1.0, 1.2], abs=1e-6)
    assert motion.end == pytest.approx([0.045, 0, 0, 0], abs=1e-6)
    assert motion.modes[-1, 1:3].tolist() == [1, 0][::order]
    assert motion.modes[-1, 3:].any()  # the onset of block 0 goes on


@settings(max_examples=examples(30))
@given(st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_a_millionth_more_than_can_be_borne_lets_go_and_a_millionth_less_does_not(
    route: Route, n: int, seed: int
):
    G, way = matrices(n, seed)
    held = -np.linalg.solve(G, way)
    most = (np.where(held > 0, BACKWARD[:n], FORWARD[:n]) / np.abs(held)).min()
    for share in (1 - 1e-6, 1 + 1e-6):
        ((modes, a, _),) = consistent(share * most * way, G)
        assert modes.any() == (share > 1)
        p = {"b": share * most * way, "G": G.ravel(order="F")}
        motion = simulate(rigid(n), 1.0, p=p, route=route)
        assert motion.end == pytest.approx(a, rel=1e-6, abs=1e-14)
        assert not motion.events  # decided at the start, not by an event right after it


@settings(max_examples=examples(30))
@given(st.integers(2, 3), st.integers(0, 2**32 - 1))
def test_a_growing_load_sets_a_body_free_when_a_contact_can_bear_no_more(
    route: Route, n: int, seed: int
):
    G, growth = matrices(n, seed)
    rates = -np.linalg.solve(G, growth)  # of the forces that hold
    times = np.where(rates > 0, BACKWARD[:n], FORWARD[:n]) / np.abs(rates)
    first, (release, following) = int(np.argmin(times)), np.sort(times)[:2]
    assume(following > 1.01 * release)
    ((modes, *_),) = consistent((1 + 1e-9) * release * growth, G)
    assume(np.flatnonzero(modes).tolist() == [first])  # the others stay
    late, p = 1e-3 * release, {"r": growth, "G": G.ravel(order="F")}
    motion = simulate(rigid(n), release + late, p=p, route=route)
    assert listed(motion) == [(f"foot {first}", "release", -np.sign(rates[first]))]
    assert motion.events[0].time == pytest.approx(release, rel=1e-12)
    # the force of the one that slides stays, those of the others follow the load
    rest = np.delete(np.arange(n), first)
    pull = growth[first] - G[first, rest] @ np.linalg.solve(G[np.ix_(rest, rest)], growth[rest])
    expected = np.zeros(n)
    expected[first] = pull * late**2 / 2
    assert motion.end == pytest.approx(expected, abs=1e-9 * late)


def test_what_can_bear_no_more_at_one_instant_lets_go_at_that_instant(route: Route):
    """Forty blocks of random friction, each pushed with all of it in one second."""
    t, v, f = ca.SX.sym("t"), ca.SX.sym("v", 40), ca.SX.sym("f", 40)
    held = np.random.default_rng(0).uniform(0.1, 10.0, 40)
    states = [Signal("v", v, value=0.0)]
    contacts = [Contact(f"block {i}", v[i], f[i], Coulomb(h, h)) for i, h in enumerate(held)]
    model = Model("blocks", states, ca.DM(held) * t + f, t=t, contacts=contacts)
    motion = simulate(model, 3.0, route=route, tolerance=Tolerance(max_step=np.inf))
    times = np.array([event.time for event in motion.events])
    assert times == pytest.approx(np.ones(len(times)), abs=1e-12)
    assert motion.modes[-1, 1:].tolist() == 40 * [1.0]
    assert motion.end == pytest.approx(held * 2.0, rel=1e-10)


# -- the layer round velocity 0 ----------------------------------------------------------------

V_REG = 1e-6


@cache
def braked(sign: float) -> Model:
    """A block pushed by 1 + 2 (t - still) over ground that resists with 1, times `sign`."""
    t, v, f, still = (ca.SX.sym(name) for name in ("t", "v", "f", "still"))
    size = abs(sign)
    ode, numbers = sign * (1 + 2 * (t - still)) + f, [Signal("still", still, value=1.0)]
    contacts = [Contact("block", v, f, Coulomb(size, size), nominal_speed=size)]
    return Model("braked", [Signal("v", v, value=0.0)], ode, t=t, p=numbers, contacts=contacts)


def passed(sign: float, start: float, still: float, route: Route) -> Trajectory:
    """The block from a velocity on, in steps that are as long as they may be."""
    return simulate(
        braked(sign), 10.0, contact=Smooth(abs(sign) * V_REG), route=route,
        x0={"v": sign * start}, p={"still": still},
        tolerance=Tolerance(1e-9, 1e-10 * abs(sign), max_step=np.inf),
    )  # fmt: skip


@pytest.mark.parametrize("sign", [1.0, -1.0])
@settings(max_examples=examples(15))
@given(st.floats(1.0, 9.0), st.floats(2e-5, 1e-3))
def test_a_stop_within_one_long_step_is_not_passed_over(
    route: Route, sign: float, still: float, depth: float
):
    """Without the ground's turn about, the velocity would fall to -depth at `still` and rise.

    Friction holds the block from where it stops until then, so that v = (t - still)^2 after it.
    Steps are exact on either side and know no reason to be short.
    """
    motion = passed(sign, still**2 - depth, still, route)
    assert sign * motion.end[0] == pytest.approx((10.0 - still) ** 2, abs=5 * V_REG)


@pytest.mark.parametrize("unit", [1e6, -1e6])
def test_a_stop_is_seen_in_any_unit_of_velocity(route: Route, unit: float):
    """The same in micrometres per second."""
    motion = passed(unit, 9.0 - 1e-4, 3.0, route)
    assert motion.end[0] / unit == pytest.approx(49.0, abs=5 * V_REG)


@cache
def gained_in_a_dip(least: float) -> float:
    """By a stiff solver, which starts and ends where tanh is 1 to the last digit."""
    half = 0.02
    start = [half**2 + least * V_REG]
    slow = solve_ivp(
        lambda t, v: 1 + 2 * t - np.tanh(v / V_REG), (-half, half), start,
        method="Radau", rtol=1e-10, atol=1e-14, max_step=1e-4,
    )  # fmt: skip
    return slow.y[0, -1] - start[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("least", [0.3, 1.0, 3.0])
def test_a_dip_into_the_layer_without_a_turn_is_not_passed_over(
    route: Route, sign: float, least: float
):
    """Where the velocity falls to `least` times V_REG only, the ground lets go for a moment.

    It gains little, as it leaves the layer the sooner.
    """
    still, gained = 5.0, gained_in_a_dip(least)
    assert gained > V_REG
    motion = passed(sign, still**2 + least * V_REG, still, route)
    expected = (10.0 - still) ** 2 + least * V_REG + gained
    assert sign * motion.end[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stops_of_what_is_no_state_are_not_passed_over(route: Route, sign: float):
    """The block of above stands on a belt that runs ever faster, beside a state of another size.

    Where steps end is chance, so that it starts with many speeds.
    """
    t, v, y, f, belt = (ca.SX.sym(name) for name in ("t", "v", "y", "f", "belt"))
    states = [Signal("v", v), Signal("y", y, value=100.0)]
    ode = ca.vertcat(sign * (1 + 2 * (t - 5.0)) + belt + f, 0)
    numbers = [Signal("belt", belt, value=0.5)]
    contacts = [Contact("block", v - belt * t, f, Coulomb(1.0, 1.0))]
    model = Model("on a belt", states, ode, t=t, p=numbers, contacts=contacts)
    passed = np.geomspace(3e-5, *((1e-2, 120) if route == "native" else (2e-3, 3)))
    blocks = simulate_ensemble(
        model, 10.0, [Scenario(x0={"v": sign * (25.0 - least)}) for least in passed],
        contact=Smooth(V_REG), route=route,
        tolerance=Tolerance(1e-9, 1e-10, max_step=np.inf),
    )  # fmt: skip
    ends = [sign * (block.end[0] - 5.0) for block in blocks.motions]
    assert ends == pytest.approx(np.full(len(passed), 25.0), abs=5 * V_REG)


def test_the_least_between_samples_is_that_of_parabolas():
    """And of what is constant."""
    s = np.linspace(0.0, 1.0, 17)[:, None]
    turns = np.array([[0.03, 0.5, 0.53, 0.97]])
    curves = np.hstack([0.1 + (s - turns) ** 2, 3.0 + 0.0 * s])
    assert _least_between(curves) == pytest.approx([*4 * [0.1], 3.0], abs=1e-14)


def test_cubics_are_told_by_the_ends_of_a_step():
    """Cubics in the time of a step of 2 s, by their values and slopes at its ends."""
    t, span = np.array([3.0, 5.0]), 2.0
    cubics = [np.polynomial.Polynomial(c) for c in ([1.0, -4.0, 0.5, 0.25], [0.0, 2.0, -1.0, -3.0])]
    (x, x_new), (dx, dx_new) = (
        np.array([of(t) for of in parts]).T for parts in (cubics, [c.deriv() for c in cubics])
    )
    step = SimpleNamespace(h=span, x=x, x_new=x_new, dx=dx, dx_new=dx_new)
    inner = np.array([of(np.linspace(3.0, 5.0, 17)) for of in cubics]).T
    assert _cubics(step) == pytest.approx(inner, rel=1e-13)  # type: ignore[arg-type]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_dip_that_ends_above_the_layer_shortens_no_step(route: Route, sign: float):
    """The force is constant all along: two steps that are exact would do."""
    motion = passed(sign, 25.01, 5.0, route)
    assert sign * motion.end[0] == pytest.approx(25.01, rel=1e-12)
    assert motion.n_rejected == 0


@pytest.mark.parametrize(
    "holds", [1e9, 1e30, *(pytest.param(each, marks=pytest.mark.slow) for each in (1e12, 1e15))]
)
@pytest.mark.parametrize("push", [0.49, 0.5 + 1e-6, 0.6, -0.6])
def test_contacts_that_share_a_load_give_way_however_much_they_hold_backward(
    holds: float, push: float
):
    """Two contacts on one velocity slide where the push exceeds the sum of their limits."""
    x, v, f = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f", 2)
    law = Coulomb(0.25, holds) if push > 0 else Coulomb(holds, 0.25)
    states = [Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)]
    contacts = [Contact(f"sole {i}", v, f[i], law) for i in range(2)]
    block = Model("block", states, ca.vertcat(v, push + f[0] + f[1]), contacts=contacts)
    motion = simulate(block, 2.0, route="python")
    excess = np.sign(push) * max(abs(push) - 0.5, 0.0)
    np.testing.assert_allclose(motion.end, [2 * excess, 2 * excess], rtol=1e-9, atol=1e-15)


def test_three_contacts_that_only_move_forward_share_the_load_on_two_masses():
    """Each alone gives way at 0.3; together they hold 0.6 on one mass, and let go of 0.7."""
    x, v, f = ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 3)
    rows = ca.DM([[1, 0], [0, 1], [1, 1]])
    push = ca.SX.sym("push")
    states = [Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)]
    ode = ca.vertcat(v, ca.vertcat(push, 0) + rows.T @ f)
    contacts = [Contact(f"{i}", rows[i, :] @ v, f[i], Coulomb(0.3, 1e9)) for i in range(3)]
    worm = Model("two masses", states, ode, p=[Signal("push", push, value=0.59)], contacts=contacts)
    assert not simulate(worm, 1.0, route="python").end.any()
    moved = simulate(worm, 1.0, p={"push": 0.7}, route="python").end
    np.testing.assert_allclose(moved, [0.05, 0.0, 0.1, 0.0], atol=1e-12)
