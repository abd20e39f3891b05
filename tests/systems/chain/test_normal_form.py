"""Normal form of the chain: proven by computer algebra, and by numbers drawn at random.

The proofs take our own Model's expressions, instruction by instruction, into SymPy. Contact
forces are free symbols there, so what is shown holds for every friction law.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.oracles.by_symbols import Symbols
from wormopt.analysis.linearise import linearise
from wormopt.analysis.normal_form import NormalForm, normal_form
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.model import Model, Output, Signal, pack
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain

INTERNAL = ["center_of_mass", "center_velocity"]
seeds = st.integers(0, 10**6)
patient = settings(max_examples=examples(30))


def in_sympy(model: Model, expression: ca.SX) -> tuple[Any, dict[str, list[Any]]]:
    """The expression and the model's symbols by name; masses and the like are positive."""
    symbols = Symbols.of(model, positive=("mass", "stiffness", "damping", "drag"))
    names = [*(s.name for s in (*model.x, *model.u, *model.p)), "contact"]
    return symbols(expression), {name: list(symbols.column(name)) for name in names}


@cache
def form_of(links: int) -> NormalForm:
    law = Coulomb(1.0, 2.0)
    worm = chain(links, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0, law=law)
    return normal_form(worm, output="length", internal=INTERNAL)


def proven(form: NormalForm, expression: ca.SX) -> tuple[Any, dict[str, list[Any]]]:
    return in_sympy(form.model, expression)


# -- proofs by computer algebra ------------------------------------------------------------------

LINKS = range(1, 7)


@pytest.mark.parametrize("links", LINKS)
def test_gain_is_positive_definite(links: int):
    """Gamma = E M^-1 E', and its leading minors are sums of masses over products of masses."""
    form = form_of(links)
    gain, known = proven(form, form.gain)
    m = known["mass"]
    edges = sp.Matrix(links, links + 1, lambda j, i: (i == j) - (i == j + 1))
    inverse = sp.diag(*(1 / mass for mass in m))
    assert (gain - edges * inverse * edges.T).applyfunc(sp.together) == sp.zeros(links)
    before, minor = sp.Integer(0), sp.Integer(1)
    for j in range(links):  # what lies beside three diagonals is 0: minors follow by recurrence
        aside = gain[j, j - 1] * gain[j - 1, j] if j else 0
        before, minor = minor, sp.cancel(gain[j, j] * minor - aside * before)
        known_minor = sp.Add(*m[: j + 2]) / sp.Mul(*m[: j + 2])
        assert sp.cancel(minor - known_minor) == 0
        assert known_minor.is_positive


@pytest.mark.parametrize("links", LINKS)
def test_coordinates_are_a_change_of_all_states(links: int):
    """The determinant of d(y, y', eta)/dx is 1 but for its sign, for all masses."""
    form = form_of(links)
    jacobian, _ = proven(form, ca.jacobian(form.coordinates, pack(form.model.x)))
    half = links + 1
    rows = [*range(links), 2 * links], [*range(links, 2 * links), 2 * links + 1]
    places, rates = jacobian[list(rows[0]), :half], jacobian[list(rows[1]), half:]
    assert jacobian[list(rows[0]), half:].is_zero_matrix  # places by places, rates by rates
    assert jacobian[list(rows[1]), :half].is_zero_matrix
    assert sp.simplify(places - rates).is_zero_matrix
    assert sp.cancel(sp.together(places.det(method="berkowitz"))) ** 2 == 1


