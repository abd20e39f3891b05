"""Scenes of kind "optimal-crawl": the inputs by which a chain crawls best, period after period."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    NonNegative,
    Pair,
    Positive,
    PositiveOrPair,
    SceneTable,
    Seed,
    Table,
    says,
    wrong_order,
)
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.shared.declared import CHAIN_SIGNALS, COST_OF_TRANSPORT, INSTANT, OPTIMUM, over
from wormopt.systems.spiked import why_unreadable


class CrawlLimitsTable(Table, frozen=True, kw_only=True):
    """What the crawl must keep to."""

    period: Annotated[
        PositiveOrPair, says("time", "period, fixed, or [shortest, longest] to choose from")
    ]
    force: Annotated[Positive, says("force", "largest |*u*<sub>j</sub>|")]
    length: Annotated[
        Pair | None,
        says(
            "length",
            "[shortest, longest]: range of every link, at every instant; no limit if left out",
        ),
    ] = None

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period."""
        if isinstance(self.period, tuple):
            return self.period[0], self.period[1]
        return self.period, self.period

    def faults(self) -> Iterator[Fault]:
        """Yield ranges that are upside down."""
        for name in ("period", "length"):
            value = getattr(self, name)
            if isinstance(value, tuple):
                yield from wrong_order(f"limits.{name}", value, may_be_equal=name == "period")


class AimTable(Table, frozen=True, kw_only=True):
    """What the crawl is to be good at: exactly one of `maximise` and `minimise`."""

    maximise: Annotated[
        Literal["speed"] | None, says("", "mean speed − `effort` · mean of |*u*|²")
    ] = None
    minimise: Annotated[
        Literal["energy_per_mass_distance"] | None,
        says("", "positive work of the actuators over mass and way; `speed` is required then"),
    ] = None
    effort: Annotated[NonNegative, says("", "weight of the squared inputs, for `maximise`")] = 0.0
    speed: Annotated[Positive | None, says("speed", "least mean speed; none if left out")] = None

    def faults(self, robust: bool) -> Iterator[Fault]:
        """Yield what does not fit together.

        `robust`: several draws of the worm are optimised for.
        """
        if (self.maximise is None) == (self.minimise is None):
            yield (
                "aim",
                'write maximise = "speed" or minimise = "energy_per_mass_distance", one of both',
            )
        elif self.minimise and self.speed is None:
            yield "aim.speed", "missing; the cheapest crawl rests: write the least mean speed"
        elif self.minimise and self.effort:
            yield "aim.effort", 'belongs to maximise = "speed"; leave it out'
        elif self.minimise and robust:
            yield "aim.minimise", 'robust designs take maximise = "speed" only'


class SearchTable(Table, frozen=True, kw_only=True):
    """Where searches begin. Results are local optima: strong actuators have many."""

    starts: Annotated[
        int,
        Meta(ge=1, le=1000, description="a whole number from 1 to 1000"),
        says(
            "count", "starts; each is the last period of a simulation under other sines as inputs"
        ),
    ] = 1
    seed: Annotated[Seed, says("", "the same seed gives the same starts")] = 0
    result: Annotated[
        Annotated[str, Meta(pattern=r"\.nc$", description='text ending in ".nc"')] | None,
        says(
            "",
            "start at the crawl of an earlier result of as many links instead; relative to the "
            "scene's folder",
        ),
    ] = None

    def faults(self, folder: Path, robust: bool) -> Iterator[Fault]:
        """Yield what does not fit together, or cannot be read; `folder` is the scene's.

        `robust`: several draws of the worm are optimised for.
        """
        if self.result is None:
            return
        if self.starts > 1:
            yield "search.result", "is one start; leave out search.starts or it"
        if robust:
            yield "search.result", "is of one worm; leave out [robust] or it"
        unreadable = why_unreadable(folder / self.result)
        if unreadable:
            yield "search.result", f'"{self.result}" cannot be read from {folder}: {unreadable}'


class RobustTable(Table, frozen=True, kw_only=True):
    """One input for several worms, of which the numbers are drawn by chance.

    Masses, stiffness, damping and friction are drawn around the scene's own. Contact is then
    complementary on the grid of `[mesh]`, not exact; `speed_simulated` lists what each worm really
    does after many periods. Refused with `minimise` and with `want = ["convergence"]`.
    """

    draws: Annotated[
        int,
        Meta(ge=1, le=20, description="a whole number from 1 to 20"),
        says("count", "worms besides the scene's own"),
    ] = 4
    spread: Annotated[
        float,
        Meta(gt=0, lt=1, description="a number between 0 and 1"),
        says("share", "half width of the range, as a share"),
    ] = 0.3
    seed: Annotated[Seed, says("", "the same seed gives the same worms")] = 0
    judge: Annotated[
        Literal["mean", "worst"],
        says("", "whether the mean speed counts or that of the slowest"),
    ] = "mean"


