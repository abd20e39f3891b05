"""Shapes of a body and strokes of the shape.

A shape gives the points of the body as CasADi expressions in its variables. A body of n links has
masses 0 to n, head first; r_{j-1} - r_j = l_j e(psi_j). The joint angles are
phi_j = psi_j - psi_{j+1}, positive if the link in front is turned to the left. The frame of the
body has its origin at the head and its first axis along the first link. A stroke is a closed curve
of the shape over a phase, independent of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError

Heading = Literal["bisector", "front", "rear"]
"""Heading of an inner mass: between its links, or along the link in front or in the rear."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Points and headings of a body by its shape variables.

    Parameters
    ----------
    s : casadi.SX
        Column of the shape variables: lengths, angles, or none for a rigid body.
    names : tuple of str
        Names of the shape variables.
    points : casadi.SX, shape (2, m)
        Places of the points in the frame of the body, in units of length.
    headings : casadi.SX, shape (m, 1)
        Headings of the points relative to the body's heading, in rad.
    rates : casadi.SX
        Column of symbols of the time derivatives of ``s``.
    twist : casadi.SX
        Three symbols: velocity of the frame, in the frame, and its angular velocity.

    Examples
    --------
    >>> chain_shape(2).names
    ('length 1', 'length 2', 'angle 1')
    >>> chain_shape(2, lengths=(1.0, 1.0)).points[:, 1]
    SX([-1, 0])
    """

    s: ca.SX
    names: tuple[str, ...]
    points: ca.SX
    headings: ca.SX
    rates: ca.SX
    twist: ca.SX

    @property
    def n_points(self) -> int:
        """Number of points."""
        return int(self.points.size2())

    @cached_property
    def velocities(self) -> ca.SX:
        """Velocities of the points, each along its own heading and to its left, shape (2, m).

        They are linear in `twist` and `rates`.
        """
        points = range(self.n_points)
        return ca.horzcat(*(turned(-self.headings[i], self.velocity(i)) for i in points))

    def velocity(self, i: int) -> ca.SX:
        """Return the velocity (2) of a point along the axes of the body's frame.

        Parameters
        ----------
        i : int
            Number of the point.
        """
        place = self.points[:, i]
        turn = ca.vertcat(-place[1], place[0])
        return self.twist[:2] + self.twist[2] * turn + ca.jtimes(place, self.s, self.rates)

    @cached_property
    def turning(self) -> ca.SX:
        """Angular velocities of the headings, shape (m, 1)."""
        return self.twist[2] + ca.jtimes(self.headings, self.s, self.rates)

    @cached_property
    def kinematics(self) -> ca.Function:
        """Function of s for places, headings, and velocities of points J twist + B rates.

        Returns ``points`` (2, m), ``headings`` (m), ``J`` (2m, 3) and ``B`` (2m, n_s).
        """
        v = ca.vec(self.velocities)
        J, B = ca.jacobian(v, self.twist), ca.jacobian(v, self.rates)
        found = [ca.densify(part) for part in (self.points, self.headings, J, B)]
        return ca.Function("kinematics", [self.s], found, ["s"], ["points", "headings", "J", "B"])


def turned(angle: ca.SX, vector: ca.SX) -> ca.SX:
    """Rotate a vector (2) to the left by an angle."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])


def rigid_shape(
    points: Sequence[Sequence[float]], headings: Sequence[float] | None = None
) -> Shape:
    """Return the shape of a rigid body.

    Parameters
    ----------
    points : sequence of (float, float)
        Places of its points in its frame, in units of length.
    headings : sequence of float, optional
        Headings of the points relative to the body's, in rad; all 0 by default.

    Returns
    -------
    Shape
        A shape without shape variables.

    Examples
    --------
    >>> rigid_shape([(1.0, 0.0), (-1.0, 0.0)]).n_points
    2
    """
    looks = [0.0] * len(points) if headings is None else headings
    if len(looks) != len(points) or not len(points):
        raise ArgumentError(f"{len(points)} points need as many headings, not {len(looks)}")
    places = ca.SX(ca.DM([list(point) for point in points])).T
    return _shape(ca.SX(0, 1), (), places, ca.SX(ca.DM(list(looks))))


