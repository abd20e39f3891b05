"""Strokes of straight sides: starts of the search, and derivatives by the corners.

The twist has least power at Gauss points of each side, all sides at once. Derivatives of
displacement and work follow from the implicit function theorem, for a potential smoothed over a
very small width. Starts are random strokes within the limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from wormopt.errors import SolveError
from wormopt.numerics.expressions import at_rows
from wormopt.ocp.motion import Guess
from wormopt.systems.planar.design.aim import Dry, Ground, PlanarAim
from wormopt.systems.planar.poses import compose, rotate
from wormopt.systems.planar.shape import Harmonics, Shape

# Width of the potential for derivatives, in usual powers; Newton's steps.
_ITERATIONS, _NEAR, _ROUGHLY, _OPEN, _SLOW = 60, 1e-9, 1e-2, 1e-15, 1e-3
_WIDTHS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-7, 1e-9)


@dataclass(frozen=True, eq=False)
class Sides:
    """Displacements of the sides of a stroke, each in the frame in which it begins."""

    pose: np.ndarray  # (k, 3)
    work: np.ndarray  # (k,)
    pose_by: np.ndarray  # (k, 3, 2 n_s) by the corner at its start and that at its end
    work_by: np.ndarray  # (k, 2 n_s)

    @property
    def running(self) -> Iterator[np.ndarray]:
        """Poses (3,) before the first and after every side."""
        end = np.zeros(3)
        yield end
        for pose in self.pose:
            end = compose(end, pose)
            yield end

    @property
    def total(self) -> np.ndarray:
        """Pose (3,) after all sides."""
        *_, end = self.running
        return end

    def gradients(self, closed: bool = True) -> Iterator[np.ndarray]:
        """Yield derivatives (3, corners, n_s) of each of `running`."""
        k, _, twice = self.pose_by.shape
        n_s = twice // 2
        by = np.zeros((3, k if closed else k + 1, n_s))
        yield by
        for i, before in zip(range(k), self.running, strict=False):
            c, s = np.cos(before[2]), np.sin(before[2])
            turn = np.array([[c, -s], [s, c]])
            ahead = turn @ self.pose[i, :2]
            by = by.copy()
            by[0] -= ahead[1] * by[2]
            by[1] += ahead[0] * by[2]
            own = self.pose_by[i].copy()
            own[:2] = turn @ own[:2]
            by[:, i] += own[:, :n_s]
            by[:, (i + 1) % by.shape[1]] += own[:, n_s:]
            yield by

    def gradient(self, closed: bool = True) -> np.ndarray:
        """Return derivatives (3, corners, n_s) of `total`."""
        *_, by = self.gradients(closed)
        return by

    def work_gradient(self, closed: bool = True) -> np.ndarray:
        """Return derivatives (corners, n_s) of the sum of `work`."""
        k, twice = self.work_by.shape
        n_s = twice // 2
        by = np.zeros((k if closed else k + 1, n_s))
        for i in range(k):
            by[i] += self.work_by[i, :n_s]
            by[(i + 1) % len(by)] += self.work_by[i, n_s:]
        return by


@dataclass(frozen=True, eq=False)
class Steps:
    """Motion of a shape on a ground while its variables change along straight lines."""

    shape: Shape
    ground: Ground
    parts: int = 4  # equal parts of a side, each with `points` Gauss points
    points: int = 8  # Gauss points of each part
    width: float = _WIDTHS[-1]  # final width of the potential, in usual powers

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        shape, width = self.shape, ca.SX.sym("width")
        potential = self.ground.potential(shape, width)
        power = self.ground.power(shape, width)
        xi, both = shape.twist, ca.vertcat(shape.s, shape.rates)
        hessian, slope = ca.hessian(potential, xi)
        symbols = [xi, shape.s, shape.rates, width]
        newton = [potential, slope, hessian]
        by_both, by_twist = ca.gradient(power, both), ca.gradient(power, xi)
        slopes = [hessian, ca.jacobian(slope, both), power, by_twist, by_both]
        return (
            ca.Function("potential", symbols, [potential]),
            ca.Function("newton", symbols, list(map(ca.densify, newton))),
            ca.Function("slopes", symbols, list(map(ca.densify, slopes))),
        )

    def twists(
        self, s: np.ndarray, rates: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float | np.ndarray]:
        """Return twists (m, 3) at shapes (m, n_s) with rates, those at a width, and the width."""
        if not isinstance(self.ground, Dry):
            xi = self._minimise(np.zeros((len(s), 3)), s, rates, 1.0, _NEAR)
            return xi, xi, 1.0
        pace = np.maximum(np.linalg.norm(rates, axis=1, keepdims=True), 1e-300)
        widths = [width for width in _WIDTHS if width >= self.width]
        xi, memory = np.zeros((len(s), 3)), self._last
        if len(memory.get("xi", ())) == len(s):
            xi, widths = memory["xi"], widths[min(2, len(widths) - 1) :]
        before = None
        for k, width in enumerate(widths):
            near = _NEAR if width == widths[-1] else _ROUGHLY * width
            guess = xi
            if before is not None:  # resting masses creep in proportion to the width
                guess = xi + (xi - before) * (widths[k - 1] - width) / (
                    widths[k - 2] - widths[k - 1]
                )
            before = xi if k else None
            xi = self._minimise(guess, s, rates / pace, width * self.ground.most, near)
        memory["xi"] = xi
        near = xi * pace
        return near, near, widths[-1] * self.ground.most * pace

    @cached_property
    def _last(self) -> dict[str, np.ndarray]:
        """Last twists, from which the next ones start."""
        return {}

    def _minimise(
        self, xi: np.ndarray, s: np.ndarray, rates: np.ndarray, width: float, near: float
    ) -> np.ndarray:
        potential, newton, _ = self._functions
        xi = xi.copy()
        slow = _SLOW * np.abs(rates).max(axis=1)  # where the head rests its twist is 0
        value, slope, hessian = at_rows(newton, xi, s, rates, width)
        for _ in range(_ITERATIONS):
            step = -np.linalg.solve(_regular(hessian), slope[..., None])[..., 0]
            falls = np.einsum("mi,mi->m", slope, step)
            size, worse, found = np.ones(len(s)), np.ones(len(s), dtype=bool), [value]
            for halved in range(30):  # whole steps, of which most succeed, with their derivatives
                tried = xi + size[:, None] * step
                found = at_rows(potential if halved else newton, tried, s, rates, width)
                limit = value[:, 0] + 1e-4 * size * falls + 1e-13 * np.abs(value[:, 0])
                worse = ~(found[0][:, 0] <= limit)
                if not worse.any():
                    break
                size[worse] /= 2
            size[worse] = 0.0
            xi = xi + size[:, None] * step
            if len(found) == 1:
                found = at_rows(newton, xi, s, rates, width)
            value, slope, hessian = found
            moved = np.abs(size[:, None] * step).max(axis=1)
            if np.all(moved <= near * (np.abs(xi).max(axis=1) + slow)):
                break
        return xi

    def sides(self, corners: np.ndarray, closed: bool = True) -> Sides:
        """Return displacements along a polygon (k, n_s), back to the first corner if `closed`."""
        begin = corners if closed else corners[:-1]
        end = np.roll(corners, -1, axis=0) if closed else corners[1:]
        k, n_s = begin.shape
        tau, weights, integral = self._rule
        q = len(tau)
        way = end - begin
        s = (begin[:, None] + tau[:, None] * way[:, None]).reshape(-1, n_s)
        rates = np.repeat(way, q, axis=0)
        xi, near, width = self.twists(s, rates)
        if not np.isfinite(xi).all():
            raise SolveError("no motion of least power was found along the stroke")
        *_, slopes = self._functions
        hessian, mixed, power, by_xi, by_both = at_rows(slopes, near, s, rates, width)
        hessian = _regular(hessian)
        mixed = mixed.reshape(-1, 2 * n_s, 3).transpose(0, 2, 1)
        xi_by = -np.linalg.solve(hessian, mixed)
        by_both = by_both + np.einsum("mi,min->mn", by_xi, xi_by)

        # by corners: s = (1 - tau) begin + tau end, rate = end - begin
        def by_corners(part: np.ndarray) -> np.ndarray:
            part = part.reshape(k, q, *part.shape[1:])
            by_s, by_rate = part[..., :n_s], part[..., n_s:]
            t = tau.reshape(1, q, *([1] * (part.ndim - 2)))
            return np.concatenate([(1 - t) * by_s - by_rate, t * by_s + by_rate], axis=-1)

        xi, xi_by = xi.reshape(k, q, 3), by_corners(xi_by)
        turn = np.einsum("ql,kl->kq", integral, xi[..., 2])
        turn_by = np.einsum("ql,kln->kqn", integral, xi_by[..., 2, :])
        c, sn = np.cos(turn), np.sin(turn)
        vx, vy = c * xi[..., 0] - sn * xi[..., 1], sn * xi[..., 0] + c * xi[..., 1]
        cb, sb = c[..., None], sn[..., None]
        vx_by = cb * xi_by[..., 0, :] - sb * xi_by[..., 1, :] - vy[..., None] * turn_by
        vy_by = sb * xi_by[..., 0, :] + cb * xi_by[..., 1, :] + vx[..., None] * turn_by
        pose = np.stack([vx @ weights, vy @ weights, xi[..., 2] @ weights], axis=-1)
        pose_by = np.stack(
            [np.einsum("q,kqn->kn", weights, part) for part in (vx_by, vy_by, xi_by[..., 2, :])],
            axis=1,
        )
        work = power.reshape(k, q) @ weights
        work_by = np.einsum("q,kqn->kn", weights, by_corners(by_both))
        return Sides(pose, work, pose_by, work_by)

    @cached_property
    def _rule(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of [0, 1], their weights, and the matrix of integrals up to each point."""
        x, w = legendre.leggauss(self.points)
        x, w, parts, h = (x + 1) / 2, w / 2, np.arange(self.parts), 1 / self.parts
        basis = legendre.legvander(2 * x - 1, self.points - 1)
        up = legendre.legval(2 * x - 1, legendre.legint(np.eye(self.points), lbnd=-1)) / 2
        one = np.linalg.solve(basis.T, up).T
        before = np.kron(parts[:, None] > parts, np.tile(w, (self.points, 1)))
        tau = ((parts[:, None] + x) * h).ravel()
        return tau, np.tile(w * h, self.parts), h * (before + np.kron(np.eye(self.parts), one))


