"""A crawl at even phases: places, velocities and forces, for results and plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from wormopt.numerics.collocation import Collocation
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.crawling.recheck import actuator_loads
from wormopt.systems.planar.crawling.velocity import Motion

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
    headings: np.ndarray  # (m, masses), in the frame of the body
    motion: Motion
    actuators: np.ndarray  # (m, n_s), their loads

    @property
    def forces(self) -> np.ndarray:
        """Forces (m, masses, 2) of the ground in the frame of the body."""
        return rotate(self.headings, self.motion.forces)


def record(crawl: Crawl, tau: np.ndarray) -> Record:
    """Return a crawl at phases that ascend from 0."""
    course = crawl.course
    crawler = course.crawler
    shapes, rates = course.stroke.at(tau)
    motion = motion_at(crawl, tau)
    mapped = crawler.shape.kinematics.map(len(tau))
    points, headings = (np.array(part) for part in mapped.call([shapes.T])[:2])
    m = crawler.shape.n_points
    points = points.reshape(2, len(tau), m).transpose(1, 2, 0)
    headings = headings.reshape(m, len(tau)).T
    forces = rotate(headings, motion.forces)
    lengths = "length 1" in crawler.shape.names
    loads = actuator_loads(points, forces, crawler.load, lengths=lengths)
    return Record(tau, shapes, rates, points, headings, motion, loads)


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
    twist = motion_at(crawl, nodes.ravel()).twist.reshape(*nodes.shape, 3) * step[:, None, None]
    turned = np.concatenate([[0.0], np.cumsum(twist[..., 2] @ rule.B)])
    angle = turned[:-1, None] + twist[..., 2] @ rule.A.T
    way = np.einsum("kdc,d->kc", rotate(angle, twist[..., :2]), rule.B)
    poses = np.column_stack([np.vstack([np.zeros(2), np.cumsum(way, axis=0)]), turned])
    weights = (step[:, None] * rule.B).ravel()
    return Quadrature(tau, nodes.ravel(), weights, poses[np.searchsorted(ends, tau)])


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
