"""C code of long functions, with a loop for what is done to many links alike.

A function is cut into expressions: what it returns, and what is used more than once. Those of equal
shape that do not wait for one another make a loop; what they read and write is counted off, or
looked up in a table where there is no rule.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from wormopt.simulation.native.lanes import OPERATIONS, number

# Operations of one expression: longer ones are cut, for a line shall not grow without end.
_LARGEST = 60
# Expressions of a shape that are worth a loop.
_FEWEST = 4

_ARGUMENTS = "const double **arg, double **res, long long *iw, double *w, int mem"

Place = tuple[str, int]  # array and entry
_PLACE = re.compile(r"\$(\w+);")


@dataclass(frozen=True)
class _Term:
    """An expression in C, with $array; where an entry stands."""

    shape: str
    places: tuple[Place, ...]
    size: int  # operations
    level: int  # loops before it


def _read(array: str, entry: int, level: int) -> _Term:
    return _Term(f"${array};", ((array, entry),), 0, level)


def source(function: ca.Function) -> tuple[str, int] | None:
    """C code in CasADi's form and how many numbers it works on; None where there is none."""
    if not function.is_a("SXFunction"):
        return None
    count = function.n_instructions()
    operations = [function.instruction_id(k) for k in range(count)]
    if any(op not in OPERATIONS and op not in _ENDS for op in operations):
        return None
    given = [function.instruction_input(k) for k in range(count)]
    target = [function.instruction_output(k) for k in range(count)]
    uses = _uses(operations, given, target)
    groups: dict[tuple[int, str], list[tuple[Place, ...]]] = defaultdict(list)
    terms: dict[int, _Term] = {}  # by entry of CasADi's work array, as it is now
    n_w = 0
    for k, op in enumerate(operations):
        if op == ca.OP_OUTPUT:
            term, (output, entry) = terms[given[k][0]], target[k]
            groups[term.level, term.shape].append(((f"r{output}", entry), *term.places))
        elif op == ca.OP_INPUT:
            terms[target[k][0]] = _read(f"a{given[k][0]}", given[k][1], 0)
        elif op == ca.OP_CONST:
            terms[target[k][0]] = _Term(number(function.instruction_constant(k)), (), 0, 0)
        else:
            term = _applied(OPERATIONS[op], [terms[i] for i in given[k]])
            if uses[k] > 1 or term.size >= _LARGEST:
                groups[term.level, term.shape].append((("w", n_w), *term.places))
                term, n_w = _read("w", n_w, term.level + 1), n_w + 1
            terms[target[k][0]] = term
    return _code(function, groups), n_w


_ENDS = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)


def _uses(operations: list[int], given: list[list[int]], target: list[list[int]]) -> list[int]:
    """How often the result of each instruction is used."""
    uses, writer = [0] * len(operations), dict[int, int]()
    for k, op in enumerate(operations):
        if op != ca.OP_INPUT:
            for i in given[k]:
                uses[writer[i]] += 1
        if op != ca.OP_OUTPUT:
            writer[target[k][0]] = k
    return uses


def _applied(operation: str, terms: list[_Term]) -> _Term:
    return _Term(
        f"({operation.format(*(term.shape for term in terms))})",
        tuple(place for term in terms for place in term.places),
        1 + sum(term.size for term in terms),
        max(term.level for term in terms),
    )


def _code(function: ca.Function, groups: dict[tuple[int, str], list[tuple[Place, ...]]]) -> str:
    """The function, level by level."""
    lines = [
        f"int {function.name()}({_ARGUMENTS})",
        "{",
        *(f"  const double *a{k} = arg[{k}];" for k in range(function.n_in())),
        *(f"  double *r{k} = res[{k}];" for k in range(function.n_out())),
    ]
    for (_, shape), rows in sorted(groups.items(), key=lambda group: group[0][0]):
        if len(rows) < _FEWEST:
            lines += [f"  {_statement(shape, [f'{a}[{i}]' for a, i in row])}" for row in rows]
        else:
            lines += _loop(shape, rows)
    return "\n".join([*lines, "  return 0;", "}", ""])


def _loop(shape: str, rows: list[tuple[Place, ...]]) -> list[str]:
    tables, entries = [], []
    for number_, column in enumerate(zip(*rows, strict=True)):
        array, counted = column[0][0], [entry for _, entry in column]
        rule = _rule(counted)
        if rule is None:
            values = ",".join(map(str, counted))
            tables.append(f"    static const int at{number_}[] = {{{values}}};")
            rule = f"at{number_}[i]"
        entries.append(f"{array}[{rule}]")
    return [
        "  {",
        *tables,
        "#pragma GCC ivdep",
        f"    for (int i = 0; i < {len(rows)}; i++) {_statement(shape, entries)}",
        "  }",
    ]


def _rule(entries: Sequence[int]) -> str | None:
    """How entries follow from their number, where they do."""
    first, step = entries[0], entries[1] - entries[0]
    regular = all(entry == first + step * k for k, entry in enumerate(entries))
    return f"{first} + {step} * i" if regular else None


def _statement(shape: str, entries: list[str]) -> str:
    target, *read = entries
    waiting = iter(read)
    return f"{target} = {_PLACE.sub(lambda _: next(waiting), shape)};"
