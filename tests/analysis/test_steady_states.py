"""Steady states in a box and branches of them: against polynomials, closed forms and residuals."""

import math
from dataclasses import replace

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings

from wormopt.analysis.average import average
from wormopt.analysis.continuation import Branch, continue_branch
from wormopt.analysis.steady import Rates, steady_states
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.model.friction import Coulomb, Law, Stribeck, Viscous
from wormopt.model.model import Contact, Model, Signal
from wormopt.systems.pair.slow import averaged_pair, slow_pair, steady_pair

NATURAL = math.sqrt(2)


def scalar_model(rate, name: str = "r", value: float = 0.0) -> Model:
    """x' = rate(x, r)."""
    x, r = ca.SX.sym("x"), ca.SX.sym(name)
    return Model("one", x=[Signal("x", x)], ode=rate(x, r), p=[Signal(name, r, value=value)])


def oval() -> Model:
    """Steady states on an ellipse in (x, r): a branch that is closed."""
    x, y, r = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("r")
    rates = ca.vertcat(x**2 + 4 * r**2 - 1, x - y)
    return Model("oval", [Signal("x", x), Signal("y", y)], rates, p=[Signal("r", r, value=0.1)])


def pair(law: Law, eps: float, *, detuning: float = 0.5) -> Model:
    slow = slow_pair(law=law, push=eps, frequency=NATURAL + eps * detuning)
    nu = next(s.symbol for s in slow.p if s.name == "frequency")
    return average(slow, 2 * ca.pi / nu)


BOX = {"center_velocity": (-2.0, 2.0), "swing": (-2.0, 2.0)}


@settings(max_examples=examples(25))
@given(roots=st.lists(st.integers(-8, 8), min_size=1, max_size=5, unique=True))
def test_all_roots_of_a_polynomial_are_found_with_their_stability(roots: list[int]):
    model = scalar_model(lambda x, r: math.prod((x - root / 4 for root in roots), start=-1) + 0 * r)
    found = steady_states(model, {"x": (-2.5, 2.5)})
    assert [s.x[0] for s in found] == pytest.approx(sorted(root / 4 for root in roots), abs=1e-9)
    for state, root in zip(found, sorted(roots), strict=True):
        slope = -math.prod((root - other) / 4 for other in roots if other != root)
        assert state.eigenvalues[0].real == pytest.approx(slope, rel=1e-6)
        assert state.stable == (slope < 0)


def test_states_outside_the_box_are_left_out():
    model = scalar_model(lambda x, r: x * (x - 3) + r)
    assert [s.x[0] for s in steady_states(model, {"x": (-1.0, 1.0)})] == pytest.approx([0.0])


def test_eigenvalues_are_those_of_the_system():
    x = ca.SX.sym("x", 2)
    ode = ca.vertcat(x[1], -4 * x[0] - x[1] + x[0] ** 2 * 0.1)
    (focus,) = steady_states(Model("focus", x=[Signal("x", x)], ode=ode), {"x": (-3.0, 3.0)})
    assert focus.eigenvalues == pytest.approx(np.roots([1, 1, 4]), abs=1e-12)
    assert focus.stable


def test_outputs_and_names_of_a_steady_state():
    (state,) = steady_states(pair(Coulomb(0.005, 0.01), 0.01), BOX)
    assert state["amplitude"][0] == pytest.approx(np.hypot(*state.states["swing"]))
    with pytest.raises(UnknownNameError, match="amplitude"):
        state["height"]


@pytest.mark.parametrize(
    "detuning", [-0.3, 0.5, *(pytest.param(d, marks=pytest.mark.slow) for d in (-1.5, 0.2, 2.0))]
)
@pytest.mark.parametrize(("forward", "backward"), [(0.5, 1.0), (0.2, 0.9), (1.0, 0.5), (0.6, 0.6)])
def test_the_averaged_pair_rests_where_19_says(detuning: float, forward: float, backward: float):
    eps = 0.02
    model = pair(Coulomb(eps * forward, eps * backward), eps, detuning=detuning)
    (state,) = steady_states(model, BOX)
    closed = steady_pair(forward, backward, detuning)
    assert state.stable
    assert state.x[0] == pytest.approx(closed.velocity, abs=1e-12)
    assert state["amplitude"][0] == pytest.approx(closed.amplitude, abs=1e-12)
    assert state["lag"][0] == pytest.approx(closed.lag, abs=1e-12)


