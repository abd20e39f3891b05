"""Scenes of kind "coil-inverse": currents of a row of coils for the field that a wave needs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    NonNegative,
    Positive,
    SceneTable,
    Seed,
    Table,
    extreme_numbers,
)
from wormopt.systems.coils.scenes.coil_row import CoilsTable, LineTable
from wormopt.systems.coils.scenes.material import Permeability, faults_of_units

Amplitude = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]


class FilmTable(Table, frozen=True, kw_only=True):
    """A film of magnetic fluid.

    Parameters
    ----------
    depth : float
        Mean thickness, m.
    mu_r : float
        Relative permeability, above 1.
    viscosity : float
        Dynamic viscosity, Pa s.
    density : float
        In kg/m³; it enters warnings only.
    surface_tension : float
        In N/m.
    """

    depth: Positive
    mu_r: Permeability = 1.09
    viscosity: Positive = 0.01
    density: Positive = 1100.0
    surface_tension: NonNegative = 0.03


class WaveTable(Table, frozen=True, kw_only=True):
    """The wave that the surface shall have.

    Parameters
    ----------
    delta : float
        Amplitude over mean thickness.
    wavelength : float
        In m.
    frequency : float
        Angular frequency, rad/s.
    field : float, optional
        H0 in A/m; sought if left out.
    """

    delta: Amplitude
    wavelength: Positive
    frequency: Positive
    field: Positive | None = None


class CurrentLimitsTable(Table, frozen=True, kw_only=True):
    """What currents must keep to, besides the ampere-turns of the coils.

    Parameters
    ----------
    slew : float, optional
        Largest change of a coil's ampere-turns per second.
    polarity : {"any", "one", "alternating"}
        Any sign with the period of the wave; one sign only; or a change of sign after each period.
    """

    slew: Positive | None = None
    polarity: Literal["any", "one", "alternating"] = "any"


class CurrentSearchTable(Table, frozen=True, kw_only=True):
    """How finely and from where currents are sought.

    Parameters
    ----------
    nodes : int
        Corners of the course in one period, and phases compared.
    places : int
        Places per pitch at which the field is compared.
    starts : int
        Starts: three offsets of the field, then random ones.
    seed : int
        The same seed gives the same starts.
    """

    nodes: Annotated[int, Meta(ge=8, le=200, description="a whole number from 8 to 200")] = 40
    places: Annotated[int, Meta(ge=1, le=20, description="a whole number from 1 to 20")] = 3
    starts: Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")] = 4
    seed: Seed = 0


class CoilInverseScene(SceneTable, frozen=True, kw_only=True):
    """Currents of a row whose travelling field comes nearest to what a wave of a film needs.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"coil-inverse"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    coils : CoilsTable
        The row.
    line : LineTable
        Where the film is.
    film : FilmTable
        The fluid.
    wave : WaveTable
        The wave it shall have.
    limits : CurrentLimitsTable
        What currents must keep to.
    search : CurrentSearchTable
        How they are sought.
    """

    kind: Literal["coil-inverse"]
    want: tuple[Literal["row_currents"], ...] = ()
    coils: CoilsTable = field(default_factory=CoilsTable)
    line: LineTable
    film: FilmTable
    wave: WaveTable
    limits: CurrentLimitsTable = field(default_factory=CurrentLimitsTable)
    search: CurrentSearchTable = field(default_factory=CurrentSearchTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        yield from self.coils.faults()
        wrong = list(self.line.faults(self.coils))
        yield from wrong
        if self.wave.wavelength < 2 * self.coils.pitch:
            yield (
                "wave.wavelength",
                f"{self.wave.wavelength:g} is below two pitches: coils {self.coils.pitch:g} apart "
                f"do not tell such a wave from a longer one; write at least "
                f"{2 * self.coils.pitch:g}",
            )
