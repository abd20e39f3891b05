"""Friction laws: the smooth form tends to the set-valued one, and the chapter's own numbers."""

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law, NoSlip, Spike, Stribeck, Viscous
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Model, Signal, pack
from wormopt.simulation.functions import System
from wormopt.simulation.options import Exact, Smooth

DRY = [
    Coulomb(1.0, 10.0),
    Coulomb(0.5, 2.0, stick_forward=0.8, stick_backward=5.0),
    Stribeck(1.0, 2.0, 1.5, 4.0, v_stribeck=0.3),
    Coulomb(0.0, 0.0),
]
LAWS = [*DRY, Viscous(2.0), Viscous(0.0), Spike(), Spike(3.0)]


def evaluate(law: Law, v: float, v_reg: float) -> float:
    symbol = ca.SX.sym("v")
    return float(ca.Function("f", [symbol], [law.smooth(symbol, v_reg)])(v))


def test_the_chapter_stand_in():
    """F(v) = -(5.5 tanh(40 v) - 4.5): force +4.5 at v = 0, zero at artanh(9/11)/40 = 0.028782."""
    law = Coulomb(1.0, 10.0)
    for v in (-0.3, -0.01, 0.0, 0.02, 0.5):
        assert evaluate(law, v, 1 / 40) == pytest.approx(-(5.5 * math.tanh(40 * v) - 4.5))
    zero = math.atanh(9 / 11) / 40
    assert zero == pytest.approx(0.028782, abs=5e-7)
    assert evaluate(law, zero, 1 / 40) == pytest.approx(0, abs=1e-13)
    assert evaluate(law, zero / 2, 1 / 40) > 0  # it feeds energy in


@pytest.mark.parametrize("law", DRY)
@pytest.mark.parametrize("v", [0.4, -0.4])
def test_smooth_dry_friction_tends_to_the_sliding_force(law: Law, v: float):
    """The rest of tanh is 2 exp(-2 |v| / v_reg): exactly so, and beyond round-off exponentially."""
    exact = float(law.slip_force(v, 1 if v > 0 else -1))
    half_gap = (law.slip_force(v, -1) - law.slip_force(v, 1)) / 2
    for v_reg in (0.2, 0.1, 0.05):
        error = evaluate(law, v, v_reg) - exact
        expected = float(half_gap) * (1 - math.tanh(abs(v) / v_reg))
        assert error == pytest.approx(math.copysign(expected, v), abs=1e-14)
    assert evaluate(law, v, 0.01) == pytest.approx(exact, abs=1e-14)


@pytest.mark.parametrize("scale", [1.0, 5.0])
def test_the_smooth_spike_lets_go_with_first_order_and_holds_in_the_limit(scale: float):
    """Ahead it carries scale v_reg / (4 v) in the limit, behind scale |v| / v_reg: unbounded."""
    law, v = Spike(scale), 0.3
    v_regs = [1e-2, 5e-3, 2.5e-3]
    ahead = np.array([evaluate(law, v, r) for r in v_regs])
    slopes = np.log2(ahead[:-1] / ahead[1:])
    assert np.all((slopes > 0.99) & (slopes < 1.01))
    assert ahead == pytest.approx([scale * r / (4 * v) for r in v_regs], rel=1e-2)
    behind = np.array([evaluate(law, -v, r) for r in v_regs])
    assert behind == pytest.approx([scale * v / r for r in v_regs], rel=1e-2)
    assert evaluate(law, -0.75 * 0.1, 0.1) == pytest.approx(scale)  # what scale means
    # The velocity at which it carries a given load tends to 0: the spike is rigid in the limit.
    load = 7.0
    for v_reg in v_regs:
        ratio = load / scale
        held = v_reg * (1 / (4 * ratio) - ratio)  # of scale (sqrt(v^2 + r^2) - v) / (2 r) = load
        assert evaluate(law, held, v_reg) == pytest.approx(load, rel=1e-9)


