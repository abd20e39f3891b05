"""`average`: closed forms, brute-force quadrature, derivatives, the change of variables."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from averaged_models import (
    COULOMB,
    EPS,
    OMEGA,
    block,
    differences,
    rates_of,
    slopes_of,
    smooth,
    steps,
)
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import root_scalar

from wormopt.analysis.average import _turned, average
from wormopt.control.drive import drive
from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law, Stribeck, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Contact, Model, Signal, pack
from wormopt.model.values import signal_values
from wormopt.numerics.expressions import Call
from wormopt.simulation.simulate import simulate
from wormopt.systems.pair.exact import magnetic_pair
from wormopt.systems.pair.slow import averaged_pair, from_slow, slow_pair, to_slow
from wormopt.systems.swinging.prescribed import harmonic_masses

NU = OMEGA + 0.5 * EPS

STRIBECK = Stribeck(
    0.4 * EPS, 0.7 * EPS, stick_forward=0.9 * EPS, stick_backward=1.5 * EPS, v_stribeck=0.3
)

WIDE = Stribeck(0.004, 0.007, stick_forward=0.009, stick_backward=0.015, v_stribeck=2.0)

VISCOUS = Viscous(0.3 * EPS)


# -- the second route: no symbolic crossings, no fixed nodes --------------------------------------


class Brute:
    """Means of a model over a period by adaptive quadrature between reversals found by search."""

    def __init__(self, model: Model, laws: Sequence[Law], period: float) -> None:
        self.model, self.laws, self.period = model, laws, period
        scheduled = [s for each in model.schedules for s in (each.begin, each.symbol)]
        given = [model.t, pack(model.x), ca.vertcat(ca.SX(0, 1), *scheduled), pack(model.p)]
        ode, velocities = ca.densify(model.ode), ca.densify(model.contact_velocities)
        self._ode = Call(ca.Function("f", [*given, model.forces], [ode]))
        self._velocity = Call(ca.Function("v", given, [velocities]))
        self._p = signal_values(model.p, None, "parameter")

    def _scheduled(self, t: float) -> np.ndarray:
        found = []
        for schedule in self.model.schedules:
            begin, piece = schedule.locate(np.array([t]))
            found += [begin, schedule.values[piece[0]]]
        return np.concatenate([np.zeros(0), *found])

    def velocities(self, x: np.ndarray, t: float) -> np.ndarray:
        return self._velocity(t, x, self._scheduled(t), self._p)[0].copy()

    def rate(self, x: np.ndarray, t: float, signs: np.ndarray) -> np.ndarray:
        slips = [
            float(law.slip_force(v, 1 if sign > 0 else -1))
            for law, v, sign in zip(self.laws, self.velocities(x, t), signs, strict=True)
        ]
        return self._ode(t, x, self._scheduled(t), self._p, np.array(slips))[0].copy()

    def pieces(
        self, state: Callable[[float], np.ndarray], also: Sequence[float] = ()
    ) -> list[tuple[float, float, np.ndarray]]:
        """From, to, and directions between, along states that may depend on time."""
        places = [*also, *(self.model.breaks(self.period) if self.model.schedules else ())]
        grid = np.linspace(0.0, self.period, 301)
        v = np.array([self.velocities(state(t), t) for t in grid])
        for i in range(v.shape[1]):
            for k in np.flatnonzero(v[:-1, i] * v[1:, i] < 0):
                bracket = (float(grid[k]), float(grid[k + 1]))
                found = root_scalar(
                    lambda t, i=i: self.velocities(state(t), t)[i],
                    bracket=bracket, xtol=1e-300, rtol=1e-15,
                )  # fmt: skip
                places += [found.root]
        edges = np.unique([0.0, *places, self.period])
        middles = (edges[:-1] + edges[1:]) / 2
        return [
            (a, b, np.sign(self.velocities(state(m), m)))
            for a, b, m in zip(edges[:-1], edges[1:], middles, strict=True)
        ]

    def mean(self, x: Any) -> np.ndarray:
        """First order."""
        y, total = np.asarray(x, float), np.zeros(self.model.n_x)
        for a, b, signs in self.pieces(lambda _: y):
            for k in range(len(y)):
                part = quad(
                    lambda t, k=k, signs=signs: self.rate(y, t, signs)[k], a, b,
                    epsabs=1e-15, epsrel=1e-13, limit=200,
                )  # fmt: skip
                total[k] += part[0]
        return total / self.period

    def swing(self, x: np.ndarray) -> Callable[[float], np.ndarray]:
        """The periodic part u without mean, by Chebyshev series between reversals."""
        series, start, total = [], np.zeros(len(x)), np.zeros(len(x))
        mean = self.mean(x)
        for a, b, signs in self.pieces(lambda _: x):
            own = [
                np.polynomial.Chebyshev.interpolate(
                    lambda ts, k=k, signs=signs:
                        np.array([self.rate(x, t, signs)[k] - mean[k] for t in ts]),
                    80, domain=[a, b],
                ).integ(lbnd=a)
                for k in range(len(x))
            ]  # fmt: skip
            own = [c + s for c, s in zip(own, start, strict=True)]
            start = np.array([c(b) for c in own])
            total += [c.integ(lbnd=a)(b) for c in own]
            series.append((b, own))

        def value(t: float) -> np.ndarray:
            own = next((own for b, own in series if t <= b), series[-1][1])
            return np.array([c(t) for c in own]) - total / self.period

        return value

    def second(self, x: Any, step: float) -> np.ndarray:
        """Second order: how the mean along x + d u(t) changes with d, reversals and all."""
        y = np.asarray(x, float)
        u, bends = self.swing(y), [a for a, _, _ in self.pieces(lambda _: y)]

        def mean(d: float) -> np.ndarray:
            total = np.zeros(len(y))
            nodes, weights = np.polynomial.legendre.leggauss(40)
            for a, b, signs in self.pieces(lambda t: y + d * u(t), bends):
                for node, weight in zip(nodes, weights, strict=True):
                    t = (a + b) / 2 + (b - a) / 2 * node
                    total += weight * (b - a) / 2 * self.rate(y + d * u(t), t, signs)
            return total / self.period

        # u bends where contacts reverse, so that all powers of the step are there
        steps = step / 2.0 ** np.arange(5)
        table = [(mean(h) - mean(-h)) / (2 * h) for h in steps]
        for order in range(1, len(table)):
            table = [near + (near - far) / (2**order - 1) for far, near in pairwise(table)]
        return table[0]


# -- the pair -------------------------------------------------------------------------------------


def random_states(count: int, seed: int, low: float, high: float) -> np.ndarray:
    """States of the pair with V / (a Omega) between two bounds."""
    random = np.random.default_rng(seed)
    a, lag = random.uniform(0.2, 1.0, count), random.uniform(-np.pi, np.pi, count)
    share = random.uniform(low, high, count)
    return np.stack([share * a * OMEGA, a * np.cos(lag), a * np.sin(lag)], axis=1)


PAIR: dict[str, Any] = {"push": EPS, "frequency": NU}


def averaged(model: Model, order: Any = 1, **options: Any) -> Model:
    frequency = next(signal.symbol for signal in model.p if signal.name == "frequency")
    return average(model, 2 * np.pi / frequency, order=order, **options)


@pytest.mark.parametrize(("low", "high"), [(-0.999, 0.999), (1.001, 2.0), (-2.0, -1.001)])
def test_the_pair_averages_to_its_closed_form(low: float, high: float):
    by_tool = rates_of(averaged(slow_pair(law=COULOMB, **PAIR)))
    by_hand = rates_of(averaged_pair(law=COULOMB, **PAIR))
    for x in random_states(40, 1, low, high):
        assert by_tool(x) == pytest.approx(by_hand(x), rel=0, abs=1e-13 * EPS)


def test_one_model_serves_all_parameters():
    model = averaged(slow_pair(law=COULOMB, **PAIR))
    other: dict[str, Any] = {"mass": 2.0, "stiffness": 3.0, "push": 0.02, "frequency": 1.8}
    by_hand = averaged_pair(law=Coulomb(0.003, 0.011), **other)
    changed = {**other, "friction_forward": 0.003, "friction_backward": 0.011}
    for x in random_states(5, 2, -1.5, 1.5):
        expected = rates_of(by_hand)(x)
        assert rates_of(model, **changed)(x) == pytest.approx(expected, rel=1e-13, abs=1e-16)


@pytest.mark.parametrize("laws", [
    [STRIBECK, STRIBECK], [VISCOUS, VISCOUS], [COULOMB, STRIBECK], [VISCOUS, COULOMB],
    [Coulomb(0.2 * EPS, 0.9 * EPS), Coulomb(0.7 * EPS, 0.3 * EPS)],
])  # fmt: skip
@pytest.mark.parametrize(
    "cosines", [pytest.param((1.0, 1.0), marks=pytest.mark.slow), (1.0, 1.0, 0.5, 0.2)]
)
def test_other_laws_and_fields_by_brute_force(laws: list[Law], cosines: tuple[float, ...]):
    model = slow_pair(law=laws, cosines=cosines, **PAIR)
    found, brute = rates_of(averaged(model)), Brute(model, laws, 2 * np.pi / NU)
    # the force of Stribeck's law is a Gauss curve of the velocity: 16 nodes are not exact
    bound = 1e-7 if STRIBECK in laws else 1e-13
    finer = rates_of(averaged(model, nodes=48))
    for x in random_states(3, 3, -1.4, 1.4):
        expected = brute.mean(x)
        assert found(x) == pytest.approx(expected, rel=0, abs=bound * EPS)
        assert finer(x) == pytest.approx(expected, rel=0, abs=2e-13 * EPS)


def test_higher_harmonics_of_the_field_do_not_matter_to_first_order_but_to_second():
    fields = (0.0, 1.0), (1.0, 1.0, 0.5, 0.2)
    plain, rich = (slow_pair(law=COULOMB, cosines=cosines, **PAIR) for cosines in fields)
    (x,) = random_states(1, 4, 0.3, 0.5)
    one, two = (rates_of(averaged(model))(x) for model in (plain, rich))
    assert one == pytest.approx(two, rel=0, abs=1e-16)
    one, two = (rates_of(averaged(model, 2))(x) for model in (plain, rich))
    assert np.abs(one - two).max() > 0.01 * EPS**2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("laws", "cosines"),
    [
        ([COULOMB, COULOMB], (1.0, 1.0)),
        ([Coulomb(0.2 * EPS, 0.9 * EPS), VISCOUS], (1.0, 1.0, 0.5, 0.2)),
        ([STRIBECK, COULOMB], (0.3, 1.0, 0.5)),
    ],
)
def test_second_order_of_the_pair_by_brute_force(laws: list[Law], cosines: tuple[float, ...]):
    model = slow_pair(law=laws, cosines=cosines, **PAIR)
    first, second = (rates_of(averaged(model, order, nodes=32)) for order in (1, 2))
    brute = Brute(model, laws, 2 * np.pi / NU)
    for x in random_states(1, 5, -0.8, 0.8):
        expected, found = brute.second(x, 0.2), second(x) - first(x)
        assert np.abs(expected).max() > 0.02 * EPS**2
        assert found == pytest.approx(expected, rel=0, abs=1e-6 * np.abs(expected).max())


def gait_of(*, jumps: bool) -> Gait:
    """A field that repeats with the frequency NU, with corners, or with jumps."""
    period = 2 * np.pi / NU
    high = [[[1.0, 0.0]], [[0.2, 0.9]], [[-0.4, 0.1]]] if jumps else [
        [[0.0, 3.0]], [[period, -2.0]], [[period / 2, -0.5]]
    ]  # fmt: skip
    return Gait(np.array([0.0, 0.3, 0.55, 1.0]) * period, np.array(high))


@pytest.mark.parametrize("jumps", [True, False])
@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_fields_that_follow_a_schedule_by_brute_force(jumps: bool, order: int):
    laws = [COULOMB, Coulomb(0.3 * EPS, 0.4 * EPS)]
    plant = slow_pair(law=laws, cosines=None, **PAIR)
    model = drive(plant, gait_of(jumps=jumps), periodic=True)
    assert model.schedules
    brute = Brute(model, laws, 2 * np.pi / NU)
    first = rates_of(average(model, 2 * np.pi / NU))
    for x in random_states(2, 6, -0.9, 1.3):
        if order == 1:
            assert first(x) == pytest.approx(brute.mean(x), rel=0, abs=2e-13 * EPS)
            continue
        if abs(x[0]) > 0.95 * OMEGA * np.hypot(*x[1:]):
            continue
        found = rates_of(average(model, 2 * np.pi / NU, order=2, nodes=32))(x) - first(x)
        expected = brute.second(x, 0.2)
        assert found == pytest.approx(expected, rel=0, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("turns", [2, 3])
def test_a_period_may_be_several_of_the_schedules(turns: int):
    plant = slow_pair(law=COULOMB, cosines=None, **PAIR)
    model = drive(plant, gait_of(jumps=True), periodic=True)
    (x,) = random_states(1, 7, 0.2, 0.4)
    once = rates_of(average(model, 2 * np.pi / NU))(x)
    # reversals are one harmonic of the period; of several periods they are a higher one
    several = rates_of(average(model, turns * 2 * np.pi / NU))
    assert several(x) == pytest.approx(once, rel=0, abs=1e-13 * EPS)


@pytest.mark.parametrize("turns", [1, 7, 60])
def test_steps_are_averaged_by_how_long_they_last(turns: int):
    """As often as they may repeat in a period, and where some step together but for round-off."""
    x, both = ca.SX.sym("x"), [steps(0.1, 0.7), replace(steps(0.1 * (1 + 1e-14), 0.7), name="pull")]
    pushes = both[0].symbol + 3 * both[1].symbol
    model = Model("pushed", [Signal("x", x)], pushes - x, schedules=both)
    found = average(model=model, period=0.7 * turns)
    assert rates_of(found)([0.25]) == pytest.approx(-4 * 5 / 7 - 0.25, rel=1e-12)


@pytest.mark.parametrize("ulps", range(-3, 4))
def test_a_reversal_where_a_schedule_steps_is_one(ulps: int):
    """cos(t) reverses at a quarter, where the push turns from EPS to -EPS."""
    push = steps(np.pi / 2 + ulps * np.spacing(np.pi / 2), 2 * np.pi)
    pushed = block(ode=lambda v, t, f: f + EPS * push.symbol, schedules=[push])
    friction = (1.0 - 0.5) / 2  # of COULOMB, forward half of the time
    expected = EPS * (friction + 0.25 - 0.75)
    assert rates_of(average(pushed, 2 * np.pi))([0.0]) == pytest.approx(expected, rel=1e-12)


def test_a_reversal_where_the_period_begins_is_no_two():
    """v + sin(t) at v = 0, forward in the first half, where friction counts 1 + sin(t) / 2."""
    model = block(velocity=lambda v, t: v + ca.sin(t), ode=lambda v, t, f: f * (1 + ca.sin(t) / 2))
    more = 1 / (2 * np.pi)
    expected = EPS * (-0.5 * (0.5 + more) + 1.0 * (0.5 - more))  # of COULOMB
    for v in (-1e-14, 0.0, 1e-14):
        found = rates_of(average(model, 2 * np.pi))([v])
        assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("v", [-1.5, -1.0, 1.0, 1.5])
def test_where_nothing_reverses_friction_is_that_of_the_law(v: float):
    """Also where the velocity touches 0."""
    for law, force, slope in (
        (COULOMB, (-0.5 if v > 0 else 1.0) * EPS, 0.0),
        (VISCOUS, -0.3 * EPS * v, -0.3 * EPS),
    ):
        model = average(block(law), 2 * np.pi)
        (x,) = model.x
        slopes = ca.Function("slopes", [x.symbol], [model.ode, ca.jacobian(model.ode, x.symbol)])
        assert np.ravel(slopes(v)) == pytest.approx([force, slope], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_averages_do_not_depend_on_the_unit_of_velocity(unit: float):
    """Forward for two thirds of the time; or half, if the ground's velocity is all there is."""
    shaken = average(block(velocity=lambda v, t: v + unit * ca.cos(t)), 2 * np.pi)
    assert rates_of(shaken)([unit / 2]) == pytest.approx(0.0, abs=1e-12 * EPS)
    alone = average(block(velocity=lambda v, t: unit * ca.cos(t)), 2 * np.pi)
    assert rates_of(alone)([unit / 2]) == pytest.approx(EPS / 4, rel=1e-12)


