"""Travel by a table of strokes, and the supervisor that chooses gears by measured loads.

Positions are those of the strokes' polynomials, loads are samples. The supervisor compares measured
loads of spikes and actuators with thresholds over whole cycles. Over a cycle, the mean load of all
spikes is (n+1)(k speed + load) for any gait. The mean square of the actuator forces increases with
the load too. Each of them gives the load on each mass, and thus the peak loads in this gear and in
the next. A single stroke also gives the load on the masses, by the balance of impulses. On rising
ground it responds first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wormopt.systems.gears.box import GearBox, Row
from wormopt.systems.gears.gear import Gear, Ground, Limits, loads


@dataclass(frozen=True, eq=False)
class Supervisor:
    """Thresholds of each gear on measured means: above `down` it shifts down, below `up` up.

    The means over a cycle are those of the total spike load and of the sum of squared actuator
    forces. A decision needs a whole cycle in the gear, and `dwell` since the last shift. An
    impulse of all spikes over a stroke above `alarm` requests the slower gear immediately.
    """

    spike_down: np.ndarray  # (gears,) -> slower
    spike_up: np.ndarray  # (gears,) -> faster
    actuator_down: np.ndarray  # (gears,)
    actuator_up: np.ndarray  # (gears,)
    alarm: np.ndarray  # (rows,) of the table of strokes
    dwell: float

    def decide(self, gear: int, spike: float, actuator: float) -> int:
        """Gear wanted after a cycle with these measured means."""
        if spike > self.spike_down[gear] or actuator > self.actuator_down[gear]:
            return gear - 1
        if spike < self.spike_up[gear] and actuator < self.actuator_up[gear]:
            return gear + 1
        return gear


def supervise(box: GearBox, limits: Limits, *, down: float, up: float, dwell: float) -> Supervisor:
    """Set thresholds such that peak loads in a gear stay within a share `down` of the limits.

    The next faster gear is selected if its peaks would stay below a share `up`, less than `down`,
    which gives the hysteresis.
    """
    gears = box.gears
    most = [gear.bears(limits.times(down)) for gear in gears]
    spike_down, actuator_down = _measures(gears, most)
    borne = [gear.bears(limits.times(up)) for gear in gears[1:]]
    spike_up, actuator_up = _measures(gears[:-1], borne)
    # the slowest gear has none below it, the fastest none above it
    spike_down[0] = actuator_down[0] = np.inf
    return Supervisor(
        spike_down,
        np.append(spike_up, -np.inf),
        actuator_down,
        np.append(actuator_up, -np.inf),
        np.array([_alarm(row, gears[row.gear], min(most[row.gear])) for row in box.rows]),
        dwell,
    )


def _alarm(row: Row, gear: Gear, most: float) -> float:
    """Impulse of all spikes over a stroke at the load `most`; none in the slowest gear."""
    if row.gear == 0 or row.shifting:
        return np.inf
    ends = row.stroke.at(np.array([0.0, row.stroke.duration]))
    gained = gear.mass @ (ends[:, 1] - ends[:, 0])
    return float(gained + gear.drag * row.stroke.way.sum() + len(ends) * most * row.stroke.duration)


def _measures(
    gears: tuple[Gear, ...], borne: list[tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Measured means in gears at the load limits of spikes, and at those of actuators."""
    spike = [gear.spike_mean(most) for gear, (most, _) in zip(gears, borne, strict=True)]
    force = [
        gear.actuator_square(most) if np.isfinite(most) else most
        for gear, (_, most) in zip(gears, borne, strict=True)
    ]
    return np.array(spike), np.array(force)


# Times in a stroke at which forces are sampled, with Gauss nodes for the means.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_LOOKS = np.concatenate([(_NODES + 1) / 2, np.linspace(0, 1, 33)])


