"""Crawls at even phases, for results and plots, and their second route: forces as unknowns.

Least power has a dual: among all forces of the ground that balance the load, the actual ones resist
the changing shape most. Its unknowns are forces, its only curved limits are ellipses, and the
multipliers of its balance are the twist of the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.polynomial.legendre import legvander

from wormopt.numerics.collocation import Collocation
from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram
from wormopt.systems.planar.crawling.crawl import Course, Crawl, Phase
from wormopt.systems.planar.crawling.velocity import Crawler, Motion, refuse_open
from wormopt.systems.planar.poses import compose, rotate
from wormopt.systems.planar.shape import kinematics_at

_FEW = 8  # midpoints next to an instant at which the motion is not unique
_ROUNDING = 1e-12  # share of velocities relative to the head
_IPOPT = Ipopt(tolerance=1e-11, iterations=300)


@dataclass(frozen=True, eq=False)
class MostResistance:
    """Solution of the dual at G instants."""

    power: np.ndarray  # (G,), lower bound of any motion's power
    twist: np.ndarray  # (G, 3)
    violation: np.ndarray  # (G,), of balance and limits, relative


def most_resistance(crawler: Crawler, s: np.ndarray, ds: np.ndarray) -> MostResistance:
    """Solve the dual by an interior point, for shapes (G, n_s) and rates.

    Velocities are seen from the frame in which the masses move least, since those relative to the
    head may be many times the actual ones.
    """
    m, ground, force = crawler.shape.n_points, crawler.ground, crawler.force
    program = _program(ground.forward / force, ground.backward / force, ground.sideways / force)
    start = np.concatenate([np.full(2 * m, 0.1), np.zeros(m)])
    low = np.concatenate([np.zeros(2 * m), np.full(m, -np.inf)])
    limits = np.concatenate([np.zeros(3), np.full(m, -np.inf)]), np.r_[np.zeros(3), np.ones(m)]
    power, twist, violation = [], [], []
    for shape, rate in zip(s, ds, strict=True):
        _, _, J, B = (np.array(part) for part in crawler.shape.kinematics(shape))
        sizes = np.array([1.0, 1.0, float(np.sqrt(np.mean(J[:, 2] ** 2)))])
        fixed = B @ rate
        frame = -np.linalg.lstsq(J / sizes, fixed)[0] / sizes
        b = fixed + J @ frame
        speed = max(float(np.abs(b).max()), _ROUNDING * float(np.abs(fixed).max())) or 1.0
        given = np.concatenate([(J / sizes).T.ravel(), b / speed, crawler.load / sizes / force])
        bounds = Bounds(low, np.full(3 * m, np.inf), *limits, given)
        found = program.solve(start, bounds, _IPOPT)
        power.append(-found.objective * speed * force - crawler.load @ frame)
        twist.append(frame - found.multipliers[:3] / sizes * speed)
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


_DEGREE = 6
# Panels of the quadrature are halved if their error exceeds this share of the path of the masses
# over the stroke, down to a width at which round-off decides rest.
_MISSED, _NARROW = 1e-11, 1e-6
_APART = 1e-9  # breaks closer to a phase are not distinguished: motion there is round-off


@dataclass(frozen=True, eq=False)
class Record:
    """A stroke at m phases."""

    tau: np.ndarray  # (m,)
    shapes: np.ndarray  # (m, n_s)
    rates: np.ndarray  # (m, n_s), by the phase
    points: np.ndarray  # (m, masses, 2), in the frame of the body
    forces: np.ndarray  # (m, masses, 2), of the ground in the frame of the body
    motion: Motion
    actuators: np.ndarray  # (m, n_s), their loads


def record(crawl: Crawl, tau: np.ndarray, motion: Motion | None = None) -> Record:
    """Return a crawl at phases that ascend from 0; its motion there may be known."""
    course = crawl.course
    crawler = course.crawler
    shapes, rates = course.stroke.at(tau)
    motion = motion or motion_at(crawl, tau)
    at = kinematics_at(crawler.shape, shapes)
    forces = rotate(at.headings, motion.forces)
    lengths = "length 1" in crawler.shape.names
    loads = actuator_loads(at.points, forces, crawler.load, lengths=lengths)
    return Record(tau, shapes, rates, at.points, forces, motion, loads)


def motion_at(crawl: Crawl, tau: np.ndarray) -> Motion:
    """Return the motion at phases, near that of their stages."""
    within = np.clip(np.searchsorted(crawl.breaks, tau, side="right") - 1, 0, len(crawl.phases) - 1)
    near = [crawl.phases[k] for k in within]
    return crawl.course.at(tau, near)  # type: ignore[arg-type]  # a stage has these attributes


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Gauss' rule between phases (m,) that ascend from 0 to 1, and its poses (m, 3)."""

    tau: np.ndarray  # (m,)
    nodes: np.ndarray  # (q,)
    weights: np.ndarray  # (q,)
    poses: np.ndarray
    motion: Motion  # at the nodes


def quadrature(crawl: Crawl, tau: np.ndarray) -> Quadrature:
    """Integrate the pose again between phases, and between the breaks among them.

    Panels are halved about kinks that are no breaks, for example where a single joint reverses.
    """
    breaks = np.union1d(crawl.breaks, crawl.course.breaks)
    after = np.searchsorted(tau, breaks).clip(1, len(tau) - 1)
    near_breaks = np.minimum(np.abs(breaks - tau[after]), np.abs(breaks - tau[after - 1])) < _APART
    ends = _halved(crawl, np.union1d(tau, breaks[~near_breaks]))
    rule, step = Collocation(_DEGREE), np.diff(ends)
    nodes = ends[:-1, None] + step[:, None] * rule.tau
    motion = motion_at(crawl, nodes.ravel())
    twist = motion.twist.reshape(*nodes.shape, 3) * step[:, None, None]
    turned = np.concatenate([[0.0], np.cumsum(twist[..., 2] @ rule.B)])
    angle = turned[:-1, None] + twist[..., 2] @ rule.A.T
    way = np.einsum("kdc,d->kc", rotate(angle, twist[..., :2]), rule.B)
    poses = np.column_stack([np.vstack([np.zeros(2), np.cumsum(way, axis=0)]), turned])
    weights = (step[:, None] * rule.B).ravel()
    return Quadrature(tau, nodes.ravel(), weights, poses[np.searchsorted(ends, tau)], motion)


def _halved(crawl: Crawl, ends: np.ndarray) -> np.ndarray:
    """Return ends of panels on which Gauss' rule resolves twist and power, from initial ends."""
    tau = Collocation(_DEGREE).tau
    last = np.linalg.inv(legvander(2 * tau - 1, _DEGREE - 1))[-2:]  # coefficients of a series
    start, step = ends[:-1], np.diff(ends)
    while start.size:
        nodes = start[:, None] + step[:, None] * tau
        motion = motion_at(crawl, nodes.ravel())
        values = np.column_stack([motion.twist, motion.power]).reshape(*nodes.shape, 4)
        missed = np.abs(np.einsum("cd,kdv->kcv", last, values)).max(axis=1) * step[:, None]
        split = np.any(missed > _MISSED * crawl.course.sizes, axis=1) & (step > _NARROW)
        middles = start[split] + step[split] / 2
        ends = np.union1d(ends, middles)
        start, step = np.append(start[split], middles), np.tile(step[split] / 2, 2)
    return ends
