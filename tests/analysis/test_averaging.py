"""`average`: closed forms, brute-force quadrature, textbook problems, refusals."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import root_scalar

from wormopt.analysis.average import average
from wormopt.analysis.crossings import _turned
from wormopt.control.drive import drive
from wormopt.errors import ArgumentError
from wormopt.model.delay import Delay
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Contact, Model, Output, Signal, Switch, pack
from wormopt.model.planar_friction import Elliptic
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values
from wormopt.simulation.call import Call
from wormopt.simulation.simulate import simulate
from wormopt.systems.pair.averaged import averaged_pair
from wormopt.systems.pair.exact import magnetic_pair
from wormopt.systems.pair.slow import from_slow, slow_pair, to_slow
from wormopt.systems.swinging.prescribed import harmonic_masses

EPS, OMEGA = 0.01, math.sqrt(2)
NU = OMEGA + 0.5 * EPS
COULOMB = Coulomb(0.5 * EPS, 1.0 * EPS)
STRIBECK = Stribeck(
    0.4 * EPS, 0.7 * EPS, stick_forward=0.9 * EPS, stick_backward=1.5 * EPS, v_stribeck=0.3
)
WIDE = Stribeck(0.004, 0.007, stick_forward=0.009, stick_backward=0.015, v_stribeck=2.0)
VISCOUS = Viscous(0.3 * EPS)


def rates_of(model: Model, **p: Any) -> Callable[[Sequence[float]], np.ndarray]:
    """Right-hand side of an averaged model as a function of its states."""
    assert not model.contacts
    assert not model.schedules
    function = ca.Function("rates", [pack(model.x), pack(model.p)], [model.ode])
    values = signal_values(model.p, p, "parameter")
    return lambda x: np.array(function(x, values)).ravel()


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
        slips = np.array(
            [
                float(law.slip_force(v, 1 if sign > 0 else -1))
                for law, v, sign in zip(self.laws, self.velocities(x, t), signs, strict=True)
            ]
        )
        return self._ode(t, x, self._scheduled(t), self._p, slips)[0].copy()

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
                    lambda ts, k=k, signs=signs: np.array(
                        [self.rate(x, t, signs)[k] - mean[k] for t in ts]
                    ),
                    80,
                    domain=[a, b],
                ).integ(lbnd=a)
                for k in range(len(x))
            ]
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


def slowly(value: Any) -> Any:
    """A case that takes long."""
    return pytest.param(value, marks=pytest.mark.slow)


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


@pytest.mark.parametrize(
    "laws",
    [
        [STRIBECK, STRIBECK],
        [VISCOUS, VISCOUS],
        [COULOMB, STRIBECK],
        [VISCOUS, COULOMB],
        [Coulomb(0.2 * EPS, 0.9 * EPS), Coulomb(0.7 * EPS, 0.3 * EPS)],
    ],
    ids=["stribeck", "viscous", "dry and stribeck", "viscous and dry", "two dry ones"],
)
@pytest.mark.parametrize("cosines", [(1.0, 1.0), (1.0, 1.0, 0.5, 0.2)])
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
    laws = [COULOMB, COULOMB]
    plain, rich = (
        slow_pair(law=laws, cosines=c, **PAIR) for c in ((0.0, 1.0), (1.0, 1.0, 0.5, 0.2))
    )
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
    ids=["dry", "viscous and dry", "stribeck and dry"],
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
@pytest.mark.parametrize("order", [1, slowly(2)])
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


def steps(break_at: float, span: float) -> Schedule:
    """1, then -1."""
    c, begin = ca.SX.sym("c"), ca.SX.sym("begin")
    breaks, values = np.array([0.0, break_at, span]), np.array([[1.0], [-1.0]])
    return Schedule("push", c, begin, breaks, values, periodic=True)


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


def shaped(law: Law, cosines: Sequence[float], sines: Sequence[float]) -> Model:
    """A block on ground that shakes with several harmonics, and is pushed besides."""
    t, v, f, scale = (ca.SX.sym(n) for n in ("t", "v", "f", "scale"))
    order = ca.DM(np.arange(1, len(cosines) + 1))
    shape = ca.dot(ca.DM(cosines), ca.cos(order * t)) + ca.dot(ca.DM(sines), ca.sin(order * t))
    contact = Contact("block", v + scale * shape, f, law)
    return Model(
        "shaken block",
        x=[Signal("v", v)],
        ode=f + EPS * ca.sin(t) + EPS * v * ca.cos(2 * t),
        p=[Signal("scale", scale, value=1.0)],
        t=t,
        contacts=[contact],
    )


def forward_share(v: float, harmonics: np.ndarray) -> float:
    """Share of the period in which v + Re sum_k c_k exp(2 pi i k theta) is positive."""
    roots = np.roots(np.concatenate([harmonics[::-1], [2 * v], harmonics.conj()]))
    ends = np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-6]) / (2 * np.pi) % 1.0
    ends = np.sort(np.concatenate([[0.0], ends, [1.0]]))
    middles, order = (ends[1:] + ends[:-1]) / 2, np.arange(1, len(harmonics) + 1)
    ahead = v + np.real(np.exp(2j * np.pi * np.outer(middles, order)) @ harmonics) > 0
    return float(np.diff(ends) @ ahead)


@settings(max_examples=examples(15))
@given(st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_shapes_drawn_at_random_slide_forward_as_long_as_their_roots_say(n: int, seed: int):
    """Also where a narrow peak is all that reverses."""
    random = np.random.default_rng(seed)
    cosines, sines = random.normal(size=(2, n))
    model = average(shaped(COULOMB, cosines.tolist(), sines.tolist()), 2 * np.pi)
    harmonics = cosines - 1j * sines
    course = np.exp(2j * np.pi * np.outer(np.arange(4096) / 4096, np.arange(1, n + 1)))
    w = np.real(course @ harmonics)
    rates = rates_of(model, scale=1.0)
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
@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "law",
    [COULOMB, pytest.param(VISCOUS, marks=pytest.mark.slow), WIDE],
    ids=["dry", "viscous", "stribeck"],
)
def test_several_harmonics_by_brute_force(shape: tuple[list[float], list[float]], law: Law):
    model = shaped(law, *shape)
    nodes = 80 if law is WIDE else 20  # of 5 harmonics in one piece, where nothing reverses
    found, brute = rates_of(average(model, 2 * np.pi, nodes=nodes)), Brute(model, [law], 2 * np.pi)
    largest = np.abs(np.hypot(*shape)).sum()
    for v in np.linspace(-1.05, 1.05, 8) * largest:
        assert found([v]) == pytest.approx(brute.mean([v]), rel=0, abs=5e-13 * EPS)


@pytest.mark.parametrize("shape", [SHAPES[0], *(slowly(shape) for shape in SHAPES[1:])])
def test_second_order_of_several_harmonics_by_brute_force(shape: Any):
    model = shaped(COULOMB, *shape)
    first, second = (rates_of(average(model, 2 * np.pi, order=order)) for order in (1, 2))
    brute = Brute(model, [COULOMB], 2 * np.pi)
    for v in (-0.11, 0.23):
        expected, found = brute.second([v], 0.05), second([v]) - first([v])
        assert np.abs(expected).max() > 1e-3 * EPS**2
        assert found == pytest.approx(expected, rel=0, abs=2e-5 * np.abs(expected).max())


@settings(max_examples=examples(24))
@given(
    st.lists(st.floats(-1, 1), min_size=2, max_size=4),
    st.lists(st.floats(-1, 1), min_size=2, max_size=4),
    st.floats(-2, 2),
    st.floats(0.1, 3),
)
def test_reversals_of_random_shapes(cos: list[float], sin: list[float], v: float, scale: float):
    """The mean of Coulomb's friction is the share of time backward: counted on a fine grid."""
    count = min(len(cos), len(sin))
    cosines, sines = np.round([cos[:count], sin[:count]], 3)
    if np.hypot(cosines, sines).max() < 0.1:
        return
    model = shaped(Coulomb(0.0, 1.0), cosines.tolist(), sines.tolist())
    found = rates_of(average(model, 2 * np.pi), scale=scale)([v])[0]
    t = (np.arange(40_000) + 0.5) / 40_000 * 2 * np.pi
    turn = np.outer(np.arange(1, count + 1), t)
    values = v + scale * (cosines @ np.cos(turn) + sines @ np.sin(turn))
    # every reversal is within a point of the grid, and so is a dip that falls between two points
    bound = (2 * count + 2) / len(t)
    assert found == pytest.approx(np.mean(values < 0), abs=bound)


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
    law = Coulomb(0.5, 1.0)
    still = shaped(law, [0.3, -0.7, 0.4], [0.9, 0.2, -0.5])
    still = replace(still, p=[replace(still.p[0], value=0.0)])
    shaken = shaped(law, [0.3, -0.7, 0.4], [0.9, 0.2, -0.5])
    found, expected = (rates_of(average(m, 2 * np.pi), scale=0.8) for m in (still, shaken))
    assert found([0.1]) == pytest.approx(expected([0.1]), rel=1e-13)


