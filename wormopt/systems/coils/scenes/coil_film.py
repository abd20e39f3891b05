"""Scenes of kind "coil-film": a film of magnetic fluid over a row of coils switched in turn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import Finite, Positive, Table, says
from wormopt.systems.coils.scenes.coil_rows import CoilsTable, SwitchingTable
from wormopt.systems.coils.scenes.hydrostatics import FluidTable
from wormopt.systems.coils.scenes.material import SIScene

Cells = Annotated[int, Meta(ge=2, le=64, description="a whole number from 2 to 64")]
Switches = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Samples = Annotated[int, Meta(ge=1, le=64, description="a whole number from 1 to 64")]
Top = Annotated[float, Meta(gt=1, le=20, description="a number above 1 and at most 20")]
Tolerance = Annotated[float, Meta(ge=1e-10, le=1e-3, description="a number from 1e-10 to 1e-3")]


class ViscousFluidTable(FluidTable, frozen=True, kw_only=True):
    """A magnetic fluid that flows."""

    viscosity: Annotated[Positive, says("viscosity", "dynamic viscosity")] = 0.05


class CoilFilmTable(Table, frozen=True, kw_only=True):
    """The film, in a trough with upright walls along the row.

    Refused: a winding where the film may be.
    """

    depth: Annotated[Positive, says("length", "thickness without field")]
    ground: Annotated[
        Finite,
        says("length", "height of the ground above the middle of the coils, or of the gap"),
    ]
    overhang: Annotated[
        Positive, says("length", "from the middles of the last coils to the walls")
    ] = 20e-3
    top: Annotated[
        Top, says("share", "greatest thickness over `depth` that may occur; more is a failure")
    ] = 4.0
    own_field: Annotated[
        bool, says("", "whether the fluid weakens the field across it, as a flat layer does")
    ] = True

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield a fault if a winding is where the film may be."""
        low, high = coils.taken
        bottom, top = self.ground, self.ground + self.top * self.depth
        # the row is alike above its middle and below it
        nearest = 0.0 if bottom <= 0 <= top else min(abs(bottom), abs(top))
        if low <= high and nearest <= high and max(abs(bottom), abs(top)) >= low:
            yield (
                "film.ground",
                f"{self.ground:g}: a coil inside the fluid, which may reach from there to {top:g} "
                f"(film.top times film.depth higher); windings take {low:g} to {high:g} from the "
                f"middle: write a ground above {high:g}",
            )


class SwitchedTimeTable(Table, frozen=True, kw_only=True):
    """How long the film is followed."""

    switches: Annotated[Switches, says("count", "steps of switching, the first from a flat film")]
    samples: Annotated[Samples, says("count", "states kept in each step")] = 4


class CellsTable(Table, frozen=True, kw_only=True):
    """How finely it is computed."""

    cells: Annotated[Cells, says("count", "cells per pitch; checked against half as many")] = 12
    tolerance: Annotated[Tolerance, says("share", "error of a step in time")] = 1e-5


class CoilFilmScene(SIScene, frozen=True, kw_only=True):
    """A film of magnetic fluid that a row of coils moves, switched in turn.

    Thin-film flow with weight, surface tension, viscosity and the field of all coils at the
    surface, ripple and ends included, followed in time from a flat film. Theory and assumptions:
    [theory-film.md](../theory-film.md#5-a-film-over-switched-coils). `units` must be `"SI"`.

    The trust report: checks `half the cells` (largest difference of the end state from that on
    half as many cells, over the depth; about a third of it is the error on all of them), `smaller
    steps` (the same for a tenth of the tolerance), `volume`, `top`, `field` (at the surface,
    against the row's own formula), `flat surface` (the normal-field instability); `warnings`
    (what lubrication and the flat layer's field leave out).
    """

    scalars: ClassVar = {
        "carried": ("area", "fluid that passed the middle of the row, per width"),
        "carried_per_switch": ("area", "the same in the mean of the switches"),
        "thickness_max": ("length", "largest thickness"),
        "thickness_min": ("length", "least thickness"),
        "slope_max": ("1", "largest \\|*h*′\\|"),
        "wave_speed": ("speed", "pitch times switches a second"),
        "relaxation_time": (
            "time", "in which a ripple of a flat film dies out that is as long as a block of coils",
        ),
        "capillary_length": ("length", "√(γ/ρ*g*)"),
        "normal_field_number": (
            "share",
            "most of weight and surface tension that a field across a flat film takes; above 1 it "
            "breaks up into peaks (Rosensweig)",
        ),
        "own_field_left_out": (
            "share",
            "change of the field by the film's own ripples, which is left out: bound of the "
            "share of weight and surface tension that it takes or adds, by first harmonics",
        ),
        "inertia": ("share", "ε*Re*, which is left out: ρ × flow × slope over the viscosity"),
        "grid_error": ("share", "of the end state, estimated from half as many cells"),
        "step_error": ("share", "of the end state, by a tenth of the tolerance"),
        "volume_error": ("share", "largest change of the volume"),
    }  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "x": ("length", ("x",), "place along the row"),
        "face": ("length", ("face",), "place between two cells"),
        "thickness": ("length", ("time", "x"), "thickness of the film"),
        "flow": ("flow_per_width", ("time", "face"), "flow to the right"),
        "coil_place": ("length", ("coil",), "place of the coil"),
        "current": ("ampere_turns", ("time", "coil"), "ampere-turns"),
    }
    headline: ClassVar = (
        "carried_per_switch", "thickness_max", "thickness_min", "own_field_left_out", "grid_error",
    )  # fmt: skip

    kind: Literal["coil-film"]
    want: Annotated[
        tuple[Literal["coil_film"], ...],
        says("", "`coil_film`: surface over place and time, at some times, and the flow"),
    ] = ()
    coils: Annotated[CoilsTable, says("", "the row")] = field(default_factory=CoilsTable)
    switching: Annotated[SwitchingTable, says("", "which coils are on when")]
    fluid: Annotated[ViscousFluidTable, says("", "the fluid")]
    film: Annotated[CoilFilmTable, says("", "the film")]
    course: Annotated[SwitchedTimeTable, says("", "how long it is followed")]
    grid: Annotated[CellsTable, says("", "how finely")] = field(default_factory=CellsTable)
    gravity: Annotated[Positive, says("acceleration", "of the fall")] = 9.80665

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        coil_faults = list(self.coils.faults())
        yield from coil_faults
        yield from self.switching.faults(self.coils)
        if not coil_faults:
            yield from self.film.faults(self.coils)
