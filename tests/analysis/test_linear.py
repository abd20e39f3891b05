"""Linear analysis against closed forms of the chain, systems with known zeros, python-control."""

import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hints import Capture, Patch
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from places import DOCS
from worms import free_worm as worm

from wormopt.analysis.bode import bode, frequencies
from wormopt.analysis.linearise import LinearModel, balanced, invariant_zeros, linearise
from wormopt.analysis.normal_form import relative_degree
from wormopt.control.lambda_tracker import Decay, lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.model import Model, Output, Signal
from wormopt.model.schedule import ParameterPath, piecewise_constant
from wormopt.numerics.expressions import identically_zero
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.construct import fast_gait

seeds = st.integers(0, 10**6)
patient = settings(max_examples=examples(40))
DRY = Coulomb(1.0, 10.0)


def random_worm(seed: int, decades: float = 1.0) -> tuple[Model, dict[str, np.ndarray]]:
    """A chain without friction, its numbers spread over decades."""
    random = np.random.default_rng(seed)
    links = int(random.integers(1, 6))

    def spread(size: int) -> np.ndarray:
        return 10 ** random.uniform(-decades / 2, decades / 2, size)

    sizes = {"mass": links + 1, "stiffness": links, "damping": links, "drag": links + 1}
    numbers = {name: spread(size) for name, size in sizes.items()}
    return worm(links, **numbers), numbers


def by_impedances(numbers: dict[str, np.ndarray], s: complex) -> np.ndarray:
    """G(s) of the chain from the equations of its masses, (m_i s^2 + k_i s) x_i = sum of forces.

    With x = Z E' mu', Z diagonal, mu' = u - (c + d s) l and l = E x this is
    G = (I + E Z E' (c + d s))^-1 E Z E'.
    """
    links = len(numbers["stiffness"])
    edges = np.eye(links, links + 1) - np.eye(links, links + 1, k=1)
    mobility = np.diag(1 / (numbers["mass"] * s**2 + numbers["drag"] * s))
    spread = edges @ mobility @ edges.T
    springs = np.diag(numbers["stiffness"] + numbers["damping"] * s)
    return np.linalg.solve(np.eye(links) + spread @ springs, spread)


# -- matrices ------------------------------------------------------------------------------------


def test_two_masses_by_hand():
    """Drag, friction of slope (F+ + F-)/(2 v_reg) / cosh^2(v / v_reg), each mass at its speed."""
    v, v_reg = np.array([0.02, -0.01]), 0.05
    model = worm(1, DRY, mass=[2.0, 4.0], drag=[0.5, 1.0])
    linear = linearise(model, output=["length", "rate"], x={"velocity": v}, v_reg=v_reg)
    k = np.array([0.5, 1.0]) + 5.5 / v_reg / np.cosh(v / v_reg) ** 2
    by_hand = [[0, 0, 1, 0], [0, 0, 0, 1],
               [-5, 5, -(5 + k[0]) / 2, 2.5], [2.5, -2.5, 1.25, -(5 + k[1]) / 4]]  # fmt: skip
    assert np.allclose(linear.A, by_hand, rtol=1e-14)
    assert np.array_equal(linear.B.ravel(), [0, 0, 0.5, -0.25])
    assert np.array_equal(linear.C, [[1, -1, 0, 0], [0, 0, 1, -1]])
    assert np.array_equal(linear.D, np.zeros((2, 1)))
    assert linear.states == ("position[0]", "position[1]", "velocity[0]", "velocity[1]")
    assert (linear.inputs, linear.outputs) == (("input[0]",), ("length[0]", "rate[0]"))


def test_the_operating_point_counts_where_the_model_is_not_linear():
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p")
    model = Model("bilinear", x=[Signal("x", x, value=3.0)], ode=p * x * u, u=[Signal("u", u)],
                  p=[Signal("p", p)], outputs=[Output("y", x**2 + u**2)])  # fmt: skip
    linear = linearise(model, output="y", u={"u": 5.0}, p={"p": 2.0})
    assert [m.item() for m in (linear.A, linear.B, linear.C, linear.D)] == [10, 6, 6, 10]
    moved = linearise(model, output="y", x={"x": 1.0}, p={"p": 2.0})
    assert [m.item() for m in (moved.A, moved.B, moved.C, moved.D)] == [0, 2, 2, 0]
    with pytest.raises(ValueError, match="parameter p has no value"):
        linearise(model, output="y")


