"""Optimal control against scripts and other toolkits: seconds to build and to solve."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median

from wormopt.bench.ocp_peers import EXACT, PEERS, Grid, Solve, even, graded
from wormopt.progress import Report

__all__ = ["MOST", "THAN", "Timed", "grids", "measure_ocp", "solve_ratio"]

THAN, MOST = "CasADi SX by hand", 2.0
"""Whose time to solve wormopt has to keep up with, and the largest ratio."""


@dataclass
class Timed:
    """How one toolkit did on one grid.

    Parameters
    ----------
    solver, grid : str
        Which.
    build : float
        Seconds to build the program and its derivatives.
    solves : list of float
        Seconds of each solve after the first.
    error : float
        Difference from the exact shortest time.
    iterations : int
        Of the nonlinear solver, 0 where it does not tell.
    functions_s : dict of str to float
        Seconds of the last solve in the program's functions.
    missing : str
        Why there are no times.
    """

    solver: str
    grid: str
    build: float = float("nan")
    solves: list[float] = field(default_factory=list)
    error: float = float("nan")
    iterations: int = 0
    functions_s: dict[str, float] = field(default_factory=dict)
    missing: str = ""

    @property
    def solve(self) -> float:
        """Median time of a solve, NaN where there is none."""
        return median(self.solves) if self.solves else float("nan")


def grids(*, quick: bool) -> list[Grid]:
    """Equal arcs, and graded ones for an error below 1e-7.

    Parameters
    ----------
    quick : bool
        Coarser ones.

    Returns
    -------
    list of Grid
    """
    return [even(20), graded(1e-7)] if quick else [even(40), graded(1e-9)]


def measure_ocp(
    chosen: Sequence[Grid], rounds: int, report: Report, names: Sequence[str] = tuple(PEERS)
) -> Iterator[list[Timed]]:
    """Build every program, then solve them in turn, so that a busy machine is fair to all.

    Parameters
    ----------
    chosen : sequence of Grid
        What to solve.
    rounds : int
        Solves of each.
    report : callable
        Told how far it is.
    names : sequence of str, optional
        Which solvers.

    Yields
    ------
    list of Timed
        All so far.
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
    """Time of a solve by wormopt over that by hand.

    Parameters
    ----------
    known : sequence of Timed
        What was measured.
    grid : str
        On which grid.

    Returns
    -------
    float
        NaN where either is unknown.

    Examples
    --------
    >>> ours, theirs = Timed("wormopt", "a", solves=[0.3]), Timed(THAN, "a", solves=[0.2])
    >>> round(solve_ratio([ours, theirs], "a"), 9)
    1.5
    """
    times = {timed.solver: timed.solve for timed in known if timed.grid == grid}
    return times.get("wormopt", float("nan")) / times.get(THAN, float("nan"))
