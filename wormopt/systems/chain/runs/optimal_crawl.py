"""Run scenes of kind ``optimal-crawl``: the best periodic inputs of a crawling chain."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import SceneError, SolveError
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.optimise import Optimum, optimise, optimise_multistart
from wormopt.ocp.problem import Problem
from wormopt.ocp.structure import structure_of
from wormopt.ocp.switching import optimise_switching_times, resting_speeds
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.simulate import simulate
from wormopt.study.numerics import Start
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.chain.convergence import Convergence, converge
from wormopt.systems.chain.copies import draw_factors, numbers_of, scenario_model
from wormopt.systems.chain.dynamic import PERIODS, Aim, CrawlLimits, crawl_problem, sine_guess
from wormopt.systems.chain.loops import build_chain, draw_links, laws_of
from wormopt.systems.chain.scenes.optimal_crawl import OptimalCrawlScene, RobustTable
from wormopt.systems.shared.optimum import (
    ACCEPTED,
    conclude_optimum,
    cross_check,
    refused,
    sample_motion,
    warnings_of_optimum,
    warnings_of_reading,
)
from wormopt.systems.shared.signals import chain_expressions
from wormopt.systems.shared.transport import assumed, cost_of_transport

_SHOWN = ("length", "velocity", "contact_force", "input")
# Samples of a motion that determine its size and its cycles.
_SAMPLES = 512
# Relaxation of complementarity, in usual speeds times usual forces: it only has to show the phases.
_RELAXED = Complementarity(residual=1e-3, first=1.0)
# State polynomials between switches.
_EXACT = Collocation(7)
# Accepted end error of the simulation of a crawl with contact on a grid.
_ACCEPTED_ON_GRID = 2e-2
# Relaxation where contact stays on a grid, and the arcs of that against the first grid.
_ON_GRID, _FINER = Complementarity(residual=1e-4, first=1e-4), 2
# Arcs that a phase needs to be seen, on average, and shorter periods that are tried.
_ARCS_A_PHASE, _SHORTER = 3, 2
# The least friction counts, but at least this share of the largest.
_FRICTION = 1e-2
# Largest input in nominal sizes.
_USUAL_SIZES = 20.0
# Keys of the scene by the optimiser's names.
_KEYS = {
    "input": "limits.force",
    "inputs": "limits.force",
    "states": "limits.length",
    "duration": "limits.period",
    "arcs": "mesh.arcs",
}
_ADVICE = {
    "not_solved": "write search.starts = 5, another number of mesh.arcs, or wider limits.length, "
    "limits.force or limits.period",
}
_NOT_FOUND = "no crawl was found within limits.period, limits.force and limits.length"


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[OptimalCrawlScene], report: Report) -> Result:
    """Find the best periodic crawl: relaxed contact from several starts, then phases, then replay.

    The switching times of the phases are free; several worms with common inputs have no phases. The
    result is "failed" if the simulation ends elsewhere. Raises SolveError if no crawl exists or is
    found.
    """
    table, begin = scene.table, time.perf_counter()
    plant, worms = _plant(table), 1 + (table.robust.draws if table.robust else 0)
    starts = iter([_resumed(scene)] if table.search.result else _guesses(table, plant, worms))
    try:
        draws = [{}, *_draws(plant, table.robust)] if table.robust else [{}]

        def stated(near: Guess) -> Problem:
            sized = _sized(table, plant, near)
            return _problem(table, scenario_model(sized, draws) if table.robust else sized)

        stages, tries = _solve(table, stated, starts, report)
        exact, solved = [*stages.values()][-1], time.perf_counter()
        numbers = _numbers(table, plant, exact.motion, draws, report)
    except SolveError as error:
        if error.code == "not_solved":  # the solver's messages on equations do not help the user
            error = SolveError(_NOT_FOUND, error.suggestion, error.partial, error.code)
        raise refused(scene, error, keys=_KEYS, advice=_ADVICE) from None
    accepted = ACCEPTED if "phases" in stages else _ACCEPTED_ON_GRID
    second = cross_check(exact.motion, accepted=accepted, report=report)
    kept, convergence, lost = _kept(numbers, accepted), None, ""
    if "convergence" in table.want and "phases" not in stages:
        lost = (
            "relaxed contact was not followed to its limit, so the motion does not show the phases"
        )
    elif "convergence" in table.want:
        try:
            convergence = converge(stages, report)
        except SolveError as error:
            lost = f"relaxed contact was not followed to its limit: {error}"
    more = [Check("relaxed contact not followed", 1.0, 0.0, lost)] if lost else []
    return conclude_optimum(
        scene,
        stages,
        second,
        numbers | (convergence.scalars if convergence else {}),
        _signals(exact.motion, bool(table.robust)) | (convergence.variables if convergence else {}),
        objective="acceleration" if table.aim.minimise else None,
        checks=[kept, *more],
        facts={"starts": [*tries]} | ({} if table.robust else assumed(table.units)),
        warnings=_warnings(table, stages, convergence),
        timings={"optimise": solved - begin, "check": time.perf_counter() - solved},
        shown=_SHOWN,
    )


def _plant(table: OptimalCrawlScene) -> Model:
    rest = float(np.mean(per(table.worm.rest_length, table.worm.links)))
    size = rest / 2 if rest > 0 else 1.0
    links = draw_links(table.worm, 1.0)
    return build_chain(table.worm, Start(), links, size, table.limits.period_range[1])


def _sized(table: OptimalCrawlScene, plant: Model, near: Guess) -> Model:
    """Scale the plant by the speed of a similar motion, and by friction.

    Masses and periods alone give forces that are too small by orders of magnitude for light worms.
    """
    masses, force = table.worm.links + 1, table.limits.force
    states = near.states(np.linspace(0.0, near.duration, _SAMPLES))
    speed = float(np.sqrt(np.mean(states[masses : 2 * masses] ** 2)))
    position, velocity = plant.x
    velocity = replace(velocity, nominal=max(speed, velocity.nominal / 10))
    held = [end for law in laws_of(table.worm) for end in law.stick_interval]
    sizes = np.abs(np.array(held, dtype=float))
    sizes = np.minimum(sizes[sizes > 0], force)
    friction = max(sizes.min(), _FRICTION * sizes.max()) if len(sizes) else force
    return replace(
        plant,
        x=[position, velocity],
        u=[replace(u, nominal=max(float(friction), force / _USUAL_SIZES)) for u in plant.u],
        contacts=[
            replace(c, nominal_force=float(friction), nominal_speed=velocity.nominal)
            for c in plant.contacts
        ],
    )


def _draws(plant: Model, robust: RobustTable) -> list[dict[str, np.ndarray]]:
    """Parameters of the other worms, drawn around the scene's values."""
    random, own = np.random.default_rng(robust.seed), numbers_of(plant)
    return [
        {name: own[name] * f for name, f in draw_factors(own, robust.spread, random).items()}
        for _ in range(robust.draws)
    ]


