"""Scenes of kind ``track-optimal``: the best input by which a chain's links follow a gait."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.loop import with_reference
from wormopt.control.reference import follow
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.ocp.optimise import Optimum
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.options import Exact
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.chains import build_chain, draw_links, tolerance_of
from wormopt.systems.chain.runs.judged import judged, judged_numbers
from wormopt.systems.chain.runs.optimal_tracking import optimal_input
from wormopt.systems.chain.runs.tracked import LOOP_SIGNALS
from wormopt.systems.chain.scenes.track_optimal import LeastError, TrackOptimalScene
from wormopt.systems.shared.optimum import optimum_timings, refused, statistics
from wormopt.systems.shared.proof import Recheck, accepted_error, faults_of_motion, recheck
from wormopt.systems.shared.signals import (
    chain_expressions,
    event_variables,
    sample,
    simulate_whole,
    variable,
)
from wormopt.systems.shared.watch import balance
from wormopt.systems.spiked.files import gait_variables
from wormopt.systems.spiked.runs.reference import gait_of_shape

# Largest difference of any state, at any time, between the optimiser's motion and the exact
# simulation of its input that is accepted: open loop, errors of the grid add up.
_ACCEPTED = 0.05
_NAME = "optimal input"


@dataclass(frozen=True, eq=False)
class _Found:
    """The optimiser's motion and the exact one."""

    optimum: Optimum  # from complementarity
    plant: Model  # driven by its input, nothing measured
    motion: Trajectory  # exact, judged
    replay: Recheck  # how far both are apart


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[TrackOptimalScene], report: Report) -> Result:
    """Find the best input and simulate it exactly, open loop.

    Scalars but ``objective_found`` are of that simulation; "failed" if it is not near the optimum
    or not confirmed. Raises SceneError for a gait's file, SolveError without input or motion.
    """
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    length = float(np.mean(np.abs(gait(gait.breaks[:-1])))) or 1.0
    links = draw_links(table.worm, table.time.end)
    plant = build_chain(table.worm, table.start, links, length, gait.period)
    reference = follow(gait, plant.t, shift=table.reference.shift % gait.period)
    try:
        optimum = optimal_input(
            plant,
            reference,
            table.time.end,
            table.objective,
            table.tube,
            table.grid,
            table.relaxation,
            period=gait.period,
            report=lambda text, fraction: report(f"optimising, {text}", fraction),
        )
        simulated = time.perf_counter()
        driven = drive(with_reference(plant, reference), optimum.motion.input_course())
        motion = simulate_whole(
            judged(driven, table.tube),
            table.time.end,
            table.time.samples,
            Exact(),
            tolerance_of(table.tolerance),
            lambda _, fraction: report("simulating", fraction),
        )
    except SolveError as error:
        raise refused(scene, error) from None
    found = _Found(optimum, driven, motion, _apart(optimum, driven, motion))
    checked = time.perf_counter()
    tolerance = tolerance_of(table.tolerance)
    second = recheck(driven, motion, tolerance, report=report) if table.tolerance.recheck else None
    timings = {
        **optimum_timings({"complementarity": optimum}),
        "simulate": checked - simulated,
        "recheck": time.perf_counter() - checked,
    }
    return _result(scene, gait, found, second, timings)


def _apart(optimum: Optimum, plant: Model, motion: Trajectory) -> Recheck:
    """Largest difference of any state at any sample between optimiser and simulation."""
    sizes = np.concatenate([np.full(s.size, s.nominal) for s in plant.x])[:, None]
    exact = motion.states[: plant.n_x]
    error = np.abs(optimum.motion.states(motion.time) - exact) / np.maximum(sizes, np.abs(exact))
    return Recheck(
        "exact simulation of the input found", float(error.max()), _ACCEPTED, "the model"
    )


# -- what is said of it ----------------------------------------------------------------------------


