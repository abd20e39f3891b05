"""Decisions about contacts and switches at their bounds, by closed forms, on both routes."""

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from held_bodies import BACKWARD, FORWARD, consistent, rigid
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from on_routes import attempted
from simulated import refused

from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb, NoSlip, Spike
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.planar_friction import Elliptic
from wormopt.model.schedule import Schedule
from wormopt.simulation.options import Route, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

USUAL = Tolerance()
ERRORS = USUAL.relative + USUAL.absolute  # of a step
DRIFT = 1e3 * (1e-14 + ERRORS)  # speed that a resting velocity may gather, of the nominal one
STRUCK = 1e-11  # speed that only an impulse stops, of the nominal one
EDGE = 100 * ERRORS  # share of a force that errors of a motion may bridge
SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0])
pytestmark = pytest.mark.usefixtures("unaided")


def kinds(motion: Trajectory) -> list[tuple[str, str]]:
    return [(event.name, event.kind) for event in motion.events]


# -- slow is at rest -----------------------------------------------------------------------------


@cache
def kicked(law: Any, nominal: float) -> Model:
    """A block that is pushed, whose velocity is set at t = 1/2."""
    t, v, f, to, push = (ca.SX.sym(name) for name in ("t", "v", "f", "to", "push"))
    states = [Signal("v", v, value=0.0)]
    numbers = [Signal("to", to, value=0.0), Signal("push", push, value=0.0)]
    contacts = [Contact("block", v, f, law, nominal_speed=nominal)]
    switches = [Switch("kick", t - 0.5, to)]
    return Model("kicked", states, f + push, t=t, p=numbers, contacts=contacts, switches=switches)


@pytest.mark.parametrize("nominal", [1e-3, 10.0])
@pytest.mark.parametrize(
    ("before", "after", "kind"),
    [
        (1.0, 0.9995 * STRUCK, "stick"),
        (1.0, 1.0005 * STRUCK, "impact"),
        (0.0, 0.7 * DRIFT, None),
        (0.0, 1.4 * DRIFT, "impact"),
    ],
)
def test_a_spike_struck_backward_stops_by_an_impulse_if_it_is_not_slow(
    before: float, after: float, kind: str | None, nominal: float, route: Route
):
    start, to = nominal * np.array([before, -after])
    motion = simulate(kicked(Spike(), nominal), 1.0, x0={"v": start}, p={"to": to}, route=route)
    assert kinds(motion) == [("kick", "switch"), *([("block", kind)] if kind else [])]
    assert motion.end[0] == 0.0
    assert motion.modes[-1, 1] == 0


@SIGNS
@pytest.mark.parametrize("speed", [0.7 * DRIFT, 1.4 * DRIFT])
def test_slow_as_drift_only_what_rests_is_at_rest(speed: float, sign: float, route: Route):
    """What slides goes on to slide down to 0."""
    block = kicked(Coulomb(1e-8, 1e-8), 1.0)
    options: Any = {"p": {"to": sign * speed}, "route": route}
    slid = simulate(block, 2.5, x0={"v": sign}, **options)
    assert kinds(slid) == [("kick", "switch"), ("block", "stick")]
    assert slid.events[1].time == pytest.approx(0.5 + speed / 1e-8, rel=1e-9)
    rested = simulate(block, 2.5, **options)
    let_go = [("block", "release"), ("block", "stick")] if speed > DRIFT else []
    assert kinds(rested) == [("kick", "switch"), *let_go]


@SIGNS
@pytest.mark.parametrize("lacking", [0.5e-13, 1.5e-13])
def test_one_is_let_go_and_its_neighbour_by_its_own_force(
    lacking: float, sign: float, route: Route
):
    """What counts as rounding is 1e-13 of the largest force."""
    v, f, push = (ca.SX.sym(name, 2) for name in ("v", "f", "push"))
    grounds = [Contact(f"block {i}", v[i], f[i], Coulomb(1.0, 1.0)) for i in range(2)]
    states, p = [Signal("v", v, value=0.0)], [Signal("push", push)]
    model = Model("neighbours", states, f + push, p=p, contacts=grounds)
    pushed = {"push": [2 * sign, sign * (1 + lacking)]}
    motion = simulate(model, 1.0, p=pushed, route=route)
    assert motion.modes[:, 1:].tolist() == [[sign, sign if lacking > 1e-13 else 0.0]]
    assert not motion.events