def _problem(table: OptimalCrawlScene, plant: Model) -> Problem:
    length = table.limits.length
    limits = CrawlLimits(
        table.limits.period_range,
        table.limits.force,
        None if length is None else (length[0], length[1]),
    )
    judge = table.robust.judge if table.robust else "mean"
    return crawl_problem(
        plant, limits, Aim(table.aim.maximise, table.aim.effort, table.aim.speed, judge)
    )


# -- solving ---------------------------------------------------------------------------------------


def _solve(
    table: OptimalCrawlScene,
    stated: Callable[[Guess], Problem],
    starts: Iterator[Guess],
    report: Report,
) -> tuple[dict[str, Optimum], tuple[float, ...]]:
    """Solve with relaxed contact, then with free switching times, or on a finer grid if that fails.

    `stated` is the problem in the sizes of a motion.
    """
    first = next(starts)
    problem, starts = stated(first), chain([first], starts)
    mesh = Mesh.even(1, table.mesh.arcs, Collocation(table.mesh.degree, table.mesh.scheme))
    relaxed, tries = optimise_multistart(problem, mesh, _RELAXED, starts, report=report)
    if table.robust:
        return {"complementarity": relaxed}, tries
    for _ in range(_SHORTER):
        cycles = _cycles(relaxed.motion)
        if _resolved(relaxed) or cycles == 1:
            break
        report(f"solving a period of 1/{cycles}", None)
        guess = relaxed.motion.guess
        guess = replace(guess, duration=guess.duration / cycles)
        shorter = tuple(end / cycles for end in problem.duration)
        problem = replace(stated(guess), duration=shorter)
        relaxed = optimise(problem, mesh, _RELAXED, guess, report=report)
    if _resolved(relaxed):
        report("polishing", 0.6)
        with suppress(SolveError):
            exact = optimise_switching_times(
                relaxed, collocation=_EXACT, tolerance=table.mesh.tolerance, report=report
            )
            return {"complementarity": relaxed, "phases": exact}, tries
    report("solving on a finer grid", 0.7)
    guess, grid = relaxed.motion.guess, Mesh.even(1, _FINER * mesh.total, mesh.collocation)
    problem = replace(stated(guess), duration=problem.duration)
    fine = optimise(problem, grid, _ON_GRID, guess, report=report)
    return {"complementarity": relaxed, "grid": fine}, tries