def _result(
    scene: Scene[TrackOptimalScene],
    gait: Gait,
    found: _Found,
    second: Recheck | None,
    timings: dict[str, float],
) -> Result:
    table, motion = scene.table, found.motion
    energy, tolerance = balance(motion), tolerance_of(table.tolerance)
    faults = [*faults_of_motion(second, energy, tolerance), *_faults(found)]
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(scene, found),
        variables=tuple(_variables(scene, gait, found)),
        trust={
            "treatment": "complementarity in the optimiser, exact in the simulation",
            "complementarity_max": found.optimum.complementarity,
            "defect_max": float(found.optimum.defects.max()),
            "replay": {"error": found.replay.error, "accepted": found.replay.accepted},
            "recheck": second
            and {"route": second.route, "error": second.error, "accepted": second.accepted},
            "energy_balance": energy and energy.residual,
            "accepted_energy": accepted_error(tolerance),
            "solves": statistics(found.optimum),
            "warnings": list(_warnings(scene, found, second)),
        },
        timings_s=timings,
        scene_text=scene.text,
        attributes={"trackers": [_NAME]},
    )


def _scalars(scene: Scene[TrackOptimalScene], found: _Found) -> dict[str, Scalar]:
    table = scene.table
    numbers = judged_numbers(found.motion, table.tube)
    name = "error_integral" if isinstance(table.objective, LeastError) else "input_integral"
    quantity = numbers[name][1]
    objective = _objective(scene, numbers["error_integral"][0], numbers["input_integral"][0])
    numbers |= {
        "objective": (objective, quantity),
        "objective_found": (found.optimum.objective, quantity),
        "solve_iterations": (found.optimum.iterations, "count"),
        "recheck_error": (found.replay.error, "share"),
    }
    return {k: Scalar(value, unit_of(kind, table.units)) for k, (value, kind) in numbers.items()}


def _objective(scene: Scene[TrackOptimalScene], missed: float, spent: float) -> float:
    objective = scene.table.objective
    if isinstance(objective, LeastError):
        return missed + objective.input_weight * spent
    return spent


def _variables(scene: Scene[TrackOptimalScene], gait: Gait, found: _Found) -> Iterator[Variable]:
    table, motion = scene.table, found.motion
    units = table.units
    yield Variable("time", unit_of("time", units), ("time",), motion.time, "time")
    kind = ("length", ("link",), "reference of the link length")
    yield variable("reference", kind, (), motion.output("reference"), units)
    expressions = chain_expressions(motion.system.model)
    expressions["error_norm"] = found.plant.output("error_norm")
    for name, values in sample(motion, expressions).items():
        yield variable(name, LOOP_SIGNALS[name], ("tracker",), values[None], units)
    tube = np.full((1, 1, len(motion.time)), table.tube.radius)
    yield variable("tube", LOOP_SIGNALS["tube"], ("tracker",), tube, units)
    yield from event_variables([motion], units, several=True)
    yield from gait_variables(gait, units)


# -- how far it is to be trusted -------------------------------------------------------------------


def _faults(found: _Found) -> Iterator[str]:
    error = found.replay.error
    if error is not None and not error <= found.replay.accepted:
        yield (
            f"simulated exactly, the input found moves the worm elsewhere, by {error:.2g} of the "
            f"states' size where {found.replay.accepted:.2g} is accepted; write more grid.arcs, or "
            "a smaller relaxation.last"
        )


def _warnings(
    scene: Scene[TrackOptimalScene], found: _Found, second: Recheck | None
) -> Iterator[str]:
    table = scene.table
    if second is None:
        yield "not rechecked by a second route: tolerance.recheck is false"
    numbers = judged_numbers(found.motion, table.tube)
    if not isinstance(table.objective, LeastError) and numbers["time_outside_tube"][0] > 0:
        yield (
            "simulated exactly, the error leaves the tube for "
            f"{numbers['time_outside_tube'][0]:.3g} "
            f"in all, and reaches {numbers['error_peak'][0]:.6g}; write more grid.arcs or a larger "
            "objective.margin"
        )
