"""Scenes of kind "pair-waveform": the field that moves a magneto-elastic pair best."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

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
    per,
    says,
    wrong_order,
)
from wormopt.systems.chain import CoulombFriction, Friction, faults_of_law
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

NATURAL = math.sqrt(2)
"""Frequency at which the free masses swing against each other, over sqrt(c / m)."""

FieldRange = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2, description="two numbers, 0 or above, [least, largest]"),
]


class DrivenPairTable(Table, frozen=True, kw_only=True):
    """Two masses on a magneto-elastic link, without units."""

    eps: Annotated[Positive, says("share", "push of the field over stiffness times length")]
    friction: Annotated[
        Friction,
        says(
            "",
            'law of the ground, with `kind = "coulomb"`; forces over the push, alike or one per '
            "mass; weaker forward than backward",
        ),
    ]

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

    Refused: frequencies that contain √2 or √2/*k* for a whole *k*, without `strain`. There the
    field, or its *k*-th harmonic, lets the swing grow without bound, and the speed with it.
    Refused as well (exit code 3): `strain` up to `eps` times the sum of the least field and mass
    0's friction forward, with which the link cannot draw mass 0 on.
    """

    field: Annotated[
        FieldRange, says("share", "range of *G*, which follows the square of the field strength")
    ]
    frequency: Annotated[
        PositiveOrPair,
        says("angular_frequency", "over √(*c*/*m*): fixed, or the range in which to choose it"),
    ]
    slope: Annotated[
        Positive | None, says("1", "largest |*G*′|; without it the field may jump")
    ] = None
    strain: Annotated[
        Positive | None,
        says("share", "largest |*x*<sub>2</sub> − *x*<sub>1</sub>|, over the link's length"),
    ] = None

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
    """What the waveform is to be good at: exactly one of `maximise` and `minimise`."""

    maximise: Annotated[Literal["speed"] | None, says("", "mean speed")] = None
    minimise: Annotated[
        Literal["work_per_distance"] | None,
        says(
            "",
            "work of the field over the distance, what flows back taken off; `speed` is required "
            "then",
        ),
    ] = None
    speed: Annotated[Positive | None, says("speed", "least mean speed")] = None

    def faults(self) -> Iterator[Fault]:
        """Yield what does not fit together."""
        if (self.maximise is None) == (self.minimise is None):
            yield "aim", 'write maximise = "speed" or minimise = "work_per_distance", one of both'
        elif self.minimise and self.speed is None:
            yield "aim.speed", "missing; the cheapest motion is rest: write the least mean speed"
        elif self.maximise and self.speed is not None:
            yield "aim.speed", 'belongs to minimise = "work_per_distance"; leave it out'


class WaveformSearchTable(Table, frozen=True, kw_only=True):
    """Where searches begin."""

    starts: Annotated[
        int,
        Meta(ge=1, le=100, description="a whole number from 1 to 100"),
        says("count", "the harmonic field first, then fields of three harmonics by chance"),
    ] = 1
    seed: Annotated[Seed, says("", "the same seed gives the same starts")] = 0