def _resolved(relaxed: Optimum) -> bool:
    """Whether the mesh is fine enough to show the phases of a motion."""
    speed = resting_speeds(relaxed)[0]
    phases = len(structure_of(relaxed.motion, speed=speed).durations)
    return _ARCS_A_PHASE * phases <= relaxed.motion.mesh.total


def _cycles(motion: Motion) -> int:
    """Number of cycles in a period: the harmonic in which lengths change most."""
    t = np.arange(_SAMPLES) / _SAMPLES * motion.duration
    power = np.sum(np.abs(np.fft.rfft(motion.output("length", t))) ** 2, axis=0)
    return 1 + int(np.argmax(power[1:]))


def _resumed(scene: Scene[OptimalCrawlScene]) -> Guess:
    """Start at the crawl of an earlier result."""
    table, name = scene.table, scene.table.search.result or ""
    try:
        earlier = Result.load(scene.folder / name)
        t = earlier["instant"].values
        states = np.vstack([earlier["position"].values, earlier["velocity"].values])
        inputs, forces = earlier["input"].values, earlier["contact_force"].values
    except (OSError, ValueError, KeyError) as error:
        message = f"{name} does not contain the crawl of a single worm: {error}"
        raise SceneError(scene.name, [("search.result", message)]) from None
    if len(inputs) != table.worm.links:
        message = f"{name} has {len(inputs)} links; write a result with {table.worm.links}"
        raise SceneError(scene.name, [("search.result", message)])
    course = _polyline(t, inputs)
    return Guess(float(t[-1]), _polyline(t, states), course, _polyline(t, forces))


