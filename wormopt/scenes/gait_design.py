"""Scenes of kind "gait-design": the best gait within limits."""

from __future__ import annotations

from collections.abc import Iterator
from math import comb
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field
from msgspec.structs import replace

from wormopt.errors import Fault
from wormopt.scenes.gait_search import Search
from wormopt.scenes.motor import MotorTable
from wormopt.scenes.shapes import too_many_resting
from wormopt.scenes.types import (
    NonNegative,
    PairPerLink,
    PerLink,
    PerMass,
    Positive,
    PositiveOrPair,
    SceneTable,
    Sharing,
    Table,
    per,
    wrong_count,
    wrong_order,
)
from wormopt.scenes.worm import WormTable

Cost = Literal[
    "peak_spike_load", "peak_actuator_force", "energy_per_distance", "acceleration_effort"
]


class RateLimits(Table, frozen=True, kw_only=True):
    """Limits on the rate of a link, apart for both directions.

    Parameters
    ----------
    contraction : float or tuple of float
        How fast a link may shorten at most, alike for all or one per link.
    extension : float or tuple of float
        How fast a link may lengthen at most, alike for all or one per link.
    """

    contraction: PerLink
    extension: PerLink


class GaitLimits(Table, frozen=True, kw_only=True):
    """What a designed gait must keep to. Limits left out do not hold.

    Parameters
    ----------
    period : float or tuple of two floats
        The period, or the shortest and longest allowed.
    length : tuple
        Shortest and longest length, one pair for all links or one per link.
    resting : int
        At least so many masses rest at any time.
    rate : float, tuple of float or RateLimits, optional
        Limit on the rate of each link.
    acceleration : float or tuple of float, optional
        Limit on the acceleration of each link.
    spike_load : float or tuple of float, optional
        Limit on the load of a spike, alike for all or one per mass.
    actuator_force : float or tuple of float, optional
        Limit on the force of each actuator.
    sigma_margin : float
        sigma of (7) stays at or above this.
    sharing : {"equal", "least_actuation"}
        How several resting masses share the spike load.
    impulses : bool
        Velocities may jump, where no acceleration limit is given.

    Examples
    --------
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> limits.length_ranges(2)
    ((0.7, 1.3), (0.7, 1.3))
    >>> limits.rate_limits(2)
    ((1.0, 1.0), (1.0, 1.0))
    """

    period: PositiveOrPair
    length: PairPerLink
    resting: Annotated[int, Meta(ge=1, le=8, description="a whole number, 1 or above")] = 1
    rate: PerLink | RateLimits | None = None
    acceleration: PerLink | None = None
    spike_load: PerMass | None = None
    actuator_force: PerLink | None = None
    sigma_margin: NonNegative = 0.0
    sharing: Sharing = "equal"
    impulses: bool = False

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period; equal where the period is fixed."""
        shortest, longest = per(self.period, 2)
        return shortest, longest

    def length_ranges(self, links: int) -> tuple[tuple[float, float], ...]:
        """Shortest and longest length of each link.

        Parameters
        ----------
        links : int
            Number of links.
        """
        pairs = self._pairs() or [self._numbers()] * links
        return tuple((low, high) for low, high in pairs)

    def _pairs(self) -> list[tuple[float, ...]]:
        return [item for item in self.length if isinstance(item, tuple)]

    def _numbers(self) -> tuple[float, ...]:
        return tuple(item for item in self.length if not isinstance(item, tuple))

    def rate_limits(self, links: int) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Limits on contraction and on extension, one number per link each; None without.

        Parameters
        ----------
        links : int
            Number of links.
        """
        if self.rate is None:
            return None
        if isinstance(self.rate, RateLimits):
            return per(self.rate.contraction, links), per(self.rate.extension, links)
        return per(self.rate, links), per(self.rate, links)

    def within(self, motor: MotorTable, links: int) -> GaitLimits:
        """Limits that a motor on every link keeps to as well.

        Parameters
        ----------
        motor : MotorTable
            The motor.
        links : int
            Number of links.

        Examples
        --------
        >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0)
        >>> both = limits.within(MotorTable(lead=0.1, rate_max=8, acceleration_max=50), 2)
        >>> both.rate_limits(2), both.acceleration
        (((0.8, 0.8), (0.8, 0.8)), (5.0, 5.0))
        """
        rate, acceleration = motor.length_rate, motor.length_acceleration
        contraction, extension = self.rate_limits(links) or ((rate,) * links,) * 2
        return replace(
            self,
            rate=RateLimits(
                contraction=tuple(min(rate, limit) for limit in contraction),
                extension=tuple(min(rate, limit) for limit in extension),
            ),
            acceleration=tuple(
                min(acceleration, limit) for limit in per(self.acceleration or acceleration, links)
            ),
        )

    def faults(self, links: int, motor: bool = False) -> Iterator[Fault]:
        """Yield what is wrong between the keys, or does not fit a worm of so many links.

        Parameters
        ----------
        links : int
            Number of links.
        motor : bool, optional
            Whether motors limit rates and accelerations too.
        """
        yield from wrong_order("gait.period", self.period_range, may_be_equal=True)
        yield from too_many_resting(self.resting, links)
        yield from self._faults_of_length(links)
        yield from self._faults_of_lists(links)
        yield from self._faults_of_jumps(motor)

    def _faults_of_length(self, links: int) -> Iterator[Fault]:
        pairs, numbers = self._pairs(), self._numbers()
        if not pairs and len(numbers) == 2:
            yield from wrong_order("gait.length", numbers, may_be_equal=False)
        elif numbers or len(pairs) != links:
            yield (
                "gait.length",
                "neither one range nor one per link; write [shortest, longest], "
                f"or a list of {links} such pairs",
            )
        for index, pair in enumerate(pairs):
            yield from wrong_order(f"gait.length[{index}]", pair, may_be_equal=False)

    def _faults_of_lists(self, links: int) -> Iterator[Fault]:
        if isinstance(self.rate, RateLimits):
            yield from wrong_count("gait.rate.contraction", self.rate.contraction, links, "links")
            yield from wrong_count("gait.rate.extension", self.rate.extension, links, "links")
        else:
            yield from wrong_count("gait.rate", self.rate, links, "links")
        yield from wrong_count("gait.acceleration", self.acceleration, links, "links")
        yield from wrong_count("gait.spike_load", self.spike_load, links + 1, "masses")
        yield from wrong_count("gait.actuator_force", self.actuator_force, links, "links")

    def _faults_of_jumps(self, motor: bool) -> Iterator[Fault]:
        if motor and self.impulses:
            yield "gait.impulses", "motor.acceleration_max forbids jumps; leave gait.impulses out"
        if motor:
            return
        if self.rate is None and self.acceleration is None:
            yield "gait", "links of unlimited rate and acceleration; give gait.rate or both"
        if self.acceleration is None and not self.impulses:
            yield (
                "gait.acceleration",
                "velocities may jump: give gait.acceleration or set gait.impulses = true",
            )
        if not self.impulses:
            return
        if self.acceleration is not None:
            yield (
                "gait.impulses",
                "gait.acceleration forbids the jumps that impulses allow; leave one out",
            )
        for key in ("actuator_force", "spike_load"):
            if getattr(self, key) is not None:
                yield (
                    "gait.impulses",
                    f"an impulse exceeds any gait.{key}; leave gait.impulses out and give "
                    "gait.acceleration",
                )


