"""Scenes of kinds "channel-worm" and "segment-shapes": a magnetisable body in a channel."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Pair,
    Positive,
    SceneTable,
    Table,
    Title,
    extreme_numbers,
    wrong_order,
)
from wormopt.systems.channel.samples import SAMPLES, Sample
from wormopt.systems.channel.scenes.rod import Coils, Elements, Poisson, Share
from wormopt.systems.channel.scenes.rod import Degree as ElementDegree

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

    Parameters
    ----------
    sample : {"sample-1", "sample-2", "capsule"}, optional
        A body of the chapter, from which keys that are left out are taken.
    pitch : float, optional
        Distance of neighbouring coils, in m.
    channel, body : float, optional
        Diameters, in m.
    length : float, optional
        Of the body, in m.
    youngs_modulus : float, optional
        Of the body, taken as solid and round, in Pa; without it forces are unknown.
    count : {"nearest", "floor"}
        How segments are counted.
    """

    sample: Literal["sample-1", "sample-2", "capsule"] | None = None
    pitch: Positive | None = None
    channel: Positive | None = None
    body: Positive | None = None
    length: Positive | None = None
    youngs_modulus: Positive | None = None
    count: Literal["nearest", "floor"] = "nearest"

    @property
    def of_chapter(self) -> Sample | None:
        """The named body, where nothing but its modulus is changed."""
        changed = any(getattr(self, name) is not None for name in _SIZES)
        return None if self.sample is None or changed else SAMPLES[self.sample]

    def size(self, name: str) -> float | None:
        """Size or modulus by its key, of the named body where the scene does not give it."""
        given = getattr(self, name)
        return getattr(SAMPLES[self.sample], name) if given is None and self.sample else given

    def faults_of_body(self, key: str) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table, whose key path is `key`."""
        sizes = [self.size(name) for name in _SIZES]
        missing = [name for name, size in zip(_SIZES, sizes, strict=True) if size is None]
        for name in missing:
            yield f"{key}.{name}", 'missing; write it in m, or name a body: sample = "sample-1"'
        if missing:
            return
        pitch, channel, body, length = (float(size or 0.0) for size in sizes)
        if body >= channel:
            yield (
                f"{key}.body",
                f"a body {body:g} m thick does not fit in a channel of {channel:g} m; "
                f"write less than {channel:g}, or a wider {key}.channel",
            )
        elif channel - body >= STEEPEST * pitch:
            yield (
                f"{key}.pitch",
                f"within {pitch:g} m the body would rise by {channel - body:g} m; write more than "
                f"{(channel - body) / STEEPEST:g}",
            )
        elif channel - body < FLATTEST * pitch:
            yield (
                f"{key}.body",
                f"a body {body:g} m thick fills the channel, and what it rises by is lost in "
                f"rounding; write less than {channel - FLATTEST * pitch:g}",
            )
        if length < pitch:
            yield (
                f"{key}.length",
                f"{length:g} m is less than the coil distance; write at least {pitch:g}",
            )


class MarkTable(Table, frozen=True, kw_only=True):
    """A measured velocity.

    Parameters
    ----------
    frequency : float
        Coil switches per second.
    velocity : float
        Against the travel of the field, in m/s.
    text : str
        What the picture says of it.
    """

    frequency: Positive
    velocity: Positive
    text: Title


class ChannelWormScene(SceneTable, frozen=True, kw_only=True):
    """Velocity of a body in a channel over the frequency of its coils, by (32)-(36).

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"channel-worm"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : ChannelBodyTable
        The body.
    frequency : tuple of float
        Least and largest number of coil switches per second.
    measured : tuple of MarkTable
        Measured velocities, beside those of the named body.
    valid_below : float, optional
        Switches per second below which (32) is claimed to hold; of the named body if left out.
    stops_above : float, optional
        Switches per second above which the body was seen to stand; likewise.
    """

    kind: Literal["channel-worm"]
    want: tuple[Literal["channel_velocity"], ...] = ()
    worm: ChannelBodyTable
    frequency: Pair = (5.0, 1000.0)
    measured: tuple[MarkTable, ...] = ()
    valid_below: Positive | None = None
    stops_above: Positive | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from _faults_of_units(self.units)
        yield from self.worm.faults_of_body("worm")
        yield from wrong_order("frequency", self.frequency, may_be_equal=False)


class RestTable(Table, frozen=True, kw_only=True):
    """The body as a rod at rest in the field of coils; all that the chapter leaves open.

    Parameters
    ----------
    susceptibility : float
        Magnetisation of the body over the field without it; an assumption.
    poisson_ratio : float
        0.5 of what keeps its volume.
    inner, outer, length : float
        Radii of the windings and their length along the axis, in m; assumptions.
    clearance : float
        From the inner side of the wall to the winding, in m; an assumption.
    ampere_turns : float
        Of a coil that is on, in A; an assumption.
    on, every : int
        Coils of a block that are on, and coils after which the pattern repeats.
    elements, degree : int
        Elements of the rod, and degree of their polynomials.
    field_tolerance : float
        Terms of the field's series below this share of the largest one are left out.
    sweep : tuple of float
        Ampere-turns at which the rest is found too.
    """

    susceptibility: Positive = 2.0
    poisson_ratio: Poisson = 0.5
    inner: Positive = 2e-3
    outer: Positive = 9e-3
    length: Positive = 20e-3
    clearance: Positive = 1e-3
    ampere_turns: Positive = 4600.0
    on: On = 3
    every: Coils = 7
    elements: Elements = 48
    degree: ElementDegree = 2
    field_tolerance: Share = 1e-3
    sweep: Sweep = ()

    def faults_of_rod(self, worm: ChannelBodyTable) -> Iterator[Fault]:
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


class SegmentShapesScene(SceneTable, frozen=True, kw_only=True):
    """Shapes of a segment between two coils: those of (33)-(35) and the elastica.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"segment-shapes"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : ChannelBodyTable
        The body.
    exact : tuple of str
        Assumptions under which the elastica is solved.
    degree : int
        Largest degree of its polynomials.
    points : int
        Points of each centre line.
    rod : RestTable, optional
        If given, the body also rests in the field of coils.
    """

    kind: Literal["segment-shapes"]
    want: tuple[Literal["segment_shapes"], ...] = ()
    worm: ChannelBodyTable
    exact: Closings = ("point_contact", "sleeve")
    degree: Degree = 256
    points: Points = 201
    rod: RestTable | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from _faults_of_units(self.units)
        yield from self.worm.faults_of_body("worm")
        for word in sorted(set(self.exact)):
            if self.exact.count(word) > 1:
                yield "exact", f'"{word}" stands there twice; write it once'
        if self.rod is not None:
            yield from self.rod.faults_of_rod(self.worm)


def _faults_of_units(units: str) -> Iterator[Fault]:
    if units != "SI":
        yield "units", 'bodies of the chapter are in m and Pa: write units = "SI"'
