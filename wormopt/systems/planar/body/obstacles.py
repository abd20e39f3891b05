"""Obstacles in the plane: how far links stay from them, and how masses press against them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError


class Obstacle(Protocol):
    """Something in the plane that a body must not touch."""

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Distance of segments from a (..., 2) to b (..., 2); 0 or below where they overlap."""
        ...

    @property
    def disc(self) -> tuple[float, float, float]:
        """X and y of the centre, and radius, of a disc around it."""
        ...


@dataclass(frozen=True)
class Disc:
    """A round obstacle.

    Parameters
    ----------
    centre : (float, float)
        Where it stands.
    radius : float
        Its radius, positive.
    friction : float, optional
        Coefficient of friction on it, not negative: for masses that press against it.

    Raises
    ------
    ArgumentError
        If the radius is not positive, or a number not finite.

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
        """Distance of segments from a to b; below 0 by how deep they lie within.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Their ends.
        """
        return to_point(np.asarray(self.centre, dtype=float), a, b) - self.radius

    @property
    def disc(self) -> tuple[float, float, float]:
        """Centre and radius."""
        return (*self.centre, self.radius)

    def normal(self, place: ca.SX) -> ca.SX:
        """Unit normal at a place (2), away from the centre.

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        away = place - ca.DM(list(self.centre))
        return away / ca.norm_2(away)

    def gap(self, place: ca.SX) -> ca.SX:
        """Distance of a place from the disc.

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
        Direction of its normal, into the open.
    friction : float, optional
        Coefficient of friction on it, not negative: for masses that press against it.

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
        """Distance of segments from a to b; below 0 by how far they reach behind it.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Their ends.
        """
        ahead = [(end - np.asarray(self.point)) @ np.array(self._open) for end in (a, b)]
        return np.minimum(*ahead)

    @property
    def disc(self) -> tuple[float, float, float]:
        """No disc is around it."""
        return (*self.point, math.inf)

    def normal(self, place: ca.SX) -> ca.SX:
        """Unit normal at a place (2).

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        return ca.SX(ca.DM(list(self._open)))

    def gap(self, place: ca.SX) -> ca.SX:
        """Distance of a place from the wall.

        Parameters
        ----------
        place : casadi.SX, shape (2,)
            The place.
        """
        return ca.dot(self.normal(place), place - ca.DM(list(self.point)))


@dataclass(frozen=True)
class Capsule:
    """All points at most a radius away from a segment: a fence, a rod.

    Parameters
    ----------
    start, end : (float, float)
        Ends of the segment; equal ones make a disc.
    radius : float, optional
        Half its thickness, 0 or above.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float = 0.0

    def __post_init__(self) -> None:
        _check_points(self.start, self.end)
        _check_radius(self.radius, least=0.0)

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Distance of segments from a to b; 0 less the radius where they cross.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Their ends.
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
        Its corners in order, three or more.

    Examples
    --------
    >>> import numpy as np
    >>> square = Block(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    >>> float(square.distance(np.array([2.0, 0.0]), np.array([2.0, 1.0])))
    1.0
    """

    corners: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", tuple((float(x), float(y)) for x, y in self.corners))
        _check_points(*self.corners)
        points = np.array(self.corners)
        if len(points) < 3 or abs(_area(points)) <= 1e-12 * np.ptp(points, axis=0).max() ** 2:
            raise ArgumentError(f"a block needs three corners or more that span an area: {points}")

    def distance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Distance of segments from a to b; 0 where they cross a side, -inf where they lie in.

        Parameters
        ----------
        a, b : ndarray, shape (..., 2)
            Their ends.
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
    """Whether points (..., 2) lie in a polygon (m, 2), by how often a ray crosses its sides."""
    x, y = point[..., :1], point[..., 1:]
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    return np.sum(crosses & (x < x0 + (y - y0) * (x1 - x0) / rise), axis=-1) % 2 == 1


def to_point(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of points (..., 2) from segments a to b, all broadcast."""
    way = b - a
    square = np.maximum(np.sum(way**2, axis=-1), 1e-300)
    share = np.clip(np.sum((point - a) * way, axis=-1) / square, 0.0, 1.0)
    off = point - a - share[..., None] * way
    return np.hypot(off[..., 0], off[..., 1])


def between(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of segments p to q from segments a to b, all broadcast; 0 where they cross."""
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