class Ratchet:
    """A law of a user's own: it slides forward only, and breaks where it is pushed back."""

    directions = (1,)
    stick_interval = (-0.5, 2.0)

    def slip_force(self, v: ca.SX, direction: int) -> float:
        return -0.5 * direction

    def smooth(self, v: ca.SX, v_reg: float) -> ca.SX:
        return -0.5 * ca.tanh(v / v_reg)


@pytest.mark.parametrize(("push", "speed"), [(1.5, 1.0), (-1.9, 0.0), (-2.1, None)])
def test_nothing_is_let_go_where_its_law_does_not_let_it(
    push: float, speed: float | None, route: Route
):
    model, p = kicked(Ratchet(), 1.0), {"push": push}
    if speed is None:
        assert refused(model, 0.4, route, p=p).code == "no_contact_mode"
    else:
        motion = simulate(model, 0.4, p=p, route=route)
        assert motion.end == pytest.approx([0.4 * speed], abs=1e-13)


@pytest.mark.parametrize("order", [1, -1])
def test_nor_beside_one_that_may_go(order: int, route: Route):
    """Two blocks that do not act on each other are let go at once, one against its law."""
    v, f = ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    laws = [Ratchet(), Coulomb(1.0, 1.0)][::order]
    grounds = [Contact(f"block {i}", v[i], f[i], law) for i, law in enumerate(laws)]
    push = ca.DM([-2.1, 3.0][::order])
    model = Model("neighbours", [Signal("v", v, value=0.0)], f + push, contacts=grounds)
    assert refused(model, 0.4, route).code == "no_contact_mode"


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("share", [0.7, 1.4])
@pytest.mark.parametrize("side", [1, -1])
def test_a_start_near_the_edge_of_what_holds_is_told(
    side: int, share: float, way: float, route: Route
):
    """As near as errors of the motion, on either side."""
    block, p = kicked(Coulomb(2.0, 2.0), 1.0), {"push": 2.0 * way * (1 + side * share * EDGE)}
    motion = simulate(block, 0.25, p=p, sensitivities=["to"], route=route)
    told = [(doubt.event.name, doubt.reason) for doubt in motion.nonsmooth_events]
    assert (("block", "edge") in told) == (share < 1)
    assert motion.modes[-1, 1] == (way if side > 0 else 0)


# -- contacts that act on each other -------------------------------------------------------------


@pytest.mark.parametrize(("share", "fits"), [(0.7, False), (1.4, True)])
def test_forces_count_as_determined_down_to_a_determinant_of_1e10(
    share: float, fits: bool, route: Route
):
    """Of rows of size 1."""
    near = 1 - share * 1e-10
    G = np.array([[1.0, near], [near, 1.0]]) / np.hypot(1.0, near)
    options: Any = {"p": {"G": G.ravel()}, "route": route}
    if fits:
        assert simulate(rigid(2), 1.0, **options).modes[:, 1:].tolist() == [[0, 0]]
    else:
        assert refused(rigid(2), 1.0, **options).code == "no_contact_mode"


def test_a_body_that_a_push_may_pull_moves_as_the_laws_allow_or_is_refused(route: Route):
    """Its matrix is any: letting go and catching may go on for ever, though there is a choice."""
    random, ends = np.random.default_rng(1), []
    for n in 30 * [2, 3]:
        G, load = 2 * random.normal(size=(n, n)), random.uniform(-4, 4, n)
        p = {"b": load, "G": G.ravel(order="F")}
        try:
            motion = simulate(rigid(n), 1e-3, p=p, route=route)
        except SolveError as error:
            ends.append((error.code, error.partial.end_time))
            continue
        ways = [1e-3 * a for _, a, _ in consistent(load, G)]
        assert any(np.allclose(motion.end, way, rtol=0, atol=1e-12) for way in ways)
        ends.append("right")
    assert set(ends) == {"right", ("no_contact_mode", 0.0)}


