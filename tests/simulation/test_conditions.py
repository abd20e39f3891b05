"""Conditions in a model's right-hand side, by closed forms: none is stepped over."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.special import erf

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.simulation.conditions import lifted
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.event_free import ending
from wormopt.simulation.gradient import gradient
from wormopt.simulation.held import _Pieces

t, x, v, f = (ca.SX.sym(name) for name in "txvf")


def signals(**values):
    return [wo.Signal(name, ca.SX.sym(name), value=value) for name, value in values.items()]


def scalar(rhs, start=0.0, p=()):
    return wo.Model("scalar", [wo.Signal("x", x, value=start)], ca.SX(rhs), t=t, p=list(p))


def block(push, law=None, p=()):
    """Unit mass at rest, with one contact."""
    states = [wo.Signal("x", x, value=0.0), wo.Signal("v", v, value=0.0)]
    contacts = [wo.Contact("sole", v, f, law or wo.Coulomb(1.0, 1.0))]
    ode = ca.vertcat(v, push + f)
    return wo.Model("block", states, ode, t=t, contacts=contacts, p=list(p))


def pulse_on(rhs):
    """Model with a pulse of a height between two instants, all of them parameters."""
    p = signals(begin=20.0, end=20.1, height=1e4)
    begin, end, height = (s.symbol for s in p)
    return rhs(ca.if_else(ca.logic_and(t > begin, t < end), height, 0), p)


# -- time ------------------------------------------------------------------------------------


def test_a_pulse_between_two_steps_is_seen(route):
    found = wo.simulate(pulse_on(lambda u, p: scalar(u, p=p)), 100.0, route=route)
    assert found.end[0] == pytest.approx(1000.0, rel=1e-11)


@pytest.mark.parametrize("width", [1.0, 0.01, 1e-4, 1e-7])
def test_a_smooth_pulse_between_two_steps_is_seen(width):
    found = wo.simulate(scalar(ca.exp(-(((t - 20) / width) ** 2)) / width), 100.0)
    rounding = 100 * np.spacing(20.0) / width  # of lengths of steps
    assert found.end[0] == pytest.approx(
        np.sqrt(np.pi) * (1 + erf(20 / width)) / 2, rel=1e-9 + rounding
    )


def test_edges_and_resonances_between_steps_are_seen():
    edge = wo.simulate(scalar(ca.tanh((t - 33.3) / 1e-5) + 1), 100.0)
    assert edge.end[0] == pytest.approx(2 * 66.7, rel=1e-10)
    peak = wo.simulate(scalar(1e-3 / (1e-6 + (t - 41.7) ** 2)), 100.0)
    right = np.arctan(58.3e3) + np.arctan(41.7e3)
    assert peak.end[0] == pytest.approx(right, rel=1e-10)
    train = wo.simulate(scalar(ca.exp(-((ca.sin(ca.pi * t) / 0.01) ** 2))), 100.0)
    one = wo.simulate(scalar(ca.exp(-((ca.sin(ca.pi * t) / 0.01) ** 2))), (0.5, 1.5))
    assert train.end[0] == pytest.approx(100 * one.end[0], rel=1e-9)
    assert one.end[0] == pytest.approx(0.01 / np.sqrt(np.pi), rel=1e-3)


def test_a_step_carries_a_resting_block_past_its_limit(route):
    push = ca.if_else(t >= 9.842, 2.22, 0)
    found = wo.simulate(block(push), 60.0, route=route)
    assert found.end[0] == pytest.approx(0.5 * 1.22 * (60 - 9.842) ** 2, rel=1e-12)
    assert [(e.time, e.kind) for e in found.events] == [(9.842, "release")]


def test_a_step_is_seen_by_cvodes():
    push = ca.if_else(t >= 9.842, 2.22, 0)
    found = wo.simulate(block(push), 60.0, contact=wo.Smooth(1e-3), route="cvodes")
    assert found.end[1] == pytest.approx(1.22 * (60 - 9.842), rel=1e-4)


@pytest.mark.parametrize("width", [0.02, 1e-3, 1e-6])
def test_a_pulse_that_is_zero_at_its_ends_is_seen_by_cvodes(width):
    """Implicit formulas see only the ends of steps."""
    push = ca.fmax(1 - ((t - 0.5) / (width / 2)) ** 2, 0) / width
    found = wo.simulate(scalar(push), 1.0, route="cvodes")
    assert found.end[0] == pytest.approx(2 / 3, rel=1e-7)


@pytest.mark.parametrize("count", [30, pytest.param(1000, marks=pytest.mark.slow)])
def test_pulses_at_any_instant_move_a_block_as_far_as_they_should(count):
    model = pulse_on(lambda u, p: block(u, p=p))
    random = np.random.default_rng(1)
    begin, width = random.uniform(0, 50, count), 10 ** random.uniform(-5, 0.5, count)
    height = random.uniform(0.5, 5, count)
    members = [
        Scenario(p={"begin": b, "end": b + w, "height": h})
        for b, w, h in zip(begin, width, height, strict=True)
    ]
    found = simulate_ensemble(model, 100.0, members)
    speed = np.maximum(height - 1, 0) * (begin + width - begin)
    assert found.end[:, 0] == pytest.approx(speed * (width + speed) / 2, rel=1e-8, abs=1e-13)
    assert np.all(found.end[:, 1] == 0)


def test_whole_numbers_remainders_and_sides_of_time_are_breaks():
    def wave(s):
        return ca.floor(3 * s) + ca.fmod(s, 0.7) + ca.sign(ca.sin(s)) + ca.fabs(ca.cos(s))

    found = wo.simulate(scalar(wave(t)), 10.0)
    ends = np.unique([*np.arange(0, 31) / 3, *np.arange(0, 15) * 0.7, *np.arange(0, 7) * np.pi / 2])
    ends = np.append(ends[ends < 10], 10.0)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    at = (ends[:-1] + ends[1:]) / 2 + np.multiply.outer(nodes, np.diff(ends) / 2)
    values = np.array(ca.Function("wave", [t], [wave(t)]).map(at.size)(at.ravel())).reshape(
        at.shape
    )
    assert found.end[0] == pytest.approx(weights @ values @ np.diff(ends) / 2, rel=1e-11)


def test_conditions_that_change_too_often_are_refused():
    with pytest.raises(SolveError, match="change more than 20000 times"):
        wo.simulate(scalar(ca.floor(1e7 * t)), 1.0)


def test_pulses_that_are_too_many_to_be_looked_at_are_told():
    train = scalar(ca.exp(-((ca.sin(ca.pi * t) / 0.01) ** 2)))
    assert wo.simulate(train, 100.0).warnings == ()
    assert any("too many narrow pulses" in text for text in wo.simulate(train, 1e5).warnings)
    # what goes up and down all the time is not narrow
    assert wo.simulate(scalar(ca.sin(ca.pi * t)), 1e5).warnings == ()


def test_derivatives_know_that_an_instant_moves(route):
    p = signals(when=9.842)
    model = block(ca.if_else(t >= p[0].symbol, 2.22, 0), p=p)
    found = wo.simulate(model, 60.0, route=route, sensitivities=["when"])
    right = [-1.22 * (60 - 9.842), -1.22]
    assert found.end_derivative.ravel() == pytest.approx(right, rel=1e-10)
    whole = pulse_on(lambda u, p: scalar(u, p=p))
    slopes = wo.simulate(whole, 100.0, route=route, sensitivities=["begin", "end", "height"])
    assert slopes.end_derivative.ravel() == pytest.approx([-1e4, 1e4, 0.1], rel=1e-9)


def test_the_gradient_refuses_instants_that_move():
    motion = wo.simulate(pulse_on(lambda u, p: scalar(u, p=p)), 100.0, dense=True)
    with pytest.raises(ArgumentError, match="jumps at times that depend on parameters or states"):
        gradient(motion, {"x": [1.0]})


def test_a_narrow_pulse_has_the_gradient_that_it_should():
    height = signals(height=2.0)
    model = scalar(height[0].symbol * ca.exp(-(((t - 20) / 0.01) ** 2)), p=height)
    found = wo.simulate(model, 100.0, sensitivities=["height"])
    assert found.end_derivative.item() == pytest.approx(0.01 * np.sqrt(np.pi), rel=1e-9)


def test_conditions_that_are_met_with_equality_for_a_while():
    """Two functions of time that are one for a while; nothing is decided by rounding."""
    equal = scalar(ca.fmax(t**2, ca.fmod(t, 1.5) ** 2) + (ca.fmod(t, 1.5) < t))
    assert wo.simulate(equal, 3.0).end[0] == pytest.approx(9 + 1.5, rel=1e-12)
    within = scalar((t < ca.if_else(t >= 0.204, 1.0, 0.201)) + ca.fmod(ca.floor(t), 1.5))
    assert wo.simulate(within, 3.0).end[0] == pytest.approx(1 - 0.003 + 1 + 0.5, rel=1e-12)


# -- states ----------------------------------------------------------------------------------


def test_jumps_in_a_state_are_located(route):
    grows = wo.simulate(scalar(ca.if_else(x > 1, x, 2.0)), 2.0, route=route)
    assert grows.end[0] == pytest.approx(np.exp(1.5), rel=1e-13)
    assert grows.events == ()
    stairs = wo.simulate(scalar(ca.floor(x) + 1), 3.0, route=route)
    whole = sum(1 / k for k in range(1, 11))
    assert stairs.end[0] == pytest.approx(10 + 11 * (3 - whole), rel=1e-12)
    falls = wo.simulate(scalar(-ca.ceil(x) - 0.5, start=2.0), 2.0, route=route)
    # 2 to 1 at 2.5, 1 to 0 at 1.5, on at 0.5
    assert falls.end[0] == pytest.approx(-0.5 * (2 - 1 / 2.5 - 1 / 1.5), rel=1e-12)
    turns = wo.simulate(scalar(1 + ca.fmod(x, 2)), 3.0, route=route)
    assert turns.end[0] == pytest.approx(3 + np.exp(3) / 9, rel=1e-11)  # 2 at log 3


def test_a_switched_oscillator_keeps_its_closed_form():
    """A spring of stiffness 4 to one side and 1 to the other, with a kick of damping at 0."""
    ode = ca.vertcat(v, -ca.if_else(x > 0, 4, 1) * (x - 0.5))
    states = [wo.Signal("x", x, value=1.5), wo.Signal("v", v, value=0.0)]
    found = wo.simulate(wo.Model("spring", states, ode), 2.0)
    begin = np.arccos(-0.5) / 2  # x = 0.5 + cos 2 t
    speed, left = -2 * np.sin(2 * begin), 2.0 - begin
    right = 0.5 - 0.5 * np.cos(left) + speed * np.sin(left)
    back = right <= 0  # it has not come back yet
    assert back
    assert found.end[0] == pytest.approx(right, rel=1e-12)


def test_jumps_cost_no_order():
    """Fixed steps of a tenth and a twentieth: the error falls as without a jump."""
    exact, errors = np.exp(1.5), []
    model = scalar(ca.if_else(x > 1, x, 2.0))
    for step in (0.4, 0.2):
        loose = wo.Tolerance(relative=0.9, absolute=1e3, max_step=step)
        errors.append(abs(wo.simulate(model, 2.0, tolerance=loose).end[0] - exact))
    assert np.log2(errors[0] / errors[1]) > 7


def test_sliding_on_a_condition_is_refused_at_once(route):
    with pytest.raises(SolveError, match=r"returns to the condition.*write a Contact") as caught:
        wo.simulate(scalar(ca.if_else(x > 1, -x, 2.0)), 2.0, route=route)
    assert caught.value.code == "slides_on_condition"
    assert caught.value.partial.end_time == pytest.approx(0.5)
    with pytest.raises(SolveError, match="write a Contact"):
        wo.simulate(scalar(0.3 - ca.sign(x), start=1.0), 2.0, route=route)


@pytest.mark.parametrize(
    "back",
    [
        3 * (2 * x >= 0),  # 0 at the same place
        3 * (ca.if_else(x >= 0, 5, 1) > 3),  # jumps there
        2 * (2 * x >= 0) + (3 * x >= 0),
        3 * (ca.if_else(2 * x >= 0, 5, 1) > 3),
        3 * (2 * x >= 0) - 5 * (3 * x >= 0) + 5 * (4 * x >= 0),
    ],
)
def test_conditions_that_change_together_are_no_slide(back, route):
    """One alone turns the motion back, x' = -2; all together let it go on, x' = 1."""
    model = scalar(1 - 3 * (x >= 0) + back, start=-1.0)
    assert wo.simulate(model, 3.0, route=route).end[0] == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize(
    "back", [1.5 * (2 * x >= 0), 1.5 * (ca.if_else(x >= 0, 5, 1) > 3), 3 * (x > 1)]
)
def test_conditions_that_turn_the_motion_back_together_are_a_slide(back, route):
    with pytest.raises(SolveError) as caught:
        wo.simulate(scalar(1 - 3 * (x >= 0) + back, start=-1.0), 3.0, route=route)
    assert caught.value.code == "slides_on_condition"
    assert caught.value.partial.end_time == pytest.approx(1.0, abs=1e-9)


def test_a_remainder_that_is_compared_with_0_where_it_jumps(route):
    """The motion comes to 3 from below, where the remainder is 0 for an instant, and goes on."""
    model = scalar(-0.5 + 1.5 * (ca.fmod(x, 1.5) > 0), start=2.0)
    assert wo.simulate(model, 2.0, route=route).end[0] == pytest.approx(4.0, abs=1e-9)


def test_a_condition_that_changes_only_where_another_one_does(route):
    """A sign whose argument is never 0: x' = 2 up to 0, and then 1."""
    model = scalar(1 + (ca.copysign(2, ca.if_else(x < 0, 1, -1)) > 0), start=-1.0)
    held = lifted(model, True, moving=False)
    assert held is not None
    assert held.held == 3
    assert wo.simulate(model, 2.0, route=route).end[0] == pytest.approx(1.5, abs=1e-12)


