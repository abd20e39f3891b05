"""Scenes of kind "tracker-readings": which reading of the chapter's example its text supports."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import Contacts, ExactContact, Horizon, Tolerances, ToleranceTable
from wormopt.scene.types import (
    Finite,
    FinitePerLink,
    NonNegative,
    NonNegativePerLink,
    PerLink,
    PerMass,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_count,
)
from wormopt.systems.chain.scenes.track import Reference
from wormopt.systems.shared.declared import (
    CHAIN,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKER_EVENTS,
    over,
)

_MOST = 20_000  # readings of one scene


class ExampleTable(Table, frozen=True, kw_only=True):
    """What all readings share of the worm."""

    links: Annotated[
        int,
        Meta(ge=1, le=20, description="a whole number from 1 to 20"),
        says("count", "*n*; mass 0 is the head"),
    ]
    mass: Annotated[PerMass, says("mass", "point masses *m*<sub>i</sub>")]
    stiffness: Annotated[PerLink, says("stiffness", "spring constants *c*<sub>j</sub>")]
    damping: Annotated[NonNegativePerLink, says("drag", "dashpot constants *d*<sub>j</sub>")]

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys."""
        yield from wrong_count("worm.mass", self.mass, self.links + 1, "masses")
        for name in ("stiffness", "damping"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links, "links")


class TrackersTable(Table, frozen=True, kw_only=True):
    """What all readings share of (13) and (14)."""

    tube_radius: Annotated[Positive, says("length", "*λ*")]
    gain_start: Annotated[Positive, says("", "*k*(0)")] = 1.0
    filter_start: Annotated[FinitePerLink, says("length", "*θ*(0)")] = 1.0


Forces = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, 0 or above, [F+, F-]"),
]
Positions = Annotated[
    tuple[Finite, ...], Meta(min_length=2, description="a list of finite numbers, one per mass")
]


class ReadingsTable(Table, frozen=True, kw_only=True):
    """What the readings differ in: every combination is simulated.

    The first of each list is what the others depart from.
    """

    start: Annotated[tuple[Positions, ...], says("length", "positions, head first, one list each")]
    rest_length: Annotated[
        tuple[NonNegative | Literal["reference"], ...],
        says(
            "length",
            "of all links; `reference`: it follows the reference, as a feed-forward "
            "*c y*<sub>ref</sub> to springs without rest length",
        ),
    ]
    input: Annotated[
        tuple[Literal["force", "rest_length"], ...],
        says("", "what *u* of the tracker is: a force, or by (11) the change of a rest length"),
    ]
    growth: Annotated[tuple[Positive, ...], says("", "*γ* of the gains")]
    period: Annotated[tuple[Positive, ...], says("time", "of the gait")]
    friction: Annotated[
        tuple[Forces, ...], says("force", "[*F*<sub>+</sub>, *F*<sub>−</sub>], one pair each")
    ]
    links: Annotated[
        tuple[Literal["printed", "reversed"], ...],
        says("", "whether the gait's first link is the first, or the last"),
    ]
    signs: Annotated[
        tuple[Literal["printed", "turned", "filter"], ...],
        says(
            "",
            "of (14): as printed; those of *u* and of *e* in *θ*′ both turned, which is as printed "
            "with −*θ*(0); that in *θ*′ alone, which feeds the error back to itself",
        ),
    ]

    def faults(self, masses: int) -> Iterator[Fault]:
        """Yield what is wrong between the keys, for a worm of so many masses."""
        for name in self.__struct_fields__:
            given = getattr(self, name)
            if not given:
                yield f"readings.{name}", "is empty; write at least one entry"
            elif len(set(given)) < len(given):
                yield f"readings.{name}", "has an entry twice; write each once"
        for k, start in enumerate(self.start):
            yield from wrong_count(f"readings.start[{k}]", start, masses, "masses")
        count = prod(len(getattr(self, name)) for name in self.__struct_fields__)
        if count > _MOST:
            yield "readings", f"are {count} combinations; at most {_MOST} are simulated"