# -- several harmonics ----------------------------------------------------------------------------


def shaped(law: Law, cosines: Any, sines: Any) -> Model:
    """A block on ground that shakes with several harmonics, and is pushed besides."""
    t, v, f, scale = (ca.SX.sym(n) for n in ("t", "v", "f", "scale"))
    order = ca.DM(np.arange(1, len(cosines) + 1))
    shape = ca.dot(ca.DM(cosines), ca.cos(order * t)) + ca.dot(ca.DM(sines), ca.sin(order * t))
    contact = Contact("block", v + scale * shape, f, law)
    rate = f + EPS * ca.sin(t) + EPS * v * ca.cos(2 * t)
    p = [Signal("scale", scale, value=1.0)]
    return Model("shaken block", x=[Signal("v", v)], ode=rate, p=p, t=t, contacts=[contact])


def forward_share(v: float, harmonics: np.ndarray) -> float:
    """Share of the period in which v + Re sum_k c_k exp(2 pi i k theta) is positive."""
    roots = np.roots(np.concatenate([harmonics[::-1], [2 * v], harmonics.conj()]))
    ends = np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-6]) / (2 * np.pi) % 1.0
    ends = np.sort(np.concatenate([[0.0], ends, [1.0]]))
    middles, order = (ends[1:] + ends[:-1]) / 2, np.arange(1, len(harmonics) + 1)
    ahead = v + np.real(np.exp(2j * np.pi * np.outer(middles, order)) @ harmonics) > 0
    return float(np.diff(ends) @ ahead)


