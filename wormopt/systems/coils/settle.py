"""How a profile settles under a load that grows from 0, and where it can no longer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wormopt.analysis.continuation import Fold, Walk
from wormopt.errors import ArgumentError
from wormopt.progress import Report, silent
from wormopt.systems.coils.profile import Collocation, Profile

_LADDER = (64, 96, 128, 192, 256, 384, 512)
_FINE = 801  # places between which extremes are looked for
_MOST_POINTS = 400
# Two degrees shall agree to this about the load at which a branch stops.
_AGREE = 1e-3
_HALVINGS = 24

Why = Literal["fold", "unstable", "floor", "ceiling", "lost"]


@dataclass(frozen=True, eq=False)
class Stop:
    """Why a profile does not settle at the full load.

    `why`: "fold", beyond it no profile is near; "unstable", it gives way sideways; "floor",
    "ceiling", it leaves its range; "lost", the steps became too short.
    """

    why: Why
    load: float  # share of the load at which it happens
    x: float  # where farthest from flat then, or leaving its range
    uncertainty: float  # change of `load` with the degree; NaN: single degree


@dataclass(frozen=True, eq=False)
class Settled:
    """A profile that rests, or the last one that did."""

    equations: Collocation  # whose unknowns `y` are
    y: np.ndarray  # (n + 2,) unknowns
    load: float  # share of the full load
    path: np.ndarray  # (m, 3) load, least and largest h along the branch
    stop: Stop | None  # why it went no further; None: at the full load
    resolved: bool  # last coefficients are as small as asked for


def settle(
    profile: Profile,
    *,
    tolerance: float = 1e-8,
    degree: int = 256,
    floor: float = -np.inf,
    ceiling: float = np.inf,
    report: Report = silent,
) -> Settled:
    """Follow a profile from no load to the full one (1), with as many points as it needs.

    By arc length with the fewest points, then by Newton's method with more until the last
    coefficients over mean h are below `tolerance`. ArgumentError: `degree` not in 64 to 512.
    """
    if not _LADDER[0] <= degree <= _LADDER[-1]:
        raise ArgumentError(f"a degree of {degree} is not within [{_LADDER[0]}, {_LADDER[-1]}]")
    found: Settled | None = None
    for n in (*(rung for rung in _LADDER if rung < degree), degree):
        equations = Collocation(profile, n)
        before, found = found, None
        if before is not None and before.stop is None:
            report(f"refining to degree {n}", None)
            found = _refined(equations, before, tolerance)
        if found is None:
            found = _Branch(equations, (floor, ceiling), report).follow(before, tolerance)
        agrees = found.stop is not None and found.stop.uncertainty < _AGREE * found.stop.load
        if agrees or (found.stop is None and found.resolved):
            return found
    assert found is not None
    return found


def _refined(equations: Collocation, before: Settled, tolerance: float) -> Settled | None:
    start = np.append(before.equations.at(before.y, equations.x), before.y[-1])
    y, converged = equations.newton(start, 1.0)
    if not converged:
        return None
    return Settled(equations, y, 1.0, before.path, None, equations.tail(y) < tolerance)


class _Branch:
    """The branch of one collocation, from no load on."""

    def __init__(self, equations: Collocation, within: tuple[float, float], report: Report) -> None:
        self.equations, self.within, self.report = equations, within, report
        left, right = equations.profile.ends
        self.x = np.linspace(left, right, _FINE)
        self.walk = Walk(equations, "load", (0.0, 1.0), np.zeros(1), 1e3)
        self.points: list[np.ndarray] = []
        self.why: Why | None = None

    def follow(self, before: Settled | None, tolerance: float) -> Settled:
        """Walk until the full load, or a stop."""
        start = np.append(self.equations.flat(), 0.0)
        tangent = self.walk.tangent(start, None)
        self.points = [start]
        self.sign = self._sign(start)
        towards = tangent * np.sign(tangent[-1])
        points, folds, end = self.walk.go(start, towards, _MOST_POINTS, self._stops)
        y = points[-1]
        if end == "range":  # the last step up to the range is not told
            self._stops(y, folds)
        elif self.why is None:
            self.why = "lost"
        stop = None
        if self.why is not None:
            y = self._located(folds) if self.why != "lost" else y
            stop = self._stop(y, before)
        path = np.array([(p[-1], *self._extremes(p)) for p in points])
        resolved = self.equations.tail(y[:-1]) < tolerance
        return Settled(self.equations, y[:-1], float(y[-1]), path, stop, resolved)

    def _stops(self, y: np.ndarray, folds: list[Fold]) -> bool:
        """Whether the walk ends at this point, and why."""
        self.report("raising the current", min(max(float(y[-1]), 0.0), 1.0))
        low, high = self._extremes(y)
        if low < self.within[0]:
            self.why = "floor"
        elif high > self.within[1]:
            self.why = "ceiling"
        elif folds:
            self.why = "fold"
        elif self._sign(y) != self.sign:
            self.why = "unstable"
        self.points.append(y)
        return self.why is not None

    def _located(self, folds: list[Fold]) -> np.ndarray:
        """Where it stops, between the last two points."""
        if self.why == "fold":
            return np.append(folds[0].x, folds[0].parameter)
        tests: dict[Why | None, Callable[[np.ndarray], bool]] = {
            "floor": lambda y: self._extremes(y)[0] < self.within[0],
            "ceiling": lambda y: self._extremes(y)[1] > self.within[1],
            "unstable": lambda y: self._sign(y) != self.sign,
        }
        test, (before, after) = tests[self.why], self.points[-2:]
        tangent = self.walk.tangent(before, (after - before) / self.walk.size)
        low, high = 0.0, float(tangent @ ((after - before) / self.walk.size))
        found = after
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            y = self.walk.step(before, tangent, middle)
            if y is None or test(y):
                high, found = middle, found if y is None else y
            else:
                low = middle
        return found

    def _stop(self, y: np.ndarray, before: Settled | None) -> Stop:
        h = self.equations.at(y[:-1], self.x)
        mean = self.equations.profile.mean
        where = np.argmin(h) if self.why == "floor" else np.argmax(np.abs(h - mean))
        change = np.nan
        if before is not None and before.stop is not None and before.stop.why == self.why:
            change = abs(before.stop.load - float(y[-1]))
        assert self.why is not None
        return Stop(self.why, float(y[-1]), float(self.x[where]), change)

    def _extremes(self, y: np.ndarray) -> tuple[float, float]:
        h = self.equations.at(y[:-1], self.x)
        return float(h.min()), float(h.max())

    def _sign(self, y: np.ndarray) -> float:
        """Sign of the determinant: it changes where a single eigenvalue does."""
        matrix = self.equations.slopes(y[None, :-1], y[-1:])[0]
        return float(np.linalg.slogdet(matrix)[0])
