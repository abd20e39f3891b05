"""Inputs computed beforehand, for a plant as it is believed and for plants that are known."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.reference import follow
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementary
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.ocp.polish import polish
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.dynamic import Aim, CrawlLimits, crawl_problem
from wormopt.systems.chain.runs.chains import build_chain, draw_links
from wormopt.systems.chain.runs.optimal_tracking import knowing, lengths_of, optimal_input
from wormopt.systems.chain.scenes.compare_tracking import CompareScene
from wormopt.systems.chain.scenes.track_optimal import LeastError, LeastInput

Draw = Mapping[str, np.ndarray]
"""Parameters of a plant by name."""


PLANS = ("optimal tracking", "optimal tube", "fastest crawl")
"""What is planned, by the names that tables and pictures show."""

# The crawl's relaxed contact; the first guess is the last of so many periods under sines with
# this share of the largest force.
_RELAXED = Complementary(residual=1e-3, first=1.0)
_PERIODS, _PART = 6, 0.9
# Cubics in the course of a length on each arc of the crawl's exact motion, which are long.
_PARTS = 6


@dataclass(frozen=True, eq=False)
class Job:
    """What one process computes."""

    kind: str  # "optimal tracking", "optimal tube" or "fastest crawl"
    table: CompareScene
    gait: Gait  # the reference
    draws: Sequence[Draw] = ()  # plants for which the plan is made anew


@dataclass(frozen=True, eq=False)
class Plan:
    """An input and the link lengths that go with it, as courses of time, one row per link."""

    inputs: Gait
    lengths: Gait
    periodic: bool


@dataclass(frozen=True, eq=False)
class Answer:
    """What came of a job; a plan is None where none was found."""

    plan: Plan | None  # for the plant as it is believed
    known: tuple[Plan | None, ...] = ()  # for the plants of the job's draws
    iterations: int = 0  # of the solves for `plan`
    # how these solves went, time taken by all, or why there is no plan
    numbers: dict[str, float | str] = field(default_factory=dict)


def answers(jobs: Sequence[Job], workers: int) -> Iterator[Answer]:
    """Do jobs in several processes; the answers come in the order of the jobs.

    With one worker they are done in this process.
    """
    if workers == 1 or len(jobs) <= 1:
        yield from map(solve, jobs)
        return
    # CasADi holds the interpreter's lock, so threads would not help.
    from loky import get_reusable_executor

    executor = get_reusable_executor(max_workers=workers, timeout=20)
    try:
        yield from executor.map(solve, jobs)
    except KeyboardInterrupt:
        executor.shutdown(wait=False, kill_workers=True)
        raise


def solve(job: Job) -> Answer:
    """Plan for the plant as it is believed, then anew for each plant that is known.

    A plan that is not found is None, and counted: nothing is raised.
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
        with suppress(SolveError):  # the relaxed input serves too: its simulation is exact
            motion, parts = polish(optimum).motion, _PARTS
    known = [knowing(optimum, draw) for draw in job.draws]
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
    """Plant of a scene as it is believed, scaled by the reference `gait`."""
    length = float(np.mean(np.abs(gait(gait.breaks[:-1])))) or 1.0
    links = draw_links(table.worm, table.time.end)
    return build_chain(table.worm, table.start, links, length, gait.period)


def _track(job: Job) -> Optimum:
    table, optimal = job.table, job.table.optimal
    plant = plant_of(table, job.gait)
    if job.kind == "optimal tracking":
        objective = LeastError(input_weight=optimal.input_weight)
    else:
        objective = LeastInput(margin=optimal.margin)
    return optimal_input(
        plant,
        follow(job.gait, plant.t),
        table.time.end,
        objective,
        table.tube,
        table.grid,
        table.relaxation,
        period=job.gait.period,
    )


def _crawl(job: Job) -> Optimum:
    table = job.table.crawl
    plant = plant_of(job.table, job.gait)
    limits = CrawlLimits(
        (table.period, table.period), table.force, (table.length[0], table.length[1])
    )
    problem = crawl_problem(plant, limits, Aim(effort=table.input_weight))
    mesh = Mesh.even(1, table.arcs, Collocation(2, "radau"))
    return optimise(problem, mesh, _RELAXED, _shuffle(plant, table.period, table.force))


def _shuffle(plant: Model, period: float, force: float) -> Guess:
    """Last of some periods under sines of which the phase runs down the worm."""
    links = sum(u.size for u in plant.u)
    phase = 2 * np.pi / (links + 1) * np.arange(links)
    size = _PART * force
    sines = Gait(
        np.array([0.0, period]),
        np.zeros((1, links, 1)),
        np.array([2 * np.pi / period]),
        size * np.cos(phase)[None],
        -size * np.sin(phase)[None],
    )
    loose = Tolerance(relative=1e-8, absolute=1e-8)
    run = simulate(
        drive(plant, sines, periodic=True), _PERIODS * period, tolerance=loose, dense=True
    )
    first = run.end_time - period

    def states(t: np.ndarray) -> np.ndarray:
        x = run.at(np.clip(first + t, 0.0, run.end_time)).states.copy()
        x[: links + 1] -= run.at(np.array([first])).states[links]
        return x

    return Guess(period, states, sines)
