"""Scenes of kind "track-optimal": the best input by which a chain's links follow a gait."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import Start, TimeSpan, ToleranceTable
from wormopt.scene.types import NonNegative, Positive, SceneTable, Table, extreme_numbers
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.chain.scenes.track import Reference

Share = Annotated[float, Meta(ge=0, lt=1, description="a number from 0 to below 1")]


class TubeTable(Table, frozen=True, kw_only=True):
    """Tube around the reference, and from when on the error shall be in it.

    Parameters
    ----------
    radius : float
        lambda.
    capture : float
        Time from which on |e| <= lambda is asked for, or judged.
    """

    radius: Positive
    capture: NonNegative = 0.0


class LeastError(Table, frozen=True, kw_only=True, tag_field="minimise", tag="error"):
    """Least integral of |e|^2 + rho |u|^2.

    Parameters
    ----------
    input_weight : float
        rho.
    """

    input_weight: Positive


class LeastInput(Table, frozen=True, kw_only=True, tag_field="minimise", tag="input"):
    """Least integral of |u|^2 with the error in the tube from its time of capture on.

    Parameters
    ----------
    margin : float
        Share of the tube's radius that the optimiser leaves free for what its grid does not see.
    """

    margin: Share = 0.02


class GridTable(Table, frozen=True, kw_only=True):
    """Grid of the optimiser: inputs are constant on each of its arcs.

    Parameters
    ----------
    arcs : int
        Arcs per period of the reference, at least; none crosses a break of the reference.
    degree : int
        Degree of the states on each arc (Radau collocation).
    """

    arcs: Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")] = 30
    degree: Annotated[int, Meta(ge=1, le=5, description="a whole number from 1 to 5")] = 2


class RelaxationTable(Table, frozen=True, kw_only=True):
    """Relaxation of complementarity, lowered by factors of ten from solve to solve.

    Parameters
    ----------
    first, last : float
        Largest product of speed and force, in usual sizes, of the first and of the last solve.
    """

    first: Positive = 0.1
    last: Positive = 1e-3

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the last is not the smaller one."""
        if self.last > self.first:
            yield "relaxation.last", f"is above relaxation.first = {self.first:g}; write less"


class TrackOptimalScene(SceneTable, frozen=True, kw_only=True):
    """A chain whose links follow a gait by the best input, open loop.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"track-optimal"}
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
    reference : Reference
        What its links shall do.
    tube : TubeTable
        Tube around the reference.
    objective : LeastError or LeastInput
        What is minimised.
    grid : GridTable
        Grid of the optimiser.
    relaxation : RelaxationTable
        How exact contact is in the optimiser.
    time : TimeSpan
        How long.
    tolerance : ToleranceTable
        Of the simulation of what was found.
    """

    kind: Literal["track-optimal"]
    want: tuple[Literal["trackers", "motion"], ...] = ()
    worm: ChainTable
    start: Start = field(default_factory=Start)
    reference: Reference
    tube: TubeTable
    objective: LeastError | LeastInput
    grid: GridTable = field(default_factory=GridTable)
    relaxation: RelaxationTable = field(default_factory=RelaxationTable)
    time: TimeSpan
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        links = self.worm.links
        yield from self.worm.faults(self.time.end)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        yield from self.relaxation.faults()
        if self.worm.random is not None:
            yield "worm.random", "an optimal input is one worm's own; leave the table out"
        if self.tube.capture >= self.time.end:
            yield "tube.capture", f"is not before time.end = {self.time.end:g}; write less"
