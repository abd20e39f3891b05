"""Scenes of kind "compare-tracking": controllers of one chain, measured by one simulator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import Horizon, Start, ToleranceTable
from wormopt.scene.types import (
    NonNegative,
    Pair,
    Positive,
    SceneTable,
    Seed,
    Table,
    Title,
    says,
    wrong_order,
)
from wormopt.systems.chain.scenes.chain import ChainTable, CoulombFriction
from wormopt.systems.chain.scenes.predictive import EstimationTable, PlantsTable, PredictiveTable
from wormopt.systems.chain.scenes.track import (
    DifferenceTracker,
    FunnelTracker,
    Tracker,
    faults_of_lag,
)
from wormopt.systems.chain.scenes.track_optimal import GridTable, RelaxationTable, Share, TubeTable
from wormopt.systems.shared.declared import JUDGED, LOOP_SIGNALS, TIME, over
from wormopt.systems.spiked import Shape


class DesignedShape(Table, frozen=True, kw_only=True, tag_field="shape", tag="designed"):
    """The fastest gait in which one mass after the other rests, tail first, within limits.

    It is designed when the scene runs, as in scenes of [kind `gait-design`](gait-design.md), with
    unit masses.
    """

    period: Annotated[Positive, says("time", "period")]
    length: Annotated[Pair, says("length", "shortest and longest length of every link")]
    rate: Annotated[Positive, says("speed", "limit on |*l*′|")]
    acceleration: Annotated[Positive, says("acceleration", "limit on |*l*″|")]
    load: Annotated[
        NonNegative,
        says("force", "force against forward motion on each mass for which spikes must hold"),
    ] = 0.0

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys; `key` is the key path of this table."""
        yield from wrong_order(f"{key}.length", self.length, may_be_equal=False)


class NamedReference(Table, frozen=True, kw_only=True):
    """One of the gaits that are followed."""

    name: Annotated[Title, says("", "what tables and pictures call it")]
    gait: Annotated[
        Shape | DesignedShape, says("", "a gait; `shape` decides which other keys there are")
    ]


class LqrTable(Table, frozen=True, kw_only=True):
    """LQR with feed-forward: weights of its Riccati equation."""

    error_weight: Annotated[Positive, says("", "weight of |*e*|²")]
    rate_weight: Annotated[NonNegative, says("", "weight of |*e*′|²")] = 0.0
    input_weight: Annotated[
        Positive, says("", "weight of the square of what is added to the feed-forward")
    ] = 1.0


class OptimalTable(Table, frozen=True, kw_only=True):
    """Optimal tracking and the optimal tube."""

    input_weight: Annotated[Positive, says("", "*ρ* in ∫(|*e*|² + *ρ*|*u*|²) d*t*")]
    margin: Annotated[
        Share, says("share", "share of the tube's radius that the optimiser leaves free")
    ] = 0.02


class CrawlTable(Table, frozen=True, kw_only=True):
    """The crawl of largest mean speed less a weight times the mean of |*u*|²; without reference."""

    period: Annotated[Positive, says("time", "its period")]
    length: Annotated[Pair, says("length", "shortest and longest length of every link")]
    force: Annotated[Positive, says("force", "largest |*u*<sub>j</sub>|")]
    input_weight: Annotated[NonNegative, says("", "weight of the mean of |*u*|²")] = 1e-3
    arcs: Annotated[
        int,
        Meta(ge=10, le=1000, description="a whole number from 10 to 1000"),
        says("count", "arcs of the first solve over a period"),
    ] = 60


class DrawsTable(PlantsTable, frozen=True, kw_only=True):
    """Plants that are not as believed: every number drawn by itself, uniform around its own."""

    members: Annotated[
        int,
        Meta(ge=2, le=10_000, description="a whole number from 2 to 10000"),
        says("count", "plants that are not as believed"),
    ]
    known: Annotated[
        int,
        Meta(ge=0, le=1000, description="a whole number from 0 to 1000"),
        says(
            "count",
            "for the first so many plants every plan is made anew by somebody who knows them",
        ),
    ] = 0


