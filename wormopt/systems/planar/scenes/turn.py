"""Scenes of kind "planar-turn": a worm of two links turns in place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Finite, Positive, SceneTable, Table, says
from wormopt.systems.planar.scenes.crawl import CRAWL_SCALARS, CRAWL_VARIABLES

if TYPE_CHECKING:  # checking a scene loads no numerics
    from wormopt.systems.planar.turning import TurnInPlace


class TurnerTable(Table, frozen=True, kw_only=True):
    """Two links that swap their lengths, three masses on ground that resists all ways alike."""

    end_friction: Annotated[Positive, says("force", "*F* of masses 0 and 2")]
    middle_friction: Annotated[Positive, says("force", "*F*<sub>1</sub> of mass 1")]
    short: Annotated[Positive, says("length", "*l*<sub>2</sub>, of the link that swings")]
    long: Annotated[Positive, says("length", "*l*<sub>1</sub>, of the link that rests")]
    straight: Annotated[Finite, says("rad", "angle of the joint at which the swing begins")]
    bent: Annotated[Finite, says("rad", "and at which it ends, both within ±π")]


class PaceTable(Table, frozen=True, kw_only=True):
    """How fast the shape may change."""

    joint: Annotated[Positive, says("angular_frequency", "largest rate of the joint's angle")]
    link: Annotated[Positive, says("speed", "largest rate of a link's length")]


class PlanarTurnScene(SceneTable, frozen=True, kw_only=True):
    """A worm of two links turns in place: the joint swings, the links swap their lengths.

    While it swings the longer link rests and the shorter one turns about the middle mass; while
    they swap, neither turns. Swing, swap, swing back, swap turns the worm by the swing and takes
    its middle nowhere. With a link that does not turn at every instant, the mean rate of the
    heading is at most half the joint's largest rate: proven, and reached as swaps get shorter. See
    [theory](../theory-planar.md#4-turning-in-place). Status `failed`:
    another way finds another motion, forces do not balance, or the motion is not the one that the
    conditions of rest promise.

    `timings_s`: `crawl` and `recheck`.
    """

    headline: ClassVar = ("heading_rate", "heading_rate_bound", "gap", "turn", "work")
    scalars: ClassVar = {
        "heading_rate": ("angular_frequency", "mean rate, by the crawl"),
        "heading_rate_bound": (
            "angular_frequency",
            "which no gait exceeds that keeps a link from turning at every instant",
        ),
        "gap": ("share", "of the bound that is missing; unknown where no link need rest"),
        "cycle_time": ("time", "of a gait: two swings and two swaps"),
        "swap_time": ("time", "of one swap"),
        "swing_hold": (
            "share",
            "most of what the ground holds that the long link needs; it rests up to 1",
        ),
        "swap_hold": ("share", "likewise of the middle mass while links swap"),
        "drift": ("length", "way of the middle mass in a gait"),
        "turn_promised": ("angle", "turn of a gait if masses rest as they must"),
        "work_promised": ("energy", "and its work"),
        "promise_error": (
            "share",
            "turn, work and drift apart from those promised, at their sizes",
        ),
        **{
            name: told
            for name, told in CRAWL_SCALARS.items()
            if not name.startswith("work_per") and name != "speed"
        },
    }
    variables: ClassVar = {
        **CRAWL_VARIABLES,
        "mean_heading": ("angle", ("time",), "mean angle of both links"),
        "swing_angle": ("angle", ("swing",), "angles of the joint in a swing"),
        "hold_by_angle": ("share", ("swing",), "of the ground's hold that the long link needs"),
    }

    kind: Literal["planar-turn"]
    want: Annotated[
        tuple[Literal["crawl", "turning", "forces", "animation"], ...],
        says(
            "",
            "`crawl`: the worm over `cycles` in the plane; `turning`: its heading and the bound, "
            "and what rest needs; `forces`: of the ground and actuators; `animation`: as it turns",
        ),
    ] = ()
    worm: Annotated[TurnerTable, says("", "the worm and its gait")]
    pace: Annotated[PaceTable, says("", "how fast it goes")]
    cycles: Annotated[
        int,
        Meta(ge=1, le=100, description="a whole number from 1 to 100"),
        says("count", "gaits that are shown"),
    ] = 2

    @property
    def swing_time(self) -> float:
        """Time of a swing."""
        return abs(self.worm.bent - self.worm.straight) / self.pace.joint

    @property
    def swap_time(self) -> float:
        """Time of a swap."""
        return (self.worm.long - self.worm.short) / self.pace.link

    def gait(self) -> TurnInPlace:
        """What it does."""
        from wormopt.systems.planar.turning import TurnInPlace

        worm = self.worm
        return TurnInPlace(
            worm.end_friction, worm.middle_friction, short=worm.short, long=worm.long,
            straight=worm.straight, bent=worm.bent,
        )  # fmt: skip

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        worm = self.worm
        if not worm.short < worm.long:
            yield (
                "worm.short",
                f"{worm.short:g} is not below worm.long, {worm.long:g}: of equal links it is open "
                "which one swings; write a smaller number, however little",
            )
        elif worm.long - worm.short < 1e-6 * worm.long:
            yield (
                "worm.short",
                "hardly shorter than worm.long: computed numbers cannot tell which link swings; "
                f"write {0.999 * worm.long:g}, say",
            )
        for name in ("straight", "bent"):
            if abs(getattr(worm, name)) >= math.pi:
                yield f"worm.{name}", "beyond what a joint can do; write an angle within ±π"
        if worm.straight == worm.bent:
            yield "worm.bent", "the same as worm.straight: the joint does not swing; write another"
