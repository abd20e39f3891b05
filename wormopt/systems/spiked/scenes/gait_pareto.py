"""Scenes of kind "gait-pareto": the best gaits between speed and a cost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Table
from wormopt.systems.spiked.scenes.gait_design import Cost, DesignTable


class ParetoTable(Table, frozen=True, kw_only=True):
    """The front to compute.

    Parameters
    ----------
    against : str
        The cost that is weighed against speed.
    points : int
        Number of points of the front, 3 to 50.
    """

    against: Cost
    points: Annotated[int, Meta(ge=3, le=50, description="a whole number from 3 to 50")] = 9


class GaitParetoScene(DesignTable, frozen=True, kw_only=True):
    """The best gaits between speed and a cost.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"gait-pareto"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : WormTable
        The worm.
    gait : LimitTable
        The limits.
    search : Search
        How to search.
    motor : MotorTable, optional
        Motors that set the links' lengths.
    pareto : ParetoTable
        The front.
    """

    kind: Literal["gait-pareto"]
    want: tuple[Literal["front", "gait", "motion", "spikes"], ...] = ()
    pareto: ParetoTable

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_cost("pareto.against", self.pareto.against)
        if self.search.certify is not None:
            yield (
                "search.certify",
                "one design is certified at a time; leave it out, and certify the gaits that "
                'matter in scenes of kind = "gait-design"',
            )
