"""Kind "fit": parameters of a worm estimated from recordings of its motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field, structs

from wormopt.errors import ArgumentError, Fault, Interrupted, SceneError
from wormopt.quantities import Scalar, Variable, unit_of_signal
from wormopt.result import Check
from wormopt.study import (
    Given,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalar,
    scalars,
    stage,
    warnings,
    whole,
)
from wormopt.study.members import NotComputedError
from wormopt.study.numerics import Contacts, ExactContact
from wormopt.study.types import Positive, Seed
from wormopt.systems.recorded.found import Found, checks_of_noise, label_of, unit_of_directions
from wormopt.systems.recorded.recordings import RecordingFile, Run, model_of, runs_of
from wormopt.systems.recorded.tables import (
    FromScene,
    Level,
    Parameter,
    Which,
    named_twice,
    scene_of,
)
from wormopt.systems.shared.studies import refused_at

with on_use():
    import numpy as np

    from wormopt.fitting.estimate import Fit
    from wormopt.fitting.fit import fit
    from wormopt.fitting.identifiability import Identifiability, identifiability
    from wormopt.fitting.noise import Whiteness, whiteness
    from wormopt.fitting.posterior import Posterior, posterior
    from wormopt.fitting.prediction import Prediction, predict
    from wormopt.fitting.profile import Profile, profile
    from wormopt.fitting.task import FitTask
    from wormopt.fitting.unknowns import Unknown
    from wormopt.model.model import Model
    from wormopt.systems.shared.proof import one_or_all

Names = Annotated[
    str | tuple[str, ...],
    Meta(description="the name of a signal, or a list of them"),
]


class FitUnknown(Parameter):
    """A parameter of the model to estimate.

    It is a parameter, an input or the initial value of a state, by its name in the Model. All
    entries are estimated, or a single one, for example `stiffness[0]`.
    """

    targets: Names | None = entry(
        "signals and entries that all equal this parameter; default: its name", default=None
    )
    per_run: bool = entry(
        "true: separate values for each run, as usual for initial states", default=False
    )


class Starts(Given):
    """Starts of the search for the best fit."""

    seeds: int = whole(
        1,
        1000,
        "largest number of starts: the given one, and others spread around it within the "
        "bounds; the search ends once three starts have ended at the best fit",
        default=6,
    )
    seed: Seed = entry("seed of the random spread of the starts", quantity="count", default=0)


class Draws(Given):
    """Samples of the posterior distribution of the parameters, drawn by NUTS.

    Needs `pip install 'wormopt[bayes]'`. Results contain `NAME_posterior`, the interval of the
    samples.
    """

    draws: int = whole(100, 100000, "samples per chain after adaptation", default=1000)
    chains: int = whole(2, 16, "number of chains", default=4)


class FitRecordings(FromScene, kind="fit"):
    """Estimate parameters from recordings of a motion, with confidence intervals.

    The scene contains a model from another scene, `[model]`; one or more `[[recording]]`, each a
    file; and the parameters to estimate, `[[unknown]]`. The fit is a weighted least-squares fit
    with exact contact. Guide: [fitting](../fitting.md).

    Results contain the estimate of every parameter as a scalar of its name, with its standard error
    and interval (`NAME_error`, `NAME_interval`). Arrays over `unknown` follow the names in the
    attribute `unknowns`. Recordings, fits and residuals over time are NaN where nothing was
    measured.

    The trust report states whether the search converged and how every start ended (`starts`); which
    parameters cannot be distinguished (`not_identifiable`, in words); whether the residuals are
    white and as large as the noise (`residuals`); and how far held-out runs are from their
    prediction (`prediction`).

    Refused, with line and column: text instead of numbers; times that decrease or are missing;
    lines of different lengths; units that do not fit their signals. Exit code 3: the search did not
    converge, or residuals are more than three times as large as the noise given.
    """

    pictures: ClassVar = {
        "recordings": "data, fit and residuals",
        "parameters": "estimates with intervals",
        "correlation": "of the errors",
        "profiles": "needs `profiles = true`",
        "prediction": "held-out runs",
    }
    table_file = True

    which: Which = ""
    recording: tuple[RecordingFile, ...] = entry("recorded runs of the worm")
    unknown: tuple[FitUnknown, ...] = entry("parameters to estimate")
    noise: dict[str, Positive] = entry(
        "known standard deviation of readings of each signal, `{position = 0.001}`; the "
        "others are estimated",
        default=dict,
    )
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = entry(
        "`linear`: least squares; the others are robust to outliers", default="linear"
    )
    contact: Contacts = field(default_factory=ExactContact)
    search: Starts = entry("the search", default=Starts)
    level: Level = entry("confidence of the intervals", quantity="share", default=0.95)
    profiles: bool = entry(
        "compute intervals by refits with each parameter held, not from the curvature",
        default=False,
    )
    posterior: Draws | None = entry("sample the posterior", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults between keys, and faults in the files."""
        for key in ("recording", "unknown"):
            if not getattr(self, key):
                yield key, f"no entry is given; write a table [[{key}]]"
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        declared: Mapping[str, tuple[str, tuple[str, ...], str]] = {}
        try:
            inner = scene_of(self.model, self.folder, self.units).table
        except SceneError as error:
            yield from error.faults
        else:  # signals of an own model have any quantities
            declared = {} if getattr(inner, "model", None) else inner.variables
        for k, recording in enumerate(self.recording):
            for key, what in recording.faults_in(self.folder, self.units, declared):
                yield f"recording[{k}].{key}", what
        yield from named_twice((one.label for one in self.recording), "recording")
        yield from self._faults_of_wants()

    def _faults_of_wants(self) -> Iterator[Fault]:
        uses = [recording.use for recording in self.recording]
        if uses and "fit" not in uses:
            yield "recording", 'all have use = "predict"; write use = "fit" for at least one'
        if "prediction" in self.want and "predict" not in uses:
            yield (
                "want",
                '"prediction" is given without a held-out run; write use = "predict" for one',
            )
        if "profiles" in self.want and not self.profiles:
            yield "want", '"profiles" is given without profiles = true; write profiles = true'

    # -- the fit -----------------------------------------------------------------------------------

    @cached_property
    def fitted_model(self) -> Model:
        """Model of the scene in `[model]`."""
        return model_of(self.model, self.which, self)

    @stage
    def reading(self) -> list[Run]:
        return runs_of(
            self.recording, self.folder, self.fitted_model, self.units, self.noise, self.name
        )

    @cached_property
    def task(self) -> FitTask:
        """The fit of the Model to all runs that are not held out."""
        runs, model = self.reading, self.fitted_model
        unknowns: list[Unknown] = []
        for k, table in enumerate(self.unknown):
            try:
                unknown = Unknown(**structs.asdict(table))
                unknown.directions(model)
            except ArgumentError as error:
                # a function with arguments, which a Model without parameters does not show
                hint = "; declare parameters to estimate in it: p = [Signal(...)]"
                what = f"{error}{'' if model.p else hint}"
                raise SceneError(self.name, [(f"unknown[{k}]", what)]) from None
            unknowns.append(unknown)
        recordings = [run.recording for run in runs if run.fitted]
        contact = self.contact.options
        with refused_at(self, "unknown"):
            return FitTask(model, recordings, unknowns, contact=contact, loss=self.loss)

    @stage
    def estimation(self) -> Fit:
        task, search = self.task, self.search
        try:
            return fit(task, seeds=search.seeds, seed=search.seed, report=self.report)
        except Interrupted as stop:
            if isinstance(stop.partial, Fit):
                return stop.partial
            raise

    @property
    def is_complete(self) -> bool:
        """Whether all starts of the search ended."""
        return self.estimation.reason != "interrupted"

    def stopped(self) -> str:
        """Why the search did not end."""
        return "" if self.is_complete else "interrupted before all starts ended"

    # -- its assessment ----------------------------------------------------------------------------

    @stage
    def identification(self) -> Identifiability:
        return identifiability(self.estimation)

    @stage
    def residual_tests(self) -> Whiteness:
        return whiteness(self.estimation)

    @stage
    def predictions(self) -> list[Prediction]:
        found = self.estimation
        return [predict(found, run.recording) for run in self.reading if not run.fitted]

    @stage
    def profiling(self) -> Mapping[str, Profile]:
        if not self.profiles:
            return {}
        return profile(self.estimation, level=self.level, report=self.report)

    @stage
    def sampling(self) -> Posterior | None:
        if (given := self.posterior) is None:
            return None
        found, seed = self.estimation, self.search.seed
        with refused_at(self, "posterior"):
            return posterior(
                found, draws=given.draws, chains=given.chains, seed=seed, report=self.report
            )

    def _assessed(self, stage: str) -> Any:
        """Result of a stage of the assessment, None in partial results without it."""
        with suppress(NotComputedError):
            return getattr(self, stage) if self.is_complete else None
        return None

    @property
    def has_predictions(self) -> bool:
        """Whether held-out runs are predicted."""
        return self.is_complete and bool(self.predictions)

    @property
    def has_profiles(self) -> bool:
        """Whether intervals are those of profiles."""
        return self.is_complete and bool(self.profiling)

    # -- results -----------------------------------------------------------------------------------

    @scalar("count", "number of fitted readings")
    def n_readings(self) -> int:
        return self.estimation.task.count

    @scalar("count", "number of estimated parameters")
    def n_unknowns(self) -> int:
        return len(self.estimation.theta)

    @scalar(
        "count",
        "number of parameters, or combinations of them, that are identifiable",
        when="is_complete",
    )
    def rank(self) -> int:
        return self.identification.rank

    @scalar("1", "half the sum of the squared weighted residuals")
    def cost(self) -> float:
        return self.estimation.cost

    @scalar("1", "mean square of the residuals relative to the noise: 1 if the noise is estimated")
    def chi2_per_reading(self) -> float:
        return float(np.mean(self.estimation.residuals[: self.n_readings] ** 2))

    @scalar("count", "number of starts of the search")
    def n_starts(self) -> int:
        return len(self.estimation.starts)

    @scalar("count", "number of starts that ended at the same estimates")
    def n_agreeing(self) -> int:
        return sum(attempt.agrees for attempt in self.estimation.starts)

    @scalar("1", "distance of the end of the search from the minimum, in standard errors")
    def offset(self) -> float:
        return self.estimation.offset

    @scalar(
        "share",
        "share of readings of a held-out run within the 95 % band of its prediction; a list "
        "if there are several runs. It is 95 % on average over many fits; a single fit may "
        "differ",
        when="has_predictions",
    )
    def prediction_coverage(self) -> Any:
        return one_or_all([one.coverage for one in self.predictions])

    @scalar(
        "1",
        "mean square of readings about the prediction, relative to its expectation: about 1",
        when="has_predictions",
    )
    def prediction_chi2(self) -> Any:
        return one_or_all([one.chi2 / one.freedom for one in self.predictions])

    @scalar("1", "rise of χ² at the ends of the intervals", when="has_profiles")
    def profile_threshold(self) -> float:
        return next(iter(self.profiling.values())).threshold

    @parts(Found)
    def found(self) -> Found:
        fitted, model = self.estimation, self.fitted_model
        sought = fitted.task.coordinates
        units = [unit_of_directions(model, one.directions, self.units) for one in sought]
        began = [one.value(one.start) for one in sought]
        found = Found.of(
            fitted.names, units, began, fitted.task, fitted.theta, fitted.covariance, self.level
        )
        if held := self._assessed("profiling"):
            return replace(found, interval=np.array([held[name].interval for name in found.names]))
        return found

    @scalars({})
    def estimates(self) -> dict[str, Scalar]:
        return self.found.scalars

    @scalars({})
    def posterior_intervals(self) -> dict[str, Scalar]:
        if (drawn := self._assessed("sampling")) is None:
            return {}
        units = dict(zip(self.found.names, self.found.units, strict=True))
        return {
            f"{label_of(name)}_posterior": Scalar(pair.tolist(), units[name])
            for name, pair in zip(drawn.names, drawn.interval(self.level), strict=True)
            if name in units
        }

    @cached_property
    def signal_units(self) -> dict[str, str]:
        """Units of outputs and states."""
        model = self.fitted_model
        return {s.name: unit_of_signal(s.unit, self.units) for s in (*model.outputs, *model.x)}

    @scalars({})
    def noise_levels(self) -> dict[str, Scalar]:
        noise = self.estimation.noise.items()
        return {f"noise_{name}": Scalar(sd, self.signal_units[name]) for name, sd in noise}

    @arrays(
        {
            "profile_value": (
                "count",
                ("unknown", "profile"),
                "value at which a parameter is held",
            ),
            "profile_rise": ("count", ("unknown", "profile"), "twice the rise of the cost there"),
        },
        when="has_profiles",
    )
    def profile_curves(self) -> dict[str, np.ndarray]:
        held = self.profiling.values()
        return {
            "profile_value": _joined([one.values for one in held]),
            "profile_rise": _joined([one.rises for one in held]),
        }

    @cached_property
    def signals(self) -> list[str]:
        """Names of recorded signals."""
        return sorted({name for run in self.reading for name in run.recording.values})

    @arrays({})
    def seen(self) -> dict[str, Variable]:
        """Recordings, fits and residuals, (run, entry, sample), NaN where nothing was measured."""
        fitted = of_fitted_runs(self.estimation)
        ahead = iter(self._assessed("predictions") or ())
        runs = [
            next(fitted) if run.fitted else of_held_out_run(run, next(ahead, None))
            for run in self.reading
        ]
        times = [run.recording.times for run in self.reading]
        dims, unit = ("run", "sample"), unit_of_signal("time", self.units)
        found = {"recorded_time": Variable("recorded_time", unit, dims, _joined(times), "times")}
        for signal in self.signals:
            unit = self.signal_units[signal]
            size = max(len(rows.get(signal, ())) for run in runs for rows in run.values())
            shape = len(runs), size, len(found["recorded_time"].values[0])
            for what, (unit_of_it, words) in {
                "recorded": (unit, "readings"),
                "fitted": (unit, "fit or prediction"),
                "residual": ("1", "fit minus reading, over its standard deviation"),
                "band": (unit, "standard deviation of readings about the prediction"),
            }.items():
                values = np.full(shape, np.nan)
                for whole_run, run in zip(values, runs, strict=True):
                    if signal in run[what]:
                        whole_run[:, : run[what][signal].shape[1]] = run[what][signal]
                if np.isfinite(values).any():
                    name, dims = f"{what}_{signal}", ("run", f"{signal}_entry", "sample")
                    found[name] = Variable(name, unit_of_it, dims, values, f"{signal}: {words}")
        return found

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def verdicts(self) -> Iterator[Check]:
        found = self.estimation
        advice = f"the search did not converge: {found.reason}" if found.reason else ""
        yield Check("distance from the bottom", found.offset, 1.0, advice, found.converged)
        yield from checks_of_noise(found)
        if drawn := self._assessed("sampling"):
            advice = f"the posterior samples are not reliable: {'; '.join(drawn.doubts)}"
            yield Check("doubts of the posterior", float(len(drawn.doubts)), 0.0, advice)

    @warnings
    def doubts(self) -> Iterator[str]:
        for run in self.reading:
            yield from run.warnings
        yield from self.estimation.warnings
        if self.is_complete:
            held = self.profiling.values()
            for one in (self.identification, self.residual_tests, *self.predictions, *held):
                yield from one.words

    @facts
    def evidence(self) -> dict[str, Any]:
        found, runs = self.estimation, self.reading
        known, tests = self._assessed("identification"), self._assessed("residual_tests")
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
            "not_identifiable": list(known.words) if known else [],
            "residual_tests": [asdict(test) for test in tests.tests] if tests else [],
            "predictions": [
                {
                    "run": one.recording.name,
                    "coverage": one.coverage,
                    "chi2": one.chi2,
                    "freedom": one.freedom,
                    "p": one.p,
                }
                for one in self._assessed("predictions") or ()
            ],
            "posterior": _facts_of(self._assessed("sampling")),
            "derivatives": "exact, through every event",
            "columns_left_out": {r.recording.name: list(r.left_out) for r in runs if r.left_out},
            "recorded_drives": {r.recording.name: list(r.drives) for r in runs if r.drives},
        }

    @attributes
    def shown(self) -> dict[str, Any]:
        return {
            "unknowns": list(self.found.names),
            "unknown_units": list(self.found.units),
            "runs": [run.recording.name for run in self.reading],
            "uses": [run.use for run in self.reading],
            "signals": self.signals,
            "table": self.found.markdown(self.level),
        }


