"""Periodic motions: against theory of linear systems, and by exact contact."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from wormopt.errors import ArgumentError, SolveError, UnknownNameError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.simulation.options import Tolerance
from wormopt.simulation.periodic import periodic_orbit
from wormopt.simulation.simulate import simulate


def linear(n: int) -> Model:
    """x' = A x + b cos(w t), its numbers parameters: one compilation for all of them."""
    x, t, A, b, w = (
        ca.SX.sym(name, m) for name, m in zip("xtAbw", (n, 1, n * n, n, 1), strict=True)
    )
    numbers = [
        Signal("matrix", A, value=(0.0,) * n**2),
        Signal("push", b, value=(1.0,) * n),
        Signal("frequency", w, value=1.0),
    ]
    ode = ca.reshape(A, n, n).T @ x + b * ca.cos(w * t)
    return Model("linear", x=[Signal("state", x, value=(0.0,) * n)], ode=ode, t=t, p=numbers)


THREE = linear(3)


@given(
    entries=st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9),
    push=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    frequency=st.floats(0.5, 4.0),
)
@settings(max_examples=examples(12))
def test_linear_systems_answer_as_theory_says(
    entries: list[float], push: list[float], frequency: float
):
    matrix = np.array(entries).reshape(3, 3) - 2.5 * np.eye(3)  # Gershgorin: eigenvalues below 0
    period = 2 * np.pi / frequency
    numbers = {"matrix": matrix.ravel(), "push": push, "frequency": frequency}
    orbit = periodic_orbit(THREE, period, p=numbers)
    answer = np.linalg.solve(1j * frequency * np.eye(3) - matrix, np.array(push)).real
    assert orbit.motion["state"][:, 0] == pytest.approx(answer, abs=1e-8)
    assert orbit.drift < 1e-9
    known = np.linalg.eigvals(expm(matrix * period))
    assert np.sort(np.abs(orbit.multipliers)) == pytest.approx(np.sort(np.abs(known)), abs=1e-9)
    assert orbit.stable


def test_an_unstable_orbit_is_found_and_told():
    matrix = np.diag([0.3, -1.0])
    orbit = periodic_orbit(linear(2), 2 * np.pi, p={"matrix": matrix.ravel()})
    assert orbit.multipliers.real == pytest.approx(np.exp(2 * np.pi * np.array([0.3, -1.0])), 1e-9)
    assert not orbit.stable


def shaken(push: float) -> Model:
    """A unit mass on rough ground that a periodic force drives; it goes on without end."""
    x, v, f, t, size, w, ahead, back = (ca.SX.sym(name) for name in "xvftPwFB")
    ground = Contact("mass", v, f, Coulomb(ahead, back))
    return Model(
        "shaken",
        x=[Signal("position", x), Signal("velocity", v)],
        ode=ca.vertcat(v, size * ca.cos(w * t) + f),
        t=t,
        p=[
            Signal("push", size, value=push),
            Signal("frequency", w, value=1.0),
            Signal("friction", ahead, value=0.5),
            Signal("backward", back, value=1.0),
        ],
        contacts=[ground],
    )


def test_dry_friction_takes_every_start_to_one_orbit():
    model = shaken(3.0)
    orbit = periodic_orbit(model, 2 * np.pi, **HOW)
    long = simulate(model, 80 * np.pi, x0={"velocity": -2.0}, times=[78 * np.pi, 80 * np.pi])
    assert orbit.motion["velocity"][0, 0] == pytest.approx(long["velocity"][0, -1], abs=1e-8)
    advance = np.diff(long["position"][0])[0]
    assert np.ptp(orbit.motion["position"][0, [0, -1]]) == pytest.approx(advance, abs=1e-8)
    assert orbit.stable
    # impulses over a period: friction is all there is besides the periodic force
    ends = orbit.motion["velocity"][0]
    assert ends[0] == pytest.approx(ends[-1], abs=1e-9)


def test_what_does_not_repeat_is_told():
    x = ca.SX.sym("x")
    drifts = Model("drifts", x=[Signal("place", x)], ode=ca.SX(1))
    with pytest.raises(SolveError, match="no motion that repeats") as caught:
        periodic_orbit(drifts, 1.0)
    assert caught.value.code == "no_periodic_motion"
    with pytest.raises(UnknownNameError, match="'place'"):
        periodic_orbit(drifts, 1.0, returning=["speed"])
    for period, names in ((0.0, ["place"]), (1.0, [])):
        with pytest.raises(ArgumentError, match="positive period"):
            periodic_orbit(drifts, period, returning=names)


# -- derivatives -----------------------------------------------------------------------------------