def _regular(hessian: np.ndarray) -> np.ndarray:
    """Return regularised Hessians (m, 3, 3), for motions that are not unique: straight chains."""
    found = hessian.reshape(-1, 3, 3)
    size = np.trace(found, axis1=1, axis2=2)[:, None, None]
    return found + (_OPEN * size + 1e-300) * np.eye(3)


_HARMONICS = 2
_INSIDE = 0.9
# Where in their ranges angles of an inchworm are: off the middle, straight bodies may be open.
_BENT = 0.55


def chance_corners(aim: PlanarAim, random: np.random.Generator) -> np.ndarray:
    """Return corners (k, n_s) of a random stroke of a few harmonics, within the limits."""
    ranges = aim.ranges
    n_s = len(ranges)
    orders = 1.0 / np.arange(1, _HARMONICS + 1)[:, None] ** 2
    wave = Harmonics(
        np.zeros(n_s),
        random.normal(size=(_HARMONICS, n_s)) * orders,
        random.normal(size=(_HARMONICS, n_s)) * orders,
    )
    swing = wave.at(np.linspace(0, 1, 65))[0]
    swing /= np.abs(swing).max(axis=0)
    half = (ranges[:, 1] - ranges[:, 0]) / 2
    size = half * random.uniform(0.3, _INSIDE, n_s)
    middle = ranges.mean(axis=1) + (half - size) * random.uniform(-_INSIDE, _INSIDE, n_s)
    tau = np.arange(aim.corners) / aim.corners
    table = np.linspace(0, 1, 65)
    shape = np.stack([np.interp(tau, table, swing[:, i]) for i in range(n_s)], axis=1)
    corners = middle + size * shape
    if aim.start is not None:
        corners[0] = aim.start
    return corners


