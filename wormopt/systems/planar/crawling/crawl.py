"""Where a stroke takes a body that crawls slowly on dry ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.crawling.ground import ground_of
from wormopt.systems.planar.crawling.phases import Course, Phase, closed, phases_of
from wormopt.systems.planar.crawling.velocity import Crawler

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
# Share of a step between samples at which they begin: none falls on an instant of symmetry.
_OFF = (np.sqrt(5) - 1) / 2


@dataclass(frozen=True, eq=False)
class Crawl:
    """A stroke as a body goes through it slowly."""

    displacement: np.ndarray  # (3,), x, y and angle after one stroke, in the frame before
    work: float  # that the ground takes in a stroke
    phases: tuple[Phase, ...]
    course: Course
    poses: np.ndarray  # (len(phases) + 1, 3), at the breaks

    @property
    def breaks(self) -> np.ndarray:
        """Phases of the stroke between which the same masses rest, 0 and 1 among them."""
        return np.array([0.0, *(phase.end for phase in self.phases)])


def crawl(
    shape: Shape,
    laws: PlanarLaw | Sequence[PlanarLaw],
    stroke: Stroke,
    *,
    load: ArrayLike = (0.0, 0.0, 0.0),
    samples: int = 128,
) -> Crawl:
    """Find where a stroke takes a body so slow that its inertia does not matter."""
    crawler = Crawler(shape, ground_of(laws, shape.n_points), np.asarray(load, dtype=float))
    course = Course(crawler, stroke)
    ends = stroke.breaks
    count = max(16, samples // (len(ends) - 1))
    found = [p for a, b in pairwise(ends) for p in _phases(course, float(a), float(b), count)]
    poses, work = _way(course, found)
    return Crawl(poses[-1], work, tuple(found), course, poses)


def _phases(course: Course, start: float, end: float, count: int) -> list[Phase]:
    """Phases between two breaks of the stroke."""
    tau = start + (end - start) * (np.arange(count) + _OFF) / count
    return phases_of(closed(course, course.sample(tau)), start, end)


def _way(course: Course, found: list[Phase]) -> tuple[np.ndarray, float]:
    """Poses (p + 1, 3) at the breaks and the work, by Gauss' rule in each phase."""
    start, end = (np.array([getattr(p, name) for p in found]) for name in ("start", "end"))
    tau = start[:, None] + (end - start)[:, None] * (_NODES + 1) / 2
    motion = course.at(tau.ravel())
    step = (end - start) / 2
    twist = motion.twist.reshape(len(found), -1, 3)
    work = float((motion.power.reshape(len(found), -1) @ _WEIGHTS * step).sum())
    inner = twist[..., 2] @ _INTEGRATE.T * step[:, None]
    turns = twist[..., 2] @ _WEIGHTS * step
    begin = np.concatenate([[0.0], np.cumsum(turns)])
    way = rotate(begin[:-1, None] + inner, twist[..., :2])
    moves = np.einsum("pqc,q,p->pc", way, _WEIGHTS, step)
    places = np.vstack([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return np.column_stack([places, begin]), work


def _integrals() -> np.ndarray:
    """Matrix of the integrals from -1 to each node, by values at the nodes."""
    legendre = np.polynomial.legendre
    inverse = np.linalg.inv(legendre.legvander(_NODES, len(_NODES) - 1))
    columns = [
        legendre.legval(_NODES, legendre.legint(row, lbnd=-1)) for row in np.eye(len(_NODES))
    ]
    return np.array(columns).T @ inverse


_INTEGRATE = _integrals()
