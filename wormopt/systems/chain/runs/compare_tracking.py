"""Scenes of kind ``compare-tracking``: controllers side by side, and what knowledge is worth."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.progress import Report, silent
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.ensemble import Member, simulate_ensemble
from wormopt.simulation.options import Exact, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.chains import tolerance_of
from wormopt.systems.chain.runs.compare_tables import Drawn, Known, table_of
from wormopt.systems.chain.runs.judged import judged, judged_numbers
from wormopt.systems.chain.runs.plans import PLANS, Answer, Draw, Job, answers
from wormopt.systems.chain.runs.rivals import Rival, draw_plants, driven, rivals
from wormopt.systems.chain.runs.tracked import LOOP_SIGNALS
from wormopt.systems.chain.scenes.compare_tracking import CompareScene, DesignedShape
from wormopt.systems.shared.proof import Recheck, accepted_error, faults_of_motion, recheck
from wormopt.systems.shared.signals import CHAIN_SIGNALS, sample, simulate_whole
from wormopt.systems.shared.watch import balance
from wormopt.systems.spiked.design.optimize import design
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.runs.reference import gait_of_shape
from wormopt.systems.spiked.task import Search, Worm

# Plants that are not as believed are simulated less exactly: they differ by far more.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)
_SAMPLES = 501
# Pieces of a designed gait that shrank to less than this share of the period are left out.
_SHORT = 1e-6
_SIGNALS = ("error_norm", "length", "input", "position")
_SAID = (
    "capture_time", "time_outside_tube", "error_peak", "error_integral", "input_integral",
    "input_rms", "input_peak", "distance", "mean_speed", "work", "net_work", "cost_of_transport",
)  # fmt: skip

Numbers = dict[str, tuple[Any, str]]


@dataclass(frozen=True, eq=False)
class _Run:
    """One rival on the worm as it is believed, and on the others."""

    rival: Rival
    motion: Trajectory  # of the worm as it is believed
    second: Recheck | None  # its second route
    numbers: Numbers  # of `motion`
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
    planned = time.perf_counter()
    runs = [
        [
            _judge(scene, rival, draws, k == 0, report)
            for rival in rivals(scene, gait, {n: a.plan for n, a in plans[k].items()})
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
    return _result(scene, plans, runs, known, timings)


def _gait(scene: Scene[CompareScene], index: int) -> Gait:
    shape = scene.table.reference[index].gait
    if not isinstance(shape, DesignedShape):
        return gait_of_shape(shape, scene, f"reference[{index}].gait")
    links = scene.table.worm.links
    limits = Limits(shape.period, shape.length, rate=shape.rate, acceleration=shape.acceleration)
    order = Search(sequence=tuple((i,) for i in range(links, -1, -1)))
    found = design(Worm(links, load=shape.load), limits, search=order)
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
    for n, ((name, k), answer) in enumerate(zip(wanted, answers(jobs, table.workers), strict=True)):
        report("optimising", 0.05 + 0.6 * (n + 1) / len(jobs))
        found[k][name] = answer
    for plans in found:
        plans["fastest crawl"] = found[0]["fastest crawl"]
    return [{name: plans[name] for name in PLANS} for plans in found]


def _judge(
    scene: Scene[CompareScene], rival: Rival, draws: Sequence[Draw], check: bool, report: Report
) -> _Run:
    table = scene.table
    report(f"simulating {rival.name}", 0.7)
    model, tolerance = judged(rival.model, table.tube), tolerance_of(table.tolerance)
    motion = simulate_whole(model, table.time.end, table.time.samples, Exact(), tolerance, silent)
    # Trackers are rechecked in scenes of their own kind: their many steps take long in Python.
    check &= table.tolerance.recheck and not any(s.name == "gain" for s in rival.model.x)
    second = recheck(rival.model, motion, tolerance, report=silent) if check else None
    ensemble = simulate_ensemble(
        model,
        table.time.end,
        [Member(p=draw) for draw in draws],
        times=np.linspace(0.0, table.time.end, _SAMPLES),
        tolerance=_LOOSE,
    )
    numbers = [
        None if code else judged_numbers(each, table.tube)
        for each, code in zip(ensemble.motions, ensemble.codes, strict=True)
    ]
    return _Run(rival, motion, second, judged_numbers(motion, table.tube), _drawn(numbers))


def _drawn(numbers: Sequence[Numbers | None]) -> Drawn:
    """Numbers of every plant, not a number where it could not be simulated or never happens."""

    def column(name: str) -> np.ndarray:
        values = (None if n is None else n[name][0] for n in numbers)
        return np.array([np.nan if v is None else v for v in values], dtype=float)

    return Drawn({name: column(name) for name in _SAID}, sum(n is None for n in numbers))


def _known(
    table: CompareScene, gait: Gait, name: str, answer: Answer, draws: Sequence[Draw]
) -> Known:
    """Plans made by somebody who knows the plant, each simulated on its plant."""
    numbers: list[Numbers | None] = []
    for plan, draw in zip(answer.known, draws, strict=False):
        motion = None
        if plan is not None:
            with suppress(SolveError):  # counted as one that is not found
                motion = simulate(
                    judged(driven(table, gait, plan), table.tube),
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
    runs: Sequence[Sequence[_Run]],
    known: Sequence[Known],
    timings: dict[str, float],
) -> Result:
    table, tolerance = scene.table, tolerance_of(scene.table.tolerance)
    faults = [
        f"{table.reference[k].name}, {each.rival.name}: {fault}"
        for k, row in enumerate(runs)
        for each in row
        for fault in faults_of_motion(each.second, balance(each.motion), tolerance)
    ]
    names = [each.name for each in table.reference]
    text = table_of(
        table,
        names,
        [{e.rival.name: {n: e.numbers[n][0] for n in _SAID} for e in row} for row in runs],
        [{e.rival.name: e.drawn for e in row} for row in runs],
        known,
    )
    energies = [balance(e.motion) for row in runs for e in row]
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(table, plans, runs, known),
        variables=tuple(_variables(scene, runs, known)),
        trust={
            "treatment": "complementarity in the optimiser, exact in every simulation",
            "recheck": {
                "route": next((e.second.route for e in runs[0] if e.second), None),
                "error": {e.rival.name: e.second and e.second.error for e in runs[0]},
                "accepted": accepted_error(tolerance),
            },
            "energy_balance": max((abs(e.residual) for e in energies if e), default=None),
            "plans": [{name: a.numbers for name, a in row.items()} for row in plans],
            "warnings": list(_warnings(names, plans, runs, known)),
        },
        timings_s=timings,
        scene_text=scene.text,
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
) -> dict[str, Scalar]:
    rows = _aligned(runs)
    found = {
        name: Scalar(
            [[e and e.numbers[name][0] for e in row] for row in rows],
            unit_of(runs[0][0].numbers[name][1], table.units),
        )
        for name in _SAID
    }
    solved = [*plans[0].values(), *(row[name] for row in plans[1:] for name in PLANS[:2])]
    rechecked = [e.second.error for e in runs[0] if e.second and e.second.error is not None]
    return found | {
        "tube_radius": Scalar(table.tube.radius, unit_of("length", table.units)),
        "draws": Scalar(table.draws.members),
        "draws_failed": Scalar([[e and e.drawn.failed for e in row] for row in rows]),
        "draws_outside": Scalar([[e and e.drawn.outside for e in row] for row in rows]),
        "known_plants": Scalar(table.draws.known),
        "known_failed": Scalar([each.drawn.failed for each in known]),
        "solve_iterations": Scalar(sum(answer.iterations for answer in solved)),
        "recheck_error": Scalar(max(rechecked, default=None)),
    }


def _names(runs: Sequence[Sequence[_Run]]) -> list[str]:
    """Names of all rivals; one whose plan was not found may lack for some reference."""
    return [*dict.fromkeys(e.rival.name for row in sorted(runs, key=len)[::-1] for e in row)]


def _aligned(runs: Sequence[Sequence[_Run]]) -> list[list[_Run | None]]:
    """Rows with an entry for every name."""
    rows = [{e.rival.name: e for e in row} for row in runs]
    return [[row.get(name) for name in _names(runs)] for row in rows]


def _variables(
    scene: Scene[CompareScene], runs: Sequence[Sequence[_Run]], known: Sequence[Known]
) -> Iterator[Variable]:
    units, rows = scene.table.units, _aligned(runs)
    dims, first = ("reference", "rival"), runs[0][0]
    yield Variable("time", unit_of("time", units), ("time",), first.motion.time, "time")
    signals = [[e and _signals(e) for e in row] for row in rows]
    lost = {name: np.full_like(values, np.nan) for name, values in _signals(first).items()}
    for name in _SIGNALS:
        quantity, own, long_name = (LOOP_SIGNALS | CHAIN_SIGNALS)[name]
        values = np.array([[(s or lost)[name] for s in row] for row in signals])
        values = values if own else values[:, :, 0]
        yield Variable(name, unit_of(quantity, units), (*dims, *own, "time"), values, long_name)
    aims = np.array([row[0].motion.output("reference") for row in runs])
    unit = unit_of("length", units)
    yield Variable("aim", unit, ("reference", "link", "time"), aims, "reference of the link length")
    none = np.full(scene.table.draws.members, np.nan)
    for name in _SAID:
        unit = unit_of(first.numbers[name][1], units)
        values = np.array([[e.drawn.values[name] if e else none for e in row] for row in rows])
        long_name = f"{name} of the plant"
        yield Variable(f"drawn_{name}", unit, (*dims, "member"), values, long_name)
        if scene.table.draws.known:
            values = np.array([each.drawn.values[name] for each in known])
            long_name = f"{name} of the plant, which is known"
            yield Variable(f"known_{name}", unit, ("plan", "known_member"), values, long_name)


def _signals(each: _Run) -> dict[str, np.ndarray]:
    model = each.rival.model
    position = next(s.symbol for s in model.x if s.name == "position")
    expressions = {name: model.output(name) for name in _SIGNALS if name != "position"}
    return sample(each.motion, expressions | {"position": position})


def _warnings(
    names: Sequence[str],
    plans: Sequence[Mapping[str, Answer]],
    runs: Sequence[Sequence[_Run]],
    known: Sequence[Known],
) -> Iterator[str]:
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
