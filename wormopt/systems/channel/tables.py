"""Tables and bases of studies of a body, or a rod, in a channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, positive, scalars, whole
from wormopt.study.types import Positive
from wormopt.systems.channel.samples import FLATTEST, SAMPLES, STEEPEST, Sample
from wormopt.systems.shared.studies import SIStudy, wrong_winding

with on_use():
    from wormopt.magnetics.blocks import BlockField, channel_field
    from wormopt.magnetics.coils import Coil
    from wormopt.systems.channel.closed_forms import ChannelWorm

_SIZES = ("pitch", "channel", "body", "length")

AmpereTurns = Annotated[
    tuple[Positive, ...],
    Meta(max_length=24, description="a list of up to 24 finite numbers above 0, ascending"),
]

ASSUMED_COILS = {
    "assumed_coil_inner": ("length", "inner radius of the windings"),
    "assumed_coil_outer": ("length", "outer radius of the windings"),
    "assumed_coil_length": ("length", "length of the windings"),
    "assumed_coil_clearance": ("length", "distance from wall to winding"),
    "assumed_ampere_turns": ("ampere_turns", "ampere-turns of an active coil"),
}
"""Scalars: parameters of coils that are not published for the experiments."""
_ASSUMED = {
    "assumed_density": ("density", "density of the worm"),
    "assumed_damping_time": ("time", "damping time of the worm"),
    "assumed_susceptibility": ("1", "susceptibility of the worm"),
    "assumed_friction": ("1", "friction on the walls"),
    "assumed_skin": ("length", "thickness of a capsule's skin; unknown for a solid worm"),
    "assumed_skin_modulus": ("stress", "Young's modulus of the skin; unknown for a solid worm"),
} | ASSUMED_COILS


def _too_few(elements: int, length: float, pitch: float, per_pitch: int) -> Iterator[Fault]:
    """Yield a fault if a pitch of a rod on `elements` has fewer of them than `per_pitch`."""
    if length / elements > pitch / per_pitch:
        yield (
            "elements",
            f"{elements} are too few for {length / pitch:.3g} pitches of coils; write at least "
            f"{int(-(-per_pitch * length // pitch))}",
        )


def of_table(table: str, faults: Iterator[Fault]) -> Iterator[Fault]:
    """Yield faults of a table with their keys in the table around it."""
    yield from ((f"{table}.{key}", what) for key, what in faults)


# -- a body between coils --------------------------------------------------------------------------


class ChannelBody(Given):
    """A body, its channel and the coils beside it.

    Keys that are left out have the values of `sample`; without a sample all sizes are required.
    """

    sample: Literal["sample-1", "sample-2", "capsule"] | None = entry(
        "a body of K. Zimmermann et al. 2007 (WLLS); gives the keys that are left out", default=None
    )
    pitch: float | None = positive("length", "distance of neighbouring coils", default=None)
    channel: float | None = positive("length", "diameter of the channel", default=None)
    body: float | None = positive(
        "length",
        "diameter of the body; the channel's less a thousandth to ten times the pitch",
        default=None,
    )
    length: float | None = positive(
        "length", "length of the body, at least the pitch", default=None
    )
    youngs_modulus: float | None = positive(
        "stress",
        "Young's modulus of a solid round body, *assumed*; the capsule has none; without "
        "it forces and energies are unknown; not used by `channel-worm`",
        default=None,
    )
    count: Literal["nearest", "floor"] = entry(
        "number of segments: the integer nearest to length over segment, or its integral part "
        "as in eq. 32 of Zimmermann et al. is "
        "printed",
        default="nearest",
    )

    @property
    def published(self) -> Sample | None:
        """Return the named body if at most its modulus is changed."""
        changed = any(getattr(self, name) is not None for name in _SIZES)
        return None if self.sample is None or changed else SAMPLES[self.sample]

    def size(self, name: str) -> float | None:
        """Return a size or the modulus by its key, from the named body if the scene has none."""
        given = getattr(self, name)
        return getattr(SAMPLES[self.sample], name) if given is None and self.sample else given

    def faults_of_keys(self) -> Iterator[Fault]:
        sizes = [self.size(name) for name in _SIZES]
        missing = [name for name, size in zip(_SIZES, sizes, strict=True) if size is None]
        for name in missing:
            yield name, 'missing; write it in m, or name a body: sample = "sample-1"'
        if missing:
            return
        pitch, channel, body, length = (float(size or 0.0) for size in sizes)
        if body >= channel:
            yield (
                "body",
                f"a body with a diameter of {body:g} m does not fit in a channel of {channel:g} m; "
                f"write less than {channel:g}, or a wider worm.channel",
            )
        elif channel - body >= STEEPEST * pitch:
            yield (
                "pitch",
                f"the body would rise by {channel - body:g} m within {pitch:g} m; write more than "
                f"{(channel - body) / STEEPEST:g}",
            )
        elif channel - body < FLATTEST * pitch:
            yield (
                "body",
                f"a body with a diameter of {body:g} m fills the channel, and its rise is lost in "
                f"round-off; write less than {channel - FLATTEST * pitch:g}",
            )
        if length < pitch:
            yield (
                "length",
                f"{length:g} m is less than the coil distance; write at least {pitch:g}",
            )

    def worm(self) -> ChannelWorm:
        """Return the body with its sizes."""
        names = ("pitch", "channel", "body", "length", "youngs_modulus")
        return ChannelWorm(*(self.size(name) for name in names), rule=self.count)


class Winding(Given):
    """Equal coils beside the channel, their axes across it."""

    inner_radius: float = positive("length", "inner radius of the winding, *assumed*", default=2e-3)
    outer_radius: float = positive(
        "length", "outer radius, at most the pitch of the coils, *assumed*", default=9e-3
    )
    length: float = positive("length", "axial length of the winding, *assumed*", default=20e-3)
    clearance: float = positive(
        "length", "distance from the wall's inner side to the winding, *assumed*", default=1e-3
    )
    ampere_turns: float = positive("ampere_turns", "of an active coil, *assumed*", default=4600.0)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_winding(self.inner_radius, self.outer_radius)

    def overlaps(self, pitch: float, key: str) -> Iterator[Fault]:
        """Yield a fault if coils of one side overlap; `key` holds the pitch."""
        if self.outer_radius > pitch:
            yield (
                "outer_radius",
                f"{self.outer_radius:g} is above {key} = {pitch:g}, so coils of one side, two "
                f"pitches apart, overlap; write at most {pitch:g}",
            )

    @property
    def assumed(self) -> dict[str, float]:
        """These parameters as scalars, so that results list them."""
        sizes = ("inner_radius", "outer_radius", "length", "clearance")
        found = {f"assumed_coil_{name}": getattr(self, name) for name in sizes}
        return found | {"assumed_ampere_turns": self.ampere_turns}

    def field(
        self, pitch: float, channel: float, body: float, on: int, every: int, tolerance: float
    ) -> BlockField:
        """Return the field of blocks of `on` coils, repeated after `every` coils."""
        coil = Coil(self.inner_radius, self.outer_radius, self.length)
        return channel_field(coil, pitch, channel, self.clearance, body, on, every, tolerance)


class RodOverCoils(Winding):
    """The body as a rod at rest in the field of coils.

    Values that Zimmermann et al. do not publish are assumptions, with the defaults of
    [`rod-motion`](rod-motion.md). The result lists them.
    """

    susceptibility: float = positive(
        "1", "magnetisation over the field without the body, *assumed*", default=2.0
    )
    poisson_ratio: float = number(
        "1", "Poisson's ratio, 0.5 for constant volume, *assumed*", above=-1, most=0.5, default=0.5
    )
    on: int = whole(2, 10, "number of active coils in a block", default=3)
    every: int = whole(2, 40, "number of coils after which the pattern repeats", default=7)
    elements: int = whole(4, 200, "finite elements of the rod", default=48)
    degree: int = whole(1, 4, "degree of their polynomials", default=2)
    field_tolerance: float = number(
        "share",
        "terms of the field's series below this share of the largest are left out",
        above=0,
        below=1,
        default=1e-3,
    )
    sweep: AmpereTurns = entry(
        "further ampere-turns at which the rest is computed, ascending; about 2 s each",
        quantity="ampere_turns",
        default=(),
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if self.on >= self.every:
            yield (
                "every",
                f"{self.every} coils are too few for blocks of {self.on}; write at least "
                f"{self.on + 1}",
            )
        if list(self.sweep) != sorted(set(self.sweep)):
            yield "sweep", "the numbers do not ascend; write them in order, each once"

    def faults_in(self, worm: ChannelBody) -> Iterator[Fault]:
        """Yield coils that overlap, and rods on too few elements."""
        pitch, length = worm.size("pitch") or 0.0, worm.size("length") or 0.0
        yield from self.overlaps(pitch, "worm.pitch")
        yield from _too_few(self.elements, length, pitch, per_pitch=4)


class BodyStudy(SIStudy):
    """A body in a channel."""

    why_si: ClassVar = 'the bodies of the scene are in m and Pa; write units = "SI"'

    worm: ChannelBody = entry("the body")

    @cached_property
    def body(self) -> ChannelWorm:
        """The body."""
        return self.worm.worm()


# -- a rod that switched coils move ----------------------------------------------------------------


class Worm(Given):
    """The worm: a round rod of soft magnetisable rubber, or a skin filled with magnetic fluid."""

    length: float = positive("length", "length, at least a pitch of the coils", default=48e-3)
    diameter: float = positive("length", "diameter, below that of the channel", default=4e-3)
    youngs_modulus: float = positive("stress", "Young's modulus", default=5e4)
    poisson_ratio: float = number(
        "1", "Poisson's ratio, 0.5 for constant volume", above=-1, most=0.5, default=0.5
    )
    density: float = positive("density", "*assumed*", default=2500.0)
    damping_time: float = positive(
        "time", "viscosity over Young's modulus, *assumed*", default=1e-3
    )
    susceptibility: float = positive(
        "1", "magnetisation over the field without the worm, *assumed*", default=2.0
    )
    skin: float | None = positive(
        "length",
        "thickness of the skin of a capsule filled with magnetic fluid, *assumed*; "
        "`youngs_modulus` is then that of the skin, `susceptibility` that of the fluid, "
        "`density` that of the whole; a solid worm if left out",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.skin and 2 * self.skin > self.diameter:
            yield (
                "skin",
                f"{self.skin:g} exceeds the radius of the body; write at most "
                f"{self.diameter / 2:g}",
            )


class Channel(Given):
    """The channel, two straight walls."""

    diameter: float = positive("length", "distance of the walls", default=11e-3)
    friction: float = positive(
        "1", "coefficient of dry friction on the walls, *assumed*", default=0.5
    )


class Zigzag(Winding):
    """A row of equal coils, alternating between both sides of the channel, with axes across it."""

    pitch: float = positive(
        "length",
        "distance of neighbours, which lie on alternate sides, along the channel",
        default=10e-3,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.overlaps(self.pitch, "coils.pitch")


class Pattern(Given):
    """Switching pattern of the coils."""

    every: int = whole(2, 40, "number of coils after which the pattern repeats", default=7)
    duration: float = number(
        "count",
        "time that a coil stays on, in switches; also the mean number of coils on at a time. "
        "With 2.5, two and three coils alternate",
        least=1,
        most=8,
        default=3.0,
    )
    shift: float = number(
        "count", "delay of every second switch, in switches", least=-0.9, most=0.9, default=0.0
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        most = self.duration + abs(self.shift) + 1
        if most > self.every:
            yield (
                "every",
                f"{self.every} coils are too few for coils that stay on for {self.duration:g} "
                f"switches; write at least {int(-(-most // 1))}",
            )


class Mesh(Given):
    """Finite elements and time steps."""

    elements: int = whole(4, 200, "finite elements of the rod", default=16)
    degree: int = whole(1, 4, "degree of their polynomials", default=2)
    step: float | None = positive(
        "time", "longest time step; 0.8 of the longest stable step if left out", default=None
    )
    field_tolerance: float = number(
        "share",
        "terms of the field's series below this share of the largest are left out",
        above=0,
        below=1,
        default=1e-3,
    )


class Duration(Given):
    """Duration of the simulation."""

    cycles: int = whole(2, 1000, "least number of repeats of the pattern in time", default=8)
    end: float = positive("time", "least duration", default=1.2)
    settle: float = number(
        "share", "initial share of the time that means leave out", above=0, below=1, default=0.25
    )


class RodStudy(SIStudy):
    """A magnetisable rod in a channel."""

    worm: Worm = entry("the worm", default=Worm)
    channel: Channel = entry("the channel", default=Channel)
    coils: Zigzag = entry("the coils", default=Zigzag)
    switching: Pattern = entry("switching of the coils")
    mesh: Mesh = entry("finite elements and time steps", default=Mesh)
    time: Duration = entry("duration", default=Duration)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        worm, channel, coils = self.worm, self.channel, self.coils
        if worm.diameter >= channel.diameter:
            yield (
                "worm.diameter",
                f"a body of {worm.diameter:g} m does not fit into a channel of "
                f"{channel.diameter:g} m; write less than channel.diameter",
            )
        if worm.length < coils.pitch:
            yield (
                "worm.length",
                f"a body of {worm.length:g} m is shorter than the distance of the coils, "
                f"{coils.pitch:g} m, so no segment forms; write at least coils.pitch",
            )
        found = _too_few(self.mesh.elements, worm.length, coils.pitch, per_pitch=2)
        yield from of_table("mesh", found)

    @scalars(_ASSUMED)
    def assumed(self) -> Mapping[str, Any]:
        worm = self.worm
        return {
            "assumed_density": worm.density,
            "assumed_damping_time": worm.damping_time,
            "assumed_susceptibility": worm.susceptibility,
            "assumed_friction": self.channel.friction,
            "assumed_skin": worm.skin,
            "assumed_skin_modulus": worm.youngs_modulus if worm.skin else None,
        } | self.coils.assumed
