"""Bodies and measurements of section 3.4 of Zimmermann et al. 2007 (WLLS); SI units, data only."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mark:
    """A measured velocity."""

    frequency: float  # coil switches per second
    velocity: float  # m/s, against the travel of the field
    text: str  # body, and source of the value


@dataclass(frozen=True)
class Sample:
    """A body in its channel."""

    pitch: float  # distance of neighbouring coils, m
    channel: float  # diameter, m
    body: float  # diameter, m
    length: float  # length of the body, m
    youngs_modulus: float | None = None  # Pa, if the text states it
    marks: tuple[Mark, ...] = ()  # measured velocities
    # switches per second below which formula and experiment are stated to agree
    valid_below: float | None = None
    # switches per second above which the body is stated to stand still
    stops_above: float | None = None


_LARGEST = "measured maximum, from the text"
SAMPLES = {
    "sample-1": Sample(
        10e-3, 11e-3, 4e-3, 48e-3, 50e3, (Mark(100.0, 78.9e-3, f"sample 1: {_LARGEST}"),),
        valid_below=100.0, stops_above=950.0,
    ),
    "sample-2": Sample(10e-3, 10e-3, 4.5e-3, 75e-3, 22e3),
    "capsule": Sample(
        10e-3, 10e-3, 4e-3, 75e-3, None, (Mark(50.0, 55.6e-3, f"capsule: {_LARGEST}"),),
        valid_below=50.0, stops_above=700.0,
    ),
}  # fmt: skip
"""Every body by its name; the modulus of the capsule's skin is not published."""
