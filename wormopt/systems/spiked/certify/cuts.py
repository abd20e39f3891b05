"""What relaxed gaits cannot pass: planes around products, cuts of averages over cells.

Planes enclose the products of the relaxation for any box of shares and periods.

Cuts say what averages over cells cannot pass, given the values at the cells' ends. Take a weighted
sum f of the velocities of a phase. From a cell's start it rises at most so fast, to its end it
falls at most so fast, and it is never larger than the links' rates allow. Run along these three
for any shares of the cell: what is passed over bounds the average of f. There are as many such
cuts as there are shares; they are made where a solution breaks them.

With drag the slopes change with f itself: f' <= rise - k h f and f' >= -fall - k h f, whose
solutions are exponential. As h is only known to lie in the box, such a cut changes with the box.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.numerics.linear_program import LinearProgram
from wormopt.systems.spiked.programs.scaled_limits import Slope

Values = tuple["np.ndarray | float", ...]

# Decays and areas are taken so much to the safe side.
_ROUNDING = 1e-12
# Steps of Newton's method; where it ends is no matter of truth.
_STEPS = 4
# Below this exponent a series is better than the quotient.
_SMALL = 5e-3


@dataclass(frozen=True, eq=False)
class Cut:
    """A weighted sum of velocities in a phase, its slopes and its largest value.

    The sum s obeys s' ≤ rate - decay s with ``rise`` and s' ≥ -rate - decay s with ``fall``.
    """

    phase: int
    weights: np.ndarray  # (n+1,) of the velocities; one sign where slopes decay
    rise: Slope  # largest slope upward
    fall: Slope  # largest slope downward
    most: float  # largest value
    shared: tuple[float, float] = (0.0, 0.0)  # of both rates, due to masses that may not rest


class Cuts:
    """Many weighted sums of velocities, handled together."""

    exponents: np.ndarray  # of decay from the start and from the end; follow from durations

    def __init__(self, cuts: Sequence[Cut]) -> None:
        self.phase = np.array([cut.phase for cut in cuts], int)
        self.weights = np.array([cut.weights for cut in cuts])
        self.rise, self.fall, self.most = np.array(
            [[cut.rise.rate, cut.fall.rate, cut.most] for cut in cuts]
        ).T
        self.shared = np.array([cut.shared for cut in cuts]).T
        slopes = [(cut.rise, cut.fall) for cut in cuts]
        self._decay = np.array([[s.decay for s in pair] for pair in slopes]).T
        self._longest = np.array([[s.longest for s in pair] for pair in slopes]).T
        self.decaying = np.asarray(self._decay.any(axis=0))
        self._decays = bool(self.decaying.any())
        self._finite = np.isfinite(self.rise), np.isfinite(self.fall)

    def set_durations(self, shortest: np.ndarray, longest: np.ndarray) -> None:
        """Set how long cells last, by phase; exponents of decay follow from it."""
        low, high = shortest * (1 - _ROUNDING), longest * (1 + _ROUNDING)
        self.exponents = self._decay * np.where(self._longest, high[self.phase], low[self.phase])
        self.exponents[1] *= -1.0  # what decays grows as seen from the end

    def holds(
        self, which: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the values at both ends of a cell in the area that is passed over.

        `which` numbers the sums; `before`, `after`: shares of the cell from its start, to
        its end.
        """
        if not self._decays:
            return before, after
        x, z = self.exponents[:, which]
        return before * _mean(x * before), after * _mean(z * after)

    def reach(self, which: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Twice the area that slopes add, run along for two shares of a cell.

        `which` numbers the sums; `before`, `after`: shares of the cell from its start, to
        its end.
        """
        up, down = _square(before, self.rise[which]), _square(after, self.fall[which])
        if not self._decays:
            return up + down
        x, z = self.exponents[:, which]
        return (up * _ramp(x * before) + down * _ramp(z * after)) * (1 + _ROUNDING)

    def borne(self, which: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Say how much of `reach` is due to masses that may not rest."""
        (up, down), (x, z) = self.shared[:, which], self.exponents[:, which]
        return up * before**2 * _ramp(x * before) + down * after**2 * _ramp(z * after)

    def shares(
        self, start: np.ndarray, end: np.ndarray, level: np.ndarray, reach: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shares (before, after) of cells that bound their averages best, shape (sums, cells).

        `start`, `end` (sums, cells): values at the ends; `level` (sums, 1): largest values
        times duration; `reach` (sums, 1) turns a slope into a change over a cell.
        """
        x, z = self.exponents[:, :, None]
        with np.errstate(all="ignore"):
            # slopes where the runs begin
            up = self.rise[:, None] * reach - x * start
            down = self.fall[:, None] * reach - z * end
            before, after = _time(level - start, up, x), _time(level - end, down, z)
            meet = _share((end - start + down) / (up + down))
            for _ in range(_STEPS * self._decays):
                rest = 1.0 - meet
                apart = start - end + up * meet * _mean(x * meet) - down * rest * _mean(z * rest)
                slope = up * np.exp(-x * meet) + down * np.exp(-z * rest)
                meet = np.where(self.decaying[:, None], _share(meet - apart / slope), meet)
        # where nothing limits a slope it is not run along
        before = np.where(self._finite[0][:, None], _share(before), 0.0)
        after = np.where(self._finite[1][:, None], _share(after), 0.0)
        apart = before + after <= 1.0
        return np.where(apart, before, meet), np.where(apart, after, 1.0 - meet)


class Drawn:
    """Cuts made so far whose numbers change with the box; `width` is that of a cell."""

    def __init__(self, cuts: Cuts, width: float) -> None:
        self._cuts, self._width = cuts, width
        masses = cuts.weights.shape[1]
        self._kinds = np.repeat([0, 1, 2], [1, masses, masses])
        none, wide = np.empty(0), np.empty((0, 2 * masses + 1))
        # sums, shares, weights of coefficients, which there are, and where
        self._all = [none.astype(int), none, none, wide, wide.astype(bool), none.astype(int)]

    def add(
        self,
        program: LinearProgram,
        rows: np.ndarray,
        columns: np.ndarray,
        which: np.ndarray,
        shares: tuple[np.ndarray, np.ndarray],
    ) -> None:
        """Remember m cuts that the program holds, by their rows and the numbers of their sums.

        `columns` (m, 2 n + 3): of g and of velocities at both ends of a cell, -1 for none;
        `shares` (m,) of the cell: from its start, to its end.
        """
        own = np.flatnonzero(self._cuts.decaying[which])
        which, shares = which[own], (shares[0][own], shares[1][own])
        weights = -self._cuts.weights[which]
        ends = [weights * (share > 0.0)[:, None] for share in shares]
        weights = np.hstack([np.full((len(own), 1), -0.5 * self._width), *ends])
        there = (columns[own] != -1) & (weights != 0.0)
        at = program.places(np.repeat(rows[own], there.sum(axis=1)), columns[own][there])
        parts = (which, *shares, weights, there, at)
        self._all = [np.concatenate(pair) for pair in zip(self._all, parts, strict=True)]

    def change(self, program: LinearProgram) -> None:
        """Change the program's cuts to the numbers of the box that was set last."""
        which, before, after, weights, there, at = self._all
        if which.size:
            held = self._cuts.holds(which, before, after)
            values = np.array([self._cuts.reach(which, before, after), *held]).T
            program.change(at, (values[:, self._kinds] * weights)[there])


def _share(value: np.ndarray) -> np.ndarray:
    """A number from 0 to 1; any will do where there is none."""
    return np.where(np.isnan(value), 0.5, np.minimum(np.maximum(value, 0.0), 1.0))


def _square(share: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Slope times a square, in which a share of 0 makes even an unlimited slope vanish."""
    return np.multiply(share**2, slope, out=np.zeros_like(share), where=share > 0.0)


def _time(way: np.ndarray, slope: np.ndarray, x: np.ndarray) -> np.ndarray:
    """How long a run takes that begins with a slope, which decays with the exponent x."""
    plain = way / slope
    left = 1.0 - plain * x
    reached = (slope > 0.0) & (left > 0.0)
    return np.where(reached, np.where(x == 0.0, plain, -np.log(left) / x), 1.0)


def _mean(x: np.ndarray) -> np.ndarray:
    """Mean of exp(-x s) over s from 0 to 1."""
    return np.where(x == 0.0, 1.0, -np.expm1(-x) / np.where(x == 0.0, 1.0, x))


def _ramp(x: np.ndarray) -> np.ndarray:
    """Twice the mean of (1 - exp(-x s)) / x over s from 0 to 1."""
    large = np.where(np.abs(x) > _SMALL, x, 1.0)
    series = 1.0 - x / 3 * (1.0 - x / 4 * (1.0 - x / 5 * (1.0 - x / 6)))
    return np.where(np.abs(x) > _SMALL, 2.0 * (1.0 - _mean(large)) / large, series)


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of a box."""

    low: np.ndarray  # smallest share of the period, by phase
    high: np.ndarray  # largest share of the period, by phase
    a: float  # shortest period
    b: float  # longest period

    def of(self, phase: np.ndarray) -> Sides:
        """The sides for things that belong to the phases `phase`."""
        return Sides(self.low[phase], self.high[phase], self.a, self.b)


@dataclass(frozen=True, eq=False)
class Plane:
    """Rows sum(coefficients · columns) ≤ side, where coefficients and side depend on the box."""

    phase: np.ndarray  # of each row
    columns: tuple[np.ndarray, ...]  # of the rows
    # coefficients (as many as columns) and side, for a box
    of: Callable[[Sides], tuple[Values, np.ndarray | float]]


def of_shares(g: np.ndarray, h: np.ndarray, e: np.ndarray, period: int, room: int) -> list[Plane]:
    """Bound g = e² T, h = e T and the room 1 / T from above; all arguments are columns.

    `g`, `h` and `e` have one column per phase.
    """
    phase, t = np.arange(len(e)), np.full(len(e), period)
    chord = Plane(phase[:1], (t[:1], np.array([room])), lambda s: ((1.0, s.a * s.b), s.a + s.b))
    return [
        Plane(phase, (g, e, t), _square_at_shortest),
        Plane(phase, (g, e, t), _square_at_longest),
        Plane(phase, (h, e, t), lambda s: ((1.0, -s.a, -s.high), -s.high * s.a)),
        Plane(phase, (h, e, t), lambda s: ((1.0, -s.b, -s.low), -s.low * s.b)),
        chord,
    ]


def of_meetings(
    phase: np.ndarray, y: np.ndarray, c: np.ndarray, e: np.ndarray, most: np.ndarray
) -> list[Plane]:
    """Enclose the products y = e c (columns) in their phases; `most` are largest values of c."""
    return [
        Plane(phase, (y, c), lambda s: ((1.0, -s.high), 0.0)),
        Plane(phase, (y, c), lambda s: ((-1.0, s.low), 0.0)),
        Plane(phase, (y, c, e), lambda s: ((1.0, -s.low, -most), -most * s.low)),
        Plane(phase, (y, c, e), lambda s: ((-1.0, s.high, most), most * s.high)),
    ]


def of_drags(
    phase: np.ndarray,
    z: np.ndarray,
    q: np.ndarray,
    g: np.ndarray,
    e: np.ndarray,
    most: np.ndarray,
) -> list[Plane]:
    """Enclose z = h q: h, which is in the box, multiplies 0 ≤ q ≤ e v_max; h e is g.

    `z`, `q`, `g`, `e` are columns, `phase` their phases, `most` the largest v_max.
    """
    columns = (z, g, e, q)
    return [
        Plane(phase, (z, q), lambda s: ((1.0, -s.high * s.b), 0.0)),
        Plane(phase, (z, q), lambda s: ((-1.0, s.low * s.a), 0.0)),
        Plane(phase, columns, lambda s: ((1.0, -most, s.low * s.a * most, -s.low * s.a), 0.0)),
        Plane(phase, columns, lambda s: ((-1.0, most, -s.high * s.b * most, s.high * s.b), 0.0)),
    ]


def _square_at_shortest(s: Sides) -> tuple[Values, np.ndarray]:
    """Keep g below a times the secant of e², and what longer periods add at most."""
    ends = s.low + s.high
    return (1.0, -s.a * ends, -(s.high**2)), -s.a * s.low * s.high - s.high**2 * s.a


def _square_at_longest(s: Sides) -> tuple[Values, np.ndarray]:
    """Keep g below b times the secant of e², less what shorter periods take at least."""
    ends = s.low + s.high
    return (1.0, -s.b * ends, -(s.low**2)), -s.b * s.low * s.high - s.low**2 * s.b
