"""The best gait of one order of rest as a bilinear program: durations times velocities.

A cycle consists of phases, one per set of resting masses, and a phase of arcs of free duration h.
On an arc all velocities are polynomials in Bernstein form, so that limits on the coefficients hold
at every instant. Rates are linear in velocities; accelerations and forces times h are linear in
velocities and h. Only lengths, distances and drag contain products of h and a velocity. With degree
1 a velocity is linear on an arc. This is exact without drag, because the optimum is then at a limit
at all times, with constant acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from math import comb
from typing import Any

import numpy as np

from wormopt.model.gait import Gait
from wormopt.numerics.bilinear import Point
from wormopt.systems.shared.sequences import (
    SHORTEST,
    Sequence_,
    is_gait,
    lasting_phases,
    wave_direction,
)
from wormopt.systems.spiked.programs.gait_rows import (
    GaitRows,
    Pattern,
    least_patterns,
    simple_patterns,
    split_matters,
)

# Arcs of a smaller share of the cycle count as having no duration.
_SHORT = 1e-6
# Loads and sums of forces below this share of the forces at play count as zero.
_TIE = 1e-7


class GaitProgram(GaitRows):
    """Bilinear program of one cyclic order of rest; `period` (min, max) overrides the limits.

    `patterns`: unloaded and full spikes by arc (`Pattern`), by default any; `like`: limits that
    define the units.
    """

    # -- points ----------------------------------------------------------------------------------

    def start(
        self, durations: Sequence[float] | np.ndarray, random: np.random.Generator | None = None
    ) -> Point | None:
        """Best motion with given phase durations, in the task's units; None if infeasible.

        `random` draws the durations of the arcs, equal by default.
        """
        shares = np.ones(self.total)
        if random is not None:
            shares = random.uniform(0.7, 1.3, self.total)
        sums = np.add.reduceat(shares, self._edges[:-1])
        return self.start_arcs(shares * np.repeat(np.asarray(durations) / sums, self.arcs))

    def start_arcs(self, widths: np.ndarray) -> Point | None:
        """Best motion with given durations of the arcs, in the task's units; None if infeasible."""
        x = np.zeros(len(self.bilinear.upper))
        x[self.h] = widths / self.limits.time
        return self.bilinear.restore(x)

    def finer(
        self, point: Point, degree: int | None = None, parts: int = 2
    ) -> tuple[GaitProgram, Point | None]:
        """Join arcs that only repeat, then cut every arc in `parts`.

        Phases without duration are omitted. The point is never worse, and None if the solver fails.
        `degree` of the velocities is kept by default.
        """
        sequence, lasts = self._lasting(point)
        parted, widths = self._parted(point, parts, lasts)
        finer = self.changed(sequence=sequence, degree=degree or self.degree, **parted)
        widths = widths * (self.limits.time / parts)
        if self._costs is not None:
            return finer, finer.moving(*self._cut(point, widths / self.limits.time, parts))
        return finer, finer.start_arcs(np.repeat(widths, parts))

    def cut(self, point: Point, parts: int) -> tuple[GaitProgram, np.ndarray]:
        """Join arcs that only repeat, then cut every arc in `parts`.

        Also returns the durations (arcs,) of the same motion, in scaled units.
        """
        parted, widths = self._parted(point, parts, np.ones(len(self.sequence), bool))
        return self.changed(**parted), np.repeat(widths / parts, parts)

    def _parted(
        self, point: Point, parts: int, lasts: np.ndarray
    ) -> tuple[dict[str, Any], np.ndarray]:
        """Arcs and patterns of `cut` in phases that last, and durations of the joined arcs."""
        begins = self._joined(point) & np.repeat(lasts, self.arcs)
        first = np.flatnonzero(begins)
        patterns = self.patterns and tuple(self.patterns[k] for k in np.repeat(first, parts))
        arcs = parts * np.add.reduceat(begins.astype(int), self._edges[:-1])[lasts]
        return {"arcs": arcs, "patterns": patterns}, np.add.reduceat(point.x[self.h], first)

    def lasting(self, point: Point) -> tuple[GaitProgram, Point | None]:
        """Omit phases of almost no duration and join equal neighbours.

        The point is None if the solver fails. If all phases last, the program itself is returned.
        """
        phases = lasting_phases(self.sequence, self.durations(point).tolist(), _SHORT)
        if len(phases) == len(self.sequence):
            return self, point
        arcs = np.split(np.arange(self.total), self._edges[1:-1])
        kept = np.concatenate([arcs[k] for phase in phases for k in phase])
        sequence = tuple(self.sequence[phase[0]] for phase in phases)
        counts = np.array([sum(len(arcs[k]) for k in phase) for phase in phases])
        patterns = self.patterns and tuple(self.patterns[k] for k in kept)
        shorter = GaitProgram(self.task, sequence, self.period, counts, self.degree, patterns)
        widths = self.widths(point)
        return shorter, shorter.start_arcs(widths[kept] * widths.sum() / widths[kept].sum())

    def moving(self, widths: np.ndarray, v: np.ndarray, first: np.ndarray) -> Point:
        """Point of a motion that is known to be feasible, in scaled units.

        `widths` (arcs,): durations; `v` (arcs, 2, masses): velocities at both ends of each arc;
        `first` (links,): lengths at the start, above the shortest.
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
        """Durations of arcs, velocities and first lengths of a point, the arguments of `moving`."""
        v = np.where(self.v >= 0, point.x[self.v], 0.0)
        return point.x[self.h], v, point.x[self.length[0]]

    def _cut(
        self, point: Point, widths: np.ndarray, parts: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arguments of `moving` for the same motion on arcs of these durations, each repeated."""
        h, v, first = self.motion(point)
        widths = np.repeat(widths, parts)
        old, new = (np.concatenate([[0.0], np.cumsum(w)]) for w in (h, widths))
        nodes = np.concatenate([v[:, 0], v[-1:, -1]])
        at = np.stack([np.interp(new, old, mass) for mass in nodes.T], axis=1)
        return widths, np.stack([at[:-1], at[1:]], axis=1), first

    def _lasting(self, point: Point) -> tuple[Sequence_, np.ndarray]:
        """Phases that last, and their mask; all phases if equal ones would become neighbours."""
        durations = np.add.reduceat(point.x[self.h], self._edges[:-1])
        lasts = durations > _SHORT * durations.sum()
        sequence = tuple(s for s, long in zip(self.sequence, lasts, strict=True) if long)
        if is_gait(sequence):
            return sequence, lasts
        return self.sequence, np.ones(len(lasts), bool)

    def _joined(self, point: Point) -> np.ndarray:
        """Mask of arcs that must begin where they do."""
        # Arcs begin at phases, changes of acceleration, and turns of a length. The coefficients
        # keep the length in its range, and farther from its ends if it turns inside.
        begins = np.zeros(self.total, bool)
        begins[self._edges[:-1]] = True
        h, v, _ = self.motion(point)
        long = h > _SHORT * h.sum()
        if self.degree > 1 or not self._continuous:
            return begins | long
        slopes = (v[:, 1] - v[:, 0]) / np.where(long, h, 1.0)[:, None]
        rates = np.diff(v, axis=2)
        ways = np.where(np.abs(rates) < 1e-6, 0.0, np.sign(rates))
        phase = np.repeat(np.arange(len(self.sequence)), self.arcs)
        for last, k in pairwise(np.flatnonzero(long)):
            if phase[last] == phase[k]:
                bends = np.abs(slopes[k] - slopes[last]) > 1e-6 * (1 + np.abs(slopes[k]))
                turns = ways[last, 0] * ways[k, 1] < 0
                other = self.patterns and self.patterns[k] != self.patterns[last]
                begins[k] |= bends.any() or turns.any() or bool(other)
        return begins

    def with_patterns(self, patterns: tuple[Pattern | None, ...]) -> GaitProgram:
        """Copy the program with other patterns."""
        return GaitProgram(self.task, self.sequence, self.period, self.arcs, self.degree, patterns)

    def simple_patterns(self) -> list[tuple[Pattern | None, ...]]:
        """Patterns with all resting spikes loaded, only the first, or only the last."""
        of_phases = [
            simple_patterns(resting) if split_matters(self.task, resting) else [None] * 3
            for resting in self.sequence
        ]
        phase_of_arc = np.repeat(np.arange(len(self.sequence)), self.arcs)
        return [tuple(of_phases[phase][k] for phase in phase_of_arc) for k in range(3)]

    def least_patterns(self, point: Point, *, other: bool = False) -> tuple[Pattern | None, ...]:
        """Patterns of the least split in the middle of every arc; None where they do not matter.

        `other`: where two patterns hold, take the one that the program does not have.
        """
        needed, patterns = self._needed(point), list[Pattern | None]()
        tie = _TIE * float(np.abs(needed).max())
        for resting, arcs in zip(self.sequence, self.arcs.tolist(), strict=True):
            at = slice(len(patterns), len(patterns) + arcs)
            if split_matters(self.task, resting):
                olds: Any = self.patterns[at] if other and self.patterns else None
                patterns += least_patterns(needed[at], resting, self.limits.spikes, tie, olds)
            else:
                patterns += [None] * arcs
        return tuple(patterns)

    def _needed(self, point: Point) -> np.ndarray:
        """Force m a + k v + load on each mass in the middle of every arc, shape (arcs, n + 1)."""
        limits, degree = self.limits, self.degree
        h, v, _ = self.motion(point)
        change = degree * (_amid(degree - 1) @ np.diff(v, axis=1))
        slope = change / np.where(h > 1e-9 * h.sum(), h, np.inf)[:, None]
        load = float(np.mean(self.task.worm.load_range)) / limits.force + limits.beyond
        return limits.mass * slope + limits.drag * (_amid(degree) @ v) + load

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
        """The maximised objective, in the task's units: the speed, or a cost with its sign changed.

        Energy per distance excludes the work against loads, which is the same for all gaits.
        """
        return self.speed(point) if self._is_speed else point.value * self.unit

    def same_for_all(self) -> float:
        """The part of a cost that `objective` excludes."""
        if self._costs is None or not self._costs.energy:
            return 0.0
        return (self.limits.links + 1) * self.task.worm.load_range[1]

    def inside(self, point: Point, margin: float, apart: float) -> Point | None:
        """A point a little within all sides, in which masses that need not rest move; None if none.

        `apart`: their least velocity, where it exceeds the margin.
        """
        columns, velocities = np.full(len(point.x), margin), self.v[self.v >= 0]
        columns[velocities] = max(apart, margin)
        return self.bilinear.inside(point, margin, columns)

    def speed(self, point: Point) -> float:
        """Mean speed, in the task's units."""
        values = self.bilinear.values(point.x)
        return float(values[self._advance] / values[self.period_row]) * self.limits.speed

    def gait(self, point: Point) -> Gait:
        """The cycle as link lengths over time; arcs without duration are left out."""
        limits, degree = self.limits, self.degree
        h, v, _ = self.motion(point)
        kept = np.flatnonzero(h > SHORTEST * h.sum())
        rates = -np.diff(v[kept], axis=2) * limits.speed  # (arc, coefficient, link)
        power = np.arange(degree + 1)
        to_powers = np.array(
            [[comb(degree, p) * comb(p, k) * (-1.0) ** (p - k) for k in power] for p in power]
        )
        width = h[kept] * limits.time
        powers = np.einsum("pk,akj->ajp", to_powers, rates)
        shortest = np.array(self.task.limits.length_ranges(limits.links))[:, 0]
        pieces = np.zeros((len(kept), limits.links, degree + 2))
        pieces[:, :, 0] = point.x[self.length][kept] * limits.speed * limits.time + shortest
        pieces[:, :, 1:] = powers / width[:, None, None] ** power / (power + 1)
        return Gait(np.concatenate([[0.0], np.cumsum(width)]), pieces)


