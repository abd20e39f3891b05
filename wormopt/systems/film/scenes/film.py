"""Scenes of kinds "film-flow" and "float": a film of magnetic fluid, and what its wave carries."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import ToleranceTable
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_order,
)

Share = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]
Shares = Annotated[
    tuple[Share, ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers above 0 and below 1"),
]
SharePair = Annotated[
    tuple[Share, ...],
    Meta(min_length=2, max_length=2, description="two numbers above 0 and below 1, smaller first"),
]
Harmonics = Annotated[
    tuple[Finite, ...], Meta(min_length=1, max_length=32, description="1 to 32 finite numbers")
]
Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]
Length = Annotated[
    float, Meta(ge=0, lt=1, description="a number from 0 to below 1, in wavelengths")
]
Lengths = Annotated[
    tuple[Length, ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers from 0 to below 1"),
]
Levels = Annotated[
    tuple[Annotated[float, Meta(gt=0, le=1, description="a number above 0, up to 1")], ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers above 0, up to 1"),
]
Points = Annotated[int, Meta(ge=2, le=100_000, description="a whole number, 2 to 100000")]


class FluidTable(Table, frozen=True, kw_only=True):
    """Fluid, film and wave in SI units.

    Parameters
    ----------
    mu_r : float
        Relative permeability.
    viscosity : float
        Dynamic viscosity, Pa s.
    density : float
        kg/m³.
    surface_tension : float
        N/m.
    depth : float
        Mean thickness of the film, m.
    wavelength : float
        m.
    frequency : float
        Angular frequency of the wave, rad/s.
    """

    mu_r: Permeability
    viscosity: Positive
    density: Positive
    surface_tension: NonNegative
    depth: Positive
    wavelength: Positive
    frequency: Positive


class FilmTable(Table, frozen=True, kw_only=True):
    """A film and the shape of its wave.

    Parameters
    ----------
    delta : float, optional
        Amplitude of a cosine wave over the mean thickness.
    cosines, sines : tuple of float, optional
        Harmonics of any other wave, over the mean thickness, the first harmonic first.
    tension : float, optional
        Number W of surface tension, for scenes without units; 0 if left out.
    fluid : FluidTable, optional
        The fluid, for scenes in SI units; W follows from it.
    """

    delta: Share | None = None
    cosines: Harmonics | None = None
    sines: Harmonics | None = None
    tension: NonNegative | None = None
    fluid: FluidTable | None = None

    def faults(self, units: str) -> Iterator[Fault]:
        """Yield key path and message of what is wrong between the keys of this table."""
        harmonics = [name for name in ("cosines", "sines") if getattr(self, name) is not None]
        if self.delta is None and not harmonics:
            yield "film.delta", "missing; write the amplitude, or harmonics in cosines and sines"
        if self.delta is not None and harmonics:
            yield "film.delta", f"is a cosine wave by itself; write it or {' and '.join(harmonics)}"
        if harmonics and not any(any(getattr(self, name)) for name in harmonics):
            yield f"film.{harmonics[0]}", "all harmonics are 0: there is no wave"
        if units == "SI" and self.fluid is None:
            yield "film.fluid", 'missing; with units = "SI" describe the fluid: [film.fluid]'
        if units == "SI" and self.tension is not None:
            yield "film.tension", "belongs to scenes without units; surface_tension gives it here"
        if units != "SI" and self.fluid is not None:
            yield "film.fluid", 'is in SI units; write units = "SI"'


class CurvesTable(Table, frozen=True, kw_only=True):
    """Cosine waves of other amplitudes to compare with.

    Parameters
    ----------
    delta : tuple of float
        Amplitudes whose fields are drawn.
    range : (float, float)
        Least and largest amplitude of the curve of mean flow.
    points : int
        Amplitudes on it.
    """

    delta: Shares = (0.1, 0.3, 0.5, 0.7, 0.9)
    range: SharePair = (0.005, 0.995)
    points: Points = 199


class FilmFlowScene(SceneTable, frozen=True, kw_only=True):
    """Flow in a film, and the field that holds its shape.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"film-flow"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether the fluid is given in SI units.
    want : tuple of str
        Pictures to draw.
    film : FilmTable
        The film.
    curves : CurvesTable
        Other amplitudes.
    samples : int
        Phases of the wave at which signals are kept.
    """

    kind: Literal["film-flow"]
    want: tuple[Literal["film"], ...] = ()
    film: FilmTable
    curves: CurvesTable = field(default_factory=CurvesTable)
    samples: Points = 401

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from self.film.faults(self.units)
        yield from wrong_order("curves.range", self.curves.range, may_be_equal=False)


class FloatsTable(Table, frozen=True, kw_only=True):
    """Bodies on the surface.

    Parameters
    ----------
    length : tuple of float
        Their lengths in wavelengths; 0 is a small float.
    position : float
        Place of their middles at time 0, in wavelengths ahead of a crest.
    """

    length: Lengths = (0.0,)
    position: Finite = 0.0


class TracersTable(Table, frozen=True, kw_only=True):
    """Points of the fluid.

    Parameters
    ----------
    height : tuple of float
        Over the ground at time 0, as shares of the thickness there; 1 is on the surface.
    position : float
        Place at time 0, in wavelengths ahead of a crest.
    """

    height: Levels
    position: Finite = 0.0


class RideTable(Table, frozen=True, kw_only=True):
    """How long is simulated.

    Parameters
    ----------
    periods : float, optional
        Of the wave; long enough for every body to be overtaken three times if left out.
    samples : int
        Times that are kept.
    """

    periods: Positive | None = None
    samples: Points = 1001


class FloatScene(SceneTable, frozen=True, kw_only=True):
    """What a travelling wave carries.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"float"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether the fluid is given in SI units.
    want : tuple of str
        Pictures to draw.
    film : FilmTable
        The film.
    floats : FloatsTable
        Bodies on the surface.
    tracers : TracersTable, optional
        Points of the fluid.
    course : RideTable
        The time.
    tolerance : ToleranceTable
        How exact simulations are.
    """

    kind: Literal["float"]
    want: tuple[Literal["ride"], ...] = ()
    film: FilmTable
    floats: FloatsTable = field(default_factory=FloatsTable)
    tracers: TracersTable | None = None
    course: RideTable = field(default_factory=RideTable)
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from self.film.faults(self.units)
        if self.film.tension:
            yield "film.tension", "does not act on what floats; leave it out"
