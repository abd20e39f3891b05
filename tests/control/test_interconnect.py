"""Adaptive loops as interconnections of python-control: they move as our own loops do."""

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest

from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.interconnect import controller_of, interconnect
from wormopt.control.lambda_tracker import Decay, Exponent, Quadratic, lambda_tracker
from wormopt.control.loop import FeedForward, gait_reference
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.model.schedule import ParameterPath
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait

EXACT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}


def worm() -> Model:
    return chain(
        2, mass=[1.0, 1.5, 2.0], stiffness=10.0, damping=5.0, rest_length=2.0,
        law=Coulomb(1.0, 10.0), drag=0.1,
    )  # fmt: skip


def loops(plant: Model) -> dict[str, Model]:
    reference = gait_reference(fast_gait(1.0), plant.t, shift=0.3)
    wide = Funnel(2.0, 0.5, 1.0)
    ahead = FeedForward(stiffness=9.0, rest_length=2.0, damping=4.0)
    return {
        "(13)": lambda_tracker(plant, reference, tube_radius=0.05, adaptation=Quadratic(1e3)),
        "(14)": lambda_tracker(plant, reference, tube_radius=0.05, feedback="filter",
                               adaptation=Exponent(2.0, 50.0), feedforward=ahead),
        "funnel": funnel_tracker(plant, reference, funnel=wide, rate_funnel=Funnel(9.0, 3.0, 1.0)),
    }  # fmt: skip


def start(loop: Model) -> np.ndarray:
    return np.concatenate([np.broadcast_to(np.asarray(s.value, float), s.size) for s in loop.x])


@pytest.mark.parametrize("name", ["(13)", "(14)", "funnel"])
def test_the_interconnection_moves_as_the_loop(control: Any, name: str):
    plant = worm()
    loop = loops(plant)[name]
    whole = interconnect(loop, plant, v_reg=0.1)
    times = np.linspace(0, 0.06, 4)
    theirs = control.input_output_response(
        whole, times, np.zeros((0, 4)), start(loop), solve_ivp_kwargs=EXACT
    )
    ours = simulate(loop, 0.06, contact=Smooth(0.1), times=times)
    assert theirs.states == pytest.approx(ours.states, abs=1e-8)
    shown = dict(zip(whole.output_labels, theirs.outputs, strict=True))
    for signal in ("length", "input", "error"):
        found = np.array([shown[f"{signal}[{j}]"] for j in range(2)])
        assert found == pytest.approx(ours[signal], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["(13)", "(14)"])
def test_the_gain_is_learned_alike(control: Any, name: str):
    """One period, with the breaks of the reference stepped to."""
    plant = worm()
    loop = loops(plant)[name]
    whole, x, until = interconnect(loop, plant), start(loop), 1.0
    stops = loop.breaks(until)
    for a, b in pairwise(stops):
        inside = np.array([a, np.nextafter(b, a)])  # at a break the schedule goes on
        x = control.input_output_response(
            whole, inside, np.zeros((0, 2)), x, solve_ivp_kwargs=EXACT
        ).states[:, -1]
    ours = simulate(loop, until, contact=Smooth(1 / 40))
    assert ours["gain"][0, -1] > 2.0
    assert x == pytest.approx(ours.end, abs=1e-7)


def test_a_controller_of_springs_that_vary_in_time_keeps_their_course():
    """Where rest lengths are moved the force is c(t) times the command."""
    course = ParameterPath(np.array([0.0, 0.5, 1.0]), np.array([[[5.0], [6.0]], [[7.0], [4.0]]]))
    plant = chain(2, mass=1.0, stiffness=course, damping=5.0, rest_length=2.0)  # fmt: skip
    reference = gait_reference(fast_gait(1.0), plant.t)
    loop = lambda_tracker(plant, reference, tube_radius=0.05, actuator="rest_length")
    tracker = controller_of(loop, plant)
    assert {s.name for s in tracker.schedules} == {"stiffness", "reference"}
    function = tracker.to_control(output="input", p={"tube_radius": 9.0})
    for t, c in ((0.2, [5.0, 6.0]), (0.7, [7.0, 4.0])):
        e = np.array([0.3, -0.1])
        rate = fast_gait(1.0)(np.array([t - 1e-6, t + 1e-6])) @ [-5e5, 5e5]
        measured = np.append(fast_gait(1.0)(np.array([t]))[:, 0] + e, rate)
        found = function.output(t, np.array([1.0]), measured)
        assert found == pytest.approx(-np.array(c) * e, abs=1e-6)


