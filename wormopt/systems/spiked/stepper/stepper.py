"""Stepping motors on threaded rods: the demand of a gait on them, and its smallest period.

They model the prototype in section 2.5 of Zimmermann et al. 2007. Extremes are those of the gait's
own functions of time, found as roots on every piece.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import Series, resolve
from wormopt.shown import enough
from wormopt.systems.spiked.stretches import at_breaks, exact_degree

_JUMP = 1e-9  # share of the largest length or rate: smaller jumps between pieces are round-off
_ACCEPTED = 1e-9  # relative amount by which a period may be below the smallest


@dataclass(frozen=True)
class Stepper:
    """A stepping motor that turns a threaded rod; all links have the same motor.

    Parameters
    ----------
    lead : float
        Travel along the rod per turn, m.
    steps_per_turn : int
        Full steps per turn.
    microsteps : int, optional
        Microsteps per full step; each pulse to the driver is one microstep.
    rate_max : float, optional
        Largest rate, turns/s.
    acceleration_max : float, optional
        Largest change of the rate, turns/s². If it is infinite, rates may jump.
    start_rate : float, optional
        Rate, turns/s, up to which the motor starts, stops and reverses without a ramp.
    hysteresis : float, optional
        Share of a microstep by which a length must be past the middle between two positions
        before the motor steps, 0 to 0.4. It avoids steps to and fro at short intervals if a
        length stays near such a middle; 0 is plain rounding.

    Raises
    ------
    ArgumentError
        If a number is out of range.

    Notes
    -----
    Pull-out curves of motors depend on the speed of the shaft, not on microstepping. Rates are
    therefore in turns, not in pulses.

    Examples
    --------
    >>> motor = Stepper(lead=2e-3, steps_per_turn=200, microsteps=2)
    >>> motor.travel
    5e-06
    """

    lead: float
    steps_per_turn: int
    microsteps: int = 1
    rate_max: float = float("inf")
    acceleration_max: float = float("inf")
    start_rate: float = 0.0
    hysteresis: float = 0.05

    def __post_init__(self) -> None:
        for name in ("steps_per_turn", "microsteps"):
            count = getattr(self, name)
            if isinstance(count, bool) or not isinstance(count, int) or count < 1:
                raise ArgumentError(f"{name} must be a whole number, 1 or above, not {count!r}")
        for name in ("lead", "rate_max", "acceleration_max"):
            if not getattr(self, name) > 0:
                raise ArgumentError(f"{name} must be above 0, not {getattr(self, name)!r}")
        if not np.isfinite(self.lead):
            raise ArgumentError(f"lead must be finite, not {self.lead!r}")
        if not 0 <= self.start_rate <= self.rate_max:
            raise ArgumentError(f"start_rate must be from 0 to rate_max, not {self.start_rate}")
        if not 0 <= self.hysteresis <= 0.4:
            raise ArgumentError(f"hysteresis must be from 0 to 0.4, not {self.hysteresis!r}")

    @property
    def travel(self) -> float:
        """Travel along the rod per microstep, m."""
        return self.lead / (self.steps_per_turn * self.microsteps)

    @property
    def pulses_per_turn(self) -> int:
        """Microsteps per turn."""
        return self.steps_per_turn * self.microsteps


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

    rate: np.ndarray  # (n,) largest, turns/s
    # (n,) largest above start_rate, turns/s²; inf if the rate jumps beyond start_rate
    acceleration: np.ndarray
    limits: tuple[Limit, ...]  # one per active limit of `Stepper`
    period: float  # of the gait

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
        """Raise SolveError if the motors cannot follow the gait.

        The message names the limit, the link, the time and the smallest period.
        """
        if self.feasible:
            return
        limit = self.strictest
        at = f"link {limit.link} at t = {limit.time:.6g}"
        allowed = f"motor.{limit.name} is {getattr(stepper, limit.name):g}"
        if limit.name == "rate_max":
            asked = f"{self.rate[limit.link]:.6g} turns/s from the motor of {at}, but {allowed}"
        elif limit.name == "acceleration_max":
            asked = (
                f"{self.acceleration[limit.link]:.6g} turns/s^2 from the motor of {at}, but "
                f"{allowed}"
            )
        else:
            asked = f"a jump of the rate from the motor of {at}, but {allowed} turns/s"
        if np.isfinite(limit.period_min):
            period = enough(limit.period_min, 4, _ACCEPTED / 2)
            suggestion = f"write gait.period = {period:g} or longer"
        else:
            suggestion = (
                "use a gait without corners (a profile with a ramp), or write motor.start_rate"
            )
        raise SolveError(f"the gait needs {asked}", suggestion, code="too_fast")


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
            over = np.sqrt(change / stepper.acceleration_max)
            if stepper.start_rate > 0:
                over = np.minimum(over, turns / stepper.start_rate)
            factors = {"rate_max": turns / stepper.rate_max, "acceleration_max": over}
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
    return Demand(rate, acceleration, tuple(strictest), gait.period)


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
    if np.isinf(stepper.acceleration_max):
        return
    after, before = at_breaks(gait, 1)
    for q, j in np.argwhere(np.abs(after - before) > _JUMP * size):
        faster = max(abs(after[q, j]), abs(before[q, j])) / stepper.lead
        yield int(j), float(gait.breaks[q]), float(faster)


def _instants(gait: Gait, stepper: Stepper, piece: int) -> list[np.ndarray]:
    """Times of a piece, for each link, that include those of its extreme demands."""
    width = float(gait.breaks[piece + 1] - gait.breaks[piece])
    first, second, third = (
        resolve(lambda s, k=k: gait.on_piece(piece, s, k), 0.0, width, exact_degree(gait))
        for k in (1, 2, 3)
    )
    ends = np.array([0.0, width])
    found = [[ends, second.roots(j), third.roots(j)] for j in range(gait.links)]
    start = stepper.start_rate * stepper.lead
    if start > 0:
        top = stepper.acceleration_max * stepper.lead
        for sign in (1.0, -1.0):
            series = [_shifted(first, -sign * start)]
            if np.isfinite(top):

                def alike(s: np.ndarray, sign: float = sign) -> np.ndarray:
                    rate, change = (gait.on_piece(piece, s, k) for k in (1, 2))
                    return change * start**2 / top + sign * rate**2

                series.append(resolve(alike, 0.0, width, exact_degree(gait, 2)))
            for j, of_link in enumerate(found):
                of_link += [one.roots(j) for one in series]
    return [np.concatenate(of_link) for of_link in found]


def _shifted(series: Series, by: float) -> Series:
    coefficients = series.coefficients.copy()
    coefficients[:, 0] += by
    return Series(series.a, series.b, coefficients)