class MeasurementTable(Table, frozen=True, kw_only=True):
    """What controllers see of link lengths: with noise, and late.

    Noise is normal at samples, joined by cubics, so that it has hardly anything above the frequency
    1/(2 `interval`); every plant has a noise of its own. Rates are those of what is seen.
    Controllers that look at nothing are as they were.
    """

    noise: Annotated[NonNegative, says("length", "standard deviation of each link's samples")] = 0.0
    interval: Annotated[Positive, says("time", "between samples of the noise")] = 0.02
    delay: Annotated[NonNegative, says("time", "how old is what is seen")] = 0.0
    seed: Annotated[Seed, says("", "the same seed gives the same noise")] = 0

    def faults(self, end: float, trackers: Sequence[Tracker]) -> Iterator[Fault]:
        """Check what no single key shows, for motions from 0 to `end`."""
        for name in ("interval", "delay"):
            length = getattr(self, name)
            if length and end / length > _MOST_STRETCHES:
                least = end / _MOST_STRETCHES
                cut = f"cuts the time into {end / length:.2g} stretches"
                yield f"measurement.{name}", f"{cut}; write {least:g} or more"
        if self.delay and any(isinstance(t, DifferenceTracker) for t in trackers):
            message = 'is not for feedback = "difference", which has one of its own; write 0'
            yield "measurement.delay", message

    @property
    def exact(self) -> bool:
        """Whether controllers see everything as it is."""
        return not (self.noise or self.delay)


# A stretch takes milliseconds.
_MOST_STRETCHES = 1e4

COMPARED = ("error_norm", "length", "input", "position")
"""Signals that are kept of every rival."""
_RIVALS = ("reference", "rival")
RANKED = ("time_outside_tube", "error_peak", "error_integral", "input_integral", "distance")
"""Numbers of which a median over the plants is told with its interval, and who has less."""


