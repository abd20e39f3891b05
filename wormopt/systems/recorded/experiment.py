"""Kind "experiment": the experiment that identifies the parameters of a worm best."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import msgspec
from msgspec import Meta

from wormopt.errors import Fault, Interrupted, SceneError
from wormopt.quantities import Scalar, Variable, unit_of_signal
from wormopt.result import Result
from wormopt.study import (
    Given,
    arrays,
    attributes,
    check,
    entry,
    facts,
    on_use,
    parts,
    positive,
    scalar,
    scalars,
    signal,
    stage,
    warnings,
    whole,
)
from wormopt.study.numerics import Contacts, ExactContact
from wormopt.study.types import Finite, Positive, PositiveOrPair, Seed, Title, wrong_order
from wormopt.systems.recorded.tables import (
    FiniteOrList,
    FromScene,
    SceneTables,
    Span,
    Which,
    named_twice,
    scene_of,
)
from wormopt.systems.shared.studies import refused_at

with on_use():
    import numpy as np

    from wormopt.fitting.choices import Choice, Constant, Ramps, Waves, base_of
    from wormopt.fitting.experiment import Experiment, mean_rate
    from wormopt.fitting.information import Criterion
    from wormopt.fitting.planning import Plan, plan_experiment
    from wormopt.fitting.unknowns import Unknown
    from wormopt.model.model import Model
    from wormopt.systems.recorded.found import label_of, unit_of_directions
    from wormopt.systems.recorded.recordings import model_of

# Largest accepted difference of the criterion by the second route, and violation of limits.
_AGREED, _KEPT = 1e-4, 1e-6
_LINEAR = 0.1  # departure from linear measurements without warning, in standard errors
_SHOWN = 1001  # times at which results contain the inputs

Name = Annotated[str, Meta(description="the name of a signal")]
Range = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [smallest, largest]"),
]
End = Annotated[
    tuple[Finite | Literal["free"], ...],
    Meta(min_length=2, max_length=2, description='[smallest, largest], numbers or "free"'),
]


class ExperimentUnknown(Given):
    """A parameter of the model that is unknown or not known well enough."""

    name: Title = entry("name of the parameter in results")
    targets: (
        Annotated[str | tuple[str, ...], Meta(description="the name of a signal, or a list")] | None
    ) = entry("signals and entries that all equal this parameter; default: its name", default=None)
    value: FiniteOrList | None = entry(
        "best known value; default: that of `known`, or of `[model]`", default=None
    )
    prior: float | None = positive(
        "",
        "its standard error before the experiment; with `log`, that of its logarithm",
        default=None,
    )
    log: bool = entry("use errors of the logarithm, which are relative errors", default=False)
    wanted: bool = entry(
        "true: estimate it as well as possible; false: a nuisance parameter", default=True
    )

    @property
    def unknown(self) -> Unknown:
        """The parameter as an engine object."""
        prior = None if self.prior is None else (0.0, self.prior)
        return Unknown(self.name, self.targets, prior=prior, log=self.log)


class MovedInput(Given, tag_field="shape"):
    """Keys common to all input signals that vary in time."""

    signal: Name = entry("an input or a parameter, for example `rest_length`")
    change: float = positive("", "largest change from the initial value, up or down")
    rate: float | None = positive("", "largest rate of change; default: unlimited", default=None)

    @property
    def largest_rate(self) -> float:
        """Largest rate of change, infinite if unlimited."""
        return math.inf if self.rate is None else self.rate


class RampsInput(MovedInput, tag="ramps"):
    """An input that is linear between equidistant knots and starts at the model's value."""

    pieces: int = whole(1, 200, "number of linear pieces over the whole run")

    def choice(self, model: Model, end: float) -> Choice:
        """Make the input of a model for a run that ends at `end`."""
        base = base_of(model, self.signal)
        return Ramps(self.signal, base, end, self.pieces, self.change, self.largest_rate)


