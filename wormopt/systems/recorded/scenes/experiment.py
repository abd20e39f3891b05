"""Scenes of kind "experiment": the experiment that identifies the parameters best."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault, SceneError
from wormopt.scene.numerics import Contacts, ExactContact
from wormopt.scene.types import (
    Finite,
    Positive,
    PositiveOrPair,
    SceneTable,
    Seed,
    Title,
    wrong_order,
)
from wormopt.study.given import Given, says
from wormopt.systems.recorded.scenes.tables import (
    FiniteOrList,
    SceneTables,
    Span,
    named_twice,
    scene_of,
)

Name = Annotated[str, Meta(description="the name of a signal")]
Count = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Pieces = Annotated[int, Meta(ge=1, le=200, description="a whole number from 1 to 200")]
Harmonics = Annotated[int, Meta(ge=1, le=20, description="a whole number from 1 to 20")]
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

    name: Annotated[Title, says("", "name of the parameter in results")]
    targets: Annotated[
        Annotated[str | tuple[str, ...], Meta(description="the name of a signal, or a list")]
        | None,
        says("", "signals and entries that all equal this parameter; default: its name"),
    ] = None
    value: Annotated[
        FiniteOrList | None,
        says("", "best known value; default: that of `known`, or of `[model]`"),
    ] = None
    prior: Annotated[
        Positive | None,
        says("", "its standard error before the experiment; with `log`, that of its logarithm"),
    ] = None
    log: Annotated[bool, says("", "use errors of the logarithm, which are relative errors")] = False
    wanted: Annotated[
        bool, says("", "true: estimate it as well as possible; false: a nuisance parameter")
    ] = True


class Moved(Given, tag_field="shape"):
    """Keys common to all input signals that vary in time."""

    signal: Annotated[Name, says("", "an input or a parameter, for example `rest_length`")]
    change: Annotated[Positive, says("", "largest change from the initial value, up or down")]
    rate: Annotated[Positive | None, says("", "largest rate of change; default: unlimited")] = None


class RampsTable(Moved, tag="ramps"):
    """An input that is linear between equidistant knots and starts at the model's value."""

    pieces: Annotated[Pieces, says("count", "number of linear pieces over the whole run")]


class WavesTable(Moved, tag="waves"):
    """An input with a few harmonics that starts at the model's value."""

    harmonics: Annotated[Harmonics, says("count", "number of harmonics")]
    frequency: Annotated[
        PositiveOrPair, says("rate", "frequency of the first harmonic; a range is optimised")
    ]


class HeldTable(Given, tag_field="shape", tag="held"):
    """A constant to choose, the same for all entries of the signal, for example a load."""

    signal: Annotated[Name, says("", "an input or a parameter")]
    range: Annotated[
        Range,
        says("", "range of the constant, [smallest, largest]"),
    ]


class ExperimentTime(Given):
    """Duration of the run and times of its measurements."""

    end: Annotated[Positive, says("time", "end of the run, which starts at 0")]
    samples: Annotated[
        int,
        Meta(ge=2, le=100_000, description="a whole number from 2 to 100000"),
        says("count", "number of equidistant measurement times, the last at the end"),
    ]


class PredictionTable(Given):
    """A prediction that the parameters serve: the mean rate of a signal in another motion."""

    model: SceneTables
    output: Annotated[
        Name, says("", "state or output whose mean rate is predicted; for a position, its speed")
    ] = "center_of_mass"
    span: Annotated[
        Span,
        says("time", "start and end of the averaging in that motion"),
    ]


class ExperimentSearch(Given):
    """Search for the best experiment."""

    rivals: Annotated[
        Count, says("count", "number of random experiments within the limits, for comparison")
    ] = 20
    starts: Annotated[
        Count, says("count", "number of the best of them from which searches start")
    ] = 3
    seed: Annotated[Seed, says("count", "seed of the random numbers")] = 0


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
    want: Annotated[
        tuple[Literal["course", "errors", "regions"], ...],
        says(
            "",
            "`course`: inputs and motion; `errors`: standard errors before and after, with those "
            "of random experiments; `regions`: confidence ellipses of pairs of wanted parameters",
        ),
    ] = ()
    model: SceneTables
    which: Annotated[str, says("", "label of the model, if the scene in `[model]` has several")] = (
        ""
    )
    known: Annotated[
        str | None,
        says(
            "",
            "folder of a result of kind `fit`, relative to the scene's folder; its estimates and "
            "their covariance are used for unknowns of the same names",
        ),
    ] = None
    unknown: Annotated[tuple[ExperimentUnknown, ...], says("", "unknown parameters")]
    measured: Annotated[
        dict[str, Positive],
        says("", "standard deviation of measurements of each signal, `{position = 0.001}`"),
    ]
    choose: Annotated[
        tuple[RampsTable | WavesTable | HeldTable, ...],
        says("", "inputs to choose; `shape` selects the other keys"),
    ]
    limits: Annotated[
        dict[str, End],
        says("", 'limits of states and outputs along the motion, `{length = [1.4, "free"]}`'),
    ] = field(default_factory=dict)
    time: Annotated[ExperimentTime, says("", "duration and measurement times")]
    criterion: Annotated[
        Literal["D", "A"],
        says(
            "",
            "`D`: volume of the confidence region of the wanted parameters; `A`: sum of the "
            "squares of their relative errors. A `[prediction]` replaces both",
        ),
    ] = "D"
    prediction: Annotated[PredictionTable | None, says("", "prediction to improve")] = None
    contact: Contacts = field(default_factory=ExactContact)
    search: Annotated[ExperimentSearch, says("", "the search")] = field(
        default_factory=ExperimentSearch
    )

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