@pytest.mark.parametrize("law", [DRY, Stribeck(1, 2, 3, 4, 0.1), Spike(), Viscous(0.4)])
def test_derivatives_are_those_of_the_simulated_motion(law: Law):
    """Difference quotients of the flow over a short time at a point near rest."""
    model, at = worm(1, law), {"position": [2.1, 0.0], "velocity": [0.03, -0.02]}
    a = linearise(model, output="length", x=at, v_reg=0.1).A
    dt, step = 1e-5, 1e-4

    def end(i: int, sign: int) -> np.ndarray:
        x = np.concatenate([at["position"], at["velocity"]]) + sign * step * np.eye(4)[i]
        start = {"position": x[:2], "velocity": x[2:]}
        return simulate(model, dt, contact=Smooth(0.1), x0=start, route="python").end

    flow = np.column_stack([(end(i, 1) - end(i, -1)) / (2 * step) for i in range(4)])
    assert np.allclose((flow - np.eye(4)) / dt, a, atol=2e-3 * np.abs(a).max())


def test_schedules_count_at_the_time_asked_for():
    path = ParameterPath(np.array([0.0, 1.0, 2.0]), np.array([[[9.0, 2.0]], [[11.0, 0.0]]]))
    model = worm(1, stiffness=path)
    found = [-linearise(model, output="length", t=t).A[2, 0] for t in (-0.5, 0.0, 0.5, 1.0, 7.0)]
    assert found == [8.0, 9.0, 10.0, 11.0, 11.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"x": {"speed": 1.0}}, "has no state 'speed'"),
        ({"u": {"input": [1, 2, 3]}}, "input input has 2 entries, not 3"),
        ({"output": ["length", "size"]}, "no output 'size'"),
        ({"v_reg": 0.0}, "v_reg"),
        ({"p": {"mass": 0.0}}, "mass must be positive"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: Any, message: str):
    with pytest.raises((ValueError, KeyError), match=message):
        linearise(worm(), **{"output": "length"} | options)


def test_what_cannot_be_linearised_is_refused():
    z = ca.SX.sym("z")
    constrained = Model("held", x=[Signal("x", ca.SX.sym("x"))], ode=z, z=[Signal("z", z)], alg=z)
    with pytest.raises(ValueError, match="algebraic"):
        linearise(constrained, output=[])
    unbounded = worm()
    unbounded = replace(unbounded, p=[replace(s, lower=-np.inf) for s in unbounded.p])
    with pytest.raises(ZeroDivisionError, match="divides by zero"):
        relative_degree(unbounded, output="length", p={"mass": 0.0})
    with pytest.raises(ValueError, match="not finite"):
        linearise(unbounded, output="length", p={"mass": 0.0})
    one = np.eye(1)
    with pytest.raises(ValueError, match="shapes"):
        LinearModel("crooked", one, one, one, one, ("x",), ("u", "v"), ("y",))


# -- high-frequency gain and relative degree -----------------------------------------------------


@patient
@given(seed=seeds)
def test_high_frequency_gain_of_any_chain(seed: int):
    """Link j feels u_j through both its masses, its neighbours through the one they share."""
    model, numbers = random_worm(seed, decades=6)
    links, masses = len(numbers["stiffness"]), numbers["mass"]
    linear = linearise(model, output="length")
    shared = np.diag(1 / masses[1:-1], 1)
    by_hand = np.diag(1 / masses[:-1] + 1 / masses[1:]) - shared - shared.T
    assert linear.relative_degree == relative_degree(model, output="length") == (2,) * links
    assert np.allclose(linear.high_frequency_gain, by_hand, rtol=1e-12)


