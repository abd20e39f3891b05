"""Stepping motors on threaded rods: the demand of a gait on them, and its smallest period.

They model the prototype in section 2.5 of Zimmermann et al. 2007. Extremes are those of the gait's
own functions of time, found as roots on every piece.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from wormopt.errors import ArgumentError, Fault, SolveError
from wormopt.study import Given, number, on_use, positive, value, whole

with on_use():
    import numpy as np

    from wormopt.model.gait import Gait
    from wormopt.numerics.chebyshev import resolve
    from wormopt.shown import enough
    from wormopt.systems.spiked.stretches import at_breaks, exact_degree

_JUMP = 1e-9  # share of the largest length or rate: smaller jumps between pieces are round-off
_ACCEPTED = 1e-9  # relative amount by which a period may be below the smallest


class Stepper(Given, kw_only=False):
    """A stepping motor that turns a threaded rod; all links have the same motor.

    Notes
    -----
    Pull-out curves of motors depend on the speed of the shaft, not on microstepping. Rates are
    therefore in turns, not in pulses. Without `rate_max` any rate is possible, without
    `acceleration_max` rates may jump.

    Examples
    --------
    >>> motor = Stepper(lead=2e-3, steps_per_turn=200, microsteps=2)
    >>> motor.travel
    5e-06
    """

    lead: float = positive("length", "travel along the rod per turn")
    steps_per_turn: int = whole(1, 100000, "full steps per turn", default=200)
    microsteps: int = whole(1, 100000, "microsteps per full step", default=1)
    rate_max: float | None = positive("rate", "largest rate, turns per time", default=None)
    acceleration_max: float | None = positive(
        "rate_change", "largest change of the rate, turns per time squared", default=None
    )
    start_rate: float = number(
        "rate",
        "rate up to which the motor starts, stops and reverses without a ramp",
        least=0,
        default=0.0,
    )
    hysteresis: float = number(
        "share",
        "hysteresis as a share of a microstep: distance by which a length must pass the "
        "middle between two positions before the motor steps",
        least=0,
        most=0.4,
        default=0.05,
    )

    @property
    def rate_limit(self) -> float:
        """Largest rate, turns per time; infinite without a limit."""
        return math.inf if self.rate_max is None else self.rate_max

    @property
    def acceleration_limit(self) -> float:
        """Largest change of the rate, turns per time squared; infinite without a limit."""
        return math.inf if self.acceleration_max is None else self.acceleration_max

    @property
    def length_rate(self) -> float:
        """Largest rate of a length."""
        return self.lead * self.rate_limit

    @property
    def length_acceleration(self) -> float:
        """Largest acceleration of a length."""
        return self.lead * self.acceleration_limit

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a start rate that is too large."""
        if self.start_rate > self.rate_limit:
            yield (
                "start_rate",
                f"{self.start_rate:g} is above motor.rate_max = {self.rate_max:g}; write at most "
                "motor.rate_max",
            )

    @property
    def travel(self) -> float:
        """Travel along the rod per microstep, m."""
        return self.lead / (self.steps_per_turn * self.microsteps)

    @property
    def pulses_per_turn(self) -> int:
        """Microsteps per turn."""
        return self.steps_per_turn * self.microsteps


class Motor(Stepper):
    """A stepping motor on a threaded rod; all links have the same motor."""

    rate_max: float = positive("rate", "largest rate, turns per time")
    acceleration_max: float = positive(
        "rate_change", "largest change of the rate, turns per time squared"
    )


@dataclass(frozen=True)
class Limit:
    """Smallest period under one limit of the motors."""

    name: str  # rate_max, acceleration_max or start_rate (rate jumps)
    period_min: float  # smallest period at which the gait's shape meets it; inf: none
    link: int  # the critical link, from 0
    time: float  # the critical time, in the gait at its own period


@dataclass(frozen=True, eq=False)
class Demand:
    """Demand of a gait on its motors."""

    limits: tuple[Limit, ...]  # one per active limit of `Stepper`
    turn_rate_max: np.ndarray = value("rate", "largest rate of each motor, turns per second")
    acceleration_max: np.ndarray = value(
        "rate_change",
        "largest acceleration of each motor above `start_rate`, turns/s²; unknown (infinite) "
        "at a jump of the rate",
    )
    period: float = value("time", "period of the gait")

    @property
    def strictest(self) -> Limit:
        """The limit that needs the longest period."""
        return max(self.limits, key=lambda limit: limit.period_min)

    @property
    def period_min(self) -> float:
        """Smallest period at which the motors can follow this shape."""
        return self.strictest.period_min

    @property
    def feasible(self) -> bool:
        """Whether the motors can follow the gait at its own period."""
        return self.period >= self.period_min * (1 - _ACCEPTED)

    def refuse(self, stepper: Stepper) -> None:
        """Raise SolveError if the motors cannot follow the gait."""
        if self.feasible:
            return
        limit = self.strictest
        at = f"link {limit.link} at t = {limit.time:.6g}"
        allowed = f"motor.{limit.name} is {getattr(stepper, limit.name):g}"
        if limit.name == "rate_max":
            rate = self.turn_rate_max[limit.link]
            needed = f"{rate:.6g} turns/s from the motor of {at}, but {allowed}"
        elif limit.name == "acceleration_max":
            needed = (
                f"{self.acceleration_max[limit.link]:.6g} turns/s^2 from the motor of {at}, but "
                f"{allowed}"
            )
        else:
            needed = f"a jump of the rate from the motor of {at}, but {allowed} turns/s"
        if np.isfinite(limit.period_min):
            period = enough(limit.period_min, 4, _ACCEPTED / 2)
            suggestion = f"write gait.period = {period:g} or longer"
        else:
            suggestion = (
                "use a gait without corners (a profile with a ramp), or write motor.start_rate"
            )
        raise SolveError(f"the gait needs {needed}", suggestion, code="too_fast")


