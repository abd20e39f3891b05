"""Steps of gaits: what a stroke does as a whole, wherever it begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.se2 import compose, rotate
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.body.travel import Travel, divided
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.kinematic.constraints import kinematics_at
from wormopt.systems.planar.kinematic.loads import Ground, loads
from wormopt.systems.planar.kinematic.motion import KinematicMotion

_LONGEST = 1 / 24  # share of a stroke: crawls have long panels, and all are looked at as often


@dataclass(frozen=True, eq=False)
class GaitStep:
    """One stroke of a gait: where it takes the body, at what cost, and over what it sweeps.

    Parameters
    ----------
    name : str
        Of the gait.
    amplitude : float
        Which of its family it is.
    poses : ndarray, shape (K + 1, 3)
        Poses of the frame of the body at instants of the stroke, from (0, 0, 0).
    points : ndarray, shape (K + 1, n, 2)
        Places of the masses then, told in the frame at the start.
    tau, clock : ndarray, shape (K + 1,)
        Phases of the stroke and instants of these.
    slack : ndarray, shape (K,)
        No point of the body is farther than this, in between two instants, from where it is at the
        nearer of them: half the time between by a bound of the speeds of all masses.
    work : float
        What the stroke takes.
    motion : object, optional
        The motion it was made from.
    """

    name: str
    amplitude: float
    poses: np.ndarray
    points: np.ndarray
    tau: np.ndarray
    clock: np.ndarray
    slack: np.ndarray
    work: float
    motion: Any = None

    @property
    def time(self) -> float:
        """What the stroke takes."""
        return float(self.clock[-1])

    @property
    def displacement(self) -> np.ndarray:
        """x, y and angle by which the frame moves, (3,)."""
        return self.poses[-1]

    @cached_property
    def disc(self) -> tuple[np.ndarray, float]:
        """Centre (2,) and radius of a disc in which the body stays."""
        low, high = self.points.min(axis=(0, 1)), self.points.max(axis=(0, 1))
        middle = (low + high) / 2
        far = np.linalg.norm(self.points - middle, axis=-1).max()
        return middle, float(far + self.slack.max())

    @cached_property
    def margins(self) -> np.ndarray:
        """By how much a distance at an instant may be more than those near it, (K + 1,)."""
        return np.maximum(np.append(self.slack, 0.0), np.append(0.0, self.slack))

    def placed(self, pose: np.ndarray) -> np.ndarray:
        """Places (K + 1, n, 2) of the masses when the step begins at a pose.

        Parameters
        ----------
        pose : ndarray, shape (3,)
            x, y and angle.
        """
        return pose[:2] + rotate(pose[2], self.points)


def swept(
    name: str,
    amplitude: float,
    course: Travel,
    stroke: Stroke,
    shape: Shape,
    *,
    work: float,
    rates: Sequence[float] | float = 1.0,
    looks: int = 8,
    motion: Any = None,
) -> GaitStep:
    """Make a step of a course of poses, gone through as fast as the largest rates let.

    Every panel is looked at so many times or more.
    """
    tau, poses, way = _sampled(course, stroke, shape, looks)
    body = kinematics_at(shape, stroke.at(tau)[0]).points
    points = poses[:, None, :2] + rotate(poses[:, None, 2], body)
    most = np.broadcast_to(np.asarray(rates, dtype=float), (stroke.n_s,))
    pace = (np.abs(stroke.at(course.nodes)[1]) / most).max(axis=1)
    spent = (pace * course.weights).reshape(len(course.ends) - 1, -1).sum(axis=1)
    clock = np.interp(tau, course.ends, np.concatenate([[0.0], np.cumsum(spent)]))
    return GaitStep(name, amplitude, poses, points, tau, clock, way / 2, work, motion)


def _sampled(
    course: Travel, stroke: Stroke, shape: Shape, looks: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Phases and poses at ends of panels and nodes within, and bounds of ways in between.

    A bound is the time between two looks by a bound of the speeds of all masses in the panel.
    """
    panels = len(course.ends) - 1
    nodes = course.nodes.reshape(panels, -1)
    pick = slice(None, None, max(1, nodes.shape[1] // looks))
    fastest = course.fastest(_velocities(course, stroke, shape))
    tau = np.column_stack([course.ends[:-1], nodes[:, pick]])
    poses = np.concatenate(
        [course.poses[:-1, None], course.node_poses.reshape(panels, -1, 3)[:, pick]], axis=1
    )
    phases = np.append(tau, 1.0)
    way = np.diff(phases) * np.repeat(fastest, tau.shape[1])
    return phases, np.vstack([poses.reshape(-1, 3), course.poses[-1:]]), way


def _velocities(course: Travel, stroke: Stroke, shape: Shape) -> np.ndarray:
    """Velocities (m, n, 2) of the masses by the phase, in the frame of the body at the nodes.

    Their own headings turn: there a series would converge no better, but say less of the frame.
    """
    s, ds = stroke.at(course.nodes)
    at = kinematics_at(shape, s)
    v = np.einsum("mrj,mj->mr", at.J, course.twists) + np.einsum("mrs,ms->mr", at.B, ds)
    return rotate(at.headings, v.reshape(len(s), -1, 2))


def kinematic_step(
    name: str,
    motion: KinematicMotion,
    *,
    amplitude: float = 1.0,
    ground: Ground = None,
    rates: Sequence[float] | float = 1.0,
) -> GaitStep:
    """Make a step of a motion that pins and skids determine.

    Parameters
    ----------
    name : str
        Of the gait.
    motion : KinematicMotion
        The motion.
    amplitude : float, optional
        Which of its family it is.
    ground : law, sequence of laws or None, optional
        What resists sliding, for the work.
    rates : float or sequence of float, optional
        Largest rates of the shape variables: the stroke is gone through as fast as they let.

    Returns
    -------
    GaitStep
    """
    course, found = motion.course, loads(motion, ground)
    return swept(
        name, amplitude, course, motion.stroke, motion.shape,
        work=float(found.power @ course.weights), rates=rates, motion=motion,
    )  # fmt: skip


def crawl_step(
    name: str,
    found: Crawl,
    *,
    amplitude: float = 1.0,
    rates: Sequence[float] | float = 1.0,
) -> GaitStep:
    """Make a step of a slow crawl; its work is that of the ground, its time by largest rates."""
    return swept(
        name, amplitude, divided(found.travel, _LONGEST), found.course.stroke,
        found.course.crawler.shape,
        work=found.work, rates=rates, motion=found,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Family:
    """Steps of one gait by their amplitude.

    Parameters
    ----------
    name : str
        Of the gait.
    make : callable
        GaitStep of an amplitude.
    amplitudes : sequence of float
        Those that a search may use, ascending; a polish may use all in between.
    degree : int, optional
        Of polynomials in the amplitude that lead a polish; its last digits are those of the steps.
    """

    name: str
    make: Callable[[float], GaitStep]
    amplitudes: tuple[float, ...]
    degree: int = 8

    def __post_init__(self) -> None:
        rising = tuple(float(a) for a in self.amplitudes)
        object.__setattr__(self, "amplitudes", rising)
        if not rising or any(b <= a for a, b in pairwise(rising)):
            raise ArgumentError(f"amplitudes of {self.name!r} must ascend, not {list(rising)}")


@dataclass(frozen=True, eq=False)
class Library:
    """Steps that may follow one another: all begin and end in the same shape.

    Parameters
    ----------
    families : sequence of Family
        Gaits, each with a few amplitudes.
    radius : float
        Half the thickness of the body: its links are capsules.

    Examples
    --------
    >>> import wormopt as wo
    >>> worm, law = wo.planar.chain_shape(2), wo.Elliptic(1.0, 3.0, 2.0)
    >>> pull = [[0.4, 0.0, 0.0], [0.4, 0.4, 0.0], [0.0, 0.4, 0.0]]
    >>> ahead = wo.planar.gait_family("ahead", worm, (0.6, 0.6, 0.4), pull, (0.5, 1.0), ground=law)
    >>> Library([ahead], radius=0.05).rest.shape
    (3, 2)
    """

    families: tuple[Family, ...]
    radius: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "families", tuple(self.families))
        names = [family.name for family in self.families]
        if not names or len(set(names)) < len(names):
            raise ArgumentError(f"a library needs families of different names, not {names}")
        if not 0 <= self.radius < np.inf:
            raise ArgumentError(f"radius must be 0 or above, not {self.radius}")
        rest = self.steps[0].points[0]
        for step in self.steps:
            ends = step.points[0], _back(step)
            if max(np.abs(end - rest).max() for end in ends) > 1e-9 * np.abs(rest).max():
                raise ArgumentError(
                    f"{step.name!r} does not begin and end in the shape of {names[0]!r}; steps "
                    "that follow one another must share it"
                )

    @cached_property
    def steps(self) -> tuple[GaitStep, ...]:
        """All steps that a search may use."""
        return tuple(f.make(amplitude) for f in self.families for amplitude in f.amplitudes)

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """To which family each step belongs."""
        return tuple(k for k, f in enumerate(self.families) for _ in f.amplitudes)

    @property
    def rest(self) -> np.ndarray:
        """Places (n, 2) of the masses in the shape that all steps share."""
        return self.steps[0].points[0]


def _back(step: GaitStep) -> np.ndarray:
    """Places of the masses at the end, in the frame there."""
    pose = step.displacement
    return rotate(-pose[2], step.points[-1] - pose[:2])


def chained(start: np.ndarray, steps: Sequence[GaitStep]) -> np.ndarray:
    """Poses (m + 1, 3) before the first of m steps and after each."""
    poses = [np.asarray(start, dtype=float)]
    for step in steps:
        poses.append(compose(poses[-1], step.displacement))
    return np.array(poses)