@settings(max_examples=examples(4))
@given(st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_shapes_drawn_at_random_slide_forward_as_long_as_their_roots_say(n: int, seed: int):
    """Also where a narrow peak is all that reverses."""
    random = np.random.default_rng(seed)
    cosines, sines = random.normal(size=(2, n))
    rates = rates_of(average(shaped(COULOMB, cosines, sines), 2 * np.pi), scale=1.0)
    harmonics = cosines - 1j * sines
    course = np.exp(2j * np.pi * np.outer(np.arange(4096) / 4096, np.arange(1, n + 1)))
    w = np.real(course @ harmonics)
    for v in (*random.uniform(-w.max(), -w.min(), 8), -w.max() - 0.003 * w.min()):
        share = forward_share(v, harmonics)
        assert rates([v])[0] == pytest.approx(EPS * (1 - 1.5 * share), abs=1e-9 * EPS)


SHAPES = [
    ((0.0, 1.0), (1.0, 0.4)),
    ((0.3, -0.7, 0.4), (0.9, 0.2, -0.5)),
    ((0.0, 0.0, 1.0), (0.5, 0.0, 0.0)),
    ((1.0, 0.5, 0.25, 0.125, 0.1), (-0.3, 0.8, 0.0, 0.6, 0.2)),
    ((-1.0, 0.0, -0.2), (0.0, 0.0, 0.0)),
]


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("law", [COULOMB, VISCOUS, WIDE])
def test_several_harmonics_by_brute_force(shape: tuple[list[float], list[float]], law: Law):
    model = shaped(law, *shape)
    nodes = 80 if law is WIDE else 20  # of 5 harmonics in one piece, where nothing reverses
    found, brute = rates_of(average(model, 2 * np.pi, nodes=nodes)), Brute(model, [law], 2 * np.pi)
    largest = np.abs(np.hypot(*shape)).sum()
    for v in np.linspace(-1.05, 1.05, 8) * largest:
        assert found([v]) == pytest.approx(brute.mean([v]), rel=0, abs=5e-13 * EPS)


@pytest.mark.parametrize(
    "shape", [SHAPES[0], *(pytest.param(s, marks=pytest.mark.slow) for s in SHAPES[1:])]
)
def test_second_order_of_several_harmonics_by_brute_force(shape: Any):
    model = shaped(COULOMB, *shape)
    first, second = (rates_of(average(model, 2 * np.pi, order=order)) for order in (1, 2))
    brute = Brute(model, [COULOMB], 2 * np.pi)
    for v in (-0.11, 0.23):
        expected, found = brute.second([v], 0.05), second([v]) - first([v])
        assert np.abs(expected).max() > 1e-3 * EPS**2
        assert found == pytest.approx(expected, rel=0, abs=2e-5 * np.abs(expected).max())


def test_slope_and_curvature_of_mean_friction_are_exact():
    """Friction of 1 backward: its mean is 1 - t/pi where v + g is 0 at t and -t, g as below."""
    averaged = average(shaped(Coulomb(0.0, 1.0), [1.0, 0.1], [0.0, 0.0]), 2 * np.pi)
    v, at = averaged.x[0].symbol, 1.0
    g, slope, curvature = (
        np.array(of) @ (1.0, 0.1)
        for of in ((np.cos(at), np.cos(2 * at)), (-np.sin(at), -2 * np.sin(2 * at)),
                   (-np.cos(at), -4 * np.cos(2 * at)))
    )  # fmt: skip
    first, second = -1 / slope, -curvature / slope**3
    mean = averaged.ode
    found = ca.Function("found", [v, *(p.symbol for p in averaged.p)],
                        [mean, ca.jacobian(mean, v), ca.hessian(mean, v)[0]])  # fmt: skip
    values = [float(value) for value in found(-g, *np.ones(len(averaged.p)))]
    assert values == pytest.approx([1 - at / np.pi, -first / np.pi, -second / np.pi], rel=1e-10)


def test_a_shaking_that_is_still_for_now_may_begin_later():
    shaken = shaped(Coulomb(0.5, 1.0), *SHAPES[1])
    still = replace(shaken, p=[replace(shaken.p[0], value=0.0)])
    found, expected = (rates_of(average(m, 2 * np.pi), scale=0.8) for m in (still, shaken))
    assert found([0.1]) == pytest.approx(expected([0.1]), rel=1e-13)


@pytest.mark.parametrize("place", [-1e-17, -0.25, 0.0, 0.75, 1.0 - 2**-53, 1.0, 2.5])
def test_places_of_reversals_lie_within_one_period(place: float):
    turned = float(ca.evalf(_turned(ca.SX(place))))
    assert 0.0 <= turned < 1.0
    assert (turned - place) == pytest.approx(round(turned - place), abs=1e-15)


# -- derivatives ----------------------------------------------------------------------------------


PLACES = [(0.2, 0.3, -0.4), (0.9, 0.3, 0.4), (-0.3, -0.2, 0.3), (-1.1, -0.2, 0.3)]
# both reverse at once: v_1 = V - z' and v_2 = V + z' at V = 0
AT_ONCE = [(0.0, 0.3, -0.4), (0.0, 0.5, 0.0)]


@pytest.mark.parametrize(
    ("laws", "x", "order"),
    [
        *product([COULOMB, [VISCOUS, COULOMB]], [*PLACES[:2], *AT_ONCE], [1]),
        *product([[VISCOUS, COULOMB]], PLACES[:2], [2]),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (
                *product([STRIBECK], [*PLACES, *AT_ONCE], [1]),
                *product([COULOMB, [VISCOUS, COULOMB]], PLACES[2:], [1]),
                *product([COULOMB], PLACES[:3], [2]),
            )
        ),
    ],
)
def test_derivatives_by_finite_differences(laws: Any, x: tuple[float, ...], order: int):
    # enough nodes that errors of quadrature, which are not smooth there, do not show
    model = averaged(slow_pair(law=laws, **PAIR), order, nodes=32)
    expected = differences(rates_of(model), np.array(x))
    assert slopes_of(model)(x) == pytest.approx(expected, rel=0, abs=1e-9 * EPS)


