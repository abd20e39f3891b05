"""Tables of a magnetisable rod in a channel, and scenes of kind "rod-motion": one motion of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, Table, says
from wormopt.systems.coils import SIScene

Coils = Annotated[int, Meta(ge=2, le=40, description="a whole number from 2 to 40")]
Elements = Annotated[int, Meta(ge=4, le=200, description="a whole number from 4 to 200")]
Degree = Annotated[int, Meta(ge=1, le=4, description="1, 2, 3 or 4")]
Cycles = Annotated[int, Meta(ge=2, le=1000, description="a whole number from 2 to 1000")]
Poisson = Annotated[float, Meta(gt=-1, le=0.5, description="a number above -1, at most 0.5")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Duration = Annotated[float, Meta(ge=1, le=8, description="a number from 1 to 8")]
Shift = Annotated[float, Meta(ge=-0.9, le=0.9, description="a number from -0.9 to 0.9")]
Levels = Annotated[
    tuple[Annotated[int, Meta(ge=4, le=200)], ...],
    Meta(max_length=6, description="a list of up to 6 whole numbers from 4 to 200"),
]
Fractions = Annotated[
    tuple[Annotated[float, Meta(gt=0, le=1)], ...],
    Meta(max_length=6, description="a list of up to 6 numbers above 0, at most 1"),
]

ASSUMED_COILS = {
    "assumed_coil_inner": ("length", "inner radius of the windings"),
    "assumed_coil_outer": ("length", "outer radius of the windings"),
    "assumed_coil_length": ("length", "of the windings"),
    "assumed_coil_clearance": ("length", "from wall to winding"),
    "assumed_ampere_turns": ("ampere_turns", "of a coil that is on"),
}
"""Scalars: numbers that are not published for the experiments, those of coils."""
ASSUMED = {
    "assumed_density": ("density", "of the worm"),
    "assumed_damping_time": ("time", "of the worm"),
    "assumed_susceptibility": ("1", "of the worm"),
    "assumed_friction": ("1", "on the walls"),
    "assumed_skin": ("length", "thickness of the skin of a capsule; unknown where it is solid"),
    "assumed_skin_modulus": ("stress", "Young's modulus of the skin; unknown where it is solid"),
} | ASSUMED_COILS


class WormTable(Table, frozen=True, kw_only=True):
    """The worm: a round rod of soft magnetisable rubber, or a skin filled with magnetic fluid."""

    length: Annotated[Positive, says("length", "at least a pitch of the coils")] = 48e-3
    diameter: Annotated[Positive, says("length", "thinner than the channel")] = 4e-3
    youngs_modulus: Annotated[Positive, says("stress", "Young's modulus")] = 5e4
    poisson_ratio: Annotated[Poisson, says("1", "0.5 of rubber, which keeps its volume")] = 0.5
    density: Annotated[Positive, says("density", "*assumed*")] = 2500.0
    damping_time: Annotated[Positive, says("time", "viscosity over Young's modulus, *assumed*")] = (
        1e-3
    )
    susceptibility: Annotated[
        Positive, says("1", "magnetisation over the field without the worm, *assumed*")
    ] = 2.0
    skin: Annotated[
        Positive | None,
        says(
            "length",
            "thickness of the skin of a capsule filled with magnetic fluid, *assumed*: "
            "`youngs_modulus` is then the skin's, `susceptibility` the fluid's, `density` that of "
            "the whole; solid if left out",
        ),
    ] = None


class ChannelTable(Table, frozen=True, kw_only=True):
    """The channel, two straight walls."""

    diameter: Annotated[Positive, says("length", "distance of the walls")] = 11e-3
    friction: Annotated[
        Positive, says("1", "coefficient of dry friction on the walls, *assumed*")
    ] = 0.5


class WindingTable(Table, frozen=True, kw_only=True):
    """Equal coils beside the channel, their axes across it."""

    inner: Annotated[Positive, says("length", "inner radius of the winding, *assumed*")] = 2e-3
    outer: Annotated[
        Positive, says("length", "outer radius, at most the pitch of the coils, *assumed*")
    ] = 9e-3
    length: Annotated[Positive, says("length", "of the winding along the axis, *assumed*")] = 20e-3
    clearance: Annotated[
        Positive, says("length", "from the inner side of the wall to the winding, *assumed*")
    ] = 1e-3
    ampere_turns: Annotated[Positive, says("ampere_turns", "of a coil that is on, *assumed*")] = (
        4600.0
    )

    @property
    def assumed(self) -> dict[str, float]:
        """Scalars: these numbers, so that results show them."""
        sizes = ("inner", "outer", "length", "clearance")
        found = {f"assumed_coil_{name}": getattr(self, name) for name in sizes}
        return found | {"assumed_ampere_turns": self.ampere_turns}


class ZigzagTable(WindingTable, frozen=True, kw_only=True):
    """A row of equal coils on both sides of the channel by turns, their axes across it."""

    pitch: Annotated[
        Positive,
        says("length", "distance of neighbours along the channel; they lie on both sides by turns"),
    ] = 10e-3

    def faults(self) -> Iterator[Fault]:
        """Yield what cannot be built."""
        if self.inner >= self.outer:
            yield (
                "coils.inner",
                f"{self.inner:g} is not below coils.outer = {self.outer:g}; write the smaller "
                "radius here",
            )
        if self.outer > self.pitch:
            yield (
                "coils.outer",
                f"{self.outer:g} is above coils.pitch = {self.pitch:g}: coils of one side, two "
                f"pitches apart, overlap; write at most {self.pitch:g}",
            )


class PatternTable(Table, frozen=True, kw_only=True):
    """How the coils are switched."""

    every: Annotated[
        Coils, says("count", "the pattern repeats after so many coils along the row")
    ] = 7
    duration: Annotated[
        Duration,
        says(
            "count",
            "how long a coil stays on, in switches: so many are on at a time, on average; 2.5 "
            "lets two and three be on by turns",
        ),
    ] = 3.0
    shift: Annotated[
        Shift, says("count", "by how much every second switch comes late, in switches")
    ] = 0.0

    def faults(self) -> Iterator[Fault]:
        """Yield what does not fit into the pattern."""
        most = self.duration + abs(self.shift) + 1
        if most > self.every:
            yield (
                "switching.every",
                f"{self.every} coils are too few for coils that stay on for {self.duration:g} "
                f"switches; write at least {int(-(-most // 1))}",
            )


class MeshTable(Table, frozen=True, kw_only=True):
    """Finite elements and time steps."""

    elements: Annotated[Elements, says("count", "finite elements of the rod")] = 16
    degree: Annotated[Degree, says("count", "degree of their polynomials")] = 2
    step: Annotated[
        Positive | None,
        says("time", "longest time step; 0.8 of the longest stable one if left out"),
    ] = None
    field_tolerance: Annotated[
        Share,
        says(
            "share", "terms of the field's series below this share of the largest one are left out"
        ),
    ] = 1e-3


class CourseTable(Table, frozen=True, kw_only=True):
    """How long the worm is followed."""

    cycles: Annotated[Cycles, says("count", "repeats of the pattern in time, at least")] = 8
    duration: Annotated[Positive, says("time", "at least")] = 1.2
    settle: Annotated[
        Share, says("share", "of the time, at the beginning, that does not count")
    ] = 0.25


class RodScene(SIScene, frozen=True, kw_only=True):
    """A magnetisable rod in a channel."""

    worm: Annotated[WormTable, says("", "what moves")] = WormTable()
    channel: Annotated[ChannelTable, says("", "where")] = ChannelTable()
    coils: Annotated[ZigzagTable, says("", "what moves it")] = ZigzagTable()
    switching: Annotated[PatternTable, says("", "how")]
    mesh: Annotated[MeshTable, says("", "elements and steps")] = MeshTable()
    course: Annotated[CourseTable, says("", "how long")] = CourseTable()

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        worm, channel, coils, mesh = self.worm, self.channel, self.coils, self.mesh
        yield from coils.faults()
        if worm.skin and 2 * worm.skin > worm.diameter:
            yield (
                "worm.skin",
                f"{worm.skin:g} is above the radius of the body; write at most "
                f"{worm.diameter / 2:g}",
            )
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
                f"{coils.pitch:g} m: no segment forms; write at least coils.pitch",
            )
        if worm.length / mesh.elements > coils.pitch / 2:
            least = int(-(-2 * worm.length // coils.pitch))
            yield (
                "mesh.elements",
                f"{mesh.elements} are too few for {worm.length / coils.pitch:.3g} pitches of "
                f"coils; write at least {least}",
            )
        yield from self.switching.faults()


class SwitchingTable(PatternTable, frozen=True, kw_only=True):
    """How fast and how the coils are switched."""

    rate: Annotated[
        Positive,
        says(
            "rate",
            "switches a second, the chapter's *n*; the field travels one pitch in 1/`rate`",
        ),
    ]

    @property
    def pattern(self) -> PatternTable:
        """The pattern, whatever its rate."""
        return PatternTable(every=self.every, duration=self.duration, shift=self.shift)


class ConvergenceTable(Table, frozen=True, kw_only=True):
    """Other meshes and steps, to see what they change."""

    elements: Annotated[Levels, says("count", "other numbers of elements")] = (24,)
    steps: Annotated[Fractions, says("share", "of the time step")] = (0.5,)
    accepted: Annotated[
        Share,
        says(
            "share",
            "largest change of the mean velocity by any of these that is accepted, beyond the "
            "errors of both and over that velocity (over a hundredth of the field's, if that is "
            "more)",
        ),
    ] = 0.1


class RodMotionScene(RodScene, frozen=True, kw_only=True):
    """A magnetisable rod in a channel, moved by coils that are switched in turn.

    A worm of soft magnetisable rubber between two walls, and coils beside them that are switched
    in turn. Theory: [theory-channel.md](../theory-channel.md#3-rod-in-the-channel). One motion of
    the rod, step by step: how fast it crawls and where to, shapes, forces on the walls, where the
    work of the field goes. It is computed again with other steps and meshes. Only
    `units = "SI"`. Numbers marked *assumed* are not published for the experiments; every result
    shows them as scalars `assumed_…`.

    `frame` are times in the last two repeats of the pattern. The status is `failed` where the
    balance of energy is off by more than 1 %, walls are entered by more than 5 % of the room, or
    the mean velocity changes too much with step or mesh, or is not known well enough to tell
    (errors above half of it).
    """

    scalars: ClassVar = {
        "velocity_mean": ("speed", "mean velocity after settling, positive with the field"),
        "velocity_error": (
            "speed",
            "half the width of its 95 % interval, by means over batches of whole repeats",
        ),
        "direction": (
            "1",
            "−1 against the travel of the field, 1 with it, 0 where the interval holds both",
        ),
        "velocity_per_frequency": ("length", "`velocity_mean` over `rate`"),
        "field_speed": ("speed", "of the field"),
        "rate": ("rate", "of the field"),
        "arc_length": (
            "length",
            "of the rod from coil to coil of a block just before the coils change, mean; unknown "
            "where it never lay over a block",
        ),
        "pressed_max": ("force", "largest force of a wall on a node"),
        "pressed_mean": ("force", "mean of the sum over all nodes"),
        "penetration_max": ("length", "deepest into a wall: one step's way"),
        "energy_error": (
            "share", "largest error of the balance of energy, over the work of the field",
        ),
        "field_error": (
            "share", "largest error of the series of *H*², over the largest *H*²",
        ),
        "field_work": ("energy", "done on the rod by the field, by the end"),
        "friction_work": ("energy", "likewise by friction"),
        "damping_work": ("energy", "likewise by the material's damping"),
        "wall_work": ("energy", "likewise by impacts"),
        "step_count": ("count", "time steps"),
        "velocity_again": (
            "speed", "with each of `convergence.steps`, then of `convergence.elements`",
        ),
    } | ASSUMED  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "centre": ("length", ("time",), "mean place of the rod"),
        "work_load": ("energy", ("time",), "done by the field"),
        "work_damping": ("energy", ("time",), "done by the material's damping"),
        "work_friction": ("energy", ("time",), "done by friction"),
        "work_walls": ("energy", ("time",), "done by impacts"),
        "frame": ("time", ("frame",), "time of a shape"),
        "rod_x": ("length", ("frame", "node"), "x of the nodes"),
        "rod_y": ("length", ("frame", "node"), "y of the nodes"),
        "rod_angle": ("rad", ("frame", "node"), "angle of the nodes"),
        "pressed_upper": ("force", ("frame", "node"), "force on the upper wall"),
        "pressed_lower": ("force", ("frame", "node"), "force on the lower wall"),
        "first_coil": ("count", ("frame",), "first coil of a block that is on"),
        "coils_on": ("count", ("frame",), "coils of a block"),
        "step_again": ("share", ("step_again",), "step"),
        "velocity_by_step": ("speed", ("step_again",), "mean velocity"),
        "error_by_step": ("speed", ("step_again",), "its error"),
        "elements_again": ("count", ("elements_again",), "elements"),
        "velocity_by_elements": ("speed", ("elements_again",), "mean velocity"),
        "error_by_elements": ("speed", ("elements_again",), "its error"),
    }

    kind: Literal["rod-motion"]
    want: Annotated[
        tuple[Literal["rod_motion", "animation"], ...],
        says("", "`rod_motion`: shapes, way, where the work goes; `animation`: a GIF"),
    ] = ()
    switching: Annotated[SwitchingTable, says("", "how fast and how")]
    convergence: Annotated[ConvergenceTable, says("", "what is computed again, more finely")] = (
        ConvergenceTable()
    )