@given(v=st.floats(-1, 1), v_reg=st.floats(1e-3, 1))
def test_smooth_laws_are_monotone_bounded_and_passive_where_they_should_be(v: float, v_reg: float):
    for law in (DRY[0], DRY[1]):
        force = evaluate(law, v, v_reg)
        low, high = law.slip_force(v, 1), law.slip_force(v, -1)
        assert low <= force <= high
        assert evaluate(law, v + 0.01, v_reg) <= force + 1e-12
    for spike in (Spike(), Spike(3.0)):
        assert evaluate(spike, v, v_reg) >= 0
        assert evaluate(spike, v + 0.01, v_reg) <= evaluate(spike, v, v_reg)
    assert evaluate(Viscous(2.0), v, v_reg) == pytest.approx(-2 * v)


@given(
    forward=st.floats(0, 5), extra=st.floats(0, 5), v_stribeck=st.floats(0.01, 2), v=st.floats(0, 3)
)
def test_stribeck_falls_from_stiction_to_sliding(
    forward: float, extra: float, v_stribeck: float, v: float
):
    law = Stribeck(forward, 1.0, forward + extra, 1.5, v_stribeck)
    force = -float(law.slip_force(v, 1))
    assert force == pytest.approx(forward + extra * math.exp(-((v / v_stribeck) ** 2)))
    assert float(law.slip_force(0.0, 1)) == law.stick_interval[0]
    assert float(law.slip_force(0.0, -1)) == law.stick_interval[1]


@pytest.mark.parametrize(
    ("law", "interval", "directions"),
    [
        (Coulomb(1.0, 10.0), (-1.0, 10.0), (1, -1)),
        (Coulomb(0.5, 2.0, 0.8, 5.0), (-0.8, 5.0), (1, -1)),
        (Coulomb(0.5, 2.0, stick_backward=3.0), (-0.5, 3.0), (1, -1)),
        (Stribeck(1.0, 2.0, 1.5, 4.0, 0.3), (-1.5, 4.0), (1, -1)),
        (Viscous(2.0), (0.0, 0.0), (1, -1)),
        (Spike(), (0.0, math.inf), (1,)),
    ],
)
def test_what_a_contact_can_hold(law: Law, interval: tuple[float, float], directions: tuple):
    assert isinstance(law, Law)
    assert law.stick_interval == interval
    assert law.directions == directions
    low, high = law.stick_interval
    for direction in directions:  # what slides against a direction can be held against it too
        assert low <= float(law.slip_force(0.0, direction)) <= high


@pytest.mark.parametrize("law", LAWS)
def test_sliding_takes_energy_away(law: Law):
    for direction in law.directions:
        for v in (0.01, 0.5, 3.0):
            assert float(law.slip_force(direction * v, direction)) * direction * v <= 0


@pytest.mark.parametrize("v", [-0.23, 0.0, 0.23])
def test_lifted_laws_are_the_laws_once_their_numbers_are_put_in(v: float):
    laws, parameters = lift(LAWS)
    velocity, width, symbols = ca.SX.sym("v"), ca.SX.sym("v_reg"), pack(parameters)
    numbers = np.concatenate([np.array(p.value) for p in parameters])
    for law, lifted in zip(LAWS, laws, strict=True):
        assert isinstance(lifted, Law)
        assert lifted.directions == law.directions
        expressions = [lifted.smooth(velocity, width), *lifted.stick_interval]
        expressions += [lifted.slip_force(velocity, d) for d in law.directions]
        found = ca.Function("f", [velocity, width, symbols], expressions)(v, 0.1, numbers)
        by_number = [law.smooth(v, 0.1), *law.stick_interval]
        by_number += [law.slip_force(v, d) for d in law.directions]
        assert [float(f) for f in found] == [float(b) for b in by_number]


