"""Columns and rows of the bilinear program of one order of rest, see `GaitProgram`.

Energy and effort are sums of cost columns. Actuators spend their net work plus the work they
absorb, because nothing is recovered. The net work is that against load and drag, so gaits differ in
the absorbed work. On an arc where forces and rates are polynomials, it is bounded by the positive
parts of the Bernstein coefficients of their product, which is exact if neither changes sign. The
effort of an arc is the squared change of a rate over the duration.

The load that the first resting masses carry together, times the duration of an arc, has columns of
its own. These columns alone allow every split among resting masses. The split of least actuation is
piecewise linear in the forces: a pattern gives the spikes that are unloaded or full, and for a
given pattern the conditions for the least sum of squares are linear. Let P_b be the sum of the
actuator forces from the first resting mass to the b-th. P_b is equal for all spikes that are
neither unloaded nor full, not larger for unloaded spikes, and not smaller for full ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from inspect import signature
from typing import Any, Self

import numpy as np
from msgspec import structs

from wormopt.numerics.bilinear import BilinearProgram, BilinearRows, Excess, Product, Term
from wormopt.systems.shared.sequences import Resting, Sequence_
from wormopt.systems.spiked.gait_problem import GaitProblem
from wormopt.systems.spiked.programs.scaled_limits import Form, ScaledLimits, scaled
from wormopt.systems.spiked.sharing import share_load

# For each resting mass, ascending: -1 where its spike is unloaded, 1 where it is full, else 0.
Pattern = tuple[int, ...]


def split_matters(task: GaitProblem, resting: Resting) -> bool:
    """Whether limits or cost depend on a split of the load that statics leaves open."""
    peaks = ("peak_spike_load", "peak_actuator_force")
    limited = task.limits.actuator_force is not None or task.objective.minimise in peaks
    return limited and len(resting) > 1 and task.limits.sharing == "least_actuation"


def lines_of(count: int, resting: Resting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Actuator forces, loads of the resting masses, and P_b of each, as rows of coefficients.

    The first `count` coefficients multiply the force on each mass (m a + k v + load). The others
    multiply the load carried by the first resting mass, the first two, and so on.
    """
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
    """All resting spikes loaded at all times; or only the first; or only the last."""
    unloaded = (-1,) * (len(resting) - 1)
    return [(0,) * len(resting), (0, *unloaded), (*unloaded, 0)]


