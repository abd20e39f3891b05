"""Scenes of kind "planar-design": the best gait of a body in the plane."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.types import Finite, Pair, Positive, SceneTable, Seed, wrong_order
from wormopt.systems.planar.scenes.tables import BodyTable, GroundTable
from wormopt.systems.planar.tables import Drags as ViscousTable

if TYPE_CHECKING:  # numerics are built in runs, so that listing scenes loads none
    from wormopt.systems.planar.body.shape import Shape
    from wormopt.systems.planar.design.aim import PlanarAim
    from wormopt.systems.planar.design.ground import Ground

Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]
Starts = Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")]
Corners = Annotated[int, Meta(ge=3, le=60, description="a whole number from 3 to 60")]


class PlanarAimTable(Given):
    """Objective of the gait."""

    purpose: Literal["speed", "turn", "work"] = entry(
        "`speed`: highest speed without net turn; `turn`: highest turn rate; `work`: least "
        "work to reach `pose`",
        default="speed",
    )
    pivot: int | Literal["any", "centre"] = entry(
        "for `turn`: the point that returns after a cycle; a mass, `centre`, or `any`",
        default="any",
    )
    pose: tuple[Finite, ...] | None = entry(
        "for `work`: [*x*, *y*, angle] of the head to reach, in its frame at the start",
        default=None,
    )
    cycles: int = whole(1, 1000, "number of cycles in which the pose is reached", default=1)
    closed: bool = entry("whether the shape must return to its start", default=True)
    start: tuple[Finite, ...] | None = entry("initial shape; free if left out", default=None)
    time: float = positive(
        "time",
        "duration of a cycle to `pose` on viscous ground, where work depends on it",
        default=1.0,
    )


class PlanarLimitsTable(Given):
    """Limits of shape, rates, work and room."""

    angle: Range = entry("least and largest joint angle", quantity="angle", default=(-2.0, 2.0))
    length: Pair | None = entry(
        "least and largest link length; required if lengths are shape variables",
        quantity="length",
        default=None,
    )
    angle_rate: float = positive("rate", "largest rate of a joint angle", default=1.0)
    length_rate: float = positive("speed", "largest rate of a link length", default=1.0)
    effort: float | None = positive(
        "energy",
        "largest work per cycle; for dry ground, or if `aim.purpose` is `work`",
        default=None,
    )
    half_width: float | None = positive(
        "length", "half the width of a passage along the displacement", default=None
    )
    radius: float = number(
        "length", "radius of the links, rods with round ends, in the passage", least=0, default=0.0
    )


class PlanarSearchTable(Given):
    """Starting points of the search."""

    starts: int = whole(1, 100, "number of random initial strokes", default=3)
    seed: Seed = entry("seed of the random numbers", quantity="count", default=0)
    corners: int = whole(3, 60, "number of corners of the stroke", default=8)


class PlanarDesignScene(SceneTable):
    """Design of a gait in slow planar motion: fastest, turning, or with least work.

    The shape changes linearly from corner to corner. From random strokes, optimal control with
    increasingly steep friction finds the corners. A local search with the exact motion then refines
    them. All results come from the exact motion, and the optimum is local. See
    [theory](../theory-planar.md#9-design-of-gaits).

    `timings_s`: `search` and `recheck`.
    """

    headline: ClassVar = ("speed", "turn_rate", "work_per_distance", "duration")
    scalars: ClassVar = {
        "displacement": ("length", "displacement of the head per cycle, [forward, to the left]"),
        "turn": ("angle", "rotation per cycle, positive to the left"),
        "distance": ("length", "distance of the head per cycle"),
        "duration": ("time", "duration of a cycle at the highest rates allowed"),
        "speed": ("speed", "`distance` divided by `duration`"),
        "turn_rate": ("rate", "`turn` divided by `duration`"),
        "work": ("energy", "work dissipated by the ground per cycle"),
        "work_per_distance": ("force", "`work` divided by `distance`"),
        "work_bound": (
            "energy",
            "lower bound of `work` for this displacement on dry ground; unknown on viscous ground",
        ),
        "work_over_bound": ("1", "`work` divided by `work_bound`"),
        "turn_bound": (
            "rate",
            "bound of `turn_rate` for two links one of which always rests; else unknown",
        ),
        "turn_over_bound": ("1", "`turn_rate` divided by `turn_bound`"),
        "circle_radius": (
            "length",
            "radius of the circle of repeated cycles; unknown without a turn",
        ),
        "half_width": ("length", "half the width that the links need across the displacement"),
        "starts_found": ("1", "objective reached from each start"),
        "miss": ("1", "largest residual of the requirements on turn, pivot or pose"),
        "recheck_error": ("1", "difference in displacement to smoothed friction at fixed instants"),
    }
    variables: ClassVar = {
        "time": ("time", ("instant",), "time"),
        "shape": ("1", ("shape_variable", "instant"), "shape variables: lengths, then angles"),
        "x": ("length", ("mass", "instant"), "*x* of each mass; the body starts facing +x"),
        "y": ("length", ("mass", "instant"), "*y* of each mass"),
        "rest": ("1", ("mass", "instant"), "1 where the mass rests, else 0"),
        "corner": (
            "1",
            ("corner", "shape_variable"),
            "corners of the stroke, as in `stroke.corners` of `planar-crawl` and `planar-swim`",
        ),
    }

    kind: Literal["planar-design"]
    want: tuple[Literal["planar_gait", "animation"], ...] = entry(
        "`planar_gait`: the body in the plane, its shape over time, and the stroke; "
        "`animation`: the moving body",
        default=(),
    )
    body: BodyTable = entry("the body")
    ground: GroundTable | None = entry("dry ground; this or `viscous`", default=None)
    grips: tuple[Positive, ...] | None = entry(
        "factor of each mass on the dry friction, head first; all 1 if left out",
        quantity="1",
        default=None,
    )
    viscous: ViscousTable | None = entry("viscous ground; this or `ground`", default=None)
    aim: PlanarAimTable = entry("objective of the gait", default=PlanarAimTable)
    limits: PlanarLimitsTable = entry("limits of the gait", default=PlanarLimitsTable)
    search: PlanarSearchTable = entry("starting points of the search", default=PlanarSearchTable)

    @property
    def planar_aim(self) -> PlanarAim:
        """Return the objective; raises ArgumentError if it is inconsistent."""
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
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.body.faults("body")
        yield from self._faults()

    def _faults(self) -> Iterator[Fault]:
        if (self.ground is None) == (self.viscous is None):
            yield "ground", "exactly one of ground and viscous is required"
        if self.ground is not None and self.ground.law != "elliptic":
            yield (
                "ground.law",
                'only elliptic friction has a motion of least power; write "elliptic"',
            )
        if self.viscous is not None and self.grips is not None:
            yield "grips", "applies to dry ground only; leave it out"
        yield from wrong_count("grips", self.grips, self.body.links + 1, "masses")
        if self.aim.pose is not None and len(self.aim.pose) != 3:
            yield "aim.pose", "missing; write [x, y, angle]"
        for name in ("angle", "length"):
            pair = getattr(self.limits, name)
            if pair is not None:
                yield from wrong_order(f"limits.{name}", pair, may_be_equal=False)
        if self.body.lengths is None and self.limits.length is None:
            yield "limits.length", "missing; lengths are shape variables: write [0.5, 1.0], say"


def _pair(numbers: tuple[float, ...]) -> tuple[float, float]:
    least, most = numbers
    return least, most
