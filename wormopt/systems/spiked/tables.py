"""Tables of worms with spikes and of given gaits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, says
from wormopt.study.types import (
    Loads,
    PerMass,
    per,
)
from wormopt.systems.shared.incline import (
    Gravity,
    Uphill,
    faults_of_slope,
    told_of_slope,
    weights,
)
from wormopt.systems.spiked.limits import Sharing
from wormopt.systems.spiked.shapes import (
    AccordionShape,
    BlockWaveShape,
    FastShape,
    FileShape,
)
from wormopt.systems.spiked.task import MOST_LINKS, Worm

Links = Annotated[
    int, Meta(ge=1, le=MOST_LINKS, description=f"a whole number from 1 to {MOST_LINKS}")
]
Shared = Annotated[
    Sharing,
    says(
        "",
        "how several resting masses share the load, see "
        "[theory](../theory-kinematic.md#5-spike-loads-and-sharing-rules); spikes have no load "
        "limit here",
    ),
]


class WormTable(Given):
    """A chain of *n* + 1 point masses on the ground, joined by *n* links.

    The link lengths are prescribed. Spikes on every mass let it slide forward but never backward.
    """

    links: Links = entry("number of links *n*", quantity="count")
    mass: PerMass = entry("point masses *m*<sub>i</sub>; mass 0 is the head", quantity="mass")
    drag: float = number("drag", "*k*: each mass has viscous drag −*k v*", least=0, default=0.0)
    load: Loads = entry(
        "*Γ*: force on each mass against the direction of motion (towed load, slope). A pair "
        "is a range and is allowed in designs only: the designed gait meets its limits over "
        "the whole range. Three or more numbers are the loads of the individual masses, head "
        "first. Example: a cable at the tail of a worm with two links is [0, 0, 0.3]",
        quantity="force",
        default=0.0,
    )
    slope: Uphill = 0.0
    gravity: Gravity = None

    @property
    def worm(self) -> Worm:
        """The worm, with its load and its weight along the slope."""
        if not self.slope:
            return Worm(self.links, self.mass, self.drag, self.load)
        pull = weights(self.slope, self.gravity, per(self.mass, self.links + 1))
        if len(set(pull)) > 1:
            return Worm(self.links, self.mass, self.drag, self.load, pull)
        if isinstance(self.load, tuple):
            loads = tuple(load + pull[0] for load in self.load)
            return Worm(self.links, self.mass, self.drag, loads)
        return Worm(self.links, self.mass, self.drag, self.load + pull[0])

    @property
    def facts(self) -> dict[str, Any]:
        """Effect of the weight on a slope, for the trust report."""
        return told_of_slope(self.slope, self.gravity, self.masses)

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return self.worm.masses

    def faults(self, units: str, loads: bool = False) -> Iterator[Fault]:
        """Yield what is wrong between the keys.

        `units` are the scene's; `loads`: whether the load may be a range.
        """
        yield from faults_of_slope(self.slope, self.gravity, units)
        if isinstance(self.load, tuple) and len(self.load) == 2 and not loads:
            yield (
                "worm.load",
                "a range of loads is allowed in gait designs only; write one number, or one load "
                "for each of three or more masses",
            )
        for key, message in self.worm.faults():
            yield f"worm.{key}", message


class FastGait(FastShape):  # noqa: D101
    __doc__ = FastShape.__doc__
    sharing: Shared = "equal"


class BlockWave(BlockWaveShape):  # noqa: D101
    __doc__ = BlockWaveShape.__doc__
    sharing: Shared = "equal"


class Accordion(AccordionShape):  # noqa: D101
    __doc__ = AccordionShape.__doc__
    sharing: Shared = "equal"


class GaitFile(FileShape):  # noqa: D101
    __doc__ = FileShape.__doc__
    sharing: Shared = "equal"


GivenGait = FastGait | BlockWave | Accordion | GaitFile
