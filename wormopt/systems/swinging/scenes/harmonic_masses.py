"""Tables of scenes of kind "harmonic-masses": masses with prescribed oscillations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from msgspec import field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole, wrong_count
from wormopt.study.numerics import AveragingTable, Tolerances, ToleranceTable
from wormopt.study.types import (
    FinitePerMass,
    NonNegativePerMass,
    PerMass,
    SceneTable,
    per,
)
from wormopt.systems.chain import (
    Friction,
    SpikeFriction,
    ViscousFriction,
    faults_of_law,
)
from wormopt.systems.shared.declared import TIME

# Accepted sum of the momenta, as a share of the largest of a mass; the builder is as strict, or
# less.
_BALANCED = 5e-13
# Masses times highest harmonic: there are up to twice as many reversals in a period, and averaging
# sorts them.
_MOST = 16


class HarmonicTable(Given):
    """A harmonic of the velocities relative to the centre.

    The velocity is Σ<sub>k</sub> *A*<sub>ik</sub> cos(*k ω t* − *φ*<sub>ik</sub>).
    """

    order: int = whole(1, 12, "*k*", default=1)
    amplitude: NonNegativePerMass = entry("amplitudes *A*<sub>ik</sub>", quantity="speed")
    phase: FinitePerMass = entry("phases *φ*<sub>ik</sub> in degrees", default=0.0)


class SwingingTable(Given):
    """Masses with prescribed velocities relative to their centre.

    Not allowed: velocities with a total momentum other than 0 (the message gives its value), masses
    without oscillation, repeated orders, friction in one direction only.
    """

    masses: int = whole(2, 12, "number of masses; times the highest `order` at most 16")
    mass: PerMass = entry("point masses", quantity="mass", default=1.0)
    frequency: float = positive(
        "angular_frequency", "angular frequency *ω* of the first harmonic", default=1.0
    )
    harmonic: tuple[HarmonicTable, ...] = entry("tables `[[worm.harmonic]]`, one for each harmonic")
    friction: Friction | tuple[Friction, ...] = entry(
        "friction law of the ground, one table for all masses or one per mass; no spikes"
    )

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass."""
        return self.friction if isinstance(self.friction, tuple) else (self.friction,) * self.masses

    @property
    def coefficients(self) -> list[list[tuple[float, float]]]:
        """Cosine and sine amplitudes of every harmonic up to the highest, for every mass."""
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
            yield "worm.harmonic", "is empty, so no mass swings; write a table for each harmonic"
            return
        for index, harmonic in enumerate(self.harmonic):
            key = f"worm.harmonic[{index}]"
            for name in ("amplitude", "phase"):
                value = getattr(harmonic, name)
                counts += wrong_count(f"{key}.{name}", value, self.masses, "masses")
            if orders.index(harmonic.order) < index:
                yield f"{key}.order", f"repeats order {harmonic.order}; write each once"
        if self.masses * max(orders) > _MOST:
            yield (
                "worm",
                f"has {self.masses} masses with harmonics up to {max(orders)}, which reverse too "
                f"often; write fewer, their product at most {_MOST}",
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
                    "velocities relative to the centre must have no total momentum, but masses "
                    f"times these add up to amplitude {amount:.6g} at phase {phase:.6g}; write "
                    "amplitudes and phases whose sum is 0",
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
                yield key, "spikes do not slide back, but these masses must; write another kind"
                return
            for side in resists:
                name = "drag" if isinstance(law, ViscousFriction) else side
                resists[side] |= any(number > 0 for number in per(getattr(law, name), 1))
        for side in (side for side, there in resists.items() if not there):
            yield (
                "worm.friction",
                f"has no resistance to motion {side}: every velocity at which all masses slide "
                f"{side} is steady; write friction {side}",
            )


class CourseTable(Given):
    """A simulated motion for comparison."""

    velocity: float = number("speed", "initial velocity *V* of the centre", default=0.0)
    periods: int = whole(1, 10000, "duration in periods", default=60)
    samples: int = whole(
        2,
        1000000,
        "number of equidistant instants in the result, including both ends",
        default=2001,
    )


class HarmonicMassesScene(SceneTable):
    """Velocity of masses with prescribed oscillations about their centre, averaged and exact.

    Actuators hold the masses to prescribed harmonic velocities relative to their centre; friction
    determines the velocity *V* of the centre. The result contains all steady velocities by averages
    of first and second order, in closed form where one exists, and the exact periodic motion at
    each. Theory: [theory-magnetics.md](../theory-magnetics.md#3-averaging).

    A motion that starts on a steady velocity, to 1e-9 of the largest, stays on it, whether it is
    stable or not.

    The trust report has `routes` (steady velocity by every route, `error` of the second order and
    the `accepted` value: ten squares of the ripple over the least amplitude), `averaging`
    (`change_by_doubled_nodes`, difference from the closed form), `smallness`, and `exact` (velocity
    at the start of the period, drift, events, second route).

    The status is `failed` where twice the nodes give other velocities, the closed form or the
    second route disagrees, or the exact motion drifts or cannot be simulated. It is also `failed`
    where friction is small (`smallness` up to 0.2, no rest) and the error of second order exceeds
    the accepted value. A missing exact motion at a steady velocity to which the motion does not
    converge only gives a warning. Further warnings: friction that is not small, masses that rest, a
    motion that is too short, a velocity that may be zero, no second route (`tolerance.recheck =
    false`).
    """

    scalars: ClassVar = {
        "velocity_steady": (
            "speed",
            "steady *V* to which the motion converges, in first order",
        ),
        "velocity_steady_second": ("speed", "the same in second order"),
        "velocity_closed_form": (
            "speed",
            "the same for dry friction and one harmonic; unknown for others",
        ),
        "velocity_exact_mean": (
            "speed",
            "displacement of the exact periodic motion over ten periods, divided by their "
            "duration; this and quantities divided by it are unknown below the accepted error "
            "(1e-7 of the largest velocity, or 1000 tolerances)",
        ),
        "averaging_error": ("speed", "difference between first order and the exact mean"),
        "averaging_error_second": ("speed", "difference between second order and the exact mean"),
        "stable": ("count", "whether small deviations decay"),
        "settling_time": ("time", "time constant of their decay"),
        "steady_velocities": ("speed", "all steady velocities"),
        "steady_stable": ("count", "whether each of them is stable"),
        "exact_velocities": ("speed", "exact mean velocities at these"),
        "advance": ("length", "displacement in a period"),
        "velocity_ripple": ("speed", "difference of largest and least *V* in the periodic motion"),
        "exact_drift": ("speed", "change of *V* after ten periods"),
        "force_mean": ("force", "mean friction on each mass"),
        "power_mean": ("power", "mean power of the actuators"),
        "energy_per_distance": ("energy_per_distance", "energy of the actuators over distance"),
        "rest_share": ("share", "largest share of the period during which one mass rests"),
        "smallness": (
            "share",
            "largest impulse of friction in a period over the least momentum amplitude",
        ),
        "recheck_error": ("share", "error of the second route for the periodic motion"),
    }
    variables: ClassVar = TIME | {
        "share": ("share", ("share",), "time as a share of the period"),
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
        "center_velocity": ("speed", ("time",), "exact velocity of the centre"),
        "center": ("length", ("time",), "position of the centre"),
        "event_share": ("share", ("event",), "time of the event as a share of the period"),
        "event_contact": ("count", ("event",), "mass"),
        "event_mode": ("count", ("event",), "direction from then on, 0 at rest"),
    }

    kind: Literal["harmonic-masses"]
    want: tuple[Literal["reversals"], ...] = entry(
        "`reversals`: velocities over a period with their reversals, *V* over time", default=()
    )
    worm: SwingingTable = entry("the masses")
    course: CourseTable = entry("a simulated motion for comparison", default=CourseTable)
    averaging: AveragingTable = entry("computation of the averages", default=AveragingTable)
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults()
