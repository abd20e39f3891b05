"""Collocation: nodes, exactness and order of the schemes; Bernstein's bounds."""

import math

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.special import roots_jacobi, roots_legendre

from wormopt.numerics.collocation import Collocation, Scheme, bernstein_matrix

SCHEMES: tuple[Scheme, ...] = ("legendre", "radau")
S6 = math.sqrt(6)
# Radau IIA of 2 and 3 stages (Hairer, Wanner: Solving Ordinary Differential Equations II, IV.5).
RADAU_TABLES = {
    2: ([1 / 3, 1], [[5 / 12, -1 / 12], [3 / 4, 1 / 4]]),
    3: (
        [(4 - S6) / 10, (4 + S6) / 10, 1],
        [
            [(88 - 7 * S6) / 360, (296 - 169 * S6) / 1800, (-2 + 3 * S6) / 225],
            [(296 + 169 * S6) / 1800, (88 + 7 * S6) / 360, (-2 - 3 * S6) / 225],
            [(16 - S6) / 36, (16 + S6) / 36, 1 / 9],
        ],
    ),
}


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 9, 16])
def test_nodes_and_weights_agree_with_scipy(degree: int):
    """Gauss from Legendre's roots; Radau's inner nodes are the roots of a Jacobi polynomial."""
    gauss, weights = roots_legendre(degree)
    points = Collocation(degree)
    assert points.tau == pytest.approx((gauss + 1) / 2, abs=1e-14)
    assert pytest.approx(weights / 2, abs=1e-13) == points.B
    radau = Collocation(degree, "radau").tau
    inner = roots_jacobi(degree - 1, 1, 0)[0] if degree > 1 else np.zeros(0)
    assert radau == pytest.approx((np.append(inner, 1.0) + 1) / 2, abs=1e-13)
    assert radau[-1] == 1.0


@pytest.mark.parametrize("stages", RADAU_TABLES)
def test_radau_methods_are_those_of_the_literature(stages: int):
    tau, A = RADAU_TABLES[stages]
    method = Collocation(stages, "radau")
    assert method.tau == pytest.approx(tau, abs=1e-14)
    assert np.array(A) == pytest.approx(method.A, abs=1e-14)
    assert pytest.approx(method.A[-1], abs=1e-15) == method.B


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("degree", [1, 2, 4, 7, 12])
def test_powers_are_integrated_exactly_as_far_as_theory_goes_and_no_further(
    scheme: Scheme, degree: int
):
    """A to degree d - 1; B to 2 d - 1 (Gauss) or 2 d - 2 (Radau)."""
    method = Collocation(degree, scheme)
    for p in range(degree):
        expected = method.tau ** (p + 1) / (p + 1)
        assert method.A @ method.tau**p == pytest.approx(expected, abs=1e-13)
    last = 2 * degree - (1 if scheme == "legendre" else 2)
    for p in range(last + 1):
        assert method.B @ method.tau**p == pytest.approx(1 / (p + 1), abs=1e-13)
    if degree <= 4:
        assert abs(method.B @ method.tau ** (last + 1) - 1 / (last + 2)) > 1e-6


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_order_on_the_exponential(scheme: Scheme, degree: int):
    """One step on x' = x is a Pade approximation of exp: order 2 d (Gauss) or 2 d - 1 (Radau)."""
    method, order = Collocation(degree, scheme), 2 * degree - (scheme == "radau")
    errors = []
    coarse = 16 if degree == 1 else 2  # high orders reach round-off in a few steps
    for steps in (coarse, 2 * coarse):
        h = 1 / steps
        slopes = np.linalg.solve(np.eye(degree) - h * method.A, np.ones(degree))
        errors.append(abs((1 + h * method.B @ slopes) ** steps - math.e))
    slope = math.log2(errors[0] / errors[1])
    assert order - 0.35 < slope < order + 0.35
    # Error constants of the Pade approximants: d! (d-1)! / ((2d-1)! (2d)!) for Radau, for Gauss
    # (d!)^2 / ((2d)! (2d+1)!), times e and the number of steps, h^(order + 1) each.
    k = degree - (scheme == "radau")
    constant = math.factorial(degree) * math.factorial(k)
    constant /= math.factorial(order) * math.factorial(order + 1)
    assert errors[1] == pytest.approx(math.e * constant * (2 * coarse) ** -order, rel=0.4)


@settings(max_examples=examples(100))
@given(
    coefficients=st.integers(0, 9).flatmap(
        lambda d: arrays(float, d + 1, elements=st.integers(-100, 100).map(lambda i: i / 10))
    ),
    scheme=st.sampled_from(SCHEMES),
)
def test_bernstein_coefficients_bound_a_polynomial_and_meet_it_at_the_ends(
    coefficients: np.ndarray, scheme: Scheme
):
    """Through values at 0 and the collocation points, as states are; bounds hold in between."""
    d = len(coefficients) - 1
    nodes = np.array([0.5]) if d == 0 else np.append(0.0, Collocation(d, scheme).tau)
    s = np.linspace(0, 1, 501)
    values = np.polynomial.polynomial.polyval(s, coefficients)
    at_nodes = np.polynomial.polynomial.polyval(nodes, coefficients)
    bernstein = bernstein_matrix(nodes) @ at_nodes
    slack = 1e-9 * (1 + np.abs(coefficients).sum())
    assert bernstein.min() - slack <= values.min()
    assert values.max() <= bernstein.max() + slack
    assert bernstein[[0, -1]] == pytest.approx(values[[0, -1]], abs=slack)
    # s^k = sum_j C(j, k) / C(d, k) B_j: the classical change of basis.
    exact = [
        sum(coefficients[k] * math.comb(j, k) / math.comb(d, k) for k in range(j + 1))
        for j in range(d + 1)
    ]
    assert bernstein == pytest.approx(exact, abs=slack)


@pytest.mark.parametrize("degree", [0, -1])
def test_a_degree_below_one_is_refused(degree: int):
    with pytest.raises(ValueError, match="whole number, 1 or above"):
        Collocation(degree)


def test_an_unknown_scheme_is_refused():
    with pytest.raises(ValueError, match="'legendre', 'radau', not 'lobatto'"):
        Collocation(3, "lobatto")  # type: ignore[arg-type]
