"""Forces that accelerations do not determine: shared by redundant contacts, or on a driven belt."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from simulated import refused

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Spike
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.planar_friction import Elliptic
from wormopt.simulation.event_free import ending
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate

x, v, t, w = (ca.SX.sym(name) for name in "xvtw")


# -- redundant contacts on lines -----------------------------------------------------------------

_COUNT = 3
_ratio, _law = ca.SX.sym("ratio", _COUNT), ca.SX.sym("law", 2 * _COUNT)
_force, _ramp = ca.SX.sym("force", _COUNT), ca.SX.sym("ramp")
CART = Model(
    "cart",
    x=[Signal("x", x, value=0.0), Signal("v", v, value=0.0)],
    ode=ca.vertcat(v, ca.dot(_ratio, _force) + _ramp * t),
    t=t,
    p=[Signal("ratio", _ratio), Signal("law", _law), Signal("ramp", _ramp)],
    contacts=[
        Contact(f"wheel {i}", _ratio[i] * v, _force[i], Coulomb(_law[2 * i], _law[2 * i + 1]))
        for i in range(_COUNT)
    ],
)
"""Wheels of one cart on the ground, geared by ratios of either sign."""


def test_redundant_contacts_rest_until_the_sum_of_their_holding_forces(route: Route):
    f, g = ca.SX.sym("f"), ca.SX.sym("g")
    feet = [Contact("left", v, f, Coulomb(1, 1)), Contact("right", v, g, Coulomb(2, 2))]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    motion = simulate(
        Model("sled", states, ca.vertcat(v, f + g + t), t=t, contacts=feet), 4.0, route=route
    )
    assert [e.kind for e in motion.events] == ["release", "release"]
    assert [e.time for e in motion.events] == pytest.approx([3.0, 3.0], abs=1e-9)
    assert motion.end == pytest.approx([1 / 6, 0.5], abs=1e-9)


@st.composite
def carts(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Ratios, forces forward and backward, ramp of the push, speed backward at the start."""
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    ratio = random.uniform(0.2, 2, _COUNT) * random.choice([-1, 1], _COUNT)
    law = random.uniform(0.1, 3, (_COUNT, 2))
    return ratio, law, float(random.uniform(0.5, 2)), float(random.uniform(0, 2))


@settings(max_examples=examples(5))
@given(drawn=carts())
def test_geared_wheels_stop_rest_and_go_as_one_contact_with_the_sum_of_their_forces(drawn):
    """Sliding backward, v' = back + ramp t; at rest until the push is `ahead`; then their gap."""
    ratio, law, ramp, speed = drawn
    ways = np.where(ratio > 0, law.T, law.T[::-1])
    ahead, back = (np.abs(ratio) * ways).sum(axis=1)
    stop = (-back + np.sqrt(back**2 + 2 * ramp * speed)) / ramp
    at_stop = -speed * stop + back * stop**2 / 2 + ramp * stop**3 / 6
    go = max(stop, ahead / ramp)
    left, after = ramp * go - ahead, 1.5
    end = [at_stop + left * after**2 / 2 + ramp * after**3 / 6, left * after + ramp * after**2 / 2]
    p = {"ratio": ratio, "law": law.ravel(), "ramp": ramp}
    motion = simulate(CART, go + after, p=p, x0={"v": -speed}, route="python")
    assert motion.end == pytest.approx(end, abs=1e-9)
    times = sorted({e.time for e in motion.events})
    assert times == pytest.approx([stop, go] if stop < go else [stop], abs=1e-9)


def test_a_bar_on_three_feet_holds_what_any_split_can_hold(route: Route):
    """Pushed at its middle foot by 2 t, two at the ends of 1 each and 0.5 between hold 2.5."""
    f = ca.SX.sym("f", 3)
    arms = ca.DM([-1.0, 0.0, 1.0])
    bar = Model(
        "bar",
        x=[Signal("x", x, value=0.0), Signal("v", v, value=0.0), Signal("turn", w, value=0.0)],
        ode=ca.vertcat(v, ca.sum1(f) + 2 * t, 3 * ca.dot(arms, f)),
        t=t,
        contacts=[
            Contact(f"foot {i}", v + arms[i] * w, f[i], Coulomb(limit, limit))
            for i, limit in enumerate((1.0, 0.5, 1.0))
        ],
    )
    motion = simulate(bar, 2.0, route=route)
    assert motion.events[0].time == pytest.approx(1.25, abs=1e-9)
    assert motion.end == pytest.approx([2 * 0.75**3 / 6, 0.75**2, 0.0], abs=1e-9)


