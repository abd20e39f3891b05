"""Scenes of kind "planar-crawl": one stroke of a body that crawls slowly on dry ground."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.types import PerMass, SceneTable
from wormopt.systems.planar.scenes.tables import BodyTable, StrokeTable

if TYPE_CHECKING:  # laws are made in runs: checking a scene loads no numerics
    from wormopt.model.planar_friction import Elliptic

CRAWL_VARIABLES: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "time": ("time", ("time",), "time since the start"),
    "x": ("length", ("mass", "time"), "*x* of each mass; the head starts with its heading along x"),
    "y": ("length", ("mass", "time"), "*y* of each mass"),
    "center_x": ("length", ("time",), "mean *x* of the masses"),
    "center_y": ("length", ("time",), "mean *y* of the masses"),
    "heading": ("angle", ("time",), "angle of the first link"),
    "resting": ("1", ("mass", "time"), "1 while the mass rests, else 0"),
    "phase": ("1", ("stroke_time",), "phase of the stroke, from 0 to 1"),
    "shape": ("1", ("shape_variable", "stroke_time"), "shape variables: lengths, then angles"),
    "head_velocity": (
        "speed",
        ("axis", "stroke_time"),
        "velocity of the head, along link 0 and to its left",
    ),
    "tail_velocity": (
        "speed",
        ("axis", "stroke_time"),
        "velocity of the tail, along its link, left",
    ),
    "ground_ahead": ("force", ("mass", "stroke_time"), "ground force along the mass's heading"),
    "ground_left": ("force", ("mass", "stroke_time"), "ground force to the left of the heading"),
    "stroke_resting": ("1", ("mass", "stroke_time"), "1 while the mass rests, else 0"),
    "link_force": (
        "force",
        ("link", "stroke_time"),
        "force of the link's actuator; positive pushes",
    ),
    "joint_torque": (
        "energy",
        ("joint", "stroke_time"),
        "torque of the joint's actuator; positive turns the front to the left",
    ),
    "power": ("power", ("stroke_time",), "power dissipated by friction"),
    "stage_start": ("1", ("stage",), "phases at which the set of resting masses changes"),
    "stage_resting": ("1", ("stage", "mass"), "1 for the masses that rest in the stage"),
}
CRAWL_SCALARS: Mapping[str, tuple[str, str]] = {
    "distance": ("length", "distance of the head per stroke; frame-independent if `turn` is 0"),
    "displacement": ("length", "[forward, to the left], in the frame at the start"),
    "turn": ("angle", "rotation of the body to the left per stroke"),
    "circle_centre": (
        "length",
        "centre of the circle of repeated strokes, [x, y]; unknown without a turn",
    ),
    "circle_radius": ("length", "radius of that circle for the head; unknown without a turn"),
    "speed": ("speed", "`distance` divided by the period"),
    "work": ("energy", "work dissipated by friction per stroke"),
    "mean_power": ("power", "`work` divided by the period"),
    "work_per_distance": ("force", "unknown if the stroke turns the body or leads nowhere"),
    "work_per_distance_floor": (
        "force",
        "lower bound of `work_per_distance` for strokes without turn or load: the sum of the "
        "masses' least resistances",
    ),
    "stages": ("count", "stages per stroke; a mass stops, starts or reverses between two stages"),
    "actuator_work": ("energy", "work of the actuators per stroke, from their loads"),
    "balance_error": ("share", "residual of forces and moments, relative to the largest"),
    "work_error": ("share", "`actuator_work` plus the load's work less `work`, relative to `work`"),
    "dual_error": ("share", "difference in power to the dual problem, at sampled phases"),
    "dual_twist_error": (
        "share",
        "difference in body velocity to the dual problem, relative to the fastest mass",
    ),
    "even_error": (
        "share",
        "difference in displacement to a quadrature at even phases, relative to the body length",
    ),
    "gauss_error": (
        "share",
        "difference in displacement to Gauss' rule between fixed phases and breaks, relative to "
        "the body length",
    ),
}


class PerMassGround(Given):
    """Dry ground that resists forward, backward and sideways motion differently."""

    law: Literal["elliptic", "unit"] = entry(
        "friction law; only `elliptic` is accepted, `unit` is refused", default="elliptic"
    )
    forward: PerMass = entry("*F*<sup>+</sup>, resistance to forward motion", quantity="force")
    backward: PerMass | None = entry(
        "*F*<sup>−</sup>, resistance to backward motion; `forward` if left out",
        quantity="force",
        default=None,
    )
    sideways: PerMass | None = entry(
        "*F*<sub>n</sub>, resistance to sideways motion; `forward` if left out",
        quantity="force",
        default=None,
    )

    def numbers(self, masses: int) -> list[tuple[float, float, float]]:
        """Return the forward, backward and sideways resistance of each mass."""
        given = (self.forward, self.backward or self.forward, self.sideways or self.forward)
        rows = [one if isinstance(one, tuple) else (one,) * masses for one in given]
        return list(zip(*rows, strict=True))

    def laws(self, masses: int) -> list[Elliptic]:
        """Return the friction law of each mass."""
        from wormopt.model.planar_friction import Elliptic

        return [Elliptic(*row) for row in self.numbers(masses)]

    def faults(self, key: str, masses: int) -> Iterator[Fault]:
        """Yield lists of a wrong length and laws without a minimum principle."""
        for name in ("forward", "backward", "sideways"):
            yield from wrong_count(f"{key}.{name}", getattr(self, name), masses, "masses")
        if self.law == "unit":
            yield (
                f"{key}.law",
                '"unit" has no principle of least power, so the motion of a slow body may not be '
                'unique; write "elliptic"',
            )


class LoadTable(Given):
    """Load on the head, which turns with the first link."""

    ahead: float = number("force", "force along the first link", default=0.0)
    left: float = number("force", "force to the left of the first link", default=0.0)
    moment: float = number("energy", "moment, positive to the left", default=0.0)

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Force ahead, force to the left, and moment."""
        return (self.ahead, self.left, self.moment)


