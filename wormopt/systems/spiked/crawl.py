"""The motion of a worm with spikes under a given gait: the bimodal system, solved in closed form.

The system is eq. 7 of Zimmermann et al. 2007. Between changes of the resting masses, everything is
a smooth explicit function of time. The times of change are roots of these functions. Gliding (mode
1) is a linear equation, and its solution is one integral. There is no time stepping.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.labelled import SampledMotion
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import Series, resolve
from wormopt.systems.spiked.limits import Sharing
from wormopt.systems.spiked.region import Region
from wormopt.systems.spiked.sharing import share_load
from wormopt.systems.spiked.stretches import (
    Drive,
    Stretch,
    at_breaks,
    exact_degree,
    periodic_stretches,
)


@dataclass(frozen=True, eq=False)
class Crawl(SampledMotion):
    """Periodic motion of a worm with spikes under a prescribed gait.

    `motion[name]` returns samples of a signal, one of `names`, at the times `motion.time`.
    """

    gait: Gait  # link lengths over time
    stretches: tuple[Stretch, ...]  # parts of the period with fixed resting masses, in order
    impulses: tuple[tuple[float, float], ...]  # time and size of each on the spikes, at corners
    # times at which the kinematic velocity W0 jumps down and the worm is thrown forward
    drops: tuple[float, ...]
    drive: Drive  # gait, masses, drag and load as functions of time

    @cached_property
    def _rows(self) -> dict[str, slice]:
        """Rows of each signal in `quantities`."""
        first = self.stretches[0]
        signals = self._signals(first, np.array([first.start]))
        edges = np.cumsum([0, *map(len, signals.values())]).tolist()
        return dict(zip(signals, map(slice, edges, edges[1:]), strict=False))

    __repr__ = SampledMotion.__repr__

    @property
    def _title(self) -> str:
        masses = len(self.drive.mass)
        return f"Crawl of {masses} masses (speed {self.speed:.6g}, at rest {self.resting_sequence})"

    @cached_property
    def _sampled(self) -> dict[str, np.ndarray]:
        return self.sample()

    @property
    def time(self) -> np.ndarray:  # pyright: ignore[reportIncompatibleVariableOverride]
        """About 600 times (m,) in a period, with both sides of every jump."""
        return self._sampled["time"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals."""
        return tuple(name for name in self._sampled if name != "time")

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (rows, m) of a signal of `sample`, at `time`."""
        if name not in self.names:
            raise UnknownNameError("the motion", "signal", [name], self.names)
        return self._sampled[name]

    def dimension(self, name: str) -> str:
        """Dimension of a signal's rows, "link" or "mass"."""
        return "link" if len(self[name]) == self.gait.links else "mass"

    def quantities(self, stretch: Stretch, s: np.ndarray) -> np.ndarray:
        """Rows (rows, m), signal after signal, at times `s` (m,) since the piece began."""
        return np.vstack([*self._signals(stretch, s).values()])

    def _signals(self, stretch: Stretch, s: np.ndarray) -> dict[str, np.ndarray]:
        """Signals of a stretch by name, shape (rows, m) each."""
        drive, gait = self.drive, self.gait
        v, a = drive.kinematic(stretch.piece, stretch.leader, s)
        sigma = drive.sigma(v, a)
        w = np.zeros_like(s)
        if stretch.common is not None:
            (w,) = stretch.common(s)
            slope = -(drive.drag * w + sigma) / drive.mean_mass
            v, a = v + w, a + slope
        load = drive.load + np.reshape(drive.beyond, (-1, 1))
        unloaded = -np.cumsum(drive.drag * v + load + drive.mass[:, None] * a, axis=0)
        mean = np.zeros_like(s) if stretch.common is not None else sigma
        total = len(drive.mass) * mean
        if stretch.resting:
            loads = share_load(total, unloaded, stretch.resting, drive.sharing, drive.spike_load)
        else:
            loads = np.zeros_like(v)
        force = unloaded + np.cumsum(loads, axis=0)
        rate = gait.on_piece(stretch.piece, s, 1)
        return {
            "length": gait.on_piece(stretch.piece, s),
            "rate": rate,
            "acceleration": gait.on_piece(stretch.piece, s, 2),
            "velocity": v,
            "reaction": loads,
            "actuator_force": force[:-1],
            "power": -force[:-1] * rate,
            "sigma": sigma[None],
            "reaction_mean": mean[None],
            "glide": w[None],
            "closure": force[-1:],
        }

    @cached_property
    def parts(self) -> tuple[tuple[Stretch, Series], ...]:
        """Stretches with their signals as Chebyshev series, split where loads have kinks."""
        return tuple(part for stretch in self.stretches for part in self._resolve(stretch))

    def _resolve(self, stretch: Stretch) -> Iterator[tuple[Stretch, Series]]:
        kinked = self.drive.sharing == "least_actuation" and len(stretch.resting) > 1
        # In mode 2 the power has the highest degree: it is the product of a force and a rate.
        degree = None if stretch.common else exact_degree(self.gait, 2)
        series = resolve(
            lambda s: self.quantities(stretch, s),
            stretch.start,
            stretch.stop,
            24 if kinked else degree,
        )
        tail = np.linalg.norm(series.coefficients[:, -2:], axis=1)
        size = np.linalg.norm(series.coefficients, axis=1)
        if not kinked or np.all(tail <= 1e-12 * np.maximum(size, self.drive.force_scale)):
            yield stretch, series
            return
        middle = (stretch.start + stretch.stop) / 2
        yield from self._resolve(replace(stretch, stop=middle))
        yield from self._resolve(replace(stretch, start=middle))

    def extremes(self, signal: str) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest values (rows,) of a signal over the period, not of its samples.

        Signals are ``length``, ``rate``, ``acceleration``, ``velocity``, ``reaction``, ``sigma``,
        ``reaction_mean``, ``actuator_force``, ``power``, ``glide`` and ``closure``.
        """
        if signal not in self._extremes:
            ends = np.array([series.extremes() for series in self._series(signal)])
            self._extremes[signal] = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
        low, high = self._extremes[signal]
        return low.copy(), high.copy()

    @cached_property
    def _extremes(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        return {}

    def _series(self, signal: str) -> Iterator[Series]:
        rows = self._rows[signal]
        for _, series in self.parts:
            yield Series(series.a, series.b, series.coefficients[rows])

    def integral(self, signal: str) -> np.ndarray:
        """Integral (rows,) of a signal of `extremes` over the period."""
        rows = self._rows[signal]
        return np.sum([s.integral()[rows] for _, s in self.parts], axis=0)

    @cached_property
    def advance(self) -> float:
        """Distance travelled per period."""
        return float(self.integral("velocity")[0])

    @property
    def force_scale(self) -> float:
        """Size of the forces: load, inertia and drag."""
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
        """Resting masses of each phase, over one period."""
        phases = [list(resting) for resting, _ in groupby(s.resting for s in self.stretches)]
        closed = phases[0] == phases[-1]
        return phases[:-1] or phases if closed else phases

    @property
    def glides(self) -> list[tuple[float, float]]:
        """Start and end of every glide; joined across pieces, but not across the period's end."""
        found, breaks = [], self.gait.breaks
        for held, together in groupby(self.stretches, lambda stretch: stretch.common is None):
            if not held:
                ends = [(breaks[s.piece] + s.start, breaks[s.piece] + s.stop) for s in together]
                found.append((float(ends[0][0]), float(ends[-1][1])))
        return found

    @property
    def corners(self) -> list[float]:
        """Times at which a link rate jumps, where actuator forces are impulses."""
        after, before = at_breaks(self.gait, 1)
        jumps = np.abs(after - before).max(axis=1)
        return self.gait.breaks[:-1][jumps > 1e-9 * self.drive.rate_scale].tolist()

    @cached_property
    def energy(self) -> float:
        """Energy spent by the actuators per period, without recovery."""
        total = 0.0
        for series in self._series("power"):
            primitive = series.primitive()
            for row in range(self.gait.links):
                cuts = np.array([series.a, *series.roots(row), series.b])
                total += float(np.maximum(np.diff(primitive(cuts)[row]), 0.0).sum())
        return total

    @property
    def effort(self) -> float:
        """Mean over time of the sum of squared link accelerations."""
        return sum(map(_integral_of_squares, self._series("acceleration"))) / self.gait.period

    @cached_property
    def net_work(self) -> float:
        """Net work of all actuators per period."""
        return float(self.integral("power").sum())

    @cached_property
    def dissipation(self) -> float:
        """Energy per period lost to drag and spent against the load; spikes do no work."""
        lost, drive = sum(map(_integral_of_squares, self._series("velocity"))), self.drive
        return drive.drag * lost + len(drive.mass) * drive.load * self.advance

    @cached_property
    def smallest_load(self) -> float:
        """Smallest load Gamma at which kinematics alone determines the motion; inf if none."""
        least = math.inf if self.drops else Region(self.drive).least_load(self.gait.period)
        return max(0.0, least)

    @cached_property
    def smallest_period(self) -> float:
        """Smallest period at which kinematics alone determines the motion; inf if none."""
        return math.inf if self.drops else Region(self.drive).least_period(self.drive.load)

    def sample(self, points: int = 600) -> dict[str, np.ndarray]:
        """Sample all signals at about `points` times, with both sides of every jump.

        Returns ``time`` (m,), ``resting`` (n+1, m), ``position`` (n+1, m) and the signals of
        `extremes`, each (rows, m).
        """
        times, values, resting, head, travelled = [], [], [], [], 0.0
        rows = self._rows
        for stretch, series in self.parts:
            share = (stretch.stop - stretch.start) / self.gait.period
            s = np.linspace(stretch.start, stretch.stop, int(np.ceil(share * points)) + 1)
            times.append(self.gait.breaks[stretch.piece] + s)
            values.append(self.quantities(stretch, s))
            rest = np.zeros((len(self.drive.mass), len(s)), dtype=np.int32)
            rest[list(stretch.resting)] = 1
            resting.append(rest)
            path = series.primitive()(s)[rows["velocity"].start]
            path -= path[0]  # rounding
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


