"""Tables of scenes of kind "tracker-readings": interpretations of a published tracker example."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.numerics import Contacts, ExactContact, Horizon, Tolerances, ToleranceTable
from wormopt.study.types import (
    Finite,
    FinitePerLink,
    NonNegative,
    NonNegativePerLink,
    PerLink,
    PerMass,
    Positive,
    SceneTable,
)
from wormopt.systems.chain.tables import Reference
from wormopt.systems.shared.declared import (
    CHAIN,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKER_EVENTS,
    over,
)

_MOST = 20_000  # Largest number of readings in a scene.


class ExampleTable(Given):
    """Parameters of the worm that all readings share."""

    links: int = whole(1, 20, "number of links *n*; mass 0 is the head")
    mass: PerMass = entry("point masses *m*<sub>i</sub>", quantity="mass")
    stiffness: PerLink = entry("spring constants *c*<sub>j</sub>", quantity="stiffness")
    damping: NonNegativePerLink = entry("dashpot constants *d*<sub>j</sub>", quantity="drag")

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys."""
        yield from wrong_count("worm.mass", self.mass, self.links + 1, "masses")
        for name in ("stiffness", "damping"):
            yield from wrong_count(f"worm.{name}", getattr(self, name), self.links, "links")


class TrackersTable(Given):
    """Parameters of trackers (13) and (14) that all readings share."""

    tube_radius: float = positive("length", "*λ*")
    gain_start: float = positive("", "*k*(0)", default=1.0)
    filter_start: FinitePerLink = entry("*θ*(0)", quantity="length", default=1.0)


Forces = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, 0 or above, [F+, F-]"),
]
Positions = Annotated[
    tuple[Finite, ...], Meta(min_length=2, description="a list of finite numbers, one per mass")
]


class ReadingsTable(Given):
    """Alternatives of the readings: every combination is simulated.

    The first entry of each list is the baseline.
    """

    start: tuple[Positions, ...] = entry(
        "initial positions, head first, one list per alternative", quantity="length"
    )
    rest_length: tuple[NonNegative | Literal["reference"], ...] = entry(
        "rest length of all links; `reference`: it follows the reference, which is a "
        "feed-forward *c y*<sub>ref</sub> to springs without rest length",
        quantity="length",
    )
    input: tuple[Literal["force", "rest_length"], ...] = entry(
        "meaning of the tracker's *u*: a force, or the change of a rest length (eq. 11)"
    )
    growth: tuple[Positive, ...] = entry("*γ*, growth rate of the gains")
    period: tuple[Positive, ...] = entry("period of the gait", quantity="time")
    friction: tuple[Forces, ...] = entry(
        "[*F*<sub>+</sub>, *F*<sub>−</sub>], one pair per alternative", quantity="force"
    )
    links: tuple[Literal["printed", "reversed"], ...] = entry(
        "whether the gait's first entry belongs to the first or the last link"
    )
    signs: tuple[Literal["printed", "turned", "filter"], ...] = entry(
        "signs in eq. 14: as printed; *u* and *e* in *θ*′ both reversed, which is the printed "
        "form with −*θ*(0); *e* in *θ*′ alone reversed, which gives positive feedback of the "
        "error"
    )

    def faults(self, masses: int) -> Iterator[Fault]:
        """Yield what is wrong between the keys, for a worm with this number of masses."""
        for name in self.__struct_fields__:
            given = getattr(self, name)
            if not given:
                yield f"readings.{name}", "is empty; write at least one entry"
            elif len(set(given)) < len(given):
                yield f"readings.{name}", "repeats an entry; write each once"
        for k, start in enumerate(self.start):
            yield from wrong_count(f"readings.start[{k}]", start, masses, "masses")
        count = prod(len(getattr(self, name)) for name in self.__struct_fields__)
        if count > _MOST:
            yield (
                "readings",
                f"have {count} combinations, but at most {_MOST} are simulated; shorten a list",
            )


