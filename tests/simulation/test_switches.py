"""Switches on all routes: when guards fire, in which order, and impacts."""

import casadi as ca
import numpy as np
import pytest
from on_routes import event_times, listed

from wormopt.model.friction import Spike
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.schedule import Schedule
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate


def circle(guard: str) -> Model:
    """A point on a circle that counts how often a guard rises through 0."""
    t, y, count = ca.SX.sym("t"), ca.SX.sym("y", 2), ca.SX.sym("count")
    rises = {"sin t": ca.sin(t), "-cos t": -ca.cos(t), "y": y[0]}[guard]
    states = [Signal("y", y, value=(0.0, 1.0)), Signal("count", count, value=0.0)]
    switches = [Switch("counts", rises, ca.vertcat(y, count + 1))]
    return Model("circle", states, ca.vertcat(y[1], -y[0], 0), t=t, switches=switches)


@pytest.mark.parametrize(("guard", "first"), [("sin t", 0.0), ("-cos t", np.pi / 2), ("y", 0.0)])
@pytest.mark.parametrize("relative", [1e-6, 1e-8, 1e-10, 1e-12])
def test_a_guard_that_goes_on_rising_fires_once_a_turn(
    route: Route, guard: str, first: float, relative: float
):
    tolerance = Tolerance(relative, 0.1 * relative)
    motion = simulate(circle(guard), 100.0, contact=Smooth(), tolerance=tolerance, route=route)
    times = first + 2 * np.pi * np.arange(16)
    assert event_times(motion) == pytest.approx(times, abs=1e3 * relative + 1e-12)
    assert motion.end[2] == 16


@pytest.mark.parametrize("period", [0.1 / 7, 0.3, 1 / 3, 0.7])
def test_a_switch_may_fire_where_a_schedule_breaks(route: Route, period: float):
    w, count, c, begin = (ca.SX.sym(name) for name in ("w", "count", "c", "begin"))
    states = [Signal("w", w, value=0.0), Signal("count", count, value=0.0)]
    schedules = [Schedule("c", c, begin, np.array([0.0, period]), np.ones((1, 1)), True)]
    switches = [Switch("tick", w - period, ca.vertcat(0, count + 1))]
    model = Model("clock", states, ca.vertcat(c, 0), schedules=schedules, switches=switches)
    motion = simulate(model, 10.5 * period, route=route)
    assert event_times(motion) == pytest.approx(period * np.arange(1, 11), abs=1e-13)
    assert motion.end == pytest.approx([period / 2, 10.0], abs=1e-13)


