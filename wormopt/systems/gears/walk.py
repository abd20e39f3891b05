"""Travel by a table of strokes: positions from their polynomials, loads from samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wormopt.systems.gears.box import GearBox, Row
from wormopt.systems.gears.gear import Gear
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.stroke import loads
from wormopt.systems.gears.supervisor import Supervisor

# Times in a stroke at which forces are sampled, with Gauss nodes for the means.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_LOOKS = np.concatenate([(_NODES + 1) / 2, np.linspace(0, 1, 33)])


@dataclass(frozen=True, eq=False)
class Walk:
    """Motion over the ground, stroke by stroke, with the peaks of each stroke."""

    row: np.ndarray  # (strokes,) rows of the table
    time: np.ndarray  # (strokes + 1,) start times, and the end
    place: np.ndarray  # (strokes + 1, n+1) of the masses at these times
    total: np.ndarray  # (strokes,) smallest total load of all spikes
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
    number, now = first, 0.0
    while places[-1].mean() < goal and now < longest:
        row = box.rows[number]
        s = row.stroke.duration * _LOOKS
        found = loads(box.mass, ground, row.stroke, s, places[-1])
        least.append(found.total.min())
        spikes.append(found.spike.max())
        forces.append(np.abs(found.actuator).max())
        count = len(_NODES)
        measured = np.array([found.total[:count], (found.actuator[:, :count] ** 2).sum(axis=0)])
        spike, force = row.stroke.duration / 2 * measured @ _WEIGHTS
        rows.append(number)
        now += row.stroke.duration
        times.append(now)
        places.append(places[-1] + row.stroke.way)
        number = choose(Done(row, number, now, float(spike), float(force)))
    arrival = _arrival(box.rows[rows[-1]], times, places, goal) if rows else 0.0
    return Walk(
        np.array(rows, dtype=int),
        np.array(times),
        np.array(places),
        np.array(least),
        np.array(spikes),
        np.array(forces),
        arrival,
    )


def _arrival(last: Row, times: list[float], places: list[np.ndarray], goal: float) -> float:
    """Time at which the goal is reached within the last stroke."""
    if places[-1].mean() < goal:
        return np.inf
    return times[-2] + last.stroke.until(goal - float(places[-2].mean()))


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
