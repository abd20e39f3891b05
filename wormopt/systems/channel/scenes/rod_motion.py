"""Scenes of kind "rod-motion": a magnetisable rod in a channel, moved by coils switched in turn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, SceneTable, Table, extreme_numbers
from wormopt.systems.channel.scenes.rod import (
    ChannelTable,
    CourseTable,
    MeshTable,
    PatternTable,
    Share,
    WormTable,
    ZigzagTable,
    faults_of_rod,
)
from wormopt.systems.coils.scenes.material import SIScene

Levels = Annotated[
    tuple[Annotated[int, Meta(ge=4, le=200)], ...],
    Meta(max_length=6, description="a list of up to 6 whole numbers from 4 to 200"),
]
Fractions = Annotated[
    tuple[Annotated[float, Meta(gt=0, le=1)], ...],
    Meta(max_length=6, description="a list of up to 6 numbers above 0, at most 1"),
]


class SwitchingTable(PatternTable, frozen=True, kw_only=True):
    """How fast and how the coils are switched.

    Parameters
    ----------
    every : int
        Coils after which the pattern repeats along the row.
    duration : float
        How long each coil stays on, in switches.
    shift : float
        By how much every second switch comes late, in switches.
    rate : float
        Switches per second, the chapter's n; the field travels one pitch in 1 / rate.
    """

    rate: Positive

    @property
    def pattern(self) -> PatternTable:
        """The pattern, whatever its rate."""
        return PatternTable(every=self.every, duration=self.duration, shift=self.shift)


class ConvergenceTable(Table, frozen=True, kw_only=True):
    """Other meshes and steps, to see what they change.

    Parameters
    ----------
    elements : tuple of int
        Numbers of elements.
    steps : tuple of float
        Shares of the time step.
    accepted : float
        Largest change of the mean velocity by any of these, beyond the errors of both and over
        that velocity (over a hundredth of the field's, if that is more), that is accepted.
    """

    elements: Levels = (24,)
    steps: Fractions = (0.5,)
    accepted: Share = 0.1


class RodMotionScene(SceneTable, frozen=True, kw_only=True):
    """A magnetisable rod in a channel, moved by coils that are switched in turn.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"rod-motion"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : WormTable
        What moves.
    channel : ChannelTable
        Where.
    coils : ZigzagTable
        What moves it.
    switching : SwitchingTable
        How.
    mesh : MeshTable
        Elements and steps.
    course : CourseTable
        How long.
    convergence : ConvergenceTable
        What is computed again, more finely.
    """

    kind: Literal["rod-motion"]
    want: tuple[Literal["rod_motion", "animation"], ...] = ()
    worm: WormTable = WormTable()
    channel: ChannelTable = ChannelTable()
    coils: ZigzagTable = ZigzagTable()
    switching: SwitchingTable
    mesh: MeshTable = MeshTable()
    course: CourseTable = CourseTable()
    convergence: ConvergenceTable = ConvergenceTable()

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        yield from faults_of_rod(self.worm, self.channel, self.coils, self.mesh)
        yield from self.switching.faults()
