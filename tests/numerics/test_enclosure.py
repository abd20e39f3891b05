"""Bounds of functions over boxes, against samples and exact ranges."""

import casadi as ca
import numpy as np
import pytest

from wormopt.numerics.expressions import Enclosure

x, y = ca.SX.sym("x"), ca.SX.sym("y")
EXPRESSIONS = [
    ca.sin(x) * ca.cos(y), ca.tan(x), ca.exp(-(((x - y) / 0.3) ** 2)), ca.fmod(x, y),
    ca.if_else(x > y, x**3, -1 / y), ca.floor(x) + ca.sign(y), x**2.5, x**-3, x**4,
    ca.fabs(x) - ca.fmin(x, y), ca.tanh(x) / (1 + y**2), ca.sqrt(x), ca.atan2(x, y), ca.cosh(x),
    ca.log(x), ca.copysign(x, y), ca.acos(x / 9), ca.ceil(y) + ca.fmax(x, 1), ca.sinh(x - y),
    ca.if_else(ca.logic_or(x > 1, ca.logic_and(y > 0, x < 0)), ca.erf(y), ca.asin(x / 5)),
    ca.if_else(ca.logic_not(x == y), x, y) + ca.if_else(x != 0, 2 * y, x), ca.exp(x) - ca.expm1(y),
]  # fmt: skip


def test_no_value_is_outside_its_bounds():
    column, count = ca.vertcat(x, y), 400
    function = ca.Function("f", [column], [ca.vertcat(*EXPRESSIONS)])
    random = np.random.default_rng(0)
    low = 3 * random.normal(size=(2, count))
    high = low + 10.0 ** random.uniform(-8, 1, (2, count))
    bounds, values = Enclosure(function)(low, high), function.map(count)
    for _ in range(20):
        found = np.array(values(low + random.uniform(size=low.shape) * (high - low)))
        inside = np.isnan(found) | ((bounds[0] <= found) & (found <= bounds[1]))
        assert np.all(inside), np.argwhere(~inside)[:3]


@pytest.mark.parametrize(
    ("expression", "low", "high", "right"),
    [
        (x**2, -1, 2, (0, 4)),
        (ca.cos(x), -1, 4, (-1, 1)),
        (ca.sin(x), 0, 1, (0, np.sin(1))),
        (ca.fabs(x), -3, 1, (0, 3)),
        (ca.floor(x), -0.5, 1.5, (-1, 1)),
        (x > 1, 2, 3, (1, 1)),
        (1 / x, -1, 1, (-np.inf, np.inf)),
        (ca.fmod(x, 2), 2.25, 3.5, (0.25, 1.5)),
    ],
)
def test_bounds_of_single_operations_are_as_narrow_as_can_be(expression, low, high, right):
    bounds = Enclosure(ca.Function("f", [x], [expression]))
    found = bounds(np.array([[float(low)]]), np.array([[float(high)]]))
    assert np.ravel(found) == pytest.approx(right, abs=1e-14)
