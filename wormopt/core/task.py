"""What the design of a gait is asked for: worm, limits, objective, and how to search."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from typing import Any, Literal

from wormopt.errors import ArgumentError, Fault

__all__ = [
    "MOST_LINKS",
    "Certify",
    "Cost",
    "Limits",
    "Objective",
    "Rates",
    "Search",
    "Sharing",
    "Task",
    "Worm",
    "per",
]

MOST_LINKS = 32

Cost = Literal[
    "peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort"
]
Sharing = Literal["equal", "least_actuation"]
Numbers = float | Sequence[float]


def per(value: Numbers, count: int) -> tuple[float, ...]:
    """One number for each of `count` things, from one number or a list.

    Parameters
    ----------
    value : float or sequence of float
        A list is given back as it is, as a tuple.
    count : int
        How many are needed.

    Examples
    --------
    >>> per(2.0, 3)
    (2.0, 2.0, 2.0)
    """
    return tuple(value) if isinstance(value, Iterable) else (value,) * count


def _frozen(value: Any) -> Any:
    """Lists as tuples, at any depth, so that tasks can be compared and hashed."""
    if isinstance(value, Iterable) and not isinstance(value, str):
        return tuple(_frozen(item) for item in value)
    return value


class _Frozen:
    """Base of what users write: whatever is given as a list or an array is kept as a tuple."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:  # pyright: ignore[reportAttributeAccessIssue]
            object.__setattr__(self, name, _frozen(getattr(self, name)))


@dataclass(frozen=True)
class Worm(_Frozen):
    """A chain of point masses with spikes, whose link lengths are prescribed, (1)-(7).

    Parameters
    ----------
    links : int
        Number of links n, 1 to 32; the masses are n + 1.
    mass : float or sequence of float, optional
        Mass, alike for all or one per mass, head first.
    drag : float, optional
        Viscous drag coefficient of each mass.
    load : float or (float, float), optional
        Force against the direction of motion on each mass (slope, towed load); a pair is a
        range: what is designed must hold for every load in it.

    Examples
    --------
    >>> worm = Worm(links=2, load=(2.0, 5.0))
    >>> worm.masses, worm.load_range
    ((1.0, 1.0, 1.0), (2.0, 5.0))
    """

    links: int
    mass: Numbers = 1.0
    drag: float = 0.0
    load: float | tuple[float, float] = 0.0

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.mass, self.links + 1)

    @property
    def load_range(self) -> tuple[float, float]:
        """Smallest and largest load on each mass; equal where the load is known."""
        low, high = per(self.load, 2)
        return low, high

    def faults(self) -> Iterator[Fault]:
        """Yield field and message of whatever is wrong."""
        if not (isinstance(self.links, Integral) and 1 <= self.links <= MOST_LINKS):
            yield "links", f"not {self.links}; write a whole number from 1 to {MOST_LINKS}"
            return
        yield from _faults_of_numbers("mass", self.mass, self.links + 1, "masses")
        yield from _faults_of_numbers("drag", self.drag, 1, "worms", least=0.0)
        yield from _faults_of_numbers("load", self.load, 2, "ends of a range", least=0.0)
        if len(per(self.load, 2)) == 2:
            yield from _wrong_order("load", self.load_range)


@dataclass(frozen=True)
class Rates(_Frozen):
    """Limits on the rate of a link, apart for both directions.

    Parameters
    ----------
    contraction, extension : float or sequence of float
        How fast a link may shorten and lengthen at most, alike for all or one per link.
    """

    contraction: Numbers
    extension: Numbers


