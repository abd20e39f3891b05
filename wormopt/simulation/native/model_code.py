"""C code of a model's functions: as CasADi writes it, with loops over links, or for runs in lanes.

A function is split into expressions: its results, and values used more than once. Independent
expressions of equal shape become a loop over vectors of eight; its inputs and outputs are indexed
by a rule, or by a table if there is none.
"""

from __future__ import annotations

import ctypes
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from wormopt.numerics.expressions import AtPlaces, instructions_of
from wormopt.simulation.functions import System
from wormopt.simulation.native.build import library, parts

LANES = 8
"""Runs side by side, as in lanes.h."""

# Most instructions; beyond, compiling costs more than vectors save.
_LONGEST = 5_000

OPERATIONS = {
    ca.OP_ASSIGN: "{}",
    ca.OP_ADD: "{} + {}",
    ca.OP_SUB: "{} - {}",
    ca.OP_MUL: "{} * {}",
    ca.OP_DIV: "{} / {}",
    ca.OP_NEG: "-{}",
    ca.OP_INV: "1.0 / {}",
    ca.OP_SQ: "lane_square({})",
    ca.OP_TWICE: "2.0 * {}",
    ca.OP_SQRT: "lane_sqrt({})",
    ca.OP_FABS: "lane_abs({})",
    ca.OP_SIGN: "lane_sign({})",
    ca.OP_FMAX: "lane_max({}, {})",
    ca.OP_FMIN: "lane_min({}, {})",
    ca.OP_TANH: "lane_tanh({})",
    ca.OP_EXP: "lane_exp({})",
    ca.OP_SIN: "lane_sin({})",
    ca.OP_COS: "lane_cos({})",
    ca.OP_LT: "TRUTH({} < {})",
    ca.OP_LE: "TRUTH({} <= {})",
    ca.OP_EQ: "TRUTH({} == {})",
    ca.OP_NE: "TRUTH({} != {})",
    ca.OP_NOT: "TRUTH({} == 0.0)",
    ca.OP_AND: "TRUTH(({} != 0.0) & ({} != 0.0))",
    ca.OP_OR: "TRUTH(({} != 0.0) | ({} != 0.0))",
    ca.OP_IF_ELSE_ZERO: "WHERE({} != 0.0, {})",
    **{
        getattr(ca, f"OP_{name.upper()}"): f"EACH({name}, {{}})"
        for name in (
            *("tan", "asin", "acos", "atan", "sinh", "cosh", "asinh", "acosh", "atanh"),
            *("log", "log1p", "expm1", "floor", "ceil", "erf"),
        )
    },
    ca.OP_POW: "EACH_2(pow, {}, {})",
    ca.OP_CONSTPOW: "EACH_2(pow, {}, {})",
    ca.OP_FMOD: "EACH_2(fmod, {}, {})",
    ca.OP_HYPOT: "EACH_2(hypot, {}, {})",
    ca.OP_ATAN2: "EACH_2(atan2, {}, {})",
    ca.OP_COPYSIGN: "EACH_2(copysign, {}, {})",
}

_HEAD = """#include "lanes.h"
#include "elementary.h"

void rhs(const vec *t, const vec *x, const vec *p, const vec *s, vec *restrict dx)"""


@lru_cache(maxsize=64)
def compiled_lanes(system: System) -> ctypes.CDLL | None:
    """`rhs` of a system for lanes; None if it is too long or has operations without vectors."""
    text = lanes_source(system.rhs)
    return None if text is None else _lanes_library(text)


@cache
def _lanes_library(text: str) -> ctypes.CDLL:
    return library("lanes", [*parts("lanes.h", "elementary.h"), ("lanes.c", text)], "-O2")


def lanes_source(function: ca.Function) -> str | None:
    """C code of a function of (t, x, p, s), one line per instruction; None if impossible."""
    lines = in_vectors(function, [f"{name}[{{}}]" for name in "txps"], "dx[{}] = {}")
    return None if lines is None else "\n".join([_HEAD, "{", *lines, "}", ""])


def places_source(at: AtPlaces) -> str | None:
    """C code of `at.function` in CasADi's form, eight places at a time; None if impossible."""
    count = len(at.weights)
    if count < LANES:
        return None
    try:
        one = at.one.expand()
    except RuntimeError:
        return None
    given = [f"NEXT(arg[0][{count} * {{}} + i])", "ALL(arg[1][{}])", "NEXT(weight[i])"]
    lines = in_vectors(one, given, f"NEXT(res[0][{count} * {{}} + i]) = {{}}")
    if lines is None:
        return None
    return "\n".join([
        '#include "vectors.h"',
        '#pragma GCC optimize("fp-contract=fast")',
        f"static const double weight[] = {{{', '.join(map(number, at.weights.tolist()))}}};",
        f"int {at.function.name()}({ARGUMENTS})",
        "{",
        f"  for (int k = 0; k < {count}; k += LANES) {{",
        f"    const int i = k < {count - LANES} ? k : {count - LANES};",
        *lines,
        "  }",
        "  return 0;",
        "}",
        "",
    ])  # fmt: skip


