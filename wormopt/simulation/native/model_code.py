"""C code of a model's functions, and the library it makes."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from functools import cache

import casadi as ca

from wormopt.simulation.native import loops
from wormopt.simulation.native.build import library, parts

# Instructions from which a function is told in loops, and lines from which one is cut in pieces.
_LONG, _TOO_LONG = 500, 2000
# Instructions up to which a right-hand side stands in the place of its calls in a step.
_SHORT = 100
_FUSED = 'static __attribute__((optimize("fp-contract=fast")))'  # as in lanes.h
_INLINE = "static inline __attribute__((always_inline))"
HEAD = """#include "numbers.h"
#include "elementary.h"
#define exp lane_exp
#define tanh lane_tanh
#define sin lane_sin
#define cos lane_cos
#define fmax lane_max
#define fmin lane_min
"""
"""What comes before the code: functions of its own, which are not calls of the C library."""
HEADERS = ("numbers.h", "elementary.h", "tableau.h", "stages.h")


def compiled(functions: Sequence[ca.Function]) -> tuple[ctypes.CDLL, int]:
    """Library of functions, and how many numbers they work on, see `source`.

    Raises CompilerError if there is no compiler or it fails.
    """
    text, n_w = source(functions)
    return _library(text), n_w


def source(functions: Sequence[ca.Function]) -> tuple[str, int]:
    """C code of functions for use in one file, and how many numbers they work on.

    The first is the right-hand side; `own_stages` comes with it where it is short. That of CasADi
    is without checks for absent arguments. The compiler's time grows with the square of the length
    of a function: long ones are told in loops.
    """
    short, texts, n_w = [], [], 0
    for function in functions:
        long = function.is_a("SXFunction") and function.n_instructions() >= _LONG
        told = loops.source(function) if long else None
        if told is None:
            short.append(function)
        else:
            texts.append(told[0])
            n_w = max(n_w, told[1])
    text = _generated(short, avoid_stack=False)
    if any(len(body[3].splitlines()) >= _TOO_LONG for body in _BODY.finditer(text)):
        text = _generated(short, avoid_stack=True)
    text = re.sub(r"^casadi_real (casadi_\w+\()", r"static inline casadi_real \1", text, flags=re.M)
    text = re.sub(r"arg\[(\d+)\]\? (arg\[\1\]\[\d+\]) : 0;", r"\2;", text)
    text = re.sub(r"if \(res\[(\d+)\]!=0\) ", "", text)
    text = _BODY.sub(_cut, text)
    rhs = functions[0]
    if short and short[0] is rhs and rhs.is_a("SXFunction"):
        own = rhs.n_instructions() <= _SHORT
        text = text.replace("static int casadi_f0(", f"{_INLINE if own else _FUSED} int casadi_f0(")
        texts += [f"#define N_X {rhs.numel_out(0)}", parts("own_stages.c")[0][1]] if own else []
    return "\n".join([HEAD, text, *texts]), n_w


def _generated(functions: Sequence[ca.Function], *, avoid_stack: bool) -> str:
    generator = ca.CodeGenerator("model.c", {"avoid_stack": avoid_stack})
    for function in functions:
        generator.add(function)
    return str(generator.dump())


_BODY = re.compile(
    r"^static int (casadi_f\d+)(\(.*?\)) \{\n(.*?)^\}", flags=re.MULTILINE | re.DOTALL
)


def _cut(function: re.Match[str]) -> str:
    """Cut the body of a generated function into functions of so many lines."""
    name, arguments, body = function.groups()
    lines = body.splitlines()
    if len(lines) < _TOO_LONG:
        return function[0]
    starts = range(0, len(lines) - 1, _TOO_LONG // 4)  # the last line returns
    pieces = ["\n".join(lines[k : k + _TOO_LONG // 4]) for k in starts]
    pieces[-1] = pieces[-1].removesuffix("\n" + lines[-1])
    cut = [
        f"__attribute__((noinline)) static void {name}_{k}{arguments} {{\n{p}\n}}\n"
        for k, p in enumerate(pieces)
    ]
    calls = "".join(f"  {name}_{k}(arg, res, iw, w, mem);\n" for k in range(len(pieces)))
    return "".join(cut) + f"static int {name}{arguments} {{\n{calls}{lines[-1]}\n}}"


@cache
def _library(text: str) -> ctypes.CDLL:
    # loops gain by vectors; what is written out does not
    level = "-O1" if "noinline" in text else "-O3" if "ivdep" in text else "-O2"
    return library("model", [*parts(*HEADERS), ("model.c", text)], level)
