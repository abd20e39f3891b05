"""Where a motion has no derivatives, `simulate(sensitivities=...)` says so."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from derived import block, changes

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.planar_friction import Elliptic
from wormopt.model.schedule import Delay
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory

# -- where there are none --------------------------------------------------------------------


def reasons(motion: Trajectory) -> list[tuple[str, str, str]]:
    return [(d.event.name, d.event.kind, d.reason) for d in motion.nonsmooth_events]


def test_a_force_that_touches_what_holds_is_grazing(route: Any):
    """A load that swings up to friction 1.5 and back; a little more of it, and the block slides."""
    model = block(lambda t, load: load * ca.sin(t), speed=0.0, stiction=1.0)
    options: Mapping[str, Any] = {"sensitivities": ["load"], "route": route}
    touches = simulate(model, 3.0, p={"load": 1.5}, **options)
    assert reasons(touches) == [("block", "release", "grazing")]
    assert touches.nonsmooth_events[0].event.time == pytest.approx(math.pi / 2, abs=1e-4)
    for load in (1.499, 1.501):
        assert simulate(model, 3.0, p={"load": load}, **options).nonsmooth_events == ()


@pytest.mark.parametrize("way", [1, -1])
def test_a_velocity_that_touches_0_is_grazing(way: int, route: Any):
    """v = (t - 1)^2 + depth, or the mirror image, on ground that hardly resists."""
    t, x, v, f = (ca.SX.sym(name) for name in ("t", "x", "v", "f"))
    states = [Signal("position", x, value=0.0), Signal("velocity", v)]
    ground = [Contact("block", v, f, Coulomb(1e-12, 1e-12))]
    model = Model("block", states, ca.vertcat(v, f + 2 * way * (t - 1)), t=t, contacts=ground)
    near = [(1e-10, {"grazing"}), (-1e-10, {"grazing"}), (1e-4, set()), (-1e-4, set())]
    for depth, expected in near:
        start = {"velocity": way * (1.0 + depth)}
        motion = simulate(model, 2.0, x0=start, sensitivities=["velocity"], route=route)
        assert {d.reason for d in motion.nonsmooth_events} == expected, depth
        assert depth < 0 or all(d.event.mode == way for d in motion.nonsmooth_events)


@pytest.mark.parametrize(
    ("depth", "expected"),
    [(1e-7, {"grazing"}), (-8e-8, {"grazing"}), (1e-3, set()), (-1e-6, set())],
)
def test_a_guard_that_touches_0_in_a_long_step_is_grazing(
    route: Any, depth: float, expected: set[str]
):
    """Next to nothing is so against what the guard is elsewhere in the step."""
    x, y, d = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("d")
    switch = [Switch("hits", d - (x - 6.3) ** 2, ca.vertcat(x, y + 1))]
    states, p = [Signal("x", x, value=0.0), Signal("y", y, value=0.0)], [Signal("d", d)]
    motion = simulate(
        Model("clock", states, ca.SX([1, 0]), p=p, switches=switch), 20.0, sensitivities=["x"],
        p={"d": depth}, route=route, tolerance=Tolerance(1e-9, 1e-10, max_step=np.inf),
    )  # fmt: skip
    found = {(d.event.name, d.event.kind, d.event.mode, d.reason) for d in motion.nonsmooth_events}
    assert found == {("hits", "switch", 0, reason) for reason in expected}
    assert len(motion.events) == (depth > 0)


@pytest.mark.parametrize(("cut", "told"), [(5.0, []), (7.0, ["hits"]), (10.0, ["hits"])])
def test_what_a_guard_touches_counts_before_the_event_of_the_step_alone(
    route: Any, cut: float, told: list[str]
):
    """From the event on the guard is out of reach."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    switches = [
        Switch("hits", 1e-9 - (x - 6.3) ** 2 - y, ca.vertcat(x, y)),
        Switch("cuts", x - cut, ca.vertcat(x, 1)),
    ]
    states = [Signal("x", x, value=0.0), Signal("y", y, value=1e-9)]
    motion = simulate(
        Model("clock", states, ca.SX([1, 0]), switches=switches), 20.0, sensitivities=["x"],
        route=route, tolerance=Tolerance(1e-9, 1e-10, max_step=np.inf),
    )  # fmt: skip
    assert [event.name for event in motion.events] == ["cuts"]
    assert [d.event.name for d in motion.nonsmooth_events] == told


@pytest.mark.parametrize("step", [3e-4, 7e-4])
def test_a_velocity_that_goes_on_falling_is_not_grazing_be_the_step_ever_so_short(
    route: Any, step: float
):
    """It falls below 0 by less than counts, as the step ends; friction of 1 stops it."""
    v, f = ca.SX.sym("v"), ca.SX.sym("f")
    ground = [Contact("block", v, f, Coulomb(1.0, 1.0), nominal_speed=1e4)]
    model = Model("block", [Signal("v", v, value=0.1)], f, contacts=ground)
    tolerance = Tolerance(1e-9, 1e-10, max_step=step)
    motion = simulate(model, 0.5, sensitivities=["v"], route=route, tolerance=tolerance)
    assert [event.time for event in motion.events] == pytest.approx([0.1], rel=1e-12)
    assert motion.nonsmooth_events == ()


