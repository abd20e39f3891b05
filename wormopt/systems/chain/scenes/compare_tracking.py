"""Scenes of kind "compare-tracking": controllers of one chain, measured by one simulator."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import Start, TimeSpan, ToleranceTable
from wormopt.scene.types import (
    NonNegative,
    Pair,
    Positive,
    SceneTable,
    Seed,
    Table,
    Title,
    extreme_numbers,
    wrong_order,
)
from wormopt.systems.chain.scenes.chain import ChainTable, CoulombFriction
from wormopt.systems.chain.scenes.track import DerivativeTracker, FilterTracker
from wormopt.systems.chain.scenes.track_optimal import GridTable, RelaxationTable, Share, TubeTable
from wormopt.systems.spiked.scenes.shapes import Shape


class DesignedShape(Table, frozen=True, kw_only=True, tag_field="shape", tag="designed"):
    """The fastest gait in which one mass after the other rests, tail first, within limits.

    It is designed when the scene runs, as in scenes of kind "gait-design".

    Parameters
    ----------
    period : float
        Period.
    length : tuple of two floats
        Shortest and longest length of every link.
    rate, acceleration : float
        Limits on |l'| and |l''|.
    load : float
        Force against forward motion on each mass for which spikes must hold.
    """

    period: Positive
    length: Pair
    rate: Positive
    acceleration: Positive
    load: NonNegative = 0.0

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys; `key` is the key path of this table."""
        yield from wrong_order(f"{key}.length", self.length, may_be_equal=False)


class NamedReference(Table, frozen=True, kw_only=True):
    """One of the gaits that are followed.

    Parameters
    ----------
    name : str
        What tables and pictures call it.
    gait : table
        A gait.
    """

    name: Title
    gait: Shape | DesignedShape


class LqrTable(Table, frozen=True, kw_only=True):
    """LQR with feed-forward: weights of its Riccati equation.

    Parameters
    ----------
    error_weight, rate_weight, input_weight : float
        Weights of |e|^2, |e'|^2 and of the square of what is added to the feed-forward.
    """

    error_weight: Positive
    rate_weight: NonNegative = 0.0
    input_weight: Positive = 1.0


class OptimalTable(Table, frozen=True, kw_only=True):
    """Optimal tracking and the optimal tube.

    Parameters
    ----------
    input_weight : float
        rho in the integral of |e|^2 + rho |u|^2.
    margin : float
        Share of the tube's radius that the optimiser leaves free.
    """

    input_weight: Positive
    margin: Share = 0.02


class CrawlTable(Table, frozen=True, kw_only=True):
    """The crawl of largest mean speed, less a weight times the mean of |u|^2; no reference in it.

    Parameters
    ----------
    period : float
        Its period.
    length : tuple of two floats
        Shortest and longest length of every link.
    force : float
        Largest |u_j|.
    input_weight : float
        Weight of the mean of |u|^2.
    arcs : int
        Arcs of the first solve over a period.
    """

    period: Positive
    length: Pair
    force: Positive
    input_weight: NonNegative = 1e-3
    arcs: Annotated[int, Meta(ge=10, le=1000, description="a whole number from 10 to 1000")] = 60


class DrawsTable(Table, frozen=True, kw_only=True):
    """Plants that are not as believed: every number drawn by itself, uniform around its own.

    Parameters
    ----------
    members : int
        How many plants.
    spread : float
        Half width of the range of masses, stiffness, damping and friction, as a share of them.
    seed : int
        The same seed gives the same plants.
    known : int
        For so many of them, the first ones, the optimal inputs are computed anew, knowing them.
    """

    members: Annotated[int, Meta(ge=2, le=10_000, description="a whole number from 2 to 10000")]
    spread: Share
    seed: Seed = 0
    known: Annotated[int, Meta(ge=0, le=1000, description="a whole number from 0 to 1000")] = 0


class CompareScene(SceneTable, frozen=True, kw_only=True):
    """One chain under several controllers, nominal and with parameters that are not as believed.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"compare-tracking"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : ChainTable
        The worm.
    start : Start
        Where it starts.
    reference : tuple of NamedReference
        Gaits that are followed; knowledge of the plant is valued for the first.
    tube : TubeTable
        Tube by which all are judged, from the time of capture on.
    tracker : tuple of FilterTracker or DerivativeTracker
        lambda-trackers.
    lqr : LqrTable
        LQR with feed-forward, also around the optimal inputs.
    optimal : OptimalTable
        Optimal tracking and optimal tube.
    crawl : CrawlTable
        The crawl that ignores the reference.
    draws : DrawsTable
        Plants that are not as believed.
    grid : GridTable
        Grid of the optimiser.
    relaxation : RelaxationTable
        How exact contact is in the optimiser.
    workers : int
        Processes that optimise.
    time : TimeSpan
        How long.
    tolerance : ToleranceTable
        Of the simulation of the worm as it is believed.
    """

    kind: Literal["compare-tracking"]
    want: tuple[Literal["comparison", "draws"], ...] = ()
    worm: ChainTable
    start: Start = field(default_factory=Start)
    reference: tuple[NamedReference, ...]
    tube: TubeTable
    tracker: tuple[FilterTracker | DerivativeTracker, ...]
    lqr: LqrTable
    optimal: OptimalTable
    crawl: CrawlTable
    draws: DrawsTable
    grid: GridTable = field(default_factory=GridTable)
    relaxation: RelaxationTable = field(default_factory=RelaxationTable)
    workers: Annotated[int, Meta(ge=1, le=64, description="a whole number from 1 to 64")] = 2
    time: TimeSpan
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        links = self.worm.links
        yield from self.worm.faults(self.time.end)
        yield from self.start.faults(links)
        yield from self.relaxation.faults()
        yield from wrong_order("crawl.length", self.crawl.length, may_be_equal=False)
        if not self.reference:
            yield "reference", "there is none; write at least one [[reference]]"
        for k, reference in enumerate(self.reference):
            yield from reference.gait.faults(links, folder, f"reference[{k}].gait")
        for k, tracker in enumerate(self.tracker):
            yield from tracker.faults(f"tracker[{k}]", links)
            if tracker.tube_radius != self.tube.radius:
                message = f"all are judged by tube.radius = {self.tube.radius:g}; write the same"
                yield f"tracker[{k}].tube_radius", message
        yield from self._faults_of_draws()
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"

    def _faults_of_draws(self) -> Iterator[Fault]:
        if self.worm.random is not None:
            yield "worm.random", "plants vary by [draws] here; leave the table out"
        if not isinstance(self.worm.friction, CoulombFriction):
            yield "worm.friction", 'is compared with kind = "coulomb", one table for all masses'
        if self.draws.known > self.draws.members:
            message = f"is more than draws.members = {self.draws.members}; write less"
            yield "draws.known", message
