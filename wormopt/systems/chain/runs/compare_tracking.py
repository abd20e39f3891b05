"""Run scenes of kind ``compare-tracking``: several controllers of one chain."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.workers import Workers
from wormopt.progress import Report, silent
from wormopt.result import NOT_RECHECKED, Result, Unchecked
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.chain.certainty import less
from wormopt.systems.chain.copies import Draw
from wormopt.systems.chain.measured import (
    balance,
    chain_checks,
    funnel_checks,
)
from wormopt.systems.chain.rival_decisions import Decided, decide, decision_jobs
from wormopt.systems.chain.rivals import (
    PLANS,
    Answer,
    Job,
    Plan,
    Rival,
    draw_plants,
    driven,
    plans_of,
    rivals,
    solve,
)
from wormopt.systems.chain.runs.compare_judging import TOLD, JudgedRun, drawn_numbers, judge, know
from wormopt.systems.chain.runs.compare_tables import Known, table_of
from wormopt.systems.chain.scenes.compare_tracking import (
    COMPARED,
    RANKED,
    CompareScene,
    DesignedShape,
)
from wormopt.systems.shared.proof import accepted_error
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import fitted, sample
from wormopt.systems.spiked import (
    GaitProblem,
    Limits,
    Objective,
    Search,
    Worm,
    designed,
    gait_of_shape,
)

# Pieces of a designed gait shorter than this share of the period are left out.
_SHORT = 1e-6


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[CompareScene], report: Report) -> Result:
    """Plan, close the loops, simulate all motions exactly, and compare the controllers.

    The result is "failed" if a second route or the energy balance does not confirm a nominal
    motion. Raises SceneError for a gait's file, and SolveError if a design or nominal motion fails.
    """
    table, clock = scene.table, time.perf_counter()
    report("designing the references", 0.0)
    gaits = [_gait(scene, k) for k in range(len(table.reference))]
    draws = draw_plants(table, gaits[0])
    designed = time.perf_counter()
    plans = _plan(table, gaits, draws[: table.draws.known], report)
    decided = _decide(table, gaits, draws, report)
    ready = time.perf_counter()
    runs = [
        [
            judge(table, rival, draws, k == 0, report)
            for rival in (
                *_rivals(scene, gait, {n: a.plan for n, a in plans[k].items()}),
                *_predictive(table, gait, decided[k]),
            )
        ]
        for k, gait in enumerate(gaits)
    ]
    simulated = time.perf_counter()
    known = [know(table, gaits[0], name, answer, draws) for name, answer in plans[0].items()]
    timings = {
        "design": designed - clock,
        "optimise": ready - designed,
        "simulate": simulated - ready,
        "know": time.perf_counter() - simulated,
    }
    return _result(scene, plans, decided, runs, known, timings)


def _gait(scene: Scene[CompareScene], index: int) -> Gait:
    shape = scene.table.reference[index].gait
    if not isinstance(shape, DesignedShape):
        return gait_of_shape(shape, scene, f"reference[{index}].gait")
    links = scene.table.worm.links
    limits = Limits(shape.period, shape.length, rate=shape.rate, acceleration=shape.acceleration)
    order = Search(sequence=tuple((i,) for i in range(links, -1, -1)))
    problem = GaitProblem(Worm(links, load=shape.load), limits, Objective())
    found = designed(problem, order, silent)
    return _without_short_pieces(found.gait)


def _without_short_pieces(gait: Gait) -> Gait:
    """Leave out phases of nearly zero duration: grids and simulations stop at every break."""
    lasting = np.diff(gait.breaks) > _SHORT * gait.period
    breaks = np.concatenate([[0.0], np.cumsum(np.diff(gait.breaks)[lasting])])
    whole = Gait(breaks, gait.polynomial[lasting])
    return whole.with_period(gait.period)


def _plan(
    table: CompareScene, gaits: Sequence[Gait], draws: Sequence[Draw], report: Report
) -> list[dict[str, Answer]]:
    """Optima by reference and kind of plan; the crawl has no reference."""
    names = plans_of(table)
    long_first = [name for name in (PLANS[1], PLANS[0], PLANS[2]) if name in names]
    wanted = [(name, 0) for name in long_first]
    wanted += [(n, k) for k in range(1, len(gaits)) for n in long_first if n != PLANS[2]]
    jobs = [Job(name, table, gaits[k], draws if k == 0 else ()) for name, k in wanted]
    found: list[dict[str, Answer]] = [{} for _ in gaits]
    if not jobs:
        return found
    with Workers(table.workers) as workers:
        for n, ((name, k), answer) in enumerate(zip(wanted, workers.map(solve, jobs), strict=True)):
            report("optimising", 0.05 + 0.6 * (n + 1) / len(jobs))
            found[k][name] = answer
    if PLANS[2] in names:
        for plans in found:
            plans[PLANS[2]] = found[0][PLANS[2]]
    return [{name: plans[name] for name in names} for plans in found]


def _rivals(
    scene: Scene[CompareScene], gait: Gait, plans: Mapping[str, Plan | None]
) -> list[Rival]:
    """Make all controllers; raises SceneError for one that cannot start at the initial state."""
    try:
        return list(rivals(scene.table, gait, plans))
    except ArgumentError as error:
        raise SceneError(scene.name, [("tracker", str(error))]) from None


def _decide(
    table: CompareScene, gaits: Sequence[Gait], draws: Sequence[Draw], report: Report
) -> list[dict[str, Decided]]:
    """Decisions of the predictive controllers, by reference and name."""
    jobs = list(decision_jobs(table, gaits, draws))
    found: list[dict[str, Decided]] = [{} for _ in gaits]
    if not jobs:
        return found
    with Workers(table.workers) as workers:
        for job, answer in zip(jobs, workers.map(decide, jobs), strict=True):
            report(f"decided: {job.name}", 0.65)
            found[next(k for k, g in enumerate(gaits) if g is job.gait)][job.name] = answer
    return [{name: each[name] for name in sorted(each)} for each in found]


def _predictive(table: CompareScene, gait: Gait, decided: Mapping[str, Decided]) -> Iterator[Rival]:
    for name, each in decided.items():
        if each.believed is not None:
            yield Rival(name, driven(table, gait, each.believed), each.others)


# -- checks and warnings ---------------------------------------------------------------------------


def _result(
    scene: Scene[CompareScene],
    plans: Sequence[Mapping[str, Answer]],
    decided: Sequence[Mapping[str, Decided]],
    runs: Sequence[Sequence[JudgedRun]],
    known: Sequence[Known],
    timings: dict[str, float],
) -> Result:
    table, tolerance = scene.table, tolerance_of(scene.table.tolerance)
    names = [each.name for each in table.reference]
    energies = [[each.motion and balance(each.motion) for each in row] for row in runs]
    checks = [
        check
        for name, row, balances in zip(names, runs, energies, strict=True)
        for each, energy in zip(row, balances, strict=True)
        for check in chain_checks(each.second, energy, tolerance, f"{name}, {each.rival.name}")
    ]
    checks += [
        check
        for name, row in zip(names, runs, strict=True)
        for each in row
        if each.motion is not None
        for check in funnel_checks(each.rival.model, each.motion, f"{name}, {each.rival.name}: ")
    ]
    residuals = [abs(each.residual) for row in energies for each in row if each]
    text = table_of(
        table,
        names,
        [{e.rival.name: {n: e.numbers[n] for n in TOLD} for e in row} for row in runs],
        [{e.rival.name: e.drawn for e in row} for row in runs],
        known,
    )
    return conclude(
        scene,
        _scalars(table, plans, runs, known),
        _signals(table, runs, known),
        checks=checks,
        facts={
            "treatment": "complementarity in the optimiser, exact in every simulation",
            "recheck": {
                "route": next((e.second.route for e in runs[0] if e.second), None),
                "error": {e.rival.name: e.second and e.second.error for e in runs[0]},
                "accepted": accepted_error(tolerance),
            },
            "energy_balance": max(residuals, default=None),
            "plans": [{name: a.numbers for name, a in row.items()} for row in plans],
            "decisions": [{name: d.numbers for name, d in row.items()} for row in decided],
        },
        warnings=[
            *_warnings(names, plans, decided, runs, known),
            *_not_rechecked(runs[0], asked=bool(table.tolerance.recheck)),
        ],
        timings=timings,
        attributes={
            "references": names,
            "rivals": _names(runs),
            "known": [each.name for each in known],
            "table": text,
        },
    )


def _scalars(
    table: CompareScene,
    plans: Sequence[Mapping[str, Answer]],
    runs: Sequence[Sequence[JudgedRun]],
    known: Sequence[Known],
) -> dict[str, Any]:
    rows = _aligned(runs)
    solved = [*plans[0].values()]
    solved += [row[name] for row in plans[1:] for name in row if name != PLANS[2]]
    rechecked = [e.second.error for e in runs[0] if e.second and e.second.error is not None]
    return {name: [[e and e.numbers[name] for e in row] for row in rows] for name in TOLD} | {
        "tube_radius": table.tube.radius,
        "draws": table.draws.members,
        "draws_failed": [[e and e.drawn.failed for e in row] for row in rows],
        "draws_outside": [[e and e.drawn.outside for e in row] for row in rows],
        "known_plants": table.draws.known,
        "known_failed": [each.drawn.failed for each in known],
        "solve_iterations": sum(answer.iterations for answer in solved),
        "recheck_error": max(rechecked, default=None),
    }


def _names(runs: Sequence[Sequence[JudgedRun]]) -> list[str]:
    """Names of all controllers; a plan that was not found may be missing for a reference."""
    return [*dict.fromkeys(e.rival.name for row in sorted(runs, key=len)[::-1] for e in row)]


def _aligned(runs: Sequence[Sequence[JudgedRun]]) -> list[list[JudgedRun | None]]:
    """Rows with an entry for every name."""
    rows = [{e.rival.name: e for e in row} for row in runs]
    return [[row.get(name) for name in _names(runs)] for row in rows]


def _signals(
    table: CompareScene, runs: Sequence[Sequence[JudgedRun]], known: Sequence[Known]
) -> dict[str, Any]:
    rows = _aligned(runs)
    sampled = [[_sampled(e.rival.model, e.motion) if e else None for e in row] for row in rows]
    one = next((s for row in sampled for s in row if s is not None), None)
    if one is None:
        raise SolveError(
            "no controller keeps the nominal plant near the tube; reduce measurement.noise or "
            "measurement.delay"
        )
    lost = {name: np.full_like(values, np.nan) for name, values in one.items()}
    arrays = {
        name: np.array([[(signals or lost)[name] for signals in row] for row in sampled])
        for name in COMPARED
    }
    none = np.full(table.draws.members, np.nan)
    found: dict[str, Any] = {
        "time": np.linspace(0.0, table.time.end, table.time.samples),
        **fitted(arrays, table.variables),
        "aim": np.array([_aim(row) for row in runs]),
    }
    for name in TOLD:
        drawn = [[e.drawn.values[name] if e else none for e in row] for row in rows]
        found[f"drawn_{name}"] = np.array(drawn)
        if table.draws.known:
            found[f"known_{name}"] = np.array([each.drawn.values[name] for each in known])
    return found | _certain(rows, table.draws.members)


def _certain(rows: Sequence[Sequence[JudgedRun | None]], members: int) -> dict[str, np.ndarray]:
    """Intervals of the quantities over the plants, and numbers of plants with the lower value."""
    lost = drawn_numbers([None] * members)
    drawn = [[e.drawn if e else lost for e in row] for row in rows]
    found = {"outside_share": np.array([[d.outside_share for d in row] for row in drawn])}
    for name in RANKED:
        found[f"median_{name}"] = np.array([[d.median(name) for d in row] for row in drawn])
        found[f"less_{name}"] = np.array(
            [less(np.array([d.values[name] for d in row])) for row in drawn]
        )
    return found


def _aim(row: Sequence[JudgedRun]) -> np.ndarray:
    """Reference over time, which every motion has; NaN if all are lost."""
    motion = next((each.motion for each in row if each.motion is not None), None)
    return np.array(np.nan) if motion is None else motion["reference"]


def _sampled(model: Model, motion: Trajectory | None) -> dict[str, np.ndarray] | None:
    if motion is None:
        return None
    outputs = {name: model[name] for name in COMPARED if name != "position"}
    return sample(motion, outputs | {"position": model["position"]})


def _not_rechecked(row: Sequence[JudgedRun], *, asked: bool) -> Iterator[str]:
    """Warn of motions of the first reference without a second route."""
    alone = [each.rival.name for each in row if each.motion and not each.second]
    if not asked:
        yield NOT_RECHECKED
    elif len(alone) == sum(each.motion is not None for each in row):
        yield Unchecked(
            "no second route rechecks a motion here: those of trackers and of delayed measurements "
            'take too long; scenes of kind "track" recheck trackers'
        )
    elif alone:
        yield f"no second route rechecks {', '.join(alone)}"


def _warnings(
    names: Sequence[str],
    plans: Sequence[Mapping[str, Answer]],
    decided: Sequence[Mapping[str, Decided]],
    runs: Sequence[Sequence[JudgedRun]],
    known: Sequence[Known],
) -> Iterator[str]:
    for reference, row in zip(names, decided, strict=True):
        for name, each in row.items():
            if each.believed is None:
                yield f"{reference}: no plan for {name}: {each.numbers['reason']}"
            if each.unsolved:
                yield (
                    f"{reference}, {name}: {each.unsolved} decisions failed; the previous "
                    "plan continued"
                )
    for reference, row in zip(names, plans, strict=True):
        for name, answer in row.items():
            if answer.plan is None:
                yield f"{reference}: no plan for {name}: {answer.numbers['reason']}"
    for reference, row in zip(names, runs, strict=True):
        for each in row:
            if each.motion is None:
                yield (
                    f"{reference}, {each.rival.name}: the error of the nominal plant exceeds "
                    "its limit; it counts as lost"
                )
            if each.drawn.failed:
                yield (
                    f"{reference}, {each.rival.name}: the simulation of {each.drawn.failed} plants "
                    "failed; they are counted, and left out of medians"
                )
    for each in known:
        if each.drawn.failed:
            yield f"{each.name}: no plan was found for {each.drawn.failed} of the known plants"
