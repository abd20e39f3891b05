"""Scenes of kind "pair-waveform": the field that moves a magneto-elastic pair best."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    NonNegative,
    Positive,
    PositiveOrPair,
    SceneTable,
    Seed,
    Table,
    extreme_numbers,
    per,
    wrong_order,
)
from wormopt.systems.chain.scenes.chain import CoulombFriction, Friction, faults_of_law

NATURAL = math.sqrt(2)
"""Frequency at which the free masses swing against each other, over sqrt(c / m)."""

FieldRange = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2, description="two numbers, 0 or above, [least, largest]"),
]


class DrivenPairTable(Table, frozen=True, kw_only=True):
    """Two masses on a magneto-elastic link, without units.

    Parameters
    ----------
    eps : float
        Push of the field over stiffness times length.
    friction : table
        Dry friction of the ground, forces over the push; numbers alike or one per mass.
    """

    eps: Positive
    friction: Friction

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        law, wrong = self.friction, list(faults_of_law("pair.friction", self.friction, 2))
        yield from wrong
        if not isinstance(law, CoulombFriction):
            yield "pair.friction", 'this kind is for dry friction; write kind = "coulomb"'
        elif not wrong and sum(per(law.forward, 2)) >= sum(per(law.backward, 2)):
            yield (
                "pair.friction",
                "not weaker forward than backward: the pair does not move forward; write "
                "forward below backward",
            )


class FieldLimitsTable(Table, frozen=True, kw_only=True):
    """What the field must keep to.

    Parameters
    ----------
    field : (float, float)
        Least and largest G; it follows the square of the field strength.
    frequency : float or (float, float)
        Angular frequency over sqrt(c / m), or the range in which to choose it.
    slope : float, optional
        Largest |G'|; without it the field may jump.
    strain : float, optional
        Largest |x_2 - x_1|, over the length of the link.
    """

    field: FieldRange
    frequency: PositiveOrPair
    slope: Positive | None = None
    strain: Positive | None = None

    @property
    def frequency_range(self) -> tuple[float, float]:
        """Least and largest frequency."""
        if isinstance(self.frequency, tuple):
            return self.frequency[0], self.frequency[1]
        return self.frequency, self.frequency

    def faults(self) -> Iterator[Fault]:
        """Yield ranges that are upside down, and those in which the swing has no bound."""
        yield from wrong_order("limits.field", self.field, may_be_equal=False)
        wrong = list(wrong_order("limits.frequency", self.frequency_range, may_be_equal=True))
        yield from wrong
        least, most = self.frequency_range
        order = math.ceil(NATURAL / most * (1 - 1e-12))
        if wrong or self.strain is not None or order * least > NATURAL * (1 + 1e-12):
            return
        named = "sqrt(2)" if order == 1 else f"sqrt(2) / {order}"
        which = "the field" if order == 1 else f"harmonic {order} of the field"
        yield (
            "limits.strain",
            f"missing; limits.frequency contains the resonance {named} = {NATURAL / order:.6g}, "
            f"where {which} lets the swing, and the speed, grow without bound: write the largest "
            "strain, 0.8 say, or frequencies to one side",
        )


class WaveformAimTable(Table, frozen=True, kw_only=True):
    """What the waveform is to be good at; one of both is sought.

    Parameters
    ----------
    maximise : {"speed"}, optional
        Mean speed.
    minimise : {"work_per_distance"}, optional
        Work of the field over the distance, at a mean speed of at least ``speed``.
    speed : float, optional
        Least mean speed.
    """

    maximise: Literal["speed"] | None = None
    minimise: Literal["work_per_distance"] | None = None
    speed: Positive | None = None

    def faults(self) -> Iterator[Fault]:
        """Yield what does not fit together."""
        if (self.maximise is None) == (self.minimise is None):
            yield "aim", 'write maximise = "speed" or minimise = "work_per_distance", one of both'
        elif self.minimise and self.speed is None:
            yield "aim.speed", "missing; the cheapest motion is rest: write the least mean speed"
        elif self.maximise and self.speed is not None:
            yield "aim.speed", 'belongs to minimise = "work_per_distance"; leave it out'


class WaveformSearchTable(Table, frozen=True, kw_only=True):
    """Where searches begin.

    Parameters
    ----------
    starts : int
        Number of starts: the harmonic field first, then fields of three harmonics by chance.
    seed : int
        The same seed gives the same starts.
    """

    starts: Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")] = 1
    seed: Seed = 0


class PairWaveformScene(SceneTable, frozen=True, kw_only=True):
    """The periodic field that moves the pair fastest, or cheapest, beside the harmonic one.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"pair-waveform"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless"}
        Lengths over that of the link, times over sqrt(m / c).
    want : tuple of str
        Pictures to draw.
    pair : DrivenPairTable
        The pair.
    limits : FieldLimitsTable
        What the field must keep to.
    aim : WaveformAimTable
        What it is to be good at.
    mesh : MeshTable
        How finely.
    search : WaveformSearchTable
        Where to begin.
    """

    kind: Literal["pair-waveform"]
    units: Literal["dimensionless"] = "dimensionless"
    want: tuple[Literal["waveform"], ...] = ()
    pair: DrivenPairTable
    limits: FieldLimitsTable
    aim: WaveformAimTable
    mesh: MeshTable = field(default_factory=lambda: MeshTable(arcs=100))
    search: WaveformSearchTable = field(default_factory=WaveformSearchTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from self.pair.faults()
        yield from self.limits.faults()
        yield from self.aim.faults()
