"""Scenes of kind "film-wave": the wave of a film of magnetic fluid that does something best."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    Pair,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_order,
)

Crests = Annotated[int, Meta(ge=1, le=12, description="a whole number from 1 to 12")]
Values = Annotated[
    tuple[Positive, ...], Meta(min_length=1, max_length=32, description="1 to 32 numbers above 0")
]
Flow = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]


class WavyFilmTable(Table, frozen=True, kw_only=True):
    """The film.

    Parameters
    ----------
    tension : float
        Number W of surface tension; without any the field could make corners of any kind.
    """

    tension: Positive


class WaveLimitsTable(Table, frozen=True, kw_only=True):
    """What the wave must keep to.

    Parameters
    ----------
    thickness : (float, float)
        Least and largest thickness over the mean.
    field : float, optional
        Range of (mu - 1) H² / (8 pi) over the unit of pressure, from least to largest.
    gradient : float, optional
        Largest slope of it by the phase; without it the field may jump.
    """

    thickness: Pair
    field: Positive | None = None
    gradient: Positive | None = None


class WaveAimTable(Table, frozen=True, kw_only=True):
    """What the wave is to be good at; one of both is sought.

    Parameters
    ----------
    maximise : {"mean_flow", "float_speed"}, optional
        What the film carries, or the speed of a small float on it.
    minimise : {"field"}, optional
        The range of the field, for a flow or so that the wave holds a small float.
    mean_flow : float, optional
        Least mean flow.
    capture : bool
        Whether a small float is held.
    """

    maximise: Literal["mean_flow", "float_speed"] | None = None
    minimise: Literal["field"] | None = None
    mean_flow: Flow | None = None
    capture: bool = False

    def faults(self) -> Iterator[Fault]:
        """Yield what does not fit together."""
        if (self.maximise is None) == (self.minimise is None):
            yield (
                "aim",
                'write maximise = "mean_flow", maximise = "float_speed" or minimise = "field", '
                "one of them",
            )
        elif self.minimise and self.mean_flow is None and not self.capture:
            yield "aim", "no wave takes the least field: write mean_flow = 0.3, say, or capture"
        elif self.maximise and self.mean_flow is not None:
            yield "aim.mean_flow", 'belongs to minimise = "field"; leave it out'
        elif self.maximise and self.capture:
            yield "aim.capture", 'belongs to minimise = "field"; leave it out'


class WaveSearchTable(Table, frozen=True, kw_only=True):
    """Where searches begin.

    Parameters
    ----------
    crests : int
        Most crests in a wavelength to start from.
    """

    crests: Crests = 3


class WaveSweepTable(Table, frozen=True, kw_only=True):
    """Other films and fields; every tension is taken with every field.

    Parameters
    ----------
    tension : tuple of float, optional
        Numbers W; that of the film if left out.
    field : tuple of float, optional
        Ranges of the field; that of the limits if left out.
    """

    tension: Values | None = None
    field: Values | None = None


class FilmWaveScene(SceneTable, frozen=True, kw_only=True):
    """The best wave of a film, beside the cosine wave within the same limits.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"film-wave"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless"}
        Numbers are scaled by (25).
    want : tuple of str
        Pictures to draw.
    film : WavyFilmTable
        The film.
    limits : WaveLimitsTable
        What the wave must keep to.
    aim : WaveAimTable
        What it is to be good at.
    mesh : MeshTable
        How finely.
    search : WaveSearchTable
        Where to begin.
    sweep : WaveSweepTable, optional
        Other films and fields.
    """

    kind: Literal["film-wave"]
    units: Literal["dimensionless"] = "dimensionless"
    want: tuple[Literal["film_wave"], ...] = ()
    film: WavyFilmTable
    limits: WaveLimitsTable
    aim: WaveAimTable
    mesh: MeshTable = field(default_factory=lambda: MeshTable(arcs=60))
    search: WaveSearchTable = field(default_factory=WaveSearchTable)
    sweep: WaveSweepTable | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        wrong = list(wrong_order("limits.thickness", self.limits.thickness, may_be_equal=False))
        yield from wrong
        least, most = self.limits.thickness
        if not wrong and not least < 1 < most:
            yield (
                "limits.thickness",
                f"[{least:g}, {most:g}] does not contain the mean thickness 1; write one number "
                "below 1 and one above",
            )
        yield from self.aim.faults()
        if self.aim.maximise and self.limits.field is None:
            yield "limits.field", "missing; write the largest range of the field"
        if self.aim.minimise and self.limits.field is not None:
            yield "limits.field", 'is what minimise = "field" finds; leave it out'
        if self.mesh.degree < 3:
            yield "mesh.degree", "the field is at least linear on every arc; write 3 or more"
        if self.sweep is not None:
            yield from self._faults_of_sweep(self.sweep)

    def _faults_of_sweep(self, sweep: WaveSweepTable) -> Iterator[Fault]:
        if self.aim.maximise != "mean_flow":
            yield "sweep", 'is for maximise = "mean_flow"; leave it out'
        if sweep.tension is None and sweep.field is None:
            yield "sweep", "is empty; write tension = [0.1, 0.03], say, or field = [...]"
        for name in ("tension", "field"):
            values = getattr(sweep, name) or ()
            if len(set(values)) < len(values):
                yield f"sweep.{name}", "the same number stands there twice; write it once"
