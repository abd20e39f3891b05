"""How resting masses share their load in a gait program: the split of least actuation.

What the first resting masses carry together, times the duration of an arc, are columns of the
program. With these alone any split is allowed. That of least actuation is piecewise linear in
the forces: a pattern says which spikes are unloaded or full, and with the pattern given the
conditions for the least sum of squares are linear. Let P_b be the sum of the actuator forces from
the first resting mass to the b-th. P_b is the same for all spikes that are neither unloaded nor
full, no larger for those unloaded, no smaller for those full.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.numerics.bilinear_rows import BilinearRows, Product, Term
from wormopt.systems.spiked.crawl import share_load
from wormopt.systems.spiked.programs.scaled_limits import Form, ScaledLimits
from wormopt.systems.spiked.sequences import Resting
from wormopt.systems.spiked.task import Task

# For each resting mass, ascending: -1 where its spike is unloaded, 1 where it is full, else 0.
Pattern = tuple[int, ...]
ScaledForce = Callable[[Form, np.ndarray, int], tuple[list[Term], list[Product]]]


def split_matters(task: Task, resting: Resting) -> bool:
    """Whether limits or cost depend on a split of the load that statics leaves open."""
    peaks = ("peak_spike_load", "peak_actuator_force")
    asked = task.limits.actuator_force is not None or task.objective.minimise in peaks
    return asked and len(resting) > 1 and task.limits.sharing == "least_actuation"


@dataclass(frozen=True, eq=False)
class SplitRows:
    """Adds rows for some arcs on which the same masses rest, under one load.

    Every force is a line: weights of what must act on each mass (m a + k v + load), then of
    what the first resting masses carry together, the first alone, the first two, and so on.
    """

    rows: BilinearRows  # the program in the making
    limits: ScaledLimits  # its task
    force: ScaledForce  # terms of a coefficient of h times a form without load
    h: np.ndarray  # columns of the durations of these arcs
    arcs: np.ndarray  # numbers of these arcs
    degree: int  # of the forces
    resting: Resting
    load: float  # on each mass, in units of force

    def add(self, pattern: Pattern | None, peak: int | None, minimise: str | None) -> None:
        """Add what holds with this pattern, or any split (None); bound a peak by its column.

        `peak` is the column of the peak that is minimised, `minimise` says which peak.
        """
        shape = (len(self.arcs), self.degree + 1, len(self.resting) - 1)
        columns = self.rows.columns(np.full(shape, np.inf))
        forces, loads, sums = _lines(self.limits.links + 1, self.resting)
        full = self.limits.spikes[list(self.resting)]
        signs = pattern or (0,) * len(loads)
        first = signs.index(0)
        for k in range(self.degree + 1):
            for line, cap, sign in zip(loads, full, signs, strict=True):
                low, high = (cap if sign > 0 else 0.0), (0.0 if sign < 0 else cap)
                self._add(line, columns[:, k], k, low, high)
            for line, limit in zip(forces, self.limits.actuator_most, strict=True):
                self._add(line, columns[:, k], k, -limit, limit)
            peaks = {"peak_spike_load": loads, "peak_actuator_force": np.vstack([forces, -forces])}
            for line in peaks.get(minimise or "", ()):
                self._add_peak(line, columns[:, k], k, peak)
            if pattern is None:
                continue
            for b, sign in enumerate(signs):
                if b != first:
                    low, high = (-np.inf if sign < 0 else 0.0), (np.inf if sign > 0 else 0.0)
                    self._add(sums[b] - sums[first], columns[:, k], k, low, high)

    def _terms(
        self, line: np.ndarray, carried: np.ndarray, k: int
    ) -> tuple[list[Term], list[Product]]:
        count = self.limits.links + 1
        weight = line[:count]
        linear, products = self.force(
            Form(weight * self.limits.mass, weight, 0.0, 0.0), self.arcs, k
        )
        shares = [(carried[:, b], float(line[count + b])) for b in np.flatnonzero(line[count:])]
        return [*linear, *shares, (self.h, self.load * float(weight.sum()))], products

    def _add(self, line: np.ndarray, carried: np.ndarray, k: int, low: float, high: float) -> None:
        """Low <= line <= high, times h."""
        linear, products = self._terms(line, carried, k)
        if low == high:
            self.rows.add([*linear, (self.h, -low)], products, 0.0, 0.0)
            return
        if np.isfinite(low):
            self.rows.add([*linear, (self.h, -low)], products, 0.0, np.inf)
        if np.isfinite(high):
            self.rows.add([*linear, (self.h, -high)], products, -np.inf, 0.0)

    def _add_peak(self, line: np.ndarray, carried: np.ndarray, k: int, peak: int | None) -> None:
        assert peak is not None
        linear, products = self._terms(line, carried, k)
        self.rows.add(linear, [*products, (self.h, peak, -1.0)], -np.inf, 0.0)


def _lines(count: int, resting: Resting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Actuator forces, loads of the resting masses, and P_b of each, as lines."""
    rest, links = len(resting), count - 1
    carried = np.zeros((rest + 1, count + rest - 1))
    carried[1:rest, count:] = np.eye(rest - 1)
    carried[rest, :count] = 1.0
    held = [sum(i < j for i in resting) for j in range(1, count)]
    forces = carried[held]
    forces[:, :count] -= np.tril(np.ones((links, count)))
    sums = np.vstack([np.zeros(forces.shape[1]), np.cumsum(forces, axis=0)])
    return forces, np.diff(carried, axis=0), sums[list(resting)]