def chain_shape(
    n_links: int, *, lengths: Sequence[float] | None = None, heading: Heading = "bisector"
) -> Shape:
    """Return the shape of a chain of links with joints that bend.

    Parameters
    ----------
    n_links : int
        Number n of links; there are n + 1 masses, head first, and n - 1 joints.
    lengths : sequence of float, optional
        Lengths of links that do not change; if left out, lengths are shape variables.
    heading : {"bisector", "front", "rear"}, optional
        Heading of an inner mass: between its links, or along the link in front or in the rear.

    Returns
    -------
    Shape
        The shape variables are the lengths, if they vary, then the joint angles in rad.

    Raises
    ------
    ArgumentError
        If there is no link, a length is not positive, or their number is not n.

    Examples
    --------
    >>> chain_shape(3, lengths=(1.0, 1.0, 1.0)).names
    ('angle 1', 'angle 2')
    """
    if n_links < 1:
        raise ArgumentError(f"a chain needs at least one link, not {n_links}")
    if lengths is not None and (len(lengths) != n_links or min(lengths) <= 0):
        raise ArgumentError(f"lengths must be {n_links} positive numbers, not {list(lengths)}")
    angles = ca.SX.sym("phi", n_links - 1)
    varied = ca.SX.sym("l", n_links if lengths is None else 0)
    names = tuple(f"length {j + 1}" for j in range(varied.numel()))
    names += tuple(f"angle {j + 1}" for j in range(n_links - 1))
    sizes = varied if lengths is None else ca.SX(ca.DM(list(lengths)))
    links = link_angles(angles)
    points = [ca.SX.zeros(2)]
    for j in range(n_links):
        along = ca.vertcat(ca.cos(links[j]), ca.sin(links[j]))
        points.append(points[-1] - sizes[j] * along)
    looks = mass_headings(links, angles, heading)
    return _shape(ca.vertcat(varied, angles), names, ca.horzcat(*points), looks)


def link_angles(angles: ca.SX) -> ca.SX:
    """Return the angles of the links relative to the first one, head first, by the joint angles."""
    return ca.vertcat(0, -ca.cumsum(angles)) if angles.numel() else ca.SX.zeros(1)


def mass_headings(links: ca.SX, angles: ca.SX, heading: Heading) -> ca.SX:
    """Return the headings of the masses, by the angles of links and joints."""
    behind = {"bisector": 0.5, "front": 1.0, "rear": 0.0}
    if heading not in behind:
        raise ArgumentError(f"heading must be one of {', '.join(behind)}, not {heading!r}")
    if not angles.numel():
        return ca.SX.zeros(2)
    return ca.vertcat(links[0], links[1:] + behind[heading] * angles, links[-1])


def _shape(s: ca.SX, names: tuple[str, ...], points: ca.SX, headings: ca.SX) -> Shape:
    rates, twist = ca.SX.sym("s_dot", s.numel()), ca.SX.sym("twist", 3)
    return Shape(s, names, points, headings, rates, twist)


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Places, headings and velocities (J twist + B rates) of points at m shapes."""

    points: np.ndarray  # (m, n, 2)
    headings: np.ndarray  # (m, n)
    J: np.ndarray  # (m, 2n, 3)
    B: np.ndarray  # (m, 2n, n_s)

    @property
    def scaling(self) -> np.ndarray:
        """Matrices (m, 3, 3) from twists to mean velocities, and rotation times size."""
        middle = self.points.mean(axis=1)
        spread = self.points - middle[:, None]
        size = np.sqrt(np.mean(np.sum(spread**2, axis=-1), axis=-1))
        T = np.tile(np.eye(3), (len(size), 1, 1))
        T[:, 0, 2], T[:, 1, 2] = middle[:, 1] / size, -middle[:, 0] / size
        T[:, 2, 2] = 1 / size
        return T


def kinematics_at(shape: Shape, s: np.ndarray) -> Kinematics:
    """Return the kinematics at shapes (m, n_s)."""
    m, n = len(s), shape.n_points
    points, headings, J, B = (np.asarray(part) for part in shape.kinematics(s.T))
    return Kinematics(
        points.T.reshape(m, n, 2),
        headings.T.reshape(m, n),
        np.moveaxis(J.reshape(2 * n, m, 3), 1, 0),
        np.moveaxis(B.reshape(2 * n, m, -1), 1, 0),
    )


@runtime_checkable
class Stroke(Protocol):
    """A curve of the shape variables over a phase tau from 0 to 1, closed unless said otherwise."""

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        ...

    @property
    def breaks(self) -> np.ndarray:
        """Phases between which the curve is smooth, including 0 and 1."""
        ...

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes and their derivatives at phases.

        At a break the derivative is the right one, at 1 the left one.

        Parameters
        ----------
        tau : array_like, shape (m,)
            Phases from 0 to 1.

        Returns
        -------
        s, ds : ndarray, shape (m, n_s)
            Shapes, and their derivatives by the phase.
        """
        ...