CASES: dict[str, tuple[Model, str, tuple[float, ...]]] = {
    "feed-through": (worm(), "link_force", (0, 0)),
    "rates": (worm(), "rate", (1, 1)),
    "lengths": (worm(), "length", (2, 2)),
    "centre without ground": (worm(), "center_of_mass", (math.inf,)),
    "centre, equal drag": (worm(drag=0.1), "center_of_mass", (math.inf,)),
    "centre, drag and masses in proportion": (
        # 0.1 : 0.3 is not 0.30000000000000004 : 0.9, but very nearly
        worm(drag=[0.3, 0.6, 0.9], mass=[0.1, 0.2, 0.30000000000000004]), "center_velocity", (2,)
    ),
    "centre, unequal drag": (worm(drag=[0.1, 0.2, 0.1]), "center_velocity", (2,)),
    "spring force": (worm(damping=0.0), "spring_force", (2, 2)),
    "damped spring force": (worm(), "spring_force", (1, 1)),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_relative_degree_of_outputs(case: str):
    model, output, degrees = CASES[case]
    assert relative_degree(model, output=output) == degrees
    if "proportion" not in case:
        assert linearise(model, output=output).relative_degree == degrees


def test_friction_lets_inputs_reach_the_centre_of_mass():
    """At equal speeds the slopes of friction are alike, and the linear chain does not know."""
    model = worm(1, DRY)
    assert relative_degree(model, output="center_of_mass") == (3,)
    assert linearise(model, output="center_of_mass").relative_degree == (math.inf,)
    apart = linearise(model, output="center_of_mass", x={"velocity": [0.01, 0.0]})
    assert apart.relative_degree == (3,)


def test_an_output_far_from_the_input():
    """A column of integrators: the relative degree is its length, beyond it there is none."""
    n = 12
    x, u = ca.SX.sym("x", n), ca.SX.sym("u")
    outputs = [Output("first", x[0]), Output("last", x[-1]), Output("nothing", ca.SX(1))]
    model = Model("integrators", x=[Signal("x", x)], ode=ca.vertcat(x[1:], u), outputs=outputs,
                  u=[Signal("u", u)])  # fmt: skip
    names = [o.name for o in outputs]
    assert relative_degree(model, output=names) == (n, 1, math.inf)
    assert linearise(model, output=names).relative_degree == (n, 1, math.inf)


def test_time_has_a_part_in_the_relative_degree():
    x, u, t = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("t")
    model = Model("drifting", x=[Signal("x", x)], ode=u, t=t, u=[Signal("u", u)],
                  outputs=[Output("y", ca.sin(t) * x)])  # fmt: skip
    assert relative_degree(model, output="y") == (1,)


def test_a_closed_loop_has_no_inputs():
    loop = tracked(worm(2, DRY))
    linear = linearise(loop, output="length", t=0.4)
    assert linear.inputs == ()
    assert relative_degree(loop, output="length") == linear.relative_degree == (math.inf,) * 2
    assert linear.high_frequency_gain.shape == (2, 0)
    assert len(linear.poles) == loop.n_x


# -- zero for all values -------------------------------------------------------------------------

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
ZERO = {
    "binomial": (X + Y) ** 2 - X**2 - 2 * X * Y - Y**2,
    "fractions": 1 / (X - Y) - 1 / (X + Y) - 2 * Y / ((X - Y) * (X + Y)),
    "powers": X**7 * X**-5 - X * X,
    "of functions": (ca.tanh(X) + 1) * (ca.tanh(X) - 1) - ca.tanh(X) ** 2 + 1,
    "derivative": ca.jacobian(ca.exp(X * Y), X) * X - ca.jacobian(ca.exp(X * Y), Y) * Y,
    "pieces": ca.if_else(X > 0, 2 * Y, Y) - Y * ca.if_else(X > 0, 2, 1),
    "dyadic": 0.375 * X - 3 * (X / 8),
}
NOT_ZERO = {
    "nearly": 0.1 * X + 0.2 * X - 0.3 * X,  # these doubles do not add up
    "small": 1e-300 * X,
    "one piece": ca.if_else(X > 0, Y, 0),
    "functions": ca.tanh(X) - ca.tanh(Y),
}


@pytest.mark.parametrize("name", [*ZERO, *NOT_ZERO])
def test_identities_are_told_from_small_numbers(name: str):
    both = ca.vertcat(X, Y)
    expected = name in ZERO
    assert identically_zero((ZERO | NOT_ZERO)[name], both).item() is expected


def test_identities_at_given_values():
    both = ca.vertcat(X, Y)
    row = ca.horzcat(X - 0.1, Y * (X - 0.1), Y - 0.1, X * Y)
    assert identically_zero(row, both, {0: 0.1}).tolist() == [[True, True, False, False]]
    assert identically_zero(ca.SX(2, 3), both).all()


# -- zeros and poles -----------------------------------------------------------------------------


@patient
@given(seed=seeds)
def test_zeros_of_the_chain_are_its_common_motion(seed: int):
    """With all lengths held, sum m_i W' = -sum k_i W; the place is a shift."""
    model, numbers = random_worm(seed, decades=6)
    linear = linearise(model, output="length")
    common = -numbers["drag"].sum() / numbers["mass"].sum()
    assert linear.shifts == 1
    assert linear.zeros == pytest.approx([common, 0.0], rel=1e-6)
    assert linear.zeros[1] == 0
    assert linear.phase_kind == "minimum phase"


def test_zeros_that_cannot_be_told_are_refused():
    """Twelve decades between the numbers of a chain; the zero must not be lost in silence."""
    with pytest.raises(ValueError, match="differ too much in size"):
        linearise(random_worm(4, decades=12)[0], output="length").phase_kind  # noqa: B018


def test_poles_of_two_masses_by_hand():
    """Equal masses and drag part into common and relative motion, kappa = k/m."""
    linear = linearise(worm(1, mass=2.0, drag=0.6), output="length")
    relative = np.roots([1, 0.3 + 2 * 5 / 2, 2 * 10 / 2])
    assert linear.poles.real == pytest.approx(sorted([*relative.real, -0.3, 0.0]), rel=1e-12)
    assert linear.poles[-1] == 0


PHASES: dict[str, tuple[Model, dict[str, Any], str]] = {
    "drag": (worm(drag=0.2), {}, "minimum phase"),
    "little drag on one mass": (worm(drag=[0, 0, 1e-9]), {}, "minimum phase"),
    "friction at rest": (worm(2, DRY), {}, "minimum phase"),
    "spikes": (worm(2, Spike()), {}, "minimum phase"),
    "nothing": (worm(), {}, "marginal"),
    "nothing, no damping": (worm(5, damping=0.0), {}, "marginal"),
    "load alone": (worm(load=2.0), {}, "marginal"),
    "friction, sliding fast": (worm(2, DRY), {"velocity": 3.0}, "marginal"),
    "drag, friction, sliding fast": (worm(2, DRY, drag=0.1), {"velocity": 3.0}, "minimum phase"),
    "friction that falls with speed": (
        worm(2, Stribeck(1.0, 10.0, 2.0, 20.0, v_stribeck=0.5)), {"velocity": 0.3},
        "not minimum phase",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", PHASES)
def test_minimum_phase_is_told_from_marginal(case: str):
    model, x, kind = PHASES[case]
    linear = linearise(model, output="length", x=x)
    assert linear.phase_kind == kind
    assert linear.minimum_phase is (kind == "minimum phase")
    assert linear.shifts == 1


def test_falling_friction_pushes_the_common_motion():
    """The zero is the mean slope of the force, here of a Stribeck law ahead of its steep part."""
    v, v_s = 0.3, 0.5
    model = worm(1, Stribeck(1.0, 10.0, 2.0, 20.0, v_stribeck=v_s))
    linear = linearise(model, output="length", x={"velocity": v}, v_reg=0.01)
    slope = 2 * v / v_s**2 * (2 - 1) * math.exp(-((v / v_s) ** 2))
    assert linear.zeros.real == pytest.approx([0, slope], rel=1e-10)


def test_the_centre_of_mass_has_no_shift():
    linear = linearise(worm(1, drag=[0.1, 0.2]), output="center_of_mass")
    assert linear.shifts == 0
    # y = (x0 + x1)/2 from forces u, -u: (Z0 - Z1)/2 / (1 + (Z0 + Z1)(c + d s)) with
    # Z_i = 1/(s (s + k_i)): the numerator (k1 - k0) s, the denominator has a factor s as well
    assert linear.zeros == pytest.approx([0.0], abs=1e-12)
    assert linear.phase_kind == "marginal"


def mixer(random: np.random.Generator, size: int) -> np.ndarray:
    """A matrix of condition up to 100, which leaves little rounding in what it mixes."""
    first, second = (np.linalg.qr(random.normal(size=(size, size)))[0] for _ in range(2))
    return first @ np.diag(10 ** random.uniform(-1, 1, size)) @ second


def known_zeros(random: np.random.Generator, channels: int) -> tuple[list[np.ndarray], np.ndarray]:
    """A system with zeros that are chosen: single channels, mixed by regular matrices."""
    blocks, zeros = [], []
    for _ in range(channels):
        order = int(random.integers(1, 5))
        chosen = random.uniform(-3, 3, int(random.integers(0, order + 1)))
        top = random.uniform(0.5, 2) * np.atleast_1d(np.poly(chosen))
        bottom = np.poly(random.uniform(-3, 3, order))
        through = top[0] if len(top) == len(bottom) else 0.0
        top = np.concatenate([np.zeros(order + 1 - len(top)), top]) - through * bottom
        a = np.vstack([-bottom[1:], np.eye(order)[:-1]])
        blocks.append((a, np.eye(order)[:, :1], top[None, 1:], np.array([[through]])))
        zeros.extend(chosen)
    a, b, c, d = (
        np.block([[m if i == j else np.zeros((len(m), n.shape[1])) for j, n in enumerate(ms)]
                  for i, m in enumerate(ms)])
        for ms in zip(*blocks, strict=True)
    )  # fmt: skip
    t, left, right = (mixer(random, k) for k in (len(a), channels, channels))
    inverse = np.linalg.inv(t)
    return [t @ a @ inverse, t @ b @ right, left @ c @ inverse, left @ d @ right], np.sort(zeros)


@patient
@given(seed=seeds, channels=st.integers(1, 3))
def test_zeros_that_were_built_in_are_found(seed: int, channels: int):
    """Feed-through, relative degrees up to 4 and zeros at random; nothing infinite remains."""
    (a, b, c, d), zeros = known_zeros(np.random.default_rng(seed), channels)
    found, uncertainty = invariant_zeros(balanced((a, b, c, d)))
    assert len(found) == len(zeros)
    # zeros that lie close move far, and say so
    assert np.all(np.abs(np.sort(found.real) - zeros) <= 1e-9 + 1e3 * uncertainty.max(initial=0))


def test_more_outputs_than_inputs():
    """Of (s + 1)(s + 2) and (s + 1)(s + 3) over s^3 only the common factor is a zero."""
    a, b = np.eye(3, k=-1), np.eye(3)[:, :1]
    c, d = np.array([[1.0, 3, 2], [1, 4, 3]]), np.zeros((2, 1))
    assert invariant_zeros((a, b, c, d))[0] == pytest.approx([-1.0], abs=1e-12)
    assert invariant_zeros((a.T, c.T, b.T, d.T))[0] == pytest.approx([-1.0], abs=1e-12)
    apart = np.array([[1.0, 3, 2], [1, 7, 12]])
    assert len(invariant_zeros((a, b, apart, d))[0]) == 0


def test_an_output_told_twice_adds_no_zero():
    once = linearise(worm(2, drag=0.4), output="length")
    twice = linearise(worm(2, drag=0.4), output=["length", "length"])
    assert len(twice.outputs) == 2  # a name counts once
    doubled = LinearModel("twice", once.A, np.hstack([once.B] * 2), np.vstack([once.C] * 2),
                     np.zeros((4, 4)), once.states, tuple("abcd"), tuple("efgh"))  # fmt: skip
    assert doubled.zeros == pytest.approx(once.zeros, abs=1e-12)


def test_hidden_modes_are_zeros():
    """Equal drag: inputs do not reach the centre's velocity, lengths do not show it."""
    linear = linearise(worm(2, drag=0.7), output="length")
    assert min(abs(linear.poles - linear.zeros[0])) < 1e-12


def test_repeated_zeros_on_the_axis_are_marginal():
    """Rounding parts a threefold zero by the cube root of its size, to the right as well."""
    a = np.eye(4, k=1) - np.ones((4, 1)) * np.eye(4)[3]
    mixed = np.linalg.qr(np.random.default_rng(3).normal(size=(4, 4)))[0]
    top = np.array([[0.0, 0.0, 0.0, 1.0]])
    system = mixed @ a @ mixed.T, mixed @ np.eye(4)[:, 3:], top @ mixed.T, np.zeros((1, 1))
    linear = LinearModel("threefold", *system, tuple("abcd"), ("u",), ("y",))
    assert len(linear.zeros) == 3
    assert linear.phase_kind == "marginal"


# -- frequency response and picture --------------------------------------------------------------


@patient
@given(seed=seeds)
def test_response_is_that_of_the_impedances(seed: int):
    model, numbers = random_worm(seed, decades=2)
    omega = np.logspace(-1, 2, 7)
    response = linearise(model, output="length").frequency_response(omega)
    by_hand = np.stack([by_impedances(numbers, 1j * w) for w in omega], axis=-1)
    assert np.allclose(response, by_hand, rtol=1e-9, atol=1e-9 * np.abs(by_hand).max())


def test_a_frequency_that_is_a_pole_is_refused():
    with pytest.raises(ValueError, match="pole"):
        linearise(worm(), output="length").frequency_response([0.0, 1.0])
    resting = linearise(worm(drag=0.1), output="length").frequency_response([0.0])
    assert resting[:, :, 0] == pytest.approx(np.eye(2) / 10, abs=1e-14)  # force over stiffness
    oscillator = linearise(worm(1, damping=0.0, stiffness=8.0), output="length")
    with pytest.raises(ValueError, match="pole"):
        oscillator.frequency_response([4.0])


def test_the_picture_shows_gain_and_phase(tmp_path: Path):
    linear = linearise(worm(2, damping=0.2), output="length")
    figure = bode(linear, tmp_path / "bode.png")
    assert (tmp_path / "bode.png").stat().st_size > 10_000
    gains, phases = figure.axes[:2], figure.axes[2:]
    omega = np.asarray(gains[1].lines[0].get_xdata())
    response = linear.frequency_response(omega)
    for j, (gain, phase) in enumerate(zip(gains, phases, strict=True)):
        assert gain.get_title() == f"from input[{j}]"
        for i in range(2):
            drawn = np.asarray(gain.lines[i].get_ydata())
            assert drawn == pytest.approx(20 * np.log10(np.abs(response[i, j])))
            angle = np.asarray(phase.lines[i].get_ydata())
            turned = response[i, j] / np.abs(response[i, j])
            assert np.exp(1j * np.radians(angle)) == pytest.approx(turned)
            assert np.abs(np.diff(angle)).max() < 90  # fine enough to unwrap
    legend = figure.legends[0]
    assert [text.get_text() for text in legend.get_texts()] == ["length[0]", "length[1]"]


def test_resonances_are_resolved():
    """Peaks a million times narrower than the range are not missed."""
    linear = linearise(worm(1, damping=1e-5), output="length")
    peak = np.abs(linear.frequency_response(frequencies(linear))).max()
    assert peak == pytest.approx(1 / (1e-5 * math.sqrt(20)), rel=1e-2)  # 1 / (d omega)


def test_the_picture_goes_where_it_is_told(tmp_path: Path):
    linear = linearise(worm(1), output=["length", "center_of_mass"])
    axes = Figure().subplots(2, 1, squeeze=False)
    assert bode(linear, axes, omega=[0.1, 1.0, 10.0]) is axes[0, 0].figure
    assert np.isnan(np.asarray(axes[0, 0].lines[1].get_ydata())).all()  # never reached
    with pytest.raises(ValueError, match="shape"):
        bode(linearise(worm(2), output="length"), axes)
    with pytest.raises(ValueError, match="ascend"):
        bode(linear, axes, omega=[1.0, 0.5])
    with pytest.raises(ValueError, match="nothing to draw"):
        bode(linearise(worm(1), output=[]))


# -- python-control ------------------------------------------------------------------------------


def nearest(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found[:, None] - expected).min(axis=1).max(initial=0.0))


@pytest.mark.parametrize("links", [1, 2, 4])
def test_zeros_poles_and_response_agree_with_control(control: Any, links: int):
    model = worm(links, DRY, drag=np.arange(links + 1) / 10, mass=1 + np.arange(links + 1) / 4)
    linear = linearise(model, output="length", x={"velocity": 0.02})
    theirs = linear.to_control()
    assert tuple(theirs.input_labels) == linear.inputs
    assert tuple(theirs.output_labels) == linear.outputs
    assert tuple(theirs.state_labels) == linear.states
    zeros = theirs.zeros()
    assert nearest(linear.zeros, zeros) < 1e-6  # they take no infinite zeros out
    assert nearest(zeros[np.abs(zeros) < 1e4], linear.zeros) < 1e-6
    assert nearest(linear.poles, theirs.poles()) < 1e-6
    omega = np.logspace(-2, 3, 9)
    response = theirs(1j * omega, squeeze=False)
    assert linear.frequency_response(omega) == pytest.approx(response, rel=1e-9, abs=1e-14)


def test_zeros_with_feed_through_agree_with_control(control: Any):
    linear = linearise(worm(2, drag=0.3), output="link_force")
    assert linear.relative_degree == (0, 0)
    assert nearest(linear.zeros, linear.to_control().zeros()) < 1e-6
    assert len(linear.zeros) == 6


def test_control_linearises_its_copy_alike(control: Any):
    model = worm(2, DRY)
    x = np.array([4.1, 2.0, 0.0, 0.01, -0.02, 0.03])
    ours = linearise(model, output="length", x={"position": x[:3], "velocity": x[3:]}, v_reg=0.1)
    theirs = control.linearize(model.to_control(output="length", v_reg=0.1), x, [0.0, 0.0])
    for matrix in "ABCD":
        assert getattr(theirs, matrix) == pytest.approx(getattr(ours, matrix), abs=1e-3)


EXACT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}


@pytest.mark.parametrize("v_reg", [1 / 40, 0.1])
def test_control_simulates_a_chain_alike(control: Any, v_reg: float):
    model = worm(2, DRY, drag=0.3)
    times, x0 = np.linspace(0, 3, 13), np.array([4, 2.1, 0, 0.1, 0, -0.3])
    system = model.to_control(output=["length", "power"], v_reg=v_reg, p={"damping": [4.0, 5.0]})
    theirs = control.input_output_response(system, times, [3.0, -2.0], x0, solve_ivp_kwargs=EXACT)
    p, start = {"damping": [4.0, 5.0], "input": [3.0, -2.0]}, {"position": x0[:3]}
    start["velocity"] = x0[3:]
    ours = simulate(model, 3.0, contact=Smooth(v_reg), p=p, x0=start, times=times)
    assert theirs.states == pytest.approx(ours.states, abs=1e-8)
    length, rate = -np.diff(ours.states[:3], axis=0), -np.diff(ours.states[3:], axis=0)
    by_hand = np.vstack([length, np.array([[3.0], [-2.0]]) * rate])
    assert theirs.outputs == pytest.approx(by_hand, abs=1e-7)


def test_parameters_are_changed_by_control(control: Any):
    model = worm(1, DRY)
    system = model.to_control(output="length")
    changed = {"mass": [1.0, 2.0], "friction_backward": 4.0, "v_reg": 0.1}
    times, x0 = np.array([0.0, 0.5, 1.0]), [3.0, 0.0, 0.0, 0.0]
    theirs = control.input_output_response(system.copy(), times, 0.5, x0, params=changed,
                                           solve_ivp_kwargs=EXACT)  # fmt: skip
    numbers = {name: value for name, value in changed.items() if name != "v_reg"}
    ours = simulate(model, 1.0, contact=Smooth(0.1), p={**numbers, "input": 0.5},
                    x0={"position": [3.0, 0.0]}, times=times)  # fmt: skip
    assert theirs.states == pytest.approx(ours.states, abs=1e-8)
    assert np.array_equal(system.params["mass"], [1.0, 1.0])


def test_control_follows_schedules(control: Any):
    random = piecewise_constant(np.random.default_rng(5), [10.0, 12.0], 2.0, 0.25, 1.0)
    model = worm(2, stiffness=random, drag=0.2)
    x0 = np.array([4.5, 2.0, 0.0, 0.0, 0.0, 0.0])
    settings = EXACT | {"max_step": 0.02}  # it knows no breaks
    theirs = control.input_output_response(
        model.to_control(output="length"), np.array([0.0, 1.0]), 0.0, x0, solve_ivp_kwargs=settings
    )
    ours = simulate(model, 1.0, contact=Smooth(), x0={"position": x0[:3]})
    assert theirs.states[:, -1] == pytest.approx(ours.end, abs=1e-7)


def tracked(plant: Model, **options: Any) -> Model:
    reference = gait_reference(fast_gait(1.0), plant.t)
    return lambda_tracker(plant, reference, tube_radius=0.2, **options)


def closed_loop() -> Model:
    """TRACK14 of docs/verification.md."""
    return tracked(worm(2, DRY, rest_length=0.0, position=(0.0, 2.0, 4.0)), feedback="filter")


def run_by_control(control: Any, loop: Model, until: float) -> np.ndarray:
    start = np.concatenate([np.ravel(np.asarray(s.value, float)) for s in loop.x])
    times = np.array([0.0, until])
    response = control.input_output_response(
        loop.to_control(output="length"), times, np.zeros((0, 2)), start, solve_ivp_kwargs=EXACT
    )
    return response.states[:, -1]


def test_control_simulates_a_closed_loop_alike(control: Any):
    loop = closed_loop()
    ours = simulate(loop, 0.3, contact=Smooth()).end
    assert run_by_control(control, loop, 0.3) == pytest.approx(ours, abs=1e-8)


def test_switches_have_no_place_in_control(control: Any):
    loop = tracked(worm(2, DRY), adaptation=Decay(dwell=0.1, decay=1.0))
    with pytest.raises(ValueError, match="switches"):
        loop.to_control(output="length")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"v_reg": 0.0}, "v_reg"),
        ({"p": {"weight": 1.0}}, "has no parameter"),
        ({"output": "size"}, "no output"),
    ],
)
def test_what_control_cannot_be_told_is_refused(control: Any, options: Any, message: str):
    with pytest.raises((ValueError, KeyError), match=message):
        worm().to_control(**{"output": "length"} | options)


def test_what_needs_no_control_loads_none(tmp_path: Path):
    code = (
        "import sys\n"
        "from wormopt.analysis.normal_form import relative_degree\n"
        "from wormopt.analysis.linearise import linearise\n"
        "from wormopt.systems.chain.build import chain\n"
        "worm = chain(2, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0, drag=0.1)\n"
        "linear = linearise(worm, output='length')\n"
        "linear.zeros, linear.poles, linear.phase_kind, linear.high_frequency_gain\n"
        "linear.frequency_response([1.0]), relative_degree(worm, output='length')\n"
        "assert not {'control', 'matplotlib'} & set(sys.modules)\n"
        "from wormopt.analysis.bode import bode\n"
        "bode(linear, 'bode.png')\n"
        "assert not {'control', 'matplotlib.pyplot'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


def test_the_examples_of_the_page_run(
    control: Any, tmp_path: Path, monkeypatch: Patch, capsys: Capture
):
    monkeypatch.chdir(tmp_path)
    page = (DOCS / "linear.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(block, names)
        printed = re.findall(r"# -> (.*)", block)
        assert capsys.readouterr().out.splitlines() == printed
    assert (tmp_path / "bode.png").exists()
