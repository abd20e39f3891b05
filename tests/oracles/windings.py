"""Fields of windings as sums over loops, each by complete elliptic integrals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.special import ellipe, ellipkm1

from wormopt.magnetics.winding import Coil

# Parts of the way from a point on, in which a winding is summed.
_CUTS = (0.0, 1e-3, 1e-2, 0.05, 0.2, 0.5, 1.0)


def loop_by_integrals(a: Any, rho: Any, s: Any) -> tuple[Any, Any]:
    """Axial and radial field of loops of one ampere, by K and E; off the axis.

    W. R. Smythe, Static and Dynamic Electricity (1968), 7.10. Radii of loops, distances of points
    from the axis and from the plane of the loop: numbers or arrays that fit.
    """
    far, near = (a + rho) ** 2 + s**2, (a - rho) ** 2 + s**2
    K, E = ellipkm1(near / far), ellipe(4 * a * rho / far)
    unit = 1 / (2 * math.pi * np.sqrt(far))
    axial = unit * (K + (a**2 - rho**2 - s**2) / near * E)
    radial = unit * s / rho * (-K + (a**2 + rho**2 + s**2) / near * E)
    return axial, radial


def summed(coil: Coil, rho: float, s: float, count: int) -> np.ndarray:
    """Field per ampere-turn: loops over the winding by Gauss' rule, in parts towards the point."""
    parts = []
    for low, high, near in (
        (coil.inner, coil.outer, rho), (-coil.length / 2, coil.length / 2, s),
    ):  # fmt: skip
        cut = min(max(near, low), high)
        edges = np.unique([low, *(cut + (e - cut) * q for e in (low, high) for q in _CUTS), high])
        nodes, weights = np.polynomial.legendre.leggauss(count)
        half = np.diff(edges)[:, None] / 2
        at = edges[:-1, None] + half * (1 + nodes)
        parts.append((at.ravel(), (half * weights).ravel() / (high - low)))
    (a, wa), (p, wp) = parts
    field = loop_by_integrals(a[:, None], rho, s - p[None, :])
    return np.array([wa @ part @ wp for part in field])


def seen(coil: Coil, direction: int, away: np.ndarray) -> np.ndarray:
    """Field of one coil at a point, told from its middle, as a vector."""
    s, flat = float(away[direction]), away.copy()
    flat[direction] = 0.0
    rho = float(np.linalg.norm(flat))
    axial, radial = summed(coil, rho, s, 12)
    return axial * np.eye(3)[direction] + radial * flat / rho
