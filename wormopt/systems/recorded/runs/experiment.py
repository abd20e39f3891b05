"""Runs scenes of kind ``experiment``: the experiment that identifies the parameters best."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, Interrupted, SceneError
from wormopt.fitting.choices import Choice, Constant, base_of
from wormopt.fitting.courses import Ramps, Waves
from wormopt.fitting.experiment import Experiment
from wormopt.fitting.information import Criterion
from wormopt.fitting.planned import mean_rate
from wormopt.fitting.planning import Plan, plan_experiment
from wormopt.fitting.unknowns import Unknown
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.recorded.found import label_of, told, unit_of_directions
from wormopt.systems.recorded.recordings import model_of
from wormopt.systems.recorded.scenes.experiment import (
    ExperimentScene,
    HeldTable,
    RampsTable,
    WavesTable,
)
from wormopt.systems.shared.settings import treatment_of

# Largest accepted difference of the criterion by the second route, and violation of limits.
_AGREED, _KEPT = 1e-4, 1e-6
_LINEAR = 0.1  # departure from linear measurements without warning, in standard errors
_SHOWN = 1001  # times at which results contain the inputs


@np.errstate(all="ignore")  # non-finite values are detected where they matter
def run(scene: Scene[ExperimentScene], report: Report) -> Result:
    """Plan the experiment; the result is "failed" if the second route finds another criterion.

    Raises SceneError for unusable models and names, SolveError if no experiment identifies the
    wanted parameters, Interrupted with the best experiment so far.
    """
    table, clock = scene.table, time.perf_counter()
    known = _Known.of(scene)
    experiment, criterion = _experiment(scene, known)
    search = table.search
    try:
        plan = plan_experiment(
            experiment,
            criterion,
            rivals=search.rivals,
            starts=min(search.starts, search.rivals),
            seed=search.seed,
            report=report,
        )
    except Interrupted as stop:
        if not isinstance(stop.partial, Plan):
            raise Interrupted from None
        partial = _result(scene, stop.partial, {})
        raise Interrupted(partial.failed("interrupted before all searches ended")) from None
    return _result(scene, plan, {"plan": time.perf_counter() - clock})


# -- the task -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Known:
    """Estimates of a fit, with their covariance."""

    names: tuple[str, ...] = ()
    value: np.ndarray = field(default_factory=lambda: np.zeros(0))
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, scene: Scene[ExperimentScene]) -> _Known:
        """Read the result of a fit, if the scene names one."""
        if scene.table.known is None:
            return cls()
        path = scene.folder / scene.table.known
        try:
            found = Result.load(path)
            names = tuple(found.attributes["unknowns"])
            errors = np.asarray(found["standard_error"].values)
            correlation = np.asarray(found["correlation"].values)
            value = np.asarray(found["estimate"].values)
        except (OSError, ValueError, KeyError) as error:
            what = f'"{scene.table.known}" is not a result of a scene of kind "fit" ({error})'
            raise SceneError(scene.name, [("known", what)]) from None
        lost = ~np.isfinite(errors)
        covariance = np.where(np.isfinite(correlation), correlation, 0.0) * np.outer(
            np.where(lost, 0.0, errors), np.where(lost, 0.0, errors)
        )
        covariance[lost, lost] = np.inf
        return cls(names, value, covariance)

    def value_of(self, name: str) -> float | None:
        """Estimate of that name; None if there is none."""
        return float(self.value[self.names.index(name)]) if name in self.names else None

    def among(self, names: Sequence[str], slopes: np.ndarray) -> np.ndarray | None:
        """Covariance of coordinates from d(parameter)/d(coordinate); infinite if unknown."""
        if not self.names:
            return None
        found = np.diag(np.full(len(names), np.inf))
        mine = [k for k, name in enumerate(names) if name in self.names]
        theirs = [self.names.index(names[k]) for k in mine]
        inner = self.covariance[np.ix_(theirs, theirs)]
        found[np.ix_(mine, mine)] = inner / np.outer(slopes[mine], slopes[mine])
        return found


def _experiment(scene: Scene[ExperimentScene], known: _Known) -> tuple[Experiment, Criterion]:
    table = scene.table
    unknowns = [
        Unknown(
            one.name,
            one.targets,
            prior=None if one.prior is None else (0.0, one.prior),
            log=one.log,
        )
        for one in table.unknown
    ]
    try:
        own = model_of(scene, table.model, table.which)
        model = _best(scene, own, unknowns, known)
        experiment = Experiment(
            model,
            unknowns,
            table.measured,
            np.arange(1, table.time.samples + 1) * table.time.end / table.time.samples,
            [_choice(model, one, table.time.end) for one in table.choose],
            {name: _ends(ends) for name, ends in table.limits.items()},
            contact=treatment_of(table.contact),
        )
        covariance = known.among(experiment.names, _slopes(experiment))
        experiment = replace(experiment, known=covariance)
        experiment.driven  # noqa: B018  raises for inputs that cannot be moved
        return experiment, _criterion(scene, experiment, unknowns, known)
    except ArgumentError as error:
        raise SceneError(scene.name, [("", str(error))]) from None


def _slopes(experiment: Experiment) -> np.ndarray:
    """Derivative of each parameter by its coordinate, for example its logarithm."""
    pairs = zip(experiment.unknowns_of, experiment.values, strict=True)
    return np.array([value if unknown.log else 1.0 for unknown, value in pairs])


def _best(
    scene: Scene[ExperimentScene], model: Model, unknowns: Sequence[Unknown], known: _Known
) -> Model:
    """The model with the best known values."""
    signals = {s.name: s for s in (*model.x, *model.p, *model.u)}
    for table, unknown in zip(scene.table.unknown, unknowns, strict=True):
        given = None if table.value is None else np.ravel(table.value)
        for k, (name, directions) in enumerate(unknown.directions(model)):
            value = known.value_of(name) if given is None else given[min(k, len(given) - 1)]
            if value is None:
                continue
            for signal, direction in directions.items():
                own = np.broadcast_to(np.asarray(signals[signal].value, float), direction.shape)
                moved = np.where(direction != 0, value * direction, own)
                signals[signal] = replace(signals[signal], value=tuple(moved.tolist()))
    return replace(
        model,
        x=[signals[s.name] for s in model.x],
        p=[signals[s.name] for s in model.p],
        u=[signals[s.name] for s in model.u],
    )


def _choice(model: Model, table: RampsTable | WavesTable | HeldTable, end: float) -> Choice:
    base = base_of(model, table.signal)
    if isinstance(table, HeldTable):
        low, high = table.range
        return Constant(table.signal, low, high, (1.0,) * len(base))
    rate = np.inf if table.rate is None else table.rate
    if isinstance(table, RampsTable):
        return Ramps(table.signal, base, end, table.pieces, table.change, rate)
    frequency = table.frequency
    if isinstance(frequency, tuple):
        frequency = (frequency[0], frequency[1])
    return Waves(table.signal, base, frequency, table.harmonics, table.change, rate)


def _ends(ends: Sequence[float | str]) -> tuple[float, float]:
    low, high = ends
    return (
        -np.inf if isinstance(low, str) else low,
        np.inf if isinstance(high, str) else high,
    )


def _criterion(
    scene: Scene[ExperimentScene],
    experiment: Experiment,
    unknowns: Sequence[Unknown],
    known: _Known,
) -> Criterion:
    table = scene.table
    if table.prediction is None:
        return experiment.criterion(table.criterion, _wanted(scene, experiment))
    model = _best(scene, model_of(scene, table.prediction.model, ""), unknowns, known)
    first, last = table.prediction.span
    return mean_rate(experiment, model, table.prediction.output, (first, last))


def _wanted(scene: Scene[ExperimentScene], experiment: Experiment) -> list[str]:
    wanted = {one.name for one in scene.table.unknown if one.wanted}
    pairs = zip(experiment.names, experiment.unknowns_of, strict=True)
    return [name for name, unknown in pairs if unknown.name in wanted]


# -- the result -----------------------------------------------------------------------------------


def _result(scene: Scene[ExperimentScene], plan: Plan, timings: Mapping[str, float]) -> Result:
    experiment, units = plan.experiment, scene.table.units
    slopes = np.abs(_slopes(experiment))
    model = experiment.model
    return conclude(
        scene,
        _scalars(scene, plan) | _numbers(plan, slopes, units),
        _arrays(plan, slopes) | {v.name: v for v in _signals(plan, units)},
        checks=_checks(plan),
        facts=_facts(plan),
        warnings=_warnings(plan),
        timings=timings,
        attributes={
            "unknowns": list(experiment.names),
            "wanted": _wanted(scene, experiment),
            "unknown_units": [
                unit_of_directions(model, directions, units)
                for directions in experiment.directions.values()
            ],
            "courses": [choice.signal for choice in experiment.choices],
            "limits": {name: list(ends) for name, ends in scene.table.limits.items()},
        },
    )


def _scalars(scene: Scene[ExperimentScene], plan: Plan) -> dict[str, Any]:
    best, middle = plan.rivals[0], plan.rivals[len(plan.rivals) // 2]
    found = {
        "shrinkage": plan.shrinks(best.known),
        "shrinkage_median": plan.shrinks(middle.known),
        "criterion": plan.value,
        "criterion_recheck": plan.recheck,
        "excess": plan.excess,
        "departure": plan.departure if np.isfinite(plan.departure) else None,
        "rank": plan.known.rank,
    }
    if scene.table.prediction is not None:
        found["prediction_error"] = float(np.exp(plan.value))
        found["prediction_error_random"] = float(np.exp(best.value))
    return found


def _numbers(plan: Plan, slopes: np.ndarray, units: str) -> dict[str, Scalar]:
    """Expected standard error of every unknown, and the chosen constants."""
    model, found = plan.experiment.model, {}
    errors = plan.known.errors * slopes
    for (name, directions), error in zip(plan.experiment.directions.items(), errors, strict=True):
        unit = unit_of_directions(model, directions, units)
        finite = float(error) if np.isfinite(error) else None
        found[f"{label_of(name)}_error"] = Scalar(finite, unit)
    signals = {s.name: s.unit for s in (*model.p, *model.u)}
    for choice, part in plan.experiment.chosen.parts(plan.chosen):
        for name, value in choice.explained(part).items():
            quantity = "rate" if name.endswith("_frequency") else signals[choice.signal]
            found[f"chosen_{label_of(name)}"] = Scalar(value, told(quantity, units))
    return found


def _arrays(plan: Plan, slopes: np.ndarray) -> dict[str, np.ndarray]:
    experiment, best = plan.experiment, plan.rivals[0].known
    arrays = {
        "value": experiment.values,
        "error_before": experiment.prior.errors * slopes,
        "error": plan.known.errors * slopes,
        "error_random": best.errors * slopes,
        "covariance": plan.known.covariance * np.outer(slopes, slopes),
        "covariance_random": best.covariance * np.outer(slopes, slopes),
        "rival_criterion": np.array([rival.value for rival in plan.rivals]),
        "rival_error": np.array([rival.known.errors * slopes for rival in plan.rivals]),
        "start_criterion": np.array(plan.ends),
    }
    return {name: array for name, array in arrays.items() if array.size}


def _signals(plan: Plan, units: str) -> Iterator[Variable]:
    """Inputs, and measured or limited signals, over time."""
    experiment = plan.experiment
    instants = np.linspace(0.0, float(experiment.instants[-1]), _SHOWN)
    yield Variable("time", told("time", units), ("time",), instants, "time")
    own = {s.name: s.unit for s in (*experiment.model.p, *experiment.model.u)}
    for choice, part in experiment.chosen.parts(plan.chosen):
        name, course = choice.signal, choice.course(part, instants)
        dims = f"course_{name}_entry", "time"
        yield Variable(f"course_{name}", told(own[name], units), dims, course, f"input {name}")
    quantities = {s.name: s.unit for s in (*experiment.model.x, *experiment.model.outputs)}
    motion = experiment.motion(plan.chosen, instants)
    shown: list[str] = [*experiment.measured, *(experiment.limits or {})]
    for name in sorted(set(shown)):
        dims = f"{name}_entry", "time"
        yield Variable(name, told(quantities[name], units), dims, motion[name], name)


def _checks(plan: Plan) -> Iterator[Check]:
    off = abs(plan.recheck - plan.value)
    advice = f"the second route finds another criterion, by {off:.2g}; loosen limits of the inputs"
    yield Check("second route", off, _AGREED, advice)
    over = float(np.maximum(plan.excess, 0.0))  # slack is no fault; keeps NaN
    advice = f"a limit is exceeded by {over:.2g} of its value; widen it, or increase pieces"
    yield Check("limits", over, _KEPT, advice)


def _facts(plan: Plan) -> dict[str, Any]:
    return {
        "derivatives": "exact, through every event",
        "search": "SLSQP from the best random experiments",
        "not_told_apart": [words(unseen) for unseen in plan.known.unseen],
        "doubts": len(plan.run.motion.nonsmooth_events),
    }


def words(unseen: Mapping[str, float]) -> str:
    """A combination of unknowns without effect, in words."""
    return " ".join(f"{share:+.3g} {name}" for name, share in unseen.items())


def _warnings(plan: Plan) -> Iterator[str]:
    for unseen in plan.known.unseen:
        yield f"the experiment does not identify {words(unseen)}: no measurement depends on it"
    doubts = plan.run.motion.nonsmooth_events
    if doubts:
        first = doubts[0]
        yield f"derivatives are one-sided: {first.reason}; expected errors may be wrong"
    if plan.departure > _LINEAR:
        told = (
            f"{plan.departure:.2g} standard errors"
            if np.isfinite(plan.departure)
            else "an unknown amount"
        )
        yield (
            f"measurements depart from linearity by {told} within two standard errors: expected "
            "errors may be wrong; plan again after the fit"
        )
    if plan.value >= plan.rivals[0].value:
        yield "the search found no better experiment than the best random one"


def as_csv(result: Result) -> str | None:
    """Text of ``course.csv``, the inputs over time for the actuators; None without inputs."""
    courses = list(result.attributes.get("courses", ()))
    if not courses or "time" not in result:
        return None
    columns, heads = [result["time"].values], [f"time{_unit(result['time'].unit)}"]
    for name in courses:
        course = result[f"course_{name}"]
        for k, row in enumerate(course.values):
            columns.append(row)
            heads.append(f"{name}[{k}]{_unit(course.unit)}")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([repr(float(value)) for value in row] for row in np.transpose(columns))
    return text.getvalue()


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" [{unit}]"