def test_contacts_of_one_freedom_whose_velocities_differ_share_nothing():
    """Masses that swing about their centre never rest at once."""
    f = ca.SX.sym("f", 2)
    apart = [
        Contact(f"mass {i}", v + sign * ca.cos(t), f[i], Coulomb(1, 2))
        for i, sign in enumerate((1, -1))
    ]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    model = Model("swing", states, ca.vertcat(v, ca.sum1(f) / 2), t=t, contacts=apart)
    assert not simulate(model, 1.0).system.shares


def plate(speeds: list[ca.SX], laws: list[Coulomb]) -> Model:
    """A plate of mass 1 that rests on the ground and on belts of these speeds."""
    f = ca.SX.sym("f", len(speeds))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    on = [Contact(f"{i}", v - s, f[i], laws[i]) for i, s in enumerate(speeds)]
    return Model("plate", states, ca.vertcat(v, ca.sum1(f)), t=t, contacts=on)


@pytest.mark.parametrize("grounds", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("speed", "way"),
    [
        (ca.sin(t), 2.0),
        pytest.param(1 - ca.cos(t), 4 - np.sin(4), marks=pytest.mark.slow),
        (t - t**2, 8 - 64 / 3),
    ],
)
def test_a_plate_on_ground_and_belt_goes_with_what_holds_it_better(
    speed: ca.SX, way: float, grounds: int, route: Route
):
    """All contacts are without velocity at the start, and when the belt turns."""
    ground, span = [Coulomb(0.4, 0.6)] * grounds, np.pi if way == 2 else 4.0
    speeds = [*[ca.SX(0)] * grounds, speed]
    held = simulate(plate(speeds, [*ground, Coulomb(0.3, 0.3)]), span, route=route)
    assert held.end == pytest.approx([0.0, 0.0], abs=1e-9)
    taken = simulate(plate(speeds, [*ground, Coulomb(9.0, 9.0)]), span, route=route)
    assert taken.end[0] == pytest.approx(way, abs=1e-8)


def test_a_plate_on_three_belts_goes_with_the_middle_one(route: Route):
    """Strong friction of the same size on all: their median."""
    speeds = [ca.sin(t + turn * ca.pi / 3) for turn in (0, 2, 4)]
    motion = simulate(plate(speeds, [Coulomb(90.0, 90.0)] * 3), 7.0, route=route)
    middle = np.median([np.sin(7.0 + turn * np.pi / 3) for turn in (0, 2, 4)])
    assert motion.end[1] == pytest.approx(middle, abs=1e-9)
    met = np.unique(np.round([e.time for e in motion.events], 7))
    assert met == pytest.approx(np.pi / 6 * np.arange(1, 14, 2), abs=1e-6)


# -- velocities that no contact force changes ----------------------------------------------------


def belt(speed: ca.SX, law: Coulomb | Spike, states: tuple = ()) -> Model:
    """A belt that moves as given, and how much it takes up: w' = -f speed."""
    f = ca.SX.sym("f")
    own = [Signal("taken", w, value=0.0), *(signal for signal, _ in states)]
    ode = ca.vertcat(-f * speed, *(rate for _, rate in states))
    return Model("belt", own, ode, t=t, contacts=[Contact("belt", speed, f, law)])


@pytest.mark.parametrize("route", ["native", "python", "radau"])
@pytest.mark.parametrize("lag", [0.0, 0.5 * np.pi, 1.0])
def test_a_driven_belt_takes_up_friction_times_its_way(lag: float, route: Route):
    """In a period it goes ahead by 2 and back by 2, wherever it starts: at its turn, say."""
    asked = Tolerance(1e-8, 1e-9) if route == "radau" else Tolerance()
    motion = simulate(belt(ca.cos(t - lag), Coulomb(1, 2)), 2 * np.pi, route=route, tolerance=asked)
    assert motion.end == pytest.approx([6.0], abs=1e-6 if route == "radau" else 1e-10)
    assert {e.kind for e in motion.events} == {"reversal"}


