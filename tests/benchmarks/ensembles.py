"""Many copies of the chapter's worm on springs that differ: in lanes beside one after the other."""

from __future__ import annotations

from functools import partial

import numpy as np

from tests.benchmarks.cases import track
from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate

_MEMBERS, _FEW = 200, 32
_SPAN, _SMOOTH = 10.0, Smooth(1 / 40)
_TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-10, 1e-11)


def task(_name: str, quick: bool) -> Task:
    """Where the worms of `track14` are at t = 10; the time is that of all of them."""
    springs = np.linspace(7.0, 13.0, _FEW if quick else _MEMBERS)
    return Task(
        f"{len(springs)} worms of track14, spring constants from 7 to 13",
        "members by CasADi's CVODES at 1e-13",
        "places of nine members at the end",
        "relative tolerance",
        1e-9,
        _known(springs[_looked_at(springs)]),
        [
            Way(OWN, partial(_in_lanes, springs, None), _TOLERANCES),
            Way(f"{OWN}, one thread", partial(_in_lanes, springs, 1), _TOLERANCES),
            Way(f"{OWN}, one by one", partial(_one_by_one, springs), _TOLERANCES),
        ],
    )


def _looked_at(springs: np.ndarray) -> np.ndarray:
    return np.linspace(0, len(springs) - 1, 9).astype(int)


def _known(springs: np.ndarray) -> np.ndarray:
    model, tight = track("filter"), Tolerance(1e-13, 1e-14)
    ends = [
        simulate(
            model, _SPAN, p={"stiffness": c}, contact=_SMOOTH, tolerance=tight, route="cvodes"
        ).end[:3]
        for c in springs
    ]
    return np.array(ends)


def _in_lanes(springs: np.ndarray, threads: int | None) -> Run:
    model = track("filter")
    members = [Scenario(p={"stiffness": c}) for c in springs]

    def run(tolerance: float) -> np.ndarray:
        asked = Tolerance(tolerance, 0.1 * tolerance)
        found = simulate_ensemble(
            model, _SPAN, members, contact=_SMOOTH, tolerance=asked, threads=threads
        )
        return found.end[_looked_at(springs), :3]

    return run


def _one_by_one(springs: np.ndarray) -> Run:
    model = track("filter")

    def run(tolerance: float) -> np.ndarray:
        asked = Tolerance(tolerance, 0.1 * tolerance)
        ends = [
            simulate(model, _SPAN, p={"stiffness": c}, contact=_SMOOTH, tolerance=asked).end[:3]
            for c in springs
        ]
        return np.array(ends)[_looked_at(springs)]

    return run
