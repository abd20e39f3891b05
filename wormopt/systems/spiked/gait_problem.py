"""The problem of gait design: worm, limits, objective, and how to search and to prove.

Each class is a table of scenes and an object of Python. Keys, units, meanings, bounds and defaults
are declared here only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from math import comb
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, structs

from wormopt.errors import ArgumentError, Fault
from wormopt.model.given import per, wrong_order
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.types import (
    Loads,
    NonNegativePerMass,
    PairPerLink,
    PerLink,
    PerMass,
    PositiveOrPair,
    Seed,
)
from wormopt.systems.shared.incline import Gravity, Uphill, faults_of_slope, told_of_slope, weights

MOST_LINKS = 32
# Periods with a smaller relative difference are equal.
_ROUNDING = 1e-9
# Smaller shares of a tick are rounding; the largest number of ticks in a table.
_NO_TICK, _MOST_TICKS = Fraction(1, 10**6), 1_000_000

Cost = Literal[
    "peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort"
]
Effort = Literal["quick", "normal", "thorough"]
Sharing = Literal["equal", "least_actuation"]
Links = Annotated[
    int, Meta(ge=1, le=MOST_LINKS, description=f"a whole number from 1 to {MOST_LINKS}")
]
Resting = Annotated[int, Meta(ge=1, le=MOST_LINKS, description="a whole number, 1 or above")]
Order = Annotated[
    tuple[tuple[Annotated[int, Meta(ge=0, le=MOST_LINKS)], ...], ...],
    Meta(description="a list of lists of mass indices, for example [[0], [2], [1]]"),
]
COST_WORDS = (
    "`peak_spike_load` (force): largest load on one spike over time and masses; "
    "`peak_actuator_force` (force): largest |*μ*<sub>j</sub>| over time and links; "
    "`energy_per_distance`: ∫ Σ<sub>j</sub> max(0, *P*<sub>j</sub>) d*t* over a period divided by "
    "the advance, without recovery; `acceleration_effort` (acceleration squared): mean over time "
    "of Σ<sub>j</sub> *l*<sub>j</sub>″²"
)
_NO_OBJECTIVE = 'no objective is given; write maximise = "speed", or minimise and speed'


_MASS = "point masses *m*<sub>i</sub>; mass 0 is the head"


class Worm(Given, kw_only=False):
    """A chain of *n* + 1 point masses on the ground, joined by *n* links.

    The link lengths are prescribed. Spikes on every mass let it slide forward but never backward.

    Examples
    --------
    >>> worm = Worm(links=2, load=(2.0, 5.0))
    >>> worm.masses, worm.load_range
    ((1.0, 1.0, 1.0), (2.0, 5.0))
    """

    links: Links = entry("number of links *n*", quantity="count")
    mass: PerMass = entry(_MASS, quantity="mass", default=1.0, per="masses")
    drag: float = number("drag", "*k*: each mass has viscous drag −*k v*", least=0, default=0.0)
    load: Loads = entry(
        "*Γ*: force on each mass against the direction of motion (towed load, slope). A pair "
        "is a range and is allowed in designs only: the designed gait meets its limits over "
        "the whole range. Three or more numbers are the loads of the individual masses, head "
        "first. Example: a cable at the tail of a worm with two links is [0, 0, 0.3]",
        quantity="force",
        default=0.0,
    )
    pull: NonNegativePerMass | None = entry(
        "force on each mass in addition to `load`, one number for all or one per mass, for "
        "example beside a range of loads",
        quantity="force",
        default=None,
        per="masses",
    )
    slope: Uphill = 0.0
    gravity: Gravity = None

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of links and masses."""
        return {"links": self.links, "masses": self.links + 1}

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.mass, self.links + 1)

    @property
    def facts(self) -> dict[str, Any]:
        """Effect of the weight on a slope, for the trust report."""
        return told_of_slope(self.slope, self.gravity, self.masses)

    @property
    def load_range(self) -> tuple[float, float]:
        """Smallest and largest load on each mass; their mean over the masses if these differ.

        Both are equal if the load is known. The motion depends on the mean alone.
        """
        fixed = _mean(self._known)
        low, high = per(self.load, 2) if self._may_vary else (0.0, 0.0)
        return low + fixed, high + fixed

    @property
    def _may_vary(self) -> bool:
        """Whether the load is one number for all masses, or a range."""
        return not isinstance(self.load, tuple) or len(self.load) == 2

    @property
    def _known(self) -> tuple[float, ...]:
        """Force on each mass in addition to a number or range for all, weight included."""
        masses = self.links + 1
        known = [per(self.pull or 0.0, masses)]
        known += [weights(self.slope, self.gravity, self.masses)] if self.slope else []
        known += [] if self._may_vary else [per(self.load, masses)]
        return tuple(map(sum, zip(*known, strict=True)))

    @property
    def beyond(self) -> tuple[float, ...]:
        """Load of each mass minus the mean over all masses; they sum to 0."""
        mean = _mean(self._known)
        return tuple(each - mean for each in self._known)

    def loads(self, mean: float) -> float | tuple[float, ...]:
        """Load on each mass for a given mean; one number if all are equal.

        Parameters
        ----------
        mean : float
            Mean load, within `load_range`.

        Returns
        -------
        float or tuple of float, shape (n+1,)
        """
        beyond = self.beyond
        return tuple(mean + each for each in beyond) if any(beyond) else mean

    @property
    def on_level_ground(self) -> Worm:
        """The worm without slope, with its weight in `load`, or in `pull` if masses differ."""
        if not self.slope:
            return self
        weight, flat = weights(self.slope, self.gravity, self.masses), {"slope": 0.0}
        if len(set(weight)) == 1:
            load = self.load
            if isinstance(load, tuple):
                heavier = tuple(one + weight[0] for one in load)
            else:
                heavier = load + weight[0]
            return structs.replace(self, load=heavier, **flat)
        pull = per(self.pull or 0.0, len(weight))
        pull = tuple(a + b for a, b in zip(pull, weight, strict=True))
        return structs.replace(self, pull=pull, **flat)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a load that is neither a range nor one per mass."""
        if self._may_vary:
            yield from wrong_order("load", per(self.load, 2))
        else:
            yield from wrong_count("load", self.load, self.links + 1, "masses")

    def faults_in_scene(self, units: str, *, ranges: bool = False) -> Iterator[Fault]:
        """Yield what is wrong in a scene in `units`; `ranges`: whether the load may be a range.

        Parameters
        ----------
        units : str
            Units of the scene.
        ranges : bool, optional
            Whether the load may be a range.

        Yields
        ------
        tuple of (str, str)
        """
        yield from faults_of_slope(self.slope, self.gravity, units)
        if isinstance(self.load, tuple) and self._may_vary and not ranges:
            yield (
                "worm.load",
                "a range of loads is allowed in gait designs only; write one number, or one load "
                "for each of three or more masses",
            )


def _mean(each: tuple[float, ...]) -> float:
    """Mean of numbers; exact if they are equal."""
    return each[0] if len(set(each)) == 1 else sum(each) / len(each)


class SceneWorm(Worm):
    """The worm of a scene, which must say its masses."""

    mass: PerMass = entry(_MASS, quantity="mass", per="masses")


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
    """What messages call them."""

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

        Returns
        -------
        tuple of (float, float)
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
        """Yield the faults of a tick for a valid period."""
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

        Yields
        ------
        tuple of (str, str)
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
                f"missing, so velocities may jump; write {self.name}.acceleration or "
                f"{self.name}.impulses = true",
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


class Objective(Given, kw_only=False):
    """The objective: exactly one of `maximise` and `minimise`.

    Refused: no objective or two; `minimise` without `speed`; any cost with `impulses = true`, where
    costs are infinite; `energy_per_distance` and `acceleration_effort` with a range of loads,
    because they depend on the load.

    Examples
    --------
    Without arguments the mean speed is maximised:

    >>> Objective() == Objective.of("speed"), Objective.of("peak_spike_load", 0.5).speed
    (True, 0.5)
    """

    minimise: Cost | None = entry(
        f"minimise a cost at a required speed: {COST_WORDS}", default=None
    )
    speed: float | None = positive(
        "speed",
        "required mean speed, a lower bound; required with `minimise`, refused with `maximise`",
        default=None,
    )
    maximise: Literal["speed"] | None = entry("maximise the mean speed", default=None)

    @classmethod
    def of(cls, what: Literal["speed"] | Cost | Objective, speed: float | None = None) -> Objective:
        """Make an objective from its name.

        Parameters
        ----------
        what : str or Objective
            "speed", or the cost to minimise; an Objective is returned unchanged.
        speed : float, optional
            Required mean speed if a cost is minimised.

        Returns
        -------
        Objective

        Raises
        ------
        ArgumentError
            If `what` is an Objective and `speed` is given too.
        """
        if not isinstance(what, Objective):
            return cls(None if what == "speed" else what, speed)
        if speed is not None:
            raise ArgumentError("speed is given, but the objective has its own; remove one of them")
        return what

    @property
    def is_smooth(self) -> bool:
        """Whether it is energy or effort, for which there are no proofs and multipliers."""
        return _is_smooth(self.minimise)

    @property
    def quantity(self) -> str:
        """Physical quantity of the objective, a name for `unit_of`."""
        match self.minimise:
            case None:
                return "speed"
            case "energy_per_distance":
                return "energy_per_distance"
            case "acceleration_effort":
                return "acceleration_squared"
            case _:
                return "force"

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        if self.minimise is None and self.maximise is None:
            if self.speed is not None:
                yield "", _NO_OBJECTIVE
        elif self.minimise is not None and self.maximise is not None:
            yield "", "maximise and minimise are given; write only one of them"
        elif self.minimise is not None and self.speed is None:
            yield (
                "speed",
                "missing; minimise needs the required speed: write a finite number above 0",
            )
        elif self.maximise is not None and self.speed is not None:
            yield "speed", 'given with maximise = "speed"; remove one of them'

    def faults_in_scene(self) -> Iterator[Fault]:
        """Yield a fault of a scene that does not say its objective."""
        if self == Objective():
            yield "objective", _NO_OBJECTIVE


def _is_smooth(cost: Cost | None) -> bool:
    return cost in ("energy_per_distance", "acceleration_effort")


def faults_of_cost(cost: Cost | None, worm: Worm, limits: Limits) -> Iterator[str]:
    """Yield why a cost cannot be minimised for a worm within limits, each valid by itself."""
    if cost is not None and limits.impulses:
        yield (
            f"{cost} has no finite value with {limits.name}.impulses; remove "
            f"{limits.name}.impulses and write {limits.name}.acceleration"
        )
    low, high = worm.load_range
    if _is_smooth(cost) and low < high:
        yield (
            f"{cost} depends on the load, and worm.load is a range; write one load, or choose "
            "speed or a peak"
        )


class Certify(Given, kw_only=False):
    """Settings of a tighter bound on the objective of any gait, for kind `gait-design` only.

    The bound applies to every gait within the limits, with any resting sequence, number of phases
    and cycles. All keys have defaults; `certify = {}` is enough. [Certificates](../certificates.md)
    explains what is proven.

    Refused: objectives `energy_per_distance` and `acceleration_effort`; `want = ["certificate"]`
    without this table; kind `gait-pareto`.
    """

    gap: float = number(
        "share",
        "end when no gait can be better by more than this share",
        least=1e-05,
        most=0.5,
        default=1e-2,
    )
    time_limit: float = positive(
        "s", "end after this time with the gap reached so far", default=60.0
    )


class Search(Given):
    """Search over the sequences in which masses rest.

    Without `phases`, plain sequences are listed up to 4 phases and varied up to 12 phases.
    Constructed sequences have as many phases as they need; a travelling wave of *n* links has up to
    *n* + 1. [Theory](../theory-kinematic.md#84-the-search-over-orders) explains how sequences are
    tried.

    | effort | plain sequences, at most | sequences varied at a time, doubled after a round without gain | variations per round, at most | rounds without gain before the end | work, pivots times rows and columns | other starts (for a cost) | sequences sharpened |
    | --- | --- | --- | --- | --- | --- | --- | --- |
    | `quick` | 16 | 1 | 8 | 1 | 3e8 | 1 (1) | 1 |
    | `normal` | 160 | 4 | 240 | 2 | 7e8 | 1 (3) | 4 |
    | `thorough` | 1000 | 8 | 800 | 2 | 6e9 | 1 (8) | 8 |

    Half of the work is spent on plain sequences. Besides the best sequence, only those within 0.2 %
    of it are sharpened.

    Refused in `sequence`: fewer than two phases, or more than `phases`; a mass that does not exist
    or appears twice in a phase; fewer than `gait.resting` masses in a phase; the same masses in two
    neighbouring phases (the last and the first are neighbours). No mass may rest in all phases,
    because the worm could not advance.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> found = wo.design(wo.Worm(links=2, load=5.0), limits, search=Search(effort="quick", seed=1))
    >>> round(found.speed, 6)
    0.825667
    """  # noqa: E501

    seed: Seed = entry("seed of the random starts", default=0)
    effort: Effort = entry("extent of the search, see above", default="normal")
    phases: int | None = whole(2, 64, "largest number of phases of a cycle", default=None)
    sequence: Order | None = entry(
        "resting masses of each phase of a cycle; only this sequence is used", default=None
    )
    time_limit: float | None = positive(
        "s",
        "the search ends after this time and returns the best gait so far, with a warning and "
        "exit code 0. The time is checked between linear programs. Sequences already begun "
        "are still fitted to the period, which can take longer than the limit itself if there "
        "are many links",
        default=None,
    )
    workers: int | None = whole(
        1,
        1024,
        "processes of the search; default: 1 up to two links, else one per processor. The "
        "result does not depend on it",
        default=None,
    )
    gap: float = number(
        "share",
        "a search for speed ends when no gait can be faster by more than this, as proven "
        "before it begins by linear programs that take tenths of a second",
        least=1e-05,
        most=0.5,
        default=1e-3,
    )
    certify: Certify | None = entry(
        "tighter bound on the objective of any gait, for peak loads too", default=None
    )

    def faults_for(self, links: int, limits: Limits) -> Iterator[Fault]:
        """Yield name and message of the faults of the given sequence.

        Parameters
        ----------
        links : int
            Number of links.
        limits : Limits
            Limits of the gait.

        Yields
        ------
        tuple of (str, str)
        """
        sequence = self.sequence
        if sequence is None:
            return
        if len(sequence) < 2:
            yield "sequence", "fewer than two phases; write at least two"
            return
        for index, masses in enumerate(sequence):
            key = f"sequence[{index}]"
            if len(set(masses)) != len(masses):
                yield key, "names a mass twice; name it once"
            if any(mass > links for mass in masses):
                yield key, f"names a mass that does not exist; write indices 0 to {links}"
            if len(set(masses)) < limits.resting:
                yield (
                    key,
                    f"fewer resting masses than {limits.name}.resting = {limits.resting}; name "
                    "more",
                )
            if set(masses) == set(sequence[index - 1]):
                yield (
                    key,
                    "the same masses rest as in the phase before (the last is before the first); "
                    "write other masses",
                )
        for mass in sorted(set(sequence[0]).intersection(*sequence)):
            yield "sequence", f"mass {mass} rests in every phase; let it move in one"
        if self.phases is not None and len(sequence) > self.phases:
            yield (
                "sequence",
                f"{len(sequence)} phases, but search.phases = {self.phases}; write fewer phases, "
                "or increase search.phases",
            )


class GaitProblem(Given, kw_only=False):
    """A problem of gait design; it can be hashed and sent to other processes.

    Raises
    ------
    ArgumentError
        If values do not fit together; the message names them.

    Examples
    --------
    >>> limits = Limits(1.0, (0.7, 1.3), rate=(1.0, 1.0), impulses=True)
    >>> GaitProblem(Worm(links=3), limits)
    Traceback (most recent call last):
    wormopt.study.given.RefusedError: GaitProblem: limits.rate: 2 entries for 3 links; write one ...
    """

    worm: Worm = entry("masses, drag, load")
    limits: Limits = entry("limits of the gait")
    objective: Objective = entry("the objective; the mean speed by default", default=Objective)

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of links and masses."""
        return self.worm.counts

    @property
    def loads_matter(self) -> bool:
        """Whether a limit or the cost depends on how resting masses share the load."""
        limited = self.limits.spike_load is not None or self.limits.actuator_force is not None
        return limited or self.objective.minimise not in (None, "acceleration_effort")

    @property
    def resting_sizes(self) -> range:
        """Numbers of resting masses worth trying; more than required help to share a load."""
        fewest = self.limits.resting
        return range(fewest, self.worm.links + 1 if self.loads_matter else fewest + 1)

    @property
    def count_of_sets(self) -> int:
        """Number of sets of masses that may rest."""
        return sum(comb(self.worm.links + 1, size) for size in self.resting_sizes)

    @property
    def speed_nominal(self) -> float:
        """Nominal speed: the largest rate of a link."""
        return max(map(max, self.limits.rate_bounds(self.worm.links)))

    def key_of(self, path: str) -> str:
        """Key of a field, "limits.rate", as its user writes it: "gait.rate" in scenes.

        Parameters
        ----------
        path : str
            Path of the field in the problem.

        Returns
        -------
        str
        """
        part, _, name = path.partition(".")
        return f"{self.limits.name}.{name}" if part == "limits" else path

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what does not fit together."""
        for key, message in self.limits.faults_for(self.worm.links):
            yield f"limits.{key}".removesuffix("."), message
        for message in faults_of_cost(self.objective.minimise, self.worm, self.limits):
            yield "objective.minimise", message
