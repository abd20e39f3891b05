"""One CasADi function, compiled: what calls it need not know."""

from __future__ import annotations

import casadi as ca

from wormopt.simulation.native.build import library

# Measured on the steps of a rod: -O2 compiles for longer and is no faster.
_LEVEL = "-O1"


def compiled(function: ca.Function) -> ca.Function:
    """Compile a function with everything it calls; it must be one that can be written as C.

    Raises CompilerError if there is no compiler or it fails.
    """
    generator = ca.CodeGenerator("function.c")
    generator.add(function)
    found = library("function", [("function.c", generator.dump())], _LEVEL)
    return ca.external(function.name(), found._name)  # noqa: SLF001  where ctypes keeps the path
