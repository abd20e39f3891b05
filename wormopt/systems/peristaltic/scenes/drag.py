"""Scenes of kind "peristaltic-drag": the best gait of a worm on linear drag."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Pair, SceneTable, wrong_order
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

Segments = Annotated[int, Meta(ge=2, le=20, description="a whole number from 2 to 20")]


class DragTable(Given):
    """Drag *c*(*l*) = *c*<sub>0</sub>(*l*/*L*)<sup>*a*</sup> on the centre of a segment."""

    exponent: float = number(
        "1", "exponent *a*: 1 for drag per present length, below 0 if thick segments grip"
    )
    coefficient: float = positive(
        "drag", "drag *c*<sub>0</sub> of a segment of length *L*", default=1.0
    )


class DragWormTable(Given):
    """A worm of segments that can all stretch and shorten."""

    segments: int = whole(2, 20, "number of segments")
    length: float = positive("length", "reference length *L* of a segment", default=1.0)


class EffortTable(Given):
    """Effort allowed in a period; exactly one of the two."""

    strain_rate: float | None = positive(
        "rate", "∫∑(*l*′<sub>j</sub>/*L*)² d*t* over a period", default=None
    )
    dissipation: float | None = positive(
        "energy", "energy dissipated in a period by drag spread along each segment", default=None
    )


class DragLimitsTable(Given):
    """Limits of the lengths."""

    mean_length: float | None = positive(
        "length", "mean length of each segment over a period; free if left out", default=None
    )
    keeps_length: bool = entry(
        "whether the total length of the worm is constant; needs `mean_length`", default=False
    )
    length: Pair | None = entry(
        "least and largest length of a segment; required without `mean_length`, else at least "
        "a tenth of *L*",
        quantity="length",
        default=None,
    )


class DragSearchTable(Given):
    """Starting points of the search."""

    starts: int = whole(
        1, 10, "number of initial gaits: the best of the ⌊*N*/2⌋ small gaits", default=1
    )


class PeristalticDragScene(SceneTable):
    """The gait with the longest displacement per period, at a given effort, on linear drag.

    The ground resists each segment by *c*(*l*) times its velocity. The worm moves only because
    drag depends on length. The best gait of small strains solves an eigenvalue problem. For any
    effort the gait is optimised numerically. See
    [theory](../theory-peristaltic.md#4-drag).

    `timings_s`: `build` and `solve` (of all programs), `optimise` and `recheck`.
    """

    headline: ClassVar = ("distance", "distance_small", "wave_step", "segments_per_wave")
    scalars: ClassVar = {
        "distance": ("length", "displacement per period"),
        "speed": ("speed", "`distance` divided by the period"),
        "distance_small": ("length", "displacement by the theory of small strains, same effort"),
        "distance_stationary": (
            "length",
            "`distance` from the Euler-Lagrange equations; unknown if a segment reaches a limit of "
            "its length",
        ),
        "price": ("1", "derivative of `distance` in lengths *L* by the relative effort"),
        "wave_step": (
            "angle",
            "mean phase of a segment's first harmonic less that of the segment before; if positive "
            "the wave runs forward",
        ),
        "segments_per_wave": ("count", "2π divided by the size of `wave_step`"),
        "gain_strain_rate": ("1", "*k* of the best small gait by strain rate"),
        "gain_dissipation": ("1", "*k* of the best small gait by dissipation"),
        "segments_per_wave_strain_rate": ("count", "`segments_per_wave`, best by strain rate"),
        "segments_per_wave_dissipation": ("count", "`segments_per_wave`, best by dissipation"),
        "length_min": ("length", "least length of a segment"),
        "length_max": ("length", "largest"),
        "effort_strain_rate": ("rate", "integral of squared strain rates over a period"),
        "effort_dissipation": ("energy", "energy dissipated by drag in a period"),
        **OPTIMUM,
        "time": ("time", "period"),
        "objective": ("1", "minimised value: the negative displacement over `distance_small`"),
        "input_rms": ("speed", "root mean square of \\|*l*′\\|"),
        "input_peak": ("speed", "largest rate of a length"),
    }
    variables: ClassVar = INSTANT | {
        "length": ("length", ("segment", "instant"), "length of the segment"),
        "length_small": ("length", ("segment", "instant"), "length in the best small gait"),
        "rate": ("speed", ("segment", "instant"), "rate of the length"),
        "position": ("length", ("ring", "instant"), "position of the ring"),
        "velocity": ("speed", ("instant",), "velocity of the mean of all segment centres"),
        "dissipation": ("power", ("instant",), "power dissipated by drag"),
    }

    kind: Literal["peristaltic-drag"]
    want: tuple[Literal["drag_gait", "body", "animation"], ...] = entry(
        "`drag_gait`: velocity and lengths, with the best small gait dashed; `body`: the worm "
        "over a period, from top to bottom; `animation`: the moving worm",
        default=(),
    )
    worm: DragWormTable = entry("the worm")
    drag: DragTable = entry("drag law of the ground")
    period: float = positive("time", "period", default=1.0)
    effort: EffortTable = entry("effort allowed in a period")
    limits: DragLimitsTable = entry("limits of the lengths")
    search: DragSearchTable = entry("starting points of the search", default=DragSearchTable)
    mesh: Annotated[
        MeshTable, says("", "discretisation; 12 arcs of degree 8 at Legendre points if left out")
    ] = field(default_factory=lambda: MeshTable(arcs=12, degree=8, scheme="legendre"))

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from _faults_of_motion(self)
        yield from _faults_of_lengths(self)
        if (self.effort.strain_rate is None) == (self.effort.dissipation is None):
            yield "effort", "exactly one of strain_rate and dissipation is required"


def _faults_of_motion(scene: PeristalticDragScene) -> Iterator[Fault]:
    """Yield faults of worms that no gait can move."""
    if scene.drag.exponent == 0:
        yield (
            "drag.exponent",
            "if drag does not depend on length no gait has a net displacement; write 1.0, or -1.0 "
            "for thick segments that grip",
        )
    if scene.limits.keeps_length and scene.worm.segments < 3:
        yield (
            "worm.segments",
            "2 segments of fixed total length have one shape variable and no net displacement; "
            "write 3",
        )
    most = scene.worm.segments // 2
    if scene.search.starts > most:
        yield "search.starts", f"there are only {most} small gaits that go forward; write {most}"


def _faults_of_lengths(scene: PeristalticDragScene) -> Iterator[Fault]:
    """Yield limits that no lengths satisfy, or that leave lengths free."""
    limits = scene.limits
    if limits.length is not None:
        yield from wrong_order("limits.length", limits.length, may_be_equal=False)
    elif limits.mean_length is None:
        yield (
            "limits",
            "without mean_length and length the best gait shortens segments to nothing; write "
            f"mean_length = {scene.worm.length:g}",
        )
    mean = limits.mean_length
    if mean is None and limits.keeps_length:
        yield "limits.mean_length", f"missing; keeps_length needs it: write {scene.worm.length:g}"
    low, high = limits.length or (0.1 * scene.worm.length, float("inf"))
    if mean is not None and low < high and not low < mean < high:
        middle = (low + high) / 2 if limits.length else scene.worm.length
        yield (
            "limits.mean_length",
            f"{mean:g} is not between the lengths {low:g} and {high:g}; write {middle:g}",
        )
