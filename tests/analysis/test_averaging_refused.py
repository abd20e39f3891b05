"""What has no average is refused, and the edges of what is allowed."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from averaged_models import COULOMB, EPS, block, differences, rates_of, scheduled, slopes_of, smooth

from wormopt.analysis.average import average
from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Spike
from wormopt.model.model import Contact, Model, Output, Signal, Switch
from wormopt.model.planar_friction import Elliptic
from wormopt.model.schedule import Delay


def switching() -> Model:
    return block(switches=[Switch("flip", ca.SX(-1.0), ca.SX.zeros(1))])


def with_z() -> Model:
    z = ca.SX.sym("z")
    return block(z=[Signal("z", z)], alg=z - 1)


def scheduled_over(T: ca.SX) -> Model:
    """A schedule, and a parameter for the period besides."""
    model = scheduled(False)
    return replace(model, p=[*model.p, Signal("T", T, value=2 * np.pi)])


def of_two_factors() -> Model:
    """The mix of two harmonics is a state."""
    t, f = ca.SX.sym("t"), ca.SX.sym("f")
    v = ca.SX.sym("v", 2)
    speed = v[0] + ca.cos(t) + v[1] * ca.sin(2 * t)
    contacts = [Contact("block", speed, f, COULOMB)]
    return Model("a block", x=[Signal("v", v)], ode=ca.vertcat(f, f), t=t, contacts=contacts)


def of_a_hidden_harmonic() -> Model:
    """A parameter that is 0 now, and a second harmonic if it is not."""
    a = ca.SX.sym("a")
    return block(
        velocity=lambda v, t: v + ca.cos(t) + a * ca.cos(2 * t), p=[Signal("a", a, value=0.0)]
    )


def lagging() -> Model:
    """x' = -x(t - 1)."""
    x, past = ca.SX.sym("x"), ca.SX.sym("past")
    return Model("lagging", [Signal("x", x)], -past, delays=[Delay("past", past, x, 1.0)])


def in_the_plane() -> Model:
    """A block on ground that resists in all directions."""
    t, v, f = ca.SX.sym("t"), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    grounds = [Contact("block", v + ca.cos(t), f, Elliptic(1.0, 1.0, 1.0))]
    return Model("a block", [Signal("v", v)], f, t=t, contacts=grounds)


PERIODIC, NO_PERIOD = "does not repeat after the period", "period must be a positive number"
PUSH = "push does not repeat with the period"


def swinging(velocity: Callable[[Any, Any], Any]) -> Callable[[], Model]:
    return lambda: block(velocity=velocity)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: "block", "must be a Model, not str"),
        (lambda: block(Spike()), "block must slide both ways"),
        (in_the_plane, "block moves in the plane"),
        (lagging, "delay"),
        (switching, "a block has switches"),
        (with_z, "algebraic variables"),
        (lambda: block(ode=lambda v, t, f: f + t), PERIODIC),
        (lambda: block(ode=lambda v, t, f: f + ca.fmax(t - 7.5, 0)), PERIODIC),
        (lambda: scheduled(True), "the velocity of block depends on a schedule"),
        (lambda: scheduled(False, False), "does not repeat"),  # it ends
        (lambda: scheduled(False, True, 5.0), PUSH),
        (of_two_factors, "ratios depend on states"),
        (of_a_hidden_harmonic, "ratios depend on states"),
        (swinging(lambda v, t: v), "block does not swing"),
        (swinging(lambda v, t: ca.SX(0)), "block does not swing"),
        (swinging(lambda v, t: v + ca.fabs(ca.sin(t))), "at most 31"),
        (swinging(lambda v, t: v + ca.cos(32 * t)), "at most 31"),
        # harmonics that pass for lower ones, for a mean, for one there is
        (swinging(lambda v, t: v + ca.cos(33 * t)), "at most 31"),
        (swinging(lambda v, t: v + ca.cos(64 * t)), "at most 31"),
        (swinging(lambda v, t: v + ca.cos(t) + ca.cos(65 * t) / 2), "at most 31"),
    ],
)
def test_what_has_no_average_is_refused(make: Callable[[], Any], message: str):
    with pytest.raises(ArgumentError, match=message):
        average(make(), 2 * np.pi)


SWINGING, SYMBOL = block(), ca.SX.sym("T")