def test_lifting_names_every_number_and_leaves_everything_else():
    class Odd:
        pass

    odd, symbol = Odd(), ca.SX.sym("F")
    laws, parameters = lift([odd, Coulomb(symbol, 3.0), Coulomb(1.0, 2.0, stick_backward=4)])
    assert laws[0] is odd
    assert isinstance(laws[1], Coulomb)
    assert ca.is_equal(laws[1].forward, symbol)
    assert laws[1].stick_forward is None
    assert {p.name: p.value for p in parameters} == {
        "friction_backward": (3.0, 2.0),
        "friction_forward": (1.0,),
        "friction_stick_backward": (4.0,),
    }
    _, parameters = lift([Stribeck(1.0, 2.0, 1.5, 4.0, 0.3), Viscous(1.0), Spike()])
    assert {p.name.removeprefix("friction_"): p.unit for p in parameters} == {
        "forward": "force",
        "backward": "force",
        "stick_forward": "force",
        "stick_backward": "force",
        "v_stribeck": "speed",
        "drag": "drag",
        "scale": "force",
    }
    assert lift([]) == ((), ())


SYMBOL = ca.SX.sym("F")

NAN = float("nan")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Coulomb(-1.0, 1.0), "0 <= sliding"),
        (lambda: Coulomb(1.0, -1.0), "0 <= sliding"),
        (lambda: Coulomb(1.0, 1.0, stick_forward=0.5), "0 <= sliding"),
        (lambda: Coulomb(1.0, 1.0, stick_backward=0.5), "0 <= sliding"),
        (lambda: Coulomb(NAN, 1.0), "0 <= sliding"),
        (lambda: Coulomb(1.0, NAN), "0 <= sliding"),
        (lambda: Stribeck(1.0, 1.0, 0.5, 1.0, 0.1), "0 <= sliding"),
        (lambda: Stribeck(1.0, 1.0, 1.0, 0.5, 0.1), "0 <= sliding"),
        (lambda: Stribeck(-1.0, 1.0, 1.0, 1.0, 0.1), "0 <= sliding"),
        (lambda: Stribeck(1.0, 1.0, 1.0, 1.0, 0.0), "v_stribeck must be positive"),
        (lambda: Stribeck(1.0, 1.0, 1.0, 1.0, NAN), "v_stribeck must be positive"),
        # Numbers beside symbols are checked all the same.
        (lambda: Coulomb(SYMBOL, -1.0), "0 <= sliding"),
        (lambda: Coulomb(SYMBOL, 1.0, stick_forward=-0.5), "0 <= sliding"),
        (lambda: Coulomb(SYMBOL, 1.0, stick_backward=0.5), "0 <= sliding"),
        (lambda: Stribeck(1.0, 1.0, SYMBOL, 0.5, 0.1), "0 <= sliding"),
        (lambda: Stribeck(SYMBOL, SYMBOL, SYMBOL, SYMBOL, -0.1), "v_stribeck must be positive"),
        (lambda: Viscous(-0.1), "must not be negative"),
        (lambda: Viscous(NAN), "must not be negative"),
        (lambda: Spike().slip_force(-0.1, -1), "does not slide backward"),
        (lambda: Spike(0.0), "scale must be positive"),
    ],
)
def test_laws_that_make_no_sense_are_refused(build: Callable[[], object], message: str):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize(
    "build",
    [
        lambda: Coulomb("rough", 1.0),  # type: ignore[arg-type]
        lambda: Coulomb([1.0, 2.0], 1.0),  # type: ignore[arg-type]
        lambda: Viscous([1.0]),  # type: ignore[arg-type]
        lambda: Spike("sharp"),  # type: ignore[arg-type]
    ],
)
def test_numbers_of_laws_are_numbers(build: Callable[[], object]):
    with pytest.raises(ArgumentError, match="must be a number, not"):
        build()


class Rough:
    """A law of a user's own whose formulas are not meant for columns."""

    directions = (1, -1)
    stick_interval = (-2.0, 3.0)

    def slip_force(self, v: ca.SX, direction: int) -> ca.SX:
        return -direction * (2.0 + ca.norm_2(v))

    def smooth(self, v: ca.SX, v_reg: ca.SX) -> ca.SX:
        return -(2.0 + ca.norm_2(v)) * v / ca.norm_2(ca.vertcat(v, v_reg))


