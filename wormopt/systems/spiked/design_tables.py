"""Tables of all kinds that design gaits: worm, limits, search and motor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from wormopt.errors import Fault
from wormopt.study import Study, entry
from wormopt.systems.spiked.gait_problem import (
    Cost,
    GaitProblem,
    Objective,
    SceneWorm,
    Search,
    faults_of_cost,
)
from wormopt.systems.spiked.limits import GaitLimits, Limits
from wormopt.systems.spiked.stepper.stepper import Motor


class DesignTable(Study):
    """Tables shared by all scenes that design gaits."""

    worm: SceneWorm = entry("the worm")
    gait: GaitLimits = entry("the limits")
    search: Search = entry("options of the search", default=Search)
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
