"""Run scenes of kind ``track-optimal``: the best input with which links follow a gait."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.loop import with_reference
from wormopt.control.reference import gait_reference
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.model.values import nominal_of
from wormopt.ocp.optimise import Optimum
from wormopt.progress import Report
from wormopt.quantities import Scalar, unit_of
from wormopt.result import NOT_RECHECKED, Check, Result
from wormopt.simulation.options import Exact
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.chain.loops import chain_for, draw_links
from wormopt.systems.chain.measured import balance, chain_checks, judged, judged_numbers
from wormopt.systems.chain.optimal_tracking import optimal_input
from wormopt.systems.chain.scenes.track_optimal import LeastError, TrackOptimalScene
from wormopt.systems.shared.optimum import optimum_timings, refused, statistics
from wormopt.systems.shared.proof import CrossCheck, accepted_error, cross_check
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import (
    chain_expressions,
    event_arrays,
    fitted,
    gait_arrays,
    sample,
    simulate_whole,
)
from wormopt.systems.spiked import gait_of_shape

# Largest accepted difference of any state, at any time, between the optimiser's motion and the
# exact simulation of its input. In open loop, errors of the grid add up.
_ACCEPTED = 0.05
_NAME = "optimal input"


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[TrackOptimalScene], report: Report) -> Result:
    """Find the best input and simulate it exactly, in open loop.

    All scalars except ``objective_found`` come from that simulation. The result is "failed" if it
    differs from the optimum or is not confirmed. Raises SceneError for a gait's file, and
    SolveError without input or motion.
    """
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    plant = chain_for(table.worm, table.start, draw_links(table.worm, table.time.end), gait)
    reference = gait_reference(gait, plant.t, shift=table.reference.shift % gait.period)
    tolerance = tolerance_of(table.tolerance)
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
            tolerance,
            lambda _, fraction: report("simulating", fraction),
        )
    except SolveError as error:
        raise refused(scene, error) from None
    replayed = _replayed(optimum, driven, motion)
    checked = time.perf_counter()
    recheck = table.tolerance.recheck
    second = cross_check(driven, motion, tolerance, recheck=recheck, report=report)
    energy, numbers = balance(motion), judged_numbers(motion, table.tube)
    return conclude(
        scene,
        _scalars(table, numbers, optimum, replayed),
        _signals(table, gait, motion),
        checks=[*chain_checks(second, energy, tolerance), replayed],
        facts={
            "treatment": "complementarity in the optimiser, exact in the simulation",
            "complementarity_max": optimum.complementarity,
            "defect_max": float(optimum.defects.max()),
            "replay": {"error": replayed.value, "accepted": replayed.limit},
            "recheck": second and second.facts,
            "energy_balance": energy and energy.residual,
            "accepted_energy": accepted_error(tolerance),
            "solves": statistics(optimum),
        },
        warnings=_warnings(table, numbers, second),
        timings={
            **optimum_timings({"complementarity": optimum}),
            "simulate": checked - simulated,
            "recheck": time.perf_counter() - checked,
        },
        attributes={"trackers": [_NAME]},
    )


def _replayed(optimum: Optimum, plant: Model, motion: Trajectory) -> Check:
    """Compare every state at every sample between optimiser and simulation."""
    sizes = nominal_of(plant.x)[:, None]
    exact = motion.states[: plant.n_x]
    apart = np.abs(optimum.motion.states(motion.time) - exact) / np.maximum(sizes, np.abs(exact))
    error = float(apart.max())
    advice = (
        f"the exact simulation of the input found ends elsewhere, by {error:.2g} of the "
        f"states' size, where {_ACCEPTED:.2g} is accepted; write more grid.arcs, or a "
        "smaller relaxation.last"
    )
    return Check("exact simulation of the input found", error, _ACCEPTED, advice)


def _scalars(
    table: TrackOptimalScene, numbers: dict[str, Any], optimum: Optimum, replayed: Check
) -> dict[str, Any]:
    objective, units = numbers["input_integral"], table.units
    unit = unit_of("effort", units)
    if isinstance(table.objective, LeastError):
        objective = numbers["error_integral"] + table.objective.input_weight * objective
        unit = unit_of("length_squared_time", units)
    return numbers | {
        "objective": Scalar(objective, unit),
        "objective_found": Scalar(optimum.objective, unit),
        "solve_iterations": optimum.iterations,
        "recheck_error": replayed.value,
    }


def _signals(table: TrackOptimalScene, gait: Gait, motion: Trajectory) -> dict[str, Any]:
    model = motion.system.model
    expressions = chain_expressions(model) | {"error_norm": model["error_norm"]}
    arrays = {name: values[None] for name, values in sample(motion, expressions).items()}
    arrays["tube"] = np.full((1, 1, len(motion.time)), table.tube.radius)
    return {
        "time": motion.time,
        "reference": motion["reference"],
        **fitted(arrays, table.variables),
        **event_arrays([motion], several=True),
        **gait_arrays(gait),
    }


def _warnings(
    table: TrackOptimalScene, numbers: dict[str, Any], second: CrossCheck | None
) -> Iterator[str]:
    if second is None:
        yield NOT_RECHECKED
    outside, peak = numbers["time_outside_tube"], numbers["error_peak"]
    if not isinstance(table.objective, LeastError) and outside > 0:
        yield (
            f"in the exact simulation the error is outside the tube for {outside:.3g} in total, "
            f"and reaches {peak:.6g}; write more grid.arcs or a larger objective.margin"
        )
