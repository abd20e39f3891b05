"""The next order of lubrication: derived by computer algebra, held against flow in two dimensions.

Sizes of two-dimensional flow are those of `by_stokes`, which knows nothing of lubrication.
"""

import math
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from outcomes import refused, value

import wormopt as wo
from tests.oracles.by_stokes import slow_flow
from tests.oracles.by_symbols import unchecked
from wormopt.errors import ArgumentError
from wormopt.systems.film import next_order
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.float import CAPTURE_DELTA, corrected_drift, float_drift
from wormopt.systems.film.next_order import (
    REACH,
    corrected_flow,
    flow_terms,
    surface_correction,
    within_reach,
)
from wormopt.systems.film.shapes import FourierWave

Function: Any = sp.Function  # its types do not say that it makes functions

x, z, C, change = sp.symbols("x z C change")
h = Function("h")(x)
SLOPE, BEND = sp.diff(h, x), sp.diff(h, x, 2)


@cache
def stream() -> tuple[Any, Any, Any]:
    """Stream function of lubrication, what eps² multiplies in the next, its p_x on the ground."""
    F = -3 * (h + C) / h**3
    first = -z + F * (z**3 / 6 - h * z**2 / 2)
    A, B = sp.symbols("A B")
    bent = -2 * sp.diff(first, x, 2, z, 2)  # its fourth derivative by z
    second = sp.expand(bent)
    for _ in range(4):
        second = sp.integrate(second, z)
    second = second + A * z**3 / 6 + B * z**2 / 2
    shear = sp.diff(first, x, 2) + 4 * SLOPE * sp.diff(first, x, z)
    laws = [second - change, sp.diff(second, z, 2) - shear]
    found = sp.solve([law.subs(z, h).doit() for law in laws], [A, B], dict=True)[0]
    return first, second.subs(found), found[A]


def vanishes(expression: Any) -> bool:
    """Whether a sum of products of powers of z, h and its derivatives is 0."""
    return sp.expand(expression.doit()) == 0


def test_both_orders_solve_slow_flow_up_to_eps_to_the_fourth():
    """Only eps² is in the equations, so that the next order is eps² and the one after it eps⁴.

    Each pair holds what eps⁰ and eps² multiply: laplace(f) is f_zz + eps² f_xx, and the shear at
    the surface (1 - eps² h'²) (psi_zz - eps² psi_xx) - 4 eps² h' psi_xz.
    """

    def laplace(low: Any, high: Any) -> tuple[Any, Any]:
        return sp.diff(low, z, 2), sp.diff(high, z, 2) + sp.diff(low, x, 2)

    first, second, _ = stream()
    bend, twist = sp.diff(first, z, 2), sp.diff(first, x, z)
    shear = sp.diff(second, z, 2) - sp.diff(first, x, 2) - SLOPE**2 * bend - 4 * SLOPE * twist
    laws = [
        laplace(*laplace(first, second)),
        (bend.subs(z, h), shear.subs(z, h)),
        (first.subs(z, h) - C, second.subs(z, h) - change),
        (first.subs(z, 0), second.subs(z, 0)),
        (sp.diff(first + z, z).subs(z, 0), sp.diff(second, z).subs(z, 0)),
    ]
    for parts in laws:
        assert all(map(vanishes, parts))


def test_a_pressure_that_repeats_gives_the_change_of_c():
    """p_x = -3 change / h³ - 12/5 h'²/h² - 48/5 C h'²/h³, but for the derivative of what repeats.

    On the ground p_x is the third derivative of the stream function: (psi_z)_xx is 0 there.
    """
    repeats = sp.Rational(-9, 5) * SLOPE / h - sp.Rational(57, 10) * C * SLOPE / h**2
    left = -3 * change / h**3 - sp.Rational(12, 5) * (1 + 4 * C / h) * SLOPE**2 / h**2
    assert vanishes(stream()[2] - left - sp.diff(repeats, x))


def test_the_velocity_of_the_surface_is_that_of_the_stream_function():
    along = sp.diff(stream()[1], z).subs(z, h)
    assert vanishes(along - surface_correction(h, SLOPE, BEND, C, change))


