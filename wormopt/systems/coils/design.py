"""Search for currents that carry a float fastest, or with least power, and their rivals.

An evolution strategy starts from the best plain blocks and the best mean-field waves, and a compass
search follows, with every value of one coil's waveform and the rate free. The result is a local
optimum: a better pattern may exist. The rivals are tuned by the same full simulation as the design:
a block in its length, distance to the next, rate, amount and delay; the mean-field wave in
amplitude, length, rate and delay.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Literal

import numpy as np

from wormopt.numerics.direct_search import Look, Point, compass, evolve
from wormopt.numerics.workers import Workers
from wormopt.progress import Report
from wormopt.systems.coils.patterns import Form, Pattern, Rides, block, wave_pattern
from wormopt.systems.coils.tables import Copper, DesignSearch

Seek = Literal["speed", "power"]
# Penalty: a relative shortfall of the speed counts as this multiple of it in power of all coils.
_PENALTY = 10.0
Sort = Literal["block", "wave"]
_RATES = 6
_AMPLITUDES = (0.4, 0.5, 0.6, 0.7)
_ON = (2, 3, 4)
_AMOUNTS = (1.0, 0.7, 0.5)  # shares of the limit, if power counts
_TUNING_ROUNDS = 4
# Values are relative to the limit; a unit of the rate's variable is two of its logarithm.
_RATE_UNIT, _FIRST_STEP = 2.0, 0.2
_COMPASS_STEP, _ROUNDS = 0.05, 2


@dataclass(frozen=True, eq=False)
class Judged:
    """A pattern, and its results."""

    pattern: Pattern
    name: str  # sort of the pattern, or of its origin
    speed: float  # m/s, mean of the float; -inf if the simulation fails
    power: float  # W, mean
    value: float  # objective, to maximise


@dataclass(frozen=True)
class Task:
    """Objective and limits."""

    rides: Rides
    copper: Copper
    seek: Seek
    form: Form
    per_step: int  # values per step
    rates: tuple[float, float]  # steps per second
    speed: float | None = None  # m/s, required; for seek = "power"
    slew: float | None = None  # ampere-turns per second

    @property
    def limit(self) -> float:
        """Largest ampere-turns of a coil."""
        return self.rides.row.coil.ampere_turns

    def judge(self, job: tuple[str, Pattern]) -> Judged:
        """Simulate film and float under a pattern, scaled to its limits."""
        name, pattern = job[0], job[1].kept(self.limit, self.slew)
        speed = self.rides.speed(pattern)
        power = self.copper.power(self.rides.row, pattern)
        return Judged(pattern, name, speed, power, self.value(speed, power))

    def value(self, speed: float, power: float) -> float:
        """Return the objective: the speed, or the power saved if the speed is met."""
        if self.seek == "speed" or not np.isfinite(speed):
            return speed
        assert self.speed is not None
        most = self.copper.resistance(self.rides.row) * self.rides.row.count * self.limit**2
        return -power / most - _PENALTY * max(0.0, 1 - speed / self.speed)


def best(found: Iterable[Judged]) -> Judged:
    """Return the pattern with the largest value."""
    return max(found, key=lambda one: one.value)


# -- rivals ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rival:
    """A block of `size` coils, or a wave of the amplitude `size`."""

    sort: Sort
    repeat: int
    size: float
    rate: float
    amount: float = 1.0  # share of the limit, of a block
    later: float = 0.0  # share of the period

    def judge(self, task: Task) -> Judged | None:
        """Compute its currents, and simulate film and float; None if there are none."""
        rides = task.rides
        if self.sort == "block":
            found = block(
                round(self.size), self.amount * task.limit, self.rate, self.repeat,
                task.per_step, task.form,
            )  # fmt: skip
        else:
            found = wave_pattern(
                rides.layer, rides.row, rides.ground, self.size, self.rate, self.repeat,
                task.per_step, form=task.form, slew=task.slew,
            )  # fmt: skip
        return None if found is None else task.judge((self.sort, found.later(self.later)))


def rivals(task: Task, repeats: Sequence[int], workers: Workers) -> list[Judged]:
    """Return the best block and the best wave of each length, tuned, best first."""
    rates = np.geomspace(*task.rates, _RATES).tolist()
    amounts = _AMOUNTS if task.seek == "power" else (1.0,)
    tried = [
        Rival("block", repeat, on, rate, amount)
        for repeat in repeats
        for on in _ON
        if on < repeat
        for rate, amount in product(rates, amounts)
    ]
    tried += [
        Rival("wave", repeat, delta, rate)
        for repeat in repeats
        for delta, rate in product(_AMPLITUDES, rates)
    ]
    judged = list(workers.map(partial(_judge, task), tried))
    found = []
    for sort, repeat in product(("block", "wave"), repeats):
        group = [
            (one, rival)
            for one, rival in zip(judged, tried, strict=True)
            if one is not None and (rival.sort, rival.repeat) == (sort, repeat)
        ]
        if group:
            first = max(group, key=lambda pair: pair[0].value)
            found.append(_tuned(task, *first, workers))
    return sorted(found, key=lambda one: -one.value)


def _judge(task: Task, rival: Rival) -> Judged | None:
    return rival.judge(task)


def _tuned(task: Task, judged: Judged, rival: Rival, workers: Workers) -> Judged:
    """Tune rate, delay, and amplitude or amount, by a compass search."""
    most: list[Judged] = [judged]
    sized = "size" if rival.sort == "wave" else "amount"
    start = {"log_rate": np.log(rival.rate), "later": 0.0, sized: getattr(rival, sized)}
    spread = np.log(task.rates[1] / task.rates[0]) / (_RATES - 1)
    steps = {"log_rate": spread / 2, "later": 0.25, sized: 0.05}
    bounds = {"log_rate": tuple(np.log(task.rates)), "later": (-0.5, 0.5), sized: (0.05, 1.0)}

    def look(points: Sequence[Point]) -> list[Look]:
        jobs = [
            Rival(
                rival.sort, rival.repeat, point.get("size", rival.size),
                float(np.exp(point["log_rate"])), point.get("amount", rival.amount),
                point["later"],
            )
            for point in points
        ]  # fmt: skip
        found = list(workers.map(partial(_judge, task), jobs))
        most.extend(one for one in found if one is not None)
        return [
            Look(point, -np.inf if one is None else one.value, 0.0)
            for point, one in zip(points, found, strict=True)
        ]

    compass(look, start, steps, bounds, _TUNING_ROUNDS)
    return max(most, key=lambda one: one.value)


# -- the search ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Found:
    """Result of one start."""

    start: Judged
    end: Judged
    course: np.ndarray  # best value after each generation


def starts_of(rivals: Sequence[Judged], count: int) -> list[Judged]:
    """Return `count` rivals: the best block, the best wave, then the next best ones."""
    best_of = {one.name: one for one in reversed(rivals)}
    first = [best_of[name] for name in sorted(best_of)]
    return [*first, *(one for one in rivals if one not in first)][:count]


def search(
    task: Task, starts: Sequence[Judged], effort: DesignSearch, workers: Workers, report: Report
) -> list[Found]:
    """Return the searches from every start, best first."""
    found = []
    for k, start in enumerate(starts):
        report(f"search {k + 1} of {len(starts)}, from the best {start.name}", k / len(starts))
        found.append(_from(task, start, effort, effort.seed + k, workers))
    return sorted(found, key=lambda one: -one.end.value)


def _from(task: Task, start: Judged, effort: DesignSearch, seed: int, workers: Workers) -> Found:
    seen: dict[bytes, Judged] = {}

    def judge(points: np.ndarray) -> list[Judged]:
        jobs = [(start.name, _pattern(task, start, point)) for point in points]
        found = list(workers.map(task.judge, jobs))
        seen.update(zip((point.tobytes() for point in points), found, strict=True))
        return found

    free = len(start.pattern.values)
    first = np.append(start.pattern.values / task.limit, np.log(start.pattern.rate) / _RATE_UNIT)
    low, high = np.full(free + 1, -1.0), np.full(free + 1, 1.0)
    low[-1], high[-1] = np.log(task.rates) / _RATE_UNIT
    evolved = evolve(
        lambda points: np.array([one.value for one in judge(points)]), first, _FIRST_STEP,
        (low, high), effort.generations, size=effort.size, seed=seed,
    )  # fmt: skip
    names = [str(k) for k in range(free + 1)]

    def look(points: Sequence[Point]) -> list[Look]:
        found = judge(np.array([[point[name] for name in names] for point in points]))
        return [Look(p, one.value, 0.0) for p, one in zip(points, found, strict=True)]

    bounds = {name: (float(low[k]), float(high[k])) for k, name in enumerate(names)}
    last = compass(
        look, dict(zip(names, evolved.point.tolist(), strict=True)),
        dict.fromkeys(names, _COMPASS_STEP), bounds, _ROUNDS,
    )[-1]  # fmt: skip
    point = np.array([last.point[name] for name in names])
    return Found(start, seen[point.tobytes()], evolved.course)


def _pattern(task: Task, start: Judged, point: np.ndarray) -> Pattern:
    rate = float(np.exp(_RATE_UNIT * point[-1]))
    return replace(start.pattern, values=task.limit * point[:-1], rate=rate)


def neighbours(task: Task, pattern: Pattern, share: float, workers: Workers) -> list[Judged]:
    """Return results of patterns with one value changed by a share of the limit, or the rate.

    All are within the limits, like the design.
    """
    jobs = []
    for sign in (share, -share):
        jobs += [
            replace(pattern, values=pattern.values + sign * task.limit * one)
            for one in np.eye(len(pattern.values))
        ]
        jobs.append(pattern.paced(1 + sign, task.rates))
    return list(workers.map(task.judge, [("neighbour", job) for job in jobs]))