def _integral_of_squares(series: Series) -> float:
    squares = resolve(lambda s: (series(s) ** 2).sum(axis=0)[None], series.a, series.b)
    return squares.integral().item()


def crawl(
    gait: Gait,
    mass: Sequence[float],
    drag: float,
    load: float | Sequence[float],
    sharing: Sharing = "equal",
    spike_load: float | Sequence[float] | None = None,
) -> Crawl:
    """Find the periodic motion of a worm with spikes under a gait.

    Parameters
    ----------
    gait : Gait
        Lengths of n links over time.
    mass : sequence of float, shape (n+1,)
        Point masses, head first.
    drag : float
        Viscous drag coefficient k of every mass: force over velocity.
    load : float or sequence of float, shape (n+1,)
        Load Gamma, a force against the direction of motion, on every mass or one for each.
    sharing : {"equal", "least_actuation"}, optional
        Rule by which two or more resting masses share the load.
    spike_load : float or sequence of float, shape (n+1,), optional
        Largest load that each spike can carry. With "least_actuation" the other spikes carry the
        remaining load, see `share_load`.

    Returns
    -------
    Crawl
        The motion, in mode 2 throughout or with its glides and impulses.

    Raises
    ------
    ArgumentError
        If the number of masses or loads is not n + 1.
    SolveError
        If there is no periodic motion, because the worm glides faster from period to period.

    Notes
    -----
    The equations are eqs. 1 to 7 of Zimmermann et al. 2007. Without load and drag nothing stops a
    glide, and a faster glide is a solution too; this function returns the one that starts from
    w = 0.

    Examples
    --------
    >>> import numpy as np
    >>> gait = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0, 1, -0.5]], [[1.0, -1, 0.5]]]))
    >>> motion = crawl(gait, [1.0, 1.0], drag=0.0, load=2.0)
    >>> round(motion.speed, 12), motion.resting_sequence
    (0.25, [[1], [0]])
    """
    if len(mass) != gait.links + 1:
        raise ArgumentError(
            f"mass has {len(mass)} entries, but {gait.links} links join {gait.links + 1} masses; "
            f"write {gait.links + 1} numbers"
        )
    loads = np.asarray(load, dtype=float)
    if loads.shape not in ((), np.shape(mass)):
        raise ArgumentError(
            f"load has {loads.size} entries for {len(mass)} masses; write one number, or one for "
            "each"
        )
    mean = float(loads.mean())
    own = loads - mean
    drive = Drive(gait, np.asarray(mass, dtype=float), drag, mean, sharing, spike_load, own)
    return Crawl(gait, *periodic_stretches(drive), drive)
