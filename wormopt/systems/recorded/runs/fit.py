"""Scenes of kind ``fit``: numbers of a worm found from recordings of its motion."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SceneError
from wormopt.fitting.estimate import Fit
from wormopt.fitting.fit import fit
from wormopt.fitting.identifiability import Identifiability, identifiability
from wormopt.fitting.task import FitTask
from wormopt.fitting.unknowns import Unknown
from wormopt.kinds import KINDS
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.quantities import UNITS, Scalar, Variable, unit_of
from wormopt.result import Check, Result
from wormopt.scene.conclude import conclude
from wormopt.scene.scene import Scene
from wormopt.systems.recorded.found import Found, Number, label_of, markdown
from wormopt.systems.recorded.recordings import Run, runs_of
from wormopt.systems.recorded.scenes.fit import FitScene, FitUnknown
from wormopt.systems.recorded.scenes.tables import near, scene_of
from wormopt.systems.shared.settings import treatment_of


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[FitScene], report: Report) -> Result:
    """Fit the model of the scene to its recordings, and tell how well its numbers are known.

    Status "failed" where the search did not converge. Raises SceneError for unusable recordings
    or models, SolveError if no start leads anywhere, Interrupted with the best fit so far.
    """
    table, clock = scene.table, time.perf_counter()
    model = model_of(scene)
    runs = runs_of(
        table.recordings, scene.folder, model, table.units, table.noise, scene.name
    )
    task = _task(scene, model, runs)
    read = time.perf_counter()
    try:
        found = fit(task, seeds=table.search.seeds, seed=table.search.seed, report=report)
    except Interrupted as stop:
        if not isinstance(stop.partial, Fit):
            raise Interrupted from None
        partial = _result(_Study(scene, model, runs, stop.partial), {})
        raise Interrupted(partial.failed("interrupted before all starts were done")) from None
    fitted = time.perf_counter()
    report("what the recordings tell", None)
    study = _Study(scene, model, runs, found, identifiability(found))
    timings = {"read": read - clock, "fit": fitted - read, "judge": time.perf_counter() - fitted}
    return _result(study, timings)


def model_of(scene: Scene[FitScene]) -> Model:
    """Build the Model of the scene in ``[model]``; SceneError if it has none."""
    table = scene.table
    inner = scene_of(_with_time(table), scene.folder, table.units)
    models_of = getattr(KINDS[inner.table.kind].load_study(), "models_of", None)
    if models_of is None:
        what = f'scenes of kind "{inner.table.kind}" have no Model that recordings could be'
        hint = 'take one of kind "simulate", "track" or "magnetic-pair"'
        raise SceneError(scene.name, [("model.kind", f"{what} compared with; {hint}")])
    try:
        models = models_of(inner)
    except SceneError as error:
        faults = [(f"model.{key}" if key else "model", what) for key, what in error.faults]
        raise SceneError(scene.name, faults) from None
    if table.which not in models and (table.which or len(models) > 1):
        there = near(table.which, models)
        raise SceneError(scene.name, [("which", f"the scene has several models; {there}")])
    return models[table.which] if table.which in models else next(iter(models.values()))


def _with_time(table: FitScene) -> dict[str, Any]:
    """Tables of the model; a scene of kind "simulate" in them needs no end of its own."""
    if table.model.get("kind") == "simulate" and "time" not in table.model:
        return {**table.model, "time": {"end": 1.0}}
    return table.model


def _task(scene: Scene[FitScene], model: Model, runs: Sequence[Run]) -> FitTask:
    table = scene.table
    unknowns = [_unknown(scene, k, one, model) for k, one in enumerate(table.unknowns)]
    recordings = [one.recording for one in runs if one.fitted]
    try:
        return FitTask(
            model,
            recordings,
            unknowns,
            contact=treatment_of(table.contact),
            loss=table.loss,
        )
    except ArgumentError as error:
        raise SceneError(scene.name, [("unknown", str(error))]) from None


def _unknown(scene: Scene[FitScene], k: int, table: FitUnknown, model: Model) -> Unknown:
    try:
        unknown = Unknown(
            table.name,
            table.targets,
            lower=table.lower,
            upper=table.upper,
            start=table.start,
            prior=table.prior,  # pyright: ignore[reportArgumentType]  two numbers, as checked
            per_run=table.per_run,
            log=table.log,
        )
        unknown.directions(model)
    except ArgumentError as error:
        raise SceneError(scene.name, [(f"unknown[{k}]", str(error))]) from None
    return unknown


# -- what is told ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Study:
    """A fit, and what it was made of."""

    scene: Scene[FitScene]
    model: Model
    runs: Sequence[Run]
    found: Fit
    known: Identifiability | None = None

    @property
    def numbers(self) -> Found:
        """Numbers found, as results tell them."""
        fit, units = self.found, self.scene.table.units
        table = [
            Number(c.name, unit_of_directions(self.model, c.directions, units), c.value(c.start))
            for c in fit.task.coordinates
        ]
        return Found.of(table, fit.task, fit.theta, fit.covariance, self.scene.table.level)


def unit_of_directions(model: Model, directions: Mapping[str, np.ndarray], units: str) -> str:
    """Unit of a number that signals follow, "1" where theirs are not one."""
    signals = {s.name: s.unit for s in (*model.x, *model.p, *model.u)}
    found = {told(signals.get(name, "1"), units) for name in directions}
    return found.pop() if len(found) == 1 else "1"


def told(unit: str, units: str) -> str:
    """Unit of a signal: that of its quantity, or its own."""
    if unit in UNITS:
        return unit_of(unit, units)
    return unit if units == "SI" else "1"


def _result(study: _Study, timings: Mapping[str, float]) -> Result:
    scene, found, numbers = study.scene, study.found, study.numbers
    seen = _seen(study)
    return conclude(
        scene,
        numbers.scalars | _scalars(study),
        numbers.variables + seen,
        checks=_checks(found),
        facts=_facts(study),
        warnings=_warnings(study),
        timings=timings,
        attributes={
            "unknowns": list(numbers.names),
            "unknown_units": [number.unit for number in numbers.numbers],
            "runs": [one.recording.name for one in study.runs],
            "uses": [one.use for one in study.runs],
            "signals": _signals(study),
            "table": markdown(numbers, scene.table.level),
        },
    )


def _checks(found: Fit) -> Iterator[Check]:
    advice = f"the search has not converged: {found.reason}" if found.reason else ""
    yield Check("distance from the bottom", found.offset, 1.0, advice, found.converged)


def _scalars(study: _Study) -> dict[str, Any]:
    found, task = study.found, study.found.task
    return {
        "n_readings": task.count,
        "n_unknowns": len(found.theta),
        "rank": None if study.known is None else study.known.rank,
        "cost": found.cost,
        "chi2_per_reading": float(np.mean(found.residuals[: task.count] ** 2)),
        "n_starts": len(found.starts),
        "n_agreeing": sum(attempt.agrees for attempt in found.starts),
        "gradient": found.offset,
        **{f"noise_{name}": _noise(study, name, sd) for name, sd in found.noise.items()},
    }


def _noise(study: _Study, name: str, sd: float) -> Scalar:
    return Scalar(sd, told(_quantities(study.model)[name], study.scene.table.units))


def _quantities(model: Model) -> dict[str, str]:
    return {s.name: s.unit for s in (*model.outputs, *model.x)}


def _signals(study: _Study) -> list[str]:
    return sorted({name for one in study.runs for name in one.recording.values})


def _seen(study: _Study) -> list[Variable]:
    """Recordings, fits and weighted residuals, (run, entry, sample), NaN where there is nothing."""
    fit, units = study.found, study.scene.table.units
    fitted = [one for one in study.runs if one.fitted]
    motions = dict(zip((id(one) for one in fitted), fit.task.motions(fit.theta), strict=True))
    weighed = fit.task.split(fit.task.plain(fit.theta)[0])
    longest = max(len(one.recording.times) for one in study.runs)
    whole = (len(study.runs), longest)
    times = np.full(whole, np.nan)
    for k, one in enumerate(study.runs):
        times[k, : len(one.recording.times)] = one.recording.times
    found = [Variable("recorded_time", told("time", units), ("run", "sample"), times, "times")]
    for name in _signals(study):
        size = next(len(o.recording.readings[name]) for o in study.runs if name in o.recording.values)
        arrays = {what: np.full((whole[0], size, whole[1]), np.nan)
                  for what in ("recorded", "fitted", "residual")}  # fmt: skip
        for k, one in enumerate(study.runs):
            count = len(one.recording.times)
            if name in one.recording.readings:
                arrays["recorded"][k, :, :count] = one.recording.readings[name]
                if one.fitted:
                    arrays["residual"][k, :, :count] = weighed[one.recording.name][name]
            if id(one) in motions:
                arrays["fitted"][k, :, :count] = motions[id(one)][name]
        unit = told(_quantities(study.model)[name], units)
        words = {"recorded": "readings", "fitted": "the fit", "residual": "fit less reading, over noise"}
        found += [
            Variable(
                f"{what}_{name}", "1" if what == "residual" else unit,
                ("run", f"{name}_entry", "sample"), array, f"{name}: {words[what]}",
            )
            for what, array in arrays.items()
        ]  # fmt: skip
    return found


def _facts(study: _Study) -> dict[str, Any]:
    found, known = study.found, study.known
    return {
        "converged": found.converged,
        "starts": [
            {
                "start": attempt.start,
                "end": attempt.theta,
                "cost": attempt.cost,
                "evaluations": attempt.evaluations,
                "agrees": attempt.agrees,
            }
            for attempt in found.starts
        ],
        "noise_estimated": list(found.estimated),
        "at_bound": list(found.at_bound),
        "not_told_apart": [] if known is None else list(known.words),
        "derivatives": "exact, through every event",
        "columns_left_out": {o.recording.name: list(o.left_out) for o in study.runs if o.left_out},
        "recorded_drives": {o.recording.name: list(o.drives) for o in study.runs if o.drives},
    }


def _warnings(study: _Study) -> Iterator[str]:
    found = study.found
    for one in study.runs:
        yield from one.warnings
    yield from found.warnings
    if study.known is not None:
        yield from study.known.words
    yield from (f"{name} is at its bound" for name in found.at_bound)
