"""An outer relaxation of gait design: a linear program whose maximum no gait can beat.

The resting masses of every phase are given, and a box that holds the durations of the phases.
Each phase of duration h runs over a scaled time s in [0, 1], cut into equal cells, and instead of
a velocity v the program knows y = h v, the way per scaled time. In these unknowns lengths, ways
and limits on rates are linear; accelerations become y' / h², so that their limits are linear in
y and g = h². Averages over a cell obey every linear limit that the motion obeys at each instant.
Every true gait with durations in the box therefore gives a feasible point: the program only
relaxes

- g = h², to the secant over the box,
- y = h c where phases meet and the velocity c is the same on both sides, and z = h q for the drag,
  to their smallest enclosures by planes over the box (McCormick),
- what happens inside a cell.

All three vanish as boxes and cells shrink.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.gaits.attempt import Task
from wormopt.gaits.cuts import Cut, Cuts
from wormopt.gaits.scaled_limits import ScaledLimits
from wormopt.gaits.sequences import Sequence_
from wormopt.optimal.linear import LinearProgram, Maximum, Rows, Term

__all__ = ["Box", "Relaxation", "Relaxed"]

# Cuts that miss by less than this share of the largest average are not worth a row.
_MISSED = 1e-3
_ROUNDS = 5
# Allowance for the rounding of box sides; everything in the program is of size 1.
_ROUNDING = 1e-14

_NOTHING = (np.empty(0),) * 3

Box = tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False)
class Relaxed:
    """What the relaxation says of a box.

    Parameters
    ----------
    bound : float
        Proven: no gait of the sequence with durations in the box is faster. Minus infinity where
        there is none.
    durations : ndarray, shape (phases,)
        Durations in the relaxed optimum; empty where there is none.
    losses : ndarray, shape (phases,)
        Part of the bound that relaxed products in each phase account for, to first order.
    slack : ndarray, shape (phases,)
        By how much the squares of the durations, as shares of the longest period, are exceeded.
    """

    bound: float
    durations: np.ndarray
    losses: np.ndarray
    slack: np.ndarray


class Relaxation:
    """The linear program of one sequence of resting masses, for any box of durations.

    Parameters
    ----------
    task : Task
        Worm and limits; the speed is what is bounded, whatever the objective.
    sequence : tuple of tuple of int
        Resting masses, phase after phase; neighbours differ.
    cells : int
        Cells per phase.
    reference : float, optional
        A speed near the optimum, where the period may vary: the bound is closest there.

    Examples
    --------
    Two masses that rest in turn: the best speed is 0.425, half the rate less the time that ramps
    take. The narrower the box, the closer the bound.

    >>> from wormopt.scenes.gait_design import GaitLimits, Objective
    >>> from wormopt.scenes.worm import WormTable
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> worm = WormTable(links=1, mass=1.0, load=5.0)
    >>> relaxation = Relaxation(Task(worm, limits, Objective(maximise="speed")), ((0,), (1,)), 10)
    >>> narrow = relaxation.solve(((0.49, 0.51), (0.49, 0.51))).bound
    >>> 0.425 < narrow < relaxation.solve(relaxation.root).bound <= 0.5
    True
    """

    def __init__(self, task: Task, sequence: Sequence_, cells: int, reference: float = 0.0) -> None:
        self._limits = ScaledLimits(task)
        self._sequence, self._cells = sequence, cells
        self._reference = reference / self._limits.speed
        self._rows = Rows()
        self._upper: list[float] = []
        self._sums: list[Cut] = []
        self._add_columns()
        for phase in range(len(sequence)):
            self._add_rates(phase)
            self._add_forces(phase)
        self._add_course()
        self._add_products()
        self._cuts = Cuts(self._sums)
        self._program = self._assemble()

    @property
    def root(self) -> Box:
        """The box of all durations, as shares of the longest period."""
        return ((0.0, 1.0),) * len(self._sequence)

    @property
    def _continuous(self) -> bool:
        return self._limits.acceleration is not None

    def _columns(self, upper: np.ndarray | float, *shape: int) -> np.ndarray:
        """Number new columns from 0 to these bounds; -1 where the bound is 0: no column."""
        most = np.broadcast_to(upper, shape)
        number = np.where(
            most > 0.0, len(self._upper) - 1 + np.cumsum(most > 0.0).reshape(shape), -1
        )
        self._upper.extend(most[most > 0.0].tolist())
        return number

    def _add_columns(self) -> None:
        """Durations h, squares g, ways y and q, lengths l from the shortest, velocities c."""
        limits, phases, m = self._limits, len(self._sequence), self._cells
        links = limits.links
        fastest = np.array([limits.fastest(resting) for resting in self._sequence])
        rests = fastest == 0.0
        before, after = np.roll(rests, 1, axis=0), np.roll(rests, -1, axis=0)
        self._way = int(self._columns(float(fastest.max()), 1)[0])
        self._h, self._g = self._columns(1.0, phases), self._columns(1.0, phases)
        at_ends = np.repeat(fastest[:, None], m + 1, axis=1)
        if self._continuous:
            at_ends[:, 0][before] = 0.0
            at_ends[:, -1][after] = 0.0
        self._y = self._columns(at_ends, phases, m + 1, links + 1)
        self._q = self._columns(fastest[:, None], phases, m, links + 1)
        self._z = self._columns(fastest[:, None] if limits.drag else 0.0, phases, m, links + 1)
        self._l = self._columns(limits.strokes, phases, m, links)
        c_max = np.minimum(fastest, np.roll(fastest, -1, axis=0))
        self._c, self._c_max = self._columns(c_max, phases, links + 1), c_max

    def _add_rates(self, phase: int) -> None:
        """Rates of the links at the cells' ends and on average."""
        h = int(self._h[phase])
        for j, (most_in, most_out) in enumerate(zip(*self._limits.rates, strict=True)):
            for way in (self._y[phase], self._q[phase]):
                change = [(way[:, j], 1.0), (way[:, j + 1], -1.0)]
                self._rows.add([*change, (h, -most_out)], -np.inf, 0.0)
                self._rows.add([*change, (h, most_in)], 0.0, np.inf)

    def _add_forces(self, phase: int) -> None:
        """Limits on accelerations and forces, and what they say of averages and whole phases."""
        limits, resting, width = self._limits, self._sequence[phase], 1.0 / self._cells
        y, q, z = self._y[phase], self._q[phase], self._z[phase]
        h, g = int(self._h[phase]), int(self._g[phase])
        for form in limits.forms(resting):
            start, end, mean = (_sum(form.alpha, way) for way in (y[:-1], y[1:], q))
            change = [*end, *_times(start, -1.0)]
            force = [*_times(change, 1.0 / width), *_sum(limits.drag * form.beta, z)]
            if form.below < np.inf:
                self._rows.add([*force, (g, form.below)], 0.0, np.inf)
            if form.above < np.inf:
                self._rows.add([*force, (g, -form.above)], -np.inf, 0.0)
            least, largest = limits.span(form.alpha, resting)
            fall, rise = limits.slopes(form, resting)
            self._sums += [
                Cut(phase, form.alpha, rise, fall, largest),
                Cut(phase, -form.alpha, fall, rise, -least),
            ]
            if self._continuous:
                gain = [
                    *_sum(form.alpha, self._c[phase][None]),
                    *_sum(-form.alpha, self._c[phase - 1][None]),
                ]
                self._rows.add([*gain, (h, -rise)], -np.inf, 0.0)
                self._rows.add([*gain, (h, fall)], 0.0, np.inf)

    def _add_cuts(
        self, which: np.ndarray, cells: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> Rows:
        """Bound averages of sums over cells by what is run along from their ends."""
        cuts, p, width, rows = self._cuts, self._cuts.phase[which], 1.0 / self._cells, Rows()
        reach = cuts.reach(which, before, after) * width / 2
        terms: list[Term] = [
            (self._g[p], -reach),
            (self._h[p], -(1.0 - before - after) * cuts.most[which]),
        ]
        for i, weight in enumerate(cuts.weights[which].T):
            ends = (self._q[p, cells, i], self._y[p, cells, i], self._y[p, cells + 1, i])
            for column, share in zip(ends, (1.0, -before, -after), strict=True):
                terms.append((np.where(weight * share != 0.0, column, -1), weight * share))
        rows.add(terms, -np.inf, 0.0)
        return rows

    def _add_course(self) -> None:
        """Lengths follow the ways and close, all masses advance alike, the period is allowed."""
        width = 1.0 / self._cells
        for j in range(self._limits.links):
            length, q = self._l[:, :, j].ravel(), self._q.reshape(-1, self._limits.links + 1)
            change = [(q[:, j], -width), (q[:, j + 1], width)]
            self._rows.add([(np.roll(length, -1), 1.0), (length, -1.0), *change], 0.0, 0.0)
        for i in range(self._limits.links + 1):
            ways = [(int(column), width) for column in self._q[:, :, i].ravel()]
            self._rows.add([*ways, (self._way, -1.0)], 0.0, 0.0)
        durations = [(int(column), 1.0) for column in self._h]
        self._rows.add(durations, self._limits.shortest_period, 1.0)

    def _meetings(self) -> Iterator[tuple[int, int, int, float]]:
        """List y = h c on both sides of the instants where phases meet."""
        phases = len(self._sequence)
        for p, i in zip(*np.nonzero(self._c_max), strict=True):
            after = (p + 1) % phases
            c, most = int(self._c[p, i]), float(self._c_max[p, i])
            yield p, int(self._y[p, -1, i]), c, most
            yield after, int(self._y[after, 0, i]), c, most

    def _drags(self) -> Iterator[tuple[int, int, int, float]]:
        """List z = h q, by which velocities enter the drag."""
        for p, k, i in zip(*np.nonzero(self._z >= 0), strict=True):
            q = int(self._q[p, k, i])
            yield p, int(self._z[p, k, i]), q, self._upper[q]

    def _add_products(self) -> None:
        """Enclose whole = h factor by two planes through factor = 0, two through factor = most.

        Their slopes depend on the box, and so does the secant above g = h².
        """
        self._secants = self._rows.add([(self._g, 1.0), (self._h, -1.0)], -np.inf, 0.0)
        products = [*(self._meetings() if self._continuous else ()), *self._drags()]
        table = np.array(products, float).reshape(-1, 4).T
        self._phase, self._whole, self._factor = table[:3].astype(int)
        self._most, h = table[3], self._h[self._phase]
        self._planes = [
            self._rows.add([(self._whole, 1.0), (self._factor, -1.0), (h, slope)], -np.inf, np.inf)
            for slope in (0.0 * self._most, 0.0 * self._most, -self._most, -self._most)
        ]
        drag = self._whole >= self._z[self._z >= 0].min(initial=len(self._upper))
        g = self._g[self._phase[drag]]  # z = h² v is below g times the largest velocity
        self._rows.add([(self._whole[drag], 1.0), (g, -self._most[drag])], -np.inf, 0.0)

    def _assemble(self) -> LinearProgram:
        cost = np.zeros(len(self._upper))
        upper = np.array(self._upper) * (1 + 4 * _ROUNDING)
        cost[self._way], cost[self._h] = 1.0, -self._reference
        program = LinearProgram(cost, self._rows, 0.0 * upper, upper)
        self._secant_places = program.places(self._secants, self._h)
        self._plane_places = [program.places(rows, self._factor) for rows in self._planes]
        return program

    def solve(self, box: Box) -> Relaxed:
        """Bound the speed of all gaits whose durations lie in a box.

        Parameters
        ----------
        box : tuple of (float, float)
            Shortest and longest duration of every phase, as shares of the longest period.

        Returns
        -------
        Relaxed
        """
        low, high, period = self._tighten(np.array(box))
        if np.any(low > high) or period[0] > period[1]:
            return Relaxed(-np.inf, *_NOTHING)
        self._set_box(low, high)
        found = self._program.maximise()
        for _ in range(_ROUNDS):
            if not found.x.size or not self._cut_off(found.x):
                break
            found = self._program.maximise()
        gain = found.bound / (period[0] if found.bound > 0 else period[1])
        bound = (self._reference + gain) * self._limits.speed * (1 + 4 * _ROUNDING)
        if not found.x.size:
            return Relaxed(bound, *_NOTHING)
        losses = self._losses(found) * self._limits.speed / period[0]
        h = found.x[self._h]
        return Relaxed(bound, h, losses, np.abs(found.x[self._g] - h**2))

    def _tighten(self, box: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
        """Draw the box in to durations that add up to an allowed period; and those periods."""
        low, high = box.T
        shortest = max(self._limits.shortest_period, float(low.sum()) - _ROUNDING)
        longest = min(1.0, float(high.sum()) + _ROUNDING)
        others_low, others_high = low.sum() - low, high.sum() - high
        drawn = (
            np.maximum(low, shortest - others_high - _ROUNDING),
            np.minimum(high, longest - others_low + _ROUNDING),
        )
        return *drawn, (shortest, longest)

    def _set_box(self, low: np.ndarray, high: np.ndarray) -> None:
        program, n = self._program, len(low)
        program.set_bounds(self._h, low, high)
        program.set_bounds(self._g, low**2 - _ROUNDING, high**2 + _ROUNDING)
        program.change(self._secant_places, -(low + high))
        program.set_sides(self._secants, np.full(n, -np.inf), _ROUNDING - low * high)
        at_low, at_high = low[self._phase], high[self._phase]
        none = np.full(len(self._phase), np.inf)
        for rows, places, slope, lower, upper in zip(
            self._planes,
            self._plane_places,
            (at_high, at_low, at_low, at_high),
            (-none, 0.0 * at_low, -none, -self._most * at_high - _ROUNDING),
            (0.0 * at_low, none, -self._most * at_low + _ROUNDING, none),
            strict=True,
        ):
            program.change(places, -slope)
            program.set_sides(rows, lower, upper)

    def _cut_off(self, x: np.ndarray) -> bool:
        """Add the cuts that a point does not meet; whether there are any."""
        cuts, x, width = self._cuts, np.append(x, 0.0), 1.0 / self._cells
        y, q = (
            np.einsum("cki,ci->ck", x[columns[cuts.phase]], cuts.weights)
            for columns in (self._y, self._q)
        )
        start, end, g = y[:, :-1], y[:, 1:], x[self._g[cuts.phase], None]
        level = x[self._h[cuts.phase]] * cuts.most
        before, after = cuts.shares(start, end, level[:, None], g * width)
        which = np.broadcast_to(np.arange(len(level))[:, None], q.shape)
        reach = cuts.reach(which, before, after) * g * width / 2
        most = before * start + after * end + reach + (1 - before - after) * level[:, None]
        found = np.nonzero(q > most + _MISSED * x[self._way])
        if found[0].size:
            self._program.extend(self._add_cuts(*found, before[found], after[found]))
        return found[0].size > 0

    def _losses(self, found: Maximum) -> np.ndarray:
        """Gain of each phase from its products, to first order: multiplier times violation."""
        x, duals = found.x, np.abs(found.row_duals)
        losses = duals[self._secants] * np.abs(x[self._g] - x[self._h] ** 2)
        apart = np.abs(x[self._whole] - x[self._h[self._phase]] * x[self._factor])
        weights = sum((duals[rows] for rows in self._planes), np.zeros(len(apart)))
        np.add.at(losses, self._phase, weights * apart)
        return losses


def _sum(weights: np.ndarray, columns: np.ndarray) -> list[Term]:
    """Terms of a weighted sum over masses, row by row."""
    return [(columns[:, i], float(weights[i])) for i in np.flatnonzero(weights)]


def _times(terms: Iterable[Term], factor: float) -> list[Term]:
    return [(columns, factor * np.asarray(value)) for columns, value in terms]


def _square(share: np.ndarray, slope: float) -> np.ndarray:
    """Slope times a square, in which a share of 0 makes even an unlimited slope vanish."""
    return np.square(share) * slope if slope < np.inf else np.where(share > 0.0, np.inf, 0.0)
