"""Tables of scenes of kinds "film-flow" and "float": a film of magnetic fluid and its wave."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.numerics import ToleranceTable
from wormopt.study.types import Finite, SceneTable, wrong_order

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
MOST_PERIODS = 20_000
"""Upper limit of the wave periods of a simulated float."""
Points = Annotated[int, Meta(ge=2, le=100_000, description="a whole number, 2 to 100000")]


class FluidTable(Given):
    """Fluid, film and wave, with `units = "SI"` only."""

    mu_r: float = number("1", "relative permeability", above=1)
    viscosity: float = positive("viscosity", "dynamic viscosity")
    density: float = positive("density", "density of the fluid")
    surface_tension: float = number("surface_tension", "surface tension; 0: none", least=0)
    depth: float = positive("length", "mean thickness of the film")
    wavelength: float = positive("length", "wavelength of the wave")
    frequency: float = positive("angular_frequency", "frequency of the wave")


class FilmTable(Given):
    """Film and shape of its wave relative to the mean thickness: `delta`, or harmonics.

    Scenes without units use the scales of eq. 25 of Zimmermann et al. 2007.
    """

    delta: float | None = number("1", "amplitude of a cosine wave", above=0, below=1, default=None)
    cosines: Harmonics | None = entry(
        "cosine amplitudes of the harmonics of another wave, from the first on; the thickness "
        "must stay positive",
        quantity="1",
        default=None,
    )
    sines: Harmonics | None = entry("sine amplitudes of the harmonics", quantity="1", default=None)
    tension: float | None = number(
        "1",
        "dimensionless surface tension *W* (eq. 25), default 0; in SI scenes it follows from "
        "the fluid",
        least=0,
        default=None,
    )
    eps: float | None = number(
        "1",
        "*ε* (eq. 25), thickness times wave number: gives the error of lubrication theory; in "
        "SI scenes it follows from the fluid",
        least=0,
        default=None,
    )
    fluid: FluidTable | None = entry("fluid of the film, in SI scenes", default=None)

    def faults(self, units: str) -> Iterator[Fault]:
        """Yield key path and message of what is wrong between the keys of this table."""
        harmonics = [name for name in ("cosines", "sines") if getattr(self, name) is not None]
        if self.delta is None and not harmonics:
            yield "film.delta", "missing; write delta, or harmonics in cosines and sines"
        if self.delta is not None and harmonics:
            yield (
                "film.delta",
                f"defines a cosine wave, so {' and '.join(harmonics)} cannot be added; write one "
                "of the two",
            )
        if harmonics and not any(any(getattr(self, name)) for name in harmonics):
            yield (
                f"film.{harmonics[0]}",
                "contains only zeros, so there is no wave; write an amplitude that is not 0",
            )
        if units == "SI" and self.fluid is None:
            yield "film.fluid", 'missing; with units = "SI" describe the fluid: [film.fluid]'
        if units == "SI" and self.tension is not None:
            yield (
                "film.tension",
                "applies to scenes without units only; write surface_tension in [film.fluid]",
            )
        if units == "SI" and self.eps is not None:
            yield (
                "film.eps",
                "applies to scenes without units only; it follows from depth and wavelength here",
            )
        if units != "SI" and self.fluid is not None:
            yield "film.fluid", 'is in SI units; write units = "SI"'


class CurvesTable(Given):
    """Amplitudes of cosine waves for comparison."""

    delta: Shares = entry(
        "amplitudes of the fields in the picture",
        quantity="1",
        default=(
            0.1,
            0.3,
            0.5,
            0.7,
            0.9,
        ),
    )
    range: SharePair = entry(
        "range of amplitudes of the mean-flow curve",
        quantity="1",
        default=(
            0.005,
            0.995,
        ),
    )
    points: int = whole(2, 100000, "number of amplitudes on that curve", default=199)


class FilmFlowScene(SceneTable):
    """Flow in a film, and the field that holds its shape.

    It computes the least field that makes a travelling wave and the flow that the wave pumps, and
    compares with cosine waves of other amplitudes. Theory:
    [theory-film.md](../theory-film.md#1-the-film). The trust report checks the equations by routes
    that are independent of the solution. Its `validity` (SI) contains *ε*, *ε Re*, *μ*<sub>r</sub>
    − 1 and the weight of the film over *P*; values above 0.1 give a warning.
    """

    scalars: ClassVar = {
        "c_constant": ("1", "*C*"),
        "mean_flow": ("1", "mean flow 1 + *C*"),
        "mean_flow_corrected": ("1", "mean flow with the correction of the next order, *ε*²"),
        "mean_flow_bar": (
            "1",
            "error estimate of that flow for lubrication theory without inertia; unknown where "
            "*ε* times the highest harmonic is above 3",
        ),
        "mean_flow_per_eps2": ("1", "correction of the mean flow by the next order, over *ε*²"),
        "d_max": (
            "1",
            "largest (*μ* − 1)*D*/(8π); (*μ* − 1)*H*<sub>0</sub>²/(8π) is at least as large",
        ),
        "xi_at_d_max": ("rad", "phase of the largest *D*"),
        "delta": (
            "1",
            "amplitude; for other waves half the difference of largest and least thickness",
        ),
        "tension_number": ("1", "*W*"),
        "surface_speed_max": (
            "1",
            "largest surface speed over the wave speed; from 1 on the wave holds floats",
        ),
        "mean_flow_square_wave": (
            "1",
            "upper bound of the mean flow of all waves of this amplitude (cosine wave)",
        ),
        "field_h0": ("magnetic_field", "least *H*<sub>0</sub> (SI)"),
        "field_h0_gaussian": ("Oe", "least *H*<sub>0</sub> in Gaussian units (SI)"),
        "field_max": ("magnetic_field", "largest field at the least *H*<sub>0</sub> (SI)"),
        "wave_speed": ("speed", "speed of the wave (SI)"),
        "flow_rate": ("flow_per_width", "mean flow per width (SI)"),
        "pressure_scale": ("stress", "pressure scale *P* (SI)"),
        "eps": ("1", "*ε* (SI, or as in the scene)"),
        "reynolds": ("1", "*Re* (SI)"),
    }
    variables: ClassVar = {
        "xi": ("rad", ("xi",), "phase t - x of the wave"),
        "height": ("1", ("xi",), "thickness over its mean"),
        "surface_velocity": ("1", ("xi",), "surface velocity over the speed of the wave"),
        "film_pressure": ("1", ("xi",), "film pressure minus its mean, over P"),
        "field_squared": ("1", ("xi",), "(mu - 1) H^2 / (8 pi) over P of the least field"),
        "field": ("magnetic_field", ("xi",), "least field H"),
        "curve_delta": ("1", ("curve_delta",), "amplitude over mean thickness"),
        "curve_mean_flow": ("1", ("curve_delta",), "mean flow of a cosine wave"),
        "curve_square_wave": (
            "1",
            ("curve_delta",),
            "least upper bound of the mean flow of all waves at W = 0",
        ),
        "curve_d_max": ("1", ("curve_delta",), "(mu - 1) D_max / (8 pi)"),
        "curve_field_h0": ("magnetic_field", ("curve_delta",), "least H0"),
        "field_delta": ("1", ("field_delta",), "amplitude of a field"),
        "field_curves": (
            "1",
            ("field_delta", "xi"),
            "(mu - 1) H^2 / (8 pi) over P of the least field",
        ),
    }

    kind: Literal["film-flow"]
    want: tuple[Literal["film"], ...] = entry(
        "`film`: mean flow over amplitude (as figure 15 of Zimmermann et al. 2007), shape, "
        "surface velocity, fields",
        default=(),
    )
    film: FilmTable = entry("film and wave")
    curves: CurvesTable = entry("cosine waves for comparison", default=CurvesTable)
    samples: int = whole(2, 100000, "number of phases in the result", default=401)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults(self.units)
        yield from wrong_order("curves.range", self.curves.range, may_be_equal=False)


class FloatsTable(Given):
    """Bodies on the surface."""

    length: Lengths = entry(
        "lengths in wavelengths; 0: a small float", quantity="1", default=(0.0,)
    )
    position: float = number(
        "1", "initial position of the middle, in wavelengths ahead of a crest", default=0.0
    )


class TracersTable(Given):
    """Tracers in the fluid; default: none."""

    height: Levels = entry(
        "initial height as a share of the thickness; 1: on the surface", quantity="1"
    )
    position: float = number("1", "initial position, as for floats", default=0.0)


class RideTable(Given):
    """Duration of the simulation."""

    periods: (
        Annotated[float, Meta(gt=0, le=MOST_PERIODS, description="a number above 0, up to 20000")]
        | None
    ) = entry(
        "number of wave periods; default: enough to overtake every body three times",
        quantity="1",
        default=None,
    )
    samples: int = whole(2, 100000, "number of times in the result", default=1001)


class FloatScene(SceneTable):
    """Drift of floats and tracers in a travelling wave.

    Floats of several lengths and tracers in the fluid are simulated, and compared with formulas.
    Theory: [theory-film.md](../theory-film.md#2-floats-and-tracers). With several floats or
    tracers, scalars are lists. Speeds are relative to the wave speed, in SI scenes in m/s.

    Not allowed: a tracer on the surface of a wave that holds floats, where it cannot be followed; a
    wave that nearly holds a body.

    The result fails if a drift differs from its formula by more than 1e-7 or a thousand tolerances.
    It also fails if a held float is away from its phase of rest by more than 1e-6, a thousand
    absolute tolerances, or the relative tolerance times the time, or if a tracer leaves its
    streamline or the film.
    """

    scalars: ClassVar = {
        "float_drift": (
            "speed",
            "simulated mean velocity between the first and the last trough that passed; for held "
            "floats over the second half of the time; unknown if fewer than two troughs passed",
        ),
        "float_drift_closed": (
            "speed",
            "mean velocity in closed form (small floats on a cosine wave) or by quadrature; 1 for "
            "held floats",
        ),
        "float_drift_error": ("1", "difference of the two"),
        "float_drift_corrected": ("speed", "drift by quadrature with the next order, *ε*²"),
        "float_drift_bar": (
            "speed",
            "error estimate of that drift for lubrication theory without inertia; unknown where "
            "*ε* times the highest harmonic is above 3",
        ),
        "float_turn": (
            "time",
            "time in which the wave overtakes the float by a wavelength; unknown for held floats",
        ),
        "trapped": ("1", "whether the wave holds the float"),
        "tracer_drift": ("speed", "simulated mean velocity of the tracers, as for floats"),
        "tracer_drift_closed": ("speed", "mean velocity of the tracers by quadrature"),
        "tracer_drift_error": ("1", "difference of the two"),
        "tracer_turn": ("time", "overtaking time of the tracers, as for floats"),
        "tracer_trapped": ("1", "whether the wave holds the tracer"),
        "phase_trapped": (
            "rad",
            "phase *t* − *x* at which the wave holds the float; with several such phases the one "
            "closest to its end",
        ),
        "phase_trapped_error": (
            "rad",
            "simulated final phase minus that phase; unknown for floats that still move on the "
            "wave",
        ),
        "delta_capture": (
            "1",
            "least amplitude at which a cosine wave holds floats of this length",
        ),
        "body_speed_max": (
            "speed",
            "largest velocity of the float; the float is held from the wave speed on",
        ),
        "mean_flow": ("1", "mean flow of the film"),
        "delta": ("1", "amplitude of a cosine wave"),
        "float_length": ("1", "length of the float, as in the scene"),
        "wave_speed": ("speed", "speed of the wave (SI)"),
        "wavelength": ("length", "wavelength of the wave (SI)"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "float_position": ("length", ("body", "time"), "middles of the floats"),
        "tracer_position": ("length", ("tracer", "time"), "position of the tracers"),
        "tracer_height": ("length", ("tracer", "time"), "height of the tracers"),
        "xi": ("rad", ("xi",), "phase t - x of the wave"),
        "height": ("length", ("xi",), "thickness of the film"),
        "field_squared": ("1", ("xi",), "(mu - 1) H^2 / (8 pi) over P of the least field"),
        "body_velocity": ("speed", ("body", "xi"), "velocity of the floats over the phase"),
    }

    kind: Literal["float"]
    want: tuple[Literal["floats", "ride"], ...] = entry(
        "`floats`: the floats on the wave, and the field (as figure 27 of Zimmermann et al. "
        "2007); `ride`: paths over the wave",
        default=(),
    )
    film: FilmTable = entry("film and wave, without `tension`")
    floats: FloatsTable = entry("bodies on the surface", default=FloatsTable)
    tracers: TracersTable | None = entry("tracers in the fluid", default=None)
    course: RideTable = entry("duration of the simulation", default=RideTable)
    tolerance: ToleranceTable = entry("tolerances of the simulation", default=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults(self.units)
        if self.film.tension:
            yield "film.tension", "has no effect on floats; leave it out"