class Objective(Table, frozen=True, kw_only=True):
    """What makes a gait the best: exactly one of `maximise` and `minimise`.

    Parameters
    ----------
    maximise : {"speed"}, optional
        Seek the largest mean speed.
    minimise : str, optional
        Cost to be made small.
    speed : float, optional
        Speed required when a cost is minimised.
    """

    maximise: Literal["speed"] | None = None
    minimise: Cost | None = None
    speed: Positive | None = None

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        if self.maximise is None and self.minimise is None:
            yield "objective", 'no objective; write maximise = "speed", or minimise and speed'
        elif self.maximise is not None and self.minimise is not None:
            yield "objective", "two objectives; leave out maximise or minimise"
        elif self.minimise is not None and self.speed is None:
            yield "objective.speed", f"missing; minimise needs {_SPEED}"
        elif self.maximise is not None and self.speed is not None:
            yield "objective.speed", 'contradicts maximise = "speed"; leave one out'


# Words of resting sets, before rotations and mirror images are counted as one.
_MOST_ORDERS = 1_000_000
_UNPROVEN = ("energy_per_distance", "acceleration_effort")
_SPEED = "the speed to keep, a finite number above 0"


class DesignTable(SceneTable, frozen=True, kw_only=True):
    """What all scenes that design gaits share.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : str
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : WormTable
        The worm.
    gait : GaitLimits
        The limits.
    search : Search
        How to search.
    motor : MotorTable, optional
        Motors that set the links' lengths, whose limits hold too.
    """

    worm: WormTable
    gait: GaitLimits
    search: Search = field(default_factory=Search)
    motor: MotorTable | None = None

    @property
    def limits(self) -> GaitLimits:
        """The limits, those of the motors among them."""
        return self.gait if self.motor is None else self.gait.within(self.motor, self.worm.links)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows.

        Parameters
        ----------
        folder : Path
            Folder of the scene.
        """
        yield from super().faults(folder)
        yield from self.worm.faults()
        yield from self.gait.faults(self.worm.links, self.motor is not None)
        if self.motor is not None:
            yield from self.motor.faults()
        yield from self.search.faults(self.worm.links, self.gait.resting)

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if a cost has no finite value in this scene.

        Parameters
        ----------
        key : str
            Where the cost stands.
        cost : str, optional
            The cost.
        """
        if self.gait.impulses and cost is not None:
            yield (
                key,
                f"{cost} has no finite value with gait.impulses; leave that out and give "
                "gait.acceleration",
            )


