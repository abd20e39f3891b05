"""C code of long functions, with a loop for what is done to many links alike.

A function is cut into expressions: what it returns, and what is used more than once. Those of equal
shape that do not wait for one another make a loop; what they read and write is counted off, or
looked up in a table where there is no rule.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence

import casadi as ca
import numpy as np

from wormopt.simulation.native.instructions import read
from wormopt.simulation.native.lanes import OPERATIONS, number

# Operations of one expression: longer ones are cut, for a line shall not grow without end.
_LARGEST = 60
# Expressions of a shape that are worth a loop.
_FEWEST = 4

HEAD = """#include <math.h>
typedef double vec;
#define lane_sqrt sqrt
#define lane_abs fabs
#define lane_max fmax
#define lane_min fmin
#define lane_tanh tanh
#define lane_exp exp
#define lane_sin sin
#define lane_cos cos
#define lane_square(a) square(a)
#define lane_sign(a) sign(a)
#define TRUTH(condition) ((double)(condition))
#define WHERE(condition, a) ((condition) ? (a) : 0.0)
#define EACH(f, a) f(a)
#define EACH_2(f, a, b) f(a, b)
static inline double square(double a) { return a * a; }
static inline double sign(double a) { return a < 0 ? -1 : a > 0 ? 1 : a; }
"""

_ARGUMENTS = "const double **arg, double **res, long long *iw, double *w, int mem"

# Of an expression its shape in C, with $array; where an entry stands, these entries, the number of
# operations in it and of loops before it. No class, for there are many.
_Term = tuple[str, tuple[int, ...], int, int]
_PLACE = re.compile(r"\$(\w+);")
_NOTHING: _Term = ("", (), 0, 0)

# By loops before them, array and shape of what is put there: entries written and read, row by row.
_Groups = dict[tuple[int, str, str], list[tuple[int, ...]]]


def source(function: ca.Function) -> tuple[str, int] | None:
    """C code in CasADi's form and how many numbers it works on; None where there is none."""
    if not function.is_a("SXFunction"):
        return None
    operations, places = read(function)
    if not set(operations.tolist()) <= {*OPERATIONS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}:
        return None
    given = _writers(operations, places)
    shared = np.bincount(given[given >= 0], minlength=len(given)) > 1
    terms, shapes = _read(function, operations, places), dict[tuple[int, str, str], str]()
    groups: _Groups = defaultdict(list)
    n_w = 0
    todo = np.flatnonzero((operations != ca.OP_INPUT) & (operations != ca.OP_CONST))
    columns = (todo, operations[todo], *given[todo].T, shared[todo], *places[todo, :2].T)
    for k, op, first, second, often, output, entry in zip(
        *map(np.ndarray.tolist, columns), strict=True
    ):
        shape, entries, size, level = terms[first]
        if op == ca.OP_OUTPUT:
            groups[level, f"r{output}", shape].append((entry, *entries))
            continue
        other, more, size_, level_ = terms[second]
        key = (op, shape, other)
        if key not in shapes:
            shapes[key] = f"({OPERATIONS[op].format(shape, other)})"
        entries, size, level = entries + more, size + size_ + 1, max(level, level_)
        if often or size >= _LARGEST:
            groups[level, "w", shapes[key]].append((n_w, *entries))
            terms[k], n_w = ("$w;", (n_w,), 0, level + 1), n_w + 1
        else:
            terms[k] = shapes[key], entries, size, level
    return _code(function, groups), n_w


def _writers(operations: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Which instructions have made the two numbers that each one works on; -1 for none."""
    n, ends = len(operations), operations == ca.OP_OUTPUT
    taken = places[:, 1:].copy()
    taken[operations == ca.OP_INPUT] = -1
    taken[ends] = np.column_stack([places[ends, 2], np.full(ends.sum(), -1)])
    k = np.arange(n)
    made = np.sort((places[:, 0] * n + k)[~ends])  # by entry of CasADi's work array, then by time
    last = np.searchsorted(made, taken * n + k[:, None]) - 1
    return np.where(taken < 0, -1, made[last] % n)


def _read(function: ca.Function, operations: np.ndarray, places: np.ndarray) -> list[_Term]:
    """Terms of the instructions that read a number; behind all, one for what is not there."""
    terms = [_NOTHING] * (len(operations) + 1)
    arrays = [f"$a{i};" for i in range(function.n_in())]
    inputs = np.flatnonzero(operations == ca.OP_INPUT)
    for k, (_, array, entry) in zip(inputs.tolist(), places[inputs].tolist(), strict=True):
        terms[k] = arrays[array], (entry,), 0, 0
    for k in np.flatnonzero(operations == ca.OP_CONST).tolist():
        terms[k] = number(function.instruction_constant(k)), (), 0, 0
    return terms


def _code(function: ca.Function, groups: _Groups) -> str:
    """The function, level by level."""
    lines = [
        f"int {function.name()}({_ARGUMENTS})",
        "{",
        *(f"  const double *a{k} = arg[{k}];" for k in range(function.n_in())),
        *(f"  double *r{k} = res[{k}];" for k in range(function.n_out())),
    ]
    for (_, array, shape), rows in sorted(groups.items(), key=lambda group: group[0][0]):
        if len(rows) < _FEWEST:
            lines += [f"  {_statement(array, shape, row)}" for row in rows]
        else:
            lines += _loop(array, shape, np.array(rows))
    return "\n".join([*lines, "  return 0;", "}", ""])


def _loop(array: str, shape: str, rows: np.ndarray) -> list[str]:
    tables, entries = [], []
    for k, column in enumerate(rows.T):
        first, step = column[0], column[1] - column[0]
        if np.all(np.diff(column) == step):
            entries.append(f"{first} + {step} * i")
        else:
            values = ",".join(map(str, column.tolist()))
            tables.append(f"    static const int at{k}[] = {{{values}}};")
            entries.append(f"at{k}[i]")
    return [
        "  {",
        *tables,
        "#pragma GCC ivdep",
        f"    for (int i = 0; i < {len(rows)}; i++) {_statement(array, shape, entries)}",
        "  }",
    ]


def _statement(array: str, shape: str, entries: Sequence[int | str]) -> str:
    target, *read = entries
    waiting = iter(read)
    value = _PLACE.sub(lambda place: f"{place[1]}[{next(waiting)}]", shape)
    return f"{array}[{target}] = {value};"
