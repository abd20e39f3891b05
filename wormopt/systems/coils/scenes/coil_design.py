"""Scenes of kind "coil-design": currents that carry a float fastest, or with least power."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import Pair, Positive, Seed, wrong_order
from wormopt.study.given import Given, says
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


class CopperTable(Given):
    """Material of the windings; power is their resistance times the squared current."""

    resistivity: Annotated[
        Positive, says("resistivity", "resistivity of the wire; assumed: copper at 20 °C")
    ] = 1.72e-8
    fill: Annotated[Fill, says("share", "share of wire in the winding's section; assumed")] = 0.6


class CarryAimTable(Given):
    """Objective of the currents.

    A speed is refused with `seek = "speed"` and required with `seek = "power"`.
    """

    seek: Annotated[
        Literal["speed", "power"],
        says("", "`speed`: the fastest float; `power`: least power at the given `speed`"),
    ] = "speed"
    speed: Annotated[
        Positive | None, says("speed", 'required speed of the float, for `seek = "power"`')
    ] = None

    def faults(self) -> Iterator[Fault]:
        """Yield a fault if the speed is missing, or given where it has no use."""
        if self.seek == "power" and self.speed is None:
            yield "aim.speed", 'missing; seek = "power" needs the speed of the float'
        if self.seek == "speed" and self.speed is not None:
            yield "aim.speed", 'has no use with seek = "speed"; leave it out'


class PatternTable(Given):
    """Waveforms to search: one for all coils, delayed by one step from coil to coil.

    A slew limit with currents that jump is refused, as are rates in the wrong order.
    """

    form: Annotated[
        Literal["ramps", "steps"],
        says("", "`ramps`: currents change linearly between values; `steps`: they jump"),
    ] = "ramps"
    per_step: Annotated[PerStep, says("count", "number of values of the waveform per step")] = 2
    repeats: Annotated[
        tuple[Repeat, ...],
        says("count", "numbers of coils after which the pattern may repeat; each is tried"),
    ] = (5, 6, 8)
    rate: Annotated[Pair, says("rate", "least and largest number of steps per second")]
    slew: Annotated[
        Positive | None,
        says("ampere_turn_rate", "largest rate of a coil's ampere-turns; unlimited if left out"),
    ] = None

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield patterns that do not fit the row or its waveform."""
        yield from wrong_order("pattern.rate", self.rate, may_be_equal=False)
        if not self.repeats or max(self.repeats) > coils.count:
            yield (
                "pattern.repeats",
                f"{list(self.repeats)}: write one or more numbers of coils, {coils.count} at most",
            )
        if self.slew is not None and self.form == "steps":
            yield "pattern.slew", 'currents of form = "steps" jump; write form = "ramps"'


class DesignTimeTable(Given):
    """Duration for which the float is carried."""

    time: Annotated[Positive, says("time", "duration of the mean speed, starting from a flat film")]
    samples: Annotated[Samples, says("count", "number of states kept")] = 121


class DesignSearchTable(Given):
    """Effort and grid of the search."""

    starts: Annotated[
        Starts, says("count", "number of starts: best block, best mean-field wave, then next best")
    ] = 2
    generations: Annotated[Generations, says("count", "generations of evolution per start")] = 25
    size: Annotated[Size, says("count", "number of patterns in a generation")] = 12
    cells: Annotated[Coarse, says("count", "cells per pitch during the search")] = 4
    seed: Annotated[Seed, says("", "seed; equal seeds give equal searches")] = 0