@SIGNS
@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e6])
@pytest.mark.parametrize("back", [-0.5e-9, 0.5e-9, 1.5e-9])
def test_what_is_let_go_is_caught_again_if_it_is_pulled_back_by_more_than_rounding(
    back: float, unit: float, sign: float, route: Route
):
    """Foot 0 goes first; then foot 1, whose force had pulled it: it is left with -`back`."""
    strong = (BACKWARD if sign < 0 else FORWARD)[:2]
    own = np.array([0.02, 1.0])  # of strong[0] foot 0 feels next to nothing
    G = np.array([[own[0], -0.5], [-0.5, 20.0]])
    pull = 20.0 * 10.0
    load = sign * np.array([own[0] * strong[0] - 0.5 * strong[1], 20.0 * strong[1] + pull])
    load[0] -= sign * back * pull
    p = {"b": unit * load, "G": unit * G.ravel()}
    motion = simulate(rigid(2), 1e-3, p=p, route=route)
    assert motion.modes[0, 1:].tolist() == [0.0 if back > 1e-9 else sign, sign]
    assert not motion.events or back == 0.5e-9  # it stops at once


@pytest.mark.parametrize("order", [1, -1])
def test_a_mirrored_sled_is_the_mirror_of_a_sled(order: int, route: Route):
    """It slides on one contact and is held by another that is kicked; a third one just slides."""
    v, f, t, kick = ca.SX.sym("v", 3), ca.SX.sym("f", 3), ca.SX.sym("t"), ca.SX.sym("kick", 3)
    G = np.array([[2.0, 0.8, 0.3], [0.8, 1.0, 0.2], [0.3, 0.2, 1.5]])
    laws = [Coulomb(0.5, 0.5), NoSlip(), Coulomb(0.3, 0.3)]
    grounds = [Contact(f"ground {i}", v[i], f[i], law) for i, law in enumerate(laws)]
    states, numbers = [Signal("v", v, value=0.0)], [Signal("kick", kick, value=0.0)]
    contacts, switches = grounds[::order], [Switch("kick", t - 0.5, v + kick)]
    sled = Model("sled", states, ca.DM(G) @ f, t=t, p=numbers, contacts=contacts, switches=switches)
    start, by = np.array([1.0, 0.0, 2.0]), np.array([0.0, 0.3, 0.0])
    one, other = (
        simulate(sled, 3.0, x0={"v": sign * start}, p={"kick": sign * by}, route=route)
        for sign in (1, -1)
    )
    assert kinds(one)[:2] == [("kick", "switch"), ("ground 1", "impact")]
    assert kinds(one) == kinds(other)
    assert other.end == pytest.approx(-one.end, abs=1e-13)
    # until the first stop all forces but that of what is held are known
    held = -(G[1, 0] * -0.5 + G[1, 2] * -0.3) / G[1, 1]
    slows = G @ [-0.5, held, -0.3]
    after = start + 0.5 * slows + by - G[:, 1] * by[1] / G[1, 1]
    stops = 0.5 + (after / -slows)[[0, 2]]
    assert one.events[2].name == f"ground {2 * int(np.argmin(stops))}"
    assert one.events[2].time == pytest.approx(stops.min(), rel=1e-12)


@SIGNS
@pytest.mark.parametrize("order", [1, -1])
def test_what_is_let_go_as_another_is_struck_goes_its_way(order: int, sign: float, route: Route):
    """A load of t pulls one off at 1, when the other, which is held, is kicked."""
    v, f, t, way = ca.SX.sym("v", 2), ca.SX.sym("f", 2), ca.SX.sym("t"), ca.SX.sym("way")
    laws = [Coulomb(1.0, 1.0), NoSlip()]
    grounds = [Contact(f"ground {i}", v[i], f[i], law) for i, law in enumerate(laws)]
    kick = Switch("kick", t - 1, v + ca.DM([0.0, 0.3]))
    states, ode, p = [Signal("v", v, value=0.0)], f + ca.vertcat(way * t, 0), [Signal("way", way)]
    pair = Model("pair", states, ode, t=t, p=p, contacts=grounds[::order], switches=[kick])
    motion = simulate(pair, 2.0, p={"way": sign}, route=route)
    expected = {("ground 0", "release"), ("ground 1", "impact"), ("kick", "switch")}
    assert sorted(kinds(motion)) == sorted(expected)
    assert motion.end == pytest.approx([sign / 2, 0.0], abs=1e-12)


