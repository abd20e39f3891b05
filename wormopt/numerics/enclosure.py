"""Bounds of a function over boxes of its inputs, by interval arithmetic on its instructions."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from wormopt.numerics.instructions import read

Interval = tuple[np.ndarray, np.ndarray]
_HALF = np.pi / 2


class Enclosure:
    """Bounds of a CasADi function of scalars, for many boxes at once.

    Parameters
    ----------
    function : casadi.Function
        One column of inputs, one column of results.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> bounds = Enclosure(ca.Function("f", [x], [x**2 - 1]))
    >>> low, high = bounds(np.array([[-1.0, 2.0]]), np.array([[2.0, 3.0]]))
    >>> low.round(12), high.round(12)
    (array([[-1.,  3.]]), array([[3., 8.]]))
    """

    def __init__(self, function: ca.Function) -> None:
        self._operations, self._places = (part.tolist() for part in read(function))
        self._n_w, self._n_out = function.sz_w(), function.nnz_out(0)
        self._constants = {
            k: function.instruction_constant(k)
            for k, operation in enumerate(self._operations)
            if operation == ca.OP_CONST
        }

    def __call__(self, low: np.ndarray, high: np.ndarray) -> Interval:
        """Bounds (results, m) over the boxes between `low` and `high` (inputs, m)."""
        work: list[Interval] = [(np.zeros(0), np.zeros(0))] * self._n_w
        found = np.zeros((2, self._n_out, low.shape[1]))
        with np.errstate(all="ignore"):
            for k, (operation, place) in enumerate(
                zip(self._operations, self._places, strict=True)
            ):
                target, *source = place
                if operation == ca.OP_INPUT:
                    work[target] = low[source[1]], high[source[1]]
                elif operation == ca.OP_OUTPUT:
                    found[:, place[1]] = work[place[2]]
                elif operation == ca.OP_CONST:
                    value = np.full(low.shape[1], self._constants[k])
                    work[target] = value, value
                else:
                    arguments = [work[i] for i in source if i >= 0]
                    work[target] = _apply(operation, arguments, low.shape[1])
        return found[0], found[1]


def _apply(operation: int, arguments: list[Interval], count: int) -> Interval:
    """Apply an operation; an unknown one is unbounded."""
    known = _OPERATIONS.get(operation)
    if known is None:
        return np.full(count, -np.inf), np.full(count, np.inf)
    low, high = known(*arguments)
    low, high = np.broadcast_to(low, count), np.broadcast_to(high, count)
    if operation not in _EXACT:
        low, high = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
    unknown = np.isnan(low) | np.isnan(high)
    return np.where(unknown, -np.inf, low), np.where(unknown, np.inf, high)


def _rising(f: Callable[[np.ndarray], np.ndarray]) -> Callable[[Interval], Interval]:
    return lambda a: (f(a[0]), f(a[1]))


def _negative(a: Interval) -> Interval:
    return -a[1], -a[0]


def _sum(a: Interval, b: Interval) -> Interval:
    return a[0] + b[0], a[1] + b[1]


def _product(a: Interval, b: Interval) -> Interval:
    corners = np.array([a[i] * b[j] for i in (0, 1) for j in (0, 1)])
    corners[np.isnan(corners)] = 0.0  # 0 times infinity
    return corners.min(axis=0), corners.max(axis=0)


def _inverse(a: Interval) -> Interval:
    through = (a[0] <= 0) & (a[1] >= 0)
    return np.where(through, -np.inf, 1 / a[1]), np.where(through, np.inf, 1 / a[0])


def _size(a: Interval) -> Interval:
    through = (a[0] <= 0) & (a[1] >= 0)
    ends = np.abs(np.array(a))
    return np.where(through, 0.0, ends.min(axis=0)), ends.max(axis=0)


def _even(f: Callable[[np.ndarray], np.ndarray]) -> Callable[[Interval], Interval]:
    """Even function that increases with the size of its argument."""
    return lambda a: _rising(f)(_size(a))


def _whole_power(a: Interval, n: int) -> Interval:
    if n < 0:
        return _inverse(_whole_power(a, -n))
    return _even(lambda v: v**n)(a) if n % 2 == 0 else _rising(lambda v: v**n)(a)


def _power(a: Interval, b: Interval) -> Interval:
    exponent = b[0].flat[0] if b[0].size else 0.0
    if np.all(b[0] == exponent) and np.all(b[1] == exponent) and exponent == round(exponent):
        return _whole_power(a, int(exponent))
    low, high = _product(b, (np.log(a[0]), np.log(a[1])))
    # undefined for negative numbers
    return np.where(a[0] < 0, np.nan, np.exp(low)), np.exp(high)


def _cosine(a: Interval) -> Interval:
    # the shifted argument of a sine has a rounding error
    low, high = (
        a[0] - 1e-15 * np.abs(a[0]),
        a[1] + 1e-15 * np.abs(a[1]),
    )
    ends = np.array([np.cos(low), np.cos(high)])
    top = np.floor(high / (2 * np.pi)) >= np.ceil(low / (2 * np.pi))
    half_low, half_high = (low / np.pi - 1) / 2, (high / np.pi - 1) / 2
    bottom = np.floor(half_high) >= np.ceil(half_low)
    far = ~(high - low < 2 * np.pi)
    return (
        np.where(bottom | far, -1.0, ends.min(axis=0)),
        np.where(top | far, 1.0, ends.max(axis=0)),
    )


def _tangent(a: Interval) -> Interval:
    whole = np.floor(a[0] / np.pi + 0.5) != np.floor(a[1] / np.pi + 0.5)
    return np.where(whole, -np.inf, np.tan(a[0])), np.where(whole, np.inf, np.tan(a[1]))


def _less(a: Interval, b: Interval) -> Interval:
    return np.where(a[1] < b[0], 1.0, 0.0), np.where(a[0] >= b[1], 0.0, 1.0)


def _at_most(a: Interval, b: Interval) -> Interval:
    return np.where(a[1] <= b[0], 1.0, 0.0), np.where(a[0] > b[1], 0.0, 1.0)


def _equal(a: Interval, b: Interval) -> Interval:
    alike = (a[0] == a[1]) & (b[0] == b[1]) & (a[0] == b[0])
    return np.where(alike, 1.0, 0.0), np.where((a[1] < b[0]) | (b[1] < a[0]), 0.0, 1.0)


def _not(a: Interval) -> Interval:
    through = (a[0] <= 0) & (a[1] >= 0)
    return np.where((a[0] == 0) & (a[1] == 0), 1.0, 0.0), np.where(through, 1.0, 0.0)


def _truth(a: Interval) -> Interval:
    low, high = _not(a)
    return 1 - high, 1 - low


def _if_else_zero(condition: Interval, a: Interval) -> Interval:
    low, high = _truth(condition)
    least, most = np.where(low > 0, a[0], 0.0), np.where(low > 0, a[1], 0.0)
    open_ = (low == 0) & (high == 1)
    return (
        np.where(open_, np.minimum(a[0], 0.0), least),
        np.where(open_, np.maximum(a[1], 0.0), most),
    )


def _rest(a: Interval, b: Interval) -> Interval:
    """Remainder of a quotient rounded towards 0."""
    quotient = _product(a, _inverse(b))
    whole = np.trunc(quotient[0]), np.trunc(quotient[1])
    low, high = _sum(a, _negative(_product(whole, b)))
    largest = _size(b)[1]
    same = whole[0] == whole[1]
    below, above = np.where(a[0] < 0, -largest, 0.0), np.where(a[1] > 0, largest, 0.0)
    return np.where(same, low, below), np.where(same, high, above)


def _with_sign(a: Interval, b: Interval) -> Interval:
    return _product(_size(a), (np.copysign(1.0, b[0]), np.copysign(1.0, b[1])))


def _erf(v: np.ndarray) -> np.ndarray:
    from scipy.special import erf  # takes a while to import

    return np.asarray(erf(v))


_OPERATIONS: dict[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _sum,
    ca.OP_SUB: lambda a, b: _sum(a, _negative(b)),
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda a, b: _product(a, _inverse(b)),
    ca.OP_NEG: _negative,
    ca.OP_INV: _inverse,
    ca.OP_SQ: _even(np.square),
    ca.OP_TWICE: _rising(lambda v: 2 * v),
    ca.OP_FABS: _size,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_FMIN: lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])),
    ca.OP_FMAX: lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])),
    ca.OP_COS: _cosine,
    ca.OP_SIN: lambda a: _cosine((a[0] - _HALF, a[1] - _HALF)),
    ca.OP_TAN: _tangent,
    ca.OP_COSH: _even(np.cosh),
    ca.OP_ATAN2: lambda a, _: (np.full_like(a[0], -np.pi), np.full_like(a[0], np.pi)),
    ca.OP_HYPOT: lambda a, b: _rising(np.sqrt)(_sum(_even(np.square)(a), _even(np.square)(b))),
    ca.OP_LT: _less,
    ca.OP_LE: _at_most,
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda a, b: _not(_equal(a, b)),
    ca.OP_NOT: _not,
    ca.OP_AND: lambda a, b: _product(_truth(a), _truth(b)),
    ca.OP_OR: lambda a, b: _truth(_sum(_truth(a), _truth(b))),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_FMOD: _rest,
    ca.OP_COPYSIGN: _with_sign,
    ca.OP_ACOS: lambda a: (np.arccos(np.minimum(a[1], 1.0)), np.arccos(np.maximum(a[0], -1.0))),
    ca.OP_ASIN: lambda a: (np.arcsin(np.maximum(a[0], -1.0)), np.arcsin(np.minimum(a[1], 1.0))),
    ca.OP_SQRT: lambda a: _rising(np.sqrt)((np.maximum(a[0], 0.0), a[1])),
    ca.OP_ERF: _rising(_erf),
} | {
    operation: _rising(f)
    for operation, f in (
        (ca.OP_EXP, np.exp),
        (ca.OP_EXPM1, np.expm1),
        (ca.OP_LOG, np.log),
        (ca.OP_LOG1P, np.log1p),
        (ca.OP_SINH, np.sinh),
        (ca.OP_TANH, np.tanh),
        (ca.OP_ATAN, np.arctan),
        (ca.OP_ASINH, np.arcsinh),
        (ca.OP_ACOSH, np.arccosh),
        (ca.OP_ATANH, np.arctanh),
        (ca.OP_FLOOR, np.floor),
        (ca.OP_CEIL, np.ceil),
        (ca.OP_SIGN, np.sign),
    )
}

# Operations that do not round.
_EXACT = frozenset(
    (
        *(ca.OP_ASSIGN, ca.OP_NEG, ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_FLOOR, ca.OP_CEIL),
        *(ca.OP_SIGN, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR),
        *(ca.OP_IF_ELSE_ZERO, ca.OP_TWICE, ca.OP_COPYSIGN),
    )
)
