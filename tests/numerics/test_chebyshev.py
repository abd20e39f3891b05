"""Chebyshev series: roots, extremes and integrals against known functions and other methods."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.polynomial import Polynomial

from wormopt.numerics.chebyshev import Series, relaxed, resolve


def series(function: Callable[[np.ndarray], np.ndarray], a: float, b: float) -> Series:
    return resolve(lambda s: np.atleast_2d(function(s)), a, b)


# Function, interval, exact roots, error allowed (round-off to the power 1 / multiplicity).
ROOTS = [
    ("sine", np.sin, (1.0, 10.0), [math.pi, 2 * math.pi, 3 * math.pi], 1e-13),
    ("none", lambda s: 2 + np.sin(s), (0.0, 9.0), [], 0.0),
    ("barely none", lambda s: (s - 0.4) ** 2 + 1e-6, (0.0, 1.0), [], 0.0),
    ("constant", lambda s: 3 + 0 * s, (0.0, 1.0), [], 0.0),
    ("zero", lambda s: 0 * s, (0.0, 1.0), [], 0.0),
    ("ends", lambda s: s * (2 - s), (0.0, 2.0), [0.0, 2.0], 1e-13),
    ("outside", lambda s: (s + 1e-3) * (s - 1 - 1e-3), (0.0, 1.0), [], 0.0),
    ("cluster", lambda s: (s - 0.5) * (s - 0.5001) * (s - 0.5002), (0.0, 1.0), None, 1e-7),
    ("many", lambda s: np.cos(40 * s), (0.0, 3.0), None, 1e-12),
    ("rational", lambda s: 1 / (1 + s**2) - 0.5, (0.0, 4.0), [1.0], 1e-13),
    ("far off", lambda s: np.sin(s - 1e6), (1e6 - 1.0, 1e6 + 1.0), [1e6], 1e-9),
]
KNOWN = {"cluster": [0.5, 0.5001, 0.5002], "many": [(k + 0.5) * math.pi / 40 for k in range(38)]}


@pytest.mark.parametrize(("name", "function", "ends", "roots", "error"), ROOTS)
def test_roots_of_known_functions(name, function, ends, roots, error):
    expected = np.array(KNOWN.get(name, roots))
    found = series(function, *ends).roots(0)
    assert found.shape == expected.shape
    assert found == pytest.approx(expected, abs=error)
    assert np.all(np.diff(found) >= 0)
    assert np.all((found >= ends[0]) & (found <= ends[1]))


@pytest.mark.parametrize("place", [0.0, 0.3, 1.0])
def test_a_double_root_is_found_to_half_the_digits_or_not_at_all(place: float):
    found = series(lambda s: (s - place) ** 2, 0.0, 1.0).roots(0)
    assert len(found) <= 2
    assert np.all(np.abs(found - place) < 3e-8)


@settings(max_examples=examples(200))
@given(
    roots=st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=7, unique=True),
    ends=st.tuples(st.floats(-3, 3), st.floats(0.1, 10)),
    size=st.floats(1e-6, 1e6),
)
def test_separate_roots_are_all_found(roots: list[float], ends: tuple[float, float], size: float):
    """Roots given beforehand, at least 0.05 apart and away from the ends at -1 and 1."""
    kept: list[float] = []
    for root in roots:
        if all(abs(root - other) > 0.05 for other in [*kept, -1.0, 1.0]):
            kept.append(root)
    a, width = ends
    b = a + width
    exact = Polynomial.fromroots(kept) if kept else Polynomial([1.0])

    def function(s: np.ndarray) -> np.ndarray:
        return size * exact(2 * (s - a) / width - 1)[None]

    found = resolve(function, a, b, max(len(kept), 1)).roots(0)
    inside = a + (np.sort([r for r in kept if -1 < r < 1]) + 1) / 2 * width
    assert found.shape == inside.shape
    assert found == pytest.approx(inside, abs=1e-9 * (1 + width))


@settings(max_examples=examples(150))
@given(hundredths=arrays(int, st.integers(2, 9), elements=st.integers(-100, 100)))
def test_polynomials_agree_with_numpy_roots_and_dense_samples(hundredths: np.ndarray):
    coefficients = hundredths / 100
    polynomial = Polynomial(coefficients)
    found = resolve(lambda s: polynomial(s)[None], -1.0, 1.0, len(coefficients) - 1)
    dense = polynomial(np.linspace(-1, 1, 2001))
    low, high = (float(v[0]) for v in found.extremes())
    # Between samples h apart a polynomial gains at most h^2 / 8 times its second derivative.
    bend = np.abs(polynomial.deriv(2).coef).sum() if len(coefficients) > 2 else 0.0
    slack = 1e-3**2 / 8 * bend + 1e-13
    assert dense.min() - slack <= low <= dense.min() + 1e-13
    assert dense.max() - 1e-13 <= high <= dense.max() + slack
    size = np.abs(coefficients).max()
    roots = polynomial.roots() if np.count_nonzero(coefficients) else np.zeros(0)
    slopes = np.abs(polynomial.deriv()(roots))
    sure = (np.abs(roots.imag) == 0) & (np.abs(roots.real) < 0.999) & (slopes > 1e-2 * size)
    for root in roots[sure].real:
        assert np.abs(found.roots(0) - root).min() < 1e-8
    scale = np.abs(found.coefficients).max()
    assert np.all(np.abs(found(found.roots(0))) < 1e-6 * scale)
    integral = float(polynomial.integ()(1.0) - polynomial.integ()(-1.0))
    assert found.integral()[0] == pytest.approx(integral, abs=1e-14)


@pytest.mark.parametrize(
    ("function", "ends", "integral", "extremes"),
    [
        (np.exp, (0.0, 2.0), math.exp(2) - 1, (1.0, math.exp(2))),
        (np.sin, (0.0, 5.0), 1 - math.cos(5), (-1.0, 1.0)),
        (lambda s: 1 / (1 + 25 * s**2), (-1.0, 1.0), 0.4 * math.atan(5), (1 / 26, 1.0)),
        (lambda s: np.cos(60 * s), (0.0, 1.0), math.sin(60) / 60, (-1.0, 1.0)),
        (lambda s: 7 + 0 * s, (2.0, 5.0), 21.0, (7.0, 7.0)),
        (lambda s: 1e-20 * np.sin(s), (0.0, 3.0), 1e-20 * (1 - math.cos(3)), (0.0, 1e-20)),
    ],
)
def test_integrals_and_extremes_in_closed_form(function, ends, integral, extremes):
    found = series(function, *ends)
    size = max(map(abs, extremes))
    assert found.integral()[0] == pytest.approx(integral, abs=1e-13 * size * (ends[1] - ends[0]))
    assert np.ravel(found.extremes()) == pytest.approx(extremes, abs=1e-12 * size)


def test_rows_are_kept_apart():
    """Derivative and primitive of several rows at once, the last from 0 at the left end."""
    found = series(lambda s: np.array([np.sin(s), s**3, 1 + 0 * s]), -1.0, 2.5)
    s = np.linspace(-1, 2.5, 50)
    slopes = np.array([np.cos(s), 3 * s**2, 0 * s])
    assert found.derivative()(s) == pytest.approx(slopes, abs=1e-11)
    wholes = np.array([math.cos(1) - np.cos(s), (s**4 - 1) / 4, s + 1])
    assert found.primitive()(s) == pytest.approx(wholes, abs=1e-12)
    triple = found.roots(1)
    assert 1 <= len(triple) <= 3
    assert np.all(np.abs(triple) < 1e-4)
    assert found.roots(2).size == 0


def test_interpolation_of_an_analytic_function_converges_geometrically():
    """Error about rho^-n: 1 / (1 + 25 x^2) has poles at i / 5, so rho = (1 + sqrt 26) / 5."""
    s = np.linspace(-1, 1, 1001)
    exact = 1 / (1 + 25 * s**2)
    degrees = np.array([20, 40, 60, 80])
    errors = [
        np.abs(resolve(lambda x: 1 / (1 + 25 * x[None] ** 2), -1, 1, n)(s)[0] - exact).max()
        for n in degrees
    ]
    rate = -np.polyfit(degrees, np.log(errors), 1)[0]
    assert rate == pytest.approx(math.log((1 + math.sqrt(26)) / 5), rel=0.03)
    assert np.abs(series(lambda x: 1 / (1 + 25 * x**2), -1, 1)(s)[0] - exact).max() < 1e-14


@pytest.mark.parametrize("rate", [0.0, 1e-9, 0.3, 7.0, 40.0, 300.0])
@pytest.mark.parametrize("start", [0.0, 2.5])
def test_what_decays_under_a_wave_is_found_in_closed_form(rate: float, start: float):
    a, b, w = 0.2, 1.3, 5.0
    found = relaxed(lambda s: np.cos(w * s)[None], rate, start, a, b)
    s = np.linspace(a, b, 57)

    def carried(s: np.ndarray) -> np.ndarray:
        return (rate * np.cos(w * s) + w * np.sin(w * s)) / (rate**2 + w**2)

    known = carried(s) + (start - carried(np.array([a]))) * np.exp(-rate * (s - a))
    assert np.abs(found(s)[0] - known).max() < 2e-14 * max(1.0, start)


@pytest.mark.parametrize("rate", [1e3, 1e6, 1e9, 1e12])
def test_what_has_settled_follows_its_forcing_however_fast_it_would_decay(rate: float):
    # under s and from -1/rate^2 that is (s - 1/rate) / rate
    found = relaxed(lambda s: s[None], rate, -1 / rate**2, 0.0, 2.0)
    s = np.linspace(0, 2, 41)
    assert np.abs(found(s)[0] - (s - 1 / rate) / rate).max() < 1e-13 / rate


def test_a_small_swing_about_a_large_mean_has_its_extremes():
    """Only rows that are constant but for rounding have none inside."""
    low, high = resolve(lambda s: 1e3 + 1e-6 * np.cos(3 * s)[None], 0.5, 4.0).extremes()
    assert (low - 1e3, high - 1e3) == (
        pytest.approx(-1e-6, abs=1e-11),
        pytest.approx(1e-6, abs=1e-11),
    )
