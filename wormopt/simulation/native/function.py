"""One CasADi function, compiled: what calls it need not know."""

from __future__ import annotations

import casadi as ca

from wormopt.simulation.native.build import CompilerError, library

# Measured on the steps of a rod: -O2 compiles for longer and is no faster.
_LEVEL = "-O1"


def compiled(function: ca.Function) -> ca.Function:
    """Compile a function with everything it calls; it must be one that can be written as C.

    Raises CompilerError if there is no compiler or it fails.
    """
    generator = ca.CodeGenerator("function.c")
    generator.add(function)
    found = library("function", [("function.c", generator.dump())], _LEVEL)
    try:
        return ca.external(function.name(), found._name)  # noqa: SLF001  where ctypes keeps the path
    except RuntimeError as error:  # on Windows of a path with letters that it does not understand
        raise CompilerError(f"CasADi does not load {found._name}") from error  # noqa: SLF001


def repeated(step: ca.Function, count: int) -> ca.Function:
    """So many calls of a function of a state and what stays; compiled where there is a compiler."""
    given = [ca.MX.sym(step.name_in(i), step.size1_in(i)) for i in range(step.n_in())]
    held = [ca.repmat(part, 1, count) for part in given[1:]]
    function = ca.Function("stride", given, [step.fold(count)(given[0], *held)])
    try:
        return compiled(function)
    except CompilerError:
        return function