def demand(gait: Gait, stepper: Stepper) -> Demand:
    """Compute the demand of a gait on the motors, and the smallest period they can follow.

    Any change is feasible up to start_rate: the smallest factor on the period is max over t of
    min(sqrt(|l''|/a_max), |l'|/start). Raises ArgumentError if a length jumps.
    """
    _refuse_jumps(gait)
    n = gait.links
    instants = [_instants(gait, stepper, q) for q in range(gait.pieces)]
    rate, acceleration = np.zeros(n), np.zeros(n)
    limits: list[Limit] = []
    for j in range(n):
        for q, of_links in enumerate(instants):
            s = of_links[j]
            turns = np.abs(gait.on_piece(q, s, 1)[j]) / stepper.lead
            change = np.abs(gait.on_piece(q, s, 2)[j]) / stepper.lead
            free = turns < stepper.start_rate * (1 - 1e-12)
            rate[j] = max(rate[j], float(turns.max()))
            acceleration[j] = max(acceleration[j], float(np.where(free, 0.0, change).max()))
            begin, period = float(gait.breaks[q]), gait.period
            over = np.sqrt(change / stepper.acceleration_limit)
            if stepper.start_rate > 0:
                over = np.minimum(over, turns / stepper.start_rate)
            factors = {"rate_max": turns / stepper.rate_limit, "acceleration_max": over}
            for name, factor in factors.items():
                k = int(factor.argmax())
                limits.append(Limit(name, period * float(factor[k]), j, begin + float(s[k])))
    for j, time, turns in _corners(gait, stepper, float(rate.max()) * stepper.lead):
        least = turns / stepper.start_rate if stepper.start_rate > 0 else np.inf
        limits.append(Limit("start_rate", gait.period * least, j, time))
        if least > 1 + _ACCEPTED:
            acceleration[j] = np.inf
    names = dict.fromkeys(limit.name for limit in limits)
    strictest = (
        max((k for k in limits if k.name == name), key=lambda k: k.period_min) for name in names
    )
    return Demand(tuple(strictest), rate, acceleration, gait.period)


def _refuse_jumps(gait: Gait) -> None:
    after, before = at_breaks(gait, 0)
    gap = np.abs(after - before)
    if gap.max() > _JUMP * np.abs(before).max():
        q, j = np.unravel_index(int(gap.argmax()), gap.shape)
        raise ArgumentError(
            f"the length of link {j} jumps by {gap[q, j]:.3g} at t = {gait.breaks[q]:.6g}, which "
            "no motor can follow; give a gait with continuous lengths"
        )


def _corners(gait: Gait, stepper: Stepper, size: float) -> Iterator[tuple[int, float, float]]:
    """Link, time and larger of both rates, turns/s, of every jump that needs start_rate."""
    if np.isinf(stepper.acceleration_limit):
        return
    after, before = at_breaks(gait, 1)
    for q, j in np.argwhere(np.abs(after - before) > _JUMP * size):
        faster = max(abs(after[q, j]), abs(before[q, j])) / stepper.lead
        yield int(j), float(gait.breaks[q]), float(faster)


def _instants(gait: Gait, stepper: Stepper, piece: int) -> list[np.ndarray]:
    """Times of a piece, for each link, that include those of its extreme demands."""
    width = float(gait.breaks[piece + 1] - gait.breaks[piece])
    second, third = (
        resolve(lambda s, k=k: gait.on_piece(piece, s, k), 0.0, width, exact_degree(gait))
        for k in (2, 3)
    )
    ends = np.array([0.0, width])
    found = [[ends, second.roots(j), third.roots(j)] for j in range(gait.links)]
    start, top = stepper.start_rate * stepper.lead, stepper.acceleration_limit * stepper.lead
    for sign in (1.0, -1.0) if start > 0 else ():

        def over(s: np.ndarray, sign: float = sign) -> np.ndarray:
            return gait.on_piece(piece, s, 1) - sign * start

        def alike(s: np.ndarray, sign: float = sign) -> np.ndarray:
            rate, change = (gait.on_piece(piece, s, k) for k in (1, 2))
            return change * start**2 / top + sign * rate**2

        series = [resolve(over, 0.0, width, exact_degree(gait))]
        series += [resolve(alike, 0.0, width, exact_degree(gait, 2))] if np.isfinite(top) else []
        for j, of_link in enumerate(found):
            of_link += [one.roots(j) for one in series]
    return [np.concatenate(of_link) for of_link in found]
