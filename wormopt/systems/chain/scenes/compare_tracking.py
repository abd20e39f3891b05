"""Tables of scenes of kind "compare-tracking": several controllers of one chain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.numerics import Horizon, Start, ToleranceTable
from wormopt.study.types import Pair, SceneTable, Seed, Title, wrong_order
from wormopt.systems.chain.scenes.predictive import EstimationTable, PlantsTable, PredictiveTable
from wormopt.systems.chain.tables import (
    ChainTable,
    CoulombFriction,
    DifferenceTracker,
    FunnelTracker,
    GridTable,
    RelaxationTable,
    Share,
    Tracker,
    TubeTable,
    faults_of_lag,
)
from wormopt.systems.shared.declared import JUDGED, LOOP_SIGNALS, TIME, over
from wormopt.systems.spiked import Shape


class DesignedShape(Given, tag_field="shape", tag="designed"):
    """The fastest gait in which one mass after the other rests, tail first, within limits.

    The gait is designed when the scene runs, as in scenes of [kind `gait-design`](gait-design.md),
    with unit masses.
    """

    period: float = positive("time", "period")
    length: Pair = entry("shortest and longest length of every link", quantity="length")
    rate: float = positive("speed", "upper limit of |*l*′|")
    acceleration: float = positive("acceleration", "upper limit of |*l*″|")
    load: float = number(
        "force",
        "force against forward motion on each mass, which the spikes must hold",
        least=0,
        default=0.0,
    )

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys; `key` is the key path of this table."""
        yield from wrong_order(f"{key}.length", self.length, may_be_equal=False)


class NamedReference(Given):
    """A reference gait."""

    name: Title = entry("name in tables and pictures")
    gait: Shape | DesignedShape = entry("the gait; `shape` selects the other keys")


class LqrTable(Given):
    """Weights of the Riccati equation of LQR with feed-forward."""

    error_weight: float = positive("", "weight of |*e*|²")
    rate_weight: float = number("", "weight of |*e*′|²", least=0, default=0.0)
    input_weight: float = positive(
        "", "weight of the squared correction to the feed-forward", default=1.0
    )


class OptimalTable(Given):
    """Optimal tracking, and the least input that keeps the error in the tube."""

    input_weight: float = positive("", "*ρ* in ∫(|*e*|² + *ρ*|*u*|²) d*t*")
    margin: Share = entry(
        "share of the tube's radius that the optimiser keeps free", quantity="share", default=0.02
    )


class CrawlTable(Given):
    """The crawl that maximises the mean speed minus a weight times the mean of |*u*|².

    It does not follow a reference.
    """

    period: float = positive("time", "period of the crawl")
    length: Pair = entry("shortest and longest length of every link", quantity="length")
    force: float = positive("force", "upper limit of |*u*<sub>j</sub>|")
    input_weight: float = number("", "weight of the mean of |*u*|²", least=0, default=1e-3)
    arcs: int = whole(10, 1000, "arcs over a period in the first solve", default=60)


class DrawsTable(PlantsTable):
    """Plants with drawn parameters.

    Each parameter is drawn independently from a uniform distribution around its nominal value.
    """

    members: int = whole(2, 10000, "number of drawn plants")
    known: int = whole(
        0,
        1000,
        "number of plants, from the first on, for which every plan is made anew with the true "
        "parameters",
        default=0,
    )


class MeasurementTable(Given):
    """Measured link lengths, with noise and delay.

    The noise is normal at its samples and interpolated by cubics, so it has hardly any content
    above the frequency 1/(2 `interval`). Every plant has its own noise. Measured rates are the
    derivatives of the measured lengths. The table has no effect on controllers without feedback.
    """

    noise: float = number(
        "length", "standard deviation of the samples of each link", least=0, default=0.0
    )
    interval: float = positive("time", "time between samples of the noise", default=0.02)
    delay: float = number("time", "delay of the measurement", least=0, default=0.0)
    seed: Seed = entry("seed of the noise", default=0)

    def faults(self, end: float, trackers: Sequence[Tracker]) -> Iterator[Fault]:
        """Check what no single key shows, for motions from 0 to `end`."""
        for name in ("interval", "delay"):
            length = getattr(self, name)
            if length and end / length > _MOST_STRETCHES:
                least = end / _MOST_STRETCHES
                cut = f"cuts the time into {end / length:.2g} stretches"
                yield f"measurement.{name}", f"{cut}; write {least:g} or more"
        if self.delay and any(isinstance(t, DifferenceTracker) for t in trackers):
            message = (
                'does not apply to feedback = "difference", which has a delay of its own; write 0'
            )
            yield "measurement.delay", message

    @property
    def exact(self) -> bool:
        """Whether measurements have neither noise nor delay."""
        return not (self.noise or self.delay)


