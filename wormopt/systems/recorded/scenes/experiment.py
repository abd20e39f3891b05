"""Scenes of kind "experiment": which run tells the numbers of a worm best."""

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
    Table,
    Title,
    says,
    wrong_order,
)
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
    Meta(min_length=2, max_length=2, description="two finite numbers, [least, largest]"),
]
End = Annotated[
    tuple[Finite | Literal["free"], ...],
    Meta(min_length=2, max_length=2, description='[least, largest], numbers or "free"'),
]


class ExperimentUnknown(Table, frozen=True, kw_only=True):
    """A number of the model that is not known well enough, or not at all."""

    name: Annotated[Title, says("", "what results call it")]
    targets: Annotated[
        Annotated[str | tuple[str, ...], Meta(description="the name of a signal, or a list")]
        | None,
        says("", "signals and entries that all are this one number; its name if left out"),
    ] = None
    value: Annotated[
        FiniteOrList | None,
        says("", "the best value that is known; that of `known` or of `[model]` if left out"),
    ] = None
    prior: Annotated[
        Positive | None,
        says("", "its standard error as known before, of its logarithm with `log`"),
    ] = None
    log: Annotated[bool, says("", "whether errors are those of its logarithm: relative ones")] = (
        False
    )
    wanted: Annotated[
        bool, says("", "whether it shall be known well; else it is only in the way")
    ] = True


class Moved(Table, frozen=True, kw_only=True, tag_field="shape"):
    """Keys of all courses."""

    signal: Annotated[Name, says("", "an input or a parameter, `rest_length` say")]
    change: Annotated[Positive, says("", "largest change from where it begins, either way")]
    rate: Annotated[Positive | None, says("", "largest rate of change; none if left out")] = None


class RampsTable(Moved, frozen=True, kw_only=True, tag="ramps"):
    """A course that is linear between equidistant knots and begins at the model's value."""

    pieces: Annotated[Pieces, says("count", "from knot to knot, over the whole run")]


class WavesTable(Moved, frozen=True, kw_only=True, tag="waves"):
    """A course of a few harmonics that begins at the model's value."""

    harmonics: Annotated[Harmonics, says("count", "how many")]
    frequency: Annotated[
        PositiveOrPair, says("rate", "of the first; of a range the best is chosen")
    ]


class HeldTable(Table, frozen=True, kw_only=True, tag_field="shape", tag="held"):
    """A number that is chosen and held, the same for all entries of the signal: a load, say."""

    signal: Annotated[Name, says("", "an input or a parameter")]
    range: Annotated[
        Range,
        says("", "from which it is chosen"),
    ]


class ExperimentTime(Table, frozen=True, kw_only=True):
    """How long the run lasts, and how often it is measured."""

    end: Annotated[Positive, says("time", "of the run, which begins at 0")]
    samples: Annotated[
        int,
        Meta(ge=2, le=100_000, description="a whole number from 2 to 100000"),
        says("count", "equidistant times of measurements, the last at the end"),
    ]


class PredictionTable(Table, frozen=True, kw_only=True):
    """What the numbers are wanted for: the mean rate of something in another motion."""

    model: SceneTables
    output: Annotated[
        Name, says("", "state or output; its mean rate is predicted, a speed for a place")
    ] = "center_of_mass"
    span: Annotated[
        Span,
        says("time", "of the motion over which the mean is taken"),
    ]


class ExperimentSearch(Table, frozen=True, kw_only=True):
    """How the best run is sought."""

    rivals: Annotated[
        Count, says("count", "runs drawn at random within the limits, to compare with")
    ] = 20
    starts: Annotated[
        Count, says("count", "how many of the best of them the search begins from")
    ] = 3
    seed: Annotated[Seed, says("count", "of the random numbers")] = 0


