"""Rivals of a design: plain blocks, and currents by the mean field, each tuned fully.

Both are tuned by the same full simulation as the design: a block in its length, distance to the
next, rate, amount and delay; the mean-field wave in amplitude, length, rate and delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Literal

import numpy as np

from wormopt.numerics.compass import Look, Point, compass
from wormopt.numerics.workers import Workers
from wormopt.systems.coils.design.mean_field import wave_pattern
from wormopt.systems.coils.design.pattern import block
from wormopt.systems.coils.design.task import Judged, Task

Sort = Literal["block", "wave"]
_RATES = 6
_AMPLITUDES = (0.4, 0.5, 0.6, 0.7)
_ON = (2, 3, 4)
_AMOUNTS = (1.0, 0.7, 0.5)  # shares of the limit, if power counts
_ROUNDS = 4


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

    compass(look, start, steps, bounds, _ROUNDS)
    return max(most, key=lambda one: one.value)
