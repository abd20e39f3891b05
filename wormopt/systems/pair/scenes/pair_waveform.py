"""Tables of scenes of kind "pair-waveform": the best field of a magneto-elastic pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, positive, says, whole
from wormopt.study.numerics import MeshTable
from wormopt.study.types import (
    NonNegative,
    PositiveOrPair,
    SceneTable,
    Seed,
    per,
    wrong_order,
)
from wormopt.systems.chain import CoulombFriction, Friction, faults_of_law
from wormopt.systems.pair.tables import NATURAL
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

FieldRange = Annotated[
    tuple[NonNegative, ...],
    Meta(min_length=2, max_length=2, description="two numbers, 0 or above, [least, largest]"),
]


class DrivenPairTable(Given):
    """Two masses on a magneto-elastic link, dimensionless."""

    eps: float = positive("share", "push of the field over stiffness times length")
    friction: Friction = entry(
        'friction law of the ground, with `kind = "coulomb"`; forces over the push, equal or '
        "one per mass; weaker forward than backward"
    )

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        law, wrong = self.friction, list(faults_of_law("pair.friction", self.friction, 2))
        yield from wrong
        if not isinstance(law, CoulombFriction):
            yield "pair.friction", 'is not supported; write kind = "coulomb"'
        elif not wrong and sum(per(law.forward, 2)) >= sum(per(law.backward, 2)):
            yield (
                "pair.friction",
                "is not weaker forward than backward, so the pair does not move forward; write "
                "forward below backward",
            )


class FieldLimitsTable(Given):
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
    def frequency_range(self) -> tuple[float, float]:
        """Least and largest frequency."""
        if isinstance(self.frequency, tuple):
            return self.frequency[0], self.frequency[1]
        return self.frequency, self.frequency

    def faults(self) -> Iterator[Fault]:
        """Yield ranges whose bounds are in the wrong order, and those with an unbounded swing."""
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
            f"where {which} makes the swing and the speed grow without bound: write the largest "
            "strain, for example 0.8, or frequencies on one side",
        )


class WaveformAimTable(Given):
    """Objective of the waveform: exactly one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry("mean speed", default=None)
    minimise: Literal["work_per_distance"] | None = entry(
        "net work of the field over the distance; requires `speed`", default=None
    )
    speed: float | None = positive("speed", "lower limit of the mean speed", default=None)

    def faults(self) -> Iterator[Fault]:
        """Yield conflicts between the keys."""
        if (self.maximise is None) == (self.minimise is None):
            yield (
                "aim",
                'needs exactly one of maximise = "speed" and minimise = "work_per_distance"',
            )
        elif self.minimise and self.speed is None:
            yield (
                "aim.speed",
                "missing, and without it the cheapest motion is rest; write the least mean speed",
            )
        elif self.maximise and self.speed is not None:
            yield "aim.speed", 'applies to minimise = "work_per_distance" only; leave it out'


class WaveformSearchTable(Given):
    """Starting points of the search."""

    starts: int = whole(
        1,
        100,
        "number of starts: the harmonic field, then random fields of three harmonics",
        default=1,
    )
    seed: Seed = entry("seed of the starts", default=0)