def test_what_rests_at_the_edge_of_what_holds_is_told(route: Any):
    pulled = block(lambda t, load: load + 0 * t, speed=0.0, stiction=1.0)
    for load, expected in ((1.5, [("block", "stick", "edge")]), (1.4, []), (1.6, [])):
        motion = simulate(pulled, 2.0, p={"load": load}, sensitivities=["load"], route=route)
        assert reasons(motion) == expected
    thrown = block(lambda t, load: -load + 0 * t, stiction=1.0)
    at_stop = simulate(thrown, 6.0, p={"load": 1.5}, sensitivities=["load"], route=route)
    assert at_stop.nonsmooth_events[0].event in at_stop.events
    assert [d.reason for d in at_stop.nonsmooth_events] == ["edge"]


def test_a_start_at_rest_that_slides_at_once_is_one_sided(route: Any):
    model = block(lambda t, load: load + 0 * t, speed=0.0, stiction=1.0)
    options: Mapping[str, Any] = {"p": {"load": 2.0}, "route": route}
    moved = simulate(model, 1.0, sensitivities=["velocity"], **options)
    assert [d.reason for d in moved.nonsmooth_events] == ["edge"]
    assert moved.end_derivative[:, 0] == pytest.approx([1.0, 1.0])
    assert simulate(model, 1.0, sensitivities=["load"], **options).nonsmooth_events == ()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_two_events_at_once_are_told_where_their_order_counts(way: float, route: Any):
    """Two masses on a stiff joint stop together; moved alike they go on doing so."""
    t, x, v, f = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    inertia = ca.DM([[2.0, 0.5], [0.5, 2.0]])
    states = [Signal("position", x, value=0.0), Signal("velocity", v, value=way)]
    ode = ca.vertcat(v, ca.solve(ca.SX(inertia), f))
    contacts = [Contact(f"twin {i}", v[i], f[i], Coulomb(1.0, 1.0)) for i in (0, 1)]
    model = Model("twins", states, ode, t=t, contacts=contacts)
    one = simulate(model, 4.0, sensitivities=["velocity[0]"], route=route)
    assert {d.reason for d in one.nonsmooth_events} == {"simultaneous"}
    assert one.nonsmooth_events[0].event in one.events
    alike = simulate(model, 4.0, sensitivities={"both": {"velocity": 1.0}}, route=route)
    assert alike.nonsmooth_events == ()
    np.testing.assert_allclose(changes(alike.events[0]), 2.5 * way, rtol=1e-12)
    # alone on the ground either may stop first
    apart = replace(model, ode=ca.vertcat(v, f / 2))
    free = simulate(apart, 4.0, sensitivities=["velocity[0]"], route=route)
    assert free.nonsmooth_events == ()
    np.testing.assert_allclose(free.end_derivative[:, 0], [2.0, 0.0, 0.0, 0.0], atol=1e-12)


# -- refusals --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "error", "told"),
    [
        (["weight"], UnknownNameError, "weight"),
        (["mass[1]"], ArgumentError, "mass has 1 entries"),
        ([3], ArgumentError, "must be names, not 3"),
        (["mass", "mass"], ArgumentError, "twice"),
        ({"a": {"mass": [1, 2]}}, ArgumentError, "shape"),
        ({"a": {"mass": math.nan}}, ArgumentError, "finite"),
        ({"a": ["mass"]}, ArgumentError, "write direction a"),
        ({3: {"mass": 1}}, ArgumentError, "labels"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(asked: Any, error: type[Exception], told: str):
    with pytest.raises(error, match=told):
        simulate(block(), 1.0, sensitivities=asked)


def test_derivatives_that_were_not_asked_for_are_refused():
    motion = simulate(block(), 1.0)
    with pytest.raises(ArgumentError, match="sensitivities="):
        motion.derivative("position")
    motion = simulate(block(), 1.0, sensitivities="mass")
    with pytest.raises(UnknownNameError):
        motion.derivative("weight")


def test_motions_without_exact_derivatives_are_refused():
    x, past = ca.SX.sym("x"), ca.SX.sym("past")
    delay = Delay("past", past, x, lag=1.0)
    lagging = Model("lagging", [Signal("x", x, value=1.0)], -past, delays=[delay])
    with pytest.raises(ArgumentError, match="has delays"):
        simulate(lagging, 2.0, sensitivities=["x"])
    v, f = ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    plane = Contact("foot", v, f, Elliptic(1.0, 1.0, 1.0))
    puck = Model("puck", [Signal("velocity", v, value=1.0)], f, contacts=[plane])
    with pytest.raises(ArgumentError, match=r"write contact=Smooth\(v_reg\)"):
        simulate(puck, 2.0, sensitivities=["velocity"])
    smooth = simulate(puck, 0.5, contact=Smooth(1e-2), sensitivities=["velocity"])
    assert np.isfinite(smooth.end_derivative).all()
