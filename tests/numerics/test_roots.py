"""Brent's method against SciPy's and against roots by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from wormopt.numerics.roots import root

SHAPES = {
    "linear": lambda x: x,
    "odd power": lambda x: x**5,
    "steep": lambda x: math.tanh(300 * x),
    "flat beyond": lambda x: math.expm1(8 * x),
    "kink": lambda x: x if x < 0 else 1e-6 * x,
    "tiny": lambda x: 1e-200 * x**3,
    "jump": lambda x: -1.0 if x < 0 else 2.0,
}


@pytest.mark.parametrize("name", SHAPES)
@given(st.floats(-3, 3), st.floats(1e-3, 5), st.floats(1e-3, 5), st.booleans())
def test_it_finds_the_root_in_as_many_steps_as_scipy(name, at, left, right, falls):
    asked: list[float] = []

    def function(x: float) -> float:
        asked.append(x)
        return (-1 if falls else 1) * SHAPES[name](x - at)

    found = root(function, at - left, at + right)
    steps = len(asked)
    assert found == pytest.approx(
        at, rel=1e-14, abs=1e-4 if name in ("odd power", "tiny") else 1e-14
    )
    other = brentq(function, at - left, at + right, xtol=1e-15, maxiter=1000)
    assert abs(function(found)) <= abs(function(other)) + 1e-14 or name == "jump"
    assert steps <= 1.2 * (len(asked) - steps) + 5


def test_ends_count_and_signs_must_differ():
    assert root(lambda x: x, 0.0, 1.0) == 0.0
    assert root(lambda x: x, -1.0, 0.0) == 0.0
    for wrong in (lambda x: x**2 + 1, lambda _: math.nan):
        with pytest.raises(ValueError, match="no opposite signs"):
            root(wrong, -1.0, 1.0)
    with pytest.raises(ValueError, match="is NaN"):
        root(lambda x: x if abs(x) == 1 else math.nan, -1.0, 1.0)
