"""Bodies on viscous ground: their local connection xi = A(s) s', and displacement by a stroke.

The power dissipated by rods and points is quadratic in the velocities. The body has no inertia and
no other load, so its motion has least power. A and the metric of power G are parts of one quadratic
form in the twist and the rates of the shape. The motion does not depend on time: displacement and
the length of the stroke in the metric are integrals over its phase. At constant power the work in a
given time is least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.systems.planar.poses import travel
from wormopt.systems.planar.shape import Shape, Stroke, turned

Drag = tuple[float, float]
"""Drags along and across."""


@dataclass(frozen=True, eq=False)
class Swimmer:
    """A body on viscous ground whose links are rods and whose masses are points.

    The drag of a rod is c_t along and c_n across itself, per length and velocity. Its velocity is
    linear from end to end, so a rod of length l resists rotation by c_n l^3 / 12, and a rod that
    stretches uniformly dissipates the power c_t l l'^2 / 12.

    Theory: docs/theory-planar.md, section 5.

    Parameters
    ----------
    shape : Shape
        Points of the body; rods join each with the next.
    rods : (float, float), optional
        c_t and c_n, drag per length and velocity.
    masses : (float, float), optional
        k_t and k_n, drag of each point per velocity, along and across its heading.

    Raises
    ------
    ArgumentError
        If a drag is negative, or nothing resists along or nothing across.

    Examples
    --------
    >>> from wormopt.systems.planar.shape import chain_shape
    >>> purcell = Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, 2.0))
    >>> A, G = purcell.local([0.0, 0.0])
    >>> np.linalg.eigvalsh(G).round(12).tolist()
    [0.061728395062, 0.333333333333]
    """

    shape: Shape
    rods: Drag = (0.0, 0.0)
    masses: Drag = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("rods", "masses"):
            pair = tuple(float(value) for value in getattr(self, name))
            if len(pair) != 2 or not np.all(np.isfinite(pair)) or min(pair) < 0:
                raise ArgumentError(f"{name} needs two drags, along and across, not {pair}")
            object.__setattr__(self, name, pair)
        if max(min(self.rods), min(self.masses)) == 0:
            raise ArgumentError(
                "the ground must resist along and across: give rods=(c_t, c_n) or "
                "masses=(k_t, k_n), both above 0"
            )
        if self.shape.n_points < 2:
            raise ArgumentError("a body on viscous ground needs two or more points")

    @cached_property
    def power(self) -> ca.SX:
        """Power dissipated by the ground, by the shape, its rates and the twist."""
        own = ca.sum2(ca.DM(self.masses).T @ self.shape.velocities**2)
        velocities = [self.shape.velocity(i) for i in range(self.shape.n_points)]
        return own + sum(self._rod(j, velocities) for j in range(1, self.shape.n_points))

    def _rod(self, j: int, velocities: list[ca.SX]) -> ca.SX:
        along, across = self.rods
        d = self.shape.points[:, j - 1] - self.shape.points[:, j]
        length = ca.norm_2(d)
        e = d / length
        total = ca.SX(0)
        middle = (velocities[j - 1] + velocities[j]) / 2
        for v, share in ((middle, 1.0), (velocities[j - 1] - velocities[j], 1 / 12)):
            ahead, aside = ca.dot(v, e), e[0] * v[1] - e[1] * v[0]
            total += share * length * (along * ahead**2 + across * aside**2)
        return total

    @cached_property
    def connection(self) -> ca.SX:
        """A(s), shape (3, n_s): the twist is A s'."""
        xx, xs, _ = self._blocks
        return -ca.mtimes(_inverse(xx), xs)

    @cached_property
    def metric(self) -> ca.SX:
        """G(s), shape (n_s, n_s): power is s'^T G s'."""
        _, xs, ss = self._blocks
        return ss + ca.mtimes(xs.T, self.connection)

    @cached_property
    def _blocks(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        q = ca.vertcat(self.shape.twist, self.shape.rates)
        form = ca.densify(ca.hessian(self.power, q)[0]) / 2
        return form[:3, :3], form[:3, 3:], form[3:, 3:]

    @cached_property
    def functions(self) -> ca.Function:
        """Function of ``s`` for ``A`` and ``G``."""
        parts = [ca.densify(part) for part in (self.connection, self.metric)]
        return ca.Function("local", [self.shape.s], parts, ["s"], ["A", "G"])

    def local(self, s: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the local connection and the metric of power at shapes.

        Parameters
        ----------
        s : array_like, shape (n_s,) or (m, n_s)
            Shapes.

        Returns
        -------
        A : ndarray, shape (3, n_s) or (m, 3, n_s)
            The twist is A s'.
        G : ndarray, shape (n_s, n_s) or (m, n_s, n_s)
            The power is s'^T G s'.
        """
        shapes, n_s = np.asarray(s, dtype=float), self.shape.s.numel()
        if shapes.shape[-1:] != (n_s,) or shapes.ndim > 2:
            raise ArgumentError(f"shapes need {n_s} variables each, not an array {shapes.shape}")
        rows = np.atleast_2d(shapes)
        A, G = map(np.asarray, self.functions(rows.T))
        A = A.reshape(3, len(rows), n_s).swapaxes(0, 1)
        G = G.reshape(n_s, len(rows), n_s).swapaxes(0, 1)
        return (A, G) if shapes.ndim == 2 else (A[0], G[0])

    def seen_from(self, place: ca.SX, angle: ca.SX) -> Swimmer:
        """Return the same body in another frame.

        Parameters
        ----------
        place : casadi.SX, shape (2, 1)
            Origin of that frame in the present one, by the shape.
        angle : casadi.SX
            Rotation of that frame to the left, in rad.

        Returns
        -------
        Swimmer
        """
        shape = self.shape
        columns = [turned(-angle, shape.points[:, i] - place) for i in range(shape.n_points)]
        points, headings = ca.horzcat(*columns), shape.headings - angle
        return replace(self, shape=replace(shape, points=points, headings=headings))

    @cached_property
    def lengths(self) -> ca.Function:
        """Function of ``s`` for the lengths of the rods."""
        d = self.shape.points[:, :-1] - self.shape.points[:, 1:]
        found = ca.sqrt(ca.sum1(d**2)).T
        return ca.Function("lengths", [self.shape.s], [ca.densify(found)], ["s"], ["lengths"])

    def towing_drag(self, shapes: np.ndarray) -> float:
        """Return the towing force of the straight body over velocity, with rods at their shortest.

        Parameters
        ----------
        shapes : ndarray, shape (m, n_s)
            Shapes of the stroke.

        Returns
        -------
        float
        """
        shortest = np.asarray(self.lengths(np.atleast_2d(shapes).T)).min(axis=1)
        return float(self.rods[0] * shortest.sum() + self.masses[0] * self.shape.n_points)

    @property
    def ceiling(self) -> float:
        """Upper bound of the efficiency of any stroke: 1, if drag is least along.

        A rod's centre has to move as far as the body. At uniform speed this takes least power, at
        least min(c_t, c_n) per length. The same holds for points.
        """
        pairs = [pair for pair in (self.rods, self.masses) if max(pair) > 0]
        return max(1.0, max((t / n if n > 0 else np.inf) for t, n in pairs))


def _inverse(m: ca.SX) -> ca.SX:
    """Return the inverse of a symmetric matrix (3, 3), by cofactors."""
    adjoint = ca.adj(m)
    return adjoint / (m[0, :] @ adjoint[:, 0])


# Initial panels of the quadrature, its target, and its required accuracy.
_PANELS, _ROUNDING, _LOOSE = 2, 1e-14, 1e-6
STRAIGHT = 1e-9
"""Turn below which a stroke counts as straight, with a distance independent of the frame."""


@dataclass(frozen=True, eq=False)
class Swim:
    """Result of `swim`: the effect of one stroke.

    Parameters
    ----------
    displacement : ndarray, shape (3,)
        Displacement and rotation of the body's frame, in the frame at the start.
    length : float
        Length of the stroke in the metric of power: in time T the work is at least length^2 / T.
    phase : ndarray, shape (m,)
        Phases of the following arrays.
    shapes : ndarray, shape (m, n_s)
        Shapes.
    poses : ndarray, shape (m, 3)
        Poses of the frame, from the start.
    travelled : ndarray, shape (m,)
        Length of the stroke up to the phase.
    drag : float
        Towing force of the straight body over velocity.
    error : float
        Change of displacement and length when panels were halved.
    """

    displacement: np.ndarray
    length: float
    phase: np.ndarray
    shapes: np.ndarray
    poses: np.ndarray
    travelled: np.ndarray
    drag: float
    error: float

    @property
    def distance(self) -> float:
        """Distance of the frame; independent of frame and start if the stroke does not turn."""
        return float(np.hypot(*self.displacement[:2]))

    @property
    def turn(self) -> float:
        """Rotation of the body, in rad."""
        return float(self.displacement[2])

    @property
    def action(self) -> float:
        """Least product of work and time, at constant power."""
        return self.length**2

    @property
    def efficiency(self) -> float:
        """Work to tow the straight body as far in the same time, over that of the stroke.

        drag distance^2 / action; NaN if the stroke turns the body or nothing moves.
        """
        if abs(self.turn) > STRAIGHT or not self.length > 0:
            return float("nan")
        return self.drag * self.distance**2 / self.action

    def work(self, duration: float) -> float:
        """Return the least work for a duration.

        Parameters
        ----------
        duration : float
            Duration of the stroke.

        Returns
        -------
        float
        """
        if not duration > 0:
            raise ArgumentError(f"duration must be above 0, not {duration}")
        return self.action / duration

    @cached_property
    def time(self) -> np.ndarray:
        """Times (m,) of the phases at constant power, over the duration of the stroke."""
        return self.travelled / self.length if self.length > 0 else self.phase


def swim(swimmer: Swimmer, stroke: Stroke) -> Swim:
    """Return the displacement and work of a stroke of a body on viscous ground.

    Theory: docs/theory-planar.md, section 5.

    Parameters
    ----------
    swimmer : Swimmer
        The body.
    stroke : Stroke
        Its shape over a phase: `Harmonics`, `Polygon`, or any object with their methods.

    Returns
    -------
    Swim
        Displacement, work, and poses over the stroke.

    Raises
    ------
    ArgumentError
        If the stroke has another number of shape variables, or passes too near a shape with
        infinite drag: a link of length 0.

    Examples
    --------
    >>> from wormopt.systems.planar.shape import chain_shape
    >>> from wormopt.systems.planar.shape import Polygon
    >>> purcell = Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, 2.0))
    >>> square = Polygon([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    >>> round(swim(purcell, square).distance, 12)
    0.180562563321
    """
    if stroke.n_s != swimmer.shape.s.numel():
        names = ", ".join(swimmer.shape.names) or "none"
        raise ArgumentError(f"the stroke has {stroke.n_s} shape variables, the body has: {names}")

    def rates(phase: np.ndarray) -> np.ndarray:
        shapes, ds = stroke.at(phase)
        A, G = swimmer.local(shapes)
        power = np.einsum("mi,mij,mj->m", ds, G, ds)
        found = np.column_stack([np.einsum("mij,mj->mi", A, ds), np.sqrt(np.maximum(power, 0.0))])
        if not np.all(np.isfinite(found)):
            raise ArgumentError("the stroke passes a shape at which drag is not finite")
        return found

    course = travel(rates, stroke.breaks, panels=_PANELS, accuracy=_ROUNDING)
    length = float(course.sums[-1, 0])
    if not course.error <= _LOOSE * (1 + length):
        raise ArgumentError("the stroke passes too near a shape at which a link has no length")
    phase = np.concatenate([[0.0], course.nodes, [1.0]])
    shapes = stroke.at(phase)[0]
    return Swim(
        course.displacement,
        length,
        phase,
        shapes,
        np.vstack([np.zeros(3), course.node_poses, course.displacement]),
        np.concatenate([[0.0], course.node_sums[:, 0], [length]]),
        swimmer.towing_drag(shapes),
        course.error,
    )
