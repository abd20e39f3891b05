"""Tables of scenes of kind "magnetic-pair": a magneto-elastic pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.numerics import AveragingTable, ToleranceTable
from wormopt.study.types import Finite, SceneTable, per
from wormopt.systems.chain import (
    Friction,
    SpikeFriction,
    ViscousFriction,
    faults_of_law,
)
from wormopt.systems.pair.tables import NATURAL

Strain = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Cosines = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=13, description="2 to 13 finite numbers, the mean first"),
]


class SampleTable(Given):
    """The magneto-elastic link as a sample of material, in SI units; *ε* is half its strain."""

    mass: float = positive("mass", "mass of each of the two masses")
    youngs_modulus: float = positive("stress", "effective Young's modulus in the field")
    strain: float = number(
        "share", "*u*<sub>0</sub>, strain in the field without force", above=0, below=1
    )
    length: float = positive("length", "length of the link")
    area: float = positive("area", "cross-section of the link")


class MagneticPairTable(Given):
    """Two equal masses on a link in a pulsating field: `eps`, or `sample` in SI scenes."""

    eps: float | None = positive(
        "share",
        "*ε*, push of the field over stiffness times length, in scenes without units",
        default=None,
    )
    sample: SampleTable | None = entry('sample of the link, with `units = "SI"`', default=None)
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

    @property
    def natural_time(self) -> float:
        """Natural time sqrt(m / c), in units of the scene."""
        s = self.sample
        return math.sqrt(s.mass * s.length / (s.youngs_modulus * s.area)) if s else 1.0

    def faults(self, units: str) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
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
        if self.cosines[1] == 0:
            yield (
                "pair.cosines",
                "has the second number 0, but this harmonic drives the pair; write another",
            )
        yield from faults_of_law("pair.friction", self.friction, 2)
        if isinstance(self.friction, SpikeFriction):
            message = "spikes do not slide back, but these masses must"
            yield "pair.friction", f'{message}; write kind = "coulomb", "stribeck" or "viscous"'
        else:
            yield from self._unresisted()

    def _unresisted(self) -> Iterator[Fault]:
        law = self.friction
        for side in ("forward", "backward"):
            name = "drag" if isinstance(law, ViscousFriction) else side
            if not any(number > 0 for number in per(getattr(law, name), 2)):
                yield (
                    "pair.friction",
                    f"has no resistance to motion {side}: every velocity at which both masses "
                    f"slide {side} is steady; write friction {side}",
                )


class CourseTable(Given):
    """The motion that is simulated from rest."""

    end: float | None = positive(
        "time",
        "duration, at least twice `periods`; default: 60/*ε* natural times, longer where "
        "deviations decay slowly",
        default=None,
    )
    samples: int = whole(2, 100000, "number of equidistant times in the result", default=2001)
    periods: int = whole(
        1,
        1000,
        "number of last field periods over which the exact motion is averaged; as many before "
        "are used to check convergence",
        default=20,
    )


ThePair = Annotated[MagneticPairTable, says("", "the pair")]
Averaging = Annotated[AveragingTable, says("", "computation of the averages")]
ToleranceOf = Annotated[ToleranceTable, says("", "tolerance of the exact simulations")]


class MagneticPairScene(SceneTable):
    """Velocity of the pair over time, exact and averaged.

    Two masses on a magneto-elastic link in a pulsating field start from rest. The result contains
    the exact motion, its averages of first and second order, and the steady motion to which they
    converge. Theory: [theory-magnetics.md](../theory-magnetics.md#2-the-pair).

    The trust report has `closed_form_difference` (difference from eq. 19 of Zimmermann et al. 2007,
    for equal dry friction), `settled_to` (distance of the average's end from its steady state),
    `quadrature_error` (change of the mean rates with twice the nodes, over *ε*), residuals, and the
    events, rests and second route of the exact motion. The exit code is 3 without a steady motion:
    at detuning 0, or where friction takes more than the field supplies.

    Limits: averages are asymptotic in *ε*; a warning appears above 0.1. They assume that masses
    pass through 0 without rest, which the exact motion checks. A warning also appears at strains
    above 0.1, where the law of the material is no longer valid.
    """

    headline: ClassVar = (
        "velocity_steady",
        "velocity_steady_second",
        "velocity_exact_mean",
        "amplitude_steady",
        "stable",
    )
    scalars: ClassVar = {
        "eps": ("1", "*ε*, the small parameter"),
        "frequency": ("angular_frequency", "frequency of the field"),
        "velocity_steady": ("1", "*V* of the steady motion in first order, dimensionless"),
        "amplitude_steady": ("1", "amplitude *a* of half the stretch in the steady motion"),
        "phase_steady": ("rad", "phase *ξ* of the steady motion"),
        "velocity_steady_second": (
            "1",
            "*V* of the steady motion in second order; unknown where the swing is below 4 *ε*",
        ),
        "velocity_exact_mean": (
            "1",
            "displacement of the exact motion over time, in the last whole periods",
        ),
        "averaging_error": ("1", "difference between first order and the exact mean"),
        "averaging_error_second": ("1", "difference between second order and the exact mean"),
        "stable": ("1", "whether small deviations decay"),
        "decay_rate": ("rate", "decay rate of the slowest deviation"),
        "strain_amplitude": ("1", "amplitude 2*a* of the stretch"),
        "velocity_steady_si": ("speed", "`velocity_steady` in SI units, with a sample"),
        "velocity_exact_mean_si": ("speed", "`velocity_exact_mean` in SI units, with a sample"),
        "u0": ("1", "strain *u*<sub>0</sub> of the sample"),
        "stiffness": ("stiffness", "stiffness of the sample"),
        "natural_rate": ("angular_frequency", "natural frequency √(*c*/*m*) of the sample"),
        "velocity_stated": ("speed", "stated velocity, as in the scene"),
        "velocity_stated_deviation": ("speed", "relative deviation of the stated velocity"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "velocity": ("speed", ("time",), "exact velocity of the centre"),
        "velocity_period": ("speed", ("time",), "exact mean over a period of the field"),
        "velocity_first": ("speed", ("time",), "average of first order"),
        "velocity_second": ("speed", ("time",), "average of second order"),
        "late_time": ("time", ("late",), "time in the last periods"),
        "late_velocity": ("speed", ("late",), "exact velocity of the centre"),
    }

    kind: Literal["magnetic-pair"]
    want: tuple[Literal["velocity"], ...] = entry(
        "`velocity`: velocity over time (figure 13 of Zimmermann et al. 2007), and the last "
        "four periods in detail; the average of second order begins where the swing reaches 4 "
        "*ε*",
        default=(),
    )
    pair: ThePair
    detuning: float = number(
        "1", "detuning *Δ*: the field's frequency is √2 + *εΔ* natural frequencies √(*c*/*m*)"
    )
    course: CourseTable = entry("the motion", default=CourseTable)
    stated_velocity: float | None = number(
        "speed", "a published velocity for comparison", default=None
    )
    averaging: Averaging = field(default_factory=AveragingTable)
    tolerance: ToleranceOf = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.pair.faults(self.units)
        frequency = NATURAL + self.pair.smallness * self.detuning
        if frequency <= 0.1:
            yield "detuning", "gives no positive frequency; write a number closer to 0"
        elif self.course.end is not None:
            least = 2 * self.course.periods * 2 * math.pi / frequency * self.pair.natural_time
            if self.course.end < least:
                yield (
                    "course.end",
                    f"is shorter than twice course.periods; write at least {least:.5g}, or fewer "
                    "periods",
                )