@dataclass(frozen=True, eq=False)
class Harmonics(Stroke):
    """A stroke of harmonic shape variables.

    s(tau) = mean + sum over h of cosine_h cos(2 pi h tau) + sine_h sin(2 pi h tau), h = 1, 2, ...

    Parameters
    ----------
    mean : array_like, shape (n_s,)
        Mean shape: link lengths, if they vary, then joint angles in rad.
    cosine, sine : array_like, shape (H, n_s)
        Coefficients of the harmonics.

    Raises
    ------
    ArgumentError
        If the shapes of the tables differ.

    Examples
    --------
    >>> circle = Harmonics([0.0, 0.0], cosine=[[1.0, 0.0]], sine=[[0.0, 1.0]])
    >>> circle.at(0.25)[0].round(12).tolist()
    [[0.0, 1.0]]
    """

    mean: Any  # stored as arrays
    cosine: Any
    sine: Any

    def __post_init__(self) -> None:
        for name in ("mean", "cosine", "sine"):
            value = np.array(getattr(self, name), dtype=float)
            object.__setattr__(self, name, value)
        if self.cosine.shape != self.sine.shape or self.cosine.shape[1:] != self.mean.shape:
            raise ArgumentError(
                f"{len(self.mean)} shape variables need tables of shape (H, {len(self.mean)}), "
                f"not {self.cosine.shape} and {self.sine.shape}"
            )

    @property
    def n_s(self) -> int:
        return len(self.mean)

    @property
    def breaks(self) -> np.ndarray:
        """Phases 0 and 1: the curve is smooth everywhere."""
        return np.array([0.0, 1.0])

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        orders = 2 * np.pi * np.arange(1, len(self.cosine) + 1)
        angle = np.atleast_1d(np.asarray(tau, dtype=float))[:, None] * orders
        c, s = np.cos(angle), np.sin(angle)
        shape = self.mean + c @ self.cosine + s @ self.sine
        return shape, (c * orders) @ self.sine - (s * orders) @ self.cosine


@dataclass(frozen=True, eq=False)
class Polygon(Stroke):
    """A stroke that is linear from corner to corner, with equal durations of all sides.

    Parameters
    ----------
    corners : array_like, shape (m, n_s)
        Shapes in order (link lengths, if they vary, then joint angles in rad).
    closed : bool, optional
        Whether a last side returns to the first corner.

    Raises
    ------
    ArgumentError
        If the corners are no table.

    Examples
    --------
    >>> Polygon([[0.0], [1.0]]).at([0.25, 0.75])[1].tolist()
    [[2.0], [-2.0]]
    """

    corners: Any  # stored as an array
    closed: bool = True

    def __post_init__(self) -> None:
        corners = np.array(self.corners, dtype=float)
        object.__setattr__(self, "corners", corners)
        if corners.ndim != 2 or len(corners) < 2:
            raise ArgumentError(f"corners must have the shape (m, n_s), not {corners.shape}")

    @property
    def n_s(self) -> int:
        return int(self.corners.shape[1])

    @property
    def breaks(self) -> np.ndarray:
        """Phases of the corners."""
        return np.linspace(0.0, 1.0, len(self.corners) + self.closed)

    def at(self, tau: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        phase, breaks = np.atleast_1d(np.asarray(tau, dtype=float)), self.breaks
        m, ends = len(breaks) - 1, np.vstack([self.corners, self.corners[:1]])
        side = np.clip(np.searchsorted(breaks, phase, side="right") - 1, 0, m - 1)
        way = np.diff(ends, axis=0)[side]
        return ends[side] + (phase * m - side)[:, None] * way, m * way