@pytest.mark.parametrize("place", [-1e-17, -0.25, 0.0, 0.75, 1.0 - 2**-53, 1.0, 2.5])
def test_places_of_reversals_lie_within_one_period(place: float):
    turned = float(ca.evalf(_turned(ca.SX(place))))
    assert 0.0 <= turned < 1.0
    assert (turned - place) == pytest.approx(round(turned - place), abs=1e-15)


# -- smooth problems of textbooks -----------------------------------------------------------------


def smooth(ode: Callable[..., Any], names: str, eps: float = EPS) -> Model:
    """A model without contacts, x' = eps f(x, t)."""
    t, *x = (ca.SX.sym(name) for name in ("t", *names.split()))
    rates = ca.vertcat(*ode(*x, t, ca))
    return Model("smooth", x=[Signal(str(s), s) for s in x], ode=eps * rates, t=t)


class Turning:
    """Cosines and sines as polynomials in w = exp(i t) and 1/w."""

    w = sp.Symbol("w")

    def cos(self, order: Any) -> Any:
        return (self.w**order + self.w**-order) / 2

    def sin(self, order: Any) -> Any:
        return (self.w**order - self.w**-order) / (2 * sp.I)


def powers(expression: Any) -> dict[int, Any]:
    """Coefficients of the powers of w."""
    found: dict[int, Any] = {}
    for term in sp.Add.make_args(sp.expand(expression)):
        rest, power = term.as_independent(Turning.w)
        n = 0 if power == 1 else int(power.as_base_exp()[1])
        found[n] = found.get(n, 0) + rest
    return found


