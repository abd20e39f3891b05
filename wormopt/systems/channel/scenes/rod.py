"""Tables of a magnetisable rod in a channel, and scenes of kind "rod-motion": one motion of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.systems.coils import SIScene

Coils = Annotated[int, Meta(ge=2, le=40, description="a whole number from 2 to 40")]
Elements = Annotated[int, Meta(ge=4, le=200, description="a whole number from 4 to 200")]
Degree = Annotated[int, Meta(ge=1, le=4, description="1, 2, 3 or 4")]
Cycles = Annotated[int, Meta(ge=2, le=1000, description="a whole number from 2 to 1000")]
Poisson = Annotated[float, Meta(gt=-1, le=0.5, description="a number above -1, at most 0.5")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Duration = Annotated[float, Meta(ge=1, le=8, description="a number from 1 to 8")]
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
    "assumed_coil_length": ("length", "length of the windings"),
    "assumed_coil_clearance": ("length", "distance from wall to winding"),
    "assumed_ampere_turns": ("ampere_turns", "ampere-turns of an active coil"),
}
"""Scalars: parameters of coils that are not published for the experiments."""
ASSUMED = {
    "assumed_density": ("density", "density of the worm"),
    "assumed_damping_time": ("time", "damping time of the worm"),
    "assumed_susceptibility": ("1", "susceptibility of the worm"),
    "assumed_friction": ("1", "friction on the walls"),
    "assumed_skin": ("length", "thickness of a capsule's skin; unknown for a solid worm"),
    "assumed_skin_modulus": ("stress", "Young's modulus of the skin; unknown for a solid worm"),
} | ASSUMED_COILS


class WormTable(Given):
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


class ChannelTable(Given):
    """The channel, two straight walls."""

    diameter: float = positive("length", "distance of the walls", default=11e-3)
    friction: float = positive(
        "1", "coefficient of dry friction on the walls, *assumed*", default=0.5
    )


class WindingTable(Given):
    """Equal coils beside the channel, their axes across it."""

    inner: float = positive("length", "inner radius of the winding, *assumed*", default=2e-3)
    outer: float = positive(
        "length", "outer radius, at most the pitch of the coils, *assumed*", default=9e-3
    )
    length: float = positive("length", "axial length of the winding, *assumed*", default=20e-3)
    clearance: float = positive(
        "length", "distance from the wall's inner side to the winding, *assumed*", default=1e-3
    )
    ampere_turns: float = positive("ampere_turns", "of an active coil, *assumed*", default=4600.0)

    @property
    def assumed(self) -> dict[str, float]:
        """Return these parameters as scalars, so that results list them."""
        sizes = ("inner", "outer", "length", "clearance")
        found = {f"assumed_coil_{name}": getattr(self, name) for name in sizes}
        return found | {"assumed_ampere_turns": self.ampere_turns}


class ZigzagTable(WindingTable):
    """A row of equal coils, alternating between both sides of the channel, with axes across it."""

    pitch: float = positive(
        "length",
        "distance of neighbours, which lie on alternate sides, along the channel",
        default=10e-3,
    )

    def faults(self) -> Iterator[Fault]:
        """Yield rows that cannot be built."""
        if self.inner >= self.outer:
            yield (
                "coils.inner",
                f"{self.inner:g} is not below coils.outer = {self.outer:g}; write a radius below "
                "coils.outer",
            )
        if self.outer > self.pitch:
            yield (
                "coils.outer",
                f"{self.outer:g} is above coils.pitch = {self.pitch:g}, so coils of one side, two "
                f"pitches apart, overlap; write at most {self.pitch:g}",
            )


class PatternTable(Given):
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

    def faults(self) -> Iterator[Fault]:
        """Yield faults of the pattern."""
        most = self.duration + abs(self.shift) + 1
        if most > self.every:
            yield (
                "switching.every",
                f"{self.every} coils are too few for coils that stay on for {self.duration:g} "
                f"switches; write at least {int(-(-most // 1))}",
            )


class MeshTable(Given):
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


class CourseTable(Given):
    """Duration of the simulation."""

    cycles: int = whole(2, 1000, "least number of repeats of the pattern in time", default=8)
    duration: float = positive("time", "least duration", default=1.2)
    settle: float = number(
        "share", "initial share of the time that means leave out", above=0, below=1, default=0.25
    )


class RodScene(SIScene):
    """A magnetisable rod in a channel."""

    worm: WormTable = entry("the worm", default=WormTable())
    channel: ChannelTable = entry("where", default=ChannelTable())
    coils: ZigzagTable = entry("the coils", default=ZigzagTable())
    switching: PatternTable = entry("how")
    mesh: MeshTable = entry("finite elements and time steps", default=MeshTable())
    course: CourseTable = entry("duration", default=CourseTable())

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        worm, channel, coils, mesh = self.worm, self.channel, self.coils, self.mesh
        yield from coils.faults()
        if worm.skin and 2 * worm.skin > worm.diameter:
            yield (
                "worm.skin",
                f"{worm.skin:g} exceeds the radius of the body; write at most "
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
                f"{coils.pitch:g} m, so no segment forms; write at least coils.pitch",
            )
        if worm.length / mesh.elements > coils.pitch / 2:
            least = int(-(-2 * worm.length // coils.pitch))
            yield (
                "mesh.elements",
                f"{mesh.elements} are too few for {worm.length / coils.pitch:.3g} pitches of "
                f"coils; write at least {least}",
            )
        yield from self.switching.faults()


class SwitchingTable(PatternTable):
    """Switching pattern of the coils, and its rate."""

    rate: float = positive(
        "rate", "*n*, switches per second; the field travels one pitch in 1/`rate`"
    )

    @property
    def pattern(self) -> PatternTable:
        """Return the pattern without its rate."""
        return PatternTable(every=self.every, duration=self.duration, shift=self.shift)


class ConvergenceTable(Given):
    """Other meshes and steps, to test convergence."""

    elements: Levels = entry("other numbers of elements", quantity="count", default=(24,))
    steps: Fractions = entry(
        "other time steps, as shares of the step", quantity="share", default=(0.5,)
    )
    accepted: float = number(
        "share",
        "accepted change of the mean velocity with any of these, beyond the errors of both and "
        "relative to that velocity (to a hundredth of the field's, if that is "
        "more)",
        above=0,
        below=1,
        default=0.1,
    )


class RodMotionScene(RodScene):
    """A magnetisable rod in a channel, moved by coils that are switched in turn.

    A worm of soft magnetisable rubber lies between two walls, with coils beside them. The scene
    simulates one motion of the rod: velocity and direction, shapes, wall forces, and the balance of
    work. It repeats the simulation with other steps and meshes. Theory:
    [theory-channel.md](../theory-channel.md#3-rod-in-the-channel). Only `units = "SI"`. Parameters
    marked *assumed* are not published for the experiments in Zimmermann et al. 2007
    [[1]](../references.md). Every result lists them as scalars `assumed_…`.

    `frame` are times in the last two repeats of the pattern. The status is `failed` if the energy
    balance has an error above 1 %, or walls are penetrated by more than 5 % of the room. It is also
    `failed` if the mean velocity changes too much with step or mesh, or its error is above half of
    it.
    """

    scalars: ClassVar = {
        "velocity_mean": ("speed", "mean velocity after `course.settle`, positive with the field"),
        "velocity_error": (
            "speed",
            "half the width of its 95 % interval, by means over batches of whole repeats",
        ),
        "direction": (
            "1",
            "−1 against the travel of the field, 1 with it, 0 if the interval contains both",
        ),
        "velocity_per_frequency": ("length", "`velocity_mean` over `rate`"),
        "field_speed": ("speed", "speed of the travelling field"),
        "rate": ("rate", "switches per second"),
        "arc_length": (
            "length",
            "mean length of the rod from coil to coil of a block just before the coils change; "
            "unknown if it never lay over a block",
        ),
        "pressed_max": ("force", "largest force of a wall on a node"),
        "pressed_mean": ("force", "mean of the sum of wall forces over all nodes"),
        "penetration_max": ("length", "largest depth in a wall: the displacement of one step"),
        "energy_error": (
            "share", "largest error of the energy balance, over the work of the field",
        ),
        "field_error": (
            "share", "largest error of the series of *H*², over the largest *H*²",
        ),
        "field_work": ("energy", "work of the field on the rod, at the end"),
        "friction_work": ("energy", "work of friction"),
        "damping_work": ("energy", "work of the material's damping"),
        "wall_work": ("energy", "work of impacts"),
        "step_count": ("count", "number of time steps"),
        "velocity_again": (
            "speed", "mean velocity for each of `convergence.steps`, then `convergence.elements`",
        ),
    } | ASSUMED  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "centre": ("length", ("time",), "mean position of the rod"),
        "work_load": ("energy", ("time",), "work of the field"),
        "work_damping": ("energy", ("time",), "work of the material's damping"),
        "work_friction": ("energy", ("time",), "work of friction"),
        "work_walls": ("energy", ("time",), "work of impacts"),
        "frame": ("time", ("frame",), "time of a shape"),
        "rod_x": ("length", ("frame", "node"), "x of the nodes"),
        "rod_y": ("length", ("frame", "node"), "y of the nodes"),
        "rod_angle": ("rad", ("frame", "node"), "angle of the nodes"),
        "pressed_upper": ("force", ("frame", "node"), "force on the upper wall"),
        "pressed_lower": ("force", ("frame", "node"), "force on the lower wall"),
        "first_coil": ("count", ("frame",), "first coil of an active block"),
        "coils_on": ("count", ("frame",), "number of coils in the block"),
        "step_again": ("share", ("step_again",), "step"),
        "velocity_by_step": ("speed", ("step_again",), "mean velocity"),
        "error_by_step": ("speed", ("step_again",), "error of the mean velocity"),
        "elements_again": ("count", ("elements_again",), "elements"),
        "velocity_by_elements": ("speed", ("elements_again",), "mean velocity"),
        "error_by_elements": ("speed", ("elements_again",), "error of the mean velocity"),
    }

    kind: Literal["rod-motion"]
    want: tuple[Literal["rod_motion", "animation"], ...] = entry(
        "`rod_motion`: shapes, displacement, works; `animation`: the moving rod, as a GIF",
        default=(),
    )
    switching: SwitchingTable = entry("switching pattern and rate")
    convergence: ConvergenceTable = entry("other meshes and steps", default=ConvergenceTable())
