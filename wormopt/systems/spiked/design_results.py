"""Reports on designed gaits: numbers, checks, warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import structs

from wormopt.errors import SolveError
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Check, Result
from wormopt.study.types import per
from wormopt.systems.shared.gravity import assumed
from wormopt.systems.spiked.design.design import Design, objective_of
from wormopt.systems.spiked.gait_problem import Cost, Effort, GaitStudy
from wormopt.systems.spiked.motion import (
    MOTION_VARIABLES,
    agreement,
    cross_check,
    motion_facts,
    motion_scalars,
    motion_variables,
)
from wormopt.systems.spiked.search.search import DONE
from wormopt.systems.spiked.stepper.stepper import Demand, demand
from wormopt.systems.spiked.verify import ACCEPTED, excess_of

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


def with_keys(error: SolveError, study: GaitStudy) -> SolveError:
    """Rewrite the error of a design with keys of scenes; a note explains limits of the motor."""
    reason, suggestion = error.reason, error.suggestion
    notes = [
        f"gait.{name} is here the limit of the motor, motor.lead * motor.{name}_max"
        for name, whose in _whose(study).items()
        if "motor" in whose and f"gait.{name}" in f"{reason} {suggestion}"
    ]
    return SolveError(reason, "; ".join([suggestion, *notes]), code=error.code)


@dataclass(frozen=True, eq=False)
class DesignReport:
    """Results reported on a designed gait."""

    objective: Scalar  # recomputed from the gait, in its quantity
    scalars: dict[str, Any]
    variables: dict[str, np.ndarray]
    checks: tuple[Check, ...]
    facts: dict[str, Any]
    warnings: tuple[str, ...]


def of_design(study: GaitStudy, found: Design) -> DesignReport:
    """Report on a designed gait, recomputed in closed form and by integration.

    Checks fail if a limit is violated by more than 1e-9 of its size, or if the second route
    differs by more, also at other loads of a range. Signals cover one cycle.
    """
    motion, required = found.motion, found.task.objective.speed
    again = cross_check(motion)
    excess = dict(found.violations)
    if required is not None:
        excess["objective.speed"] = 1.0 - motion.speed / required
    unit = unit_of(found.task.objective.quantity, study.units)
    objective = Scalar(objective_of(motion, found.task.objective.minimise), unit)
    scalars = motion_scalars(motion, study.units) | {
        "recheck_speed_error": abs(again.speed - motion.speed),
        "cycles": found.cycles,
        "ceiling": found.ceiling,
        "discretisation_error": Scalar(found.error * abs(objective.value), unit),
        "worst_violation": max(0.0, *excess.values()),
        **_of_ticks(found),
        **_limits(found),
    }
    checks = [*_checks(excess, found), *agreement(motion, again), *_under_loads(found)]
    facts = motion_facts(motion, again) | _facts(found, excess) | assumed(study.units)
    limits, rounded = found.task.limits, dict[str, float]()
    if limits.length_step is not None:  # rounded lengths that change linearly between ticks
        facts["rounded"] = rounded = excess_of(found.table, limits.tick or 1.0, limits)
    if (motor := study.motor) is not None:
        # a motor that always needs a ramp, and the gait alone: independent of the design's check
        needed = demand(found.gait, structs.replace(motor, start_rate=0.0))
        scalars |= {f"{name}_limit_from": whose for name, whose in _whose(study).items()}
        scalars["motor_rate_share"] = float(needed.turn_rate_max.max()) / motor.rate_max
        most = float(needed.acceleration_max.max())
        scalars["motor_acceleration_share"] = most / motor.acceleration_max
        checks.append(_check_of_motors(needed))
        facts |= assumed(study.units, motors=_MOTORS)
    warnings = tuple(_warnings(found, study.search.effort, rounded))
    return DesignReport(
        objective, scalars, motion_variables(motion), tuple(checks), facts, warnings
    )


def _checks(excess: dict[str, float], found: Design) -> Iterator[Check]:
    for key, value in excess.items():
        over = float(np.maximum(value, 0.0))  # NaN remains
        yield Check(key, over, ACCEPTED, f"{key} is exceeded by {value:.2g} of its value")
    above = found.speed / found.ceiling - 1.0
    advice = "the speed is above its ceiling, which is an error; please report this scene"
    yield Check("speed over its ceiling", max(0.0, above), ACCEPTED, advice)


def _under_loads(found: Design) -> Iterator[Check]:
    """Integrate anew at other loads of a range and compare resting masses and speed."""
    low, high = found.task.worm.load_range
    for load in np.linspace(low, high, 5)[:-1].tolist() if low < high else ():
        motion = found.motion_under(load)
        yield from agreement(motion, cross_check(motion), f"under the load {load:g}: ")


def _of_ticks(found: Design) -> dict[str, Any]:
    """Scalars of cycles of whole ticks, whole steps, and a range of loads."""
    limits, known = found.task.limits, dict[str, Any]()
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
    return known | ({"load_range": [low, high]} if low < high else {})


def _limits(found: Design) -> dict[str, Any]:
    """Limits for pictures; only those that are given."""
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
    """A Result for pictures of a design, without units."""
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
    best_of_each = {t.sequence: t for t in reversed(survey.trials)}  # the best one is kept
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
            "tried": len(survey.tried),
            "variations_tried": survey.varied,
            "linear_programs": survey.programs,
            "stages_s": survey.seconds,
            "best": [
                {"sequence": t.sequence, "cycles": t.cycles, "objective": t.cost} for t in best
            ],
        },
        "ceiling": "upper bound on the speed from link rates and resting masses alone",
    }


def _warnings(found: Design, effort: Effort, rounded: dict[str, float]) -> Iterator[str]:
    if effort == "quick":
        yield 'search.effort = "quick" tries few sequences; write "normal" or "thorough"'
    if not np.isfinite(found.error):
        yield "the arcs were not halved, so the discretisation error is unknown"
    elif found.error > 1e-6:
        size = f"{found.error:.1g} of its value"
        yield f"the last halving of the arcs still changed the objective by {size}"
    if found.ended not in DONE:
        yield f"the search ended early ({found.ended}): a longer search may find a better gait"
    for name, value in rounded.items():
        if value > ACCEPTED:
            yield (
                f"lengths rounded to gait.length_step exceed {name} by {value:.2g} of its value "
                "from tick to tick: write a smaller gait.length_step or a larger gait.tick"
            )


def _check_of_motors(needed: Demand) -> Check:
    # a period too short by a share means accelerations too large by twice this share
    name, short = needed.strictest.name, max(0.0, needed.period_min / needed.period - 1.0)
    advice = f"motor.{name} is exceeded: the gait needs a period of {needed.period_min}"
    return Check(f"motor.{name}", short, ACCEPTED, advice, passed=needed.feasible)


def _whose(study: GaitStudy) -> dict[str, list[str]]:
    """Source of the smaller limit of each link: "gait" or "motor"."""
    links, limits, motor = study.counts["links"], study.gait, study.motor
    if motor is None:
        return {}
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
