"""Bodies and measurements of section 3.4 of Zimmermann et al. 2007 (WLLS); SI units, data only."""

from __future__ import annotations

from dataclasses import dataclass

from wormopt.study import Given, entry, positive
from wormopt.study.types import Title

STEEPEST, FLATTEST = 10.0, 1e-3
"""Limits of the rise over the pitch: up to the largest, arc lengths are exact to round-off; below
the least, the excess of a segment's length over the pitch is lost in it."""


class Mark(Given):
    """A measured velocity."""

    frequency: float = positive("rate", "coil switches per second")
    velocity: float = positive("speed", "velocity against the travel of the field")
    text: Title = entry("label in the plot")


def _largest(frequency: float, velocity: float, body: str) -> tuple[Mark, ...]:
    """Return the largest velocity of a body that was measured."""
    text = f"{body}: measured maximum, from the text"
    return (Mark(frequency=frequency, velocity=velocity, text=text),)


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


SAMPLES = {
    "sample-1": Sample(
        10e-3, 11e-3, 4e-3, 48e-3, 50e3, _largest(100.0, 78.9e-3, "sample 1"),
        valid_below=100.0, stops_above=950.0,
    ),
    "sample-2": Sample(10e-3, 10e-3, 4.5e-3, 75e-3, 22e3),
    "capsule": Sample(
        10e-3, 10e-3, 4e-3, 75e-3, None, _largest(50.0, 55.6e-3, "capsule"),
        valid_below=50.0, stops_above=700.0,
    ),
}  # fmt: skip
"""Every body by its name; the modulus of the capsule's skin is not published."""
