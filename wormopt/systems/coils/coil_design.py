"""Kind "coil-design": currents that carry a float fastest, or with least power."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from msgspec import Meta, structs

from wormopt.errors import ArgumentError, Fault, SolveError
from wormopt.result import Check, Result
from wormopt.study import (
    Given,
    array,
    check,
    checks,
    entry,
    facts,
    on_use,
    positive,
    scalar,
    stage,
    warnings,
    whole,
)
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.coils.over_coils import Cargo, Cells, OverCoils
from wormopt.systems.coils.tables import Coils, Copper, DesignSearch

with on_use():
    import numpy as np

    from wormopt.model.gait import Gait
    from wormopt.numerics.workers import Workers
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.coils.design import (
        Found,
        Judged,
        Task,
        best,
        neighbours,
        rivals,
        search,
        starts_of,
    )
    from wormopt.systems.coils.patterns import Pattern, Rides, travel_by_radau

_FINE = 1e-4  # tolerance on the fine grid that distinguishes candidates
# Factors on the rates from the coarse grid that are also tried on the fine grid, because it loses
# floats at other rates.
_RATES = (1.03, 1.0, 0.97, 0.93, 0.88, 0.82)
# Most that the coarse grid may miss of a speed, as a share: it misses up to 0.8 % in the scene.
_HOPE = 0.03
_MARGIN = 1.02  # over the required speed, during the search
_NEIGHBOUR = 0.05

Repeat = Annotated[int, Meta(ge=3, le=20, description="a whole number from 3 to 20")]


class CarryAim(Given):
    """Objective of the currents.

    A speed is refused with `seek = "speed"` and required with `seek = "power"`.
    """

    seek: Literal["speed", "power"] = entry(
        "`speed`: the fastest float; `power`: least power at the given `speed`", default="speed"
    )
    speed: float | None = positive(
        "speed", 'required speed of the float, for `seek = "power"`', default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.seek == "power" and self.speed is None:
            yield "speed", 'missing; seek = "power" needs the speed of the float'
        if self.seek == "speed" and self.speed is not None:
            yield "speed", 'has no use with seek = "speed"; leave it out'


class Waveforms(Given):
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
    frequency: Pair = entry("least and largest number of steps per second", quantity="rate")
    slew: float | None = positive(
        "ampere_turn_rate",
        "largest rate of a coil's ampere-turns; unlimited if left out",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("frequency", self.frequency, may_be_equal=False)
        if self.slew is not None and self.form == "steps":
            yield "slew", 'currents of form = "steps" jump; write form = "ramps"'

    def faults_in(self, coils: Coils) -> Iterator[Fault]:
        """Yield a fault if no pattern fits the row."""
        if not self.repeats or max(self.repeats) > coils.count:
            yield (
                "pattern.repeats",
                f"{list(self.repeats)}: write one or more numbers of coils, {coils.count} at most",
            )


class CarryTime(Given):
    """Duration for which the float is carried."""

    end: float = positive("time", "duration of the mean speed, starting from a flat film")
    samples: int = whole(9, 2000, "number of states kept", default=121)


@dataclass(frozen=True, eq=False)
class Contest:
    """The design and the best rival of each sort, on the fine grid."""

    design: Judged
    block: Judged
    wave: Judged


class CoilDesign(OverCoils, kind="coil-design"):
    """Optimise the currents of a row of coils that transports a float on a film.

    Film, float and row are those of kind [`coil-film`](coil-film.md), with the currents as
    unknowns. All coils have the same waveform, delayed by one step from coil to coil. The search
    varies every value of the waveform and the rate. The design is compared with the best plain
    blocks and the best mean-field currents, tuned with the same simulation. Theory and open
    questions: [theory-film.md](../theory-film.md#57-currents-that-carry-it-best). `units` must be
    `"SI"`.

    The trust report has the checks `half the cells` and `smaller steps` (change of the float's
    speed), and `second integrator` (SciPy's Radau on the equations of the Model, which are not
    compiled). `limits` checks the currents at all times. `neighbours` is the gain of the best
    pattern with one value changed by a twentieth of the limit, or the rate by a twentieth, on the
    search grid. Checks of a float are as in `coil-film`. The report also has `searches` (each start
    and its result) and `rivals`. The optimum is local. If no search improves on the best block or
    wave, that is the design, with a warning.
    """

    pictures: ClassVar = {
        "coil_design": "waveforms, paths of the float, currents and film",
        "animation": "film, float and coils with current, as a moving GIF",
    }
    headline: ClassVar = (
        "float_speed", "over_mean_field", "over_block", "power", "neighbour_gain",
    )  # fmt: skip
    remedy = "raise film.top, grid.cells or fluid.viscosity, or lower coils.ampere_turns"

    objective: CarryAim = entry("objective", default=CarryAim)
    pattern: Waveforms = entry("waveforms to search")
    coils: Coils = entry("the row; `ampere_turns` is the limit", default=Coils)
    copper: Copper = entry("the wire", default=Copper)
    cargo: Cargo = entry("the float")
    time: CarryTime = entry("duration")
    search: DesignSearch = entry("effort and grid of the search", default=DesignSearch)
    grid: Cells = entry("grid of the final simulation", default=Cells)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.pattern.faults_in(self.coils)

    # -- the search --------------------------------------------------------------------------------

    @cached_property
    def workers(self) -> Workers:
        """Processes that simulate patterns."""
        return Workers()

    @cached_property
    def task(self) -> Task:
        """Objective and limits, on the grid of the search."""
        layer, aim, form = self.layer_of(self.search.cells), self.objective, self.pattern
        rides = Rides(**vars(self.setup(layer)), time=self.time.end)
        low, high = form.frequency
        return Task(
            rides, self.copper, aim.seek, form.form, form.per_step, (low, high), aim.speed,
            form.slew,
        )  # fmt: skip

    @property
    def sought(self) -> Task:
        """The task with a margin over the required speed."""
        speed = self.task.speed
        return self.task if speed is None else replace(self.task, speed=_MARGIN * speed)

    @property
    def finer(self) -> Rides:
        """Rides on the fine grid."""
        return replace(self.task.rides, layer=self.layer, tolerance=_FINE)

    @stage
    def blocks_and_waves(self) -> list[Judged]:
        try:
            tuned = rivals(self.sought, self.pattern.repeats, self.workers)
        except ArgumentError as error:
            raise self.too_near(error) from None
        if {one.name for one in tuned if np.isfinite(one.speed)} != {"block", "wave"}:
            reason = "no block of coils, or no mean-field wave, can be simulated to the end"
            raise SolveError(reason, self.remedy, code="not_solved")
        return tuned

    @stage
    def searches(self) -> list[Found]:
        starts = starts_of(self.blocks_and_waves, self.search.starts)
        return search(self.sought, starts, self.search, self.workers, self.report)

    @stage
    def contest(self) -> Contest:
        found = [*self.blocks_and_waves]
        found += [replace(one.end, name="design") for one in self.searches]
        jobs = [(one.name, one.pattern.paced(r, self.task.rates)) for one in found for r in _RATES]
        judged = self.on_the_fine_grid(list(self.workers.map(self.task.judge, jobs)))
        block, wave = (
            best(one for one in judged if one.name == sort) for sort in ("block", "wave")
        )
        # blocks and waves are patterns too: if nothing improves on one, it is the design
        return Contest(replace(best(judged), name="design"), block, wave)

    def on_the_fine_grid(self, coarse: Sequence[Judged]) -> list[Judged]:
        """Return the results on the fine grid of patterns that may be the best of their sort.

        Those of others would have to exceed the results on the grid of the search by `_HOPE`.
        """
        judge = replace(self.task, rides=self.finer).judge
        hopes = {
            one: self.task.value(max((1 + _HOPE) * one.speed, (1 - _HOPE) * one.speed), one.power)
            for one in coarse
        }
        judged: list[Judged] = []
        while True:
            most: dict[str, float] = {}
            for one in judged or coarse:
                most[one.name] = max(most.get(one.name, -np.inf), one.value)
            todo = [one for one, hope in hopes.items() if hope >= most[one.name]]
            if not todo:
                return judged
            judged += self.workers.map(judge, [(one.name, one.pattern) for one in todo])
            for one in todo:
                del hopes[one]

    @cached_property
    def design(self) -> Pattern:
        """The designed currents."""
        return self.contest.design.pattern

    @cached_property
    def currents(self) -> Gait:
        return self.design.course(self.coils.count)

    @cached_property
    def times(self) -> np.ndarray:
        return np.linspace(0.0, self.time.end, self.time.samples)

    @stage
    def rides_of_rivals(self) -> tuple[Ride, Ride]:
        """The float under the best mean-field currents, and under the best block."""
        alone = structs.replace(self)  # without what is computed already, as it is sent
        rivals = [one.pattern for one in (self.contest.wave, self.contest.block)]
        wave, block = self.workers.map(partial(_ride, alone), rivals)
        return wave, block

    @property
    def mean_field_ride(self) -> Ride:
        """The float under the best mean-field currents."""
        return self.rides_of_rivals[0]

    @property
    def block_ride(self) -> Ride:
        """The float under the best block."""
        return self.rides_of_rivals[1]

    # -- speed and power ---------------------------------------------------------------------------

    @scalar("speed", "mean speed of the float with the designed currents")
    def float_speed(self) -> float:
        return _ridden(self.motion).speed()

    @scalar("speed", "`float_speed` over the second half of the time")
    def late_speed(self) -> float:
        return _ridden(self.motion).speed(len(self.instants) // 2)

    @scalar("speed", "mean speed with the best mean-field currents")
    def mean_field_speed(self) -> float:
        return self.mean_field_ride.speed()

    @scalar("speed", "mean speed with the best plain block")
    def block_speed(self) -> float:
        return self.block_ride.speed()

    @scalar(
        "share", "gain over the best mean-field currents in speed, or in power if that is minimised"
    )
    def over_mean_field(self) -> float | None:
        return self.gain_over(self.mean_field_speed, self.mean_field_power)

    @scalar("share", "gain over the best block in speed, or in power if that is minimised")
    def over_block(self) -> float | None:
        return self.gain_over(self.block_speed, self.block_power)

    def gain_over(self, speed: float, power: float) -> float | None:
        """Return the relative gain of the design; unknown against a rival that is too slow."""
        if self.objective.speed is None:
            return self.float_speed / speed - 1 if speed > 0 else None
        return None if speed < 0.99 * self.objective.speed else 1 - self.power / power

    @scalar("power", "mean power of all coils")
    def power(self) -> float:
        return self.contest.design.power

    @scalar("power", "mean power of the best mean-field currents")
    def mean_field_power(self) -> float:
        return self.contest.wave.power

    @scalar("power", "mean power of the best block")
    def block_power(self) -> float:
        return self.contest.block.power

    @scalar("resistance", "resistance of one place of the row per squared turns")
    def resistance(self) -> float:
        return self.copper.resistance(self.coils.row)

    # -- the currents ------------------------------------------------------------------------------

    @scalar("rate", "steps per second")
    def rate(self) -> float:
        return self.design.rate

    @scalar("count", "number of coils after which the pattern repeats")
    def repeat(self) -> int:
        return self.design.repeat

    @scalar("speed", "pitch times steps per second")
    def wave_speed(self) -> float:
        return self.design.rate * self.coils.pitch

    @scalar("ampere_turns", "largest current of a coil at any time")
    def currents_max(self) -> float:
        return self.design.largest

    @scalar("ampere_turn_rate", "largest slope of a current; unknown if it jumps")
    def slew_max(self) -> float | None:
        return self.design.slew if np.isfinite(self.design.slew) else None

    @array("ampere_turns", "value", "waveform of a coil: values over a period", name="pattern")
    def waveform(self) -> np.ndarray:
        return self.design.values

    @array("ampere_turns", "mean_field_value", "waveform of the best mean-field currents")
    def mean_field_pattern(self) -> np.ndarray:
        return self.contest.wave.pattern.values

    @array("ampere_turns", "block_value", "waveform of the best block")
    def block_pattern(self) -> np.ndarray:
        return self.contest.block.pattern.values

    @array("time", "mean_field_time", "time")
    def mean_field_time(self) -> np.ndarray:
        return self.mean_field_ride.time

    @array("length", "mean_field_time", "position of the float's middle")
    def mean_field_position(self) -> np.ndarray:
        return self.mean_field_ride.position

    @array("time", "block_time", "time")
    def block_time(self) -> np.ndarray:
        return self.block_ride.time

    @array("length", "block_time", "position of the float's middle")
    def block_position(self) -> np.ndarray:
        return self.block_ride.position

    # -- the trust report --------------------------------------------------------------------------

    @check(
        1e-2,
        "smaller steps change the float's end by {value:.2g} of its length; lower grid.tolerance",
        name="smaller steps",
    )
    def off_by_smaller_steps(self) -> float:
        ends = (one["position"][0, -1] for one in (self.smaller_steps, self.half_the_cells))
        return float(abs(np.subtract(*ends)) / self.cargo.length)

    @cached_property
    def second_integrator(self) -> Callable[[], float]:
        """The float's travel by another integrator, computed beside other work."""
        return self.workers.start(partial(travel_by_radau, self.finer), self.design)

    @stage
    def travel_by_second_integrator(self) -> float:
        return self.second_integrator()

    def _complete(self) -> Result:
        _ = self.contest
        with self.workers:  # an interrupt or a failure ends the job
            _ = self.second_integrator  # takes longer than all other work after the contest
            return super()._complete()

    @check(
        1e-2,
        "with SciPy's Radau the float ends {value:.2g} of its length elsewhere; lower "
        "grid.tolerance",
        name="second integrator",
    )
    def off_by_second_integrator(self) -> float:
        travel = self.float_position[-1] - self.cargo.start
        return float(abs(self.travel_by_second_integrator - travel) / self.cargo.length)

    @check(1 + 1e-9, "currents reach {value:.4g} of a limit")
    def limits(self) -> float:
        """Largest current and slope over their limits, from all pieces of the Gait."""
        begin, slope = self.currents.polynomial[:, :, 0], self.currents.polynomial[:, :, 1]
        lengths = np.diff(self.currents.breaks)[:, None]
        largest = max(np.abs(begin).max(), np.abs(begin + slope * lengths).max())
        found = largest / self.coils.ampere_turns
        if self.pattern.slew is not None:
            found = max(found, np.abs(slope).max() / self.pattern.slew)
        return float(found)

    @stage
    def neighbouring_patterns(self) -> list[Judged]:
        return neighbours(self.task, self.design, _NEIGHBOUR, self.workers)

    @scalar("share", "relative gain of the best neighbouring pattern")
    def neighbour_gain(self) -> float:
        here = self.task.judge(("design", self.design))
        gain = max(best(self.neighbouring_patterns).value - here.value, 0.0)
        if self.objective.seek == "speed":
            gain /= abs(here.speed) or gain or 1.0
        return float(gain)

    @check(0.05, "a neighbouring pattern is better by {value:.2g}; raise search.generations")
    def neighbours(self) -> float:
        return self.neighbour_gain

    @checks
    def required_speed(self) -> Iterator[Check]:
        if self.objective.speed is not None:
            short = max(1 - self.float_speed / self.objective.speed, 0.0)
            yield Check(
                "speed kept", short, 0.01,
                f"the float is slower than objective.speed by {short:.2g}; lower objective.speed, "
                "or raise coils.ampere_turns or the frequencies",
            )  # fmt: skip

    @facts
    def starts_and_results(self) -> dict[str, Any]:
        return {
            "rivals": [_summary(one) for one in self.blocks_and_waves],
            "searches": [
                {"start": _summary(one.start), "end": _summary(one.end)} for one in self.searches
            ],
            "search_cells": self.task.rides.layer.cells,
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        yield "the optimum is local: better currents may exist"
        yield (
            f"power is that of the wire alone, with assumed resistivity "
            f"{self.copper.resistivity:g} ohm m and fill {self.copper.fill:g}"
        )
        yield from self.coils.too_hot(self.currents_max)
        yield from self.warnings_of_float()
        wall = (self.coils.count - 1) * self.coils.pitch + self.film.overhang
        if self.cargo.start + self.float_numbers.float_travel > wall - self.cargo.length:
            yield "the wall stops the float near it; write more coils, or a shorter time.end"
        for sort in (self.contest.block, self.contest.wave):
            if sort.pattern is self.design:
                yield f"no search improved on the best {sort.name}, so this is the design"
        ends = [one.end.value for one in self.searches]
        if len(ends) > 1 and abs(ends[0] - ends[-1]) > 0.01 * abs(ends[0]):
            yield "searches from different starts ended in different optima"
        low, high = self.pattern.frequency
        if not 1.01 * low < self.rate < 0.99 * high:
            yield f"the rate is at an end of pattern.frequency: {self.rate:.3g}; widen it"


class Ride(NamedTuple):
    """Path of a float."""

    time: np.ndarray
    position: np.ndarray

    def speed(self, begin: int = 0) -> float:
        """Mean speed from the sample `begin` on."""
        X, t = self.position, self.time
        return float((X[-1] - X[begin]) / (t[-1] - t[begin]))


def _ridden(motion: Trajectory) -> Ride:
    return Ride(motion.time, motion["position"][0])


def _ride(study: CoilDesign, pattern: Pattern) -> Ride:
    """Simulate film and float under a pattern."""
    currents = pattern.course(study.coils.count)
    try:
        return _ridden(study.follow(currents, study.layer, study.grid.tolerance))
    except SolveError as error:  # a Trajectory cannot be sent
        raise SolveError(error.reason, error.suggestion, code=error.code) from None


def _summary(one: Judged) -> dict[str, Any]:
    return {
        "sort": one.name, "repeat": one.pattern.repeat, "rate": one.pattern.rate,
        "speed": one.speed, "power": one.power,
    }  # fmt: skip
