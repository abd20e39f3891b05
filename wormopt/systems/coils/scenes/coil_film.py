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
_LIGHTEST = 1e-9  # of a float over the film's mass: lighter ones take steps without number
_FARTHEST = 100  # pitches from the last coil to a wall: further out nothing moves
Tolerance = Annotated[float, Meta(ge=1e-10, le=1e-3, description="a number from 1e-10 to 1e-3")]


class ViscousFluidTable(FluidTable, frozen=True, kw_only=True):
    """A magnetic fluid that flows."""

    viscosity: Annotated[Positive, says("viscosity", "dynamic viscosity")] = 0.05


class CoilFilmTable(Table, frozen=True, kw_only=True):
    """The film, in a trough with upright walls along the row.

    Refused: a winding where the film may be, walls more than 100 pitches from the last coils.
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
        """Yield a fault if a winding is where the film may be, or the film is too long."""
        farthest = _FARTHEST * coils.pitch
        if self.overhang > farthest:
            yield (
                "film.overhang",
                f"{self.overhang:g} is more than {_FARTHEST} pitches, where no coil moves the "
                f"film; write {farthest:g} at most",
            )
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


class CargoTable(Table, frozen=True, kw_only=True):
    """A float on the film, as wide as the trough: a plate of one material, that does not magnetise.

    Its stiffness tapers to its tips, half of `edge` beyond `length` on each side. Plates that bend
    by next to nothing count as rigid alike. Refused: a start where the float is not between the
    walls, next to no mass, more than any film bears.
    """

    length: Annotated[Positive, says("length", "along the row")]
    thickness: Annotated[Positive, says("length", "of the plate")]
    density: Annotated[Positive, says("density", "of the plate")]
    modulus: Annotated[
        Positive, says("stress", "Young's: the plate resists bending by modulus thickness³ / 12")
    ] = 1e9
    start: Annotated[Finite, says("length", "place of its middle, the first coil being at 0")] = 0.0
    edge: Annotated[
        Positive | None,
        says("length", "over which its ends fade, assumed; two thirds of its length by default"),
    ] = None

    def faults(
        self, coils: CoilsTable, film: CoilFilmTable, fluid: FluidTable, gravity: float
    ) -> Iterator[Fault]:
        """Yield faults of a float that the film does not bear, has no mass, or too long ends."""
        # what it displaces at the most, and the pull of upright menisci at its ends
        borne = fluid.density * film.top * film.depth
        borne += 2 * fluid.surface_tension / (gravity * self.length)
        if self.density * self.thickness > borne:
            yield (
                "cargo.thickness",
                f"{self.thickness:g}: so heavy a float lies on the ground, however the film rises "
                f"beside it (to film.top times film.depth); write {borne / self.density:.2g} at "
                "most, or a smaller cargo.density",
            )
        lightest = _LIGHTEST * fluid.density * film.depth / self.thickness
        if self.density < lightest:
            yield (
                "cargo.density",
                f"{self.density:g}: the float has less than a billionth of the film's mass; write "
                f"{lightest:g} at least, or a larger cargo.thickness",
            )
        low = -film.overhang + self.length / 2
        high = (coils.count - 1) * coils.pitch + film.overhang - self.length / 2
        if not low <= self.start <= high:
            yield (
                "cargo.start",
                f"{self.start:g}: a float {self.length:g} long is not between the walls there; "
                + (f"write {low:g} to {high:g}" if low <= high else "write a smaller cargo.length"),
            )
        if self.edge is not None and self.edge > self.length:
            yield (
                "cargo.edge",
                f"{self.edge:g}: longer than the float; write {self.length:g} at most",
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
        "draught": ("length", "of the float where nothing moves: mass over density and length"),
        "float_travel": ("length", "way of the float"),
        "float_speed": ("speed", "the same over the time"),
        "float_captured": (
            "share",
            "of the switches after the first few in which it keeps up with the coils: comes on "
            "by at least nine tenths of a pitch",
        ),
        "float_bend": ("length", "largest departure of its underside from a straight line"),
        "float_clearance": ("length", "least thickness of the film below it"),
        "float_grid_error": ("length", "of its end place, estimated from half as many cells"),
        "energy_error": ("share", "of the work, over what is dissipated"),
        "momentum_error": ("share", "of the push, over the largest forces on the float"),
    }  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "x": ("length", ("x",), "place along the row"),
        "face": ("length", ("face",), "place between two cells"),
        "thickness": ("length", ("time", "x"), "thickness of the film"),
        "flow": ("flow_per_width", ("time", "face"), "flow to the right"),
        "coil_place": ("length", ("coil",), "place of the coil"),
        "current": ("ampere_turns", ("time", "coil"), "ampere-turns"),
        "float_position": ("length", ("time",), "place of the float's middle"),
        "float_velocity": ("speed", ("time",), "velocity of the float"),
    }
    headline: ClassVar = (
        "carried_per_switch", "thickness_max", "thickness_min", "own_field_left_out", "grid_error",
    )  # fmt: skip

    kind: Literal["coil-film"]
    want: Annotated[
        tuple[Literal["coil_film", "cargo"], ...],
        says(
            "",
            "`coil_film`: surface over place and time, at some times, and the flow; `cargo`: the "
            "float on the film at some times, to scale, and its path",
        ),
    ] = ()
    coils: Annotated[CoilsTable, says("", "the row")] = field(default_factory=CoilsTable)
    switching: Annotated[SwitchingTable, says("", "which coils are on when")]
    fluid: Annotated[ViscousFluidTable, says("", "the fluid")]
    film: Annotated[CoilFilmTable, says("", "the film")]
    cargo: Annotated[CargoTable | None, says("", "a float on the film")] = None
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
            if self.cargo:
                yield from self.cargo.faults(self.coils, self.film, self.fluid, self.gravity)
        if self.cargo is None and "cargo" in self.want:
            yield "want", 'the picture "cargo" needs a float: write a table [cargo]'
