"""The ``[worm]`` table: masses and links under drag and load."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import NonNegative, NonNegativeOrPair, PerMass, Table
from wormopt.systems.spiked.task import MOST_LINKS, Worm


class WormTable(Table, frozen=True, kw_only=True):
    """A chain of point masses and links on the ground.

    Parameters
    ----------
    links : int
        Number of links n, 1 to 32; the masses are n + 1.
    mass : float or tuple of float
        Mass, alike for all or one per mass, head first.
    drag : float
        Viscous drag coefficient of each mass.
    load : float or tuple of float
        Force against the direction of motion on each mass (slope or towed load), or a range.

    Examples
    --------
    >>> WormTable(links=2, mass=1.0).masses
    (1.0, 1.0, 1.0)
    """

    links: Annotated[
        int,
        Meta(ge=1, le=MOST_LINKS, description=f"a whole number from 1 to {MOST_LINKS}"),
    ]
    mass: PerMass
    drag: NonNegative = 0.0
    load: NonNegativeOrPair = 0.0

    @property
    def worm(self) -> Worm:
        """The worm itself."""
        return Worm(self.links, self.mass, self.drag, self.load)  # pyright: ignore[reportArgumentType]

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each point mass, head first."""
        return self.worm.masses

    def faults(self, loads: bool = False) -> Iterator[Fault]:
        """Yield what is wrong between the keys; `loads`: whether the load may be a range."""
        if isinstance(self.load, tuple) and not loads:
            yield "worm.load", "a range of loads is for gaits that are designed; write one number"
        for key, message in self.worm.faults():
            yield f"worm.{key}", message
