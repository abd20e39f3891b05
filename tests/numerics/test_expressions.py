"""Functions of expressions at many points."""

import casadi as ca
import numpy as np
import pytest

from wormopt.numerics.expressions import at_rows


@pytest.mark.parametrize("m", [0, 1, 511, 512, 513, 1025])
def test_a_function_at_many_rows_is_that_of_each(m: int):
    x, y, none = ca.SX.sym("x", 2), ca.SX.sym("y"), ca.SX.sym("none", 0)
    function = ca.Function("f", [x, none, y], [ca.vertcat(x[0] * y, x[1] - y, 3.0)])
    rows, last = np.random.default_rng(m).normal(size=(m, 2)), np.arange(1.0 * m)
    (found,) = at_rows(function, rows, np.zeros((m, 0)), last[:, None])
    expected = np.stack([rows[:, 0] * last, rows[:, 1] - last, np.full(m, 3.0)], axis=1)
    np.testing.assert_array_equal(found, expected)


def test_a_function_without_entries_has_none_at_any_row():
    x = ca.SX.sym("x")
    function = ca.Function("none", [x], [ca.SX(0, 1)])
    assert at_rows(function, np.zeros((3, 1)))[0].shape == (3, 0)


def test_rows_are_evaluated_one_by_one_and_matrices_are_flat_by_columns():
    """Results of one call are kept when the function is called again."""
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ca.horzcat(x, y * x, x**2), ca.densify(ca.SX(2, 1))])
    rows = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    found, zero = at_rows(function, rows, 10.0)
    at_rows(function, -rows, np.zeros((3, 1)))
    assert found.tolist() == [[a, b, 10 * a, 10 * b, a * a, b * b] for a, b in rows.tolist()]
    assert zero.tolist() == [[0.0, 0.0]] * 3