class CoilDesignScene(SIScene):
    """Currents of a row of coils that carry a float on a film fastest, or with least power.

    Film, float and row are those of kind [`coil-film`](coil-film.md), with the currents as
    unknowns. All coils have the same waveform, delayed by one step from coil to coil. The search
    varies every value of the waveform and the rate. The design is compared with the best plain
    blocks and the best mean-field currents, tuned with the same simulation. Theory and open
    questions: [theory-film.md](../theory-film.md#57-currents-that-carry-it-best). `units` must be
    `"SI"`.

    The trust report has the checks `half the cells` and `smaller steps` (change of the float's
    speed), and `second integrator` (SciPy's Radau on the same equations). `limits` checks the
    currents at all times. `neighbours` is the gain of the best pattern with one value changed by a
    twentieth of the limit, or the rate by a twentieth, on the search grid. Checks of a float are as
    in `coil-film`. The report also has `searches` (each start and its result) and `rivals`. The
    optimum is local. If no search improves on the best block or wave, that is the design, with a
    warning.
    """

    scalars: ClassVar = {
        "float_speed": ("speed", "mean speed of the float with the designed currents"),
        "late_speed": ("speed", "the same over the second half of the time"),
        "mean_field_speed": ("speed", "mean speed with the best mean-field currents"),
        "block_speed": ("speed", "mean speed with the best plain block"),
        "over_mean_field": ("share", "relative gain in speed, or in power if that is minimised"),
        "over_block": ("share", "the same relative gain over the best block"),
        "power": ("power", "mean power of all coils"),
        "mean_field_power": ("power", "mean power of the best mean-field currents"),
        "block_power": ("power", "mean power of the best block"),
        "resistance": ("resistance", "resistance of one place of the row per squared turns"),
        "rate": ("rate", "steps per second"),
        "repeat": ("count", "number of coils after which the pattern repeats"),
        "wave_speed": ("speed", "pitch times steps per second"),
        "currents_max": ("ampere_turns", "largest current of a coil at any time"),
        "slew_max": ("ampere_turn_rate", "largest slope of a current; unknown if it jumps"),
        "thickness_max": ("length", "largest thickness of the film"),
        "thickness_min": ("length", "least thickness"),
        "draught": ("length", "static draught of the float: mass over density and length"),
        "float_travel": ("length", "displacement of the float"),
        "float_bend": ("length", "largest deviation of its underside from a straight line"),
        "float_clearance": ("length", "least thickness of the film below the float"),
        "float_grid_error": ("length", "error of its end place, estimated from half the cells"),
        "energy_error": ("share", "error of the work balance, relative to the dissipation"),
        "momentum_error": ("share", "error of the push, relative to the float's largest forces"),
        "neighbour_gain": ("share", "relative gain of the best neighbouring pattern"),
    }  # fmt: skip
    variables: ClassVar = {
        "time": ("time", ("time",), "time"),
        "x": ("length", ("x",), "place along the row"),
        "thickness": ("length", ("time", "x"), "thickness of the film"),
        "coil_place": ("length", ("coil",), "place of the coil"),
        "current": ("ampere_turns", ("time", "coil"), "ampere-turns"),
        "float_position": ("length", ("time",), "position of the float's middle"),
        "pattern": ("ampere_turns", ("value",), "waveform of a coil: values over a period"),
        "mean_field_pattern": ("ampere_turns", ("mean_field_value",), "the same by the mean field"),
        "block_pattern": ("ampere_turns", ("block_value",), "the same of the best block"),
        "mean_field_time": ("time", ("mean_field_time",), "time"),
        "mean_field_position": ("length", ("mean_field_time",), "position of the float's middle"),
        "block_time": ("time", ("block_time",), "time"),
        "block_position": ("length", ("block_time",), "position of the float's middle"),
    }
    headline: ClassVar = (
        "float_speed", "over_mean_field", "over_block", "power", "neighbour_gain",
    )  # fmt: skip

    kind: Literal["coil-design"]
    want: Annotated[
        tuple[Literal["coil_design"], ...],
        says("", "`coil_design`: waveforms, paths of the float, currents and film"),
    ] = ()
    aim: Annotated[CarryAimTable, says("", "objective")] = field(default_factory=CarryAimTable)
    pattern: Annotated[PatternTable, says("", "waveforms to search")]
    coils: Annotated[CoilsTable, says("", "the row; `ampere_turns` is the limit")] = field(
        default_factory=CoilsTable
    )
    copper: Annotated[CopperTable, says("", "the wire")] = field(default_factory=CopperTable)
    fluid: Annotated[ViscousFluidTable, says("", "the fluid")]
    film: Annotated[CoilFilmTable, says("", "the film")]
    cargo: Annotated[CargoTable, says("", "the float")]
    course: Annotated[DesignTimeTable, says("", "duration")]
    search: Annotated[DesignSearchTable, says("", "effort and grid of the search")] = field(
        default_factory=DesignSearchTable
    )
    grid: Annotated[CellsTable, says("", "grid of the final simulation")] = field(
        default_factory=CellsTable
    )
    gravity: Annotated[Positive, says("acceleration", "acceleration of gravity")] = 9.80665

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