# -- onsets --------------------------------------------------------------------------------------


def test_what_stops_as_soon_as_it_has_begun_to_slip_can_be_kicked(route: Route):
    """A load above 1 from t = 1 to 3, by so little that the block is at rest again at 4.

    Kicked back at 5 it slides for 1/2, as load and friction stop it. Its neighbour does not move.
    """
    least = 2e-7
    t, q, v, f = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 4), ca.SX.sym("f", 4)
    law = Elliptic(1.0, 1.0, 1.0)
    pull = 1 + least * (1 - (t - 2) ** 2)
    model = Model(
        "slipping",
        [Signal("q", q, value=0.0), Signal("v", v, value=0.0)],
        ca.vertcat(v[2:], f + ca.vertcat(0, 0, 0, pull)),
        t=t,
        contacts=[Contact(f"block {i}", v[2 * i : 2 * i + 2], f[2 * i : 2 * i + 2], law)
                  for i in range(2)],
        switches=[Switch("kick", t - 5, ca.vertcat(q, v[:3], -1))],
    )  # fmt: skip
    motion = simulate(model, 7.0, route=route, tolerance=Tolerance(1e-9, 1e-10))
    moves = [("block 1", kind) for kind in ("release", "stick")]
    assert kinds(motion) == [*moves, ("kick", "switch"), *moves]
    times = [event.time for event in motion.events]
    assert times == pytest.approx([1.0, 4.0, 5.0, 5.0, 5.5], abs=1e-5)
    assert motion.end[:2] == pytest.approx([0.0, 2.25 * least - 0.25], abs=2e-6)
    assert motion.end[2:].tolist() == 4 * [0.0]
    onsets = motion.modes[:, 3:].any(axis=1)
    assert onsets.tolist() == [False, True, False, False, False]


@pytest.mark.parametrize("joined", [False, True])
def test_what_begins_to_slip_goes_on_when_something_else_happens(joined: bool, route: Route):
    """Pulled by t it slips from 1 on; its twin, joined to it or not, rests.

    At 1.03 it is slower than what counts as stopped, but it has just begun.
    """
    t, v, f = ca.SX.sym("t"), ca.SX.sym("v", 4), ca.SX.sym("f", 4)
    law = Elliptic(1.0, 1.0, 1.0)
    joint = np.kron([[1.0, 0.25 * joined], [0.25 * joined, 1.0]], np.eye(2))
    push = f + ca.vertcat(0.5 * t, 0, t, 0)
    model = Model(
        "slipping",
        [Signal("v", v, value=0.0)],
        ca.DM(joint) @ push,
        t=t,
        contacts=[Contact(f"block {i}", v[2 * i : 2 * i + 2], f[2 * i : 2 * i + 2], law)
                  for i in range(2)],
        switches=[Switch("nothing", t - 1.03, v)],
    )  # fmt: skip
    motion = simulate(model, 1.5, route=route, tolerance=Tolerance(stop=1e-3))
    assert kinds(motion) == [("block 1", "release"), ("nothing", "switch")]
    gained = (1 - (0.25 * joined) ** 2) * 0.5**2 / 2
    assert motion.end == pytest.approx([0, 0, gained, 0], abs=1e-10)


@pytest.mark.parametrize("above", [-1e-15, 0.0, 1e-15])
def test_a_load_that_jumps_to_what_friction_holds_lets_nothing_go(above: float, route: Route):
    """To the last digits, in which the force it takes may be out of bounds."""
    t, v, load, f = (ca.SX.sym(name) for name in ("t", "v", "load", "f"))
    states = [Signal("v", v, value=0.0), Signal("load", load, value=0.1)]
    ode, contacts = ca.vertcat(f + load, 0), [Contact("block", v, f, Coulomb(0.3, 0.3))]
    switches = [Switch("more", t - 0.5, ca.vertcat(v, 0.3 + above))]
    model = Model("loaded", states, ode, t=t, contacts=contacts, switches=switches)
    motion = simulate(model, 1.0, route=route)
    assert kinds(motion) == [("more", "switch")]
    assert motion.end[0] == 0.0


