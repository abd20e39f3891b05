"""Scenes of kind ``optimal-crawl``: the inputs by which a chain crawls best."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import SceneError, SolveError
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.optimise import Optimum, best_of
from wormopt.ocp.problem import Problem
from wormopt.ocp.switching import optimise_switching_times
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.scene.numerics import Start
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.convergence import Convergence, converge
from wormopt.systems.chain.copies import copies, draw_factors, numbers_of
from wormopt.systems.chain.dynamic import PERIODS, Aim, CrawlLimits, crawl_problem, sine_guess
from wormopt.systems.chain.runs.chains import build_chain, draw_links
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
# Relaxation of complementarity, in usual speeds times usual forces: it only has to show the phases.
_RELAXED = Complementarity(residual=1e-3, first=1.0)
# State polynomials between switches.
_EXACT = Collocation(7)
# A robust crawl is not solved exactly; its simulation may end elsewhere by so much.
_ACCEPTED_ROBUST = 2e-2
# Keys of the scene, by what an optimiser calls them.
_KEYS = {
    "input": "limits.force",
    "inputs": "limits.force",
    "states": "limits.length",
    "duration": "limits.period",
    "arcs": "mesh.arcs",
}
_ADVICE = {
    "not_solved": "start elsewhere (search), or write another number of mesh.arcs or wider limits",
}


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[OptimalCrawlScene], report: Report) -> Result:
    """Find the best periodic crawl: relaxed contact from several starts, then phases, then replay.

    Phases have free switching times; none if several worms share the inputs. "failed" where
    the simulation ends elsewhere; raises SolveError if there is no crawl or none is found.
    """
    table, begin = scene.table, time.perf_counter()
    plant = _plant(table)
    draws = [{}, *_draws(plant, table.robust)] if table.robust else [{}]
    problem = _problem(table, copies(plant, draws) if table.robust else plant)
    starts = [_resumed(scene)] if table.search.result else _guesses(table, plant, len(draws))
    try:
        stages, tries = _solve(table, problem, starts, report)
        exact, solved = [*stages.values()][-1], time.perf_counter()
        numbers = _numbers(table, plant, exact.motion, draws, report)
    except SolveError as error:
        raise refused(scene, error, keys=_KEYS, advice=_ADVICE) from None
    accepted = _ACCEPTED_ROBUST if table.robust else ACCEPTED
    second = cross_check(exact.motion, accepted=accepted, report=report)
    kept, convergence, lost = _kept(numbers, accepted), None, ""
    if "convergence" in table.want:
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


def _draws(plant: Model, robust: RobustTable) -> list[dict[str, np.ndarray]]:
    """Numbers of the other worms, each drawn around the scene's own."""
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
    table: OptimalCrawlScene, problem: Problem, starts: Iterable[Guess], report: Report
) -> tuple[dict[str, Optimum], tuple[float, ...]]:
    mesh = Mesh.even(1, table.mesh.arcs, Collocation(table.mesh.degree, table.mesh.scheme))
    relaxed, tries = best_of(problem, mesh, _RELAXED, starts, report=report)
    if table.robust:
        return {"complementarity": relaxed}, tries
    report("polishing", 0.6)
    exact = optimise_switching_times(
        relaxed, collocation=_EXACT, tolerance=table.mesh.tolerance, report=report
    )
    return {"complementarity": relaxed, "phases": exact}, tries


def _resumed(scene: Scene[OptimalCrawlScene]) -> Guess:
    """Start at the crawl of an earlier result."""
    table, name = scene.table, scene.table.search.result or ""
    try:
        earlier = Result.load(scene.folder / name)
        t = earlier["instant"].values
        states = np.vstack([earlier["position"].values, earlier["velocity"].values])
        inputs, forces = earlier["input"].values, earlier["contact_force"].values
    except (OSError, ValueError, KeyError) as error:
        message = f"{name} holds no crawl of one worm: {error}"
        raise SceneError(scene.name, [("search.result", message)]) from None
    if len(inputs) != table.worm.links:
        message = f"{name} has {len(inputs)} links; write one of {table.worm.links}"
        raise SceneError(scene.name, [("search.result", message)])
    course = _polyline(t, inputs)
    return Guess(float(t[-1]), _polyline(t, states), course, _polyline(t, forces))


def _polyline(t: np.ndarray, rows: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda at: np.array([np.interp(at, t, row) for row in rows])


def _guesses(table: OptimalCrawlScene, plant: Model, worms: int) -> Iterator[Guess]:
    """Sines of which the phases run down the worm at first, and by chance afterwards."""
    period, force = sum(table.limits.period_range) / 2, table.limits.force
    for start in range(table.search.starts):
        random = np.random.default_rng([table.search.seed, start])
        phase = random.uniform(0, 2 * np.pi, table.worm.links) if start else None
        share = random.uniform(0.3, 1.0) if start else 1.0
        yield sine_guess(plant, period, share * force, phase, worms)


# -- what is told ----------------------------------------------------------------------------------


def _kept(numbers: Mapping[str, Any], accepted: float) -> Check:
    """Whether worms keep the speed they were optimised for."""
    speed, kept = numbers["speed"], float(np.mean(numbers["speed_simulated"]))
    advice = f"after some periods the simulated speed is {kept:.6g}, not {speed:.6g}"
    limit = accepted * max(abs(speed), abs(kept))
    return Check("speed after some periods", kept - speed, limit, advice)


def _numbers(
    table: OptimalCrawlScene,
    plant: Model,
    motion: Motion,
    draws: Sequence[Mapping[str, np.ndarray]],
    report: Report,
) -> dict[str, Any]:
    """Speed as optimised, and as every worm has it after many simulated periods."""
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
    relaxed = stages["complementarity"]
    if "phases" in stages:
        yield from warnings_of_optimum(stages["phases"], table.mesh.tolerance)
        yield from warnings_of_reading(relaxed, stages["phases"])
    else:
        yield from warnings_of_optimum(relaxed, math.inf)
        yield (
            "several worms: contact is complementary on a grid, so that the motion is right to "
            "about a part in a thousand; speed_simulated is what each worm really does"
        )
    if table.search.starts == 1:
        yield "a local optimum from one start; write search.starts to try more"
    if convergence is not None:
        yield from convergence.warnings()