def test_a_loop_with_delays_has_no_controller_by_itself():
    plant = worm()
    reference = gait_reference(fast_gait(1.0), plant.t)
    loop = lambda_tracker(plant, reference, tube_radius=0.05, feedback="difference")
    with pytest.raises(ArgumentError, match="a controller by itself does not support delays"):
        controller_of(loop, plant)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"measured": 3}, "measured must be a name or a list of names"),
        ({"input": ["input"]}, "input must be of type"),
        ({"p": "mass"}, "write each parameter by name"),
        ({"p": {"size": 1.0}}, "size"),
        ({"v_reg": None}, "v_reg must be finite and above 0"),
        ({"plant": None}, "plant must be of type Model, not None"),
    ],
)
def test_interconnections_of_nothing_are_refused(more: dict[str, Any], message: str):
    plant = worm()
    loop, given = loops(plant)["(13)"], dict[str, Any](plant=plant) | more
    with pytest.raises((ArgumentError, UnknownNameError), match=message):
        interconnect(loop, **given)


def test_a_controller_by_hand():
    """(13): u = -(k e + k' e + k e') of the measured lengths and rates alone."""
    plant = worm()
    loop = loops(plant)["(13)"]
    tracker = controller_of(loop, plant)
    assert [s.name for s in tracker.x] == ["gain"]
    assert [s.name for s in tracker.p] == ["tube_radius", "gain_growth"]
    still = ca.substitute(
        ca.vertcat(tracker.ode, tracker["input"], tracker["error"]), tracker["gain"], ca.SX(3.0)
    )
    reference = gait_reference(fast_gait(1.0), plant.t, shift=0.3)
    assert reference.schedule is not None
    begin, piece = reference.schedule.locate(np.zeros(1))
    schedule = tracker.schedules[0]
    symbols = [tracker.t, schedule.symbol, schedule.begin, *(s.symbol for s in tracker.u),
               *(s.symbol for s in tracker.p)]  # fmt: skip
    length, rate = np.array([2.4, 1.9]), np.array([0.3, -0.2])
    found = ca.Function("f", symbols, [still])(
        0.0, schedule.values[piece[0]], begin, length, rate, 0.05, 1e3
    ).full()[:, 0]
    gait = fast_gait(1.0)
    step = 1e-6
    e = length - gait(np.array([0.3])).ravel()
    slope = (gait(np.array([0.3 + step])) - gait(np.array([0.3 - step]))).ravel() / (2 * step)
    grown = 1e3 * (np.linalg.norm(e) - 0.05) ** 2
    by_hand = np.concatenate([[grown], -(3.0 * e + grown * e + 3.0 * (rate - slope)), e])
    assert found == pytest.approx(by_hand, rel=1e-7, abs=1e-7)


def test_what_does_not_fit_is_refused():
    plant = worm()
    loop = loops(plant)["(13)"]
    with pytest.raises(ValueError, match="not a loop around this"):
        controller_of(loop, worm())
    with pytest.raises(ValueError, match="uses more of"):
        controller_of(loop, plant, measured=["length"])
    with pytest.raises(ValueError, match="not affine"):
        controller_of(loop, plant, measured=["length", "rate", "energy"])
    with pytest.raises(KeyError, match="size"):
        controller_of(loop, plant, measured=["size"])
    reference = gait_reference(fast_gait(1.0), plant.t)
    jumping = lambda_tracker(plant, reference, tube_radius=0.2, adaptation=Decay(0.1, 1.0))
    with pytest.raises(ValueError, match="switches"):
        controller_of(jumping, plant)
    with pytest.raises(ValueError, match="no parameter 'weight'"):
        interconnect(loop, plant, p={"weight": 1.0})
