"""Scenes of kind "film-wave": the wave of a film of magnetic fluid that does something best."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    Pair,
    Positive,
    SceneTable,
    Table,
    says,
    wrong_order,
)
from wormopt.systems.shared.declared import OPTIMUM

Crests = Annotated[int, Meta(ge=1, le=12, description="a whole number from 1 to 12")]
Values = Annotated[
    tuple[Positive, ...], Meta(min_length=1, max_length=32, description="1 to 32 numbers above 0")
]
# Each decade below takes four times as long, for a wave that carries the same to a share of 1e-3.
Tension = Annotated[
    float, Meta(ge=1e-6, le=1e300, description="1e-6 or more: below, fronts are all but corners")
]
Tensions = Annotated[
    tuple[Tension, ...],
    Meta(min_length=1, max_length=32, description="1 to 32 numbers from 1e-6"),
]
Flow = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]


class WavyFilmTable(Table, frozen=True, kw_only=True):
    """The film."""

    tension: Annotated[
        Tension,
        says("1", "number *W* of surface tension; without any the field could make corners"),
    ]


class WaveLimitsTable(Table, frozen=True, kw_only=True):
    """What the wave must keep to."""

    thickness: Annotated[
        Pair, says("1", "bounds of the thickness over its mean, 1, which lies between them")
    ]
    field: Annotated[
        Positive | None,
        says("1", "largest range of the field; required, but refused with `minimise`"),
    ] = None
    gradient: Annotated[
        Positive | None,
        says("1", "largest slope of the field by the phase; without it the field may jump"),
    ] = None


class WaveAimTable(Table, frozen=True, kw_only=True):
    """What the wave is to be good at: exactly one of `maximise` and `minimise`.

    `minimise` needs `mean_flow`, `capture`, or both. With `float_speed` the wave of the largest
    flow is taken if it holds the float (speed 1); if not, a wave that holds it is sought; if there
    is none, that of the largest drift.
    """

    maximise: Annotated[
        Literal["mean_flow", "float_speed"] | None,
        says("", "mean flow; or mean velocity of a small float"),
    ] = None
    minimise: Annotated[Literal["field"] | None, says("", "range of the field")] = None
    mean_flow: Annotated[Flow | None, says("1", "least mean flow, with `minimise`")] = None
    capture: Annotated[
        bool, says("", "whether the wave shall hold a small float, with `minimise`")
    ] = False

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
    """Where searches begin."""

    crests: Annotated[
        Crests,
        says(
            "count",
            "searches begin with waves of 1, 2, … up to so many crests alike; where a float is to "
            "be held also with one crest higher than the others",
        ),
    ] = 3


class WaveMapTable(Table, frozen=True, kw_only=True):
    """Other films and fields, with `maximise = "mean_flow"`: every tension with every field."""

    tension: Annotated[Tensions | None, says("1", "numbers *W*; that of the film if left out")] = (
        None
    )
    field: Annotated[
        Values | None, says("1", "ranges of the field; that of the limits if left out")
    ] = None


class FilmWaveScene(SceneTable, frozen=True, kw_only=True):
    """The best wave of a film, beside the cosine wave within the same limits.

    The wave carries most, moves a small float fastest, or needs the least field. Theory, and what
    is found: [theory-film.md](../theory-film.md#4-wave-design). Without units, scaled by (25):
    fields are (*μ* − 1)*H*²/(8π) over *P*, and only their range counts, from least to largest over
    a wavelength; `Fluid.field` turns them into A/m.

    Refused is what no field can do: a mean flow from `mean_flow_supremum` on, and capture where
    even that flow would not do.

    Where the field jumps, variables over `xi` hold what is just before and just after; a crest is
    at 0. Those of the sweep are not a number where no wave was found that stands its checks.

    The trust report has `starts` (what each led to), and `checks` beside `accepted`: *C*, mean and
    bounds of the thickness, range of the field and the field itself (mean difference over its
    range) by quadrature of (30) and second differences, its slope where limited, and what the aim
    asks. Where one does not hold the status is `failed`.
    """

    scalars: ClassVar = {
        "mean_flow": ("1", "1 + *C*, by quadrature over the thickness found"),
        "c_constant": ("1", "*C*, by the same"),
        "mean_flow_cosine": (
            "1",
            "of the largest cosine wave within the limits; with `minimise` of the smallest that "
            "does what is asked, unknown where the thickness or the gradient does not allow it",
        ),
        "cosine_delta": ("1", "amplitude of that wave"),
        "mean_flow_supremum": ("1", "no wave between the thicknesses carries more, at any field"),
        "gap_to_supremum": ("1", "distance to it"),
        "gain": (
            "1",
            "over the cosine wave: ratio of the flows, of the drifts, or how many times less field",
        ),
        "crests": ("count", "how often the wave rises through its mean in a wavelength"),
        "field_range": ("1", "range of the field"),
        "field_range_cosine": ("1", "that of the cosine wave"),
        "captured": ("1", "whether the wave holds a small float"),
        "float_drift": (
            "1",
            "mean velocity of a small float over that of the wave; 1 if it is held",
        ),
        "float_drift_cosine": ("1", "the same on the cosine wave"),
        "capture_margin": ("1", "largest thickness + 3*C*; from −1e-6 on a float is held"),
        "thickness_min": ("1", "least thickness of the wave"),
        "thickness_max": ("1", "largest thickness of the wave"),
        "plateau_share": ("1", "share of the wave that lies at a bound of the thickness"),
        "tension_number": ("1", "as in the scene"),
        "thickness_limits": ("1", "as in the scene"),
        "field_limit": ("1", "as in the scene"),
        "n_phases": ("count", "phases between switches of the field, in a wavelength"),
        "defect_max": OPTIMUM["defect_max"],
        "recheck_error": (
            "1",
            "difference of *C* between optimiser and quadrature; 1e-6 is accepted",
        ),
        "solve_iterations": OPTIMUM["solve_iterations"],
    }
    variables: ClassVar = {
        "xi": ("rad", ("xi",), "phase t - x"),
        "height": ("1", ("xi",), "thickness over its mean"),
        "height_slope": ("1", ("xi",), "slope of the thickness by the phase"),
        "field_pressure": ("1", ("xi",), "field (mu - 1) H^2 / (8 pi), least"),
        "surface_velocity": ("1", ("xi",), "velocity of the surface over that of the wave"),
        "xi_cosine": ("rad", ("xi_cosine",), "phase t - x"),
        "height_cosine": ("1", ("xi_cosine",), "thickness of the cosine wave"),
        "field_pressure_cosine": ("1", ("xi_cosine",), "its least field (mu - 1) H^2 / (8 pi)"),
        "surface_velocity_cosine": ("1", ("xi_cosine",), "velocity of its surface"),
        "sweep_tension": ("1", ("sweep_tension",), "number W of surface tension"),
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
    units: Annotated[Literal["dimensionless"], says("", "numbers are scaled by (25)")] = (
        "dimensionless"
    )
    want: Annotated[
        tuple[Literal["film_wave"], ...],
        says("", "`film_wave`: shape, field and speed of the surface, and other films if swept"),
    ] = ()
    film: Annotated[WavyFilmTable, says("", "the film")]
    limits: Annotated[WaveLimitsTable, says("", "what the wave must keep to")]
    aim: Annotated[WaveAimTable, says("", "what it is to be good at")]
    mesh: Annotated[
        MeshTable, says("", "how finely; 60 arcs if left out, and a degree of at least 3")
    ] = field(default_factory=lambda: MeshTable(arcs=60))
    search: Annotated[WaveSearchTable, says("", "where to begin")] = field(
        default_factory=WaveSearchTable
    )
    map: Annotated[WaveMapTable | None, says("", "other films and fields")] = None

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
            yield "limits.field", 'is what minimise = "field" finds; leave it out'
        if self.mesh.degree < 3:
            yield "mesh.degree", "the field is at least linear on every arc; write 3 or more"
        if self.map is not None:
            yield from self._faults_of_map(self.map)

    def _faults_of_map(self, table: WaveMapTable) -> Iterator[Fault]:
        if self.aim.maximise != "mean_flow":
            yield "map", 'is for maximise = "mean_flow"; leave it out'
        if table.tension is None and table.field is None:
            yield "map", "is empty; write tension = [0.1, 0.03], say, or field = [...]"
        for name in ("tension", "field"):
            values = getattr(table, name) or ()
            if len(set(values)) < len(values):
                yield f"map.{name}", "the same number stands there twice; write it once"
