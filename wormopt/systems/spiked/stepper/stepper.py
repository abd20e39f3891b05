"""Stepping motors on threaded rods, chapter 2.5: what a gait asks of them, and how fast it may be.

The extremes are those of the gait's own functions of time, found as roots on every piece.
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

_JUMP = 1e-9  # of the largest length or rate: smaller jumps between pieces are round-off
_ACCEPTED = 1e-9  # by so much of itself a period may be below the smallest


@dataclass(frozen=True)
class Stepper:
    """A stepping motor that turns a threaded rod; every link has one of its kind.

    Parameters
    ----------
    lead : float
        Way along the rod per turn, m.
    steps_per_turn : int
        Full steps per turn.
    microsteps : int, optional
        Microsteps per full step; each pulse to the driver is one.
    rate_max : float, optional
        Largest rate, turns/s.
    acceleration_max : float, optional
        Largest change of the rate, turns/s²; where it is infinite, rates may jump.
    start_rate : float, optional
        Up to this rate, turns/s, the motor starts, stops and reverses at once.
    hysteresis : float, optional
        Share of a microstep by which a length must be past the middle between two positions
        before the motor steps, 0 to 0.4. It keeps a length that lingers at such a middle from
        being answered by a step to and fro at short intervals; 0 is plain rounding.

    Raises
    ------
    ArgumentError
        If a number is out of range.

    Notes
    -----
    Pull-out curves of motors are given over the speed of the shaft, which does not depend on
    microstepping: hence turns, not pulses.

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
            raise ArgumentError("lead must be finite")
        if not 0 <= self.start_rate <= self.rate_max:
            raise ArgumentError(f"start_rate must lie within 0 and rate_max, not {self.start_rate}")
        if not 0 <= self.hysteresis <= 0.4:
            raise ArgumentError(f"hysteresis must lie within 0 and 0.4, not {self.hysteresis!r}")

    @property
    def travel(self) -> float:
        """Way along the rod per microstep, m."""
        return self.lead / (self.steps_per_turn * self.microsteps)

    @property
    def pulses_per_turn(self) -> int:
        """Microsteps per turn."""
        return self.steps_per_turn * self.microsteps


@dataclass(frozen=True)
class Limit:
    """What one limit of the motors says of the period."""

    name: str  # rate_max, acceleration_max or start_rate (rate jumps)
    period_min: float  # at which the gait's shape keeps it; inf: none does
    link: int  # that decides, from 0
    time: float  # when it does, in the gait as it is


@dataclass(frozen=True, eq=False)
class Demand:
    """What a gait asks of its motors."""

    rate: np.ndarray  # (n,) largest, turns/s
    # (n,) largest above start_rate, turns/s²; inf where the rate jumps beyond start_rate
    acceleration: np.ndarray
    limits: tuple[Limit, ...]  # one per limit of `Stepper` that says something
    period: float  # of the gait

    @property
    def strictest(self) -> Limit:
        """The limit that asks for the longest period."""
        return max(self.limits, key=lambda limit: limit.period_min)

    @property
    def period_min(self) -> float:
        """Smallest period at which motors follow this shape."""
        return self.strictest.period_min

    @property
    def feasible(self) -> bool:
        """Whether the motors follow the gait as it is."""
        return self.period >= self.period_min * (1 - _ACCEPTED)

    def refuse(self, stepper: Stepper) -> None:
        """Raise SolveError if the motors cannot follow.

        It names the limit, the link, the time and the smallest period.
        """
        if self.feasible:
            return
        limit = self.strictest
        at = f"link {limit.link} at t = {limit.time:.6g}"
        allowed = f"motor.{limit.name} is {getattr(stepper, limit.name):g}"
        if limit.name == "rate_max":
            asked = f"{self.rate[limit.link]:.6g} turns/s of the motor of {at}, and {allowed}"
        elif limit.name == "acceleration_max":
            asked = (
                f"{self.acceleration[limit.link]:.6g} turns/s^2 of the motor of {at}, and {allowed}"
            )
        else:
            asked = f"a jump of the rate of the motor of {at}, and {allowed} turns/s"
        if np.isfinite(limit.period_min):
            period = enough(limit.period_min, 4, _ACCEPTED / 2)
            suggestion = f"write gait.period = {period:g} or longer"
        else:
            suggestion = (
                "take a gait without corners (a profile with a ramp), or give motor.start_rate"
            )
        raise SolveError(f"the gait asks for {asked}", suggestion, code="too_fast")


def demand(gait: Gait, stepper: Stepper) -> Demand:
    """Find what a gait asks of the motors, and the smallest period they can follow.

    Up to start_rate any change is followed: the least factor on the period is max over t of
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
            f"the length of link {j} jumps by {gap[q, j]:.3g} at t = {gait.breaks[q]:.6g}: "
            "no motor follows that"
        )


def _corners(gait: Gait, stepper: Stepper, size: float) -> Iterator[tuple[int, float, float]]:
    """Link, time and the larger of both rates, turns/s, of every jump that is no motor's."""
    if np.isinf(stepper.acceleration_max):
        return
    after, before = at_breaks(gait, 1)
    for q, j in np.argwhere(np.abs(after - before) > _JUMP * size):
        faster = max(abs(after[q, j]), abs(before[q, j])) / stepper.lead
        yield int(j), float(gait.breaks[q]), float(faster)


def _instants(gait: Gait, stepper: Stepper, piece: int) -> list[np.ndarray]:
    """Of each link, the instants of a piece among which its extreme demands are."""
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