@pytest.mark.parametrize("links", LINKS)
def test_second_derivatives_are_those_of_newton(links: int):
    """y'' = E M^-1 (F - K v - Gamma) - E M^-1 E' (c (l - l0) + d l' - u), no matter the order."""
    form = form_of(links)
    u = pack(form.model.u)
    found, s = proven(form, form.drift + form.gain @ u)
    link = [
        s["stiffness"][j] * (s["position"][j] - s["position"][j + 1] - s["rest_length"][j])
        + s["damping"][j] * (s["velocity"][j] - s["velocity"][j + 1])
        - s["input"][j]
        for j in range(links)
    ]
    pulls = [0, *link, 0]
    acceleration = [
        (s["contact"][i] - s["drag"][i] * s["velocity"][i] - s["load"][i] + pulls[i] - pulls[i + 1])
        / s["mass"][i]
        for i in range(links + 1)
    ]
    for j in range(links):
        assert sp.expand(found[j] - acceleration[j] + acceleration[j + 1]) == 0


@pytest.mark.parametrize("links", LINKS)
def test_zero_dynamics_are_one_mass_on_all_friction(links: int):
    """S' = W and (sum m) W' = sum F_i - (sum k) W - sum Gamma_i, whatever the springs are.

    With y' = 0 all velocities are W. Then (W^2/2)' <= -(sum k / sum m) W^2 as long as forces
    of the ground work against motion: minimum phase for all positive masses and drags.
    """
    form = form_of(links)
    found, s = proven(form, form.internal_rate)
    w = sp.Symbol("W", real=True)
    still = found.subs(dict.fromkeys(s["velocity"], w))
    total, drag = sp.Add(*s["mass"]), sp.Add(*s["drag"])
    law = sp.Add(*s["contact"]) - drag * w - sp.Add(*s["load"])
    assert sp.cancel(sp.together(still[0] - w)) == 0
    assert sp.cancel(sp.together(still[1] * total - law)) == 0
    assert (drag / total).is_positive


@pytest.mark.parametrize("links", LINKS)
def test_zeros_of_the_pencil_for_all_parameters(links: int):
    """The determinant of [[P(s), -E'], [E, 0]] is s (s sum m + sum k), but for its sign.

    P(s) is the impedance of masses, drag, springs and dashpots; -E' lets inputs in. The
    determinant is taken from the Model's own ode.
    """
    form = form_of(links)
    model, half = form.model, links + 1
    s = sp.Symbol("s")
    ode, known = in_sympy(model, model.ode[half:])
    m = known["mass"]
    force = sp.Matrix([sp.expand(ode[i] * m[i]) for i in range(half)])
    x, v = sp.Matrix(known["position"]), sp.Matrix(known["velocity"])
    pencil = s**2 * sp.diag(*m) - s * force.jacobian(v) - force.jacobian(x)
    acting = force.jacobian(sp.Matrix(known["input"]))
    seen = sp.Matrix(known["position"][:-1]) - sp.Matrix(known["position"][1:])
    # in the lengths and a common place, x = S l + w, the rows of E are [I, 0] and drop out
    common = sp.Matrix(half, half, lambda i, j: 1 if i <= j else 0)
    assert seen.jacobian(x) * common == sp.eye(links).row_join(sp.zeros(links, 1))
    assert common.det() in (1, -1)
    left = (pencil * common[:, links]).applyfunc(sp.expand).row_join(-acting)
    found = sp.expand(left.det(method="berkowitz"))
    expected = sp.expand(s * (s * sp.Add(*m) + sp.Add(*known["drag"])))
    assert found in (expected, sp.expand(-expected))


# -- numbers drawn at random ---------------------------------------------------------------------


def by_signal(model: Model) -> np.ndarray:
    return np.concatenate([np.ravel(np.asarray(s.value, float)) for s in model.p])


def random_law(random: np.random.Generator) -> Law:
    """Any law whose force never falls with speed."""
    forward, backward = random.uniform(0.1, 5, 2)
    return [Coulomb(forward, backward), Viscous(forward), Spike()][int(random.integers(3))]


