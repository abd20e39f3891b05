"""Second route to the displacement of a stroke: balances of force and moment, stepped in time.

It shares nothing with the local connection: drags act at Gauss points of the rods as vectors in the
plane, the pose is that in the plane, and SciPy's DOP853 integrates it.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.swimming.swimmer import Swimmer

_AT = np.array([-1.0, 1.0]) / (2 * np.sqrt(3.0))  # Gauss's points from the middle of a rod


def balanced(swimmer: Swimmer, s: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the twist (3) of the body's frame at which all drags balance, and their power."""
    places, headings, J, B = map(np.asarray, swimmer.shape.kinematics(s))
    places, headings = places.T, headings.ravel()
    own = J.reshape(-1, 2, 3), (B @ rates).reshape(-1, 2)
    c, sn = np.cos(headings), np.sin(headings)
    back = np.stack([np.stack([c, -sn], -1), np.stack([sn, c], -1)], -2)
    by_twist, by_rates = back @ own[0], np.einsum("mij,mj->mi", back, own[1])
    force, moment = np.zeros((2, 4)), np.zeros(4)
    ahead = np.stack([c, sn], axis=-1)
    drags = [
        (places[i], ahead[i], by_twist[i], by_rates[i], *swimmer.masses) for i in range(len(places))
    ]
    for j in range(1, len(places)):
        d = places[j - 1] - places[j]
        length = np.hypot(*d)
        for at in _AT:
            front, rear = 0.5 + at, 0.5 - at
            drags.append((
                front * places[j - 1] + rear * places[j], d / length,
                front * by_twist[j - 1] + rear * by_twist[j],
                front * by_rates[j - 1] + rear * by_rates[j],
                swimmer.rods[0] * length / 2, swimmer.rods[1] * length / 2,
            ))  # fmt: skip
    pulls = []
    for place, e, twist, rate, along, across in drags:
        n = np.array([-e[1], e[0]])
        drag = along * np.outer(e, e) + across * np.outer(n, n)
        velocity = np.column_stack([twist, rate])  # by the twist, and 1
        pull = -drag @ velocity
        force += pull
        moment += place[0] * pull[1] - place[1] * pull[0]
        pulls.append((pull, velocity))
    rows = np.vstack([force, moment])
    twist = np.linalg.solve(rows[:, :3], -rows[:, 3])
    whole = np.append(twist, 1.0)
    return twist, float(-sum((pull @ whole) @ (velocity @ whole) for pull, velocity in pulls))


def stepped(swimmer: Swimmer, stroke: Stroke, tolerance: float = 1e-10) -> np.ndarray:
    """Return displacement (3) of a stroke, from break to break, and work at even phases."""

    def moves(tau: float, pose: np.ndarray, end: float) -> np.ndarray:
        s, rates = stroke.at(np.array([min(tau, end)]))
        twist, power = balanced(swimmer, s[0], rates[0])
        return np.concatenate([rotate(pose[2], twist[:2]), twist[2:], [power]])

    pose = np.zeros(4)
    for begin, end in zip(stroke.breaks, stroke.breaks[1:], strict=False):
        last = np.nextafter(end, begin)  # at a break the rate is that of what follows
        found = solve_ivp(
            moves, (begin, end), pose, "DOP853", rtol=tolerance, atol=tolerance, args=(last,)
        )  # fmt: skip
        pose = found.y[:, -1]
    return pose
