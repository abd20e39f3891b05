"""Bounds on the speed of G1, whose optimum is known: how near in what time.

Ours speaks of all orders of resting masses of at most four phases a cycle, and any number of
cycles. SCIP, a solver for all kinds of programs, is given the best order and one cycle, on arcs of
free duration with velocities linear within them, of which six a phase are enough. HiGHS bounds the
mixed-integer program on equal steps, whose optimum is below that of G1: no proof for other gaits.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from wormopt.bench.design_cases import G1, Arrays, task_of
from wormopt.bench.design_rivals import Grid, milp_bound
from wormopt.bench.ladder import Run, Task, Way
from wormopt.bench.run import OWN
from wormopt.progress import silent
from wormopt.systems.spiked.certify.proof import prove
from wormopt.systems.spiked.task import Certify

EXACT = 14 * math.sqrt(1394) / 125 - 839 / 250
_ORDER, _ARCS = (0, 2, 1), 6  # that rest by turns in the best gait; arcs a phase
_LIMIT = 60.0  # s


def task(_name: str, quick: bool) -> Task:
    """The bound over the optimum; a bound below it is no bound."""
    gaps = (0.2, 0.1, 0.05) if quick else (0.2, 0.1, 0.05, 0.02, 0.01, 0.003, 0.001)
    times = (0.5, 1.0) if quick else (0.5, 1.0, 3.0, 10.0, 30.0)
    return Task(
        "bounds on the speed of G1",
        "exact optimum 14 sqrt(1394)/125 - 839/250",
        "bound over the optimum, less 1",
        "gap asked; of SCIP seconds, of HiGHS steps a cycle",
        0.05,
        np.ones(1),
        [
            Way(OWN, partial(_own, workers=1), gaps),
            Way(f"{OWN}, two processes", partial(_own, workers=2), gaps),
            Way("SCIP, one order", _scip, times),
            Way("HiGHS, equal steps", _highs, (6, 12) if quick else (6, 12, 24)),
        ],
    )


def _proven(bound: float) -> np.ndarray:
    """Over the optimum; no number if it is below, which no proof can be."""
    return np.array([bound / EXACT if bound >= EXACT * (1 - 1e-9) else math.nan])


def _own(workers: int) -> Run:
    problem = task_of(G1)

    def run(gap: float) -> np.ndarray:
        proof = prove(problem, EXACT, Certify(4, gap, _LIMIT, None, workers), silent)
        return _proven(proof.progress.bound)

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