@dataclass(frozen=True, eq=False)
class Walk:
    """Motion over the ground, stroke by stroke, with the peaks of each stroke."""

    row: np.ndarray  # (strokes,) rows of the table
    time: np.ndarray  # (strokes + 1,) start times, and the end
    place: np.ndarray  # (strokes + 1, n+1) of the masses at these times
    total: np.ndarray  # (strokes,) smallest total load of all spikes, until the arrival
    spike: np.ndarray  # (strokes,) largest load of a spike
    actuator: np.ndarray  # (strokes,) largest actuator force
    arrival: float  # time at which the mean of the masses reaches the goal; inf if it does not


@dataclass(frozen=True, eq=False)
class Done:
    """A finished stroke with its measured loads."""

    row: Row
    number: int  # of the row
    time: float  # now
    spike: float  # integral over the stroke of the total spike load
    actuator: float  # integral of the squared actuator forces


Choose = Callable[[Done], int]
"""Next row of the table, at the end of a stroke."""


def walk(
    box: GearBox,
    ground: Ground,
    begin: np.ndarray,
    first: int,
    choose: Choose,
    goal: float,
    longest: float,
) -> Walk:
    """Travel from positions `begin` (n+1,) until the mean reaches `goal`, or to time `longest`."""
    rows, times, places = [], [0.0], [begin]
    least, spikes, forces = [], [], []
    number, now, arrival = first, 0.0, np.inf
    while np.isinf(arrival) and now < longest:
        row = box.rows[number]
        span, left = row.stroke.duration, goal - float(places[-1].mean())
        if row.stroke.way.mean() >= left:
            span = row.stroke.until(left)
            arrival = now + span
        s = span * _LOOKS
        found = loads(box.mass, ground, row.stroke, s, places[-1])
        least.append(found.total.min())
        spikes.append(found.spike.max())
        forces.append(np.abs(found.actuator).max())
        count = len(_NODES)
        measured = np.array([found.total[:count], (found.actuator[:, :count] ** 2).sum(axis=0)])
        spike, force = span / 2 * measured @ _WEIGHTS
        rows.append(number)
        now += row.stroke.duration
        times.append(now)
        places.append(places[-1] + row.stroke.way)
        number = choose(Done(row, number, now, float(spike), float(force)))
    return Walk(
        np.array(rows, dtype=int),
        np.array(times),
        np.array(places),
        np.array(least),
        np.array(spikes),
        np.array(forces),
        arrival,
    )


class Supervised:
    """Row selection of a supervisor; an independent implementation of that in `model`."""

    def __init__(self, box: GearBox, supervisor: Supervisor) -> None:
        self._box, self._supervisor = box, supervisor
        self._wanted: int | None = None
        self._whole = True
        self._shifted = -np.inf
        self._sums = np.zeros(2)

    def __call__(self, done: Done) -> int:
        """Next row; decides at the end of a cycle, and on an alarm of a stroke."""
        row, now = done.row, done.time
        self._sums += done.spike, done.actuator
        wanted = row.gear if self._wanted is None else self._wanted
        ripe = now - self._shifted >= self._supervisor.dwell * (1 - 1e-12)
        if row.ends_cycle:
            gear: Gear = self._box.gears[row.gear]
            if self._whole and ripe:
                wanted = self._supervisor.decide(row.gear, *(self._sums / gear.period))
            self._whole, self._sums = True, np.zeros(2)
        if ripe and done.spike > self._supervisor.alarm[done.number]:
            wanted = min(wanted, row.gear - 1)
        following = row.follows
        if wanted < row.gear and row.slower is not None:
            following = row.slower
        elif wanted > row.gear and row.faster is not None:
            following = row.faster
        self._wanted = wanted
        if self._box.rows[following].gear != row.gear:
            self._whole, self._shifted, self._sums = False, now, np.zeros(2)
        return following


def kept(done: Done) -> int:
    """Keep the gear."""
    return done.row.follows


def by_schedule(rows: tuple[int, ...]) -> Choose:
    """Follow a schedule, and keep the gear after its end."""
    left = iter(rows[1:])
    return lambda done: next(left, done.row.follows)
