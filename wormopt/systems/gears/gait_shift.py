"""Kind "gait-shift": a worm with spikes that shifts its gait by measured loads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.quantities import GRAVITY
from wormopt.result import Check
from wormopt.study import (
    Study,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    parts,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.study.given import wrong_count
from wormopt.study.types import per
from wormopt.systems.chain import faults_of_law
from wormopt.systems.gears.tables import (
    Adaptive,
    GroundTable,
    ShiftedWorm,
    ShiftLimits,
    SupervisorRules,
    Way,
)
from wormopt.systems.shared.studies import refused_at
from wormopt.systems.spiked import AccordionShape, BlockWaveShape, FileShape

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.simulation.options import Tolerance
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.gears.box import GearBox, gear_box
    from wormopt.systems.gears.checks import (
        KEPT,
        agreement,
        hindsight,
        loads_by_limits,
        transitions,
    )
    from wormopt.systems.gears.gear import Gear, Ground, Limits, faults_of_links
    from wormopt.systems.gears.hindsight import Schedule, best_schedule, ideal_time
    from wormopt.systems.gears.model import geared_chain, geared_worm
    from wormopt.systems.gears.walk import (
        Choose,
        Supervised,
        Supervisor,
        Walk,
        by_schedule,
        kept,
        supervise,
        walk,
    )
    from wormopt.systems.spiked import gait_of_shape

# Chains: tolerance of the simulation, and accepted error of arrival under a hundredth of it.
_CHAIN, _CHAIN_AGREED = 1e-8, 1e-5
_SAMPLES = 2000
# Longest simulated time, relative to the time of the slowest gear.
_PATIENCE = 3.0

GearTable = BlockWaveShape | AccordionShape | FileShape


@dataclass(frozen=True)
class GearNumbers:
    """Gears from the slowest to the fastest, and transitions between them."""

    gear_speeds: list[float] = value("speed", "mean speed of each gear")
    gear_resting: list[int] = value("count", "smallest number of resting masses in each gear")
    gear_loads: list[list[float]] = value(
        "force",
        "smallest and largest admissible load on each mass for each gear; below the smallest it "
        "glides",
    )
    up_durations: list[float] = value(
        "time", "duration of the transition from each gear to the next faster"
    )
    down_durations: list[float] = value("time", "duration of the transition back")
    up_resting: list[list[int]] = value("count", "masses that rest throughout each transition up")
    down_resting: list[list[int]] = value(
        "count", "masses that rest throughout each transition down"
    )


@dataclass(frozen=True)
class Travel:
    """Motion of the worm under its supervisor."""

    time: float = value("time", "travel time of the supervised worm")
    shifts: int = value("count", "number of shifts of the supervisor")
    shift_times: np.ndarray = value("time", "start times of the supervisor's shifts")
    shift_places: np.ndarray = value("length", "mean position of the masses at these times")
    shift_gears: np.ndarray = value("count", "gear after each of these shifts")
    spike_load_max: float = value("force", "largest spike load under the supervisor")
    actuator_force_max: float = value("force", "largest actuator force under the supervisor")
    spike_total_min: float = value(
        "force", "smallest total load of all spikes; the worm glides below 0"
    )
    stroke_time: np.ndarray = signal("time", "stroke", "start time of the stroke")
    stroke_place: np.ndarray = signal(
        "length", "stroke", "mean position of the masses at that time"
    )
    stroke_gear: np.ndarray = signal("count", "stroke", "gear of the stroke")
    stroke_shifting: np.ndarray = signal("count", "stroke", "1 in a transition")
    stroke_load: np.ndarray = signal(
        "force", "stroke", "load on each mass there, with its share of the tow"
    )
    stroke_spike_load: np.ndarray = signal("force", "stroke", "largest spike load in the stroke")
    stroke_actuator_force: np.ndarray = signal(
        "force", "stroke", "largest actuator force in the stroke"
    )


@dataclass(frozen=True)
class Comparison:
    """The best schedule of gears in hindsight, and each gear alone."""

    best_time: float = value(
        "time", "travel time of the best schedule of gears, which knows the route"
    )
    efficiency: float = value("share", "`best_time` divided by `time`")
    ideal_time: float = value(
        "time", "travel time with free shifts, with the fastest gear for the lightest load nearby"
    )
    fixed_time: float | None = value(
        "time", "travel time of the fastest single gear within the limits, if any"
    )
    fixed_times: list[float | None] = value(
        "time", "travel time of each gear alone; unknown if it violates a limit"
    )
    fixed_spike_loads: list[float] = value("force", "largest spike load in each gear alone")
    best_shifts: int = value("count", "number of shifts of the best schedule")
    best_stroke_time: np.ndarray = signal(
        "time", "best_stroke", "best schedule: start time of the stroke"
    )
    best_stroke_place: np.ndarray = signal(
        "length", "best_stroke", "best schedule: mean position then"
    )
    best_stroke_gear: np.ndarray = signal("count", "best_stroke", "best schedule: gear")
    best_stroke_spike_load: np.ndarray = signal(
        "force", "best_stroke", "best schedule: largest spike load"
    )


@dataclass(frozen=True)
class ChainNumbers:
    """Motion of the tracked chain."""

    adaptive_time: float = value("time", "travel time of the tracked chain, which shifts by itself")
    adaptive_shifts: int = value("count", "number of its shifts")
    adaptive_spike_load_max: float = value("force", "its largest spike load")
    adaptive_actuator_force_max: float = value("force", "its largest link force")
    adaptive_total_max: float = value("force", "its largest total load of all spikes")
    adaptive_error_max: float = value("length", "largest norm of its tracking error")
    adaptive_gain: float = value("1", "its gain at the end")
    adaptive_sample: np.ndarray = signal("time", "adaptive_sample", "time of the tracked chain")
    adaptive_place: np.ndarray = signal("length", "adaptive_sample", "mean position of its masses")
    adaptive_gear: np.ndarray = signal("count", "adaptive_sample", "its gear")
    adaptive_error: np.ndarray = signal("length", "adaptive_sample", "norm of its tracking error")


class GaitShift(Study, kind="gait-shift"):
    """Switch gaits on a slope by the spike load, and optimise the switching schedule.

    A worm with gears follows a route whose slope, towed load and drag change. Each gear is a gait.
    Gears are numbered from 0, the slowest, in any order of the tables. The shortest transitions
    within the limits are designed between neighbouring gears; resting masses stay at rest in them.
    A supervisor without knowledge of the route shifts by measured loads. Its time is compared with
    that of each gear alone and of the best schedule in hindsight. See [theory](../gait-shift.md).

    Results list gears from the slowest to the fastest. Variables with the dimension `stroke` have
    one number for each stroke of the motion.
    """

    pictures: ClassVar = {
        "shift": "gear, loads with their limits and position over time",
        "transitions": "speed and admissible loads of each gear",
    }
    headline: ClassVar = ("time", "best_time", "efficiency", "fixed_time", "shifts")

    worm: ShiftedWorm = entry("the worm")
    gears: Annotated[
        tuple[GearTable, ...],
        Meta(min_length=2, max_length=8, description="a list of 2 to 8 tables"),
    ] = entry(
        "the gaits; `shape` selects the other keys. Only polynomials: "
        '`profile = "quintic"` or `"trapezoid"`, a design, or a table'
    )
    limits: ShiftLimits = entry("limits of gears and transitions")
    ground: GroundTable = entry("the ground along the route")
    way: Way = entry("the route")
    supervisor: SupervisorRules = entry("rules for shifting", default=SupervisorRules)
    adaptive: Adaptive | None = entry(
        "a chain that follows by a tracker and shifts by its own forces; none by default",
        default=None,
    )

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.worm.mass, self.worm.links + 1)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_count("worm.mass", self.worm.mass, self.worm.links + 1, "masses")
        yield from self._faults_of_slope()
        for k, gear in enumerate(self.gears):
            yield from self._faults_of_gear(f"gears[{k}]", gear)
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

    def _faults_of_gear(self, key: str, gear: GearTable) -> Iterator[Fault]:
        yield from gear.faults(self.worm.links, self.folder, key)
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

    # -- what is given -----------------------------------------------------------------------------

    @cached_property
    def load_limits(self) -> Limits:
        """Limits on gears and transitions."""
        given = self.limits
        force = math.inf if given.actuator_force is None else given.actuator_force
        low, high = given.length
        return Limits(given.spike_load, force, given.rate, given.acceleration, (low, high))

    @cached_property
    def route(self) -> Ground:
        """The ground along the route, from its start on: digits of a far start are not needed."""
        given, count = self.ground, len(self.ground.place)
        gravity = GRAVITY if given.gravity is None else given.gravity
        pull = self.masses[0] * gravity * np.sin(per(given.slope, count))
        drag = self.worm.drag if given.drag is None else given.drag
        return Ground(
            np.array(given.place) - self.way.start,
            pull + np.array(per(given.load, count)),
            np.array(per(drag, count)),
            np.array(per(given.towed, count)),
        )

    @cached_property
    def sorted_gears(self) -> list[Gear]:
        """Gears from slow to fast; SceneError if one violates a limit of the links."""
        found = [self._gear(f"gears[{k}]", shape) for k, shape in enumerate(self.gears)]
        return sorted(found, key=lambda gear: gear.speed)

    def _gear(self, key: str, shape: GearTable) -> Gear:
        gait = gait_of_shape(shape, self.scene, key)
        with refused_at(self, key):
            gear = Gear(key, gait, np.array(self.masses), self.worm.drag)
        if faults := list(faults_of_links(gear, self.load_limits)):
            raise SceneError(self.name, [(key, text) for text in faults])
        return gear

    # -- computing ---------------------------------------------------------------------------------

    @stage
    def box(self) -> GearBox:
        """The gear box; SceneError if gears cannot be combined."""
        with refused_at(self, "gears"):
            return gear_box(self.sorted_gears, self.load_limits, resting=self.limits.resting)

    @cached_property
    def rules(self) -> Supervisor:
        """The supervisor with its tables of loads."""
        given = self.supervisor
        return supervise(
            self.box, self.load_limits, down=given.down, up=given.up, dwell=given.dwell
        )

    @cached_property
    def first(self) -> int:
        """Fastest gear that the supervisor would keep at the start."""
        load = self.load_at(np.zeros(1))[0]
        share = self.load_limits.times(self.supervisor.down)
        bears = [min(gear.bears(share)) >= load for gear in self.box.gears]
        return max((k for k, fine in enumerate(bears) if fine), default=0)

    def load_at(self, place: np.ndarray) -> np.ndarray:
        """Load on each mass, with an equal share of the towed load."""
        return self.route.at("load", place) + self.route.at("towed", place) / len(self.masses)

    def begin(self, gear: int) -> np.ndarray:
        """Positions of the masses at time 0, (n+1,), from the start on."""
        place = -np.concatenate([[0.0], np.cumsum(self.box.gears[gear].lengths[0])])
        return place - place.mean()

    @property
    def distance(self) -> float:
        """Distance from the start to the goal."""
        return self.way.goal - self.way.start

    @property
    def longest(self) -> float:
        """Longest simulated time; it has a cycle more, since cycles may begin slowly."""
        slowest = self.box.gears[0]
        return _PATIENCE * (self.distance / slowest.speed + slowest.period)

    @property
    def departure(self) -> dict[str, Any]:
        """Gear, place and goal of the simulations."""
        return {"gear": self.first, "begin": self.begin(self.first), "goal": self.distance}

    def walk(self, gear: int, choose: Choose) -> Walk:
        """Travel from a cycle of a gear, with rows selected by `choose`."""
        begin, row = self.begin(gear), self.box.first_row(gear)
        return walk(self.box, self.route, begin, row, choose, self.distance, self.longest)

    @stage
    def motion(self) -> Trajectory:
        model = geared_worm(self.box, self.route, self.rules, **self.departure)
        motion = simulate(
            model, self.longest, dense=True, report=lambda _, share: self.report("walking", share)
        )
        if motion.end_time >= self.longest:
            raise SolveError(
                f"the worm does not arrive by t = {self.longest:.6g}",
                "check that the slowest gear carries the loads of the route, or decrease "
                "supervisor.dwell",
            )
        return motion

    @cached_property
    def again(self) -> Walk:
        """The same motion, computed stroke by stroke."""
        return self.walk(self.first, Supervised(self.box, self.rules))

    @stage
    def fixed(self) -> list[Walk]:
        return [self.walk(k, kept) for k in range(len(self.box.gears))]

    @stage
    def best(self) -> Schedule:
        return best_schedule(
            self.box, self.route, self.load_limits, 0.0, self.distance, self.first,
            report=self.report,
        )  # fmt: skip

    @cached_property
    def best_walk(self) -> Walk:
        """Travel with the best schedule."""
        return self.walk(self.first, by_schedule(self.best.rows))

    def follow(self, share: float) -> Trajectory:
        """Simulate the tracked chain, with a share of the usual tolerance."""
        assert self.adaptive
        return simulate(
            geared_chain(self.box, self.route, self.rules, self.adaptive, **self.departure),
            self.longest,
            dense=True,
            tolerance=Tolerance(share * _CHAIN, share * _CHAIN / 10),
            report=lambda _, done: self.report("following", done),
        )

    @stage
    def chain_motion(self) -> Trajectory:
        motion = self.follow(1.0)
        if motion.end_time >= self.longest:
            raise SolveError(
                f"the tracked chain does not arrive by t = {self.longest:.6g}",
                "increase adaptive.gain_start or adaptive.stiffness",
            )
        return motion

    @stage
    def finer_chain(self) -> float:
        """Arrival of the chain under a hundredth of the tolerance."""
        return self.follow(0.01).end_time

    # -- results -----------------------------------------------------------------------------------

    def _gears_of(self, walked: Walk) -> np.ndarray:
        return np.array([self.box.rows[number].gear for number in walked.row], dtype=np.int32)

    @parts(GearNumbers)
    def gear_numbers(self) -> GearNumbers:
        box, limits = self.box, self.load_limits
        return GearNumbers(
            gear_speeds=[each.speed for each in box.gears],
            gear_resting=[each.resting for each in box.gears],
            gear_loads=[[each.least, min(each.bears(limits))] for each in box.gears],
            up_durations=[each.duration for each in box.up],
            down_durations=[each.duration for each in box.down],
            up_resting=[list(each.resting) for each in box.up],
            down_resting=[list(each.resting) for each in box.down],
        )

    @parts(Travel)
    def travel(self) -> Travel:
        motion, again, rows = self.motion, self.again, self.box.rows
        gear = self._gears_of(again)
        changes, place = 1 + np.flatnonzero(np.diff(gear)), again.place[:-1].mean(axis=1)
        return Travel(
            time=motion.end_time,
            shifts=len(changes),
            shift_times=again.time[changes],
            shift_places=again.place[changes].mean(axis=1) + self.way.start,
            shift_gears=gear[changes],
            spike_load_max=motion.largest("spike_load"),
            actuator_force_max=motion.largest("actuator_force"),
            spike_total_min=again.total.min(),
            stroke_time=again.time[:-1],
            stroke_place=place + self.way.start,
            stroke_gear=gear,
            stroke_shifting=np.array([rows[k].shifting for k in again.row], dtype=np.int32),
            stroke_load=self.load_at(place),
            stroke_spike_load=again.spike,
            stroke_actuator_force=again.actuator,
        )

    @parts(Comparison)
    def comparison(self) -> Comparison:
        limits, walked = self.load_limits, self.best_walk
        alone = [
            one.arrival
            if one.spike.max() <= limits.spike * (1 + KEPT)
            and one.actuator.max() <= limits.actuator * (1 + KEPT)
            and one.total.min() >= 0
            else None
            for one in self.fixed
        ]
        gear = self._gears_of(walked)
        return Comparison(
            best_time=self.best.time,
            efficiency=self.best.time / self.motion.end_time,
            ideal_time=ideal_time(self.box, self.route, limits, 0.0, self.distance),
            fixed_time=min((each for each in alone if each is not None), default=None),
            fixed_times=alone,
            fixed_spike_loads=[one.spike.max() for one in self.fixed],
            best_shifts=int(np.count_nonzero(np.diff(gear))),
            best_stroke_time=walked.time[:-1],
            best_stroke_place=walked.place[:-1].mean(axis=1) + self.way.start,
            best_stroke_gear=gear,
            best_stroke_spike_load=walked.spike,
        )

    @parts(ChainNumbers, when="adaptive")
    def chain(self) -> ChainNumbers:
        motion = self.chain_motion
        forces = motion.system.model.forces
        sampled = motion.at(np.linspace(0.0, motion.end_time, _SAMPLES))
        gear = sampled["gear"][0]
        return ChainNumbers(
            adaptive_time=motion.end_time,
            adaptive_shifts=int(np.count_nonzero(np.diff(gear))),
            adaptive_spike_load_max=motion.largest(forces),
            adaptive_actuator_force_max=motion.largest("link_force"),
            adaptive_total_max=motion.largest(ca.SX(ca.sum1(forces))),
            adaptive_error_max=motion.largest("error_norm"),
            adaptive_gain=float(sampled["gain"][0, -1]),
            adaptive_sample=sampled.time,
            adaptive_place=sampled["position"].mean(axis=0) + self.way.start,
            adaptive_gear=gear.astype(np.int32),
            adaptive_error=sampled["error_norm"][0],
        )

    @attributes
    def drawn(self) -> dict[str, Any]:
        return {
            "gears": [gear.name for gear in self.box.gears],
            "spike_load_limit": self.limits.spike_load,
            "actuator_force_limit": self.limits.actuator_force,
        }

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def agreed(self) -> Iterator[Check]:
        limits, travel, again = self.load_limits, self.travel, self.again
        yield from loads_by_limits(limits, travel.spike_load_max, travel.actuator_force_max)
        yield from agreement(self.motion, again)
        yield from transitions(self.box, limits)
        yield from hindsight(limits, self.best, self.best_walk, again)

    @checks
    def of_chain(self) -> Iterator[Check]:
        if self.adaptive is None:
            return
        chain, again = self.chain, self.finer_chain
        reached = chain.adaptive_spike_load_max, chain.adaptive_actuator_force_max
        yield from loads_by_limits(self.load_limits, *reached, "of the chain")
        advice = f"under a hundredth of the tolerance the chain arrives at {again:.9g}"
        off = abs(chain.adaptive_time / again - 1)
        yield Check("arrival of the chain, finer", off, _CHAIN_AGREED, advice)

    @facts
    def assumed(self) -> dict[str, Any]:
        return {"assumptions": ["resting masses share the load equally", "spikes never slip back"]}

    @warnings
    def of_gears(self) -> Iterator[str]:
        box, limits = self.box, self.load_limits
        for k, gear in enumerate(box.gears):
            if min(gear.bears(limits)) <= gear.least:
                yield f"gear {k} ({gear.name}) glides at every load within the limits"
            if any(gear.outdone(other, limits) for other in box.gears):
                yield (
                    f"gear {k} ({gear.name}) is never useful: a faster gear carries every load "
                    "that it does; remove it"
                )
        if not all(each.complete for each in (*box.up, *box.down)):
            yield "not all pairs of phases were tried: a transition may be longer than necessary"
