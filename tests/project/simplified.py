"""What SymPy simplifies to zero."""

from typing import Any

import sympy as sp


def zero(expression: Any) -> bool:
    return sp.simplify(expression) == 0
