"""Limits of a gait: period, lengths, rates, accelerations, loads."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Literal, get_args

from wormopt.errors import Fault
from wormopt.model.given import (
    Frozen,
    Numbers,
    faults_of_number,
    faults_of_numbers,
    faults_of_whole,
    is_number,
    per,
    wrong_order,
)

# Periods with a smaller relative difference are equal.
_ROUNDING = 1e-9
# Smaller shares of a tick are rounding; the largest number of ticks in a table.
_NO_TICK, _MOST_TICKS = Fraction(1, 10**6), 1_000_000

Sharing = Literal["equal", "least_actuation"]


@dataclass(frozen=True)
class Rates(Frozen):
    """Limits on the rate of a link, separate for both directions.

    Parameters
    ----------
    contraction, extension : float or sequence of float
        Largest rates at which a link shortens and lengthens, one number for all links or one per
        link.

    Examples
    --------
    >>> import wormopt as wo
    >>> wo.Limits(period=1.0, length=(0.7, 1.3), rate=Rates(1.0, 0.5)).rate_limits(2)
    ((1.0, 1.0), (0.5, 0.5))
    """

    contraction: Numbers
    extension: Numbers


@dataclass(frozen=True)
class Limits(Frozen):
    """Limits that a gait must meet. A limit that is not given does not apply.

    All quantities are in one consistent system of units.

    Parameters
    ----------
    period : float or (float, float)
        The motion repeats after this time, or after a time in this range. One or more cycles fill
        it.
    length : (float, float) or sequence of such pairs
        Shortest and longest length, of all links or of each.
    resting : int, optional
        Smallest number of masses at rest at any time.
    rate : float, sequence of float or Rates, optional
        Largest rate of each link length.
    acceleration : float or sequence of float, optional
        Largest acceleration of each link length.
    spike_load : float or sequence of float, optional
        Largest load on a spike, one number for all masses or one per mass.
    actuator_force : float or sequence of float, optional
        Largest force of each actuator, one number for all links or one per link.
    sigma_margin : float, optional
        Lower bound on sigma of eq. 7 of Zimmermann et al. 2007, a force.
    sharing : {"equal", "least_actuation"}, optional
        Rule by which several resting masses share the spike load.
    impulses : bool, optional
        Whether velocities may jump; only without a limit on acceleration.
    tick : float, optional
        Tick of a controller, a time. A cycle is a whole number of ticks, so a table of lengths at
        the ticks repeats exactly.
    length_step : float, optional
        Lengths at the ticks are rounded to multiples of this step, in `Design.table` and in
        exports. The other limits apply before rounding.

    Examples
    --------
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> limits.length_ranges(2)
    ((0.7, 1.3), (0.7, 1.3))
    >>> limits.rate_limits(2)
    ((1.0, 1.0), (1.0, 1.0))
    """

    period: float | tuple[float, float]
    length: Sequence[Any]
    resting: int = 1
    rate: Numbers | Rates | None = None
    acceleration: Numbers | None = None
    spike_load: Numbers | None = None
    actuator_force: Numbers | None = None
    sigma_margin: float = 0.0
    sharing: Sharing = "equal"
    impulses: bool = False
    tick: float | None = None
    length_step: float | None = None

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period; equal if the period is fixed."""
        shortest, longest = per(self.period, 2)
        return shortest, longest

    def cycles_of(self, period: float) -> int:
        """Smallest number of cycles that fill the required period, even if they exceed its range.

        Parameters
        ----------
        period : float
            Shortest period of the motion.

        Returns
        -------
        int

        Examples
        --------
        >>> Limits(period=(1.0, 5.0), length=(0.7, 1.3), rate=1.0).cycles_of(0.4)
        3
        """
        return max(1, math.ceil(self.period_range[0] / period * (1.0 - _ROUNDING)))

    def ticks_of(self, period: float) -> tuple[int, ...]:
        """Numbers of ticks of a cycle next to a period: the nearest below and above it.

        Parameters
        ----------
        period : float
            Period of a cycle under the other limits.

        Returns
        -------
        tuple of int
            Two numbers, or one if the period is a whole number of ticks; empty without a tick.

        Examples
        --------
        >>> Limits(period=(1.0, 5.0), length=(0.7, 1.3), rate=1.0, tick=0.1).ticks_of(1.23)
        (12, 13)
        >>> Limits(period=1.0, length=(0.7, 1.3), rate=1.0, tick=0.1).ticks_of(1 / 3)
        (2, 5)
        """
        if self.tick is None:
            return ()
        fewest, most = self._ticks_of_period()

        def fits(ticks: int) -> bool:  # a multiple of it is within the range
            return most % ticks <= most - fewest

        below, above = whole_beside(period, self.tick)
        shorter = next((k for k in range(min(below, most), 0, -1) if fits(k)), None)
        longer = next((k for k in range(max(above, 1), most + 1) if fits(k)), None)
        return tuple(sorted({k for k in (shorter, longer) if k is not None}))

    def whole_ticks(self, count: int) -> float:
        """Duration of a number of ticks, rounded once.

        Parameters
        ----------
        count : int
            Number of ticks.

        Returns
        -------
        float
        """
        return float(count * Fraction(repr(float(self.tick or 0.0))))

    def without_ticks(self, period: float | tuple[float, float] | None = None) -> Limits:
        """Limits without tick and length step, optionally with another period.

        Parameters
        ----------
        period : float or (float, float), optional
            Replaces the period of the limits.

        Returns
        -------
        Limits
        """
        return replace(self, period=period or self.period, tick=None, length_step=None)

    def _ticks_of_period(self) -> tuple[int, int]:
        """Fewest and most ticks of the range of periods; fewest exceeds most if none fits."""
        shortest, longest = self.period_range
        tick = self.tick or math.inf
        return whole_beside(shortest, tick)[1], whole_beside(longest, tick)[0]

    def length_ranges(self, links: int) -> tuple[tuple[float, float], ...]:
        """Shortest and longest length of each link.

        Parameters
        ----------
        links : int
            Number of links.

        Returns
        -------
        tuple of (float, float)
        """
        one = all(not isinstance(item, tuple) for item in self.length)
        pairs = [self.length] * links if one else self.length
        return tuple((low, high) for low, high in pairs)

    def rate_limits(self, links: int) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Limits on contraction and on extension, one number per link each; None if not given.

        Parameters
        ----------
        links : int
            Number of links.

        Returns
        -------
        contraction, extension : tuple of float
        """
        if self.rate is None:
            return None
        if isinstance(self.rate, Rates):
            return per(self.rate.contraction, links), per(self.rate.extension, links)
        return per(self.rate, links), per(self.rate, links)

    def rate_bounds(self, links: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Largest contraction and extension rates, given or implied by length and acceleration.

        A link that oscillates within a range R with acceleration at most a is never faster than
        sqrt(a R), because it starts from and returns to rate 0 within that range.

        Parameters
        ----------
        links : int
            Number of links.

        Returns
        -------
        contraction, extension : tuple of float
            One number per link each.

        Examples
        --------
        >>> Limits(period=1.0, length=(0.75, 1.0), acceleration=16.0).rate_bounds(1)
        ((2.0,), (2.0,))
        """
        most = per(math.inf if self.acceleration is None else self.acceleration, links)
        ranges = self.length_ranges(links)
        implied = tuple(math.sqrt(a * (b[1] - b[0])) for a, b in zip(most, ranges, strict=True))
        given = self.rate_limits(links) or (implied, implied)
        contraction, extension = (tuple(map(min, way, implied)) for way in given)
        return contraction, extension

    def within(self, rate: float, acceleration: float, links: int) -> Limits:
        """Tighten the limits by the largest rate and acceleration of a motor.

        Parameters
        ----------
        rate, acceleration : float
            Largest rate and acceleration of every link length.
        links : int
            Number of links.

        Returns
        -------
        Limits

        Examples
        --------
        >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0)
        >>> both = limits.within(0.8, 5.0, 2)
        >>> both.rate_limits(2), both.acceleration
        (((0.8, 0.8), (0.8, 0.8)), (5.0, 5.0))
        """
        given = self.rate_limits(links) or ((rate,) * links,) * 2
        slower = [tuple(min(rate, limit) for limit in way) for way in given]
        weaker = per(acceleration if self.acceleration is None else self.acceleration, links)
        return replace(
            self,
            rate=Rates(*slower),
            acceleration=tuple(min(acceleration, limit) for limit in weaker),
        )

    def faults(self, links: int, prefix: str = "") -> Iterator[Fault]:
        """Yield name and message of every fault, for a worm with this number of links.

        Parameters
        ----------
        links : int
            Number of links.
        prefix : str, optional
            Prefix of names of limits in messages, for example "gait.".

        Yields
        ------
        tuple of (str, str)
        """
        wrong = [*faults_of_numbers("period", self.period, 2, "ends of a range")]
        if not wrong:
            wrong += wrong_order("period", self.period_range)
        yield from wrong or self._faults_of_tick(prefix)
        if is_number(self.resting, links + 1):
            yield (
                "resting",
                f"{self.resting} resting masses leave a worm of {links} links no mass to move; "
                f"write at most {links}",
            )
        else:
            yield from faults_of_whole("resting", self.resting, 1, links)
        if self.sharing not in get_args(Sharing):
            yield "sharing", f'{self.sharing!r} is not known; write "equal" or "least_actuation"'
        wrong = [*self._faults_of_length(links)]
        yield from wrong or self._faults_of_steps(links, prefix)
        yield from self._faults_of_lists(links)
        yield from self._faults_of_jumps(prefix)

    def _faults_of_tick(self, prefix: str) -> Iterator[Fault]:
        """Yield the faults of a tick for a valid period."""
        if self.tick is None:
            return
        shortest, longest = self.period_range
        if wrong := [*faults_of_number("tick", self.tick)]:
            yield from wrong
        elif shortest > _MOST_TICKS * self.tick:
            yield (
                "tick",
                f"{self.tick:g} is less than a millionth of {prefix}period = {shortest:g}; write "
                f"at least {shortest / _MOST_TICKS:g}",
            )
        else:
            fewest, most = self._ticks_of_period()
            if fewest <= most:
                return
            nearest = [f"{self.whole_ticks(k):.12g}" for k in (most, fewest) if k > 0]
            fixed = shortest == longest
            given = (
                f"{shortest:.12g} is" if fixed else f"[{shortest:.12g}, {longest:.12g}] contains"
            )
            yield (
                "period",
                f"{given} no whole number of ticks of {prefix}tick = {self.tick:.12g}; write "
                f"{' or '.join(nearest)}, or another tick",
            )

    def _faults_of_steps(self, links: int, prefix: str) -> Iterator[Fault]:
        step = self.length_step
        if step is None:
            return
        if wrong := [*faults_of_number("length_step", step)]:
            yield from wrong
        elif self.tick is None:
            yield "length_step", f"is given without {prefix}tick; write {prefix}tick too"
        else:
            ranges = self.length_ranges(links)
            few = [r for r in ranges if whole_beside(r[0], step)[1] >= whole_beside(r[1], step)[0]]
            if few:
                low, high = few[0]
                yield (
                    "length_step",
                    f"no two multiples of {step:g} are within {prefix}length [{low:g}, {high:g}]; "
                    f"write at most {(high - low) / 2:g}",
                )

    def _faults_of_length(self, links: int) -> Iterator[Fault]:
        given: Any = self.length if isinstance(self.length, tuple) else (self.length,)
        pairs = [item for item in given if isinstance(item, tuple)]
        numbers = [item for item in given if not isinstance(item, tuple)]
        if not pairs and len(numbers) == 2:
            pairs, names = [tuple(numbers)], ["length"]
        elif numbers or len(pairs) != links or any(len(pair) != 2 for pair in pairs):
            yield (
                "length",
                "the list is neither one range nor one per link; write [shortest, longest], or a "
                f"list of {links} such pairs",
            )
            return
        else:
            names = [f"length[{index}]" for index in range(links)]
        for name, pair in zip(names, pairs, strict=True):
            wrong = [*faults_of_numbers(name, pair, 2, "ends of a range")]
            yield from wrong or wrong_order(name, pair, may_be_equal=False)

    def _faults_of_lists(self, links: int) -> Iterator[Fault]:
        names = ("rate", "acceleration", "spike_load", "actuator_force")
        given = {name: v for name in names if (v := getattr(self, name)) is not None}
        if isinstance(self.rate, Rates):
            del given["rate"]
            given |= {f"rate.{way}": value for way, value in vars(self.rate).items()}
        for name, value in given.items():
            count, things = (links + 1, "masses") if name == "spike_load" else (links, "links")
            for key, message in faults_of_numbers(name, value, count, things):
                other = ", or Rates(contraction, extension)" if name == "rate" else ""
                yield key, message + other
        yield from faults_of_number("sigma_margin", self.sigma_margin, least=0.0)

    def _faults_of_jumps(self, prefix: str) -> Iterator[Fault]:
        if self.rate is None and self.acceleration is None:
            yield (
                "",
                f"neither {prefix}rate nor {prefix}acceleration is given; write {prefix}rate or "
                "both",
            )
        if self.acceleration is None and not self.impulses:
            yield (
                "acceleration",
                f"missing, so velocities may jump; write {prefix}acceleration or {prefix}impulses "
                "= true",
            )
        if not self.impulses:
            return
        if self.acceleration is not None:
            yield (
                "impulses",
                f"{prefix}acceleration forbids the jumps that impulses allow; remove one of them",
            )
        for key in ("actuator_force", "spike_load"):
            if getattr(self, key) is not None:
                yield (
                    "impulses",
                    f"true, but an impulse exceeds any {prefix}{key}; remove {prefix}impulses and "
                    f"write {prefix}acceleration",
                )


def whole_beside(value: float, step: float) -> tuple[int, int]:
    """Whole numbers of steps next to a value, below and above; equal if the value is one."""
    steps = Fraction(repr(float(value))) / Fraction(repr(float(step)))
    return math.floor(steps + _NO_TICK), math.ceil(steps - _NO_TICK)
