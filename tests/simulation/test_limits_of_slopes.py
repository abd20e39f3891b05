"""Derivatives where a slope of the model is 0/0 and the motion is smooth: drag v |v| at rest.

References: v' = k (a e - v |v|) from rest has v = sqrt(a) tanh(k sqrt(a) t) e.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.errors import SolveError
from wormopt.model.model import Model, Signal, Switch
from wormopt.simulation.options import Route, Tolerance
from wormopt.simulation.simulate import simulate

SIZE = 3
v, k, push = ca.SX.sym("v", SIZE), ca.SX.sym("k"), ca.SX.sym("push", SIZE)
FALL = Model(
    "fall",
    x=[Signal("v", v, value=0.0)],
    ode=k * (push - v * ca.norm_2(v)),
    p=[Signal("k", k, value=1.0), Signal("push", push, value=(1.0, 0.0, 0.0))],
)


@pytest.mark.parametrize("route", ["native", "python", "radau"])
def test_a_fall_from_rest_has_the_derivative_of_its_hyperbolic_tangent(route: Route):
    asked = Tolerance(1e-9, 1e-10) if route == "radau" else Tolerance()
    motion = simulate(FALL, 1.0, sensitivities=["k"], route=route, tolerance=asked)
    near = 1e-6 if route == "radau" else 1e-9
    assert motion.end == pytest.approx([np.tanh(1.0), 0, 0], abs=near)
    assert motion.end_derivative[:, 0] == pytest.approx([1 / np.cosh(1.0) ** 2, 0, 0], abs=near)


@settings(max_examples=examples(10))
@given(seed=st.integers(0, 10**6), unit=st.sampled_from([1e-6, 1.0, 1e6]))
def test_so_it_has_in_any_direction_and_unit(route: Route, seed: int, unit: float):
    random = np.random.default_rng(seed)
    way, rate, end = random.normal(size=SIZE), random.uniform(0.3, 3), random.uniform(0.2, 2)
    way *= unit**2 / np.linalg.norm(way)  # so that the last speed is the unit
    p = {"k": rate / unit, "push": way}
    sizes = Tolerance(absolute=1e-12 * unit)
    sensitivities = {"k": {"k": [p["k"]]}}
    motion = simulate(FALL, end, p=p, sensitivities=sensitivities, route=route, tolerance=sizes)
    expected = way / unit * rate * end / np.cosh(rate * end) ** 2
    assert motion.end_derivative[:, 0] == pytest.approx(expected, rel=1e-7, abs=1e-8 * unit)


def test_what_is_set_to_rest_on_its_way_goes_on_with_its_derivative(route: Route):
    x, t, rate = ca.SX.sym("x", 2), ca.SX.sym("t"), ca.SX.sym("rate")
    ode, numbers = rate * (ca.vertcat(1, 0) - x * ca.norm_2(x)), [Signal("rate", rate, value=1.0)]
    switches = [Switch("caught", t - 1, 0 * x)]
    model = Model("fall", [Signal("v", x, value=0.0)], ode, t=t, p=numbers, switches=switches)
    motion = simulate(model, 2.0, sensitivities=["rate"], route=route)
    assert motion.end_derivative[:, 0] == pytest.approx([1 / np.cosh(1.0) ** 2, 0], abs=1e-9)


def test_what_stays_at_rest_has_the_limit_from_all_sides(route: Route):
    """Of v' = -k v |v| from v0 the derivative by v0 is 1 / (1 + |v0| k t)^2: 1 at 0."""
    still: Any = {"p": {"push": np.zeros(SIZE)}, "route": route}
    motion = simulate(FALL, 3.0, sensitivities={"v0": {"v": [1, 2, 3]}}, **still)
    assert motion.end.tolist() == [0, 0, 0]
    assert motion.end_derivative[:, 0] == pytest.approx([1, 2, 3], rel=1e-9)


w = ca.SX.sym("w", 2)


@pytest.mark.parametrize(
    "ode",
    [ca.vertcat(ca.norm_2(w), 0), ca.vertcat(1 - ca.sqrt(ca.sqrt(ca.sumsqr(w))), 0)],
    ids=["no limit", "infinite"],
)
def test_slopes_without_a_limit_are_refused_as_such_and_the_motion_is_there(
    ode: ca.SX, route: Route
):
    model = Model("corner", x=[Signal("w", w, value=0.0)], ode=ode)
    coarse = Tolerance(1e-7, 1e-8)
    assert np.isfinite(simulate(model, 0.1, route=route, tolerance=coarse).end).all()
    with pytest.raises(SolveError, match="the motion has no derivatives") as caught:
        simulate(model, 0.1, sensitivities=["w"], route=route, tolerance=coarse)
    assert caught.value.code == "steep_derivatives"


def test_implicit_integrators_that_need_the_limit_say_that_derivatives_fail():
    with pytest.raises(SolveError, match="the motion has no derivatives") as caught:
        simulate(FALL, 1.0, sensitivities=["k"], route="cvodes")
    assert caught.value.code == "steep_derivatives"


@pytest.mark.parametrize("route", ["native", "python", "radau", "cvodes"])
def test_the_motion_itself_needs_no_slope(route: Route):
    motion = simulate(FALL, 1.0, route=route, tolerance=Tolerance(1e-8, 1e-9))
    assert motion.end == pytest.approx([np.tanh(1.0), 0, 0], abs=1e-6)
