"""Scenes of kind ``gait-shift``: build the gear box, walk, look back, compare."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.progress import Report
from wormopt.quantities import GRAVITY
from wormopt.result import Check, Result
from wormopt.scene.conclude import conclude
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain import law_of
from wormopt.systems.gears.adaptive import Body, geared_chain
from wormopt.systems.gears.box import GearBox, gear_box
from wormopt.systems.gears.gear import Gear, Limits
from wormopt.systems.gears.ground import Ground
from wormopt.systems.gears.hindsight import Schedule, best_schedule, least_time
from wormopt.systems.gears.model import geared_worm
from wormopt.systems.gears.scenes import AdaptiveTable, GaitShiftScene
from wormopt.systems.gears.supervisor import Supervisor, supervise
from wormopt.systems.gears.trip import round_trip, tried
from wormopt.systems.gears.walk import Supervised, Walk, by_schedule, kept, walk
from wormopt.systems.spiked import gait_of_shape

# Limits may be exceeded by rounding; both routes agree to this in time; so much may be missed
# between the looks of the second route.
_KEPT, _AGREED, _PEAKS = 1e-9, 1e-7, 1e-4
# Chains: tolerance of the simulation, and how near arrivals are under a hundredth of it.
_CHAIN, _CHAIN_AGREED = Tolerance(1e-8, 1e-9), 1e-5
_SAMPLES = 2000
# So many times as long as the slowest gear takes is given up.
_PATIENCE = 3.0


@dataclass(frozen=True, eq=False)
class Case:
    """What a scene describes."""

    scene: Scene[GaitShiftScene]

    @property
    def table(self) -> GaitShiftScene:
        """Its table."""
        return self.scene.table

    @cached_property
    def limits(self) -> Limits:
        """Limits on gears and transitions."""
        given = self.table.limits
        force = math.inf if given.actuator_force is None else given.actuator_force
        low, high = given.length
        return Limits(given.spike_load, force, given.rate, given.acceleration, (low, high))

    @cached_property
    def ground(self) -> Ground:
        """The ground along the way."""
        given, count = self.table.ground, len(self.table.ground.place)
        gravity = GRAVITY if given.gravity is None else given.gravity
        pull = self.table.masses[0] * gravity * np.sin(per(given.slope, count))
        drag = self.table.worm.drag if given.drag is None else given.drag
        return Ground(
            np.array(given.place),
            pull + np.array(per(given.load, count)),
            np.array(per(drag, count)),
            np.array(per(given.towed, count)),
        )

    @cached_property
    def gears(self) -> list[Gear]:
        """The gears, from the slowest. SceneError where one breaks a limit of the links."""
        found = [self._gear(k) for k in range(len(self.table.gears))]
        return sorted(found, key=lambda gear: gear.speed)

    def _gear(self, k: int) -> Gear:
        shape, key = self.table.gears[k], f"gears[{k}]"
        gait = gait_of_shape(shape, self.scene, key)
        try:
            gear = Gear(f"gears[{k}]", gait, np.array(self.table.masses), self.table.worm.drag)
        except ArgumentError as error:
            raise SceneError(self.scene.name, [(key, str(error))]) from None
        faults = list(_faults_of_links(gear, self.limits))
        if faults:
            raise SceneError(self.scene.name, [(key, text) for text in faults])
        return gear

    @cached_property
    def box(self) -> GearBox:
        """The gear box. SceneError where gears do not go together."""
        try:
            return gear_box(self.gears, self.limits, resting=self.table.limits.resting)
        except ArgumentError as error:
            raise SceneError(self.scene.name, [("gears", str(error))]) from None

    @cached_property
    def supervisor(self) -> Supervisor:
        """The supervisor."""
        given = self.table.supervisor
        return supervise(
            self.box, self.limits, down=given.down, up=given.up, dwell=given.dwell
        )

    @cached_property
    def first(self) -> int:
        """The fastest gear that the supervisor would keep at the start."""
        load = self._load(np.array([self.table.way.start]))[0]
        share = self.limits.times(self.table.supervisor.down)
        bears = [min(gear.bears(share)) >= load for gear in self.box.gears]
        return max((k for k, fine in enumerate(bears) if fine), default=0)

    def _load(self, place: np.ndarray) -> np.ndarray:
        """Load on each mass, with an even part of what is towed."""
        return self.ground.at("load", place) + self.ground.at("towed", place) / len(self.box.mass)

    def begin(self, gear: int) -> np.ndarray:
        """Places of the masses at time 0, (n+1,)."""
        place = -np.concatenate([[0.0], np.cumsum(self.box.gears[gear].lengths[0])])
        return place - place.mean() + self.table.way.start

    @property
    def longest(self) -> float:
        """When to give up."""
        way = self.table.way.goal - self.table.way.start
        return _PATIENCE * way / self.box.gears[0].speed

    def walk(self, gear: int, choose: Any) -> Walk:
        """Walk the way from a cycle of a gear on, by whoever chooses the rows."""
        first = self.box.first_row(gear)
        goal = self.table.way.goal
        return walk(self.box, self.ground, self.begin(gear), first, choose, goal, self.longest)


def run(scene: Scene[GaitShiftScene], report: Report) -> Result:
    """Shift along the way; "failed" where a limit is broken or two routes disagree.

    Raises SceneError for gears that do not fit, SolveError where there is no transition or the
    worm does not arrive.
    """
    case, clocks = Case(scene), [perf_counter()]
    report("transitions", None)
    box = case.box
    clocks.append(perf_counter())
    motion = _simulated(case, report)
    again = case.walk(case.first, Supervised(box, case.supervisor))
    clocks.append(perf_counter())
    fixed = [case.walk(k, kept) for k in range(len(box.gears))]
    way = case.table.way
    best = best_schedule(
        box, case.ground, case.limits, way.start, way.goal, case.first, report=report
    )
    looked_back = case.walk(case.first, by_schedule(best.rows))
    clocks.append(perf_counter())
    chain = None if case.table.adaptive is None else _chained(case, case.table.adaptive, report)
    clocks.append(perf_counter())
    checks = [
        *_limits_kept(case, motion),
        *_agreement(motion, again),
        *_transitions(case),
        *_hindsight(case, best, looked_back),
        *(_chain_checks(chain) if chain else ()),
    ]
    clocks.append(perf_counter())
    stages = ("transitions", "simulate", "hindsight", "adaptive", "recheck")
    return conclude(
        scene,
        _scalars(case, motion, again, best, looked_back, fixed) | (chain.scalars if chain else {}),
        _variables(case, again, looked_back) | (chain.variables if chain else {}),
        checks=checks,
        facts={"assumptions": ["resting masses share the load alike", "spikes never slip back"]},
        warnings=_warnings(case, chain),
        timings=dict(zip(stages, np.diff(clocks).tolist(), strict=True)),
        attributes={
            "gears": [gear.name for gear in box.gears],
            "spike_load_limit": case.table.limits.spike_load,
            "actuator_force_limit": case.table.limits.actuator_force,
        },
    )


def _simulated(case: Case, report: Report) -> Trajectory:
    """The supervised worm, simulated as a Model with events."""
    model = geared_worm(
        case.box,
        case.ground,
        case.supervisor,
        gear=case.first,
        begin=case.begin(case.first),
        goal=case.table.way.goal,
    )
    motion = simulate(
        model, case.longest, dense=True, report=lambda _, share: report("walking", share)
    )
    if motion.end_time >= case.longest:
        raise SolveError(
            f"the worm does not arrive by t = {case.longest:.6g}",
            "look whether the slowest gear bears the way, or shorten supervisor.dwell",
        )
    return motion


def _faults_of_links(gear: Gear, limits: Limits) -> Iterator[str]:
    ends = [np.linspace(0.0, w, 65) for w in np.diff(gear.gait.breaks)]
    size = limits.length[1]
    for name, order, low, high in (
        ("length", 0, *limits.length),
        ("rate", 1, -limits.rate, limits.rate),
        ("acceleration", 2, -limits.acceleration, limits.acceleration),
    ):
        values = [gear.gait.on_piece(q, s, order) for q, s in enumerate(ends)]
        least, most = min(v.min() for v in values), max(v.max() for v in values)
        if least < low - _KEPT * size or most > high + _KEPT * max(size, abs(high)):
            yield (
                f"goes from {least:.4g} to {most:.4g} in {name}, which limits.{name} does not "
                "allow; write a longer period or a wider limit"
            )


# -- checks --------------------------------------------------------------------------------------


def _limits_kept(case: Case, motion: Trajectory) -> Iterator[Check]:
    for name, signal, limit, key in (
        ("spike load", "spike_load", case.limits.spike, "spike_load"),
        ("actuator force", "actuator_force", case.limits.actuator, "actuator_force"),
    ):
        if math.isinf(limit):
            continue
        reached = motion.largest(signal) / limit
        advice = (
            f"the {name} reaches {reached:.4g} of limits.{key}: write a smaller supervisor.down, "
            "or a ground that rises less steeply"
        )
        yield Check(f"{name} by its limit", reached, 1 + _KEPT, advice)


def _agreement(motion: Trajectory, again: Walk) -> Iterator[Check]:
    off = abs(motion.end_time / again.arrival - 1)
    advice = f"walked stroke by stroke the worm arrives at {again.arrival:.9g}"
    yield Check("arrival, second route", off, _AGREED, advice)
    for name, signal, peak in (
        ("spike load", "spike_load", again.spike.max()),
        ("actuator force", "actuator_force", again.actuator.max()),
    ):
        off = abs(motion.largest(signal) / float(peak) - 1)
        yield Check(f"largest {name}, second route", off, _PEAKS, f"it finds {peak:.6g}")
    low = float(again.total.min())
    advice = f"spikes would have to pull by {-low:.4g}, so the worm glides: slow that gear down"
    yield Check("gliding", max(0.0, -low), 0.0, advice)


def _transitions(case: Case) -> Iterator[Check]:
    """Integrate round trips through neighbouring gears by (7), which knows no gears."""
    box, moved, wrong, way = case.box, 0.0, 0, 0.0
    for lower, (slow, fast) in enumerate(zip(box.gears, box.gears[1:], strict=False)):
        trip = round_trip(box, lower)
        low = max(slow.least, fast.least)
        high = min(*slow.bears(case.limits), *fast.bears(case.limits))
        for load in (low, high):
            trial = tried(box, trip, load)
            moved, way = max(moved, trial.moved), max(way, trial.advance)
            wrong += trial.glides + trial.impulses
    advice = "a mass that is to rest through a transition moves"
    yield Check("masses that move in transitions", moved, 0.0, advice)
    advice = "transitions have corners, or let the worm glide"
    yield Check("glides and impulses in transitions", float(wrong), 0.0, advice)
    advice = "the way through a transition is another"
    yield Check("way through transitions, second route", way, _KEPT, advice)


def _hindsight(case: Case, best: Schedule, walked: Walk) -> Iterator[Check]:
    off = abs(walked.arrival / best.time - 1)
    advice = f"the best schedule arrives at {walked.arrival:.9g} when it is walked"
    yield Check("best schedule, walked", off, _AGREED, advice)
    over = max(
        float(walked.spike.max()) / case.limits.spike,
        float(walked.actuator.max()) / case.limits.actuator,
    )
    advice = "the best schedule breaks a limit between the looks at it"
    yield Check("best schedule, loads by limits", over, 1 + _PEAKS, advice)


# -- the tracked chain ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Chained:
    """What is told of the tracked chain."""

    scalars: dict[str, Any]
    variables: dict[str, np.ndarray]
    again: float  # when it arrives under a hundredth of the tolerance
    over: bool  # whether a spike carries more than its limit


def _chained(case: Case, table: AdaptiveTable, report: Report) -> Chained:
    model = geared_chain(
        case.box,
        case.ground,
        case.supervisor,
        Body(
            table.stiffness,
            table.damping,
            law_of(table.friction),
            table.tube_radius,
            table.gain_start,
            table.growth,
        ),
        gear=case.first,
        begin=case.begin(case.first),
        goal=case.table.way.goal,
    )

    def simulated(tolerance: Tolerance) -> Trajectory:
        return simulate(
            model,
            case.longest,
            dense=True,
            tolerance=tolerance,
            report=lambda _, share: report("following", share),
        )

    motion = simulated(_CHAIN)
    if motion.end_time >= case.longest:
        raise SolveError(
            f"the tracked chain does not arrive by t = {case.longest:.6g}",
            "write a larger adaptive.gain_start or adaptive.stiffness",
        )
    finer = Tolerance(_CHAIN.relative / 100, _CHAIN.absolute / 100)
    sampled = motion.at(np.linspace(0.0, motion.end_time, _SAMPLES))
    gear = sampled["gear"][0]
    spike = motion.largest(model.forces)
    return Chained(
        {
            "adaptive_time": motion.end_time,
            "adaptive_shifts": int(np.count_nonzero(np.diff(gear))),
            "adaptive_spike_load_max": spike,
            "adaptive_total_max": motion.largest(_sum(model.forces)),
            "adaptive_error_max": motion.largest("error_norm"),
            "adaptive_gain": float(sampled["gain"][0, -1]),
        },
        {
            "adaptive_sample": sampled.time,
            "adaptive_place": sampled["position"].mean(axis=0),
            "adaptive_gear": gear.astype(np.int32),
            "adaptive_error": sampled["error_norm"][0],
        },
        simulated(finer).end_time,
        spike > case.limits.spike,
    )


def _sum(column: Any) -> Any:
    return sum(column[i] for i in range(column.numel()))


def _chain_checks(chain: Chained) -> Iterator[Check]:
    off = abs(chain.scalars["adaptive_time"] / chain.again - 1)
    advice = f"under a hundredth of the tolerance the chain arrives at {chain.again:.9g}"
    yield Check("arrival of the chain, finer", off, _CHAIN_AGREED, advice)


# -- what is told --------------------------------------------------------------------------------


def _gears_of(case: Case, walked: Walk) -> np.ndarray:
    return np.array([case.box.rows[number].gear for number in walked.row], dtype=np.int32)


def _scalars(
    case: Case,
    motion: Trajectory,
    again: Walk,
    best: Schedule,
    looked_back: Walk,
    fixed: list[Walk],
) -> dict[str, Any]:
    box, limits, way = case.box, case.limits, case.table.way
    gear = _gears_of(case, again)
    changes = 1 + np.flatnonzero(np.diff(gear))
    fine = [
        bool(w.spike.max() <= limits.spike * (1 + _KEPT))
        and bool(w.actuator.max() <= limits.actuator * (1 + _KEPT))
        and bool(w.total.min() >= 0)
        for w in fixed
    ]
    alone = [w.arrival if good else None for w, good in zip(fixed, fine, strict=True)]
    return {
        "time": motion.end_time,
        "best_time": best.time,
        "efficiency": best.time / motion.end_time,
        "least_time": least_time(box, case.ground, limits, way.start, way.goal),
        "fixed_time": min((each for each in alone if each is not None), default=None),
        "fixed_times": alone,
        "fixed_spike_loads": [w.spike.max() for w in fixed],
        "shifts": len(changes),
        "best_shifts": int(np.count_nonzero(np.diff(_gears_of(case, looked_back)))),
        "shift_times": again.time[changes],
        "shift_places": again.place[changes].mean(axis=1),
        "shift_gears": gear[changes],
        "gear_speeds": [each.speed for each in box.gears],
        "gear_resting": [each.resting for each in box.gears],
        "gear_loads": [[each.least, min(each.bears(limits))] for each in box.gears],
        "up_durations": [each.duration for each in box.up],
        "down_durations": [each.duration for each in box.down],
        "up_resting": [list(each.resting) for each in box.up],
        "down_resting": [list(each.resting) for each in box.down],
        "spike_load_max": motion.largest("spike_load"),
        "actuator_force_max": motion.largest("actuator_force"),
        "spike_total_min": again.total.min(),
    }


def _variables(case: Case, again: Walk, best: Walk) -> dict[str, np.ndarray]:
    place, best_place = again.place[:-1].mean(axis=1), best.place[:-1].mean(axis=1)
    shifting = [case.box.rows[number].shifting for number in again.row]
    return {
        "stroke_time": again.time[:-1],
        "stroke_place": place,
        "stroke_gear": _gears_of(case, again),
        "stroke_shifting": np.array(shifting, dtype=np.int32),
        "stroke_load": case._load(place),
        "stroke_spike_load": again.spike,
        "stroke_actuator_force": again.actuator,
        "best_stroke_time": best.time[:-1],
        "best_stroke_place": best_place,
        "best_stroke_gear": _gears_of(case, best),
        "best_stroke_spike_load": best.spike,
    }


def _warnings(case: Case, chain: Chained | None) -> Iterator[str]:
    for k, gear in enumerate(case.box.gears):
        if min(gear.bears(case.limits)) <= gear.least:
            yield f"gear {k} ({gear.name}) bears no load without gliding"
    if chain and chain.over:
        yield (
            "a spike of the tracked chain carries more than limits.spike_load: springs share the "
            "load otherwise than alike, and its masses come to rest with a jolt"
        )