class WavesInput(MovedInput, tag="waves"):
    """An input with a few harmonics that starts at the model's value."""

    harmonics: int = whole(1, 20, "number of harmonics")
    frequency: PositiveOrPair = entry(
        "frequency of the first harmonic; a range is optimised", quantity="rate"
    )

    def choice(self, model: Model, end: float) -> Choice:
        """Make the input of a model."""
        given: Any = self.frequency
        frequency = (given[0], given[1]) if isinstance(given, tuple) else given
        base = base_of(model, self.signal)
        return Waves(self.signal, base, frequency, self.harmonics, self.change, self.largest_rate)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a reversed range of frequencies."""
        if isinstance(self.frequency, tuple):
            yield from wrong_order("frequency", self.frequency, may_be_equal=True)


class HeldInput(Given, tag_field="shape", tag="held"):
    """A constant to choose, the same for all entries of the signal, for example a load."""

    signal: Name = entry("an input or a parameter")
    range: Range = entry("range of the constant, [smallest, largest]")

    def choice(self, model: Model, end: float) -> Choice:
        """Make the constant of a model."""
        low, high = self.range
        return Constant(self.signal, low, high, (1.0,) * len(base_of(model, self.signal)))

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield an empty range."""
        yield from wrong_order("range", self.range, may_be_equal=False)


class Duration(Given):
    """Duration of the run and times of its measurements."""

    end: float = positive("time", "end of the run, which starts at 0")
    samples: int = whole(2, 100000, "number of equidistant measurement times, the last at the end")