def test_derivatives_pass_a_jump_in_a_state(route):
    start = wo.simulate(scalar(ca.if_else(x > 1, x, 2.0)), 2.0, route=route, sensitivities=["x"])
    # the jump is 1/2 earlier for each unit of the start, and the end e^(2 - that)
    assert start.end_derivative.item() == pytest.approx(np.exp(1.5) / 2, rel=1e-11)


def test_what_is_continuous_is_left_as_it_is():
    kink = scalar(ca.if_else(x > 1, x * x, 1))
    assert lifted(kink, True, moving=False) is None
    wraps = scalar(1 - ca.fabs(x - ca.floor(x + 0.5)))
    assert lifted(wraps, True, moving=False) is None
    slope = wo.simulate(kink, 1.5)
    assert slope.end[0] == pytest.approx(2.0, rel=1e-9)


def test_a_start_on_a_condition_goes_either_way():
    up = wo.simulate(scalar(ca.if_else(x > 0, 2.0, 1.0)), 1.0)
    assert up.end[0] == pytest.approx(2.0, rel=1e-12)
    down = wo.simulate(scalar(ca.if_else(x >= 0, -2.0, -1.0)), 1.0)
    assert down.end[0] == pytest.approx(-1.0, rel=1e-12)


def test_a_condition_that_is_0_for_a_while(route):
    """How deep a mass is in the ground is 0 above it: there, no branch may be kept."""
    deep = ca.fmax(0, -x)
    for within in (deep > 0, ca.logic_not(deep <= 0), ca.sign(deep) > 0.5):
        rate = ca.if_else(within, 2.0, 1.0)
        falls = wo.simulate(scalar(-rate, start=1.0), 2.0, route=route)
        assert falls.end[0] == pytest.approx(-2.0, rel=1e-11)
        rises = wo.simulate(scalar(rate, start=-1.0), 2.0, route=route)
        assert rises.end[0] == pytest.approx(1.5, rel=1e-11)
        swings = [wo.Signal("x", x, value=0.0), wo.Signal("y", v, value=1.0)]
        model = wo.Model("swing", swings, ca.vertcat(v, -ca.if_else(within, 4.0, 1.0) * x))
        found = wo.simulate(model, 4 * np.pi, route=route)  # half a period of 2 pi, half of pi, ...
        right = (np.sin(np.pi), np.cos(np.pi))
        assert found.end == pytest.approx([right[0], right[1]], abs=1e-9)


