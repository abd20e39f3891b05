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

__all__ = ["GaitProgram"]

# Arcs of a smaller share of the cycle count as having no duration.
_SHORT = 1e-6


class GaitProgram(GaitRows):
    """The bilinear program of one cyclic order of rest.

    Parameters
    ----------
    task : Task
        Worm, limits and objective; where velocities may jump, smooth costs are left out and the
        speed is sought.
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    period : tuple of float
        Shortest and longest duration of the cycle, whatever the limits say of the period.
    arcs : int or sequence of int, optional
        Arcs per phase, alike for all or one number for each.
    degree : int, optional
        Degree of the velocities on an arc.
    patterns : tuple, optional
        Which spikes are unloaded or full, arc after arc, where that matters (`gaits.split`); any
        split of the load is allowed if left out.
    like : ScaledLimits, optional
        Whose units are taken instead of the task's own.

    Examples
    --------
    Two masses that rest in turn: without the time for ramps the speed would be half the rate.

    >>> from wormopt.numerics.bilinear import Climb
    >>> from wormopt.systems.spiked.limits import Limits
    >>> from wormopt.systems.spiked.task import Task, Worm
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> program = GaitProgram(Task(Worm(1, load=5.0), limits), ((0,), (1,)), (1.0, 1.0))
    >>> point = program.bilinear.climb(program.start([0.5, 0.5]), Climb(1e-9))
    >>> round(program.speed(point), 9)
    0.425
    """

    # -- points ----------------------------------------------------------------------------------

    def start(
        self, durations: Sequence[float] | np.ndarray, random: np.random.Generator | None = None
    ) -> Point | None:
        """Best motion with given durations of the phases.

        Parameters
        ----------
        durations : sequence of float
            In the task's units.
        random : Generator, optional
            Draws durations of their arcs, equal if left out.

        Returns
        -------
        Point or None
            None where no motion meets the limits.
        """
        shares = np.ones(self.total)
        if random is not None:
            shares = random.uniform(0.7, 1.3, self.total)
        sums = np.add.reduceat(shares, self._edges[:-1])
        return self.start_arcs(shares * np.repeat(np.asarray(durations) / sums, self.arcs))

    def moved(self, task: Task, period: tuple[float, float]) -> GaitProgram:
        """Give the same unknowns and rows in the same units, with the numbers of another task.

        Parameters
        ----------
        task : Task
            Of the same worm and limits but for their numbers.
        period : tuple of float
            Shortest and longest duration of its cycle.

        Returns
        -------
        GaitProgram
        """
        same = (self.arcs, self.degree, self.patterns, self.limits)
        return type(self)(task, self.sequence, period, *same)

    def start_arcs(self, widths: np.ndarray) -> Point | None:
        """Best motion with given durations of the arcs.

        Parameters
        ----------
        widths : ndarray
            Durations of the arcs, in the task's units.

        Returns
        -------
        Point or None
            None where no motion meets the limits.
        """
        x = np.zeros(len(self.bilinear.upper))
        x[self.h] = widths / self.limits.time
        return self.bilinear.restore(x)

    def finer(
        self, point: Point, degree: int | None = None, parts: int = 2
    ) -> tuple[GaitProgram, Point | None]:
        """The same cycle with every arc cut in parts, once those that only repeat are joined.

        Phases that last no time are left out.

        Parameters
        ----------
        point : Point
            Of this program.
        degree : int, optional
            Degree of the velocities; the same if left out.
        parts : int, optional
            Parts of each arc.

        Returns
        -------
        program : GaitProgram
        point : Point or None
            Never worse; None where the solver fails.
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
        """A motion that is known to be feasible: durations of arcs, velocities, first lengths.

        Parameters
        ----------
        widths : ndarray, shape (arcs,)
            In scaled units, as are all others.
        v : ndarray, shape (arcs, 2, masses)
            Velocities at both ends of each arc.
        first : ndarray, shape (links,)
            Lengths at the start, above the shortest.
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
        """Durations of arcs, velocities and first lengths of a point, as `moving` takes them.

        Parameters
        ----------
        point : Point
            Of this program.
        """
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
        """The same with other patterns.

        Parameters
        ----------
        patterns : tuple
            As for the class.
        """
        return GaitProgram(self.task, self.sequence, self.period, self.arcs, self.degree, patterns)

    def durations(self, point: Point) -> np.ndarray:
        """Duration of each phase, in the task's units.

        Parameters
        ----------
        point : Point
            Of this program.
        """
        return np.add.reduceat(point.x[self.h], self._edges[:-1]) * self.limits.time

    def widths(self, point: Point) -> np.ndarray:
        """Duration of each arc, in the task's units.

        Parameters
        ----------
        point : Point
            Of this program.
        """
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
        """What is made large, in the task's units: the speed, or a cost with its sign changed.

        Of the energy per distance the part that gaits differ in: without the work against loads.

        Parameters
        ----------
        point : Point
            Of this program.
        """
        return self.speed(point) if self._is_speed else point.value * self.unit

    def same_for_all(self) -> float:
        """What `objective` leaves out of a cost."""
        if self._costs is None or not self._costs.energy:
            return 0.0
        return (self.limits.links + 1) * self.task.worm.load_range[1]

    def speed(self, point: Point) -> float:
        """Mean speed, in the task's units.

        Parameters
        ----------
        point : Point
            Of this program.
        """
        values = self.bilinear.values(point.x)
        return float(values[self._advance] / values[self._period]) * self.limits.speed

    def gait(self, point: Point) -> Gait:
        """The cycle as link lengths over time; arcs without duration are left out.

        Parameters
        ----------
        point : Point
            Of this program.
        """
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
