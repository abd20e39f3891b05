"""Kind "tracker-readings": interpretations of a published tracker example."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import prod
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.result import Check, Result
from wormopt.study import (
    Given,
    Study,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.given import wrong_count
from wormopt.study.numerics import Contacts, ExactContact, Horizon, Tolerances, ToleranceTable
from wormopt.study.types import (
    Finite,
    FinitePerLink,
    NonNegative,
    NonNegativePerLink,
    PerLink,
    PerMass,
    Positive,
    per,
)
from wormopt.systems.chain.tables import Criteria, DerivativeTracker, FilterTracker, Reference
from wormopt.systems.shared.declared import (
    CHAIN,
    LOOP_SIGNALS,
    REFERENCE,
    TIME,
    TRACKER_EVENTS,
    over,
)

with on_use():
    import numpy as np

    from wormopt.control.lambda_tracker import Feedback
    from wormopt.model.friction import Coulomb
    from wormopt.numerics.workers import Workers
    from wormopt.simulation.ensemble import simulate_ensemble
    from wormopt.simulation.native.build import compiler
    from wormopt.simulation.options import Tolerance, Treatment
    from wormopt.systems.chain.measured import chain_checks, chain_facts
    from wormopt.systems.chain.readings import (
        SENTENCES,
        Course,
        Example,
        Reading,
        Structure,
        as_model,
        build,
        ends,
        gait_of,
        readings,
        scenario,
        structure_of,
        supported,
    )
    from wormopt.systems.chain.tracked import Tracked, follow, follow_in_turn, tracked_signals
    from wormopt.systems.shared.proof import (
        CrossCheck,
        accepted_error,
        warnings_of_contact,
        warnings_of_motion,
    )
    from wormopt.systems.shared.signals import fitted
    from wormopt.systems.spiked import gait_of_shape

TRACKERS: dict[Feedback, str] = {"filter": "tracker (14)", "derivative": "tracker (13)"}
"""Order of the published figures: tracker (14) left, tracker (13) right."""
_MOST = 20_000  # Largest number of readings in a scene.
# Mirror images are two integrations of one motion, with gains of up to 1e4 times the error.
_MIRRORED = 1e-5
_SAMPLES, _ENDS = 1001, 33
_SHOWN = 30  # readings in Markdown
_OF_MOTIONS = (
    "gain_middle",
    "gain_end",
    "gain_growth",
    "error_peak",
    "captured_outputs",
    "captured_norm",
)
_SHORT = ("14", "13")
_SIGNALS = TIME | REFERENCE | over(LOOP_SIGNALS, "tracker") | TRACKER_EVENTS


def _loose() -> Tolerance:
    """Tolerance of readings, which differ by percents; the one that is shown is exact."""
    return Tolerance(relative=1e-9, absolute=1e-10, max_steps=200_000)


class Worm(Given):
    """Parameters of the worm that all readings share."""

    links: int = whole(1, 20, "number of links *n*; mass 0 is the head")
    mass: PerMass = entry("point masses *m*<sub>i</sub>", quantity="mass")
    stiffness: PerLink = entry("spring constants *c*<sub>j</sub>", quantity="stiffness")
    damping: NonNegativePerLink = entry("dashpot constants *d*<sub>j</sub>", quantity="drag")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_count("mass", self.mass, self.links + 1, "masses")
        for name in ("stiffness", "damping"):
            yield from wrong_count(name, getattr(self, name), self.links, "links")


class Trackers(Given):
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


class Alternatives(Given):
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

    @property
    def count(self) -> int:
        """Number of combinations."""
        return prod(len(getattr(self, name)) for name in self.__struct_fields__)

    def faults_of_keys(self) -> Iterator[Fault]:
        for name in self.__struct_fields__:
            given = getattr(self, name)
            if not given:
                yield name, "is empty; write at least one entry"
            elif len(set(given)) < len(given):
                yield name, "repeats an entry; write each once"
        if self.count > _MOST:
            what = f"have {self.count} combinations, but at most {_MOST} are simulated"
            yield "", f"{what}; shorten a list"

    @property
    def choices(self) -> dict[str, Sequence[Any]]:
        """Entries by the names of `Reading`."""
        given: dict[str, Sequence[Any]] = {n: getattr(self, n) for n in self.__struct_fields__}
        rests = [None if value == "reference" else value for value in given["rest_length"]]
        return given | {"rest_length": rests}


@dataclass(frozen=True)
class Judged:
    """Results of every reading."""

    reading_choice: np.ndarray = signal(
        "count", "reading choice", "chosen entry of each key of readings, from 0"
    )
    supported: np.ndarray = signal(
        "count", "reading sentence", "1 if the reading supports the sentence"
    )
    gain_middle: np.ndarray = signal("count", "tracker reading", "gain at half the time")
    gain_end: np.ndarray = signal("count", "tracker reading", "gain at the end")
    gain_growth: np.ndarray = signal("share", "tracker reading", "growth of the gain in the window")
    error_peak: np.ndarray = signal(
        "length", "tracker reading", "largest norm of the error in the window"
    )
    captured_outputs: np.ndarray = signal(
        "time", "tracker reading", "time from which every output stays in its strip"
    )
    captured_norm: np.ndarray = signal(
        "time", "tracker reading", "time from which the norm of the error stays in the tube"
    )
    ends_first: np.ndarray = signal(
        "time", "reading", "first end of the interval for which every sentence holds"
    )
    ends_last: np.ndarray = signal(
        "time", "reading", "last end of the interval for which every sentence holds"
    )
    n_readings: int = value("count", "readings")
    n_supporting: int = value("count", "readings that support every sentence")
    most_supported: int = value("count", "sentences that the best reading supports")
    chosen: int = value("count", "index of the reading that is shown, from 0")
    chosen_departures: int = value(
        "count", "number of keys in which it departs from the first entries"
    )
    chosen_gain: np.ndarray = value("count", "gains of the shown reading at the end")
    given_up: int = value("count", "numbers of divergent motions with trackers (13) and (14)")


class TrackerReadings(Study, kind="tracker-readings"):
    """Compare interpretations of the tracker example of Zimmermann et al. 2007.

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
    `sentence_meanings`, `choices` (keys of `[readings]`), `chosen_reading`. The trust report
    compares mirror images: a reading with F<sub>+</sub>, F<sub>−</sub> and the order of links
    exchanged has the same errors and gains.

    Not allowed: equal entries; lists of `start` without one number per mass; more than 20000
    combinations; a window of at least half of the time.
    """

    pictures: ClassVar = {
        "readings": "entries that support each sentence, and their numbers",
        "trackers": "the shown reading, in the order of figures 5 to 8",
    }
    table_file: ClassVar = True
    exports: ClassVar = {"readings.csv": "wormopt.systems.chain.tracker_readings:as_csv"}
    headline: ClassVar = (
        "n_readings",
        "n_supporting",
        "most_supported",
        "chosen_departures",
        "chosen_gain",
    )

    worm: Worm = entry("the worm")
    reference: Reference = entry("reference of the links; each reading sets its period")
    tracker: Trackers = entry("parameters of both trackers")
    readings: Alternatives = entry("alternatives of the readings")
    sentences: Criteria = entry("criteria of the sentences")
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        links = self.worm.links
        yield from self.reference.gait.faults(links, self.folder, "reference.gait")
        yield from wrong_count("tracker.filter_start", self.tracker.filter_start, links, "links")
        for k, start in enumerate(self.readings.start):
            yield from wrong_count(f"readings.start[{k}]", start, links + 1, "masses")
        if 2 * self.sentences.window >= self.time.end:
            yield (
                "sentences.window",
                f"is not below half of time.end = {self.time.end:g}; write less",
            )

    # -- all readings ------------------------------------------------------------------------------

    @cached_property
    def example(self) -> Example:
        """Parameters that all readings share."""
        worm, tracker, n = self.worm, self.tracker, self.worm.links
        return Example(
            gait_of_shape(self.reference.gait, self.scene, "reference.gait"),
            np.array(per(worm.mass, n + 1)),
            np.array(per(worm.stiffness, n)),
            np.array(per(worm.damping, n)),
            tracker.tube_radius,
            tracker.gain_start,
            np.array(per(tracker.filter_start, n)),
            self.reference.shift,
        )

    @cached_property
    def listed(self) -> Sequence[Reading]:
        """Every combination."""
        return readings(**self.readings.choices)

    @stage
    def motions(self) -> dict[tuple[str, int], Course]:
        """Motions by tracker and reading; the signs of tracker (14) do not affect tracker (13)."""
        listed = self.listed
        groups: dict[Structure, list[int]] = {}
        for name in TRACKERS:
            for k, reading in enumerate(listed):
                if name == "filter" or reading.signs == listed[0].signs:
                    groups.setdefault(structure_of(reading, name), []).append(k)
        work = partial(_courses, self.example, self.time.end, self.contact.options)
        jobs = [(of, [listed[k] for k in members]) for of, members in groups.items()]
        found: dict[tuple[str, int], Course] = {}
        with Workers() as workers:
            made = zip(groups.items(), workers.map(work, jobs), strict=True)
            for count, ((structure, members), several) in enumerate(made, 1):
                found |= zip(((structure.feedback, k) for k in members), several, strict=True)
                self.report("simulating readings", count / len(groups))
        alike = len(self.readings.signs)  # the key that varies fastest
        for k in range(len(listed)):
            found["derivative", k] = found["derivative", k - k % alike]
        return found

    @parts(Judged)
    def judged(self) -> Judged:
        radius = self.tracker.tube_radius
        return _judge(self.motions, self.readings.choices, radius, self.sentences)

    # -- the reading that is shown -----------------------------------------------------------------

    @stage
    def shown(self) -> list[Tracked]:
        """Exact motions of the chosen reading."""
        return follow_in_turn(partial(self._follow, name) for name in TRACKERS)

    def _follow(self, name: Feedback) -> Tracked:
        reading = self.listed[self.judged.chosen]
        of = structure_of(reading, name)
        loop = build(self.example, of)
        loop = as_model(loop, scenario(self.example, reading, of, loop))
        of_kind = FilterTracker if name == "filter" else DerivativeTracker
        tracker = of_kind(tube_radius=self.tracker.tube_radius)
        span = self.time.end, self.time.samples
        how = self.contact.options, self.tolerance.options, self.report
        return follow(TRACKERS[name], tracker, loop, *span, *how)

    @stage
    def recheck(self) -> list[CrossCheck | None]:
        again = self.tolerance.recheck
        return [each.recheck(self.tolerance.options, again, self.report) for each in self.shown]

    @scalar(*CHAIN["recheck_error"])
    def recheck_error(self) -> list[float | None]:
        return [second and second.error for second in self.recheck]

    @arrays(_SIGNALS)
    def signals(self) -> Mapping[str, Any]:
        if len(self.shown) < len(TRACKERS):  # of a partial result
            return {}
        return fitted(tracked_signals(self.shown), _SIGNALS)

    @attributes
    def names(self) -> dict[str, Any]:
        choices, found = self.readings.choices, self.judged
        picked = zip(choices.items(), found.reading_choice[found.chosen], strict=True)
        return {
            "trackers": list(TRACKERS.values()),
            "sentences": list(SENTENCES),
            "sentence_meanings": list(SENTENCES.values()),
            "choices": {name: list(entries) for name, entries in choices.items()},
            "chosen_reading": {name: entries[k] for (name, entries), k in picked},
            "table": _table_of(self.sentences, self.time.end, choices, found),
        }

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_readings(self) -> Iterator[Check]:
        found = self.judged
        yield from _mirror(self.example, self.listed, found.gain_end)
        gains = found.gain_end[:, found.chosen]
        for each, second, gain in zip(self.shown, self.recheck, gains, strict=True):
            yield from chain_checks(second, each.energies, self.tolerance.options, each.label)
            yield _same(each, gain)

    @warnings
    def doubts(self) -> Iterator[str]:
        chosen = self.listed[self.judged.chosen]
        yield from warnings_of_contact(self.contact.options, [Coulomb(*chosen.friction)])
        for each, second in zip(self.shown, self.recheck, strict=True):
            yield from warnings_of_motion(each.motion, second)

    @facts
    def simulations(self) -> dict[str, Any]:
        motions, energies = zip(*((o.motion, o.energies) for o in self.shown), strict=True)
        return chain_facts(motions, self.recheck, self.tolerance.options, energies)


def _courses(
    example: Example, end: float, contact: Treatment, job: tuple[Structure, Sequence[Reading]]
) -> list[Course]:
    """Simulate readings of one structure."""
    of, members = job
    loop = build(example, of)
    times = np.linspace(0.0, end, _SAMPLES)
    # Positive feedback of the error grows beyond bounds; implicit steps are not worth their cost.
    explicit = "native" if compiler() else "python"
    herd = simulate_ensemble(
        loop,
        end,
        [scenario(example, each, of, loop) for each in members],
        contact=contact,
        times=times,
        tolerance=_loose(),
        route=explicit if of.unstable else "auto",
    )
    masses, gain = example.links + 1, 2 * (example.links + 1)  # gains follow positions and rates
    wanted = [gait_of(example, reading)(times + example.shift) for reading in members]
    return [
        Course(times, -np.diff(states[:masses], axis=0) - lengths, states[gain])
        for lengths, states in zip(wanted, herd.states, strict=True)
    ]


def _judge(
    courses: Mapping[tuple[str, int], Course],
    choices: Mapping[str, Sequence[Any]],
    radius: float,
    by: Criteria,
) -> Judged:
    """Compare all readings with the sentences; pick the one that is shown."""
    lengths = [len(entries) for entries in choices.values()]
    count = prod(lengths)
    supports, lasting = [], []
    for k in range(count):
        pair = courses["derivative", k], courses["filter", k]
        supports.append(list(supported(*pair, radius, by).values()))
        held = list(ends(*pair, radius, by, _ENDS)) if all(supports[-1]) else []
        lasting.append((held[0], held[-1]) if held else (np.nan, np.nan))
    numbers = [
        [_numbers(courses[name, k], radius, by.window) for k in range(count)] for name in TRACKERS
    ]
    arrays = {n: np.array([[each[n] for each in row] for row in numbers]) for n in numbers[0][0]}
    picks = np.array(np.unravel_index(np.arange(count), lengths)).T
    holds, (first, last) = np.array(supports), np.array(lasting).T
    supporting, departures = holds.sum(axis=1), np.sum(picks > 0, axis=1)
    # most sentences, then fewest departures, then the longest range of ends, then the first
    ranks = zip(-supporting, departures, -np.nan_to_num(last - first), range(count), strict=True)
    chosen = min(ranks)[-1]
    return Judged(
        reading_choice=picks,
        supported=holds.astype(float),
        **arrays,
        ends_first=first,
        ends_last=last,
        n_readings=count,
        n_supporting=int(np.sum(holds.all(axis=1))),
        most_supported=int(supporting.max()),
        chosen=chosen,
        chosen_departures=int(departures[chosen]),
        chosen_gain=arrays["gain_end"][:, chosen],
        given_up=int(np.sum(np.isnan(arrays["gain_end"]))),
    )


def _numbers(course: Course, radius: float, window: float) -> dict[str, float]:
    return {
        "gain_middle": float(course.gain[len(course.gain) // 2]),
        "gain_end": float(course.gain[-1]),
        "gain_growth": course.growth(window),
        "error_peak": course.peak(window),
        "captured_outputs": course.captured(radius, "outputs", window),
        "captured_norm": course.captured(radius, "norm", window),
    }


def _same(each: Tracked, gain: float) -> Check:
    """Whether the shown motion agrees with the judged reading."""
    exact = float(each.motion["gain"][0, -1])
    off, accepted = abs(gain / exact - 1), accepted_error(_loose())
    advice = (
        f"{each.label}: the gain of the judged reading differs from the exact gain by {off:.2g}"
    )
    return Check(f"{each.label}: gain as judged", off, accepted, advice)


def _mirror(example: Example, listed: Sequence[Reading], gains: np.ndarray) -> Iterator[Check]:
    """Mirror images have the same gains: F+ and F- exchanged, and the order of links."""
    places = {reading: k for k, reading in enumerate(listed)}
    pairs = [(k, places[image]) for reading, k in places.items()
             if (image := _image(reading)) in places and places[image] > k
             and _symmetric(example, reading)]  # fmt: skip
    if not pairs:
        return
    one, other = np.array(pairs).T
    off = float(np.nanmax(abs(gains[:, one] / gains[:, other] - 1), initial=0.0))
    advice = f"the gains of {len(pairs)} pairs of mirror images differ by {off:.2g}"
    yield Check("mirror images", off, _MIRRORED, advice)


def _image(reading: Reading) -> Reading:
    links = "reversed" if reading.links == "printed" else "printed"
    forward, backward = reading.friction
    return Reading(**vars(reading) | {"links": links, "friction": (backward, forward)})


def _symmetric(example: Example, reading: Reading) -> bool:
    rows = (
        example.mass,
        example.stiffness,
        example.damping,
        example.filter_start,
        np.diff(reading.start),
    )
    return all(np.array_equal(row, row[::-1]) for row in rows)


# -- tables of all readings ------------------------------------------------------------------------


def _table_of(by: Criteria, end: float, choices: Mapping[str, Sequence[Any]], found: Judged) -> str:
    """Markdown with the results of all readings."""
    half = end / 2
    lines = [
        f"{found.n_readings} readings to t = {end:g}. Strips: {by.strips}; "
        f"quick: within {by.quick:g}; growth and errors: in the last {by.window:g}; converged: "
        f"growth up to {by.settled:g}; growing: from {by.growing:g} on.",
        "",
        *(f"- **{name}**: {what}" for name, what in SENTENCES.items()),
        "",
        "## Readings that support each sentence, by entry",
        "",
        *_shares(choices, found),
        "",
        "## Best readings",
        "",
        f"The first row is the literal reading. Columns: k at t = {half:g} and at the end; growth "
        "and largest \\|e\\| in the window; capture by outputs and by norm; ends: range of ends "
        "for which all sentences hold.",
        "",
        *_best(choices, found),
        "",
    ]
    return "\n".join(lines)


def _shares(choices: Mapping[str, Sequence[Any]], found: Judged) -> Iterator[str]:
    supports, picks = found.supported > 0, found.reading_choice
    yield from _head(["", "", *SENTENCES, "all"])
    rows = [("every reading", "", np.ones(len(supports), bool))]
    for k, (name, entries) in enumerate(choices.items()):
        rows += [(name, _text(one), picks[:, k] == i) for i, one in enumerate(entries)]
    for name, one, own in rows:
        counts = [*supports[own].sum(axis=0), supports[own].all(axis=1).sum()]
        yield _line([name, one, *(f"{count} / {own.sum()}" for count in counts)])


def _best(choices: Mapping[str, Sequence[Any]], found: Judged) -> Iterator[str]:
    supports, picks = found.supported > 0, found.reading_choice
    order = np.lexsort((np.sum(picks > 0, axis=1), -supports.sum(axis=1)))
    shown = list(dict.fromkeys([0, found.chosen, *order.tolist()]))[:_SHOWN]
    yield from _head([*choices, *(f"({t})" for t in _SHORT), "ends", "not supported"])
    for k in shown:
        own = [_text(e[i]) for e, i in zip(choices.values(), picks[k], strict=True)]
        ends = f"{found.ends_first[k]:.3g} to {found.ends_last[k]:.3g}"
        missing = ", ".join(np.array(list(SENTENCES))[~supports[k]]) or "none"
        motions = [_motion(found, row, k) for row in range(2)]
        yield _line([*own, *motions, ends if supports[k].all() else "–", missing])


def _motion(found: Judged, tracker: int, reading: int) -> str:
    values = [getattr(found, name)[tracker, reading] for name in _OF_MOTIONS]
    if not np.isfinite(values[1]):
        return "grows beyond bounds"
    first = [f"{value:.4g}" for value in values[:2]] + [f"{value:.2g}" for value in values[2:4]]
    return " · ".join(first + ["never" if np.isnan(v) else f"{v:.2f}" for v in values[4:]])


def as_csv(result: Result) -> str:
    """All readings as CSV, one per line: choices, results of both trackers, sentences."""
    choices: Mapping[str, Sequence[Any]] = result.attributes["choices"]
    names = result.attributes["sentences"]
    picks, supports = result["reading_choice"].values, result["supported"].values
    head = [*choices, *(f"{n}_{t}" for t in _SHORT for n in _OF_MOTIONS), *names]
    lines = [",".join([*head, "ends_first", "ends_last"])]
    for k in range(len(supports)):
        own = [_plain(e[int(i)]) for e, i in zip(choices.values(), picks[k], strict=True)]
        numbers = [result[n].values[t, k] for t in range(2) for n in _OF_MOTIONS]
        ends = [result[n].values[k] for n in ("ends_first", "ends_last")]
        cells = [*own, *map(_number, numbers), *(f"{int(s)}" for s in supports[k])]
        lines.append(",".join([*cells, *map(_number, ends)]))
    return "\n".join([*lines, ""])


def _text(entry: Any) -> str:
    if entry is None:
        return "reference"
    if isinstance(entry, list | tuple):
        return "(" + ", ".join(f"{value:g}" for value in entry) + ")"
    return entry if isinstance(entry, str) else f"{entry:.3g}"


def _plain(entry: Any) -> str:
    if isinstance(entry, list | tuple):
        return " ".join(repr(value) for value in entry)
    return "reference" if entry is None else str(entry)


def _number(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def _head(names: Sequence[str]) -> Iterator[str]:
    yield _line(names)
    yield _line(["---"] * len(names))


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
