"""Tables that scenes of a magnetisable rod in a channel share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, Table

Coils = Annotated[int, Meta(ge=2, le=40, description="a whole number from 2 to 40")]
Elements = Annotated[int, Meta(ge=4, le=200, description="a whole number from 4 to 200")]
Degree = Annotated[int, Meta(ge=1, le=4, description="1, 2, 3 or 4")]
Cycles = Annotated[int, Meta(ge=2, le=1000, description="a whole number from 2 to 1000")]
Poisson = Annotated[float, Meta(gt=-1, le=0.5, description="a number above -1, at most 0.5")]
Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Duration = Annotated[float, Meta(ge=1, le=8, description="a number from 1 to 8")]
Shift = Annotated[float, Meta(ge=-0.9, le=0.9, description="a number from -0.9 to 0.9")]

Rates = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, max_length=60, description="a list of finite numbers above 0"),
]
Factors = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, max_length=6, description="a list of 1 to 6 finite numbers above 0"),
]


class WormTable(Table, frozen=True, kw_only=True):
    """The worm: a round rod of soft magnetisable rubber.

    Parameters
    ----------
    length, diameter : float
        In m.
    youngs_modulus : float
        In Pa.
    poisson_ratio : float
        0.5 of what keeps its volume.
    density : float
        In kg/m³; an assumption.
    damping_time : float
        Viscosity over Young's modulus, in s; an assumption.
    susceptibility : float
        Magnetisation of the worm over the field without it; an assumption.
    """

    length: Positive = 48e-3
    diameter: Positive = 4e-3
    youngs_modulus: Positive = 5e4
    poisson_ratio: Poisson = 0.5
    density: Positive = 2500.0
    damping_time: Positive = 1e-3
    susceptibility: Positive = 2.0


class ChannelTable(Table, frozen=True, kw_only=True):
    """The channel, two straight walls.

    Parameters
    ----------
    diameter : float
        Distance of the walls, in m.
    friction : float
        Coefficient of dry friction on them; an assumption.
    """

    diameter: Positive = 11e-3
    friction: Positive = 0.5


class ZigzagTable(Table, frozen=True, kw_only=True):
    """A row of equal coils on both sides of the channel by turns, their axes across it.

    Parameters
    ----------
    pitch : float
        Distance of neighbours along the channel, in m.
    inner, outer, length : float
        Radii of the winding and its length along the axis, in m; assumptions.
    clearance : float
        From the inner side of the wall to the winding, in m; an assumption.
    ampere_turns : float
        Of a coil that is on; an assumption.
    """

    pitch: Positive = 10e-3
    inner: Positive = 2e-3
    outer: Positive = 9e-3
    length: Positive = 20e-3
    clearance: Positive = 1e-3
    ampere_turns: Positive = 4600.0

    def faults(self) -> Iterator[Fault]:
        """Yield what cannot be built."""
        if self.inner >= self.outer:
            yield (
                "coils.inner",
                f"{self.inner:g} is not below coils.outer = {self.outer:g}; write the smaller "
                "radius here",
            )
        if self.outer > self.pitch:
            yield (
                "coils.outer",
                f"{self.outer:g} is above coils.pitch = {self.pitch:g}: coils of one side, two "
                f"pitches apart, overlap; write at most {self.pitch:g}",
            )


class PatternTable(Table, frozen=True, kw_only=True):
    """How the coils are switched.

    Parameters
    ----------
    every : int
        Coils after which the pattern repeats along the row.
    duration : float
        How long each coil stays on, in switches; that many coils are on at a time, on average.
    shift : float
        By how much every second switch comes late, in switches.
    """

    every: Coils = 7
    duration: Duration = 3.0
    shift: Shift = 0.0

    def faults(self, key: str = "switching") -> Iterator[Fault]:
        """Yield what does not fit into the pattern; `key` names the table in the scene."""
        most = self.duration + abs(self.shift) + 1
        if most > self.every:
            yield (
                f"{key}.every",
                f"{self.every} coils are too few for coils that stay on for {self.duration:g} "
                f"switches; write at least {int(-(-most // 1))}",
            )


class MeshTable(Table, frozen=True, kw_only=True):
    """Finite elements and time steps.

    Parameters
    ----------
    elements, degree : int
        Elements of the rod, and degree of their polynomials.
    step : float, optional
        Longest time step, in s; 0.8 of the longest stable one if left out.
    field_tolerance : float
        Terms of the field's series below this share of the largest one are left out.
    """

    elements: Elements = 16
    degree: Degree = 2
    step: Positive | None = None
    field_tolerance: Share = 1e-3


class CourseTable(Table, frozen=True, kw_only=True):
    """How long the worm is followed.

    Parameters
    ----------
    cycles : int
        Repeats of the pattern in time, at least.
    duration : float
        In s, at least.
    settle : float
        Share of the time at the beginning that does not count.
    """

    cycles: Cycles = 8
    duration: Positive = 1.2
    settle: Share = 0.25


def faults_of_rod(
    worm: WormTable, channel: ChannelTable, coils: ZigzagTable, mesh: MeshTable
) -> Iterator[Fault]:
    """Yield what no single table shows, as key path and message."""
    yield from coils.faults()
    if worm.diameter >= channel.diameter:
        yield (
            "worm.diameter",
            f"a body of {worm.diameter:g} m does not fit into a channel of {channel.diameter:g} m; "
            "write less than channel.diameter",
        )
    if worm.length < coils.pitch:
        yield (
            "worm.length",
            f"a body of {worm.length:g} m is shorter than the distance of the coils, "
            f"{coils.pitch:g} m: no segment forms; write at least coils.pitch",
        )
    if worm.length / mesh.elements > coils.pitch / 2:
        least = int(-(-2 * worm.length // coils.pitch))
        yield (
            "mesh.elements",
            f"{mesh.elements} are too few for {worm.length / coils.pitch:.3g} pitches of coils; "
            f"write at least {least}",
        )