def _polyline(t: np.ndarray, rows: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda at: np.array([np.interp(at, t, row) for row in rows])


def _guesses(table: OptimalCrawlScene, plant: Model, worms: int) -> Iterator[Guess]:
    """Sine inputs: the first has phases that run along the worm, the others random phases."""
    period, force = sum(table.limits.period_range) / 2, table.limits.force
    for start in range(table.search.starts):
        random = np.random.default_rng([table.search.seed, start])
        phase = random.uniform(0, 2 * np.pi, table.worm.links) if start else None
        share = random.uniform(0.3, 1.0) if start else 1.0
        yield sine_guess(plant, period, share * force, phase, worms)


# -- results ---------------------------------------------------------------------------------------


def _kept(numbers: Mapping[str, Any], accepted: float) -> Check:
    """Whether the worms keep the optimised speed."""
    speed, kept = numbers["speed"], float(np.mean(numbers["speed_simulated"]))
    advice = (
        f"the simulated speed after some periods is {kept:.6g}, not {speed:.6g}; write "
        "more mesh.arcs"
    )
    limit = accepted * max(abs(speed), abs(kept))
    return Check("speed after some periods", kept - speed, limit, advice)


def _numbers(
    table: OptimalCrawlScene,
    plant: Model,
    motion: Motion,
    draws: Sequence[Mapping[str, np.ndarray]],
    report: Report,
) -> dict[str, Any]:
    """Optimised speed, and the speed of each worm after many simulated periods."""
    report("simulating the crawl", 0.95)
    course, duration, masses = motion.input_course(), motion.duration, table.worm.links + 1
    ends = motion.states(np.array([0.0, duration]))
    advances = [ends[2 * masses * k, 1] - ends[2 * masses * k, 0] for k in range(len(draws))]
    driven = drive(plant, course, periodic=True)
    begin = {"position": ends[:masses, 0], "velocity": ends[masses : 2 * masses, 0]}
    speeds = []
    for draw in draws:
        span = (2 if not table.robust else 4 * PERIODS) * duration
        run = simulate(driven, span, x0=begin, p=dict(draw), dense=True)
        assert run.dense is not None
        x = run.dense(np.array([span - duration, span]))[0]
        speeds.append((x[1] - x[0]) / duration)
    found: dict[str, Any] = {
        "speed": float(np.mean(advances)) / duration,
        "speed_simulated": speeds if table.robust else speeds[0],
        "advance": float(np.mean(advances)),
    }
    if not table.robust:
        energy = _work(plant, motion) / advances[0]
        found |= {"energy_per_mass_distance": energy} | cost_of_transport(energy, table.units)
    return found


def _work(plant: Model, motion: Motion) -> float:
    """Positive work of the actuators in a period, over the mass."""
    edges = motion.breaks
    s, weights = np.polynomial.legendre.leggauss(20)
    t = edges[:-1, None] + np.diff(edges)[:, None] * (s + 1) / 2
    power = motion.output("power", t.ravel()).reshape(-1, *t.shape)
    mass = next(
        np.sum(np.broadcast_to(np.array(p.value), p.size)) for p in plant.p if p.name == "mass"
    )
    return float(np.sum(np.maximum(power, 0.0) * weights / 2 * np.diff(edges)[:, None]) / mass)


def _signals(motion: Motion, robust: bool) -> dict[str, np.ndarray]:
    model = motion.program.problem.model
    wanted = {"input": model.u[0].symbol} if robust else chain_expressions(model)
    return sample_motion(motion, wanted).arrays(OptimalCrawlScene.variables)


def _warnings(
    table: OptimalCrawlScene, stages: Mapping[str, Optimum], convergence: Convergence | None
) -> Iterator[str]:
    relaxed, last = stages["complementarity"], [*stages.values()][-1]
    if "phases" in stages:
        yield from warnings_of_optimum(last, table.mesh.tolerance)
        yield from warnings_of_reading(relaxed, last)
    else:
        yield from warnings_of_optimum(last, math.inf)
        why, part = "the motion shows no distinct phases", "hundred"
        if table.robust:
            why, part = "several worms", "thousand"
        yield (
            f"{why}: contact is a complementarity condition on a grid, so the motion is accurate "
            f"to about one part in a {part}; speed_simulated is the speed of each worm in the "
            "exact simulation"
        )
    if (cycles := math.ceil(table.limits.period_range[0] / last.motion.duration - 1e-6)) > 1:
        yield (
            "the crawl repeats within limits.period: time, advance and signals describe one of "
            f"{cycles} cycles, with a duration of {cycles * last.motion.duration:.6g}; a smaller "
            "force, or a larger aim.effort, gives slower cycles"
        )
    if table.search.starts == 1:
        yield "the result is a local optimum from a single start; write search.starts to try more"
    if convergence is not None:
        yield from convergence.warnings()
