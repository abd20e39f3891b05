"""Scenes of kinds "magnetic-pair" and "resonance": two masses on a magneto-elastic link."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import AveragingTable, ToleranceTable
from wormopt.scene.types import (
    Finite,
    Positive,
    SceneTable,
    Table,
    per,
    says,
    wrong_order,
)
from wormopt.systems.chain import (
    Friction,
    SpikeFriction,
    ViscousFriction,
    faults_of_law,
)
from wormopt.systems.pair.scenes.pair_waveform import NATURAL

Strain = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]
Cosines = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=13, description="2 to 13 finite numbers, the mean first"),
]
FinitePair = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [least, largest]"),
]


class SampleTable(Table, frozen=True, kw_only=True):
    """The magneto-elastic link as a sample of material, in SI units; *ε* is half its strain."""

    mass: Annotated[Positive, says("mass", "each of the two masses")]
    youngs_modulus: Annotated[Positive, says("stress", "effective modulus in the field")]
    strain: Annotated[Strain, says("share", "*u*<sub>0</sub>, in the field without force")]
    length: Annotated[Positive, says("length", "of the link")]
    area: Annotated[Positive, says("area", "cross-section of the link")]


class MagneticPairTable(Table, frozen=True, kw_only=True):
    """Two equal masses on a link, under a pulsating field: `eps`, or `sample` in SI scenes."""

    eps: Annotated[
        Positive | None,
        says(
            "share", "*ε*: push of the field over stiffness times length; in scenes without units"
        ),
    ] = None
    sample: Annotated[SampleTable | None, says("", 'instead, with `units = "SI"`')] = None
    friction: Annotated[
        Friction,
        says(
            "",
            "law of the ground, but no spikes; forces are told over the push, velocities over "
            "length times natural rate; one number or one per mass",
        ),
    ]
    cosines: Annotated[
        Cosines,
        says(
            "share",
            "*G*(*t*) = Σ `cosines[k]` cos(*kνt*); the second drives the swing and is not 0",
        ),
    ] = (1.0, 1.0)

    @property
    def smallness(self) -> float:
        """The small number eps of (16)."""
        return self.sample.strain / 2 if self.sample else self.eps or 0.0

    @property
    def natural_time(self) -> float:
        """sqrt(m / c), in units of the scene."""
        s = self.sample
        return math.sqrt(s.mass * s.length / (s.youngs_modulus * s.area)) if s else 1.0

    def faults(self, units: str) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        if units == "SI" and self.sample is None:
            yield "pair.sample", 'missing; with units = "SI" describe the link: [pair.sample]'
        if units == "SI" and self.eps is not None:
            yield "pair.eps", "belongs to scenes without units; pair.sample.strain / 2 is eps"
        if units != "SI" and self.sample is not None:
            yield "pair.sample", 'is in SI units; write units = "SI"'
        if units != "SI" and self.eps is None:
            yield "pair.eps", "missing; write the push over stiffness times length, 0.0355 say"
        if self.cosines[1] == 0:
            yield "pair.cosines", "the second number, the harmonic that swings the pair, is 0"
        yield from faults_of_law("pair.friction", self.friction, 2)
        if isinstance(self.friction, SpikeFriction):
            message = "spikes do not slide back, these masses must"
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
                    f"nothing resists motion {side}: any velocity so fast that both masses slide "
                    f"{side} is steady; write some friction {side}",
                )


class CourseTable(Table, frozen=True, kw_only=True):
    """The motion that is simulated from rest."""

    end: Annotated[
        Positive | None,
        says(
            "time",
            "last time, at least twice `periods`; if left out 60/*ε* natural times, longer where "
            "deviations fade slowly",
        ),
    ] = None
    samples: Annotated[
        int,
        Meta(ge=2, le=100_000, description="a whole number, 2 to 100000"),
        says("count", "equidistant times at which it is kept"),
    ] = 2001
    periods: Annotated[
        int,
        Meta(ge=1, le=1000, description="a whole number from 1 to 1000"),
        says(
            "count",
            "last periods of the field over which the exact motion is averaged, and as many "
            "before, to see whether it has settled",
        ),
    ] = 20


ThePair = Annotated[MagneticPairTable, says("", "the pair")]
Averaging = Annotated[AveragingTable, says("", "how averages are computed")]
ToleranceOf = Annotated[ToleranceTable, says("", "how exact simulations are")]


class MagneticPairScene(SceneTable, frozen=True, kw_only=True):
    """Velocity of the pair over time, exactly and on average.

    Two masses on a magneto-elastic bar in a pulsating field, from rest: the exact motion, its
    averages of first and second order, and the steady motion they settle on. Theory:
    [theory-magnetics.md](../theory-magnetics.md#2-the-pair).

    The trust report: `closed_form_difference` from (19) where friction is dry and alike,
    `settled_to` (how far the average ends from its steady state), `quadrature_error` (change of the
    mean rates with twice the nodes, over *ε*), residuals, and of the exact motion its events,
    rests, and a second route. Exit code 3 where there is no steady motion: at detuning 0, or where
    friction takes more than the field gives.

    Limits: averages are asymptotic in *ε*; a warning stands where it is above 0.1. They assume
    that masses pass through 0 and do not rest, which the exact motion is asked about. Beyond
    strains of 0.1 a warning says that the law of the material ends.
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
        "frequency": ("angular_frequency", "of the field"),
        "velocity_steady": ("1", "*V* of the steady motion, first order, dimensionless"),
        "amplitude_steady": ("1", "its *a*, of half the stretch"),
        "phase_steady": ("rad", "its *ξ*"),
        "velocity_steady_second": (
            "1",
            "*V* of second order; unknown where the swing is below 4 *ε*",
        ),
        "velocity_exact_mean": (
            "1",
            "displacement of the exact motion over time, in the last whole periods",
        ),
        "averaging_error": ("1", "difference of the first order from it"),
        "averaging_error_second": ("1", "difference of the second order from it"),
        "stable": ("1", "whether small deviations die out"),
        "decay_rate": ("rate", "how fast the slowest of them does"),
        "strain_amplitude": ("1", "2*a*, amplitude of the stretch"),
        "velocity_steady_si": ("speed", "`velocity_steady`, with a sample"),
        "velocity_exact_mean_si": ("speed", "`velocity_exact_mean`, with a sample"),
        "u0": ("1", "of the sample"),
        "stiffness": ("stiffness", "of the sample"),
        "natural_rate": ("angular_frequency", "of the sample, √(*c*/*m*)"),
        "velocity_stated": ("speed", "what was stated"),
        "velocity_stated_deviation": ("speed", "by how much it is off"),
    }
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "velocity": ("speed", ("time",), "velocity of the centre, exact"),
        "velocity_period": ("speed", ("time",), "its mean over a period of the field"),
        "velocity_first": ("speed", ("time",), "average, first order"),
        "velocity_second": ("speed", ("time",), "average, second order"),
        "late_time": ("time", ("late",), "time in the last periods"),
        "late_velocity": ("speed", ("late",), "velocity of the centre, exact"),
    }

    kind: Literal["magnetic-pair"]
    want: Annotated[
        tuple[Literal["velocity"], ...],
        says(
            "",
            "`velocity`: the chapter's figure 13, and the last four periods closely; the average "
            "of second order begins where the swing reaches 4 *ε*",
        ),
    ] = ()
    pair: ThePair
    detuning: Annotated[
        Finite, says("1", "*Δ*: the field's frequency is √2 + *εΔ* natural rates √(*c*/*m*)")
    ]
    course: Annotated[CourseTable, says("", "the motion")] = field(default_factory=CourseTable)
    stated_velocity: Annotated[
        Finite | None, says("speed", "a velocity that somebody stated, to compare with")
    ] = None
    averaging: Averaging = field(default_factory=AveragingTable)
    tolerance: ToleranceOf = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.pair.faults(self.units)
        frequency = NATURAL + self.pair.smallness * self.detuning
        if frequency <= 0.1:
            yield "detuning", "leaves no frequency above 0; write one nearer to 0"
        elif self.course.end is not None:
            least = 2 * self.course.periods * 2 * math.pi / frequency * self.pair.natural_time
            if self.course.end < least:
                yield (
                    "course.end",
                    f"is shorter than twice course.periods; write at least {least:.5g}, or fewer "
                    "periods",
                )


