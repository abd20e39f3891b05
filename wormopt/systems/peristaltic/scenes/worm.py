"""Scenes of kind "peristaltic-worm": simulation of a worm of membrane segments."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.systems.coils import SIScene
from wormopt.systems.peristaltic.tables import SegmentTable
from wormopt.systems.shared.declared import EVENTS, TIME, over

Segments = Annotated[int, Meta(ge=1, le=30, description="a whole number from 1 to 30")]
Cycles = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]

_MU0 = 4e-7 * math.pi


class WormTable(SegmentTable):
    """The worm: a row of sealed membrane cylinders full of magnetic fluid."""

    segments: int = whole(1, 30, "number of segments *N*; segment 0 is the head")
    density: float = positive(
        "density", "mean density of a segment, in its volume π*R*²*L*, *assumed*"
    )
    damping: float = number("drag", "damping along each segment (Kelvin-Voigt), *assumed*", least=0)
    load: float = number("force", "load on the whole worm against forward motion", default=0.0)
    gravity: float = positive("acceleration", "acceleration of gravity", default=GRAVITY)

    @property
    def mass(self) -> float:
        """Return the mass of a segment."""
        return self.density * math.pi * self.radius**2 * self.length


class CoilTable(Given):
    """One coil around each segment, and the fluid in it."""

    current: float = positive("current", "current of a coil that is on")
    field_per_current: float = positive(
        "field_per_current", "magnetic field in the fluid per current, *assumed*"
    )
    mu_r: float = number("1", "relative permeability of the fluid", above=1)
    share: float = number(
        "share",
        "share *c* of the segment's length in the field, *assumed*",
        above=0,
        below=1,
        default=0.5,
    )

    @property
    def pressure(self) -> float:
        """Return the magnetic pressure in the field of a coil that is on."""
        return _MU0 * (self.mu_r - 1) * (self.field_per_current * self.current) ** 2 / 2


Direction = Literal["retrograde", "direct"]
_DIRECTION = says("", "`retrograde`: the wave runs from head to tail; `direct`: from tail to head")


class SwitchedWave(Given, tag_field="kind", tag="switched"):
    """Coils are on or off; the block of coils that are on moves by one segment each step."""

    on: int = whole(1, 30, "number *m* of coils on at a time")
    step: float = positive("time", "time until the block moves by one segment")
    direction: Annotated[Direction, _DIRECTION] = "retrograde"


class HarmonicWave(Given, tag_field="kind", tag="harmonic"):
    """Currents *I* (1 + cos(2π *t*/*T* − 2π *q j*/*N*))/2 in segment *j*."""

    period: float = positive("time", "*T*")
    waves: float = number(
        "1", "phase lag *q*/*N* between neighbouring segments, in periods", above=0, below=1
    )
    direction: Annotated[Direction, _DIRECTION] = "retrograde"


class DryTable(Given, tag_field="kind", tag="dry"):
    """Open ground with dry friction by weight."""

    forward: float = number("1", "coefficient against sliding forward", least=0)
    backward: float = number("1", "coefficient against sliding backward", least=0)


class DragTable(Given, tag_field="kind", tag="drag"):
    """Open ground with drag *c*<sub>0</sub> (*l*/*L*)<sup>*a*</sup> at the segments' middles."""

    coefficient: float = positive("drag", "drag *c*<sub>0</sub> of a segment")
    exponent: float = number(
        "1", "exponent *a*: if positive long segments grip, if negative short ones, at 0 none"
    )


class TubeTable(Given, tag_field="kind", tag="tube"):
    """A straight tube: swollen segments press on its wall and grip it."""

    radius: float = positive("length", "*R*<sub>t</sub>, above that of the worm")
    friction: float = number(
        "1", "coefficient of dry friction, for weight and wall pressure", least=0
    )
    bedding: float = positive("bedding", "*k*<sub>w</sub>, wall pressure per depth, *assumed*")


class SettingTable(Given):
    """Duration and accuracy of the simulation."""

    cycles: int = whole(1, 1000, "number of cycles of the wave", default=6)
    settle: Annotated[int, Meta(ge=0, le=999, description="a whole number from 0 to 999")] = entry(
        "number of first cycles that means leave out", quantity="count", default=2
    )
    tolerance: Annotated[
        float, Meta(ge=1e-13, le=1e-4, description="a number from 1e-13 to 1e-4")
    ] = entry("relative tolerance of a step", quantity="share", default=1e-10)
    moreau_step: float | None = positive(
        "time",
        "longer step of the second route, which also uses a quarter of it; if left out, a "
        "twentieth of the shortest vibration's period over 2π",
        default=None,
    )


class PeristalticWormScene(SIScene):
    """A worm of membrane segments with coils on the ground or in a tube, simulated with events.

    Coils that are on shorten their segments, which swell. A wave of active coils moves the worm.
    Rest and sliding are resolved exactly. Theory:
    [theory-peristaltic.md](../theory-peristaltic.md#2-the-chain). Moreau-Jean time stepping, which
    uses no events, computes the motion again. Only `units = "SI"`. Parameters marked *assumed* are
    not from Zimmermann et al. 2007 [[1]](../references.md). The status is `failed` if energy is not
    balanced, the second route disagrees, or a coil pulls its segment into itself.

    `frame` are times in the last two cycles.
    """

    scalars: ClassVar = {
        "advance": ("length", "displacement of the mass centre per cycle, mean after `settle`"),
        "advance_ideal": (
            "length",
            "(*N* − *m*) *D*, advance with ideal anchors; unknown for harmonic currents",
        ),
        "advance_share": ("share", "`advance` divided by `advance_ideal`"),
        "speed": ("speed", "mean speed after `course.settle` cycles"),
        "against_wave": ("1", "1: moves against its wave; −1: with it; 0: not at all"),
        "stroke": (
            "length",
            "*D*: shortening of a segment by its coil without load, or until it fills the tube",
        ),
        "slip": (
            "length",
            "backward slip per cycle of the segments that a step leaves short: at best 0",
        ),
        "holding_reserve": (
            "share",
            "least unused share of the friction of those segments; 0 if they slide",
        ),
        "coil_duty": ("share", "mean of the coils' squared currents over `coils.current` squared"),
        "loading": ("1", "*κ* = *p*<sub>m</sub>*R*/(*Gh*)"),
        "loading_share": ("share", "*κ* over that at which a coil pulls its segment into itself"),
        "magnetic_pressure": ("stress", "*p*<sub>m</sub> of a coil that is on"),
        "weight": ("force", "weight of a segment"),
        "normal_force_max": ("force", "largest force of the wall on a segment"),
        "wall_depth_max": ("length", "largest depth of a segment in the wall"),
        "stretch_min": ("1", "least length of a segment, over *L*"),
        "coil_work": ("energy", "work of the coils"),
        "damping_work": ("energy", "work of the dashpots"),
        "drag_work": ("energy", "work of drag"),
        "friction_work": ("energy", "work of dry friction"),
        "load_work": ("energy", "work of the load"),
        "energy_error": ("share", "works less the energy gained, relative to the largest of them"),
        "moreau_error": ("share", "difference to the second route's end, over the longest path"),
        "n_events": ("count", "number of located events: reversals, sticks, releases"),
        "n_steps": ("count", "number of integrator steps"),
    }
    variables: ClassVar = (
        TIME
        | over(
            {
                "position": ("length", ("ring",), "position of the ring"),
                "current": ("current", ("segment",), "current of the coil"),
                "stretch": ("1", ("segment",), "length over unstressed length"),
                "normal_force": ("force", ("segment",), "force of the wall"),
                "contact_force": ("force", ("contact",), "tangential force of the ground"),
                "resting": ("count", ("contact",), "1 while the contact rests, else 0"),
                "center": ("length", (), "position of the centre of mass"),
                "stored": ("energy", (), "kinetic and elastic energy, including the wall's"),
                "work_coil": ("energy", (), "work of the coils"),
                "work_damping": ("energy", (), "work of the dashpots"),
                "work_drag": ("energy", (), "work of drag"),
                "work_friction": ("energy", (), "work of dry friction"),
                "work_load": ("energy", (), "work of the load"),
            }
        )
        | EVENTS
    )
    headline: ClassVar = ("advance", "advance_share", "speed", "against_wave", "slip")

    kind: Literal["peristaltic-worm"]
    want: tuple[Literal["worm", "course", "animation"], ...] = entry(
        "`worm`: the body over the last cycle; `course`: positions and energies over time; "
        "`animation`: the moving body, as a GIF",
        default=(),
    )
    worm: WormTable = entry("the worm")
    coils: CoilTable = entry("the coils")
    wave: SwitchedWave | HarmonicWave = entry("how")
    ground: DryTable | DragTable | TubeTable = entry("open ground, or a tube")
    anchoring: Literal["mid", "clamp"] = entry(
        "`mid`: friction acts at the middle of a segment; `clamp`: half of it at either end. "
        "Drag acts at the middle",
        default="mid",
    )
    course: SettingTable = entry("duration and accuracy", default=SettingTable())

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        worm, course = self.worm, self.course
        if isinstance(self.wave, SwitchedWave) and self.wave.on >= worm.segments:
            yield (
                "wave.on",
                f"{self.wave.on} of {worm.segments} coils on leave none to switch on; write at "
                f"most {worm.segments - 1}",
            )
        if course.settle >= course.cycles:
            yield "course.settle", f"no cycle is left; write at most {course.cycles - 1}"
        yield from self._faults_of_field()
        yield from self._faults_of_ground()

    def _faults_of_field(self) -> Iterator[Fault]:
        most = self.loading_limit * self.worm.shear_modulus * self.worm.wall / self.worm.radius
        if self.coils.pressure >= most:
            current = self.coils.current * math.sqrt(most / self.coils.pressure)
            yield (
                "coils.current",
                f"{self.coils.current:g} A make a magnetic pressure of {self.coils.pressure:.4g} "
                f"Pa; from {most:.4g} Pa a coil pulls its segment into itself; write less than "
                f"{current:.4g}",
            )

    @property
    def loading_limit(self) -> float:
        """Return P R / (G h) at which coil and membrane balance at the length of the coil."""
        c, a = self.coils.share, self.worm.neo_hookean
        return 2 * c * (c**-2 - c) * (a + (1 - a) / c)

    def _faults_of_ground(self) -> Iterator[Fault]:
        ground, worm = self.ground, self.worm
        if isinstance(ground, TubeTable):
            yield from worm.faults_in("ground.radius", ground.radius)
        if isinstance(ground, DragTable) or not worm.load:
            return
        key = "friction" if isinstance(ground, TubeTable) else (
            "backward" if worm.load > 0 else "forward"
        )  # fmt: skip
        if not getattr(ground, key):
            least = abs(worm.load) / (worm.segments * worm.mass * worm.gravity)
            yield (
                f"ground.{key}",
                f"0, and the load is {worm.load:g} N: nothing holds the worm; write {least:.3g} or "
                "more",
            )