def by_sympy(ode: Callable[..., Any], names: str) -> tuple[Any, Any, tuple[Any, ...]]:
    """Mean of f, and mean of (df/dx) u with u the integral of f less its mean, without mean."""
    x = sp.symbols(f"{names},", real=True)
    f = sp.Matrix(ode(*x, 1, Turning()))
    swings = [powers(rate) for rate in f]
    u = sp.Matrix(
        [sum(c / (sp.I * n) * Turning.w**n for n, c in own.items() if n) for own in swings]
    )
    first = sp.Matrix([own.get(0, 0) for own in swings])
    second = sp.Matrix([powers(rate).get(0, 0) for rate in f.jacobian(x) * u])
    return first, second, x


def numbers_of(expression: Any, values: dict[Any, float]) -> np.ndarray:
    found = [complex(entry.subs(values).evalf(20)) for entry in expression]
    assert max(abs(number.imag) for number in found) < 1e-15
    return np.array([number.real for number in found])


def growing(x: Any, t: Any, m: Any) -> list[Any]:
    return [x * m.sin(t) + m.cos(t) + x**2 * m.sin(2 * t) - x / 3]


def van_der_pol(p: Any, q: Any, t: Any, m: Any) -> list[Any]:
    """z'' + z = eps (1 - z^2) z' with z = p cos(t) + q sin(t)."""
    z, rate = p * m.cos(t) + q * m.sin(t), q * m.cos(t) - p * m.sin(t)
    force = (1 - z**2) * rate
    return [-force * m.sin(t), force * m.cos(t)]


def spun(p: Any, q: Any, t: Any, m: Any) -> list[Any]:
    return [p * q * m.cos(t) + m.sin(t) ** 2 * q, p**2 * m.sin(t) - q * m.cos(t) + m.cos(3 * t)]


@pytest.mark.parametrize(
    ("ode", "names"), [(growing, "x"), (van_der_pol, "p q"), (spun, "p q")],
    ids=["growing", "van der Pol", "spun"],
)  # fmt: skip
def test_smooth_problems_against_symbolic_averages(ode: Any, names: str):
    first, second, symbols = by_sympy(ode, names.replace(" ", ","))
    model = smooth(ode, names)
    one, two = (rates_of(average(model, 2 * np.pi, order=order)) for order in (1, 2))
    random = np.random.default_rng(8)
    for x in random.uniform(-2, 2, (5, len(symbols))):
        values = dict(zip(symbols, x, strict=True))
        f1, f2 = (numbers_of(expression, values) for expression in (first, second))
        assert one(x) == pytest.approx(EPS * f1, rel=0, abs=1e-14)
        assert two(x) - one(x) == pytest.approx(EPS**2 * f2, rel=0, abs=1e-15)
        assert np.abs(f2).max() > 1e-3


def test_the_limit_cycle_of_van_der_pol_is_slower_by_a_sixteenth():
    # Lindstedt: amplitude 2, frequency 1 - eps^2 / 16
    two = rates_of(average(smooth(van_der_pol, "p q"), 2 * np.pi, order=2))
    for phase in (0.0, 1.0):
        p, q = 2 * np.cos(phase), 2 * np.sin(phase)
        rate = two([p, q])
        assert (p * rate[1] - q * rate[0]) / 4 == pytest.approx(EPS**2 / 16, rel=1e-10)
        assert (p * rate[0] + q * rate[1]) / 4 == pytest.approx(0.0, abs=1e-16)


