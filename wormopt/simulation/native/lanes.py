"""Right-hand sides for several runs at a time: C in which every number is a vector of runs."""

from __future__ import annotations

import ctypes
from functools import cache, lru_cache

import casadi as ca

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
def compiled(system: System) -> ctypes.CDLL | None:
    """`rhs` of a system for lanes; None if it is too long or has operations without vectors.

    Raises CompilerError if there is no compiler or it fails.
    """
    text = source(system.rhs)
    return None if text is None else _library(text)


@cache
def _library(text: str) -> ctypes.CDLL:
    return library("lanes", [*parts("lanes.h", "elementary.h"), ("lanes.c", text)], "-O2")


def source(function: ca.Function) -> str | None:
    """C code of a function of (t, x, p, s), one line per instruction; None if impossible."""
    if not function.is_a("SXFunction") or function.n_instructions() > _LONGEST:
        return None
    lines, declared = [], set[int]()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        given, result = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            lines.append(f"    dx[{result[1]}] = a{given[0]};")
            continue
        if operation == ca.OP_INPUT:
            value = f"{'txps'[given[0]]}[{given[1]}]"
        elif operation == ca.OP_CONST:
            value = f"ALL({number(function.instruction_constant(k))})"
        elif operation in OPERATIONS:
            value = OPERATIONS[operation].format(*(f"a{i}" for i in given))
        else:
            return None
        kind = "" if result[0] in declared else "vec "
        declared.add(result[0])
        lines.append(f"    {kind}a{result[0]} = {value};")
    return "\n".join([_HEAD, "{", *lines, "}", ""])


def number(value: float) -> str:
    """Format a number in C exactly."""
    known = {"inf": "__builtin_inf()", "-inf": "-__builtin_inf()", "nan": '__builtin_nan("")'}
    return known.get(str(value), value.hex())
