"""A crawl at even phases: places, velocities and forces, for results and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.crawling.panels import Panels
from wormopt.systems.planar.crawling.phases import Sample
from wormopt.systems.planar.crawling.recheck import actuator_loads
from wormopt.systems.planar.crawling.velocity import Motion

_GAUSS = legendre.leggauss


@dataclass(frozen=True, eq=False)
class Record:
    """A stroke at m phases."""

    tau: np.ndarray  # (m,)
    shapes: np.ndarray  # (m, n_s)
    rates: np.ndarray  # (m, n_s), by the phase
    poses: np.ndarray  # (m, 3)
    points: np.ndarray  # (m, masses, 2), in the frame of the body
    headings: np.ndarray  # (m, masses), likewise
    motion: Motion
    actuators: np.ndarray  # (m, n_s), their loads

    @property
    def forces(self) -> np.ndarray:
        """Forces (m, masses, 2) of the ground in the frame of the body."""
        return rotate(self.headings, self.motion.forces)


def record(crawl: Crawl, tau: np.ndarray) -> Record:
    """A crawl at phases that ascend."""
    course = crawl.course
    crawler = course.crawler
    shapes, rates = course.stroke.at(tau)
    within = np.clip(np.searchsorted(crawl.breaks, tau, side="right") - 1, 0, len(crawl.phases) - 1)
    near = [Sample(p.start, p.rest, p.back, p.twist) for p in (crawl.phases[k] for k in within)]
    motion = course.at(tau, near)
    mapped = crawler.shape.kinematics.map(len(tau))
    points, headings = (np.array(part) for part in mapped.call([shapes.T])[:2])
    m = crawler.shape.n_points
    points = points.reshape(2, len(tau), m).transpose(1, 2, 0)
    headings = headings.reshape(m, len(tau)).T
    forces = rotate(headings, motion.forces)
    lengths = "length 1" in crawler.shape.names
    loads = actuator_loads(points, forces, crawler.load, lengths=lengths)
    poses = poses_at(crawl.panels, tau)
    return Record(tau, shapes, rates, poses, points, headings, motion, loads)


def poses_at(panels: Panels, tau: np.ndarray) -> np.ndarray:
    """Poses (m, 3) at phases, by the polynomials of the panels."""
    q = panels.twist.shape[1]
    to_series = np.linalg.inv(legendre.legvander(_GAUSS(q)[0], q - 1))
    at = np.clip(np.searchsorted(panels.ends, tau, side="right") - 1, 0, len(panels.ends) - 2)
    half = np.diff(panels.ends)[at] / 2
    x = (tau - panels.ends[at]) / half - 1
    begin = panels.all_poses[at]
    rates = np.concatenate([rotate(panels.angles, panels.twist[..., :2]), panels.twist[..., 2:]], 2)
    series = legendre.legint(np.einsum("kq,pqc->kpc", to_series, rates), lbnd=-1, axis=0)
    values = legendre.legvander(x, q)
    return begin + half[:, None] * np.einsum("mk,kmc->mc", values, series[:, at])
