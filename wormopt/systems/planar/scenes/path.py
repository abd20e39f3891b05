"""Scenes of kind "planar-path": a path through the plane, composed of strokes of gaits."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.types import Finite, Positive, SceneTable, per
from wormopt.systems.planar.scenes.tables import BodyTable, GroundTable

Place = Annotated[
    tuple[Finite, ...], Meta(min_length=2, max_length=2, description="[x, y], two finite numbers")
]
Pose = Annotated[
    tuple[Finite, ...],
    Meta(min_length=3, max_length=3, description="[x, y, angle], three finite numbers"),
]
Mass = Annotated[int, Meta(ge=0, le=200, description="a mass, a whole number from 0 on")]
Name = Annotated[str, Meta(min_length=1, max_length=40, description="a short name in quotes")]


class HeldTable(Given):
    """Constraints of the body until a phase of the stroke."""

    until: float = positive("share", "phase at which they end; 1 for the last", default=1.0)
    pins: tuple[Mass, ...] = entry("masses that do not move", default=())
    skids: tuple[Mass, ...] = entry("masses that move only along their heading", default=())


class GaitTable(Given):
    """A gait: changes of the shape from the rest shape, and the constraints meanwhile."""

    name: Name = entry("name of the gait")
    mirrored: Name | None = entry(
        "name of the mirror image of the gait; none if left out", default=None
    )
    changes: tuple[tuple[Finite, ...], ...] = entry(
        "successive shapes less the rest shape, at amplitude 1; then back to rest"
    )
    held: tuple[HeldTable, ...] = entry(
        "constraints, phase by phase; if left out, a slow crawl by friction alone", default=()
    )
    amplitudes: Annotated[
        tuple[Positive, ...],
        Meta(min_length=1, max_length=20, description="ascending numbers above 0"),
    ] = entry(
        "amplitudes used by the search; final amplitudes lie within their range",
        quantity="1",
        default=(0.5, 1.0),
    )

    def faults(self, key: str, body: BodyTable) -> Iterator[Fault]:
        """Yield faults of rows, phases and masses."""
        masses, variables = body.links + 1, _n_s(body)
        if not self.changes or any(len(row) != variables for row in self.changes):
            yield (
                f"{key}.changes",
                f"has rows of a wrong length; write {variables} numbers, one per shape variable",
            )
        if any(b <= a for a, b in pairwise(self.amplitudes)):
            yield f"{key}.amplitudes", "the amplitudes do not ascend; write the smallest first"
        ends = [0.0, *(held.until for held in self.held)]
        if self.held and (ends[-1] != 1.0 or any(b <= a for a, b in pairwise(ends))):
            yield f"{key}.held", "the phases do not ascend to 1; write the last until = 1.0"
        for j, held in enumerate(self.held):
            who = (*held.pins, *held.skids)
            if who and max(who) >= masses:
                yield f"{key}.held[{j}]", f"there is no mass {max(who)}; the tail is {masses - 1}"
            elif len(set(who)) < len(who):
                yield f"{key}.held[{j}]", "a mass is listed twice; a pin needs no skid"
            elif 2 * len(held.pins) + len(held.skids) < 3:
                yield (
                    f"{key}.held[{j}]",
                    "the body is not fully constrained; write a pin and a skid",
                )


class DiscTable(Given, tag_field="shape", tag="disc"):
    """A round obstacle."""

    centre: Place = entry("centre of the disc", quantity="length")
    radius: float = positive("length", "radius of the disc")


class BlockTable(Given, tag_field="shape", tag="block"):
    """A solid polygon."""

    corners: Annotated[
        tuple[Place, ...], Meta(min_length=3, max_length=100, description="three places or more")
    ] = entry("corners in order", quantity="length")

    @property
    def flat(self) -> bool:
        """Return whether the polygon has no area."""
        pairs = zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True)
        twice = sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs)
        wide = max(max(row) - min(row) for row in zip(*self.corners, strict=True))
        return (
            abs(twice) < 1e-9 * wide * wide or wide == 0
        )  # no power: it raises where it overflows


class WallTable(Given, tag_field="shape", tag="wall"):
    """A straight wall without end: everything behind it is closed."""

    point: Place = entry("any point of the wall", quantity="length")
    angle: float = number("angle", "direction of the normal, which points into the open")


class CapsuleTable(Given, tag_field="shape", tag="capsule"):
    """A rod or a fence: all points within a radius of a straight segment."""

    start: Place = entry("first end of the segment", quantity="length")
    end: Place = entry("second end of the segment", quantity="length")
    radius: float = number("length", "half the thickness", least=0, default=0.0)


class NearTable(Given):
    """Largest distance and angle from a pose."""

    place: float = positive("length", "largest distance")
    angle: float = positive("angle", "largest angle")


class CorridorTable(Given):
    """A line with a strip to both sides that no mass may leave."""

    line: Annotated[
        tuple[Place, ...], Meta(min_length=2, max_length=200, description="two places or more")
    ] = entry("corners of the line in order", quantity="length")
    width: float = positive("length", "largest distance from the line to either side")


class CourseTable(Given):
    """Start, goal and limits of the path."""

    start: Pose = entry("initial pose of the head: x, y, and angle of the first link")
    goal: Pose = entry("pose to reach; the angle is modulo 2π")
    tolerance: NearTable = entry("accepted distance of the end from the goal")
    via: tuple[Place, ...] = entry(
        "places that the head must pass, in this order", quantity="length", default=()
    )
    via_radius: float = positive("length", "accepted distance from these places", default=0.2)
    corridor: CorridorTable | None = entry("strip that no mass may leave", default=None)
    clearance: float = number("length", "least distance from obstacles", least=0, default=0.0)


class PathSearchTable(Given):
    """Options of the search."""

    cost: Literal["steps", "work", "time"] = entry("quantity to minimise", default="time")
    capture: Annotated[
        NearTable, says("", "distance to the goal at which the library search ends")
    ] = field(default_factory=lambda: NearTable(place=0.35, angle=0.35))
    cell: Annotated[NearTable, says("", "cell of poses within which only the cheapest is kept")] = (
        field(default_factory=lambda: NearTable(place=0.1, angle=0.1))
    )
    poses: int = whole(1, 10000000, "largest number of poses searched", default=100_000)


class PlanarPathScene(SceneTable):
    """Find strokes of given gaits that lead a worm to a pose, past obstacles, at least cost.

    Pins and skids determine the motion of a worm by its shape. Without them, friction determines
    a slow crawl. Each stroke is a step with a displacement in the plane, work, time, and an area
    swept. A search finds the best steps of the library. Then the amplitudes are optimised until
    the path meets the pose. See
    [theory](../theory-planar.md#8-paths).

    `timings_s`: `library`, `plan` and `recheck`.
    """

    headline: ClassVar = ("steps", "work", "time", "room", "off_place")
    scalars: ClassVar = {
        "steps": ("count", "number of steps"),
        "work": ("energy", "work dissipated by sliding along the path"),
        "time": ("time", "duration at the highest rates allowed"),
        "cost_searched": ("1", "cost of the steps from the library, before amplitudes change"),
        "room": (
            "length",
            "least distance from obstacles and the corridor, less radius and clearance",
        ),
        "room_simulated": ("length", "the same from points along the links in the simulation"),
        "off_place": ("length", "distance of the simulated end from the goal"),
        "off_angle": ("angle", "angle of the simulated end less the angle of the goal"),
        "pin_load": ("force", "largest load of a pin"),
        "condition": ("1", "largest condition number of the constraints"),
        "poses_looked": ("count", "number of poses searched"),
        "routes_polished": ("count", "number of routes whose amplitudes were optimised"),
    }
    variables: ClassVar = {
        "instant": ("time", ("instant",), "time"),
        "x": ("length", ("mass", "instant"), "*x* of the mass"),
        "y": ("length", ("mass", "instant"), "*y* of the mass"),
        "pinned": ("1", ("mass", "instant"), "1 if the mass is pinned, or rests in a crawl"),
        "amplitude": ("1", ("step",), "amplitude of the step"),
        "step_work": ("energy", ("step",), "work of the step"),
        "step_time": ("time", ("step",), "duration of the step"),
        "pose_x": ("length", ("stop",), "*x* of the head between steps"),
        "pose_y": ("length", ("stop",), "*y* of the head between steps"),
        "pose_angle": ("angle", ("stop",), "heading between steps"),
    }

    kind: Literal["planar-path"]
    want: tuple[Literal["path", "animation"], ...] = entry(
        "`path`: bodies between steps and the area swept; `animation`: the moving body", default=()
    )
    body: BodyTable = entry("the worm")
    radius: float = number("length", "half the thickness of the body", least=0, default=0.0)
    rest: tuple[Finite, ...] = entry(
        "rest shape, between steps: lengths, if they vary, then joint angles"
    )
    rates: Positive | tuple[Positive, ...] = entry(
        "largest rates of the shape variables, one for all or one for each", default=1.0
    )
    ground: GroundTable = entry("friction of sliding masses")
    pin_load: float | None = positive("force", "largest load that a pin can hold", default=None)
    gaits: Annotated[
        tuple[GaitTable, ...], Meta(min_length=1, max_length=50, description="one gait or more")
    ] = entry("library of gaits")
    obstacles: tuple[DiscTable | BlockTable | CapsuleTable | WallTable, ...] = entry(
        "obstacles that the body may not touch", default=()
    )
    course: CourseTable = entry("start, goal and limits of the path")
    search: PathSearchTable = entry("how", default=PathSearchTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        variables = _n_s(self.body)
        if len(self.rest) != variables:
            yield "rest", f"has {len(self.rest)} numbers for {variables} shape variables"
        elif self.body.lengths is None and min(self.rest[: self.body.links]) <= 0:
            yield "rest", "a link length is not above 0; write lengths above 0"
        if isinstance(self.rates, tuple) and len(self.rates) != variables:
            yield "rates", f"has {len(self.rates)} numbers for {variables} shape variables"
        names = [n for gait in self.gaits for n in (gait.name, gait.mirrored) if n]
        if len(set(names)) < len(names):
            yield "gaits", "two gaits have the same name; write different names"
        if self.ground.law != "elliptic" and not all(gait.held for gait in self.gaits):
            yield "ground.law", 'a gait without pins and skids needs least power; write "elliptic"'
        for j, each in enumerate(self.obstacles):
            if isinstance(each, BlockTable) and each.flat:
                yield f"obstacles[{j}].corners", "they span no area; for a fence write a capsule"
        for j, gait in enumerate(self.gaits):
            yield from gait.faults(f"gaits[{j}]", self.body)
            if gait.mirrored and any(self.rest[variables - self.body.links + 1 :]):
                yield (
                    f"gaits[{j}].mirrored",
                    "the rest shape is bent; write the mirrored gait as a gait of its own",
                )
            if len(self.rest) == variables:
                yield from _too_short(self, f"gaits[{j}]", gait)


def _n_s(body: BodyTable) -> int:
    return (body.links if body.lengths is None else 0) + body.links - 1


def _too_short(scene: PlanarPathScene, key: str, gait: GaitTable) -> Iterator[Fault]:
    """Yield strokes in which a link vanishes or a joint folds over."""
    lengths = scene.body.links if scene.body.lengths is None else 0
    for row in gait.changes:
        shape = [r + max(gait.amplitudes) * d for r, d in zip(scene.rest, row, strict=False)]
        if any(length <= 0 for length in shape[:lengths]):
            yield (
                f"{key}.changes",
                "a link vanishes at the largest amplitude; write smaller changes",
            )
            return
        if any(abs(angle) >= 3.14159 for angle in shape[lengths:]):
            yield f"{key}.changes", "a joint folds over at the largest amplitude; bend it less"
            return


def rates_of(scene: PlanarPathScene) -> tuple[float, ...]:
    """Largest rate of each shape variable."""
    return tuple(per(scene.rates, _n_s(scene.body)))
