"""Scenes of kind "coil-design": currents that carry a float fastest, or with least power."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import Pair, Positive, Seed, Table, says, wrong_order
from wormopt.systems.coils.scenes.coil_film import (
    CargoTable,
    CellsTable,
    CoilFilmTable,
    ViscousFluidTable,
)
from wormopt.systems.coils.scenes.coil_rows import CoilsTable
from wormopt.systems.coils.scenes.material import SIScene

Repeat = Annotated[int, Meta(ge=3, le=20, description="a whole number from 3 to 20")]
PerStep = Annotated[int, Meta(ge=1, le=8, description="a whole number from 1 to 8")]
Samples = Annotated[int, Meta(ge=9, le=2000, description="a whole number from 9 to 2000")]
Starts = Annotated[int, Meta(ge=1, le=20, description="a whole number from 1 to 20")]
Generations = Annotated[int, Meta(ge=1, le=1000, description="a whole number from 1 to 1000")]
Size = Annotated[int, Meta(ge=6, le=200, description="a whole number from 6 to 200")]
Coarse = Annotated[int, Meta(ge=2, le=32, description="a whole number from 2 to 32")]
Fill = Annotated[float, Meta(gt=0, le=1, description="a number above 0 and at most 1")]


class CopperTable(Table, frozen=True, kw_only=True):
    """What the windings are made of: power is its resistance times the current's square."""

    resistivity: Annotated[
        Positive, says("resistivity", "of the wire; assumed: copper at 20 °C")
    ] = 1.72e-8
    fill: Annotated[Fill, says("share", "of the winding's section that is wire; assumed")] = 0.6


class CarryAimTable(Table, frozen=True, kw_only=True):
    """What currents are wanted for.

    Refused: a speed with `seek = "speed"`, none with `"power"`.
    """

    seek: Annotated[
        Literal["speed", "power"],
        says("", "the float as fast as can be; or as fast as `speed` says, with least power"),
    ] = "speed"
    speed: Annotated[
        Positive | None, says("speed", 'that the float shall have, for `seek = "power"`')
    ] = None

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the speed is missing, or one too many."""
        if self.seek == "power" and self.speed is None:
            yield "aim.speed", 'seek = "power" needs the speed that the float shall have: write it'
        if self.seek == "speed" and self.speed is not None:
            yield "aim.speed", 'nothing is kept to with seek = "speed": leave it out'


class PatternTable(Table, frozen=True, kw_only=True):
    """Which currents are looked at: one course for all coils, each a step later than the last.

    Refused: a slew with currents that jump, rates in the wrong order.
    """

    form: Annotated[
        Literal["ramps", "steps"],
        says("", "currents change linearly from value to value, or hold each and jump"),
    ] = "ramps"
    per_step: Annotated[PerStep, says("count", "values of a course in a step")] = 2
    repeats: Annotated[
        tuple[Repeat, ...],
        says("count", "after how many coils a pattern may repeat; each is tried"),
    ] = (5, 6, 8)
    rate: Annotated[Pair, says("rate", "least and most steps a second")]
    slew: Annotated[
        Positive | None,
        says("ampere_turn_rate", "largest change of a coil's ampere-turns; any if left out"),
    ] = None

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield what cannot be."""
        yield from wrong_order("pattern.rate", self.rate, may_be_equal=False)
        if not self.repeats or max(self.repeats) > coils.count:
            yield (
                "pattern.repeats",
                f"{list(self.repeats)}: write one or more numbers of coils, {coils.count} at most",
            )
        if self.slew is not None and self.form == "steps":
            yield "pattern.slew", 'currents of form = "steps" jump; write form = "ramps"'


class DesignTimeTable(Table, frozen=True, kw_only=True):
    """How long the float is carried."""

    time: Annotated[Positive, says("time", "over which the mean speed is taken, from a flat film")]
    samples: Annotated[Samples, says("count", "states kept")] = 121


class DesignSearchTable(Table, frozen=True, kw_only=True):
    """How long currents are sought, and on which grid."""

    starts: Annotated[
        Starts, says("count", "best block and best wave of the mean field, then the next best")
    ] = 2
    generations: Annotated[Generations, says("count", "of the evolution from each start")] = 25
    size: Annotated[Size, says("count", "patterns in a generation")] = 12
    cells: Annotated[Coarse, says("count", "cells per pitch while searching")] = 4
    seed: Annotated[Seed, says("", "the same seed gives the same search")] = 0


