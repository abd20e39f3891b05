"""Obstacles in the plane: their distance from links, and their contact with masses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError


class Obstacle(Protocol):
    """An obstacle in the plane that a body must not touch."""

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return distances of segments from a (..., 2) to b (..., 2); 0 or below for overlaps."""
        ...

    @property
    def disc(self) -> tuple[float, float, float]:
        """Centre x and y, and radius, of a disc around it."""
        ...


@dataclass(frozen=True)
class Disc:
    """A round obstacle.

    Parameters
    ----------
    centre : (float, float)
        Centre, in units of length.
    radius : float
        Radius, positive.
    friction : float, optional
        Coefficient of dry friction, not negative, for masses that press against it.

    Raises
    ------
    ArgumentError
        If the radius is not positive, or a number is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> post = Disc((1.0, 0.0), radius=0.5)
    >>> float(post.distance(np.array([0.0, 0.7]), np.array([2.0, 0.7]))).__round__(12)
    0.2
    """

    centre: tuple[float, float]
    radius: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        _check_points(self.centre)
        _check_radius(self.radius, least=1e-300)

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
        return (*self.centre, self.radius)

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


@dataclass(frozen=True)
class Wall:
    """A straight wall: the half plane behind it is closed.

    Parameters
    ----------
    point : (float, float)
        A point of the wall.
    angle : float
        Direction of its normal, in rad, which points into the open.
    friction : float, optional
        Coefficient of dry friction, not negative, for masses that press against it.

    Examples
    --------
    >>> import numpy as np
    >>> Wall((0.0, 0.0), angle=0.0).distance(np.array([2.0, 1.0]), np.array([3.0, 0.0])).item()
    2.0
    """

    point: tuple[float, float]
    angle: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        _check_points(self.point, (self.angle, 0.0))

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
        return (*self.point, math.inf)

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


@dataclass(frozen=True)
class Capsule:
    """All points within a radius of a segment: a fence, a rod.

    Parameters
    ----------
    start, end : (float, float)
        Ends of the segment; equal ends make a disc.
    radius : float, optional
        Half its thickness, not negative.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float = 0.0

    def __post_init__(self) -> None:
        _check_points(self.start, self.end)
        _check_radius(self.radius, least=0.0)

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


@dataclass(frozen=True)
class Block:
    """A solid polygon, convex or not, whose sides do not cross.

    Parameters
    ----------
    corners : sequence of (float, float)
        Corners in order, at least three.

    Raises
    ------
    ArgumentError
        If the corners are fewer than three or span no area.

    Examples
    --------
    >>> import numpy as np
    >>> square = Block([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    >>> square.distance(np.array([2.0, 0.0]), np.array([2.0, 1.0])).item()
    1.0
    """

    corners: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", tuple((float(x), float(y)) for x, y in self.corners))
        _check_points(*self.corners)
        points = np.array(self.corners)
        if len(points) < 3 or abs(_area(points)) <= 1e-12 * np.ptp(points, axis=0).max() ** 2:
            raise ArgumentError(f"{points} span no area; a block needs three or more corners")

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

    @property
    def disc(self) -> tuple[float, float, float]:
        """Centre and radius of a disc around it."""
        return self._disc

    @cached_property
    def _disc(self) -> tuple[float, float, float]:
        corners = np.array(self.corners)
        x, y = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return x, y, float(np.hypot(*(corners - [x, y]).T).max())


def inside(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return whether points (..., 2) are in a polygon (m, 2), by the crossings of a ray."""
    x, y = point[..., :1], point[..., 1:]
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    return np.sum(crosses & (x < x0 + (y - y0) * (x1 - x0) / rise), axis=-1) % 2 == 1


def to_point(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return distances of points (..., 2) from segments a to b, all broadcast."""
    way = b - a
    square = np.maximum(np.sum(way**2, axis=-1), 1e-300)
    share = np.clip(np.sum((point - a) * way, axis=-1) / square, 0.0, 1.0)
    off = point - a - share[..., None] * way
    return np.hypot(off[..., 0], off[..., 1])


def between(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return distances of segments p to q from segments a to b, all broadcast; 0 if they cross."""
    ends = [to_point(p, a, b), to_point(q, a, b), to_point(a, p, q), to_point(b, p, q)]
    least = np.min(np.broadcast_arrays(*ends), axis=0)
    apart = (_side(a, b, p) * _side(a, b, q) >= 0) | (_side(p, q, a) * _side(p, q, b) >= 0)
    return np.where(apart, least, 0.0)


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    way, off = b - a, point - a
    return way[..., 0] * off[..., 1] - way[..., 1] * off[..., 0]


def _area(points: np.ndarray) -> float:
    x, y = points.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _check_points(*points: tuple[float, float]) -> None:
    for point in points:
        if len(point) != 2 or not np.isfinite(point).all():
            raise ArgumentError(f"a place must be two finite numbers, not {point}")


def _check_radius(radius: float, *, least: float) -> None:
    if not least <= radius < np.inf:
        raise ArgumentError(f"radius must be a finite number {'above' if least else 'from'} 0")
