"""C code of functions of scalars, with loops over equal operations of many links.

A function is split into expressions: its results, and values used more than once. Independent
expressions of equal shape become a loop over vectors of eight; its inputs and outputs are indexed
by a rule, or by a table if there is none.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from wormopt.numerics.instructions import read
from wormopt.simulation.native.lanes import LANES, OPERATIONS, number

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


def source(function: ca.Function) -> tuple[str, int] | None:
    """C code in CasADi's form and number of working numbers; None if impossible."""
    if not function.is_a("SXFunction"):
        return None
    try:
        operations, places = read(function)
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
    """Arrays, shapes and rows, level by level, with w filled without gaps; and the size of w.

    A row is an instruction, the entry that it writes and those that it reads.
    """
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
