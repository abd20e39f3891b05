"""Purcell's swimmer by resistive forces, written anew: nothing is shared with the package.

Three rods of length 1 in a row; the ground resists a rod by c_t along and c_n across itself, per
length and velocity. Forces and the moment about the middle of the second rod balance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

_HALF = 0.5


@dataclass(frozen=True)
class Followed:
    """What a stroke does: way and turn of the middle rod, and work times time at constant power."""

    distance: float
    turn: float
    action: float


def resistance(s: np.ndarray, along: float, across: float) -> np.ndarray:
    """Power as a form (5, 5) of both velocities and the spin of the middle rod, and both rates."""
    angles = np.array([s[0], 0.0, -s[1]])
    e = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    n = np.stack([-e[:, 1], e[:, 0]], axis=1)
    middles = np.array([[_HALF, 0.0] + _HALF * e[0], [0.0, 0.0], [-_HALF, 0.0] - _HALF * e[2]])
    form = np.zeros((5, 5))
    for j, (place, ahead, aside) in enumerate(zip(middles, e, n, strict=True)):
        spin, velocity = np.zeros(5), np.zeros((2, 5))
        spin[2] = 1.0
        velocity[:, :2] = np.eye(2)
        velocity[:, 2] = [-place[1], place[0]]
        if (
            j != 1
        ):  # a positive angle turns the front rod to the left, and the rear rod to the right
            spin[3 + j // 2] = 1.0 - j
            velocity[:, 3 + j // 2] = _HALF * aside
        form += along * np.outer(ahead @ velocity, ahead @ velocity)
        form += across * np.outer(aside @ velocity, aside @ velocity)
        form += across / 12 * np.outer(spin, spin)
    return form


def followed(shapes: np.ndarray, across: float) -> Followed:
    """What a smooth stroke does by its shapes (2, m) at even times, the last as the first."""
    time = np.linspace(0.0, 1.0, shapes.shape[1])
    closed = np.vstack([shapes.T[:-1], shapes.T[:1]])
    course = make_interp_spline(time, closed, k=5, bc_type="periodic")
    slope = course.derivative()

    def moves(t: float, y: np.ndarray) -> np.ndarray:
        form, rates = resistance(course(t), 1.0, across), slope(t)
        twist = -np.linalg.solve(form[:3, :3], form[:3, 3:] @ rates)
        whole, c, n = np.concatenate([twist, rates]), np.cos(y[2]), np.sin(y[2])
        return np.array([
            c * twist[0] - n * twist[1], n * twist[0] + c * twist[1], twist[2],
            np.sqrt(whole @ form @ whole),
        ])  # fmt: skip

    found = solve_ivp(
        moves, (0, 1), np.zeros(4), "DOP853", rtol=1e-10, atol=1e-12, max_step=time[1]
    )
    x, y, turn, length = found.y[:, -1]
    return Followed(float(np.hypot(x, y)), float(turn), float(length**2))
