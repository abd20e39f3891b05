"""Runs scenes of kind ``fit``: parameters of a worm estimated from recordings of its motion."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SceneError, SolveError
from wormopt.fitting.estimate import Fit
from wormopt.fitting.fit import fit
from wormopt.fitting.inference.identifiability import Identifiability, identifiability
from wormopt.fitting.inference.posterior import Posterior, posterior
from wormopt.fitting.inference.prediction import Prediction, predict
from wormopt.fitting.inference.profile import Profile, profile
from wormopt.fitting.inference.whiteness import Whiteness, whiteness
from wormopt.fitting.task import FitTask
from wormopt.fitting.unknowns import Unknown
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.recorded.found import (
    Found,
    Number,
    label_of,
    markdown,
    told,
    unit_of_directions,
)
from wormopt.systems.recorded.recordings import Run, model_of, runs_of
from wormopt.systems.recorded.scenes.fit import FitScene, FitUnknown, PosteriorTable
from wormopt.systems.shared.proof import one_or_all
from wormopt.systems.shared.settings import treatment_of


@np.errstate(all="ignore")  # non-finite values are detected where they matter
def run(scene: Scene[FitScene], report: Report) -> Result:
    """Fit the model of the scene to its recordings, and judge the certainty of the estimates.

    The result is "failed" if the search did not converge. Raises SceneError for unusable
    recordings or models, SolveError if all starts fail, Interrupted with the best fit so far.
    """
    table, clock = scene.table, time.perf_counter()
    model = model_of(scene, table.model, table.which)
    runs = runs_of(table.recording, scene.folder, model, table.units, table.noise, scene.name)
    task = _task(scene, model, runs)
    read = time.perf_counter()
    try:
        found = fit(task, seeds=table.search.seeds, seed=table.search.seed, report=report)
    except Interrupted as stop:
        if not isinstance(stop.partial, Fit):
            raise Interrupted from None
        partial = _result(_Study(scene, model, runs, stop.partial), {})
        raise Interrupted(partial.failed("interrupted before all starts ended")) from None
    fitted = time.perf_counter()
    try:
        study = _judged(scene, model, runs, found, report)
    except SolveError as error:
        partial = _result(_Study(scene, model, runs, found), {})
        reason = f"the fit could not be assessed: {error.reason}"
        raise SolveError(reason, error.suggestion, partial=partial) from None
    except KeyboardInterrupt:
        partial = _result(_Study(scene, model, runs, found), {})
        raise Interrupted(partial.failed("interrupted before the fit was assessed")) from None
    timings = {"read": read - clock, "fit": fitted - read, "judge": time.perf_counter() - fitted}
    return _result(study, timings)


def _judged(
    scene: Scene[FitScene], model: Model, runs: Sequence[Run], found: Fit, report: Report
) -> _Study:
    """Identifiability, residual tests, and predictions of held-out runs."""
    table = scene.table
    report("assessing the fit", None)
    study = _Study(
        scene, model, runs, found, identifiability(found), whiteness(found),
        [predict(found, one.recording) for one in runs if not one.fitted],
    )  # fmt: skip
    if table.profiles:
        study = replace(study, profiles=profile(found, level=table.level, report=report))
    if table.posterior is not None:
        study = replace(study, drawn=_drawn(scene, table.posterior, found, report))
    return study


def _drawn(scene: Scene[FitScene], table: PosteriorTable, found: Fit, report: Report) -> Posterior:
    try:
        return posterior(
            found,
            draws=table.draws,
            chains=table.chains,
            seed=scene.table.search.seed,
            report=report,
        )
    except ArgumentError as error:
        raise SceneError(scene.name, [("posterior", str(error))]) from None


def _task(scene: Scene[FitScene], model: Model, runs: Sequence[Run]) -> FitTask:
    table = scene.table
    unknowns = [_unknown(scene, k, one, model) for k, one in enumerate(table.unknown)]
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
        raise SceneError(scene.name, [(f"unknown[{k}]", f"{error}{_own(model)}")]) from None
    return unknown


def _own(model: Model) -> str:
    """Advice for a function with arguments, which a Model without parameters does not show."""
    return "" if model.p else "; declare parameters to estimate in it: p = [Signal(...)]"


# -- the result ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Study:
    """A fit with its inputs and assessments."""

    scene: Scene[FitScene]
    model: Model
    runs: Sequence[Run]
    found: Fit
    known: Identifiability | None = None
    tests: Whiteness | None = None
    predictions: Sequence[Prediction] = ()
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    drawn: Posterior | None = None

    @property
    def numbers(self) -> Found:
        """Estimates in the form of results."""
        fit, units = self.found, self.scene.table.units
        table = [
            Number(c.name, unit_of_directions(self.model, c.directions, units), c.value(c.start))
            for c in fit.task.coordinates
        ]
        found = Found.of(table, fit.task, fit.theta, fit.covariance, self.scene.table.level)
        if not self.profiles:
            return found
        return replace(found, interval=np.array([self.profiles[n].interval for n in found.names]))


def _result(study: _Study, timings: Mapping[str, float]) -> Result:
    scene, numbers = study.scene, study.numbers
    return conclude(
        scene,
        numbers.scalars | _scalars(study),
        numbers.variables | {v.name: v for v in _seen(study)} | _profiles(study),
        checks=_checks(study),
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


def _checks(study: _Study) -> Iterator[Check]:
    found, drawn = study.found, study.drawn
    advice = f"the search did not converge: {found.reason}" if found.reason else ""
    yield Check("distance from the bottom", found.offset, 1.0, advice, found.converged)
    if drawn is not None:
        advice = f"the posterior samples are not reliable: {'; '.join(drawn.doubts)}"
        yield Check("doubts of the posterior", float(len(drawn.doubts)), 0.0, advice)


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
        "offset": found.offset,
        **_of_others(study),
        **_posterior_intervals(study),
        **{f"noise_{name}": _noise(study, name, sd) for name, sd in found.noise.items()},
    }


def _of_others(study: _Study) -> dict[str, Any]:
    """Scalars of predictions and profiles, if there are any."""
    ahead, held = study.predictions, [*study.profiles.values()]
    found = {"profile_threshold": held[0].threshold} if held else {}
    if ahead:
        found["prediction_coverage"] = one_or_all([one.coverage for one in ahead])
        found["prediction_chi2"] = one_or_all([one.chi2 / one.freedom for one in ahead])
    return found


def _posterior_intervals(study: _Study) -> dict[str, Scalar]:
    """Intervals of the parameters from the posterior samples, if there are any."""
    if study.drawn is None:
        return {}
    units = {number.name: number.unit for number in study.numbers.numbers}
    ends = zip(study.drawn.names, study.drawn.interval(study.scene.table.level), strict=True)
    return {
        f"{label_of(name)}_posterior": Scalar(pair.tolist(), units[name])
        for name, pair in ends
        if name in units
    }


def _noise(study: _Study, name: str, sd: float) -> Scalar:
    return Scalar(sd, told(_quantities(study.model)[name], study.scene.table.units))


def _quantities(model: Model) -> dict[str, str]:
    return {s.name: s.unit for s in (*model.outputs, *model.x)}


def _signals(study: _Study) -> list[str]:
    return sorted({name for one in study.runs for name in one.recording.values})


def _seen(study: _Study) -> list[Variable]:
    """Recordings, fits and residuals, (run, entry, sample), NaN where nothing was measured."""
    units, runs = study.scene.table.units, study.runs
    longest = max(len(one.recording.times) for one in runs)
    told_of = _told_of_runs(study)
    times = np.full((len(runs), longest), np.nan)
    for row, one in zip(times, runs, strict=True):
        row[: len(one.recording.times)] = one.recording.times
    found = [Variable("recorded_time", told("time", units), ("run", "sample"), times, "times")]
    for name in _signals(study):
        unit = told(_quantities(study.model)[name], units)
        size = max(len(r.get(name, ())) for what in told_of.values() for r in what)
        for what, (unit_of_it, words) in {
            "recorded": (unit, "readings"),
            "fitted": (unit, "fit or prediction"),
            "residual": ("1", "fit minus reading, over its standard deviation"),
            "band": (unit, "standard deviation of readings about the prediction"),
        }.items():
            array = np.full((len(runs), size, longest), np.nan)
            for whole, values in zip(array, told_of[what], strict=True):
                if name in values:
                    whole[:, : values[name].shape[1]] = values[name]
            if np.isfinite(array).any():
                dims = ("run", f"{name}_entry", "sample")
                found.append(
                    Variable(f"{what}_{name}", unit_of_it, dims, array, f"{name}: {words}")
                )
    return found


def _told_of_runs(study: _Study) -> dict[str, list[Mapping[str, np.ndarray]]]:
    """Readings, fit, residuals and band by signal of every run, in the order of the runs."""
    fit = study.found
    motions, weighed = (
        iter(fit.task.motions(fit.theta)),
        fit.task.split(fit.task.plain(fit.theta)[0]),
    )
    names, ahead = iter(fit.task.runs), iter(study.predictions)
    found: dict[str, list[Mapping[str, np.ndarray]]] = {
        what: [] for what in ("recorded", "fitted", "residual", "band")
    }
    for one in study.runs:
        readings = one.recording.readings
        found["recorded"].append(readings)
        if one.fitted:
            motion = next(motions)
            told_of_it = {name: motion[name] for name in readings}, weighed[next(names).name], {}
        elif study.predictions:
            own = next(ahead)
            left = {
                name: (own.values[name] - readings[name]) / own.error[name] for name in readings
            }
            told_of_it = own.values, left, own.error
        else:  # interrupted earlier
            told_of_it = {}, {}, {}
        for what, values in zip(("fitted", "residual", "band"), told_of_it, strict=True):
            found[what].append(values)
    return found


def _profiles(study: _Study) -> dict[str, np.ndarray]:
    if not study.profiles:
        return {}
    longest = max(len(one.values) for one in study.profiles.values())
    values, rises = np.full((2, len(study.profiles), longest), np.nan)
    for k, one in enumerate(study.profiles.values()):
        values[k, : len(one.values)], rises[k, : len(one.values)] = one.values, one.rises
    return {"profile_value": values, "profile_rise": rises}


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
        "residual_tests": [
            {"test": t.test, "run": t.run, "signal": t.signal, "statistic": t.statistic, "p": t.p}
            for t in (study.tests.tests if study.tests else ())
        ],
        "predictions": [
            {
                "run": one.recording.name,
                "coverage": one.coverage,
                "chi2": one.chi2,
                "freedom": one.freedom,
                "p": one.p,
            }
            for one in study.predictions
        ],
        "posterior": _facts_of(study.drawn),
        "derivatives": "exact, through every event",
        "columns_left_out": {o.recording.name: list(o.left_out) for o in study.runs if o.left_out},
        "recorded_drives": {o.recording.name: list(o.drives) for o in study.runs if o.drives},
    }


def _facts_of(drawn: Posterior | None) -> dict[str, Any] | None:
    if drawn is None:
        return None
    return {
        "draws": int(np.prod(drawn.draws.shape[:2])),
        "divergences": drawn.divergences,
        "r_hat": dict(zip(drawn.names, drawn.r_hat.tolist(), strict=True)),
        "effective": dict(zip(drawn.names, drawn.effective.tolist(), strict=True)),
    }


def _warnings(study: _Study) -> Iterator[str]:
    found = study.found
    for one in study.runs:
        yield from one.warnings
    yield from found.warnings
    for judged in (study.known, study.tests, *study.predictions, *study.profiles.values()):
        yield from () if judged is None else judged.words
