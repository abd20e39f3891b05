"""Tables of films of magnetic fluid: film and wave, travelling field, duration, resolution."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import Given, entry, number, on_use, whole
from wormopt.study.types import Finite
from wormopt.systems.film.units import Fluid
from wormopt.systems.spiked import why_unreadable
from wormopt.tables import SUFFIXES

with on_use():
    import numpy as np

    from wormopt.magnetics.pressure import magnetic_pressure
    from wormopt.systems.film.cosine import CosineWave
    from wormopt.systems.film.given_field import read_field
    from wormopt.systems.film.shapes import FourierWave, Wave

Share = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]
SharePair = Annotated[
    tuple[Share, ...],
    Meta(min_length=2, max_length=2, description="two numbers above 0 and below 1, smaller first"),
]
Length = Annotated[
    float, Meta(ge=0, lt=1, description="a number from 0 to below 1, in wavelengths")
]
Harmonics = Annotated[
    tuple[Finite, ...], Meta(min_length=1, max_length=32, description="1 to 32 finite numbers")
]
Samples = Annotated[
    tuple[Finite, ...],
    Meta(min_length=4, max_length=100_000, description="4 to 100000 finite numbers"),
]
Name = Annotated[str, Meta(min_length=1, description="text that is not empty")]
MOST_PERIODS = 20_000
"""Upper limit of the wave periods of a simulated float."""

CAPTURE_DELTA = math.sqrt(13) - 3
"""Least amplitude at which a cosine wave holds a small float: root of delta² + 6 delta = 4."""


class Film(Given):
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
    fluid: Fluid | None = entry("fluid of the film, in SI scenes", default=None)

    # Units of dimensionless results, in those of the scene.

    @property
    def length_unit(self) -> float:
        """Unit of lengths along the film."""
        return 1 / self.fluid.wave_number if self.fluid else 1.0

    @property
    def height_unit(self) -> float:
        """Unit of lengths across the film."""
        return self.fluid.depth if self.fluid else 1.0

    @property
    def time_unit(self) -> float:
        """Unit of times."""
        return 1 / self.fluid.frequency if self.fluid else 1.0

    @property
    def speed_unit(self) -> float:
        """Unit of speeds, that of the wave."""
        return self.fluid.speed if self.fluid else 1.0

    @property
    def stress_unit(self) -> float:
        """Unit of forces per area, eta omega / (k d)."""
        one = self.fluid
        return one.viscosity * one.frequency / one.eps if one else 1.0

    @property
    def thinness(self) -> float | None:
        """Depth times wave number, if it is known."""
        return self.fluid.eps if self.fluid else self.eps

    @property
    def tension_number(self) -> float:
        """Dimensionless surface tension."""
        return self.fluid.tension if self.fluid else self.tension or 0.0

    def wave(self, scene: str) -> Wave:
        """Make the wave; SceneError if its thickness is not positive everywhere."""
        if self.delta is not None:
            return CosineWave(self.delta)
        key = "film.cosines" if self.cosines else "film.sines"
        try:
            wave = FourierWave(self.cosines or (), self.sines or ())
            _ = wave.nodes  # refuses waves that no grid resolves
        except ArgumentError as error:
            raise SceneError(scene, [(key, str(error))]) from None
        return wave

    def faults_of_keys(self) -> Iterator[Fault]:
        harmonics = [name for name in ("cosines", "sines") if getattr(self, name) is not None]
        if self.delta is not None and harmonics:
            yield (
                "delta",
                f"defines a cosine wave, so {' and '.join(harmonics)} cannot be added; write one "
                "of the two",
            )
        if harmonics and not any(any(getattr(self, name)) for name in harmonics):
            yield (
                harmonics[0],
                "contains only zeros, so there is no wave; write an amplitude that is not 0",
            )

    @property
    def has_wave(self) -> bool:
        """Whether a wave is prescribed."""
        return any(one is not None for one in (self.delta, self.cosines, self.sines))

    def faults_in(self, units: str, *, needs_wave: bool = True) -> Iterator[Fault]:
        """Yield what is missing in a study, and what does not fit its units."""
        if needs_wave and not self.has_wave:
            yield "film.delta", "missing; write delta, or harmonics in cosines and sines"
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


class Ride(Given):
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


class Field(Given):
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
    mu_r: float | None = number(
        "1",
        "relative permeability, required for *H* and *H*² in scenes without units",
        above=1,
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.samples is None and self.file is None:
            yield "samples", "missing; write the values over a wavelength, or file"
        if self.samples is not None and self.file is not None:
            yield "file", "cannot be combined with samples; write one of them"
        if self.file is None and self.variable is not None:
            yield "variable", "needs an earlier result; name it in file"

    def faults_in(self, units: str, folder: Path) -> Iterator[Fault]:
        """Yield what does not fit the units of a scene, or the file in its folder."""
        if self.file is not None:
            yield from self._faults_of_file(self.file, folder)
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

    def pressure(self, folder: Path, units: str, fluid: Fluid | None) -> np.ndarray:
        """Samples as (mu - 1) H² / (8 pi) in units of P."""
        if self.samples is not None:
            values = np.array(self.samples)
        else:
            values = read_field(folder / (self.file or ""), self.variable, self.quantity, units)
        if self.quantity == "pressure":
            return values
        if self.quantity == "field_squared" and values.min() < 0:
            raise ArgumentError(
                f"H² is {values.min():.6g} at its least; write values of 0 or above"
            )
        square = values if self.quantity == "field_squared" else values * values
        if fluid is None:
            return ((self.mu_r or 1.0) - 1) * square / (8 * math.pi)
        return np.asarray(magnetic_pressure(fluid.mu_r, np.sqrt(square))) / fluid.pressure


class Duration(Given):
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


class Resolution(Given):
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

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.most < self.points:
            yield "most", f"is less than grid.points; write at least {self.points}"
        if self.points < 2 * self.order:
            yield "points", f"is too small for order {self.order}; write {2 * self.order}"
