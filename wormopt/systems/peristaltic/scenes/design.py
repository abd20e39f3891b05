"""Scenes of kind "peristaltic-design": the fastest gait of a worm that anchors in a tube."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Pair, Positive, SceneTable

# Relative difference below which sizes count as equal.
_ROUNDING = 1e-9
Phases = Annotated[int, Meta(ge=3, le=16, description="a whole number from 3 to 16")]
Rate = Annotated[
    Positive | Pair, Meta(description="a number above 0, or two, [contraction, extension]")
]


class AnchoringWormTable(Given):
    """The worm: sealed segments that thicken as they shorten."""

    segments: int = whole(3, 12, "number of segments *N*")
    length: float = positive("length", "rest length *L* of a segment, its longest")
    radius: float = positive("length", "rest radius *R* of a segment, its least")
    drag: float = number("force", "dry drag of each moving segment", least=0)
    load: float = number("force", "load against the advance of the worm", least=0, default=0.0)
    push: float | None = positive(
        "force", "push available from a growing segment; not checked if left out", default=None
    )


class TubeTable(Given):
    """The tube."""

    radius: float = positive("length", "inner radius, above that of the worm")
    friction: float = positive("1", "coefficient of dry friction on its wall")
    wall_force: float = positive("force", "total normal force of an anchored segment")

    @property
    def hold(self) -> float:
        """Return the friction limit of an anchored segment."""
        return self.friction * self.wall_force


class AnchorLimitsTable(Given):
    """Limits of the gait."""

    rate: Rate = entry("largest rate of a length; one value holds for both", quantity="speed")
    clearance: float = positive(
        "length", "least clearance of a moving segment from the wall, see above"
    )
    reserve: float = number(
        "1",
        "least ratio of friction limit to force on the anchors",
        least=1,
        most=1000000.0,
        default=1.0,
    )
    anchors: int | None = whole(
        1, 10, "least number of anchored segments; the least that holds if left out", default=None
    )


class OrderSearchTable(Given):
    """Options of the search for the order of anchors, and of the proof."""

    phases: int = whole(
        3, 16, "largest number of phases in a cycle; the bound is for these gaits", default=6
    )
    time_limit: float = positive("s", "time after which the proof of the bound stops", default=50.0)


class PeristalticDesignScene(SceneTable):
    """The fastest gait of a peristaltic worm that anchors in a tube, with a certified bound.

    A segment is sealed: at length *l* its radius is *R*√(*L*/*l*). At *L*(*R*/*R*_t)² it touches
    the wall. It is anchored, and rests, while it has this length. A segment that is anchored
    neither before nor after the end of a phase has the clearance there. Each flight from rest to
    rest therefore has a phase in which the segment lifts and one in which it lands. The number *k*
    of anchored segments satisfies *k μ N*_w ≥ reserve × (load + drag × (*N* − *k*)) at any time.
    See [theory-peristaltic.md](../theory-peristaltic.md#3-anchored-gaits).

    A worm as thick as its tube is refused, as is a clearance without room. A wall force that needs
    more than *N* − 2 anchors is refused; the message gives the least force that suffices.

    The trust report has `checks` of the gait's lengths against the displacements of the rings,
    anchored segments that move or are long, clearance of flights, and rates. Further checks cover
    slips in the quasi-static motion of least dissipation, and speed against the ceiling and the
    waves. `facts` state the scope of the certificate and the assumptions. Warnings report a gap
    above 1 % and a push of the foremost growing segment above `worm.push`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "mean speed of the designed gait"),
        "advance": ("length", "advance per cycle"),
        "period": ("time", "duration of a cycle"),
        "ceiling": ("speed", "upper bound for every gait, from rates and number of anchors alone"),
        "bound": ("speed", "upper bound for gaits of at most `search.phases` phases"),
        "gap_certified": ("1", "largest relative increase in speed that is still possible"),
        "wave_speed": (
            "speed",
            "speed of the fastest wave with advance (*N* − *m*) *D* per cycle that also holds",
        ),
        "wave_short": ("count", "number of short segments *m* in the wave"),
        "gain": ("1", "speed divided by that of the wave"),
        "anchors": ("count", "least number *k* of anchored segments at any time"),
        "hold": ("force", "friction limit of an anchored segment, *μ N*_w"),
        "reserve_min": ("1", "least holding reserve of all phases"),
        "push_max": ("force", "largest drag that the foremost growing segment pushes"),
        "shortest": ("length", "length of a segment at the wall"),
        "stroke": ("length", "longest less shortest length, *D*"),
        "lift": ("length", "length of a segment with the clearance less the shortest length"),
        "clearance_min": ("length", "least over all flights of the largest distance from the wall"),
        "rate_limit": ("speed", "largest rates of contraction and extension"),
        "order": ("1", "anchored segments of each phase"),
        "durations": ("time", "durations of the phases"),
        "reserves": ("1", "holding reserve of each phase; unknown for phases of no duration"),
        "n_phases": ("count", "number of phases with a duration above 0"),
        "nodes": ("count", "number of nodes of branch and bound"),
        "worm_radius": ("length", "`worm.radius`"),
        "tube_radius": ("length", "`tube.radius`"),
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
    want: tuple[Literal["peristalsis", "animation"], ...] = entry(
        "`peristalsis`: the body in its tube over a cycle, and its advance with the "
        "ceiling; `animation`: the moving body",
        default=(),
    )
    worm: AnchoringWormTable = entry("the worm")
    tube: TubeTable = entry("the tube")
    limits: AnchorLimitsTable = entry("limits of the gait")
    search: OrderSearchTable = entry("options of the search", default=OrderSearchTable)

    @property
    def rates(self) -> tuple[float, float]:
        """Return the largest rates of contraction and extension."""
        rate = self.limits.rate
        contraction, extension = rate if isinstance(rate, tuple) else (rate, rate)
        return contraction, extension

    def length_of(self, radius: float) -> float:
        """Return the length at which a segment has a radius."""
        return self.worm.length * (self.worm.radius / radius) ** 2

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
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
                f"{self.limits.clearance:g} exceeds the room {room:g} between worm and tube; "
                "write at most that",
            )
        most = worm.segments - 2
        if (self.limits.anchors or 0) > most:
            yield (
                "limits.anchors",
                f"{self.limits.anchors} of {worm.segments} segments leave none to move; write at "
                f"most {most}, or more segments",
            )
