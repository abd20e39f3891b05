"""Amplitudes of the steps of a route for which it ends in its goal, at the least cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares, minimize

from wormopt.numerics.chebyshev import Series, resolve
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.path.steps import Family, GaitStep, chained
from wormopt.systems.planar.path.task import Cost, PathTask, cost_of

_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Fitted:
    """A family with displacement and cost as series in the amplitude."""

    family: Family
    cost: Cost

    @property
    def ends(self) -> tuple[float, float]:
        """Least and largest amplitude."""
        return self.family.amplitudes[0], self.family.amplitudes[-1]

    @cached_property
    def series(self) -> Series | None:
        """x, y, angle and cost; None where there is but one amplitude."""
        low, high = self.ends
        return None if high <= low else resolve(self._values, low, high, self.family.degree)

    @cached_property
    def slopes(self) -> Series | None:
        """Their derivatives."""
        return None if self.series is None else self.series.derivative()

    def _values(self, amplitudes: np.ndarray) -> np.ndarray:
        steps = [self.family.make(float(a)) for a in amplitudes]
        return np.array([[*step.displacement, cost_of(step, self.cost)] for step in steps]).T

    @cached_property
    def _only(self) -> np.ndarray:
        return self._values(np.array(self.family.amplitudes[:1]))[:, 0]

    def at(self, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
        """x, y, angle and cost, and their derivatives by the amplitude."""
        if self.series is None or self.slopes is None:
            return self._only, np.zeros(4)
        a = np.array([amplitude])
        return self.series(a)[:, 0], self.slopes(a)[:, 0]


def polished(
    task: PathTask,
    route: Sequence[Fitted],
    amplitudes: np.ndarray,
    *,
    by_cost: bool,
    accuracy: float,
) -> list[GaitStep] | None:
    """Return steps of a route that end in the goal to `accuracy`; None if no amplitudes do.

    `amplitudes` (m,) are the start. The result is a local minimum of the cost, or the nearest
    amplitudes if `by_cost` is False. Series approximate the steps; the last digits come from the
    steps themselves.
    """
    bounds = np.array([fit.ends for fit in route])
    if np.sum(bounds[:, 1] > bounds[:, 0]) < 3:
        return (
            None
            if np.abs(task.off(_end(task, route, amplitudes)[0])).max() > accuracy
            else ([fit.family.make(float(a)) for fit, a in zip(route, amplitudes, strict=True)])
        )
    begin = _reaching(task, route, amplitudes, bounds)
    if begin is None:
        return None
    width = np.maximum(bounds[:, 1] - bounds[:, 0], 1e-12)
    scale = max(float(sum(fit.at(a)[0][3] for fit, a in zip(route, amplitudes, strict=True))), 1e-9)

    def aim(a: np.ndarray) -> tuple[float, np.ndarray]:
        off = (a - amplitudes) / width
        if not by_cost:
            return float(off @ off), 2 * off / width
        found = [fit.at(x) for fit, x in zip(route, a, strict=True)]
        # a small penalty of the distance separates amplitudes of equal cost
        value = sum(f[3] for f, _ in found) / scale + 1e-6 * float(off @ off)
        return float(value), np.array([d[3] for _, d in found]) / scale + 2e-6 * off / width

    found = minimize(
        aim, begin, jac=True, method="SLSQP", bounds=bounds,
        constraints={
            "type": "eq",
            "fun": lambda a: task.off(_end(task, route, a)[0]),
            "jac": lambda a: _end(task, route, a)[1],
        },
        options={"maxiter": 40, "ftol": 1e-10},
    )  # fmt: skip
    if np.abs(task.off(_end(task, route, found.x)[0])).max() > 1e-5:
        return None
    return _exactly(task, route, np.clip(found.x, *bounds.T), bounds, accuracy)


def _reaching(
    task: PathTask, route: Sequence[Fitted], amplitudes: np.ndarray, bounds: np.ndarray
) -> np.ndarray | None:
    """Return amplitudes with which the series end in the goal; None if none are found."""
    free = bounds[:, 1] > bounds[:, 0]
    a = amplitudes.copy()

    def filled(x: np.ndarray) -> np.ndarray:
        a[free] = x
        return a

    low, high = bounds[free].T
    found = least_squares(
        lambda x: task.off(_end(task, route, filled(x))[0]),
        np.clip(amplitudes[free], low + 1e-3 * (high - low), high - 1e-3 * (high - low)),
        jac=lambda x: _end(task, route, filled(x))[1][:, free],  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        max_nfev=20,
        gtol=1e-6,
    )
    return None if np.abs(found.fun).max() > 1e-2 else filled(found.x).copy()


def _exactly(
    task: PathTask, route: Sequence[Fitted], a: np.ndarray, bounds: np.ndarray, accuracy: float
) -> list[GaitStep] | None:
    """Correct amplitudes by the least change, with the steps themselves."""
    for _ in range(_ROUNDS):
        steps = [fit.family.make(float(x)) for fit, x in zip(route, a, strict=True)]
        off = task.off(chained(task.start, steps)[-1])
        if np.abs(off).max() <= accuracy:
            return steps
        J = _end(task, route, a)[1]
        room = (a > bounds[:, 0]) & (a < bounds[:, 1])
        change = np.zeros_like(a)
        change[room] = -np.linalg.pinv(J[:, room]) @ off
        a = np.clip(a + change, *bounds.T)
    return None


def _end(task: PathTask, route: Sequence[Fitted], a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the end pose (3,) by the series, and its derivatives by the amplitudes (3, m)."""
    found = [fit.at(x) for fit, x in zip(route, a, strict=True)]
    poses = [task.start]
    for value, _ in found:
        x, y, angle = poses[-1]
        poses.append(np.array([*(np.array([x, y]) + rotate(angle, value[:2])), angle + value[2]]))
    end = poses[-1]
    J = np.zeros((3, len(found)))
    for k, (_, slope) in enumerate(found):
        lever = end[:2] - poses[k + 1][:2]
        J[:2, k] = rotate(poses[k][2], slope[:2]) + slope[2] * np.array([-lever[1], lever[0]])
        J[2, k] = slope[2]
    return end, J
