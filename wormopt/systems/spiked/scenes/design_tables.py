"""Tables of a design: limits of the gait, what to seek, and how to search and prove."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from msgspec import Meta, structs

from wormopt.errors import Fault
from wormopt.scene.types import (
    NonNegative,
    PairPerLink,
    PerLink,
    PerMass,
    Positive,
    PositiveOrPair,
    Seed,
    Table,
    says,
)
from wormopt.systems.spiked.limits import Limits, Rates, Sharing
from wormopt.systems.spiked.task import MOST_LINKS, Certify, Cost, Effort, Objective, Search

Resting = Annotated[int, Meta(ge=1, le=MOST_LINKS, description="a whole number, 1 or above")]
Phases = Annotated[int, Meta(ge=2, le=64, description="a whole number from 2 to 64")]
Gap = Annotated[float, Meta(ge=1e-5, le=0.5, description="a number from 1e-5 to 0.5")]
Workers = Annotated[int, Meta(ge=1, le=1024, description="a whole number from 1 to 1024")]
Order = Annotated[
    tuple[tuple[Annotated[int, Meta(ge=0, le=MOST_LINKS)], ...], ...],
    Meta(description="a list of lists of mass indices, [[0], [2], [1]] say"),
]


COST_WORDS = (
    "`peak_spike_load` (force): largest load on one spike over time and masses; "
    "`peak_actuator_force` (force): largest |*μ*<sub>j</sub>| over time and links; "
    "`energy_per_distance`: ∫ Σ<sub>j</sub> max(0, *P*<sub>j</sub>) d*t* over a period, by the "
    "advance, nothing is recovered; `acceleration_effort` (acceleration squared): mean over time "
    "of Σ<sub>j</sub> *l*<sub>j</sub>″²"
)


class RateTable(Table, frozen=True, kw_only=True):
    """Limits on the rate of a link, apart for both directions."""

    contraction: Annotated[PerLink, says("speed", "largest −*l*′")]
    extension: Annotated[PerLink, says("speed", "largest *l*′")]


class LimitTable(Table, frozen=True, kw_only=True):
    """What a designed gait must keep to. Limits left out do not hold.

    *σ* ≥ 0 holds in every design: the worm never glides.

    Refused: a reversed range of periods or loads; a period, or range of it, that holds no whole
    number of ticks; an empty length range; `resting` above *n*; lists of the wrong length; neither
    `rate` nor `acceleration`; no `acceleration` without `impulses = true`; `impulses = true`
    together with `acceleration` (which forbids jumps) or `actuator_force` (which every impulse
    exceeds).
    """

    period: Annotated[
        PositiveOrPair,
        says(
            "time",
            "the motion repeats after it, fixed or to choose; one or more equal cycles fill it, as "
            "many as are best",
        ),
    ]
    length: Annotated[PairPerLink, says("length", "range of each link")]
    resting: Annotated[
        Resting, says("count", "at least so many masses rest at any time, up to *n*")
    ] = 1
    rate: Annotated[
        PerLink | RateTable | None,
        says(
            "speed",
            "largest |*l*′|, one number for all or one per link; or largest −*l*′ and *l*′ apart: "
            "a table with `contraction` and `extension`, both per link",
        ),
    ] = None
    acceleration: Annotated[PerLink | None, says("acceleration", "largest |*l*″|")] = None
    spike_load: Annotated[
        PerMass | None,
        says(
            "force",
            "largest load *λ*<sub>i</sub> on one spike; a single resting mass bears (*n* + 1) *λ*",
        ),
    ] = None
    actuator_force: Annotated[PerLink | None, says("force", "largest |*μ*<sub>j</sub>|")] = None
    sigma_margin: Annotated[NonNegative, says("force", "*σ* of (7) stays at or above this")] = 0.0
    sharing: Annotated[
        Sharing,
        says(
            "",
            "how several resting masses share the load, see "
            "[theory](../theory-kinematic.md#87-sharing-in-a-design); with `least_actuation` a "
            "spike at its `spike_load` leaves the rest to the others",
        ),
    ] = "equal"
    impulses: Annotated[
        bool,
        says(
            "",
            "velocities may jump; refused together with `acceleration`, `spike_load`, "
            "`actuator_force` and all costs",
        ),
    ] = False
    tick: Annotated[
        Positive | None,
        says(
            "time",
            "tick of a controller: a cycle lasts a whole number of ticks, so that lengths exported "
            "at the ticks repeat exactly ([export](../export.md#gaits-for-a-controller)); at most "
            "a million ticks in the shortest period",
        ),
    ] = None
    length_step: Annotated[
        Positive | None,
        says(
            "length",
            "with `tick`: lengths exported at instants are rounded to multiples of it within "
            "`length`, of a stepping motor `lead`/(`steps_per_turn` · `microsteps`); all else is "
            "of the gait before that",
        ),
    ] = None

    @property
    def limits(self) -> Limits:
        """The limits themselves."""
        given = {name: getattr(self, name) for name in self.__struct_fields__}
        if isinstance(self.rate, RateTable):
            given["rate"] = Rates(self.rate.contraction, self.rate.extension)
        return Limits(**given)


class ObjectiveTable(Table, frozen=True, kw_only=True):
    """What makes a gait the best: exactly one of `maximise` and `minimise`.

    Refused: no objective or two; `minimise` without `speed`; any cost with `impulses = true` (none
    has a finite value there). `energy_per_distance` and `acceleration_effort` with a range of
    loads, on which they depend.
    """

    maximise: Annotated[Literal["speed"] | None, says("", "largest mean speed")] = None
    minimise: Annotated[
        Cost | None, says("", f"smallest cost at a required speed: {COST_WORDS}")
    ] = None
    speed: Annotated[
        Positive | None,
        says(
            "speed",
            "required mean speed (at least); needed with `minimise`, refused with `maximise`",
        ),
    ] = None

    @property
    def objective(self) -> Objective:
        """The objective itself."""
        return Objective(self.minimise, self.speed)

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        if self.maximise is None and self.minimise is None:
            yield "objective", 'no objective; write maximise = "speed", or minimise and speed'
        elif self.maximise is not None and self.minimise is not None:
            yield "objective", "two objectives; leave out maximise or minimise"
        elif self.minimise is not None and self.speed is None:
            yield (
                "objective.speed",
                "missing; minimise needs the speed to keep, a finite number above 0",
            )
        elif self.maximise is not None and self.speed is not None:
            yield "objective.speed", 'contradicts maximise = "speed"; leave one out'


class CertifyTable(Table, frozen=True, kw_only=True):
    """A sharper proof of how much better any gait could be, of kind `gait-design` only.

    It speaks of every gait within the limits: of any order of rest, number of phases and cycles.
    Its keys may all be left out, `certify = {}` is enough. What it proves:
    [certificates](../certificates.md).

    Refused: objectives `energy_per_distance` and `acceleration_effort`; `want = ["certificate"]`
    without this table; kind `gait-pareto`.
    """

    gap: Annotated[Gap, says("share", "it ends when no gait can be better by more than this")] = (
        Certify.gap
    )
    time_limit: Annotated[Positive, says("s", "it stops then, with the gap it has")] = (
        Certify.time_limit
    )


class SearchTable(Table, frozen=True, kw_only=True):
    """How the order in which masses rest is sought.

    Without `phases`, plain orders are listed up to 4 phases, and variations go up to 12 phases;
    constructed orders have as many as they need (a travelling wave of *n* links up to *n* + 1).
    How orders are tried: [theory](../theory-kinematic.md#84-the-search-over-orders).

    | effort | plain orders, at most | orders varied at a time, twice as many after a round in vain | variations a round, at most | rounds in vain before they end | work, pivots times rows and columns | other starts (of a cost) | orders sharpened |
    | --- | --- | --- | --- | --- | --- | --- | --- |
    | `quick` | 16 | 1 | 8 | 1 | 3e8 | 1 (1) | 1 |
    | `normal` | 160 | 4 | 240 | 2 | 7e8 | 1 (3) | 4 |
    | `thorough` | 1000 | 8 | 800 | 2 | 6e9 | 1 (8) | 8 |

    Half of the work is for plain orders. Besides the best, only orders within 0.2 % of it are
    sharpened.

    Refused in `sequence`: fewer than two phases, or more than `phases`; a mass that is not there
    or is named twice in a phase; fewer than `gait.resting` masses in a phase; two neighbouring
    phases (the last and the first too) with the same masses. No mass may rest in all phases: the
    worm could not advance.
    """  # noqa: E501

    seed: Annotated[Seed, says("", "seed of the random starts")] = 0
    effort: Annotated[Effort, says("", "how much is searched")] = "normal"
    phases: Annotated[Phases | None, says("count", "most phases of a cycle")] = None
    sequence: Annotated[
        Order | None,
        says("", "resting masses of each phase of a cycle in turn; nothing else is tried"),
    ] = None
    time_limit: Annotated[
        Positive | None,
        says(
            "s",
            "the search ends then, and the best gait so far is taken, with a warning and exit code "
            "0. It is looked at between linear programs; orders already begun are still fitted to "
            "the period, which with many links takes longer than the limit itself",
        ),
    ] = None
    workers: Annotated[
        Workers | None,
        says(
            "count",
            "processes of the search, if left out 1 up to two links, else one per processor; its "
            "result does not depend on it",
        ),
    ] = None
    gap: Annotated[
        Gap,
        says(
            "share",
            "a search for speed ends when no gait can be faster by more than this, as proven "
            "before it begins by linear programs that take tenths of a second",
        ),
    ] = Search.gap
    certify: Annotated[
        CertifyTable | None,
        says("", "a sharper bound of every gait, for peak loads too"),
    ] = None

    @property
    def search(self) -> Search:
        """The settings themselves."""
        given: dict[str, Any] = structs.asdict(self)
        del given["certify"]
        return Search(**given)

    @property
    def proof(self) -> Certify | None:
        """The proof that is wanted."""
        return None if self.certify is None else Certify(**structs.asdict(self.certify))

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield what is wrong with the designer's own sequence.

        `resting`: at least so many masses rest at any time.
        """
        for key, message in self.search.faults(links, resting):
            yield f"search.{key}", in_scene(message)


def in_scene(told: str) -> str:
    """What an engine says of a task in the words of its scene, where limits stand in [gait].

    `told` is a name, "limits.rate" say, or a sentence with such names.
    """
    return re.sub(r"\blimits\.(?=[a-z])", "gait.", told)
