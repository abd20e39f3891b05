"""The last steps of a design: the corners of a stroke on the set-valued motion itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.ground import Dry
from wormopt.systems.planar.design.polygons import Sides, Steps


_KEPT = 1e-5
"""What a point may miss and still count."""


@dataclass(frozen=True, eq=False)
class Polish:
    """Corners (k, n_s) and times (k,) of the sides of a stroke, as one vector for SciPy.

    Times are those of the sides at the fastest pace: |change| <= rate time.
    """

    aim: PlanarAim
    steps: Steps
    count: int

    @cached_property
    def sizes(self) -> np.ndarray:
        """Usual sizes of the shape variables."""
        return np.abs(self.aim.ranges).max(axis=1)

    def pack(self, corners: np.ndarray) -> np.ndarray:
        """Vector of corners and the least times of the sides."""
        parts = [(corners / self.sizes).ravel()]
        if self.aim.timed:
            parts.append(side_times(self.aim, corners) / self.aim.duration_usual)
        return np.concatenate(parts)

    def unpack(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners and times."""
        n = self.count * len(self.sizes)
        corners = w[:n].reshape(self.count, -1) * self.sizes
        return corners, w[n:] * self.aim.duration_usual

    def told(self, w: np.ndarray) -> tuple[Sides, np.ndarray, np.ndarray]:
        """Displacements, corners and times; remembers the last."""
        memory = self._memory
        if memory.get("w") is None or not np.array_equal(memory["w"], w):
            corners, times = self.unpack(w)
            memory["w"] = w.copy()
            memory["told"] = (self.steps.sides(corners, self.aim.closed), corners, times)
        return memory["told"]

    @cached_property
    def _memory(self) -> dict:
        return {}

    def _chain(self, by_corners: np.ndarray, by_times: float = 0.0) -> np.ndarray:
        """Derivatives by the vector from those by corners and by each time."""
        parts = [(by_corners * self.sizes).reshape(*by_corners.shape[:-2], -1)]
        if self.aim.timed:
            shape = (*by_corners.shape[:-2], self.count)
            parts.append(np.full(shape, by_times * self.aim.duration_usual))
        return np.concatenate(parts, axis=-1)

    def objective(self, w: np.ndarray) -> tuple[float, np.ndarray]:
        """What is made least, and its gradient."""
        sides, _, times = self.told(w)
        total, by = sides.total, sides.gradient(self.aim.closed)
        purpose = self.aim.purpose
        if purpose == "work":
            factor = self._work_factor
            by_work = work_gradient(sides, self.aim.closed)
            return factor * float(sides.work.sum()), self._chain(factor * by_work)
        T = times.sum()
        gain = total[2] if purpose == "turn" else np.hypot(*total[:2])
        gain_by = by[2] if purpose == "turn" else np.einsum("i,ikn->kn", total[:2] / gain, by[:2])
        return float(-gain / T), self._chain(-gain_by / T, gain / T**2)

    @property
    def _work_factor(self) -> float:
        """Work by that of sides that each take the time 1."""
        dry = isinstance(self.aim.ground, Dry)
        return 1.0 if dry else (self.count if self.aim.closed else self.count - 1) / self.aim.time

    def equal(self, w: np.ndarray) -> np.ndarray:
        """What vanishes."""
        total = self.told(w)[0].total
        return self.conditions(total, self.told(w)[1])[0]

    def equal_by(self, w: np.ndarray) -> np.ndarray:
        """Its derivatives."""
        sides, corners, _ = self.told(w)
        _, by_total, by_first = self.conditions(sides.total, corners)
        by = np.einsum("ri,ikn->rkn", by_total, sides.gradient(self.aim.closed))
        by[:, 0] += by_first
        rows = [self._chain(by)]
        return np.vstack(rows)

    def conditions(
        self, total: np.ndarray, corners: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Conditions, their derivatives by the pose, and by the first corner."""
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
        if aim.purpose == "work":
            return total - aim.step, np.eye(3), np.zeros((3, n_s))
        return total[2:], np.eye(3)[2:], np.zeros((1, n_s))

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
        """Stays above 0: times less those that the rates need, and what effort is left."""
        rows = self._linear @ w
        effort = self.aim.limits.effort
        if effort is None:
            return rows
        return np.append(rows, 1 - self.told(w)[0].work.sum() / effort)

    def within_by(self, w: np.ndarray) -> np.ndarray:
        """Its derivatives."""
        effort = self.aim.limits.effort
        if effort is None:
            return self._linear
        by = self._chain(work_gradient(self.told(w)[0], self.aim.closed))
        return np.vstack([self._linear, -by / effort])

    @cached_property
    def _linear(self) -> np.ndarray:
        k, n_s = self.count, len(self.sizes)
        if not self.aim.timed:
            return np.zeros((0, k * n_s))
        out = np.zeros((2 * k * n_s, k * n_s + k))
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
        """Limits of the vector."""
        low, high = (self.aim.ranges / self.sizes[:, None]).T
        pairs = [(a, b) for _ in range(self.count) for a, b in zip(low, high, strict=True)]
        if self.aim.start is not None:
            pairs[: len(self.sizes)] = [
                (v, v) for v in np.array(self.aim.start) / self.sizes
            ]
        if self.aim.timed:
            pairs += [(0.0, np.inf)] * self.count
        return pairs


def side_times(aim: PlanarAim, corners: np.ndarray) -> np.ndarray:
    """Times (k,) of the sides at the fastest pace."""
    ends = np.roll(corners, -1, axis=0) if aim.closed else np.vstack([corners[1:], corners[-1:]])
    return np.abs((ends - corners) / aim.rates).max(axis=1)


def work_gradient(sides: Sides, closed: bool) -> np.ndarray:
    """Derivatives (corners, n_s) of the work."""
    k, twice = sides.work_by.shape
    n_s = twice // 2
    out = np.zeros((k if closed else k + 1, n_s))
    for i in range(k):
        out[i] += sides.work_by[i, :n_s]
        out[(i + 1) % len(out)] += sides.work_by[i, n_s:]
    return out


@dataclass(frozen=True, eq=False)
class Polished:
    """Where SciPy's sequential quadratic programs ended."""

    corners: np.ndarray
    value: float  # speed, rate of turning, or work
    miss: float  # largest of what should vanish


def polish(aim: PlanarAim, corners: np.ndarray, *, iterations: int, parts: int) -> Polished:
    """Best corners near by; `parts`: of a side, see `Steps`."""
    task = Polish(aim, Steps(aim.shape, aim.ground, parts=parts, points=6), len(corners))
    constraints = [{"type": "ineq", "fun": task.within, "jac": task.within_by}]
    if task.equal(task.pack(corners)).size:
        constraints.append({"type": "eq", "fun": task.equal, "jac": task.equal_by})
    best: list[Polished] = []

    def seen(w: np.ndarray) -> None:
        """Keep the best of the points that lead where they should: steps may lead away again."""
        one = _polished(task, w)
        if not best or _merit(aim, one) < _merit(aim, best[0]):
            best[:] = [one]

    first = task.pack(corners)
    seen(first)
    found = minimize(
        task.objective,
        first,
        jac=True,
        method="SLSQP",
        bounds=task.bounds(),
        constraints=constraints,
        options={"maxiter": iterations, "ftol": 1e-9},
        callback=seen,
    )
    seen(found.x)
    return best[0]


def _polished(task: Polish, w: np.ndarray) -> Polished:
    """What a point is worth with its sides at the fastest pace."""
    aim = task.aim
    corners = np.clip(task.unpack(w)[0], *aim.ranges.T)
    w = task.pack(corners)
    miss = float(np.abs(task.equal(w)).max(initial=0.0))
    over = -min(0.0, float(task.within(w).min(initial=0.0)))
    return Polished(corners, abs(task.objective(w)[0]), max(miss, over))


def _merit(aim: PlanarAim, one: Polished) -> tuple[bool, float]:
    """Order: what keeps to its conditions first, then by value; else by what is missed."""
    if one.miss > _KEPT:
        return True, one.miss
    return False, one.value if aim.purpose == "work" else -one.value
