"""Weighted residuals between single measured numbers and the scene that computes them.

The scene is computed for every measurement; derivatives are differences of parallel runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.families.points import Point
from wormopt.numerics.workers import each
from wormopt.progress import Report, silent
from wormopt.study.scene import Scene, load_scene
from wormopt.systems.recorded.tables import KeyUnknown, Measured, value_at

# Residual, in standard deviations, of a measurement whose scene cannot be computed.
_LOST = 1e6


@dataclass(frozen=True)
class Looked:
    """Scalars of the scene for one choice of parameters."""

    values: np.ndarray  # (m,) computed, NaN if that failed
    reasons: tuple[str, ...]  # why runs failed; empty if none did


@dataclass(eq=False)
class NumbersTask:
    """A fit to measured numbers; coordinates are parameters or their logarithms."""

    scene: Scene[Any]
    measured: Sequence[Measured]
    unknowns: Sequence[KeyUnknown]
    report: Report = silent
    runs: int = 0
    known: dict[bytes, Looked] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(unknown.name for unknown in self.unknowns)

    @property
    def start(self) -> np.ndarray:
        """Initial coordinates, (n,)."""
        return np.array([self._coordinate(u, _begun(self.scene, u)) for u in self.unknowns])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of coordinates, (n,) each."""
        ends = [
            [self._coordinate(u, one) if one is not None else side * math.inf for side, one in pair]
            for u in self.unknowns
            for pair in [((-1, u.lower), (1, u.upper))]
        ]
        lower, upper = np.array(ends, dtype=float).T
        return lower, upper

    @property
    def nominal(self) -> np.ndarray:
        """Nominal sizes of coordinates, (n,)."""
        return np.array(
            [1.0 if u.log else abs(_begun(self.scene, u)) or 1.0 for u in self.unknowns]
        )

    def values(self, theta: np.ndarray) -> np.ndarray:
        """Parameters (n,) of coordinates (n,)."""
        return np.where(self._logs, np.exp(np.where(self._logs, theta, 0.0)), theta)

    def slopes(self, theta: np.ndarray) -> np.ndarray:
        """Derivatives of parameters by coordinates, (n,)."""
        return np.where(self._logs, self.values(theta), 1.0)

    @property
    def _logs(self) -> np.ndarray:
        return np.array([u.log for u in self.unknowns])

    def _coordinate(self, unknown: KeyUnknown, value: Any) -> float:
        return math.log(value) if unknown.log else float(value)

    # -- residuals -----------------------------------------------------------------------------

    @property
    def fitted(self) -> np.ndarray:
        """Whether each measurement is fitted, not held out, (m,)."""
        return np.array([one.use == "fit" for one in self.measured])

    def misfit(self, theta: np.ndarray) -> np.ndarray:
        """Weighted residuals of the fitted measurements, then of the priors."""
        return self._weighed(self.look([theta])[0], theta)

    @property
    def steps(self) -> np.ndarray:
        """Changes (n, n) of coordinates for differences, one in each row."""
        return np.diag([u.step for u in self.unknowns] * self.nominal)

    def inside(self, theta: np.ndarray) -> np.ndarray:
        """Coordinates within their bounds."""
        return np.clip(theta, *self.bounds)

    def neighbours(self, theta: np.ndarray, share: float) -> list[np.ndarray]:
        """Coordinates `share` steps away, (2 n): all forward, then all backward."""
        moved = [theta + side * share * step for side in (1, -1) for step in self.steps]
        return [self.inside(one) for one in moved]

    def wide_residuals(self, theta: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals and their Jacobian, by differences over both neighbours."""
        around = self.neighbours(theta, share)
        self.look([theta, *around])
        n = len(theta)
        columns = [
            (self.misfit(ahead) - self.misfit(back)) / (ahead - back)[k]
            for k, (ahead, back) in enumerate(zip(around[:n], around[n:], strict=True))
        ]
        return self.misfit(theta), np.stack(columns, axis=1)

    def residuals(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals and their Jacobian by differences; SolveError if runs fail there."""
        steps = self.steps
        _, upper = self.bounds
        steps[theta + steps.sum(axis=0) > upper] *= -1
        looks = self.look([theta, *(theta + step for step in steps)])
        r = self._weighed(looks[0], theta)
        columns = []
        for look, step in zip(looks[1:], steps, strict=True):
            if not np.isfinite(look.values[self.fitted]).all():
                look, step = self.look([theta - step])[0], -step
            if not np.isfinite(look.values[self.fitted]).all():
                raise SolveError(
                    f"the scene cannot be computed near the current parameters: {look.reasons[0]}",
                    "write narrower bounds, or another start",
                )
            columns.append((self._weighed(look, theta + step) - r) / step.sum())
        return r, np.stack(columns, axis=1)

    def _weighed(self, look: Looked, theta: np.ndarray) -> np.ndarray:
        rows = [
            (value - one.value) / one.deviation
            for value, one in zip(look.values, self.measured, strict=True)
            if one.use == "fit"
        ]
        priors = [
            (t - u.prior[0]) / u.prior[1]
            for t, u in zip(theta, self.unknowns, strict=True)
            if u.prior
        ]
        found = np.array([*rows, *priors])
        return np.where(np.isfinite(found), found, _LOST)

    # -- runs ----------------------------------------------------------------------------------

    def look(self, thetas: Sequence[np.ndarray]) -> list[Looked]:
        """Compute the scene for all measurements, in parallel for several choices of parameters."""
        new = {t.tobytes(): t for t in map(np.ascontiguousarray, thetas)}
        new = {key: t for key, t in new.items() if key not in self.known}
        jobs = {
            (key, repr(one.changes)): (self.scene, self._overrides(theta) | one.changes)
            for key, theta in new.items()
            for one in self.measured
        }
        places = list(jobs)
        done = each(_compute, list(jobs.values()), self.report, "runs")
        found = {places[k]: point for k, point in done}
        self.runs += len(jobs)
        for key in new:
            values = [_number(found[key, repr(one.changes)], one.scalar) for one in self.measured]
            failed = [p for at, p in found.items() if at[0] == key and p.status == "failed"]
            self.known[key] = Looked(np.array(values), tuple(point.reason for point in failed))
        return [self.known[np.ascontiguousarray(theta).tobytes()] for theta in thetas]

    def _overrides(self, theta: np.ndarray) -> dict[str, float]:
        numbers = zip(self.unknowns, self.values(theta).tolist(), strict=True)
        return {key: value for unknown, value in numbers for key in unknown.keys}


def _begun(scene: Scene[Any], unknown: KeyUnknown) -> float:
    start = unknown.start
    return float(value_at(scene, unknown.keys[0]) if start is None else np.ravel(start)[0])


def _compute(job: tuple[Scene[Any], dict[str, Any]]) -> Point:
    scene, changes = job
    try:
        return Point.of("", load_scene(scene, changes).table.result(silent))
    except (SolveError, SceneError, ArgumentError) as error:
        return Point("failed", str(error))


def _number(point: Point, name: str) -> float:
    value = point.scalars[name].value if name in point.scalars else None
    return float(value) if isinstance(value, int | float) else math.nan
