"""CasADi's expressions in SymPy, instruction by instruction, and whether they are zero.

Nothing is evaluated at points. What a Model says is read from its own instructions; where it has
branches, a proof tells the signs of what they hang on, and is done case by case. A double in an
expression is read as the one number it stands for: a fraction of small integers, that times a
power of pi, or its root. Others must be named, else nothing is read.
"""

from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Any, TypeVar

import casadi as ca
import sympy as sp
from sympy.polys.fields import field

from wormopt.model.model import Model
from wormopt.study import Given

Expression = Any  # of SymPy, whose types are loose
Signs = Mapping[Expression, int]
T = TypeVar("T")

_LARGEST = 1000  # denominator of a fraction that a double may stand for
_ROUNDING = 4.5e-16  # two units of the last place: constants are folded before they are seen
_NAMES = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}


class Undecided(Exception):
    """A branch hangs on a sign that the proof has not told."""


# -- numbers and nodes ----------------------------------------------------------------------------


def number(value: float, named: Mapping[float, Expression] | None = None) -> Expression:
    """What a double stands for; ValueError where that is not plain."""
    if value in (float("inf"), float("-inf")):
        return sp.oo if value > 0 else -sp.oo
    plain = _fraction(value)
    if plain is not None:
        return plain
    for power in (1, -1, 2, 3, 4):
        share = _fraction(value / float(sp.pi) ** power)
        if share is not None:
            return share * sp.pi**power
    square = _fraction(value * value)
    if square is not None:
        return sp.sign(value) * sp.sqrt(square)
    for known, symbol in (named or {}).items():
        share = _fraction(value / known)
        if share is not None:
            return share * symbol
    raise ValueError(f"{value!r} stands for no plain number; name it")


def _fraction(value: float) -> Expression | None:
    near = Fraction(value).limit_denominator(_LARGEST)
    close = abs(Fraction(value) - near) <= Fraction(_ROUNDING) * abs(near)
    return sp.Rational(near.numerator, near.denominator) if close else None


_STEPS: dict[int, Callable[..., Expression]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_SQ: lambda a: a**2,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_POW: lambda a, b: a**b,
    ca.OP_CONSTPOW: lambda a, b: a**b,
    ca.OP_SQRT: sp.sqrt,
    ca.OP_EXP: sp.exp,
    ca.OP_LOG: sp.log,
    ca.OP_LOG1P: lambda a: sp.log(1 + a),
    ca.OP_EXPM1: lambda a: sp.exp(a) - 1,
    ca.OP_HYPOT: lambda a, b: sp.sqrt(a**2 + b**2),
    ca.OP_SIN: sp.sin,
    ca.OP_COS: sp.cos,
    ca.OP_TAN: sp.tan,
    ca.OP_ASIN: sp.asin,
    ca.OP_ACOS: sp.acos,
    ca.OP_ATAN: sp.atan,
    ca.OP_ATAN2: sp.atan2,
    ca.OP_SINH: sp.sinh,
    ca.OP_COSH: sp.cosh,
    ca.OP_TANH: sp.tanh,
    ca.OP_FLOOR: sp.floor,
    # truths are 0 and 1, with which CasADi reckons on
    ca.OP_NOT: lambda a: 1 - a,
    ca.OP_AND: lambda a, b: a * b,
    ca.OP_OR: lambda a, b: a + b - a * b,
    ca.OP_IF_ELSE_ZERO: lambda a, b: b if a else sp.Integer(0),
}
# Nodes that hang on the sign of something: of what, and what they are for that sign.
_BRANCHES: dict[int, tuple[Callable[..., Expression], Callable[..., Any]]] = {
    ca.OP_LT: (lambda a, b: b - a, lambda s, a, b: s > 0),
    ca.OP_LE: (lambda a, b: b - a, lambda s, a, b: s >= 0),
    ca.OP_EQ: (lambda a, b: b - a, lambda s, a, b: s == 0),
    ca.OP_NE: (lambda a, b: b - a, lambda s, a, b: s != 0),
    ca.OP_FMAX: (lambda a, b: a - b, lambda s, a, b: a if s >= 0 else b),
    ca.OP_FMIN: (lambda a, b: a - b, lambda s, a, b: b if s >= 0 else a),
    ca.OP_SIGN: (lambda a: a, lambda s, a: s),
    ca.OP_FABS: (lambda a: a, lambda s, a: s * a),
}


