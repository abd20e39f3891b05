"""Runs scenes of kind ``gait-shift``: build the gears, travel, optimise in hindsight, compare."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.chain import law_of
from wormopt.systems.gears.adaptive import Body, geared_chain
from wormopt.systems.gears.case import Case
from wormopt.systems.gears.checks import KEPT, agreement, hindsight, loads_by_limits, transitions
from wormopt.systems.gears.hindsight import Schedule, best_schedule, ideal_time
from wormopt.systems.gears.model import geared_worm
from wormopt.systems.gears.scenes import AdaptiveTable, GaitShiftScene
from wormopt.systems.gears.walk import Supervised, Walk, by_schedule, kept

# Chains: tolerance of the simulation, and accepted error of arrival under a hundredth of it.
_CHAIN, _CHAIN_AGREED = Tolerance(1e-8, 1e-9), 1e-5
_SAMPLES = 2000


def run(scene: Scene[GaitShiftScene], report: Report) -> Result:
    """Shift along the route; the result is "failed" if a limit is violated or two routes disagree.

    Raises SceneError for gears that do not fit, SolveError if there is no transition or the worm
    does not arrive, Interrupted by the user. The last two carry the result of the supervised worm
    if it has arrived.
    """
    case, clocks = Case(scene), [perf_counter()]
    partial: Result | None = None
    try:
        report("transitions", None)
        box = case.box
        clocks.append(perf_counter())
        motion = _simulated(case, report)
        again = case.walk(case.first, Supervised(box, case.supervisor))
        scalars, variables = _supervised(case, motion, again)
        partial = conclude(scene, scalars, variables, attributes=_attributes(case))
        clocks.append(perf_counter())
        compared = _compared(case, motion, report)
        clocks.append(perf_counter())
        chain = _chained(case, case.table.adaptive, report) if case.table.adaptive else None
        clocks.append(perf_counter())
        report("rechecking", None)
        checks = [
            *loads_by_limits(
                case.limits, motion.largest("spike_load"), motion.largest("actuator_force")
            ),
            *agreement(motion, again),
            *transitions(case),
            *hindsight(case, compared.best, compared.walked, again),
            *(_chain_checks(case, chain) if chain else ()),
        ]
        clocks.append(perf_counter())
    except SolveError as error:
        raise SolveError(error.reason, error.suggestion, partial, error.code) from None
    except KeyboardInterrupt:
        why = "interrupted before the comparison ended"
        raise Interrupted(partial and partial.failed(why)) from None
    stages = ("transitions", "simulate", "hindsight", "adaptive", "recheck")
    return conclude(
        scene,
        scalars | compared.scalars | (chain.scalars if chain else {}),
        variables | compared.variables | (chain.variables if chain else {}),
        checks=checks,
        facts={"assumptions": ["resting masses share the load equally", "spikes never slip back"]},
        warnings=_warnings(case),
        timings=dict(zip(stages, np.diff(clocks).tolist(), strict=True)),
        attributes=_attributes(case),
    )


def _simulated(case: Case, report: Report) -> Trajectory:
    """Simulate the supervised worm as a Model with events."""
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
            "check that the slowest gear carries the loads of the route, or decrease "
            "supervisor.dwell",
        )
    return motion


# -- the tracked chain ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Chained:
    """Results of the tracked chain."""

    scalars: dict[str, Any]
    variables: dict[str, np.ndarray]
    again: float  # arrival time under a hundredth of the tolerance


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
            table.memory or min(gear.period for gear in case.box.gears) / 4,
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
            "increase adaptive.gain_start or adaptive.stiffness",
        )
    finer = Tolerance(_CHAIN.relative / 100, _CHAIN.absolute / 100)
    sampled = motion.at(np.linspace(0.0, motion.end_time, _SAMPLES))
    gear = sampled["gear"][0]
    return Chained(
        {
            "adaptive_time": motion.end_time,
            "adaptive_shifts": int(np.count_nonzero(np.diff(gear))),
            "adaptive_spike_load_max": motion.largest(model.forces),
            "adaptive_actuator_force_max": motion.largest("link_force"),
            "adaptive_total_max": motion.largest(ca.SX(ca.sum1(model.forces))),
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
    )


def _chain_checks(case: Case, chain: Chained) -> Iterator[Check]:
    told = chain.scalars
    reached = told["adaptive_spike_load_max"], told["adaptive_actuator_force_max"]
    yield from loads_by_limits(case.limits, *reached, "of the chain")
    off = abs(told["adaptive_time"] / chain.again - 1)
    advice = f"under a hundredth of the tolerance the chain arrives at {chain.again:.9g}"
    yield Check("arrival of the chain, finer", off, _CHAIN_AGREED, advice)


# -- the result ----------------------------------------------------------------------------------


def _attributes(case: Case) -> dict[str, Any]:
    return {
        "gears": [gear.name for gear in case.box.gears],
        "spike_load_limit": case.table.limits.spike_load,
        "actuator_force_limit": case.table.limits.actuator_force,
    }


def _gears_of(case: Case, walked: Walk) -> np.ndarray:
    return np.array([case.box.rows[number].gear for number in walked.row], dtype=np.int32)


def _supervised(
    case: Case, motion: Trajectory, again: Walk
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Scalars and variables of the gears and of the worm under its supervisor."""
    box, gear = case.box, _gears_of(case, again)
    changes = 1 + np.flatnonzero(np.diff(gear))
    place = again.place[:-1].mean(axis=1)
    scalars = {
        "time": motion.end_time,
        "shifts": len(changes),
        "shift_times": again.time[changes],
        "shift_places": again.place[changes].mean(axis=1),
        "shift_gears": gear[changes],
        "gear_speeds": [each.speed for each in box.gears],
        "gear_resting": [each.resting for each in box.gears],
        "gear_loads": [[each.least, min(each.bears(case.limits))] for each in box.gears],
        "up_durations": [each.duration for each in box.up],
        "down_durations": [each.duration for each in box.down],
        "up_resting": [list(each.resting) for each in box.up],
        "down_resting": [list(each.resting) for each in box.down],
        "spike_load_max": motion.largest("spike_load"),
        "actuator_force_max": motion.largest("actuator_force"),
        "spike_total_min": again.total.min(),
    }
    shifting = [box.rows[number].shifting for number in again.row]
    return scalars, {
        "stroke_time": again.time[:-1],
        "stroke_place": place,
        "stroke_gear": gear,
        "stroke_shifting": np.array(shifting, dtype=np.int32),
        "stroke_load": case.load(place),
        "stroke_spike_load": again.spike,
        "stroke_actuator_force": again.actuator,
    }