def test_a_condition_that_another_one_carries_past_its_limit(route):
    """Nothing slides where time, or another condition, changes what is compared."""
    rises = scalar(ca.if_else(x < ca.floor(t), 1.0, 0.25))  # 0.25 at 1, 1 at 1.75
    assert wo.simulate(rises, 2.0, route=route).end[0] == pytest.approx(1.0625, rel=1e-12)
    steps = scalar(1 + (ca.floor(x) <= ca.fmod(x, 1.5)))  # 2 but from 1.5 to 2.5, and from 3
    assert wo.simulate(steps, 2.0, route=route).end[0] == pytest.approx(2.75, rel=1e-11)


def test_a_start_where_a_condition_of_time_has_just_begun():
    """At 0 the sign of time is 0, and 1 from then on: what depends on it begins with that."""
    nested = ca.if_else(ca.sign(t) * 0.5 < ca.fmax(0.3, x), 1.0, 2.0)
    assert wo.simulate(scalar(nested), 0.1).end[0] == pytest.approx(0.2, rel=1e-12)


def test_conditions_stay_out_of_what_is_shown():
    motion = wo.simulate(scalar(ca.if_else(x > 1, x, 2.0)), 2.0, times=[0, 1, 2], dense=True)
    assert motion.names == ("x",)
    assert motion.end.shape == (1,)
    assert motion.at(np.array([0.25]))["x"].item() == pytest.approx(0.5)