class FrequenciesTable(Table, frozen=True, kw_only=True):
    """Frequencies along which steady motions are followed."""

    detuning: Annotated[FinitePair, says("1", "least and largest *Δ*")] = (-2.0, 2.0)
    points: Annotated[
        int,
        Meta(ge=2, le=10_000, description="a whole number, 2 to 10000"),
        says("count", "equidistant values between them at which states are given"),
    ] = 400
    largest: Annotated[
        Positive,
        says("1", "amplitude in lengths of the link at which a branch counts as running away"),
    ] = 100.0


class ConfirmTable(Table, frozen=True, kw_only=True):
    """Exact simulations from every stable state that is given; none without this table."""

    time: Annotated[
        Positive, says("1", "how long each is, in natural times √(*m*/*c*), in SI scenes too")
    ] = 2000.0
    periods: Annotated[
        int,
        Meta(ge=1, le=1000, description="a whole number from 1 to 1000"),
        says("count", "last periods of the field that are averaged, and as many before"),
    ] = 50


class ResonanceScene(SceneTable, frozen=True, kw_only=True):
    """Steady motions of the pair along the frequency of its field.

    All branches of the average, folds, stability, and an exact motion from every stable point.
    Variables over `curve` are the branches as they were followed; at detunings without a steady
    motion no state is given. Theory: [theory-magnetics.md](../theory-magnetics.md#2-the-pair).
    """

    headline: ClassVar = ("velocity_largest", "steady_motions", "stable", "delta_fold", "confirmed")
    scalars: ClassVar = {
        "eps": ("1", "*ε*, the small parameter"),
        "delta_fold": (
            "1",
            "detunings at which branches turn back, ascending; empty without folds",
        ),
        "branches": ("count", "branches"),
        "steady_motions": ("count", "states given"),
        "stable": ("count", "how many of these are stable"),
        "velocity_largest": ("speed", "largest \\|*V*\\| among them"),
        "confirmed": ("count", "exact motions that settled"),
        "averaging_error": ("1", "largest difference of *V* from these, first order"),
        "averaging_error_second": ("1", "the same of second order"),
        "u0": ("1", "strain of the sample"),
    }
    variables: ClassVar = {
        "detuning": ("1", ("point",), "detuning of the field"),
        "velocity_steady": ("speed", ("point",), "velocity of the centre"),
        "amplitude_steady": ("length", ("point",), "amplitude of half the stretch"),
        "stable_point": ("1", ("point",), "whether it is stable"),
        "branch": ("1", ("point",), "number of its branch"),
        "velocity_second": ("speed", ("point",), "velocity of the centre, second order"),
        "velocity_exact": ("speed", ("point",), "velocity of the centre, exact mean"),
        "curve_detuning": ("1", ("curve",), "detuning of the field"),
        "curve_velocity": ("speed", ("curve",), "velocity of the centre"),
        "curve_amplitude": ("length", ("curve",), "amplitude of half the stretch"),
        "curve_stable": ("1", ("curve",), "whether it is stable"),
        "curve_branch": ("1", ("curve",), "number of the branch"),
    }

    kind: Literal["resonance"]
    want: Annotated[
        tuple[Literal["resonance"], ...],
        says("", "`resonance`: velocity and amplitude along the detuning"),
    ] = ()
    pair: ThePair
    frequencies: Annotated[FrequenciesTable, says("", "along which frequencies")] = field(
        default_factory=FrequenciesTable
    )
    confirm: Annotated[ConfirmTable | None, says("", "exact motions to compare with")] = None
    averaging: Averaging = field(default_factory=AveragingTable)
    tolerance: ToleranceOf = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.pair.faults(self.units)
        yield from wrong_order(
            "frequencies.detuning", self.frequencies.detuning, may_be_equal=False
        )
        if self.confirm is not None:
            lowest = max(NATURAL + self.pair.smallness * self.frequencies.detuning[0], 0.1)
            least = 2 * self.confirm.periods * 2 * math.pi / lowest
            if self.confirm.time < least:
                yield (
                    "confirm.time",
                    f"is shorter than twice confirm.periods; write at least {least:.5g}, or fewer "
                    "periods",
                )
        if NATURAL + self.pair.smallness * self.frequencies.detuning[0] <= 0.1:
            yield (
                "frequencies.detuning",
                "leaves no frequency above 0; write a least one nearer to 0",
            )
