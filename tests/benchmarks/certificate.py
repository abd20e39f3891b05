"""Bounds on the speed of G1, whose optimum is known: how near in what time.

Ours speaks of every gait of any phases and cycles. SCIP, a solver for all kinds of programs, is
given the best order and one cycle, on arcs of free duration with velocities linear within them, of
which six a phase are enough. HiGHS bounds the mixed-integer program on equal steps, whose optimum
is below that of G1: no proof for other gaits. `table` prints the bounds of the documentation.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.benchmarks.design_cases import G1, Arrays, task_of
from tests.benchmarks.design_rivals import Grid, milp_bound
from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.progress import silent
from wormopt.systems.spiked.certify.bound import bounded, gap_of
from wormopt.systems.spiked.certify.certificate import verify
from wormopt.systems.spiked.design.optimize import designed
from wormopt.systems.spiked.gait_problem import Certify, GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits

EXACT = 14 * math.sqrt(1394) / 125 - 839 / 250
_ORDER, _ARCS = (0, 2, 1), 6  # that rest by turns in the best gait; arcs a phase
_LIMIT = 60.0  # s


def task(_name: str, quick: bool) -> Task:
    """The bound over the optimum; a bound below it is no bound."""
    gaps = (0.05, 0.03, 0.02) if quick else (0.05, 0.03, 0.02, 0.015, 0.012, 0.01)
    times = (0.5, 1.0) if quick else (0.5, 1.0, 3.0, 10.0, 30.0)
    return Task(
        "bounds on the speed of G1",
        "exact optimum 14 sqrt(1394)/125 - 839/250",
        "bound over the optimum, less 1",
        "gap asked; of SCIP seconds, of HiGHS steps a cycle",
        0.05,
        np.ones(1),
        [
            Way(OWN, _own, gaps),
            Way("SCIP, one order", _scip, times),
            Way("HiGHS, equal steps", _highs, (6, 12) if quick else (6, 12, 24)),
        ],
    )


def _proven(bound: float) -> np.ndarray:
    """Over the optimum; no number if it is below, which no proof can be."""
    return np.array([bound / EXACT if bound >= EXACT * (1 - 1e-9) else math.nan])


def _own() -> Run:
    problem = task_of(G1)

    def run(gap: float) -> np.ndarray:
        return _proven(bounded(problem, EXACT, Certify(gap, _LIMIT), silent).bound)

    return run


def _highs() -> Run:
    limits = Arrays.of(G1)
    return lambda steps: np.array([milp_bound(limits, Grid(int(steps), 1.0), _LIMIT) / EXACT])


def _scip() -> Run:
    import pyscipopt  # type: ignore[import-not-found]

    def run(seconds: float) -> np.ndarray:
        program = _program(pyscipopt)
        program.setParam("limits/time", seconds)
        program.optimize()
        return _proven(float(program.getDualbound()))

    return run


def _program(scip: Any) -> Any:
    """G1 with its masses resting in one order: linear but for lengths and the way."""
    program, limits = scip.Model(), Arrays.of(G1)
    program.hideOutput()
    n, phases = limits.links, len(_ORDER)
    count, (shortest, longest) = phases * _ARCS, limits.length[0]

    def variable(low: float, high: float) -> Any:
        return program.addVar(lb=low, ub=float(high))

    d = [variable(0, 1) for _ in range(count)]
    program.addCons(scip.quicksum(d) == limits.period[0])
    v = [[variable(0, limits.fastest[i]) for i in range(n + 1)] for _ in range(count)]
    length = [[variable(shortest, longest) for _ in range(n)] for _ in range(count)]
    way = [variable(0, 1) for _ in range(count)]
    for k in range(count):
        rest, after = _ORDER[k // _ARCS], (k + 1) % count
        program.addCons(v[k][rest] == 0)
        program.addCons(v[after][rest] == 0)
        gained = scip.quicksum(m * (v[after][i] - v[k][i]) for i, m in enumerate(limits.mass))
        program.addCons(gained >= -limits.static_load * d[k])
        program.addCons(2 * way[k] <= (v[k][0] + v[after][0]) * d[k])
        for i in range(n):
            rates = [v[j][i] - v[j][i + 1] for j in (k, after)]
            program.addCons(rates[0] >= -limits.contraction[i])
            program.addCons(rates[0] <= limits.extension[i])
            for sign in (1, -1):
                most = limits.acceleration[i] * d[k]
                program.addCons(sign * (rates[1] - rates[0]) <= most)
            program.addCons(length[after][i] == length[k][i] + (rates[0] + rates[1]) * d[k] / 2)
    program.setObjective(scip.quicksum(way), "maximize")
    return program


def table() -> Iterator[str]:
    """Rows of the table on the page on certificates: gaits, bounds, processor seconds."""
    yield "| problem | gait | bound | gap | bound, s | verification, s |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for name, problem, gap in _problems():
        gait = designed(problem, Search(workers=1), silent).value
        begun = time.process_time()
        proven = bounded(problem, gait, Certify(gap, 2 * _LIMIT), silent)
        solved = time.process_time()
        verified = "none"
        if proven.certificate is not None and verify(proven.certificate).holds:
            verified = f"{time.process_time() - solved:.2f}"
        left = gap_of(gait, proven.bound, problem.objective.minimise is not None)
        yield (
            f"| {name} | {gait:.6f} | {proven.bound:.6f} | {100 * left:.2f} % "
            f"| {solved - begun:.1f} | {verified} |"
        )


def _problems() -> Iterator[tuple[str, GaitProblem, float]]:
    """Problems of the table, each with the gap that is asked for."""

    def problem(
        links: int = 2, drag: float = 0.0, peak_at: float | None = None, **more: Any
    ) -> GaitProblem:
        given = {"length": (0.7, 1.3), "rate": 1.0, "acceleration": 20.0, "period": (0.2, 20.0)}
        objective = Objective("peak_spike_load", peak_at) if peak_at else Objective()
        return GaitProblem(Worm(links, drag=drag, load=5.0), Limits(**given | more), objective)

    yield "one link", problem(1), 0.01
    yield "two links (G1)", problem(), 0.01
    yield "two links (G1)", problem(), 0.002
    yield "period 1", problem(period=1.0), 0.01
    yield "`drag = 1`", problem(drag=1.0), 0.01
    yield "`spike_load = 25`", problem(spike_load=25.0), 0.01
    yield "`actuator_force = 15`", problem(actuator_force=15.0), 0.01
    yield "`resting = 2`", problem(resting=2), 0.01
    unlike = {"rate": (1.0, 0.6), "length": ((0.7, 1.3), (0.7, 1.1))}
    yield "unlike rates and lengths", problem(**unlike), 0.01
    yield "period 1, least peak spike load at 0.75", problem(peak_at=0.75, period=1.0), 0.01
    yield "three links", problem(3), 0.01
    yield "three links, `resting = 2`", problem(3, resting=2), 0.01
    yield "four links", problem(4), 0.01