def _amid(degree: int) -> np.ndarray:
    """Bernstein polynomials at the middle of an arc."""
    return np.array([comb(degree, k) for k in range(degree + 1)]) / 2.0**degree


class WaveProgram(GaitProgram):
    """Program of a travelling wave: every mass repeats its neighbour's motion a phase later.

    The velocity of mass i in phase p depends only on (p + i), or (p - i), modulo the number of
    phases. The program therefore has the unknowns of one mass for any number of links. Neighbours
    are alike in all phases, so links need the rows of one phase. Sums of forces differ, because the
    chain has ends.

    The parameters are those of `GaitProgram`; `sequence` must be a wave (`wave_direction`), with
    equal numbers of arcs in all phases. Limits may differ between links and masses.
    """

    @cached_property
    def _phases(self) -> int:
        if any(len(set(values)) > 1 for values in self.task.of_each):
            return len(self.sequence)
        # In the first phase, every pair of neighbouring classes is that of a link. With as many
        # phases as masses, the last and the first class are those of a link in the second.
        return 1 if len(self.sequence) <= self.limits.links else 2

    def _add_columns(self) -> None:
        """Columns by class: (phase + or - mass) modulo phases, and arc of the phase."""
        limits, phases, arcs = self.limits, len(self.sequence), int(self.arcs[0])
        masses, columns = np.arange(limits.links + 1), self.rows.columns
        direction = wave_direction(self.sequence, len(masses))
        classes = (direction * masses + np.arange(phases)[:, None]) % phases  # (phase, mass)
        most = np.full(phases, np.inf)
        for phase, resting in enumerate(self.sequence):
            np.minimum.at(most, classes[phase], limits.fastest(resting))
        self.h = np.tile(columns(np.ones(arcs)), phases)
        at_nodes = np.repeat(most[:, None], arcs, axis=1)
        at_nodes[:, 0] = np.minimum(most, np.roll(most, 1))
        starts = columns(at_nodes)
        ends = np.concatenate([starts[:, 1:], np.roll(starts[:, :1], -1, axis=0)], axis=1)
        inner = [columns(np.repeat(most[:, None], arcs, axis=1)) for _ in range(self.degree - 1)]
        by_class = np.stack([starts, *inner, ends], axis=2)  # (class, arc, coefficient)
        self.v = by_class[classes].transpose(0, 2, 3, 1).reshape(phases * arcs, -1, len(masses))
        strokes = np.full((phases, arcs), limits.strokes.min())
        of_links = columns(strokes)[classes[:, 1:]]
        self.length = of_links.transpose(0, 2, 1).reshape(phases * arcs, -1)
        self._add_peak_column()