def test_the_answer_of_a_linear_system_moves_with_matrix_push_and_frequency():
    """x = Re(e^iwt R b) with R = (iw - A)^-1, and dR = R dA R - i R^2 dw."""
    matrix = np.array([[-2.0, 0.6, 0.0], [-0.4, -1.5, 0.3], [0.2, 0.0, -3.0]])
    push, w = np.array([1.0, -0.5, 0.3]), 1.7
    orbit = periodic_orbit(
        THREE,
        2 * np.pi / w,
        p={"matrix": matrix.ravel(), "push": push, "frequency": w},
        samples=7,
        sensitivities=["push[1]", "matrix[5]", "frequency"],
        period_derivative={"frequency": -2 * np.pi / w**2},
    )
    R = np.linalg.inv(1j * w * np.eye(3) - matrix)
    turn = np.exp(1j * w * orbit.motion.time)
    by_matrix = R[:, 1] * (R @ push)[2]
    by_frequency = -1j * np.outer(R @ R @ push, turn) + np.outer(
        R @ push, 1j * orbit.motion.time * turn
    )
    found = orbit.motion.derivative("state")
    assert orbit.motion.directions == ("push[1]", "matrix[5]", "frequency")
    assert found[:, 0] == pytest.approx(np.real(np.outer(R[:, 1], turn)), abs=1e-9)
    assert found[:, 1] == pytest.approx(np.real(np.outer(by_matrix, turn)), abs=1e-9)
    assert found[:, 2] == pytest.approx(by_frequency.real, abs=1e-9)
    assert orbit.mean_rate_derivative("state") == pytest.approx(0.0, abs=1e-9)


def found_speed(push: float = 3.0, frequency: float = 1.0, friction: float = 0.5) -> float:
    p, sharp = {"push": push, "frequency": frequency, "friction": friction}, Tolerance(1e-13, 1e-14)
    orbit = periodic_orbit(SHAKEN, 2 * np.pi / frequency, p=p, tolerance=sharp, samples=2, **HOW)
    return float(orbit.mean_rate("position")[0])


SHAKEN = shaken(3.0)
HOW: Any = {"returning": ["velocity"], "x0": {"velocity": 1.0}}
SHORTER = {"frequency": -2 * np.pi}  # the period, by its frequency


@pytest.mark.parametrize(
    "push", [pytest.param(3.0, id="slides"), pytest.param(0.9, id="rests part of the time")]
)
def test_the_mean_speed_on_dry_ground_moves_with_what_drives_it(push: float):
    asked = {"sensitivities": ["push", "friction", "frequency"], "period_derivative": SHORTER}
    orbit = periodic_orbit(SHAKEN, 2 * np.pi, p={"push": push}, **asked, **HOW)
    rests = any(event.kind == "stick" for event in orbit.motion.events)
    assert rests == (push < 1)
    slopes = orbit.mean_rate_derivative("position")[0]
    h, base = 1e-3, {"push": push}
    for name, slope in zip(orbit.motion.directions, slopes, strict=True):
        at = {"push": push, "frequency": 1.0, "friction": 0.5}[name]
        v = [found_speed(**{**base, name: at + k * h}) for k in (1, -1, 2, -2)]
        assert slope == pytest.approx((8 * (v[0] - v[1]) - v[2] + v[3]) / (12 * h), rel=1e-6)
    if rests:  # whatever comes before a rest is forgotten
        assert orbit.multipliers == pytest.approx(0.0, abs=1e-14)


def test_the_mean_speed_is_a_force_over_a_frequency():
    """By units alone: of a unit mass, times a function of the ratios of forces."""
    forces = {"push": 1.7, "friction": 0.5, "backward": 1.0}
    ways = {"forces": forces, "frequency": {"frequency": 1.0}}
    asked = {"sensitivities": ways, "period_derivative": SHORTER}
    orbit = periodic_orbit(SHAKEN, 2 * np.pi, p={"push": 1.7}, **asked, **HOW)
    speed = orbit.mean_rate("position")[0]
    assert orbit.mean_rate_derivative("position")[0] == pytest.approx([speed, -speed], rel=1e-9)
    velocity = orbit.motion["velocity"][0]
    along = orbit.motion.derivative("velocity")[0, 0]
    assert along == pytest.approx(velocity, abs=1e-9)


def test_what_only_goes_on_has_a_multiplier_of_one():
    x, t, k = ca.SX.sym("x"), ca.SX.sym("t"), ca.SX.sym("k")
    numbers = [Signal("fading", k, value=1e-9)]
    model = Model("slow", [Signal("place", x)], ca.cos(t) - k * x, t=t, p=numbers)
    orbit = periodic_orbit(model, 2 * np.pi)
    assert orbit.multipliers == pytest.approx(1.0, abs=1e-8)
    with pytest.raises(SolveError, match="a multiplier is 1") as caught:
        periodic_orbit(model, 2 * np.pi, sensitivities=["fading"])
    assert caught.value.code == "singular"
    with pytest.raises(SolveError, match="a multiplier is 1: leave states"):
        periodic_orbit(model, 2 * np.pi, p={"fading": 0.0}, x0={"place": 1.0})


def test_directions_that_an_orbit_does_not_have_are_refused():
    with pytest.raises(ArgumentError, match="does not depend on initial values of velocity"):
        periodic_orbit(SHAKEN, 2 * np.pi, sensitivities=["velocity"], **HOW)
    with pytest.raises(UnknownNameError, match="no direction 'weight'"):
        periodic_orbit(
            SHAKEN, 2 * np.pi, sensitivities=["push"], period_derivative={"weight": 1.0}, **HOW
        )
    with pytest.raises(ArgumentError, match="needs sensitivities"):
        periodic_orbit(SHAKEN, 2 * np.pi, **HOW).mean_rate_derivative("position")