class PairWaveformScene(SceneTable, frozen=True, kw_only=True):
    """The periodic field that moves the pair fastest, or cheapest, beside the harmonic one.

    The magneto-elastic pair (16) under the best field, and under the harmonic one within the same
    limits. Velocities return after a period, positions up to the advance; friction is dry and told
    exactly. See [optimal.md](../optimal.md#the-field-of-a-magneto-elastic-pair). Without units:
    lengths over that of the link, times over √(*m*/*c*).

    The harmonic field goes about the middle of `limits.field`, with the largest amplitude that
    range, slope and strain allow (for `minimise`: the smallest that has the speed), at the best
    frequency of the range. Where its mean alone, put on at rest, stretches the link beyond
    `limits.strain`, a warning says so, `gain` is unknown, and the search starts from the fastest
    harmonic field about a lower mean; so it does where that strain leaves a harmonic field too
    weak to move the pair. Where the pair rests under the first field, four by chance are tried.

    `input_rms` and `input_peak` are those of *G*, with a slope of *G*′. Where arcs join, an
    instant stands twice. `gait_breaks` and `gait_polynomial` are the field exactly, as a Gait of
    one row: `drive(magnetic_pair(..., cosines=None), load_gait("result.nc"), periodic=True)` moves
    the pair with it. `timings_s`: `build` and `solve` (of all programs), `harmonic`, `optimise`
    and `check`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "as optimised"),
        "speed_simulated": (
            "speed",
            "from an exact simulation of 20 periods under the field found",
        ),
        "speed_harmonic": (
            "speed",
            "on the periodic orbit under the harmonic field, by exact simulation",
        ),
        "gain": (
            "share",
            "ratio of the last two; for `minimise` of the works per distance; unknown where the "
            "harmonic field does not move the pair, or not as fast as asked",
        ),
        "frequency": ("angular_frequency", "of the field found"),
        "frequency_harmonic": ("angular_frequency", "of the harmonic field"),
        "first_harmonic": ("share", "amplitude of the first harmonic of the field found"),
        "amplitude_harmonic": ("share", "amplitude of the harmonic field"),
        "strain_max": ("share", "largest \\|*x*<sub>2</sub> − *x*<sub>1</sub>\\|"),
        "strain_max_harmonic": ("share", "the same under the harmonic field"),
        "swing": ("share", "half of largest less smallest stretch"),
        "work_per_distance": ("energy_per_distance", "work of the field over the distance"),
        "work_per_distance_harmonic": ("energy_per_distance", "the same of the harmonic field"),
        "drift": ("share", "change of stretch and velocities over the 20 periods"),
        "drift_harmonic": ("share", "the same over the last block of `periods_harmonic`"),
        "periods_harmonic": (
            "count",
            "periods simulated until the motion under the harmonic field repeated itself",
        ),
        "push_left": (
            "share",
            "what was left at the least of a push of a thousandth, over up to 1200 periods; the "
            "simulation ends below 0.5. A warning says where it never is",
        ),
        **OPTIMUM,
    }
    variables: ClassVar = INSTANT | {
        "field": ("share", ("instant",), "field G"),
        "field_harmonic": ("share", ("instant",), "harmonic field"),
        "stretch": ("length", ("instant",), "stretch x_2 - x_1"),
        "stretch_harmonic": ("length", ("instant",), "stretch under it"),
        "position": ("length", ("mass", "instant"), "position of the mass"),
        "velocity": ("speed", ("mass", "instant"), "velocity of the mass"),
        "contact_force": ("force", ("mass", "instant"), "force of the ground"),
        "gait_breaks": ("time", ("gait_break",), "times of the field's pieces"),
        "gait_polynomial": (
            "share",
            ("gait_piece", "link", "gait_power"),
            "field, coefficients of s^k, s the time since the piece began",
        ),
    }

    kind: Literal["pair-waveform"]
    units: Annotated[
        Literal["dimensionless"], says("", "lengths over that of the link, times over √(*m*/*c*)")
    ] = "dimensionless"
    want: Annotated[
        tuple[Literal["waveform"], ...],
        says(
            "",
            "`waveform`: field, stretch and velocities over a period; the harmonic field, run "
            "through in the same time, is shifted so that its crest is that of the first harmonic",
        ),
    ] = ()
    pair: Annotated[DrivenPairTable, says("", "the pair")]
    limits: Annotated[FieldLimitsTable, says("", "what the field must keep to")]
    aim: Annotated[WaveformAimTable, says("", "what it is to be good at")]
    mesh: Annotated[MeshTable, says("", "how finely; 100 arcs if left out")] = field(
        default_factory=lambda: MeshTable(arcs=100)
    )
    search: Annotated[WaveformSearchTable, says("", "where to begin")] = field(
        default_factory=WaveformSearchTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.pair.faults()
        yield from self.limits.faults()
        yield from self.aim.faults()