Rows = dict[str, Mapping[str, "np.ndarray"]]
"""Readings ("recorded"), "fitted" values, "residual" and "band" of a run by signal, (size, m)."""


def of_fitted_runs(found: Fit) -> Iterator[Rows]:
    """Yield readings, fit and residuals of every fitted run."""
    task = found.task
    residuals = task.split(found.plain[0])
    for run, motion in zip(task.runs, task.motions(found.theta), strict=True):
        fitted = {name: motion[name] for name in run.readings}
        yield {
            "recorded": run.readings,
            "fitted": fitted,
            "residual": residuals[run.name],
            "band": {},
        }


def of_held_out_run(run: Run, ahead: Prediction | None) -> Rows:
    """Give readings, prediction, residuals and band of a held-out run; None: not predicted."""
    read = run.recording.readings
    if ahead is None:
        return {"recorded": read, "fitted": {}, "residual": {}, "band": {}}
    off = {name: (ahead.values[name] - read[name]) / ahead.error[name] for name in read}
    return {"recorded": read, "fitted": ahead.values, "residual": off, "band": ahead.error}


def _joined(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Rows of different lengths as one array, NaN beyond their ends."""
    found = np.full((len(rows), max(map(len, rows))), np.nan)
    for whole_row, row in zip(found, rows, strict=True):
        whole_row[: len(row)] = row
    return found


def _facts_of(drawn: Posterior | None) -> dict[str, Any] | None:
    if drawn is None:
        return None
    return {
        "draws": int(np.prod(drawn.draws.shape[:2])),
        "divergences": drawn.divergences,
        "r_hat": dict(zip(drawn.names, drawn.r_hat.tolist(), strict=True)),
        "effective": dict(zip(drawn.names, drawn.effective.tolist(), strict=True)),
    }
