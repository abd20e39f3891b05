"""What is asked of a path: poses, obstacles, a corridor, costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.obstacles import Obstacle, to_point
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.path.steps import GaitStep, Library

Cost = Literal["steps", "work", "time"]
Near: TypeAlias = "Tolerance | tuple[float, float]"


@dataclass(frozen=True)
class Tolerance:
    """How near a pose must be met.

    Parameters
    ----------
    place : float
        Largest distance.
    angle : float
        Largest angle, rad.
    """

    place: float
    angle: float

    @classmethod
    def of(cls, given: Near) -> Tolerance:
        """Make one of a distance and an angle."""
        return given if isinstance(given, Tolerance) else cls(*given)

    def __post_init__(self) -> None:
        if not (0 < self.place < np.inf and 0 < self.angle < np.inf):
            raise ArgumentError(f"tolerances must be positive, not {self.place}, {self.angle}")

    def met(self, off: np.ndarray) -> np.ndarray:
        """Whether poses less the one asked for, (..., 3), lie within.

        Parameters
        ----------
        off : ndarray, shape (..., 3)
            x, y and angle.
        """
        near = np.hypot(off[..., 0], off[..., 1]) <= self.place
        return near & (np.abs(wrapped(off[..., 2])) <= self.angle)


@dataclass(frozen=True, eq=False)
class Corridor:
    """A line of straight pieces which all masses must keep near to.

    Parameters
    ----------
    line : array_like, shape (m, 2)
        Its corners in order.
    width : float
        Largest distance of a mass to either side.
    """

    line: np.ndarray
    width: float

    def __post_init__(self) -> None:
        line = np.array(self.line, dtype=float)
        object.__setattr__(self, "line", line)
        if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2 or not self.width > 0:
            raise ArgumentError("a corridor needs a line of two points or more and a width above 0")

    def room(self, points: np.ndarray) -> np.ndarray:
        """By how much points (..., 2) are nearer to the line than they must be.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            The points.
        """
        pieces = zip(self.line, self.line[1:], strict=False)
        return self.width - np.min([to_point(points, a, b) for a, b in pieces], axis=0)


@dataclass(frozen=True, eq=False)
class PathTask:
    """A path to find: from a pose to another, past obstacles, through places on the way.

    Parameters
    ----------
    start, goal : array_like, shape (3,)
        Poses of the frame at the head: x, y, heading. A goal holds modulo 2 pi.
    tolerance : Tolerance or (float, float)
        How near the goal must be met: a distance and an angle.
    obstacles : sequence of Obstacle, optional
        What the body must not touch.
    clearance : float, optional
        Least distance from obstacles.
    via : sequence of (float, float), optional
        Places that the head must come near to in this order, between two steps.
    via_radius : float, optional
        How near.
    corridor : Corridor or (array_like, float), optional
        What the masses must stay in: corners (m, 2) of a line, and how far from it they may be.

    Examples
    --------
    >>> task = PathTask((0, 0, 0), (2, 0, 0), (1e-6, 1e-6), via=[(1, 0)], via_radius=0.1)
    >>> task.off([2.0, 0.5, 0.1]).round(12).tolist()
    [0.0, 0.5, 0.1]
    """

    start: np.ndarray
    goal: np.ndarray
    tolerance: Any  # kept as a Tolerance
    obstacles: Sequence[Obstacle] = ()
    clearance: float = 0.0
    via: Sequence[tuple[float, float]] = ()
    via_radius: float = 0.0
    corridor: Any = None  # kept as a Corridor

    def __post_init__(self) -> None:
        for name in ("start", "goal"):
            pose = np.array(getattr(self, name), dtype=float)
            if pose.shape != (3,) or not np.isfinite(pose).all():
                raise ArgumentError(f"{name} must be x, y and an angle, not {pose.tolist()}")
            object.__setattr__(self, name, pose)
        object.__setattr__(self, "tolerance", Tolerance.of(self.tolerance))
        if self.corridor is not None and not isinstance(self.corridor, Corridor):
            object.__setattr__(self, "corridor", Corridor(*self.corridor))
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        object.__setattr__(self, "via", tuple((float(x), float(y)) for x, y in self.via))
        if self.via and not self.via_radius > 0:
            raise ArgumentError("places on the way need a via_radius above 0")
        if not self.clearance >= 0:
            raise ArgumentError(f"clearance must be 0 or above, not {self.clearance}")

    def off(self, poses: np.ndarray) -> np.ndarray:
        """Poses less the goal, angles between -pi and pi.

        Parameters
        ----------
        poses : ndarray, shape (..., 3)
            x, y and angle.
        """
        off = np.asarray(poses) - self.goal
        off[..., 2] = wrapped(off[..., 2])
        return off

    def room(
        self, places: np.ndarray, radius: float, obstacles: Sequence[Obstacle] | None = None
    ) -> np.ndarray:
        """Least room (...,) that bodies with masses at places (..., n, 2) have; below 0 they touch.

        Room is distance to obstacles less radius and clearance, or to the edge of the corridor.

        Parameters
        ----------
        places : ndarray, shape (..., n, 2)
            Of the masses.
        radius : float
            Half the thickness of the links.
        obstacles : sequence of Obstacle, optional
            Those that are looked at; all if left out.
        """
        a, b = places[..., :-1, :], places[..., 1:, :]
        found = np.full(places.shape[:-2], np.inf)
        for obstacle in self.obstacles if obstacles is None else obstacles:
            free = obstacle.distance(a, b).min(axis=-1) - radius - self.clearance
            found = np.minimum(found, free)
        if self.corridor is not None:
            found = np.minimum(found, self.corridor.room(places).min(axis=-1))
        return found

    def step_room(self, pose: np.ndarray, step: GaitStep, radius: float) -> float:
        """Least room over all instants of a step from a pose, bounded from below.

        Parameters
        ----------
        pose : ndarray, shape (3,)
            Where it begins.
        step : GaitStep
            The step.
        radius : float
            Half the thickness of the links.
        """
        middle, far = step.disc
        x, y = pose[:2] + rotate(pose[2], middle)
        least, near = np.inf, []
        for obstacle in self.obstacles:
            at_x, at_y, size = obstacle.disc
            apart = math.hypot(x - at_x, y - at_y) - size - far - radius - self.clearance
            if apart <= 0:
                near.append(obstacle)
            else:
                least = min(least, apart)
        if not near and self.corridor is None:
            return least
        rooms = self.room(step.placed(pose), radius, near) - step.margins
        return min(least, float(rooms.min()))


def cost_of(step: GaitStep, cost: Cost) -> float:
    """What a step costs."""
    return 1.0 if cost == "steps" else float(getattr(step, cost))


def rest_fault(task: PathTask, library: Library) -> str:
    """Why a task cannot be met whatever the steps: the body touches something at either end."""
    for name, pose in (("start", task.start), ("goal", task.goal)):
        places = pose[:2] + rotate(pose[2], library.rest)
        room = float(task.room(places, library.radius))
        if room == -np.inf:
            return f"at the {name} the body lies inside an obstacle"
        if room < 0:
            return f"at the {name} the body lacks {-room:.3g} of room to what it must not touch"
    return ""


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles between -pi and pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi
