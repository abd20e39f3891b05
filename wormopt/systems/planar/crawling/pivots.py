"""Least power with one mass at rest, about which the body turns."""

from __future__ import annotations

import numpy as np

from wormopt.systems.planar.crawling.balance import LeastPower

_SINGULAR = 1e-20


def pivots(body: LeastPower) -> tuple[np.ndarray, np.ndarray]:
    """Return least power with each mass at rest: x (G, m, n), value (G, m), for n of 2 or 3.

    If any mass rests at least power, the lowest of these is that power. The value is infinite if a
    mass cannot rest.
    """
    G, m, _, n = body.J.shape
    each = np.repeat(np.arange(G), m)
    J, b = body.J.reshape(G * m, 2, n), body.b.reshape(G * m, 2)
    x = _resting(J, b, np.zeros((G * m, n)))
    x = _resting(J, b, x)
    bodies = body.of(each)
    if n == 3:
        way = np.cross(J[:, 0], J[:, 1])
        way /= np.linalg.norm(way, axis=1)[:, None]
        x += bodies.along(x, way).least()[:, None] * way
    value = bodies.smooth_value(x, 0.0)
    value[_stays(J)] = np.inf
    return x.reshape(G, m, n), value.reshape(G, m)


def _resting(J: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the nearest x (K, n) at which a mass rests."""
    across = J @ J.transpose(0, 2, 1)
    across[_stays(J)] = np.eye(2)
    off = b + (J @ x[..., None])[..., 0]
    return x - (J.transpose(0, 2, 1) @ np.linalg.solve(across, off[..., None]))[..., 0]


def _stays(J: np.ndarray) -> np.ndarray:
    """Return whether a mass (K,) has a velocity, in at least one direction, that no x changes."""
    return np.linalg.det(J @ J.transpose(0, 2, 1)) < _SINGULAR