class Symbols:
    """Symbols of SymPy for columns of CasADi; called with an expression, the same in SymPy."""

    def __init__(
        self,
        columns: Mapping[str, ca.SX],
        positive: Iterable[str] = (),
        constants: Mapping[float, Expression] | None = None,
    ) -> None:
        """`positive`: names of columns that are; `constants`: what other doubles stand for."""
        self._columns, self._constants = dict(columns), constants
        above = set(positive)
        self._known = {
            name: sp.Matrix([
                sp.Symbol(name if column.numel() == 1 else f"{name}{i}", real=True,
                          positive=True if name in above else None)
                for i in range(column.numel())
            ])
            for name, column in self._columns.items()
        }  # fmt: skip

    @classmethod
    def of(cls, model: Model, positive: Iterable[str] = (), **more: Any) -> "Symbols":
        """All of a Model's symbols by their names; ``contact`` and ``pressed`` are forces."""
        pressed = [c.normal_force for c in model.contacts if c.normal_force is not None]
        columns = {s.name: s.symbol for s in (*model.x, *model.z, *model.u, *model.p)}
        columns |= {"t": model.t, "contact": model.forces, "pressed": ca.vertcat(*pressed)}
        for schedule in model.schedules:
            columns |= {schedule.name: schedule.symbol, f"{schedule.name}_begin": schedule.begin}
        return cls(columns | more.pop("columns", {}), positive, **more)

    def __getitem__(self, name: str) -> Expression:
        """Column of symbols of a name, or the only one."""
        column = self._known[name]
        return column[0] if len(column) == 1 else column

    def column(self, *names: str) -> Expression:
        """Symbols of several names below each other."""
        return sp.Matrix.vstack(*(self._known[name] for name in names))

    def __call__(self, expression: Any, signs: Signs | None = None) -> Expression:
        """The expression as a matrix of SymPy; `signs`: of what its branches hang on."""
        dense = ca.densify(ca.SX(expression))
        function = ca.Function("f", list(self._columns.values()), [dense])
        names = list(self._columns)
        work: list[Any] = [sp.Integer(0)] * function.sz_w()
        found: list[Any] = [sp.Integer(0)] * dense.numel()
        steps: Any = function
        for k in range(function.n_instructions()):
            op, i, o = (f(k) for f in (steps.instruction_id, steps.instruction_input,
                                       steps.instruction_output))  # fmt: skip
            if op == ca.OP_INPUT:
                work[o[0]] = self._known[names[i[0]]][i[1]]
            elif op == ca.OP_OUTPUT:
                found[o[1]] = work[i[0]]
            elif op == ca.OP_CONST:
                work[o[0]] = number(function.instruction_constant(k), self._constants)
            else:
                work[o[0]] = _node(op, [work[j] for j in i], signs or {})
        return sp.Matrix(*dense.shape[::-1], found).T

    def one(self, expression: Any, signs: Signs | None = None) -> Expression:
        """The same of a scalar."""
        (found,) = self(expression, signs)
        return found


def _node(op: int, values: list[Expression], signs: Signs) -> Expression:
    if op in _BRANCHES:
        of, becomes = _BRANCHES[op]
        return sp.Integer(0) + becomes(_sign(of(*values), signs), *values)
    if op not in _STEPS:
        raise NotImplementedError(f"no meaning is known of the node {_NAMES.get(op, op)}")
    return _STEPS[op](*values)


