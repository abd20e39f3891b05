"""Scenes of kind ``gait-design``: construct the best gait within limits, and prove it."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.design.design import Design, objective_of
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.runs.gait_limits import add_limits
from wormopt.systems.spiked.runs.motion import (
    disagreements,
    motion_scalars,
    motion_trust,
    motion_variables,
    recheck,
)
from wormopt.systems.spiked.runs.motor_limits import (
    motor_faults,
    motor_scalars,
    motor_trust,
    say_whose,
)
from wormopt.systems.spiked.scenes.gait_design import DesignTable, GaitDesignScene
from wormopt.systems.spiked.scenes.gait_search import in_scene
from wormopt.systems.spiked.task import Cost, Objective

# A gait is accepted if no limit is exceeded by more, and the second route agrees to this.
_ACCEPTED = 1e-9


def run(scene: Scene[GaitDesignScene], report: Report) -> Result:
    """Design the scene's gait; "failed" where the trust report does not hold.

    Raises SolveError where no gait meets the limits, Interrupted with the best gait so far.
    """
    table = scene.table
    task, settings = table.task(table.objective.objective), table.search.search
    try:
        found = designed(task, settings, report)
    except SolveError as error:
        raise refused(error, scene) from None
    result = design_result(scene, found)
    if found.ended == "interrupted":
        reason = "interrupted: the best gait so far, its search cut short"
        raise Interrupted(replace(result, status="failed", reason=reason))
    result = add_limits(result, found, table)
    proof = table.search.proof
    if proof is None or result.status != "ok":
        return result
    from wormopt.systems.spiked.runs.gait_certificate import add_certificate

    result, interrupted = add_certificate(
        result, found, proof, table.units, report, lambda better: design_result(scene, better)
    )
    if interrupted:
        reason = "interrupted: the gait is done, its certificate is not; run again to go on"
        raise Interrupted(replace(result, status="failed", reason=reason))
    return result


def refused(error: SolveError, scene: Scene[Any]) -> SolveError:
    """A design's refusal in the words of its scene, with a partial result that says so.

    The scene's table is a DesignTable.
    """
    told, kind = say_whose(error, scene.table), scene.table.kind
    nothing = Result(
        scene.name, kind, scene.title, "failed", reason=str(told), scene_text=scene.text
    )
    return SolveError(told.reason, told.suggestion, nothing, told.code)


def design_result(scene: Scene[Any], found: Design, cost: Cost | None = None) -> Result:
    """Result of a designed gait, computed anew in closed form and rechecked by integration.

    "failed" where a limit is exceeded by over 1e-9 of its size, or the two routes differ in
    speed by more than that. Signals show one cycle; `cost` is stated besides.
    """
    table: DesignTable = scene.table
    clock = time.perf_counter()
    motion, objective = found.motion, found.task.objective
    again = recheck(motion)
    excess = {in_scene(name): value for name, value in found.violations.items()}
    if objective.speed is not None:
        excess["objective.speed"] = 1.0 - motion.speed / objective.speed
    scalars = motion_scalars(motion, table.units) | _design_scalars(table, found, motion)
    scalars |= motor_scalars(table, found.gait)
    if cost is not None:
        unit = unit_of(Objective(cost).quantity, table.units)
        scalars[cost_scalar(cost)] = Scalar(objective_of(motion, cost), unit)
    error = abs(again.speed - motion.speed)
    scalars["worst_violation"] = Scalar(max(0.0, *excess.values()))
    scalars["recheck_speed_error"] = Scalar(error, unit_of("speed", table.units))
    trust = dict(motion_trust(motion, again)) | _design_trust(found, excess)
    trust |= motor_trust(table)
    faults = [*_faults(excess, motion, found.ceiling), *disagreements(motion, again)]
    faults += [*_faults_under_loads(found), *motor_faults(table, found.gait)]
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=scalars,
        variables=tuple(motion_variables(motion, table.units)),
        trust=trust,
        timings_s=found.timings_s | {"prove": time.perf_counter() - clock},
        scene_text=scene.text,
    )


def _faults_under_loads(found: Design) -> list[str]:
    """Integrate anew under other loads of a range: as many masses must rest, as fast a motion."""
    low, high = found.task.worm.load_range
    if low == high:
        return []
    motions = [found.motion_under(load) for load in np.linspace(low, high, 5)[:-1].tolist()]
    return [
        f"under the load {motion.drive.load:g}: {fault}"
        for motion in motions
        for fault in disagreements(motion, recheck(motion))
    ]


def cost_scalar(cost: Cost) -> str:
    """Name of the scalar that holds a cost."""
    return {
        "peak_spike_load": "spike_load_max",
        "peak_actuator_force": "actuator_force_max",
        "energy_per_distance": "energy_per_distance",
        "acceleration_effort": "acceleration_effort",
    }[cost]


def _design_scalars(table: DesignTable, found: Design, motion: Crawl) -> dict[str, Scalar]:
    units, limits, links = table.units, table.limits, table.worm.links
    objective = found.task.objective
    value = objective_of(motion, objective.minimise)
    unit, time_unit = unit_of(objective.quantity, units), unit_of("time", units)
    scalars = {
        "objective": Scalar(value, unit),
        "cycles": Scalar(found.cycles),
        "period": Scalar(found.cycles * found.gait.period, time_unit),
        "advance": Scalar(found.cycles * motion.advance, unit_of("length", units)),
        "smallest_period": Scalar(found.gait.period, time_unit),
        "ceiling": Scalar(found.ceiling, unit_of("speed", units)),
        "gap": Scalar((found.ceiling - motion.speed) / found.ceiling),
        "discretisation_error": Scalar(found.error * abs(value), unit),
        "length_limits": Scalar(limits.length_ranges(links), unit_of("length", units)),
    }
    rates = limits.rate_limits(links)
    if rates is not None:
        scalars["rate_limit"] = Scalar(rates, unit_of("speed", units))
    if limits.spike_load is not None:
        scalars["spike_load_limit"] = Scalar(limits.spike_load, unit_of("force", units))
    if limits.actuator_force is not None:
        scalars["actuator_force_limit"] = Scalar(limits.actuator_force, unit_of("force", units))
    low, high = found.task.worm.load_range
    if low < high:
        scalars["load_range"] = Scalar([low, high], unit_of("force", units))
    return scalars


def _design_trust(found: Design, excess: dict[str, float]) -> dict[str, Any]:
    survey, warnings = found.survey, []
    best_of_each = {t.sequence: t for t in reversed(survey.trials)}  # the last, the best, stays
    best_of_each = dict(sorted(best_of_each.items(), key=lambda item: -item[1].value))
    if not found.error <= 1e-6:
        size = (
            "by an unknown share" if not np.isfinite(found.error) else f"by {found.error:.1g} of it"
        )
        warnings.append(f"halving the arcs still changed the objective {size}")
    if found.ended != "searched":
        warnings.append(
            f"the search was cut short ({found.ended}): a longer one may find a better gait"
        )
    return {
        "violations": {k: max(0.0, v) for k, v in excess.items()},
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
                {"sequence": t.sequence, "cycles": t.cycles, "objective": t.cost}
                for t in list(best_of_each.values())[:5]
            ],
        },
        "ceiling": "upper bound on the speed by link rates and resting masses alone",
        "warnings": warnings,
    }


def _faults(excess: dict[str, float], motion: Crawl, ceiling: float) -> list[str]:
    faults = [
        f"{key} is exceeded by {value:.2g} of its size"
        for key, value in excess.items()
        if not value <= _ACCEPTED
    ]
    if motion.speed > ceiling * (1 + _ACCEPTED):
        faults.append("the speed is above its ceiling, which cannot be; please report this scene")
    return faults