# A stretch takes milliseconds.
_MOST_STRETCHES = 1e4

COMPARED = ("error_norm", "length", "input", "position")
"""Signals that are kept of every controller."""
_RIVALS = ("reference", "rival")
RANKED = ("time_outside_tube", "error_peak", "error_integral", "input_integral", "distance")
"""Quantities that are reported as medians over the plants with intervals, and compared between
controllers.
"""


class CompareScene(SceneTable):
    """One chain under several controllers, with nominal and with drawn parameters.

    One exact simulator evaluates all controllers: adaptive trackers, LQR with feed-forward, optimal
    tracking, the least input that stays in the tube, and the fastest crawl, which has no reference.
    Plans are applied in open loop and with LQR around them. `[predictive]` adds predictive control
    in real time, as in scenes of [kind `track-predictive`](track-predictive.md). `[draws]` applies
    the same controllers, which do not know the parameters, to plants with drawn parameters, and
    makes new plans for the first of these plants. `[measurement]` gives the feedback noisy and
    delayed lengths. A motion then ends when its error exceeds ten radii of the tube, and its plant
    counts as lost. The file `table.md` beside the result holds all figures;
    [comparison.md](../comparison.md) discusses them.

    Not allowed: a tracker with another tube radius; `draws.known` above `draws.members`; friction
    other than one `coulomb` table; `worm.random`.

    Intervals over the plants are exact and assume no distribution: Clopper-Pearson intervals for
    the share that leaves the tube, order statistics for medians. Plants that are lost, or whose
    simulation fails, rank below all others. With fewer than six plants, medians have no bounds.

    Scalars are lists of lists, by reference and controller. In the trust report, `recheck` is the
    second route for the first reference, without trackers. Attributes: `references`, `rivals` (the
    controllers), `known` (names), and `table`, the text of `table.md`. `timings_s`: `design`,
    `optimise`, `simulate`, `know`.
    """

    headline: ClassVar = ("tube_radius", "draws", "draws_failed", "draws_outside", "distance")
    scalars: ClassVar = JUDGED | {
        "tube_radius": ("length", "*λ*"),
        "draws": ("count", "number of drawn plants"),
        "draws_failed": ("count", "plants whose simulation failed"),
        "draws_outside": ("count", "plants that leave the tube after the time of capture"),
        "known_plants": ("count", "plants with new plans made for their true parameters"),
        "known_failed": (
            "count",
            "new plans that failed, in the order of the attribute `known`",
        ),
        "solve_iterations": ("count", "iterations of the plans for the nominal plant"),
        "recheck_error": (
            "share",
            "error of the second route for the first reference, without trackers",
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
                f"{name} of the plant with known parameters",
            )
            for name, (quantity, _) in JUDGED.items()
        },
        "outside_share": (
            "share",
            (*_RIVALS, "bound"),
            "exact 95 % interval of the share of plants that leave the tube",
        ),
        **{
            f"median_{name}": (
                JUDGED[name][0],
                (*_RIVALS, "bound"),
                f"interval of at least 95 % for the median of {name} over the plants",
            )
            for name in RANKED
        },
        **{
            f"less_{name}": (
                "count",
                (*_RIVALS, "other"),
                f"plants on which {name} is lower than with the other controller",
            )
            for name in RANKED
        },
    }

    kind: Literal["compare-tracking"]
    want: tuple[Literal["comparison", "draws"], ...] = entry(
        "`comparison`: error over time, and largest error against input; `draws`: box plots "
        "over the plants",
        default=(),
    )
    worm: ChainTable = entry("the chain, with one `coulomb` table of friction, without `random`")
    start: Start = entry("initial state", default=Start)
    reference: tuple[NamedReference, ...] = entry(
        "tables `[[reference]]`: gaits to follow; known plants use the first"
    )
    tube: TubeTable = entry("tube that all controllers are judged by, from the time of capture on")
    tracker: tuple[Tracker, ...] = entry(
        "tables `[[tracker]]`: controllers that do not know the plant; their `tube_radius` is "
        "`tube.radius`"
    )
    lqr: LqrTable = entry("LQR with feed-forward, also around the optimal inputs")
    optimal: OptimalTable | None = entry(
        "optimal tracking and the optimal tube; default: neither", default=None
    )
    crawl: CrawlTable | None = entry("the crawl without reference; default: none", default=None)
    measurement: MeasurementTable | None = entry(
        "noise and delay of the measurements; default: exact measurements", default=None
    )
    predictive: PredictiveTable | None = entry(
        "predictive control in real time; default: none", default=None
    )
    estimation: EstimationTable | None = entry(
        "adds predictive control with parameter estimation; default: none", default=None
    )
    draws: DrawsTable = entry("plants with drawn parameters")
    grid: GridTable = entry("grid of the optimiser", default=GridTable)
    relaxation: RelaxationTable = entry(
        "relaxation of contact in the optimiser", default=RelaxationTable
    )
    workers: int = whole(1, 64, "number of processes for the optimisation", default=2)
    time: Horizon
    tolerance: ToleranceTable = entry(
        "tolerance of the simulation of the nominal plant", default=ToleranceTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        links = self.worm.links
        yield from self.worm.faults(self.time.end, self.units)
        yield from self.start.faults(links)
        if self.crawl is not None:
            yield from wrong_order("crawl.length", self.crawl.length, may_be_equal=False)
        if not self.reference:
            yield "reference", "has no entries; write at least one [[reference]]"
        for k, reference in enumerate(self.reference):
            yield from reference.gait.faults(links, folder, f"reference[{k}].gait")
        for k, tracker in enumerate(self.tracker):
            yield from tracker.faults(f"tracker[{k}]", links)
            yield from faults_of_lag(f"tracker[{k}]", tracker, self.time.end)
            free = isinstance(tracker, FunnelTracker) and tracker.tube_radius is None
            if not free and tracker.tube_radius != self.tube.radius:
                message = (
                    f"differs from tube.radius = {self.tube.radius:g}, which judges all "
                    "controllers; write the same"
                )
                yield f"tracker[{k}].tube_radius", message
        yield from self._faults_of_draws()
        if self.predictive is not None:
            yield from self.predictive.faults(self.time.end, self.units)
        if self.estimation is not None:
            yield from self.estimation.faults(self.worm)
            if self.predictive is None:
                yield "estimation", "needs predictive control; add [predictive]"
        if self.measurement is not None:
            yield from self.measurement.faults(self.time.end, self.tracker)
            if self.predictive is not None and not self.measurement.exact:
                yield (
                    "measurement",
                    "does not apply to [predictive], which measures states; leave out one of them",
                )
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"

    def _faults_of_draws(self) -> Iterator[Fault]:
        if self.worm.random is not None:
            yield (
                "worm.random",
                "is not allowed, since [draws] varies the plants; leave the table out",
            )
        if self.worm.slope:
            yield (
                "worm.slope",
                "is not allowed, since drawn masses would change the weights; write worm.load",
            )
        if not isinstance(self.worm.friction, CoulombFriction):
            yield (
                "worm.friction",
                'is not supported; write one table with kind = "coulomb" for all masses',
            )
        if self.draws.known and self.optimal is None and self.crawl is None:
            yield "draws.known", "needs plans; write 0, or add [optimal] or [crawl]"
        if self.draws.known > self.draws.members:
            message = f"is more than draws.members = {self.draws.members}; write less"
            yield "draws.known", message
