"""Forces of contacts that may be undetermined: of all solutions the nearest one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

# Relative compliance of contacts at rest and in onset that decides how they share a load, and
# number of iterations that remove its effect.
RESTING, TURNING = 1e-6, 1e-3
_REFINEMENTS = 5
# Largest number of equations written out for the compiler.
_WRITTEN_OUT = 8


@dataclass(frozen=True, eq=False)
class Equations:
    """Linear equations for forces or impulses, perhaps singular."""

    matrix: ca.SX
    right: ca.SX
    gives: ca.SX  # compliance added to the matrix to decide, relative to `size`
    near: ca.SX  # the solution nearest to it is chosen
    size: ca.SX  # of the matrix's entries


def solver(name: str, symbols: Sequence[ca.SX], equations: Equations) -> ca.Function:
    """Solve by loops unless equations are few: written out, a dozen contacts take half a minute.

    Returns the solution, then 1 if it is unique, else 0.
    """
    given: Any = list(symbols)
    e = equations
    parts: Any = [ca.densify(p) for p in (e.matrix, e.right, e.size * e.gives, e.near, e.size)]
    few = e.right.numel() <= _WRITTEN_OUT
    if not few:
        read = ca.Function("parts", given, parts)
        given = read.mx_in()
        parts = read(*given)
    A, b, softened, found, size = parts
    how = () if few else ("qr",)
    inverse: Any = ca.solve(A + softened, ca.DM.eye(b.numel()), *how)
    for _ in range(_REFINEMENTS):
        found = found + inverse @ (b - A @ found)
    weakest = ca.mmax(ca.fabs(inverse)) * size
    return ca.Function(name, given, [ca.vertcat(found, weakest < 0.1 / RESTING)])


def determined(matrix: ca.SX) -> ca.SX:
    """Determinant relative to the sizes of the rows: 1 well determined, 0 not at all.

    From factors: an expression by minors grows like Fibonacci's numbers for a chain.
    """
    size = ca.fabs(_product(ca.diag(ca.qr(matrix)[1])))
    return size / ca.sqrt(_product(ca.sum2(matrix**2)))


def _product(column: ca.SX) -> ca.SX:
    product = ca.SX(1)
    for i in range(column.numel()):
        product *= column[i]
    return product
