"""Tables of scenes of kind "optimal-crawl": the best periodic inputs of a crawling chain."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.numerics import MeshTable
from wormopt.study.types import (
    Pair,
    PositiveOrPair,
    SceneTable,
    Seed,
    wrong_order,
)
from wormopt.systems.chain.tables import ChainTable
from wormopt.systems.shared.declared import CHAIN_SIGNALS, COST_OF_TRANSPORT, INSTANT, OPTIMUM, over
from wormopt.systems.spiked import why_unreadable


class CrawlLimitsTable(Given):
    """Limits of the crawl."""

    period: PositiveOrPair = entry("fixed period, or [shortest, longest]", quantity="time")
    force: float = positive("force", "upper limit of |*u*<sub>j</sub>|")
    length: Pair | None = entry(
        "[shortest, longest] length of every link at all times; default: no limit",
        quantity="length",
        default=None,
    )

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period."""
        if isinstance(self.period, tuple):
            return self.period[0], self.period[1]
        return self.period, self.period

    def faults(self) -> Iterator[Fault]:
        """Yield ranges whose bounds are in the wrong order."""
        for name in ("period", "length"):
            value = getattr(self, name)
            if isinstance(value, tuple):
                yield from wrong_order(f"limits.{name}", value, may_be_equal=name == "period")


