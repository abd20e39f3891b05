"""The bridge from CasADi to SymPy: every node, numbers, branches, and what it refuses."""

import math
from typing import Any

import casadi as ca
import pytest
import sympy as sp
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.oracles.by_symbols import Symbols, Undecided, number, unchecked, zero
from wormopt.systems.film.units import Fluid

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
BOTH = Symbols({"x": X, "y": Y})
NODES: list[Any] = [
    X + Y, X - Y, X * Y, X / Y, -X, 1 / X, X**2, 2 * X, X**Y, X**1.5, ca.sqrt(X), ca.exp(X),
    ca.log(X), ca.log1p(X), ca.expm1(X), ca.hypot(X, Y), ca.sin(X), ca.cos(X), ca.tan(X),
    ca.asin(X), ca.acos(X), ca.atan(X), ca.atan2(X, Y), ca.sinh(X), ca.cosh(X), ca.tanh(X),
    ca.floor(3 * X), ca.if_else(X < Y, X, 2 * Y), ca.if_else(X <= Y, X, 2 * Y), ca.fmax(X, Y),
    ca.fmin(X, Y), ca.sign(X - Y), ca.fabs(X - Y), ca.if_else(X == Y, X, 2),
    ca.if_else(X != Y, X, 2),
    ca.if_else(ca.logic_and(X < Y, Y < 2), X, Y), ca.if_else(ca.logic_or(X < Y, Y < 2), X, Y),
    ca.if_else(ca.logic_not(X < Y), X, Y), ca.pi * X, math.sqrt(2) / 3 * X,
]  # fmt: skip


@pytest.mark.parametrize("k", range(len(NODES)))
@pytest.mark.parametrize("at", [(0.25, 0.75), (0.75, 0.25)])
def test_every_node_has_the_value_it_has_in_casadi(k: int, at: tuple[float, float]):
    x, y = BOTH["x"], BOTH["y"]
    found = BOTH.one(NODES[k], {x - y: 1 if at[0] > at[1] else -1, y - 2: -1})
    known = float(ca.Function("f", [X, Y], [NODES[k]])(*at))
    assert float(found.subs({x: at[0], y: at[1]})) == pytest.approx(known, rel=1e-14)


def test_a_node_without_meaning_is_refused():
    with pytest.raises(NotImplementedError, match="OP_ERF"):
        BOTH(ca.erf(X))


def test_a_branch_is_taken_only_where_its_sign_is_told():
    with pytest.raises(Undecided, match="x - y"):
        BOTH(ca.fmax(X, Y))
    x, y = BOTH["x"], BOTH["y"]
    assert BOTH.one(ca.fmax(X, Y), {y - x: 1}) == y
    assert BOTH.one(ca.fmax(X, Y), {x - y: 0}) == x
    assert Symbols({"x": X}, ["x"]).one(ca.fabs(X)).is_positive


@settings(max_examples=examples(60))
@given(top=st.integers(-500, 500).filter(bool), bottom=st.integers(1, 500))
def test_doubles_are_read_as_what_they_stand_for(top: int, bottom: int):
    share = sp.Rational(top, bottom)
    assert number(top / bottom) == share
    assert number(math.pi * top / bottom) == share * sp.pi
    assert number(float(sp.Float(share))) == share
    assert number(7e-9 * top / bottom, {7e-9: sp.Symbol("c")}) == share * sp.Symbol("c")
    assert number(math.sqrt(abs(top) / bottom)) == sp.sqrt(abs(share))


def test_a_double_that_stands_for_nothing_plain_is_refused():
    with pytest.raises(ValueError, match="name it"):
        BOTH(0.123456789012 * X)


def test_shapes_are_kept():
    column = ca.SX.sym("c", 2)
    three = Symbols({"c": column})
    found = three(column @ column.T + ca.SX(ca.DM([[0, 1], [2, 3]])))
    a, b = three["c"]
    assert found == sp.Matrix([[a**2, a * b + 1], [a * b + 2, b**2 + 3]])
    assert three.column("c", "c").shape == (4, 1)


def test_what_is_zero_and_what_is_not():
    x, y = sp.symbols("x y", positive=True)
    root = sp.sqrt(x**2 + y)
    assert zero((root - x) * (root + x) - y)
    assert zero(sp.sin(x) ** 4 - (1 - sp.cos(x) ** 2) ** 2)
    assert zero(sp.tan(x) * sp.cos(x) - sp.sin(x))
    assert zero(sp.Matrix([x / y - 1 / (y / x), 0]))
    assert zero(1 / (1 + sp.sqrt(2)) - sp.sqrt(2) + 1)
    assert zero(sp.cbrt(x) ** 2 * x ** sp.Rational(1, 3) - x)
    for other in (x - y, root - x, sp.sin(x), sp.exp(x) - 1, sp.sqrt(2) - 1, sp.sqrt(x) - x):
        assert not zero(other)


def test_numbers_give_way_to_symbols():
    depth, length = ca.SX.sym("d"), ca.SX.sym("l")
    found = Symbols({"d": depth, "l": length}).one(
        unchecked(Fluid, depth=depth, wavelength=length).eps
    )
    assert zero(found - 2 * sp.pi * sp.Symbol("d", real=True) / sp.Symbol("l", real=True))