def test_forces_of_contacts_that_are_alike_are_those_of_each():
    rough, rng = Rough(), np.random.default_rng(4)
    laws = [Coulomb(1.0, 10.0), rough, Spike(2.0), Coulomb(2.0, 3.0, 4.0, 5.0), rough, Viscous(0.5)]
    laws += [
        NoSlip(3.0),
        Coulomb(0.5, 2.0),
        Spike(),
        Stribeck(1.0, 2.0, 1.5, 4.0, 0.3),
        NoSlip(),
        rough,
    ]
    laws = [*laws, *DRY]
    lifted, parameters = lift(laws[::2])
    mixed = [lifted[k // 2] if k % 2 == 0 else law for k, law in enumerate(laws)]
    n = len(laws)
    v, f, m = ca.SX.sym("v", n), ca.SX.sym("f", n), ca.SX.sym("m", n)
    contacts = [Contact(f"foot {k}", v[k], f[k], law) for k, law in enumerate(mixed)]
    heavy = rng.uniform(1, 2, n)
    mass = Signal("mass", m, value=tuple(heavy))
    pull = rng.uniform(-9, 9, n)
    ode = (f + pull) / m
    feet = Model("feet", [Signal("v", v)], ode, p=[mass, *parameters], contacts=contacts)
    speed = rng.uniform(-1, 1, n)

    smooth = System(feet, Smooth(0.3))
    found = smooth.rhs(0.0, speed, smooth.parameters(None), []).full().ravel()
    right = [evaluate(law, w, 0.3) for law, w in zip(laws, speed.tolist(), strict=True)]
    np.testing.assert_allclose(found, (np.array(right) + pull) / heavy, rtol=1e-14)

    exact = System(feet, Exact())
    assert len(exact.contacts) == n - 2  # drag, and friction of no force, never rest
    modes, free = rng.choice([-1.0, 0.0, 1.0], n - 2), [*map(feet.contacts.index, exact.contacts)]
    told = exact.probe(0.0, speed, exact.parameters(None), modes).full().ravel()
    velocity, _, force, low, high = told[:-1].reshape(5, -1)
    np.testing.assert_array_equal(velocity, speed[free])
    for k, i in enumerate(free):
        law, ways = laws[i], laws[i].directions
        assert (low[k], high[k]) == pytest.approx(tuple(map(float, law.stick_interval)), rel=1e-14)
        way = int(modes[k]) if modes[k] in ways or not modes[k] else (*ways, 0)[0]
        slip = law.slip_force(ca.SX(speed[i]), way) if way else -pull[i]
        resting = modes[k] == 0
        expected = -pull[i] if resting else float(slip) if ways else 0.0
        assert force[k] == pytest.approx(expected, rel=1e-13, abs=1e-13), (i, law, modes[k])


class Wet(Rough):
    """A law of a user's own with a symbol inside that is not among its fields."""

    def __init__(self, drag: ca.SX) -> None:
        self.drag = drag

    def slip_force(self, v: ca.SX, direction: int) -> ca.SX:
        return -direction * 2.0 - self.drag[1] * v

    def smooth(self, v: ca.SX, v_reg: ca.SX) -> ca.SX:
        return -2.0 * ca.tanh(v / v_reg) - self.drag[0] * v


def test_contacts_may_share_a_law_with_symbols_of_its_own():
    v, f, drag = ca.SX.sym("v", 3), ca.SX.sym("f", 3), ca.SX.sym("drag", 2)
    law = Wet(drag)
    contacts = [Contact(f"foot {k}", v[k], f[k], law) for k in range(3)]
    wet = Signal("drag", drag, value=(0.5, 0.25))
    feet = Model("feet", [Signal("v", v)], f, p=[wet], contacts=contacts)
    speed = np.array([0.5, -1.0, 2.0])
    smooth, exact = System(feet, Smooth(0.3)), System(feet, Exact())
    found = smooth.rhs(0.0, speed, smooth.parameters(None), []).full().ravel()
    np.testing.assert_allclose(found, -2 * np.tanh(speed / 0.3) - 0.5 * speed, rtol=1e-14)
    found = exact.rhs(0.0, speed, exact.parameters(None), np.sign(speed)).full().ravel()
    np.testing.assert_allclose(found, -2 * np.sign(speed) - 0.25 * speed, rtol=1e-14)
