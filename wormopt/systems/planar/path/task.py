"""Path tasks: poses, obstacles, a corridor, costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.study import Given, entry, number, on_use, positive
from wormopt.study.types import Finite
from wormopt.systems.planar.obstacles import (
    Block,
    Capsule,
    Disc,
    Obstacle,
    Place,
    Wall,
    to_point,
)

with on_use():
    import numpy as np
    from numpy.typing import ArrayLike

    from wormopt.systems.planar.path.steps import GaitStep, Library
    from wormopt.systems.planar.poses import rotate

Pose = Annotated[
    tuple[Finite, ...],
    Meta(min_length=3, max_length=3, description="[x, y, angle], three finite numbers"),
]
Obstacles = tuple[Disc | Block | Capsule | Wall, ...]
Cost = Literal["steps", "work", "time"]


class Tolerance(Given, kw_only=False):
    """Largest distance and angle from a pose."""

    place: float = positive("length", "largest distance")
    angle: float = positive("angle", "largest angle")

    @classmethod
    def of(cls, given: Tolerance | tuple[float, float]) -> Tolerance:
        """Return a tolerance from a distance and an angle."""
        return given if isinstance(given, Tolerance) else cls(*given)

    def met(self, off: np.ndarray) -> np.ndarray:
        """Return whether differences (..., 3) from a pose are within the tolerance.

        Parameters
        ----------
        off : ndarray, shape (..., 3)
            x, y and angle.
        """
        near = np.hypot(off[..., 0], off[..., 1]) <= self.place
        return near & (np.abs(wrapped(off[..., 2])) <= self.angle)


class Corridor(Given, kw_only=False):
    """A line with a strip to both sides that no mass may leave."""

    line: Annotated[
        tuple[Place, ...], Meta(min_length=2, max_length=200, description="two places or more")
    ] = entry("corners of the line in order", quantity="length")
    width: float = positive("length", "largest distance from the line to either side")

    def room(self, points: np.ndarray) -> np.ndarray:
        """Return the distance left to points (..., 2) until they leave the corridor.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            The points.
        """
        line = np.array(self.line)
        pieces = pairwise(line)
        return self.width - np.min([to_point(points, a, b) for a, b in pieces], axis=0)


class Route(Given, kw_only=False):
    """Start, goal and limits of a path."""

    start: Pose = entry("initial pose of the head: x, y, and angle of the first link")
    goal: Pose = entry("pose to reach; the angle is modulo 2π")
    tolerance: Tolerance = entry("accepted distance of the end from the goal")
    via: tuple[Place, ...] = entry(
        "places that the head must pass, in this order", quantity="length", default=()
    )
    via_radius: float = positive("length", "accepted distance from these places", default=0.2)
    corridor: Corridor | None = entry("strip that no mass may leave", default=None)
    clearance: float = number("length", "least distance from obstacles", least=0, default=0.0)


class PathTask(Route, kw_only=False):
    """A path to find: from a pose to another, past obstacles, through via points.

    Examples
    --------
    >>> task = PathTask((0, 0, 0), (2, 0, 0), Tolerance(1e-6, 1e-6), via=[(1, 0)], via_radius=0.1)
    >>> task.off([2.0, 0.5, 0.1]).round(12).tolist()
    [0.0, 0.5, 0.1]
    """

    obstacles: Obstacles = entry("obstacles that the body may not touch", default=())

    def off(self, poses: ArrayLike) -> np.ndarray:
        """Return poses less the goal, with angles between -pi and pi.

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
        """Return the least room (...,) of bodies at places (..., n, 2); negative on contact.

        Room is the distance to obstacles less radius and clearance, or to the edge of the corridor.

        Parameters
        ----------
        places : ndarray, shape (..., n, 2)
            Places of the masses.
        radius : float
            Half the thickness of the links.
        obstacles : sequence of Obstacle, optional
            Obstacles to include; all if left out.
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
        """Return the least room over all instants of a step from a pose, bounded from below.

        If the body touches something at the end, only the end counts.

        Parameters
        ----------
        pose : ndarray, shape (3,)
            Initial pose.
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
        # the end decides most steps: it touches, or is farther away than the body moves
        end = pose[:2] + rotate(pose[2], step.points[-1])
        at_end = float(self.room(end, radius, near))
        if at_end < step.margins[-1]:
            return at_end - float(step.margins[-1])
        if at_end >= step.reach:
            return min(least, at_end - step.reach)
        rooms = self.room(step.placed(pose), radius, near) - step.margins
        return min(least, float(rooms.min()))


def cost_of(step: GaitStep, cost: Cost) -> float:
    """Return the cost of a step."""
    return 1.0 if cost == "steps" else float(getattr(step, cost))


def rest_fault(task: PathTask, library: Library) -> str:
    """Return why no steps can meet a task: the body touches an obstacle at either end."""
    for name, pose in (("start", task.start), ("goal", task.goal)):
        places = pose[:2] + rotate(pose[2], library.rest)
        room = float(task.room(places, library.radius))
        if room == -np.inf:
            return f"at the {name} the body is inside an obstacle"
        if room < 0:
            return f"at the {name} the body lacks {-room:.3g} of room to obstacles or corridor"
    return ""


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles between -pi and pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi
