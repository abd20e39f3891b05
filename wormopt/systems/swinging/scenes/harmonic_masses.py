"""Scenes of kind "harmonic-masses": masses that swing about their centre as prescribed."""

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
    FinitePerMass,
    NonNegativePerMass,
    PerMass,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    per,
    wrong_count,
)
from wormopt.systems.chain.scenes.chain import (
    Friction,
    SpikeFriction,
    ViscousFriction,
    faults_of_law,
)

# So much of the largest momentum of a mass may be left of their sum; the builder is as strict, or
# less.
_BALANCED = 5e-13
# Masses times highest harmonic: there are up to twice as many reversals in a period, and averaging
# sorts them.
_MOST = 16


class HarmonicTable(Table, frozen=True, kw_only=True):
    """One harmonic of the velocities relative to the centre.

    Parameters
    ----------
    order : int
        Multiple of the frequency.
    amplitude : float or tuple of float
        Amplitudes, alike for all or one per mass.
    phase : float or tuple of float
        Phases in degrees; the velocity is amplitude cos(order omega t - phase).
    """

    order: Annotated[int, Meta(ge=1, le=12, description="a whole number from 1 to 12")] = 1
    amplitude: NonNegativePerMass
    phase: FinitePerMass = 0.0


class SwingingTable(Table, frozen=True, kw_only=True):
    """Masses with prescribed velocities relative to their centre.

    Parameters
    ----------
    masses : int
        How many.
    mass : float or tuple of float
        Mass, alike for all or one per mass.
    frequency : float
        Angular frequency of the first harmonic.
    harmonic : tuple of HarmonicTable
        Harmonics of the velocities.
    friction : table or tuple of tables
        Law of the ground, one table for all or one per mass.
    """

    masses: Annotated[int, Meta(ge=2, le=12, description="a whole number from 2 to 12")]
    mass: PerMass = 1.0
    frequency: Positive = 1.0
    harmonic: tuple[HarmonicTable, ...]
    friction: Friction | tuple[Friction, ...]

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
    """A motion to compare with.

    Parameters
    ----------
    velocity : float
        Velocity of the centre at its start.
    periods : int
        How many periods it goes on.
    samples : int
        Equidistant times at which it is kept, both ends included.
    """

    velocity: Finite = 0.0
    periods: Annotated[int, Meta(ge=1, le=10_000, description="a whole number from 1 to 10000")] = (
        60
    )
    samples: Annotated[
        int, Meta(ge=2, le=1_000_000, description="a whole number from 2 to 1000000")
    ] = 2001


class HarmonicMassesScene(SceneTable, frozen=True, kw_only=True):
    """How fast masses travel that swing about their centre, by averaging and exactly.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"harmonic-masses"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : SwingingTable
        The masses.
    course : CourseTable
        A motion to compare with.
    averaging : AveragingTable
        How averages are computed.
    tolerance : ToleranceTable
        How exact simulations are.
    """

    kind: Literal["harmonic-masses"]
    want: tuple[Literal["reversals"], ...] = ()
    worm: SwingingTable
    course: CourseTable = field(default_factory=CourseTable)
    averaging: AveragingTable = field(default_factory=AveragingTable)
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from self.worm.faults()