class AimTable(Given):
    """Objective of the crawl: exactly one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry(
        "mean speed − `effort` · mean of |*u*|²", default=None
    )
    minimise: Literal["energy_per_mass_distance"] | None = entry(
        "positive work of the actuators over mass and distance; requires `speed`", default=None
    )
    effort: float = number("", "weight of the squared inputs, for `maximise`", least=0, default=0.0)
    speed: float | None = positive(
        "speed", "lower limit of the mean speed; default: none", default=None
    )

    def faults(self, robust: bool) -> Iterator[Fault]:
        """Yield conflicts between the keys.

        `robust`: the design covers several drawn chains.
        """
        if (self.maximise is None) == (self.minimise is None):
            yield (
                "aim",
                'has neither or both of maximise and minimise; write maximise = "speed" or '
                'minimise = "energy_per_mass_distance"',
            )
        elif self.minimise and self.speed is None:
            yield (
                "aim.speed",
                "missing, and without it the cheapest crawl stays at rest; write the least mean "
                "speed",
            )
        elif self.minimise and self.effort:
            yield "aim.effort", 'applies to maximise = "speed" only; leave it out'
        elif self.minimise and robust:
            yield "aim.minimise", 'is not supported with [robust]; write maximise = "speed"'


class SearchTable(Given):
    """Starting points of the search. Results are local optima; strong actuators have many."""

    starts: int = whole(
        1,
        1000,
        "number of starts; each is the last period of a simulation with different sine inputs",
        default=1,
    )
    seed: Seed = entry("seed of the starts", default=0)
    result: Annotated[str, Meta(pattern=r"\.nc$", description='text ending in ".nc"')] | None = (
        entry(
            "start from the crawl of an earlier result with the same number of links instead; "
            "path relative to the scene's folder",
            default=None,
        )
    )

    def faults(self, folder: Path, robust: bool) -> Iterator[Fault]:
        """Yield conflicts between the keys, and files that cannot be read; `folder` is the scene's.

        `robust`: the design covers several drawn chains.
        """
        if self.result is None:
            return
        if self.starts > 1:
            yield "search.result", "gives a single start; leave out search.starts or search.result"
        if robust:
            yield "search.result", "belongs to a single chain; leave out [robust] or search.result"
        unreadable = why_unreadable(folder / self.result)
        if unreadable:
            yield "search.result", f'"{self.result}" cannot be read from {folder}: {unreadable}'


class RobustTable(Given):
    """One input for several chains with randomly drawn parameters.

    Masses, stiffness, damping and friction are drawn around the scene's values. Contact is then a
    complementarity condition on the grid of `[mesh]`, which is not exact. `speed_simulated` lists
    the speed of each chain after many periods. Not allowed: `minimise`, and `want =
    ["convergence"]`.
    """

    draws: int = whole(1, 20, "number of chains besides the nominal one", default=4)
    spread: float = number(
        "share",
        "half width of the range, as a share of the nominal value",
        above=0,
        below=1,
        default=0.3,
    )
    seed: Seed = entry("seed of the drawn chains", default=0)
    judge: Literal["mean", "worst"] = entry(
        "criterion: the average speed of the chains, or the speed of the slowest", default="mean"
    )


class OptimalCrawlScene(SceneTable):
    """The best periodic crawl of a chain under dry friction.

    It finds the periodic inputs with which the chain crawls fastest, or at the least energy.
    Velocities repeat after a period; positions advance by the same amount. Contact is exact dry
    friction: a relaxed solve finds which masses rest when, a second solve optimises the switching
    times, and an exact simulation repeats the motion with the inputs found. See
    [optimal.md](../optimal.md).

    If the crawl repeats within the period, results describe a single cycle, and a warning gives the
    number of cycles. If the relaxed motion shows no distinct phases, contact stays a
    complementarity condition on a finer grid, and a warning says so.

    `[mesh]` is the mesh of the relaxed solve, with 60 arcs by default; its `tolerance` is that of
    the exact solve. The arrays contain the instants at which arcs join twice. `timings_s`: `build`
    and `solve` (of all programs), `optimise` and `check`.
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
            "mean speed of an exact simulation over two periods; with `[robust]` a list by chain, "
            "after many periods",
        ),
        "advance": ("length", "distance travelled in a period"),
        "energy_per_mass_distance": (
            "acceleration",
            "positive work of the actuators over mass and distance; not with `[robust]`",
        ),
        **COST_OF_TRANSPORT,
        "order_smoothed": (
            "1",
            "order of convergence: slope of the errors over the smoothing width (convergence)",
        ),
        "order_complementarity": (
            "1",
            "order of convergence: slope of the errors over the grid (convergence)",
        ),
        "objective_smoothed": ("speed", "objective at the least smoothing width (convergence)"),
        "objective_smoothed_error_bar": (
            "speed",
            "estimated error of the same, without the exact answer (convergence)",
        ),
        "objective_complementarity": ("speed", "objective on the finest grid (convergence)"),
        "objective_complementarity_error_bar": (
            "speed",
            "estimated error of the same, without the exact answer (convergence)",
        ),
        "same_modes": ("1", "whether both show the contact modes of the exact crawl (convergence)"),
        **OPTIMUM,
        "objective": (
            "speed",
            "minimised quantity; minus the speed when the speed is maximised; energy over mass "
            "and distance has the unit of an acceleration",
        ),
    }
    variables: ClassVar = {
        **INSTANT,
        **over(CHAIN_SIGNALS, last="instant"),
        "width": ("speed", ("width",), "width of the smoothed friction law"),
        "smoothed_error": ("speed", ("width",), "error with the smoothed friction law"),
        "arcs": ("count", ("arcs",), "arcs of the grid"),
        "complementarity_error": ("speed", ("arcs",), "error with complementarity on the grid"),
    }

    kind: Literal["optimal-crawl"]
    want: tuple[Literal["signals", "convergence"], ...] = entry(
        "`signals`: signals over time; `convergence`: further solves with smoothed contact "
        "and on finer grids, and their convergence to the exact answer (about half a minute "
        "more)",
        default=(),
    )
    worm: ChainTable = entry("the chain, with `friction` and without `random`")
    limits: CrawlLimitsTable = entry("limits of the crawl")
    aim: AimTable = entry("objective of the crawl")
    mesh: Annotated[MeshTable, says("", "mesh in time")] = field(
        default_factory=lambda: MeshTable(arcs=60)
    )
    search: SearchTable = entry("starting points of the search", default=SearchTable)
    robust: RobustTable | None = entry(
        "design for several chains; default: a single chain", default=None
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from self.worm.faults(1.0, self.units)
        yield from self.limits.faults()
        yield from self.aim.faults(self.robust is not None)
        yield from self.search.faults(folder, self.robust is not None)
        if self.worm.random is not None:
            yield (
                "worm.random",
                "is not allowed, since an optimal crawl belongs to a known chain; write [robust] "
                "instead",
            )
        if self.robust is not None and self.worm.slope:
            yield (
                "worm.slope",
                "is not allowed, since masses drawn by [robust] would change the weights; write "
                "worm.load",
            )
        if self.worm.friction is None:
            yield "worm.friction", "missing, and a chain cannot crawl without friction; add it"
        if self.robust is not None and "convergence" in self.want:
            yield "want", '"convergence" needs a single chain; leave out [robust] or "convergence"'