@dataclass(frozen=True)
class Limits(_Frozen):
    """What a gait must keep to. Limits left out do not hold.

    Parameters
    ----------
    period : float or (float, float)
        The motion repeats after this time, or after one between these; one or more cycles fill
        it.
    length : (float, float) or sequence of such pairs
        Shortest and longest length, of every link or of each.
    resting : int, optional
        At least so many masses rest at any time.
    rate : float, sequence of float or Rates, optional
        Limit on the rate of each link.
    acceleration : float or sequence of float, optional
        Limit on the acceleration of each link.
    spike_load : float or sequence of float, optional
        Limit on the load of a spike, alike for all or one per mass.
    actuator_force : float or sequence of float, optional
        Limit on the force of each actuator.
    sigma_margin : float, optional
        sigma of (7) stays at or above this.
    sharing : {"equal", "least_actuation"}, optional
        How several resting masses share the spike load.
    impulses : bool, optional
        Velocities may jump, where no acceleration limit is given.

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

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period; equal where the period is fixed."""
        shortest, longest = per(self.period, 2)
        return shortest, longest

    def length_ranges(self, links: int) -> tuple[tuple[float, float], ...]:
        """Shortest and longest length of each of so many links.

        Parameters
        ----------
        links : int
            Number of links.
        """
        one = all(not isinstance(item, tuple) for item in self.length)
        pairs = [self.length] * links if one else self.length
        return tuple((low, high) for low, high in pairs)

    def rate_limits(self, links: int) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Limits on contraction and on extension, one number per link each; None without.

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
        """Largest contraction and extension rates, given or implied by length and acceleration.

        A link that swings within a range R with acceleration at most a is never faster than
        sqrt(a R): it starts from and returns to rate 0 within that range.

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
        """Limits that every link keeps to as well, of a motor say.

        Parameters
        ----------
        rate, acceleration : float
            Most that a motor gives.
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
        return replace(
            self,
            rate=Rates(*slower),
            acceleration=tuple(min(acceleration, limit) for limit in weaker),
        )

    def faults(self, links: int) -> Iterator[Fault]:
        """Yield field and message of whatever is wrong, or does not fit so many links.

        Parameters
        ----------
        links : int
            Number of links.
        """
        yield from _faults_of_numbers("period", self.period, 2, "ends of a range")
        if len(per(self.period, 2)) == 2:
            yield from _wrong_order("period", self.period_range)
        if not 1 <= self.resting <= links:
            yield (
                "resting",
                f"{self.resting} resting masses leave a worm of {links} links none to move; "
                f"write at most {links}"
                if self.resting > links
                else f"not {self.resting}; at least 1 mass must rest",
            )
        yield from self._faults_of_length(links)
        yield from self._faults_of_lists(links)
        yield from self._faults_of_jumps()

    def _faults_of_length(self, links: int) -> Iterator[Fault]:
        pairs = [item for item in self.length if isinstance(item, tuple)]
        numbers = [item for item in self.length if not isinstance(item, tuple)]
        if not pairs and len(numbers) == 2:
            pairs, names = [tuple(numbers)], ["length"]
        elif numbers or len(pairs) != links or any(len(pair) != 2 for pair in pairs):
            yield (
                "length",
                "neither one range nor one per link; write [shortest, longest], "
                f"or a list of {links} such pairs",
            )
            return
        else:
            names = [f"length[{index}]" for index in range(links)]
        for name, pair in zip(names, pairs, strict=True):
            yield from _faults_of_numbers(name, pair, 2, "ends of a range")
            yield from _wrong_order(name, pair, may_be_equal=False)

    def _faults_of_lists(self, links: int) -> Iterator[Fault]:
        if isinstance(self.rate, Rates):
            for name in ("contraction", "extension"):
                values = getattr(self.rate, name)
                yield from _faults_of_numbers(f"rate.{name}", values, links, "links")
        else:
            yield from _faults_of_numbers("rate", self.rate, links, "links")
        yield from _faults_of_numbers("acceleration", self.acceleration, links, "links")
        yield from _faults_of_numbers("spike_load", self.spike_load, links + 1, "masses")
        yield from _faults_of_numbers("actuator_force", self.actuator_force, links, "links")
        yield from _faults_of_numbers("sigma_margin", self.sigma_margin, 1, "worms", least=0.0)

    def _faults_of_jumps(self) -> Iterator[Fault]:
        if self.rate is None and self.acceleration is None:
            yield "", "links of unlimited rate and acceleration; give {}rate or both"
        if self.acceleration is None and not self.impulses:
            yield (
                "acceleration",
                "velocities may jump: give {}acceleration or set {}impulses = true",
            )
        if not self.impulses:
            return
        if self.acceleration is not None:
            yield (
                "impulses",
                "{}acceleration forbids the jumps that impulses allow; leave one out",
            )
        for key in ("actuator_force", "spike_load"):
            if getattr(self, key) is not None:
                yield (
                    "impulses",
                    f"an impulse exceeds any {{}}{key}; leave {{}}impulses out and give "
                    "{}acceleration",
                )


@dataclass(frozen=True)
class Objective:
    """What makes a gait the best: the largest mean speed, or the least cost at a required speed.

    Parameters
    ----------
    minimise : str, optional
        Cost to be made small; the mean speed is made large if left out.
    speed : float, optional
        Mean speed required when a cost is minimised.

    Examples
    --------
    >>> Objective.of("speed"), Objective.of("peak_spike_load", 0.5).speed
    (Objective(minimise=None, speed=None), 0.5)
    """

    minimise: Cost | None = None
    speed: float | None = None

    @classmethod
    def of(cls, name: Literal["speed"] | Cost, speed: float | None = None) -> Objective:
        """Make an objective of its name.

        Parameters
        ----------
        name : str
            "speed", or the cost to be made small.
        speed : float, optional
            Mean speed required where a cost is made small.
        """
        return cls(None if name == "speed" else name, speed)

    @property
    def is_smooth(self) -> bool:
        """Whether it is neither linear nor a peak."""
        return self.minimise in ("energy_per_distance", "acceleration_effort")

    def faults(self) -> Iterator[Fault]:
        """Yield field and message of whatever is wrong."""
        if self.minimise is None and self.speed is not None:
            yield "speed", "a speed that is made large cannot be required; leave one out"
        elif self.minimise is not None and self.speed is None:
            yield "speed", "missing; minimise needs the speed to keep, a finite number above 0"
        elif self.speed is not None:
            yield from _faults_of_numbers("speed", self.speed, 1, "gaits")


