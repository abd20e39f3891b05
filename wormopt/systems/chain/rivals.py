"""Controllers of a scene of kind ``compare-tracking``, and the plans of some of them.

Plans are inputs computed in advance, for the nominal plant and for plants with known parameters.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from wormopt.control.drive import drive
from wormopt.control.loop import with_reference
from wormopt.control.lqr import lqr
from wormopt.control.reference import gait_reference
from wormopt.control.sensing import Sensors, band_limited, through_sensors
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.ocp.switching import optimise_switching_times
from wormopt.systems.chain.copies import Draw, drawn_plants
from wormopt.systems.chain.dynamic import crawl_problem, sine_guess
from wormopt.systems.chain.loops import chain_for, close_loop, draw_links, labels
from wormopt.systems.chain.optimal_tracking import knowing, lengths_of, optimal_input
from wormopt.systems.chain.scenes.compare_tracking import CompareScene
from wormopt.systems.chain.tables import Aim, CrawlLimits, LeastError, LeastInput

LQR = "LQR, feed-forward"
PLANS = ("optimal tracking", "optimal tube", "fastest crawl")
"""Plans by the names in tables and pictures."""

# Relaxed contact of the crawl.
_RELAXED = Complementarity(residual=1e-3, first=1.0)
# Cubics per arc for a link length in the crawl's exact motion, whose arcs are long.
_PARTS = 6


@dataclass(frozen=True, eq=False)
class Job:
    """Work of one process."""

    kind: str  # "optimal tracking", "optimal tube" or "fastest crawl"
    table: CompareScene
    gait: Gait  # the reference
    draws: Sequence[Draw] = ()  # plants for which the plan is made anew


@dataclass(frozen=True, eq=False)
class Plan:
    """An input and the corresponding link lengths as functions of time, one row per link."""

    inputs: Gait
    lengths: Gait
    periodic: bool


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of a job; a plan is None if it was not found."""

    plan: Plan | None  # for the plant as it is believed
    known: tuple[Plan | None, ...] = ()  # for the plants of the job's draws
    iterations: int = 0  # of the solves for `plan`
    # how these solves went, time taken by all, or why there is no plan
    numbers: dict[str, float | str] = field(default_factory=dict)


def plans_of(table: CompareScene) -> tuple[str, ...]:
    """Plans of a scene."""
    tracking = PLANS[:2] if table.optimal is not None else ()
    return tracking + (PLANS[2:] if table.crawl is not None else ())