@pytest.mark.parametrize("v", [-0.9, -0.2, 0.4, 1.7, 2.5])
def test_derivatives_with_several_harmonics(v: float):
    model = average(shaped(WIDE, *SHAPES[1]), 2 * np.pi)
    expected = differences(rates_of(model), np.array([v]))
    assert slopes_of(model)([v]) == pytest.approx(expected, rel=0, abs=1e-8 * EPS)


# -- the change of variables ----------------------------------------------------------------------


def test_both_forms_of_the_pair_move_alike():
    settings_: dict[str, Any] = {"law": COULOMB, "push": EPS, "frequency": NU}
    x0, v0 = np.array([-0.2, 0.3]), np.array([0.05, 0.25])
    t = np.linspace(0.0, 60.0, 121)
    there = simulate(magnetic_pair(**settings_), 60.0, x0={"position": x0, "velocity": v0}, times=t)
    begin = to_slow(0.0, x0, v0, frequency=NU)
    x0_slow = {name: begin[name] for name in ("center_velocity", "swing")}
    slow = simulate(slow_pair(**settings_), 60.0, times=t, x0=x0_slow)
    expected = to_slow(t, there["position"], there["velocity"], frequency=NU)
    assert slow["center_velocity"][0] == pytest.approx(expected["center_velocity"], abs=1e-9)
    assert slow["swing"] == pytest.approx(expected["swing"], abs=1e-9)
    center = expected["center"]
    back = from_slow(t, slow["center_velocity"][0], slow["swing"], center=center, frequency=NU)
    assert back["position"] == pytest.approx(there["position"], abs=1e-9)
    assert back["velocity"] == pytest.approx(there["velocity"], abs=1e-9)
    assert sum(event.kind == "reversal" for event in there.events) > 40


