"""How a worm with spikes crawls with a given gait: the bimodal system (7), solved in closed form.

Between instants at which the resting masses change, everything is a smooth explicit function of
time. The instants are roots of such functions, and gliding (mode 1) is a linear equation whose
solution is one integral. Nothing is stepped through time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
from scipy.optimize import root_scalar

from wormopt.core.chebyshev import Series, resolve
from wormopt.core.gait import Gait
from wormopt.errors import SolveError

__all__ = ["Crawl", "Sharing", "Stretch", "crawl", "share_load"]

Sharing = Literal["equal", "least_actuation"]


def share_load(
    total: np.ndarray, unloaded: np.ndarray, resting: Sequence[int], sharing: Sharing
) -> np.ndarray:
    """Split the total spike load over the resting masses.

    Parameters
    ----------
    total : ndarray, shape (m,)
        Sum of all spike loads at each instant.
    unloaded : ndarray, shape (n+1, m)
        Actuator forces mu_1..mu_{n+1} by the recursion from the head if no spike carried anything.
    resting : sequence of int
        Resting masses, ascending.
    sharing : {"equal", "least_actuation"}
        Same load on each, or the split with loads >= 0 that minimises the sum of squared
        actuator forces. The latter is a bounded isotonic regression of the cumulative load.

    Returns
    -------
    ndarray, shape (n+1, m)
        Load of every mass, 0 for those that move.

    Examples
    --------
    >>> import numpy as np
    >>> share_load(np.array([6.0]), np.zeros((3, 1)), [0, 2], "equal").ravel()
    array([3., 0., 3.])
    """
    loads = np.zeros_like(unloaded)
    if sharing == "equal" or len(resting) == 1:
        loads[list(resting)] = total / len(resting)
        return loads
    # Behind resting mass k and before the next, every actuator force is unloaded + carried[k].
    spans = list(pairwise(resting))
    sums = np.array([unloaded[i:j].sum(axis=0) for i, j in spans])
    counts = np.array([j - i for i, j in spans])
    carried = np.full_like(sums, -np.inf)
    for k in range(len(spans)):
        for first in range(k + 1):
            means = [
                -sums[first : last + 1].sum(axis=0) / counts[first : last + 1].sum()
                for last in range(k, len(spans))
            ]
            carried[k] = np.maximum(carried[k], np.min(means, axis=0))
    carried = np.clip(carried, 0.0, np.maximum(total, 0.0))
    loads[list(resting)] = np.diff(carried, axis=0, prepend=0.0 * total[None], append=total[None])
    return loads


@dataclass(frozen=True, eq=False)
class _Drive:
    """A gait drives a worm: the explicit functions of time on one piece."""

    gait: Gait
    mass: np.ndarray
    drag: float
    load: float
    sharing: Sharing

    @property
    def mean_mass(self) -> float:
        return float(self.mass.mean())

    @cached_property
    def rate_scale(self) -> float:
        return self._largest(1)

    @cached_property
    def force_scale(self) -> float:
        return self.load + self.mean_mass * self._largest(2) + self.drag * self.rate_scale

    def _largest(self, derivative: int) -> float:
        steps = [np.linspace(0, h, 9) for h in np.diff(self.gait.breaks)]
        values = [self.gait.on_piece(q, s, derivative) for q, s in enumerate(steps)]
        return max(float(np.abs(v).max()) for v in values) or 1.0

    def spans(self, piece: int, s: np.ndarray, derivative: int) -> np.ndarray:
        """Derivatives of S_i = x_0 - x_i, shape (n+1, m)."""
        links = self.gait.on_piece(piece, s, derivative)
        return np.vstack([np.zeros(len(s)), np.cumsum(links, axis=0)])

    def kinematic(self, piece: int, leader: int, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and accelerations of the masses while ``leader`` rests."""
        first, second = self.spans(piece, s, 1), self.spans(piece, s, 2)
        return first[leader] - first, second[leader] - second

    def sigma(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Driving term of (7), for masses that may differ."""
        return self.mass @ a / len(self.mass) + self.drag * v.mean(axis=0) + self.load


@dataclass(frozen=True, eq=False)
class Stretch:
    """An interval on which the same masses rest, or all glide, and everything is smooth.

    Parameters
    ----------
    piece : int
        Piece of the gait.
    start, stop : float
        Times since the piece began.
    resting : tuple of int
        Masses at rest, ascending; empty in a glide.
    leader : int
        Mass that rests in mode 2, and would rest if the worm did not glide.
    common : Series, optional
        Velocity w in a glide; None in mode 2.
    """

    piece: int
    start: float
    stop: float
    resting: tuple[int, ...]
    leader: int
    common: Series | None = None


@dataclass(frozen=True, eq=False)
class Crawl:
    """Periodic motion of a worm with spikes under a rigidly prescribed gait.

    Parameters
    ----------
    gait : Gait
        What the links do.
    stretches : tuple of Stretch
        The whole period in order.
    impulses : tuple of (float, float)
        Times and sizes of spike impulses at corners of the gait.
    drops : tuple of float
        Times at which the kinematic velocity W0 jumps down, so that the worm is thrown forward.
    drive : object
        The functions of time behind it.
    """

    gait: Gait
    stretches: tuple[Stretch, ...]
    impulses: tuple[tuple[float, float], ...]
    drops: tuple[float, ...]
    drive: _Drive = field(repr=False)

    # Rows of a stretch's quantities.
    def _rows(self) -> dict[str, slice]:
        n = self.gait.links
        sizes = {
            "length": n,
            "rate": n,
            "acceleration": n,
            "velocity": n + 1,
            "reaction": n + 1,
            "actuator_force": n,
            "power": n,
            "sigma": 1,
            "reaction_mean": 1,
            "glide": 1,
            "closure": 1,
        }
        edges = np.cumsum([0, *sizes.values()])
        return {k: slice(int(a), int(b)) for k, a, b in zip(sizes, edges, edges[1:], strict=False)}

    def quantities(self, stretch: Stretch, s: np.ndarray) -> np.ndarray:
        """All signals of a stretch, stacked in the order of _rows.

        Parameters
        ----------
        stretch : Stretch
            One of ``stretches``.
        s : ndarray, shape (m,)
            Times since its piece began.

        Returns
        -------
        ndarray, shape (rows, m)
        """
        drive, gait = self.drive, self.gait
        v, a = drive.kinematic(stretch.piece, stretch.leader, s)
        sigma = drive.sigma(v, a)
        w = np.zeros_like(s)
        if stretch.common is not None:
            w = stretch.common(s)[0]
            slope = -(drive.drag * w + sigma) / drive.mean_mass
            v, a = v + w, a + slope
        unloaded = -np.cumsum(drive.drag * v + drive.load + drive.mass[:, None] * a, axis=0)
        mean = np.zeros_like(s) if stretch.common is not None else sigma
        total = len(drive.mass) * mean
        if stretch.resting:
            loads = share_load(total, unloaded, stretch.resting, drive.sharing)
        else:
            loads = np.zeros_like(v)
        force = unloaded + np.cumsum(loads, axis=0)
        rate = gait.on_piece(stretch.piece, s, 1)
        return np.vstack(
            [
                gait.on_piece(stretch.piece, s, 0),
                rate,
                gait.on_piece(stretch.piece, s, 2),
                v,
                loads,
                force[:-1],
                -force[:-1] * rate,
                sigma,
                mean,
                w,
                force[-1:],
            ]
        )

    @cached_property
    def parts(self) -> tuple[tuple[Stretch, Series], ...]:
        """Stretches with their quantities as Chebyshev series, split where loads have kinks."""
        return tuple(part for stretch in self.stretches for part in self._resolve(stretch))

    def _resolve(self, stretch: Stretch) -> Iterator[tuple[Stretch, Series]]:
        degree = self.gait.degree
        kinked = self.drive.sharing == "least_actuation" and len(stretch.resting) > 1
        known = degree is not None and stretch.common is None and not kinked
        # power is the product of a force (degree - 1 at most) and a rate
        series = resolve(
            lambda s: self.quantities(stretch, s),
            stretch.start,
            stretch.stop,
            max(2 * (degree or 1) - 1, 1) if known else (24 if kinked else None),
        )
        tail = np.abs(series.coefficients[:, -2:]).max(axis=1)
        size = np.abs(series.coefficients).max(axis=1)
        rough = kinked and bool(np.any(tail > 1e-12 * np.maximum(size, self.drive.force_scale)))
        if not rough or stretch.stop - stretch.start < 1e-9 * self.gait.period:
            yield stretch, series
            return
        middle = (stretch.start + stretch.stop) / 2
        yield from self._resolve(replace(stretch, stop=middle))
        yield from self._resolve(replace(stretch, start=middle))

    def extremes(self, signal: str) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value of every row of a signal over the period.

        Parameters
        ----------
        signal : str
            ``length``, ``rate``, ``acceleration``, ``velocity``, ``reaction``,
            ``reaction_mean``, ``actuator_force``, ``power``, ``sigma``, ``glide`` or ``closure``.

        Returns
        -------
        low, high : ndarray, shape (rows,)
        """
        rows = range(*self._rows()[signal].indices(10**6))
        values = np.array([[s.extremes(r) for r in rows] for _, s in self.parts])
        return values[:, :, 0].min(axis=0), values[:, :, 1].max(axis=0)

    def integral(self, signal: str) -> np.ndarray:
        """Integral of every row of a signal over the period.

        Parameters
        ----------
        signal : str
            As for `extremes`.

        Returns
        -------
        ndarray, shape (rows,)
        """
        rows = self._rows()[signal]
        return np.sum([s.integral()[rows] for _, s in self.parts], axis=0)

    @cached_property
    def advance(self) -> float:
        """Distance per period."""
        return float(self.integral("velocity")[0])

    @property
    def force_scale(self) -> float:
        """Size of the forces at play: load, inertia and drag."""
        return self.drive.force_scale

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.advance / self.gait.period

    @property
    def resting_min(self) -> int:
        """Smallest number of masses at rest at any time."""
        return min(len(s.resting) for s in self.stretches)

    @property
    def resting_sequence(self) -> list[list[int]]:
        """Resting masses, phase after phase, over one period."""
        phases: list[list[int]] = []
        for stretch in self.stretches:
            if not phases or phases[-1] != list(stretch.resting):
                phases.append(list(stretch.resting))
        if len(phases) > 1 and phases[0] == phases[-1]:
            phases.pop()
        return phases

    @property
    def glides(self) -> list[tuple[float, float]]:
        """Begin and end of every glide; joined across pieces, but not across the period's end."""
        found: list[tuple[float, float]] = []
        for stretch in self.stretches:
            begin = float(self.gait.breaks[stretch.piece])
            if stretch.common is None:
                continue
            if found and abs(found[-1][1] - begin - stretch.start) < 1e-12 * self.gait.period:
                found[-1] = (found[-1][0], begin + stretch.stop)
            else:
                found.append((begin + stretch.start, begin + stretch.stop))
        return found

    @cached_property
    def energy(self) -> float:
        """Energy the actuators spend per period, nothing recovered."""
        rows = self._rows()
        total = 0.0
        for _, series in self.parts:
            primitive = series.primitive()
            for j in range(self.gait.links):
                at = [series.roots(rows[k].start + j) for k in ("actuator_force", "rate")]
                cuts = np.unique(np.concatenate([[series.a, series.b], *at]))
                work = np.diff(primitive(cuts)[rows["power"].start + j])
                total += float(work[work > 0].sum())
        return total

    @property
    def effort(self) -> float:
        """Mean over time of the sum of squared link accelerations."""
        total = 0.0
        rows = self._rows()["acceleration"]
        for _, series in self.parts:
            links = Series(series.a, series.b, series.coefficients[rows])
            total += _integral_of_squares(links)
        return total / self.gait.period

    @cached_property
    def net_work(self) -> float:
        """Net work of all actuators per period."""
        return float(self.integral("power").sum())

    @cached_property
    def dissipation(self) -> float:
        """Energy lost to drag and gained in height per period; spikes do no work."""
        rows, drive = self._rows()["velocity"], self.drive
        lost = 0.0
        for _, series in self.parts:
            velocities = Series(series.a, series.b, series.coefficients[rows])
            lost += _integral_of_squares(velocities)
        return drive.drag * lost + len(drive.mass) * drive.load * self.advance

    @cached_property
    def smallest_load(self) -> float:
        """Smallest load Gamma for which kinematics alone rules this gait; inf if none does."""
        if self.drops:
            return float("inf")
        low = min(self._inertia_and_drag(1.0))
        return max(0.0, -low)

    @cached_property
    def smallest_period(self) -> float:
        """Smallest period for which kinematics alone rules this shape of gait; inf if none does."""
        if self.drops:
            return float("inf")

        def least(quickness: float) -> float:
            return min(self._inertia_and_drag(quickness)) + self.drive.load

        fast = 1.0
        while least(fast) >= 0 and fast < 1e9:
            fast *= 4
        if fast >= 1e9:
            return 0.0
        slow = 0.0
        if self.drive.load == 0:
            # Only drag can hold the worm then, and where W0 comes to rest no slowness is enough.
            slow = 1.0
            while least(slow) < 0:
                slow /= 4
                if slow < 1e-6:
                    return float("inf")
        return self.gait.period / _root(least, slow, fast)

    def _inertia_and_drag(self, quickness: float) -> Iterator[float]:
        """Smallest values of sigma - Gamma, stretch by stretch, when the gait runs quicker."""
        drive = self.drive
        for stretch in self.stretches:

            def value(s: np.ndarray, stretch: Stretch = stretch) -> np.ndarray:
                v, a = drive.kinematic(stretch.piece, stretch.leader, s)
                inertia = drive.mass @ a / len(drive.mass)
                return (inertia * quickness**2 + drive.drag * v.mean(axis=0) * quickness)[None]

            degree = self.gait.degree
            series = resolve(value, stretch.start, stretch.stop, degree and max(degree, 1))
            yield series.extremes(0)[0]

    def sample(self, points: int = 600) -> dict[str, np.ndarray]:
        """Signals on a time grid in which both sides of every jump appear.

        Parameters
        ----------
        points : int, optional
            About how many instants over the period.

        Returns
        -------
        dict of ndarray
            ``time`` (m,), ``resting`` (n+1, m), ``position`` (n+1, m) and the signals of
            `extremes`, each with shape (rows, m).
        """
        times, values, resting, head, travelled = [], [], [], [], 0.0
        rows = self._rows()
        for stretch, series in self.parts:
            share = (stretch.stop - stretch.start) / self.gait.period
            s = np.linspace(stretch.start, stretch.stop, max(2, int(np.ceil(share * points)) + 1))
            times.append(self.gait.breaks[stretch.piece] + s)
            values.append(self.quantities(stretch, s))
            rest = np.zeros((len(self.drive.mass), len(s)), dtype=np.int32)
            rest[list(stretch.resting)] = 1
            resting.append(rest)
            path = series.primitive()(s)[rows["velocity"].start]
            head.append(travelled + path)
            travelled += float(path[-1])
        stacked = np.concatenate(values, axis=1)
        signals = {name: stacked[at] for name, at in rows.items()}
        spans = np.vstack([np.zeros(stacked.shape[1]), np.cumsum(signals["length"], axis=0)])
        return signals | {
            "time": np.concatenate(times),
            "resting": np.concatenate(resting, axis=1),
            "position": np.concatenate(head) - spans,
        }


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(root_scalar(function, bracket=(low, high), xtol=1e-15, rtol=1e-14).root)


def _integral_of_squares(series: Series) -> float:
    degree = max(2 * (series.coefficients.shape[1] - 1), 1)
    squares = resolve(lambda s: (series(s) ** 2).sum(axis=0)[None], series.a, series.b, degree)
    return float(squares.integral()[0])


def crawl(
    gait: Gait, mass: Sequence[float], drag: float, load: float, sharing: Sharing = "equal"
) -> Crawl:
    """Find the periodic motion that a gait gives a worm with spikes, (1)-(7).

    Parameters
    ----------
    gait : Gait
        Link lengths over time.
    mass : sequence of float, shape (n+1,)
        Point masses.
    drag, load : float
        Viscous drag k and load Gamma on every mass.
    sharing : {"equal", "least_actuation"}, optional
        How two or more resting masses share the load.

    Returns
    -------
    Crawl
        In mode 2 throughout, or with its glides and impulses found.

    Raises
    ------
    ValueError
        If the number of masses is not that of the links plus one.
    SolveError
        If no periodic motion is reached: the worm glides faster from period to period.

    Notes
    -----
    Without load and drag nothing stops a glide, and every faster one is a motion too; found is
    the one that starts from w = 0.

    Examples
    --------
    >>> import numpy as np
    >>> gait = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0, 1, -0.5]], [[1.0, -1, 0.5]]]))
    >>> motion = crawl(gait, [1.0, 1.0], drag=0.0, load=2.0)
    >>> round(motion.speed, 12), motion.resting_sequence
    (0.25, [[1], [0]])
    """
    if len(mass) != gait.links + 1:
        raise ValueError(f"{gait.links} links join {gait.links + 1} masses, not {len(mass)}")
    drive = _Drive(gait, np.asarray(mass, dtype=float), drag, load, sharing)
    cells = [cell for piece in range(gait.pieces) for cell in _cells(drive, piece)]
    w = 0.0
    for _ in range(500):
        stretches, impulses, drops, end = _one_period(drive, cells, w)
        if abs(end - w) <= 1e-13 * drive.rate_scale:
            return Crawl(gait, tuple(stretches), tuple(impulses), tuple(drops), drive)
        w = end
    raise SolveError(
        "the worm glides on from period to period and never settles",
        "raise worm.load or worm.drag, or choose a longer period",
    )


def _cells(drive: _Drive, piece: int) -> list[Stretch]:
    """Split a piece where the resting masses change."""
    width = float(drive.gait.breaks[piece + 1] - drive.gait.breaks[piece])
    degree = drive.gait.degree
    tie = 1e-10 * drive.rate_scale
    spans = resolve(lambda s: drive.spans(piece, s, 1), 0.0, width, degree and max(degree, 1))
    cuts, alike = [0.0, width], {i: {i} for i in range(len(drive.mass))}
    for i, j in combinations(alike, 2):
        gap = Series(0.0, width, (spans.coefficients[i] - spans.coefficients[j])[None])
        if np.abs(gap.coefficients).sum() <= tie:
            # The functions are analytic: masses that rest together do so on the whole piece.
            alike[i].add(j)
            alike[j].add(i)
            continue
        for root in gap.roots(0):
            values = spans(np.array([root]))[:, 0]
            if values[i] >= values.max() - 1e3 * tie:
                cuts.append(float(root))
    cells: list[Stretch] = []
    for a, b in pairwise(sorted(cuts)):
        if b - a <= 1e-12 * drive.gait.period and width > b - a:
            continue
        values = spans(a + (b - a) * np.array([0.1, 0.5, 0.9]))
        ahead = (values >= values.max(axis=0) - tie).all(axis=1)
        # Where curves only touch, round-off may not choose the leader: keep the one before.
        leader = (
            cells[-1].leader if cells and ahead[cells[-1].leader] else int(values[:, 1].argmax())
        )
        resting = tuple(sorted(alike[leader]))
        if cells and cells[-1].resting == resting:
            cells[-1] = replace(cells[-1], stop=b)
        else:
            begin = cells[-1].stop if cells else 0.0
            cells.append(Stretch(piece, begin, b, resting, resting[0]))
    cells[-1] = replace(cells[-1], stop=width)
    return _absorb_touching(cells, spans, tie)


def _absorb_touching(cells: list[Stretch], spans: Series, tie: float) -> list[Stretch]:
    """Let a first cell that is a mere touch begin with the next cell's resting masses."""
    while len(cells) > 1:
        first, second = cells[:2]
        values = spans(np.linspace(first.start, first.stop, 5))
        if np.any(values[second.leader] < values.max(axis=0) - tie):
            break
        cells = [replace(second, start=first.start), *cells[2:]]
    return cells


def _one_period(
    drive: _Drive, cells: list[Stretch], w: float
) -> tuple[list[Stretch], list[tuple[float, float]], list[float], float]:
    """Go once through the cells from common velocity ``w``; return also w at the end."""
    total = float(drive.mass.sum())
    still = 1e-11 * drive.rate_scale

    def momentum(cell: Stretch, s: float) -> float:
        v, _ = drive.kinematic(cell.piece, cell.leader, np.array([s]))
        return float(drive.mass @ v[:, 0]) / total

    stretches: list[Stretch] = []
    impulses: list[tuple[float, float]] = []
    drops: list[float] = []
    for k, cell in enumerate(cells):
        before = cells[k - 1]
        jump = momentum(cell, cell.start) - momentum(before, before.stop)
        if abs(jump) > 1e2 * still:
            time = float(drive.gait.breaks[cell.piece] + cell.start)
            w -= jump
            if jump < 0:
                drops.append(time)
            if w < 0:
                impulses.append((time, -w * total))
                w = 0.0
        for stretch in _glide_or_hold(drive, cell, w if w > still else 0.0):
            stretches.append(stretch)
            held = stretch.common is None
            w = 0.0 if held else float(stretch.common(np.array([stretch.stop]))[0, 0])  # type: ignore[misc]
            w = w if w > still else 0.0
    return stretches, impulses, drops, w


def _glide_or_hold(drive: _Drive, cell: Stretch, w: float) -> Iterator[Stretch]:
    """Split a cell into mode 2 (a mass rests) and mode 1 (the worm glides)."""
    degree = drive.gait.degree

    def driving(s: np.ndarray) -> np.ndarray:
        return drive.sigma(*drive.kinematic(cell.piece, cell.leader, s))[None]

    sigma = resolve(driving, cell.start, cell.stop, degree and max(degree, 1))
    edges = np.concatenate([[cell.start], sigma.roots(0), [cell.stop]])
    now, end = cell.start, cell.stop
    touch = 1e-9 * drive.force_scale
    while now < end:
        if w == 0.0:
            begin = _first_dip(sigma, edges, now, touch)
            if begin is None:
                yield replace(cell, start=now)
                return
            if begin > now:
                yield replace(cell, start=now, stop=begin)
            now = begin
        common = _free_motion(drive, sigma, now, end, w)
        # A glide ends where w falls through 0; at its start w is 0 too, but rising.
        falls = [r for r in common.roots(0) if r > now and sigma(np.array([r]))[0, 0] > 0]
        stop = float(falls[0]) if falls else end
        if stop > now:
            yield replace(cell, start=now, stop=stop, resting=(), common=common)
        now, w = stop, 0.0


def _first_dip(sigma: Series, edges: np.ndarray, now: float, touch: float) -> float | None:
    """First instant from ``now`` at which sigma goes below zero by more than a touch."""
    for a, b in pairwise(edges):
        low = max(float(a), now)
        if b <= low:
            continue
        part = sigma(np.linspace(low, float(b), 11))[0]
        if part.min() < -touch:
            return low
    return None


def _free_motion(drive: _Drive, sigma: Series, now: float, end: float, w: float) -> Series:
    """Solve m w' + k w + sigma = 0 from w(now): one integral, since sigma is known."""
    decay = drive.drag / drive.mean_mass

    def forcing(s: np.ndarray) -> np.ndarray:
        return np.exp(decay * (s - now)) * sigma(s) / drive.mean_mass

    lost = resolve(forcing, now, end).primitive()

    def common(s: np.ndarray) -> np.ndarray:
        return np.exp(-decay * (s - now)) * (w - lost(s))

    return resolve(common, now, end)