def simple_patterns(resting: Resting) -> list[Pattern]:
    """All resting spikes loaded at all times; or only the first of them, or only the last."""
    patterns = np.full((3, len(resting)), -1)
    patterns[0] = patterns[1, 0] = patterns[2, -1] = 0
    return [tuple(pattern) for pattern in patterns.tolist()]


def least_patterns(
    needed: np.ndarray,
    resting: Resting,
    full: np.ndarray,
    tie: float,
    olds: Sequence[Pattern] | None,
) -> list[Pattern]:
    """Patterns of the least split where these forces (arcs, n + 1) must act on the masses.

    With `olds` the other pattern of every mass for which two hold. `full`: most of each spike.
    """
    bare, total, held = -np.cumsum(needed, axis=1).T, needed.sum(axis=1), list(resting)
    loads = share_load(total, bare, resting, "least_actuation", full)
    sums = np.cumsum(bare + np.cumsum(loads, axis=0), axis=0)  # P_b behind each mass
    sums = np.vstack([np.zeros(len(total)), sums[:-1]])[held].T
    loads, full = loads[held].T, full[held]
    if olds is None:
        return [_pattern(load, full, p, tie) for load, p in zip(loads, sums, strict=True)]
    arcs = zip(olds, loads, sums, strict=True)
    return [_flipped(old, load, full, p, tie) for old, load, p in arcs]


def _pattern(load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float) -> Pattern:
    signs = np.where(load <= tie, -1, np.where(load >= full - tie, 1, 0))
    if not np.any(signs == 0):
        # The total is just what the full ones carry: the next to change counts as in between.
        is_full = signs == 1
        key = np.where(is_full, sums, np.inf) if is_full.any() else -sums
        signs[int(np.argmin(key))] = 0
    return tuple(signs.tolist())


def _flipped(
    old: Pattern, load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float
) -> Pattern:
    """The other pattern of every mass for which two hold."""
    first = old.index(0)
    new = list(old)
    for b, sign in enumerate(old):
        if b == first or abs(sums[b] - sums[first]) > tie:
            continue
        if sign != 0:
            new[b] = 0
        elif load[b] <= tie:
            new[b] = -1
        elif load[b] >= full[b] - tie:
            new[b] = 1
    if 0 in new[first + 1 :]:
        new[first] = -1 if load[first] <= tie else int(load[first] >= full[first] - tie)
    return tuple(new)