@settings(max_examples=examples(8))
@given(st.integers(0, 10**6))
def test_belts_of_any_course_take_up_what_their_turns_say(seed: int):
    """Speed of two waves: its way between turns, found on a fine grid, times the friction."""
    random = np.random.default_rng(seed)
    a, b, phase = random.uniform(0.3, 1.0, 3)
    speed = a * ca.cos(t) + b * ca.cos(3 * t + phase)
    law = random.uniform(0.2, 3, 2)
    motion = simulate(belt(speed, Coulomb(*law.tolist())), 5.0, route="python")

    def way(s: np.ndarray) -> np.ndarray:
        return a * np.sin(s) + b / 3 * np.sin(3 * s + phase)

    def rate(s: np.ndarray) -> np.ndarray:
        return a * np.cos(s) + b * np.cos(3 * s + phase)

    grid = np.linspace(0, 5, 20001)
    signs = np.flatnonzero(rate(grid[1:]) * rate(grid[:-1]) < 0)
    turns = [0.0, *(brentq(rate, grid[k], grid[k + 1], xtol=1e-15) for k in signs), 5.0]
    gone = np.diff(way(np.array(turns)))
    taken = law[0] * gone[gone > 0].sum() - law[1] * gone[gone < 0].sum()
    assert motion.end == pytest.approx([taken], rel=1e-9)


def test_the_velocity_of_a_belt_may_be_a_state_and_its_friction_push_something_else(route: Route):
    """A belt that swings as sin t, its friction on a block in oil; beside one in contact itself."""
    y, z, f, g = (ca.SX.sym(name) for name in "yzfg")
    model = Model(
        "belt and block",
        x=[
            Signal("belt", y, value=0.0),
            Signal("rate", z, value=1.0),
            Signal("x", x, value=0.0),
            Signal("v", v, value=0.0),
        ],
        ode=ca.vertcat(z, -y, v, g - f),
        contacts=[Contact("belt", y, f, Coulomb(2, 2)), Contact("block", v, g, Coulomb(0.5, 0.5))],
    )
    motion = simulate(model, 2 * np.pi, route=route)
    assert not motion.system.shares
    # pushed by 2 - 0.5 for pi; then slowed by 2.5 until it stops at 1.6 pi, then back
    back = np.pi - 1.5 * np.pi / 2.5
    end = 1.5 * np.pi**2 / 2 + (1.5 * np.pi) ** 2 / 5 - 1.5 * back**2 / 2
    assert motion.end[2:] == pytest.approx([end, -1.5 * back], abs=1e-9)


def test_what_a_belt_takes_up_has_derivatives(route: Route):
    f, ahead, back = ca.SX.sym("f"), ca.SX.sym("ahead"), ca.SX.sym("back")
    swing = ca.SX.sym("swing")
    speed = ca.cos(t) + swing
    model = Model(
        "belt",
        [Signal("taken", w, value=0.0)],
        -f * speed,
        t=t,
        p=[
            Signal("ahead", ahead, value=1.0),
            Signal("back", back, value=2.0),
            Signal("swing", swing, value=0.0),
        ],
        contacts=[Contact("belt", speed, f, Coulomb(ahead, back))],
    )
    motion = simulate(model, 2 * np.pi, sensitivities=["ahead", "back", "swing"], route=route)
    # by `swing`: of ahead for half a period and against it for the other
    assert motion.end_derivative[0] == pytest.approx([2, 2, np.pi - 2 * np.pi], abs=1e-8)
    assert motion.events[0].derivative == pytest.approx([0, 0, 1], abs=1e-9)
    assert not motion.nonsmooth_events


@pytest.mark.parametrize(
    "speed", [ca.fmax(0, ca.sin(t)), ca.if_else(t < 1, 1 - t, 0), 0 * t], ids=["half", "stops", "0"]
)
def test_a_belt_at_rest_is_refused_as_its_force_is_open(speed: ca.SX, route: Route):
    error = refused(belt(speed, Coulomb(1, 2)), 5.0, route)
    assert error.code == "open_force"
    assert "no contact force acts on its velocity" in str(error)


def test_a_belt_that_touches_rest_goes_on(route: Route):
    """Its speed (t - 1)^2 has no sign to change."""
    motion = simulate(belt((t - 1) ** 2, Coulomb(1, 2)), 3.0, route=route)
    assert motion.end == pytest.approx([3.0], abs=1e-8)


def test_a_belt_driven_back_over_spikes_is_refused(route: Route):
    assert refused(belt(ca.cos(t), Spike()), 2.0, route).code == "no_contact_mode"


def test_belts_and_rails_in_the_plane_take_up_friction(route: Route):
    """A belt that never rests, of speed (4, 3), and a runner on a rail, from 1 by 0.5."""
    f = ca.SX.sym("f", 2)
    law = Elliptic(0.5, 0.5, 0.5)
    plane = [Contact("belt", ca.vertcat(4, 3) * (1 + t), f, law)]
    model = Model("belt", [Signal("taken", w, value=0.0)], -f[0] - 2 * f[1], t=t, contacts=plane)
    assert simulate(model, 1.0, route=route).end == pytest.approx([0.5 * (0.8 + 1.2)], abs=1e-10)
    rail = [Contact("rail", ca.vertcat(v, 0), f, law)]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=1.0)]
    motion = simulate(Model("rail", states, ca.vertcat(v, f[0]), contacts=rail), 3.0, route=route)
    assert motion.end == pytest.approx([1.0, 0.0], abs=1e-9)


