"""Tables of all kinds that design gaits: worm, limits, search and motor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from msgspec import structs

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.later import on_use
from wormopt.study.types import SceneTable
from wormopt.systems.spiked.gait_problem import (
    Cost,
    GaitLimits,
    GaitProblem,
    Limits,
    Objective,
    Search,
    Worm,
    faults_of_cost,
)

with on_use():
    from wormopt.systems.spiked.stepper.stepper import Stepper


class Motor(Given):
    """A stepping motor on a threaded rod; all links have the same motor."""

    lead: float = positive("length", "travel along the rod per turn")
    steps_per_turn: int = whole(1, 100000, "full steps per turn", default=200)
    microsteps: int = whole(1, 100000, "microsteps per full step", default=1)
    rate_max: float = positive("rate", "largest rate, turns per time")
    acceleration_max: float = positive(
        "rate_change", "largest change of the rate, turns per time squared"
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
    def length_rate(self) -> float:
        """Largest rate of a length."""
        return self.lead * self.rate_max

    @property
    def length_acceleration(self) -> float:
        """Largest acceleration of a length."""
        return self.lead * self.acceleration_max

    @property
    def stepper(self) -> Stepper:
        """The motor as an engine object."""
        return Stepper(**structs.asdict(self))

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a start rate that is too large."""
        if self.start_rate > self.rate_max:
            yield (
                "start_rate",
                f"{self.start_rate:g} is above motor.rate_max = {self.rate_max:g}; write at most "
                "motor.rate_max",
            )


class DesignTable(SceneTable):
    """Tables shared by all scenes that design gaits."""

    worm: Worm = entry("the worm")
    gait: GaitLimits = entry("the limits")
    search: Search = entry("how to search", default=Search)
    motor: Motor | None = entry(
        "a stepping motor with a threaded rod on each link; none by default. |*l*′| ≤ `lead` "
        "· `rate_max` and |*l*″| ≤ `lead` · `acceleration_max` hold in addition to the limits "
        "in `[gait]`, which then need no `rate` or `acceleration`. Other keys of this table "
        "have no effect on the design; the limits also hold below `start_rate`. Refused: "
        "`gait.impulses`",
        default=None,
    )

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of links and masses."""
        return self.worm.counts

    @property
    def limits(self) -> Limits:
        """The limits, including those of the motors."""
        own, motor = self.gait, self.motor
        if motor is None:
            return own
        return own.within(motor.length_rate, motor.length_acceleration, self.worm.links)

    def task(self, objective: Objective) -> GaitProblem:
        """The design problem for the given objective."""
        return GaitProblem(self.worm, self.limits, objective)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_design()

    def faults_of_design(self) -> Iterator[Fault]:
        """Yield what is wrong between worm, limits, motor and search."""
        yield from self.worm.faults_in_scene(self.units, ranges=True)
        links, limits = self.worm.links, self.gait
        if self.motor is not None and limits.impulses:
            yield (
                "gait.impulses",
                "true, but motor.acceleration_max forbids jumps of velocity; remove the key",
            )
        for key, message in limits.faults_for(links, motor=self.motor is not None):
            yield f"gait.{key}".removesuffix("."), message
        for key, message in self.search.faults_for(links, limits):
            yield f"search.{key}", message

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if the cost at `key` cannot be minimised in this scene."""
        for message in faults_of_cost(cost, self.worm, self.gait):
            yield key, message
