"""Tables of scenes of kind "film-forward": the wave of a film in a given travelling field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Finite, Positive, SceneTable, wrong_order
from wormopt.systems.film.tables import Film, Share, SharePair
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
Permeability = Annotated[float, Meta(gt=1, le=1e30, description="a finite number above 1")]


class FieldTable(Given):
    """A field over one wavelength, from `samples` or a `file`.

    Values are at equidistant phases *ξ* = *t* − *x* from 0 on, without the end.

    The result of a row of coils can be used: `file` is the folder of a
    [`coil-inverse`](coil-inverse.md) run, `variable = "pressure_mean"`, and `film.delta` and
    `film.tension` are those of its wave. `file` is relative to the scene's folder, so write a new
    scene beside the results, without `[branch]`. In the field of the packaged row, the film after
    100 periods is within 0.007 of the steady film, which is within 0.017 of the wave. The film
    still moves slowly, and pumps 0.0318 instead of 0.0334.
    """

    samples: Samples | None = entry("values of the field", default=None)
    file: Name | None = entry(
        "a table (`.csv`, `.txt`, `.tsv`, `.dat`) with one column, or with *ξ* and the "
        "values, in the units of its head; or an earlier result, as its folder or its "
        "`result.nc`",
        default=None,
    )
    variable: Name | None = entry("variable of the result", default=None)
    quantity: Literal["pressure", "field_squared", "field"] = entry(
        "quantity of the values: (*μ* − 1)*H*²/(8π) over *P*, *H*² or *H*; in SI scenes the "
        "last two are in A²/m² and A/m",
        default="pressure",
    )
    mu_r: Permeability | None = entry(
        "relative permeability, required for *H* and *H*² in scenes without units",
        quantity="1",
        default=None,
    )

    def faults(self, units: str, folder: Path) -> Iterator[Fault]:
        """Yield key path and message of what is wrong between the keys of this table."""
        if self.samples is None and self.file is None:
            yield "field.samples", "missing; write the values over a wavelength, or file"
        if self.samples is not None and self.file is not None:
            yield "field.file", "cannot be combined with samples; write one of them"
        if self.file is not None:
            yield from self._faults_of_file(self.file, folder)
        elif self.variable is not None:
            yield "field.variable", "needs an earlier result; name it in file"
        if self.quantity != "pressure" and units != "SI" and self.mu_r is None:
            yield "field.mu_r", f'missing; quantity = "{self.quantity}" needs the permeability'
        if self.mu_r is not None and (units == "SI" or self.quantity == "pressure"):
            what = (
                "is already given by film.fluid" if units == "SI" else "has no effect on a pressure"
            )
            yield "field.mu_r", f"{what}; leave it out"

    def _faults_of_file(self, name: str, folder: Path) -> Iterator[Fault]:
        path, is_table = folder / name, name.lower().endswith(SUFFIXES)
        unreadable = why_unreadable(path / "result.nc" if path.is_dir() else path)
        if unreadable:
            yield "field.file", f'"{name}" cannot be read from {folder}: {unreadable}'
        if is_table and self.variable is not None:
            yield "field.variable", "applies to an earlier result, not to a table; leave it out"
        if not is_table and self.variable is None:
            yield (
                "field.variable",
                "missing; write the variable of the result that contains the field",
            )


class StartTable(Given):
    """The film at time 0."""

    shape: Literal["flat", "wave", "samples"] = entry(
        "shape: flat, the prescribed wave, or given samples", default="flat"
    )
    samples: Thicknesses | None = entry(
        "thickness at equidistant phases from 0 on, with mean 1", quantity="1", default=None
    )
    nudge: float = number(
        "1", "amplitude of an added ripple `nudge` cos(`harmonic` *ξ*)", default=0.0
    )
    harmonic: int = whole(1, 16, "harmonic of the ripple", default=1)


class GridTable(Given):
    """Resolution of the film."""

    points: int = whole(
        32, 512, "initial number of equidistant points over a wavelength", default=128
    )
    most: int = whole(
        32,
        2048,
        "largest number of points; they are doubled until two resolutions agree",
        default=512,
    )
    order: Literal[4, 6, 8, 10, 12, 14] = entry(
        "order of the finite differences", quantity="count", default=12
    )
    agreement: float = number(
        "1",
        "accepted difference between the end states of two resolutions",
        above=0,
        most=0.1,
        default=1e-2,
    )


class CourseTable(Given):
    """Duration of the simulation."""

    periods: float = number("1", "number of wave periods", least=1, most=100000.0, default=100.0)
    samples: int = whole(20, 20000, "number of times in the result", default=401)
    rupture: float = number(
        "1",
        "a film thinner than this share of its mean counts as ruptured; this is an assumption",
        above=0,
        below=1,
        default=0.02,
    )
    settled: float = number(
        "1",
        "distance from a steady film below which it counts as reached",
        above=0,
        most=0.01,
        default=1e-6,
    )


class StepsTable(Given):
    """Tolerances of the simulation."""

    relative: float = number(
        "1",
        "relative error per step, against the size of a state",
        least=1e-12,
        most=0.001,
        default=1e-8,
    )
    absolute: float = positive("1", "absolute error per step, against 1", default=1e-10)
    max_steps: int = whole(1, 1000000000, "largest number of steps of a run", default=200_000)
    recheck: bool = entry(
        "whether the simulation is repeated with a hundredth of these tolerances", default=True
    )


class MapTable(Given):
    """Final states of flat films in the fields of many cosine waves.

    The map uses a single resolution where harmonics have decayed.
    """

    delta: Amplitudes = entry("amplitudes, ascending", quantity="1")
    tension: Tensions = entry("values of the surface tension *W*, ascending", quantity="1")


class BranchTable(Given):
    """Continuation of steady films in the amplitude of the prescribed cosine wave."""

    delta: SharePair = entry(
        "least and largest amplitude; the continuation passes folds", quantity="1"
    )
    points: int = whole(32, 256, "equidistant points over a wavelength", default=64)


_MAP = ("map_delta", "map_tension")


class FilmForwardScene(SceneTable):
    """Dynamics of a film in a travelling field.

    It answers whether the film takes the wave for which the field was made, and whether that wave
    is stable. Theory: [theory-film.md](../theory-film.md#3-forward-problem). `[film]` is the
    prescribed wave with its surface tension, in the least field that holds it. `[field]` replaces
    that field; the wave may then be left out, or is used for comparison. All results are
    dimensionless, in the scales of eq. 25 of Zimmermann et al. 2007, in SI scenes too.

    Not allowed: surface tension 0, with which the equation is of first order and its fronts break;
    fields that jump from their last sample to their first; permeabilities of 1 or below; too few
    points for the order.

    The trust report contains both resolutions with outcomes and difference, the share of the
    highest harmonics, the run with tighter tolerances, residuals of Newton's method, the difference
    between the closed form of the wave and the film on the points (`closed_form_difference`), and
    assumptions. The status is `failed` if twice the points or tighter tolerances change the
    outcome.
    """

    scalars: ClassVar = {
        "outcome": (
            "1",
            "`wave`: the film converges to the prescribed wave (with `[field]`: to the steady "
            "film closest to that wave); `other`: to another steady film; `moving`: it still "
            "moves at the end; `breaks`: it becomes thinner than `rupture`; `unresolved`: the "
            "points do not resolve it, status `failed`",
        ),
        "distance_to_wave": (
            "1",
            "largest difference between the thickness at the end and the prescribed wave",
        ),
        "distance_to_steady": (
            "1",
            "largest difference between the thickness at the end and the closest steady film",
        ),
        "growth_rate_max": (
            "1",
            "largest growth rate of small deviations from the prescribed wave (with `[field]`: "
            "from the closest steady film); below 0: stable",
        ),
        "growth_rate_end": (
            "1",
            "largest growth rate of small deviations from the steady film closest to the end",
        ),
        "mean_flow": ("1", "mean of *Q* at the end"),
        "mean_flow_wave": ("1", "mean of *Q* for the prescribed wave"),
        "volume_error": ("1", "largest deviation of the mean thickness from 1"),
        "thickness_max": ("1", "largest thickness at the end"),
        "thickness_min": ("1", "least thickness at the end"),
        "thickness_least": ("1", "least thickness over all times"),
        "broke_time": ("1", "time of rupture"),
        "broke_xi": ("rad", "phase of rupture"),
        "tension_number": ("1", "*W*"),
        "rupture_thickness": ("1", "rupture thickness, as in the scene"),
        "points": ("count", "final number of points"),
        "branches": ("count", "number of branches of steady films"),
        "delta_fold": ("1", "amplitudes of the folds"),
        "delta_stability": ("1", "amplitudes near which stability changes"),
        "map_wave": ("count", "films of the map that converge to the wave"),
        "map_other": ("count", "films of the map that converge to another steady film"),
        "map_moving": ("count", "films of the map that still move"),
        "map_breaks": ("count", "films of the map that rupture"),
        "map_unresolved": ("count", "films of the map that the points do not resolve"),
        "map_wave_unstable": ("count", "unstable waves of the map"),
        "map_wave_stable_not_reached": (
            "count",
            "stable waves of the map that the flat film does not reach",
        ),
    }
    variables: ClassVar = {
        "xi": ("rad", ("xi",), "phase t - x"),
        "time": ("1", ("time",), "time"),
        "thickness": ("1", ("time", "xi"), "thickness over the mean thickness"),
        "thickness_end": ("1", ("xi",), "thickness at the end"),
        "thickness_wave": ("1", ("xi",), "prescribed thickness"),
        "flow_end": ("1", ("xi",), "flow Q at the end"),
        "field_pressure": ("1", ("xi",), "(mu - 1) H² / (8 pi)"),
        "growth_wave": ("1", ("mode_wave",), "growth rates of the prescribed wave"),
        "swing_wave": ("1", ("mode_wave",), "angular frequencies of the prescribed wave's modes"),
        "growth_end": ("1", ("mode_end",), "growth rates of the steady film at the end"),
        "swing_end": ("1", ("mode_end",), "angular frequencies of its modes"),
        "branch_delta": ("1", ("branch",), "amplitude of the wave that the field prescribes"),
        "branch_thickness_max": ("1", ("branch",), "largest thickness"),
        "branch_thickness_min": ("1", ("branch",), "least thickness"),
        "branch_mean_flow": ("1", ("branch",), "mean flow"),
        "branch_growth": ("1", ("branch",), "largest growth rate"),
        "branch_number": ("1", ("branch",), "index of the branch"),
        "map_delta": ("1", ("map_delta",), "amplitude of the wave"),
        "map_tension": ("1", ("map_tension",), "surface tension W"),
        "map_outcome": ("1", _MAP, "0 wave, 1 other, 2 moving, 3 breaks, 4 unresolved"),
        "map_distance": ("1", _MAP, "distance from the prescribed wave at the end"),
        "map_growth": ("1", _MAP, "largest growth rate of the prescribed wave"),
        "map_growth_end": ("1", _MAP, "largest growth rate of the steady film at the end"),
        "map_crest": ("1", _MAP, "largest thickness at the end"),
        "map_least": ("1", _MAP, "least thickness over time"),
        "map_time": ("1", _MAP, "time of the end, or of rupture"),
        "map_points": ("1", _MAP, "points"),
    }

    kind: Literal["film-forward"]
    want: tuple[Literal["forward", "basins"], ...] = entry(
        "`forward`: thickness over phase and time, film, field, eigenvalues, branches; "
        "`basins`: the map",
        default=(),
    )
    film: Film = entry("prescribed wave, and surface tension above 0")
    field: FieldTable | None = entry(
        "another field that replaces that of the prescribed wave", default=None
    )
    start: StartTable = entry("the film at time 0", default=StartTable)
    course: CourseTable = entry("duration of the simulation", default=CourseTable)
    grid: GridTable = entry("resolution of the film", default=GridTable)
    tolerance: StepsTable = entry("tolerances of the simulation", default=StepsTable)
    branch: BranchTable | None = entry(
        "continuation of steady films in the amplitude; default: none", default=None
    )
    map: MapTable | None = entry("flat films in many fields; default: none", default=None)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults_in(self.units, needs_wave=self.field is None)
        yield from self._faults_of_tension()
        if self.film.eps is not None and self.units != "SI":
            yield (
                "film.eps",
                "is 0 in this kind, since lubrication theory neglects it; leave it out",
            )
        if self.field is not None:
            yield from self.field.faults(self.units, folder)
        yield from self._faults_of_start()
        if self.grid.most < self.grid.points:
            yield "grid.most", f"is less than grid.points; write at least {self.grid.points}"
        if self.grid.points < 2 * self.grid.order:
            yield (
                "grid.points",
                f"is too small for order {self.grid.order}; write {2 * self.grid.order}",
            )
        yield from self._faults_of_tables()

    def _faults_of_tension(self) -> Iterator[Fault]:
        why = (
            "without surface tension the equation is of first order, and its fronts steepen "
            "until they break"
        )
        if self.units != "SI" and self.film.tension is None:
            yield "film.tension", "missing; write the surface tension W, for example 0.1"
        elif self.film.tension == 0:
            yield "film.tension", f"is not above 0; {why}; write 0.1, for example"
        if self.film.fluid is not None and self.film.fluid.surface_tension == 0:
            yield "film.fluid.surface_tension", f"is not above 0; {why}"

    def _faults_of_start(self) -> Iterator[Fault]:
        start = self.start
        if start.shape == "wave" and not self.film.has_wave:
            yield "start.shape", "needs a prescribed wave; write film.delta"
        if start.shape == "samples" and start.samples is None:
            yield "start.samples", "missing; write the thickness over a wavelength"
        if start.shape != "samples" and start.samples is not None:
            yield (
                "start.samples",
                'applies to shape = "samples" only; write it, or leave samples out',
            )

    def _faults_of_tables(self) -> Iterator[Fault]:
        cosine = self.field is None and self.film.delta is not None
        if self.branch is not None and not cosine:
            yield "branch", "follows cosine waves; write film.delta and no field"
        if self.branch is not None:
            yield from wrong_order("branch.delta", self.branch.delta, may_be_equal=False)
            least, largest = self.branch.delta
            if cosine and not least <= (self.film.delta or 0) <= largest:
                yield "branch.delta", f"does not contain film.delta = {self.film.delta:g}"
            if self.branch.points < 2 * self.grid.order:
                yield (
                    "branch.points",
                    f"is too small for order {self.grid.order}; write {2 * self.grid.order}",
                )
        if self.map is None:
            if "basins" in self.want:
                yield "map", 'missing; want = ["basins"] needs it'
            return
        for name in ("delta", "tension"):
            values = getattr(self.map, name)
            if list(values) != sorted(set(values)):
                yield f"map.{name}", "is not strictly ascending; sort it, without repetitions"