def _sign(value: Expression, signs: Signs) -> int:
    for sign, holds in ((1, value.is_positive), (-1, value.is_negative), (0, value.is_zero)):
        if holds:
            return sign
    for known, sign in signs.items():
        share = sp.cancel(value / known)
        if share.is_nonzero and share.is_extended_real:
            return sign if share.is_positive else -sign if share.is_negative else _fail(value)
    return _fail(value)


def _fail(value: Expression) -> int:
    raise Undecided(f"tell the sign of {value}")


def unchecked(kind: type[T], **fields: Any) -> T:
    """A dataclass or table that refuses all but numbers, with symbols in their place."""
    if issubclass(kind, Given):
        return kind.of_checked(dict.fromkeys(kind.__struct_fields__) | fields)
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


# -- whether it is zero ---------------------------------------------------------------------------


def zero(expression: Expression) -> bool:
    """Whether it is identically zero, or all entries of a matrix are; True is a proof.

    Roots, sines and cosines become unknowns with their relations, r^q = f and s² + c² = 1; other
    functions are unknowns of their own. What is left is a polynomial, of which all coefficients
    must vanish.
    """
    if isinstance(expression, sp.MatrixBase):
        return all(zero(entry) for entry in expression)
    plain = sp.sympify(expression).replace(sp.tan, lambda a: sp.sin(a) / sp.cos(a))
    return plain == 0 or _Lifted(plain).vanishes()


class _Lifted:
    """An expression as a rational function of unknowns, and the relations among them."""

    def __init__(self, expression: Expression) -> None:
        self._unknowns: dict[Expression, Expression] = {}
        self._relations: list[tuple[Expression, int, Expression]] = []  # r, q, f of r^q = f
        self._whole = self._lift(expression)

    def vanishes(self) -> bool:
        top = _numerator(self._whole)
        for root, power, value in reversed(self._relations):
            if top.has(root):
                top = _numerator(_reduced(top, root, power, value))
        return bool(top == 0)

    def _lift(self, e: Expression) -> Expression:
        if e.is_Rational or e.is_Symbol:
            return e
        if e.is_Add or e.is_Mul:
            return e.func(*(self._lift(part) for part in e.args))
        if e.is_Pow and e.exp.is_Rational:
            return self._root(self._lift(e.base), e.exp)
        if isinstance(e, sp.sin | sp.cos):
            return self._turn(e)
        return self._unknown(e)

    def _root(self, base: Expression, exponent: Expression) -> Expression:
        if exponent.q == 1:
            return base**exponent
        base = sp.factor(base)
        known = (base, exponent.q) in self._unknowns
        root = self._unknown((base, exponent.q))
        if not known:
            self._relations.append((root, int(exponent.q), base))
        return root**exponent.p

    def _turn(self, e: Expression) -> Expression:
        angle = sp.expand(e.args[0])
        plain = e.func(angle)  # half turns and signs of angles are taken out
        if not isinstance(plain, sp.sin | sp.cos) or plain.args[0] != angle:
            return self._lift(plain)
        known = ("cos", angle) in self._unknowns
        s, c = self._unknown(("sin", angle)), self._unknown(("cos", angle))
        if not known:
            self._relations.append((s, 2, 1 - c**2))
        return s if isinstance(e, sp.sin) else c

    def _unknown(self, key: Any) -> Expression:
        return self._unknowns.setdefault(key, sp.Dummy())


def _numerator(e: Expression) -> Expression:
    symbols = sorted(e.free_symbols, key=str)
    return field(symbols, sp.QQ)[0].from_expr(e).numer.as_expr() if symbols else e


def _reduced(top: Expression, root: Expression, power: int, value: Expression) -> Expression:
    """A polynomial in a root, with its powers from `power` on replaced."""
    coefficients = sp.Poly(top, root).all_coeffs()[::-1]
    return sp.Add(*(c * root ** (k % power) * value ** (k // power)
                    for k, c in enumerate(coefficients)))  # fmt: skip
