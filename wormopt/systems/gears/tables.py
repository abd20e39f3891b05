"""Tables of worms that shift their gait: worm, ground, limits, supervisor, way, tracked chain."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, positive
from wormopt.study.types import Finite, NonNegative, Pair, PerMass, wrong_order
from wormopt.systems.chain import CoulombFriction, SpikeFriction
from wormopt.systems.spiked import Links

Along = Annotated[
    NonNegative | tuple[NonNegative, ...],
    Meta(description="a finite number, 0 or above, or a list with one such number per place"),
]
Angle = Annotated[
    float, Meta(ge=-math.pi / 2, le=math.pi / 2, description="an angle from -pi/2 to pi/2")
]
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, at most 1")]
Few = Annotated[int, Meta(ge=1, description="a whole number, 1 or above")]


class ShiftedWorm(Given):
    """A chain of *n* + 1 point masses with spikes, joined by *n* links that follow their gait."""

    links: Links = entry("number of links *n*", quantity="count")
    mass: PerMass = entry("point masses *m*<sub>i</sub>; mass 0 is the head", quantity="mass")
    drag: float = number(
        "drag", "*k*: viscous drag of each mass, as assumed by the supervisor", least=0, default=0.0
    )


class GroundTable(Given):
    """The ground at each position: linear between the given places, constant beyond them.

    Refused: places that do not increase, lists of other lengths.
    """

    place: Annotated[
        tuple[Finite, ...], Meta(min_length=1, description="a list of increasing numbers")
    ] = entry("positions along the route", quantity="length")
    slope: Angle | tuple[Angle, ...] = entry(
        "angle at which the ground rises there: *m*<sub>i</sub> *g* sin(`slope`) is added to "
        "the load on each mass; needs equal masses",
        quantity="rad",
        default=0.0,
    )
    gravity: float | None = positive(
        "acceleration",
        "*g* for `slope`; default 9.80665 m/s² in SI scenes, required in others",
        default=None,
    )
    load: Along = entry("force on each mass against forward motion", quantity="force", default=0.0)
    towed: Along = entry(
        "additional force on the tail against forward motion: a towed load",
        quantity="force",
        default=0.0,
    )
    drag: Along | None = entry(
        "true drag *k* of each mass; default: `worm.drag`", quantity="drag", default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        for k, (a, b) in enumerate(zip(self.place, self.place[1:], strict=False), start=1):
            if b <= a:
                yield f"place[{k}]", f"{b:g} is not above {a:g}; write increasing places"
        for name in ("slope", "load", "towed", "drag"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != len(self.place):
                yield (
                    name,
                    f"{len(value)} numbers for {len(self.place)} places; write one for all, or a "
                    f"list of {len(self.place)}",
                )


class ShiftLimits(Given):
    """Limits of the gears and of the transitions between them."""

    spike_load: float = positive("force", "largest load on one spike")
    actuator_force: float | None = positive(
        "force", "largest force of each actuator; default: unlimited", default=None
    )
    rate: float = positive("speed", "largest rate of each link length")
    acceleration: float = positive("acceleration", "largest acceleration of each length")
    length: Pair = entry("shortest and longest link length", quantity="length")
    resting: Few = entry(
        "smallest number of masses at rest throughout a transition", quantity="count", default=1
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("length", self.length, may_be_equal=False)


class SupervisorRules(Given):
    """Rules for shifting by loads measured over whole cycles."""

    down: float = number(
        "share",
        "shift down if estimated peak loads exceed this share of the limits",
        above=0,
        most=1,
        default=0.9,
    )
    up: float = number(
        "share",
        "shift up if peak loads in the next faster gear would stay below this share; less "
        "than `down`",
        above=0,
        most=1,
        default=0.85,
    )
    dwell: float = number("time", "shortest time in a gear", least=0, default=0.0)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.up >= self.down:
            yield (
                "up",
                f"{self.up:g} is not below supervisor.down = {self.down:g}, so the worm would "
                "shift to and fro; write a smaller value",
            )


class Way(Given):
    """Start and goal of the mean position of the masses."""

    start: float = number("length", "mean position of the masses at time 0", default=0.0)
    goal: float = number("length", "mean position of the masses at the end")

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.goal <= self.start:
            yield (
                "goal",
                f"{self.goal:g} is not above way.start = {self.start:g}; write a larger value",
            )


class Adaptive(Given):
    """The same worm as a chain of springs whose links follow the gears by a λ-tracker.

    The tracker is that of eq. 13 of Zimmermann et al. 2007 [1].
    """

    stiffness: float = positive("stiffness", "stiffness *c* of each link")
    damping: float = number("drag", "damping *d* of each link", least=0)
    friction: CoulombFriction | SpikeFriction = entry(
        'friction of the ground, `kind = "spike"` or `"coulomb"`', default=SpikeFriction
    )
    tube_radius: float = positive("length", "tube radius *λ* of the tracker")
    gain_start: float = positive("1", "initial gain *k*(0)", default=1.0)
    growth: float = positive("1", "growth rate *γ* of the gain", default=1.0)
    memory: float | None = positive(
        "time",
        "averaging time of the load measured on each mass, by which actuators share the load "
        "among the spikes; default: a quarter of the shortest cycle",
        default=None,
    )
