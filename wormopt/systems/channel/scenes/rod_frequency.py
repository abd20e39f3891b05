"""Scenes of kind "rod-frequency": how fast a magnetisable rod crawls, over the frequency."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, SceneTable, Table, Title, extreme_numbers
from wormopt.systems.channel.scenes.rod import (
    ChannelTable,
    CourseTable,
    Factors,
    MeshTable,
    PatternTable,
    Rates,
    Share,
    WormTable,
    ZigzagTable,
    faults_of_rod,
)
from wormopt.systems.coils.scenes.material import SIScene

Doubtful = Literal[
    "youngs_modulus",
    "density",
    "damping_time",
    "susceptibility",
    "friction",
    "coil_outer",
    "coil_clearance",
]
Rounds = Annotated[int, Meta(ge=0, le=20, description="a whole number from 0 to 20")]
Count = Annotated[int, Meta(ge=0, le=60, description="a whole number from 0 to 60")]


class SensitivityTable(Table, frozen=True, kw_only=True):
    """Which numbers are changed to see what the velocity hangs on.

    Parameters
    ----------
    parameters : tuple of str
        Numbers of the worm, the channel and the coils.
    factors : tuple of float
        By which each of them is changed; coils that would overlap take all of their pitch.
    rates : tuple of float
        Frequencies at which.
    """

    parameters: Annotated[tuple[Doubtful, ...], Meta(min_length=1)] = (
        "youngs_modulus",
        "density",
        "damping_time",
        "susceptibility",
        "friction",
        "coil_outer",
        "coil_clearance",
    )
    factors: Factors = (0.5, 2.0)
    rates: Rates = (20.0, 100.0, 500.0)


class SearchTable(Table, frozen=True, kw_only=True):
    """How the best frequency and the best pattern are sought.

    Parameters
    ----------
    refine : int
        Frequencies tried between the neighbours of the best one.
    rounds : int
        Rounds of the search for a pattern, over frequency, duration and shift; 0 for none.
    """

    refine: Count = 8
    rounds: Rounds = 4


class MeasuredTable(Table, frozen=True, kw_only=True):
    """A measured point that the picture shows.

    Parameters
    ----------
    rate : float
        Switches per second.
    velocity : float
        Against the travel of the field, in m/s; 0 where the body did not move.
    text : str
        What the picture says of it.
    """

    rate: Positive
    velocity: Annotated[float, Meta(ge=0, le=1e3, description="a number from 0 to 1000")]
    text: Title


class RodFrequencyScene(SceneTable, frozen=True, kw_only=True):
    """Velocity of a magnetisable rod over the frequency at which its coils are switched.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"rod-frequency"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    rates : tuple of float
        Switches per second, ascending.
    worm : WormTable
        What moves.
    channel : ChannelTable
        Where.
    coils : ZigzagTable
        What moves it.
    switching : PatternTable
        How.
    mesh : MeshTable
        Elements and steps.
    course : CourseTable
        How long.
    sensitivity : SensitivityTable, optional
        What the velocity hangs on; left out if the scene has it not.
    search : SearchTable, optional
        What is best; left out if the scene has it not.
    accepted : float
        Largest change of the best velocity on a finer mesh and by half the step, beyond the
        errors of both and over that velocity, that is accepted.
    measured : tuple of MeasuredTable
        Marks in the picture.
    """

    kind: Literal["rod-frequency"]
    want: tuple[Literal["rod_frequency"], ...] = ()
    rates: Rates
    worm: WormTable = WormTable()
    channel: ChannelTable = ChannelTable()
    coils: ZigzagTable = ZigzagTable()
    switching: PatternTable = PatternTable()
    mesh: MeshTable = MeshTable()
    course: CourseTable = CourseTable(duration=3.0)
    sensitivity: SensitivityTable | None = None
    search: SearchTable | None = None
    accepted: Share = 0.1
    measured: tuple[MeasuredTable, ...] = ()

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        yield from faults_of_rod(self.worm, self.channel, self.coils, self.mesh)
        yield from self.switching.faults()
        if list(self.rates) != sorted(set(self.rates)):
            yield "rates", "must ascend, each standing once; write them in order"