class OptimalCrawlScene(SceneTable, frozen=True, kw_only=True):
    """The best periodic crawl of a chain under dry friction.

    The inputs by which a chain crawls fastest, or cheapest, period after period: velocities return
    after a period, positions up to one advance. Contact is dry friction, told exactly: a relaxed
    solve shows who rests when, a second one frees the switching times, an exact simulation with
    the inputs found repeats the motion. See [optimal.md](../optimal.md).

    If the crawl repeats itself within the period, results are those of one cycle, and a warning
    says how many there are. If no phases can be read off the relaxed motion, contact stays
    complementary on a finer grid, as a warning says.

    `[mesh]` is that of the relaxed solve, with 60 arcs if left out; its `tolerance` that of the
    exact one. Where arcs join, the instant stands twice. `timings_s`: `build` and `solve` (of all
    programs), `optimise` and `check`.
    """

    headline: ClassVar = (
        "speed",
        "speed_simulated",
        "cost_of_transport",
        "objective",
        "time",
        "input_peak",
        "mode_sequence",
    )
    scalars: ClassVar = {
        "speed": ("speed", "mean speed"),
        "speed_simulated": (
            "speed",
            "the same from an exact simulation of two periods; with `[robust]` a list, one per "
            "worm, after many periods",
        ),
        "advance": ("length", "way in a period"),
        "energy_per_mass_distance": (
            "acceleration",
            "positive work of the actuators over mass and way; not with `[robust]`",
        ),
        **COST_OF_TRANSPORT,
        "order_smoothed": ("1", "slope of the errors over the width (convergence)"),
        "order_complementarity": ("1", "slope of the errors over the grid (convergence)"),
        "objective_smoothed": ("speed", "at the least width (convergence)"),
        "objective_smoothed_error_bar": (
            "speed",
            "its error, stated without the exact answer (convergence)",
        ),
        "objective_complementarity": ("speed", "on the finest grid (convergence)"),
        "objective_complementarity_error_bar": (
            "speed",
            "its error, stated without the exact answer (convergence)",
        ),
        "same_modes": ("1", "whether both show the modes of the exact crawl (convergence)"),
        **OPTIMUM,
        "objective": (
            "speed",
            "what was minimised; of a speed its negative; energy by mass and distance counts as an "
            "acceleration",
        ),
    }
    variables: ClassVar = {
        **INSTANT,
        **over(CHAIN_SIGNALS, last="instant"),
        "width": ("speed", ("width",), "width of the smoothed law"),
        "smoothed_error": ("speed", ("width",), "its error"),
        "arcs": ("count", ("arcs",), "arcs of the grid"),
        "complementarity_error": ("speed", ("arcs",), "its error"),
    }

    kind: Literal["optimal-crawl"]
    want: Annotated[
        tuple[Literal["signals", "convergence"], ...],
        says(
            "",
            "`signals`: signals below each other; `convergence`: solves again with smoothed "
            "contact and on finer grids and shows how both tend to the exact answer (about half a "
            "minute more)",
        ),
    ] = ()
    worm: Annotated[ChainTable, says("", "the chain, with `friction` and without `random`")]
    limits: Annotated[CrawlLimitsTable, says("", "what the crawl must keep to")]
    aim: Annotated[AimTable, says("", "what it is to be good at")]
    mesh: Annotated[MeshTable, says("", "how finely the motion is resolved")] = field(
        default_factory=lambda: MeshTable(arcs=60)
    )
    search: Annotated[SearchTable, says("", "where to begin")] = field(default_factory=SearchTable)
    robust: Annotated[
        RobustTable | None, says("", "several worms instead of one; one if left out")
    ] = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from self.worm.faults(1.0, self.units)
        yield from self.limits.faults()
        yield from self.aim.faults(self.robust is not None)
        yield from self.search.faults(folder, self.robust is not None)
        if self.worm.random is not None:
            yield "worm.random", "an optimal crawl is one of a known worm; write [robust] instead"
        if self.robust is not None and self.worm.slope:
            yield "worm.slope", "masses are drawn by [robust], not their weights; write worm.load"
        if self.worm.friction is None:
            yield "worm.friction", "missing; without friction no worm crawls"
        if self.robust is not None and "convergence" in self.want:
            yield "want", '"convergence" is for one worm; leave out [robust] or it'