def test_steps_without_events_know_conditions_too():
    """The independent route: it has no guards of contact, and the same breaks of time."""
    push = ca.if_else(t >= 0.842, 2.22, 0) + ca.if_else(x > 0.1, 0.5, 0)
    motion = wo.simulate(block(push), 2.0)
    found = ending(motion, np.zeros(2), 1e-8)
    assert found.end == pytest.approx(motion.end, rel=1e-7)


# -- what holds without limit ----------------------------------------------------------------


def test_what_holds_the_other_way_does_not_matter(route):
    p = signals(push=0.0, forward=0.0, backward=0.0)
    push, forward, backward = (s.symbol for s in p)
    finite = block(push, wo.Coulomb(forward, backward), p)  # compiled once

    def end(push, forward, backward):
        if max(forward, backward) == np.inf:
            return wo.simulate(block(push, wo.Coulomb(forward, backward)), 2.0, route=route).end
        p = {"push": push, "forward": forward, "backward": backward}
        return wo.simulate(finite, 2.0, p=p, route=route).end

    for held in [*10.0 ** np.arange(0, 31, 6), np.inf]:
        assert end(0.5, 0.25, held) == pytest.approx([0.5, 0.5], rel=1e-13)
        assert end(-0.5, held, 0.25) == pytest.approx([-0.5, -0.5], rel=1e-13)
        assert end(1e-9, 0.0, held) == pytest.approx([2e-9, 2e-9], rel=1e-9)


