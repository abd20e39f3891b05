"""What `simulate` refuses and says, and signals by name."""

import casadi as ca
import numpy as np
import pytest
from numpy.typing import ArrayLike
from simulated import crawler, oscillator

from wormopt.control.lambda_tracker import Exponent, lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.errors import ArgumentError, Interrupted, UnknownNameError
from wormopt.model.friction import Coulomb, Stribeck
from wormopt.model.model import Contact, Model, Signal
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"p": {"colour": 1.0}}, "has no parameter or input 'colour'"),
        ({"x0": {"x": [1.0, 2.0, 3.0]}}, "has 2 entries, not 3"),
        ({"x0": np.zeros(2)}, r"write each state by name, \{'x': ...\}, not ndarray"),
        ({"p": [1.0]}, r"write each parameter or input by name, .*, not list"),
        ({"schedules": [1.0]}, r"write each schedule by name, .*, not list"),
        ({"x0": {"x": "far"}}, "state x must be a number or a list of numbers, not 'far'"),
        ({"times": "all"}, "times must be a number or a list of numbers, not 'all'"),
        ({"times": [0.0, 2.0]}, "sample times must ascend within"),
        ({"times": [0.5, 0.2]}, "sample times must ascend within"),
        ({"schedules": {"reference": np.zeros((1, 1))}}, "has no schedule 'reference'"),
    ],
)
def test_what_does_not_fit_the_model_is_said(options: dict, words: str):
    with pytest.raises(ValueError, match=words):
        simulate(oscillator(), 1.0, **options)


def test_time_must_run_forward():
    for span in ((1.0, 1.0), (0.0, 1.0, 2.0), (), (0.0, np.inf), -1.0):
        with pytest.raises(ValueError, match="with start < end"):
            simulate(oscillator(), span)  # type: ignore[arg-type]


def test_names_that_are_not_there_are_told_with_those_that_are():
    motion = simulate(crawler(), 0.1)
    there = "'position', 'velocity', 'length'"
    for ask in (motion.__getitem__, motion.largest, motion.system.model.__getitem__):
        with pytest.raises(UnknownNameError, match=f"no .* 'nonsense'; it has {there}") as caught:
            ask("nonsense")
        assert isinstance(caught.value, KeyError | ValueError)


def test_signals_by_name_are_those_of_the_states_and_of_the_equations():
    motion = simulate(crawler(), 2.0, times=np.linspace(0.0, 2.0, 9), dense=True)
    model = motion.system.model
    assert np.array_equal(motion["position"], motion.states[:3])
    assert motion["length"] == pytest.approx(-np.diff(motion["position"], axis=0), abs=1e-14)
    assert motion["mass"].shape == (3, 9)  # parameters are constant
    assert np.ptp(motion["mass"], axis=1) == pytest.approx(0.0)
    fine = motion.at(np.linspace(0.0, 2.0, 20001))
    assert motion.largest("velocity") == pytest.approx(np.abs(fine["velocity"]).max(), rel=1e-6)
    assert motion.largest(model["length"] - 1) >= np.abs(fine["length"] - 1).max()
    data = motion.to_xarray()
    assert data["position"].dims == ("position_entry", "time")
    assert np.array_equal(data["velocity"].values, motion["velocity"])
    assert set(data.data_vars) == set(motion.names)


def test_stick_intervals_are_those_between_a_stick_and_a_release():
    motion = simulate(crawler(), 6.0)
    intervals = motion.stick_intervals()
    for name, begin, end in intervals:
        own = [e for e in motion.events if e.name == name]
        if begin > 0:
            assert any(e.kind == "stick" and e.time == begin for e in own)
        if end < 6.0:
            assert any(e.kind == "release" and e.time == end for e in own)
        middle = np.array([(begin + end) / 2])
        column = [c.name for c in motion.system.contacts].index(name)
        assert motion.modes_at(middle)[column, 0] == 0
    sticks = sum(e.kind == "stick" for e in motion.events)
    assert len(intervals) >= sticks


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("mass", -1.0, "mass must be positive, not -1"),
        ("mass", [1.0, 0.0, 1.0], "mass must be positive, not 0"),
        ("mass", np.nan, "mass must be positive, not nan"),
        ("stiffness", [1.0, -2.0], "stiffness must be 0 or above, not -2"),
        ("damping", -1.0, "damping must be 0 or above"),
        ("drag", -1.0, "drag must be 0 or above"),
        ("friction_forward", -1.0, "friction_forward must be 0 or above"),
        ("friction_v_stribeck", 0.0, "friction_v_stribeck must be positive"),
        ("tube_radius", 0.0, "tube_radius must be positive"),
        ("gain_exponent", 0.5, "gain_exponent must be at least 1, not 0.5"),
    ],
)
def test_parameters_out_of_their_bounds_are_refused_by_name(
    name: str, value: ArrayLike, words: str
):
    law = Stribeck(1.0, 2.0, stick_forward=1.0, stick_backward=2.0, v_stribeck=0.1)
    worm = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=law)
    reference = gait_reference(fast_gait(1.0), worm.t)
    loop = lambda_tracker(worm, reference, tube_radius=0.2, adaptation=Exponent(2.0))
    with pytest.raises(ArgumentError, match=words):
        simulate(loop, 0.1, p={name: value})
    members = [Scenario(), Scenario(p={name: value})]
    with pytest.raises(ArgumentError, match=words):
        simulate_ensemble(loop, 0.001, members)


def test_stiction_below_sliding_friction_is_refused_also_as_parameters():
    law = Coulomb(1.0, 3.0, stick_forward=2.0)
    worm = chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0, law=law)
    assert simulate(worm, 0.1, p={"friction_forward": 2.0}).end_time == 0.1
    words = r"mass 1 with forward = 5, backward = 3, stick_forward = 2: .* <= stiction force"
    with pytest.raises(ArgumentError, match=words):
        simulate(worm, 0.1, p={"friction_forward": [1.0, 5.0]})


def test_bounds_of_a_model_of_ones_own_hold():
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    share = Signal("share", a, lower=0.0, upper=1.0)
    model = Model("decay", x=[Signal("x", x, value=1.0)], ode=-a * x, p=[share])
    assert simulate(model, 1.0, p={"share": 1.0}).end == pytest.approx([np.exp(-1.0)])
    with pytest.raises(ArgumentError, match="share must be 0 or above and at most 1, not 2"):
        simulate(model, 1.0, p={"share": 2.0})


def test_contacts_that_rest_together_on_one_freedom_stop_it_together():
    """From 1 by 2: at 0.5, after 0.25."""
    x, v, f = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("f", 2)
    contacts = [Contact(f"foot {i}", v, f[i], Coulomb(1.0, 1.0)) for i in range(2)]
    states = [Signal("x", x, value=0.0), Signal("v", v, value=1.0)]
    cart = Model("cart", x=states, ode=ca.vertcat(v, f[0] + f[1]), contacts=contacts)
    motion = simulate(cart, 3.0)
    assert [(e.time, e.kind) for e in motion.events] == 2 * [(pytest.approx(0.5), "stick")]
    assert motion.end == pytest.approx([0.25, 0.0], abs=1e-12)


@pytest.mark.compiled
def test_a_user_who_stops_is_heard():
    def stop(text: str, fraction: float | None = None) -> None:
        raise KeyboardInterrupt

    for route in ("native", "python", "cvodes"):
        with pytest.raises(Interrupted) as caught:
            simulate(oscillator(), 1e6, route=route, report=stop)
        assert isinstance(caught.value, KeyboardInterrupt)
        assert caught.value.partial.end_time == 0.0
