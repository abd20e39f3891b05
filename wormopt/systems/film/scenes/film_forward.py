"""Scenes of kind "film-forward": which wave a film takes under a given travelling field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_order,
)
from wormopt.systems.film.scenes.film import FilmTable, Permeability, Share, SharePair
from wormopt.systems.spiked.scenes.shapes import why_unreadable

Samples = Annotated[
    tuple[Finite, ...],
    Meta(min_length=4, max_length=100_000, description="4 to 100000 finite numbers"),
]
Thicknesses = Annotated[
    tuple[Positive, ...],
    Meta(min_length=4, max_length=100_000, description="4 to 100000 finite numbers above 0"),
]
Amplitudes = Annotated[
    tuple[Share, ...],
    Meta(min_length=1, max_length=100, description="1 to 100 numbers above 0 and below 1"),
]
Tensions = Annotated[
    tuple[Positive, ...], Meta(min_length=1, max_length=100, description="1 to 100 numbers above 0")
]
Name = Annotated[str, Meta(min_length=1, description="text that is not empty")]


class FieldTable(Table, frozen=True, kw_only=True):
    """A field over one wavelength, at equidistant phases xi = t - x from 0 on.

    Parameters
    ----------
    samples : tuple of float, optional
        The values themselves.
    file : str, optional
        A .csv file, whose last column they are, or an earlier result: its folder or result.nc.
    variable : str, optional
        Which variable of the result.
    quantity : {"pressure", "field_squared", "field"}
        Whether values are (mu - 1) H² / (8 pi), H² or H; of the last two in A²/m² and A/m where
        the scene is in SI units.
    mu_r : float, optional
        Relative permeability, for fields in scenes without units.
    """

    samples: Samples | None = None
    file: Name | None = None
    variable: Name | None = None
    quantity: Literal["pressure", "field_squared", "field"] = "pressure"
    mu_r: Permeability | None = None

    def faults(self, units: str, folder: Path) -> Iterator[Fault]:
        """Yield key path and message of what is wrong between the keys of this table."""
        if self.samples is None and self.file is None:
            yield "field.samples", "missing; write the values over a wavelength, or file"
        if self.samples is not None and self.file is not None:
            yield "field.file", "stands beside samples; write one of them"
        if self.file is not None:
            yield from self._faults_of_file(self.file, folder)
        elif self.variable is not None:
            yield "field.variable", "belongs to an earlier result; name it in file"
        if self.quantity != "pressure" and units != "SI" and self.mu_r is None:
            yield "field.mu_r", f'missing; quantity = "{self.quantity}" needs the permeability'
        if self.mu_r is not None and (units == "SI" or self.quantity == "pressure"):
            what = "film.fluid has it" if units == "SI" else "does not act on a pressure"
            yield "field.mu_r", f"{what}; leave it out"

    def _faults_of_file(self, name: str, folder: Path) -> Iterator[Fault]:
        path, is_csv = folder / name, name.lower().endswith(".csv")
        unreadable = why_unreadable(path / "result.nc" if path.is_dir() else path)
        if unreadable:
            yield "field.file", f'"{name}" cannot be read from {folder}: {unreadable}'
        if is_csv and self.variable is not None:
            yield "field.variable", "belongs to an earlier result; a .csv file has columns only"
        if not is_csv and self.variable is None:
            yield "field.variable", "missing; write which variable of the result the field is"


class StartTable(Table, frozen=True, kw_only=True):
    """The film at time 0.

    Parameters
    ----------
    shape : {"flat", "wave", "samples"}
        Flat, the prescribed wave, or given.
    samples : tuple of float, optional
        Thickness at equidistant phases from 0 on, of mean 1.
    nudge : float
        Amplitude of a ripple added to it, cos(harmonic xi).
    harmonic : int
        Which harmonic the ripple is.
    """

    shape: Literal["flat", "wave", "samples"] = "flat"
    samples: Thicknesses | None = None
    nudge: Finite = 0.0
    harmonic: Annotated[int, Meta(ge=1, le=16, description="a whole number from 1 to 16")] = 1


class GridTable(Table, frozen=True, kw_only=True):
    """How finely the film is resolved.

    Parameters
    ----------
    points : int
        Equidistant points over a wavelength at first.
    most : int
        Most points, to which they are doubled until two resolutions agree.
    order : int
        Of the differences.
    agreement : float
        By how much the ends of two resolutions may differ.
    """

    points: Annotated[int, Meta(ge=32, le=512, description="a whole number from 32 to 512")] = 128
    most: Annotated[int, Meta(ge=32, le=2048, description="a whole number from 32 to 2048")] = 512
    order: Literal[4, 6, 8, 10, 12, 14] = 12
    agreement: Annotated[float, Meta(gt=0, le=0.1, description="a number above 0, up to 0.1")] = (
        1e-2
    )


class CourseTable(Table, frozen=True, kw_only=True):
    """How long the film is followed.

    Parameters
    ----------
    periods : float
        Of the wave.
    samples : int
        Equidistant times that are kept.
    rupture : float
        Thickness, over the mean one, below which the film counts as broken.
    settled : float
        Distance from a steady wave below which it counts as reached.
    """

    periods: Annotated[float, Meta(ge=1, le=1e5, description="a number from 1 to 1e5")] = 100.0
    samples: Annotated[int, Meta(ge=20, le=20_000, description="a whole number, 20 to 20000")] = 401
    rupture: Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")] = 0.02
    settled: Annotated[float, Meta(gt=0, le=1e-2, description="a number above 0, up to 0.01")] = (
        1e-6
    )


class StepsTable(Table, frozen=True, kw_only=True):
    """How exact the motion shall be.

    Parameters
    ----------
    relative, absolute : float
        Error of a step against the size of a state, and against 1.
    max_steps : int
        Steps after which a run is given up.
    recheck : bool
        Whether the motion is found again to a hundredth of these tolerances.
    """

    relative: Annotated[
        float, Meta(ge=1e-12, le=1e-3, description="a number from 1e-12 to 1e-3")
    ] = 1e-8
    absolute: Positive = 1e-10
    max_steps: Annotated[int, Meta(ge=1, le=10**9, description="a whole number, 1 or above")] = (
        200_000
    )
    recheck: bool = True


class MapTable(Table, frozen=True, kw_only=True):
    """Where flat films go under the fields of cosine waves.

    Parameters
    ----------
    delta : tuple of float
        Amplitudes.
    tension : tuple of float
        Numbers W of surface tension.
    """

    delta: Amplitudes
    tension: Tensions


class BranchTable(Table, frozen=True, kw_only=True):
    """Steady waves followed along the amplitude of the wave that the field prescribes.

    Parameters
    ----------
    delta : (float, float)
        Least and largest amplitude.
    points : int
        Equidistant points over a wavelength.
    """

    delta: SharePair
    points: Annotated[int, Meta(ge=32, le=256, description="a whole number from 32 to 256")] = 64


class FilmForwardScene(SceneTable, frozen=True, kw_only=True):
    """What a film does under a travelling field.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"film-forward"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether the fluid is given in SI units.
    want : tuple of str
        Pictures to draw.
    film : FilmTable
        Surface tension, and the wave whose field acts unless there is another.
    field : FieldTable, optional
        Another field.
    start : StartTable
        The film at time 0.
    course : CourseTable
        The time.
    grid : GridTable
        The points.
    tolerance : StepsTable
        How exact simulations are.
    branch : BranchTable, optional
        Steady waves along the amplitude.
    map : MapTable, optional
        Flat films under other fields.
    """

    kind: Literal["film-forward"]
    want: tuple[Literal["forward", "basins"], ...] = ()
    film: FilmTable
    field: FieldTable | None = None
    start: StartTable = msgspec.field(default_factory=StartTable)
    course: CourseTable = msgspec.field(default_factory=CourseTable)
    grid: GridTable = msgspec.field(default_factory=GridTable)
    tolerance: StepsTable = msgspec.field(default_factory=StepsTable)
    branch: BranchTable | None = None
    map: MapTable | None = None

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        for key, message in self.film.faults(self.units):
            # with a field of its own a scene needs no wave
            if self.field is None or not (key == "film.delta" and "missing" in message):
                yield key, message
        yield from self._faults_of_tension()
        if self.field is not None:
            yield from self.field.faults(self.units, folder)
        yield from self._faults_of_start()
        if self.grid.most < self.grid.points:
            yield "grid.most", f"is less than grid.points; write at least {self.grid.points}"
        if self.grid.points < 2 * self.grid.order:
            yield "grid.points", f"too few for order {self.grid.order}; write {2 * self.grid.order}"
        yield from self._faults_of_tables()

    @property
    def has_wave(self) -> bool:
        """Whether a wave is prescribed."""
        film = self.film
        return film.delta is not None or film.cosines is not None or film.sines is not None

    def _faults_of_tension(self) -> Iterator[Fault]:
        why = (
            "without surface tension nothing smooths the film: the equation is of first order and "
            "its fronts steepen until they break"
        )
        if self.units != "SI" and self.film.tension is None:
            yield "film.tension", "missing; write the number W of surface tension, 0.1 say"
        elif self.film.tension == 0:
            yield "film.tension", f"must be above 0; {why}; write 0.1, say"
        if self.film.fluid is not None and self.film.fluid.surface_tension == 0:
            yield "film.fluid.surface_tension", f"must be above 0; {why}"

    def _faults_of_start(self) -> Iterator[Fault]:
        start = self.start
        if start.shape == "wave" and not self.has_wave:
            yield "start.shape", "there is no prescribed wave; write film.delta"
        if start.shape == "samples" and start.samples is None:
            yield "start.samples", "missing; write the thickness over a wavelength"
        if start.shape != "samples" and start.samples is not None:
            yield "start.samples", 'goes with shape = "samples"'

    def _faults_of_tables(self) -> Iterator[Fault]:
        cosine = self.field is None and self.film.delta is not None
        if self.branch is not None and not cosine:
            yield "branch", "follows cosine waves; write film.delta and no field"
        if self.branch is not None:
            yield from wrong_order("branch.delta", self.branch.delta, may_be_equal=False)
            least, largest = self.branch.delta
            if cosine and not least <= (self.film.delta or 0) <= largest:
                yield "branch.delta", f"does not hold film.delta = {self.film.delta:g}"
            if self.branch.points < 2 * self.grid.order:
                yield "branch.points", f"too few for order {self.grid.order}"
        if self.map is None:
            if "basins" in self.want:
                yield "map", 'missing; want = ["basins"] draws it'
            return
        for name in ("delta", "tension"):
            values = getattr(self.map, name)
            if list(values) != sorted(set(values)):
                yield f"map.{name}", "must ascend, no value twice"