class Predicted(Given):
    """A prediction that the parameters serve: the mean rate of a signal in another motion."""

    model: SceneTables
    output: Name = entry(
        "state or output whose mean rate is predicted; for a position, its speed",
        default="center_of_mass",
    )
    span: Span = entry("start and end of the averaging in that motion", quantity="time")

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield an empty span."""
        yield from wrong_order("span", self.span, may_be_equal=False)


class Search(Given):
    """Search for the best experiment."""

    rivals: int = whole(
        1, 1000, "number of random experiments within the limits, for comparison", default=20
    )
    starts: int = whole(1, 1000, "number of the best of them from which searches start", default=3)
    seed: Seed = entry("seed of the random numbers", quantity="count", default=0)


@dataclass(frozen=True, eq=False)
class Known:
    """Estimates of a fit, with their covariance."""

    names: tuple[str, ...] = ()
    value: np.ndarray = field(default_factory=lambda: np.zeros(0))
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, result: Result) -> Known:
        """Estimates in the result of a fit; KeyError if it is another result."""
        names = tuple(result.attributes["unknowns"])
        errors, correlation, value = (
            np.asarray(result[name].values)
            for name in ("standard_error", "correlation", "estimate")
        )
        lost = ~np.isfinite(errors)
        finite = np.where(lost, 0.0, errors)
        covariance = np.where(np.isfinite(correlation), correlation, 0.0)
        covariance *= np.outer(finite, finite)
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


@dataclass(frozen=True)
class Expected:
    """Errors of the parameters before and after the experiment, and after random ones."""

    value: np.ndarray = signal("1", "unknown", "best values known before, each in its own unit")
    error_before: np.ndarray = signal("1", "unknown", "standard errors before, infinite if unknown")
    error: np.ndarray = signal("1", "unknown", "expected standard errors after the experiment")
    error_random: np.ndarray = signal(
        "1", "unknown", "expected errors after the best random experiment"
    )
    covariance: np.ndarray = signal(
        "1", "unknown unknown_too", "expected covariance after the experiment"
    )
    covariance_random: np.ndarray = signal(
        "1", "unknown unknown_too", "expected covariance after the best random experiment"
    )
    rival_criterion: np.ndarray = signal("1", "rival", "criterion of each random experiment")
    rival_error: np.ndarray = signal("1", "rival unknown", "standard errors after each of them")
    start_criterion: np.ndarray | None = signal("1", "start", "criterion at the end of each search")


class PlannedExperiment(FromScene, kind="experiment"):
    """Plan the experiment that identifies the parameters of a worm best.

    The information of an experiment is the Fisher information of its measurements, plus what is
    known before. It uses exact derivatives of the motion, through sticking and slipping, and the
    noise. Guide: [fitting](../fitting.md#what-to-measure-next).

    Limits on inputs hold at all times. Limits along the motion are checked at 4000 times or more.
    Results contain the expected standard error of every unknown before and after the experiment,
    the input signals (`course_<signal>`, and `course.csv` for the actuators), the limited and
    measured signals over time, and the random experiments, best first.

    Searches end where masses are about to stick or to slip, and there the derivatives hold on one
    side only. The planned experiment is therefore moved aside to one with nearly linear
    measurements in the unknowns within two standard errors. A warning reports if none was found.

    The trust report contains the criterion recomputed by the Python integrator with a hundredth of
    the tolerance, and the largest violation of a limit. Exit code 3: the two values disagree, a
    limit is violated, or no experiment identifies the wanted parameters. The message then names the
    parameters that cannot be distinguished.
    """

    headline: ClassVar = ("shrinkage", "shrinkage_median", "prediction_error")
    pictures: ClassVar = {
        "course": "inputs and motion",
        "errors": "standard errors before and after, with those of random experiments",
        "regions": "confidence ellipses of pairs of wanted parameters",
    }
    exports: ClassVar = {"course.csv": "wormopt.systems.recorded.experiment:as_csv"}

    which: Which = ""
    known: str | None = entry(
        "folder of a result of kind `fit`, relative to the scene's folder; its estimates and "
        "their covariance are used for unknowns of the same names",
        default=None,
    )
    unknown: tuple[ExperimentUnknown, ...] = entry("unknown parameters")
    measured: dict[str, Positive] = entry(
        "standard deviation of measurements of each signal, `{position = 0.001}`"
    )
    choose: tuple[RampsInput | WavesInput | HeldInput, ...] = entry(
        "inputs to choose; `shape` selects the other keys"
    )
    limits: dict[str, End] = entry(
        'limits of states and outputs along the motion, `{length = [1.4, "free"]}`', default=dict
    )
    time: Duration = entry("duration and measurement times")
    criterion: Literal["D", "A"] = entry(
        "`D`: volume of the confidence region of the wanted parameters; `A`: sum of the "
        "squares of their relative errors. A `[prediction]` replaces both",
        default="D",
    )
    prediction: Predicted | None = entry("prediction to improve", default=None)
    contact: Contacts = msgspec.field(default_factory=ExactContact)
    search: Search = entry("the search", default=Search)

    def faults_of_keys(self) -> Iterator[Fault]:
        for key in ("unknown", "choose", "measured"):
            if not getattr(self, key):
                yield key, f"no entry is given; write at least one in [{key}]"
        if self.unknown and not any(unknown.wanted for unknown in self.unknown):
            yield "unknown", "wanted is false for all unknowns; remove wanted = false from one"
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        for name, (low, high) in self.limits.items():
            if isinstance(low, float) and isinstance(high, float):
                yield from wrong_order(f"limits.{name}", (low, high), may_be_equal=False)
            elif low == high:
                yield f"limits.{name}", 'both ends are "free"; write a number, or remove the key'
        if self.known is not None and not os.path.exists(self.folder / self.known):  # noqa: PTH110  as there
            what = f'"{self.known}" does not exist in {self.folder}'
            yield "known", f'{what}; run the scene of kind "fit"'
        for key, tables in (
            ("model", self.model),
            ("prediction.model", self.prediction and self.prediction.model),
        ):
            try:
                if tables:
                    scene_of(tables, self.folder, self.units, key)
            except SceneError as error:
                yield from error.faults

    # -- the task ----------------------------------------------------------------------------------

    @cached_property
    def estimates(self) -> Known:
        """Estimates of a fit, if the scene names its result."""
        if self.known is None:
            return Known()
        try:
            return Known.of(Result.load(self.folder / self.known))
        except (OSError, ValueError, KeyError) as error:
            what = f'"{self.known}" is not a result of a scene of kind "fit" ({error})'
            raise SceneError(self.name, [("known", what)]) from None

    def with_best_values(self, model: Model) -> Model:
        """Model with the best known values of the unknown parameters."""
        signals = {s.name: s for s in (*model.x, *model.p, *model.u)}
        for table in self.unknown:
            given = None if table.value is None else np.ravel(table.value)
            for k, (name, directions) in enumerate(table.unknown.directions(model)):
                own = self.estimates.value_of(name)
                value = own if given is None else given[min(k, len(given) - 1)]
                if value is None:
                    continue
                for key, direction in directions.items():
                    before = np.asarray(signals[key].value, float)
                    moved = np.where(direction != 0, value * direction, before)
                    signals[key] = replace(signals[key], value=tuple(moved.tolist()))
        return replace(
            model,
            x=[signals[s.name] for s in model.x],
            p=[signals[s.name] for s in model.p],
            u=[signals[s.name] for s in model.u],
        )

    @cached_property
    def experiment(self) -> Experiment:
        """What may be chosen, and what is measured; ArgumentError if it does not fit the model."""
        model = self.with_best_values(model_of(self.model, self.which, self))
        end, samples = self.time.end, self.time.samples
        experiment = Experiment(
            model,
            [one.unknown for one in self.unknown],
            self.measured,
            np.arange(1, samples + 1) * end / samples,
            [one.choice(model, end) for one in self.choose],
            {name: _ends(ends) for name, ends in self.limits.items()},
            contact=self.contact.options,
        )
        known = self.estimates.among(experiment.names, _slopes(experiment))
        experiment = replace(experiment, known=known)
        experiment.driven  # noqa: B018  raises for inputs that cannot be moved
        return experiment

    @property
    def wanted_names(self) -> list[str]:
        """Names of the wanted parameters, entry by entry."""
        wanted = {one.name for one in self.unknown if one.wanted}
        pairs = zip(self.experiment.names, self.experiment.unknowns_of, strict=True)
        return [name for name, unknown in pairs if unknown.name in wanted]

    @cached_property
    def minimised(self) -> Criterion:
        """The criterion of experiments."""
        if (table := self.prediction) is None:
            return self.experiment.criterion(self.criterion, self.wanted_names)
        model = self.with_best_values(model_of(table.model, "", self, "prediction.model"))
        return mean_rate(self.experiment, model, table.output, (table.span[0], table.span[1]))

    @stage
    def planning(self) -> tuple[Plan, str]:
        """The best plan, and why the search ended early."""
        with refused_at(self, ""):
            experiment, criterion = self.experiment, self.minimised
        rivals, starts = self.search.rivals, min(self.search.starts, self.search.rivals)
        try:
            plan = plan_experiment(
                experiment, criterion, rivals=rivals, starts=starts, seed=self.search.seed,
                report=self.report,
            )  # fmt: skip
        except Interrupted as stop:
            if isinstance(stop.partial, Plan):
                return stop.partial, "interrupted before all searches ended"
            raise
        return plan, ""

    @property
    def plan(self) -> Plan:
        """The best experiment."""
        return self.planning[0]

    def stopped(self) -> str:
        """Why the search ended early."""
        return self.planning[1]

    # -- results -----------------------------------------------------------------------------------

    @scalar(
        "1",
        "factor by which the confidence region of the wanted parameters is smaller than after "
        'the best random experiment: its volume, or its mean size for criterion "A"',
    )
    def shrinkage(self) -> float:
        return self.plan.shrinks(self.plan.rivals[0].known)

    @scalar("1", "`shrinkage` relative to the median random experiment")
    def shrinkage_median(self) -> float:
        rivals = self.plan.rivals
        return self.plan.shrinks(rivals[len(rivals) // 2].known)

    @scalar("1", "logarithm of the mean relative error of the wanted parameters", name="criterion")
    def reached(self) -> float:
        return self.plan.value

    @scalar("1", "the criterion by the second route")
    def criterion_recheck(self) -> float:
        return self.plan.recheck

    @scalar("share", "largest violation of a limit, negative if no limit is reached")
    def excess(self) -> float:
        return self.plan.excess

    @scalar(
        "1",
        "departure of the measurements from linearity within two standard errors, in standard "
        "errors; a warning reports large values",
    )
    def departure(self) -> float | None:
        return self.plan.departure if np.isfinite(self.plan.departure) else None

    @scalar("1", "standard error of the prediction, in its own unit", when="prediction")
    def prediction_error(self) -> float:
        return float(np.exp(self.plan.value))

    @scalar("1", "`prediction_error` after the best random experiment", when="prediction")
    def prediction_error_random(self) -> float:
        return float(np.exp(self.plan.rivals[0].value))

    @scalar("count", "number of unknowns, or combinations of them, that are identifiable")
    def rank(self) -> int:
        return self.plan.known.rank

    @parts(Expected)
    def expected(self) -> Expected:
        return expected(self.plan)

    @cached_property
    def unknown_units(self) -> dict[str, str]:
        """Unit of every unknown."""
        model, directions = self.plan.experiment.model, self.plan.experiment.directions
        return {
            name: unit_of_directions(model, one, self.units) for name, one in directions.items()
        }

    @scalars({})
    def errors(self) -> dict[str, Scalar]:
        return {
            f"{label_of(name)}_error": Scalar(float(error) if np.isfinite(error) else None, unit)
            for (name, unit), error in zip(
                self.unknown_units.items(), self.expected.error, strict=True
            )
        }

    @scalars({})
    def constants(self) -> dict[str, Scalar]:
        return {
            f"chosen_{label_of(name)}": Scalar(
                value,
                unit_of_signal("rate", self.units)
                if name.endswith("_frequency")
                else self.signal_units[choice.signal],
            )
            for choice, part in self.plan.experiment.chosen.parts(self.plan.chosen)
            for name, value in choice.explained(part).items()
        }

    @cached_property
    def signal_units(self) -> dict[str, str]:
        """Units of the signals of the model."""
        model = self.plan.experiment.model
        return {
            s.name: unit_of_signal(s.unit, self.units)
            for s in (*model.x, *model.outputs, *model.p, *model.u)
        }

    @arrays({"time": ("time", ("time",), "time")})
    def signals(self) -> dict[str, Any]:
        plan, units = self.plan, self.signal_units
        experiment = plan.experiment
        times = np.linspace(0.0, experiment.end, _SHOWN)
        found: dict[str, Any] = {"time": times}
        for choice, part in experiment.chosen.parts(plan.chosen):
            name, values = f"course_{choice.signal}", choice.over_time(part, times)
            dims = f"{name}_entry", "time"
            found[name] = Variable(
                name, units[choice.signal], dims, values, f"input {choice.signal}"
            )
        motion = experiment.motion(plan.chosen, times)
        for name in sorted({*self.measured, *self.limits}):
            dims = f"{name}_entry", "time"
            found[name] = Variable(name, units[name], dims, motion[name], name)
        return found

    # -- trust -------------------------------------------------------------------------------------

    @check(
        _AGREED,
        "the second route finds another criterion, by {value:.2g}; loosen limits of the inputs",
        name="second route",
    )
    def second_route(self) -> float:
        return abs(self.plan.recheck - self.plan.value)

    @check(
        _KEPT,
        "a limit is exceeded by {value:.2g} of its value; widen it, or increase pieces",
        name="limits",
    )
    def limits_kept(self) -> float:
        return float(np.maximum(self.plan.excess, 0.0))  # slack is no fault; keeps NaN

    @warnings
    def doubts(self) -> Iterator[str]:
        plan = self.plan
        for unseen in plan.known.unseen:
            yield f"the experiment does not identify {words(unseen)}: no measurement depends on it"
        if one_sided := plan.run.motion.nonsmooth_events:
            first = one_sided[0].reason
            yield f"derivatives are one-sided: {first}; expected errors may be wrong"
        if plan.departure > _LINEAR:
            size = "an unknown amount"
            if np.isfinite(plan.departure):
                size = f"{plan.departure:.2g} standard errors"
            yield (
                f"measurements depart from linearity by {size} within two standard errors: "
                "expected errors may be wrong; plan again after the fit"
            )
        if plan.value >= plan.rivals[0].value:
            yield "the search found no better experiment than the best random one"

    @facts
    def evidence(self) -> dict[str, Any]:
        return {
            "derivatives": "exact, through every event",
            "search": "SLSQP from the best random experiments",
            "not_identifiable": [words(unseen) for unseen in self.plan.known.unseen],
            "doubts": len(self.plan.run.motion.nonsmooth_events),
        }

    @attributes
    def shown(self) -> dict[str, Any]:
        return {
            "unknowns": [*self.unknown_units],
            "wanted": self.wanted_names,
            "unknown_units": [*self.unknown_units.values()],
            "courses": [choice.signal for choice in self.plan.experiment.choices],
            "limits": {name: list(ends) for name, ends in self.limits.items()},
        }


def expected(plan: Plan) -> Expected:
    """Collect errors that are known before and expected after an experiment."""
    experiment, best = plan.experiment, plan.rivals[0].known
    slopes = np.abs(_slopes(experiment))
    pairs = np.outer(slopes, slopes)
    return Expected(
        value=experiment.values,
        error_before=experiment.prior.errors * slopes,
        error=plan.known.errors * slopes,
        error_random=best.errors * slopes,
        covariance=plan.known.covariance * pairs,
        covariance_random=best.covariance * pairs,
        rival_criterion=np.array([rival.value for rival in plan.rivals]),
        rival_error=np.array([rival.known.errors * slopes for rival in plan.rivals]),
        start_criterion=np.array(plan.ends) if plan.ends else None,
    )


def _slopes(experiment: Experiment) -> np.ndarray:
    """Derivative of each parameter by its coordinate, for example its logarithm."""
    pairs = zip(experiment.unknowns_of, experiment.values, strict=True)
    return np.array([value if unknown.log else 1.0 for unknown, value in pairs])


def _ends(ends: Sequence[float | str]) -> tuple[float, float]:
    low, high = ends
    return (
        -np.inf if isinstance(low, str) else low,
        np.inf if isinstance(high, str) else high,
    )


def words(unseen: Mapping[str, float]) -> str:
    """A combination of unknowns without effect, in words."""
    return " ".join(f"{share:+.3g} {name}" for name, share in unseen.items())


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
