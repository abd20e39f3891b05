"""Scenes of kinds "magnetic-pair" and "resonance": two masses on a magneto-elastic link."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import AveragingTable, ToleranceTable
from wormopt.scene.types import (
    Finite,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    per,
    wrong_order,
)
from wormopt.systems.chain.scenes.chain import (
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
    """The magneto-elastic link as a sample of material, in SI units.

    Parameters
    ----------
    mass : float
        Each of the two masses, kg.
    youngs_modulus : float
        Effective modulus E in the field, Pa.
    strain : float
        Strain u0 in the field without force.
    length, area : float
        Length l0 and cross-section S0, m and m2.
    """

    mass: Positive
    youngs_modulus: Positive
    strain: Strain
    length: Positive
    area: Positive


class MagneticPairTable(Table, frozen=True, kw_only=True):
    """Two equal masses on a link, under a pulsating field.

    Parameters
    ----------
    eps : float, optional
        Push of the field over stiffness times length, for scenes without units.
    sample : SampleTable, optional
        The link in SI units instead; eps is half its strain.
    friction : table
        Law of the ground; forces over the push, velocities over length times natural rate.
    cosines : tuple of float
        Field G(t) = sum_k cosines[k] cos(k nu t).
    """

    eps: Positive | None = None
    sample: SampleTable | None = None
    friction: Friction
    cosines: Cosines = (1.0, 1.0)

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
    """The motion that is simulated from rest.

    Parameters
    ----------
    end : float, optional
        Last time; if left out 60 / eps natural times, or 25 times that in which the slowest
        deviation falls to 1/e.
    samples : int
        Equidistant times at which it is kept.
    periods : int
        Last periods of the field over which the exact motion is averaged, and as many before.
    """

    end: Positive | None = None
    samples: Annotated[int, Meta(ge=2, le=100_000, description="a whole number, 2 to 100000")] = (
        2001
    )
    periods: Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")] = 20


class MagneticPairScene(SceneTable, frozen=True, kw_only=True):
    """Velocity of the pair over time, exactly and on average.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"magnetic-pair"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether the pair is a sample in SI units.
    want : tuple of str
        Pictures to draw.
    pair : MagneticPairTable
        The pair.
    detuning : float
        Delta: the field's frequency is the natural one plus eps Delta, in natural rates.
    course : CourseTable
        The motion.
    stated_velocity : float, optional
        A velocity that somebody stated, to compare with.
    averaging : AveragingTable
        How averages are computed.
    tolerance : ToleranceTable
        How exact simulations are.
    """

    kind: Literal["magnetic-pair"]
    want: tuple[Literal["velocity"], ...] = ()
    pair: MagneticPairTable
    detuning: Finite
    course: CourseTable = field(default_factory=CourseTable)
    stated_velocity: Finite | None = None
    averaging: AveragingTable = field(default_factory=AveragingTable)
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
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


class SweepTable(Table, frozen=True, kw_only=True):
    """Frequencies along which steady motions are followed.

    Parameters
    ----------
    detuning : (float, float)
        Least and largest detuning Delta.
    points : int
        Equidistant values between them at which states are given.
    largest : float
        Amplitude a, in lengths of the link, at which a branch is given up as running away.
    """

    detuning: FinitePair = (-2.0, 2.0)
    points: Annotated[int, Meta(ge=2, le=10_000, description="a whole number, 2 to 10000")] = 400
    largest: Positive = 100.0


class ConfirmTable(Table, frozen=True, kw_only=True):
    """Exact simulations from every stable state that is given.

    Parameters
    ----------
    time : float
        How long each is, in natural times 1 / sqrt(c / m).
    periods : int
        Last periods of the field that are averaged, and as many before.
    """

    time: Positive = 2000.0
    periods: Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")] = 50


class ResonanceScene(SceneTable, frozen=True, kw_only=True):
    """Steady motions of the pair along the field's frequency.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"resonance"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether the pair is a sample in SI units.
    want : tuple of str
        Pictures to draw.
    pair : MagneticPairTable
        The pair.
    sweep : SweepTable
        Along which frequencies.
    confirm : ConfirmTable, optional
        Exact simulations to compare with; none if left out.
    averaging : AveragingTable
        How averages are computed.
    tolerance : ToleranceTable
        How exact simulations are.
    """

    kind: Literal["resonance"]
    want: tuple[Literal["resonance"], ...] = ()
    pair: MagneticPairTable
    sweep: SweepTable = field(default_factory=SweepTable)
    confirm: ConfirmTable | None = None
    averaging: AveragingTable = field(default_factory=AveragingTable)
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from self.pair.faults(self.units)
        yield from wrong_order("sweep.detuning", self.sweep.detuning, may_be_equal=False)
        if self.confirm is not None:
            lowest = max(NATURAL + self.pair.smallness * self.sweep.detuning[0], 0.1)
            least = 2 * self.confirm.periods * 2 * math.pi / lowest
            if self.confirm.time < least:
                yield (
                    "confirm.time",
                    f"is shorter than twice confirm.periods; write at least {least:.5g}, or fewer "
                    "periods",
                )
        if NATURAL + self.pair.smallness * self.sweep.detuning[0] <= 0.1:
            yield "sweep.detuning", "leaves no frequency above 0; write a least one nearer to 0"
