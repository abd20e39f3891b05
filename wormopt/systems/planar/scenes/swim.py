"""Scenes of kind "planar-swim": a given or optimal stroke of a body on viscous ground."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, says, whole
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Finite, SceneTable
from wormopt.systems.planar.scenes.tables import BodyTable, StrokeTable

Row = tuple[Finite, ...]
_UNEVEN = 1e4  # largest ratio of lengths; rotational drags grow with their cubes


class ViscousTable(Given):
    """Viscous ground: drag of rods per length and of masses, along and across them."""

    along: float = number(
        "viscosity", "*c*<sub>t</sub>, drag of rods per length, along them", least=0, default=0.0
    )
    across: float = number(
        "viscosity", "*c*<sub>n</sub>, drag of rods per length, across them", least=0, default=0.0
    )
    mass_along: float = number(
        "drag", "*k*<sub>t</sub>, drag of masses along the heading", least=0, default=0.0
    )
    mass_across: float = number(
        "drag", "*k*<sub>n</sub>, drag of masses across the heading", least=0, default=0.0
    )

    def faults(self, key: str) -> Iterator[Fault]:
        """Yield a fault if the ground does not resist both along and across."""
        if max(min(self.along, self.across), min(self.mass_along, self.mass_across)) == 0:
            yield (
                key,
                "the ground must resist along and across; write along and across, or mass_along "
                "and mass_across, both above 0",
            )


class ShapeLimitsTable(Given):
    """Limits of the shape in the stroke."""

    angle: Row = entry(
        "[smallest, largest] angle of every joint, within ±π",
        quantity="angle",
        default=(
            -2.0,
            2.0,
        ),
    )
    length: Row | None = entry(
        "[shortest, longest] link; required if lengths are shape variables",
        quantity="length",
        default=None,
    )


class StrokeSearchTable(Given):
    """Objective and starting points of the search."""

    maximise: Literal["efficiency", "distance"] = entry(
        "`efficiency` (at the optimal pace), or `distance` alone", default="efficiency"
    )
    starts: int = whole(
        1, 8, "initial ellipses, around the middle of the limits and other shapes", default=3
    )


class PlanarSwimScene(SceneTable):
    """A stroke of a body on viscous ground: its displacement and its cost.

    If `stroke` is given, this stroke is computed. Otherwise the best stroke that does not turn the
    body is searched from a cold start. See [theory](../theory-planar.md#5-viscous-crawling).

    `timings_s`: `search` and `recheck`.
    """

    headline: ClassVar = ("distance", "turn", "efficiency", "action")
    scalars: ClassVar = {
        "distance": (
            "length",
            "distance of the frame per stroke; frame-independent if `turn` is 0",
        ),
        "displacement": ("length", "[forward, to the left], in the frame at the start"),
        "turn": ("angle", "rotation of the body per stroke"),
        "circle_radius": (
            "length",
            "radius of the circle of repeated strokes; unknown without a turn",
        ),
        "action": ("action", "least product of work and time, reached at constant power"),
        "efficiency": (
            "1",
            "drag of the straight body × `distance`² / `action`; unknown if the stroke turns",
        ),
        "efficiency_ceiling": ("1", "upper bound of the efficiency of any stroke"),
        "efficiency_spectral": (
            "1",
            "`efficiency` from harmonics; unknown if it was not optimised or limits are active",
        ),
        "efficiency_small": (
            "1",
            "efficiency of the best small stroke with the same distance, to first order; only for "
            "two shape variables",
        ),
        "starts_found": ("1", "objective reached from each start: efficiency, or distance"),
        "recheck_error": ("share", "difference in displacement to force balances stepped in time"),
    }
    variables: ClassVar = {
        "instant": ("share", ("instant",), "time over that of a stroke, at constant power"),
        "shape": ("1", ("shape_variable", "instant"), "shape variables: lengths, then angles"),
        "x": ("length", ("mass", "instant"), "*x* of each mass; the body starts facing +x"),
        "y": ("length", ("mass", "instant"), "*y* of each mass"),
        "power": ("1", ("instant",), "power over its mean, at even phases"),
        "height_s1": ("angle", ("s1",), "first angle, or length, of the height functions"),
        "height_s2": ("angle", ("s2",), "second"),
        "height": (
            "1",
            ("twist", "s1", "s2"),
            "displacement forward, to the left, and turn of a small stroke, per area",
        ),
    }

    kind: Literal["planar-swim"]
    want: tuple[Literal["swim", "heights", "animation"], ...] = entry(
        "`swim`: the body over a stroke in the plane; `heights`: height functions with the "
        "stroke (two shape variables); `animation`: the moving body",
        default=(),
    )
    body: BodyTable = entry("the body")
    ground: ViscousTable = entry("the ground")
    stroke: StrokeTable | None = entry(
        "the stroke; if left out, the best stroke is searched", default=None
    )
    frame: Literal["head", "middle", "calm"] = entry(
        "frame of the height functions: at the `head`, at the `middle` of the chain, or the "
        "`calm` frame, which moves least while the shape changes",
        default="calm",
    )
    limits: ShapeLimitsTable = entry(
        "limits of the stroke that is searched", default=ShapeLimitsTable
    )
    search: StrokeSearchTable = entry("options of the search", default=StrokeSearchTable)
    mesh: Annotated[
        MeshTable, says("", "discretisation; 16 arcs of degree 6 at Legendre points if left out")
    ] = field(
        default_factory=lambda: MeshTable(arcs=16, degree=6, scheme="legendre", tolerance=1e-6)
    )

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """Return the lower and upper limits of the shape variables."""
        lengths = [self.limits.length] * (self.body.links if self.body.lengths is None else 0)
        pairs = [pair or (0.0, 0.0) for pair in lengths]
        pairs += [self.limits.angle] * (self.body.links - 1)
        return [pair[0] for pair in pairs], [pair[1] for pair in pairs]

    @property
    def n_s(self) -> int:
        """Return the number of shape variables."""
        return self.body.links - 1 + (self.body.links if self.body.lengths is None else 0)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        sizes = self.body.sizes or (1.0,)
        if max(sizes) > _UNEVEN * min(sizes):
            yield "body.lengths", "the lengths differ too much; write lengths nearer to each other"
        yield from self.ground.faults("ground")
        if self.n_s == 0:
            yield "body.links", "a single link of fixed length has no shape to change; write 3"
        elif self.stroke is not None:
            yield from self._faults_of_stroke(self.stroke)
        else:
            yield from self._faults_of_search()
        if "heights" in self.want and self.n_s != 2:
            yield "want", f"height functions need two shape variables; the body has {self.n_s}"

    def _faults_of_stroke(self, stroke: StrokeTable) -> Iterator[Fault]:
        yield from stroke.faults("stroke", self.n_s)
        for name in stroke.__struct_fields__:
            value = getattr(stroke, name)
            rows = (value,) if name == "mean" else value
            first = self.n_s - (self.body.links - 1)  # the lengths come first
            if any(abs(angle) > 2 * math.pi for row in rows for angle in row[first:]):
                yield f"stroke.{name}", "a joint angle exceeds 2π; write angles in radians"
            sizes = [size for row in rows for size in row[:first]]
            if name in ("mean", "corners") and min(sizes, default=1.0) <= 0:
                yield f"stroke.{name}", "a link length is not above 0; write lengths before angles"

    def _faults_of_search(self) -> Iterator[Fault]:
        if self.n_s < 2:
            yield (
                "body.links",
                "a body with one shape variable has no net displacement in any stroke; write 3",
            )
        ground = self.ground
        alike = ground.along == ground.across and ground.mass_along == ground.mass_across
        if alike and self.body.lengths is not None:
            yield (
                "ground.across",
                "on ground with equal resistance in all directions the centre of a body of fixed "
                "lengths rests in any stroke; write more than along",
            )
        for name in ("angle", "length"):
            pair = getattr(self.limits, name)
            if pair is None:
                if name == "length" and self.body.lengths is None:
                    yield (
                        "limits.length",
                        "missing; lengths are shape variables: write [0.5, 1.5], say",
                    )
            elif len(pair) != 2 or not pair[0] < pair[1]:
                yield f"limits.{name}", "write [smallest, largest], the smaller number first"
            elif name == "length" and pair[0] <= 0:
                yield "limits.length", "the shortest length is not above 0; write one above 0"
            elif name == "angle" and max(map(abs, pair)) > math.pi:
                yield "limits.angle", "the links would cross; write angles within ±π (3.14159)"