class GaitDesignScene(DesignTable, frozen=True, kw_only=True):
    """The best gait within limits.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"gait-design"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : WormTable
        The worm.
    gait : GaitLimits
        The limits.
    search : Search
        How to search.
    motor : MotorTable, optional
        Motors that set the links' lengths.
    objective : Objective
        What to seek.
    """

    kind: Literal["gait-design"]
    want: tuple[Literal["gait", "motion", "spikes", "certificate", "animation"], ...] = ()
    objective: Objective

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows.

        Parameters
        ----------
        folder : Path
            Folder of the scene.
        """
        yield from super().faults(folder)
        yield from self.objective.faults()
        yield from self.faults_of_cost("objective.minimise", self.objective.minimise)
        yield from self._faults_of_proof()

    def _faults_of_proof(self) -> Iterator[Fault]:
        if self.search.certify is None and "certificate" in self.want:
            yield "want", '"certificate" draws a proof; add a table [search.certify]'
        if self.search.certify is not None and self.objective.minimise in _UNPROVEN:
            yield (
                "search.certify",
                f"there is no proof for {self.objective.minimise}; leave it out, or seek speed, "
                "peak_spike_load or peak_actuator_force",
            )
        if self.search.certify is not None and self.search.sequence is None:
            yield from self._faults_of_many_orders(self.search.certify.phases)

    def _faults_of_many_orders(self, phases: int) -> Iterator[Fault]:
        masses, fewest = self.worm.links + 1, self.gait.resting
        sharing = self.gait.spike_load is not None or self.gait.actuator_force is not None
        most = masses if sharing or self.objective.minimise else fewest
        sets = sum(comb(masses, size) for size in range(fewest, most + 1))
        possible = max((p for p in range(2, 9) if sets**p <= _MOST_ORDERS), default=0)
        if phases > possible:
            yield (
                "search.certify.phases",
                f"{phases} phases of {sets} sets of resting masses have too many orders to look "
                f"at; write {possible} at most"
                if possible
                else f"{sets} sets of resting masses are too many to look at; give search.sequence",
            )