sizes = st.floats(-5, 5)


@given(
    st.tuples(sizes, sizes), st.tuples(sizes, sizes), st.floats(0, 100), st.floats(0.1, 5),
    st.floats(0.1, 5),
)  # fmt: skip
def test_slow_variables_go_there_and_back(x: Any, v: Any, t: float, nu: float, omega: float):
    frame = {"frequency": nu, "natural_frequency": omega}
    slow = to_slow(t, x, v, **frame)
    back = from_slow(t, **slow, **frame)
    assert back["position"] == pytest.approx(np.array(x), abs=1e-12)
    assert back["velocity"] == pytest.approx(np.array(v), abs=1e-11)
    again = to_slow(t, back["position"], back["velocity"], **frame)
    for name, value in slow.items():
        assert again[name] == pytest.approx(value, abs=1e-11)


def test_a_pair_with_dimensions_is_the_scaled_one():
    # lengths in l0, times in sqrt(m/c), forces in c l0
    m, c, length = 3e-3, 3.0345, 29e-3
    time, force = math.sqrt(m / c), c * length
    real: dict[str, Any] = {
        "law": Coulomb(0.5 * EPS * force, EPS * force), "push": EPS * force,
        "frequency": NU / time, "mass": m, "stiffness": c,
    }  # fmt: skip
    plain, scaled = magnetic_pair(law=COULOMB, **PAIR), magnetic_pair(**real)
    t = np.linspace(0.0, 80.0, 41)
    one, other = simulate(plain, 80.0, times=t), simulate(scaled, 80.0 * time, times=t * time)
    assert other["position"] / length == pytest.approx(one["position"], abs=1e-9)
    assert other["velocity"] * time / length == pytest.approx(one["velocity"], abs=1e-9)
    averages, big = (averaged(slow_pair(**g), 2) for g in ({"law": COULOMB, **PAIR}, real))
    (x,) = random_states(1, 9, 0.3, 0.6)
    units = np.array([length / time, length, length])
    expected = rates_of(averages)(x) * units / time
    assert rates_of(big)(x * units) == pytest.approx(expected, rel=1e-12, abs=1e-16)


