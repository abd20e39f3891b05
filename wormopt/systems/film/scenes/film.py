"""Tables of scenes of kind "float"."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number
from wormopt.study.numerics import ToleranceTable
from wormopt.study.types import SceneTable
from wormopt.systems.film.tables import Film, Length, Ride

Lengths = Annotated[
    tuple[Length, ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers from 0 to below 1"),
]
Levels = Annotated[
    tuple[Annotated[float, Meta(gt=0, le=1, description="a number above 0, up to 1")], ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers above 0, up to 1"),
]
Points = Annotated[int, Meta(ge=2, le=100_000, description="a whole number, 2 to 100000")]


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
    film: Film = entry("film and wave, without `tension`")
    floats: FloatsTable = entry("bodies on the surface", default=FloatsTable)
    tracers: TracersTable | None = entry("tracers in the fluid", default=None)
    course: Ride = entry("duration of the simulation", default=Ride)
    tolerance: ToleranceTable = entry("tolerances of the simulation", default=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.film.faults_in(self.units)
        if self.film.tension:
            yield "film.tension", "has no effect on floats; leave it out"
