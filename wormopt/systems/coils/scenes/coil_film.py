"""Scenes of kind "coil-film": a film of magnetic fluid over a row of coils switched in turn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.systems.coils.scenes.coil_rows import CoilsTable, SwitchingTable
from wormopt.systems.coils.scenes.hydrostatics import FluidTable
from wormopt.systems.coils.scenes.material import SIScene

Samples = Annotated[int, Meta(ge=1, le=64, description="a whole number from 1 to 64")]
_LIGHTEST = 1e-9  # least mass of a float over the film's: lighter ones need too many steps
_FARTHEST = 100  # largest distance from the last coil to a wall, in pitches
Tolerance = Annotated[float, Meta(ge=1e-10, le=1e-3, description="a number from 1e-10 to 1e-3")]


class ViscousFluidTable(FluidTable):
    """A magnetic fluid that flows."""

    viscosity: float = positive("viscosity", "dynamic viscosity", default=0.05)


class CoilFilmTable(Given):
    """The film, in a trough with upright walls along the row.

    A film that may reach a winding is refused, as are walls more than 100 pitches from the last
    coils.
    """

    depth: float = positive("length", "thickness without field")
    ground: float = number(
        "length", "height of the ground above the middle of the coils, or of the gap"
    )
    overhang: float = positive(
        "length", "distance from the last coils' middles to the walls", default=20e-3
    )
    top: float = number(
        "share",
        "largest thickness over `depth` accepted; more is a failure",
        above=1,
        most=20,
        default=4.0,
    )
    own_field: bool = entry(
        "whether the fluid reduces the field across it, as in a flat layer", default=True
    )

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield a fault if the film may reach a winding, or is too long."""
        farthest = _FARTHEST * coils.pitch
        if self.overhang > farthest:
            yield (
                "film.overhang",
                f"{self.overhang:g} is more than {_FARTHEST} pitches, where no coil moves the "
                f"film; write {farthest:g} at most",
            )
        low, high = coils.taken
        bottom, top = self.ground, self.ground + self.top * self.depth
        # the row is symmetric about its middle height
        nearest = 0.0 if bottom <= 0 <= top else min(abs(bottom), abs(top))
        if low <= high and nearest <= high and max(abs(bottom), abs(top)) >= low:
            yield (
                "film.ground",
                f"{self.ground:g} puts a coil inside the fluid, which may reach from there to "
                f"{top:g} (by film.top times film.depth); windings reach from {low:g} to {high:g} "
                f"from the middle; write a ground above {high:g}",
            )


class CargoTable(Given):
    """A float on the film, as wide as the trough: a non-magnetic plate of one material.

    Its stiffness tapers to its tips over half of `edge` beyond `length` on each side. Plates with
    negligible bending count as rigid. A start with the float outside the walls is refused, as are
    almost no mass and a mass above what the film carries.
    """

    length: float = positive("length", "length along the row")
    thickness: float = positive("length", "thickness of the plate")
    density: float = positive("density", "density of the plate")
    modulus: float = positive(
        "stress", "Young's modulus; bending stiffness is modulus thickness³ / 12", default=1e9
    )
    start: float = number("length", "initial position of its middle; coil 0 is at 0", default=0.0)
    edge: float | None = positive(
        "length",
        "length of its tapered ends, assumed; two thirds of `length` if left out",
        default=None,
    )

    def faults(
        self, coils: CoilsTable, film: CoilFilmTable, fluid: FluidTable, gravity: float
    ) -> Iterator[Fault]:
        """Yield faults of a float that the film cannot carry, without mass, or with long ends."""
        # largest displaced fluid, and the pull of upright menisci at its ends
        borne = fluid.density * film.top * film.depth
        borne += 2 * fluid.surface_tension / (gravity * self.length)
        if self.density * self.thickness > borne:
            yield (
                "cargo.thickness",
                f"{self.thickness:g}: this float is so heavy that it lies on the ground, for any "
                f"height of the film (up to film.top times film.depth); write at most "
                f"{borne / self.density:.2g}, or a smaller cargo.density",
            )
        lightest = _LIGHTEST * fluid.density * film.depth / self.thickness
        if self.density < lightest:
            yield (
                "cargo.density",
                f"{self.density:g}: the float has less than a billionth of the film's mass; write "
                f"at least {lightest:g}, or a larger cargo.thickness",
            )
        low = -film.overhang + self.length / 2
        high = (coils.count - 1) * coils.pitch + film.overhang - self.length / 2
        if not low <= self.start <= high:
            yield (
                "cargo.start",
                f"{self.start:g}: a float of length {self.length:g} is not between the walls; "
                + (f"write {low:g} to {high:g}" if low <= high else "write a smaller cargo.length"),
            )
        if self.edge is not None and self.edge > self.length:
            yield (
                "cargo.edge",
                f"{self.edge:g} exceeds the length of the float; write {self.length:g} at most",
            )