# -- switches ------------------------------------------------------------------------------------


def test_switches_are_told_by_their_names_and_derivatives_go_through_each(route: Route):
    """x is taken 2 a at t = 1, then 3 b at t = 2; y, the block, rests beside it."""
    t, x, y, v, f, a, b = (ca.SX.sym(name) for name in ("t", "x", "y", "v", "f", "a", "b"))
    model = Model(
        "doubled",
        [Signal("x", x, value=0.5), Signal("y", y, value=1.0), Signal("v", v, value=0.0)],
        ca.vertcat(1, v, f),
        t=t,
        p=[Signal("a", a, value=1.5), Signal("b", b, value=-0.7)],
        contacts=[Contact("block", v, f, Coulomb(1.0, 1.0))],
        switches=[
            Switch("first", t - 1, ca.vertcat(2 * a * x, y, v)),
            Switch("second", t - 2, ca.vertcat(3 * b * x, b * y, v)),
        ],
    )
    motion = simulate(model, 3.0, sensitivities=["x", "a", "b", "y"], route=route)
    assert kinds(motion) == [("first", "switch"), ("second", "switch")]
    assert [event.mode for event in motion.events] == [0, 0]
    assert motion.end == pytest.approx([3 * -0.7 * (3 * 1.5 + 1) + 1, -0.7, 0.0], rel=1e-12)
    by = [[6 * 1.5 * -0.7, 6 * 1.5 * -0.7, 0][:2], [3 * -0.7 * 3], [3 * 5.5]]
    expected = [[by[0][0], by[1][0], by[2][0], 0.0], [0.0, 0.0, 1.0, -0.7], [0.0] * 4]
    np.testing.assert_allclose(motion.end_derivative, expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("law", [Spike(), NoSlip()])
def test_an_impulse_changes_with_what_carries_it(law: Any, route: Route):
    """Struck backward, a contact pushes what it is joined to by `share` of its own velocity."""
    t, v, w, f, share = (ca.SX.sym(name) for name in ("t", "v", "w", "f", "share"))
    states, ode = [Signal("v", v, value=0.0), Signal("w", w, value=0.0)], ca.vertcat(f, share * f)
    numbers, contacts = [Signal("share", share, value=0.4)], [Contact("end", v, f, law)]
    switches = [Switch("kick", t - 0.5, ca.vertcat(v - 3.0, w))]
    model = Model("joined", states, ode, t=t, p=numbers, contacts=contacts, switches=switches)
    motion = simulate(model, 1.0, sensitivities=["share"], route=route)
    assert kinds(motion) == [("kick", "switch"), ("end", "impact")]
    assert motion.end == pytest.approx([0.0, 1.2], abs=1e-13)
    np.testing.assert_allclose(motion.end_derivative[:, 0], [0.0, 3.0], atol=1e-13)


@pytest.mark.parametrize("share", [0.4, -0.4])
def test_what_is_held_stops_by_its_own_impulse_whatever_rests_beside_it(share: float, route: Route):
    """Its impulse of 3 moves the block that it is joined to, which friction of 1/2 then slows."""
    t, v, w, f, g = (ca.SX.sym(name) for name in ("t", "v", "w", "f", "g"))
    states = [Signal("v", v, value=0.0), Signal("w", w, value=0.0)]
    ode = ca.vertcat(f + share * g, share * f + g)
    contacts = [Contact("rail", v, f, NoSlip()), Contact("block", w, g, Coulomb(0.5, 0.5))]
    switches = [Switch("kick", t - 0.5, ca.vertcat(v - 3.0, w))]
    model = Model("joined", states, ode, t=t, contacts=contacts, switches=switches)
    motion = simulate(model, 1.0, route=route)
    assert ("rail", "impact") in kinds(motion)
    slowed = 0.5 * (1 - share**2) * 0.5  # the rail takes a part of it
    assert motion.end == pytest.approx([0.0, np.sign(share) * (3 * abs(share) - slowed)], abs=1e-12)


@pytest.mark.parametrize(("share", "again"), [(0.5, True), (2.0, False)])
def test_a_guard_left_above_0_fires_again_only_within_rounding_and_is_refused_there(
    share: float, again: bool, route: Route
):
    """Rounding: its rise in 8 roundings of the time; left by more, it must come from below 0.

    It is exp t - exp 1/2 at first; then it falls by a tenth of that, and rises for good: a second
    event that rounding does not tell from the first, and refused.
    """
    x, w, a, grows, count = (ca.SX.sym(name) for name in ("x", "w", "a", "grows", "count"))
    rate = np.exp(0.5)
    left = share * 8 * 0.5 * np.finfo(float).eps * rate
    first, second = ca.vertcat(left, -1e-6, 1e4, 0, 1), ca.vertcat(-1, 0, 0, 0, count + 1)
    values = {"x": 1 - rate, "w": 1.0, "a": 0.0, "grows": 1.0, "count": 0.0}
    model = Model(
        "touching",
        [Signal(str(s), s, value=values[str(s)]) for s in (x, w, a, grows, count)],
        ca.vertcat(w, a + grows * w, 0, 0, 0),
        switches=[
            Switch("never", x - 1e6, ca.vertcat(x, w, a, grows, count)),
            Switch("rises", x, ca.if_else(count < 1, first, second)),
        ],
    )
    motion, code = attempted(model, 4.0, route=route)
    assert motion.events[0].time == pytest.approx(0.5, rel=1e-14)
    assert motion.end_time == (pytest.approx(0.5, abs=1e-9) if again else 4.0)
    assert (motion.end[4], code) == (1, "events_accumulate" if again else "")


def test_a_guard_that_jumps_at_the_very_end_fires(route: Route):
    """By a schedule, whose break is the end; a motion that ends before has no event."""
    x, u, begin = (ca.SX.sym(name) for name in ("x", "u", "begin"))
    steps = Schedule("u", u, begin, np.array([0.0, 1.0, 2.0]), np.array([[-1.0], [1.0]]))
    switches = [Switch("on", u, x + 1)]
    states = [Signal("x", x, value=0.0)]
    model = Model("late", states, ca.SX(1), switches=switches, schedules=[steps])
    for span, fired in ((1.0, 1), (0.999, 0)):
        motion = simulate(model, span, route=route)
        assert kinds(motion) == fired * [("on", "switch")]
        assert motion.end == pytest.approx([span + fired], abs=1e-12)


@cache
def meeting() -> Model:
    """Two bodies meet and go on as one; the second has `m` times the mass of the first."""
    x, y, v, w, m = (ca.SX.sym(name) for name in ("x", "y", "v", "w", "m"))
    lost = (v - w) / (1 + m)
    return Model(
        "meeting",
        [Signal(str(s), s, value=value) for s, value in ((x, 0.0), (y, 1.0), (v, 1.0), (w, 0.0))],
        ca.vertcat(v, w, 0, 0),
        p=[Signal("m", m, value=0.3)],
        switches=[Switch("meet", x - y, ca.vertcat(x, y, v - m * lost, w + lost))],
    )


def test_bodies_that_go_on_as_one_do_not_meet_again_by_rounding(route: Route):
    """Velocities differ by the last digit or not at all; when places do too, nothing is asked."""
    for m, v, w in np.random.default_rng(0).uniform([0.1, 1, -1], [3, 3, 0.5], (40, 3)):
        x0 = {"v": v, "w": w}
        motion = simulate(meeting(), 1 / (v - w) + 0.2, route=route, p={"m": m}, x0=x0)
        assert [event.time for event in motion.events] == [pytest.approx(1 / (v - w), rel=1e-12)]
        assert motion.end[2:] == pytest.approx((v + m * w) / (1 + m), rel=1e-12)


def test_a_guard_left_at_0_without_a_rate_must_fall_before_it_rises_again(route: Route):
    """A counter is put up to 2, taken back to 1 where its guard is 0, and put up once more."""
    t, n = ca.SX.sym("t"), ca.SX.sym("n")
    switches = [Switch("back", n - 1, ca.SX(1))]
    switches += [Switch(f"up at {at}", t - at, ca.SX(2)) for at in (0.5, 1.5)]
    counter = Model("counter", [Signal("n", n, value=0.0)], ca.SX(0), t=t, switches=switches)
    motion = simulate(counter, 2.0, route=route)
    assert [event.name for event in motion.events] == ["up at 0.5", "back", "up at 1.5"]
    assert motion.end == [2.0]


@cache
def falling_ball(set_down: bool) -> Model:
    """Thrown up from the floor with 1; `kept` is its restitution, `above` where it bounces."""
    names = ("h", "v", "kept", "floor", "above")
    h, v, kept, floor, above = (ca.SX.sym(name) for name in names)
    return Model(
        "ball",
        [Signal("h", h, value=0.0), Signal("v", v, value=1.0)],
        ca.vertcat(v, -2.0),
        p=[Signal(str(p), p, value=0.5 if p is kept else 0.0) for p in (kept, floor, above)],
        switches=[
            Switch("bounce", floor - h + above, ca.vertcat(floor if set_down else h, -kept * v))
        ],
    )


@pytest.mark.parametrize("floor", [0.0, 1e6, -3e5])
@pytest.mark.parametrize("set_down", [False, True])
def test_a_ball_bounces_as_high_up_as_on_the_ground(set_down: bool, floor: float, route: Route):
    """It is thrown up with 1 and has half its speed after each bounce, where it is or on the spot.

    The spot is exact to the last digit of the height only, and so are the times.
    """
    p = {"floor": floor}
    motion = simulate(falling_ball(set_down), 1.98, route=route, x0={"h": floor}, p=p)
    times = 2 - 0.5 ** np.arange(6.0)
    expected = times[times < 1.98]
    found = [event.time for event in motion.events]
    assert found == pytest.approx(expected, abs=1e-12 + 1e-14 * abs(floor) * 64)
    assert motion.end[0] >= floor


@pytest.mark.parametrize("set_down", [False, True])
@given(
    kept=st.floats(0.1, 0.95),
    floor=st.floats(-1e3, 1e3) | st.sampled_from([0.0, 1.0]),
    rounds=st.floats(0.5, 1.5),
)
@example(kept=0.5, floor=0.0, rounds=1.5)
@example(kept=0.8, floor=0.0, rounds=1.5)
@settings(
    max_examples=examples(15),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_a_ball_never_falls_through_the_floor(
    set_down: bool, route: Route, kept: float, floor: float, rounds: float
):
    """Thrown up with 1 it bounces without end before 1 / (1 - kept), and is refused.

    Flights of the last digit of its height may go on by rounding, until steps are spent.
    """
    last = 1 / (1 - kept)
    ball: dict[str, Any] = {"x0": {"h": floor}, "p": {"kept": kept, "floor": floor}}
    ball["tolerance"] = Tolerance(max_steps=2000)
    motion, code = attempted(falling_ball(set_down), rounds * last, route=route, **ball)
    flights = last * (1 - kept ** np.arange(1, 1 + len(motion.events)))
    early = flights < 0.999 * last  # later ones are as long as rounding of the height allows
    found = np.array([event.time for event in motion.events])
    np.testing.assert_allclose(found[early], flights[early], rtol=0, atol=1e-9 * last)
    assert motion.end[0] >= floor - 1e-12 * max(1.0, abs(floor))
    if code == "too_many_steps":  # on flights of the last digit, each of which takes some time
        assert motion.end_time >= last * (1 - 1e-5)
        assert motion.end[0] == pytest.approx(floor, rel=1e-12, abs=1e-12)
    elif code:
        assert code == "events_accumulate"
        assert motion.end_time == pytest.approx(last, rel=1e-5)
    else:
        assert rounds <= 1 + 1e-5


def test_a_height_that_a_ball_just_about_reaches_is_reached_once_or_not(route: Route):
    """Tops differ by digits; the first firing is not refused where the guard falls by then."""
    h, v, top = (ca.SX.sym(name) for name in ("h", "v", "top"))
    states = [Signal("h", h, value=0.0), Signal("v", v, value=1.0)]
    reached = Switch("reached", h - top, ca.vertcat(h, v))
    numbers = [Signal("top", top, value=1.0)]
    model = Model("thrown", states, ca.vertcat(v, -2), p=numbers, switches=[reached])
    for speed in np.linspace(1, 2, 40 if route == "native" else 3):
        for digits in range(-40, 40, 2 if route == "native" else 8):
            p = {"top": speed**2 / 4 + digits * 2.77e-17}
            motion = simulate(model, 20.0, route=route, x0={"v": speed}, p=p)
            assert len(motion.events) <= 1


@pytest.mark.parametrize("speed", [1e-6, 1e-10, 1e-14])
def test_a_ball_put_on_the_floor_never_falls_through_it(speed: float, route: Route):
    """Pushed below the floor it is lifted onto it, and thrown up with next to nothing."""
    t, h, v = (ca.SX.sym(name) for name in ("t", "h", "v"))
    push, lift = Switch("push", t - 0.5, ca.SX([-1, 0])), Switch("lift", -h, ca.SX([0, speed]))
    states = [Signal("h", h, value=1.0), Signal("v", v, value=0.0)]
    model = Model("pushed", states, ca.vertcat(v, -1), t=t, switches=[push, lift])
    motion, code = attempted(model, 1.0, route=route, tolerance=Tolerance(max_steps=300))
    assert [event.name for event in motion.events[:2]] == ["push", "lift"]
    assert code in ("events_accumulate", "too_many_steps")
    assert motion.end[0] >= -1e-15


@pytest.mark.parametrize("set_down", [False, True])
@given(
    kept=st.floats(0.2, 0.9), size=st.floats(0, 8), share=st.sampled_from([-0.45, -0.2, 0.2, 0.45])
)
@example(kept=0.5, size=19 / 3, share=-0.2)
@settings(
    max_examples=examples(15),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_a_ball_never_falls_through_a_floor_that_it_cannot_hit_exactly(
    set_down: bool, route: Route, kept: float, size: float, share: float
):
    """It lies between two numbers for heights: the guard is never 0."""
    floor = 10.0**size
    last, digit = 1 / (1 - kept), np.spacing(floor)
    motion, code = attempted(
        falling_ball(set_down),
        1.5 * last,
        route=route,
        x0={"h": floor + 4 * digit},
        p={"kept": kept, "floor": floor, "above": share * digit},
        tolerance=Tolerance(max_steps=2000 if route == "native" else 500),
    )
    assert code in ("events_accumulate", "too_many_steps")
    assert motion.end[0] >= floor - 4 * digit
    assert motion.end_time >= last * (1 - 1e-3)


@cache
def swinging_against_a_wall() -> Model:
    """x'' = -x; at `wall` it is stopped, and swings from there to the same height ever after."""
    x, v, wall = (ca.SX.sym(name) for name in ("x", "v", "wall"))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=1.0)]
    hit = Switch("hit", x - wall, ca.vertcat(x, 0))
    return Model("swing", states, ca.vertcat(v, -x), p=[Signal("wall", wall)], switches=[hit])


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_a_guard_that_comes_back_to_0_and_no_higher_may_fire_there_on_either_side(
    unit: float, route: Route
):
    """Whether it fires is a matter of errors, by which it moves no more than by their root."""
    heights = np.random.default_rng(0).uniform(0.1, 0.9, 20 if route == "native" else 6)
    for height in heights:
        motion = simulate(
            swinging_against_a_wall(),
            40.0,
            route=route,
            x0={"v": unit},
            p={"wall": unit * height},
            times=np.linspace(0, 40, 81),
        )
        since = motion.time - np.arcsin(height)
        expected = np.where(since < 0, np.sin(motion.time), height * np.cos(since))
        assert motion["x"][0] / unit == pytest.approx(expected, abs=1e-5)
        assert motion.events[0].time == pytest.approx(np.arcsin(height), rel=1e-10)
        turns = [(event.time - motion.events[0].time) / (2 * np.pi) for event in motion.events]
        assert turns == pytest.approx(np.round(turns), abs=1e-5)