class CompareScene(SceneTable, frozen=True, kw_only=True):
    """One chain under several controllers, nominal and with parameters that are not as believed.

    All are measured by one exact simulator: adaptive trackers, LQR with feed-forward, optimal
    tracking, the least input that stays in the tube, and the fastest crawl, which ignores the
    reference; plans open loop, and with LQR around them; with `[predictive]` predictive control in
    real time, as in scenes of [kind `track-predictive`](track-predictive.md). Then the same
    controllers, which do not know it, on plants whose parameters are drawn; and plans made anew
    for the first of these plants. With `[measurement]` feedback sees lengths with noise, and late;
    a motion whose error grows beyond ten radii of the tube then ends, and the worm counts as lost.
    All figures stand in `table.md`, beside the result; what follows from them:
    [comparison.md](../comparison.md).

    Refused: a tracker with another tube; more known plants than plants; friction of another kind
    than one `coulomb` table; `worm.random`.

    Intervals over the plants are exact: of the share that leaves the tube by Clopper and Pearson,
    of medians by order statistics, without assuming a distribution. Plants that could not be
    simulated, or are lost, count as worse than all others, on which nobody is less than another.
    With fewer than six plants medians have no bounds.

    Scalars are lists of lists, for each reference and controller. In the trust report `recheck` is
    the second route, trackers excepted, for the first reference. Attributes: `references`,
    `rivals`, `known` (names), and `table`, what `table.md` holds. `timings_s`: `design`,
    `optimise`, `simulate`, `know`.
    """

    headline: ClassVar = ("tube_radius", "draws", "draws_failed", "draws_outside", "distance")
    scalars: ClassVar = JUDGED | {
        "tube_radius": ("length", "*λ*"),
        "draws": ("count", "plants that are not as believed"),
        "draws_failed": ("count", "plants that could not be simulated"),
        "draws_outside": ("count", "plants that leave the tube after its time of capture"),
        "known_plants": ("count", "plants for which plans are made anew"),
        "known_failed": (
            "count",
            "plans that were not found, in the order of the attribute `known`",
        ),
        "solve_iterations": ("count", "iterations of the plans for the worm as believed"),
        "recheck_error": (
            "share",
            "of the second route, trackers excepted, for the first reference",
        ),
    }
    variables: ClassVar = {
        **TIME,
        **over({name: LOOP_SIGNALS[name] for name in COMPARED}, *_RIVALS),
        "aim": ("length", ("reference", "link", "time"), "reference of the link length"),
        **{
            f"drawn_{name}": (quantity, (*_RIVALS, "member"), f"{name} of the plant")
            for name, (quantity, _) in JUDGED.items()
        },
        **{
            f"known_{name}": (
                quantity,
                ("plan", "known_member"),
                f"{name} of the plant, which is known",
            )
            for name, (quantity, _) in JUDGED.items()
        },
        "outside_share": (
            "share",
            (*_RIVALS, "bound"),
            "of plants that leave the tube: exact interval of 95 %",
        ),
        **{
            f"median_{name}": (
                JUDGED[name][0],
                (*_RIVALS, "bound"),
                f"median of {name} over the plants: interval of at least 95 %",
            )
            for name in RANKED
        },
        **{
            f"less_{name}": (
                "count",
                (*_RIVALS, "other"),
                f"plants on which {name} is less than with the other controller",
            )
            for name in RANKED
        },
    }

    kind: Literal["compare-tracking"]
    want: Annotated[
        tuple[Literal["comparison", "draws"], ...],
        says(
            "",
            "`comparison`: errors in time, largest error against input; `draws`: box plots over "
            "the plants",
        ),
    ] = ()
    worm: Annotated[
        ChainTable, says("", "the worm, with one `coulomb` table of friction, without `random`")
    ]
    start: Annotated[Start, says("", "where it starts")] = field(default_factory=Start)
    reference: Annotated[
        tuple[NamedReference, ...],
        says("", "tables `[[reference]]`: gaits to follow; plants are known for the first"),
    ]
    tube: Annotated[
        TubeTable, says("", "tube by which all are judged, from the time of capture on")
    ]
    tracker: Annotated[
        tuple[Tracker, ...],
        says(
            "",
            "tables `[[tracker]]`: controllers that do not know the plant; `tube_radius` is "
            "`tube.radius`",
        ),
    ]
    lqr: Annotated[LqrTable, says("", "LQR with feed-forward, also around the optimal inputs")]
    optimal: Annotated[
        OptimalTable | None,
        says("", "optimal tracking and optimal tube; not compared if left out"),
    ] = None
    crawl: Annotated[
        CrawlTable | None,
        says("", "the crawl that ignores the reference; not compared if left out"),
    ] = None
    measurement: Annotated[
        MeasurementTable | None,
        says("", "noise and delay of what controllers see; they see all as it is if left out"),
    ] = None
    predictive: Annotated[
        PredictiveTable | None,
        says("", "predictive control in real time; not compared if left out"),
    ] = None
    estimation: Annotated[
        EstimationTable | None,
        says("", "predictive control that learns on the way beside it; none if left out"),
    ] = None
    draws: Annotated[DrawsTable, says("", "plants that are not as believed")]
    grid: Annotated[GridTable, says("", "grid of the optimiser")] = field(default_factory=GridTable)
    relaxation: Annotated[RelaxationTable, says("", "how exact contact is in the optimiser")] = (
        field(default_factory=RelaxationTable)
    )
    workers: Annotated[
        int,
        Meta(ge=1, le=64, description="a whole number from 1 to 64"),
        says("count", "processes that optimise"),
    ] = 2
    time: Horizon
    tolerance: Annotated[
        ToleranceTable, says("", "of the simulation of the worm as it is believed")
    ] = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        yield from self.relaxation.faults()
        if self.crawl is not None:
            yield from wrong_order("crawl.length", self.crawl.length, may_be_equal=False)
        if not self.reference:
            yield "reference", "there is none; write at least one [[reference]]"
        for k, reference in enumerate(self.reference):
            yield from reference.gait.faults(links, folder, f"reference[{k}].gait")
        for k, tracker in enumerate(self.tracker):
            yield from tracker.faults(f"tracker[{k}]", links)
            yield from faults_of_lag(f"tracker[{k}]", tracker, self.time.end)
            free = isinstance(tracker, FunnelTracker) and tracker.tube_radius is None
            if not free and tracker.tube_radius != self.tube.radius:
                message = f"all are judged by tube.radius = {self.tube.radius:g}; write the same"
                yield f"tracker[{k}].tube_radius", message
        yield from self._faults_of_draws()
        if self.predictive is not None:
            yield from self.predictive.faults(self.time.end, self.units)
        if self.estimation is not None:
            yield from self.estimation.faults(self.worm)
            if self.predictive is None:
                yield "estimation", "serves predictive control; write [predictive] too"
        if self.measurement is not None:
            yield from self.measurement.faults(self.time.end, self.tracker)
            if self.predictive is not None and not self.measurement.exact:
                yield "measurement", "is not for [predictive], which sees states; leave out either"
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"

    def _faults_of_draws(self) -> Iterator[Fault]:
        if self.worm.random is not None:
            yield "worm.random", "plants vary by [draws] here; leave the table out"
        if self.worm.slope:
            yield "worm.slope", "masses are drawn here, their weights are not; write worm.load"
        if not isinstance(self.worm.friction, CoulombFriction):
            yield "worm.friction", 'is compared with kind = "coulomb", one table for all masses'
        if self.draws.known and self.optimal is None and self.crawl is None:
            yield "draws.known", "serves plans; write 0, or [optimal] or [crawl]"
        if self.draws.known > self.draws.members:
            message = f"is more than draws.members = {self.draws.members}; write less"
            yield "draws.known", message
