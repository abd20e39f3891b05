"""Tables that kinds of film share: the film of magnetic fluid and its wave."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import Given, entry, number, on_use, positive, whole
from wormopt.study.types import Finite

with on_use():
    from wormopt.systems.film.cosine import CosineWave
    from wormopt.systems.film.shapes import FourierWave, Wave
    from wormopt.systems.film.units import Fluid

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
MOST_PERIODS = 20_000
"""Upper limit of the wave periods of a simulated float."""


class FluidTable(Given):
    """Fluid, film and wave, with `units = "SI"` only."""

    mu_r: float = number("1", "relative permeability", above=1)
    viscosity: float = positive("viscosity", "dynamic viscosity")
    density: float = positive("density", "density of the fluid")
    surface_tension: float = number("surface_tension", "surface tension; 0: none", least=0)
    depth: float = positive("length", "mean thickness of the film")
    wavelength: float = positive("length", "wavelength of the wave")
    frequency: float = positive("angular_frequency", "frequency of the wave")


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
    fluid: FluidTable | None = entry("fluid of the film, in SI scenes", default=None)

    @property
    def scales(self) -> Fluid | None:
        """Fluid and scales in SI units, None in scenes without units."""
        given = self.fluid
        return given and Fluid(**{name: getattr(given, name) for name in given.__struct_fields__})

    # Units of dimensionless results, in those of the scene.

    @property
    def length_unit(self) -> float:
        """Unit of lengths along the film."""
        return 1 / self.scales.wave_number if self.scales else 1.0

    @property
    def height_unit(self) -> float:
        """Unit of lengths across the film."""
        return self.scales.depth if self.scales else 1.0

    @property
    def time_unit(self) -> float:
        """Unit of times."""
        return 1 / self.scales.frequency if self.scales else 1.0

    @property
    def speed_unit(self) -> float:
        """Unit of speeds, that of the wave."""
        return self.scales.speed if self.scales else 1.0

    @property
    def stress_unit(self) -> float:
        """Unit of forces per area, eta omega / (k d)."""
        one = self.scales
        return one.viscosity * one.frequency / one.eps if one else 1.0

    @property
    def thinness(self) -> float | None:
        """Depth times wave number, if it is known."""
        return self.scales.eps if self.scales else self.eps

    @property
    def tension_number(self) -> float:
        """Dimensionless surface tension."""
        return self.scales.tension if self.scales else self.tension or 0.0

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
        """Yield a wave that is given twice, or none."""
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