@dataclass(frozen=True, eq=False)
class Compared:
    """Results with which the supervised worm is compared."""

    best: Schedule
    walked: Walk  # with the best schedule
    scalars: dict[str, Any]
    variables: dict[str, np.ndarray]


def _compared(case: Case, motion: Trajectory, report: Report) -> Compared:
    """Travel in each gear alone, and with the best schedule."""
    box, way, limits = case.box, case.table.way, case.limits
    fixed = [case.walk(k, kept) for k in range(len(box.gears))]
    best = best_schedule(box, case.ground, limits, way.start, way.goal, case.first, report=report)
    walked = case.walk(case.first, by_schedule(best.rows))
    fine = [
        bool(w.spike.max() <= limits.spike * (1 + KEPT))
        and bool(w.actuator.max() <= limits.actuator * (1 + KEPT))
        and bool(w.total.min() >= 0)
        for w in fixed
    ]
    alone = [w.arrival if good else None for w, good in zip(fixed, fine, strict=True)]
    gear = _gears_of(case, walked)
    return Compared(
        best,
        walked,
        {
            "best_time": best.time,
            "efficiency": best.time / motion.end_time,
            "ideal_time": ideal_time(box, case.ground, limits, way.start, way.goal),
            "fixed_time": min((each for each in alone if each is not None), default=None),
            "fixed_times": alone,
            "fixed_spike_loads": [w.spike.max() for w in fixed],
            "best_shifts": int(np.count_nonzero(np.diff(gear))),
        },
        {
            "best_stroke_time": walked.time[:-1],
            "best_stroke_place": walked.place[:-1].mean(axis=1),
            "best_stroke_gear": gear,
            "best_stroke_spike_load": walked.spike,
        },
    )


def _warnings(case: Case) -> Iterator[str]:
    for k, gear in enumerate(case.box.gears):
        if min(gear.bears(case.limits)) <= gear.least:
            yield f"gear {k} ({gear.name}) glides at every load within the limits"
        if any(gear.outdone(other, case.limits) for other in case.box.gears):
            yield (
                f"gear {k} ({gear.name}) is never useful: a faster gear carries every load that it "
                "does; remove it"
            )
    if not all(each.complete for each in (*case.box.up, *case.box.down)):
        yield "not all pairs of phases were tried: a transition may be longer than necessary"
