"""Scenes of kind "harmonic-masses": masses that swing about their centre as prescribed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import AveragingTable, Tolerances, ToleranceTable
from wormopt.scene.types import (
    Finite,
    FinitePerMass,
    NonNegativePerMass,
    PerMass,
    Positive,
    SceneTable,
    Table,
    per,
    says,
    wrong_count,
)
from wormopt.systems.chain import (
    Friction,
    SpikeFriction,
    ViscousFriction,
    faults_of_law,
)
from wormopt.systems.shared.declared import TIME

# So much of the largest momentum of a mass may be left of their sum; the builder is as strict, or
# less.
_BALANCED = 5e-13
# Masses times highest harmonic: there are up to twice as many reversals in a period, and averaging
# sorts them.
_MOST = 16


class HarmonicTable(Table, frozen=True, kw_only=True):
    """One harmonic of the velocities relative to the centre.

    The velocity is Σ<sub>k</sub> *A*<sub>ik</sub> cos(*k ω t* − *φ*<sub>ik</sub>).
    """

    order: Annotated[
        int, Meta(ge=1, le=12, description="a whole number from 1 to 12"), says("count", "*k*")
    ] = 1
    amplitude: Annotated[NonNegativePerMass, says("speed", "*A*<sub>ik</sub>")]
    phase: Annotated[FinitePerMass, says("", "*φ*<sub>ik</sub>, in degrees")] = 0.0


class SwingingTable(Table, frozen=True, kw_only=True):
    """Masses with prescribed velocities relative to their centre.

    Refused: velocities of which the masses' momenta do not cancel (the message says what is left),
    masses that do not swing, orders that stand twice, friction that resists one way only.
    """

    masses: Annotated[
        int,
        Meta(ge=2, le=12, description="a whole number from 2 to 12"),
        says("count", "how many; times the highest `order` at most 16"),
    ]
    mass: Annotated[PerMass, says("mass", "point masses")] = 1.0
    frequency: Annotated[Positive, says("angular_frequency", "*ω* of the first harmonic")] = 1.0
    harmonic: Annotated[
        tuple[HarmonicTable, ...], says("", "tables `[[worm.harmonic]]`, one for each harmonic")
    ]
    friction: Annotated[
        Friction | tuple[Friction, ...],
        says("", "law of the ground, one table for all or one per mass; no spikes"),
    ]

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass."""
        return self.friction if isinstance(self.friction, tuple) else (self.friction,) * self.masses

    @property
    def coefficients(self) -> list[list[tuple[float, float]]]:
        """Cosine and sine of every harmonic up to the highest, for every mass."""
        found = [[(0.0, 0.0)] * max(h.order for h in self.harmonic) for _ in range(self.masses)]
        for harmonic in self.harmonic:
            amplitude, phase = (
                per(value, self.masses) for value in (harmonic.amplitude, harmonic.phase)
            )
            for i in range(self.masses):
                turn = math.radians(phase[i] % 360.0)
                found[i][harmonic.order - 1] = (
                    amplitude[i] * math.cos(turn),
                    amplitude[i] * math.sin(turn),
                )
        return found

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong between the keys of this table."""
        counts = [*wrong_count("worm.mass", self.mass, self.masses, "masses")]
        orders = [harmonic.order for harmonic in self.harmonic]
        if not orders:
            yield "worm.harmonic", "empty: nothing swings; write a table for each harmonic"
            return
        for index, harmonic in enumerate(self.harmonic):
            key = f"worm.harmonic[{index}]"
            for name in ("amplitude", "phase"):
                value = getattr(harmonic, name)
                counts += wrong_count(f"{key}.{name}", value, self.masses, "masses")
            if orders.index(harmonic.order) < index:
                yield f"{key}.order", f"{harmonic.order} stands there twice; write it once"
        if self.masses * max(orders) > _MOST:
            yield (
                "worm",
                f"{self.masses} masses with harmonics up to {max(orders)} reverse too often; write "
                f"fewer, their product at most {_MOST}",
            )
        yield from counts
        if not counts and len(set(orders)) == len(orders):
            yield from self._faults_of_swing()
        yield from self._faults_of_friction()

    def _faults_of_swing(self) -> Iterator[Fault]:
        masses, coefficients = per(self.mass, self.masses), self.coefficients
        sizes = [max(math.hypot(*pair) for pair in own) for own in coefficients]
        still = [str(i) for i, size in enumerate(sizes) if size == 0]
        if still:
            yield (
                "worm.harmonic",
                f"mass {', '.join(still)} does not swing; write an amplitude above 0 in a harmonic",
            )
        largest = max(m * size for m, size in zip(masses, sizes, strict=True))
        for index, harmonic in enumerate(self.harmonic):
            pairs = [own[harmonic.order - 1] for own in coefficients]
            left = [math.fsum(m * p[k] for m, p in zip(masses, pairs, strict=True)) for k in (0, 1)]
            if math.hypot(*left) > _BALANCED * largest:
                amount, phase = math.hypot(*left), math.degrees(math.atan2(left[1], left[0]))
                yield (
                    f"worm.harmonic[{index}]",
                    "velocities relative to the centre have no momentum, but masses times these "
                    f"add up to amplitude {amount:.6g} at phase {phase:.6g}; write amplitudes and "
                    "phases of which nothing is left",
                )

    def _faults_of_friction(self) -> Iterator[Fault]:
        several = isinstance(self.friction, tuple)
        if several:
            wrong = [*wrong_count("worm.friction", self.friction, self.masses, "masses", "table")]
            yield from wrong
            if wrong:
                return
        resists = {"forward": False, "backward": False}
        for i, law in enumerate(self.ground if several else self.ground[:1]):
            key = f"worm.friction[{i}]" if several else "worm.friction"
            yield from faults_of_law(key, law, 1 if several else self.masses)
            if isinstance(law, SpikeFriction):
                yield key, "spikes do not slide back, these masses must; write another kind"
                return
            for side in resists:
                name = "drag" if isinstance(law, ViscousFriction) else side
                resists[side] |= any(number > 0 for number in per(getattr(law, name), 1))
        for side in (side for side, there in resists.items() if not there):
            yield (
                "worm.friction",
                f"nothing resists motion {side}: any velocity so fast that all masses slide "
                f"{side} is steady; write some friction {side}",
            )


class CourseTable(Table, frozen=True, kw_only=True):
    """A motion to compare with."""

    velocity: Annotated[
        Finite, says("speed", "*V*, velocity of the centre, at the start of the motion shown")
    ] = 0.0
    periods: Annotated[
        int,
        Meta(ge=1, le=10_000, description="a whole number from 1 to 10000"),
        says("count", "how long it goes on"),
    ] = 60
    samples: Annotated[
        int,
        Meta(ge=2, le=1_000_000, description="a whole number from 2 to 1000000"),
        says("count", "equidistant instants kept of it, both ends included"),
    ] = 2001


class HarmonicMassesScene(SceneTable, frozen=True, kw_only=True):
    """How fast masses travel that swing about their centre, by averaging and exactly.

    Masses that actuators hold to prescribed harmonic velocities relative to their centre; the
    velocity *V* of the centre is what friction makes of it. All steady velocities by averages of
    first and second order, in closed form where there is one, and the exact periodic motion at
    each. Theory: [theory-magnetics.md](../theory-magnetics.md#3-averaging).

    A course that starts on a steady velocity, to 1e-9 of the largest, stays on it, stable or not.

    The trust report: `routes` (steady velocity by every route, `error` of the second order and
    what is `accepted`: ten squares of the ripple over the smallest swing), `averaging`
    (`change_by_doubled_nodes`, difference from the closed form), `smallness`, `exact` (velocity at
    the start of the period, drift, events, second route). The status is `failed` where twice the
    nodes give other velocities, the closed form or the second route disagrees, the exact motion
    drifts or cannot be simulated, or friction is small (`smallness` up to 0.2, no rest) and the
    second order is off by more than accepted. An exact motion missing at a steady velocity that
    the course does not tend to is only warned of. Warnings besides: friction that is not small,
    masses that rest, a course that is too short, a velocity not told from rest, no second route
    (`tolerance.recheck = false`).

    Limits: where two masses reverse at the same instant, as with *F*<sub>−</sub> = 2
    *F*<sub>+</sub> in the packaged scene, the exact motion is that of friction changed by a share
    of 1e-9, and a warning says so. Where one mass comes to rest as another begins to move, under
    large friction, it cannot be simulated.
    """

    scalars: ClassVar = {
        "velocity_steady": (
            "speed",
            "the steady *V* to which the course tends, by first order",
        ),
        "velocity_steady_second": ("speed", "the same by second order"),
        "velocity_closed_form": (
            "speed",
            "the same for dry friction and one harmonic; unknown for others",
        ),
        "velocity_exact_mean": (
            "speed",
            "displacement of the exact periodic motion over ten periods, divided by their time; "
            "unknown, as is what is over it, where it is below the error accepted (1e-7 of the "
            "largest velocity, or 1000 tolerances)",
        ),
        "averaging_error": ("speed", "difference of the first order from it"),
        "averaging_error_second": ("speed", "difference of the second order from it"),
        "stable": ("count", "whether small deviations die out"),
        "settling_time": ("time", "time in which they fall to 1/e"),
        "steady_velocities": ("speed", "all steady velocities"),
        "steady_stable": ("count", "which of them are stable"),
        "exact_velocities": ("speed", "the exact means there"),
        "advance": ("length", "way in a period"),
        "velocity_ripple": ("speed", "largest less smallest *V* of the periodic motion"),
        "exact_drift": ("speed", "by how much *V* has changed after ten periods"),
        "force_mean": ("force", "mean friction on each mass"),
        "power_mean": ("power", "of the actuators"),
        "energy_per_distance": ("energy_per_distance", "of the actuators"),
        "rest_share": ("share", "largest share of the period during which one mass rests"),
        "smallness": (
            "share",
            "impulse that friction could give in a period over the momentum of the smallest swing",
        ),
        "recheck_error": ("share", "of the periodic motion, by the second route"),
    }
    variables: ClassVar = TIME | {
        "share": ("share", ("share",), "share of the period"),
        "relative_velocity": (
            "speed",
            ("mass", "share"),
            "velocity of the mass relative to the centre",
        ),
        "center_velocity_averaged": (
            "speed",
            ("time",),
            "velocity of the centre, averaged to first order",
        ),
        "center_velocity": ("speed", ("time",), "velocity of the centre, exact"),
        "center": ("length", ("time",), "place of the centre"),
        "event_share": ("share", ("event",), "share of the period"),
        "event_contact": ("count", ("event",), "mass"),
        "event_mode": ("count", ("event",), "direction from then on, 0 at rest"),
    }

    kind: Literal["harmonic-masses"]
    want: Annotated[
        tuple[Literal["reversals"], ...],
        says("", "`reversals`: velocities over a period with their reversals, the course of *V*"),
    ] = ()
    worm: Annotated[SwingingTable, says("", "the masses")]
    course: Annotated[CourseTable, says("", "a motion to compare with")] = field(
        default_factory=CourseTable
    )
    averaging: Annotated[AveragingTable, says("", "how averages are computed")] = field(
        default_factory=AveragingTable
    )
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults()
