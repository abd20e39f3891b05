"""Long functions in C with loops: as CasADi evaluates them, and as short as they should be."""

import ctypes

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.bench.sweeps import long_chain
from wormopt.simulation.native import build, loops, model_code
from wormopt.simulation.options import Exact, Smooth, Tolerance
from wormopt.simulation.simulate import simulate, system_of

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="there is no C compiler")


def evaluated(function: ca.Function, values: list[np.ndarray]) -> list[np.ndarray]:
    """Results of a function by its C code with loops."""
    told = loops.source(function)
    assert told is not None
    text, n_w = told
    sources = [*build.parts(*model_code.HEADERS), ("loops.c", model_code.HEAD + text)]
    library = build.library("loops", sources, "-O2")
    work = np.zeros(n_w + 1)
    results = [np.full(function.nnz_out(k), np.nan) for k in range(function.n_out())]

    def addresses(arrays: list[np.ndarray]) -> ctypes.Array:
        return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))

    call = getattr(library, function.name())
    call(addresses(values), addresses(results), None, ctypes.c_void_p(work.ctypes.data), 0)
    return results


def check(function: ca.Function, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    values = [rng.uniform(-2.0, 2.0, function.nnz_in(k)) for k in range(function.n_in())]
    right = function.call([ca.DM(function.sparsity_in(k), v) for k, v in enumerate(values)])
    for found, expected in zip(evaluated(function, values), right, strict=True):
        np.testing.assert_allclose(found, expected.nonzeros(), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("links", [2, 30, 150])
@pytest.mark.parametrize("contact", [Smooth(1 / 40), Exact()])
def test_functions_of_chains_are_casadis(links: int, contact: Smooth | Exact):
    for function in system_of(long_chain(links), contact).functions.values():
        check(function, links)


@pytest.mark.parametrize("name", ["tanh", "exp", "sin", "cos"])
def test_functions_of_numbers_are_right_to_the_last_bits(name: str):
    far = [30.0, -25.0, 99_999.0, -3e5, 1e22, 650.0, 720.0, -720.0, -800.0, 5e-324]
    usual = [*np.linspace(-4.0, 4.0, 81), *np.logspace(-300, 0, 23), 0.0, -0.0]
    at = np.array([*usual, *far, np.inf, -np.inf, np.nan])
    x = ca.SX.sym("x", len(at))
    (found,) = evaluated(ca.Function("f", [x], [getattr(ca, name)(x)]), [at])
    with np.errstate(all="ignore"):
        # digits beyond double precision where the machine has them
        right = getattr(np, name)(at.astype(np.longdouble))
        near = np.abs(found - right) <= 4.5e-16 * np.abs(right) + (2e-16 if name in "sincos" else 0)
        same = found == right.astype(float)
    assert np.all(near | same | (np.isnan(found) & np.isnan(right)))


def test_code_does_not_grow_with_the_chain():
    lengths = []
    for links in (100, 400):
        told = loops.source(system_of(long_chain(links), Smooth(1 / 40)).rhs)
        assert told is not None
        lengths.append(len(told[0].splitlines()))
    assert lengths[1] <= 1.1 * lengths[0] < 400


def test_tables_where_there_is_no_rule_and_sums_without_end():
    x, order = ca.SX.sym("x", 300), np.random.default_rng(1).permutation(300)
    mixed = ca.sin(x)[order.tolist()] * x
    total = ca.sum1(mixed) + ca.exp(ca.sum1(x**2) / 300)
    told = ca.vertcat(mixed, total, x[7], 3.5, ca.if_else(x[:9] > 0, x[9:18], total))
    function = ca.Function("told", [x], [told, ca.vertcat(total, x[5]), ca.SX(2, 3)])
    text, _ = loops.source(function) or ("", 0)
    assert "static const int" in text
    assert max(map(len, text.splitlines())) < 6000
    check(function)


OPERATIONS = (
    lambda a, b: a + b,
    lambda a, b: a - b,
    lambda a, b: a * b,
    lambda a, b: a / (3 + b**2),
    lambda a, b: ca.tanh(a) - 2 * b,
    lambda a, b: ca.fmax(a, ca.sin(b)),
    lambda a, b: ca.if_else(a < b, -a, ca.fabs(b)),
    lambda a, b: ca.sign(a) * ca.sqrt(1 + b**2),
)


@given(
    steps=st.lists(
        st.tuples(st.sampled_from(OPERATIONS), st.integers(-12, 12), st.integers(1, 9)),
        min_size=1,
        max_size=6,
    )
)
@settings(max_examples=examples(4), deadline=None)
def test_whatever_neighbours_do_to_each_other(steps: list):
    x, p = ca.SX.sym("x", 13), ca.SX.sym("p", 2)
    y = x
    for operation, shift, back in steps:
        moved = [(k + shift) % 13 for k in range(13)]
        y = operation(y[moved], y) / 2 + p[back % 2] * x[back]
    check(ca.Function("told", [x, p], [y]), len(steps))


def test_what_c_cannot_say_is_left_to_casadi():
    x = ca.SX.sym("x")
    assert loops.source(ca.Function("odd", [x], [ca.erfinv(x)])) is None
    y = ca.MX.sym("y")
    assert loops.source(ca.Function("mixed", [y], [y**2])) is None


@pytest.mark.parametrize("contact", [Smooth(1 / 40), Exact()])
def test_long_chains_move_as_without_compiled_code(contact: Smooth | Exact):
    model, tolerance = long_chain(40), Tolerance(1e-9, 1e-10)
    text, _ = model_code.source(list(system_of(model, contact).functions.values()))
    assert "for (int i = 0; i < 39" in text
    fast, slow = (
        simulate(model, 0.3, contact=contact, tolerance=tolerance, route=route)
        for route in ("native", "python")
    )
    np.testing.assert_allclose(fast.end, slow.end, atol=1e-9)