class SentencesTable(Given):
    """Criteria by which a sentence of the text counts as supported."""

    strips: Literal["outputs", "norm", "both"] = entry(
        "criterion of capture: `outputs`, every \\|*e*<sub>j</sub>\\| ≤ *λ*, as the strips of "
        "figure 5; `norm`, the Euclidean \\|*e*\\| ≤ *λ*, at which gains stop growing; "
        "`both`: either of the two supports a sentence",
        default="both",
    )
    quick: float = positive("time", "time within which tracker (13) captures the outputs")
    window: float = positive(
        "time",
        "length of the final interval: outputs that leave their strips in it are not "
        "captured; growth of gains and errors refer to it",
    )
    settled: float = number("share", "largest growth of a converged gain", least=0)
    growing: float = positive("share", "least growth of a gain that still increases")


_EACH = ("tracker", "reading")


class ReadingsScene(SceneTable):
    """Trackers (13) and (14) of Zimmermann et al. 2007 under every reading of their example.

    The published data contradict each other in places and are incomplete in others, and the text
    alone describes figures 5 to 8. Every combination of `[readings]` is simulated with both
    trackers and compared with the sentences of the text, by the criteria of `[sentences]`.
    [readings.md](../readings.md) discusses the results. One reading is shown and simulated again as
    exactly as in scenes of [kind `track`](track.md). Among the readings that support most
    sentences, it departs from the first entries in the fewest keys; ties are resolved by the number
    of ends of the interval.

    `table.md` holds the shares of readings that support each sentence and the best readings;
    `readings.csv` holds all readings. Samples decide what is captured; linear interpolation between
    two samples gives the time of capture. Attributes: `trackers`, `sentences` (names),
    `sentence_meanings`, `choices` (keys of `[readings]`), `chosen_reading`. `timings_s`:
    `simulate`, `recheck`. The trust report compares mirror images: a reading with F<sub>+</sub>,
    F<sub>−</sub> and the order of links exchanged has the same errors and gains.

    Not allowed: equal entries; lists of `start` without one number per mass; more than 20000
    combinations; a window of at least half of the time.
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
        "chosen": ("count", "index of the reading that is shown, from 0"),
        "chosen_departures": ("count", "number of keys in which it departs from the first entries"),
        "chosen_gain": ("count", "gains of the shown reading at the end"),
        "given_up": ("count", "numbers of divergent motions with trackers (13) and (14)"),
        "recheck_error": CHAIN["recheck_error"],
    }
    variables: ClassVar = {
        "reading_choice": (
            "count",
            ("reading", "choice"),
            "chosen entry of each key of readings, from 0",
        ),
        "supported": ("count", ("reading", "sentence"), "1 if the reading supports the sentence"),
        "gain_middle": ("count", _EACH, "gain at half the time"),
        "gain_end": ("count", _EACH, "gain at the end"),
        "gain_growth": ("share", _EACH, "growth of the gain in the window"),
        "error_peak": ("length", _EACH, "largest norm of the error in the window"),
        "captured_outputs": ("time", _EACH, "time from which every output stays in its strip"),
        "captured_norm": ("time", _EACH, "time from which the norm of the error stays in the tube"),
        "ends_first": (
            "time",
            ("reading",),
            "first end of the interval for which every sentence holds",
        ),
        "ends_last": (
            "time",
            ("reading",),
            "last end of the interval for which every sentence holds",
        ),
        **TIME,
        **REFERENCE,
        **over(LOOP_SIGNALS, "tracker"),
        **TRACKER_EVENTS,
    }

    kind: Literal["tracker-readings"]
    want: tuple[Literal["readings", "trackers"], ...] = entry(
        "`readings`: entries that support each sentence, and their numbers; `trackers`: the "
        "shown reading, in the order of figures 5 to 8",
        default=(),
    )
    worm: ExampleTable = entry("the worm")
    reference: Reference = entry("reference of the links; each reading sets its period")
    tracker: TrackersTable = entry("parameters of both trackers")
    readings: ReadingsTable = entry("alternatives of the readings")
    sentences: SentencesTable = entry("criteria of the sentences")
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
            yield (
                "sentences.window",
                f"is not below half of time.end = {self.time.end:g}; write less",
            )