def least_patterns(
    needed: np.ndarray,
    resting: Resting,
    full: np.ndarray,
    tie: float,
    olds: Sequence[Pattern] | None,
) -> list[Pattern]:
    """Patterns of the least split for the forces `needed` (arcs, n + 1) on the masses.

    With `olds`, masses for which two patterns hold get the other one. `full`: largest
    loads of the spikes.
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
        # The full spikes carry exactly the total: the next to change counts as in between.
        is_full = signs == 1
        key = np.where(is_full, sums, np.inf) if is_full.any() else -sums
        signs[int(np.argmin(key))] = 0
    return tuple(signs.tolist())


def _flipped(
    old: Pattern, load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float
) -> Pattern:
    """The pattern in which every mass with two valid patterns has the other one."""
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


# Upper bound on the cost of an arc, in units of force times distance or of rate squared over time.
_MOST_COST = 1e6
# Accelerations, as shares of the limit, whose tangents bound the effort from below.
_TANGENTS = (0.03, 0.07, 0.13, 0.22, 0.35, 0.5, 0.75, 1.0)


class GaitRows:
    """Unknowns and limits of a cycle; the parameters are those of `GaitProgram`."""

    def __init__(
        self,
        task: GaitProblem,
        sequence: Sequence_,
        period: tuple[float, float],
        arcs: int | Sequence[int] | np.ndarray = 6,
        degree: int = 1,
        patterns: tuple[Pattern | None, ...] | None = None,
        like: ScaledLimits | None = None,
    ) -> None:
        self.task, self.sequence, self.period, self.degree = task, sequence, period, degree
        self.patterns, self.like = patterns, like
        self.limits = scaled(structs.replace(task, limits=task.limits.without_ticks(period)))
        if like is not None:
            self.limits = replace(self.limits, like=like)
        self.arcs = np.broadcast_to(arcs, len(sequence))
        self._edges = np.concatenate([[0], np.cumsum(self.arcs)])
        self.total = int(self._edges[-1])
        self.rows = BilinearRows()
        self._peak: int | None = None
        self._add_columns()
        self._costs = CostColumns(self) if task.objective.is_smooth else None
        self._add_rates()
        for phase, resting in enumerate(sequence):
            at = slice(self._edges[phase], self._edges[phase + 1])
            of_links = 0 if phase < self._phases else self.limits.links
            for form in self.limits.binding(resting)[of_links:]:
                self._add_form(form, at)
            if split_matters(task, resting):
                self._add_splits(resting, at)
            else:
                self._add_peaks(resting, at)
            if self._costs is not None:
                self._costs.add_phase(resting, at)
        self._add_lengths()
        self._add_ends()

    def __reduce__(self) -> tuple:
        """Pickle the arguments only: less is sent, and nothing of the solver."""
        return type(self), tuple(getattr(self, name) for name in _ARGUMENTS)

    def changed(self, **others: Any) -> Self:
        """The program with other arguments."""
        return type(self)(**{name: getattr(self, name) for name in _ARGUMENTS} | others)

    def forget(self) -> None:
        """Release the solver: the next solution then starts alike in every process."""
        vars(self).pop("bilinear", None)

    @cached_property
    def _phases(self) -> int:
        """Phases whose rows of links are stated; the rows of all others follow from them."""
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
        """Rates of the links at all coefficients; where a mass rests, columns are bounded."""
        ends = slice(0, self.degree if self._continuous else self.degree + 1)
        for j, (contraction, extension) in enumerate(zip(*self.limits.rates, strict=True)):
            ahead, behind = (self.v[self._stated, ends, i].ravel() for i in (j, j + 1))
            both = (ahead >= 0) & (behind >= 0)
            if both.any():
                terms = [(ahead[both], 1.0), (behind[both], -1.0)]
                self.rows.add(terms, [], -contraction, extension)

    def _force(
        self, form: Form, at: slice | np.ndarray, k: int
    ) -> tuple[list[Term], list[Product]]:
        """Coefficient k of h times a form on some arcs: linear terms, and products for the drag."""
        v, h, degree = self.v[at], self.h[at], self.degree
        dragged = form.dragged if self.limits.drag else []
        raised = bool(dragged)
        steps = [(k + 1, k, degree - k if raised else degree)]
        if raised:
            steps.append((k, k - 1, k))
        linear: list[Term] = [
            (v[:, end, i], sign * weight * form.alpha[i])
            for later, sooner, weight in steps
            if weight
            for i in form.moving
            for end, sign in ((later, 1.0), (sooner, -1.0))
        ]
        products: list[Product] = [
            (h, v[:, k, i], self.limits.drag * form.beta[i]) for i in dragged
        ]
        return linear, products

    def _coefficients(self, form: Form) -> range:
        dragged = self.limits.drag and form.dragged
        return range(self.degree + 1 if dragged else self.degree)

    def _add_form(self, form: Form, at: slice) -> None:
        """Add -below <= form <= above at all times of a phase, times h."""
        for k in self._coefficients(form):
            linear, products = self._force(form, at, k)
            if not products and all(np.all(np.asarray(column) < 0) for column, _ in linear):
                continue
            self._keep(linear, products, self.h[at], -form.below, form.above)

    def _keep(
        self, linear: list[Term], products: list[Product], h: np.ndarray, low: float, high: float
    ) -> None:
        """Add low <= terms <= high, times h."""
        if low == high:
            self.rows.add([*linear, (h, -low)], products, 0.0, 0.0)
            return
        if low > -np.inf:
            self.rows.add([*linear, (h, -low)], products, 0.0, np.inf)
        if high < np.inf:
            self.rows.add([*linear, (h, -high)], products, -np.inf, 0.0)

    def _add_splits(self, resting: Resting, at: slice) -> None:
        """Add the loads of the spikes, with one pattern for all loads of a range."""
        patterns = self.patterns or (None,) * self.total
        for pattern in sorted(set(patterns[at]), key=str):
            arcs = np.array([k for k in range(self.total)[at] if patterns[k] == pattern])
            for load in sorted(set(self.task.worm.load_range)):
                self._add_split(resting, arcs, pattern, load / self.limits.force)

    def _add_split(
        self, resting: Resting, arcs: np.ndarray, pattern: Pattern | None, load: float
    ) -> None:
        """Add the conditions on some arcs under one load for a pattern, or for any split (None)."""
        limits, h, count = self.limits, self.h[arcs], self.limits.links + 1
        degree = self.degree if limits.drag else self.degree - 1
        shared = self.rows.columns(np.full((len(arcs), degree + 1, len(resting) - 1), np.inf))
        forces, loads, sums = lines_of(count, resting)
        signs = pattern or (0,) * len(loads)
        first = signs.index(0)
        peaks = {"peak_spike_load": loads, "peak_actuator_force": np.vstack([forces, -forces])}

        def terms(line: np.ndarray, k: int) -> tuple[list[Term], list[Product]]:
            weight = line[:count]
            linear, products = self._force(limits.weighted(weight), arcs, k)
            shares = [
                (shared[:, k, b], float(line[count + b])) for b in np.flatnonzero(line[count:])
            ]
            at_rest = load * float(weight.sum()) + float(weight @ limits.beyond)
            return [*linear, *shares, (h, at_rest)], products

        for k in range(degree + 1):
            for line, cap, sign in zip(loads, limits.spikes[list(resting)], signs, strict=True):
                low, high = (cap if sign > 0 else 0.0), (0.0 if sign < 0 else cap)
                self._keep(*terms(line, k), h, low, high)
            for line, limit in zip(forces, limits.actuator_most, strict=True):
                self._keep(*terms(line, k), h, -limit, limit)
            if self._peak is not None:
                for line in peaks[str(self.task.objective.minimise)]:
                    linear, products = terms(line, k)
                    self.rows.add(linear, [*products, (h, self._peak, -1.0)], -np.inf, 0.0)
            for b, sign in enumerate(signs if pattern else ()):
                if b != first:
                    low, high = (-np.inf if sign < 0 else 0.0), (np.inf if sign > 0 else 0.0)
                    self._keep(*terms(sums[b] - sums[first], k), h, low, high)

    def _add_peaks(self, resting: Resting, at: slice) -> None:
        """Keep forces below the minimised peak, at all times and any load, times h."""
        if self._peak is None:
            return
        limits, count = self.limits, self.limits.links + 1
        loads = np.array(self.task.worm.load_range) / limits.force
        if self.task.objective.minimise == "peak_spike_load":
            whole = limits.weighted(np.ones(count))
            self._add_peak(whole, at, count * loads[1], float(len(resting)))
            return
        for weight, at_rest in limits.actuators(resting):
            for sign in (1.0, -1.0):
                form = limits.weighted(sign * weight)
                most = np.max(sign * (at_rest * loads + weight @ limits.beyond))
                self._add_peak(form, at, float(most), 1.0)

    def _add_peak(self, form: Form, at: slice, at_rest: float, shared: float) -> None:
        for k in self._coefficients(form):
            linear, products = self._force(form, at, k)
            products = [*products, (self.h[at], self._peak, -shared)]
            self.rows.add([*linear, (self.h[at], at_rest)], products, -np.inf, 0.0)

    def _add_lengths(self) -> None:
        """Let lengths follow the rates and stay in their ranges at all coefficients."""
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
        """Add the period, advance of the head, required speed and jumps of velocities."""
        every = [(int(h), 1.0) for h in self.h]
        self.period_row = int(self.rows.add(every, [], *self.limits.periods)[0])
        self._advance = int(self.rows.add([(0, 0.0)], self._ways, -np.inf, np.inf)[0])
        required = self.task.objective.speed
        if required is not None:
            self._hold_speed(required / self.limits.speed)
        if not self._continuous:
            jump = [
                (column, sign * mass)
                for i, mass in enumerate(self.limits.mass)
                for column, sign in ((self.v[:, 0, i], 1.0), (np.roll(self.v[:, -1, i], 1), -1.0))
            ]
            self.rows.add(jump, [], 0.0, np.inf)

    @property
    def _ways(self) -> list[Product]:
        """Products whose sum is the advance of the head."""
        share = 1.0 / (self.degree + 1)
        return [
            (int(self.h[k]), int(v), share) for k, row in enumerate(self.v[:, :, 0]) for v in row
        ]

    def _hold_speed(self, value: float) -> None:
        self.rows.add([(int(h), -value) for h in self.h], self._ways, 0.0, np.inf)

    def hold(self, value: float) -> None:
        """Keep the objective (a speed, or a peak with its sign changed) at or above a value."""
        if self._peak is None:
            self._hold_speed(value)
        else:
            self.rows.upper[self._peak] = -value

    @cached_property
    def bilinear(self) -> BilinearProgram:
        """The program."""
        if self._costs is not None:
            gain = self._costs.add_gain()
            per = self._advance if self._costs.energy else self.period_row
            excess = self._costs.excess()
            return BilinearProgram(self.rows, np.unique(self.h), gain, per, excess)
        if self._peak is None:
            return BilinearProgram(self.rows, np.unique(self.h), self._advance, self.period_row)
        low = int(self.rows.add([(self._peak, -1.0)], [], -np.inf, np.inf)[0])
        return BilinearProgram(self.rows, np.unique(self.h), low)


def is_energy(task: GaitProblem) -> bool:
    """Whether the cost of a task is the energy absorbed by actuators."""
    return task.objective.minimise == "energy_per_distance"


_ARGUMENTS = tuple(signature(GaitRows).parameters)


class CostColumns:
    """Columns and rows of the cost of a gait program, added phase by phase."""

    def __init__(self, program: GaitRows) -> None:
        self.program = program  # has its own columns already
        self.columns: list[np.ndarray] = []  # of costs
        self.rows: list[np.ndarray] = []  # that bound the costs from below
        self.energy = is_energy(program.task)
        if program.degree != 1:
            raise ValueError("costs need velocities that are linear on an arc")
        self.dragged = self.energy and program.limits.drag > 0
        # the distance of a mass at each coefficient of its velocity, a factor of the work of drag
        self.ways = np.full(program.v.shape, -1)
        if self.dragged:
            upper = np.where(program.v >= 0, np.array(program.rows.upper)[program.v], 0.0)
            self.ways = program.rows.columns(upper)
            h = np.broadcast_to(program.h[:, None, None], program.v.shape)
            there = program.v >= 0
            product = (h[there], program.v[there], -1.0)
            program.rows.add([(self.ways[there], 1.0)], [product], 0.0, 0.0)

    def add_phase(self, resting: tuple[int, ...], at: slice) -> None:
        """Add the cost of the arcs `at` of a phase."""
        if not self.energy:
            self._add_effort(at)
            return
        for j, (weight, at_rest) in enumerate(self.program.limits.actuators(resting)):
            self._add_absorbed(j, weight, at_rest, at)

    def _add_absorbed(self, j: int, weight: np.ndarray, at_rest: float, at: slice) -> None:
        """Bernstein coefficients of the power that actuator j absorbs, times the duration."""
        limits, v = self.program.limits, self.program.v[at]
        load = at_rest * self.program.task.worm.load_range[1] / limits.force
        load += float(weight @ limits.beyond)
        form = limits.weighted(weight)
        steps = [(v[:, end, i], s * form.alpha[i]) for end, s in ((1, 1.0), (0, -1.0))
                 for i in form.moving]  # fmt: skip
        push = [(self.program.h[at], load), *steps]
        pushes = [push, push]
        if self.dragged:
            drag = limits.drag * form.beta
            pushes = [
                [*push, *((self.ways[at, k, i], drag[i]) for i in np.flatnonzero(drag))]
                for k in (0, 1)
            ]
        rates = [[(v[:, k, j], 1.0), (v[:, k, j + 1], -1.0)] for k in (0, 1)]

        def power(k: int, m: int, share: float) -> list[tuple]:
            return [(a, b, -share * p * q) for a, p in pushes[k] for b, q in rates[m]]

        if self.dragged:
            self._add(power(0, 0, 1 / 3), at)
            self._add([*power(0, 1, 1 / 6), *power(1, 0, 1 / 6)], at)
            self._add(power(1, 1, 1 / 3), at)
        else:
            self._add(power(0, 0, 0.5), at)
            self._add(power(0, 1, 0.5), at)

    def _add_effort(self, at: slice) -> None:
        program = self.program
        h, v, most = program.h[at], program.v[at], program.limits.acceleration
        assert most is not None
        for j in range(program.limits.links):
            step = [(v[:, 1, j], 1.0), (v[:, 0, j], -1.0),
                    (v[:, 1, j + 1], -1.0), (v[:, 0, j + 1], 1.0)]  # fmt: skip
            square = [(a, b, -p * q) for a, p in step for b, q in step]
            column = self._add(square, at, times=h)
            for slope in (sign * share * most[j] for share in _TANGENTS for sign in (1.0, -1.0)):
                tangent = [(columns, -2 * slope * sign) for columns, sign in step]
                program.rows.add([(column, 1.0), (h, slope**2), *tangent], [], 0.0, np.inf)

    def _add(self, products: list[tuple], at: slice, times: np.ndarray | None = None) -> np.ndarray:
        """Cost columns c, one per arc, with the row c (times h) + products >= 0."""
        rows, count = self.program.rows, at.stop - at.start
        column = rows.columns(np.full(count, _MOST_COST))
        own = [(column, 1.0)] if times is None else []
        twice = [] if times is None else [(column, times, 1.0)]
        self.columns.append(column)
        self.rows.append(rows.add(own, [*twice, *products], 0.0, np.inf))
        return column

    def add_gain(self) -> int:
        """Add the row of the cost with its sign changed, and return its index."""
        total = [(int(c), -1.0) for c in np.concatenate(self.columns)]
        work: list[tuple] = []
        if self.dragged:
            share = self.program.limits.drag / 3
            for q, v in zip(self.ways, self.program.v, strict=True):
                for i in range(len(v[0])):
                    work += [(int(q[k, i]), int(v[m, i]), -share * w)
                             for k, m, w in ((0, 0, 1.0), (0, 1, 1.0), (1, 1, 1.0))]  # fmt: skip
        return int(self.program.rows.add(total, work, -np.inf, np.inf)[0])

    def complete(self, x: np.ndarray) -> None:
        """Set the distances in a point `x` from its durations and velocities, in place."""
        there = self.ways >= 0
        h = np.broadcast_to(self.program.h[:, None, None], self.ways.shape)
        x[self.ways[there]] = x[h[there]] * x[self.program.v[there]]

    def excess(self) -> Excess:
        """The cost columns, as the bilinear program takes them."""
        factors = np.unique(self.program.v[self.program.v >= 0])
        return Excess(np.concatenate(self.columns), np.concatenate(self.rows), factors)
