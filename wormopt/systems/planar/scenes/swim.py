"""Scenes of kind "planar-swim": a stroke of a body on viscous ground, given or the best."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    Finite,
    NonNegative,
    SceneTable,
    Table,
    says,
)
from wormopt.systems.planar.scenes.tables import BodyTable, StrokeTable

Row = tuple[Finite, ...]
_UNEVEN = 1e4  # lengths over each other; drags against turning go with their cubes


class ViscousTable(Table, frozen=True, kw_only=True):
    """Viscous ground: drags of rods, by length, and of points, along and across them."""

    along: Annotated[
        NonNegative, says("viscosity", "*c*<sub>t</sub>, of rods along themselves, by length")
    ] = 0.0
    across: Annotated[NonNegative, says("viscosity", "*c*<sub>n</sub>, and across")] = 0.0
    mass_along: Annotated[NonNegative, says("drag", "*k*<sub>t</sub>, of masses along")] = 0.0
    mass_across: Annotated[NonNegative, says("drag", "*k*<sub>n</sub>, and across")] = 0.0

    def faults(self, key: str) -> Iterator[Fault]:
        """Check that something resists both ways."""
        if max(min(self.along, self.across), min(self.mass_along, self.mass_across)) == 0:
            yield (
                key,
                "the ground must resist along and across; write along and across, or mass_along "
                "and mass_across, both above 0",
            )


class ShapeLimitsTable(Table, frozen=True, kw_only=True):
    """What the stroke must keep to."""

    angle: Annotated[Row, says("angle", "[smallest, largest] angle of every joint, within ±π")] = (
        -2.0,
        2.0,
    )
    length: Annotated[
        Row | None,
        says("length", "[shortest, longest] link; required where lengths are shape variables"),
    ] = None


class StrokeSearchTable(Table, frozen=True, kw_only=True):
    """What the stroke shall be best at, and where to begin."""

    maximise: Annotated[
        Literal["efficiency", "distance"],
        says("", "`efficiency`, of which the pace is best too, or the way alone"),
    ] = "efficiency"
    starts: Annotated[
        int,
        Meta(ge=1, le=8, description="a whole number from 1 to 8"),
        says("count", "ellipses to begin with, about the middle of the limits and other shapes"),
    ] = 3


class PlanarSwimScene(SceneTable, frozen=True, kw_only=True):
    """A stroke of a body on viscous ground: how far it gets and what it costs.

    With `stroke` that one is computed; without, the best stroke that does not turn the body is
    found from a cold start. See [theory](../theory-planar.md#5-viscous-crawling).

    `timings_s`: `search` and `recheck`.
    """

    headline: ClassVar = ("distance", "turn", "efficiency", "action")
    scalars: ClassVar = {
        "distance": ("length", "way of the frame in one stroke; free of it where `turn` is 0"),
        "displacement": ("length", "[ahead, to the left], in the frame at the start"),
        "turn": ("angle", "angle by which a stroke turns the body"),
        "circle_radius": ("length", "of the circle of repeated strokes; unknown without a turn"),
        "action": ("action", "work times time at constant power, the least"),
        "efficiency": (
            "1",
            "drag of the straight body × `distance`² by `action`; unknown where the stroke turns",
        ),
        "efficiency_ceiling": ("1", "which no stroke exceeds"),
        "efficiency_spectral": (
            "1",
            "`efficiency` found again by harmonics; unknown where none was searched or limits hold",
        ),
        "efficiency_small": (
            "1",
            "of the best small stroke that goes as far, to first order; two shape variables",
        ),
        "starts_found": ("1", "what each start led to: efficiencies, or ways"),
        "recheck_error": ("share", "way by balances of forces in the plane, stepped in time"),
    }
    variables: ClassVar = {
        "instant": ("share", ("instant",), "time over that of a stroke, at constant power"),
        "shape": ("1", ("shape_variable", "instant"), "shape variables: lengths, then angles"),
        "x": ("length", ("mass", "instant"), "places of the masses, at first ahead is +x"),
        "y": ("length", ("mass", "instant"), "and to the left"),
        "power": ("1", ("instant",), "power over its mean at even phase"),
        "height_s1": ("angle", ("s1",), "first angle, or length, of the height function"),
        "height_s2": ("angle", ("s2",), "second"),
        "height": (
            "1",
            ("twist", "s1", "s2"),
            "way ahead, to the left, and turn of a small stroke, by its area",
        ),
    }

    kind: Literal["planar-swim"]
    want: Annotated[
        tuple[Literal["swim", "heights", "animation"], ...],
        says(
            "",
            "`swim`: the body over a stroke in the plane; `heights`: curvature functions with the "
            "stroke (two shape variables); `animation`: the body as it goes",
        ),
    ] = ()
    body: Annotated[BodyTable, says("", "the body")]
    ground: Annotated[ViscousTable, says("", "the ground")]
    stroke: Annotated[
        StrokeTable | None, says("", "the stroke; left out, the best one is searched")
    ] = None
    frame: Annotated[
        Literal["head", "middle", "calm"],
        says(
            "",
            "of height functions: at the `head`; at the `middle` of the chain; or the `calm` one, "
            "that moves least while the shape changes",
        ),
    ] = "calm"
    limits: Annotated[ShapeLimitsTable, says("", "of a stroke that is searched")] = field(
        default_factory=ShapeLimitsTable
    )
    search: Annotated[StrokeSearchTable, says("", "how it is searched")] = field(
        default_factory=StrokeSearchTable
    )
    mesh: Annotated[
        MeshTable, says("", "how finely; 16 arcs of degree 6 at Legendre's points if left out")
    ] = field(
        default_factory=lambda: MeshTable(arcs=16, degree=6, scheme="legendre", tolerance=1e-6)
    )

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper limits of the shape variables."""
        lengths = [self.limits.length] * (self.body.links if self.body.lengths is None else 0)
        pairs = [pair or (0.0, 0.0) for pair in lengths]
        pairs += [self.limits.angle] * (self.body.links - 1)
        return [pair[0] for pair in pairs], [pair[1] for pair in pairs]

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        return self.body.links - 1 + (self.body.links if self.body.lengths is None else 0)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        sizes = self.body.sizes or (1.0,)
        if max(sizes) > _UNEVEN * min(sizes):
            yield "body.lengths", "too uneven to compute with; write lengths nearer to each other"
        yield from self.ground.faults("ground")
        if self.n_s == 0:
            yield "body.links", "one link of fixed length has no shape to change; write 3"
        elif self.stroke is not None:
            yield from self._faults_of_stroke(self.stroke)
        else:
            yield from self._faults_of_search()
        if "heights" in self.want and self.n_s != 2:
            yield "want", f"height functions need two shape variables, the body has {self.n_s}"

    def _faults_of_stroke(self, stroke: StrokeTable) -> Iterator[Fault]:
        yield from stroke.faults("stroke", self.n_s)
        for name in stroke.__struct_fields__:
            value = getattr(stroke, name)
            rows = (value,) if name == "mean" else value
            first = self.n_s - (self.body.links - 1)  # lengths are before
            if any(abs(angle) > 2 * math.pi for row in rows for angle in row[first:]):
                yield f"stroke.{name}", "a joint turns by more than a turn; write angles in radians"
            sizes = [size for row in rows for size in row[:first]]
            if name in ("mean", "corners") and min(sizes, default=1.0) <= 0:
                yield f"stroke.{name}", "links have lengths; write them first, all above 0"

    def _faults_of_search(self) -> Iterator[Fault]:
        if self.n_s < 2:
            yield (
                "body.links",
                "a body with one shape variable gets nowhere, whatever its stroke; write 3",
            )
        ground = self.ground
        alike = ground.along == ground.across and ground.mass_along == ground.mass_across
        if alike and self.body.lengths is not None:
            yield (
                "ground.across",
                "on ground that resists all ways alike the centre of a body of fixed lengths "
                "rests, whatever its stroke; write more than along",
            )
        for name in ("angle", "length"):
            pair = getattr(self.limits, name)
            if pair is None:
                if name == "length" and self.body.lengths is None:
                    yield "limits.length", "lengths are shape variables: write [0.5, 1.5], say"
            elif len(pair) != 2 or not pair[0] < pair[1]:
                yield f"limits.{name}", "write [smallest, largest], the smaller number first"
            elif name == "length" and pair[0] <= 0:
                yield "limits.length", "a link keeps a length; write a smallest one above 0"
            elif name == "angle" and max(map(abs, pair)) > math.pi:
                yield "limits.angle", "links would cross; write angles within ±π (3.14159)"
