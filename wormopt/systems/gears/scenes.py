"""Scenes of kind "gait-shift": a worm with spikes that shifts its gait by what it measures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Pair,
    PerMass,
    Positive,
    SceneTable,
    Table,
    per,
    says,
    wrong_count,
    wrong_order,
)
from wormopt.systems.chain import CoulombFriction, SpikeFriction, faults_of_law
from wormopt.systems.shared.incline import Gravity
from wormopt.systems.spiked import AccordionShape, BlockWaveShape, FileShape, Links

Along = Annotated[
    NonNegative | tuple[NonNegative, ...],
    Meta(description="a finite number, 0 or above, or a list of such numbers, one per place"),
]
Angle = Annotated[
    float, Meta(ge=-math.pi / 2, le=math.pi / 2, description="an angle from -pi/2 to pi/2")
]
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, at most 1")]
Few = Annotated[int, Meta(ge=1, description="a whole number, 1 or above")]


class ShiftedWormTable(Table, frozen=True, kw_only=True):
    """A chain of *n* + 1 point masses with spikes, joined by *n* links that follow their gait."""

    links: Annotated[Links, says("count", "*n*")]
    mass: Annotated[PerMass, says("mass", "point masses *m*<sub>i</sub>; mass 0 is the head")]
    drag: Annotated[
        NonNegative,
        says("drag", "*k*: viscous drag of each mass as the supervisor believes it to be"),
    ] = 0.0


class GroundTable(Table, frozen=True, kw_only=True):
    """What each mass meets where it is: linear between places, constant before and after.

    Refused: places that do not ascend, lists of other lengths.
    """

    place: Annotated[
        tuple[Finite, ...],
        Meta(min_length=1, description="a list of numbers that ascend"),
        says("length", "places along the way"),
    ]
    slope: Annotated[
        Angle | tuple[Angle, ...],
        says(
            "rad",
            "rise of the ground there: *m*<sub>i</sub> *g* sin(`slope`) is added to the load on "
            "each mass; needs equal masses",
        ),
    ] = 0.0
    gravity: Gravity = None
    load: Annotated[Along, says("force", "against forward motion, on each mass")] = 0.0
    towed: Annotated[Along, says("force", "the same on the tail alone: what is towed")] = 0.0
    drag: Annotated[
        Along | None, says("drag", "*k* of each mass in truth; `worm.drag` if left out")
    ] = None

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys."""
        for k, (a, b) in enumerate(zip(self.place, self.place[1:], strict=False), start=1):
            if b <= a:
                yield f"ground.place[{k}]", f"{b:g} is not beyond {a:g}; let places ascend"
        for name in ("slope", "load", "towed", "drag"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != len(self.place):
                yield (
                    f"ground.{name}",
                    f"{len(value)} numbers for {len(self.place)} places; write one for all, or "
                    f"a list of {len(self.place)}",
                )


class ShiftLimitsTable(Table, frozen=True, kw_only=True):
    """What gears and the transitions between them must keep to."""

    spike_load: Annotated[Positive, says("force", "most that a spike carries")]
    actuator_force: Annotated[
        Positive | None, says("force", "of each actuator, both ways; none if left out")
    ] = None
    rate: Annotated[Positive, says("speed", "of each link length, both ways")]
    acceleration: Annotated[Positive, says("acceleration", "of each link length, both ways")]
    length: Annotated[Pair, says("length", "shortest and longest link length")]
    resting: Annotated[Few, says("count", "masses that rest throughout a transition, at least")] = 1


class SupervisorTable(Table, frozen=True, kw_only=True):
    """When to shift, by loads measured over whole cycles."""

    down: Annotated[
        Share,
        says("share", "of the limits: above it peaks, as measured loads tell, are too high"),
    ] = 0.9
    up: Annotated[
        Share,
        says("share", "below it peaks would have to be in the next faster gear; less than `down`"),
    ] = 0.85
    dwell: Annotated[NonNegative, says("time", "that a gear is kept at least")] = 0.0


class WayTable(Table, frozen=True, kw_only=True):
    """From where to where the mean of the masses goes."""

    start: Annotated[Finite, says("length", "place of the mean of the masses at time 0")] = 0.0
    goal: Annotated[Finite, says("length", "and at the end")]


class AdaptiveTable(Table, frozen=True, kw_only=True):
    """The same as a chain of springs whose links follow by a λ-tracker (13)."""

    stiffness: Annotated[Positive, says("stiffness", "*c* of each link")]
    damping: Annotated[NonNegative, says("drag", "*d* of each link")]
    friction: Annotated[
        CoulombFriction | SpikeFriction, says("", 'of the ground, `kind = "spike"` or `"coulomb"`')
    ] = field(default_factory=SpikeFriction)
    tube_radius: Annotated[Positive, says("length", "*λ*")]
    gain_start: Annotated[Positive, says("1", "*k*(0)")] = 1.0
    growth: Annotated[Positive, says("1", "*γ* of the gain's growth")] = 1.0
    memory: Annotated[
        Positive | None,
        says(
            "time",
            "over which the load that each mass feels is averaged, for actuators to share it "
            "among the spikes; a quarter of the shortest cycle if left out",
        ),
    ] = None


GearTable = BlockWaveShape | AccordionShape | FileShape


class GaitShiftScene(SceneTable, frozen=True, kw_only=True):
    """A worm with a gear box on a way whose slope, towed load and drag change.

    Each gear is a gait; gear 0 is the slowest, whatever the order of the tables. Between
    neighbouring gears there are the shortest transitions within the limits, by which masses at
    rest stay at rest. A supervisor that knows nothing of the way shifts by measured loads; its
    time is compared with that of each gear alone, and of the best schedule in hindsight. See
    [theory](../gait-shift.md).

    Results tell gears from the slowest to the fastest. Variables with the dimension `stroke` are
    one number for each stroke of the motion. `timings_s`: `transitions`, `simulate`,
    `hindsight`, `adaptive`, `recheck`.
    """

    headline: ClassVar = ("time", "best_time", "efficiency", "fixed_time", "shifts")
    scalars: ClassVar = {
        "time": ("time", "that the supervised worm takes"),
        "best_time": ("time", "of the best schedule of gears, which knows the way"),
        "efficiency": ("share", "`best_time` by `time`"),
        "ideal_time": (
            "time",
            "were shifts free, with the fastest gear that bears the lightest load nearby",
        ),
        "fixed_time": ("time", "of the fastest gear that alone keeps all limits; unknown if none"),
        "fixed_times": ("time", "of each gear alone; unknown where it breaks a limit"),
        "fixed_spike_loads": ("force", "largest load of a spike in each gear alone"),
        "shifts": ("count", "how often the supervisor shifts"),
        "best_shifts": ("count", "how often the best schedule does"),
        "shift_times": ("time", "when the supervisor's shifts begin"),
        "shift_places": ("length", "where the mean of the masses is then"),
        "shift_gears": ("count", "gears into which it shifts"),
        "gear_speeds": ("speed", "mean speed of each gear"),
        "gear_resting": ("count", "fewest masses at rest in each gear"),
        "gear_loads": (
            "force",
            "least and largest load on each mass that each gear bears: below the least it glides",
        ),
        "up_durations": ("time", "of transitions from each gear into the next faster one"),
        "down_durations": ("time", "and back"),
        "up_resting": ("count", "masses that rest throughout each transition up"),
        "down_resting": ("count", "and down"),
        "spike_load_max": ("force", "largest load of a spike under the supervisor"),
        "actuator_force_max": ("force", "largest force of an actuator, either way"),
        "spike_total_min": ("force", "least load of all spikes together; below 0 the worm glides"),
        "adaptive_time": ("time", "that the tracked chain takes, shifting by itself"),
        "adaptive_shifts": ("count", "how often it shifts"),
        "adaptive_spike_load_max": ("force", "largest load of one of its spikes"),
        "adaptive_actuator_force_max": ("force", "largest force in one of its links, either way"),
        "adaptive_total_max": ("force", "largest load of all its spikes together"),
        "adaptive_error_max": ("length", "largest norm of its tracking error"),
        "adaptive_gain": ("1", "its gain at the end"),
    }
    variables: ClassVar = {
        "stroke_time": ("time", ("stroke",), "when the stroke begins"),
        "stroke_place": ("length", ("stroke",), "mean place of the masses then"),
        "stroke_gear": ("count", ("stroke",), "gear of the stroke"),
        "stroke_shifting": ("count", ("stroke",), "1 in a transition"),
        "stroke_load": ("force", ("stroke",), "load on each mass there, with its part of the tow"),
        "stroke_spike_load": ("force", ("stroke",), "largest load of a spike in it"),
        "stroke_actuator_force": ("force", ("stroke",), "largest force of an actuator in it"),
        "best_stroke_time": ("time", ("best_stroke",), "of the best schedule: begin of the stroke"),
        "best_stroke_place": ("length", ("best_stroke",), "its mean place of the masses"),
        "best_stroke_gear": ("count", ("best_stroke",), "its gear"),
        "best_stroke_spike_load": ("force", ("best_stroke",), "its largest load of a spike"),
        "adaptive_sample": ("time", ("adaptive_sample",), "time of the tracked chain"),
        "adaptive_place": ("length", ("adaptive_sample",), "mean place of its masses"),
        "adaptive_gear": ("count", ("adaptive_sample",), "its gear"),
        "adaptive_error": ("length", ("adaptive_sample",), "norm of its tracking error"),
    }

    kind: Literal["gait-shift"]
    want: Annotated[
        tuple[Literal["shift", "transitions"], ...],
        says(
            "",
            "`shift`: gear, loads against limits and way over time; `transitions`: what loads "
            "each gear bears at what speed",
        ),
    ] = ()
    worm: Annotated[ShiftedWormTable, says("", "the worm")]
    gears: Annotated[
        tuple[GearTable, ...],
        Meta(min_length=2, max_length=8, description="a list of 2 to 8 tables"),
        says(
            "",
            "the gaits; `shape` decides which other keys there are. Polynomials only: "
            '`profile = "quintic"` or `"trapezoid"`, a design, or a table',
        ),
    ]
    limits: Annotated[ShiftLimitsTable, says("", "what they must keep to")]
    ground: Annotated[GroundTable, says("", "the ground along the way")]
    way: Annotated[WayTable, says("", "the way")]
    supervisor: Annotated[SupervisorTable, says("", "when to shift")] = field(
        default_factory=SupervisorTable
    )
    adaptive: Annotated[
        AdaptiveTable | None,
        says(
            "", "a chain that follows by a tracker and shifts by its own forces; none if left out"
        ),
    ] = None

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.worm.mass, self.worm.links + 1)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from wrong_count("worm.mass", self.worm.mass, self.worm.links + 1, "masses")
        yield from wrong_order("limits.length", self.limits.length, may_be_equal=False)
        yield from self.ground.faults()
        yield from self._faults_of_slope()
        for k, gear in enumerate(self.gears):
            yield from self._faults_of_gear(k, gear, folder)
        if self.supervisor.up >= self.supervisor.down:
            yield (
                "supervisor.up",
                f"must be below supervisor.down = {self.supervisor.down:g}, or the worm would "
                "shift to and fro; write less",
            )
        if self.way.goal <= self.way.start:
            yield "way.goal", f"is not beyond way.start = {self.way.start:g}; write more"
        if self.limits.resting > self.worm.links:
            yield "limits.resting", f"leaves none to move; write at most {self.worm.links}"
        if self.adaptive is not None:
            law = self.adaptive.friction
            yield from faults_of_law("adaptive.friction", law, self.worm.links + 1)

    def _faults_of_slope(self) -> Iterator[Fault]:
        if not any(per(self.ground.slope, len(self.ground.place))):
            return
        if self.ground.gravity is None and self.units != "SI":
            yield (
                "ground.gravity",
                'missing; ground.slope needs it where units are not "SI": write the acceleration '
                "of the fall in units of the scene",
            )
        if isinstance(self.worm.mass, tuple) and len(set(self.worm.mass)) > 1:
            yield "ground.slope", "pulls unequal masses back unequally; write one worm.mass for all"

    def _faults_of_gear(self, k: int, gear: GearTable, folder: Path) -> Iterator[Fault]:
        key = f"gears[{k}]"
        yield from gear.faults(self.worm.links, folder, key)
        if isinstance(gear, FileShape):
            return
        if gear.profile == "cosine":
            yield (
                f"{key}.profile",
                'gears are gaits of polynomials; write "quintic", or "trapezoid" with a ramp',
            )
        if gear.ramp == 0.0:
            yield f"{key}.ramp", "corners jerk the worm; write a number above 0, at most 0.5"