def test_the_closed_form_of_the_cosine_wave(monkeypatch: pytest.MonkeyPatch):
    """By means of 1, 1/h, 1/h² and 1/h³, which are 1, 1/y, 1/y³ and (3 - y²) / (2 y⁵), with
    h'² = -h² + 2 h - y²."""
    y = sp.symbols("y", positive=True)
    means = [1, 1 / y, y**-3, (3 - y**2) / (2 * y**5)]
    squares, cubes = (-means[n - 2] + 2 * means[n - 1] - y**2 * means[n] for n in (2, 3))
    constant = -2 * y**2 / (3 - y**2)
    total = -sp.Rational(4, 5) * (squares + 4 * constant * cubes) / means[3]
    closed = sp.Rational(8, 5) * y**4 * (1 - y) * (1 + 4 * y + y**2) / (3 - y**2) ** 2
    assert sp.cancel(total - closed) == 0
    delta = sp.sqrt(1 - y**2)
    monkeypatch.setattr(next_order, "math", SimpleNamespace(sqrt=sp.sqrt))
    ours = sum(flow_terms(unchecked(CosineWave, delta=delta)))
    assert sp.nsimplify(sp.cancel(sp.nsimplify(ours - closed))) == 0


@cache
def low_wave_flow() -> Any:
    """Mean flow over delta² of waves of next to no height, for any eps, from linear Stokes flow."""
    e, a, b = sp.symbols("e a b", positive=True)
    phi = a * z * sp.sinh(e * z) + b * (e * z * sp.cosh(e * z) - sp.sinh(e * z))
    top: list[Any] = [sp.diff(phi, z, n).subs(z, 1) for n in range(4)]
    found = sp.solve([top[0] - 1, top[2] + e**2], [a, b], dict=True)[0]
    flow = (-top[3] / 2 + sp.Rational(3, 2) * e**2 * top[1] + top[1]) / 2
    return sp.lambdify(e, flow.subs(found), "mpmath"), sp.simplify(flow.subs(found)), e


@pytest.mark.slow
def test_low_waves_have_the_correction_that_linear_flow_has():
    _, flow, e = low_wave_flow()
    assert sp.series(flow, e, 0, 4).removeO() == sp.Rational(3, 2) + sp.Rational(6, 5) * e**2
    first, second = flow_terms(CosineWave(1e-5))
    assert (first + second) / 1e-10 == pytest.approx(1.2, rel=1e-9)


@pytest.mark.slow
def test_the_bar_holds_low_waves_up_to_6_4_and_no_further():
    """That flow grows like eps³ / 2, and leaves every bar of the size eps² at last."""
    flow, _, _ = low_wave_flow()

    def outside(e: float) -> float:
        first, second = (term / 1e-10 for term in flow_terms(CosineWave(1e-5)))
        middle = 1.5 + e**2 * (first + second)
        return abs(float(flow(e)) - middle) / (e**2 * (second - first))

    assert max(outside(e) for e in np.linspace(0.05, REACH, 30)) < 0.2
    assert outside(6.4) < 1 < outside(6.5)


@pytest.mark.slow
def test_elements_converge():
    """With twice their degree, as a number of the whole flow does; the drift is no worse."""
    values = [slow_flow(CosineWave(0.5), 0.5, 6 * n, n) for n in (4, 8, 16)]
    flow, drift = (
        np.abs(np.diff([getattr(value, name) for value in values]))
        for name in ("mean_flow", "drift")
    )
    assert math.log2(flow[0] / flow[1]) == pytest.approx(4, abs=0.5)
    assert flow[1] < 1e-6
    assert drift[1] < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    "wave",
    [CosineWave(0.3), CosineWave(0.5), FourierWave([0.3, 0.1], [0.0, 0.1])],
    ids=["0.3", "0.5", "two harmonics"],
)
def test_what_is_left_falls_with_the_fourth_power(wave: Any):
    """Without the next order it falls with the second."""
    rows = []
    for e in (0.2, 0.2 * math.sqrt(2), 0.4):
        flow = slow_flow(wave, e)
        rows.append([
            flow.mean_flow - wave.mean_flow,
            flow.mean_flow - corrected_flow(wave, e).value,
            flow.drift - float_drift(wave).velocity,
            flow.drift - corrected_drift(wave, e).value,
        ])  # fmt: skip
    for before, after in pairwise(np.abs(rows)):
        assert 2 * np.log2(after / before) == pytest.approx([2, 4, 2, 4], abs=0.25)
    assert np.all(np.abs(rows[0]) < [0.01, 3e-4, 0.015, 5e-4])


NUMBERS = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=4)


@pytest.mark.slow
@settings(max_examples=examples(25))
@given(rows=NUMBERS, half=st.floats(0.05, 0.8), reach=st.floats(0.1, REACH))
def test_bars_hold_flow_in_two_dimensions(
    rows: list[tuple[float, float]], half: float, reach: float
):
    size = sum(abs(a) + abs(b) for a, b in rows)
    assume(size > 0.05 and abs(rows[-1][0]) + abs(rows[-1][1]) > 0.01)
    wave = FourierWave([half * a / size for a, _ in rows], [half * b / size for _, b in rows])
    assume(float(np.ptp(wave.height(np.linspace(0, 7, 200)))) > 0.05)
    e = reach / len(rows) * (1 - 1e-12)
    flow = slow_flow(wave, e, 16 + 16 * len(rows), 6)
    for exact, found in (
        (flow.mean_flow, corrected_flow(wave, e)),
        (flow.drift, corrected_drift(wave, e)),
    ):
        assert found.bar is not None
        assert abs(exact - found.value) < found.bar + 1e-5  # what elements are off by