def test_the_second_tongue_of_mathieu_has_its_known_edges():
    # z'' + (1 + d + eps cos t) z = 0 is at its limits of stability for d = 5 eps^2/12, -eps^2/12
    eps = 1e-3
    for edge, row in ((5 / 12, 0), (-1 / 12, 1)):

        def mathieu(p: Any, q: Any, t: Any, m: Any, edge: float = edge) -> list[Any]:
            z = p * m.cos(t) + q * m.sin(t)
            force = -(edge * eps + m.cos(t)) * z
            return [-force * m.sin(t), force * m.cos(t)]

        averages = average(smooth(mathieu, "p q", eps), 2 * np.pi, order=2)
        slopes = ca.Function("A", [pack(averages.x)], [ca.jacobian(averages.ode, pack(averages.x))])
        matrix = np.array(slopes([0.3, 0.4]))
        # the other entry stays, of the size of the width of the tongue: half of 5/12 + 1/12
        still, other = sorted(np.abs([matrix[0, 1], matrix[1, 0]]))
        assert still < 2 * eps**3
        assert other == pytest.approx(eps**2 / 4, rel=5e-3)
        assert np.abs([matrix[0, 0], matrix[1, 1]]).max() < 1e-16
        assert np.abs(matrix[row, 1 - row]) in (pytest.approx(still), pytest.approx(other))


# -- a block with dry friction, by hand -----------------------------------------------------------


def pushed_block(push: float) -> Model:
    t, v, f = (ca.SX.sym(n) for n in ("t", "v", "f"))
    ground = Contact("block", v + ca.cos(t), f, COULOMB)
    return Model("block", x=[Signal("v", v)], ode=f + push * ca.sin(t), t=t, contacts=[ground])


def block_by_sympy() -> tuple[Any, Any, tuple[Any, ...]]:
    """Mean friction on shifted pieces, differentiated by the shift."""
    t, V, F, B, g, d = sp.symbols("t V F B g d", real=True)
    turn = sp.acos(-V)  # forward for |t| < turn
    first = (-F * turn + B * (sp.pi - turn)) / sp.pi
    ahead, behind = -F - first, B - first  # rates of u
    # u from t = -turn on, over both pieces, and then without its mean
    begin = sp.Symbol("u0")
    on = begin + ahead * (t + turn) + g * (sp.cos(turn) - sp.cos(t))
    at = on.subs(t, turn)
    off = at + behind * (t - turn) + g * (sp.cos(turn) - sp.cos(t))
    area = sp.integrate(on, (t, -turn, turn)) + sp.integrate(off, (t, turn, 2 * sp.pi - turn))
    begin_value = sp.solve(sp.Eq(area, 0), begin)[0]
    # v + d u + cos(t) = 0 at turn + d s: u - sin(turn) s = 0, and at -turn: u + sin(turn) s = 0
    late = at.subs(begin, begin_value) / sp.sin(turn)
    early = -begin_value / sp.sin(turn)
    forward = (turn + d * late) - (-turn + d * early)
    mean = (-F * forward + B * (2 * sp.pi - forward)) / (2 * sp.pi)
    return first, sp.diff(mean, d), (V, F, B, g)


def test_the_pushed_block_against_shifted_pieces():
    first, second, symbols = block_by_sympy()
    push = 0.8 * EPS
    model = pushed_block(push)
    one, two = (rates_of(average(model, 2 * np.pi, order=order)) for order in (1, 2))
    for V in (-0.9, -0.3, 0.0, 0.25, 0.7):
        values = dict(zip(symbols, (V, 0.5 * EPS, EPS, push), strict=True))
        assert one([V])[0] == pytest.approx(float(first.subs(values)), abs=1e-16)
        expected = float(second.subs(values))
        assert two([V])[0] - one([V])[0] == pytest.approx(expected, abs=1e-17)
        # what is left when all is said: the push shifts both reversals alike
        short = -1.5 * EPS * push * V / (np.pi * np.sqrt(1 - V**2))
        assert expected == pytest.approx(short, abs=1e-17)


def zero_of(function: Callable[[float], float]) -> float:
    return root_scalar(function, bracket=(0.2, 0.8), xtol=1e-300, rtol=1e-14).root


def orders(errors: Sequence[float], sizes: Sequence[float]) -> np.ndarray:
    return np.diff(np.log(errors)) / np.diff(np.log(sizes))


