"""Limits of a gait: lengths, rates, accelerations, loads, ticks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, structs

from wormopt.errors import Fault
from wormopt.model.given import per, wrong_order
from wormopt.study.given import Given, entry, number, positive
from wormopt.study.types import PairPerLink, PerLink, PerMass, PositiveOrPair

MOST_LINKS = 32
# Periods with a smaller relative difference are equal.
_ROUNDING = 1e-9
# Smaller shares of a tick are rounding; the largest number of ticks in a table.
_NO_TICK, _MOST_TICKS = Fraction(1, 10**6), 1_000_000

Sharing = Literal["equal", "least_actuation"]
Resting = Annotated[int, Meta(ge=1, le=MOST_LINKS, description="a whole number, 1 or above")]


class Rates(Given, kw_only=False):
    """Limits on the rate of a link, separate for both directions.

    Examples
    --------
    >>> import wormopt as wo
    >>> wo.Limits(period=1.0, length=(0.7, 1.3), rate=Rates(1.0, 0.5)).rate_limits(2)
    ((1.0, 1.0), (0.5, 0.5))
    """

    contraction: PerLink = entry("largest −*l*′", quantity="speed", per="links")
    extension: PerLink = entry("largest *l*′", quantity="speed", per="links")


class Limits(Given, kw_only=False):
    """Limits that a gait must meet. A limit that is not given does not apply.

    Examples
    --------
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> limits.length_ranges(2)
    ((0.7, 1.3), (0.7, 1.3))
    >>> limits.rate_limits(2)
    ((1.0, 1.0), (1.0, 1.0))
    """

    name: ClassVar[str] = "limits"
    """Name in messages."""

    period: PositiveOrPair = entry(
        "the motion repeats after this time, one number or a range to choose from; the design "
        "fills it with the optimal number of equal cycles",
        quantity="time",
    )
    length: PairPerLink = entry("range of each link", quantity="length")
    resting: Resting = entry(
        "smallest number of masses at rest at any time, at most *n*", quantity="count", default=1
    )
    rate: PerLink | Rates | None = entry(
        "largest |*l*′|, one number for all links or one per link; or a table with "
        "`contraction` (largest −*l*′) and `extension` (largest *l*′), each a number or one "
        "per link",
        quantity="speed",
        default=None,
        per="links",
    )
    acceleration: PerLink | None = entry(
        "largest |*l*″|", quantity="acceleration", default=None, per="links"
    )
    spike_load: PerMass | None = entry(
        "largest load *λ*<sub>i</sub> on one spike; a single resting mass carries (*n* + 1) *λ*",
        quantity="force",
        default=None,
        per="masses",
    )
    actuator_force: PerLink | None = entry(
        "largest |*μ*<sub>j</sub>|", quantity="force", default=None, per="links"
    )
    sigma_margin: float = number(
        "force", "lower bound on *σ* of eq. 7 of Zimmermann et al. 2007", least=0, default=0.0
    )
    sharing: Sharing = entry(
        "how several resting masses share the load, see "
        "[theory](../theory-kinematic.md#87-sharing-in-a-design); with `least_actuation`, a "
        "spike at its `spike_load` leaves the remaining load to the others",
        default="equal",
    )
    impulses: bool = entry(
        "velocities may jump; refused together with `acceleration`, `spike_load`, "
        "`actuator_force` and all costs",
        default=False,
    )
    tick: float | None = positive(
        "time",
        "tick of a controller: a cycle is a whole number of ticks, so lengths exported at the "
        "ticks repeat exactly ([export](../export.md#gaits-for-a-controller)); at most a "
        "million ticks in the shortest period",
        default=None,
    )
    length_step: float | None = positive(
        "length",
        "with `tick`: lengths exported at the ticks are rounded to multiples of this step "
        "within `length`. For a stepping motor the step is `lead`/(`steps_per_turn` · "
        "`microsteps`). All other results belong to the gait before rounding",
        default=None,
    )

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

        Examples
        --------
        >>> Limits(period=(1.0, 5.0), length=(0.7, 1.3), rate=1.0).cycles_of(0.4)
        3
        """
        return max(1, math.ceil(self.period_range[0] / period * (1.0 - _ROUNDING)))

    def ticks_of(self, period: float) -> tuple[int, ...]:
        """Numbers of ticks of a cycle next to a period: the nearest below and above it.

        One if the period is a whole number of ticks; empty without a tick.

        Parameters
        ----------
        period : float
            Period of a cycle under the other limits.

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
        """
        return float(count * Fraction(repr(float(self.tick or 0.0))))

    def without_ticks(self, period: float | tuple[float, float] | None = None) -> Limits:
        """Limits without tick and length step, optionally with another period.

        Parameters
        ----------
        period : float or (float, float), optional
            Replaces the period of the limits.
        """
        return structs.replace(self, period=period or self.period, tick=None, length_step=None)

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
        """
        one = all(not isinstance(item, tuple) for item in self.length)
        pairs: Any = [self.length] * links if one else self.length
        return tuple((low, high) for low, high in pairs)

    def rate_limits(self, links: int) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Limits on contraction and on extension, one number per link each; None if not given.

        Parameters
        ----------
        links : int
            Number of links.
        """
        if self.rate is None:
            return None
        if isinstance(self.rate, Rates):
            return per(self.rate.contraction, links), per(self.rate.extension, links)
        return per(self.rate, links), per(self.rate, links)

    def rate_bounds(self, links: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Largest contraction and extension rate of each link, given or implied.

        A link that oscillates within a range R with acceleration at most a is never faster than
        sqrt(a R), because it starts from and returns to rate 0 within that range.

        Parameters
        ----------
        links : int
            Number of links.

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
        return structs.replace(
            self,
            rate=Rates(*slower),
            acceleration=tuple(min(acceleration, limit) for limit in weaker),
        )

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield periods without a tick, and a step without one."""
        yield from list(wrong_order("period", self.period_range)) or self._faults_of_tick()
        if self.length_step is not None and self.tick is None:
            yield "length_step", f"is given without {self.name}.tick; write {self.name}.tick too"

    def _faults_of_tick(self) -> Iterator[Fault]:
        if self.tick is None:
            return
        shortest, longest = self.period_range
        if shortest > _MOST_TICKS * self.tick:
            yield (
                "tick",
                f"{self.tick:g} is less than a millionth of {self.name}.period = {shortest:g}; "
                f"write at least {shortest / _MOST_TICKS:g}",
            )
            return
        fewest, most = self._ticks_of_period()
        if fewest <= most:
            return
        nearest = [f"{self.whole_ticks(k):.12g}" for k in (most, fewest) if k > 0]
        fixed = shortest == longest
        given = f"{shortest:.12g} is" if fixed else f"[{shortest:.12g}, {longest:.12g}] contains"
        yield (
            "period",
            f"{given} no whole number of ticks of {self.name}.tick = {self.tick:.12g}; write "
            f"{' or '.join(nearest)}, or another tick",
        )

    def faults_for(self, links: int, *, motor: bool = False) -> Iterator[Fault]:
        """Yield name and message of what does not fit a worm with this number of links.

        Parameters
        ----------
        links : int
            Number of links.
        motor : bool, optional
            Whether a motor limits rates and accelerations too.
        """
        if self.resting > links:
            yield (
                "resting",
                f"{self.resting} resting masses leave a worm of {links} links no mass to move; "
                f"write at most {links}",
            )
        yield from list(self._faults_of_length(links)) or self._faults_of_steps(links)
        if self.rate is None and self.acceleration is None and not motor:
            yield (
                "",
                f"neither {self.name}.rate nor {self.name}.acceleration is given; write "
                f"{self.name}.rate or both",
            )
        if self.acceleration is None and not self.impulses and not motor:
            yield (
                "acceleration",
                f"missing, so velocities may jump; write {self.name}.acceleration",
            )
        if not self.impulses:
            return
        if self.acceleration is not None:
            yield (
                "impulses",
                f"{self.name}.acceleration forbids the jumps that impulses allow; remove one of "
                "them",
            )
        for key in ("actuator_force", "spike_load"):
            if getattr(self, key) is not None:
                yield (
                    "impulses",
                    f"true, but an impulse exceeds any {self.name}.{key}; remove "
                    f"{self.name}.impulses and write {self.name}.acceleration",
                )

    def _faults_of_length(self, links: int) -> Iterator[Fault]:
        pairs = [item for item in self.length if isinstance(item, tuple)]
        if not pairs and len(self.length) == 2:
            yield from wrong_order("length", self.length_ranges(1)[0], may_be_equal=False)
        elif len(pairs) != len(self.length) or len(pairs) != links:
            yield (
                "length",
                "the list is neither one range nor one per link; write [shortest, longest], or a "
                f"list of {links} such pairs",
            )
        else:
            for index, pair in enumerate(pairs):
                yield from wrong_order(f"length[{index}]", pair, may_be_equal=False)

    def _faults_of_steps(self, links: int) -> Iterator[Fault]:
        if (step := self.length_step) is None:
            return
        for low, high in self.length_ranges(links):
            if whole_beside(low, step)[1] >= whole_beside(high, step)[0]:
                yield (
                    "length_step",
                    f"no two multiples of {step:g} are within {self.name}.length [{low:g}, "
                    f"{high:g}]; write at most {(high - low) / 2:g}",
                )
                return


def whole_beside(value: float, step: float) -> tuple[int, int]:
    """Whole numbers of steps next to a value, below and above; equal if the value is one."""
    steps = Fraction(repr(float(value))) / Fraction(repr(float(step)))
    return math.floor(steps + _NO_TICK), math.ceil(steps - _NO_TICK)


class GaitLimits(Limits):
    """Limits that the designed gait must meet. A limit that is not given does not apply.

    *σ* ≥ 0 holds in every design, so the worm never glides.

    Refused: a reversed range of periods or loads; a period, or range of periods, that contains no
    whole number of ticks; an empty length range; `resting` above *n*; lists of the wrong length;
    neither `rate` nor `acceleration`; no `acceleration` without `impulses = true`; `impulses =
    true` together with `acceleration` (which forbids jumps) or `actuator_force` (which every
    impulse exceeds).
    """

    name: ClassVar[str] = "gait"
