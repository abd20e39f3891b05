"""Scenes of kind "gait-design": the best gait within limits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import ArgumentError, Fault
from wormopt.scene.types import (
    NonNegative,
    PairPerLink,
    PerLink,
    PerMass,
    Positive,
    PositiveOrPair,
    SceneTable,
    Table,
)
from wormopt.systems.spiked.limits import Limits, Rates, Sharing
from wormopt.systems.spiked.scenes.gait_search import SearchTable, in_scene
from wormopt.systems.spiked.scenes.motor import MotorTable
from wormopt.systems.spiked.scenes.worm import WormTable
from wormopt.systems.spiked.task import MOST_LINKS, Cost, Objective, Task


class RateTable(Table, frozen=True, kw_only=True):
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


class LimitTable(Table, frozen=True, kw_only=True):
    """What a designed gait must keep to, see `Limits`. Limits left out do not hold.

    Parameters
    ----------
    period : float or tuple of two floats
        The period, or the shortest and longest allowed; one or more cycles fill it.
    length : tuple
        Shortest and longest length, one pair for all links or one per link.
    resting : int
        At least so many masses rest at any time.
    rate : float, tuple of float or RateTable, optional
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
    """

    period: PositiveOrPair
    length: PairPerLink
    resting: Annotated[int, Meta(ge=1, le=MOST_LINKS, description="a whole number, 1 or above")] = 1
    rate: PerLink | RateTable | None = None
    acceleration: PerLink | None = None
    spike_load: PerMass | None = None
    actuator_force: PerLink | None = None
    sigma_margin: NonNegative = 0.0
    sharing: Sharing = "equal"
    impulses: bool = False

    @property
    def limits(self) -> Limits:
        """The limits themselves."""
        given = {name: getattr(self, name) for name in self.__struct_fields__}
        if isinstance(self.rate, RateTable):
            given["rate"] = Rates(self.rate.contraction, self.rate.extension)
        return Limits(**given)


class ObjectiveTable(Table, frozen=True, kw_only=True):
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

    @property
    def objective(self) -> Objective:
        """The objective itself."""
        return Objective(self.minimise, self.speed)

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
    gait : LimitTable
        The limits.
    search : SearchTable
        How to search.
    motor : MotorTable, optional
        Motors that set the links' lengths, whose limits hold too.
    """

    worm: WormTable
    gait: LimitTable
    search: SearchTable = field(default_factory=SearchTable)
    motor: MotorTable | None = None

    @property
    def limits(self) -> Limits:
        """The limits, those of the motors among them."""
        own, motor = self.gait.limits, self.motor
        if motor is None:
            return own
        return own.within(motor.length_rate, motor.length_acceleration, self.worm.links)

    def task(self, objective: Objective) -> Task:
        """The problem of design with the given objective."""
        return Task(self.worm.worm, self.limits, objective)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults(loads=True)
        yield from self._faults_of_limits()
        if self.motor is not None:
            yield from self.motor.faults()
        yield from self.search.faults(self.worm.links, self.gait.resting)

    def _faults_of_limits(self) -> Iterator[Fault]:
        limits = self.gait.limits
        if self.motor is not None:
            if limits.impulses:
                yield "gait.impulses", "motor.acceleration_max forbids jumps; leave it out"
                return
            given = {name: getattr(limits, name) or 1.0 for name in ("rate", "acceleration")}
            limits = replace(limits, **given)  # what is left out is the motor's
        for key, message in limits.faults(self.worm.links, "gait."):
            yield f"gait.{key}".removesuffix("."), message

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if the cost at `key` cannot be sought in this scene."""
        for message in Objective(cost).faults_within(self.worm.worm, self.gait.limits):
            yield key, in_scene(message)


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
    gait : LimitTable
        The limits.
    search : SearchTable
        How to search.
    motor : MotorTable, optional
        Motors that set the links' lengths.
    objective : ObjectiveTable
        What to seek.
    """

    kind: Literal["gait-design"]
    want: tuple[Literal["gait", "motion", "spikes", "limits", "certificate", "animation"], ...] = ()
    objective: ObjectiveTable

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.objective.faults()
        yield from self.faults_of_cost("objective.minimise", self.objective.minimise)
        yield from self._faults_of_proof()

    def _faults_of_proof(self) -> Iterator[Fault]:
        wanted, objective = self.search.proof, self.objective.objective
        if wanted is None:
            if "certificate" in self.want:
                yield "want", '"certificate" draws a proof; add a table [search.certify]'
            return
        if objective.is_smooth:
            yield (
                "search.certify",
                f"there is no proof for {objective.minimise}; leave it out, or seek speed, "
                "peak_spike_load or peak_actuator_force",
            )
        with suppress(ArgumentError):  # what is wrong with the task is told already
            for key, message in wanted.faults_of_orders(self.task(objective)):
                yield f"search.certify.{key}".removesuffix("."), message
