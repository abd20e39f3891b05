"""Tables of the kinds of study of a magneto-elastic pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, positive
from wormopt.study.types import Finite, NonNegative, PositiveOrPair, per, wrong_order
from wormopt.systems.chain import Friction, SpikeFriction, ViscousFriction, faults_of_law

NATURAL = math.sqrt(2)
"""Natural frequency of the free masses against each other, over sqrt(c / m)."""

LOWEST = 0.1
"""Frequency in the same unit that the field must exceed."""

Cosines = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=13, description="2 to 13 finite numbers, the mean first"),
]


FieldRange = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2, description="two numbers, 0 or above, [least, largest]"),
]


class Sample(Given):
    """The magneto-elastic link as a sample of material, in SI units; *ε* is half its strain."""

    mass: float = positive("mass", "mass of each of the two masses")
    youngs_modulus: float = positive("stress", "effective Young's modulus in the field")
    strain: float = number(
        "share", "*u*<sub>0</sub>, strain in the field without force", above=0, below=1
    )
    length: float = positive("length", "length of the link")
    area: float = positive("area", "cross-section of the link")


class PairTable(Given):
    """Two equal masses on a link in a pulsating field: `eps`, or `sample` in SI scenes."""

    eps: float | None = positive(
        "share",
        "*ε*, push of the field over stiffness times length, in scenes without units",
        default=None,
    )
    sample: Sample | None = entry('sample of the link, with `units = "SI"`', default=None)
    friction: Friction = entry(
        "friction law of the ground, without spikes; forces over the push, velocities over "
        "length times natural frequency; a number, or a list with one number per mass"
    )
    cosines: Cosines = entry(
        "*G*(*t*) = Σ `cosines[k]` cos(*kνt*); the second number drives the swing and is not 0",
        quantity="share",
        default=(1.0, 1.0),
    )

    @property
    def smallness(self) -> float:
        """Small parameter eps of eq. 16."""
        return self.sample.strain / 2 if self.sample else self.eps or 0.0

    # Units of the dimensionless pair, in those of the scene.

    @property
    def length_unit(self) -> float:
        """Length of the link."""
        return self.sample.length if self.sample else 1.0

    @property
    def time_unit(self) -> float:
        """Natural time sqrt(m / c)."""
        s = self.sample
        return math.sqrt(s.mass * s.length / (s.youngs_modulus * s.area)) if s else 1.0

    @property
    def speed_unit(self) -> float:
        """Unit of velocities."""
        return self.length_unit / self.time_unit

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.cosines[1] == 0:
            yield (
                "cosines",
                "has the second number 0, but this harmonic drives the pair; write another",
            )
        law = self.friction
        yield from faults_of_law("friction", law, 2)
        if isinstance(law, SpikeFriction):
            message = "spikes do not slide back, but these masses must"
            yield "friction", f'{message}; write kind = "coulomb", for example'
            return
        for side in ("forward", "backward"):
            name = "drag" if isinstance(law, ViscousFriction) else side
            if not any(number > 0 for number in per(getattr(law, name), 2)):
                yield (
                    "friction",
                    f"has no resistance to motion {side}: every velocity at which both masses "
                    f"slide {side} is steady; write friction {side}",
                )

    def slow_fields(self, key: str, detuning: float) -> Iterator[Fault]:
        """Yield a detuning, given by `key`, at which the field is too slow."""
        frequency = NATURAL + self.smallness * detuning
        if frequency <= LOWEST:
            least = (LOWEST - NATURAL) / self.smallness
            yield (
                key,
                f"{detuning:g} gives the frequency sqrt(2) + eps * {detuning:g} = {frequency:.4g}, "
                f"which is not above {LOWEST:g}; write a detuning above {least:.4g}",
            )

    def faults_in(self, units: str) -> Iterator[Fault]:
        """Yield what does not fit the units of the scene."""
        if units == "SI" and self.sample is None:
            yield "pair.sample", 'missing; with units = "SI" describe the link: [pair.sample]'
        if units == "SI" and self.eps is not None:
            yield (
                "pair.eps",
                "applies to scenes without units only; pair.sample.strain / 2 is eps here",
            )
        if units != "SI" and self.sample is not None:
            yield "pair.sample", 'is in SI units; write units = "SI"'
        if units != "SI" and self.eps is None:
            yield (
                "pair.eps",
                "missing; write the push over stiffness times length, for example 0.0355",
            )


class Limits(Given):
    """Limits of the field.

    Not allowed: frequencies that contain √2 or √2/*k* for a whole *k*, without `strain`. There the
    field, or its *k*-th harmonic, makes the swing and the speed grow without bound. Exit code 3:
    `strain` up to `eps` times the sum of the least field and the forward friction of mass 0, with
    which the link cannot pull mass 0 forward.
    """

    field: FieldRange = entry(
        "range of *G*, which is proportional to the square of the field strength", quantity="share"
    )
    frequency: PositiveOrPair = entry(
        "frequency over √(*c*/*m*): a fixed value, or a range", quantity="angular_frequency"
    )
    slope: float | None = positive(
        "1", "upper limit of |*G*′|; default: the field may jump", default=None
    )
    strain: float | None = positive(
        "share",
        "upper limit of |*x*<sub>2</sub> − *x*<sub>1</sub>| over the link's length",
        default=None,
    )

    @property
    def frequencies(self) -> tuple[float, float]:
        """Least and largest frequency."""
        least, most = per(self.frequency, 2)
        return least, most

    @property
    def period(self) -> tuple[float, float]:
        """Shortest and longest period."""
        least, most = self.frequencies
        return 2 * math.pi / most, 2 * math.pi / least

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("field", self.field, may_be_equal=False)
        wrong = list(wrong_order("frequency", self.frequencies, may_be_equal=True))
        yield from wrong
        least, most = self.frequencies
        order = math.ceil(NATURAL / most * (1 - 1e-12))
        if wrong or self.strain is not None or order * least > NATURAL * (1 + 1e-12):
            return
        named = "sqrt(2)" if order == 1 else f"sqrt(2) / {order}"
        which = "the field" if order == 1 else f"harmonic {order} of the field"
        yield (
            "strain",
            f"missing; limits.frequency contains the resonance {named} = {NATURAL / order:.6g}, "
            f"where {which} makes the swing and the speed grow without bound: write the largest "
            "strain, for example 0.8, or frequencies on one side",
        )


class Aim(Given):
    """Objective of the waveform: exactly one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry("mean speed", default=None)
    minimise: Literal["work_per_distance"] | None = entry(
        "net work of the field over the distance; requires `speed`", default=None
    )
    speed: float | None = positive("speed", "lower limit of the mean speed", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        if (self.maximise is None) == (self.minimise is None):
            what = "no objective is given" if self.maximise is None else "two objectives are given"
            yield "", f'{what}; write maximise = "speed" or minimise = "work_per_distance"'
        elif self.minimise and self.speed is None:
            yield (
                "speed",
                "missing, and without it the cheapest motion is rest; write the least mean speed",
            )
        elif self.maximise and self.speed is not None:
            yield "speed", 'applies to minimise = "work_per_distance" only; leave it out'
