"""Derivatives of steady states: against closed forms, perturbation theory and their limits."""

from collections.abc import Sequence

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings

from wormopt.analysis.average import average
from wormopt.analysis.continuation import continue_branch
from wormopt.analysis.steady import SteadyState, steady_sensitivity, steady_states
from wormopt.errors import ArgumentError, SolveError, UnknownNameError
from wormopt.model.friction import Viscous
from wormopt.model.model import Model, Output, Signal
from wormopt.systems.pair.slow import slow_pair


def linear(n: int) -> Model:
    """x' = A x + b, all numbers parameters."""
    x, A, b = ca.SX.sym("x", n), ca.SX.sym("A", n * n), ca.SX.sym("b", n)
    matrix = ca.reshape(A, n, n)
    numbers = [Signal("matrix", A, value=0.0), Signal("push", b, value=0.0)]
    power = [Output("power", ca.dot(b, x))]
    return Model("linear", [Signal("x", x)], matrix @ x + b, p=numbers, outputs=power)


TWO = linear(2)


def steady(matrix: Sequence[float] | np.ndarray, push: Sequence[float]) -> SteadyState:
    numbers = {"matrix": matrix, "push": push}
    (state,) = steady_states(TWO, {"x": (-9.0, 9.0)}, p=numbers, starts=5)
    return state


@settings(max_examples=examples(20))
@given(
    upper=st.floats(-0.5, 0.5),
    lower=st.floats(-0.5, 0.5),
    push=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=2),
)
def test_a_linear_system_has_a_closed_form(upper: float, lower: float, push: list[float]):
    """x = -A^-1 b; the eigenvalues of a matrix of two rows by trace and determinant."""
    A = np.array([[-2.0, upper], [lower, -3.0]])
    found = steady_sensitivity(steady(A.T.ravel(), push), ["push", "matrix[0]"])
    assert found.directions == ("push[0]", "push[1]", "matrix[0]")
    inverse = np.linalg.inv(A)
    x = -inverse @ push
    by_corner = -inverse[:, 0] * x[0]
    assert found.derivative("x") == pytest.approx(np.c_[-inverse, by_corner], abs=1e-11)
    power = np.append(x - inverse.T @ push, push @ by_corner)
    assert found.derivative("power")[0] == pytest.approx(power, abs=1e-11)
    trace, root = A.trace(), np.sqrt(A.trace() ** 2 - 4 * np.linalg.det(A))
    slope = 0.5 * np.array([1 + (trace + 6) / root, 1 - (trace + 6) / root])
    assert found.eigenvalues[:, 2] == pytest.approx(slope, abs=1e-9)
    assert found.eigenvalues[:, :2] == pytest.approx(0.0, abs=1e-12)


def test_the_amplitude_of_a_damped_swing_falls_with_friction_as_theory_says():
    """a = 1 / (2 W sqrt(D^2 + (k/2)^2)), averaged; eigenvalues -eps k / 2 +- i eps D."""
    eps, detuning, natural = 0.01, 0.4, np.sqrt(2)
    slow = slow_pair(law=Viscous(eps * 0.3), push=eps, frequency=natural + eps * detuning)
    frequency = next(s.symbol for s in slow.p if s.name == "frequency")
    model = average(slow, 2 * ca.pi / frequency)
    (state,) = steady_states(model, {"center_velocity": (-2.0, 2.0), "swing": (-2.0, 2.0)})
    found = steady_sensitivity(state, ["frequency"])
    amplitude = 1 / (2 * natural * np.hypot(detuning, 0.15))
    expected = -amplitude * detuning / (detuning**2 + 0.15**2) / eps
    assert found.derivative("amplitude")[0, 0] == pytest.approx(expected, rel=1e-8)


def test_a_direction_is_the_sum_of_its_parts():
    state = steady([-2.0, 0.3, 0.1, -1.0], [1.0, 0.5])
    parts = steady_sensitivity(state, ["push", "matrix"])
    tied = steady_sensitivity(state, {"all": {"push": 2.0, "matrix": [1.0, 0.0, 0.0, 3.0]}})
    weights = [2.0, 2.0, 1.0, 0.0, 0.0, 3.0]
    assert tied.x[:, 0] == pytest.approx(parts.x @ weights, abs=1e-13)
    assert tied.eigenvalues[:, 0] == pytest.approx(parts.eigenvalues @ weights, abs=1e-13)


def test_along_a_branch_it_is_the_slope_of_the_branch_until_the_fold():
    """x' = r + x - x^3: dx/dr = 1 / (3 x^2 - 1), and the eigenvalue is 1 - 3 x^2."""
    x, r = ca.SX.sym("x"), ca.SX.sym("r")
    cusp = Model("cusp", x=[Signal("x", x)], ode=r + x - x**3, p=[Signal("r", r, value=-2.0)])
    (start,) = steady_states(cusp, {"x": (-3.0, 3.0)})
    branch = continue_branch(start, "r", (-2.0, 2.0))
    folds = [fold.parameter for fold in branch.folds]
    assert len(folds) == 2
    for k, place in enumerate(branch.x[:, 0]):
        if branch.parameter[k] in folds:
            with pytest.raises(SolveError, match="no derivative: its Jacobian is singular"):
                steady_sensitivity(branch.state(k))
            continue
        found = steady_sensitivity(branch.state(k))
        slope = 1 / (3 * place**2 - 1)
        assert found.x[0, 0] == pytest.approx(slope, rel=1e-9)
        assert found.eigenvalues[0, 0] == pytest.approx(-6 * place * slope, rel=1e-9)


@pytest.mark.parametrize("corner", [0.0, 1.0])
def test_eigenvalues_that_are_not_simple_have_no_derivative(corner: float):
    found = steady_sensitivity(steady([-1.0, 0.0, corner, -1.0], [1.0, 1.0]), ["matrix"])
    assert np.isnan(found.eigenvalues).all()
    assert np.isfinite(found.x).all()


def test_complex_eigenvalues_turn_with_the_stiffness():
    """x'' + c x' + k x = 0: l = -c/2 +- i w, dl/dk = -+ 1 / (2 i w)."""
    x, c, k = ca.SX.sym("x", 2), ca.SX.sym("c"), ca.SX.sym("k")
    rates = ca.vertcat(x[1], 1 - k * x[0] - c * x[1])
    numbers = [Signal("damping", c, value=0.4), Signal("stiffness", k, value=4.0)]
    model = Model("swing", [Signal("x", x)], rates, p=numbers)
    (state,) = steady_states(model, {"x": (-3.0, 3.0)})
    found = steady_sensitivity(state)
    w = np.sqrt(4 - 0.04)
    assert found.eigenvalues[:, 1] == pytest.approx(np.array([0.5j, -0.5j]) / w, abs=1e-12)
    by_damping = -0.5 + np.array([-0.1j, 0.1j]) / w
    assert found.eigenvalues[:, 0] == pytest.approx(by_damping, abs=1e-12)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["speed"], "no state, parameter, input or schedule 'speed'"),
        (["push[2]"], "has 2 entries"),
        (["x"], "does not depend on initial states"),
        ({"d": {"push": [1.0, 2.0, 3.0]}}, "not of the shape|one number or"),
        ({"d": {"push": [np.nan, 0.0]}}, "must be finite"),
        ({"d": 1.0}, "not float"),
    ],
)
def test_what_is_no_direction_is_refused(asked, message: str):
    state = steady([-2.0, 0.3, 0.1, -1.0], [1.0, 0.5])
    with pytest.raises((ArgumentError, UnknownNameError), match=message):
        steady_sensitivity(state, asked)
