"""Scenes of kinds "channel-worm" and "segment-shapes": a magnetisable body in a channel."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Pair, Positive, Table, Title, says, wrong_order
from wormopt.systems.channel.samples import SAMPLES, Sample
from wormopt.systems.channel.scenes.rod import (
    ASSUMED_COILS,
    Coils,
    Elements,
    Poisson,
    Share,
    WindingTable,
)
from wormopt.systems.channel.scenes.rod import Degree as ElementDegree
from wormopt.systems.coils import SIScene

STEEPEST, FLATTEST = 10.0, 1e-3
"""Rises over the coil distance; below, l_s - L is lost in rounding."""
Closings = Annotated[
    tuple[Literal["point_contact", "sleeve"], ...],
    Meta(min_length=1, max_length=2, description='a list of "point_contact" and "sleeve"'),
]
Points = Annotated[int, Meta(ge=11, le=10_001, description="a whole number from 11 to 10001")]
Degree = Annotated[int, Meta(ge=16, le=512, description="a whole number from 16 to 512")]
On = Annotated[int, Meta(ge=2, le=10, description="a whole number from 2 to 10")]
Sweep = Annotated[
    tuple[Positive, ...],
    Meta(max_length=24, description="a list of up to 24 finite numbers above 0, ascending"),
]
_SIZES = ("pitch", "channel", "body", "length")


class ChannelBodyTable(Table, frozen=True, kw_only=True):
    """A body, its channel and the coils beside it.

    Keys that are left out are those of `sample`; without one all sizes must be given.
    """

    sample: Annotated[
        Literal["sample-1", "sample-2", "capsule"] | None,
        says("", "a body of the chapter; the keys below that are left out are its own"),
    ] = None
    pitch: Annotated[Positive | None, says("length", "distance of neighbouring coils")] = None
    channel: Annotated[Positive | None, says("length", "diameter of the channel")] = None
    body: Annotated[
        Positive | None,
        says(
            "length",
            "diameter; thinner than the channel, by a thousandth to ten times the pitch",
        ),
    ] = None
    length: Annotated[Positive | None, says("length", "of the body; at least the pitch")] = None
    youngs_modulus: Annotated[
        Positive | None,
        says(
            "stress",
            "of a solid round body: an assumption; the capsule has none, and without it forces and "
            "energies are unknown; not used by `channel-worm`",
        ),
    ] = None
    count: Annotated[
        Literal["nearest", "floor"],
        says(
            "",
            "segments: the integer nearest to length over segment, or the integral part as (32) is "
            "printed",
        ),
    ] = "nearest"

    @property
    def of_chapter(self) -> Sample | None:
        """The named body, where nothing but its modulus is changed."""
        changed = any(getattr(self, name) is not None for name in _SIZES)
        return None if self.sample is None or changed else SAMPLES[self.sample]

    def size(self, name: str) -> float | None:
        """Size or modulus by its key, of the named body where the scene does not give it."""
        given = getattr(self, name)
        return getattr(SAMPLES[self.sample], name) if given is None and self.sample else given

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        sizes = [self.size(name) for name in _SIZES]
        missing = [name for name, size in zip(_SIZES, sizes, strict=True) if size is None]
        for name in missing:
            yield f"worm.{name}", 'missing; write it in m, or name a body: sample = "sample-1"'
        if missing:
            return
        pitch, channel, body, length = (float(size or 0.0) for size in sizes)
        if body >= channel:
            yield (
                "worm.body",
                f"a body {body:g} m thick does not fit in a channel of {channel:g} m; "
                f"write less than {channel:g}, or a wider worm.channel",
            )
        elif channel - body >= STEEPEST * pitch:
            yield (
                "worm.pitch",
                f"within {pitch:g} m the body would rise by {channel - body:g} m; write more than "
                f"{(channel - body) / STEEPEST:g}",
            )
        elif channel - body < FLATTEST * pitch:
            yield (
                "worm.body",
                f"a body {body:g} m thick fills the channel, and what it rises by is lost in "
                f"rounding; write less than {channel - FLATTEST * pitch:g}",
            )
        if length < pitch:
            yield (
                "worm.length",
                f"{length:g} m is less than the coil distance; write at least {pitch:g}",
            )


class BodyScene(SIScene, frozen=True, kw_only=True):
    """A body in a channel."""

    why_si: ClassVar = 'bodies of the chapter are in m and Pa: write units = "SI"'

    worm: Annotated[ChannelBodyTable, says("", "the body")]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults()


class MarkTable(Table, frozen=True, kw_only=True):
    """A measured velocity."""

    frequency: Annotated[Positive, says("rate", "coil switches a second")]
    velocity: Annotated[Positive, says("speed", "against the travel of the field")]
    text: Annotated[Title, says("", "what the picture says of it")]


class ChannelWormScene(BodyScene, frozen=True, kw_only=True):
    """Velocity of a body in a channel over the frequency of its coils, by (32)-(36).

    A magnetisable body in a channel beside coils that are switched in turn: length of a segment,
    count of segments and velocity over the frequency by (32), for the three assumed shapes
    (33)–(35). Theory: [theory-channel.md](../theory-channel.md#1-closed-forms). Only
    `units = "SI"`. Marks and limits of a sample are those of the chapter's text. They are left out
    where one of its sizes is changed.

    The trust report: `recheck_error` of the lengths against those of the centre lines as Chebyshev
    series, `accepted`, `assumptions`, `warnings`: segments that need more body than there is or
    none at all, marks where (32) is not claimed.
    """

    scalars: ClassVar = {
        "shapes": ("1", "`sine`, `beam`, `line`; lists below are in this order"),
        "arc_length": ("length", "of a segment, *l*<sub>s</sub>"),
        "segments": ("count", "*k*<sub>s</sub>"),
        "missing_length": (
            "length",
            "*k*<sub>s</sub>*l*<sub>s</sub> less the length of the body; above 0 there is a "
            "warning",
        ),
        "velocity_per_frequency": ("length", "velocity over switches a second"),
        "direction": ("1", "−1: against the travel of the field; velocities are sizes"),
        "rise": ("length", "*d* − *d*<sub>w</sub>"),
        "measured": ("1", "the marks, as text"),
        "measured_frequency": ("rate", "of the marks"),
        "measured_velocity": ("speed", "of the marks"),
        "velocity_at": (
            "speed", "(32) at the frequency of each mark, a list over the shapes",
        ),
        "velocity_over_measured": ("share", "that over the measured velocity"),
        "valid_below": ("rate", "as given, or of the sample"),
        "stops_above": ("rate", "as given, or of the sample"),
    }  # fmt: skip
    variables: ClassVar = {
        "frequency": ("rate", ("frequency",), "coil switches per second"),
        "velocity": ("speed", ("shape", "frequency"), "against the travel of the field"),
    }

    kind: Literal["channel-worm"]
    want: Annotated[
        tuple[Literal["channel_velocity"], ...],
        says("", "`channel_velocity`: figures 19 and 20"),
    ] = ()
    frequency: Annotated[Pair, says("rate", "coil switches a second")] = (5.0, 1000.0)
    measured: Annotated[
        tuple[MarkTable, ...], says("", "marks beside those of the sample, a list of tables")
    ] = ()
    valid_below: Annotated[
        Positive | None,
        says("rate", "switches a second below which (32) is claimed; of the sample if left out"),
    ] = None
    stops_above: Annotated[
        Positive | None,
        says(
            "rate",
            "switches a second above which the body was seen to stand; of the sample if left out",
        ),
    ] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("frequency", self.frequency, may_be_equal=False)


class RestTable(WindingTable, frozen=True, kw_only=True):
    """The body as a rod at rest in the field of coils.

    What the chapter does not give is an assumption, with the defaults of
    [`rod-motion`](rod-motion.md), and shown in the result.
    """

    susceptibility: Annotated[
        Positive, says("1", "magnetisation over the field without the body, *assumed*")
    ] = 2.0
    poisson_ratio: Annotated[
        Poisson, says("1", "of the body, 0.5 of what keeps its volume, *assumed*")
    ] = 0.5
    on: Annotated[On, says("count", "coils of a block that are on")] = 3
    every: Annotated[Coils, says("count", "coils after which the pattern repeats")] = 7
    elements: Annotated[Elements, says("count", "finite elements of the rod")] = 48
    degree: Annotated[ElementDegree, says("count", "degree of their polynomials")] = 2
    field_tolerance: Annotated[
        Share,
        says(
            "share", "terms of the field's series below this share of the largest one are left out"
        ),
    ] = 1e-3
    sweep: Annotated[
        Sweep,
        says(
            "ampere_turns",
            "ampere-turns at which the rest is found too, ascending; about 2 s each",
        ),
    ] = ()

    def faults(self, worm: ChannelBodyTable) -> Iterator[Fault]:
        """Yield what cannot be built, as key path and message."""
        if self.inner >= self.outer:
            yield "rod.inner", f"{self.inner:g} is not below rod.outer = {self.outer:g}; write less"
        pitch, body = worm.size("pitch"), worm.size("length")
        if pitch is not None and self.outer > pitch:
            yield (
                "rod.outer",
                f"{self.outer:g} is above worm.pitch = {pitch:g}: coils of one side, two pitches "
                f"apart, overlap; write at most {pitch:g}",
            )
        if self.on >= self.every:
            yield (
                "rod.every",
                f"{self.every} coils are too few for blocks of {self.on}; write at least "
                f"{self.on + 1}",
            )
        if pitch is not None and body is not None and body / self.elements > pitch / 4:
            least = int(-(-4 * body // pitch))
            yield (
                "rod.elements",
                f"{self.elements} are too few for {body / pitch:.3g} pitches of coils; write at "
                f"least {least}",
            )
        if list(self.sweep) != sorted(set(self.sweep)):
            yield "rod.sweep", "the numbers must ascend; write them in order, each once"


class SegmentShapesScene(BodyScene, frozen=True, kw_only=True):
    """Shapes of a segment between two coils: those of (33)-(35) and the elastica.

    The shape of a segment between two coils: the three assumed ones and the exact one of an
    elastic body, an elastica, under two assumptions. Lengths, wall forces, energies, distances.
    Theory: [theory-channel.md](../theory-channel.md#2-exact-segment-shapes). Only
    `units = "SI"`. With `[rod]` the body also rests in the field of coils, as far as its modulus
    is known (otherwise a warning says that the rod is left out), and `rod` is one more exact
    shape; of it `theta` is the angle of its cross sections.

    Distances are between points at the same share of the length. Those of a sweep are NaN where
    the rod is not bent from wall to wall, and, with a warning, where its rest is not stable or off
    balance; the mesh is refined at `rod.ampere_turns` only.

    The trust report has for each elastica `degree`, `residual`, `tail` (last coefficients),
    `defect` (between the points), `recheck_error` (against elliptic integrals), beside `accepted`,
    `assumptions` and `warnings`: surfaces strained by more than a tenth, bodies that would run
    into themselves. Of the `rod`: `residual` (energy's slope that nothing balances) and
    `imbalance` (accelerations by the equations of motion), relative; `violation` of walls in m,
    `complementarity` of gaps and forces; least and largest stiffness along the walls, `softest`
    and `stiffest`, and whether the rest is `stable`; `iterations`; `field_error` of the series;
    `mesh_change` of the length with two thirds of the elements; `minimum` says "local". Off
    balance by more than 1e-6, not stable, or a change above 0.005: status `failed`. Exit code 3
    where the rod comes to no rest or does not reach over the coils, and where a `sleeve` leaves
    the walls (rises above 1.669 coil distances) or the degree does not suffice.
    """

    scalars: ClassVar = {
        "shapes": ("1", "names; lists below are in this order"),
        "arc_length": ("length", "*l*<sub>s</sub>"),
        "segments": ("count", "*k*<sub>s</sub>"),
        "velocity_per_frequency": ("length", "(32) over the frequency"),
        "energy_over_stiffness": (
            "curvature", "bending energy over *EI*; unknown for the line, which has kinks",
        ),
        "energy": ("energy", "bending energy"),
        "reaction_over_stiffness": (
            "curvature_squared", "`reaction` over *EI*",
        ),
        "reaction": (
            "force", "force *V* of a wall across the channel; positive where it pushes",
        ),
        "tension_over_stiffness": ("curvature_squared", "`tension` over *EI*"),
        "tension": ("force", "tension *N* along the channel"),
        "curvature_max": ("curvature", "largest curvature"),
        "surface_strain": ("share", "that times half the thickness of the body"),
        "angle_max": ("angle", "steepest place"),
        "rise": ("length", "*d* − *d*<sub>w</sub>"),
        "channel": ("length", "*d*"),
        "body": ("length", "*d*<sub>w</sub>"),
        "bending_stiffness": (
            "bending_stiffness", "*EI*, with *I* = π*d*<sub>w</sub>⁴/64",
        ),
        "exact_shapes": ("1", "the exact ones"),
        "closest_shape": ("1", "for each of these the assumed one whose largest distance is least"),
        "closest_distance": ("length", "its largest distance"),
        "closest_distance_rms": ("length", "its root mean square distance"),
        "closest_shape_rod": (
            "1",
            "which of the three assumed shapes comes closest to the rod's; unknown where the rod "
            "is not bent from wall to wall",
        ),
        "closest_distance_rod": ("length", "its largest distance, unknown likewise"),
        "rod_reaches_walls": (
            "1",
            "whether the rod touches the walls within half a coil distance of both coils of the "
            "segment",
        ),
        "rod_arc_lengths": (
            "length", "of all segments of the block; `arc_length` has the middle one",
        ),
        "rod_stretch": (
            "share",
            "by which the segment is longer than the same piece of the body without load",
        ),
        "rod_compression_max": (
            "share",
            "by which fibres are shortened at most, anywhere; at 1 cross sections run into each "
            "other, and the rod is refused as crushed (exit code 3)",
        ),
        "rod_force_upper": ("force", "resultant of the upper wall"),
        "rod_force_lower": ("force", "resultant of the lower wall"),
        "rod_energy": ("energy", "elastic and magnetic, of the bent rod"),
        "rod_energy_on_one_wall": (
            "energy",
            "of one that lies along the wall of the first coil; unknown if it does not stay there",
        ),
        "rod_preferred": ("1", "whether the bent one has less"),
        "assumed_susceptibility": ("1", "as in the scene"),
        "assumed_poisson_ratio": ("1", "as in the scene"),
        "coils_on": ("count", "as in the scene"),
        "sweep_closest_shape": ("1", "closest assumed shape at each of `rod.sweep`"),
    } | ASSUMED_COILS  # fmt: skip
    variables: ClassVar = {
        "share": ("share", ("share",), "share of the length of the segment"),
        "x": ("length", ("shape", "share"), "place along the channel"),
        "y": ("length", ("shape", "share"), "height of the centre line"),
        "theta": ("angle", ("shape", "share"), "angle against the channel"),
        "distance_max": (
            "length", ("shape", "other_shape"), "largest distance at the same share",
        ),
        "distance_rms": (
            "length", ("shape", "other_shape"), "root mean square of that distance",
        ),
        "exact": ("count", ("shape",), "whether computed from forces"),
        "rod_x": (
            "length", ("node",), "place of a node along the channel, from the middle of the block",
        ),
        "rod_y": ("length", ("node",), "its height"),
        "rod_angle": ("angle", ("node",), "angle of its cross section"),
        "rod_force_upper_at": ("force", ("node",), "force of the upper wall on it"),
        "rod_force_lower_at": ("force", ("node",), "force of the lower wall on it"),
        "rod_node_length": ("length", ("node",), "length that a node stands for"),
        "sweep": ("ampere_turns", ("sweep",), "ampere-turns"),
        "sweep_arc_length": ("length", ("sweep",), "length of the segment"),
        "sweep_distance": (
            "length", ("assumed", "sweep"), "largest distance from assumed shapes",
        ),
    }  # fmt: skip

    kind: Literal["segment-shapes"]
    want: Annotated[
        tuple[Literal["segment_shapes"], ...],
        says("", "`segment_shapes`: centre lines between the walls, distances, the rod at rest"),
    ] = ()
    exact: Annotated[
        Closings,
        says(
            "",
            "walls push across the channel and nothing pulls along it; or the length is free and "
            "has the least energy",
        ),
    ] = ("point_contact", "sleeve")
    degree: Annotated[Degree, says("count", "largest degree of the polynomials")] = 256
    points: Annotated[Points, says("count", "of each centre line")] = 201
    rod: Annotated[
        RestTable | None,
        says("", "if given, the body also rests in the field of coils"),
    ] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        for word in sorted(set(self.exact)):
            if self.exact.count(word) > 1:
                yield "exact", f'"{word}" stands there twice; write it once'
        if self.rod is not None:
            yield from self.rod.faults(self.worm)
