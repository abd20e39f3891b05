"""Scenes of kind "peristaltic-drag": the best gait of a worm on linear drag."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    Finite,
    Pair,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_order,
)
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

Segments = Annotated[int, Meta(ge=2, le=20, description="a whole number from 2 to 20")]


class DragTable(Table, frozen=True, kw_only=True):
    """Drag *c*(*l*) = *c*<sub>0</sub>(*l*/*L*)<sup>*a*</sup> on the centre of a segment."""

    exponent: Annotated[
        Finite,
        says("1", "*a*: 1 for drag by present length, below 0 where thick segments grip"),
    ]
    coefficient: Annotated[
        Positive, says("drag", "*c*<sub>0</sub>, of a segment of length *L*")
    ] = 1.0


class DragWormTable(Table, frozen=True, kw_only=True):
    """A worm of segments that all can stretch and shorten."""

    segments: Annotated[Segments, says("count", "number of segments")]
    length: Annotated[Positive, says("length", "*L* of a segment, to which strains refer")] = 1.0


class EffortTable(Table, frozen=True, kw_only=True):
    """What a period may cost; exactly one of them."""

    strain_rate: Annotated[
        Positive | None, says("rate", "∫∑(*l*′<sub>j</sub>/*L*)² d*t* over a period")
    ] = None
    dissipation: Annotated[
        Positive | None,
        says("energy", "what drag, spread along each segment, dissipates in a period"),
    ] = None


class DragLimitsTable(Table, frozen=True, kw_only=True):
    """What lengths must keep to."""

    mean_length: Annotated[
        Positive | None,
        says("length", "mean over a period of each segment's length; left out, it is free"),
    ] = None
    keeps_length: Annotated[
        bool, says("", "whether the length of the whole worm never changes; needs `mean_length`")
    ] = False
    length: Annotated[
        Pair | None,
        says(
            "length",
            "least and largest length of a segment; required without `mean_length`, else from a "
            "tenth of *L* on",
        ),
    ] = None


class DragSearchTable(Table, frozen=True, kw_only=True):
    """Where to begin."""

    starts: Annotated[
        int,
        Meta(ge=1, le=10, description="a whole number from 1 to 10"),
        says("count", "so many of the best small gaits, of ⌊*N*/2⌋"),
    ] = 1