def test_errors_of_the_pushed_block_have_the_orders_promised():
    # periodic motion of the block itself: reversals by root search, nothing integrated numerically
    sizes, errors = (0.08, 0.04, 0.02, 0.01), {1: [], 2: []}
    for eps in sizes:
        law, push = Coulomb(0.5 * eps, eps), 0.8 * eps
        t, v, f = (ca.SX.sym(n) for n in ("t", "v", "f"))
        x = ca.SX.sym("x")
        moving = Model(
            "block",
            x=[Signal("x", x, value=0.0), Signal("v", v)],
            ode=ca.vertcat(v, f + push * ca.sin(t)),
            t=t,
            contacts=[Contact("block", v + ca.cos(t), f, law)],
        )
        slow = Model("block", x=[moving.x[1]], ode=moving.ode[1], t=t, contacts=moving.contacts)

        def over_a_period(V: float, moving: Model = moving) -> np.ndarray:
            return simulate(moving, 2 * np.pi, x0={"v": V}).end

        start = zero_of(lambda V: over_a_period(V)[1] - V)
        exact = over_a_period(start)[0] / (2 * np.pi)
        for order in (1, 2):
            rate = rates_of(average(slow, 2 * np.pi, order=order))
            steady = zero_of(lambda V, rate=rate: rate([V])[0])
            errors[order].append(abs(exact - steady))
    assert orders(errors[1], sizes) == pytest.approx(1.0, abs=0.15)
    assert orders(errors[2], sizes) == pytest.approx(2.0, abs=0.25)
    assert errors[1][-1] < 0.5 * sizes[-1]
    assert errors[2][-1] < 1.0 * sizes[-1] ** 2


# -- derivatives ----------------------------------------------------------------------------------


def slopes_of(model: Model) -> Callable[[Sequence[float]], np.ndarray]:
    x = pack(model.x)
    function = ca.Function("slopes", [x, pack(model.p)], [ca.jacobian(model.ode, x)])
    values = signal_values(model.p, None, "parameter")
    return lambda state: np.array(function(state, values))


def differences(rates: Callable[[Any], np.ndarray], x: np.ndarray, h: float = 1e-4) -> np.ndarray:
    """Derivatives by central differences of fourth order."""
    columns = []
    for k in range(len(x)):
        e = np.eye(len(x))[k] * h
        near, far = rates(x + e) - rates(x - e), rates(x + 2 * e) - rates(x - 2 * e)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T


@pytest.mark.parametrize("laws", [COULOMB, STRIBECK, [VISCOUS, COULOMB]],
                         ids=["dry", "stribeck", "mixed"])  # fmt: skip
@pytest.mark.parametrize(
    "x", [(0.2, 0.3, -0.4), (0.0, 0.3, -0.4), (0.9, 0.3, 0.4), (-1.1, -0.2, 0.3), (0.0, 0.5, 0.0)],
    ids=["within", "both reverse at once", "beyond", "beyond, backward", "at the start"],
)  # fmt: skip
def test_derivatives_by_finite_differences(laws: Any, x: tuple[float, ...]):
    # both reverse at once: v_1 = V - z' and v_2 = V + z' at V = 0
    check_derivatives(laws, x, 1)


@pytest.mark.parametrize("laws", [COULOMB, [VISCOUS, COULOMB]], ids=["dry", "mixed"])
@pytest.mark.parametrize("x", [(0.2, 0.3, -0.4), (0.9, 0.3, 0.4), (-0.3, -0.2, 0.3)])
def test_derivatives_of_the_second_order(laws: Any, x: tuple[float, ...]):
    check_derivatives(laws, x, 2)


def check_derivatives(laws: Any, x: tuple[float, ...], order: int) -> None:
    # enough nodes that errors of quadrature, which are not smooth there, do not show
    model = averaged(slow_pair(law=laws, **PAIR), order, nodes=32)
    expected = differences(rates_of(model), np.array(x))
    assert slopes_of(model)(x) == pytest.approx(expected, rel=0, abs=1e-9 * EPS)


@pytest.mark.parametrize("v", [-0.9, -0.2, 0.4, 1.7, 2.5])
def test_derivatives_with_several_harmonics(v: float):
    model = average(shaped(WIDE, *SHAPES[1]), 2 * np.pi)
    expected = differences(rates_of(model), np.array([v]))
    assert slopes_of(model)([v]) == pytest.approx(expected, rel=0, abs=1e-8 * EPS)


# -- refusals -------------------------------------------------------------------------------------


def block(law: Law = COULOMB, velocity: Any = None, ode: Any = None, **more: Any) -> Model:
    t, v, f = (ca.SX.sym(n) for n in ("t", "v", "f"))
    speed = v + ca.cos(t) if velocity is None else velocity(v, t)
    rate = f if ode is None else ode(v, t, f)
    contacts = [Contact("block", speed, f, law)]
    return Model("a block", x=[Signal("v", v)], ode=rate, t=t, contacts=contacts, **more)


