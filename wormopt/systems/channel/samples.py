"""Bodies of the chapter's section 3.4 and what its text says was measured; SI units, data only."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SAMPLES", "Mark", "Sample"]


@dataclass(frozen=True)
class Mark:
    """A velocity that was measured.

    Parameters
    ----------
    frequency : float
        Coil switches per second.
    velocity : float
        In m/s, against the travel of the field.
    text : str
        Whose, and where it is said.
    """

    frequency: float
    velocity: float
    text: str


@dataclass(frozen=True)
class Sample:
    """A body in its channel.

    Parameters
    ----------
    pitch, channel, body, length : float
        Distance of neighbouring coils, diameters of channel and body, length of the body, in m.
    youngs_modulus : float, optional
        In Pa, where the text tells it.
    marks : tuple of Mark
        What was measured.
    valid_below : float, optional
        Switches per second below which formula and experiment are said to agree.
    stops_above : float, optional
        Switches per second above which the body is said to stand still.
    """

    pitch: float
    channel: float
    body: float
    length: float
    youngs_modulus: float | None = None
    marks: tuple[Mark, ...] = ()
    valid_below: float | None = None
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
"""Every body by its name; the modulus of the capsule's skin is not told."""