class Bolt:
    """A law that holds and never lets go."""

    directions = ()
    stick_interval = (-1.0, 1.0)

    def slip_force(self, v: ca.SX, direction: int) -> ca.SX:
        return 0 * v

    def smooth(self, v: ca.SX, v_reg: float) -> ca.SX:
        return -v / v_reg


def test_what_cannot_slide_is_no_belt():
    model = belt(ca.cos(t), Bolt())  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="no contact force acts on the velocity of belt"):
        simulate(model, 1.0)
    assert np.isfinite(simulate(model, 1.0, contact=Smooth(0.1)).end).all()


def test_steps_without_events_refuse_driven_belts():
    motion = simulate(belt(ca.cos(t), Coulomb(1, 2)), 1.0)
    with pytest.raises(ArgumentError, match="driven"):
        ending(motion, np.zeros(1), 1e-6)


# -- velocities that no contact force changes in some places --------------------------------------


def _legs(angles: tuple[float, ...]) -> Model:
    """Feet on a wheel of unit radius and inertia, each moving along the ground by its cosine."""
    f, (pull, ahead, back) = ca.SX.sym("f", len(angles)), map(ca.SX.sym, ("pull", "ahead", "back"))
    arms = [ca.cos(x + angle) for angle in angles]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    ode = ca.vertcat(v, ca.dot(ca.vertcat(*arms), f) + pull)
    law = Coulomb(ahead, back)  # parameters: the model is compiled once
    contacts = [Contact(f"foot {i}", a * v, f[i], law) for i, a in enumerate(arms)]
    p = [Signal("pull", pull, value=0.0), Signal("ahead", ahead), Signal("back", back)]
    return Model("legs", states, ode, p=p, contacts=contacts)


@pytest.mark.parametrize("angles", [(0.0,), (0.0, 1.0)])
def test_a_foot_is_not_stopped_where_its_arm_is_upright(angles: tuple[float, ...], route: Route):
    """What friction takes is mu times the way of each foot, whatever its speed."""
    random = np.random.default_rng(1)
    for start, energy, mu in random.uniform((-1, 2, 0.1), (1, 3, 0.5), (4, 3)):
        x0, p = {"x": start, "v": np.sqrt(2 * energy)}, {"ahead": mu, "back": mu}
        motion = simulate(_legs(angles), 2.0, x0=x0, p=p, route=route)
        end, speed = motion.end
        assert end > 2.0  # beyond pi/2 and what remains of it
        grid = np.linspace(start, end, 20_001)
        way = sum(np.trapezoid(np.abs(np.cos(grid + angle)), grid) for angle in angles)
        assert speed**2 / 2 == pytest.approx(energy - mu * way, abs=1e-6)
        assert {event.kind for event in motion.events} == {"reversal"}


def test_a_motion_may_start_with_an_arm_that_is_upright(route: Route):
    start, p = {"x": np.pi / 2, "v": 1.0}, {"ahead": 0.2, "back": 0.2}
    end, speed = simulate(_legs((0.0,)), 1.0, x0=start, p=p, route=route).end
    assert speed**2 / 2 == pytest.approx(0.5 - 0.2 * (1 - np.sin(end)), abs=1e-9)


def test_derivatives_pass_an_upright_arm():
    model, x0, law = _legs((0.0,)), {"x": 1.2, "v": 1.0}, {"ahead": 0.5, "back": 0.3}
    motion = simulate(model, 0.8, x0=x0, p={"pull": 0.1} | law, sensitivities=["pull"])
    ends = [simulate(model, 0.8, x0=x0, p={"pull": 0.1 + h} | law).end for h in (1e-4, -1e-4)]
    assert motion.end_derivative[:, 0] == pytest.approx((ends[0] - ends[1]) / 2e-4, abs=1e-6)


def test_steps_without_events_pass_an_upright_arm():
    p = {"ahead": 0.5, "back": 0.3}
    motion = simulate(_legs((0.0, 1.0)), 1.0, x0={"x": 0.5, "v": 2.0}, p=p)
    assert ending(motion, np.array([0.5, 2.0]), 1e-6).end == pytest.approx(motion.end, abs=1e-5)
