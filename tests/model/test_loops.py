"""Long functions in C with loops: as CasADi evaluates them, and as short as they should be."""

import ctypes
import sys
from types import FrameType

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.benchmarks.chain_length import long_chain
from wormopt.numerics.expressions import instructions_of
from wormopt.simulation.native import build, model_code
from wormopt.simulation.options import Exact, Smooth, Tolerance
from wormopt.simulation.simulate import simulate, system_of

pytestmark = pytest.mark.compiled


def evaluated(function: ca.Function, values: list[np.ndarray]) -> list[np.ndarray]:
    """Results of a function by its C code with loops."""
    told = model_code.loop_source(function)
    assert told is not None
    text, n_w = told
    sources = [*build.parts(*model_code.HEADERS), ("loops.c", model_code.head([text]) + text)]
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


def test_code_does_not_grow_with_the_chain():
    lengths = []
    for links in (100, 400):
        told = model_code.loop_source(system_of(long_chain(links), Smooth(1 / 40)).rhs)
        assert told is not None
        lengths.append(len(told[0].splitlines()))
    assert lengths[1] <= 1.1 * lengths[0] < 400


def calls_of_casadi(links: int, contact: Smooth | Exact) -> int:
    """How often Python calls CasADi from the numbers of a chain to its C code."""
    calls = 0

    def see(_frame: FrameType, event: str, called: object) -> None:
        nonlocal calls
        calls += event == "c_call" and "casadi" in str(getattr(called, "__module__", ""))

    sys.setprofile(see)
    try:
        system = system_of(long_chain(links), contact)
        system.parameters(None)
        functions = list(system.functions.values())
        model_code.source(functions)
    finally:
        sys.setprofile(None)
    return calls


@pytest.mark.parametrize("contact", [Smooth(1 / 40), Exact()])
def test_work_before_a_first_run_grows_in_proportion(contact: Smooth | Exact):
    lengths = (50, 100, 200)
    calls = [calls_of_casadi(links, contact) for links in lengths]
    assert calls[2] - calls[1] <= 2.05 * (calls[1] - calls[0])
    assert calls[2] <= 60 * 200
    systems = [system_of(long_chain(links), contact) for links in lengths]
    counts = [sum(f.n_instructions() for f in s.functions.values()) for s in systems]
    assert counts[2] - counts[1] <= 2.05 * (counts[1] - counts[0])


def test_smooth_chains_need_no_function_for_velocities_that_are_states():
    assert [*system_of(long_chain(3), Smooth(1 / 40)).functions] == ["rhs"]


def test_instructions_are_those_that_casadi_tells_one_by_one():
    x, y = ca.SX.sym("x", 12), ca.SX.sym("y")
    numbers = ca.SX([np.pi, -1e-300, 2.0, np.inf, -np.inf, np.nan, 1e22, 123456789.0])
    both = [x[:3] + y, x * y - 0.1, x[3] / x[4], ca.fmin(x[5], x[6]), ca.atan2(x[7], y), x[8] ** y]
    one = [ca.log1p(x[9]), ca.expm1(y), 2 * x[1], 1 / y, -x[2], x[0] ** 2, ca.sign(y), ca.erf(y)]
    either = [ca.if_else(x[0] <= y, x[1], x[2] != 3), ca.logic_and(x[0] < 1, ca.logic_not(y == 2))]
    told = [ca.vertcat(numbers, *both, *one, *either), x[11], ca.SX(0, 1)]
    for function in (
        ca.Function("told", [x, y], told),
        ca.Function("same", [x], [x]),
        ca.Function("nothing", [x], [ca.SX(0, 1)]),
    ):
        operations, places = instructions_of(function)
        assert operations.tolist() == [
            function.instruction_id(k) for k in range(function.n_instructions())
        ]
        for k, found in enumerate(places.tolist()):
            right = [*function.instruction_output(k), *function.instruction_input(k)]
            assert found == right + [-1] * (3 - len(right))


def test_rows_that_are_read_and_written_backwards_or_far_apart():
    x = ca.SX.sym("x", 40)
    squares = ca.tanh(x[::-1]) * x[0] + x
    told = ca.SX(81, 1)
    told[::2] = ca.vertcat(squares, x[3])
    function = ca.Function("told", [x], [ca.densify(told), squares[38::-2]])
    text, _ = model_code.loop_source(function) or ("", 0)
    assert "SPREAD" in text
    assert "EVERY" in text
    check(function)


def test_a_zero_keeps_its_sign():
    """What all read is spread over the vectors with it: 1 / -0 is not 1 / 0."""
    x, y = ca.SX.sym("x", 9), ca.SX.sym("y")
    function = ca.Function("zeros", [x, y], [ca.atan2(y, x), ca.copysign(x, y), 1 / ca.sign(x * y)])
    for found in evaluated(function, [np.full(9, -1.0), np.array([-0.0])])[:2]:
        np.testing.assert_array_equal(found, [found[0]] * 9)
        assert found[0] < 0.0
    one_over = evaluated(function, [np.ones(9), np.array([-0.0])])[2]
    np.testing.assert_array_equal(one_over, -np.inf)


def test_tables_where_there_is_no_rule_and_sums_without_end():
    x, order = ca.SX.sym("x", 300), np.random.default_rng(1).permutation(300)
    mixed = ca.sin(x)[order.tolist()] * x
    total = ca.sum1(mixed) + ca.exp(ca.sum1(x**2) / 300)
    told = ca.vertcat(mixed, total, x[7], 3.5, ca.if_else(x[:9] > 0, x[9:18], total))
    function = ca.Function("told", [x], [told, ca.vertcat(total, x[5]), ca.SX(2, 3)])
    text, _ = model_code.loop_source(function) or ("", 0)
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
@settings(max_examples=examples(4))
def test_whatever_neighbours_do_to_each_other(steps: list):
    x, p = ca.SX.sym("x", 13), ca.SX.sym("p", 2)
    y = x
    for operation, shift, back in steps:
        moved = [(k + shift) % 13 for k in range(13)]
        y = operation(y[moved], y) / 2 + p[back % 2] * x[back]
    check(ca.Function("told", [x, p], [y]), len(steps))


def test_what_c_cannot_say_is_left_to_casadi():
    x = ca.SX.sym("x")
    assert model_code.loop_source(ca.Function("odd", [x], [ca.erfinv(x)])) is None
    apart = ca.Function("apart", [x], [ca.sin(x)], {"never_inline": True})
    assert model_code.loop_source(ca.Function("calls", [x], [apart(x) + 1])) is None
    y = ca.MX.sym("y")
    assert model_code.loop_source(ca.Function("mixed", [y], [y**2])) is None


@pytest.mark.parametrize("contact", [Smooth(1 / 40), Exact()])
def test_long_chains_move_as_without_compiled_code(contact: Smooth | Exact):
    model, tolerance = long_chain(40), Tolerance(1e-9, 1e-10)
    text, _ = model_code.source(list(system_of(model, contact).functions.values()))
    assert "for (int k = 0; k < 39; k += LANES)" in text
    fast, slow = (
        simulate(model, 0.3, contact=contact, tolerance=tolerance, route=route)
        for route in ("native", "python")
    )
    np.testing.assert_allclose(fast.end, slow.end, atol=1e-9)
