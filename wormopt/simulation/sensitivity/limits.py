"""Limits of slopes that are 0/0 where the motion is smooth, such as those of v |v| at rest.

Limits are estimated from three points ever closer along the motion, or on both sides if nothing
moves. Compiled in `take_limits` of native/variation.c.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

# Distance, in nominal sizes, at which limits are estimated; share of the difference of a pair that
# remains at a quarter of the distance, and negligible share of the value; growth that excludes a
# limit.
_NEARBY, _LEFT, _NOTHING, _GROWS = 1e-10, 0.6, 1e-4, 1.5


def with_limits(
    slopes: ca.Function,
    nominal: np.ndarray,
    t: ca.MX,
    x: ca.MX,
    p: ca.MX,
    s: ca.MX,
    dx: ca.MX,
    entries: Sequence[ca.MX],
) -> list[ca.MX]:
    """Entries of Jacobians, by `slopes` at (t, x, p, s), with limits in place of NaN.

    `nominal` sizes are those of the model's states, which come first in x; dx is their rate.
    """
    sizes = [entry.numel() for entry in entries]
    given = [t, x, p, s, dx, ca.vertcat(*entries)]
    symbols = [ca.MX.sym(f"a{i}", part.numel()) for i, part in enumerate(given)]
    same = ca.Function("same", symbols, [symbols[-1]])
    limits = ca.Function("limits", symbols, [_limits(slopes, nominal, *symbols)])
    broken = ca.logic_not(ca.sum1(_numbers(*given[-1:])) == sum(sizes))
    found = ca.Function.if_else("found", limits, same)(broken, *given)
    return ca.vertsplit(found, np.cumsum([0, *sizes]).tolist())


def _numbers(values: ca.MX) -> ca.MX:
    """Whether each value is a number; CasADi would simplify a comparison with itself."""
    a, b = (ca.MX.sym(name, values.numel()) for name in "ab")
    return ca.Function("equal", [a, b], [a == b])(values, values)


def _limits(
    slopes: ca.Function,
    nominal: np.ndarray,
    t: ca.MX,
    x: ca.MX,
    p: ca.MX,
    s: ca.MX,
    dx: ca.MX,
    known: ca.MX,
) -> ca.MX:
    rate = ca.mmax(ca.fabs(dx[: len(nominal)]) / nominal)
    after = ca.if_else(rate > 0, _NEARBY / rate, 0)
    way = np.zeros(x.numel())
    way[: len(nominal)] = nominal * (1 + 0.618 * (np.arange(len(nominal)) % 7))

    def near(distance: ca.MX | float, direction: ca.MX | np.ndarray, later: ca.MX | float) -> ca.MX:
        return ca.vertcat(*slopes(t + later, x + distance * direction, p, s)[1:])

    ahead = [near(after / 4**i, dx, after / 4**i) for i in range(3)]
    found = _adopted(known, ahead[0], ahead[1], ahead[1], ahead[2])
    sides = [near(sign * _NEARBY / scale, way, 0.0) for scale in (1, 4) for sign in (1, -1)]
    return _adopted(found, *sides)


def _adopted(known: ca.MX, a: ca.MX, b: ca.MX, near_a: ca.MX, near_b: ca.MX) -> ca.MX:
    """Values with NaN replaced by limits, if a pair of points has any."""
    apart, near = ca.fabs(a - b), ca.fabs(near_a - near_b)
    size = ca.fmax(ca.fabs(near_a), ca.fabs(near_b))
    good = (size <= _GROWS * ca.fmax(ca.fabs(a), ca.fabs(b))) * (
        near <= ca.fmax(_LEFT * apart, _NOTHING * size)
    )
    limit = ca.if_else(good, (near_a + near_b) / 2, known)
    return ca.if_else(_numbers(known), known, limit)