def switching() -> Model:
    return block(switches=[Switch("flip", ca.SX(-1.0), ca.SX.zeros(1))])


def with_z() -> Model:
    z = ca.SX.sym("z")
    return block(z=[Signal("z", z)], alg=z - 1)


def scheduled(velocity: bool, periodic: bool = True, span: float = 2 * np.pi) -> Model:
    push = replace(steps(0.4 * span, span), periodic=periodic)
    c = push.symbol
    if velocity:
        return block(velocity=lambda v, t: v + c * ca.cos(t), schedules=[push])
    return block(ode=lambda v, t, f: f + EPS * c, schedules=[push])


def scheduled_over(T: ca.SX) -> Model:
    """A schedule, and a parameter for the period besides."""
    model = scheduled(False)
    return replace(model, p=[*model.p, Signal("T", T, value=2 * np.pi)])


def of_two_factors() -> Model:
    """The mix of two harmonics is a state."""
    t, f = ca.SX.sym("t"), ca.SX.sym("f")
    v = ca.SX.sym("v", 2)
    speed = v[0] + ca.cos(t) + v[1] * ca.sin(2 * t)
    contacts = [Contact("block", speed, f, COULOMB)]
    return Model("a block", x=[Signal("v", v)], ode=ca.vertcat(f, f), t=t, contacts=contacts)


def of_a_hidden_harmonic() -> Model:
    """A parameter that is 0 now, and a second harmonic if it is not."""
    a = ca.SX.sym("a")
    return block(
        velocity=lambda v, t: v + ca.cos(t) + a * ca.cos(2 * t), p=[Signal("a", a, value=0.0)]
    )


def lagging() -> Model:
    """x' = -x(t - 1)."""
    x, past = ca.SX.sym("x"), ca.SX.sym("past")
    return Model("lagging", [Signal("x", x)], -past, delays=[Delay("past", past, x, 1.0)])


def in_the_plane() -> Model:
    """A block on ground that resists in all directions."""
    t, v, f = ca.SX.sym("t"), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    grounds = [Contact("block", v + ca.cos(t), f, Elliptic(1.0, 1.0, 1.0))]
    return Model("a block", [Signal("v", v)], f, t=t, contacts=grounds)


MODEL_OF_A_STATE, SYMBOL = block(), ca.SX.sym("T")
REFUSED: dict[str, tuple[Callable[[], Any], Any, str]] = {
    "no model": (lambda: "block", 2 * np.pi, "must be a Model, not str"),
    "spikes": (lambda: block(Spike()), 2 * np.pi, "block cannot slide both ways"),
    "contacts in the plane": (in_the_plane, 2 * np.pi, "block moves in the plane"),
    "delays": (lagging, 2 * np.pi, "delay"),
    "switches": (switching, 2 * np.pi, "a block has switches"),
    "algebraic": (with_z, 2 * np.pi, "algebraic variables"),
    "secular": (
        lambda: block(ode=lambda v, t, f: f + t), 2 * np.pi, "does not repeat after the period"
    ),
    "begins to repeat": (
        lambda: block(ode=lambda v, t, f: f + ca.fmax(t - 7.5, 0)), 2 * np.pi, "does not repeat"
    ),
    "wrong period": (block, 6.0, "does not repeat after the period"),
    "half a period": (block, np.pi, "does not repeat after the period"),
    "velocity from a schedule": (
        lambda: scheduled(True), 2 * np.pi, "the velocity of block follows a schedule"
    ),
    "schedule that ends": (lambda: scheduled(False, False), 2 * np.pi, "does not repeat"),
    "schedule of another period": (
        lambda: scheduled(False, True, 5.0), 2 * np.pi, "push does not repeat with the period"
    ),
    "none of a schedule's periods": (
        lambda: scheduled(False), 1e-12, "push does not repeat with the period"
    ),
    "period of a parameter beside a schedule": (
        lambda: scheduled_over(SYMBOL), SYMBOL, "push does not repeat with the period"
    ),
    "shape of states": (of_two_factors, 2 * np.pi, "ratios depend on the states"),
    "shape of parameters": (of_a_hidden_harmonic, 2 * np.pi, "ratios depend on the states"),
    "no swing": (lambda: block(velocity=lambda v, t: v), 2 * np.pi, "block does not swing"),
    "no velocity": (
        lambda: block(velocity=lambda v, t: ca.SX(0)), 2 * np.pi, "block does not swing"
    ),
    "corners": (
        lambda: block(velocity=lambda v, t: v + ca.fabs(ca.sin(t))), 2 * np.pi, "at most 31"
    ),
    "harmonics above 31": (
        lambda: block(velocity=lambda v, t: v + ca.cos(32 * t)), 2 * np.pi, "at most 31"
    ),
    "harmonics that pass for lower ones": (
        lambda: block(velocity=lambda v, t: v + ca.cos(33 * t)), 2 * np.pi, "at most 31"
    ),
    "harmonics that pass for a mean": (
        lambda: block(velocity=lambda v, t: v + ca.cos(64 * t)), 2 * np.pi, "at most 31"
    ),
    "harmonics that pass for one there is": (
        lambda: block(velocity=lambda v, t: v + ca.cos(t) + ca.cos(65 * t) / 2), 2 * np.pi,
        "at most 31",
    ),
    "zero": (block, 0.0, "period must be a positive number"),
    "no single number": (block, ca.SX.sym("T", 2), "period must be a positive number"),
    "period of a state": (
        lambda: MODEL_OF_A_STATE, 2 * np.pi / MODEL_OF_A_STATE.x[0].symbol, "expression of param"
    ),
    "no number": (block, "long", "period must be a positive number"),
    "negative": (block, -2 * np.pi, "period must be a positive number"),
    "infinite": (block, math.inf, "period must be a positive number"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_average_is_refused(case: str):
    make, period, message = REFUSED[case]
    with pytest.raises(ArgumentError, match=message):
        average(make(), period)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"order": 3}, "order must be 1 or 2, not 3"), ({"order": "1"}, "order must be"),
     ({"nodes": 0}, "nodes must be"), ({"nodes": 2.5}, "nodes must be"),
     ({"nodes": True}, "nodes must be")],
)  # fmt: skip
def test_options_that_cannot_be_are_refused(options: Any, message: str):
    with pytest.raises(ArgumentError, match=message):
        average(block(), 2 * np.pi, **options)


