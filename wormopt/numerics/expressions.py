"""Exact answers about CasADi expressions: whether one is zero, bounds over boxes, instructions.

To test for zero, the expression is evaluated at a random point in the field of integers modulo a
prime, where sums cancel exactly. An expression that is not identically zero vanishes there with a
probability of about its degree / 2^61. Functions that are no quotients of polynomials, such as
tanh, are independent unknowns, so that only relations among them, such as cos^2 + sin^2 = 1, go
unnoticed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from threading import get_ident

import casadi as ca
import numpy as np

_DIGITS = b"0123456789"
_NUMBERS_ALONE = bytes(c if c in _DIGITS else ord(" ") for c in range(256))
_PLACE = re.compile(rb"([@\[]?)(\d+)")


@lru_cache(maxsize=4)
def instructions_of(function: ca.Function) -> tuple[np.ndarray, np.ndarray]:
    """Operations (n,) of a function of scalars, and where they write and read (n, 3).

    The latter are as in `Function.instruction_output` and then `Function.instruction_input`,
    followed by -1. Raises ValueError if the listing of the function is not understood.
    """
    listing = function.str(True).encode().partition(b"Algorithm:\n")[2]
    kinds = listing.translate(None, _DIGITS).splitlines()
    numbers = np.fromstring(listing.translate(_NUMBERS_ALONE), dtype=np.int64, sep=" ")
    known = dict[bytes, int]()
    kind = np.array([known.setdefault(k, len(known)) for k in kinds], dtype=np.int64)
    examples = [kinds.index(k) for k in known]
    lines = listing.split(b"\n", max(examples, default=0) + 1)
    tokens = [_PLACE.findall(lines[k]) for k in examples]
    counts = np.array([len(each) for each in tokens], dtype=np.int64)[kind]
    if counts.sum() != len(numbers):
        raise ValueError(f"the instructions of {function.name()} cannot be read")
    starts = np.cumsum(counts) - counts
    operations = np.array([function.instruction_id(k) for k in examples], dtype=np.int64)[kind]
    places = np.full((len(kinds), 3), -1)
    for i, (k, each) in enumerate(zip(examples, tokens, strict=True)):
        where = [j for j, (mark, _) in enumerate(each) if mark]
        right = [*function.instruction_output(k), *function.instruction_input(k)]
        if [int(each[j][1]) for j in where] != right:
            raise ValueError(f"{lines[k].decode()!r} is not understood")
        rows = np.flatnonzero(kind == i)
        places[rows, : len(where)] = numbers[starts[rows, None] + np.array(where, dtype=np.int64)]
    operations.flags.writeable = places.flags.writeable = False
    return operations, places


_PRIME = 2**61 - 1
_LARGEST_POWER = 64


def identically_zero(
    expression: ca.SX, symbols: ca.SX, values: Mapping[int, float] | None = None
) -> np.ndarray:
    """Return for each entry of an expression whether it is identically zero.

    `values`: exact values of some entries of `symbols`, by index; the others are arbitrary.
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


def _integer_power(base: int, exponent: int) -> int | None:
    """Power by a small whole exponent; None for other exponents."""
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
    ca.OP_POW: _integer_power,
    ca.OP_CONSTPOW: _integer_power,
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
        self._operations, self._places = (part.tolist() for part in instructions_of(function))
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


@dataclass(frozen=True, eq=False)
class AtPlaces:
    """One function of many places side by side, which compiled code evaluates in vectors.

    `one` maps the coordinates of a place, a column common to all places, and the weight of the
    place to a column.
    """

    one: ca.Function
    weights: np.ndarray  # (places,)

    @cached_property
    def function(self) -> ca.Function:
        """Function of all coordinates, the first one of every place first, and of the column."""
        # Its results are in the same order.
        count, size = len(self.weights), self.one.size1_in(0)
        q, common = ca.MX.sym("q", size * count), ca.MX.sym("common", self.one.size1_in(1))
        places = ca.reshape(q, count, size).T
        found = self.one.map(count)(places, ca.repmat(common, 1, count), ca.DM(self.weights).T)
        return ca.Function("at_places", [q, common], [ca.vec(found.T)])


class Call:
    """A CasADi function called through its buffer, a hundred times faster than an ordinary call.

    Its arguments and results must be dense. Those in `shared` are not passed: they are read
    from these arrays, which the caller may rewrite. With `rows` the function is mapped, and
    arguments and results have a row for each evaluation.
    """

    def __init__(
        self, function: ca.Function, *shared: tuple[str, np.ndarray], rows: int | None = None
    ) -> None:
        def zeros(size: int) -> np.ndarray:
            return np.zeros(size if rows is None else (rows, size // rows))

        self._buffer, self._run = function.buffer()
        self._shared = arrays = dict(shared)  # kept alive: the buffer stores addresses only
        self._passed = []
        for i, name in enumerate(function.name_in()):
            array = arrays.get(name)
            if array is None:
                array = zeros(function.numel_in(i))
                self._passed.append(array)
            if array.size:
                self._buffer.set_arg(i, array.data)  # type: ignore[call-arg]
        self._results = [zeros(function.numel_out(i)) for i in range(function.n_out())]
        for i, result in enumerate(self._results):
            if result.size:
                self._buffer.set_res(i, result.data)  # type: ignore[call-arg]

    def __call__(self, *values: float | np.ndarray) -> list[np.ndarray]:
        """Evaluate; the results are overwritten by the next call, matrices flat by columns."""
        for place, value in zip(self._passed, values, strict=True):
            place[:] = value
        self._run()
        return self._results


# Rows at which a function is evaluated at once.
_AT_ONCE = 512


@lru_cache(maxsize=8)  # each holds buffers of 512 rows
def _call_at(function: ca.Function, count: int, _thread: int) -> Call:
    return Call(function.map(count), rows=count)


def at_rows(function: ca.Function, *rows: float | np.ndarray) -> list[np.ndarray]:
    """All results (m, size) of a function, dense, at m rows of arguments; matrices by columns.

    The first argument has m rows, a later one may have one or be a number.
    """
    # an ordinary call takes eight times as long, for conversions
    m = len(np.asarray(rows[0]))
    if 0 < m <= _AT_ONCE:
        return [own.copy() for own in _call_at(function, m, get_ident())(*rows)]
    given = [np.broadcast_to(each, (m, function.numel_in(i))) for i, each in enumerate(rows)]
    found = [np.empty((m, function.numel_out(i))) for i in range(function.n_out())]
    for k in range(0, m, _AT_ONCE):
        part = slice(min(k, m - _AT_ONCE), k + _AT_ONCE)  # the last is as long as the others
        values = _call_at(function, _AT_ONCE, get_ident())(*(each[part] for each in given))
        for whole, own in zip(found, values, strict=True):
            whole[part] = own
    return found