class PlanarCrawlScene(SceneTable):
    """A body crawls on dry ground so slowly that its inertia does not matter.

    At every instant the body moves with the velocity of least power. The phases at which masses
    stop and start follow exactly. See
    [theory](../theory-planar.md#3-slow-crawling-on-dry-ground). The status is `failed` if a second
    route finds another motion, or if forces, moments or works are not balanced.

    `timings_s`: `crawl` and `recheck`.
    """

    headline: ClassVar = ("distance", "turn", "work", "speed", "stages")
    scalars: ClassVar = dict(CRAWL_SCALARS)
    variables: ClassVar = dict(CRAWL_VARIABLES)

    kind: Literal["planar-crawl"]
    want: tuple[Literal["crawl", "forces", "animation"], ...] = entry(
        "`crawl`: the body over `cycles` in the plane; `forces`: ground and actuator forces "
        "over a stroke, with the resting masses; `animation`: the moving body",
        default=(),
    )
    body: BodyTable = entry("the body")
    ground: PerMassGround = entry("the ground; a value for all masses, or one for each")
    stroke: StrokeTable = entry("periodic change of the shape variables")
    load: LoadTable = entry("load on the head", default=LoadTable)
    period: float = positive(
        "time", "duration of a stroke; distance and work do not depend on it", default=1.0
    )
    cycles: int = whole(1, 100, "number of strokes shown", default=2)
    samples: int = whole(
        16, 4096, "initial number of phases at which changes of rest are searched", default=128
    )

    @property
    def n_s(self) -> int:
        """Return the number of shape variables."""
        return (0 if self.body.sizes else self.body.links) + self.body.links - 1

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        yield from self.ground.faults("ground", self.body.links + 1)
        if self.n_s == 0:
            yield "body.links", "a single link of fixed length has no shape to change; write 3"
            return
        wrong = list(self.stroke.faults("stroke", self.n_s))
        yield from wrong
        if not wrong:
            yield from _wrong_shapes(self)


def _wrong_shapes(table: PlanarCrawlScene) -> Iterator[Fault]:
    """Yield faults where a length may vanish or a joint may turn past π."""
    lengths = table.n_s - (table.body.links - 1)
    for k, (low, high) in enumerate(_reach(table.stroke)):
        if k < lengths and low <= 0:
            yield (
                "stroke",
                f"link {k + 1} shrinks to {low:.3g} in the stroke; write lengths that stay above 0",
            )
        elif k >= lengths and max(-low, high) >= math.pi:
            yield (
                "stroke",
                f"joint {k - lengths + 1} bends by {max(-low, high):.3g}; write angles within ±π",
            )
    if all(high - low < 1e-12 * max(1, high) for low, high in _reach(table.stroke)):
        yield "stroke", "the shape never changes; write another row than 0, or different corners"


def _reach(stroke: StrokeTable) -> list[tuple[float, float]]:
    """Least and largest value of each shape variable; harmonics are sampled."""
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
