"""Tables that several kinds of coils share: the row, its switching, its wire, and a fluid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Literal

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, positive, whole
from wormopt.study.types import Seed
from wormopt.systems.shared.studies import wrong_winding

with on_use():
    from wormopt.magnetics.coils import Coil, CoilRow
    from wormopt.magnetics.hydrostatics import Fluid, Langevin, Linear
    from wormopt.magnetics.travelling import switched_course
    from wormopt.model.gait import Gait
    from wormopt.systems.coils.patterns import Pattern

# Current density that copper carries for long without cooling, in A/m².
_DENSITY = 5e6
# Least gap of facing coils over their length; smaller gaps are lost in round-off.
_LEAST_GAP = 1e-12


class Coils(Given):
    """A row of equal coils.

    Sizes marked *assumed* are not published in Zimmermann et al. 2007 [[1]](../references.md). That
    these values belong together is also an assumption: 20 coils and 3000 ampere-turns are from its
    section 3.5, the pitch is from section 3.4.

    Coils that overlap are refused.
    """

    count: int = whole(1, 200, "number of places along the row; 20 in section 3.5", default=20)
    pitch: float = positive("length", "distance of neighbours; from section 3.4", default=10e-3)
    inner_radius: float = positive("length", "inner radius of the winding; assumed", default=2e-3)
    outer_radius: float = positive("length", "outer radius of the winding; assumed", default=4.5e-3)
    length: float = positive("length", "axial length of the winding; assumed", default=20e-3)
    ampere_turns: float = positive(
        "ampere_turns", "largest ampere-turns of a coil; 3000 in section 3.5", default=3000.0
    )
    axis: Literal["across", "along", "vertical"] = entry(
        "direction of the coils' axes: horizontal across the row (*y*), along it (*x*) or "
        "upright (*z*)",
        default="across",
    )
    gap: float | None = positive(
        "length",
        "gap between two facing coils at each place; a single coil if left out",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_winding(self.inner_radius, self.outer_radius)
        size, what = 2 * self.outer_radius, "twice coils.outer_radius"
        if self.axis == "along":
            size, what = self.length, "coils.length"
        if self.pitch < size:
            yield (
                "pitch",
                f"{self.pitch:g} is below {what} = {size:g}, so the coils overlap; write at least "
                f"{size:g}, or smaller coils",
            )
        if self.gap is not None and self.axis == "along":
            yield "gap", 'coils with axis = "along" do not face each other; leave it out'
        elif self.gap is not None and self.gap < _LEAST_GAP * self.length:
            yield (
                "gap",
                f"{self.gap:g} is lost in round-off beside coils.length = {self.length:g}; write "
                f"at least {_LEAST_GAP * self.length:.3g}",
            )

    @cached_property
    def row(self) -> CoilRow:
        """The row as the formulas take it."""
        coil = Coil(self.inner_radius, self.outer_radius, self.length, self.ampere_turns)
        return CoilRow(coil, self.count, self.pitch, self.axis, self.gap)

    @property
    def section(self) -> float:
        """Section of a winding, in m²."""
        return self.length * (self.outer_radius - self.inner_radius)

    @property
    def taken(self) -> tuple[float, float]:
        """Heights between which a line along the row meets windings, symmetric above and below."""
        if self.axis == "along":
            return self.inner_radius, self.outer_radius
        if self.axis == "across":
            return (0.0, self.outer_radius) if self.gap is None else (1.0, 0.0)
        if self.gap is None:
            return 0.0, self.length / 2
        return self.gap / 2, self.gap / 2 + self.length

    def too_hot(self, largest: float) -> Iterator[str]:
        """Yield a warning if copper cannot carry `largest` ampere-turns for long."""
        density = largest / self.section
        if density > _DENSITY:
            yield (
                f"{density / 1e6:.3g} A/mm² over the whole section of the winding; without cooling "
                f"copper carries about {_DENSITY / 1e6:g} for long"
            )


class Switching(Given):
    """Blocks of active coils, shifted by one coil at every switch.

    More ampere-turns than the coils carry are refused.
    """

    frequency: float = positive("rate", "switches per second, *n* of Zimmermann et al.")
    on: int = whole(1, 200, "number of coils in a block", default=3)
    every: int | None = whole(
        1,
        200,
        "number of coils after which the pattern repeats; a single block if left out",
        default=None,
    )
    ampere_turns: float | None = number(
        "ampere_turns",
        "ampere-turns of an active coil; `coils.ampere_turns` if left out",
        least=0,
        default=None,
    )

    def faults_in(self, coils: Coils) -> Iterator[Fault]:
        """Yield patterns and currents beyond the limits of the row."""
        every = coils.count if self.every is None else self.every
        if every > coils.count:
            yield (
                "switching.every",
                f"{every} exceeds the {coils.count} coils of the row; write at most that",
            )
        elif self.on > every:
            yield (
                "switching.on",
                f"{self.on} coils do not fit into a pattern of {every}; write at most that",
            )
        if self.ampere_turns is not None and self.ampere_turns > coils.ampere_turns:
            yield (
                "switching.ampere_turns",
                f"{self.ampere_turns:g} exceeds the limit of the coils; write at most "
                f"coils.ampere_turns = {coils.ampere_turns:g}",
            )

    def amount(self, coils: Coils) -> float:
        """Return the ampere-turns of an active coil."""
        return coils.ampere_turns if self.ampere_turns is None else self.ampere_turns

    def currents(self, coils: Coils) -> Gait:
        """Return the ampere-turns of all coils over time."""
        return switched_course(
            coils.count, self.amount(coils), self.frequency, on=self.on, every=self.every
        )


class Copper(Given):
    """Material of the windings; power is their resistance times the squared current."""

    resistivity: float = positive(
        "resistivity", "resistivity of the wire; assumed: copper at 20 °C", default=1.72e-8
    )
    fill: float = number(
        "share", "share of wire in the winding's section; assumed", above=0, most=1, default=0.6
    )

    def resistance(self, row: CoilRow) -> float:
        """Return the resistance of a place of the row over the squared turns, in ohm.

        The mean length of a turn is pi (inner + outer), because the current fills the section
        uniformly.
        """
        coil, sides = row.coil, 1 if row.gap is None else 2
        section = (coil.outer - coil.inner) * coil.length
        return (
            sides * self.resistivity * math.pi * (coil.inner + coil.outer) / (self.fill * section)
        )

    def power(self, row: CoilRow, pattern: Pattern) -> float:
        """Return the mean power of all coils over a period, in W."""
        return self.resistance(row) * row.count * pattern.square


class DesignSearch(Given):
    """Effort and grid of the search."""

    starts: int = whole(
        1, 20, "number of starts: best block, best mean-field wave, then next best", default=2
    )
    generations: int = whole(1, 1000, "generations of evolution per start", default=25)
    size: int = whole(6, 200, "number of patterns in a generation", default=12)
    cells: int = whole(2, 32, "cells per pitch during the search", default=4)
    seed: Seed = entry("seed; equal seeds give equal searches", default=0)


class MagneticFluid(Given):
    """A magnetic fluid."""

    chi: float = positive("1", "susceptibility; with `saturation`, the initial one")
    density: float = positive("density", "density of the fluid", default=1200.0)
    surface_tension: float = positive("surface_tension", "surface tension", default=0.03)
    saturation: float | None = positive(
        "magnetic_field",
        "saturation magnetisation, for Langevin's law; if left out, magnetisation is linear in "
        "the field",
        default=None,
    )

    def under(self, gravity: float) -> Fluid:
        """Return the fluid as the formulas take it."""
        law: Linear | Langevin = Linear(self.chi)
        if self.saturation is not None:
            law = Langevin(self.chi, self.saturation)
        return Fluid(self.density, self.surface_tension, law, gravity)
