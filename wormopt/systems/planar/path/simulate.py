"""Simulation of a planned path by independent methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.obstacles import Block, Capsule, Disc, Obstacle, Wall, inside
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.body.shape import Heading
from wormopt.systems.planar.crawling.cartesian import simulate_crawled
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.kinematic.cartesian import simulate_held
from wormopt.systems.planar.kinematic.motion import KinematicMotion
from wormopt.systems.planar.path.plan import PlannedPath


@dataclass(frozen=True, eq=False)
class Course:
    """Places of all masses over a whole path."""

    step: np.ndarray  # (m,) number of the step and phase within, together
    places: np.ndarray  # (m, n, 2)

    @property
    def pose(self) -> np.ndarray:
        """x, y of the head and angle of the first link at the end, (3,)."""
        head, next_to = self.places[-1, 0], self.places[-1, 1]
        dx, dy = head - next_to
        return np.array([*head, np.arctan2(dy, dx)])


def simulate_path(
    path: PlannedPath,
    *,
    lengths: Sequence[float] | None = None,
    heading: Heading = "bisector",
    looks: int = 64,
) -> Course:
    """Simulate all steps of a path, one after another from the start, by independent methods.

    Motions with pins and skids are integrated with all masses in Cartesian coordinates. Slow crawls
    use smoothed laws, without rest or breaks, in a frame at the tail. Each step begins where the
    previous one ended, including its error.

    Parameters
    ----------
    path : PlannedPath
        Its steps must come from `gait_family`.
    lengths : sequence of float, optional
        Link lengths, if they are no shape variables.
    heading : {"bisector", "front", "rear"}, optional
        Heading of inner masses.
    looks : int, optional
        Instants kept of each smooth part of a stroke.

    Returns
    -------
    Course
        Places of all masses; `pose` is that of the head at the end.

    Raises
    ------
    ArgumentError
        If a step has another origin.

    Examples
    --------
    >>> import wormopt as wo
    >>> P, worm = wo.planar, wo.planar.chain_shape(2)
    >>> push = P.Phase(0.5, P.Constraints(pins=(2,), skids=(0,)))
    >>> pull = P.Phase(1.0, P.Constraints(pins=(0,), skids=(2,)))
    >>> ahead = P.gait_family(
    ...     "ahead", worm, (0.6, 0.6, 0.0), [(0.4, 0.4, 0.0)], (0.5, 1.0), held=[push, pull]
    ... )
    >>> task = P.PathTask((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (1e-9, 1e-9))
    >>> path = P.plan_path(task, P.Library([ahead]), (0.3, 0.1), cost="time")
    >>> bool(abs(P.simulate_path(path).pose - [1.5, 0.0, 0.0]).max() < 1e-9)
    True
    """
    start = path.task.start
    places = start[:2] + rotate(start[2], path.library.rest)
    when, course = [np.zeros(1)], [places[None]]
    for k, step in enumerate(path.steps):
        motion, places = step.motion, course[-1][-1]
        if isinstance(motion, KinematicMotion):
            tau, found = simulate_held(
                places, motion.stroke, motion.phases, lengths, heading, looks
            )
        elif isinstance(motion, Crawl):
            own = motion.course
            tau, found = simulate_crawled(
                places, own.stroke, own.crawler.ground, lengths, heading, looks
            )
        else:
            raise ArgumentError(
                f"{step.name!r} is neither constrained nor a crawl; make it by gait_family"
            )
        when.append(k + tau[1:])
        course.append(found[1:])
    return Course(np.concatenate(when), np.concatenate(course))


def least_distance(course: np.ndarray, obstacles: Sequence[Obstacle], *, points: int = 41) -> float:
    """Return the least distance of points along all links (m, n, 2) from obstacles.

    It uses points alone, neither distances of segments nor bounds of the plan: a second route.

    Parameters
    ----------
    course : ndarray, shape (m, n, 2)
        Places of the masses.
    obstacles : sequence of Obstacle
        The obstacles.
    points : int, optional
        Points of each link.

    Returns
    -------
    float
    """
    share = np.linspace(0.0, 1.0, points)[:, None]
    a, b = course[:, :-1, None], course[:, 1:, None]
    along = (a + share * (b - a)).reshape(-1, 2)
    return min((float(_from(obstacle, along).min()) for obstacle in obstacles), default=np.inf)


def _from(obstacle: Obstacle, points: np.ndarray) -> np.ndarray:
    """Return distances of points (m, 2) from an obstacle, negative inside."""
    if isinstance(obstacle, Disc):
        off = points - np.array(obstacle.centre)
        return np.hypot(off[:, 0], off[:, 1]) - obstacle.radius
    if isinstance(obstacle, Wall):
        normal = np.array([np.cos(obstacle.angle), np.sin(obstacle.angle)])
        return (points - np.array(obstacle.point)) @ normal
    if isinstance(obstacle, Capsule):
        return _from_segment(points, np.array(obstacle.start), np.array(obstacle.end)) - (
            obstacle.radius
        )
    assert isinstance(obstacle, Block)
    corners = np.array(obstacle.corners)
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    least = np.min([_from_segment(points, p, q) for p, q in sides], axis=0)
    return np.where(inside(corners, points), -least, least)


def _from_segment(points: np.ndarray, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return distances of points from a segment, from components along and across it."""
    size = float(np.hypot(*(q - p)))
    if size == 0:
        return np.hypot(*(points - p).T)
    e = (q - p) / size
    x, y = (points - p) @ e, (points - p) @ np.array([-e[1], e[0]])
    return np.hypot(np.maximum(np.maximum(-x, x - size), 0.0), y)
