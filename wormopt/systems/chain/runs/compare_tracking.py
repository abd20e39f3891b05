"""Scenes of kind ``compare-tracking``: controllers side by side, and what knowledge is worth."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.control.reference import gait_reference
from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.model.gait import Gait
from wormopt.numerics.workers import Workers
from wormopt.progress import Report, silent
from wormopt.result import Result
from wormopt.scene.conclude import conclude
from wormopt.scene.scene import Scene
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Exact, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.copies import Draw
from wormopt.systems.chain.measured import (
    balance,
    chain_checks,
    funnel_checks,
    judged,
    judged_numbers,
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
    rivals,
    solve,
)
from wormopt.systems.chain.runs.compare_tables import Drawn, Known, table_of
from wormopt.systems.chain.scenes.compare_tracking import COMPARED, CompareScene, DesignedShape
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.shared.proof import CrossCheck, accepted_error, cross_check
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import fitted, sample, simulate_whole
from wormopt.systems.spiked import (
    GaitProblem,
    Limits,
    Objective,
    Search,
    Worm,
    designed,
    gait_of_shape,
)

# Plants that are not as believed are simulated less exactly: they differ by far more.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)
_SAMPLES = 501
# Pieces of a designed gait that shrank to less than this share of the period are left out.
_SHORT = 1e-6
_TOLD = tuple(JUDGED)


@dataclass(frozen=True, eq=False)
class _Run:
    """One rival on the worm as it is believed, and on the others."""

    rival: Rival
    motion: Trajectory  # of the worm as it is believed
    second: CrossCheck | None  # its second route
    numbers: dict[str, Any]  # of `motion`
    drawn: Drawn  # of the other plants


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[CompareScene], report: Report) -> Result:
    """Plan, close the loops, simulate all exactly, and put the figures side by side.

    "failed" where a motion as believed lacks confirmation by a second route or energy balance.
    Raises SceneError for a gait's file; SolveError if a design or nominal motion fails.
    """
    table, clock = scene.table, time.perf_counter()
    report("designing the references", 0.0)
    gaits = [_gait(scene, k) for k in range(len(table.reference))]
    draws = draw_plants(table, gaits[0])
    designed = time.perf_counter()
    plans = _plan(table, gaits, draws[: table.draws.known], report)
    decided = _decide(table, gaits, draws, report)
    planned = time.perf_counter()
    runs = [
        [
            _judge(scene, rival, draws, k == 0, report)
            for rival in (
                *_rivals(scene, gait, {n: a.plan for n, a in plans[k].items()}),
                *_predictive(table, gait, decided[k]),
            )
        ]
        for k, gait in enumerate(gaits)
    ]
    simulated = time.perf_counter()
    known = [_known(table, gaits[0], name, plans[0][name], draws) for name in PLANS]
    timings = {
        "design": designed - clock,
        "optimise": planned - designed,
        "simulate": simulated - planned,
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
    """Leave out phases that shrank to nothing: grids and simulations stop at every break."""
    lasting = np.diff(gait.breaks) > _SHORT * gait.period
    breaks = np.concatenate([[0.0], np.cumsum(np.diff(gait.breaks)[lasting])])
    whole = Gait(breaks, gait.polynomial[lasting])
    return whole.with_period(gait.period)


def _plan(
    table: CompareScene, gaits: Sequence[Gait], draws: Sequence[Draw], report: Report
) -> list[dict[str, Answer]]:
    """Answers by reference and kind of plan; the crawl knows no reference."""
    wanted = [(name, 0) for name in (PLANS[1], PLANS[0], PLANS[2])]  # those that take long first
    wanted += [(name, k) for k in range(1, len(gaits)) for name in (PLANS[1], PLANS[0])]
    jobs = [Job(name, table, gaits[k], draws if k == 0 else ()) for name, k in wanted]
    found: list[dict[str, Answer]] = [{} for _ in gaits]
    with Workers(table.workers) as workers:
        for n, ((name, k), answer) in enumerate(zip(wanted, workers.map(solve, jobs), strict=True)):
            report("optimising", 0.05 + 0.6 * (n + 1) / len(jobs))
            found[k][name] = answer
    for plans in found:
        plans["fastest crawl"] = found[0]["fastest crawl"]
    return [{name: plans[name] for name in PLANS} for plans in found]


def _rivals(
    scene: Scene[CompareScene], gait: Gait, plans: Mapping[str, Plan | None]
) -> list[Rival]:
    """Make all rivals; raises SceneError for a controller that cannot start there."""
    try:
        return list(rivals(scene.table, gait, plans))
    except ArgumentError as error:
        raise SceneError(scene.name, [("tracker", str(error))]) from None


def _decide(
    table: CompareScene, gaits: Sequence[Gait], draws: Sequence[Draw], report: Report
) -> list[dict[str, Decided]]:
    """What predictive rivals decided, by reference and name."""
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


def _judge(
    scene: Scene[CompareScene], rival: Rival, draws: Sequence[Draw], check: bool, report: Report
) -> _Run:
    table = scene.table
    report(f"simulating {rival.name}", 0.7)
    model, tolerance = judged(rival.model, table.tube), tolerance_of(table.tolerance)
    motion = simulate_whole(model, table.time.end, table.time.samples, Exact(), tolerance, silent)
    # Trackers are rechecked in scenes of their own kind: their many steps take long in Python.
    check &= table.tolerance.recheck and not any(s.name == "gain" for s in rival.model.x)
    second = cross_check(rival.model, motion, tolerance, report=silent) if check else None
    numbers: list[dict[str, Any] | None] = [None] * len(draws)
    members = dict(scenarios(rival, draws))
    ensemble = simulate_ensemble(
        model,
        table.time.end,
        list(members.values()),
        times=np.linspace(0.0, table.time.end, _SAMPLES),
        tolerance=_LOOSE,
    )
    for k, each, code in zip(members, ensemble.motions, ensemble.codes, strict=True):
        numbers[k] = None if code else judged_numbers(each, table.tube)
    return _Run(rival, motion, second, judged_numbers(motion, table.tube), _drawn(numbers))


def scenarios(rival: Rival, draws: Sequence[Draw]) -> Iterator[tuple[int, Scenario]]:
    """Plants by their number, each with its own course of inputs where the rival decides."""
    for k, draw in enumerate(draws):
        if rival.others is None:
            yield k, Scenario(p=draw)
        elif (course := rival.others[k]) is not None:
            (own,) = gait_reference(course, rival.model.t, periodic=False, name="input").schedules
            yield k, Scenario(p=draw, schedules={"input": own.values})


def _drawn(numbers: Sequence[dict[str, Any] | None]) -> Drawn:
    """Numbers of every plant, not a number where it could not be simulated or never happens."""

    def column(name: str) -> np.ndarray:
        values = (None if n is None else n[name] for n in numbers)
        return np.array([np.nan if v is None else v for v in values], dtype=float)

    return Drawn({name: column(name) for name in _TOLD}, sum(n is None for n in numbers))


def _known(
    table: CompareScene, gait: Gait, name: str, answer: Answer, draws: Sequence[Draw]
) -> Known:
    """Plans made by somebody who knows the plant, each simulated on its plant."""
    numbers: list[dict[str, Any] | None] = []
    for plan, draw in zip(answer.known, draws, strict=False):
        motion = None
        if plan is not None:
            with suppress(SolveError):  # counted as one that is not found
                motion = simulate(
                    judged(driven(table, gait, plan.inputs, periodic=plan.periodic), table.tube),
                    table.time.end,
                    p=draw,
                    times=np.linspace(0.0, table.time.end, _SAMPLES),
                    tolerance=_LOOSE,
                )
        numbers.append(None if motion is None else judged_numbers(motion, table.tube))
    return Known(name, _drawn(numbers))


# -- what is said of it ----------------------------------------------------------------------------


def _result(
    scene: Scene[CompareScene],
    plans: Sequence[Mapping[str, Answer]],
    decided: Sequence[Mapping[str, Decided]],
    runs: Sequence[Sequence[_Run]],
    known: Sequence[Known],
    timings: dict[str, float],
) -> Result:
    table, tolerance = scene.table, tolerance_of(scene.table.tolerance)
    names = [each.name for each in table.reference]
    energies = [[balance(each.motion) for each in row] for row in runs]
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
        for check in funnel_checks(each.rival.model, each.motion, f"{name}, {each.rival.name}: ")
    ]
    residuals = [abs(each.residual) for row in energies for each in row if each]
    text = table_of(
        table,
        names,
        [{e.rival.name: {n: e.numbers[n] for n in _TOLD} for e in row} for row in runs],
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
        warnings=_warnings(names, plans, decided, runs, known),
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
    runs: Sequence[Sequence[_Run]],
    known: Sequence[Known],
) -> dict[str, Any]:
    rows = _aligned(runs)
    solved = [*plans[0].values(), *(row[name] for row in plans[1:] for name in PLANS[:2])]
    rechecked = [e.second.error for e in runs[0] if e.second and e.second.error is not None]
    return {name: [[e and e.numbers[name] for e in row] for row in rows] for name in _TOLD} | {
        "tube_radius": table.tube.radius,
        "draws": table.draws.members,
        "draws_failed": [[e and e.drawn.failed for e in row] for row in rows],
        "draws_outside": [[e and e.drawn.outside for e in row] for row in rows],
        "known_plants": table.draws.known,
        "known_failed": [each.drawn.failed for each in known],
        "solve_iterations": sum(answer.iterations for answer in solved),
        "recheck_error": max(rechecked, default=None),
    }


def _names(runs: Sequence[Sequence[_Run]]) -> list[str]:
    """Names of all rivals; one whose plan was not found may lack for some reference."""
    return [*dict.fromkeys(e.rival.name for row in sorted(runs, key=len)[::-1] for e in row)]


def _aligned(runs: Sequence[Sequence[_Run]]) -> list[list[_Run | None]]:
    """Rows with an entry for every name."""
    rows = [{e.rival.name: e for e in row} for row in runs]
    return [[row.get(name) for name in _names(runs)] for row in rows]


def _signals(
    table: CompareScene, runs: Sequence[Sequence[_Run]], known: Sequence[Known]
) -> dict[str, Any]:
    rows = _aligned(runs)
    sampled = [[e and _sampled(e) for e in row] for row in rows]
    lost = {name: np.full_like(values, np.nan) for name, values in _sampled(runs[0][0]).items()}
    arrays = {
        name: np.array([[(signals or lost)[name] for signals in row] for row in sampled])
        for name in COMPARED
    }
    none = np.full(table.draws.members, np.nan)
    found: dict[str, Any] = {
        "time": runs[0][0].motion.time,
        **fitted(arrays, table.variables),
        "aim": np.array([row[0].motion["reference"] for row in runs]),
    }
    for name in _TOLD:
        drawn = [[e.drawn.values[name] if e else none for e in row] for row in rows]
        found[f"drawn_{name}"] = np.array(drawn)
        if table.draws.known:
            found[f"known_{name}"] = np.array([each.drawn.values[name] for each in known])
    return found


def _sampled(each: _Run) -> dict[str, np.ndarray]:
    model = each.rival.model
    outputs = {name: model[name] for name in COMPARED if name != "position"}
    return sample(each.motion, outputs | {"position": model["position"]})


def _warnings(
    names: Sequence[str],
    plans: Sequence[Mapping[str, Answer]],
    decided: Sequence[Mapping[str, Decided]],
    runs: Sequence[Sequence[_Run]],
    known: Sequence[Known],
) -> Iterator[str]:
    for reference, row in zip(names, decided, strict=True):
        for name, each in row.items():
            if each.believed is None:
                yield f"{reference}: no {name}: {each.numbers['reason']}"
            if each.unsolved:
                yield f"{reference}, {name}: {each.unsolved} decisions were not solved"
    for reference, row in zip(names, plans, strict=True):
        for name, answer in row.items():
            if answer.plan is None:
                yield f"{reference}: no {name}: {answer.numbers['reason']}"
    for reference, row in zip(names, runs, strict=True):
        for each in row:
            if each.drawn.failed:
                yield (
                    f"{reference}, {each.rival.name}: {each.drawn.failed} of the plants could not "
                    "be simulated; they are counted, and left out of medians"
                )
    for each in known:
        if each.drawn.failed:
            yield f"{each.name}: not found for {each.drawn.failed} of the plants that are known"
