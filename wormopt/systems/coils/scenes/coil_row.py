"""Scenes of kind "coil-row": the field of a row of coils that are switched in turn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
)
from wormopt.systems.coils.scenes.material import faults_of_units

Count = Annotated[int, Meta(ge=1, le=200, description="a whole number from 1 to 200")]
Margin = Annotated[int, Meta(ge=0, le=100, description="a whole number from 0 to 100")]


class CoilsTable(Table, frozen=True, kw_only=True):
    """A row of equal coils; sizes that the chapter does not tell are assumptions.

    Parameters
    ----------
    count : int
        Number of coils, or of pairs of them.
    pitch : float
        Distance of neighbours, m.
    inner, outer, length : float
        Radii of the winding and its length along the axis, m.
    ampere_turns : float
        Largest ampere-turns of a coil.
    axis : {"across", "along", "vertical"}
        Direction of the coils' axes: horizontal across the row, along it, or upright.
    gap : float, optional
        Two coils at each place face each other over this gap, m; one coil if left out.
    """

    count: Count = 20
    pitch: Positive = 10e-3
    inner: Positive = 2e-3
    outer: Positive = 4.5e-3
    length: Positive = 20e-3
    ampere_turns: Positive = 3000.0
    axis: Literal["across", "along", "vertical"] = "across"
    gap: Positive | None = None

    def faults(self) -> Iterator[Fault]:
        """Yield what cannot be built."""
        if self.inner >= self.outer:
            yield (
                "coils.inner",
                f"{self.inner:g} is not below coils.outer = {self.outer:g}; the winding lies "
                "between both: write the smaller radius here",
            )
        size, what = 2 * self.outer, "twice coils.outer"
        if self.axis == "along":
            size, what = self.length, "coils.length"
        if self.pitch < size:
            yield (
                "coils.pitch",
                f"{self.pitch:g} is below {what} = {size:g}: the coils overlap; write at least "
                f"{size:g}, or smaller coils",
            )
        if self.gap is not None and self.axis == "along":
            yield "coils.gap", 'coils with axis = "along" do not face each other; leave it out'


class LineTable(Table, frozen=True, kw_only=True):
    """The line of the fluid, along x.

    Parameters
    ----------
    height : float
        Height of it above the middle of the coils (of the gap, where there is one), m; below it
        negative.
    margin : int
        So many coils at each end of the row are left out where a profile is taken.
    """

    height: Finite
    margin: Margin = 3

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield a fault if the line goes through a winding, or nothing is left of it."""
        low, high = _taken(coils)
        if low <= abs(self.height) <= high:
            inside = f", or nearer to the middle than {low:g}" if low else ""
            yield (
                "line.height",
                f"{self.height:g}: a coil inside the fluid; the line goes through windings, which "
                f"reach from {low:g} to {high:g}: write a height beyond {high:g}{inside}",
            )
        if 2 * self.margin >= coils.count - 1:
            yield (
                "line.margin",
                f"{self.margin} coils at each end leave nothing of {coils.count}; write at most "
                f"{max((coils.count - 2) // 2, 0)}",
            )


def _taken(coils: CoilsTable) -> tuple[float, float]:
    """Heights between which a line along the row meets windings, above and below alike."""
    if coils.axis == "along":
        return coils.inner, coils.outer
    if coils.axis == "across":
        return (0.0, coils.outer) if coils.gap is None else (1.0, 0.0)
    if coils.gap is None:
        return 0.0, coils.length / 2
    return coils.gap / 2, coils.gap / 2 + coils.length


class SwitchingTable(Table, frozen=True, kw_only=True):
    """Blocks of coils that are on, shifted by one coil again and again.

    Parameters
    ----------
    rate : float
        Switches per second, the chapter's n.
    on : int
        Coils of a block.
    every : int, optional
        The pattern repeats after so many coils; one block in the whole row if left out.
    ampere_turns : float, optional
        Of each coil that is on; the largest the coils carry if left out.
    """

    rate: Positive
    on: Count = 3
    every: Count | None = None
    ampere_turns: NonNegative | None = None

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield what the row cannot do, as key path and message."""
        every = coils.count if self.every is None else self.every
        if every > coils.count:
            yield (
                "switching.every",
                f"{every} is more than the {coils.count} coils of the row; write at most that",
            )
        elif self.on > every:
            yield (
                "switching.on",
                f"{self.on} coils do not fit into a pattern of {every}; write at most that",
            )
        if self.ampere_turns is not None and self.ampere_turns > coils.ampere_turns:
            yield (
                "switching.ampere_turns",
                f"{self.ampere_turns:g} is above what the coils carry; write at most "
                f"coils.ampere_turns = {coils.ampere_turns:g}",
            )


class CoilRowScene(SceneTable, frozen=True, kw_only=True):
    """The travelling field of a row of coils that are switched in turn.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"coil-row"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"SI"}
        Numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    coils : CoilsTable
        The row.
    line : LineTable
        Where the fluid is.
    switching : SwitchingTable
        Which coils are on when.
    """

    kind: Literal["coil-row"]
    want: tuple[Literal["travelling_field"], ...] = ()
    coils: CoilsTable = field(default_factory=CoilsTable)
    line: LineTable
    switching: SwitchingTable

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        yield from faults_of_units(self.units)
        yield from self.coils.faults()
        yield from self.line.faults(self.coils)
        yield from self.switching.faults(self.coils)