class PairWaveformScene(SceneTable):
    """The periodic field that moves the pair fastest, or with the least work.

    The magneto-elastic pair (eq. 16 of Zimmermann et al. 2007) moves in the best field, and for
    comparison in a harmonic field within the same limits. Velocities repeat after a period,
    positions repeat up to the advance. Friction is exact dry friction. See
    [optimal.md](../optimal.md#the-field-of-a-magneto-elastic-pair). The scene is dimensionless:
    lengths over that of the link, times over √(*m*/*c*).

    The mean of the harmonic field is the middle of `limits.field`. It has the largest amplitude
    that range, slope and strain allow (for `minimise`: the smallest with the required speed), at
    the best frequency of the range. If its mean alone, applied at rest, stretches the link beyond
    `limits.strain`, a warning says so, `gain` is unknown, and the search starts from the fastest
    harmonic field about a lower mean. The same holds if that strain leaves a harmonic field too
    weak to move the pair. If the pair rests in the first field, four random fields are tried.

    `input_rms` and `input_peak` are those of *G*, with a slope limit those of *G*′. The arrays
    contain the instants at which arcs join twice. `gait_breaks` and `gait_polynomial` are the exact
    field, as a Gait of one row: `drive(magnetic_pair(..., cosines=None), load_gait("result.nc"),
    periodic=True)` moves the pair with it. `timings_s`: `build` and `solve` (of all programs),
    `harmonic`, `optimise` and `check`.
    """

    scalars: ClassVar = {
        "speed": ("speed", "mean speed of the optimiser"),
        "speed_simulated": (
            "speed",
            "mean speed of an exact simulation over 20 periods in the field found",
        ),
        "speed_harmonic": (
            "speed",
            "mean speed of the periodic orbit in the harmonic field, by exact simulation",
        ),
        "gain": (
            "share",
            "ratio of the last two; for `minimise` of the works per distance; unknown where the "
            "harmonic field does not move the pair, or not at the required speed",
        ),
        "frequency": ("angular_frequency", "frequency of the field found"),
        "frequency_harmonic": ("angular_frequency", "frequency of the harmonic field"),
        "first_harmonic": ("share", "amplitude of the first harmonic of the field found"),
        "amplitude_harmonic": ("share", "amplitude of the harmonic field"),
        "strain_max": ("share", "largest \\|*x*<sub>2</sub> − *x*<sub>1</sub>\\|"),
        "strain_max_harmonic": (
            "share",
            "largest \\|*x*<sub>2</sub> − *x*<sub>1</sub>\\| in the harmonic field",
        ),
        "swing": ("share", "half the difference of largest and smallest stretch"),
        "work_per_distance": ("energy_per_distance", "work of the field over the distance"),
        "work_per_distance_harmonic": (
            "energy_per_distance",
            "work of the harmonic field over the distance",
        ),
        "drift": ("share", "change of stretch and velocities over the 20 periods"),
        "drift_harmonic": (
            "share",
            "change of stretch and velocities over the last block of `periods_harmonic`",
        ),
        "periods_harmonic": (
            "count",
            "periods until the motion in the harmonic field was periodic",
        ),
        "push_left": (
            "share",
            "least remaining share of a push of a thousandth, over up to 1200 periods; the "
            "simulation ends below 0.5. A warning appears if it is never below",
        ),
        **OPTIMUM,
    }
    variables: ClassVar = INSTANT | {
        "field": ("share", ("instant",), "field G"),
        "field_harmonic": ("share", ("instant",), "harmonic field"),
        "stretch": ("length", ("instant",), "stretch x_2 - x_1"),
        "stretch_harmonic": ("length", ("instant",), "stretch in the harmonic field"),
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
    units: Literal["dimensionless"] = entry(
        "lengths over that of the link, times over √(*m*/*c*)", default="dimensionless"
    )
    want: tuple[Literal["waveform"], ...] = entry(
        "`waveform`: field, stretch and velocities over a period; the harmonic field, scaled "
        "to the same period, is shifted so its crest is that of the first harmonic",
        default=(),
    )
    pair: DrivenPairTable = entry("the pair")
    limits: FieldLimitsTable = entry("limits of the field")
    aim: WaveformAimTable = entry("objective of the waveform")
    mesh: Annotated[MeshTable, says("", "mesh in time; default: 100 arcs")] = field(
        default_factory=lambda: MeshTable(arcs=100)
    )
    search: WaveformSearchTable = entry(
        "starting points of the search", default=WaveformSearchTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from self.pair.faults()
        yield from self.limits.faults()
        yield from self.aim.faults()
