"""The ``[worm]`` table: masses and links under drag and load."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scenes.types import NonNegative, PerMass, Table, per, wrong_count


class WormTable(Table, frozen=True, kw_only=True):
    """A chain of point masses and links on the ground.

    Parameters
    ----------
    links : int
        Number of links n, 1 to 8; the masses are n + 1.
    mass : float or tuple of float
        Mass, alike for all or one per mass, head first.
    drag : float
        Viscous drag coefficient of each mass.
    load : float
        Force against the direction of motion on each mass (slope or towed load).

    Examples
    --------
    >>> WormTable(links=2, mass=1.0).masses
    (1.0, 1.0, 1.0)
    """

    links: Annotated[int, Meta(ge=1, le=8, description="a whole number from 1 to 8")]
    mass: PerMass
    drag: NonNegative = 0.0
    load: NonNegative = 0.0

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return per(self.mass, self.links + 1)

    @property
    def load_range(self) -> tuple[float, float]:
        """Lowest and highest load."""
        return self.load, self.load

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        yield from wrong_count("worm.mass", self.mass, self.links + 1, "masses")
