"""Scenes of kind "slide": a block on the ground goes somewhere in the best way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.scene.numerics import ContactTable, ExactContact, MeshTable
from wormopt.scene.types import Finite, Positive, SceneTable, Table, extreme_numbers
from wormopt.systems.chain.scenes.chain import Friction, faults_of_law


class Place(Table, frozen=True, kw_only=True):
    """Where the block is and how fast.

    Parameters
    ----------
    position : float
        Position.
    velocity : float
        Velocity.
    """

    position: Finite
    velocity: Finite = 0.0


class BlockTable(Table, frozen=True, kw_only=True):
    """The block.

    Parameters
    ----------
    mass : float
        Mass.
    force : float
        Largest drive either way.
    friction : table
        Law of the ground.
    """

    mass: Positive = 1.0
    force: Positive
    friction: Friction


class SlideScene(SceneTable, frozen=True, kw_only=True):
    """The fastest way, or the one of least effort, from one place and velocity to another.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"slide"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    block : BlockTable
        The block.
    start, end : Place
        From where to where.
    minimise : {"time", "effort"}
        Duration, or the integral of the squared drive over it.
    time : float, optional
        Longest duration.
    contact : SmoothContact or ExactContact
        How contact is treated.
    mesh : MeshTable
        How finely.
    """

    kind: Literal["slide"]
    want: tuple[Literal["signals"], ...] = ()
    block: BlockTable
    start: Place
    end: Place
    minimise: Literal["time", "effort"] = "time"
    time: Positive | None = None
    contact: ContactTable = field(default_factory=ExactContact)
    mesh: MeshTable = field(default_factory=MeshTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_law("block.friction", self.block.friction, 1)
        if self.start == self.end:
            yield "end", "is the start; write another position or velocity"
        if self.minimise == "effort" and self.time is None:
            yield "time", "missing; the least effort takes for ever: write the longest time allowed"
