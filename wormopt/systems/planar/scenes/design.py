"""Scenes of kind "planar-design": the best gait of a body in the plane."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Pair,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
    wrong_order,
)
from wormopt.systems.planar.scenes.swim import ViscousTable
from wormopt.systems.planar.scenes.tables import BodyTable, GroundTable

if TYPE_CHECKING:  # what tables tell is built in runs: listing scenes loads no numerics
    from wormopt.systems.planar.body.shape import Shape
    from wormopt.systems.planar.design.aim import PlanarAim
    from wormopt.systems.planar.design.ground import Ground

Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]
Starts = Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")]
Corners = Annotated[int, Meta(ge=3, le=60, description="a whole number from 3 to 60")]
Cycles = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]


class PlanarAimTable(Table, frozen=True, kw_only=True):
    """What the gait is for."""

    purpose: Annotated[
        Literal["speed", "turn", "work"],
        says(
            "",
            "`speed`: fastest without net turn; `turn`: largest turn by time; `work`: least work "
            "to `pose`",
        ),
    ] = "speed"
    pivot: Annotated[
        int | Literal["any", "centre"],
        says("", "of `turn`, what is where it was after a cycle: a mass, the masses' centre, any"),
    ] = "any"
    pose: Annotated[
        tuple[Finite, ...] | None,
        says("", "[*x*, *y*, angle] of the head to reach, in its frame at the start"),
    ] = None
    cycles: Annotated[Cycles, says("count", "in which the pose is reached")] = 1
    closed: Annotated[bool, says("", "whether the shape returns")] = True
    start: Annotated[
        tuple[Finite, ...] | None, says("", "shape to begin with; left out, it is free")
    ] = None
    time: Annotated[
        Positive, says("time", "of a cycle to `pose` on viscous ground, whose work hangs on it")
    ] = 1.0


class PlanarLimitsTable(Table, frozen=True, kw_only=True):
    """What shape, rates, work and room must keep to."""

    angle: Annotated[Range, says("angle", "least and largest angle of a joint")] = (-2.0, 2.0)
    length: Annotated[
        Pair | None, says("length", "least and largest of a link; required where lengths vary")
    ] = None
    angle_rate: Annotated[Positive, says("rate", "largest rate of an angle")] = 1.0
    length_rate: Annotated[Positive, says("speed", "largest rate of a length")] = 1.0
    effort: Annotated[
        Positive | None, says("energy", "most work in a cycle; dry ground only, or `work`")
    ] = None
    half_width: Annotated[
        Positive | None, says("length", "half the width of a passage along the way")
    ] = None
    radius: Annotated[
        NonNegative, says("length", "of the links, rods with round ends, in the passage")
    ] = 0.0


class PlanarSearchTable(Table, frozen=True, kw_only=True):
    """Where the search begins."""

    starts: Annotated[Starts, says("count", "strokes by chance to begin with")] = 3
    seed: Annotated[int, Meta(ge=0), says("count", "of chance")] = 0
    corners: Annotated[Corners, says("count", "corners of the stroke")] = 8


class PlanarDesignScene(SceneTable, frozen=True, kw_only=True):
    """The best gait of a body in the plane, moved slowly: fastest, turning, or cheapest.

    The shape goes straight from corner to corner. From strokes by chance, optimal control with ever
    steeper friction leads to corners, which are made best by the exact motion; what is told is that
    of the exact motion. A local optimum. See [theory](../theory-planar.md#9-design-of-gaits).

    `timings_s`: `search` and `recheck`.
    """

    headline: ClassVar = ("speed", "turn_rate", "work_per_distance", "duration")
    scalars: ClassVar = {
        "displacement": ("length", "[ahead, to the left] of the head in a cycle"),
        "turn": ("angle", "in a cycle"),
        "distance": ("length", "way of the head in a cycle"),
        "duration": ("time", "of a cycle, at the fastest pace"),
        "speed": ("speed", "`distance` by `duration`"),
        "turn_rate": ("rate", "`turn` by `duration`"),
        "work": ("energy", "that the ground takes in a cycle"),
        "work_per_distance": ("force", "`work` by `distance`"),
        "work_bound": (
            "energy",
            "no gait that moves the masses so far takes less of dry ground; unknown of viscous",
        ),
        "work_over_bound": ("1", "`work` by it"),
        "turn_bound": (
            "rate",
            "largest `turn_rate` of two links of which one rests at any instant; else unknown",
        ),
        "turn_over_bound": ("1", "`turn_rate` by it"),
        "circle_radius": ("length", "of the circle of repeated cycles; unknown without a turn"),
        "half_width": ("length", "half the width that the links take along the way"),
        "starts_found": ("1", "what each start led to"),
        "miss": ("1", "largest of what should vanish: turn, way of the pivot, way to the pose"),
        "recheck_error": ("1", "displacement by smoothed friction at given instants"),
    }
    variables: ClassVar = {
        "time": ("time", ("instant",), "time"),
        "shape": ("1", ("shape_variable", "instant"), "shape variables: lengths, then angles"),
        "x": ("length", ("mass", "instant"), "places of the masses, ahead is +x at the start"),
        "y": ("length", ("mass", "instant"), "and to the left"),
        "rest": ("1", ("mass", "instant"), "1 where the mass rests"),
        "corner": (
            "1",
            ("corner", "shape_variable"),
            "corners of the stroke, as `stroke.corners` of `planar-crawl` and `planar-swim`",
        ),
    }

    kind: Literal["planar-design"]
    want: Annotated[
        tuple[Literal["planar_gait", "animation"], ...],
        says(
            "",
            "`planar_gait`: the body in the plane, its shape over time and the stroke; "
            "`animation`: the body as it goes",
        ),
    ] = ()
    body: Annotated[BodyTable, says("", "the body")]
    ground: Annotated[GroundTable | None, says("", "dry ground; this or `viscous`")] = None
    grips: Annotated[
        tuple[Positive, ...] | None,
        says("1", "by how much more dry ground resists each mass, head first; 1 if left out"),
    ] = None
    viscous: Annotated[ViscousTable | None, says("", "viscous ground")] = None
    aim: Annotated[PlanarAimTable, says("", "what the gait is for")] = field(
        default_factory=PlanarAimTable
    )
    limits: Annotated[PlanarLimitsTable, says("", "what it must keep to")] = field(
        default_factory=PlanarLimitsTable
    )
    search: Annotated[PlanarSearchTable, says("", "where the search begins")] = field(
        default_factory=PlanarSearchTable
    )

    @property
    def planar_aim(self) -> PlanarAim:
        """What is wanted; ArgumentError where it makes no sense."""
        from wormopt.systems.planar.design.aim import PlanarAim, PlanarLimits

        given, aim, shape = self.limits, self.aim, self.body.shape()
        limits = PlanarLimits(
            length=_pair(given.length or (0.5, 1.0)), angle=_pair(given.angle),
            length_rate=given.length_rate, angle_rate=given.angle_rate, effort=given.effort,
            half_width=given.half_width, radius=given.radius,
        )  # fmt: skip
        pose = aim.pose
        x, y, turn = pose or (0.0, 0.0, 0.0)
        return PlanarAim(
            shape, self._ground(shape), limits, aim.purpose,
            pose=(x, y, turn) if pose else None, cycles=aim.cycles,
            closed=aim.closed, start=aim.start,
            pivot=aim.pivot, corners=self.search.corners,
            time=aim.time,
        )  # fmt: skip

    def _ground(self, shape: Shape) -> Ground:
        from wormopt.model.planar_friction import Elliptic
        from wormopt.systems.planar.design.ground import Dry, Viscous
        from wormopt.systems.planar.swimming.swimmer import Swimmer

        if self.viscous is not None:
            drags = self.viscous
            return Viscous(
                Swimmer(
                    shape,
                    rods=(drags.along, drags.across),
                    masses=(drags.mass_along, drags.mass_across),
                )
            )
        assert self.ground is not None
        law = self.ground.friction()
        grips = self.grips or (1.0,) * shape.n_points
        numbers = [float(part) for part in (law.forward, law.backward, law.sideways)]  # type: ignore[attr-defined]
        return Dry(tuple(Elliptic(*(grip * number for number in numbers)) for grip in grips))

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        yield from self._faults()

    def _faults(self) -> Iterator[Fault]:
        if (self.ground is None) == (self.viscous is None):
            yield "ground", "exactly one of ground and viscous must be given"
        if self.ground is not None and self.ground.law != "elliptic":
            yield (
                "ground.law",
                "only elliptic friction has a motion of least power; write elliptic",
            )
        if self.viscous is not None:
            yield from self.viscous.faults("viscous")
            if self.grips is not None:
                yield "grips", "these are of dry ground; leave them out"
        yield from wrong_count("grips", self.grips, self.body.links + 1, "masses")
        if self.aim.pose is not None and len(self.aim.pose) != 3:
            yield "aim.pose", "write [x, y, angle]"
        for name in ("angle", "length"):
            pair = getattr(self.limits, name)
            if pair is not None:
                yield from wrong_order(f"limits.{name}", pair, may_be_equal=False)
        if self.body.lengths is None and self.limits.length is None:
            yield "limits.length", "lengths are shape variables: write [0.5, 1.0], say"


def _pair(numbers: tuple[float, ...]) -> tuple[float, float]:
    least, most = numbers
    return least, most