@pytest.mark.parametrize(
    ("model", "period", "message"),
    [
        (SWINGING, 6.0, PERIODIC),
        (SWINGING, np.pi, PERIODIC),
        (scheduled(False), 1e-12, PUSH),
        (scheduled_over(SYMBOL), SYMBOL, PUSH),
        (SWINGING, 2 * np.pi / SWINGING.x[0].symbol, "expression of param"),
        *((SWINGING, no, NO_PERIOD) for no in (0.0, ca.SX.sym("T", 2), "long", -7.0, math.inf)),
    ],
)
def test_what_is_no_period_is_refused(model: Model, period: Any, message: str):
    with pytest.raises(ArgumentError, match=message):
        average(model, period)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"order": 3}, "order must be 1 or 2, not 3"), ({"order": "1"}, "order must be"),
     ({"nodes": 0}, "nodes must be"), ({"nodes": 2.5}, "nodes must be"),
     ({"nodes": True}, "nodes must be")],
)  # fmt: skip
def test_options_that_cannot_be_are_refused(options: Any, message: str):
    with pytest.raises(ArgumentError, match=message):
        average(block(), 2 * np.pi, **options)


def test_thirty_one_harmonics_are_allowed():
    """cos(31 t) > -1/2 for two thirds of the time."""
    model = block(Coulomb(0.0, EPS), velocity=lambda v, t: v + ca.cos(31 * t))
    assert rates_of(average(model, 2 * np.pi))([0.5]) == pytest.approx(EPS / 3, rel=1e-12)


def test_one_node_on_every_eighth_of_the_period_sees_eight_middles():
    """There cos(8 t) is -1, and cos(k t) of another k adds up to 0; by 16 nodes its mean is 0."""
    for k in range(1, 16):
        model = smooth(lambda x, t, m, k=k: [m.cos(k * t)], "x", eps=1.0)
        found = rates_of(average(model, 2 * np.pi, nodes=1))([0.0])
        assert found == pytest.approx(-1.0 if k == 8 else 0.0, abs=1e-14)
        assert rates_of(average(model, 2 * np.pi))([0.0]) == pytest.approx(0.0, abs=1e-14)


def test_sixteen_nodes_are_taken_if_nothing_is_said():
    model = smooth(lambda x, t, m: [1 / (1.01 + m.cos(t))], "x", eps=1.0)
    usual = rates_of(average(model, 2 * np.pi))([0.0])
    fewer, asked, more = (
        rates_of(average(model, 2 * np.pi, nodes=nodes))([0.0]) for nodes in (15, 16, 17)
    )
    assert usual == asked
    assert fewer != asked != more


def test_what_stands_still_has_the_mean_0_and_numbers_may_come_later():
    """x' = 0 y, y' = cos(t) / m - y, where nothing is said of m."""
    t, x, m = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("m")
    rates = ca.vertcat(0, ca.cos(t) / m - x[1])
    model = Model("block", [Signal("x", x)], rates, t=t, p=[Signal("m", m)])
    found = average(model, 2 * np.pi)
    mean = ca.Function("mean", [x, m], [found.ode])([3.0, 5.0], 2.0)
    assert np.array(mean).ravel() == pytest.approx([0.0, -5.0], abs=1e-14)
    still = Model("block", [Signal("x", x)], ca.SX.zeros(2))
    assert average(still, 1.0).ode.is_zero()


def test_only_outputs_without_time_are_kept():
    t, v = ca.SX.sym("t"), ca.SX.sym("v")
    outputs = [Output("slow", 2 * v), Output("fast", v + ca.cos(t))]
    model = Model("block", x=[Signal("v", v)], ode=EPS * ca.cos(t) * v, t=t, outputs=outputs)
    assert [output.name for output in average(model, 2 * np.pi).outputs] == ["slow"]


@pytest.mark.parametrize("shift", [-1e-17, 0.0, 1e-17])
def test_reversals_where_the_period_begins_count_once(shift: float):
    def velocity(v: Any, t: Any) -> Any:
        return v + ca.sin(t + shift)

    model = block(velocity=velocity, ode=lambda v, t, f: f + EPS * ca.cos(t))
    one, two = (average(model, 2 * np.pi, order=order) for order in (1, 2))
    h = 1e-3
    for average_ in (one, two):
        slope = slopes_of(average_)([0.0])
        rates = rates_of(average_)
        assert slope == pytest.approx(differences(rates, np.zeros(1), h), abs=1e-6 * EPS)
    assert rates_of(two)([0.0]) == pytest.approx(rates_of(two)([1e-9]), abs=1e-9 * EPS)
