"""Refinement of a design: the corners of a stroke with almost set-valued friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import minimize

from wormopt.systems.planar.design.aim import Dry, PlanarAim
from wormopt.systems.planar.design.polygons import Sides, Steps
from wormopt.systems.planar.poses import rotate
from wormopt.systems.planar.shape import Shape

_KEPT = 1e-3
"""Accepted residual of a point."""
_PRICE = 30.0
"""Weight of a residual, in usual sizes of the objective."""
SEARCHED, STEEP = (1e-2, 1e-3, 1e-5), (1e-5, 1e-7)
"""Successive widths of the potential: where masses stop and start there is no slope."""


# Gain, in usual sizes, below which a search ends: a tenth of the width; or this if smooth.
_ENOUGH, _SMOOTH = 1e-7, 1e-9
# Parts of a side at whose ends the body must be in a passage.
_SPLIT = 4


@dataclass(frozen=True, eq=False)
class Polish:
    """Corners (k, n_s) and times (k,) of the sides of a stroke, as one vector for SciPy.

    Times are those of the sides at the fastest pace: |change| <= rate time.
    """

    aim: PlanarAim
    steps: Steps
    count: int
    split: int = 1  # parts of a side at whose ends the passage is checked

    @cached_property
    def sizes(self) -> np.ndarray:
        """Usual sizes of the shape variables."""
        return np.abs(self.aim.ranges).max(axis=1)

    @cached_property
    def splitting(self) -> np.ndarray:
        """Matrix (ends of parts, corners) from corners to ends of parts."""
        k, m = self.count, self.split
        sides = k if self.aim.closed else k - 1
        rows = np.zeros((sides * m, k))
        for i in range(sides * m):
            side, part = divmod(i, m)
            rows[i, side] += 1 - part / m
            rows[i, (side + 1) % k] += part / m
        return rows if self.aim.closed else np.vstack([rows, np.eye(k)[-1:]])

    @property
    def drifts(self) -> bool:
        """Whether the vector ends with the position of the passage's middle."""
        return self.aim.limits.half_width is not None and self.aim.purpose == "speed"

    def pack(self, corners: np.ndarray) -> np.ndarray:
        """Return the vector of corners, least times of the sides, and middle of the passage."""
        parts = [(corners / self.sizes).ravel()]
        if self.aim.timed:
            parts.append(side_times(self.aim, corners) / self.aim.duration_usual)
        if self.drifts:
            sides = self.steps.sides(self.splitting @ corners, self.aim.closed)
            across = Room(self.aim, self.splitting @ corners, sides).across
            parts.append(np.array([(across.min() + across.max()) / 2]))
        return np.concatenate(parts)

    def unpack(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return corners and times."""
        n = self.count * len(self.sizes)
        corners = w[:n].reshape(self.count, -1) * self.sizes
        times = w[n : n + self.count * self.aim.timed]
        return corners, times * self.aim.duration_usual

    def motion(self, w: np.ndarray) -> tuple[Sides, np.ndarray, np.ndarray]:
        """Return displacements, corners and times; the last result is cached."""
        memory = self._memory
        if memory.get("w") is None or not np.array_equal(memory["w"], w):
            corners, times = self.unpack(w)
            sides = self.steps.sides(self.splitting @ corners, self.aim.closed)
            memory["w"], memory["motion"] = w.copy(), (sides, corners, times)
        return memory["motion"]

    @cached_property
    def _memory(self) -> dict[str, Any]:
        return {}

    def _chain(self, by_ends: np.ndarray, by_times: float = 0.0) -> np.ndarray:
        """Return derivatives by the vector, from those by ends (..., ends, n_s) and by times."""
        by_corners = np.einsum("ek,...en->...kn", self.splitting, by_ends)
        lead = by_corners.shape[:-2]
        parts = [(by_corners * self.sizes).reshape(*lead, -1)]
        if self.aim.timed:
            parts.append(np.full((*lead, self.count), by_times * self.aim.duration_usual))
        if self.drifts:
            parts.append(np.zeros((*lead, 1)))
        return np.concatenate(parts, axis=-1)

    def objective(self, w: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the objective to minimise, over its usual size, and its gradient."""
        value, by = self._sought(w)
        return value / self.aim.usual, by / self.aim.usual

    def _sought(self, w: np.ndarray) -> tuple[float, np.ndarray]:
        sides, _, times = self.motion(w)
        closed, purpose = self.aim.closed, self.aim.purpose
        if purpose == "work":
            factor = self._work_factor
            by_work = sides.work_gradient(closed)
            return factor * float(sides.work.sum()), self._chain(factor * by_work)
        total, by = sides.total, sides.gradient(closed)
        T = times.sum()
        if purpose == "turn":
            gain, gain_by = total[2], by[2]
        else:
            gain = max(float(np.hypot(*total[:2])), 1e-300)
            gain_by = np.einsum("i,ikn->kn", total[:2] / gain, by[:2])
        return float(-gain / T), self._chain(-gain_by / T, gain / T**2)

    @property
    def _work_factor(self) -> float:
        """Ratio of work to that of parts of unit duration."""
        if isinstance(self.aim.ground, Dry):
            return 1.0
        ends = len(self.splitting)
        return (ends if self.aim.closed else ends - 1) / self.aim.time

    def equal(self, w: np.ndarray) -> np.ndarray:
        """Return the equality residuals, over their usual sizes."""
        sides, corners, _ = self.motion(w)
        return self.conditions(sides.total, corners)[0] / self.units

    def equal_by(self, w: np.ndarray) -> np.ndarray:
        """Return the derivatives of the equality residuals."""
        sides, corners, _ = self.motion(w)
        _, by_total, by_first = self.conditions(sides.total, corners)
        by = np.einsum("ri,ikn->rkn", by_total, sides.gradient(self.aim.closed))
        by[:, 0] += by_first
        return self._chain(by) / self.units[:, None]

    @property
    def units(self) -> np.ndarray:
        """Usual sizes of the equality residuals."""
        if self.aim.purpose == "turn":
            return np.full(0 if self.aim.pivot == "any" else 2, self.aim.length)
        return np.array([self.aim.length] * 2 + [1.0])[self._required]

    @property
    def _required(self) -> slice:
        """Components x, y, angle of the displacement that a cycle must have."""
        work = self.aim.purpose == "work"
        if self.aim.single:  # nothing changes y and angle, and SLSQP stops at rows without slopes
            return slice(0, int(work))
        return slice(0 if work else 2, 3)

    def conditions(
        self, total: np.ndarray, corners: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return equality conditions, their derivatives by the pose, and by the first corner."""
        n_s = len(self.sizes)
        aim = self.aim
        if aim.purpose == "turn":
            if aim.pivot == "any":
                return np.zeros(0), np.zeros((0, 3)), np.zeros((0, n_s))
            place, by_s = self._place(corners[0])
            c, s = np.cos(total[2]), np.sin(total[2])
            turn = np.array([[c, -s], [s, c]])
            rest = total[:2] + turn @ place - place
            around = np.array([[-s, -c], [c, -s]]) @ place
            return rest, np.column_stack([np.eye(2), around]), (turn - np.eye(2)) @ by_s
        rest = (total - (aim.step if aim.purpose == "work" else 0.0))[self._required]
        return rest, np.eye(3)[self._required], np.zeros((len(rest), n_s))

    def _place(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = np.asarray(self.aim.shape.kinematics(s)[0])
        slope = np.empty((2, len(s)))
        mean = (
            (lambda p: p.mean(axis=1))
            if self.aim.pivot == "centre"
            else (lambda p: p[:, int(self.aim.pivot)])
        )
        h = 1e-6
        for i in range(len(s)):
            d = np.zeros(len(s))
            d[i] = h
            ahead, back = (np.asarray(self.aim.shape.kinematics(s + e)[0]) for e in (d, -d))
            slope[:, i] = (mean(ahead) - mean(back)) / (2 * h)
        return mean(points), slope

    def within(self, w: np.ndarray) -> np.ndarray:
        """Return margins, at least 0: times less those the rates need, effort left, room left."""
        rows = [self._linear @ w]
        limits = self.aim.limits
        if self.aim.timed:
            times = self.unpack(w)[1]
            rows.append(np.array([(times.sum() - self.aim.shortest) / self.aim.duration_usual]))
        if limits.effort is not None:
            rows.append(
                np.array([1 - self._work_factor * self.motion(w)[0].work.sum() / limits.effort])
            )
        if limits.half_width is not None:
            room = limits.half_width - limits.radius
            across = self._room(w).across - (w[-1] if self.drifts else 0.0)
            rows += [(room - across) / room, (room + across) / room]
        return np.concatenate(rows)

    def within_by(self, w: np.ndarray) -> np.ndarray:
        """Return the derivatives of the margins."""
        rows, limits = [self._linear], self.aim.limits
        if self.aim.timed:
            by = np.zeros((1, len(w)))
            n = self.count * len(self.sizes)
            by[:, n : n + self.count] = 1.0
            rows.append(by)
        if limits.effort is not None:
            by = self._chain(self.motion(w)[0].work_gradient(self.aim.closed))
            rows.append(-self._work_factor * by[None] / limits.effort)
        if limits.half_width is not None:
            room = limits.half_width - limits.radius
            by = self._chain(self._room(w).across_by)
            if self.drifts:
                by[:, -1] = -1.0
            rows += [-by / room, by / room]
        return np.vstack(rows)

    def _room(self, w: np.ndarray) -> Room:
        sides, corners, _ = self.motion(w)
        return Room(self.aim, self.splitting @ corners, sides)

    @cached_property
    def _linear(self) -> np.ndarray:
        k, n_s = self.count, len(self.sizes)
        if not self.aim.timed:
            return np.zeros((0, k * n_s))
        out = np.zeros((2 * k * n_s, k * n_s + k + self.drifts))
        row = 0
        for i in range(k):
            for j in range(n_s):
                scale = self.sizes[j] / (self.aim.rates[j] * self.aim.duration_usual)
                for sign in (1, -1):
                    out[row, ((i + 1) % k) * n_s + j] = -sign * scale
                    out[row, i * n_s + j] = sign * scale
                    out[row, k * n_s + i] = 1
                    row += 1
        return out

    def bounds(self) -> list[tuple[float, float]]:
        """Return the limits of the vector."""
        low, high = (self.aim.ranges / self.sizes[:, None]).T
        pairs = [(a, b) for _ in range(self.count) for a, b in zip(low, high, strict=True)]
        if self.aim.start is not None:
            pairs[: len(self.sizes)] = [(v, v) for v in np.array(self.aim.start) / self.sizes]
        if self.aim.timed:
            pairs += [(0.0, np.inf)] * self.count
        if self.drifts:
            pairs.append((-np.inf, np.inf))
        return pairs


def side_times(aim: PlanarAim, corners: np.ndarray) -> np.ndarray:
    """Return the times (k,) of the sides at the highest rates allowed."""
    ends = np.roll(corners, -1, axis=0) if aim.closed else np.vstack([corners[1:], corners[-1:]])
    return np.abs((ends - corners) / aim.rates).max(axis=1)


@dataclass(frozen=True, eq=False)
class Polished:
    """Result of SciPy's sequential quadratic programs."""

    corners: np.ndarray
    value: float  # speed, turn rate, or work
    miss: float  # largest residual


def polish(
    aim: PlanarAim,
    corners: np.ndarray,
    *,
    parts: int,
    iterations: int = 60,
    widths: Sequence[float] = SEARCHED,
) -> Polished:
    """Return the best corners nearby, by increasingly steep friction; `parts`: see `Steps`."""
    split = _SPLIT if aim.limits.half_width is not None else 1
    steps = Steps(aim.shape, aim.ground, parts=-(-parts // split), points=6)
    best = Polished(corners, 0.0, np.inf)
    if not isinstance(aim.ground, Dry):  # all smooth
        return _climbed(Polish(aim, steps, len(corners), split), corners, iterations, _SMOOTH)
    for width in widths:
        task = Polish(aim, replace(steps, width=width), len(corners), split)
        best = _climbed(task, best.corners, iterations, 0.1 * max(width, _ENOUGH))
    return best


def _climbed(task: Polish, corners: np.ndarray, iterations: int, gain: float) -> Polished:
    """Return the result of sequential quadratic programs, or their best intermediate point."""
    aim = task.aim
    constraints = [{"type": "ineq", "fun": task.within, "jac": task.within_by}]
    first = task.pack(corners)
    if task.equal(first).size:
        constraints.append({"type": "eq", "fun": task.equal, "jac": task.equal_by})
    best: list[Polished] = []

    def seen(w: np.ndarray) -> None:
        """Keep the best of the points that satisfy the conditions: later steps may violate them."""
        one = _polished(task, w)
        if not best or _merit(aim, one) < _merit(aim, best[0]):
            best[:] = [one]

    seen(first)
    found = minimize(
        task.objective,
        first,
        jac=True,
        method="SLSQP",
        bounds=task.bounds(),
        constraints=constraints,
        options={"maxiter": iterations, "ftol": gain},
        callback=seen,
    )
    seen(found.x)
    return best[0]


def _polished(task: Polish, w: np.ndarray) -> Polished:
    """Return the value of a point with its sides at the highest rates allowed."""
    aim = task.aim
    corners = np.clip(task.unpack(w)[0], *aim.ranges.T)
    w = task.pack(corners)
    miss = float(np.abs(task.equal(w)).max(initial=0.0))
    over = -min(0.0, float(task.within(w).min(initial=0.0)))
    return Polished(corners, abs(task.objective(w)[0]) * aim.usual, max(miss, over))


def _merit(aim: PlanarAim, one: Polished) -> tuple[bool, float]:
    """Return a sort key: points that nearly satisfy their conditions first, then by residual."""
    if one.miss > _KEPT:
        return True, one.miss
    gain = -one.value if aim.purpose == "work" else one.value
    return False, _PRICE * aim.usual * one.miss - gain


# -- room of a body across its displacement --------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Room:
    """Distances of a body across its displacement at the ends of parts of the sides."""

    aim: PlanarAim
    ends: np.ndarray  # (e, n_s)
    sides: Sides

    @property
    def across(self) -> np.ndarray:
        """Distances across the displacement, of all masses at all ends."""
        along = self._along[0]
        return (along[0] * self._places[..., 1] - along[1] * self._places[..., 0]).ravel()

    @property
    def across_by(self) -> np.ndarray:
        """Derivatives of these distances, (distances, ends, n_s)."""
        along, along_by = self._along
        places, by = self._places, self._places_by
        aside = along[0] * by[:, :, 1] - along[1] * by[:, :, 0]
        aside += np.einsum("em,kn->emkn", places[..., 1], along_by[0])
        aside -= np.einsum("em,kn->emkn", places[..., 0], along_by[1])
        return aside.reshape(-1, *aside.shape[2:])

    @cached_property
    def _along(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction of the displacement or of the first heading, and its derivatives."""
        by = self.sides.gradient(self.aim.closed)[:2]
        if self.aim.purpose != "speed":
            return np.array([1.0, 0.0]), 0 * by
        way = self.sides.total[:2]
        size = max(float(np.hypot(*way)), 1e-300)
        along = way / size
        return along, np.einsum("ij,jkn->ikn", np.eye(2) - np.outer(along, along), by) / size

    @cached_property
    def _own(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (e, masses, 2) in the body's frame, and derivatives (e, masses, 2, n_s)."""
        shape, (e, n_s) = self.aim.shape, self.ends.shape
        places, slopes = _points(shape).map(e)(self.ends.T)
        m = shape.n_points
        own = np.asarray(places).reshape(2, e, m).transpose(1, 2, 0)
        by = np.asarray(slopes).reshape(m, 2, e, n_s).transpose(2, 0, 1, 3)
        return own, by

    @cached_property
    def _poses(self) -> np.ndarray:
        return np.array(list(self.sides.running))[: len(self.ends)]

    @cached_property
    def _places(self) -> np.ndarray:
        poses = self._poses
        return poses[:, None, :2] + rotate(poses[:, None, 2], self._own[0])

    @cached_property
    def _places_by(self) -> np.ndarray:
        """Derivatives (e, masses, 2, ends, n_s)."""
        poses, (own, slopes) = self._poses, self._own
        by = np.array(list(self.sides.gradients(self.aim.closed)))[: len(self.ends)]
        turned = rotate(poses[:, None, 2], own)
        sideways = np.stack([-turned[..., 1], turned[..., 0]], axis=-1)
        found = by[:, None, :2] + sideways[..., None, None] * by[:, None, 2:3]
        turn = rotate(poses[:, None, 2, None], np.moveaxis(slopes, 2, -1))
        for i in range(len(self.ends)):
            found[i, :, :, i] += np.moveaxis(turn[i], -1, 1)
        return found


@cache
def _points(shape: Shape) -> ca.Function:
    slopes = ca.jacobian(ca.vec(shape.points), shape.s)
    return ca.Function("points", [shape.s], [ca.densify(shape.points), ca.densify(slopes)])