def test_thirty_one_harmonics_are_allowed():
    """cos(31 t) > -1/2 for two thirds of the time."""
    model = block(Coulomb(0.0, EPS), velocity=lambda v, t: v + ca.cos(31 * t))
    assert rates_of(average(model, 2 * np.pi))([0.5]) == pytest.approx(EPS / 3, rel=1e-12)


def test_one_node_on_every_eighth_of_the_period_sees_eight_middles():
    """There cos(8 t) is -1, and cos(k t) of another k adds up to 0; by 16 nodes its mean is 0."""
    for k in range(1, 16):
        model = smooth(lambda x, t, m, k=k: [m.cos(k * t)], "x", eps=1.0)
        found = rates_of(average(model, 2 * np.pi, nodes=1))([0.0])
        assert found == pytest.approx(-1.0 if k == 8 else 0.0, abs=1e-14)
        assert rates_of(average(model, 2 * np.pi))([0.0]) == pytest.approx(0.0, abs=1e-14)


def test_sixteen_nodes_are_taken_if_nothing_is_said():
    model = smooth(lambda x, t, m: [1 / (1.01 + m.cos(t))], "x", eps=1.0)
    usual = rates_of(average(model, 2 * np.pi))([0.0])
    fewer, asked, more = (
        rates_of(average(model, 2 * np.pi, nodes=nodes))([0.0]) for nodes in (15, 16, 17)
    )
    assert usual == asked
    assert fewer != asked != more


def test_what_stands_still_has_the_mean_0_and_numbers_may_come_later():
    """x' = 0 y, y' = cos(t) / m - y, where nothing is said of m."""
    t, x, m = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("m")
    rates = ca.vertcat(0, ca.cos(t) / m - x[1])
    model = Model("block", [Signal("x", x)], rates, t=t, p=[Signal("m", m)])
    found = average(model, 2 * np.pi)
    mean = ca.Function("mean", [x, m], [found.ode])([3.0, 5.0], 2.0)
    assert np.array(mean).ravel() == pytest.approx([0.0, -5.0], abs=1e-14)
    still = Model("block", [Signal("x", x)], ca.SX.zeros(2))
    assert average(still, 1.0).ode.is_zero()


def test_only_outputs_without_time_are_kept():
    t, v = ca.SX.sym("t"), ca.SX.sym("v")
    outputs = [Output("slow", 2 * v), Output("fast", v + ca.cos(t))]
    model = Model("block", x=[Signal("v", v)], ode=EPS * ca.cos(t) * v, t=t, outputs=outputs)
    assert [output.name for output in average(model, 2 * np.pi).outputs] == ["slow"]


