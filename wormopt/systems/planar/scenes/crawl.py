"""Scenes of kind "planar-crawl": a stroke of a body that crawls slowly on dry ground."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    PerMass,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
)
from wormopt.systems.planar.scenes.tables import BodyTable, StrokeTable

if TYPE_CHECKING:  # laws are made in runs: checking a scene loads no numerics
    from wormopt.model.planar_friction import Elliptic

CRAWL_VARIABLES: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "time": ("time", ("time",), "from the start"),
    "x": ("length", ("mass", "time"), "places of the masses; at first the head looks along x"),
    "y": ("length", ("mass", "time"), "and to the left"),
    "center_x": ("length", ("time",), "mean place of the masses"),
    "center_y": ("length", ("time",), "and to the left"),
    "heading": ("angle", ("time",), "angle of the first link"),
    "resting": ("1", ("mass", "time"), "1 while a mass rests"),
    "phase": ("1", ("stroke_time",), "phase of a stroke, from 0 to 1"),
    "shape": ("1", ("shape_variable", "stroke_time"), "shape variables: lengths, then angles"),
    "head_velocity": (
        "speed",
        ("axis", "stroke_time"),
        "of the head, along link 0 and to its left",
    ),
    "tail_velocity": ("speed", ("axis", "stroke_time"), "of the tail, along its link and left"),
    "ground_ahead": ("force", ("mass", "stroke_time"), "of the ground, along a mass's heading"),
    "ground_left": ("force", ("mass", "stroke_time"), "and to its left"),
    "stroke_resting": ("1", ("mass", "stroke_time"), "1 while a mass rests"),
    "link_force": ("force", ("link", "stroke_time"), "of the actuators of links, which push"),
    "joint_torque": (
        "energy",
        ("joint", "stroke_time"),
        "of those of joints, the front to the left",
    ),
    "power": ("power", ("stroke_time",), "that the ground takes"),
    "stage_start": ("1", ("stage",), "phases at which the same masses begin to rest and slide"),
    "stage_resting": ("1", ("stage", "mass"), "1 for the masses that rest in a stage"),
}
CRAWL_SCALARS: Mapping[str, tuple[str, str]] = {
    "distance": ("length", "way of the head in one stroke; free of it where `turn` is 0"),
    "displacement": ("length", "[ahead, to the left], in the frame at the start"),
    "turn": ("angle", "angle by which a stroke turns the body to the left"),
    "circle_centre": (
        "length",
        "of the circle of repeated strokes, [x, y]; unknown without a turn",
    ),
    "circle_radius": ("length", "likewise, for the head"),
    "speed": ("speed", "`distance` by the period"),
    "work": ("energy", "that the ground takes in a stroke"),
    "mean_power": ("power", "`work` by the period"),
    "work_per_distance": ("force", "unknown where the stroke turns, or goes nowhere"),
    "work_per_distance_floor": (
        "force",
        "sum of the masses' least resistances: no stroke without a turn or load takes less",
    ),
    "stages": ("count", "of a stroke, between which masses stop, go or turn back"),
    "actuator_work": ("energy", "of the actuators in a stroke, by their loads from the head down"),
    "balance_error": ("share", "forces and moments left, of those there are"),
    "work_error": ("share", "`actuator_work` and that of the load less `work`, over it"),
    "dual_error": ("share", "powers by forces of most resistance, at sampled phases, apart"),
    "dual_twist_error": ("share", "and velocities of the body, of that of the fastest mass"),
    "even_error": ("share", "displacement by even phases apart, of the length of the body"),
    "gauss_error": ("share", "likewise by Gauss' rule on fixed phases and the breaks"),
}


class PerMassGround(Table, frozen=True, kw_only=True):
    """Dry ground that resists forward, backward and sideways motion differently."""

    law: Annotated[
        Literal["elliptic", "unit"],
        says("", "`elliptic`: the force of an ellipse that takes most power; `unit` is refused"),
    ] = "elliptic"
    forward: Annotated[PerMass, says("force", "*F*<sup>+</sup>, against motion ahead")]
    backward: Annotated[
        PerMass | None, says("force", "*F*<sup>−</sup>, against motion back; as `forward`")
    ] = None
    sideways: Annotated[
        PerMass | None, says("force", "*F*<sub>n</sub>, against motion aside; as `forward`")
    ] = None

    def numbers(self, masses: int) -> list[tuple[float, float, float]]:
        """Resistances of each mass ahead, back and aside."""
        given = (self.forward, self.backward or self.forward, self.sideways or self.forward)
        rows = [one if isinstance(one, tuple) else (one,) * masses for one in given]
        return list(zip(*rows, strict=True))

    def laws(self, masses: int) -> list[Elliptic]:
        """The law of each mass."""
        from wormopt.model.planar_friction import Elliptic

        return [Elliptic(*row) for row in self.numbers(masses)]

    def faults(self, key: str, masses: int) -> Iterator[Fault]:
        """Check that lists have a number for each mass, and that the law has a minimum."""
        for name in ("forward", "backward", "sideways"):
            yield from wrong_count(f"{key}.{name}", getattr(self, name), masses, "masses")
        if self.law == "unit":
            yield (
                f"{key}.law",
                '"unit" has no principle of least power, and which of its motions a slow body '
                'takes may be open; write "elliptic"',
            )


class LoadTable(Table, frozen=True, kw_only=True):
    """What pulls at the head and turns with the first link."""

    ahead: Annotated[Finite, says("force", "along the first link")] = 0.0
    left: Annotated[Finite, says("force", "to its left")] = 0.0
    moment: Annotated[Finite, says("energy", "to the left")] = 0.0

    @property
    def numbers(self) -> tuple[float, float, float]:
        """All three."""
        return (self.ahead, self.left, self.moment)


class PlanarCrawlScene(SceneTable, frozen=True, kw_only=True):
    """A body crawls so slowly on dry ground that its inertia does not matter: where a stroke leads.

    At every instant it moves with the velocity of least power; which masses rest and when, follows
    exactly. See
    [theory](../theory-planar.md#3-slow-crawling-on-dry-ground). Status
    `failed`: another way finds another motion, or forces, moments or works are not balanced.

    `timings_s`: `crawl` and `recheck`.
    """

    headline: ClassVar = ("distance", "turn", "work", "speed", "stages")
    scalars: ClassVar = dict(CRAWL_SCALARS)
    variables: ClassVar = dict(CRAWL_VARIABLES)

    kind: Literal["planar-crawl"]
    want: Annotated[
        tuple[Literal["crawl", "forces", "animation"], ...],
        says(
            "",
            "`crawl`: the body over `cycles` in the plane; `forces`: of the ground and actuators "
            "over a stroke, with the masses at rest; `animation`: the body as it goes",
        ),
    ] = ()
    body: Annotated[BodyTable, says("", "the body")]
    ground: Annotated[PerMassGround, says("", "the ground; numbers for all masses or each")]
    stroke: Annotated[StrokeTable, says("", "course of its shape variables")]
    load: Annotated[LoadTable, says("", "what pulls at it")] = field(default_factory=LoadTable)
    period: Annotated[
        Positive, says("time", "of a stroke; way and work do not hang on it, speed and power do")
    ] = 1.0
    cycles: Annotated[
        int,
        Meta(ge=1, le=100, description="a whole number from 1 to 100"),
        says("count", "strokes that are shown"),
    ] = 2
    samples: Annotated[
        int,
        Meta(ge=16, le=4096, description="a whole number from 16 to 4096"),
        says("count", "phases at which changes are looked for at first"),
    ] = 128

    @property
    def n_s(self) -> int:
        """Number of shape variables."""
        return (0 if self.body.sizes else self.body.links) + self.body.links - 1

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        yield from self.ground.faults("ground", self.body.links + 1)
        if self.n_s == 0:
            yield "body.links", "one link of fixed length has no shape to change; write 3"
            return
        wrong = list(self.stroke.faults("stroke", self.n_s))
        yield from wrong
        if not wrong:
            yield from _wrong_shapes(self)


def _wrong_shapes(table: PlanarCrawlScene) -> Iterator[Fault]:
    """Faults where lengths may vanish or joints go round."""
    lengths = table.n_s - (table.body.links - 1)
    for k, (low, high) in enumerate(_reach(table.stroke)):
        if k < lengths and low <= 0:
            yield (
                "stroke",
                f"link {k + 1} is as short as {low:.3g} in it; write lengths that stay above 0",
            )
        elif k >= lengths and max(-low, high) >= math.pi:
            yield (
                "stroke",
                f"joint {k - lengths + 1} bends by {max(-low, high):.3g}; write angles within ±π",
            )
    if all(high - low < 1e-12 * max(1, high) for low, high in _reach(table.stroke)):
        yield "stroke", "nothing changes in it; write a mean and other rows than 0, or more corners"


def _reach(stroke: StrokeTable) -> list[tuple[float, float]]:
    """Least and largest value of each shape variable, of harmonics a sample of them."""
    if stroke.__struct_config__.tag == "polygon":
        rows = stroke.corners  # type: ignore[union-attr]
    else:
        rows = [_harmonic(stroke, 2 * math.pi * k / 360) for k in range(360)]
    return [(min(column), max(column)) for column in zip(*rows, strict=True)]


def _harmonic(stroke: StrokeTable, angle: float) -> list[float]:
    mean, cosine, sine = stroke.mean, stroke.cosine, stroke.sine  # type: ignore[union-attr]
    found = list(mean)
    for h, (c, s) in enumerate(zip(cosine, sine, strict=True), start=1):
        for k in range(len(mean)):
            found[k] += c[k] * math.cos(h * angle) + s[k] * math.sin(h * angle)
    return found