def places_library(at: AtPlaces) -> ctypes.CDLL | None:
    """`at.function` in vectors; None if impossible."""
    text = places_source(at)
    return None if text is None else _library(text)


def in_vectors(function: ca.Function, inputs: Sequence[str], output: str) -> list[str] | None:
    """C code in vectors, one line per instruction, with formats of entries; None if impossible."""
    if not function.is_a("SXFunction") or function.n_instructions() > _LONGEST:
        return None
    lines, declared = [], set[int]()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        given, result = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            lines.append(f"    {output.format(result[1], f'a{given[0]}')};")
            continue
        if operation == ca.OP_INPUT:
            value = inputs[int(given[0])].format(given[1])
        elif operation == ca.OP_CONST:
            value = f"ALL({number(function.instruction_constant(k))})"
        elif operation in OPERATIONS:
            value = OPERATIONS[operation].format(*(f"a{i}" for i in given))
        else:
            return None
        kind = "" if result[0] in declared else "vec "
        declared.add(result[0])
        lines.append(f"    {kind}a{result[0]} = {value};")
    return lines


def number(value: float) -> str:
    """Format a number in C exactly."""
    known = {"inf": "__builtin_inf()", "-inf": "-__builtin_inf()", "nan": '__builtin_nan("")'}
    return known.get(str(value), value.hex())


# Most operations of one expression: longer ones are split to limit the length of lines.
_LARGEST = 60
# Up to this many working numbers are local, so that the compiler can keep them in registers.
_AT_HAND = 256

# Prefix of the names of operations with one number, instead of vectors.
_ONE = "one_"
_NAMES = "lane_(?:sqrt|abs|max|min|square|sign|tanh|exp|sin|cos)|ALL|TRUTH|WHERE|EACH_2|EACH"
_OF_VECTORS = re.compile(rf"\b(?={_NAMES}\b)")

FUSED = '__attribute__((optimize("fp-contract=fast")))'
"""Fuse multiply-add, as in lanes.h."""
ARGUMENTS = "const double **arg, double **res, long long *iw, double *work, int mem"

# By number of preceding loops, array and shape of the result: its instructions.
_Groups = dict[tuple[int, str, str], list[int]]
_PLACE = re.compile(r"\$(\w+);")


class _Expression(NamedTuple):
    """Expression of an instruction without entries: the same shape may occur elsewhere."""

    shape: str  # in C, with $array for an entry
    size: int = 0  # operations
    level: int = 0  # preceding loops


def loop_source(function: ca.Function) -> tuple[str, int] | None:
    """C code in CasADi's form and number of working numbers; None if impossible."""
    if not function.is_a("SXFunction"):
        return None
    try:
        operations, places = instructions_of(function)
    except ValueError:
        return None
    if not set(operations.tolist()) <= {*OPERATIONS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}:
        return None
    given = _writers(operations, places)
    groups, n_w = _placed(_grouped(function, operations, places, given), operations, places, given)
    vectors = any(len(rows) >= LANES for _, _, rows in groups)
    lines = [
        *([FUSED] if vectors else []),
        f"int {function.name()}({ARGUMENTS})",
        "{",
        f"  double w[{n_w}];" if 0 < n_w <= _AT_HAND else "  double *restrict w = work;",
        *(f"  const double *restrict a{k} = arg[{k}];" for k in range(function.n_in())),
        *(f"  double *restrict r{k} = res[{k}];" for k in range(function.n_out())),
    ]
    # operations outside loops keep CasADi's order, so that few values wait in registers
    code: list[tuple[int, list[str]]] = []
    for array, shape, rows in groups:
        if len(rows) < LANES:
            code += [(k, [f"  {_statement(array, shape, row)}"]) for k, *row in rows.tolist()]
        else:
            code.append((rows[-1, 0], _loop(array, shape, rows[:, 1:])))
    if not vectors:
        code.sort(key=lambda one: one[0])
    lines += [line for _, each in code for line in each]
    return "\n".join([*lines, "  return 0;", "}", ""]), n_w