def test_a_pair_with_too_much_friction_has_no_steady_swing():
    """E cos(Phi) = 0.4 * 2 / pi > 1/2."""
    law = Coulomb(0.8 * 0.01, 0.8 * 0.01)
    assert steady_states(pair(law, 0.01), BOX) == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"center_velocity": (0.0, 1.0)}, "range of swing"),
        ({**BOX, "speed": (0.0, 1.0)}, "speed"),
        ({**BOX, "swing": (1.0, 0.0)}, "smaller number first"),
        ({**BOX, "swing": (0.0, math.inf)}, "finite"),
    ],
)
def test_boxes_that_cannot_be_are_refused(change, message: str):
    with pytest.raises((ArgumentError, UnknownNameError), match=message):
        steady_states(averaged_pair(law=Coulomb(0.01, 0.02), push=0.02, frequency=1.4), change)


def test_states_that_change_no_rate_are_named():
    x = ca.SX.sym("x", 2)
    signals = [Signal("place", x[0]), Signal("speed", x[1])]
    cart = Model("cart", x=signals, ode=ca.vertcat(x[1], -x[1]))
    with pytest.raises(ArgumentError, match="place has no effect on rates"):
        steady_states(cart, {"place": (0.0, 1.0), "speed": (-1.0, 1.0)})


def test_what_is_neither_damped_nor_driven_is_not_called_stable():
    x = ca.SX.sym("x", 2)
    swing = Model("swing", x=[Signal("x", x)], ode=ca.vertcat(x[1], -ca.sin(x[0])))
    (center,) = steady_states(swing, {"x": (-1.0, 1.0)})
    assert not center.stable


def test_models_that_are_not_autonomous_are_refused():
    slow = slow_pair(law=Coulomb(0.01, 0.02), push=0.02, frequency=1.4)
    with pytest.raises(ArgumentError, match="average it first"):
        steady_states(slow, BOX)
    t, x = ca.SX.sym("t"), ca.SX.sym("x")
    with pytest.raises(ArgumentError, match="depends on time"):
        Rates(Model("clock", x=[Signal("x", x)], ode=ca.cos(t) - x, t=t))


@pytest.fixture(scope="module")
def cusp() -> Branch:
    """Branch of x' = r + x - x^3."""
    model = scalar_model(lambda x, r: r + x - x**3, value=-2.0)
    (start,) = steady_states(model, {"x": (-3.0, 3.0)})
    return continue_branch(start, "r", (-2.0, 2.0))


FOLD = 2 / 27**0.5


def test_a_branch_goes_around_both_folds_of_a_cusp(cusp: Branch):
    branch = cusp
    assert [f.parameter for f in branch.folds] == pytest.approx([FOLD, -FOLD], abs=1e-12)
    assert [f.x[0] for f in branch.folds] == pytest.approx([-(3**-0.5), 3**-0.5], abs=1e-6)
    assert branch.ends == ("range", "range")
    assert branch.parameter + branch.x[:, 0] - branch.x[:, 0] ** 3 == pytest.approx(0.0, abs=1e-10)
    size = np.abs(branch.x[:, 0]) - 3**-0.5
    clear = np.abs(size) > 1e-6  # the folds themselves are on the branch too
    assert clear.sum() == len(clear) - 2
    assert np.array_equal(branch.stable[clear], size[clear] > 0)


def test_a_branch_is_sampled_where_it_is_asked_for(cusp: Branch):
    """Near a fold too, where both sheets are found."""
    grid = np.append(np.linspace(-2.0, 2.0, 41), FOLD - 1e-3)
    sampled = cusp.at(grid)
    for value in grid:
        roots = np.roots([-1.0, 0.0, 1.0, value])
        expected = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
        found = np.sort(sampled.x[sampled.parameter == value, 0])
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.4, 0.75, 1.0])
def test_a_branch_goes_on_where_another_one_crosses_its_fold(share: float):
    """x' = r x - x^3: the outer branch turns back at r = 0, where x = 0 crosses it."""
    model = scalar_model(lambda x, r: r * x - x**3, value=share)
    start = steady_states(model, {"x": (0.01, 2.0)})[0]
    branch = continue_branch(start, "r", (-1.0, 1.0))
    outer = np.abs(branch.x[:, 0]) > 1e-3
    assert branch.x[outer, 0] ** 2 == pytest.approx(branch.parameter[outer], abs=1e-9)
    assert [fold.parameter for fold in branch.folds] == pytest.approx([0.0], abs=1e-3)


@pytest.mark.parametrize("value", [-1.0, 1.0])
def test_a_branch_that_starts_at_an_end_of_its_range_is_whole(value: float):
    model = scalar_model(lambda x, r: r - x, value=value)
    (start,) = steady_states(model, {"x": (-2.0, 2.0)})
    branch = continue_branch(start, "r", (-1.0, 1.0))
    assert np.all(np.diff(branch.parameter) > 0)
    grid = np.linspace(-1.0, 1.0, 9)
    assert branch.at(grid).x[:, 0] == pytest.approx(grid, abs=1e-12)