class SentencesTable(Table, frozen=True, kw_only=True):
    """From where on a sentence of the text counts as supported."""

    strips: Annotated[
        Literal["outputs", "norm", "both"],
        says(
            "",
            "what is captured: `outputs`, every \\|*e*<sub>j</sub>\\| ≤ *λ*, as the strips of "
            "figure 5; `norm`, the Euclidean \\|*e*\\| ≤ *λ*, at which gains stop to grow; `both`: "
            "a sentence counts if it holds either way",
        ),
    ] = "both"
    quick: Annotated[Positive, says("time", "within which (13) captures the outputs")]
    window: Annotated[
        Positive,
        says(
            "time",
            "the end of the interval: outputs that leave their strips in it are not captured; "
            "growth of gains and errors are those in it",
        ),
    ]
    settled: Annotated[NonNegative, says("share", "by which a gain that has converged may grow")]
    growing: Annotated[Positive, says("share", "by which a gain that still grows does at least")]


_EACH = ("tracker", "reading")


class ReadingsScene(SceneTable, frozen=True, kw_only=True):
    """(13) and (14) under every reading of what the chapter leaves open, against its sentences.

    The chapter's data contradict themselves in places and are silent in others, and its figures 5
    to 8 are described by the text alone. Every combination of `[readings]` is simulated under both
    trackers, and compared with what the text says, by the criteria of `[sentences]`; what is found:
    [readings.md](../readings.md). One reading is shown, simulated again as
    exactly as in scenes of [kind `track`](track.md): of those that support most sentences the one
    that departs in the fewest keys from the first entries, then that which does so for most ends of
    the interval.

    `table.md` holds the shares of readings that support each sentence and the best readings,
    `readings.csv` all. Samples decide what is captured, the straight line between two of them
    when. Attributes: `trackers`, `sentences`
    (names), `sentence_meanings`, `choices` (keys of `[readings]`), `chosen_reading`.
    `timings_s`: `simulate`, `recheck`. The trust report compares mirror images: a reading with
    F<sub>+</sub>, F<sub>−</sub> and the order of links exchanged has the same errors and gains.

    Refused: two entries alike; lists of `start` that are not one number per mass; more than 20000
    combinations; a window not shorter than half of the time.
    """

    headline: ClassVar = (
        "n_readings",
        "n_supporting",
        "most_supported",
        "chosen_departures",
        "chosen_gain",
    )
    scalars: ClassVar = {
        "n_readings": ("count", "readings"),
        "n_supporting": ("count", "readings that support every sentence"),
        "most_supported": ("count", "sentences that the best reading supports"),
        "chosen": ("count", "number of the reading that is shown, from 0"),
        "chosen_departures": ("count", "keys in which it departs from the first entries"),
        "chosen_gain": ("count", "its gains at the end"),
        "given_up": ("count", "motions under (13) and (14) that grew beyond bounds"),
        "recheck_error": CHAIN["recheck_error"],
    }
    variables: ClassVar = {
        "reading_choice": (
            "count",
            ("reading", "choice"),
            "which entry of each key of readings, from 0",
        ),
        "supported": ("count", ("reading", "sentence"), "1 where it supports the sentence"),
        "gain_middle": ("count", _EACH, "gain at half the time"),
        "gain_end": ("count", _EACH, "gain at the end"),
        "gain_growth": ("share", _EACH, "by which the gain grows in the window"),
        "error_peak": ("length", _EACH, "largest norm of the error in the window"),
        "captured_outputs": ("time", _EACH, "from when on every output is in its strip"),
        "captured_norm": ("time", _EACH, "from when on the norm of the error is in the tube"),
        "ends_first": ("time", ("reading",), "first end for which every sentence holds"),
        "ends_last": ("time", ("reading",), "last end for which every sentence holds"),
        **TIME,
        **REFERENCE,
        **over(LOOP_SIGNALS, "tracker"),
        **TRACKER_EVENTS,
    }

    kind: Literal["tracker-readings"]
    want: Annotated[
        tuple[Literal["readings", "trackers"], ...],
        says(
            "",
            "`readings`: which entries support which sentences, and how many; `trackers`: the "
            "reading that is shown, in the order of figures 5 to 8",
        ),
    ] = ()
    worm: Annotated[ExampleTable, says("", "the worm")]
    reference: Annotated[
        Reference, says("", "what its links shall do; the period is that of each reading")
    ]
    tracker: Annotated[TrackersTable, says("", "both trackers")]
    readings: Annotated[ReadingsTable, says("", "what is open")]
    sentences: Annotated[SentencesTable, says("", "what the text says")]
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults()
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from wrong_count("tracker.filter_start", self.tracker.filter_start, links, "links")
        yield from self.readings.faults(links + 1)
        if 2 * self.sentences.window >= self.time.end:
            yield "sentences.window", f"is not below half of time.end = {self.time.end:g}"
