"""Scenes of kind "peristaltic-worm": a worm of membrane segments, simulated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.quantities import GRAVITY
from wormopt.scene.types import Finite, NonNegative, Positive, Table, says
from wormopt.systems.coils import SIScene
from wormopt.systems.peristaltic.scenes.segment import SegmentTable
from wormopt.systems.shared.declared import EVENTS, TIME, over

Segments = Annotated[int, Meta(ge=1, le=30, description="a whole number from 1 to 30")]
Cycles = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]

_MU0 = 4e-7 * math.pi


class WormTable(SegmentTable, frozen=True, kw_only=True):
    """The worm: sealed membrane cylinders full of magnetic fluid, one behind the other."""

    segments: Annotated[Segments, says("count", "*N*; segment 0 is the head")]
    density: Annotated[
        Positive, says("density", "of all that is in a segment's volume π*R*²*L*, *assumed*")
    ]
    damping: Annotated[
        NonNegative, says("drag", "of the dashpot along each segment (Kelvin-Voigt), *assumed*")
    ]
    load: Annotated[Finite, says("force", "against forward motion, on the whole worm")] = 0.0
    gravity: Annotated[Positive, says("acceleration", "by which it weighs on the ground")] = GRAVITY

    @property
    def mass(self) -> float:
        """Mass of a segment."""
        return self.density * math.pi * self.radius**2 * self.length


class CoilTable(Table, frozen=True, kw_only=True):
    """One coil about each segment, and the fluid in it."""

    current: Annotated[Positive, says("current", "of a coil that is on")]
    field_per_current: Annotated[
        Positive, says("field_per_current", "magnetic field in the fluid by current, *assumed*")
    ]
    mu_r: Annotated[Permeability, says("1", "relative permeability of the fluid")]
    share: Annotated[
        Share, says("share", "*c*, part of the segment's length that lies in the field, *assumed*")
    ] = 0.5

    @property
    def pressure(self) -> float:
        """Magnetic pressure in the field of a coil that is on."""
        return _MU0 * (self.mu_r - 1) * (self.field_per_current * self.current) ** 2 / 2


Direction = Literal["retrograde", "direct"]
_DIRECTION = says("", "`retrograde`: the wave runs from head to tail; `direct`: from tail to head")


class SwitchedWave(Table, frozen=True, kw_only=True, tag_field="kind", tag="switched"):
    """Coils are on or off: a block of coils that are on goes on by one segment each step."""

    on: Annotated[Segments, says("count", "*m*, coils that are on at a time")]
    step: Annotated[Positive, says("time", "how long until the block goes on")]
    direction: Annotated[Direction, _DIRECTION] = "retrograde"


class HarmonicWave(Table, frozen=True, kw_only=True, tag_field="kind", tag="harmonic"):
    """Currents *I* (1 + cos(2π *t*/*T* − 2π *q j*/*N*))/2 in segment *j*."""

    period: Annotated[Positive, says("time", "*T*")]
    waves: Annotated[Share, says("1", "*q*/*N*, periods by which a segment lags behind the last")]
    direction: Annotated[Direction, _DIRECTION] = "retrograde"


class DryTable(Table, frozen=True, kw_only=True, tag_field="kind", tag="dry"):
    """Open ground with dry friction on the weight."""

    forward: Annotated[NonNegative, says("1", "coefficient against sliding forward")]
    backward: Annotated[NonNegative, says("1", "coefficient against sliding backward")]


class DragTable(Table, frozen=True, kw_only=True, tag_field="kind", tag="drag"):
    """Open ground with drag *c*<sub>0</sub> (*l*/*L*)<sup>*a*</sup> at the segments' middles."""

    coefficient: Annotated[Positive, says("drag", "*c*<sub>0</sub> of a segment")]
    exponent: Annotated[
        Finite, says("1", "*a*: above 0 long segments hold on, below 0 short ones, at 0 none")
    ]


class TubeTable(Table, frozen=True, kw_only=True, tag_field="kind", tag="tube"):
    """A straight tube: segments that swell press on its wall and hold on to it."""

    radius: Annotated[Positive, says("length", "*R*<sub>t</sub>, above that of the worm")]
    friction: Annotated[
        NonNegative, says("1", "coefficient of dry friction, of weight and of pressing")
    ]
    bedding: Annotated[
        Positive,
        says("bedding", "*k*<sub>w</sub>, pressure by which the wall gives way, *assumed*"),
    ]


class SettingTable(Table, frozen=True, kw_only=True):
    """How long the worm is followed, and how exactly."""

    cycles: Annotated[Cycles, says("count", "cycles of the wave")] = 6
    settle: Annotated[
        Annotated[int, Meta(ge=0, le=999, description="a whole number from 0 to 999")],
        says("count", "first cycles, which do not count"),
    ] = 2
    tolerance: Annotated[
        Annotated[float, Meta(ge=1e-13, le=1e-4, description="a number from 1e-13 to 1e-4")],
        says("share", "relative error of a step"),
    ] = 1e-10
    moreau_step: Annotated[
        Positive | None,
        says(
            "time",
            "longer step of the second route, which goes by a quarter of it too; a twentieth of "
            "the shortest vibration's time over 2π if left out",
        ),
    ] = None


class PeristalticWormScene(SIScene, frozen=True, kw_only=True):
    """A worm of membrane segments with coils, on the ground or in a tube, simulated with events.

    Coils that are on shorten their segments, which swell; a wave of them moves the worm. Rest and
    sliding are decided exactly. Theory:
    [theory-peristaltic.md](../theory-peristaltic.md#2-the-chain). The motion is computed again by
    steps of Moreau and Jean, which know no events. Only `units = "SI"`. Numbers marked *assumed*
    are not the chapter's. Status `failed`: energy is not balanced, the second route disagrees, or
    a coil pulls its segment into itself.

    `frame` are times in the last two cycles.
    """

    scalars: ClassVar = {
        "advance": ("length", "way of the centre of mass in a cycle, mean after settling"),
        "advance_ideal": (
            "length",
            "(*N* − *m*) *D*, of ideal anchors; unknown for harmonic currents",
        ),
        "advance_share": ("share", "`advance` over `advance_ideal`"),
        "speed": ("speed", "mean speed after settling"),
        "against_wave": ("1", "1: moves against its wave; −1: with it; 0: not at all"),
        "stroke": (
            "length",
            "*D*: a segment's shortening by its coil without load, or until it fills the tube",
        ),
        "slip": (
            "length",
            "way back, in a cycle, of the segments that a step leaves short: at best 0",
        ),
        "holding_reserve": (
            "share",
            "least part of the friction of those segments that is not used up; 0 where they slide",
        ),
        "coil_duty": ("share", "mean of the coils' squared currents over `coils.current` squared"),
        "loading": ("1", "*κ* = *p*<sub>m</sub>*R*/(*Gh*)"),
        "loading_share": ("share", "*κ* over that at which a coil pulls its segment into itself"),
        "magnetic_pressure": ("stress", "*p*<sub>m</sub> of a coil that is on"),
        "weight": ("force", "of a segment"),
        "normal_force_max": ("force", "largest force of the wall on a segment"),
        "wall_depth_max": ("length", "deepest into the wall"),
        "stretch_min": ("1", "shortest segment, over *L*"),
        "coil_work": ("energy", "done by the coils"),
        "damping_work": ("energy", "likewise by the dashpots"),
        "drag_work": ("energy", "likewise by drag"),
        "friction_work": ("energy", "likewise by dry friction"),
        "load_work": ("energy", "likewise by the load"),
        "energy_error": ("share", "works less the energy gained, over the largest of them"),
        "moreau_error": ("share", "difference of the second route's end, over the longest way"),
        "n_events": ("count", "events located: reversals, sticks, releases"),
        "n_steps": ("count", "steps of the integrator"),
    }
    variables: ClassVar = (
        TIME
        | over(
            {
                "position": ("length", ("ring",), "place of the ring"),
                "current": ("current", ("segment",), "current of the coil"),
                "stretch": ("1", ("segment",), "length over the unstressed one"),
                "normal_force": ("force", ("segment",), "force of the wall"),
                "contact_force": ("force", ("contact",), "force of the ground along it"),
                "resting": ("count", ("contact",), "1 where the contact rests"),
                "center": ("length", (), "place of the centre of mass"),
                "stored": ("energy", (), "kinetic and elastic energy, that of the wall too"),
                "work_coil": ("energy", (), "done by the coils"),
                "work_damping": ("energy", (), "done by the dashpots"),
                "work_drag": ("energy", (), "done by drag"),
                "work_friction": ("energy", (), "done by dry friction"),
                "work_load": ("energy", (), "done by the load"),
            }
        )
        | EVENTS
    )
    headline: ClassVar = ("advance", "advance_share", "speed", "against_wave", "slip")

    kind: Literal["peristaltic-worm"]
    want: Annotated[
        tuple[Literal["worm", "course", "animation"], ...],
        says(
            "",
            "`worm`: the body as it swells and thins; `course`: places and energies over time; "
            "`animation`: a GIF",
        ),
    ] = ()
    worm: Annotated[WormTable, says("", "what moves")]
    coils: Annotated[CoilTable, says("", "what moves it")]
    wave: Annotated[SwitchedWave | HarmonicWave, says("", "how")]
    ground: Annotated[DryTable | DragTable | TubeTable, says("", "what it moves on, or in")]
    anchoring: Annotated[
        Literal["mid", "clamp"],
        says(
            "",
            "`mid`: friction acts at the middle of a segment; `clamp`: half of it at either end. "
            "Drag is at the middle",
        ),
    ] = "mid"
    course: Annotated[SettingTable, says("", "how long, and how exactly")] = SettingTable()

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        worm, course = self.worm, self.course
        if isinstance(self.wave, SwitchedWave) and self.wave.on >= worm.segments:
            yield (
                "wave.on",
                f"{self.wave.on} of {worm.segments} coils on leave none to go on to; write at most "
                f"{worm.segments - 1}",
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
                f"Pa: from {most:.4g} Pa on a coil pulls its segment into itself; write less than "
                f"{current:.4g}",
            )

    @property
    def loading_limit(self) -> float:
        """P R / (G h) at which a segment is as short as its coil: coil and membrane balance."""
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
                f"0, and a load of {worm.load:g} N: nothing holds the worm; write {least:.3g} or "
                "more",
            )