class CoilDesignScene(SIScene, frozen=True, kw_only=True):
    """Currents of a row of coils that carry a float on a film fastest, or with least power.

    Film, float and row of kind [`coil-film`](coil-film.md) in full, the currents free: all coils
    have one course, each a step later than its neighbour, and every value of it is sought, and the
    rate. Held against the best plain blocks and the best currents by the mean field, tuned by the
    same simulation. Theory, and what is not known:
    [theory-film.md](../theory-film.md#57-currents-that-carry-it-best). `units` must be `"SI"`.

    The trust report: checks `half the cells`, `smaller steps` (change of the float's speed),
    `second integrator` (SciPy's Radau on the same equations), `limits` (of the currents at all
    times), `neighbours` (share by which a pattern is better of which one value is changed by a
    twentieth of the limit, or the rate by a twentieth, on the grid of the search), those of a float
    as for `coil-film`; `searches` (each start and what it led to), `rivals`. The optimum is local;
    where no search betters the best block or wave, that is the design, with a warning.
    """

    scalars: ClassVar = {
        "float_speed": ("speed", "mean speed of the float with the currents found"),
        "late_speed": ("speed", "the same over the second half of the time"),
        "mean_field_speed": ("speed", "with the best currents by the mean field"),
        "block_speed": ("speed", "with the best plain block"),
        "over_mean_field": ("share", "by which the design is better; of power, if that is sought"),
        "over_block": ("share", "the same over the best block"),
        "power": ("power", "mean, of all coils"),
        "mean_field_power": ("power", "mean, with the best currents by the mean field"),
        "block_power": ("power", "mean, with the best block"),
        "resistance": ("resistance", "of a place of the row over the square of the turns"),
        "rate": ("rate", "steps a second"),
        "repeat": ("count", "coils after which the pattern repeats"),
        "wave_speed": ("speed", "pitch times steps a second"),
        "currents_max": ("ampere_turns", "largest of a coil, at all times"),
        "slew_max": ("ampere_turn_rate", "largest slope of a current; unknown where it jumps"),
        "thickness_max": ("length", "largest thickness of the film"),
        "thickness_min": ("length", "least thickness"),
        "draught": ("length", "of the float where nothing moves: mass over density and length"),
        "float_travel": ("length", "way of the float"),
        "float_bend": ("length", "largest departure of its underside from a straight line"),
        "float_clearance": ("length", "least thickness of the film below it"),
        "float_grid_error": ("length", "of its end place, estimated from half as many cells"),
        "energy_error": ("share", "of the work, over what is dissipated"),
        "momentum_error": ("share", "of the push, over the largest forces on the float"),
        "neighbour_gain": ("share", "by which the best neighbour is better"),
    }  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "x": ("length", ("x",), "place along the row"),
        "thickness": ("length", ("time", "x"), "thickness of the film"),
        "coil_place": ("length", ("coil",), "place of the coil"),
        "current": ("ampere_turns", ("time", "coil"), "ampere-turns"),
        "float_position": ("length", ("time",), "place of the float's middle"),
        "pattern": ("ampere_turns", ("value",), "course of a coil: values over a period"),
        "mean_field_pattern": ("ampere_turns", ("mean_field_value",), "the same by the mean field"),
        "block_pattern": ("ampere_turns", ("block_value",), "the same of the best block"),
        "mean_field_time": ("time", ("mean_field_time",), "time"),
        "mean_field_position": ("length", ("mean_field_time",), "place of the float's middle"),
        "block_time": ("time", ("block_time",), "time"),
        "block_position": ("length", ("block_time",), "place of the float's middle"),
    }
    headline: ClassVar = (
        "float_speed", "over_mean_field", "over_block", "power", "neighbour_gain",
    )  # fmt: skip

    kind: Literal["coil-design"]
    want: Annotated[
        tuple[Literal["coil_design"], ...],
        says("", "`coil_design`: the courses of a coil, the float's ways, currents and film"),
    ] = ()
    aim: Annotated[CarryAimTable, says("", "what is sought")] = field(default_factory=CarryAimTable)
    pattern: Annotated[PatternTable, says("", "which currents")]
    coils: Annotated[CoilsTable, says("", "the row; `ampere_turns` is the limit")] = field(
        default_factory=CoilsTable
    )
    copper: Annotated[CopperTable, says("", "the wire")] = field(default_factory=CopperTable)
    fluid: Annotated[ViscousFluidTable, says("", "the fluid")]
    film: Annotated[CoilFilmTable, says("", "the film")]
    cargo: Annotated[CargoTable, says("", "the float")]
    course: Annotated[DesignTimeTable, says("", "how far")]
    search: Annotated[DesignSearchTable, says("", "how long it is sought")] = field(
        default_factory=DesignSearchTable
    )
    grid: Annotated[CellsTable, says("", "how finely it is checked")] = field(
        default_factory=CellsTable
    )
    gravity: Annotated[Positive, says("acceleration", "of the fall")] = 9.80665

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        coil_faults = list(self.coils.faults())
        yield from coil_faults
        yield from self.aim.faults()
        yield from self.pattern.faults(self.coils)
        if coil_faults:
            return
        yield from self.film.faults(self.coils)
        yield from self.cargo.faults(self.coils, self.film, self.fluid, self.gravity)
