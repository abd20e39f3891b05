"""Optimal control against scripts and other toolkits: seconds to build and to solve."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median

from wormopt.bench.ocp_peers import EXACT, PEERS, Grid, Solve, even, graded
from wormopt.progress import Report

THAN, MOST = "CasADi SX by hand", 2.0
"""Whose time to solve wormopt has to keep up with, and the largest ratio."""


@dataclass
class Timed:
    """How one toolkit did on one grid."""

    solver: str
    grid: str
    build: float = float("nan")  # s, of the program and its derivatives
    solves: list[float] = field(default_factory=list)  # s, of each solve after the first
    error: float = float("nan")  # difference from the exact shortest time
    iterations: int = 0  # of the nonlinear solver; 0: not told
    # s, of the last solve in the program's functions
    functions_s: dict[str, float] = field(default_factory=dict)
    missing: str = ""  # why there are no times

    @property
    def solve(self) -> float:
        """Median time of a solve, NaN where there is none."""
        return median(self.solves) if self.solves else float("nan")


def grids(*, quick: bool) -> list[Grid]:
    """Equal arcs, and graded ones for an error below 1e-7; coarser ones if `quick`."""
    return [even(20), graded(1e-7)] if quick else [even(40), graded(1e-9)]


def measure_ocp(
    chosen: Sequence[Grid], rounds: int, report: Report, names: Sequence[str] = tuple(PEERS)
) -> Iterator[list[Timed]]:
    """Build every program, then solve them in turn, so that a busy machine is fair to all.

    Yields all results so far; `rounds`: solves of each; `names`: solvers.
    """
    known: list[Timed] = []
    for k, grid in enumerate(chosen):
        ready: list[tuple[Timed, Solve]] = []
        for name in names:
            report(f"ocp: {name} on {grid.name}", k / len(chosen))
            known.append(Timed(name, grid.name))
            solve = _built(known[-1], grid)
            if solve is not None:
                ready.append((known[-1], solve))
            yield known
        for _ in range(rounds):
            for timed, solve in ready:
                _solve_once(timed, solve)
        yield known


def _built(timed: Timed, grid: Grid) -> Solve | None:
    begin = time.perf_counter()
    try:
        solve = PEERS[timed.solver](grid)
        timed.build = time.perf_counter() - begin
        solve()  # the first one is not like the others
    except ImportError as error:
        timed.missing = f"not installed: {error.name}"
    except NotImplementedError as error:
        timed.missing = str(error)
    except Exception as error:  # whatever a peer does wrong
        timed.missing = f"{type(error).__name__}: {str(error).splitlines()[0]}"
    else:
        return solve
    return None


def _solve_once(timed: Timed, solve: Solve) -> None:
    begin = time.perf_counter()
    answer = solve()
    timed.solves.append(time.perf_counter() - begin)
    timed.error, timed.iterations = answer.time - EXACT, answer.iterations
    timed.functions_s = answer.functions_s


def solve_ratio(known: Sequence[Timed], grid: str) -> float:
    """Time of a solve by wormopt over that by hand; NaN where either is unknown."""
    times = {timed.solver: timed.solve for timed in known if timed.grid == grid}
    return times.get("wormopt", float("nan")) / times.get(THAN, float("nan"))
