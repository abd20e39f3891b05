"""C code of a model's functions, and its library."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from functools import cache

import casadi as ca

from wormopt.simulation.native import loops
from wormopt.simulation.native.build import library, parts

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
    """Library of functions, and their number of working numbers, see `source`.

    Raises CompilerError if there is no compiler or it fails.
    """
    text, n_w = source(functions)
    return _library(text), n_w


def source(functions: Sequence[ca.Function]) -> tuple[str, int]:
    """C code of functions for use in one file, and their number of working numbers.

    The first is the right-hand side; `own_stages` is added if it is short. CasADi writes functions
    with own loops or unusual operations.
    """
    sources = [loops.source(function) for function in functions]
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
        return f"{loops.FUSED}\n{text}"
    inlined = text.replace("int rhs(", f"{_INLINE} int own_rhs(")
    called = (
        f"{loops.FUSED}\nint rhs({loops.ARGUMENTS}) {{ return own_rhs(arg, res, iw, work, mem); }}"
    )
    stages = [f"#define N_X {rhs.numel_out(0)}", parts("own_stages.c")[0][1]]
    return "\n".join([inlined, called, *stages])


def _generated(functions: Sequence[ca.Function]) -> str:
    """CasADi's code of functions, without checks for absent arguments.

    The compiler's time grows quadratically with the length of a function: long ones are split.
    """
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
