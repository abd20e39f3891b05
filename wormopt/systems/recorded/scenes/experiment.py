"""Scenes of kind "experiment": the experiment that identifies the parameters best."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault, SceneError
from wormopt.study.given import Given, entry, positive, whole
from wormopt.study.numerics import Contacts, ExactContact
from wormopt.study.types import (
    Finite,
    Positive,
    PositiveOrPair,
    SceneTable,
    Seed,
    Title,
    wrong_order,
)
from wormopt.systems.recorded.tables import (
    FiniteOrList,
    SceneTables,
    Span,
    named_twice,
    scene_of,
)

Name = Annotated[str, Meta(description="the name of a signal")]
Count = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Pieces = Annotated[int, Meta(ge=1, le=200, description="a whole number from 1 to 200")]
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


class Moved(Given, tag_field="shape"):
    """Keys common to all input signals that vary in time."""

    signal: Name = entry("an input or a parameter, for example `rest_length`")
    change: float = positive("", "largest change from the initial value, up or down")
    rate: float | None = positive("", "largest rate of change; default: unlimited", default=None)


class RampsTable(Moved, tag="ramps"):
    """An input that is linear between equidistant knots and starts at the model's value."""

    pieces: int = whole(1, 200, "number of linear pieces over the whole run")


class WavesTable(Moved, tag="waves"):
    """An input with a few harmonics that starts at the model's value."""

    harmonics: int = whole(1, 20, "number of harmonics")
    frequency: PositiveOrPair = entry(
        "frequency of the first harmonic; a range is optimised", quantity="rate"
    )


class HeldTable(Given, tag_field="shape", tag="held"):
    """A constant to choose, the same for all entries of the signal, for example a load."""

    signal: Name = entry("an input or a parameter")
    range: Range = entry("range of the constant, [smallest, largest]")


class ExperimentTime(Given):
    """Duration of the run and times of its measurements."""

    end: float = positive("time", "end of the run, which starts at 0")
    samples: int = whole(2, 100000, "number of equidistant measurement times, the last at the end")


class PredictionTable(Given):
    """A prediction that the parameters serve: the mean rate of a signal in another motion."""

    model: SceneTables
    output: Name = entry(
        "state or output whose mean rate is predicted; for a position, its speed",
        default="center_of_mass",
    )
    span: Span = entry("start and end of the averaging in that motion", quantity="time")


class ExperimentSearch(Given):
    """Search for the best experiment."""

    rivals: int = whole(
        1, 1000, "number of random experiments within the limits, for comparison", default=20
    )
    starts: int = whole(1, 1000, "number of the best of them from which searches start", default=3)
    seed: Seed = entry("seed of the random numbers", quantity="count", default=0)


class ExperimentScene(SceneTable):
    """The experiment that identifies the parameters of a worm best, within the worm's limits.

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
    scalars: ClassVar = {
        "shrinkage": (
            "1",
            "factor by which the confidence region of the wanted parameters is smaller than after "
            'the best random experiment: its volume, or its mean size for criterion "A"',
        ),
        "shrinkage_median": ("1", "the same factor relative to the median random experiment"),
        "criterion": ("1", "logarithm of the mean relative error of the wanted parameters"),
        "criterion_recheck": ("1", "the criterion by the second route"),
        "excess": ("share", "largest violation of a limit, negative if no limit is reached"),
        "departure": (
            "1",
            "departure of the measurements from linearity within two standard errors, in standard "
            "errors; a warning reports large values",
        ),
        "prediction_error": ("1", "standard error of the prediction, in its own unit"),
        "prediction_error_random": ("1", "the same after the best random experiment"),
        "rank": ("count", "number of unknowns, or combinations of them, that are identifiable"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "value": ("1", ("unknown",), "best values known before, each in its own unit"),
        "error_before": ("1", ("unknown",), "standard errors before, infinite if unknown"),
        "error": ("1", ("unknown",), "expected standard errors after the experiment"),
        "error_random": ("1", ("unknown",), "expected errors after the best random experiment"),
        "covariance": ("1", ("unknown", "unknown_too"), "expected covariance after the experiment"),
        "covariance_random": (
            "1",
            ("unknown", "unknown_too"),
            "expected covariance after the best random experiment",
        ),
        "rival_criterion": ("1", ("rival",), "criterion of each random experiment"),
        "rival_error": ("1", ("rival", "unknown"), "standard errors after each of them"),
        "start_criterion": ("1", ("start",), "criterion at the end of each search"),
    }

    kind: Literal["experiment"]
    want: tuple[Literal["course", "errors", "regions"], ...] = entry(
        "`course`: inputs and motion; `errors`: standard errors before and after, with those "
        "of random experiments; `regions`: confidence ellipses of pairs of wanted parameters",
        default=(),
    )
    model: SceneTables
    which: str = entry("label of the model, if the scene in `[model]` has several", default="")
    known: str | None = entry(
        "folder of a result of kind `fit`, relative to the scene's folder; its estimates and "
        "their covariance are used for unknowns of the same names",
        default=None,
    )
    unknown: tuple[ExperimentUnknown, ...] = entry("unknown parameters")
    measured: dict[str, Positive] = entry(
        "standard deviation of measurements of each signal, `{position = 0.001}`"
    )
    choose: tuple[RampsTable | WavesTable | HeldTable, ...] = entry(
        "inputs to choose; `shape` selects the other keys"
    )
    limits: dict[str, End] = entry(
        'limits of states and outputs along the motion, `{length = [1.4, "free"]}`', default=dict
    )
    time: ExperimentTime = entry("duration and measurement times")
    criterion: Literal["D", "A"] = entry(
        "`D`: volume of the confidence region of the wanted parameters; `A`: sum of the "
        "squares of their relative errors. A `[prediction]` replaces both",
        default="D",
    )
    prediction: PredictionTable | None = entry("prediction to improve", default=None)
    contact: Contacts = field(default_factory=ExactContact)
    search: ExperimentSearch = entry("the search", default=ExperimentSearch)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        for key, given in (
            ("unknown", self.unknown),
            ("choose", self.choose),
            ("measured", self.measured),
        ):
            if not given:
                yield key, f"no entry is given; write at least one in [{key}]"
        if self.unknown and not any(unknown.wanted for unknown in self.unknown):
            yield "unknown", "wanted is false for all unknowns; remove wanted = false from one"
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        yield from self._faults_of_ranges()
        if self.known is not None and not os.path.exists(folder / self.known):  # noqa: PTH110  as there
            yield "known", f'"{self.known}" does not exist in {folder}; run the scene of kind "fit"'
        for key, tables in (
            ("model", self.model),
            ("prediction.model", self.prediction and self.prediction.model),
        ):
            try:
                if tables:
                    scene_of(tables, folder, self.units, key)
            except SceneError as error:
                yield from error.faults

    def _faults_of_ranges(self) -> Iterator[Fault]:
        for k, choice in enumerate(self.choose):
            if isinstance(choice, HeldTable):
                yield from wrong_order(f"choose[{k}].range", choice.range, may_be_equal=False)
            if isinstance(choice, WavesTable) and isinstance(choice.frequency, tuple):
                yield from wrong_order(
                    f"choose[{k}].frequency", choice.frequency, may_be_equal=True
                )
        for name, (low, high) in self.limits.items():
            if isinstance(low, float) and isinstance(high, float):
                yield from wrong_order(f"limits.{name}", (low, high), may_be_equal=False)
            elif low == high:
                yield f"limits.{name}", 'both ends are "free"; write a number, or remove the key'
        if self.prediction is not None:
            yield from wrong_order("prediction.span", self.prediction.span, may_be_equal=False)