@dataclass(frozen=True)
class Certify:
    """Proof of how much better any gait could be.

    Parameters
    ----------
    phases : int, optional
        It speaks of all gaits with at most so many phases a cycle, 2 to 8.
    gap : float, optional
        How much better a gait might still be when it is enough, as a share.
    time_limit : float, optional
        Seconds after which it stops with the gap it has.
    """

    phases: int = 4
    gap: float = 1e-3
    time_limit: float = 300.0


@dataclass(frozen=True)
class Search(_Frozen):
    """How the order in which masses rest is sought.

    Parameters
    ----------
    seed : int, optional
        Seed of random starts.
    effort : {"quick", "normal", "thorough"}, optional
        How much is searched.
    phases : int, optional
        A cycle has at most so many phases, 2 to 64.
    sequence : sequence of sequences of int, optional
        The resting masses of each phase of a cycle in turn; nothing else is tried then.
    time_limit : float, optional
        Seconds after which the best gait found so far is taken; no limit if left out.
    workers : int, optional
        Number of threads.
    certify : Certify, optional
        The proof of how much better any gait could be; none if left out.
    """

    seed: int = 0
    effort: Literal["quick", "normal", "thorough"] = "normal"
    phases: int | None = None
    sequence: tuple[tuple[int, ...], ...] | None = None
    time_limit: float | None = None
    workers: int | None = None
    certify: Certify | None = field(default=None)

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield field and message of what is wrong.

        Parameters
        ----------
        links : int
            Number of links.
        resting : int
            At least so many masses rest at any time.
        """
        if self.sequence is None:
            return
        count = len(self.sequence)
        if count < 2:
            yield "sequence", "fewer than two phases; write at least two"
        if self.phases is not None and count > self.phases:
            yield "sequence", f"{count} phases, but search.phases allows {self.phases}"
        for index, masses in enumerate(self.sequence):
            key = f"sequence[{index}]"
            if len(set(masses)) != len(masses):
                yield key, "names a mass twice; name it once"
            if any(not 0 <= mass <= links for mass in masses):
                yield key, f"names a mass there is not; write indices 0 to {links}"
            if len(set(masses)) < resting:
                yield key, f"fewer resting masses than gait.resting = {resting}; name more"
            if count > 1 and set(masses) == set(self.sequence[index - 1]):
                yield key, "the same masses rest as in the phase before (round the period)"
        for mass in sorted(set.intersection(*map(set, self.sequence)) if self.sequence else ()):
            yield "sequence", f"mass {mass} rests in every phase; let it move in one"


@dataclass(frozen=True)
class Task:
    """A problem of gait design; it can be hashed and sent to other processes.

    Parameters
    ----------
    worm : Worm
        Masses, drag, load.
    limits : Limits
        What the gait must keep to.
    objective : Objective, optional
        What to seek; the speed if left out.

    Raises
    ------
    ArgumentError
        If something in it is wrong or does not fit together; the message names it.

    Examples
    --------
    >>> Task(Worm(links=2, mass=(1.0, 1.0)), Limits(1.0, (0.7, 1.3), rate=1.0, impulses=True))
    Traceback (most recent call last):
    wormopt.errors.ArgumentError: worm.mass: 2 entries for 3 masses; write one number for all ...
    """

    worm: Worm
    limits: Limits
    objective: Objective = Objective()

    def __post_init__(self) -> None:
        for key, message in self._faults():
            raise ArgumentError(f"{key}: {message}")

    @property
    def loads_matter(self) -> bool:
        """Whether a limit or the cost depends on how resting masses share the load."""
        limited = self.limits.spike_load is not None or self.limits.actuator_force is not None
        return limited or self.objective.minimise not in (None, "acceleration_effort")

    @property
    def speed_nominal(self) -> float:
        """Usual size of the speed: the largest rate of a link."""
        return max(map(max, self.limits.rate_bounds(self.worm.links)))

    def _faults(self) -> Iterator[Fault]:
        for prefix, found in (
            ("worm.", self.worm.faults()),
            ("limits.", self.limits.faults(self.worm.links)),
            ("objective.", self.objective.faults()),
        ):
            for key, message in found:
                yield f"{prefix}{key}".removesuffix("."), message.format(*[prefix] * 3)


def _faults_of_numbers(
    key: str, value: Any, count: int, things: str, least: float | None = None
) -> Iterator[Fault]:
    """Yield a fault for what is no finite number above 0 or from least on, or no full list."""
    if value is None:
        return
    if isinstance(value, tuple) and len(value) != count:
        entries = "1 entry" if len(value) == 1 else f"{len(value)} entries"
        yield (
            key,
            f"{entries} for {count} {things}; write one number for all {things}, "
            f"or a list of {count}",
        )
    for item in per(value, 1):
        known = isinstance(item, Real) and math.isfinite(item)
        if not known or not (item > 0 if least is None else item >= least):
            wanted = "above 0" if least is None else f"{least:g} or above"
            yield key, f"not {item!r}; write a finite number {wanted}"


def _wrong_order(
    key: str, pair: tuple[float, ...], *, may_be_equal: bool = True
) -> Iterator[Fault]:
    low, high = pair
    if low > high or (low == high and not may_be_equal):
        yield key, f"the range [{low:g}, {high:g}] is empty; write the smaller number first"
