"""Scenes of kind ``optimal-crawl``: the inputs by which a chain crawls best."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementary, Smoothed
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.optimise import Optimum, best_of, optimise
from wormopt.ocp.polish import polish
from wormopt.ocp.problem import Problem
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.numerics import Start
from wormopt.scene.scene import Scene
from wormopt.scene.types import per
from wormopt.simulation.options import Exact, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.copies import copies
from wormopt.systems.chain.dynamic import Aim, CrawlLimits, crawl_problem
from wormopt.systems.chain.runs.chains import build_chain, draw_links
from wormopt.systems.chain.scenes.optimal_crawl import OptimalCrawlScene, RobustTable
from wormopt.systems.shared.optimum import (
    ACCEPTED,
    conclude,
    modes_of,
    recheck,
    refused,
    sample_motion,
    warnings_of_optimum,
    warnings_of_reading,
)
from wormopt.systems.shared.signals import CHAIN_SIGNALS, chain_expressions

_SHOWN = ("length", "velocity", "contact_force", "input")
# Relaxation of complementarity, in usual speeds times usual forces: the last one only has to show
# the phases, that of the convergence study has to be small against the error of the grid.
_RELAXED, _TIGHT = Complementary(residual=1e-3, first=1.0), Complementary(1e-5, first=1.0)
# Widths of the smoothed law in the convergence study, in usual speeds, of which the last ones
# show its order.
_WIDTHS, _SHOWN_WIDTHS = Smoothed(v_reg=0.4**6, first=1.0, ratio=0.4), 5
# State polynomials between switches.
_EXACT = Collocation(7)
# A robust crawl is not solved exactly; its simulation may end elsewhere by so much.
_ACCEPTED_ROBUST = 2e-2
# The first guess is the last one of so many simulated periods, under sines of this share of the
# largest force.
_PERIODS, _PART = 6, 0.9
_DRAWN = ("mass", "stiffness", "damping", "friction_forward", "friction_backward")


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
        raise refused(scene, error) from None
    accepted = _ACCEPTED_ROBUST if table.robust else ACCEPTED
    second = recheck(exact.motion, accepted=accepted, report=report)
    faults, convergence = [*_strays(numbers, accepted)], None
    if "convergence" in table.want:
        try:
            convergence = _converge(stages, report)
        except SolveError as error:
            faults.append(f"relaxed contact was not followed to its limit: {error}")
    variables = _variables(exact.motion, table.units, bool(table.robust))
    result = conclude(
        scene,
        stages,
        second,
        objective="acceleration" if table.aim.minimise else "speed",
        scalars=numbers | (convergence.scalars(table.units) if convergence else {}),
        variables=[*variables, *(convergence.variables(table.units) if convergence else ())],
        warnings=[*_warnings(table, stages, convergence)],
        timings={"optimise": solved - begin, "check": time.perf_counter() - solved},
        faults=faults,
        shown=_SHOWN,
    )
    return replace(result, trust={**result.trust, "starts": [*tries]})


def _plant(table: OptimalCrawlScene) -> Model:
    rest = float(np.mean(per(table.worm.rest_length, table.worm.links)))
    size = rest / 2 if rest > 0 else 1.0
    links = draw_links(table.worm, 1.0)
    return build_chain(table.worm, Start(), links, size, table.limits.period_range[1])


def _draws(plant: Model, robust: RobustTable) -> list[dict[str, np.ndarray]]:
    """Numbers of the other worms, each drawn around the scene's own."""
    random = np.random.default_rng(robust.seed)
    own = {s.name: np.array(s.value, float).ravel() for s in plant.p if s.name in _DRAWN}
    low, high = 1 - robust.spread, 1 + robust.spread
    return [
        {name: value * random.uniform(low, high, value.shape) for name, value in own.items()}
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
    exact = polish(relaxed, collocation=_EXACT, tolerance=table.mesh.tolerance, report=report)
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
    for start in range(table.search.starts):
        yield _guess(table, plant, worms, start)


def _guess(table: OptimalCrawlScene, plant: Model, worms: int, start: int) -> Guess:
    """Last period of a simulation under sines; their phases run down the worm at first."""
    shortest, longest = table.limits.period_range
    period, links = (shortest + longest) / 2, table.worm.links
    lag = 2 * np.pi / (links + 1) * np.arange(links)
    random = np.random.default_rng([table.search.seed, start])
    phase = lag if start == 0 else random.uniform(0, 2 * np.pi, links)
    force = _PART * table.limits.force * (1.0 if start == 0 else random.uniform(0.3, 1.0))
    sines = Gait(
        np.array([0.0, period]),
        np.zeros((1, links, 1)),
        np.array([2 * np.pi / period]),
        force * np.cos(phase)[None],
        -force * np.sin(phase)[None],
    )
    loose = Tolerance(relative=1e-8, absolute=1e-8)
    driven = drive(plant, sines, periodic=True)
    motion = simulate(driven, _PERIODS * period, contact=Exact(), tolerance=loose, dense=True)
    if motion.dense is None:
        raise SolveError("the first guess cannot be simulated", "write a smaller limits.force")
    dense, first, masses = motion.dense, (_PERIODS - 1) * period, links + 1

    def states(t: np.ndarray) -> np.ndarray:
        x = dense(first + t)[: 2 * masses]
        x[:masses] -= dense(np.array([first]))[masses - 1]
        return np.tile(x, (worms, 1))

    return Guess(period, states, lambda t: sines(first + t))


# -- convergence of relaxed contact ----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Convergence:
    """Objectives of relaxed contact on the way to the exact one."""

    exact: float  # objective with prescribed modes
    widths: np.ndarray  # of the smoothed law
    smoothed: np.ndarray  # objective at each width
    arcs: np.ndarray  # numbers of arcs
    relaxed: np.ndarray  # objective with complementarity on each grid
    alike: bool  # both show the contact modes of the exact one

    @property
    def orders(self) -> tuple[float, float]:
        """Slopes of the errors against the width and against the length of an arc."""
        by_width = np.polyfit(np.log(self.widths), np.log(np.abs(self.smoothed - self.exact)), 1)
        by_arc = np.polyfit(-np.log(self.arcs), np.log(np.abs(self.relaxed - self.exact)), 1)
        return float(by_width[0]), float(by_arc[0])

    @property
    def bars(self) -> tuple[float, float]:
        """Error bars that each sequence states by itself: twice its last step."""
        smoothed, relaxed = (2 * float(abs(v[-1] - v[-2])) for v in (self.smoothed, self.relaxed))
        return smoothed, relaxed

    def scalars(self, units: str) -> dict[str, Scalar]:
        """Orders, last objectives, and their error bars."""
        speed = unit_of("speed", units)
        return {
            "order_smoothed": Scalar(self.orders[0]),
            "order_complementarity": Scalar(self.orders[1]),
            "objective_smoothed": Scalar(float(self.smoothed[-1]), speed),
            "objective_smoothed_error_bar": Scalar(self.bars[0], speed),
            "objective_complementarity": Scalar(float(self.relaxed[-1]), speed),
            "objective_complementarity_error_bar": Scalar(self.bars[1], speed),
            "same_modes": Scalar(self.alike),
        }

    def variables(self, units: str) -> list[Variable]:
        """Errors over widths and over grids."""
        speed = unit_of("speed", units)
        return [
            Variable("width", speed, ("width",), self.widths, "width of the smoothed law"),
            Variable("smoothed_error", speed, ("width",), self.smoothed - self.exact, "its error"),
            Variable("arcs", "1", ("arcs",), self.arcs, "arcs of the grid"),
            Variable(
                "complementarity_error", speed, ("arcs",), self.relaxed - self.exact, "its error"
            ),
        ]


def _converge(stages: Mapping[str, Optimum], report: Report) -> _Convergence:
    """Solve again with narrower laws and on finer grids, from the same local optimum."""
    relaxed, exact = stages["complementarity"], stages["phases"]
    problem, arcs = exact.motion.program.problem, relaxed.motion.mesh.total
    speed = problem.model.contacts[0].nominal_speed
    widths = replace(_WIDTHS, v_reg=_WIDTHS.v_reg * speed, first=_WIDTHS.first * speed)
    report("smoothed contact", 0.7)
    fine = Mesh.even(1, 2 * arcs, Collocation(3, "radau"))
    smoothed = optimise(problem, fine, widths, relaxed.motion.guess)
    found = []
    for k, n in enumerate((arcs // 2, arcs, 2 * arcs)):
        report("complementarity on finer grids", 0.8 + k / 20)
        grid = Mesh.even(1, n, Collocation(2, "radau"))
        found.append(optimise(problem, grid, _TIGHT, relaxed.motion.guess))
    return _Convergence(
        exact.objective,
        np.array([level.level for level in smoothed.levels[-_SHOWN_WIDTHS:]]),
        np.array([level.objective for level in smoothed.levels[-_SHOWN_WIDTHS:]]),
        np.array([o.motion.mesh.total for o in found]),
        np.array([o.objective for o in found]),
        len({_cycle_of(o) for o in (exact, smoothed, found[-1])}) == 1,
    )


def _cycle_of(optimum: Optimum) -> tuple[tuple[int, ...], ...]:
    """Contact modes of a period without repetitions, wherever it begins."""
    modes, _ = modes_of(optimum)
    cycle = [tuple(m) for k, m in enumerate(modes) if m != modes[k - 1]] or [tuple(modes[0])]
    return min(tuple(cycle[k:] + cycle[:k]) for k in range(len(cycle)))


# -- what is told ----------------------------------------------------------------------------------


def _strays(numbers: Mapping[str, Scalar], accepted: float) -> Iterator[str]:
    """Say so if worms do not keep the speed they were optimised for."""
    speed, kept = numbers["speed"].value, float(np.mean(numbers["speed_simulated"].value))
    if not abs(kept - speed) <= accepted * max(abs(speed), abs(kept)):
        yield f"after some periods the simulated speed is {kept:.6g}, not {speed:.6g}"


def _numbers(
    table: OptimalCrawlScene,
    plant: Model,
    motion: Motion,
    draws: Sequence[Mapping[str, np.ndarray]],
    report: Report,
) -> dict[str, Scalar]:
    """Speed as optimised, and as every worm has it after many simulated periods."""
    report("simulating the crawl", 0.95)
    course, duration, masses = motion.input_course(), motion.duration, table.worm.links + 1
    ends = motion.states(np.array([0.0, duration]))
    advances = [ends[2 * masses * k, 1] - ends[2 * masses * k, 0] for k in range(len(draws))]
    driven = drive(plant, course, periodic=True)
    begin = {"position": ends[:masses, 0], "velocity": ends[masses : 2 * masses, 0]}
    speeds = []
    for draw in draws:
        span = (2 if not table.robust else 4 * _PERIODS) * duration
        run = simulate(driven, span, x0=begin, p=dict(draw), dense=True)
        assert run.dense is not None
        x = run.dense(np.array([span - duration, span]))[0]
        speeds.append((x[1] - x[0]) / duration)
    speed = unit_of("speed", table.units)
    found = {
        "speed": Scalar(float(np.mean(advances)) / duration, speed),
        "speed_simulated": Scalar(speeds if table.robust else speeds[0], speed),
        "advance": Scalar(float(np.mean(advances)), unit_of("length", table.units)),
    }
    if not table.robust:
        found["cost_of_transport"] = Scalar(
            _work(plant, motion) / advances[0], unit_of("acceleration", table.units)
        )
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


def _variables(motion: Motion, units: str, robust: bool) -> list[Variable]:
    if robust:
        return sample_motion(motion, {"input": motion.program.problem.model.u[0].symbol}).variables(
            CHAIN_SIGNALS, units
        )
    sampled = sample_motion(motion, chain_expressions(motion.program.problem.model))
    return sampled.variables(CHAIN_SIGNALS, units)


def _warnings(
    table: OptimalCrawlScene, stages: Mapping[str, Optimum], convergence: _Convergence | None
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
    if convergence is None:
        return
    names = ("smoothed", "complementarity")
    last = (convergence.smoothed[-1], convergence.relaxed[-1])
    for name, value, bar in zip(names, last, convergence.bars, strict=True):
        if abs(value - convergence.exact) > bar:
            yield f"the error bar of {name} contact does not contain the exact objective"
