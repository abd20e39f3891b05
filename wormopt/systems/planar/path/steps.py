"""Steps of gaits: the effect of a whole stroke, and families proportional to an amplitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.crawling.crawl import Crawl, crawl
from wormopt.systems.planar.kinematic import (
    Constraints,
    Ground,
    KinematicMotion,
    Phase,
    kinematic_motion,
    loads,
)
from wormopt.systems.planar.poses import Travel, compose, divided, rotate
from wormopt.systems.planar.shape import Polygon, Shape, Stroke, kinematics_at

_LOOKS = 8  # least number of instants of a panel
_LONGEST = 1 / 24  # share of a stroke: crawls have long panels, which get as many samples


@dataclass(frozen=True, eq=False)
class GaitStep:
    """One stroke of a gait: its displacement, its cost, and the area it sweeps.

    Parameters
    ----------
    name : str
        Name of the gait.
    amplitude : float
        Amplitude within the family.
    poses : ndarray, shape (K + 1, 3)
        Poses of the frame of the body at instants of the stroke, from (0, 0, 0).
    points : ndarray, shape (K + 1, n, 2)
        Places of the masses at these instants, in the frame at the start.
    tau, clock : ndarray, shape (K + 1,)
        Phases of the stroke, and times.
    slack : ndarray, shape (K,)
        Bound of the distance of any point of the body, between two instants, from its place at the
        nearer of them: half the time between, times a bound of the speeds of all masses.
    work : float
        Work of the stroke.
    motion : object, optional
        The motion from which it was made.
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
        """Duration of the stroke."""
        return float(self.clock[-1])

    @property
    def displacement(self) -> np.ndarray:
        """x, y and angle of the frame after the stroke, (3,)."""
        return self.poses[-1]

    @cached_property
    def disc(self) -> tuple[np.ndarray, float]:
        """Centre (2,) and radius of a disc that contains the body."""
        low, high = self.points.min(axis=(0, 1)), self.points.max(axis=(0, 1))
        middle = (low + high) / 2
        far = np.linalg.norm(self.points - middle, axis=-1).max()
        return middle, float(far + self.slack.max())

    @cached_property
    def reach(self) -> float:
        """Largest distance of any point of the body from its place at the end."""
        moved = np.linalg.norm(self.points - self.points[-1], axis=-1)
        return float(moved.max() + self.slack.max())

    @cached_property
    def margins(self) -> np.ndarray:
        """Largest excess of the distance at an instant over those near it, (K + 1,)."""
        return np.maximum(np.append(self.slack, 0.0), np.append(0.0, self.slack))

    def placed(self, pose: np.ndarray) -> np.ndarray:
        """Return places (K + 1, n, 2) of the masses if the step begins at a pose.

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
    work: float,
    rates: Sequence[float] | float,
    motion: KinematicMotion | Crawl,
) -> GaitStep:
    """Return a step from poses, at the highest speed that the largest rates allow."""
    tau, poses, way = _sampled(course, stroke, shape)
    body = kinematics_at(shape, stroke.at(tau)[0]).points
    points = poses[:, None, :2] + rotate(poses[:, None, 2], body)
    most = np.broadcast_to(np.asarray(rates, dtype=float), (stroke.n_s,))
    pace = (np.abs(stroke.at(course.nodes)[1]) / most).max(axis=1)
    spent = (pace * course.weights).reshape(len(course.ends) - 1, -1).sum(axis=1)
    clock = np.interp(tau, course.ends, np.concatenate([[0.0], np.cumsum(spent)]))
    return GaitStep(name, amplitude, poses, points, tau, clock, way / 2, work, motion)


def _sampled(
    course: Travel, stroke: Stroke, shape: Shape
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return phases and poses at ends of panels and nodes, and bounds of displacements between."""
    panels = len(course.ends) - 1
    nodes = course.nodes.reshape(panels, -1)
    pick = slice(None, None, max(1, nodes.shape[1] // _LOOKS))
    fastest = course.fastest(_velocities(course, stroke, shape))
    tau = np.column_stack([course.ends[:-1], nodes[:, pick]])
    poses = np.concatenate(
        [course.poses[:-1, None], course.node_poses.reshape(panels, -1, 3)[:, pick]], axis=1
    )
    phases = np.append(tau, 1.0)
    way = np.diff(phases) * np.repeat(fastest, tau.shape[1])
    return phases, np.vstack([poses.reshape(-1, 3), course.poses[-1:]]), way


def _velocities(course: Travel, stroke: Stroke, shape: Shape) -> np.ndarray:
    """Return velocities (m, n, 2) of the masses by the phase, in the frame of the body."""
    s, ds = stroke.at(course.nodes)
    at = kinematics_at(shape, s)
    v = np.einsum("mrj,mj->mr", at.J, course.twists) + np.einsum("mrs,ms->mr", at.B, ds)
    return rotate(at.headings, v.reshape(len(s), -1, 2))


@dataclass(frozen=True, eq=False)
class Family:
    """Steps of one gait by their amplitude.

    Parameters
    ----------
    name : str
        Name of the gait.
    make : callable
        Function from an amplitude to a GaitStep.
    amplitudes : sequence of float
        Amplitudes that a search may use, ascending; refinement may use all in between.
    degree : int, optional
        Degree of the polynomials in the amplitude that approximate steps during refinement.
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
    """Steps that begin and end in the same shape, so they can follow one another in any order.

    Parameters
    ----------
    families : sequence of Family
        Gaits, each with a few amplitudes.
    radius : float
        Half the thickness of the body, whose links are capsules.

    Raises
    ------
    ArgumentError
        If names are equal, the radius is negative, or rest shapes differ.

    Examples
    --------
    >>> import wormopt as wo
    >>> P, worm = wo.planar, wo.planar.chain_shape(2)
    >>> hold = P.Constraints(pins=(2,), skids=(0,))
    >>> nod = P.gait_family("nod", worm, (0.6, 0.6, 0.0), [(0.2, 0.2, 0.0)], (1.0,), held=hold)
    >>> P.Library([nod], radius=0.05).rest.shape
    (3, 2)
    """

    families: tuple[Family, ...]
    radius: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "families", tuple(self.families))
        names = [family.name for family in self.families]
        if not names or len(set(names)) < len(names):
            raise ArgumentError(f"families must have different names, not {names}")
        if not 0 <= self.radius < np.inf:
            raise ArgumentError(f"radius must be 0 or above, not {self.radius}")
        rest = self.steps[0].points[0]
        for step in self.steps:
            ends = step.points[0], _back(step)
            if max(np.abs(end - rest).max() for end in ends) > 1e-9 * np.abs(rest).max():
                raise ArgumentError(
                    f"{step.name!r} does not begin and end in the shape of {names[0]!r}; give all "
                    "families the same rest shape"
                )

    @cached_property
    def steps(self) -> tuple[GaitStep, ...]:
        """All steps that a search may use."""
        return tuple(f.make(amplitude) for f in self.families for amplitude in f.amplitudes)

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """Index of the family of each step."""
        return tuple(k for k, f in enumerate(self.families) for _ in f.amplitudes)

    @property
    def rest(self) -> np.ndarray:
        """Places (n, 2) of the masses in the common rest shape."""
        return self.steps[0].points[0]


def _back(step: GaitStep) -> np.ndarray:
    """Return places of the masses at the end, in the frame at the end."""
    pose = step.displacement
    return rotate(-pose[2], step.points[-1] - pose[:2])


def chained(start: ArrayLike, steps: Sequence[GaitStep]) -> np.ndarray:
    """Return poses (m + 1, 3) before the first of m steps and after each."""
    poses = [np.asarray(start, dtype=float)]
    for step in steps:
        poses.append(compose(poses[-1], step.displacement))
    return np.array(poses)


def gait_family(
    name: str,
    shape: Shape,
    rest: ArrayLike,
    changes: ArrayLike,
    amplitudes: Sequence[float],
    *,
    ground: Ground = None,
    held: Constraints | Sequence[Phase] | None = None,
    rates: Sequence[float] | float = 1.0,
) -> Family:
    """Return a family of strokes from a rest shape through others and back, by an amplitude.

    With pins and skids the shape determines the motion. Without them the body crawls slowly, and
    friction determines the motion.

    Parameters
    ----------
    name : str
        Name of the gait.
    shape : Shape
        The body.
    rest : array_like, shape (n_s,)
        Shape at the start and end of the stroke.
    changes : array_like, shape (k, n_s)
        Shapes in between, less the rest shape, at amplitude 1.
    amplitudes : sequence of float
        Amplitudes that a search may use, ascending.
    ground : law, sequence of laws or None, optional
        Friction of all masses, or of each: `Elliptic` for a crawl; with constraints the resistance
        to sliding, for the work.
    held : Constraints or sequence of Phase, optional
        Constraints; none if left out.
    rates : float or sequence of float, optional
        Largest rates of the shape variables, for the duration.

    Returns
    -------
    Family

    Raises
    ------
    ArgumentError
        If there are neither constraints nor ground.

    Examples
    --------
    Two links stretch, one after the other; the ground resists backward motion more.

    >>> import wormopt as wo
    >>> worm, law = wo.planar.chain_shape(2), wo.Elliptic(1.0, 3.0, 2.0)
    >>> pull = [[0.4, 0.0, 0.0], [0.4, 0.4, 0.0], [0.0, 0.4, 0.0]]
    >>> ahead = wo.planar.gait_family("ahead", worm, (0.6, 0.6, 0.4), pull, (0.5, 1.0), ground=law)
    >>> bool(ahead.make(1.0).displacement[0] > 0.1)
    True
    """
    stroke = _strokes(rest, changes)
    if held is None and ground is None:
        raise ArgumentError("without constraints and ground the body does not move; give a ground")

    def make(amplitude: float) -> GaitStep:
        if held is not None:
            motion = kinematic_motion(shape, stroke(amplitude), held)
            course = motion.course
            work = float(loads(motion, ground).power @ course.weights)
        else:
            motion = crawl(shape, cast("PlanarLaw", ground), stroke(amplitude))
            course, work = divided(motion.travel, _LONGEST), motion.work
        return swept(name, amplitude, course, stroke(amplitude), shape, work, rates, motion)

    if held is not None:
        return Family(name, make, tuple(amplitudes))
    # phases appear and vanish with the amplitude: more points do not improve a polynomial
    return Family(name, make, tuple(amplitudes), degree=6)


def _strokes(rest: ArrayLike, changes: ArrayLike) -> Callable[[float], Polygon]:
    """Return strokes by their amplitude, from rest through other shapes and back."""
    start, way = np.asarray(rest, dtype=float), np.atleast_2d(np.asarray(changes, dtype=float))
    return lambda amplitude: Polygon(np.vstack([start, start + amplitude * way]))
