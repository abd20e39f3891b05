"""Test without threshold whether an expression is zero for all values of its symbols.

The expression is evaluated at a random point in the field of integers modulo a prime, where
sums cancel exactly. An expression that is not identically zero vanishes there with a probability
of about its degree / 2^61. Functions that are no quotients of polynomials, such as tanh, are
independent unknowns, so that only relations among them, such as cos^2 + sin^2 = 1, go unnoticed.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

_PRIME = 2**61 - 1
_LARGEST_POWER = 64


def identically_zero(
    expression: ca.SX, symbols: ca.SX, values: Mapping[int, float] | None = None
) -> np.ndarray:
    """Return for each entry of an expression whether it is identically zero.

    `values`: exact values of some entries of `symbols`, by index; the others are arbitrary.
    Raises ZeroDivisionError if the expression divides by zero for these values.
    """
    random = np.random.default_rng(0)
    at = [int(random.integers(1, _PRIME)) for _ in range(symbols.numel())]
    for i, value in (values or {}).items():
        at[i] = _residue(value)
    function = ca.Function("f", [symbols], [ca.densify(expression)])
    found = np.array(_Field(random).evaluate(function, at), dtype=object)
    return (found == 0).reshape(expression.shape, order="F").astype(bool)


def _residue(value: float) -> int:
    top, bottom = float(value).as_integer_ratio()
    return _divide(top % _PRIME, bottom)


def _divide(a: int, b: int) -> int:
    if b % _PRIME == 0:
        raise ZeroDivisionError("the model divides by zero for these parameters")
    return a * pow(b, -1, _PRIME) % _PRIME


def _power(base: int, exponent: int) -> int | None:
    """None where the exponent is no small whole number."""
    signed = exponent if exponent <= _PRIME // 2 else exponent - _PRIME
    if abs(signed) > _LARGEST_POWER:
        return None
    power = pow(base, abs(signed), _PRIME)
    return power if signed >= 0 else _divide(1, power)


_ARITHMETIC = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: _divide,
    ca.OP_NEG: lambda a: -a,
    ca.OP_INV: lambda a: _divide(1, a),
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    # a condition is an unknown; an expression with it is zero if both its branches are
    ca.OP_NOT: lambda a: 1 - a,
    ca.OP_IF_ELSE_ZERO: lambda a, b: a * b,
}


class _Field:
    """Arithmetic modulo the prime; every other function gets a random value per argument."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self._unknowns: dict[tuple[int, ...], int] = {}

    def _apply(self, operation: int, arguments: list[int]) -> int:
        known = _ARITHMETIC.get(operation)
        value = known(*arguments) if known else None
        if value is not None:
            return value % _PRIME
        key = (operation, *arguments)
        if key not in self._unknowns:
            self._unknowns[key] = int(self._random.integers(1, _PRIME))
        return self._unknowns[key]

    def evaluate(self, function: ca.Function, at: list[int]) -> list[int]:
        work, results = [0] * function.sz_w(), [0] * function.nnz_out(0)
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            source, target = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_INPUT:
                work[target[0]] = at[source[1]]
            elif operation == ca.OP_OUTPUT:
                results[target[1]] = work[source[0]]
            elif operation == ca.OP_CONST:
                work[target[0]] = _residue(function.instruction_constant(k))
            else:
                work[target[0]] = self._apply(operation, [work[i] for i in source])
        return results


def without_zeros(matrix: ca.SX) -> ca.SX:
    """Drop off-diagonal entries that are identically 0, such as sin cos - cos sin."""
    if matrix.sparsity().is_diag():
        return matrix
    rows, columns = matrix.sparsity().get_triplet()
    sides = [k for k, pair in enumerate(zip(rows, columns, strict=True)) if len({*pair}) > 1]
    entries = matrix.nz[sides]
    try:
        gone = identically_zero(entries, ca.vertcat(*ca.symvar(entries))).ravel()
    except ZeroDivisionError:
        return matrix
    for k, zero in zip(sides, gone, strict=True):
        if zero:
            matrix[rows[k], columns[k]] = 0
    return ca.sparsify(matrix)
