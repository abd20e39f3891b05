"""Second route to these motions: places of all masses as unknowns, integrated in time.

It uses neither the frame of the body nor its quadrature or kinematics. At every instant it solves
for the velocities of all masses with the given rates of links and joints and with the constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from wormopt.systems.planar.body.shape import Heading
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.kinematic.constraints import Constraints
from wormopt.systems.planar.kinematic.motion import Phase

_BEHIND = {"bisector": 0.5, "front": 1.0, "rear": 0.0}


def simulate_held(
    places: np.ndarray,
    stroke: Stroke,
    phases: Sequence[Phase],
    lengths: Sequence[float] | None = None,
    heading: Heading = "bisector",
    looks: int = 32,
    *,
    accuracy: float = 1e-11,
) -> tuple[np.ndarray, np.ndarray]:
    """Return places of the masses of a chain over one stroke, by Runge-Kutta steps of order 8.

    `places` (n + 1, 2) are the start; `lengths` are those of links that do not stretch (the stroke
    then has angles only). Returns phases (m,) and places (m, n + 1, 2), `looks` for each smooth
    part of the stroke.
    """
    n = len(places) - 1
    ends = np.union1d(stroke.breaks, [phase.until for phase in phases])
    ends = ends[np.diff(ends, prepend=-np.inf) > 1e-12]  # differ by more than rounding
    tau, course = [0.0], [np.asarray(places, dtype=float).ravel()]
    for a, b in pairwise(ends):
        held = next(phase.constraints for phase in phases if phase.until > (a + b) / 2)

        def velocity(t: float, r: np.ndarray, held: Constraints = held, b: float = b) -> np.ndarray:
            # the rate at the very end of a part is that of the part, not of the next one
            rates = stroke.at(min(t, b - 1e-12))[1][0]
            stretch = np.zeros(n) if lengths is not None else rates[:n]
            bend = rates if lengths is not None else rates[n:]
            return _velocities(r.reshape(-1, 2), stretch, bend, held, heading)

        t = np.linspace(a, b, looks + 1)
        found = solve_ivp(velocity, (a, b), course[-1], method="DOP853", t_eval=t[1:],
                          rtol=accuracy, atol=accuracy)  # fmt: skip
        tau.extend(found.t)
        course.extend(found.y.T)
    return np.array(tau), np.array(course).reshape(len(tau), -1, 2)


def _velocities(
    r: np.ndarray, stretch: np.ndarray, bend: np.ndarray, held: Constraints, heading: Heading
) -> np.ndarray:
    """Return velocities of all masses, (2 (n + 1),), from rows for links, joints, constraints."""
    n = len(r) - 1
    d = r[:-1] - r[1:]
    size = np.hypot(d[:, 0], d[:, 1])
    along = d / size[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    rows, given = [], []

    def turning(j: int) -> np.ndarray:
        """Row of how fast link j turns."""
        row = np.zeros((n + 1, 2))
        row[j], row[j + 1] = across[j] / size[j], -across[j] / size[j]
        return row.ravel()

    for j in range(n):
        row = np.zeros((n + 1, 2))
        row[j], row[j + 1] = along[j], -along[j]
        rows.append(row.ravel())
        given.append(stretch[j])
    for j in range(n - 1):
        rows.append(turning(j) - turning(j + 1))
        given.append(bend[j])
    for i, normal in _normals(along, held, heading):
        row = np.zeros((n + 1, 2))
        row[i] = normal
        rows.append(row.ravel())
        given.append(0.0)
    return np.linalg.lstsq(np.array(rows), np.array(given), rcond=None)[0]


def _normals(
    along: np.ndarray, held: Constraints, heading: Heading
) -> list[tuple[int, tuple[float, float]]]:
    """Directions into which masses cannot move."""
    found: list[tuple[int, tuple[float, float]]] = []
    for i in held.pins:
        found += [(i, (1.0, 0.0)), (i, (0.0, 1.0))]
    for i in held.skids:
        front, rear = along[max(i - 1, 0)], along[min(i, len(along) - 1)]
        turn = np.arctan2(rear[0] * front[1] - rear[1] * front[0], front @ rear)
        angle = np.arctan2(rear[1], rear[0]) + _BEHIND[heading] * turn
        found.append((i, (-float(np.sin(angle)), float(np.cos(angle)))))
    return found
