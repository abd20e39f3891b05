"""The best gait of one order of rest as a bilinear program: durations times velocities.

A cycle is cut into phases, one per set of resting masses, and each phase into arcs of free
duration h. On an arc all velocities are polynomials, given by their Bernstein coefficients, so
that limits on the coefficients hold at every instant. Rates are linear in velocities,
accelerations and forces times h are linear in velocities and h; only lengths, ways and drag know
products of h and a velocity. With one degree a velocity is linear on an arc, which is exact
without drag: there the optimum is at some limit at all times, with constant acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wormopt.model.gait import Gait
from wormopt.numerics.bilinear import Point
from wormopt.systems.spiked.programs.gait_rows import GaitRows
from wormopt.systems.spiked.programs.split import Pattern
from wormopt.systems.spiked.search.sequences import Sequence_, is_gait
from wormopt.systems.spiked.task import Task

# Arcs of a smaller share of the cycle count as having no duration.
_SHORT = 1e-6


class GaitProgram(GaitRows):
    """Bilinear program of one cyclic order of rest; `period` (min, max) overrides the limits.

    `patterns`: spikes unloaded or full, by arc (`gaits.split`), default any; `like` gives
    units. Where velocities may jump, smooth costs are left out and the speed is sought.
    """

    # -- points ----------------------------------------------------------------------------------

    def start(
        self, durations: Sequence[float] | np.ndarray, random: np.random.Generator | None = None
    ) -> Point | None:
        """Best motion with given phase durations, in the task's units; None: infeasible.

        `random` draws the durations of their arcs, equal by default.
        """
        shares = np.ones(self.total)
        if random is not None:
            shares = random.uniform(0.7, 1.3, self.total)
        sums = np.add.reduceat(shares, self._edges[:-1])
        return self.start_arcs(shares * np.repeat(np.asarray(durations) / sums, self.arcs))

    def moved(self, task: Task, period: tuple[float, float]) -> GaitProgram:
        """The same unknowns, rows and units with the numbers of another task of the same form.

        `period` is the shortest and longest duration of its cycle.
        """
        same = (self.arcs, self.degree, self.patterns, self.limits)
        return type(self)(task, self.sequence, period, *same)

    def start_arcs(self, widths: np.ndarray) -> Point | None:
        """Best motion with given durations of the arcs, in the task's units; None: infeasible."""
        x = np.zeros(len(self.bilinear.upper))
        x[self.h] = widths / self.limits.time
        return self.bilinear.restore(x)

    def finer(
        self, point: Point, degree: int | None = None, parts: int = 2
    ) -> tuple[GaitProgram, Point | None]:
        """The same cycle with every arc cut in `parts`, once those that only repeat are joined.

        Phases of no duration are left out. The point is never worse, None if the solver
        fails; `degree` of the velocities is kept by default.
        """
        sequence, lasts = self._lasting(point)
        begins = self._joined(point) & np.repeat(lasts, self.arcs)
        first = np.flatnonzero(begins)
        patterns = self.patterns and tuple(self.patterns[k] for k in np.repeat(first, parts))
        arcs = parts * np.add.reduceat(begins.astype(int), self._edges[:-1])[lasts]
        widths = np.add.reduceat(point.x[self.h], first) * (self.limits.time / parts)
        degree = degree or self.degree
        finer = type(self)(self.task, sequence, self.period, arcs, degree, patterns)
        if self._costs is not None:
            return finer, finer.moving(*self._cut(point, widths / self.limits.time, parts))
        return finer, finer.start_arcs(np.repeat(widths, parts))

    def moving(self, widths: np.ndarray, v: np.ndarray, first: np.ndarray) -> Point:
        """Point of a motion that is known to be feasible, all in scaled units.

        `widths` (arcs,): durations; `v` (arcs, 2, masses): velocities at both ends of each
        arc; `first` (links,): lengths at the start, above the shortest.
        """
        x = np.zeros(len(self.bilinear.upper))
        x[self.h] = widths
        x[self.v[self.v >= 0]] = v[self.v >= 0]
        steps = -np.diff(v.mean(axis=1), axis=1) * widths[:, None]
        x[self.length] = first + np.cumsum(steps, axis=0) - steps
        if self._costs is not None:
            self._costs.complete(x)
        return self.bilinear.point(x)

    def motion(self, point: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Durations of arcs, velocities and first lengths of a point, as `moving` takes them."""
        v = np.where(self.v >= 0, point.x[self.v], 0.0)
        return point.x[self.h], v, point.x[self.length[0]]

    def _cut(
        self, point: Point, widths: np.ndarray, parts: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same motion on arcs of these durations, each so many times."""
        h, v, first = self.motion(point)
        widths = np.repeat(widths, parts)
        old, new = (np.concatenate([[0.0], np.cumsum(w)]) for w in (h, widths))
        nodes = np.concatenate([v[:, 0], v[-1:, -1]])
        at = np.stack([np.interp(new, old, mass) for mass in nodes.T], axis=1)
        return widths, np.stack([at[:-1], at[1:]], axis=1), first

    def _lasting(self, point: Point) -> tuple[Sequence_, np.ndarray]:
        """The phases that last, and true for each of them; all where the rest part equal ones."""
        durations = np.add.reduceat(point.x[self.h], self._edges[:-1])
        lasts = durations > _SHORT * durations.sum()
        sequence = tuple(s for s, long in zip(self.sequence, lasts, strict=True) if long)
        if is_gait(sequence):
            return sequence, lasts
        return self.sequence, np.ones(len(lasts), bool)

    def _joined(self, point: Point) -> np.ndarray:
        """True for each arc that must begin where it does.

        At a phase, at a change of acceleration, and where a length turns: its range is held by
        the coefficients, which an arc with a turn inside would hold farther from its ends.
        """
        begins = np.zeros(self.total, bool)
        begins[self._edges[:-1]] = True
        h, last = point.x[self.h], -1
        long = h > _SHORT * h.sum()
        if self.degree > 1 or not self._continuous:
            return begins | long
        v = np.where(self.v >= 0, point.x[self.v], 0.0)
        slopes = (v[:, 1] - v[:, 0]) / np.where(long, h, 1.0)[:, None]
        rates = np.diff(v, axis=2)
        for k in range(self.total):
            if begins[k]:
                last = k if long[k] else -1
            elif long[k]:
                if last >= 0:
                    bends = np.abs(slopes[k] - slopes[last]) > 1e-6 * (1 + np.abs(slopes[k]))
                    turns = rates[last, 0] * rates[k, 1] < 0
                    begins[k] = bends.any() or (turns & (np.abs(rates[k, 0]) < 1e-6)).any()
                    if self.patterns and self.patterns[k] != self.patterns[last]:
                        begins[k] = True
                last = k
        return begins

    def with_patterns(self, patterns: tuple[Pattern | None, ...]) -> GaitProgram:
        """The same program with other patterns."""
        return GaitProgram(self.task, self.sequence, self.period, self.arcs, self.degree, patterns)

    def durations(self, point: Point) -> np.ndarray:
        """Duration of each phase, in the task's units."""
        return np.add.reduceat(point.x[self.h], self._edges[:-1]) * self.limits.time

    def widths(self, point: Point) -> np.ndarray:
        """Duration of each arc, in the task's units."""
        return point.x[self.h] * self.limits.time

    @property
    def unit(self) -> float:
        """Unit of the objective, in the task's units."""
        if self._costs is not None and not self._costs.energy:
            return (self.limits.speed / self.limits.time) ** 2
        return self.limits.speed if self._is_speed else self.limits.force

    @property
    def _is_speed(self) -> bool:
        return self._peak is None and self._costs is None

    def objective(self, point: Point) -> float:
        """What is maximised, in the task's units: the speed, or a cost with its sign changed.

        Energy per distance excludes the work against loads, in which gaits do not differ.
        """
        return self.speed(point) if self._is_speed else point.value * self.unit

    def same_for_all(self) -> float:
        """What `objective` leaves out of a cost."""
        if self._costs is None or not self._costs.energy:
            return 0.0
        return (self.limits.links + 1) * self.task.worm.load_range[1]

    def speed(self, point: Point) -> float:
        """Mean speed, in the task's units."""
        values = self.bilinear.values(point.x)
        return float(values[self._advance] / values[self._period]) * self.limits.speed

    def gait(self, point: Point) -> Gait:
        """The cycle as link lengths over time; arcs without duration are left out."""
        from math import comb

        limits, degree = self.limits, self.degree
        h = point.x[self.h]
        kept = np.flatnonzero(h > 1e-14 * h.sum())
        v = np.where(self.v >= 0, point.x[self.v], 0.0)[kept]
        rates = -np.diff(v, axis=2) * limits.speed  # (arc, coefficient, link)
        to_powers = np.array(
            [
                [
                    comb(degree, p) * comb(p, k) * (-1.0) ** (p - k) if k <= p else 0.0
                    for k in range(degree + 1)
                ]
                for p in range(degree + 1)
            ]
        )
        width = h[kept] * limits.time
        powers = np.einsum("pk,akj->ajp", to_powers, rates)
        power = np.arange(degree + 1)
        shortest = np.array(self.task.limits.length_ranges(limits.links))[:, 0]
        pieces = np.zeros((len(kept), limits.links, degree + 2))
        pieces[:, :, 0] = point.x[self.length][kept] * limits.speed * limits.time + shortest
        pieces[:, :, 1:] = powers / width[:, None, None] ** power / (power + 1)
        return Gait(np.concatenate([[0.0], np.cumsum(width)]), pieces)
