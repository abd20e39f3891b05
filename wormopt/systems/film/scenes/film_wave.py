"""Tables of scenes of kind "film-wave": the optimal wave of a film of magnetic fluid."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Pair, Positive, SceneTable, wrong_order
from wormopt.systems.shared.declared import OPTIMUM

Values = Annotated[
    tuple[Positive, ...], Meta(min_length=1, max_length=32, description="1 to 32 numbers above 0")
]
# Each decade below takes four times as long, and changes the flow by a share of 1e-3.
Tension = Annotated[
    float, Meta(ge=1e-6, le=1e300, description="1e-6 or more: below, fronts are all but corners")
]
Tensions = Annotated[
    tuple[Tension, ...],
    Meta(min_length=1, max_length=32, description="1 to 32 numbers from 1e-6"),
]
Flow = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]


class WavyFilmTable(Given):
    """The film."""

    tension: float = number(
        "1", "surface tension *W*; without it the field could make corners", least=1e-06
    )


class WaveLimitsTable(Given):
    """Limits of the wave."""

    thickness: Pair = entry(
        "bounds of the thickness over its mean 1, which lies between them", quantity="1"
    )
    field: float | None = positive(
        "1",
        "upper limit of the range of the field; required, but not allowed with `minimise`",
        default=None,
    )
    gradient: float | None = positive(
        "1",
        "upper limit of the slope of the field over the phase; default: the field may jump",
        default=None,
    )


class WaveAimTable(Given):
    """Objective of the wave: exactly one of `maximise` and `minimise`.

    `minimise` requires `mean_flow`, `capture`, or both. With `float_speed`, the wave with the
    largest flow is the result if it holds the float (speed 1). Otherwise a wave that holds the
    float is searched for; if none exists, the result is the wave with the largest drift.
    """

    maximise: Literal["mean_flow", "float_speed"] | None = entry(
        "mean flow, or mean velocity of a small float", default=None
    )
    minimise: Literal["field"] | None = entry("range of the field", default=None)
    mean_flow: float | None = number(
        "1", "lower limit of the mean flow, with `minimise`", above=0, below=1, default=None
    )
    capture: bool = entry(
        "whether the wave must hold a small float, with `minimise`", default=False
    )

    def faults(self) -> Iterator[Fault]:
        """Yield conflicts between the keys."""
        if (self.maximise is None) == (self.minimise is None):
            yield (
                "aim",
                'needs exactly one of maximise = "mean_flow", maximise = "float_speed" and '
                'minimise = "field"',
            )
        elif self.minimise and self.mean_flow is None and not self.capture:
            yield (
                "aim",
                "is missing a requirement, since the least field makes no wave; write mean_flow = "
                "0.3, for example, or capture",
            )
        elif self.maximise and self.mean_flow is not None:
            yield "aim.mean_flow", 'applies to minimise = "field" only; leave it out'
        elif self.maximise and self.capture:
            yield "aim.capture", 'applies to minimise = "field" only; leave it out'


class WaveSearchTable(Given):
    """Starting points of the search."""

    crests: int = whole(
        1,
        12,
        "largest number of crests at the start: waves with 1, 2, … equal crests; if a float "
        "must be held, also with one crest higher than the others",
        default=3,
    )


class WaveMapTable(Given):
    """Combinations of other films and fields, with `maximise = "mean_flow"`."""

    tension: Tensions | None = entry(
        "values of *W*; default: that of the film", quantity="1", default=None
    )
    field: Values | None = entry(
        "ranges of the field; default: that of the limits", quantity="1", default=None
    )


class FilmWaveScene(SceneTable):
    """The best wave of a film, compared with the cosine wave within the same limits.

    The wave has the largest mean flow, moves a small float fastest, or needs the least field.
    Theory and results: [theory-film.md](../theory-film.md#4-wave-design). The scene is
    dimensionless, in the scales of eq. 25 of Zimmermann et al. 2007. Fields are (*μ* − 1)*H*²/(8π)
    over *P*, and only their range over a wavelength matters; `Fluid.field` converts them to A/m.

    Not allowed are requirements that no field can meet: a mean flow of `mean_flow_supremum` or
    more, and capture where even that flow does not suffice.

    Where the field jumps, variables over `xi` hold the values just before and just after. A crest
    is at 0. Variables of the sweep are NaN where no wave passes its checks.

    The trust report has `starts` (the result of each), and `checks` beside `accepted`. By
    quadrature of eq. 30 and second differences, these check *C*, mean and bounds of the thickness,
    range of the field, the field itself (mean difference over its range), its slope where limited,
    and the requirements. If one is violated, the status is `failed`.
    """

    scalars: ClassVar = {
        "mean_flow": ("1", "1 + *C*, by quadrature over the thickness found"),
        "c_constant": ("1", "*C*, by the same quadrature"),
        "mean_flow_cosine": (
            "1",
            "mean flow of the largest cosine wave within the limits; with `minimise` of the "
            "smallest that meets the requirements, unknown where thickness or gradient do not "
            "allow it",
        ),
        "cosine_delta": ("1", "amplitude of that wave"),
        "mean_flow_supremum": (
            "1",
            "least upper bound of the mean flow of all waves between the thicknesses, at any field",
        ),
        "gap_to_supremum": ("1", "difference between that bound and the mean flow"),
        "gain": (
            "1",
            "gain over the cosine wave: ratio of the flows, or of the drifts, or of the fields "
            "(how many times less)",
        ),
        "crests": ("count", "number of upward crossings of the mean thickness in a wavelength"),
        "field_range": ("1", "range of the field"),
        "field_range_cosine": ("1", "range of the field of the cosine wave"),
        "captured": ("1", "whether the wave holds a small float"),
        "float_drift": (
            "1",
            "mean velocity of a small float over the wave speed; 1 if it is held",
        ),
        "float_drift_cosine": ("1", "mean velocity of a small float on the cosine wave"),
        "capture_margin": ("1", "largest thickness + 3*C*; a float is held from −1e-6 on"),
        "thickness_min": ("1", "least thickness of the wave"),
        "thickness_max": ("1", "largest thickness of the wave"),
        "plateau_share": ("1", "share of the wave at a bound of the thickness"),
        "tension_number": ("1", "surface tension *W*, as in the scene"),
        "thickness_limits": ("1", "bounds of the thickness, as in the scene"),
        "field_limit": ("1", "upper limit of the field's range, as in the scene"),
        "n_phases": ("count", "number of phases between switches of the field, in a wavelength"),
        "defect_max": OPTIMUM["defect_max"],
        "recheck_error": (
            "1",
            "difference of *C* between optimiser and quadrature; up to 1e-6 is accepted",
        ),
        "solve_iterations": OPTIMUM["solve_iterations"],
    }
    variables: ClassVar = {
        "xi": ("rad", ("xi",), "phase t - x"),
        "height": ("1", ("xi",), "thickness over its mean"),
        "height_slope": ("1", ("xi",), "slope of the thickness over the phase"),
        "field_pressure": ("1", ("xi",), "least field as (mu - 1) H^2 / (8 pi)"),
        "surface_velocity": ("1", ("xi",), "velocity of the surface over that of the wave"),
        "xi_cosine": ("rad", ("xi_cosine",), "phase t - x"),
        "height_cosine": ("1", ("xi_cosine",), "thickness of the cosine wave"),
        "field_pressure_cosine": (
            "1",
            ("xi_cosine",),
            "least field of the cosine wave as (mu - 1) H^2 / (8 pi)",
        ),
        "surface_velocity_cosine": ("1", ("xi_cosine",), "surface velocity of the cosine wave"),
        "sweep_tension": ("1", ("sweep_tension",), "surface tension W"),
        "sweep_field": ("1", ("sweep_field",), "largest range of the field"),
        "sweep_mean_flow": ("1", ("sweep_tension", "sweep_field"), "largest mean flow"),
        "sweep_mean_flow_cosine": (
            "1",
            ("sweep_tension", "sweep_field"),
            "mean flow of the cosine wave",
        ),
        "sweep_crests": ("1", ("sweep_tension", "sweep_field"), "crests of the best wave"),
    }

    kind: Literal["film-wave"]
    units: Literal["dimensionless"] = entry(
        "dimensionless, in the scales of eq. 25 of Zimmermann et al. 2007", default="dimensionless"
    )
    want: tuple[Literal["film_wave"], ...] = entry(
        "`film_wave`: shape, field and surface velocity, and other films if swept", default=()
    )
    film: WavyFilmTable = entry("the film")
    limits: WaveLimitsTable = entry("limits of the wave")
    aim: WaveAimTable = entry("objective of the wave")
    mesh: Annotated[
        MeshTable, says("", "mesh over the phase; default: 60 arcs; the degree is at least 3")
    ] = field(default_factory=lambda: MeshTable(arcs=60))
    search: WaveSearchTable = entry("starting points of the search", default=WaveSearchTable)
    map: WaveMapTable | None = entry("other films and fields", default=None)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
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
            yield "limits.field", 'is the result of minimise = "field"; leave it out'
        if self.mesh.degree < 3:
            yield (
                "mesh.degree",
                "is below 3, but the field is at least linear on every arc; write 3 or more",
            )
        if self.map is not None:
            yield from self._faults_of_map(self.map)

    def _faults_of_map(self, table: WaveMapTable) -> Iterator[Fault]:
        if self.aim.maximise != "mean_flow":
            yield "map", 'needs maximise = "mean_flow"; leave [map] out'
        if table.tension is None and table.field is None:
            yield "map", "is empty; write tension = [0.1, 0.03], for example, or field = [...]"
        for name in ("tension", "field"):
            values = getattr(table, name) or ()
            if len(set(values)) < len(values):
                yield f"map.{name}", "repeats a number; write each once"