@pytest.mark.parametrize("shift", [-1e-17, 0.0, 1e-17])
def test_reversals_where_the_period_begins_count_once(shift: float):
    def velocity(v: Any, t: Any) -> Any:
        return v + ca.sin(t + shift)

    model = block(velocity=velocity, ode=lambda v, t, f: f + EPS * ca.cos(t))
    one, two = (average(model, 2 * np.pi, order=order) for order in (1, 2))
    h = 1e-3
    for average_ in (one, two):
        slope = slopes_of(average_)([0.0])
        rates = rates_of(average_)
        assert slope == pytest.approx(differences(rates, np.zeros(1), h), abs=1e-6 * EPS)
    assert rates_of(two)([0.0]) == pytest.approx(rates_of(two)([1e-9]), abs=1e-9 * EPS)


# -- the change of variables ----------------------------------------------------------------------


def test_both_forms_of_the_pair_move_alike():
    settings_: dict[str, Any] = {"law": COULOMB, "push": EPS, "frequency": NU}
    x0, v0 = np.array([-0.2, 0.3]), np.array([0.05, 0.25])
    t = np.linspace(0.0, 60.0, 121)
    there = simulate(magnetic_pair(**settings_), 60.0, x0={"position": x0, "velocity": v0}, times=t)
    begin = to_slow(0.0, x0, v0, frequency=NU)
    slow = simulate(
        slow_pair(**settings_), 60.0, times=t,
        x0={"center_velocity": begin["center_velocity"], "swing": begin["swing"]},
    )  # fmt: skip
    expected = to_slow(t, there["position"], there["velocity"], frequency=NU)
    assert slow["center_velocity"][0] == pytest.approx(expected["center_velocity"], abs=1e-9)
    assert slow["swing"] == pytest.approx(expected["swing"], abs=1e-9)
    back = from_slow(
        t, slow["center_velocity"][0], slow["swing"], center=expected["center"],
        frequency=NU,
    )  # fmt: skip
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
    plain = magnetic_pair(law=Coulomb(0.5 * EPS, EPS), push=EPS, frequency=NU)
    scaled = magnetic_pair(
        law=Coulomb(0.5 * EPS * force, EPS * force), push=EPS * force, frequency=NU / time,
        mass=m, stiffness=c,
    )  # fmt: skip
    t = np.linspace(0.0, 80.0, 41)
    one, other = simulate(plain, 80.0, times=t), simulate(scaled, 80.0 * time, times=t * time)
    assert other["position"] / length == pytest.approx(one["position"], abs=1e-9)
    assert other["velocity"] * time / length == pytest.approx(one["velocity"], abs=1e-9)
    averages = averaged(slow_pair(law=COULOMB, **PAIR), 2)
    big = averaged(
        slow_pair(
            law=Coulomb(0.5 * EPS * force, EPS * force), push=EPS * force, frequency=NU / time,
            mass=m, stiffness=c,
        ),
        2,
    )  # fmt: skip
    (x,) = random_states(1, 9, 0.3, 0.6)
    units = np.array([length / time, length, length])
    expected = rates_of(averages)(x) * units / time
    assert rates_of(big)(x * units) == pytest.approx(expected, rel=1e-12, abs=1e-16)


def test_masses_of_one_phase_are_one_block():
    """N masses average to what their blocks do, each for itself."""
    law = Coulomb(0.5 * EPS, EPS)
    pair = harmonic_masses([1.0, -1.0], [0.0, 0.0], law=law)
    alone = rates_of(average(block(law), 2 * np.pi))
    both = rates_of(averaged(pair))
    for V in (-1.3, -0.4, 0.0, 0.5, 0.99):
        assert both([V]) == pytest.approx(alone([V]), abs=1e-16)


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.37, 0.8])
def test_extrema_of_three_and_five_fold_do_not_hide_reversals(shift: float):
    """cos t - cos(2t) / 4 is flat at its top: (cos t < 1 - sqrt(3/2)) is where it is below 0."""
    below = 1 - math.acos(1 - math.sqrt(1.5)) / math.pi
    turn = 2 * math.pi * shift
    cosines = [math.cos(turn), -math.cos(2 * turn) / 4]
    sines = [math.sin(turn), -math.sin(2 * turn) / 4]
    mean = rates_of(average(shaped(Coulomb(0.0, EPS), cosines, sines), 2 * math.pi))([0.0])
    assert mean[0] / EPS == pytest.approx(below, abs=1e-9)


@pytest.mark.parametrize("size", [1e-13, 1.0, 1e6])
def test_what_does_not_repeat_is_refused_whatever_its_size(size: float):
    with pytest.raises(ArgumentError, match="does not repeat"):
        average(smooth(lambda x, t, m: [size * t], "x"), 2 * math.pi)
    with pytest.raises(ArgumentError, match="does not repeat"):
        average(smooth(lambda x, t, m: [size * m.cos(t)], "x"), 3.0)