def random_worm(seed: int) -> tuple[Model, dict[str, np.ndarray], np.random.Generator]:
    random = np.random.default_rng(seed)
    links = int(random.integers(1, 9))
    sizes = {"mass": links + 1, "drag": links + 1, "load": links + 1, "stiffness": links,
             "damping": links, "rest_length": links}  # fmt: skip
    numbers: dict[str, Any] = {
        name: 10 ** random.uniform(-1, 1, size) for name, size in sizes.items()
    }
    laws = [random_law(random) for _ in range(links + 1)]
    return chain(links, law=laws, **numbers), numbers, random


@patient
@given(seed=seeds)
def test_gain_has_its_sign_and_zeros_are_those_of_the_zero_dynamics(seed: int):
    """The poles of the linearised zero dynamics are the invariant zeros of the linear chain."""
    model, numbers, random = random_worm(seed)
    form = normal_form(model, output="length", internal=INTERNAL)
    assert form.sign() == "positive definite"
    speed, v_reg = float(random.normal()), float(random.uniform(0.05, 1.0))
    still = form.zero_dynamics()
    rest = linearise(still, output=(), x={"center_velocity": speed}, v_reg=v_reg)
    whole = linearise(model, output="length", x={"velocity": speed}, v_reg=v_reg)
    assert rest.poles.real == pytest.approx(whole.zeros.real, rel=1e-7, abs=1e-9)
    # laws whose force falls nowhere: the zero lies left of -(sum k) / (sum m), the place at 0
    slowest = -numbers["drag"].sum() / numbers["mass"].sum()
    assert rest.poles[0].real <= slowest * (1 - 1e-9)
    assert whole.phase_kind == "minimum phase"


def test_held_lengths_are_followed_by_the_whole_chain():
    """Zero dynamics against the chain itself, its lengths held by u = -Gamma^-1 b."""
    worm = chain(3, mass=[1.0, 2.0, 0.5, 1.5], stiffness=8.0, damping=2.0, rest_length=1.0,
                 drag=[0.1, 0.4, 0.2, 0.3], load=0.2)  # fmt: skip
    form = normal_form(worm, output="length", internal=INTERNAL)
    u = pack(worm.u)
    ode = ca.substitute(worm.ode, u, -ca.solve(form.gain, form.drift))
    held = replace(worm, u=(), ode=ode, outputs=())
    whole = simulate(held, 2.0, x0={"velocity": 1.5})
    rest = simulate(form.zero_dynamics(), 2.0, x0={"center_of_mass": 0.0, "center_velocity": 1.5})
    assert whole["velocity"][:, -1] == pytest.approx([rest["center_velocity"][0, -1]] * 4, rel=1e-9)
    assert -np.diff(whole["position"][:, -1]) == pytest.approx([1.0] * 3, abs=1e-9)


def test_falling_friction_is_not_minimum_phase():
    """Stribeck friction falls with speed: two motions with the lengths held part at first."""
    worm = chain(2, mass=1.0, stiffness=8.0, damping=2.0, rest_length=1.0,
                 law=Stribeck(1.0, 10.0, 2.0, 20.0, v_stribeck=0.5))  # fmt: skip
    still = normal_form(worm, output="length", internal=INTERNAL).zero_dynamics()
    x0 = {"center_of_mass": 0.0}
    slower, faster = (
        simulate(still, 0.1, contact=Smooth(0.01), x0={**x0, "center_velocity": v})
        for v in (0.3, 0.31)
    )
    ends = [m["center_velocity"][0, -1] for m in (slower, faster)]
    assert ends[1] - ends[0] > 0.01


# -- other models, and what is refused -----------------------------------------------------------


def pendulum_cart() -> Model:
    """A rod that a force at its cart swings, with the angle or the cart's place as output."""
    x, v, a, w, u = (ca.SX.sym(name) for name in "xvawu")
    gain = 1 / (1 + ca.sin(a) ** 2)
    force = (u + ca.sin(a) * (w**2 - 9.81 * ca.cos(a))) * gain
    swing = 9.81 * ca.sin(a) - ca.cos(a) * force
    return Model(
        "cart with a rod",
        x=[Signal("x", x, value=0.0), Signal("v", v, value=0.0), Signal("a", a, value=0.3),
           Signal("w", w, value=0.0)],
        ode=ca.vertcat(v, force, w, swing),
        u=[Signal("u", u)],
        outputs=[Output("place", x), Output("sum", w + ca.cos(a) * v), Output("drift", v),
                 Output("tip", x + ca.sin(a))],
    )  # fmt: skip