def _grouped(
    function: ca.Function, operations: np.ndarray, places: np.ndarray, given: np.ndarray
) -> _Groups:
    """Expressions by shape; those used more than once are stored in w."""
    groups: _Groups = defaultdict(list)

    @cache
    def joined(op: int, a: _Expression, b: _Expression, put: int) -> tuple[_Expression, list[int]]:
        """Expression of an operation, and its group, or a list that is discarded.

        `put`: index of the output, else whether it is stored in w.
        """
        if op == ca.OP_OUTPUT:
            return a, groups[a.level, f"r{put}", a.shape]
        shape = f"({OPERATIONS[op].format(a.shape, b.shape)})"
        size, level = a.size + b.size + 1, max(a.level, b.level)
        if put or size >= _LARGEST:
            return _Expression("$w;", 0, level + 1), groups[level, "w", shape]
        return _Expression(shape, size, level), []

    inputs, constants, ends = (operations == op for op in (ca.OP_INPUT, ca.OP_CONST, ca.OP_OUTPUT))
    arrays = [*(_Expression(f"$a{i};") for i in range(function.n_in())), _Expression("")]
    # by instruction; the last represents none
    found = [arrays[i] for i in np.append(np.where(inputs, places[:, 1], -1), -1).tolist()]
    for k in np.flatnonzero(constants).tolist():
        found[k] = _Expression(f"ALL({number(function.instruction_constant(k))})")
    shared = np.bincount(given[given >= 0], minlength=len(given)) > 1
    put = np.where(ends, places[:, 0], shared)
    todo = np.flatnonzero(~(inputs | constants))
    columns = (todo, operations[todo], *given[todo].T, put[todo])
    for k, op, a, b, to in zip(*(column.tolist() for column in columns), strict=True):
        found[k], group = joined(op, found[a], found[b], to)
        group.append(k)
    return groups