@pytest.mark.slow
def test_a_drop_whose_correction_cancels_is_within_its_bar():
    """A crest of four harmonics on a film of a tenth: both terms are alike but for 7 %."""
    share = np.array([56, 28, 8, 1]) / 35  # of ((1 + cos) / 2)^4 over its mean
    wave, e = FourierWave(0.9 * share), 0.5
    found = corrected_flow(wave, e)
    assert found.bar is not None
    assert abs(found.value - wave.mean_flow) < 0.1 * found.bar
    assert abs(slow_flow(wave, e, 120, 8).mean_flow - found.value) < found.bar


@pytest.mark.slow
def test_beyond_its_reach_there_is_no_bar_and_would_be_none():
    wave, e = CosineWave(0.003), 9.0
    found, sizes = corrected_flow(wave, e), flow_terms(wave)
    assert found.bar is None
    assert corrected_drift(wave, e).bar is None
    would_be = e**2 * sum(map(abs, sizes))
    exact = slow_flow(wave, e, 32, 16).mean_flow
    assert exact == pytest.approx(9e-6 * float(low_wave_flow()[0](e)), rel=0.03)
    assert abs(exact - found.value) > 1.2 * would_be


@pytest.mark.slow
def test_thicker_films_hold_floats_in_lower_waves():
    """Lubrication says sqrt(13) - 3 = 0.6056; what is left of the shift is a small part of it."""
    low, high = 0.5, CAPTURE_DELTA
    for _ in range(20):
        middle = (low + high) / 2
        holds = corrected_drift(CosineWave(middle), 0.3).value == 1.0
        low, high = (low, middle) if holds else (middle, high)
    shift = CAPTURE_DELTA - high
    assert shift > 0.004
    assert slow_flow(CosineWave(high + shift / 4), 0.3).drift == 1.0
    assert slow_flow(CosineWave(high - shift / 4), 0.3).drift < 1.0


def test_ways_agree_and_small_eps_is_lubrication():
    for delta in (0.05, 0.5, 0.9):
        assert flow_terms(FourierWave([0.0, delta])) == pytest.approx(
            4 * np.array(flow_terms(CosineWave(delta))), rel=1e-12
        )  # slopes are twice as steep
    wave = CosineWave(0.5)
    assert corrected_drift(wave, 0.0).value == pytest.approx(float_drift(wave).velocity, abs=1e-12)
    assert corrected_flow(wave, 0.0).bar == 0
    assert within_reach(FourierWave([0.1, 0.1, 0.0]), 1.5)
    assert not within_reach(FourierWave([0.1, 0.1]), 1.51)


@pytest.mark.parametrize("wrong", [-0.1, math.nan, math.inf, "thin", None, 1j])
def test_wrong_eps_is_refused(wrong: Any):
    for find in (corrected_flow, corrected_drift):
        with pytest.raises(ArgumentError, match="eps must be a finite number, 0 or above"):
            find(CosineWave(0.5), wrong)


@pytest.mark.slow
def test_scenes_tell_the_bar():
    flow = wo.run("fig15_film_flow", "film.eps=0.4")
    assert value(flow, "mean_flow_corrected") == pytest.approx(0.353203, abs=1e-6)
    assert value(flow, "mean_flow_bar") == pytest.approx(0.037019, abs=1e-6)
    thick = wo.run("fig15_film_flow", "film.eps=4.0")
    assert value(thick, "mean_flow_bar") is None
    assert any("eps = 4 times" in text for text in thick.trust["warnings"])
    ride = wo.run("fig27_float", ["film.delta=0.5", "film.eps=0.4", "floats.length=[0.0, 0.5]"])
    exact = corrected_drift(CosineWave(0.5), 0.4, math.pi).value
    assert value(ride, "float_drift_corrected") == pytest.approx([0.64726, exact], abs=1e-5)
    assert "float_drift_bar" not in wo.run("fig27_float").scalars


@pytest.mark.parametrize(
    ("scene", "says"),
    [("film_field", "follows from depth and wavelength"), ("film_forward", "leave it out")],
)
def test_wrong_scenes_are_refused(scene: str, says: str):
    refused(scene, "film.eps=0.1", "film.eps", says)
