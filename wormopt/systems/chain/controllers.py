"""Controllers of a comparison: their settings, plans in advance, and motions on all plants."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import Given, entry, number, on_use, positive, whole
from wormopt.study.numerics import TimeSpan, ToleranceTable
from wormopt.study.types import Pair, Title, wrong_order
from wormopt.systems.chain.crawl_tables import Aim, CrawlLimits
from wormopt.systems.chain.hardware import Hardware
from wormopt.systems.chain.predictive import DrawnPlants
from wormopt.systems.chain.tables import Tube
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.spiked import Shape

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.control.hardware import NOISE
    from wormopt.control.loop import Reference, gait_reference
    from wormopt.control.lqr import lqr
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model, Switch, pack
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.contact import Complementarity
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Motion
    from wormopt.ocp.optimise import Optimum, optimise
    from wormopt.ocp.switching import optimise_switching_times
    from wormopt.progress import silent
    from wormopt.simulation.ensemble import Scenario, simulate_ensemble
    from wormopt.simulation.options import Exact, Tolerance
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.chain.copies import Draw
    from wormopt.systems.chain.drawn import Drawn
    from wormopt.systems.chain.dynamic import crawl_problem, sine_guess
    from wormopt.systems.chain.measured import (
        Balance,
        balance,
        chain_checks,
        funnel_checks,
        judged,
        judged_numbers,
    )
    from wormopt.systems.chain.optimal_tracking import knowing, lengths_of
    from wormopt.systems.chain.predictive import loose_tolerance
    from wormopt.systems.shared.proof import CrossCheck, cross_check
    from wormopt.systems.shared.signals import sample, simulate_whole
    from wormopt.systems.spiked import GaitProblem, Limits, Objective, Search, Worm, designed

# Pieces of a designed gait shorter than this share of the period are left out.
_SHORT = 1e-6
# Of motions of drawn plants.
_SAMPLES = 501
# By hardware that is not ideal: error in tube radii, and number of steps, beyond which a plant is
# lost.
_LOST, _PATIENCE = 10.0, 100_000
# Cubics per arc for a link length in the crawl's exact motion, whose arcs are long.
_PARTS = 6


class DesignedShape(Given, tag_field="shape", tag="designed"):
    """The fastest gait in which one mass after the other rests, tail first, within limits.

    The gait is designed when the scene runs, as in scenes of [kind `gait-design`](gait-design.md),
    with unit masses.
    """

    period: float = positive("time", "period")
    length: Pair = entry("shortest and longest length of every link", quantity="length")
    rate: float = positive("speed", "upper limit of |*l*′|")
    acceleration: float = positive("acceleration", "upper limit of |*l*″|")
    load: float = number(
        "force",
        "force against forward motion on each mass, which the spikes must hold",
        least=0,
        default=0.0,
    )

    def faults(self, links: int, folder: Path, key: str = "gait") -> Iterator[Fault]:
        """Yield what is wrong between the keys; `key` is the key path of this table."""
        yield from wrong_order(f"{key}.length", self.length, may_be_equal=False)

    def gait(self, links: int) -> Gait:
        """Design the gait, without phases of nearly zero duration, which cost time in all uses."""
        limits = Limits(self.period, self.length, rate=self.rate, acceleration=self.acceleration)
        order = Search(sequence=tuple((i,) for i in range(links, -1, -1)))
        problem = GaitProblem(Worm(links, load=self.load), limits, Objective())
        found = designed(problem, order, silent).gait
        lasting = np.diff(found.breaks) > _SHORT * found.period
        breaks = np.concatenate([[0.0], np.cumsum(np.diff(found.breaks)[lasting])])
        return Gait(breaks, found.polynomial[lasting]).with_period(found.period)


class NamedReference(Given):
    """A reference gait."""

    name: Title = entry("name in tables and pictures")
    gait: Shape | DesignedShape = entry("the gait; `shape` selects the other keys")


class Draws(DrawnPlants):
    """Plants with drawn parameters.

    Each parameter is drawn independently from a uniform distribution around its nominal value.
    """

    members: int = whole(2, 10000, "number of drawn plants")
    known: int = whole(
        0,
        1000,
        "number of plants, from the first on, for which every plan is made anew with the true "
        "parameters",
        default=0,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.known > self.members:
            yield "known", f"is more than draws.members = {self.members}; write less"


class LqrWeights(Given):
    """Weights of the Riccati equation of LQR with feed-forward."""

    error_weight: float = positive("", "weight of |*e*|²")
    rate_weight: float = number("", "weight of |*e*′|²", least=0, default=0.0)
    input_weight: float = positive(
        "", "weight of the squared correction to the feed-forward", default=1.0
    )

    def close(self, plant: Model, reference: Reference, feedforward: Gait | None = None) -> Model:
        """Close the loop; without `feedforward`, that of the reference is used."""
        return lqr(
            plant,
            reference,
            error_weight=self.error_weight,
            rate_weight=self.rate_weight,
            input_weight=self.input_weight,
            feedforward=feedforward,
        )


class OptimalTracking(Given):
    """Optimal tracking, and the least input that keeps the error in the tube."""

    input_weight: float = positive("", "*ρ* in ∫(|*e*|² + *ρ*|*u*|²) d*t*")
    margin: float = number(
        "share",
        "share of the tube's radius that the optimiser keeps free",
        least=0,
        below=1,
        default=0.02,
    )


class Crawl(Given):
    """The crawl that maximises the mean speed minus a weight times the mean of |*u*|².

    It does not follow a reference.
    """

    period: float = positive("time", "period of the crawl")
    length: Pair = entry("shortest and longest length of every link", quantity="length")
    force: float = positive("force", "upper limit of |*u*<sub>j</sub>|")
    input_weight: float = number("", "weight of the mean of |*u*|²", least=0, default=1e-3)
    arcs: int = whole(10, 1000, "arcs over a period in the first solve", default=60)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("length", self.length, may_be_equal=False)

    def optimum(self, plant: Model) -> Optimum:
        """Find the crawl with relaxed contact; SolveError if there is none."""
        limits = CrawlLimits(period=self.period, actuator_force=self.force, length=self.length)
        problem = crawl_problem(plant, limits, Aim(maximise="speed", effort=self.input_weight))
        mesh = Mesh.even(1, self.arcs, Collocation(2, "radau"))
        relaxed = Complementarity(residual=1e-3, first=1.0)
        return optimise(problem, mesh, relaxed, sine_guess(plant, self.period, self.force))


@dataclass(frozen=True, eq=False)
class Controller:
    """A controller of the comparison."""

    name: str
    model: Model  # without inputs; output ``error`` against the reference
    # inputs on the drawn plants, where they are not those of the model; None: there are none
    others: tuple[Gait | None, ...] | None = None


# -- plans -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plan:
    """An input and the corresponding link lengths as functions of time, one row per link."""

    inputs: Gait
    lengths: Gait
    periodic: bool

    @classmethod
    def of(cls, motion: Motion, periodic: bool, parts: int = 1) -> Plan:
        """Plan of an optimal motion, with `parts` cubics per arc for the lengths."""
        return cls(motion.input_course(), lengths_of(motion, parts), periodic)


@dataclass(frozen=True, eq=False)
class Planned:
    """Plans of one kind; None where none was found."""

    nominal: Plan | None
    known: tuple[Plan | None, ...]  # for plants with known parameters
    iterations: int = 0  # of the solves for the nominal plant
    # statistics of these solves, time taken by all, or why there is no plan
    numbers: dict[str, float | str] = field(default_factory=dict)


def make_plans(
    find: Callable[[], Optimum], draws: Sequence[Draw], *, periodic: bool, seconds: float | None
) -> Planned:
    """Plan for the nominal plant by `find`, then again for each drawn plant.

    A solve for a drawn plant takes at most `seconds`. Periodic plans are computed with exact
    contact if possible. A plan that is not found is None; no exception is raised.
    """
    begin = time.perf_counter()
    try:
        optimum = find()
    except SolveError as error:
        return Planned(None, (None,) * len(draws), numbers={"reason": str(error)})
    planned = time.perf_counter()
    motion, parts = optimum.motion, 1
    if periodic:
        with suppress(SolveError):  # The relaxed input suffices too, since its simulation is exact.
            motion, parts = optimise_switching_times(optimum).motion, _PARTS
    known = [knowing(optimum, draw, seconds) for draw in draws]
    return Planned(
        Plan.of(motion, periodic, parts),
        tuple(each and Plan.of(each, periodic) for each in known),
        optimum.iterations,
        {
            "objective": optimum.objective,
            "iterations": optimum.iterations,
            "solve_s": optimum.solve_s,
            "build_s": optimum.build_s,
            "planned_s": planned - begin,
            "known_s": time.perf_counter() - planned,
            "violation": optimum.solution.violation,
            "exact": "phases" if parts > 1 else "",
        },
    )


# -- motions ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Judged:
    """One controller on the nominal plant and on the drawn plants."""

    controller: Controller
    motion: Trajectory | None  # of the nominal plant; None if it is lost
    second: CrossCheck | None  # its second route
    numbers: dict[str, Any]  # of `motion`
    drawn: Drawn
    free: bool  # whether nothing hinders the controller

    @property
    def name(self) -> str:
        """Name of the controller."""
        return self.controller.name

    @cached_property
    def energy(self) -> Balance | None:
        """Energy balance of the nominal motion."""
        return self.motion and balance(self.motion)

    def signals(self, names: Iterable[str]) -> dict[str, np.ndarray] | None:
        """Signals of the nominal motion, None if the plant is lost."""
        model = self.controller.model
        return self.motion and sample(self.motion, {name: model[name] for name in names})

    def checks(self, tolerance: Tolerance, label: str) -> Iterator[Check]:
        """Second route, energy and funnels of the nominal motion; names begin with `label`."""
        yield from chain_checks(self.second, self.energy, tolerance, label)
        if self.free:
            yield from self._funnels(label)

    def _funnels(self, label: str) -> Iterator[Check]:
        if self.motion is not None:
            yield from funnel_checks(self.controller.model, self.motion, f"{label}: ")

    def warnings(self, label: str) -> Iterator[str]:
        """Warn of lost and failed plants, and of hardware for which a funnel is too narrow."""
        if self.motion is None:
            yield f"{label}: the error of the nominal plant exceeds its limit; it counts as lost"
        if not self.free:
            yield from (each.advice for each in self._funnels(label) if not each.passed)
        if self.drawn.failed:
            yield (
                f"{label}: the simulation of {self.drawn.failed} plants failed; they are counted, "
                "and left out of medians"
            )


@dataclass(frozen=True, eq=False)
class Trial:
    """Plants and conditions for which controllers are judged."""

    tube: Tube
    time: TimeSpan
    tolerance: ToleranceTable
    hardware: Hardware
    draws: Sequence[Draw]

    def judge(self, controller: Controller, *, again: bool) -> Judged:
        """Simulate a controller on all plants; `again` asks for a second route where affordable.

        With hardware that is not ideal a motion ends when its error is far outside the tube, and
        its plant is lost. Raises SolveError if the nominal motion fails although it is ideal.
        """
        plain, tolerance = controller.model, self.tolerance.options
        model = judged(plain, self.tube)
        if not self.hardware.ideal:
            far = ca.dot(model["error"], model["error"]) - (_LOST * self.tube.radius) ** 2
            lost = Switch("is lost", far, pack(model.x), terminal=True)
            model = replace(model, switches=[*model.switches, lost])
        motion = self._nominal(model, tolerance)
        # Scenes of kind "track" recheck trackers: their many steps take long in Python.
        again &= not plain.delays and not any(signal.name == "gain" for signal in plain.x)
        recheck = again and self.tolerance.recheck
        second = motion and cross_check(model, motion, tolerance, recheck=recheck, report=silent)
        numbers = dict.fromkeys(JUDGED) if motion is None else judged_numbers(motion, self.tube)
        bounded = any(output.name == "saturated" for output in plain.outputs)
        free = self.hardware == Hardware() and not bounded
        drawn = self._drawn(controller, model)
        return Judged(controller, motion, second, numbers, drawn, free)

    def _nominal(self, model: Model, tolerance: Tolerance) -> Trajectory | None:
        """Motion of the nominal plant; None if it is lost."""
        end, samples = self.time.end, self.time.samples
        try:
            motion = simulate_whole(model, end, samples, Exact(), tolerance, silent)
        except SolveError:
            if self.hardware.ideal:
                raise
            return None
        return motion if motion.end_time == end else None

    def _drawn(self, controller: Controller, model: Model) -> Drawn:
        members, end, tolerance = dict(self.scenarios(controller)), self.time.end, loose_tolerance()
        if not self.hardware.ideal:
            tolerance = replace(tolerance, max_steps=_PATIENCE)
        times = np.linspace(0.0, end, _SAMPLES)
        ensemble = simulate_ensemble(
            model, end, list(members.values()), times=times, tolerance=tolerance
        )
        numbers: list[dict[str, Any] | None] = [None] * len(self.draws)
        for k, motion, code in zip(members, ensemble.motions, ensemble.codes, strict=True):
            if not code and motion.end_time == end:
                numbers[k] = judged_numbers(motion, self.tube)
        return Drawn.of(numbers)

    def scenarios(self, controller: Controller) -> Iterator[tuple[int, Scenario]]:
        """Yield plants by number, each with its own noise, or with the inputs decided for it."""
        model, hardware = controller.model, self.hardware
        noisy = any(schedule.name == NOISE for schedule in model.schedules)
        links = model["length"].numel()

        def values(of: Gait, name: str) -> dict[str, np.ndarray]:
            (own,) = gait_reference(of, model.t, periodic=False, name=name).schedules
            return {name: own.values}

        for k, draw in enumerate(self.draws):
            if noisy:
                noise = hardware.noise_of(k + 1, self.time.end, links)
                yield k, Scenario(p=draw, schedules=values(noise, NOISE))
            elif controller.others is None:
                yield k, Scenario(p=draw)
            elif (inputs := controller.others[k]) is not None:
                yield k, Scenario(p=draw, schedules=values(inputs, "input"))


def numbers_on(draw: Draw, model: Model, tube: Tube, end: float) -> dict[str, Any] | None:
    """Quantities of a controlled plant with drawn parameters; None where its simulation fails."""
    model, times = judged(model, tube), np.linspace(0.0, end, _SAMPLES)
    try:
        motion = simulate(model, end, p=draw, times=times, tolerance=loose_tolerance())
    except SolveError:
        return None
    return judged_numbers(motion, tube)
