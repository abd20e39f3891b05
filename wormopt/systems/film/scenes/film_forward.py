"""Scenes of kind "film-forward": which wave a film takes under a given travelling field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import msgspec
from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_order,
)
from wormopt.systems.film.scenes.film import FilmTable, Permeability, Share, SharePair
from wormopt.systems.spiked import why_unreadable
from wormopt.tables import SUFFIXES

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
    """A field over one wavelength, by `samples` or from a `file`.

    Values are at equidistant phases *ξ* = *t* − *x* from 0 on, the end left out.

    The result of a row of coils is such a field: `file` is the folder of a
    [`coil-inverse`](coil-inverse.md) run, `variable = "pressure_mean"`, `film.delta` and
    `film.tension` those of its wave. `file` is relative to the scene's folder, so write a scene of
    your own beside the results, without `[branch]`. Under the packaged row's field the film is
    after 100 periods within 0.007 of the steady film, itself within 0.017 of the wave; it still
    moves slowly, and pumps 0.0318 against 0.0334.
    """

    samples: Annotated[Samples | None, says("", "the values themselves")] = None
    file: Annotated[
        Name | None,
        says(
            "",
            "a table (`.csv`, `.txt`, `.tsv`, `.dat`: one column, or *ξ* and the values, units in "
            "the head are converted), or an "
            "earlier result, its folder or its `result.nc`",
        ),
    ] = None
    variable: Annotated[Name | None, says("", "which variable of the result")] = None
    quantity: Annotated[
        Literal["pressure", "field_squared", "field"],
        says(
            "",
            "whether values are (*μ* − 1)*H*²/(8π) over *P*, *H*² or *H*; in SI scenes the last "
            "two are in A²/m² and A/m",
        ),
    ] = "pressure"
    mu_r: Annotated[
        Permeability | None,
        says("1", "permeability, needed for *H* and *H*² in scenes without units"),
    ] = None

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
        path, is_table = folder / name, name.lower().endswith(SUFFIXES)
        unreadable = why_unreadable(path / "result.nc" if path.is_dir() else path)
        if unreadable:
            yield "field.file", f'"{name}" cannot be read from {folder}: {unreadable}'
        if is_table and self.variable is not None:
            yield "field.variable", "belongs to an earlier result; a table has columns only"
        if not is_table and self.variable is None:
            yield "field.variable", "missing; write which variable of the result the field is"


class StartTable(Table, frozen=True, kw_only=True):
    """The film at time 0."""

    shape: Annotated[
        Literal["flat", "wave", "samples"], says("", "flat, the prescribed wave, or given")
    ] = "flat"
    samples: Annotated[
        Thicknesses | None, says("1", "thickness at equidistant phases from 0 on, of mean 1")
    ] = None
    nudge: Annotated[Finite, says("1", "a ripple `nudge` cos(`harmonic` *ξ*) on top")] = 0.0
    harmonic: Annotated[
        int,
        Meta(ge=1, le=16, description="a whole number from 1 to 16"),
        says("count", "which harmonic the ripple is"),
    ] = 1


class GridTable(Table, frozen=True, kw_only=True):
    """How finely the film is resolved."""

    points: Annotated[
        int,
        Meta(ge=32, le=512, description="a whole number from 32 to 512"),
        says("count", "equidistant points over a wavelength at first"),
    ] = 128
    most: Annotated[
        int,
        Meta(ge=32, le=2048, description="a whole number from 32 to 2048"),
        says("count", "points up to which they are doubled until two resolutions agree"),
    ] = 512
    order: Annotated[Literal[4, 6, 8, 10, 12, 14], says("count", "of the differences")] = 12
    agreement: Annotated[
        float,
        Meta(gt=0, le=0.1, description="a number above 0, up to 0.1"),
        says("1", "by how much the ends of two resolutions may differ"),
    ] = 1e-2


class CourseTable(Table, frozen=True, kw_only=True):
    """How long the film is followed."""

    periods: Annotated[
        float, Meta(ge=1, le=1e5, description="a number from 1 to 1e5"), says("1", "of the wave")
    ] = 100.0
    samples: Annotated[
        int,
        Meta(ge=20, le=20_000, description="a whole number, 20 to 20000"),
        says("count", "times that are kept"),
    ] = 401
    rupture: Annotated[
        float,
        Meta(gt=0, lt=1, description="a number above 0 and below 1"),
        says("1", "a film thinner than this share of its mean counts as broken: an assumption"),
    ] = 0.02
    settled: Annotated[
        float,
        Meta(gt=0, le=1e-2, description="a number above 0, up to 0.01"),
        says("1", "distance from a steady film at which it counts as reached"),
    ] = 1e-6


class StepsTable(Table, frozen=True, kw_only=True):
    """How exact the motion shall be."""

    relative: Annotated[
        float,
        Meta(ge=1e-12, le=1e-3, description="a number from 1e-12 to 1e-3"),
        says("1", "error of a step, against the size of a state"),
    ] = 1e-8
    absolute: Annotated[Positive, says("1", "the same, against 1")] = 1e-10
    max_steps: Annotated[
        int,
        Meta(ge=1, le=10**9, description="a whole number, 1 or above"),
        says("count", "steps after which a run is given up"),
    ] = 200_000
    recheck: Annotated[
        bool, says("", "whether the motion is found again to a hundredth of these tolerances")
    ] = True


class MapTable(Table, frozen=True, kw_only=True):
    """Where a flat film goes under the field of every cosine wave.

    The map is content with one resolution where harmonics have died out.
    """

    delta: Annotated[Amplitudes, says("1", "amplitudes, ascending")]
    tension: Annotated[Tensions, says("1", "numbers *W* of surface tension, ascending")]


class BranchTable(Table, frozen=True, kw_only=True):
    """Steady films followed along the amplitude of the cosine wave that the field prescribes."""

    delta: Annotated[SharePair, says("1", "least and largest amplitude; folds are gone around")]
    points: Annotated[
        int,
        Meta(ge=32, le=256, description="a whole number from 32 to 256"),
        says("count", "equidistant points over a wavelength"),
    ] = 64


_MAP = ("map_delta", "map_tension")


class FilmForwardScene(SceneTable, frozen=True, kw_only=True):
    """What a film does under a travelling field.

    Does the film take the wave for which the field was made, and is the wave stable? Theory:
    [theory-film.md](../theory-film.md#3-forward-problem). `[film]` is the prescribed wave, with
    the least field that holds it, and surface tension. With `[field]` another field acts; the wave
    may then be left out, or is what the film is compared with. All results are without units, in
    the scales of (25), in SI scenes too.

    Refused: surface tension 0 (the equation is then of first order and its fronts break), fields
    that jump from their last sample to their first, permeabilities not above 1, too few points
    for the order.

    The trust report: both resolutions with their outcomes and difference, the share of the highest
    harmonics, the run with tighter tolerances, residuals of Newton's method, the closed form of the
    wave against the film the points hold (`closed_form_difference`), assumptions. A film that ends
    otherwise on twice the points, or with tighter tolerances, is `failed`.
    """

    scalars: ClassVar = {
        "outcome": (
            "1",
            "`wave`: it settles on the prescribed wave (under a field of its own: on the steady "
            "film next to that wave); `other`: on another steady film; `moving`: it still moves at "
            "the end; `breaks`: it becomes thinner than `rupture`; `unresolved`: the points cannot "
            "hold it, status `failed`",
        ),
        "distance_to_wave": (
            "1",
            "largest difference of thickness at the end from the prescribed wave",
        ),
        "distance_to_steady": ("1", "the same from the steady film next to the end"),
        "growth_rate_max": (
            "1",
            "largest rate at which small deviations grow from the prescribed wave (under a field "
            "of its own: from the steady film next to it); below 0: stable",
        ),
        "growth_rate_end": ("1", "the same from the steady film next to the end"),
        "mean_flow": ("1", "mean of *Q* at the end"),
        "mean_flow_wave": ("1", "of the prescribed wave"),
        "volume_error": ("1", "largest deviation of the mean thickness from 1"),
        "thickness_max": ("1", "largest thickness at the end"),
        "thickness_min": ("1", "least thickness at the end"),
        "thickness_least": ("1", "least thickness over all times"),
        "broke_time": ("1", "when it broke"),
        "broke_xi": ("rad", "where it broke"),
        "tension_number": ("1", "*W*"),
        "rupture_thickness": ("1", "as in the scene"),
        "points": ("count", "points at last"),
        "branches": ("count", "how many branches of steady films were followed"),
        "delta_fold": ("1", "amplitudes at which they turn back"),
        "delta_stability": ("1", "amplitudes near which stability changes"),
        "map_wave": ("count", "films of the map that take the wave"),
        "map_other": ("count", "films of the map that settle elsewhere"),
        "map_moving": ("count", "films of the map that still move"),
        "map_breaks": ("count", "films of the map that break"),
        "map_unresolved": ("count", "films of the map that the points cannot hold"),
        "map_wave_unstable": ("count", "waves of the map that are not stable"),
        "map_wave_stable_not_reached": (
            "count",
            "waves of the map that are stable, but not where the flat film goes",
        ),
    }
    variables: ClassVar = {
        "xi": ("rad", ("xi",), "phase t - x"),
        "time": ("1", ("time",), "time"),
        "thickness": ("1", ("time", "xi"), "thickness over the mean one"),
        "thickness_end": ("1", ("xi",), "thickness at the end"),
        "thickness_wave": ("1", ("xi",), "prescribed thickness"),
        "flow_end": ("1", ("xi",), "flow Q at the end"),
        "field_pressure": ("1", ("xi",), "(mu - 1) H² / (8 pi)"),
        "growth_wave": ("1", ("mode_wave",), "rates of growth"),
        "swing_wave": ("1", ("mode_wave",), "angular rates"),
        "growth_end": ("1", ("mode_end",), "rates of growth"),
        "swing_end": ("1", ("mode_end",), "angular rates"),
        "branch_delta": ("1", ("branch",), "amplitude of the wave that the field prescribes"),
        "branch_thickness_max": ("1", ("branch",), "largest thickness"),
        "branch_thickness_min": ("1", ("branch",), "least thickness"),
        "branch_mean_flow": ("1", ("branch",), "mean flow"),
        "branch_growth": ("1", ("branch",), "largest rate of growth"),
        "branch_number": ("1", ("branch",), "number of the branch"),
        "map_delta": ("1", ("map_delta",), "amplitude of the wave"),
        "map_tension": ("1", ("map_tension",), "surface tension W"),
        "map_outcome": ("1", _MAP, "0 wave, 1 other, 2 moving, 3 breaks, 4 unresolved"),
        "map_distance": ("1", _MAP, "distance from the prescribed wave at the end"),
        "map_growth": ("1", _MAP, "largest rate of growth on the prescribed wave"),
        "map_growth_end": ("1", _MAP, "largest rate of growth on the steady film at the end"),
        "map_crest": ("1", _MAP, "largest thickness at the end"),
        "map_least": ("1", _MAP, "least thickness over time"),
        "map_time": ("1", _MAP, "time until the end, or until it broke"),
        "map_points": ("1", _MAP, "points"),
    }

    kind: Literal["film-forward"]
    want: Annotated[
        tuple[Literal["forward", "basins"], ...],
        says(
            "",
            "`forward`: thickness over phase and time, film, field, eigenvalues, branches; "
            "`basins`: the map",
        ),
    ] = ()
    film: Annotated[FilmTable, says("", "prescribed wave, and surface tension above 0")]
    field: Annotated[FieldTable | None, says("", "another field that acts instead")] = None
    start: Annotated[StartTable, says("", "the film at time 0")] = msgspec.field(
        default_factory=StartTable
    )
    course: Annotated[CourseTable, says("", "the time")] = msgspec.field(
        default_factory=CourseTable
    )
    grid: Annotated[GridTable, says("", "the points")] = msgspec.field(default_factory=GridTable)
    tolerance: Annotated[StepsTable, says("", "how exact simulations are")] = msgspec.field(
        default_factory=StepsTable
    )
    branch: Annotated[
        BranchTable | None, says("", "steady films along the amplitude; none if left out")
    ] = None
    map: Annotated[MapTable | None, says("", "flat films under other fields; none if left out")] = (
        None
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        for key, message in self.film.faults(self.units):
            # with a field of its own a scene needs no wave
            if self.field is None or not (key == "film.delta" and "missing" in message):
                yield key, message
        yield from self._faults_of_tension()
        if self.film.eps is not None and self.units != "SI":
            yield "film.eps", "is 0 here, as lubrication has it; leave it out"
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