def test_masses_of_one_phase_are_one_block():
    """N masses average to what their blocks do, each for itself."""
    pair = harmonic_masses([1.0, -1.0], [0.0, 0.0], law=COULOMB)
    alone = rates_of(average(block(), 2 * np.pi))
    both = rates_of(averaged(pair))
    for V in (-1.3, -0.4, 0.0, 0.5, 0.99):
        assert both([V]) == pytest.approx(alone([V]), abs=1e-16)


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.37, 0.8])
def test_extrema_of_three_and_five_fold_do_not_hide_reversals(shift: float):
    """cos t - cos(2t) / 4 is flat at its top: (cos t < 1 - sqrt(3/2)) is where it is below 0."""
    below = 1 - math.acos(1 - math.sqrt(1.5)) / math.pi
    turn, size = 2 * math.pi * shift * np.array([1, 2]), np.array([1, -1 / 4])
    shaken = shaped(Coulomb(0.0, EPS), size * np.cos(turn), size * np.sin(turn))
    mean = rates_of(average(shaken, 2 * math.pi))([0.0])
    assert mean[0] / EPS == pytest.approx(below, abs=1e-9)


@pytest.mark.parametrize("size", [1e-13, 1.0, 1e6])
def test_what_does_not_repeat_is_refused_whatever_its_size(size: float):
    with pytest.raises(ArgumentError, match="does not repeat"):
        average(smooth(lambda x, t, m: [size * t], "x"), 2 * math.pi)
    with pytest.raises(ArgumentError, match="does not repeat"):
        average(smooth(lambda x, t, m: [size * m.cos(t)], "x"), 3.0)