def test_a_chain_on_ground_that_holds_without_limit_travels():
    ends = []
    for held in (1e9, 1e15, 1e30, np.inf):
        worm = wo.chain(
            1, mass=1.0, stiffness=10.0, damping=0.1, rest_length=1.0, position=[1.5, 0.0],
            law=wo.Coulomb(0.1, held),
        )  # fmt: skip
        ends.append(wo.simulate(worm, 5.0)["position"][:, -1])
    assert ends[0].mean() - 0.75 == pytest.approx(2.79, abs=0.005)
    assert np.ptp(ends, axis=0).max() < 1e-12


def test_smooth_contact_refuses_infinite_friction():
    with pytest.raises(ArgumentError, match="finite friction"):
        wo.simulate(block(0.5, wo.Coulomb(0.25, np.inf)), 2.0, contact=wo.Smooth())


def test_members_with_equal_schedules_share_their_instants():
    """x' = 1 where sin(c t) > 0: to t = 2 pi, for half of the time, whatever c is."""
    t, c = ca.SX.sym("t"), ca.SX.sym("c")
    schedule = wo.Schedule("c", c, ca.SX.sym("begin"), np.array([0.0, 10.0]), np.array([[1.0]]))
    states = [wo.Signal("x", ca.SX.sym("x"), value=0.0)]
    model = wo.Model("gated", states, ca.if_else(ca.sin(c * t) > 0, 1.0, 0.0), t=t,
                     schedules=[schedule])  # fmt: skip
    members = [Scenario(schedules={"c": np.array([[k]])}) for k in (1.0, 2.0, 1.0, 2.0, 1.0)]
    found = simulate_ensemble(model, 2 * np.pi, members)
    assert found.end[:, 0] == pytest.approx(5 * [np.pi], rel=1e-9)
    one, alike, other = (
        _Pieces.of((replace(schedule, values=np.array([[k]])),)) for k in (1, 1, 2)
    )
    assert (one == alike, hash(one) == hash(alike), one == other) == (True, True, False)
