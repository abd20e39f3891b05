"""Results of designed gaits: numbers, checks, warnings, sensitivities to limits, and bounds."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec import structs

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of, unit_ratio
from wormopt.result import Check, Result
from wormopt.study.types import per
from wormopt.systems.shared.incline import weights
from wormopt.systems.shared.transport import assumed
from wormopt.systems.spiked.certify.bound import Bounded, bounded, gap_of
from wormopt.systems.spiked.certify.certificate import verify
from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.declared import MOTION_VARIABLES
from wormopt.systems.spiked.design.design import Design, objective_of
from wormopt.systems.spiked.design.sensitivity import Sensitivity, scaling_error, sensitivities
from wormopt.systems.spiked.design_tables import DesignTable
from wormopt.systems.spiked.gait_problem import Cost, Effort, Worm
from wormopt.systems.spiked.motion import (
    Findings,
    agreement,
    cross_check,
    motion_facts,
    motion_scalars,
    motion_variables,
)
from wormopt.systems.spiked.search.search import DONE
from wormopt.systems.spiked.stepper.stepper import Demand, Motor, demand
from wormopt.systems.spiked.table import excess_of

# A gait is accepted if every limit holds and the second route agrees within this share.
_ACCEPTED = 1e-9
# Rounding of a gait's own value, relative, in its comparison with a bound.
_PROOF_ROUNDING = 1e-12
# Sensitivities of larger programs take seconds; they are computed only if the picture is wanted.
_MOST_UNKNOWNS = 3000
_MOTORS = (
    "one motor per link turns a threaded rod: |l'| <= lead rate_max and |l''| <= lead "
    "acceleration_max hold at all times, also below motor.start_rate, where motors need no ramp; "
    "within these limits no step is lost at any force"
)
COST_SCALARS: dict[Cost, str] = {
    "peak_spike_load": "spike_load_max",
    "peak_actuator_force": "actuator_force_max",
    "energy_per_distance": "energy_per_distance",
    "acceleration_effort": "acceleration_effort",
}
"""Scalars that hold the costs."""


def with_keys(error: SolveError, table: DesignTable) -> SolveError:
    """Rewrite the error of a design with keys of scenes; a note explains limits of the motor."""
    reason, suggestion = error.reason, error.suggestion
    notes = [
        f"gait.{name} is here the limit of the motor, motor.lead * motor.{name}_max"
        for name, whose in (_whose(table, table.motor) if table.motor else {}).items()
        if "motor" in whose and f"gait.{name}" in f"{reason} {suggestion}"
    ]
    return SolveError(reason, "; ".join([suggestion, *notes]), code=error.code)


def of_design(table: DesignTable, found: Design) -> Findings:
    """Collect the results of a designed gait, recomputed in closed form and by integration.

    Fails if a limit is violated by more than 1e-9 of its size, or if the speed of the second
    route differs by more. Signals cover one cycle.
    """
    clock = time.perf_counter()
    motion, objective = found.motion, found.task.objective
    again = cross_check(motion)
    excess = dict(found.violations)
    if objective.speed is not None:
        excess["objective.speed"] = 1.0 - motion.speed / objective.speed
    checks = [*_checks(excess, motion, found), *agreement(motion, again), *_under_loads(found)]
    known = Findings(
        motion_scalars(motion, table.units)
        | {"recheck_speed_error": abs(again.speed - motion.speed)}
        | _scalars(table, found, motion),
        motion_variables(motion),
        tuple(checks),
        motion_facts(motion, again) | _facts(found, excess) | assumed(table.units),
        tuple(_warnings(found, table.search.effort)),
    ) | Findings({"worst_violation": max(0.0, *excess.values())})
    if table.motor is not None:
        known |= _of_motors(table, table.motor, found)
    if found.task.limits.length_step is not None:
        known |= _of_steps(found)
    return known | Findings(timings=found.timings_s | {"prove": time.perf_counter() - clock})


def objective_reached(table: DesignTable, found: Design) -> dict[str, Scalar]:
    """Objective reached, whose quantity depends on the objective."""
    objective = found.task.objective
    value = objective_of(found.motion, objective.minimise)
    return {"objective": Scalar(value, unit_of(objective.quantity, table.units))}


def _checks(excess: dict[str, float], motion: Crawl, found: Design) -> Iterator[Check]:
    for key, value in excess.items():
        over = float(np.maximum(value, 0.0))  # keeps what is not a number
        yield Check(key, over, _ACCEPTED, f"{key} is exceeded by {value:.2g} of its value")
    above = motion.speed / found.ceiling - 1.0
    advice = "the speed is above its ceiling, which is an error; please report this scene"
    yield Check("speed over its ceiling", max(0.0, above), _ACCEPTED, advice)


def _under_loads(found: Design) -> Iterator[Check]:
    """Integrate anew at other loads of a range and compare resting masses and speed."""
    low, high = found.task.worm.load_range
    for load in np.linspace(low, high, 5)[:-1].tolist() if low < high else ():
        motion = found.motion_under(load)
        yield from agreement(motion, cross_check(motion), f"under the load {load:g}: ")


def _scalars(table: DesignTable, found: Design, motion: Crawl) -> dict[str, Any]:
    limits, links, objective = table.limits, table.worm.links, found.task.objective
    error = found.error * abs(objective_of(motion, objective.minimise))
    known = {
        "cycles": found.cycles,
        "ceiling": found.ceiling,
        "discretisation_error": Scalar(error, unit_of(objective.quantity, table.units)),
        "length_limits": limits.length_ranges(links),
    }
    if found.free is not None:
        known |= {
            "ticks": round(found.period / (limits.tick or 1.0)),
            "tick_loss": found.tick_loss,
            "free_period": found.free.period,
            "free_speed": found.free.speed,
        }
    if limits.length_step is not None:
        known |= {"length_step": limits.length_step, "step_loss": found.step_loss}
    low, high = found.task.worm.load_range
    return known | _limits(found) | ({"load_range": [low, high]} if low < high else {})


def _limits(found: Design) -> dict[str, Any]:
    """Limits that pictures show, those that are given."""
    limits, links = found.task.limits, found.task.worm.links
    given = {
        "length_limits": limits.length_ranges(links),
        "rate_limit": limits.rate_limits(links),
        "acceleration_limit": limits.acceleration,
        "spike_load_limit": limits.spike_load,
        "actuator_force_limit": limits.actuator_force,
    }
    return {name: value for name, value in given.items() if value is not None}


def as_result(found: Design) -> Result:
    """A Result that holds what pictures of a design show, without units."""
    motion = found.motion
    arrays = motion_variables(motion)
    return Result(
        "design",
        "gait-design",
        "Designed gait",
        scalars={name: Scalar(value) for name, value in _limits(found).items()},
        variables=tuple(
            Variable(name, "1", dims, arrays[name], what)
            for name, (_, dims, what) in MOTION_VARIABLES.items()
        ),
        attributes={"impulses": motion.impulses},
    )


def _facts(found: Design, excess: dict[str, float]) -> dict[str, Any]:
    survey = found.survey
    best_of_each = {t.sequence: t for t in reversed(survey.trials)}  # the last, the best, stays
    best = sorted(best_of_each.values(), key=lambda trial: -trial.value)[:5]
    return {
        "violations": excess,
        "solver": {
            **found.solver,
            "sequence": found.sequence,
            "durations": found.durations,
            "cycles": found.cycles,
        },
        "search": {
            "ended": found.ended,
            "tried": survey.tried,
            "variations_tried": survey.varied,
            "linear_programs": survey.programs,
            "stages_s": survey.seconds,
            "best": [
                {"sequence": t.sequence, "cycles": t.cycles, "objective": t.cost} for t in best
            ],
        },
        "ceiling": "upper bound on the speed from link rates and resting masses alone",
    }


def _warnings(found: Design, effort: Effort) -> Iterator[str]:
    if effort == "quick":
        yield 'search.effort = "quick" tries few sequences; write "normal" or "thorough"'
    if not found.error <= 1e-6:
        known = np.isfinite(found.error)
        size = f"by {found.error:.1g} of its value" if known else "by an unknown share"
        yield f"the last halving of the arcs still changed the objective {size}"
    if found.ended not in DONE:
        yield f"the search ended early ({found.ended}): a longer search may find a better gait"


def _of_steps(found: Design) -> Findings:
    """Violation of limits by rounded lengths that move in straight lines from tick to tick."""
    limits = found.task.limits
    excess = excess_of(found.table, limits.tick or 1.0, limits)
    over = [
        f"lengths rounded to gait.length_step exceed {name} by {value:.2g} of its value "
        "from tick to tick: write a smaller gait.length_step or a larger gait.tick"
        for name, value in excess.items()
        if value > _ACCEPTED
    ]
    return Findings(facts={"rounded": excess}, warnings=tuple(over))


# -- motors --------------------------------------------------------------------------------------


def _of_motors(table: DesignTable, motor: Motor, found: Design) -> Findings:
    """Find which limits are the motor's, the shares of them that the gait uses, and violations.

    Computed from the gait alone, independently of the design's own check of its limits.
    """
    asked = demand(found.gait, structs.replace(motor, start_rate=0.0))  # always ramped
    scalars = {
        **{f"{name}_limit_from": whose for name, whose in _whose(table, motor).items()},
        "motor_rate_share": float(asked.rate.max()) / motor.rate_max,
        "motor_acceleration_share": float(asked.acceleration.max()) / motor.acceleration_max,
    }
    return Findings(
        scalars, checks=(_check_of_motors(asked),), facts=assumed(table.units, motors=_MOTORS)
    )


def _check_of_motors(asked: Demand) -> Check:
    # a period that is short by a share stands for accelerations that are over by twice that
    name, short = asked.strictest.name, max(0.0, asked.period_min / asked.period - 1.0)
    advice = f"motor.{name} is exceeded: the gait needs a period of {asked.period_min}"
    return Check(f"motor.{name}", short, _ACCEPTED, advice, passed=asked.feasible)


def _whose(table: DesignTable, motor: Motor) -> dict[str, list[str]]:
    """Source of the smaller limit of each link: "gait" or "motor"."""
    links, limits = table.worm.links, table.gait
    rates = limits.rate_limits(links)
    given = {
        "rate": np.full(links, np.inf) if rates is None else np.min(rates, axis=0),
        "acceleration": np.array(per(limits.acceleration or np.inf, links)),
    }
    own = {"rate": motor.length_rate, "acceleration": motor.length_acceleration}
    return {
        name: ["motor" if own[name] <= limit else "gait" for limit in values]
        for name, values in given.items()
    }


# -- limits that bind the gait -------------------------------------------------------------------


def of_limits(table: DesignTable, found: Design) -> Findings:
    """Sensitivities to all limits (scalars ``sensitivity.*``), where they are known.

    Includes the data of the picture ``limits``; the trust report gives the method or the reason.
    """
    reason = _reason_against(found, "limits" in table.want)
    if reason:
        return Findings(facts={"sensitivity": f"unknown: {reason}"})
    clock = time.perf_counter()
    known = sensitivities(found)
    seconds = time.perf_counter() - clock
    one_sided = [s.name for s in known if s.one_sided]
    weight = (".pull", ".slope") if _has_weights(table.worm) else ("", "")
    return Findings(
        _derivatives(known, found, table),
        {"limit_elasticity": np.array([s.elasticity for s in known])},
        facts={
            "sensitivity": {
                "method": "multipliers of the program under a change of each limit; the resting "
                "sequence is kept",
                "one_sided": one_sided,
                "scaling_error": scaling_error(known, found.task.objective),
            }
        },
        timings={"sensitivity": seconds},
        attributes={
            "limits": {
                "objective": found.task.objective.minimise or "speed",
                "name": [s.name.replace(*weight) for s in known],
                "value": [s.value for s in known],
                "unit": [unit_of(s.quantity, table.units) for s in known],
                "one_sided": [s.one_sided for s in known],
            }
        },
    )


def _reason_against(found: Design, wanted: bool) -> str:
    if found.trial is None:
        return "a smooth cost is minimised by another solver, whose multipliers are not kept"
    if found.ended == "interrupted":
        return "the design was interrupted"
    if len(found.trial.point.x) > _MOST_UNKNOWNS and not wanted:
        return 'the program is large; add "limits" to want'
    return ""


def _has_weights(worm: Worm) -> bool:
    """Whether a slope pulls the masses by unequal forces, which are then in `pull`."""
    return bool(worm.slope) and len(set(worm.masses)) > 1


def _derivatives(
    known: tuple[Sensitivity, ...], found: Design, table: DesignTable
) -> dict[str, Scalar]:
    """Sensitivity of each key; a list where the key has one number per link or mass."""
    objective, worm = found.task.objective.quantity, table.worm
    values: dict[str, Any] = {}
    unit: dict[str, str] = {}
    for s in known:
        if _has_weights(worm) and s.name.startswith("worm.pull"):
            continue
        name = "sensitivity." + re.sub(r"\[\d+\]", "", s.name.partition(".")[2])
        unit[name] = unit_ratio(objective, s.quantity, table.units)
        if "[" in s.name:
            values.setdefault(name, []).append(s.derivative)
        else:
            values[name] = s.derivative
    if worm.slope:  # derivative by the loads, times m g cos(slope)
        across = weights(math.pi / 2 - worm.slope, worm.gravity, worm.masses)
        by_pull = [s.derivative for s in known if s.name.startswith("worm.pull")]
        if not _has_weights(worm):  # equal on all masses, and part of their load
            loads = [s.derivative for s in known if s.name.startswith("worm.load")]
            by_pull = (
                loads if len(loads) == len(across) > 2 else [sum(loads) / len(across)] * len(across)
            )
        values["sensitivity.slope"] = sum(a * b for a, b in zip(by_pull, across, strict=True))
        unit["sensitivity.slope"] = unit_ratio(objective, "angle", table.units)
    return {name: Scalar(value, unit[name]) for name, value in values.items()}


# -- the bound on every gait -----------------------------------------------------------------------


def of_certificate(table: DesignTable, found: Design, report: Report) -> Findings:
    """Bound the objective of every gait, verify the proof exactly, and compare with the gait.

    Without a table `[search.certify]` the bound is the one that the search began with.
    """
    wanted, task = table.search.certify, found.task
    clock = time.perf_counter()
    if wanted is not None:
        proven = bounded(task, found.value, wanted, report, found.survey.bounded)
    else:
        assert found.bounded is not None
        proven = found.bounded
    proved = time.perf_counter()
    cost = task.objective.minimise is not None
    gap = gap_of(found.value, proven.bound, cost)
    advice = "the gait is better than its proven bound, which is an error; please report this scene"
    checks = [Check("gait over its proven bound", max(0.0, -gap), _PROOF_ROUNDING, advice)]
    facts: dict[str, Any] = {
        "holds_for": "every gait with any resting sequence, number of phases and cycles in which "
        f"gait.resting = {task.limits.resting} and all other limits hold at all times",
        "source": proven.source,
    }
    timings: dict[str, float] = {}
    if proven.certificate is not None:
        report("verifying the certificate in exact arithmetic", None)
        verified = verify(proven.certificate)
        advice = (
            f"verification of the certificate failed: {verified.reason}; please report this scene"
        )
        checks.append(Check("certificate verified", 0.0 if verified.holds else 1.0, 0.0, advice))
        facts["verified_inequalities"] = verified.inequalities
        timings["verify"] = time.perf_counter() - proved
    unit = unit_of(task.objective.quantity, table.units)
    known = Findings(
        {"bound": Scalar(proven.bound, unit), "gap_certified": max(0.0, gap)},
        checks=tuple(checks),
        facts={"certificate": facts},
        timings=timings,
        attributes={"certificate": proven.certificate.text} if proven.certificate else {},
    )
    if wanted is None:
        return known
    facts |= {"ended": proven.ending, "wanted_gap": wanted.gap}
    history = np.array(proven.history)
    courses = {"proof_bound": history[:, 1], "proof_value": 0 * history[:, 1] + found.value}
    variables: dict[str, Any] = {"proof_time": history[:, 0]}
    for name, values in courses.items():
        long_name = {"proof_bound": "proven bound", "proof_value": "objective of the gait"}[name]
        variables[name] = Variable(name, unit, ("proof",), values, long_name)
    return known | Findings(
        {"certified_seconds": proved - clock},
        variables,
        warnings=tuple(_doubts_of_proof(proven, wanted.gap)),
        timings={"certify": proved - clock},
    )


def _doubts_of_proof(proven: Bounded, gap: float) -> Iterator[str]:
    missed = f"the gap {gap:g} was not reached"
    match proven.ending:
        case "time limit" | "interrupted":
            yield f"{missed} ({proven.ending}): increase search.certify.time_limit"
        case "finest program":
            yield (
                f"{missed} with the largest program; either a better gait exists (try "
                'search.effort = "thorough"), or the bound is not tight'
            )
