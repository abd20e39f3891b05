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
from dataclasses import replace
from functools import lru_cache

import numpy as np

from wormopt.core.gait import Gait
from wormopt.core.task import Limits, Objective, Task, Worm
from wormopt.gaits.costs import CostColumns, has_cost_columns
from wormopt.gaits.scaled_limits import Form, ScaledLimits
from wormopt.gaits.sequences import Resting, Sequence_
from wormopt.gaits.split import Pattern, SplitRows, split_matters
from wormopt.optimal.bilinear import BilinearProgram, Point
from wormopt.optimal.bilinear_rows import BilinearRows, Product, Term

__all__ = ["GaitProgram"]

# Arcs of a smaller share of the cycle count as having no duration.
_SHORT = 1e-9


@lru_cache(maxsize=64)
def _scaled(worm: Worm, limits: Limits, objective: Objective) -> ScaledLimits:
    return ScaledLimits(Task(worm, limits, objective))


class GaitProgram:
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

    >>> from wormopt.optimal.bilinear import Climb
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> program = GaitProgram(Task(Worm(1, load=5.0), limits), ((0,), (1,)), (1.0, 1.0))
    >>> point = program.bilinear.climb(program.start([0.5, 0.5]), Climb(1e-9))
    >>> round(program.speed(point), 9)
    0.425
    """

    def __init__(
        self,
        task: Task,
        sequence: Sequence_,
        period: tuple[float, float],
        arcs: int | Sequence[int] | np.ndarray = 6,
        degree: int = 1,
        patterns: tuple[Pattern | None, ...] | None = None,
        like: ScaledLimits | None = None,
    ) -> None:
        self.task, self.sequence, self.period, self.degree = task, sequence, period, degree
        self.patterns = patterns
        limits = replace(task.limits, period=period)
        self.limits = _scaled(task.worm, limits, task.objective)
        if like is not None:
            self.limits = replace(self.limits, like=like)
        self.arcs = np.broadcast_to(arcs, len(sequence))
        self._edges = np.concatenate([[0], np.cumsum(self.arcs)])
        self.total = int(self._edges[-1])
        self.rows = BilinearRows()
        self._peak: int | None = None
        self._add_columns()
        self._costs = CostColumns(self) if has_cost_columns(task) else None
        self._add_rates()
        for phase, resting in enumerate(sequence):
            at = slice(self._edges[phase], self._edges[phase + 1])
            of_links = 0 if phase < self._phases else self.limits.links
            for form in self.limits.forms(resting)[of_links:]:
                self._add_form(form, at)
            if split_matters(task, resting):
                self._add_splits(resting, at)
            else:
                self._add_peaks(resting, at)
            if self._costs is not None:
                self._costs.add_phase(resting, at)
        self._add_lengths()
        self._add_ends()
        self.bilinear = self._assemble()

    @property
    def _phases(self) -> int:
        """Phases whose rows of links are stated; those of all others follow from them."""
        return len(self.sequence)

    @property
    def _stated(self) -> slice:
        return slice(0, self._edges[self._phases])

    # -- columns ---------------------------------------------------------------------------------

    def _add_columns(self) -> None:
        """Durations h, velocities v per arc, coefficient and mass, lengths l above the shortest."""
        limits, total, degree, columns = self.limits, self.total, self.degree, self.rows.columns
        fastest = np.repeat([limits.fastest(r) for r in self.sequence], self.arcs, axis=0)
        self.h = columns(np.ones(total))
        self.v = np.full((total, degree + 1, limits.links + 1), -1)
        if self._continuous:
            starts = columns(np.minimum(fastest, np.roll(fastest, 1, axis=0)))
            self.v[:, 0], self.v[:, -1] = starts, np.roll(starts, -1, axis=0)
        else:
            self.v[:, 0], self.v[:, -1] = columns(fastest), columns(fastest)
        for k in range(1, degree):
            self.v[:, k] = columns(fastest)
        self.length = columns(np.repeat(limits.strokes[None], total, axis=0))
        self._add_peak_column()

    def _add_peak_column(self) -> None:
        if self.task.objective.minimise in ("peak_spike_load", "peak_actuator_force"):
            self._peak = int(self.rows.columns(np.array([np.inf]))[0])

    @property
    def _continuous(self) -> bool:
        return self.limits.acceleration is not None

    # -- rows ------------------------------------------------------------------------------------

    def _add_rates(self) -> None:
        """Rates of the links at all coefficients; bounds where one of both masses rests."""
        ends = slice(0, self.degree if self._continuous else self.degree + 1)
        upper = np.array(self.rows.upper)
        for j, (contraction, extension) in enumerate(zip(*self.limits.rates, strict=True)):
            ahead, behind = (self.v[self._stated, ends, i].ravel() for i in (j, j + 1))
            np.minimum.at(upper, ahead[(behind < 0) & (ahead >= 0)], extension)
            np.minimum.at(upper, behind[(ahead < 0) & (behind >= 0)], contraction)
            both = (ahead >= 0) & (behind >= 0)
            if both.any():
                terms = [(ahead[both], 1.0), (behind[both], -1.0)]
                self.rows.add(terms, [], -contraction, extension)
        self.rows.upper = upper.tolist()

    def _force(
        self, form: Form, at: slice | np.ndarray, k: int
    ) -> tuple[list[Term], list[Product]]:
        """Coefficient k of h times a form on some arcs: linear terms, and products for the drag.

        Accelerations are of one degree less; where they meet a drag they are raised to its.
        """
        v, h, degree = self.v[at], self.h[at], self.degree
        dragged = np.flatnonzero(form.beta * self.limits.drag)
        raised = len(dragged) > 0
        steps = [(k + 1, k, degree - k if raised else degree)]
        if raised:
            steps.append((k, k - 1, k))
        linear: list[Term] = [
            (v[:, end, i], sign * weight * form.alpha[i])
            for later, sooner, weight in steps
            if weight
            for i in np.flatnonzero(form.alpha)
            for end, sign in ((later, 1.0), (sooner, -1.0))
        ]
        products: list[Product] = [
            (h, v[:, k, i], self.limits.drag * form.beta[i]) for i in dragged
        ]
        return linear, products

    def _coefficients(self, form: Form) -> range:
        dragged = np.any(form.beta * self.limits.drag)
        return range(self.degree + 1 if dragged else self.degree)

    def _add_form(self, form: Form, at: slice) -> None:
        """-below <= form <= above at all times of a phase, times h."""
        for k in self._coefficients(form):
            linear, products = self._force(form, at, k)
            if not products and all(np.all(np.asarray(column) < 0) for column, _ in linear):
                continue
            if form.below < np.inf:
                self.rows.add([*linear, (self.h[at], form.below)], products, 0.0, np.inf)
            if form.above < np.inf:
                self.rows.add([*linear, (self.h[at], -form.above)], products, -np.inf, 0.0)

    def _add_splits(self, resting: Resting, at: slice) -> None:
        """What each spike carries, with one pattern for all loads of a range."""
        patterns = self.patterns or (None,) * self.total
        degree = self.degree if self.limits.drag else self.degree - 1
        for pattern in sorted(set(patterns[at]), key=str):
            arcs = np.array([k for k in range(self.total)[at] if patterns[k] == pattern])
            for load in sorted(set(self.task.worm.load_range)):
                SplitRows(
                    self.rows,
                    self.limits,
                    self._force,
                    self.h[arcs],
                    arcs,
                    degree,
                    resting,
                    load / self.limits.force,
                ).add(pattern, self._peak, self.task.objective.minimise)

    def _add_peaks(self, resting: Resting, at: slice) -> None:
        """Forces below the peak that is minimised, at all times and any load, times h."""
        if self._peak is None:
            return
        limits, count = self.limits, self.limits.links + 1
        loads = np.array(self.task.worm.load_range) / limits.force
        if self.task.objective.minimise == "peak_spike_load":
            whole = Form(limits.mass, np.ones(count), 0.0, 0.0)
            self._add_peak(whole, at, count * loads[1], float(len(resting)))
            return
        for weight, at_rest in limits.actuators(resting):
            for sign in (1.0, -1.0):
                form = Form(sign * weight * limits.mass, sign * weight, 0.0, 0.0)
                self._add_peak(form, at, float(np.max(sign * at_rest * loads)), 1.0)

    def _add_peak(self, form: Form, at: slice, at_rest: float, shared: float) -> None:
        for k in self._coefficients(form):
            linear, products = self._force(form, at, k)
            products = [*products, (self.h[at], self._peak, -shared)]
            self.rows.add([*linear, (self.h[at], at_rest)], products, -np.inf, 0.0)

    def _add_lengths(self) -> None:
        """Lengths follow the rates, and stay in their ranges at all coefficients."""
        share, own = 1.0 / (self.degree + 1), self._stated
        for j, stroke in enumerate(self.limits.strokes):
            length, after = self.length[own, j], np.roll(self.length[:, j], -1)[own]
            change: list[tuple] = []
            for k in range(self.degree + 1):
                for mass, sign in ((j, share), (j + 1, -share)):
                    change.append((self.h[own], self.v[own, k, mass], sign))
                if k < self.degree:
                    self.rows.add([(length, 1.0)], change, 0.0, stroke)
            back = [(h, v, -weight) for h, v, weight in change]
            self.rows.add([(after, 1.0), (length, -1.0)], back, 0.0, 0.0)

    def _add_ends(self) -> None:
        """Period, advance of the head, speed that is required, jumps of velocities."""
        every = [(int(h), 1.0) for h in self.h]
        shortest, longest = self.limits.shortest_period, self.limits.longest_period
        self._period = int(self.rows.add(every, [], shortest, longest)[0])
        share = 1.0 / (self.degree + 1)
        ways = [
            (int(self.h[k]), int(v), share) for k, row in enumerate(self.v[:, :, 0]) for v in row
        ]
        none = [(0, 0.0)]
        self._advance = int(self.rows.add(none, ways, -np.inf, np.inf)[0])
        required = self.task.objective.speed
        if required is not None:
            kept = [(h, -required / self.limits.speed) for h, _ in every]
            self.rows.add(kept, ways, 0.0, np.inf)
        if not self._continuous:
            jump = [
                (column, sign * mass)
                for i, mass in enumerate(self.limits.mass)
                for column, sign in ((self.v[:, 0, i], 1.0), (np.roll(self.v[:, -1, i], 1), -1.0))
            ]
            self.rows.add(jump, [], 0.0, np.inf)

    def _assemble(self) -> BilinearProgram:
        if self._costs is not None:
            gain = self._costs.add_gain()
            per = self._advance if self._costs.energy else self._period
            excess = self._costs.excess()
            return BilinearProgram(self.rows, np.unique(self.h), gain, per, excess)
        if self._peak is None:
            return BilinearProgram(self.rows, np.unique(self.h), self._advance, self._period)
        low = int(self.rows.add([(self._peak, -1.0)], [], -np.inf, np.inf)[0])
        return BilinearProgram(self.rows, np.unique(self.h), low)

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
        begins = self._joined(point)
        first = np.flatnonzero(begins)
        patterns = self.patterns and tuple(self.patterns[k] for k in np.repeat(first, parts))
        arcs = parts * np.add.reduceat(begins.astype(int), self._edges[:-1])
        widths = np.add.reduceat(point.x[self.h], first) * (self.limits.time / parts)
        degree = degree or self.degree
        finer = type(self)(self.task, self.sequence, self.period, arcs, degree, patterns)
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

    def _joined(self, point: Point) -> np.ndarray:
        """True for each arc that must begin where it does.

        At a phase, at a change of acceleration, and where a length turns: its range is held by
        the coefficients, which an arc with a turn inside would hold farther from its ends.
        """
        begins = np.zeros(self.total, bool)
        begins[self._edges[:-1]] = True
        if self.degree > 1 or not self._continuous:
            return np.ones(self.total, bool)
        h, last = point.x[self.h], -1
        long = h > _SHORT * h.sum()
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
