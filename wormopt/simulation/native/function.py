"""One CasADi function, compiled: what calls it need not know."""

from __future__ import annotations

import casadi as ca

from wormopt.simulation.native.build import library

__all__ = ["compiled"]

# Measured on the steps of a rod: -O2 compiles for longer and is no faster.
_LEVEL = "-O1"


def compiled(function: ca.Function) -> ca.Function:
    """Compile a function with everything it calls.

    Parameters
    ----------
    function : casadi.Function
        Any that can be written as C.

    Returns
    -------
    casadi.Function
        The same, compiled.

    Raises
    ------
    CompilerError
        If there is no compiler or it fails.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> compiled(ca.Function("square", [x], [x * x]))(3.0)
    DM(9)
    """
    generator = ca.CodeGenerator("function.c")
    generator.add(function)
    found = library("function", [("function.c", generator.dump())], _LEVEL)
    return ca.external(function.name(), found._name)  # noqa: SLF001  where ctypes keeps the path
