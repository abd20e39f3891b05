"""Scenes of kind "peristaltic-design": the fastest gait of a worm that anchors in a tube."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    NonNegative,
    Pair,
    Positive,
    SceneTable,
    Table,
    says,
)

# Sizes that differ by so little are the same.
_ROUNDING = 1e-9
Segments = Annotated[int, Meta(ge=3, le=12, description="a whole number from 3 to 12")]
Phases = Annotated[int, Meta(ge=3, le=16, description="a whole number from 3 to 16")]
Rate = Annotated[
    Positive | Pair, Meta(description="a number above 0, or two, [contraction, extension]")
]
Anchors = Annotated[int, Meta(ge=1, le=10, description="a whole number from 1 to 10")]
Reserve = Annotated[float, Meta(ge=1, le=1e6, description="a number of at least 1")]


class AnchoringWormTable(Table, frozen=True, kw_only=True):
    """The worm: sealed segments that grow thick where they are short."""

    segments: Annotated[Segments, says("count", "number of segments *N*")]
    length: Annotated[Positive, says("length", "*L* of a segment at rest, its longest")]
    radius: Annotated[Positive, says("length", "*R* of a segment at rest, its least")]
    drag: Annotated[NonNegative, says("force", "of each segment that moves")]
    load: Annotated[NonNegative, says("force", "on the worm, against its advance")] = 0.0
    push: Annotated[
        Positive | None,
        says("force", "that a segment pushes with as it grows; without it nothing is warned of"),
    ] = None


class TubeTable(Table, frozen=True, kw_only=True):
    """The tube."""

    radius: Annotated[Positive, says("length", "inner radius, above that of the worm")]
    friction: Annotated[Positive, says("1", "coefficient of dry friction on its wall")]
    wall_force: Annotated[Positive, says("force", "normal force of an anchored segment, all round")]

    @property
    def hold(self) -> float:
        """Friction of an anchored segment."""
        return self.friction * self.wall_force


class AnchorLimitsTable(Table, frozen=True, kw_only=True):
    """What the gait must keep to."""

    rate: Annotated[Rate, says("speed", "largest rate of a length, the same of both if one")]
    clearance: Annotated[
        Positive, says("length", "between the wall and a segment that moves, see above")
    ]
    reserve: Annotated[Reserve, says("1", "anchors hold so many times what they must at least")] = (
        1.0
    )
    anchors: Annotated[
        Anchors | None,
        says("count", "anchored at any time, at least; as many as must hold if left out"),
    ] = None


class OrderSearchTable(Table, frozen=True, kw_only=True):
    """How the order of anchors is sought, and what is proven."""

    phases: Annotated[
        Phases, says("count", "a cycle has at most so many; the bound speaks of those")
    ] = 6
    time_limit: Annotated[Positive, says("s", "seconds after which the bound stands as it is")] = (
        50.0
    )


class PeristalticDesignScene(SceneTable, frozen=True, kw_only=True):
    """The fastest gait of a peristaltic worm that anchors in a tube, and proof of it.

    A segment is sealed: at length *l* its radius is *R*√(*L*/*l*). At *L*(*R*/*R*_t)² it touches
    the wall; it is anchored, and rests, while it is as short as that. A segment that is anchored
    neither before nor after the end of a phase has the clearance there: each flight from rest to
    rest has a phase in which it lifts and one in which it lands. So many segments are anchored at
    any time that *k μ N*_w ≥ reserve × (load + drag × (*N* − *k*)). Explained in
    [theory-peristaltic.md](../theory-peristaltic.md#3-anchored-gaits).

    Refused: a worm as thick as its tube, or with no room for the clearance; a wall force that would
    need more than *N* − 2 anchors, with the one that would do.

    The trust report has `checks`: of the gait's lengths against ways of the rings, anchored
    segments that move or are long, clearance of flights, rates, slides by the quasi-static motion
    of least dissipation with the friction given, speed over the ceiling and below the waves.
    `facts`: what the certificate speaks of, assumptions. Warned of: a gap above 1 %; a push of the
    foremost growing segment above `worm.push`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "mean speed of the designed gait"),
        "advance": ("length", "per cycle"),
        "period": ("time", "of a cycle"),
        "ceiling": ("speed", "no gait is faster, by rates and number of anchors alone"),
        "bound": ("speed", "no gait of at most `search.phases` phases is faster"),
        "gap_certified": ("1", "by which share the gait could be faster at most"),
        "wave_speed": (
            "speed",
            "of the fastest wave of (*N* − *m*) *D* a cycle that holds as well",
        ),
        "wave_short": ("count", "its short segments *m*"),
        "gain": ("1", "speed over that of the wave"),
        "anchors": ("count", "anchored at any time, at least: *k*"),
        "hold": ("force", "of an anchored segment, *μ N*_w"),
        "reserve_min": ("1", "least holding reserve of all phases"),
        "push_max": ("force", "drag that the foremost growing segment pushes, largest"),
        "shortest": ("length", "of a segment at the wall"),
        "stroke": ("length", "longest less shortest length, *D*"),
        "lift": ("length", "by which a segment with the clearance is longer than the shortest"),
        "clearance_min": ("length", "from the wall, least of the largest of all flights"),
        "rate_limit": ("speed", "of contraction and extension"),
        "order": ("1", "anchored segments of each phase"),
        "durations": ("time", "of the phases"),
        "reserves": ("1", "holding reserve of each phase, unknown where it lasts no time"),
        "n_phases": ("count", "phases that last"),
        "nodes": ("count", "of the trees of branch and bound"),
        "worm_radius": ("length", "as given"),
        "tube_radius": ("length", "as given"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "length": ("length", ("segment", "time"), "length of the segment"),
        "radius": ("length", ("segment", "time"), "radius of the segment"),
        "anchored": ("1", ("segment", "time"), "1 where the segment is anchored"),
        "position": ("length", ("ring", "time"), "position of the ring"),
        "wave_time": ("time", ("wave_time",), "time"),
        "wave_position": ("length", ("wave_time",), "position of the head in the wave"),
    }

    kind: Literal["peristaltic-design"]
    want: Annotated[
        tuple[Literal["peristalsis", "animation"], ...],
        says(
            "",
            "`peristalsis`: the body in its tube over a cycle, and its advance against the "
            "ceiling; `animation`: it moves",
        ),
    ] = ()
    worm: Annotated[AnchoringWormTable, says("", "the worm")]
    tube: Annotated[TubeTable, says("", "the tube")]
    limits: Annotated[AnchorLimitsTable, says("", "what the gait must keep to")]
    search: Annotated[OrderSearchTable, says("", "how it is sought")] = field(
        default_factory=OrderSearchTable
    )

    @property
    def rates(self) -> tuple[float, float]:
        """Largest rates of contraction and extension."""
        rate = self.limits.rate
        contraction, extension = rate if isinstance(rate, tuple) else (rate, rate)
        return contraction, extension

    def length_of(self, radius: float) -> float:
        """Length at which a segment has a radius."""
        return self.worm.length * (self.worm.radius / radius) ** 2

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        worm, room = self.worm, self.tube.radius - self.worm.radius
        if room <= 0:
            yield (
                "tube.radius",
                f"{self.tube.radius:g} leaves no room for a worm of radius {worm.radius:g}; "
                "write more than that",
            )
        elif self.limits.clearance > room * (1 + _ROUNDING):
            yield (
                "limits.clearance",
                f"{self.limits.clearance:g} is more than the room {room:g} between worm and tube; "
                "write at most that",
            )
        most = worm.segments - 2
        if (self.limits.anchors or 0) > most:
            yield (
                "limits.anchors",
                f"{self.limits.anchors} of {worm.segments} segments leave none to move; write at "
                f"most {most}, or more segments",
            )
