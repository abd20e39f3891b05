"""Relaxation of gait design: a linear program whose maximum no gait can beat.

The resting masses of every phase are given, and a box that holds the phases' shares of the period,
and the period T. Each phase of share e and duration h = e T runs over a scaled time s in [0, 1],
cut into equal cells, and instead of a velocity v the program knows y = e v, the way per scaled
time and period. In these unknowns the speed, ways and limits on rates are linear; accelerations
become y' / (e h), so that their limits are linear in y and g = e h. Lengths are linear in y and
1 / T. Averages over a cell obey every linear limit that the motion obeys at each instant. Every
true gait in the box therefore gives a feasible point: the program only relaxes

- g = e² T, h = e T and 1 / T, to planes over the box,
- y = e c where phases meet and the velocity c is the same on both sides, and z = h q for the drag,
  to their smallest enclosures by planes over the box (McCormick),
- what happens inside a cell.

All of them vanish as boxes and cells shrink.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.numerics.linear_program import LinearProgram, Maximum, Rows, Term
from wormopt.systems.shared.sequences import Sequence_
from wormopt.systems.spiked.certify.cuts import (
    Cut,
    Cuts,
    Drawn,
    Sides,
    of_drags,
    of_meetings,
    of_shares,
)
from wormopt.systems.spiked.programs.scaled_limits import Form, scaled
from wormopt.systems.spiked.task import GaitProblem

# Averages above what cuts allow are worth a row if they are so by this share of what the bound is
# above the cutoff; then by shares of the speed from the second to the third.
_MISSED, _LEAST_MISSED, _MOST_MISSED = 0.5, 1e-5, 5e-3
# Rounds of cuts for a box, and the shares for a bound that is as close as cuts make it.
_ROUNDS, _ALL_ROUNDS, _ALL_MISSED = 8, 100, 1e-9
# Allowance for the rounding of box sides; everything in the program is of size 1.
_ROUNDING = 1e-14

Box = tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False)
class Relaxed:
    """What the relaxation says of a box; arrays have shape (phases + 1,), the period last."""

    bound: float  # proven: no gait in the box is faster; -inf: no gait
    point: np.ndarray  # relaxed optimum: shares of the period, then period / longest; empty if none
    # of the bound, due to relaxed products, to first order, by side of the box to blame
    losses: np.ndarray
    slack: np.ndarray  # product of distances from both ends, by side
    loads: float = 0.0  # of the bound, due to loads on masses that may not rest


class Relaxation:
    """Linear program of one resting sequence, for any box of shares and periods.

    It bounds the speed, whatever the objective. Neighbouring phases of `sequence` differ;
    `cells` is per phase; `more` others may rest in each phase (default: none).
    """

    def __init__(
        self, task: GaitProblem, sequence: Sequence_, cells: int, more: tuple[int, ...] = ()
    ) -> None:
        self._limits = scaled(task)
        self._sequence, self._cells = sequence, cells
        self._more = more or (0,) * len(sequence)
        self._borne: list[tuple[int, np.ndarray, float]] = []
        self._bearing: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self._balance: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._rows = Rows()
        self._sums: list[Cut] = []
        self._add_columns()
        for phase in range(len(sequence)):
            self._add_rates(phase)
            self._add_forces(phase)
        self._add_course()
        self._add_products()
        self._cuts = Cuts(self._sums)
        self._drawn = Drawn(self._cuts, 1.0 / cells)
        self._program = self._assemble()

    @property
    def _continuous(self) -> bool:
        return self._limits.acceleration is not None

    def _columns(self, upper: np.ndarray | float, *shape: int) -> np.ndarray:
        return self._rows.columns(np.broadcast_to(upper, shape))

    def _add_columns(self) -> None:
        """Speed, period T, shares e, g, h, ways y and q, lengths l from the shortest, speeds c.

        Lengths are per period like ways, and so is what they may change by: ``_room`` is 1 / T,
        or less where no link could use more. No link swings by more than 1 per period.
        """
        limits, phases, m = self._limits, len(self._sequence), self._cells
        links = limits.links
        fastest = np.array([limits.fastest(resting) for resting in self._sequence])
        rests = fastest == 0.0
        before, after = np.roll(rests, 1, axis=0), np.roll(rests, -1, axis=0)
        self._most_room = 1.0 / float(limits.strokes.min())
        self._way = self._rows.columns(np.array([fastest.max()])).item()
        self._period, self._room = self._rows.columns(np.ones(2))  # bounds come with the box
        self._e, self._g, self._h = self._rows.columns(np.ones((3, phases)))
        at_ends = np.repeat(fastest[:, None], m + 1, axis=1)
        if self._continuous:
            at_ends[:, 0][before] = 0.0
            at_ends[:, -1][after] = 0.0
        self._y = self._columns(at_ends, phases, m + 1, links + 1)
        self._q = self._columns(fastest[:, None], phases, m, links + 1)
        self._z = self._columns(fastest[:, None] if limits.drag else 0.0, phases, m, links + 1)
        self._l = self._rows.columns(np.ones((phases, m, links)))
        c_max = np.minimum(fastest, np.roll(fastest, -1, axis=0))
        self._c, self._c_max = self._rows.columns(c_max), c_max

    def _add_rates(self, phase: int) -> None:
        """Rates of the links at the cells' ends and on average."""
        e = int(self._e[phase])
        way = np.concatenate([self._y[phase], self._q[phase]])
        for j, (most_in, most_out) in enumerate(zip(*self._limits.rates, strict=True)):
            change = [(way[:, j], 1.0), (way[:, j + 1], -1.0)]
            self._rows.add([*change, (e, -most_out)], -np.inf, 0.0)
            self._rows.add([*change, (e, most_in)], 0.0, np.inf)

    def _add_forces(self, phase: int) -> None:
        """Limits on accelerations and forces, and what they say of averages and whole phases."""
        limits, resting, width = self._limits, self._sequence[phase], 1.0 / self._cells
        y, z = self._y[phase], self._z[phase]
        h, g = int(self._h[phase]), int(self._g[phase])
        c, before = self._c[phase], self._c[phase - 1]
        for bounds in limits.bounds(resting, self._more[phase]):
            form = bounds.form
            start, end = (_sum(form.alpha, way) for way in (y[:-1], y[1:]))
            change = [*end, *_times(start, -1.0)]
            force = [*_times(change, 1.0 / width), *_sum(limits.drag * form.beta, z)]
            if form.below < np.inf:
                self._rows.add([*force, (g, form.below)], 0.0, np.inf)
            if form.above < np.inf:
                above = self._rows.add([*force, (g, -form.above)], -np.inf, 0.0)
                self._bear(g, above, form.shared)
            for down, up in bounds.courses:
                shared = form.shared if up.rate == form.above else 0.0
                self._sums += [
                    Cut(phase, form.alpha, up, down, bounds.largest, (shared, 0.0)),
                    Cut(phase, -form.alpha, down, up, -bounds.least, (0.0, shared)),
                ]
            if self._continuous:
                gain = [*_sum(form.alpha, c[None]), *_sum(-form.alpha, before[None])]
                rise = self._rows.add([*gain, (h, -bounds.rise)], -np.inf, 0.0)
                if bounds.rise == form.above:
                    self._bear(h, rise, form.shared)
                self._rows.add([*gain, (h, bounds.fall)], 0.0, np.inf)
                if np.any(limits.drag * form.beta):
                    self._add_balance(phase, form, gain)

    def _bear(self, column: int, rows: np.ndarray, shared: float) -> None:
        """Remember rows that allow so much of a column for masses that may not rest."""
        if shared:
            self._borne.append((column, rows, shared))

    def _add_balance(self, phase: int, form: Form, gain: list[Term]) -> None:
        """Momentum over the whole phase: drag takes k times the way, which is T times that of y."""
        drags, q = self._limits.drag / self._cells * form.beta, self._q[phase]
        kept = q != -1
        drags, q = np.broadcast_to(drags, q.shape)[kept], q[kept]
        for sign, most, shared in ((1.0, form.above, form.shared), (-1.0, form.below, 0.0)):
            if most < np.inf:
                terms = [*gain, *zip(q.tolist(), drags.tolist(), strict=True)]
                terms = [*_times(terms, sign), (int(self._h[phase]), -most)]
                row = self._rows.add(terms, -np.inf, 0.0)
                self._balance.append((np.full(q.shape, row), q, sign * drags))
                self._bear(int(self._h[phase]), row, shared)

    def _add_cuts(
        self, which: np.ndarray, cells: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> Rows:
        """Bound averages of sums over cells by what is run along from their ends."""
        cuts, p, width, rows = self._cuts, self._cuts.phase[which], 1.0 / self._cells, Rows()
        reach = cuts.reach(which, before, after) * width / 2
        level = (1.0 - before - after + _ROUNDING) * cuts.most[which]
        terms: list[Term] = [(self._g[p], -reach), (self._e[p], -level)]
        held = cuts.holds(which, before, after)
        for i, weight in enumerate(cuts.weights[which].T):
            ends = (self._q[p, cells, i], self._y[p, cells, i], self._y[p, cells + 1, i])
            for column, share in zip(ends, (1.0, -held[0], -held[1]), strict=True):
                terms.append((np.where(weight * share != 0.0, column, -1), weight * share))
        rows.add(terms, -np.inf, 0.0)
        return rows

    def _add_course(self) -> None:
        """Lengths follow the ways and close, all masses advance alike, the period is allowed."""
        width = 1.0 / self._cells
        for j in range(self._limits.links):
            length, q = self._l[:, :, j].ravel(), np.concatenate(self._q)
            change = [(q[:, j], -width), (q[:, j + 1], width)]
            self._rows.add([(np.roll(length, -1), 1.0), (length, -1.0), *change], 0.0, 0.0)
            self._rows.add([(length, 1.0), (self._room, -self._limits.strokes[j])], -np.inf, 0.0)
        for i in range(self._limits.links + 1):
            ways = [(int(column), width) for column in self._q[:, :, i].ravel()]
            self._rows.add([*ways, (self._way, -1.0)], 0.0, 0.0)
        for columns, whole in ((self._e, ()), (self._h, ((int(self._period), -1.0),))):
            parts = [(int(column), 1.0) for column in columns]
            side = 0.0 if whole else 1.0
            self._rows.add([*parts, *whole], side - _ROUNDING, side + _ROUNDING)

    def _meetings(self) -> Iterator[tuple[int, int, int, float]]:
        """List y = e c on both sides of the instants where phases meet."""
        phases = len(self._sequence)
        for p, i in zip(*np.nonzero(self._c_max), strict=True):
            after = (p + 1) % phases
            c, most = int(self._c[p, i]), float(self._c_max[p, i])
            yield p, int(self._y[p, -1, i]), c, most
            yield after, int(self._y[after, 0, i]), c, most

    def _drags(self) -> Iterator[tuple[int, int, int, float]]:
        """List z = h q, by which velocities enter the drag."""
        for p, k, i in zip(*np.nonzero(self._z != -1), strict=True):
            q = int(self._q[p, k, i])
            yield p, int(self._z[p, k, i]), q, self._rows.upper[q]

    def _add_products(self) -> None:
        """Enclose products by planes that depend on the box."""
        e, room = self._e, int(self._room)
        p, y, c, most = self._meeting = _table(self._meetings() if self._continuous else ())
        d, z, q, top = self._drag = _table(self._drags())
        self._planes = [
            *of_shares(self._g, self._h, e, int(self._period), room),
            *of_meetings(p, y, c, e[p], most),
            *of_drags(d, z, q, self._g[d], e[d], top),
        ]
        self._plane_rows = [
            self._rows.add(
                [(column, np.ones(len(column))) for column in plane.columns], -np.inf, np.inf
            )
            for plane in self._planes
        ]

    def _assemble(self) -> LinearProgram:
        cost = np.zeros(len(self._rows.upper))
        upper = np.array(self._rows.upper) * (1 + 4 * _ROUNDING)
        cost[self._way] = 1.0
        program = LinearProgram(cost, self._rows, np.zeros_like(upper), upper)
        pairs = zip(self._planes, self._plane_rows, strict=True)
        self._places = np.concatenate(
            [program.places(rows, column) for plane, rows in pairs for column in plane.columns]
        )
        if self._balance:
            parts = (np.concatenate(part) for part in zip(*self._balance, strict=True))
            rows, columns, self._drags_per_way = parts
            self._ways = program.places(rows, columns)
        return program

    def solve(self, box: Box, cutoff: float | None = None) -> Relaxed:
        """Bound the speed of all gaits in a box; bounds below `cutoff` are not wanted.

        `box`: (smallest, largest) share of the period per phase, then (shortest, longest)
        period as shares of the longest allowed. Less work if far above `cutoff`.
        """
        sides = self._tighten(np.array(box))
        if np.any(sides.low > sides.high) or sides.a > sides.b:
            return _nothing(-np.inf)
        self._set_box(sides)
        found = self._program.maximise()
        bound = self._bound_of(found)
        for _ in range(_ALL_ROUNDS if cutoff is None else _ROUNDS):
            missed = self._missed(bound, cutoff)
            if missed <= 0.0 or not found.x.size or not self._cut_off(found.x, missed):
                break
            found = self._program.maximise()
            bound = min(bound, self._bound_of(found))
        if not found.x.size:
            return _nothing(bound)
        point = found.x[[*self._e, self._period]]
        ends = np.append(sides.low, sides.a), np.append(sides.high, sides.b)
        slack = np.maximum(point - ends[0], 0.0) * np.maximum(ends[1] - point, 0.0)
        losses, loads = self._losses(found, sides), self._loads(found)
        return Relaxed(bound, point, losses * self._limits.speed, slack, loads)

    def _missed(self, bound: float, cutoff: float | None) -> float:
        """By which share of the speed cuts must be missed to be made; 0 for none."""
        if cutoff is None:
            return _ALL_MISSED
        if bound <= cutoff:
            return 0.0
        return min(max(_MISSED * (bound - cutoff) / bound, _LEAST_MISSED), _MOST_MISSED)

    def _bound_of(self, found: Maximum) -> float:
        return found.bound * self._limits.speed * (1 + 4 * _ROUNDING)

    def _tighten(self, box: np.ndarray) -> Sides:
        """Draw the box in to shares that add up to 1."""
        (low, high), (a, b) = box[:-1].T, box[-1]
        others_low, others_high = low.sum() - low, high.sum() - high
        return Sides(
            np.maximum(low, 1.0 - others_high - _ROUNDING),
            np.minimum(high, 1.0 - others_low + _ROUNDING),
            float(a),
            float(b),
        )

    def _set_box(self, sides: Sides) -> None:
        program, (low, high, a, b) = self._program, (sides.low, sides.high, sides.a, sides.b)
        program.set_bounds(self._e, low, high)
        program.set_bounds(
            self._g, np.maximum(low**2 * a - _ROUNDING, 0.0), high**2 * b + _ROUNDING
        )
        program.set_bounds(self._h, np.maximum(low * a - _ROUNDING, 0.0), high * b + _ROUNDING)
        room = min(1.0 / a if a else np.inf, self._most_room) * (1 + _ROUNDING)
        program.set_bounds(
            np.array([self._period, self._room]), np.array([a, 0.0]), np.array([b, room])
        )
        coefficients, upper = [], []
        for plane in self._planes:
            none = np.zeros(len(plane.phase))
            values, side = plane.of(sides.of(plane.phase))
            coefficients += [none + value for value in values]
            upper.append(none + side + _ROUNDING)
        program.change(self._places, np.concatenate(coefficients))
        most = np.concatenate(upper)
        rows = np.concatenate(self._plane_rows)
        program.set_sides(rows, np.full(len(most), -np.inf), most)
        if self._balance:  # the period that is on the safe side
            drags = self._drags_per_way
            program.change(self._ways, drags * np.where(drags > 0.0, a, b))
        width = 1.0 / self._cells
        self._cuts.set_durations(low * a * width, high * b * width)
        self._drawn.change(program)

    def _cut_off(self, x: np.ndarray, missed: float) -> bool:
        """Add the cuts that a point does not meet; whether there are any."""
        cuts, x, width = self._cuts, np.append(np.maximum(x, 0.0), 0.0), 1.0 / self._cells
        y, q = (
            np.einsum("cki,ci->ck", x[columns[cuts.phase]], cuts.weights)
            for columns in (self._y, self._q)
        )
        start, end, g = y[:, :-1], y[:, 1:], x[self._g[cuts.phase], None]
        level = x[self._e[cuts.phase]] * cuts.most
        before, after = cuts.shares(start, end, level[:, None], g * width)
        every = np.broadcast_to(np.arange(len(level))[:, None], q.shape)
        reach = cuts.reach(every, before, after) * g * width / 2
        held = cuts.holds(every, before, after)
        most = held[0] * start + held[1] * end + reach + (1 - before - after) * level[:, None]
        found = which, cells = np.nonzero(q > most + missed * x[self._way])
        if which.size:
            before, after = before[found], after[found]
            rows = self._program.extend(self._add_cuts(which, cells, before, after))
            p = self._cuts.phase[which]
            columns = self._g[p, None], self._y[p, cells], self._y[p, cells + 1]
            self._drawn.add(self._program, rows, np.hstack(columns), which, (before, after))
            if cuts.shared[:, which].any():
                self._bearing.append((rows, which, before, after))
        return which.size > 0

    def _loads(self, found: Maximum) -> float:
        """Gain from loads on masses that may not rest, to first order, from all rows with them."""
        cuts, half = self._cuts, 0.5 / self._cells
        drawn = [
            (self._g[cuts.phase[which]], rows, half * cuts.borne(which, before, after))
            for rows, which, before, after in self._bearing
        ]
        gains = [
            np.sum(np.abs(found.row_duals[rows]) * found.x[columns] * shared)
            for columns, rows, shared in (*self._borne, *drawn)
        ]
        return float(sum(gains)) * self._limits.speed

    def _losses(self, found: Maximum, sides: Sides) -> np.ndarray:
        """Gain from products by sides of the box, to first order: multipliers times violations."""
        x, (low, high) = found.x, (sides.low, sides.high)
        weights = [np.abs(found.row_duals[rows]) for rows in self._plane_rows]
        e, t = x[self._e], x[self._period]
        excess = t * (e - low) * (high - e)
        losses = np.append(np.maximum(excess, 0.0) * (weights[0] + weights[1]), 0.0)
        rest = np.abs(x[self._g] - t * e**2 - excess) * (weights[0] + weights[1])
        rest += np.abs(x[self._h] - t * e) * (weights[2] + weights[3])
        losses[-1] += rest.sum() + weights[4].item() * t * abs(x[self._room] * t - 1.0)
        p, y, c, _ = self._meeting
        np.add.at(losses, p, sum(weights[5:9]) * np.abs(x[y] - e[p] * x[c]))
        p, z, q, _ = self._drag
        periods_fault = sides.b * low < sides.a * high  # the relative width of the period is less
        side = np.where(periods_fault, np.arange(len(e)), len(e))[p]
        np.add.at(losses, side, sum(weights[9:]) * np.abs(x[z] - t * e[p] * x[q]))
        return losses


def _table(
    products: Iterable[tuple[int, int, int, float]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Phases, products, factors and the factors' largest values."""
    phase, whole, factor, most = np.array([*products], float).reshape(-1, 4).T
    return phase.astype(int), whole.astype(int), factor.astype(int), most


def _nothing(bound: float) -> Relaxed:
    none = np.empty(0)
    return Relaxed(bound, none, none, none)


def _sum(weights: np.ndarray, columns: np.ndarray) -> list[Term]:
    """Terms of a weighted sum over masses, row by row."""
    return [(columns[:, i], float(weights[i])) for i in np.flatnonzero(weights)]


def _times(terms: Iterable[Term], factor: float) -> list[Term]:
    return [(columns, factor * np.asarray(value)) for columns, value in terms]
