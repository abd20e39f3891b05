"""Scenes of kind "coil-design": currents that carry a float fastest, or with least power."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Pair, Seed, wrong_order
from wormopt.systems.coils.scenes.coil_film import (
    CargoTable,
    CellsTable,
    CoilFilmTable,
    ViscousFluidTable,
)
from wormopt.systems.coils.scenes.coil_rows import CoilsTable
from wormopt.systems.coils.scenes.material import SIScene

Repeat = Annotated[int, Meta(ge=3, le=20, description="a whole number from 3 to 20")]


class CopperTable(Given):
    """Material of the windings; power is their resistance times the squared current."""

    resistivity: float = positive(
        "resistivity", "resistivity of the wire; assumed: copper at 20 °C", default=1.72e-8
    )
    fill: float = number(
        "share", "share of wire in the winding's section; assumed", above=0, most=1, default=0.6
    )


class CarryAimTable(Given):
    """Objective of the currents.

    A speed is refused with `seek = "speed"` and required with `seek = "power"`.
    """

    seek: Literal["speed", "power"] = entry(
        "`speed`: the fastest float; `power`: least power at the given `speed`", default="speed"
    )
    speed: float | None = positive(
        "speed", 'required speed of the float, for `seek = "power"`', default=None
    )

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

    form: Literal["ramps", "steps"] = entry(
        "`ramps`: currents change linearly between values; `steps`: they jump", default="ramps"
    )
    per_step: int = whole(1, 8, "number of values of the waveform per step", default=2)
    repeats: tuple[Repeat, ...] = entry(
        "numbers of coils after which the pattern may repeat; each is tried",
        quantity="count",
        default=(5, 6, 8),
    )
    rate: Pair = entry("least and largest number of steps per second", quantity="rate")
    slew: float | None = positive(
        "ampere_turn_rate",
        "largest rate of a coil's ampere-turns; unlimited if left out",
        default=None,
    )

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

    time: float = positive("time", "duration of the mean speed, starting from a flat film")
    samples: int = whole(9, 2000, "number of states kept", default=121)


class DesignSearchTable(Given):
    """Effort and grid of the search."""

    starts: int = whole(
        1, 20, "number of starts: best block, best mean-field wave, then next best", default=2
    )
    generations: int = whole(1, 1000, "generations of evolution per start", default=25)
    size: int = whole(6, 200, "number of patterns in a generation", default=12)
    cells: int = whole(2, 32, "cells per pitch during the search", default=4)
    seed: Seed = entry("seed; equal seeds give equal searches", default=0)


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
    want: tuple[Literal["coil_design"], ...] = entry(
        "`coil_design`: waveforms, paths of the float, currents and film", default=()
    )
    aim: CarryAimTable = entry("objective", default=CarryAimTable)
    pattern: PatternTable = entry("waveforms to search")
    coils: CoilsTable = entry("the row; `ampere_turns` is the limit", default=CoilsTable)
    copper: CopperTable = entry("the wire", default=CopperTable)
    fluid: ViscousFluidTable = entry("the fluid")
    film: CoilFilmTable = entry("the film")
    cargo: CargoTable = entry("the float")
    course: DesignTimeTable = entry("duration")
    search: DesignSearchTable = entry("effort and grid of the search", default=DesignSearchTable)
    grid: CellsTable = entry("grid of the final simulation", default=CellsTable)
    gravity: float = positive("acceleration", "acceleration of gravity", default=9.80665)

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
