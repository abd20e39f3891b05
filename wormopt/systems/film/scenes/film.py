"""Scenes of kinds "film-flow" and "float": a film of magnetic fluid, and what its wave carries."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import ToleranceTable
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Positive,
    SceneTable,
    Table,
    says,
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
MOST_PERIODS = 20_000
"""Periods of the wave that a float rides at most."""
Points = Annotated[int, Meta(ge=2, le=100_000, description="a whole number, 2 to 100000")]


class FluidTable(Table, frozen=True, kw_only=True):
    """Fluid, film and wave, with `units = "SI"` only."""

    mu_r: Annotated[Permeability, says("1", "relative permeability")]
    viscosity: Annotated[Positive, says("viscosity", "dynamic viscosity")]
    density: Annotated[Positive, says("density", "of the fluid")]
    surface_tension: Annotated[NonNegative, says("surface_tension", "0 leaves it out")]
    depth: Annotated[Positive, says("length", "mean thickness of the film")]
    wavelength: Annotated[Positive, says("length", "of the wave")]
    frequency: Annotated[Positive, says("angular_frequency", "of the wave")]


class FilmTable(Table, frozen=True, kw_only=True):
    """A film and the shape of its wave, over the mean thickness: `delta`, or harmonics.

    Scenes without units count in the scales of (25).
    """

    delta: Annotated[Share | None, says("1", "amplitude of a cosine wave")] = None
    cosines: Annotated[
        Harmonics | None,
        says("1", "harmonics of any other wave, the first one first; the film must not tear"),
    ] = None
    sines: Annotated[Harmonics | None, says("1", "the same, of its sines")] = None
    tension: Annotated[
        NonNegative | None,
        says("1", "*W* of (25), 0 if left out; in SI scenes it follows from the fluid"),
    ] = None
    eps: Annotated[
        NonNegative | None,
        says(
            "1",
            "*ε* of (25), thickness times wave number: tells how far lubrication is off; in SI "
            "scenes it follows from the fluid",
        ),
    ] = None
    fluid: Annotated[FluidTable | None, says("", "what the film is made of, in SI scenes")] = None

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
        if units == "SI" and self.eps is not None:
            yield "film.eps", "belongs to scenes without units; depth and wavelength give it here"
        if units != "SI" and self.fluid is not None:
            yield "film.fluid", 'is in SI units; write units = "SI"'


class CurvesTable(Table, frozen=True, kw_only=True):
    """Cosine waves of other amplitudes to compare with."""

    delta: Annotated[Shares, says("1", "amplitudes whose fields are drawn")] = (
        0.1,
        0.3,
        0.5,
        0.7,
        0.9,
    )
    range: Annotated[SharePair, says("1", "amplitudes of the curve of mean flow")] = (0.005, 0.995)
    points: Annotated[Points, says("count", "amplitudes on that curve")] = 199


class FilmFlowScene(SceneTable, frozen=True, kw_only=True):
    """Flow in a film, and the field that holds its shape.

    The least field that makes a travelling wave, and what the wave pumps, beside cosine waves of
    other amplitudes. Theory: [theory-film.md](../theory-film.md#1-the-film). The trust report
    checks laws by another way than the solution was found; its `validity` (SI) holds *ε*, *ε Re*,
    *μ*<sub>r</sub> − 1 and the weight of the film over *P*, warned of above 0.1.
    """

    scalars: ClassVar = {
        "c_constant": ("1", "*C*"),
        "mean_flow": ("1", "mean flow 1 + *C*"),
        "mean_flow_corrected": ("1", "the same with what the next order, *ε*², adds"),
        "mean_flow_bar": (
            "1",
            "by how much the flow without lubrication and inertia may differ from that; unknown "
            "where *ε* times the highest harmonic is above 3",
        ),
        "mean_flow_per_eps2": ("1", "what the next order adds, over *ε*²"),
        "d_max": ("1", "largest (*μ* − 1)*D*/(8π); (*μ* − 1)*H*<sub>0</sub>²/(8π) is no less"),
        "xi_at_d_max": ("rad", "where that is"),
        "delta": ("1", "amplitude; of other waves half of largest less least thickness"),
        "tension_number": ("1", "*W*"),
        "surface_speed_max": (
            "1",
            "largest on the surface, over the wave's; holds floats from 1 on",
        ),
        "mean_flow_square_wave": ("1", "what no wave of this amplitude exceeds (cosine wave)"),
        "field_h0": ("magnetic_field", "least *H*<sub>0</sub> (SI)"),
        "field_h0_gaussian": ("Oe", "the same in Gaussian units (SI)"),
        "field_max": ("magnetic_field", "largest field then (SI)"),
        "wave_speed": ("speed", "speed of the wave (SI)"),
        "flow_rate": ("flow_per_width", "mean flow per width (SI)"),
        "pressure_scale": ("stress", "*P* (SI)"),
        "eps": ("1", "*ε* (SI, or as in the scene)"),
        "reynolds": ("1", "*Re* (SI)"),
    }
    variables: ClassVar = {
        "xi": ("rad", ("xi",), "phase t - x of the wave"),
        "height": ("1", ("xi",), "thickness over its mean"),
        "surface_velocity": ("1", ("xi",), "over the speed of the wave"),
        "film_pressure": ("1", ("xi",), "pressure in the film less its mean, over P"),
        "field_squared": ("1", ("xi",), "(mu - 1) H^2 / (8 pi) over P, least field"),
        "field": ("magnetic_field", ("xi",), "least field H"),
        "curve_delta": ("1", ("curve_delta",), "amplitude over mean thickness"),
        "curve_mean_flow": ("1", ("curve_delta",), "mean flow of a cosine wave"),
        "curve_square_wave": ("1", ("curve_delta",), "least upper bound of all waves at W = 0"),
        "curve_d_max": ("1", ("curve_delta",), "(mu - 1) D_max / (8 pi)"),
        "curve_field_h0": ("magnetic_field", ("curve_delta",), "least H0"),
        "field_delta": ("1", ("field_delta",), "amplitude of a field"),
        "field_curves": ("1", ("field_delta", "xi"), "(mu - 1) H^2 / (8 pi) over P, least field"),
    }

    kind: Literal["film-flow"]
    want: Annotated[
        tuple[Literal["film"], ...],
        says("", "`film`: mean flow over amplitude (figure 15), shape, surface velocity, fields"),
    ] = ()
    film: Annotated[FilmTable, says("", "film and wave")]
    curves: Annotated[CurvesTable, says("", "other amplitudes")] = field(
        default_factory=CurvesTable
    )
    samples: Annotated[Points, says("count", "phases that are kept")] = 401

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults(self.units)
        yield from wrong_order("curves.range", self.curves.range, may_be_equal=False)


class FloatsTable(Table, frozen=True, kw_only=True):
    """Bodies on the surface."""

    length: Annotated[Lengths, says("1", "their lengths in wavelengths; 0 is a small float")] = (
        0.0,
    )
    position: Annotated[
        Finite, says("1", "place of their middles at time 0, in wavelengths ahead of a crest")
    ] = 0.0


class TracersTable(Table, frozen=True, kw_only=True):
    """Points of the fluid; without this table there are none."""

    height: Annotated[
        Levels, says("1", "at time 0, as shares of the thickness there; 1 is on the surface")
    ]
    position: Annotated[Finite, says("1", "as for floats")] = 0.0


class RideTable(Table, frozen=True, kw_only=True):
    """How long is simulated."""

    periods: Annotated[
        Annotated[float, Meta(gt=0, le=MOST_PERIODS, description="a number above 0, up to 20000")]
        | None,
        says("1", "of the wave; if left out as many as it takes to overtake every body thrice"),
    ] = None
    samples: Annotated[Points, says("count", "times that are kept")] = 1001


class FloatScene(SceneTable, frozen=True, kw_only=True):
    """What a travelling wave carries.

    Floats of several lengths, and points of the fluid, simulated and by formulas. Theory:
    [theory-film.md](../theory-film.md#2-floats-and-tracers). With several floats or tracers
    scalars are lists. Speeds are over the wave's, in SI scenes in m/s.

    Refused: a tracer on the surface of a wave that holds floats, since it cannot be followed
    there, and a body that the wave all but holds.

    A drift that is off its formula by more than 1e-7 or a thousand tolerances fails the result,
    and so does a float held off its phase of rest by more than 1e-6, a thousand absolute
    tolerances or the relative tolerance times the time, and a tracer that leaves its line or the
    film.
    """

    scalars: ClassVar = {
        "float_drift": (
            "speed",
            "mean velocity by simulation, between the first and the last trough that passed; of "
            "what is held, over the second half of the time; unknown where fewer than two troughs "
            "passed",
        ),
        "float_drift_closed": (
            "speed",
            "the same in closed form (small floats on a cosine wave) or by quadrature; 1 of what "
            "is held",
        ),
        "float_drift_error": ("1", "their difference"),
        "float_drift_corrected": ("speed", "by quadrature, with the next order, *ε*²"),
        "float_drift_bar": (
            "speed",
            "by how much the drift on a film without lubrication and inertia may differ from that; "
            "unknown where *ε* times the highest harmonic is above 3",
        ),
        "float_turn": (
            "time",
            "in which the wave overtakes it by a wavelength; unknown of what is held",
        ),
        "trapped": ("1", "whether the wave holds the float"),
        "tracer_drift": ("speed", "of tracers, as of floats"),
        "tracer_drift_closed": ("speed", "of tracers, by quadrature"),
        "tracer_drift_error": ("1", "their difference"),
        "tracer_turn": ("time", "of tracers, as of floats"),
        "tracer_trapped": ("1", "whether the wave holds the tracer"),
        "phase_trapped": (
            "rad",
            "phase *t* − *x* at which it holds the float; where several crests hold floats, the "
            "one nearest to where it ends",
        ),
        "phase_trapped_error": (
            "rad",
            "simulated phase at the end less this; unknown of floats that still move on the wave",
        ),
        "delta_capture": (
            "1",
            "amplitude of the cosine wave from which on it holds floats of this length",
        ),
        "body_speed_max": ("speed", "largest velocity of the float; it is held from the wave's on"),
        "mean_flow": ("1", "of the film"),
        "delta": ("1", "amplitude of a cosine wave"),
        "float_length": ("1", "as in the scene"),
        "wave_speed": ("speed", "speed of the wave (SI)"),
        "wavelength": ("length", "of the wave (SI)"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "float_position": ("length", ("body", "time"), "middles of the floats"),
        "tracer_position": ("length", ("tracer", "time"), "position of the tracers"),
        "tracer_height": ("length", ("tracer", "time"), "height of the tracers"),
        "xi": ("rad", ("xi",), "phase t - x of the wave"),
        "height": ("length", ("xi",), "thickness of the film"),
        "field_squared": ("1", ("xi",), "(mu - 1) H^2 / (8 pi) over P, least field"),
        "body_velocity": ("speed", ("body", "xi"), "velocity of the floats by phase"),
    }

    kind: Literal["float"]
    want: Annotated[
        tuple[Literal["floats", "ride"], ...],
        says(
            "",
            "`floats`: the floats on the wave, and the field (figure 27); `ride`: paths over the "
            "wave",
        ),
    ] = ()
    film: Annotated[FilmTable, says("", "film and wave, without `tension`")]
    floats: Annotated[FloatsTable, says("", "bodies on the surface")] = field(
        default_factory=FloatsTable
    )
    tracers: Annotated[TracersTable | None, says("", "points of the fluid")] = None
    course: Annotated[RideTable, says("", "the time")] = field(default_factory=RideTable)
    tolerance: Annotated[ToleranceTable, says("", "how exact simulations are")] = field(
        default_factory=ToleranceTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults(self.units)
        if self.film.tension:
            yield "film.tension", "does not act on what floats; leave it out"