class ExperimentScene(SceneTable, frozen=True, kw_only=True):
    """Which run of a worm tells its numbers best, within what the worm can do.

    What a run tells is the Fisher information of its measurements: derivatives of the motion,
    exact through sticking and slipping, over the noise; what is known before is added. Guide:
    [fitting.md](../fitting.md#what-to-measure-next).

    Limits of courses hold at all times; limits along the motion are looked at 4000 times and more.
    Results hold every unknown's expected standard error before and after, the course of every
    signal (`course_<signal>`, with `course.csv` for the actuators), what is limited and what is
    measured over time, and the runs drawn at random, the best first.

    Searches end where masses are about to stick or to let go: derivatives there say nothing of
    the other side. So runs are taken beside, where measurements are all but linear in the
    unknowns within two standard errors; a warning says where none was found.

    The trust report: the criterion again by the Python route with a hundredth of the tolerance,
    and the largest excess of a limit. Exit code 3: where they disagree, a limit is exceeded, or no
    run tells what is wanted; the message names the numbers that cannot be told apart then.
    """

    headline: ClassVar = ("shrinkage", "shrinkage_median", "prediction_error")
    scalars: ClassVar = {
        "shrinkage": (
            "1",
            "how many times smaller the confidence region of what is wanted is than after the best "
            'run drawn at random: its volume; its mean size for criterion "A"',
        ),
        "shrinkage_median": ("1", "the same against the median of these runs"),
        "criterion": ("1", "logarithm of the mean relative error of what is wanted"),
        "criterion_recheck": ("1", "the same by the second route"),
        "excess": ("share", "largest excess of a limit, below 0 where none is reached"),
        "departure": (
            "1",
            "how far measurements depart from linear ones within two standard errors, in standard "
            "errors; a warning says where it is much",
        ),
        "prediction_error": ("1", "standard error of the prediction, in its own unit"),
        "prediction_error_random": ("1", "the same after the best run drawn at random"),
        "rank": ("count", "how many unknowns, or combinations of them, the run tells"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "value": ("1", ("unknown",), "best values known before, in the unit of each"),
        "error_before": ("1", ("unknown",), "standard errors before, infinite for unknown"),
        "error": ("1", ("unknown",), "expected standard errors after the run"),
        "error_random": ("1", ("unknown",), "after the best run drawn at random"),
        "covariance": ("1", ("unknown", "unknown_too"), "expected covariance after the run"),
        "covariance_random": (
            "1",
            ("unknown", "unknown_too"),
            "after the best run drawn at random",
        ),
        "rival_criterion": ("1", ("rival",), "criterion after runs drawn at random"),
        "rival_error": ("1", ("rival", "unknown"), "standard errors after them"),
        "start_criterion": ("1", ("start",), "criterion at which each start of the search ended"),
    }

    kind: Literal["experiment"]
    want: Annotated[
        tuple[Literal["course", "errors", "regions"], ...],
        says(
            "",
            "`course`: what is moved, and the motion; `errors` before and after, beside runs drawn "
            "at random; `regions`: confidence ellipses of pairs of what is wanted",
        ),
    ] = ()
    model: SceneTables
    which: Annotated[
        str, says("", "which model, by its label, where the scene in `[model]` has several")
    ] = ""
    known: Annotated[
        str | None,
        says(
            "",
            "folder of the result of a scene of kind `fit`, relative to the scene's: its numbers "
            "and their covariance are what is known, of unknowns of the same names",
        ),
    ] = None
    unknown: Annotated[tuple[ExperimentUnknown, ...], says("", "what is not known")]
    measured: Annotated[
        dict[str, Positive],
        says("", "standard deviations of measurements by signal, `{position = 0.001}`"),
    ]
    choose: Annotated[
        tuple[RampsTable | WavesTable | HeldTable, ...],
        says("", "what may be chosen; `shape` decides which other keys there are"),
    ]
    limits: Annotated[
        dict[str, End],
        says("", 'of states and outputs along the motion, `{length = [1.4, "free"]}`'),
    ] = field(default_factory=dict)
    time: Annotated[ExperimentTime, says("", "the run")]
    criterion: Annotated[
        Literal["D", "A"],
        says(
            "",
            "`D`: the volume of the confidence region of what is wanted; `A`: the sum of the "
            "squares of its relative errors. A `[prediction]` takes the place of both",
        ),
    ] = "D"
    prediction: Annotated[PredictionTable | None, says("", "what the numbers are wanted for")] = (
        None
    )
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
                yield key, f"there is none; write a table [{key}]"
        if self.unknown and not any(unknown.wanted for unknown in self.unknown):
            yield "unknown", "none is wanted; leave out wanted = false at one"
        yield from named_twice((unknown.name for unknown in self.unknown), "unknown")
        yield from self._faults_of_ranges()
        if self.known is not None and not os.path.exists(folder / self.known):  # noqa: PTH110  as there
            yield "known", f'there is no "{self.known}" in {folder}; run the scene of kind "fit"'
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
                yield f"limits.{name}", "limits nothing; write a number, or leave it out"
        if self.prediction is not None:
            yield from wrong_order("prediction.span", self.prediction.span, may_be_equal=False)
