"""Scenes of kind "planar-turn": a worm of two links turns in place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import SceneTable
from wormopt.systems.planar.scenes.crawl import CRAWL_SCALARS, CRAWL_VARIABLES

if TYPE_CHECKING:  # checking a scene loads no numerics
    from wormopt.systems.planar.turning import TurnInPlace


class TurnerTable(Given):
    """A worm of two links that exchange lengths, on ground with equal resistance everywhere."""

    end_friction: float = positive("force", "friction *F* of masses 0 and 2")
    middle_friction: float = positive("force", "friction *F*<sub>1</sub> of mass 1")
    short: float = positive("length", "length *l*<sub>2</sub> of the link that swings")
    long: float = positive("length", "length *l*<sub>1</sub> of the link that rests")
    straight: float = number("rad", "joint angle at which the swing begins, within ±π")
    bent: float = number("rad", "joint angle at which the swing ends, within ±π")


class PaceTable(Given):
    """Largest rates of the shape."""

    joint: float = positive("angular_frequency", "largest rate of the joint angle")
    link: float = positive("speed", "largest rate of a link length")


class PlanarTurnScene(SceneTable):
    """A worm of two links turns in place: the joint swings, then the links exchange lengths.

    During a swing the longer link rests and the shorter one turns about the middle mass. During an
    exchange (swap) neither link turns. The gait swing, swap, swing back, swap rotates the worm by
    the swing angle and returns its middle mass. If one link rests at every instant, the mean
    rate of the heading is at most half the joint's largest rate. This bound is proven, and it is
    approached as swaps get shorter. See
    [theory](../theory-planar.md#4-turning-in-place). The status is `failed` if a second route finds
    another motion, forces are not balanced, or the motion differs from that predicted by the
    conditions of rest.

    `timings_s`: `crawl` and `recheck`.
    """

    headline: ClassVar = ("heading_rate", "heading_rate_bound", "gap", "turn", "work")
    scalars: ClassVar = {
        "heading_rate": ("angular_frequency", "mean rate of the heading, by the crawl"),
        "heading_rate_bound": (
            "angular_frequency",
            "bound of the mean rate for gaits in which one link does not turn at every instant",
        ),
        "gap": ("share", "relative gap to the bound; unknown if no link has to rest"),
        "cycle_time": ("time", "duration of a gait: two swings and two swaps"),
        "swap_time": ("time", "duration of a swap"),
        "swing_hold": (
            "share",
            "largest share of the available friction that the long link needs; it rests up to 1",
        ),
        "swap_hold": ("share", "the same for the middle mass while the links swap"),
        "drift": ("length", "displacement of the middle mass per gait"),
        "turn_promised": ("angle", "turn per gait if the conditions of rest hold"),
        "work_promised": ("energy", "work per gait if the conditions of rest hold"),
        "promise_error": (
            "share",
            "relative difference of turn, work and drift to the predicted values",
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
        "swing_angle": ("angle", ("swing",), "joint angles during a swing"),
        "hold_by_angle": ("share", ("swing",), "share of available friction the long link needs"),
    }

    kind: Literal["planar-turn"]
    want: tuple[Literal["crawl", "turning", "forces", "animation"], ...] = entry(
        "`crawl`: the worm over `cycles` in the plane; `turning`: heading, bound and friction "
        "needed; `forces`: forces of ground and actuators; `animation`: the moving worm",
        default=(),
    )
    worm: TurnerTable = entry("the worm and its gait")
    pace: PaceTable = entry("largest rates of the shape")
    cycles: int = whole(1, 100, "number of gaits shown", default=2)

    @property
    def swing_time(self) -> float:
        """Return the duration of a swing."""
        return abs(self.worm.bent - self.worm.straight) / self.pace.joint

    @property
    def swap_time(self) -> float:
        """Return the duration of a swap."""
        return (self.worm.long - self.worm.short) / self.pace.link

    def gait(self) -> TurnInPlace:
        """Return the gait of this scene."""
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
                f"{worm.short:g} is not below worm.long, {worm.long:g}; with equal links the "
                "swinging link is not determined; write a smaller number",
            )
        elif worm.long - worm.short < 1e-6 * worm.long:
            yield (
                "worm.short",
                "too close to worm.long to determine numerically which link swings; "
                f"write {0.999 * worm.long:g}, say",
            )
        for name in ("straight", "bent"):
            if abs(getattr(worm, name)) >= math.pi:
                yield f"worm.{name}", "beyond the range of a joint; write an angle within ±π"
        if worm.straight == worm.bent:
            yield "worm.bent", "equals worm.straight, so the joint does not swing; write another"