def solve(job: Job) -> Answer:
    """Plan for the nominal plant, then anew for each plant with known parameters.

    A plan that is not found is None and counted; no exception is raised.
    """
    begin = time.perf_counter()
    periodic = job.kind == "fastest crawl"
    try:
        optimum = _crawl(job) if periodic else _track(job)
    except SolveError as error:
        return Answer(None, (None,) * len(job.draws), 0, {"reason": str(error)})
    planned = time.perf_counter()
    motion, parts = optimum.motion, 1
    if periodic:
        with suppress(SolveError):  # The relaxed input suffices too, since its simulation is exact.
            motion, parts = optimise_switching_times(optimum).motion, _PARTS
    seconds = None if periodic else job.table.relaxation.time_limit
    known = [knowing(optimum, draw, seconds) for draw in job.draws]
    return Answer(
        Plan(motion.input_course(), lengths_of(motion, parts), periodic),
        tuple(m and Plan(m.input_course(), lengths_of(m), periodic) for m in known),
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


def plant_of(table: CompareScene, gait: Gait) -> Model:
    """Nominal plant of a scene, scaled by the reference `gait`."""
    return chain_for(table.worm, table.start, draw_links(table.worm, table.time.end), gait)


def _track(job: Job) -> Optimum:
    table, optimal = job.table, job.table.optimal
    assert optimal is not None
    plant = plant_of(table, job.gait)
    if job.kind == "optimal tracking":
        objective = LeastError(input_weight=optimal.input_weight)
    else:
        objective = LeastInput(margin=optimal.margin)
    return optimal_input(
        plant,
        gait_reference(job.gait, plant.t),
        table.time.end,
        objective,
        table.tube,
        table.grid,
        table.relaxation,
        period=job.gait.period,
    )


def _crawl(job: Job) -> Optimum:
    table = job.table.crawl
    assert table is not None
    plant = plant_of(job.table, job.gait)
    limits = CrawlLimits(period=table.period, force=table.force, length=table.length)
    problem = crawl_problem(plant, limits, Aim(maximise="speed", effort=table.input_weight))
    mesh = Mesh.even(1, table.arcs, Collocation(2, "radau"))
    return optimise(problem, mesh, _RELAXED, sine_guess(plant, table.period, table.force))


# -- rivals --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Rival:
    """One controller of the comparison."""

    name: str  # for tables and pictures
    model: Model  # without inputs; output ``error`` against the reference
    # its inputs on the other plants, where they are not those of the model; None: there are none
    others: tuple[Gait | None, ...] | None = None


def rivals(table: CompareScene, gait: Gait, plans: Mapping[str, Plan | None]) -> Iterator[Rival]:
    """Close the loops and apply the plans, first in open loop, then with LQR around them.

    Plans that were not found are left out.
    """
    for name, tracker in zip(labels(table.tracker), table.tracker, strict=True):
        plant = plant_of(table, gait)
        loop = close_loop(plant, gait_reference(gait, plant.t), tracker, table.worm)
        yield Rival(name, seen(table, plant, loop))
    yield Rival(LQR, _lqr(table, gait, None))
    found = {name: plan for name, plan in plans.items() if plan is not None}
    for name, plan in found.items():
        yield Rival(name, driven(table, gait, plan.inputs, periodic=plan.periodic))
    for name, plan in found.items():
        yield Rival(f"{name} + LQR", _lqr(table, gait, plan))


def driven(table: CompareScene, gait: Gait, inputs: Gait, *, periodic: bool = False) -> Model:
    """Plant with inputs over time, evaluated against the reference `gait`."""
    plant = plant_of(table, gait)
    compared = with_reference(plant, gait_reference(gait, plant.t))
    return drive(compared, inputs, periodic=periodic)


def _lqr(table: CompareScene, gait: Gait, plan: Plan | None) -> Model:
    """LQR on the reference, or around a plan, with its input fed forward, its lengths followed."""
    plant, weights = plant_of(table, gait), table.lqr
    reference = gait_reference(gait, plant.t)
    aim = reference
    if plan is not None:
        aim = gait_reference(plan.lengths, plant.t, periodic=plan.periodic, name="course")
    loop = lqr(
        plant,
        aim,
        error_weight=weights.error_weight,
        rate_weight=weights.rate_weight,
        input_weight=weights.input_weight,
        feedforward=None if plan is None else plan.inputs,
    )
    return seen(table, plant, loop if plan is None else with_reference(loop, reference))


def seen(table: CompareScene, plant: Model, loop: Model) -> Model:
    """A closed loop whose controller has the scene's measurements."""
    measurement = table.measurement
    if measurement is None or measurement.exact:
        return loop
    noise = noise_of(table, 0) if measurement.noise else None
    return through_sensors(plant, loop, Sensors(noise, measurement.delay))


def noise_of(table: CompareScene, member: int) -> Gait:
    """Noise of the nominal plant, number 0, or of another plant, from number 1 on."""
    measurement = table.measurement
    assert measurement is not None
    seed = (measurement.seed, member)
    return band_limited(
        measurement.noise, measurement.interval, table.time.end, table.worm.links, seed
    )


def draw_plants(table: CompareScene, gait: Gait) -> list[Draw]:
    """Parameters of the drawn plants, which do not depend on `gait`."""
    draws = table.draws
    return drawn_plants(plant_of(table, gait), draws.spread, draws.seed, draws.members)
