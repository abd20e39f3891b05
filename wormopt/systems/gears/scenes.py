"""Scenes of kind "gait-shift": a worm with spikes that shifts its gait by measured loads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, wrong_count
from wormopt.study.types import (
    Finite,
    NonNegative,
    Pair,
    PerMass,
    SceneTable,
    per,
    wrong_order,
)
from wormopt.systems.chain import CoulombFriction, SpikeFriction, faults_of_law
from wormopt.systems.shared.incline import Gravity
from wormopt.systems.spiked import AccordionShape, BlockWaveShape, FileShape, Links

Along = Annotated[
    NonNegative | tuple[NonNegative, ...],
    Meta(description="a finite number, 0 or above, or a list with one such number per place"),
]
Angle = Annotated[
    float, Meta(ge=-math.pi / 2, le=math.pi / 2, description="an angle from -pi/2 to pi/2")
]
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, at most 1")]
Few = Annotated[int, Meta(ge=1, description="a whole number, 1 or above")]


class ShiftedWormTable(Given):
    """A chain of *n* + 1 point masses with spikes, joined by *n* links that follow their gait."""

    links: Links = entry("number of links *n*", quantity="count")
    mass: PerMass = entry("point masses *m*<sub>i</sub>; mass 0 is the head", quantity="mass")
    drag: float = number(
        "drag", "*k*: viscous drag of each mass, as assumed by the supervisor", least=0, default=0.0
    )


class GroundTable(Given):
    """The ground at each position: linear between the given places, constant beyond them.

    Refused: places that do not increase, lists of other lengths.
    """

    place: Annotated[
        tuple[Finite, ...], Meta(min_length=1, description="a list of increasing numbers")
    ] = entry("positions along the route", quantity="length")
    slope: Angle | tuple[Angle, ...] = entry(
        "angle at which the ground rises there: *m*<sub>i</sub> *g* sin(`slope`) is added to "
        "the load on each mass; needs equal masses",
        quantity="rad",
        default=0.0,
    )
    gravity: Gravity = None
    load: Along = entry("force on each mass against forward motion", quantity="force", default=0.0)
    towed: Along = entry(
        "additional force on the tail against forward motion: a towed load",
        quantity="force",
        default=0.0,
    )
    drag: Along | None = entry(
        "true drag *k* of each mass; default: `worm.drag`", quantity="drag", default=None
    )

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys."""
        for k, (a, b) in enumerate(zip(self.place, self.place[1:], strict=False), start=1):
            if b <= a:
                yield f"ground.place[{k}]", f"{b:g} is not above {a:g}; write increasing places"
        for name in ("slope", "load", "towed", "drag"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != len(self.place):
                yield (
                    f"ground.{name}",
                    f"{len(value)} numbers for {len(self.place)} places; write one for all, or a "
                    f"list of {len(self.place)}",
                )


class ShiftLimitsTable(Given):
    """Limits of the gears and of the transitions between them."""

    spike_load: float = positive("force", "largest load on one spike")
    actuator_force: float | None = positive(
        "force", "largest force of each actuator; default: unlimited", default=None
    )
    rate: float = positive("speed", "largest rate of each link length")
    acceleration: float = positive("acceleration", "largest acceleration of each length")
    length: Pair = entry("shortest and longest link length", quantity="length")
    resting: Few = entry(
        "smallest number of masses at rest throughout a transition", quantity="count", default=1
    )


class SupervisorTable(Given):
    """Rules for shifting by loads measured over whole cycles."""

    down: float = number(
        "share",
        "shift down if estimated peak loads exceed this share of the limits",
        above=0,
        most=1,
        default=0.9,
    )
    up: float = number(
        "share",
        "shift up if peak loads in the next faster gear would stay below this share; less "
        "than `down`",
        above=0,
        most=1,
        default=0.85,
    )
    dwell: float = number("time", "shortest time in a gear", least=0, default=0.0)


class WayTable(Given):
    """Start and goal of the mean position of the masses."""

    start: float = number("length", "mean position of the masses at time 0", default=0.0)
    goal: float = number("length", "mean position of the masses at the end")


class AdaptiveTable(Given):
    """The same worm as a chain of springs whose links follow the gears by a λ-tracker.

    The tracker is that of eq. 13 of Zimmermann et al. 2007 [1].
    """

    stiffness: float = positive("stiffness", "stiffness *c* of each link")
    damping: float = number("drag", "damping *d* of each link", least=0)
    friction: CoulombFriction | SpikeFriction = entry(
        'friction of the ground, `kind = "spike"` or `"coulomb"`', default=SpikeFriction
    )
    tube_radius: float = positive("length", "tube radius *λ* of the tracker")
    gain_start: float = positive("1", "initial gain *k*(0)", default=1.0)
    growth: float = positive("1", "growth rate *γ* of the gain", default=1.0)
    memory: float | None = positive(
        "time",
        "averaging time of the load measured on each mass, by which actuators share the load "
        "among the spikes; default: a quarter of the shortest cycle",
        default=None,
    )


GearTable = BlockWaveShape | AccordionShape | FileShape


class GaitShiftScene(SceneTable):
    """A worm with gears on a route whose slope, towed load and drag change.

    Each gear is a gait. Gears are numbered from 0, the slowest, in any order of the tables. The
    shortest transitions within the limits are designed between neighbouring gears; resting masses
    stay at rest in them. A supervisor without knowledge of the route shifts by measured loads. Its
    time is compared with that of each gear alone and of the best schedule in hindsight. See
    [theory](../gait-shift.md).

    Results list gears from the slowest to the fastest. Variables with the dimension `stroke` have
    one number for each stroke of the motion. `timings_s`: `transitions`, `simulate`, `hindsight`,
    `adaptive`, `recheck`.
    """

    headline: ClassVar = ("time", "best_time", "efficiency", "fixed_time", "shifts")
    scalars: ClassVar = {
        "time": ("time", "travel time of the supervised worm"),
        "best_time": ("time", "travel time of the best schedule of gears, which knows the route"),
        "efficiency": ("share", "`best_time` divided by `time`"),
        "ideal_time": (
            "time",
            "travel time with free shifts, with the fastest gear for the lightest load nearby",
        ),
        "fixed_time": ("time", "travel time of the fastest single gear within the limits, if any"),
        "fixed_times": ("time", "travel time of each gear alone; unknown if it violates a limit"),
        "fixed_spike_loads": ("force", "largest spike load in each gear alone"),
        "shifts": ("count", "number of shifts of the supervisor"),
        "best_shifts": ("count", "number of shifts of the best schedule"),
        "shift_times": ("time", "start times of the supervisor's shifts"),
        "shift_places": ("length", "mean position of the masses at these times"),
        "shift_gears": ("count", "gear after each of these shifts"),
        "gear_speeds": ("speed", "mean speed of each gear"),
        "gear_resting": ("count", "smallest number of resting masses in each gear"),
        "gear_loads": (
            "force",
            "smallest and largest admissible load on each mass for each gear; below the smallest "
            "it glides",
        ),
        "up_durations": ("time", "duration of the transition from each gear to the next faster"),
        "down_durations": ("time", "duration of the transition back"),
        "up_resting": ("count", "masses that rest throughout each transition up"),
        "down_resting": ("count", "masses that rest throughout each transition down"),
        "spike_load_max": ("force", "largest spike load under the supervisor"),
        "actuator_force_max": ("force", "largest actuator force under the supervisor"),
        "spike_total_min": ("force", "smallest total load of all spikes; the worm glides below 0"),
        "adaptive_time": ("time", "travel time of the tracked chain, which shifts by itself"),
        "adaptive_shifts": ("count", "number of its shifts"),
        "adaptive_spike_load_max": ("force", "its largest spike load"),
        "adaptive_actuator_force_max": ("force", "its largest link force"),
        "adaptive_total_max": ("force", "its largest total load of all spikes"),
        "adaptive_error_max": ("length", "largest norm of its tracking error"),
        "adaptive_gain": ("1", "its gain at the end"),
    }
    variables: ClassVar = {
        "stroke_time": ("time", ("stroke",), "start time of the stroke"),
        "stroke_place": ("length", ("stroke",), "mean position of the masses at that time"),
        "stroke_gear": ("count", ("stroke",), "gear of the stroke"),
        "stroke_shifting": ("count", ("stroke",), "1 in a transition"),
        "stroke_load": ("force", ("stroke",), "load on each mass there, with its share of the tow"),
        "stroke_spike_load": ("force", ("stroke",), "largest spike load in the stroke"),
        "stroke_actuator_force": ("force", ("stroke",), "largest actuator force in the stroke"),
        "best_stroke_time": ("time", ("best_stroke",), "best schedule: start time of the stroke"),
        "best_stroke_place": ("length", ("best_stroke",), "best schedule: mean position then"),
        "best_stroke_gear": ("count", ("best_stroke",), "best schedule: gear"),
        "best_stroke_spike_load": ("force", ("best_stroke",), "best schedule: largest spike load"),
        "adaptive_sample": ("time", ("adaptive_sample",), "time of the tracked chain"),
        "adaptive_place": ("length", ("adaptive_sample",), "mean position of its masses"),
        "adaptive_gear": ("count", ("adaptive_sample",), "its gear"),
        "adaptive_error": ("length", ("adaptive_sample",), "norm of its tracking error"),
    }

    kind: Literal["gait-shift"]
    want: tuple[Literal["shift", "transitions"], ...] = entry(
        "`shift`: gear, loads with their limits and position over time; `transitions`: speed "
        "and admissible loads of each gear",
        default=(),
    )
    worm: ShiftedWormTable = entry("the worm")
    gears: Annotated[
        tuple[GearTable, ...],
        Meta(min_length=2, max_length=8, description="a list of 2 to 8 tables"),
    ] = entry(
        "the gaits; `shape` selects the other keys. Only polynomials: "
        '`profile = "quintic"` or `"trapezoid"`, a design, or a table'
    )
    limits: ShiftLimitsTable = entry("limits of gears and transitions")
    ground: GroundTable = entry("the ground along the route")
    way: WayTable = entry("the route")
    supervisor: SupervisorTable = entry("rules for shifting", default=SupervisorTable)
    adaptive: AdaptiveTable | None = entry(
        "a chain that follows by a tracker and shifts by its own forces; none by default",
        default=None,
    )

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
                f"{self.supervisor.up:g} is not below supervisor.down = {self.supervisor.down:g}, "
                "so the worm would shift to and fro; write a smaller value",
            )
        if self.way.goal <= self.way.start:
            yield (
                "way.goal",
                f"{self.way.goal:g} is not above way.start = {self.way.start:g}; write a larger "
                "value",
            )
        if self.limits.resting > self.worm.links:
            yield (
                "limits.resting",
                f"{self.limits.resting} leaves no mass to move; write at most {self.worm.links}",
            )
        if self.adaptive is not None:
            law = self.adaptive.friction
            yield from faults_of_law("adaptive.friction", law, self.worm.links + 1)

    def _faults_of_slope(self) -> Iterator[Fault]:
        if not any(per(self.ground.slope, len(self.ground.place))):
            return
        if self.ground.gravity is None and self.units != "SI":
            yield (
                "ground.gravity",
                'missing; ground.slope needs it if units are not "SI": write the acceleration of '
                "gravity in units of the scene",
            )
        if isinstance(self.worm.mass, tuple) and len(set(self.worm.mass)) > 1:
            yield (
                "ground.slope",
                "pulls unequal masses back by unequal forces; write one worm.mass for all",
            )

    def _faults_of_gear(self, k: int, gear: GearTable, folder: Path) -> Iterator[Fault]:
        key = f"gears[{k}]"
        yield from gear.faults(self.worm.links, folder, key)
        if isinstance(gear, FileShape):
            return
        if gear.profile == "cosine":
            yield (
                f"{key}.profile",
                '"cosine" is not a polynomial; write "quintic", or "trapezoid" with a ramp',
            )
        if gear.ramp == 0.0:
            yield (
                f"{key}.ramp",
                "0 gives corners, at which velocities jump; write a number above 0, at most 0.5",
            )
