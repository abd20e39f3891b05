"""Second routes to slow crawling: forces as unknowns instead of velocities, and even phases.

Least power has a dual: among all forces of the ground that balance the load, the actual ones resist
the changing shape most. Its unknowns are forces, its only curved limits are ellipses, and the
multipliers of its balance are the twist of the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram
from wormopt.systems.planar.body.se2 import compose, rotate
from wormopt.systems.planar.crawling.phases import Course, Phase
from wormopt.systems.planar.crawling.velocity import Crawler, refuse_open

_FEW = 8  # midpoints next to an instant at which the motion is not unique
_IPOPT = Ipopt(tolerance=1e-11, iterations=300)


@dataclass(frozen=True, eq=False)
class MostResistance:
    """Solution of the dual at G instants."""

    power: np.ndarray  # (G,), lower bound of any motion's power
    twist: np.ndarray  # (G, 3)
    violation: np.ndarray  # (G,), of balance and limits, relative


def most_resistance(crawler: Crawler, s: np.ndarray, ds: np.ndarray) -> MostResistance:
    """Solve the dual by an interior point, for shapes (G, n_s) and rates."""
    m, ground = crawler.shape.n_points, crawler.ground
    force = float(np.mean([ground.forward, ground.backward, ground.sideways]))
    program = _program(ground.forward / force, ground.backward / force, ground.sideways / force)
    start = np.concatenate([np.full(2 * m, 0.1), np.zeros(m)])
    low = np.concatenate([np.zeros(2 * m), np.full(m, -np.inf)])
    limits = np.concatenate([np.zeros(3), np.full(m, -np.inf)]), np.r_[np.zeros(3), np.ones(m)]
    power, twist, violation = [], [], []
    for shape, rate in zip(s, ds, strict=True):
        _, _, J, B = (np.array(part) for part in crawler.shape.kinematics(shape))
        b = B @ rate
        speed = float(np.abs(b).max()) or 1.0
        sizes = np.array([1.0, 1.0, float(np.sqrt(np.mean(J[:, 2] ** 2)))])
        given = np.concatenate([(J / sizes).T.ravel(), b / speed, crawler.load / sizes / force])
        bounds = Bounds(low, np.full(3 * m, np.inf), *limits, given)
        found = program.solve(start, bounds, _IPOPT)
        power.append(-found.objective * speed * force)
        twist.append(-found.multipliers[:3] / sizes * speed)
        violation.append(found.violation)
    return MostResistance(np.array(power), np.array(twist), np.array(violation))


def _program(forward: np.ndarray, backward: np.ndarray, sideways: np.ndarray) -> NonlinearProgram:
    """Return the program over the pushes F+ a - F- c along and Fn n aside, (a + c)^2 + n^2 <= 1."""
    m = len(forward)
    w, p = ca.MX.sym("w", 3 * m), ca.MX.sym("p", 8 * m + 3)
    a, c, aside = ca.vertsplit(w, m)
    along = ca.DM(forward) * a - ca.DM(backward) * c
    push = ca.vec(ca.horzcat(along, ca.DM(sideways) * aside).T)
    J, b, load = ca.reshape(p[: 6 * m], 2 * m, 3), p[6 * m : 8 * m], p[8 * m :]
    balance = J.T @ push - load
    return NonlinearProgram(w, p, -ca.dot(push, b), ca.vertcat(balance, (a + c) ** 2 + aside**2))


def even_displacement(course: Course, count: int, known: Sequence[Phase] = ()) -> np.ndarray:
    """Return the displacement (3,) of a stroke by midpoints of even phases, ignoring breaks.

    The velocity at each midpoint is computed again. The error decreases as 1/count^2. Close to an
    instant at which the motion is not unique, the velocity cannot be found independently and is
    that of the `known` crawl. A stroke with more than a few of these midpoints is refused.
    """
    ends = np.unique(np.concatenate([np.linspace(0.0, 1.0, count + 1), course.breaks]))
    step = np.diff(ends)
    tau = (ends[1:] + ends[:-1]) / 2
    shapes, rates = course.stroke.at(tau)
    motion, open_ = course.crawler.sought(shapes, rates)
    twist = motion.twist
    if not known or open_.sum() > _FEW:
        refuse_open(course.crawler.shape, shapes, open_)
    elif open_.any():
        within = np.searchsorted([phase.end for phase in known[:-1]], tau[open_], side="right")
        twist[open_] = course.at(tau[open_], [known[k] for k in within]).twist
    twist = twist * step[:, None]
    angle = np.concatenate([[0.0], np.cumsum(twist[:, 2])])
    way = rotate((angle[1:] + angle[:-1]) / 2, twist[:, :2])
    return np.array([*way.sum(axis=0), angle[-1]])


def actuator_loads(
    points: np.ndarray, forces: np.ndarray, load: np.ndarray, *, lengths: bool
) -> np.ndarray:
    """Return the actuator loads of a chain, head first: of links if `lengths`, then of joints.

    `points` (G, m, 2), `forces` (G, m, 2) on them and the `load` (3,) on the head are in the frame
    of the body. A link's actuator pushes its masses apart; a joint's turns the link in front to the
    left.
    """
    ahead = np.cumsum(forces, axis=1) + load[:2]
    moments = np.cumsum(cross(points, forces), axis=1) + load[2]
    links = points[:, :-1] - points[:, 1:]
    links /= np.linalg.norm(links, axis=2)[..., None]
    push = -(ahead[:, :-1] * links).sum(axis=2)
    joints = -(moments - cross(points, ahead))[:, 1:-1]
    return np.concatenate([push, joints], axis=1) if lengths else joints


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def repeated(displacement: np.ndarray, poses: np.ndarray, cycles: int) -> np.ndarray:
    """Return poses (cycles (m - 1) + 1, 3) of the stroke's poses (m, 3), repeated."""
    start, found = np.zeros(3), []
    for _ in range(cycles):
        found.append(compose(start, poses[:-1]))
        start = compose(start, displacement)
    return np.vstack([*found, start])