@pytest.mark.parametrize("order", [1, -1])
def test_a_jump_of_the_state_fires_other_switches(route: Route, order: int):
    """At x = 1 it jumps to -1; y, which jumps to 3 then, is put back to 0 at once."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    states = [Signal("x", x, value=0.0), Signal("y", y, value=0.0)]
    switches = [Switch("first", x - 1, ca.SX([-1, 3])), Switch("second", y - 2, ca.vertcat(x, 0))]
    model = Model("jumps", states, ca.SX([1, 0]), switches=switches[::order])
    motion = simulate(model, 6.0, route=route)
    assert [event.name for event in motion.events] == ["first", "second"] * 3
    assert event_times(motion) == pytest.approx([1, 1, 3, 3, 5, 5], abs=1e-12)
    assert motion.end == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_guard_that_begins_at_zero_and_falls_does_not_fire(route: Route):
    x = ca.SX.sym("x")
    states, up = [Signal("x", x, value=1.0)], Switch("up", x - 1, x + 5)
    motion = simulate(Model("leaves", states, ca.SX(-1), switches=[up]), 2.0, route=route)
    assert not motion.events
    assert motion.end == pytest.approx([-1.0], abs=1e-12)


@pytest.mark.parametrize("levels", [(1.0, 0.99), (0.99, 1.0), (1.0, 0.4), (0.5, 0.5)])
def test_events_close_to_each_other_keep_their_order(route: Route, levels: tuple[float, float]):
    """They lie within one step, whichever switch is written first."""
    x, a, b, level = ca.SX.sym("x"), ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("level", 2)
    model = Model(
        "clock",
        x=[Signal("x", x, value=0.0), Signal("a", a, value=0.0), Signal("b", b, value=0.0)],
        ode=ca.SX([1, 0, 0]),
        p=[Signal("level", level)],
        switches=[
            Switch("a", x - level[0], ca.vertcat(x, x, b)),
            Switch("b", x - level[1], ca.vertcat(x, a, x)),
        ],
    )
    long = Tolerance(max_step=np.inf)
    motion = simulate(model, 20.0, p={"level": levels}, route=route, tolerance=long)
    assert event_times(motion) == pytest.approx(sorted(levels), abs=1e-12)
    assert motion.end == pytest.approx([20.0, *levels], abs=1e-12)


def test_a_spike_that_is_hit_and_pulled_on_has_its_impact(route: Route):
    """Thrown backward while a force pulls it forward, it stops and slides on at once."""
    x, v, f, t = (ca.SX.sym(name) for name in ("x", "v", "f", "t"))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    ode, contacts = ca.vertcat(v, (0.7 * f + 1) / 3), [Contact("spike", 0.7 * v, f, Spike())]
    switches = [Switch("throw", ca.sin(t), ca.vertcat(x, -0.5 * v))]
    model = Model("pulled", states, ode, t=t, contacts=contacts, switches=switches)
    motion = simulate(model, 14.0, x0={"v": 1.0}, route=route)
    throws = 2 * np.pi * np.arange(3)
    assert listed(motion) == [("throw", "switch", 0), ("spike", "impact", 1)] * 3
    assert event_times(motion) == pytest.approx(np.repeat(throws, 2), abs=1e-11)
    assert motion.end[1] == pytest.approx((14.0 - throws[-1]) / 3, abs=1e-10)


@pytest.mark.parametrize("lift", [None, 0.5])
def test_a_guard_left_above_zero_must_come_back_before_it_fires_again(
    route: Route, lift: float | None
):
    """It is thrown from 0 to 1, falls to 7/8 and rises for ever; or a jump lifts it before."""
    v, w, count, t = (ca.SX.sym(name) for name in ("v", "w", "count", "t"))
    values = {"v": -0.5 if lift is None else -5.0, "w": 1.5 if lift is None else lift, "count": 0.0}
    switches = [Switch("rises", v, ca.vertcat(1, 0, count + 1))]
    if lift:
        switches.insert(0, Switch("lift", t - lift, ca.vertcat(0.3, w, count)))
    states = [Signal(str(s), s, value=values[str(s)]) for s in (v, w, count)]
    model = Model("thrown", states, ca.vertcat(w - 0.5, 1, 0), t=t, switches=switches)
    motion = simulate(model, 10.0, route=route)
    time = lift or np.sqrt(2) - 1
    assert [event.name for event in motion.events] == [switch.name for switch in switches]
    assert event_times(motion) == pytest.approx(time, abs=1e-12)
    assert motion.end[2] == 1
    since = 10 - time
    assert motion.end[0] == pytest.approx(1 - since / 2 + since**2 / 2, abs=1e-9)


def test_what_is_stopped_just_below_its_guard_by_rounding_does_not_fire_it_again(route: Route):
    """x'' = 1 + cos(5 t); with derivatives the place of an event is not shifted to the last bit."""
    x, v, t, level = (ca.SX.sym(name) for name in ("x", "v", "t", "level"))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.2)]
    ode, numbers = ca.vertcat(v, 1 + ca.cos(5 * t)), [Signal("level", level, value=0.0)]
    switches = [Switch("stop", x - level, ca.vertcat(x, 0))]
    model = Model("stopped", states, ode, t=t, p=numbers, switches=switches)
    for place in np.linspace(0.5, 1.1, 13):
        motion = simulate(model, 3.0, p={"level": place}, route=route, sensitivities=["level"])
        (time,) = event_times(motion)
        left = np.array([3 - time, (np.sin(15) - np.sin(5 * time)) / 5])
        assert motion.end[1] == pytest.approx(left.sum(), abs=1e-9)