class PeristalticDragScene(SceneTable, frozen=True, kw_only=True):
    """The farthest way in a period, at a given effort, of a worm on linear drag.

    A worm whose segments are dragged back by *c*(*l*) times their velocity moves only because drag
    hangs on length. The best small gait is that of an eigenvalue problem; at any effort the gait is
    optimised. See [theory](../theory-peristaltic.md#4-drag).

    `timings_s`: `build` and `solve` (of all programs), `optimise` and `recheck`.
    """

    headline: ClassVar = ("distance", "distance_small", "wave_step", "segments_per_wave")
    scalars: ClassVar = {
        "distance": ("length", "way in a period"),
        "speed": ("speed", "`distance` by period"),
        "distance_small": ("length", "way of the theory of small strains at the same effort"),
        "distance_stationary": (
            "length",
            "`distance` found again by the equations of Euler and Lagrange; unknown where a "
            "segment reaches a limit of its length",
        ),
        "price": ("1", "by which `distance` in lengths *L* grows with the effort over itself"),
        "wave_step": (
            "angle",
            "mean phase of a segment's first harmonic less that of the segment before; above 0 the "
            "wave runs forward",
        ),
        "segments_per_wave": ("count", "2π by the size of `wave_step`"),
        "gain_strain_rate": ("1", "*k* of small gaits that are best by strain rate"),
        "gain_dissipation": ("1", "*k* of small gaits that are best by dissipation"),
        "segments_per_wave_strain_rate": ("count", "`segments_per_wave` of these"),
        "segments_per_wave_dissipation": ("count", "and of these"),
        "length_min": ("length", "least length of a segment"),
        "length_max": ("length", "largest"),
        "effort_strain_rate": ("rate", "strain rates squared over a period"),
        "effort_dissipation": ("energy", "what drag dissipates in a period"),
        **OPTIMUM,
        "time": ("time", "period"),
        "objective": ("1", "what was minimised: the negative way over `distance_small`"),
        "input_rms": ("speed", "root of the mean of \\|*l*′\\|²"),
        "input_peak": ("speed", "largest rate of a length"),
    }
    variables: ClassVar = INSTANT | {
        "length": ("length", ("segment", "instant"), "length of the segment"),
        "length_small": ("length", ("segment", "instant"), "length in the best small gait"),
        "rate": ("speed", ("segment", "instant"), "rate of the length"),
        "position": ("length", ("ring", "instant"), "position of the ring"),
        "velocity": ("speed", ("instant",), "velocity of the mean of all centres"),
        "dissipation": ("power", ("instant",), "power that drag takes"),
    }

    kind: Literal["peristaltic-drag"]
    want: Annotated[
        tuple[Literal["drag_gait", "body", "animation"], ...],
        says(
            "",
            "`drag_gait`: lengths, dashed those of the best small gait, and velocity; `body`: the "
            "worm as it swells and thins, from top to bottom; `animation`: the same, moving",
        ),
    ] = ()
    worm: Annotated[DragWormTable, says("", "the worm")]
    drag: Annotated[DragTable, says("", "law of the ground")]
    period: Annotated[Positive, says("time", "period")] = 1.0
    effort: Annotated[EffortTable, says("", "what a period may cost")]
    limits: Annotated[DragLimitsTable, says("", "what lengths must keep to")]
    search: Annotated[DragSearchTable, says("", "where to begin")] = field(
        default_factory=DragSearchTable
    )
    mesh: Annotated[
        MeshTable, says("", "how finely; 12 arcs of degree 8 at Legendre's points if left out")
    ] = field(default_factory=lambda: MeshTable(arcs=12, degree=8, scheme="legendre"))

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from _faults_of_motion(self)
        yield from _faults_of_lengths(self)
        if (self.effort.strain_rate is None) == (self.effort.dissipation is None):
            yield "effort", "exactly one of strain_rate and dissipation must be given"


def _faults_of_motion(scene: PeristalticDragScene) -> Iterator[Fault]:
    """Find worms that no gait moves."""
    if scene.drag.exponent == 0:
        yield (
            "drag.exponent",
            "with drag that does not hang on length no gait goes anywhere; write 1.0, or -1.0 for "
            "thick segments that grip",
        )
    if scene.limits.keeps_length and scene.worm.segments < 3:
        yield (
            "worm.segments",
            "2 segments of fixed total length move to and fro on one line and go nowhere; write 3",
        )
    most = scene.worm.segments // 2
    if scene.search.starts > most:
        yield "search.starts", f"there are only {most} small gaits that go forward; write {most}"


def _faults_of_lengths(scene: PeristalticDragScene) -> Iterator[Fault]:
    """Find limits that no lengths keep to, or that leave them free."""
    limits = scene.limits
    if limits.length is not None:
        yield from wrong_order("limits.length", limits.length, may_be_equal=False)
    elif limits.mean_length is None:
        yield (
            "limits",
            "with neither mean_length nor length the best gait shortens segments to nothing; write "
            f"mean_length = {scene.worm.length:g}",
        )
    mean = limits.mean_length
    if mean is None and limits.keeps_length:
        yield "limits.mean_length", f"missing beside keeps_length; write {scene.worm.length:g}"
    low, high = limits.length or (0.1 * scene.worm.length, float("inf"))
    if mean is not None and low < high and not low < mean < high:
        middle = (low + high) / 2 if limits.length else scene.worm.length
        yield (
            "limits.mean_length",
            f"{mean:g} is not between the lengths {low:g} and {high:g}; write {middle:g}",
        )