def test_a_gain_that_depends_on_the_state():
    form = normal_form(pendulum_cart(), output="place", internal=["a", "sum"])
    assert form.gain_at() == pytest.approx(1 / (1 + np.sin(0.3) ** 2))
    assert form.gain_at(x={"a": 1.0}) == pytest.approx(1 / (1 + np.sin(1.0) ** 2))
    assert form.sign() == "positive definite"
    swung = normal_form(pendulum_cart(), output="a")
    assert swung.sign() == "negative definite"
    assert swung.sign(x={"a": 2.0}) == "positive definite"
    assert abs(swung.gain_at(x={"a": np.pi / 2}).item()) < 1e-15  # of either sign
    with pytest.raises(ValueError, match="not affine"):
        form.zero_dynamics()


def test_walls_are_kept_where_they_are():
    """A wall on mass 0 at x = 3; with the length held at 1 the tail is 1 behind it."""
    worm = chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0, law=Coulomb(1.0, 2.0))
    x, push = worm["position"], ca.SX.sym("push")
    contacts = [replace(worm.contacts[0], gap=3 - x[0], normal_force=push), worm.contacts[1]]
    form = normal_form(replace(worm, contacts=contacts), output="length", internal=INTERNAL)
    still = form.zero_dynamics([1.0])
    gap = still.contacts[0].gap
    assert gap is not None
    assert still.contacts[1].gap is None
    symbols = [pack(still.x), pack(still.p)]
    found = ca.Function("gap", symbols, [gap])([2.0, 0.0], by_signal(still))
    assert float(found) == pytest.approx(0.5)  # the centre at 2, so the head at 2.5


def test_what_has_no_such_form_is_refused():
    worm = form_of(2).model
    with pytest.raises(ValueError, match="act directly on y'"):
        normal_form(worm, output="rate")
    with pytest.raises(ValueError, match="1 outputs for 2 inputs"):
        normal_form(worm, output="center_of_mass")
    with pytest.raises(ValueError, match="act directly on eta'"):
        normal_form(worm, output="length", internal="velocity")
    with pytest.raises(ValueError, match="act directly on eta'"):
        normal_form(pendulum_cart(), output="place", internal=["a", "w"])
    with pytest.raises(ValueError, match="the relative degree is not two"):
        normal_form(chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0),
                    output="center_of_mass")  # fmt: skip
    with pytest.raises(KeyError, match="size"):
        normal_form(worm, output="size")
    with pytest.raises(ValueError, match="name more in internal="):
        normal_form(worm, output="length").zero_dynamics()
    with pytest.raises(ValueError, match="name fewer"):
        normal_form(worm, output="length", internal=["position", *INTERNAL]).zero_dynamics()
    doubled = Output("doubled", ca.SX(2) * worm["center_of_mass"][:, [0, 0]].T)
    twice = normal_form(replace(worm, outputs=[*worm.outputs, doubled]), output="length",
                        internal="doubled")  # fmt: skip
    with pytest.raises(ValueError, match="do not determine"):
        twice.zero_dynamics()
    with pytest.raises(ValueError, match="held must be one number or 2"):
        normal_form(worm, output="length", internal=INTERNAL).zero_dynamics([1.0, 2.0, 3.0])
    cubed = pendulum_cart()
    u = pack(cubed.u)
    with pytest.raises(ValueError, match="not affine in the inputs"):
        normal_form(replace(cubed, ode=ca.substitute(cubed.ode, u, u**3)), output="place")