def _writers(operations: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Instructions that compute both operands of each instruction; -1 for none."""
    n, ends = len(operations), operations == ca.OP_OUTPUT
    taken = places[:, 1:].copy()
    taken[operations == ca.OP_INPUT] = -1
    taken[ends] = np.column_stack([places[ends, 2], np.full(ends.sum(), -1)])
    k = np.arange(n)
    made = np.sort((places[:, 0] * n + k)[~ends])  # by entry of CasADi's work array, then by time
    there = taken >= 0
    last = np.searchsorted(made, (taken * n + k[:, None])[there]) - 1
    taken[there] = made[last] % n
    return taken


def _placed(
    groups: _Groups, operations: np.ndarray, places: np.ndarray, given: np.ndarray
) -> tuple[list[tuple[str, str, np.ndarray]], int]:
    """Arrays, shapes and rows, level by level, with w filled without gaps; and the size of w."""
    # A row is an instruction, the entry that it writes and those that it reads.
    entry = np.full(len(operations), -1)  # of inputs, outputs and entries of w
    for op, column in ((ca.OP_INPUT, 2), (ca.OP_OUTPUT, 1)):
        entry[operations == op] = places[operations == op, column]

    def taken(k: np.ndarray) -> Iterator[np.ndarray]:
        """Entries that equal expressions read, operand by operand."""
        for column in given.T:
            a = column[k]
            if a[0] >= 0:
                yield from (entry[a],) if entry[a[0]] >= 0 else taken(a)

    n_w, found = 0, []
    for (_, array, shape), listed in sorted(groups.items(), key=lambda group: group[0][0]):
        k = np.array(listed)
        if array == "w":
            entry[k] = np.arange(n_w, n_w + len(k))
            n_w += len(k)
        found.append((array, shape, np.array([k, entry[k], *taken(k)]).T))
    return found, n_w


def _statement(array: str, shape: str, row: Sequence[int]) -> str:
    target, *entries = row
    waiting = iter(entries)
    value = _PLACE.sub(lambda place: f"{place[1]}[{next(waiting)}]", _OF_VECTORS.sub(_ONE, shape))
    return f"{array}[{target}] = {value};"


def _loop(array: str, shape: str, rows: np.ndarray) -> list[str]:
    """All rows of a shape, eight at a time; the last eight may repeat some."""
    arrays, tables, places = [array, *_PLACE.findall(shape)], [], []
    for k, (name, column) in enumerate(zip(arrays, rows.T, strict=True)):
        first, step = column[0], column[1] - column[0]
        if np.any(np.diff(column) != step):
            values = ",".join(map(str, column.tolist()))
            tables.append(f"    static const int at{k}[] = {{{values}}};")
            places.append(f"EVERY({name}[at{k}[i + l]])")
        elif step == 0:
            places.append(f"ALL({name}[{first}])")
        elif step == 1:
            places.append(f"NEXT({name}[{first} + i])")
        else:
            places.append(f"EVERY({name}[{first} + {step} * (i + l)])")
    target, *entries = places
    waiting = iter(entries)
    value = _PLACE.sub(lambda _: next(waiting), shape)
    if target.startswith("NEXT"):
        put = f"{target} = {value};"
    else:
        put = f"SPREAD({target[len('EVERY(') : -1]}, {value});"
    last = len(rows) - LANES
    return [
        "  {",
        *tables,
        f"    for (int k = 0; k < {len(rows)}; k += LANES) {{",
        f"      const int i = k < {last} ? k : {last};",
        f"      {put}",
        "    }",
        "  }",
    ]


# Lines from which a generated function is split.
_TOO_LONG = 2000
_APART = '__attribute__((noinline, optimize("O1")))'
# Most instructions of a right-hand side that is inlined in a step.
_SHORT = 100
_INLINE = "static inline __attribute__((always_inline))"
HEADERS = (
    *("numbers.h", "lanes.h", "elementary.h", "singles.h", "vectors.h"),
    *("tableau.h", "stages.h"),
)


def head(texts: Sequence[str]) -> str:
    """Include of own functions, for vectors if the code has loops."""
    loops_in_it = any("LANES" in text for text in texts)
    return f'#include "{"vectors" if loops_in_it else "singles"}.h"\n'


def compiled(functions: Sequence[ca.Function]) -> tuple[ctypes.CDLL, int]:
    """Library of functions, and their number of working numbers, see `source`."""
    text, n_w = source(functions)
    return _library(text), n_w


def source(functions: Sequence[ca.Function]) -> tuple[str, int]:
    """C code of functions for use in one file, and their number of working numbers.

    The first is the right-hand side; `own_stages` is added if it is short. CasADi writes functions
    with own loops or unusual operations.
    """
    sources = [loop_source(function) for function in functions]
    texts = [one[0] for one in sources if one]
    others = [function for function, one in zip(functions, sources, strict=True) if one is None]
    if sources[0]:
        texts[0] = _right_hand_side(functions[0], texts[0])
    texts = [head(texts), *texts]
    if others:  # their math.h must precede macros of its names
        texts = ["#include <math.h>", *texts, _generated(others)]
    return "\n".join(texts), max(one[1] if one else 0 for one in sources)


def _right_hand_side(rhs: ca.Function, text: str) -> str:
    """Code of the right-hand side with fused multiply-add; with the stages of a step if short."""
    if rhs.n_instructions() > _SHORT:
        return f"{FUSED}\n{text}"
    inlined = text.replace("int rhs(", f"{_INLINE} int own_rhs(")
    called = f"{FUSED}\nint rhs({ARGUMENTS}) {{ return own_rhs(arg, res, iw, work, mem); }}"
    stages = [f"#define N_X {rhs.numel_out(0)}", parts("own_stages.c")[0][1]]
    return "\n".join([inlined, called, *stages])


def _generated(functions: Sequence[ca.Function]) -> str:
    """CasADi's code of functions, without checks for absent arguments."""
    # The compiler's time grows quadratically with the length of a function: long ones are split.
    text = _dumped(functions, avoid_stack=False)
    if any(len(body[3].splitlines()) >= _TOO_LONG for body in _BODY.finditer(text)):
        text = _dumped(functions, avoid_stack=True)
    text = re.sub(r"^casadi_real (casadi_\w+\()", r"static inline casadi_real \1", text, flags=re.M)
    text = re.sub(r"arg\[(\d+)\]\? (arg\[\1\]\[\d+\]) : 0;", r"\2;", text)
    text = re.sub(r"if \(res\[(\d+)\]!=0\) ", "", text)
    return _BODY.sub(_cut, text)


def _dumped(functions: Sequence[ca.Function], *, avoid_stack: bool) -> str:
    generator = ca.CodeGenerator("model.c", {"avoid_stack": avoid_stack})
    for function in functions:
        generator.add(function)
    return str(generator.dump())


_BODY = re.compile(
    r"^static int (casadi_f\d+)(\(.*?\)) \{\n(.*?)^\}", flags=re.MULTILINE | re.DOTALL
)


def _cut(function: re.Match[str]) -> str:
    """Split the body of a generated function into functions of at most this many lines."""
    name, arguments, body = function.groups()
    lines = body.splitlines()
    if len(lines) < _TOO_LONG:
        return function[0]
    starts = range(0, len(lines) - 1, _TOO_LONG // 4)  # the last line returns
    pieces = ["\n".join(lines[k : k + _TOO_LONG // 4]) for k in starts]
    pieces[-1] = pieces[-1].removesuffix("\n" + lines[-1])
    cut = [
        f"{_APART} static void {name}_{k}{arguments} {{\n{p}\n}}\n" for k, p in enumerate(pieces)
    ]
    calls = "".join(f"  {name}_{k}(arg, res, iw, w, mem);\n" for k in range(len(pieces)))
    return "".join(cut) + f"static int {name}{arguments} {{\n{calls}{lines[-1]}\n}}"


@cache
def _library(text: str) -> ctypes.CDLL:
    return library("model", [*parts(*HEADERS), ("model.c", text)])
