"""Scenes of kind "optimal-crawl": the inputs by which a chain crawls best, period after period."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

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
    extreme_numbers,
    wrong_order,
)
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.spiked.scenes.shapes import why_unreadable


class CrawlLimitsTable(Table, frozen=True, kw_only=True):
    """What the crawl must keep to.

    Parameters
    ----------
    period : float or (float, float)
        Period, or the range in which to choose it.
    force : float
        Largest size of every input.
    length : (float, float), optional
        Least and largest length of every link.
    """

    period: PositiveOrPair
    force: Positive
    length: Pair | None = None

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
    """What the crawl is to be good at; one of both is sought.

    Parameters
    ----------
    maximise : {"speed"}, optional
        Mean speed less ``effort`` times the mean of the squared inputs.
    minimise : {"cost_of_transport"}, optional
        Positive work of the actuators over mass and way, at a mean speed of at least ``speed``.
    effort : float
        Weight of the mean of the squared inputs, for "speed".
    speed : float, optional
        Least mean speed.
    """

    maximise: Literal["speed"] | None = None
    minimise: Literal["cost_of_transport"] | None = None
    effort: NonNegative = 0.0
    speed: Positive | None = None

    def faults(self, robust: bool) -> Iterator[Fault]:
        """Yield what does not fit together.

        `robust`: several draws of the worm are optimised for.
        """
        if (self.maximise is None) == (self.minimise is None):
            yield "aim", 'write maximise = "speed" or minimise = "cost_of_transport", one of both'
        elif self.minimise and self.speed is None:
            yield "aim.speed", "missing; the cheapest crawl rests: write the least mean speed"
        elif self.minimise and self.effort:
            yield "aim.effort", 'belongs to maximise = "speed"; leave it out'
        elif self.minimise and robust:
            yield "aim.minimise", 'robust designs take maximise = "speed" only'


class SearchTable(Table, frozen=True, kw_only=True):
    """Where searches begin.

    Parameters
    ----------
    starts : int
        Number of starts; each is a simulation under other sine inputs.
    seed : int
        The same seed gives the same starts.
    result : str, optional
        ``result.nc`` of an earlier crawl of as many links, from which to start instead; relative
        to the scene's folder.
    """

    starts: Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")] = 1
    seed: Seed = 0
    result: Annotated[str, Meta(pattern=r"\.nc$", description='text ending in ".nc"')] | None = None

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

    Parameters
    ----------
    draws : int
        Number of worms besides the scene's own.
    spread : float
        Half width of the range of masses, stiffness, damping and friction, as a share.
    seed : int
        The same seed gives the same worms.
    judge : {"mean", "worst"}
        Whether their mean speed or that of the slowest is maximised.
    """

    draws: Annotated[int, Meta(ge=1, le=20, description="a whole number from 1 to 20")] = 4
    spread: Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")] = 0.3
    seed: Seed = 0
    judge: Literal["mean", "worst"] = "mean"


class OptimalCrawlScene(SceneTable, frozen=True, kw_only=True):
    """The best periodic crawl of a chain under dry friction.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"optimal-crawl"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw, and "convergence" to compute how relaxed contact converges.
    worm : ChainTable
        The chain.
    limits : CrawlLimitsTable
        What the crawl must keep to.
    aim : AimTable
        What it is to be good at.
    mesh : MeshTable
        How finely.
    search : SearchTable
        Where to begin.
    robust : RobustTable, optional
        Several worms instead of one.
    """

    kind: Literal["optimal-crawl"]
    want: tuple[Literal["signals", "convergence"], ...] = ()
    worm: ChainTable
    limits: CrawlLimitsTable
    aim: AimTable
    mesh: MeshTable = field(default_factory=lambda: MeshTable(arcs=60))
    search: SearchTable = field(default_factory=SearchTable)
    robust: RobustTable | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from self.worm.faults(1.0)
        yield from self.limits.faults()
        yield from self.aim.faults(self.robust is not None)
        yield from self.search.faults(folder, self.robust is not None)
        if self.worm.random is not None:
            yield "worm.random", "an optimal crawl is one of a known worm; write [robust] instead"
        if self.worm.friction is None:
            yield "worm.friction", "missing; without friction no worm crawls"
        if self.robust is not None and "convergence" in self.want:
            yield "want", '"convergence" is for one worm; leave out [robust] or it'
