"""Elastic energy of a thin incompressible membrane, Mooney-Rivlin or neo-Hookean.

Per unstressed area and over G h / 2 it is a I1 + (1 - a) I2 - 3; a = 1 is neo-Hookean. `stretch` is
axial, `hoop` circumferential. Functions take numbers, arrays or CasADi expressions.
"""

from __future__ import annotations

from typing import Any


def density(stretch: Any, hoop: Any, neo_hookean: Any = 1.0) -> Any:
    """Return the energy w per unstressed area over G h; 0 if unstressed."""
    x, y, a = stretch**2, hoop**2, neo_hookean
    first, second = x + y + 1 / (x * y), 1 / x + 1 / y + x * y
    return (a * first + (1 - a) * second - 3) / 2


def slopes(stretch: Any, hoop: Any, neo_hookean: Any = 1.0) -> tuple[Any, Any]:
    """Return derivatives of `density` by stretch and hoop: tensions over G h per length."""
    x, y, a, b = stretch**2, hoop**2, neo_hookean, 1 - neo_hookean
    along = stretch * (a * (1 - 1 / (x * x * y)) + b * (y - 1 / (x * x)))
    around = hoop * (a * (1 - 1 / (x * y * y)) + b * (x - 1 / (y * y)))
    return along, around


def curvatures(stretch: Any, hoop: Any, neo_hookean: Any = 1.0) -> tuple[Any, Any, Any]:
    """Return second derivatives of `density`: by stretch twice, by both, by hoop twice."""
    x, y, a, b = stretch**2, hoop**2, neo_hookean, 1 - neo_hookean
    along = a * (1 + 3 / (x * x * y)) + b * (y + 3 / (x * x))
    both = stretch * hoop * (2 * a / (x * x * y * y) + 2 * b)
    around = a * (1 + 3 / (x * y * y)) + b * (x + 3 / (y * y))
    return along, both, around
