"""Obstacles in the plane: their distance from links, and their contact with masses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, positive
from wormopt.study.types import Finite

with on_use():
    import casadi as ca
    import numpy as np

Place = Annotated[
    tuple[Finite, ...], Meta(min_length=2, max_length=2, description="[x, y], two finite numbers")
]
_FRICTION = number(
    "1",
    "coefficient of dry friction on masses that press against it, if contact is smooth",
    least=0,
    default=0.0,
)


class Disc(Given, kw_only=False, tag_field="shape", tag="disc"):
    """A round obstacle.

    Examples
    --------
    >>> import numpy as np
    >>> post = Disc((1.0, 0.0), radius=0.5)
    >>> float(post.distance(np.array([0.0, 0.7]), np.array([2.0, 0.7]))).__round__(12)
    0.2
    """

    centre: Place = entry("centre of the disc", quantity="length")
    radius: float = positive("length", "radius of the disc")
    friction: float = _FRICTION

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the distance of segments from a to b; negative by their depth in the disc.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Ends of the segments.
        """
        return to_point(np.asarray(self.centre, dtype=float), a, b) - self.radius

    @property
    def disc(self) -> tuple[float, float, float]:
        """Centre and radius."""
        x, y = self.centre
        return x, y, self.radius

    def normal(self, place: ca.SX) -> ca.SX:
        """Return the unit normal at a place (2), away from the centre.

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        away = place - ca.DM(list(self.centre))
        return away / ca.norm_2(away)

    def gap(self, place: ca.SX) -> ca.SX:
        """Return the distance of a place from the disc.

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        return ca.norm_2(place - ca.DM(list(self.centre))) - self.radius


class Wall(Given, kw_only=False, tag_field="shape", tag="wall"):
    """An infinite straight wall; the space behind it is closed.

    Examples
    --------
    >>> import numpy as np
    >>> Wall((0.0, 0.0), angle=0.0).distance(np.array([2.0, 1.0]), np.array([3.0, 0.0])).item()
    2.0
    """

    point: Place = entry("any point of the wall", quantity="length")
    angle: float = number("angle", "direction of the normal, which points into the open")
    friction: float = _FRICTION

    @property
    def _open(self) -> tuple[float, float]:
        return math.cos(self.angle), math.sin(self.angle)

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the distance of segments from a to b; negative by their depth behind the wall.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Ends of the segments.
        """
        ahead = [(end - np.asarray(self.point)) @ np.array(self._open) for end in (a, b)]
        return np.minimum(*ahead)

    @property
    def disc(self) -> tuple[float, float, float]:
        """A disc of infinite radius: no disc encloses a wall."""
        x, y = self.point
        return x, y, math.inf

    def normal(self, place: ca.SX) -> ca.SX:
        """Return the unit normal (2) of the wall.

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        return ca.SX(ca.DM(list(self._open)))

    def gap(self, place: ca.SX) -> ca.SX:
        """Return the distance of a place from the wall.

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        return ca.dot(self.normal(place), place - ca.DM(list(self.point)))


class Capsule(Given, kw_only=False, tag_field="shape", tag="capsule"):
    """A rod or a fence: all points within a radius of a straight segment."""

    start: Place = entry("first end of the segment", quantity="length")
    end: Place = entry("second end of the segment", quantity="length")
    radius: float = number("length", "half the thickness", least=0, default=0.0)

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the distance of segments from a to b; minus the radius if they cross.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Ends of the segments.
        """
        start, end = (np.asarray(p, dtype=float) for p in (self.start, self.end))
        return between(start, end, a, b) - self.radius

    @property
    def disc(self) -> tuple[float, float, float]:
        """Centre and radius of a disc around it."""
        (x0, y0), (x1, y1) = self.start, self.end
        return (x0 + x1) / 2, (y0 + y1) / 2, float(np.hypot(x1 - x0, y1 - y0)) / 2 + self.radius


class Block(Given, kw_only=False, tag_field="shape", tag="block"):
    """A solid polygon, convex or not, whose sides do not cross.

    Examples
    --------
    >>> import numpy as np
    >>> square = Block([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    >>> square.distance(np.array([2.0, 0.0]), np.array([2.0, 1.0])).item()
    1.0
    """

    corners: Annotated[
        tuple[Place, ...], Meta(min_length=3, max_length=100, description="three places or more")
    ] = entry("corners in order", quantity="length")

    def faults_of_keys(self) -> Iterator[Fault]:
        pairs = zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True)
        twice = sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs)
        wide = max(max(row) - min(row) for row in zip(*self.corners, strict=True))
        # no power: it raises where it overflows
        if abs(twice) < 1e-9 * wide * wide or wide == 0:
            yield "corners", "they span no area; for a fence write a capsule"

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the distance of segments from a to b; 0 if they cross a side, -inf inside.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Ends of the segments.
        """
        p, q = self._sides
        least = between(p, q, a[..., None, :], b[..., None, :]).min(axis=-1)
        return np.where(inside(p, a), -np.inf, least)

    @cached_property
    def _sides(self) -> tuple[np.ndarray, np.ndarray]:
        corners = np.array(self.corners)
        return corners, np.roll(corners, -1, axis=0)

    @cached_property
    def disc(self) -> tuple[float, float, float]:
        """Centre and radius of a disc around it."""
        corners = np.array(self.corners)
        x, y = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return x, y, float(np.hypot(*(corners - [x, y]).T).max())


Obstacle = Disc | Wall | Capsule | Block
"""An obstacle in the plane that a body must not touch."""


def inside(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return whether points (..., 2) are in a polygon (m, 2), by the crossings of a ray."""
    x, y = point[..., :1], point[..., 1:]
    (x0, y0), (x1, y1) = corners.T, np.concatenate([corners[1:], corners[:1]]).T
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    return np.sum(crosses & (x < x0 + (y - y0) * (x1 - x0) / rise), axis=-1) % 2 == 1


def to_point(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return distances of points (..., 2) from segments a to b, all broadcast."""
    (x, y), (u, v) = _parts(b - a), _parts(point - a)  # sums over an axis of two are slow
    square = np.maximum(x * x + y * y, 1e-300)
    share = np.minimum(np.maximum((u * x + v * y) / square, 0.0), 1.0)
    return np.hypot(u - share * x, v - share * y)


def between(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return distances of segments p to q from segments a to b, all broadcast; 0 if they cross."""
    ends = [to_point(p, a, b), to_point(q, a, b), to_point(a, p, q), to_point(b, p, q)]
    least = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
    apart = (_side(a, b, p) * _side(a, b, q) >= 0) | (_side(p, q, a) * _side(p, q, b) >= 0)
    return np.where(apart, least, 0.0)


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    (x, y), (u, v) = _parts(b - a), _parts(point - a)
    return x * v - y * u


def _parts(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return vectors[..., 0], vectors[..., 1]