def test_a_branch_whose_last_sample_is_repeated_includes_its_end(cusp: Branch):
    """A walk from an end of the range samples it twice, with states that differ by round-off."""
    again = np.append(np.arange(len(cusp.parameter)), -1)
    twice = replace(cusp, parameter=cusp.parameter[again], x=cusp.x[again])
    assert twice.at([2.0]).x == pytest.approx(cusp.at([2.0]).x, abs=1e-12)
    assert len(cusp.at([2.0]).x) == 1


def test_a_branch_that_comes_back_to_its_start_is_closed():
    start = steady_states(oval(), {"x": (0.0, 2.0), "y": (0.0, 2.0)})[0]
    branch = continue_branch(start, "r", (-1.0, 1.0))
    assert branch.ends == ("closed", "closed")
    assert sorted(f.parameter for f in branch.folds) == pytest.approx([-0.5, 0.5], abs=1e-12)
    assert branch.x[0] == pytest.approx(branch.x[-1])
    assert branch.states("x").min() == pytest.approx(-1.0, abs=0.02)


def test_a_branch_that_grows_without_bound_is_given_up():
    model = scalar_model(lambda x, r: 1 - r * x, value=1.0)
    (start,) = steady_states(model, {"x": (0.0, 2.0)})
    branch = continue_branch(start, "r", (-1.0, 2.0), largest=50.0)
    assert sorted(branch.ends) == ["range", "runaway"]
    assert 50.0 < branch.x.max() < 60.0


def test_the_resonance_of_a_linear_swing_is_the_known_one():
    """Viscous friction k alike for both: a = G_1 / (2 Omega sqrt(Delta^2 + (k/2)^2)), V = 0."""
    eps, drag = 0.01, 0.3
    model = pair(Viscous(eps * drag), eps)
    (start,) = steady_states(model, BOX)
    branch = continue_branch(start, "frequency", (NATURAL - 2 * eps, NATURAL + 2 * eps))
    detuning = (branch.parameter - NATURAL) / eps
    size = np.hypot(*branch.states("swing"))
    expected = 1 / (2 * NATURAL * np.sqrt(detuning**2 + (drag / 2) ** 2))
    assert size == pytest.approx(expected, rel=1e-9)
    assert branch.ends == ("range", "range")
    assert branch.stable.all()
    assert branch.folds == ()


@pytest.mark.slow
def test_friction_that_falls_with_velocity_folds_the_resonance():
    """The slope of the branch vanishes at the fold, where an eigenvalue is 0."""
    eps = 0.02
    law = Stribeck(0.3 * eps, 0.6 * eps, 0.9 * eps, 1.8 * eps, 0.15)
    model = pair(law, eps, detuning=1.0)
    start = max(steady_states(model, BOX), key=lambda state: state.x[0])
    span = (NATURAL + 0.3 * eps, NATURAL + 3 * eps)
    branch = continue_branch(start, "frequency", span)
    (fold,) = branch.folds
    assert (branch.parameter <= fold.parameter + 1e-12).all()
    above, below = (
        steady_states(model, BOX, p={"frequency": fold.parameter + side * 0.01 * eps}, starts=300)
        for side in (1, -1)
    )
    assert above == ()
    assert [state.stable for state in below] == [False, True]
    rates = Rates(model)
    p = rates.parameters({"frequency": fold.parameter})
    smallest = np.abs(rates.steady(fold.x, p).eigenvalues).min()
    assert smallest < 1e-6 * eps


@pytest.mark.parametrize(
    ("parameter", "span", "message"),
    [
        ("s", (0.0, 1.0), "no parameter"),
        ("r", (1.0, 2.0), "not within"),
        ("r", (1.0, 0.0), "not within"),
        ("many", (0.0, 1.0), "has 2 entries"),
    ],
)
def test_branches_that_cannot_be_followed_are_refused(parameter: str, span, message: str):
    model = scalar_model(lambda x, r: r - x, value=0.5)
    model = replace(model, p=[*model.p, Signal("many", ca.SX.sym("many", 2), value=0.0)])
    (start,) = steady_states(model, {"x": (0.0, 1.0)})
    with pytest.raises((ArgumentError, UnknownNameError), match=message):
        continue_branch(start, parameter, span)


def test_contacts_are_averaged_first():
    x, force = ca.SX.sym("x"), ca.SX.sym("f")
    ground = Contact("block", x, force, Coulomb(1.0, 2.0))
    block = Model("block", x=[Signal("x", x)], ode=force, contacts=[ground])
    with pytest.raises(ArgumentError, match="average it first"):
        steady_states(block, {"x": (0.0, 1.0)})
