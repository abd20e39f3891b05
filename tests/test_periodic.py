"""Periodic motions: against theory of linear systems, and by exact contact."""

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
@settings(max_examples=examples(12), deadline=None)
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
    assert np.sort(np.abs(orbit.multipliers)) == pytest.approx(np.sort(np.abs(known)), abs=1e-7)
    assert orbit.stable


def test_an_unstable_orbit_is_found_and_told():
    matrix = np.diag([0.3, -1.0])
    orbit = periodic_orbit(linear(2), 2 * np.pi, p={"matrix": matrix.ravel()})
    assert orbit.multipliers.real == pytest.approx(np.exp(2 * np.pi * np.array([0.3, -1.0])), 1e-6)
    assert not orbit.stable


def shaken(push: float) -> Model:
    """A unit mass on rough ground that a periodic force drives; it goes on without end."""
    x, v, f, t = (ca.SX.sym(name) for name in "xvft")
    ground = Contact("mass", v, f, Coulomb(0.5, 1.0))
    states = [Signal("position", x), Signal("velocity", v)]
    return Model(
        "shaken", x=states, ode=ca.vertcat(v, push * ca.cos(t) + f), t=t, contacts=[ground]
    )


def test_dry_friction_takes_every_start_to_one_orbit():
    model = shaken(3.0)
    orbit = periodic_orbit(model, 2 * np.pi, returning=["velocity"], x0={"velocity": 1.0})
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
