"""Scenes of kind "planar-path": a path through the plane, put together from steps of gaits."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Positive,
    SceneTable,
    Table,
    per,
    says,
)
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


class HeldTable(Table, frozen=True, kw_only=True):
    """What holds the body up to a phase of the stroke."""

    until: Annotated[Positive, says("share", "phase up to which; 1 for the last")] = 1.0
    pins: Annotated[tuple[Mass, ...], says("", "masses that do not move")] = ()
    skids: Annotated[tuple[Mass, ...], says("", "masses that move along their heading only")] = ()


class GaitTable(Table, frozen=True, kw_only=True):
    """A gait: changes of the shape from the one at rest, and what holds meanwhile."""

    name: Annotated[Name, says("", "of the gait")]
    mirrored: Annotated[
        Name | None, says("", "name of the gait that bends to the other side; left out, none")
    ] = None
    changes: Annotated[
        tuple[tuple[Finite, ...], ...],
        says("", "shapes less that at rest, one after another, at amplitude 1; then back to rest"),
    ]
    held: Annotated[
        tuple[HeldTable, ...],
        says("", "what holds, phase by phase; left out, nothing but friction: a slow crawl"),
    ] = ()
    amplitudes: Annotated[
        tuple[Positive, ...],
        Meta(min_length=1, max_length=20, description="ascending numbers above 0"),
        says("1", "those that the search uses; in between lie those of the end"),
    ] = (0.5, 1.0)

    def faults(self, key: str, body: BodyTable) -> Iterator[Fault]:
        """Check rows, phases, and masses."""
        masses, variables = body.links + 1, _n_s(body)
        if not self.changes or any(len(row) != variables for row in self.changes):
            yield (
                f"{key}.changes",
                f"write rows of {variables} numbers, one for each shape variable",
            )
        if any(b <= a for a, b in pairwise(self.amplitudes)):
            yield f"{key}.amplitudes", "they must ascend; write the smallest first"
        ends = [0.0, *(held.until for held in self.held)]
        if self.held and (ends[-1] != 1.0 or any(b <= a for a, b in pairwise(ends))):
            yield f"{key}.held", "phases must rise to until = 1.0"
        for j, held in enumerate(self.held):
            who = (*held.pins, *held.skids)
            if who and max(who) >= masses:
                yield f"{key}.held[{j}]", f"there is no mass {max(who)}; the tail is {masses - 1}"
            elif len(set(who)) < len(who):
                yield f"{key}.held[{j}]", "a mass stands there twice; a pin needs no skid"
            elif 2 * len(held.pins) + len(held.skids) < 3:
                yield f"{key}.held[{j}]", "this leaves the body free; write a pin and a skid"


class DiscTable(Table, frozen=True, kw_only=True, tag_field="shape", tag="disc"):
    """A round obstacle."""

    centre: Annotated[Place, says("length", "its centre")]
    radius: Annotated[Positive, says("length", "its radius")]


class BlockTable(Table, frozen=True, kw_only=True, tag_field="shape", tag="block"):
    """A solid polygon."""

    corners: Annotated[
        tuple[Place, ...],
        Meta(min_length=3, max_length=100, description="three places or more"),
        says("length", "its corners in order"),
    ]

    @property
    def flat(self) -> bool:
        """Whether it has no area."""
        pairs = zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True)
        twice = sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs)
        wide = max(max(row) - min(row) for row in zip(*self.corners, strict=True))
        return (
            abs(twice) < 1e-9 * wide * wide or wide == 0
        )  # no power: it raises where it overflows


class WallTable(Table, frozen=True, kw_only=True, tag_field="shape", tag="wall"):
    """A straight wall without end: all that lies behind it is closed."""

    point: Annotated[Place, says("length", "any point of it")]
    angle: Annotated[Finite, says("angle", "direction of its normal, into the open")]


class CapsuleTable(Table, frozen=True, kw_only=True, tag_field="shape", tag="capsule"):
    """A rod or a fence: all points near a straight line from one end to the other."""

    start: Annotated[Place, says("length", "one end")]
    end: Annotated[Place, says("length", "the other")]
    radius: Annotated[NonNegative, says("length", "half its thickness")] = 0.0


class NearTable(Table, frozen=True, kw_only=True):
    """How near to a pose."""

    place: Annotated[Positive, says("length", "largest distance")]
    angle: Annotated[Positive, says("angle", "largest angle")]


class CorridorTable(Table, frozen=True, kw_only=True):
    """A line which all masses keep near to."""

    line: Annotated[
        tuple[Place, ...],
        Meta(min_length=2, max_length=200, description="two places or more"),
        says("length", "its corners in order"),
    ]
    width: Annotated[Positive, says("length", "largest distance to either side")]


class CourseTable(Table, frozen=True, kw_only=True):
    """From where to where."""

    start: Annotated[Pose, says("", "pose of the head: x, y, and angle of the first link")]
    goal: Annotated[Pose, says("", "pose to reach; the angle holds modulo 2π")]
    tolerance: Annotated[NearTable, says("", "how near the goal must be met")]
    via: Annotated[
        tuple[Place, ...], says("length", "places that the head must come by, in this order")
    ] = ()
    via_radius: Annotated[Positive, says("length", "how near")] = 0.2
    corridor: Annotated[CorridorTable | None, says("", "what the masses must stay in")] = None
    clearance: Annotated[NonNegative, says("length", "least distance from obstacles")] = 0.0


class PathSearchTable(Table, frozen=True, kw_only=True):
    """How the search goes about."""

    cost: Annotated[Literal["steps", "work", "time"], says("", "what is least")] = "time"
    capture: Annotated[
        NearTable, says("", "how near the amplitudes of the library must come to the goal")
    ] = field(default_factory=lambda: NearTable(place=0.35, angle=0.35))
    cell: Annotated[NearTable, says("", "cells of poses of which the cheapest alone is kept")] = (
        field(default_factory=lambda: NearTable(place=0.1, angle=0.1))
    )
    poses: Annotated[
        int,
        Meta(ge=1, le=10_000_000, description="a whole number from 1 to 10 million"),
        says("count", "after so many the search gives up"),
    ] = 100_000


class PlanarPathScene(SceneTable, frozen=True, kw_only=True):
    """Steps of a few gaits that lead a worm to a pose and past obstacles, at the least cost.

    A worm whose feet are pins or skids moves as its shape tells, one that nothing holds as friction
    lets a slow crawl. Each stroke is a step: a displacement in the plane, work, time, and what it
    sweeps over. The best steps of the library are searched, then amplitudes are changed until the
    pose is met. See
    [theory](../theory-planar.md#8-paths).

    `timings_s`: `library`, `plan` and `recheck`.
    """

    headline: ClassVar = ("steps", "work", "time", "room", "off_place")
    scalars: ClassVar = {
        "steps": ("count", "number of steps"),
        "work": ("energy", "what sliding takes in all"),
        "time": ("time", "as fast as the rates allow"),
        "cost_searched": ("1", "cost of the steps that the search found, before the polish"),
        "room": (
            "length",
            "least distance from what must not be touched, less radius and clearance",
        ),
        "room_simulated": ("length", "the same by points along the links of the simulation"),
        "off_place": ("length", "distance of the end from the goal, by simulation"),
        "off_angle": ("angle", "angle of the end less that of the goal, by simulation"),
        "pin_load": ("force", "largest load of a pin"),
        "condition": ("1", "largest condition number of what holds"),
        "poses_looked": ("count", "poses that the search took up"),
        "routes_polished": ("count", "routes whose amplitudes were changed to meet the goal"),
    }
    variables: ClassVar = {
        "instant": ("time", ("instant",), "time"),
        "x": ("length", ("mass", "instant"), "x of the mass"),
        "y": ("length", ("mass", "instant"), "y of the mass"),
        "pinned": ("1", ("mass", "instant"), "whether the mass is pinned, or rests in a crawl"),
        "amplitude": ("1", ("step",), "amplitude of the step"),
        "step_work": ("energy", ("step",), "work of the step"),
        "step_time": ("time", ("step",), "time of the step"),
        "pose_x": ("length", ("stop",), "x of the head between steps"),
        "pose_y": ("length", ("stop",), "y of the head between steps"),
        "pose_angle": ("angle", ("stop",), "heading between steps"),
    }

    kind: Literal["planar-path"]
    want: Annotated[
        tuple[Literal["path", "animation"], ...],
        says("", "`path`: bodies between steps and what they sweep; `animation`: the same, moving"),
    ] = ()
    body: Annotated[BodyTable, says("", "the worm")]
    radius: Annotated[NonNegative, says("length", "half the thickness of the body")] = 0.0
    rest: Annotated[
        tuple[Finite, ...], says("", "shape between steps: lengths, where they vary, then angles")
    ]
    rates: Annotated[
        Positive | tuple[Positive, ...],
        says("", "largest rates of the shape variables, one for all or one for each"),
    ] = 1.0
    ground: Annotated[GroundTable, says("", "friction of masses that slide")]
    pin_load: Annotated[Positive | None, says("force", "what a pin can bear")] = None
    gaits: Annotated[
        tuple[GaitTable, ...],
        Meta(min_length=1, max_length=50, description="one gait or more"),
        says("", "the library"),
    ]
    obstacles: Annotated[
        tuple[DiscTable | BlockTable | CapsuleTable | WallTable, ...],
        says("", "what must not be touched"),
    ] = ()
    course: Annotated[CourseTable, says("", "from where to where")]
    search: Annotated[PathSearchTable, says("", "how")] = field(default_factory=PathSearchTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        variables = _n_s(self.body)
        if len(self.rest) != variables:
            yield "rest", f"{len(self.rest)} numbers for {variables} shape variables"
        elif self.body.lengths is None and min(self.rest[: self.body.links]) <= 0:
            yield "rest", "lengths at rest must be above 0"
        if isinstance(self.rates, tuple) and len(self.rates) != variables:
            yield "rates", f"{len(self.rates)} numbers for {variables} shape variables"
        names = [n for gait in self.gaits for n in (gait.name, gait.mirrored) if n]
        if len(set(names)) < len(names):
            yield "gaits", "two gaits have the same name; write different ones"
        if self.ground.law != "elliptic" and not all(gait.held for gait in self.gaits):
            yield "ground.law", 'a gait that nothing holds crawls by least power; write "elliptic"'
        for j, each in enumerate(self.obstacles):
            if isinstance(each, BlockTable) and each.flat:
                yield f"obstacles[{j}].corners", "they span no area; for a fence write a capsule"
        for j, gait in enumerate(self.gaits):
            yield from gait.faults(f"gaits[{j}]", self.body)
            if gait.mirrored and any(self.rest[variables - self.body.links + 1 :]):
                yield f"gaits[{j}].mirrored", "the shape at rest is bent; write a gait of its own"
            if len(self.rest) == variables:
                yield from _too_short(self, f"gaits[{j}]", gait)


def _n_s(body: BodyTable) -> int:
    return (body.links if body.lengths is None else 0) + body.links - 1


def _too_short(scene: PlanarPathScene, key: str, gait: GaitTable) -> Iterator[Fault]:
    """Find strokes in which a link vanishes or a joint folds over."""
    lengths = scene.body.links if scene.body.lengths is None else 0
    for row in gait.changes:
        shape = [r + max(gait.amplitudes) * d for r, d in zip(scene.rest, row, strict=False)]
        if any(length <= 0 for length in shape[:lengths]):
            yield (
                f"{key}.changes",
                "at the largest amplitude a link vanishes; write smaller changes",
            )
            return
        if any(abs(angle) >= 3.14159 for angle in shape[lengths:]):
            yield f"{key}.changes", "at the largest amplitude a joint folds over; bend it less"
            return


def rates_of(scene: PlanarPathScene) -> tuple[float, ...]:
    """Largest rate of each shape variable."""
    return tuple(per(scene.rates, _n_s(scene.body)))