class SwitchedTimeTable(Given):
    """Duration of the simulation."""

    switches: int = whole(1, 1000, "switching steps, the first from a flat film")
    samples: int = whole(1, 64, "number of states kept in each step", default=4)


class CellsTable(Given):
    """Resolution in space and time."""

    cells: int = whole(2, 64, "cells per pitch; compared with half as many", default=12)
    tolerance: float = number(
        "share", "relative tolerance of a time step", least=1e-10, most=0.001, default=1e-5
    )


class CoilFilmScene(SIScene):
    """A film of magnetic fluid moved by a row of coils that are switched in turn.

    The thin-film equation has weight, surface tension, viscosity, and the field of all coils at the
    surface, with its ripple and the ends of the row. The simulation starts from a flat film. Theory
    and assumptions: [theory-film.md](../theory-film.md#5-a-film-over-switched-coils). `units` must
    be `"SI"`.

    The trust report has the check `half the cells`: the largest difference of the end state to
    that on half the cells, over the depth. About a third of it is the error on all cells. Further
    checks are `smaller steps` (the same for a tenth of the tolerance), `volume`, `top`, `field` (at
    the surface, against the row's own formula), and `flat surface` (normal-field instability).
    `warnings` report effects that lubrication and the flat layer's field neglect.
    """

    scalars: ClassVar = {
        "carried": ("area", "fluid that passed the middle of the row, per width"),
        "carried_per_switch": ("area", "the same per switch, on average"),
        "thickness_max": ("length", "largest thickness"),
        "thickness_min": ("length", "least thickness"),
        "slope_max": ("1", "largest \\|*h*′\\|"),
        "wave_speed": ("speed", "pitch times switches per second"),
        "relaxation_time": (
            "time", "decay time of a ripple of a flat film as long as a block of coils",
        ),
        "capillary_length": ("length", "√(γ/ρ*g*)"),
        "normal_field_number": (
            "share",
            "largest share of weight and surface tension that the field across a flat film "
            "cancels; above 1 the film forms peaks (Rosensweig)",
        ),
        "own_field_left_out": (
            "share",
            "neglected change of the field by the film's ripples: bound, by first harmonics, of "
            "its share of weight and surface tension",
        ),
        "inertia": ("share", "neglected inertia ε*Re*: ρ × flow × slope over the viscosity"),
        "grid_error": ("share", "error of the end state, estimated from half the cells"),
        "step_error": ("share", "change of the end state at a tenth of the tolerance"),
        "volume_error": ("share", "largest relative change of the volume"),
        "draught": ("length", "static draught of the float: mass over density and length"),
        "float_travel": ("length", "displacement of the float"),
        "float_speed": ("speed", "mean speed of the float"),
        "float_captured": (
            "share",
            "share of switches, after the first few, in which it keeps up with the coils: moves by "
            "at least nine tenths of a pitch",
        ),
        "float_bend": ("length", "largest deviation of its underside from a straight line"),
        "float_clearance": ("length", "least thickness of the film below the float"),
        "float_grid_error": ("length", "error of its end place, estimated from half the cells"),
        "energy_error": ("share", "error of the work balance, relative to the dissipation"),
        "momentum_error": ("share", "error of the push, relative to the float's largest forces"),
    }  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "x": ("length", ("x",), "position along the row"),
        "face": ("length", ("face",), "position of the face between two cells"),
        "thickness": ("length", ("time", "x"), "thickness of the film"),
        "flow": ("flow_per_width", ("time", "face"), "flow to the right"),
        "coil_place": ("length", ("coil",), "position of the coil"),
        "current": ("ampere_turns", ("time", "coil"), "ampere-turns"),
        "float_position": ("length", ("time",), "position of the float's middle"),
        "float_velocity": ("speed", ("time",), "velocity of the float"),
    }
    headline: ClassVar = (
        "carried_per_switch", "thickness_max", "thickness_min", "own_field_left_out", "grid_error",
    )  # fmt: skip

    kind: Literal["coil-film"]
    want: tuple[Literal["coil_film", "cargo"], ...] = entry(
        "`coil_film`: surface over place and time, at a few times, and the flow; `cargo`: the "
        "float on the film at a few times, to scale, and its path",
        default=(),
    )
    coils: CoilsTable = entry("the row", default=CoilsTable)
    switching: SwitchingTable = entry("sequence of active coils")
    fluid: ViscousFluidTable = entry("the fluid")
    film: CoilFilmTable = entry("the film")
    cargo: CargoTable | None = entry("a float on the film", default=None)
    course: SwitchedTimeTable = entry("duration")
    grid: CellsTable = entry("resolution", default=CellsTable)
    gravity: float = positive("acceleration", "acceleration of gravity", default=9.80665)

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
            yield "want", 'the plot "cargo" needs a float; write a table [cargo]'
