"""Runs scenes of kind "fit-design": fit a worm, design a gait for it, test it on the worm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, Fault, SceneError, SolveError
from wormopt.fitting.estimate import Fit
from wormopt.fitting.fit import fit
from wormopt.fitting.recording import Recording
from wormopt.fitting.task import FitTask
from wormopt.fitting.unknowns import Unknown
from wormopt.progress import Report
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Check, Result
from wormopt.study.scene import Scene
from wormopt.systems.recorded.recordings import Run, runs_of
from wormopt.systems.recorded.scenes.fit_design import (
    FORCES,
    NO_FORCE,
    CrawlRecording,
    FitDesignScene,
)
from wormopt.systems.spiked import (
    Believed,
    Crawl,
    Findings,
    Robust,
    Search,
    design_believed,
    designed,
    driven_worm,
    gait_of_shape,
    load_band,
    of_design,
    on_plant,
    refused,
)

# A limit on the plant holds if it is exceeded by no more than this share.
_ACCEPTED = 1e-9


def run(scene: Scene[FitDesignScene], report: Report) -> Result:
    """Fit, design and test; SolveError if no gait meets the limits."""
    table, clock = scene.table, perf_counter()
    runs = _runs(scene)
    fitted = _fit(scene, runs, report)
    found = Findings(timings={"fit": perf_counter() - clock}) | _of_fit(table, fitted, runs)
    if not fitted.converged:
        return (found | _not_converged(fitted)).result(scene)
    believed = believed_of(fitted, table)
    clock = perf_counter()
    try:
        robust = _design(table, believed, report)
    except SolveError as error:
        raise refused(error, scene) from None
    gait = of_design(table, robust.design)
    found |= Findings(gait.scalars, gait.variables, gait.checks, gait.facts, gait.warnings)
    found |= _of_design(table, robust, believed)
    found |= Findings(timings={"design": perf_counter() - clock})
    if table.plant is not None:
        found |= _of_plant(table, robust, believed, report)
    return found.result(scene)


# -- the fit ---------------------------------------------------------------------------------------


def _runs(scene: Scene[FitDesignScene]) -> list[Run]:
    """Recordings, each with the Model driven by its gait; SceneError lists all faults."""
    found, faults = list[Run](), list[Fault]()
    for k, recording in enumerate(scene.table.recording):
        key = f"recording[{k}]"
        try:
            found.append(_run(scene, recording, key))
        except SceneError as error:
            faults += [(where.replace("recording[0]", key), what) for where, what in error.faults]
        except ArgumentError as error:
            faults.append((key, str(error)))
    if not faults and not any(name in run.recording.readings for run in found for name in FORCES):
        faults.append(("recording", NO_FORCE))
    if faults:
        raise SceneError(scene.name, faults)
    return found


def _run(scene: Scene[FitDesignScene], recording: CrawlRecording, key: str) -> Run:
    """One recording, which starts at time 0 with the worm at rest."""
    worm = scene.table.worm
    gait = gait_of_shape(recording.gait, scene, f"{key}.gait")
    try:
        model = driven_worm(gait, worm.masses, worm.drag, worm.load_range[0])
    except ArgumentError as error:
        raise SceneError(scene.name, [(f"{key}.gait", str(error))]) from None
    (one,) = runs_of([recording], scene.folder, model, scene.table.units, {}, scene.name)
    read = one.recording
    begun = replace(read, model=read.model or model, span=(0.0, float(read.times[-1])))
    return replace(one, recording=begun)


def _fit(scene: Scene[FitDesignScene], runs: Sequence[Run], report: Report) -> Fit:
    asked = scene.table.fit
    recordings: list[Recording] = [run.recording for run in runs if run.fitted]
    model = recordings[0].model
    assert model is not None
    unknowns = [Unknown(name) for name in asked.numbers]
    try:
        task = FitTask(model, recordings, unknowns, noise=asked.noise or None)
    except ArgumentError as error:
        raise SceneError(scene.name, [("fit", str(error))]) from None
    return fit(task, seeds=asked.seeds, seed=asked.seed, report=report)


def believed_of(fitted: Fit, table: FitDesignScene) -> Believed:
    """Masses, drag and load from the fit or the scene, with their covariance."""
    worm = table.worm
    names = [*(f"mass[{i}]" for i in range(len(worm.masses))), "drag", "load"]
    numbers = np.array([*worm.masses, worm.drag, worm.load_range[0]])
    at = [names.index(name) for name in fitted.names]
    numbers[at] = fitted.values
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(at, at)] = fitted.covariance
    freedom = fitted.task.count - len(at) if fitted.estimated else np.inf
    mass = tuple(numbers[:-2].tolist())
    return Believed(mass, float(numbers[-2]), float(numbers[-1]), covariance, freedom)


def _of_fit(table: FitDesignScene, fitted: Fit, runs: Sequence[Run]) -> Findings:
    believed = believed_of(fitted, table)
    errors = np.sqrt(np.diag(believed.covariance))
    scalars = {
        "mass_found": list(believed.mass),
        "mass_error": errors[:-2].tolist(),
        "drag_found": believed.drag,
        "drag_error": float(errors[-2]),
        "load_found": believed.load,
        "load_error": float(errors[-1]),
        "n_readings": fitted.task.count,
    }
    told = {
        "converged": fitted.converged,
        "starts": [
            {"cost": start.cost, "agrees": start.agrees, "evaluations": start.evaluations}
            for start in fitted.starts
        ],
        "noise": dict(fitted.noise),
        "noise_estimated": list(fitted.estimated),
        "at_bound": list(fitted.at_bound),
        "left_out": {run.recording.name: list(run.left_out) for run in runs if run.left_out},
    }
    warnings = (*fitted.warnings, *(line for run in runs for line in run.warnings))
    return Findings(scalars, _readings(fitted), facts={"fit": told}, warnings=warnings)


def _readings(fitted: Fit) -> dict[str, np.ndarray]:
    """Recorded and fitted actuator forces, run by run."""
    times, numbers, read, again = [], [], [], []
    for k, (run, motion) in enumerate(
        zip(fitted.task.runs, fitted.task.motions(fitted.theta), strict=True)
    ):
        force = motion["actuator_force"]
        times.append(run.times)
        numbers.append(np.full(len(run.times), k, dtype=np.int32))
        read.append(run.readings.get("actuator_force", np.full(force.shape, np.nan)))
        again.append(force)
    return {
        "reading_time": np.concatenate(times),
        "reading_run": np.concatenate(numbers),
        "read_force": np.concatenate(read, axis=1),
        "fitted_force": np.concatenate(again, axis=1),
    }


def _not_converged(fitted: Fit) -> Findings:
    advice = f"the fit did not converge: {fitted.reason}"
    return Findings(checks=(Check("fit", fitted.offset, 0.0, advice, passed=False),))


# -- the design ------------------------------------------------------------------------------------


def _design(table: FitDesignScene, believed: Believed, report: Report) -> Robust:
    objective = table.objective
    return design_believed(
        believed, table.limits, objective, table.confidence, table.search, report
    )


def _of_design(table: FitDesignScene, robust: Robust, believed: Believed) -> Findings:
    design = robust.design
    time, load, error = load_band(design, believed, robust.reach)
    value, quantity = design.value, design.task.objective.quantity
    scalars = {
        "objective": Scalar(value, unit_of(quantity, table.units)),
        "confidence": table.confidence,
        "reach": robust.reach,
        "load_width": robust.width,
        "load_width_needed": robust.needed,
        "speed_if_known": robust.nominal.speed,
    }
    told = {
        "rule": "Scheffe: with this confidence all parameters lie in one ellipsoid, and all limits "
        "hold at all times for all parameters in it, if the model is correct",
        "designs": robust.rounds,
    }
    return Findings(
        scalars,
        {"band_time": time, "band_load": load, "band_error": error},
        facts={"robust": told},
    )


def _of_plant(
    table: FitDesignScene, robust: Robust, believed: Believed, report: Report
) -> Findings:
    """Motion of the gait on the real worm, compared with the best gait for that worm."""
    plant, clock = table.plant_worm, perf_counter()
    assert plant is not None
    motion, bold = on_plant(robust.design, plant), on_plant(robust.nominal, plant)
    task = robust.nominal.task.vary(worm=plant)
    known = Search(sequence=robust.nominal.sequence, workers=table.search.workers)
    best = designed(task, known, report)
    true = np.array([*plant.masses, plant.drag, plant.load_range[0]])
    scalars = {
        "plant_speed": motion.speed,
        "plant_spike_load_max": motion.extremes("reaction")[1].max(),
        "plant_spike_load_bold": bold.extremes("reaction")[1].max(),
        "plant_best": best.speed,
        "plant_share": motion.speed / best.speed,
        "plant_distance": believed.distance(true),
    }
    variables = {
        "plant_time": motion.time,
        "plant_load": motion["reaction"].max(axis=0),
        "bold_time": bold.time,
        "bold_load": bold["reaction"].max(axis=0),
    }
    return Findings(
        scalars,
        variables,
        tuple(_checks_of_plant(table, motion)),
        timings={"plant": perf_counter() - clock},
    )


def _checks_of_plant(table: FitDesignScene, motion: Crawl) -> Iterator[Check]:
    limits: dict[str, Any] = {
        "spike_load": ("reaction", table.gait.spike_load),
        "actuator_force": ("actuator_force", table.gait.actuator_force),
    }
    for key, (signal, most) in limits.items():
        if most is None:
            continue
        low, high = motion.extremes(signal)
        over = float(np.max(np.maximum(np.abs(low), np.abs(high)) / np.asarray(most))) - 1.0
        advice = (
            f"on the plant gait.{key} is exceeded by {over:.2g} of its value: the plant's "
            "parameters lie outside the ellipsoid, or the model does not describe the plant"
        )
        yield Check(f"gait.{key} on the plant", max(over, 0.0), _ACCEPTED, advice)
    glides = float(len(motion.glides))
    yield Check("glides on the plant", glides, 0.0, "the worm glides on the plant")