def first_corners(aim: PlanarAim, seed: int, k: int) -> np.ndarray:
    """Return corners (k, n_s) of start k: first a wave of lengths, if it moves forward."""
    lengths = np.char.startswith(np.array(aim.shape.names), "length")
    ahead = aim.purpose == "speed" and isinstance(aim.ground, Dry) and aim.start is None
    if k == 0 and ahead and lengths.sum() > 1 and aim.corners > lengths.sum():
        return _wave(aim, np.flatnonzero(lengths))
    return chance_corners(aim, np.random.default_rng([seed, k]))


def _wave(aim: PlanarAim, lengths: np.ndarray) -> np.ndarray:
    """Return an inchworm, slightly bent: one long link runs from head to tail, the rest short."""
    low, high = aim.ranges.T
    middle = low + _BENT * (high - low)
    table = np.tile(middle, (len(lengths) + 2, 1))
    table[:, lengths] = low[lengths]
    table[1 + np.arange(len(lengths)), lengths] = high[lengths]
    at = np.linspace(0, len(table) - 1, aim.corners, endpoint=False)
    rows = np.arange(len(table))
    return np.stack([np.interp(at, rows, column) for column in table.T], axis=1)


def guess_from(aim: PlanarAim, corners: np.ndarray) -> Guess:
    """Return the motion along a polygon at the highest rates, or uniform if time is irrelevant."""
    steps = Steps(aim.shape, aim.ground, parts=1, points=4)
    ends = np.roll(corners, -1, axis=0) if aim.closed else np.vstack([corners[1:], corners[-1:]])
    k = len(corners)
    way = ends - corners
    # poses at the corners and a few places between, by small straight steps
    parts = 8
    tau = (np.arange(k * parts) % parts / parts)[:, None]
    fine = np.repeat(corners, parts, axis=0) + tau * np.repeat(way, parts, axis=0)
    sides = steps.sides(np.vstack([fine, ends[-1:]]), closed=False)
    poses = [np.zeros(3)]
    for pose in sides.pose:
        poses.append(compose(poses[-1], pose))
    poses = np.array(poses)
    if aim.purpose == "speed":
        x, y, _ = poses[-1]
        ahead = -np.arctan2(y, x)
        drift = poses[-1, 2] * np.linspace(0, 1, len(poses))
        poses = np.column_stack([rotate(ahead, poses[:, :2]), poses[:, 2] + ahead - drift])
    t, breaks = np.linspace(0, 1, k * parts + 1), np.linspace(0, 1, k + 1)
    table = np.hstack([np.vstack([fine, ends[-1:]]), poses])
    inputs, twists = k * way, k * parts * sides.pose
    if aim.timed:
        pace = k * np.maximum(np.abs(way / aim.rates).max(axis=1), 1e-3 * aim.duration_usual)
        inputs = np.column_stack([inputs, pace])
        table = np.column_stack([table, np.interp(t, breaks, np.append(0, np.cumsum(pace) / k))])

    def side(at: np.ndarray, edges: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(edges) - 2)

    def states(at: np.ndarray) -> np.ndarray:
        return np.array([np.interp(at, t, column) for column in table.T])

    return Guess(
        1.0,
        states,
        lambda at: inputs[side(at, breaks)].T,
        algebraic=(lambda at: twists[side(at, t)].T) if isinstance(aim.ground, Dry) else None,
    )
