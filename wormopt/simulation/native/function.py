"""One CasADi function, compiled or not."""

from __future__ import annotations

import casadi as ca

from wormopt.simulation.native.build import CompilerError, library

# Measured on the steps of a rod: -O2 compiles longer and runs no faster.
_LEVEL = "-O1"


def compiled(function: ca.Function) -> ca.Function:
    """Compile a function with everything it calls; CasADi must be able to write it as C.

    Raises CompilerError if there is no compiler or it fails.
    """
    generator = ca.CodeGenerator("function.c")
    generator.add(function)
    found = library("function", [("function.c", generator.dump())], _LEVEL)
    try:
        return ca.external(function.name(), found._name)  # noqa: SLF001  where ctypes keeps the path
    except RuntimeError as error:  # on Windows for some characters in the path
        raise CompilerError(f"CasADi does not load {found._name}") from error  # noqa: SLF001


def repeated(step: ca.Function, count: int) -> ca.Function:
    """Repeat a function of a state and constants; compiled if there is a compiler."""
    given = [ca.MX.sym(step.name_in(i), step.size1_in(i)) for i in range(step.n_in())]
    held = [ca.repmat(part, 1, count) for part in given[1:]]
    function = ca.Function("stride", given, [step.fold(count)(given[0], *held)])
    try:
        return compiled(function)
    except CompilerError:
        return function
