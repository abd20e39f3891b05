"""Tables of a design: limits of the gait, motors, objective, search and certificate."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, structs

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.later import on_use
from wormopt.study.types import (
    PairPerLink,
    PerLink,
    PerMass,
    PositiveOrPair,
    SceneTable,
    Seed,
)
from wormopt.systems.spiked.limits import Limits, Rates, Sharing
from wormopt.systems.spiked.tables import WormTable
from wormopt.systems.spiked.task import (
    MOST_LINKS,
    Certify,
    Cost,
    Effort,
    GaitProblem,
    Objective,
    Search,
)

with on_use():
    from wormopt.systems.spiked.stepper.stepper import Stepper

Resting = Annotated[int, Meta(ge=1, le=MOST_LINKS, description="a whole number, 1 or above")]
Order = Annotated[
    tuple[tuple[Annotated[int, Meta(ge=0, le=MOST_LINKS)], ...], ...],
    Meta(description="a list of lists of mass indices, for example [[0], [2], [1]]"),
]


COST_WORDS = (
    "`peak_spike_load` (force): largest load on one spike over time and masses; "
    "`peak_actuator_force` (force): largest |*μ*<sub>j</sub>| over time and links; "
    "`energy_per_distance`: ∫ Σ<sub>j</sub> max(0, *P*<sub>j</sub>) d*t* over a period divided by "
    "the advance, without recovery; `acceleration_effort` (acceleration squared): mean over time "
    "of Σ<sub>j</sub> *l*<sub>j</sub>″²"
)


class RateTable(Given):
    """Limits on the rate of a link, separate for both directions."""

    contraction: PerLink = entry("largest −*l*′", quantity="speed")
    extension: PerLink = entry("largest *l*′", quantity="speed")


class LimitTable(Given):
    """Limits that the designed gait must meet. A limit that is not given does not apply.

    *σ* ≥ 0 holds in every design, so the worm never glides.

    Refused: a reversed range of periods or loads; a period, or range of periods, that contains no
    whole number of ticks; an empty length range; `resting` above *n*; lists of the wrong length;
    neither `rate` nor `acceleration`; no `acceleration` without `impulses = true`; `impulses =
    true` together with `acceleration` (which forbids jumps) or `actuator_force` (which every
    impulse exceeds).
    """

    period: PositiveOrPair = entry(
        "the motion repeats after this time, one number or a range to choose from; the design "
        "fills it with the optimal number of equal cycles",
        quantity="time",
    )
    length: PairPerLink = entry("range of each link", quantity="length")
    resting: Resting = entry(
        "smallest number of masses at rest at any time, at most *n*", quantity="count", default=1
    )
    rate: PerLink | RateTable | None = entry(
        "largest |*l*′|, one number for all links or one per link; or a table with "
        "`contraction` (largest −*l*′) and `extension` (largest *l*′), each a number or one "
        "per link",
        quantity="speed",
        default=None,
    )
    acceleration: PerLink | None = entry("largest |*l*″|", quantity="acceleration", default=None)
    spike_load: PerMass | None = entry(
        "largest load *λ*<sub>i</sub> on one spike; a single resting mass carries (*n* + 1) *λ*",
        quantity="force",
        default=None,
    )
    actuator_force: PerLink | None = entry(
        "largest |*μ*<sub>j</sub>|", quantity="force", default=None
    )
    sigma_margin: float = number(
        "force", "lower bound on *σ* of eq. 7 of Zimmermann et al. 2007", least=0, default=0.0
    )
    sharing: Sharing = entry(
        "how several resting masses share the load, see "
        "[theory](../theory-kinematic.md#87-sharing-in-a-design); with `least_actuation`, a "
        "spike at its `spike_load` leaves the remaining load to the others",
        default="equal",
    )
    impulses: bool = entry(
        "velocities may jump; refused together with `acceleration`, `spike_load`, "
        "`actuator_force` and all costs",
        default=False,
    )
    tick: float | None = positive(
        "time",
        "tick of a controller: a cycle is a whole number of ticks, so lengths exported at the "
        "ticks repeat exactly ([export](../export.md#gaits-for-a-controller)); at most a "
        "million ticks in the shortest period",
        default=None,
    )
    length_step: float | None = positive(
        "length",
        "with `tick`: lengths exported at the ticks are rounded to multiples of this step "
        "within `length`. For a stepping motor the step is `lead`/(`steps_per_turn` · "
        "`microsteps`). All other results belong to the gait before rounding",
        default=None,
    )

    @property
    def limits(self) -> Limits:
        """The limits as an engine object."""
        given = {name: getattr(self, name) for name in self.__struct_fields__}
        if isinstance(self.rate, RateTable):
            given["rate"] = Rates(self.rate.contraction, self.rate.extension)
        return Limits(**given)


class ObjectiveTable(Given):
    """The objective: exactly one of `maximise` and `minimise`.

    Refused: no objective or two; `minimise` without `speed`; any cost with `impulses = true`, where
    costs are infinite; `energy_per_distance` and `acceleration_effort` with a range of loads,
    because they depend on the load.
    """

    maximise: Literal["speed"] | None = entry("maximise the mean speed", default=None)
    minimise: Cost | None = entry(
        f"minimise a cost at a required speed: {COST_WORDS}", default=None
    )
    speed: float | None = positive(
        "speed",
        "required mean speed, a lower bound; required with `minimise`, refused with `maximise`",
        default=None,
    )

    @property
    def objective(self) -> Objective:
        """The objective as an engine object."""
        return Objective(self.minimise, self.speed)

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        if self.maximise is None and self.minimise is None:
            yield (
                "objective",
                'no objective is given; write maximise = "speed", or minimise and speed',
            )
        elif self.maximise is not None and self.minimise is not None:
            yield "objective", "maximise and minimise are given; write only one of them"
        elif self.minimise is not None and self.speed is None:
            yield (
                "objective.speed",
                "missing; minimise needs the required speed: write a finite number above 0",
            )
        elif self.maximise is not None and self.speed is not None:
            yield "objective.speed", 'given with maximise = "speed"; remove one of them'


class CertifyTable(Given):
    """Settings of a tighter bound on the objective of any gait, for kind `gait-design` only.

    The bound applies to every gait within the limits, with any resting sequence, number of phases
    and cycles. All keys have defaults; `certify = {}` is enough. [Certificates](../certificates.md)
    explains what is proven.

    Refused: objectives `energy_per_distance` and `acceleration_effort`; `want = ["certificate"]`
    without this table; kind `gait-pareto`.
    """

    gap: float = number(
        "share",
        "end when no gait can be better by more than this share",
        least=1e-05,
        most=0.5,
        default=Certify.gap,
    )
    time_limit: float = positive(
        "s", "end after this time with the gap reached so far", default=Certify.time_limit
    )


class SearchTable(Given):
    """Search over the sequences in which masses rest.

    Without `phases`, plain sequences are listed up to 4 phases and varied up to 12 phases.
    Constructed sequences have as many phases as they need; a travelling wave of *n* links has up to
    *n* + 1. [Theory](../theory-kinematic.md#84-the-search-over-orders) explains how sequences are
    tried.

    | effort | plain sequences, at most | sequences varied at a time, doubled after a round without gain | variations per round, at most | rounds without gain before the end | work, pivots times rows and columns | other starts (for a cost) | sequences sharpened |
    | --- | --- | --- | --- | --- | --- | --- | --- |
    | `quick` | 16 | 1 | 8 | 1 | 3e8 | 1 (1) | 1 |
    | `normal` | 160 | 4 | 240 | 2 | 7e8 | 1 (3) | 4 |
    | `thorough` | 1000 | 8 | 800 | 2 | 6e9 | 1 (8) | 8 |

    Half of the work is spent on plain sequences. Besides the best sequence, only those within 0.2 %
    of it are sharpened.

    Refused in `sequence`: fewer than two phases, or more than `phases`; a mass that does not exist
    or appears twice in a phase; fewer than `gait.resting` masses in a phase; the same masses in two
    neighbouring phases (the last and the first are neighbours). No mass may rest in all phases,
    because the worm could not advance.
    """  # noqa: E501

    seed: Seed = entry("seed of the random starts", default=0)
    effort: Effort = entry("extent of the search, see above", default="normal")
    phases: int | None = whole(2, 64, "largest number of phases of a cycle", default=None)
    sequence: Order | None = entry(
        "resting masses of each phase of a cycle; only this sequence is used", default=None
    )
    time_limit: float | None = positive(
        "s",
        "the search ends after this time and returns the best gait so far, with a warning and "
        "exit code 0. The time is checked between linear programs. Sequences already begun "
        "are still fitted to the period, which can take longer than the limit itself if there "
        "are many links",
        default=None,
    )
    workers: int | None = whole(
        1,
        1024,
        "processes of the search; default: 1 up to two links, else one per processor. The "
        "result does not depend on it",
        default=None,
    )
    gap: float = number(
        "share",
        "a search for speed ends when no gait can be faster by more than this, as proven "
        "before it begins by linear programs that take tenths of a second",
        least=1e-05,
        most=0.5,
        default=Search.gap,
    )
    certify: CertifyTable | None = entry(
        "tighter bound on the objective of any gait, for peak loads too", default=None
    )

    @property
    def search(self) -> Search:
        """The search settings as an engine object."""
        given: dict[str, Any] = structs.asdict(self)
        del given["certify"]
        return Search(**given)

    @property
    def proof(self) -> Certify | None:
        """The settings of the proof; None without one."""
        return None if self.certify is None else Certify(**structs.asdict(self.certify))

    def faults(self, links: int, resting: int) -> Iterator[Fault]:
        """Yield the faults of the given sequence; `resting` is the smallest number at rest."""
        for key, message in self.search.faults(links, resting):
            yield f"search.{key}", in_scene(message)


class Motor(Given):
    """A stepping motor on a threaded rod; all links have the same motor."""

    lead: float = positive("length", "travel along the rod per turn")
    steps_per_turn: int = whole(1, 100000, "full steps per turn", default=200)
    microsteps: int = whole(1, 100000, "microsteps per full step", default=1)
    rate_max: float = positive("rate", "largest rate, turns per time")
    acceleration_max: float = positive(
        "rate_change", "largest change of the rate, turns per time squared"
    )
    start_rate: float = number(
        "rate",
        "rate up to which the motor starts, stops and reverses without a ramp",
        least=0,
        default=0.0,
    )
    hysteresis: float = number(
        "share",
        "hysteresis as a share of a microstep: distance by which a length must pass the "
        "middle between two positions before the motor steps",
        least=0,
        most=0.4,
        default=0.05,
    )

    @property
    def length_rate(self) -> float:
        """Largest rate of a length."""
        return self.lead * self.rate_max

    @property
    def length_acceleration(self) -> float:
        """Largest acceleration of a length."""
        return self.lead * self.acceleration_max

    @property
    def stepper(self) -> Stepper:
        """The motor as an engine object."""
        return Stepper(**structs.asdict(self))

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a start rate that is too large."""
        if self.start_rate > self.rate_max:
            yield (
                "start_rate",
                f"{self.start_rate:g} is above motor.rate_max = {self.rate_max:g}; write at most "
                "motor.rate_max",
            )


class DesignTable(SceneTable):
    """Tables shared by all scenes that design gaits."""

    worm: WormTable = entry("the worm")
    gait: LimitTable = entry("the limits")
    search: SearchTable = entry("how to search", default=SearchTable)
    motor: Motor | None = entry(
        "a stepping motor with a threaded rod on each link; none by default. |*l*′| ≤ `lead` "
        "· `rate_max` and |*l*″| ≤ `lead` · `acceleration_max` hold in addition to the limits "
        "in `[gait]`, which then need no `rate` or `acceleration`. Other keys of this table "
        "have no effect on the design; the limits also hold below `start_rate`. Refused: "
        "`gait.impulses`",
        default=None,
    )

    @property
    def limits(self) -> Limits:
        """The limits, including those of the motors."""
        own, motor = self.gait.limits, self.motor
        if motor is None:
            return own
        return own.within(motor.length_rate, motor.length_acceleration, self.worm.links)

    def task(self, objective: Objective) -> GaitProblem:
        """The design problem for the given objective."""
        return GaitProblem(self.worm.worm, self.limits, objective)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_design()

    def faults_of_design(self) -> Iterator[Fault]:
        """Yield what is wrong between worm, limits, motor and search."""
        yield from self.worm.faults(self.units, loads=True)
        yield from self._faults_of_limits()
        yield from self.search.faults(self.worm.links, self.gait.resting)

    def _faults_of_limits(self) -> Iterator[Fault]:
        limits = self.gait.limits
        if self.motor is not None:
            if limits.impulses:
                yield (
                    "gait.impulses",
                    "true, but motor.acceleration_max forbids jumps of velocity; remove the key",
                )
                return
            given = {name: getattr(limits, name) or 1.0 for name in ("rate", "acceleration")}
            limits = replace(limits, **given)  # the motor gives the missing ones
        for key, message in limits.faults(self.worm.links, "gait."):
            yield f"gait.{key}".removesuffix("."), message

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if the cost at `key` cannot be minimised in this scene."""
        for message in Objective(cost).faults_within(self.worm.worm, self.gait.limits):
            yield key, in_scene(message)


def in_scene(message: str) -> str:
    """Rewrite keys of an engine message as keys of the scene: limits are in [gait].

    `message` is a name, for example "limits.rate", or a sentence with such names.
    """
    return re.sub(r"\blimits\.(?=[a-z])", "gait.", message)
