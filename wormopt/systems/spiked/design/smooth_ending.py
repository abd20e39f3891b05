"""The last digits of a gait of least energy or effort: more arcs, then IPOPT."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.systems.spiked.design.design import Design, objective_of, of_trial
from wormopt.systems.spiked.programs.costs import has_cost_columns, is_energy
from wormopt.systems.spiked.search.search import Survey, effort_of
from wormopt.systems.spiked.search.sequences import lasting
from wormopt.systems.spiked.search.trial import Trial, Trier
from wormopt.systems.spiked.task import Search, Task

if TYPE_CHECKING:
    from wormopt.systems.spiked.design.smooth import Solved


# Halving the arcs ends where they become too many.
_MOST_UNKNOWNS, _MOST_HALVINGS = 1000, 5
# Smooth costs are solved for from so many of the best trials.
_POLISHED = 2
# Resolving the energy ends where halving gains less than this share of the whole; limits count as
# kept that are exceeded by less.
_GAINED, _KEPT = 3e-7, 1e-9


def smoothest(task: Task, settings: Search, survey: Survey, bound: float, report: Report) -> Design:
    """Resolve the best trials of a smooth cost, solve for it from the best; take the best gait.

    Parameters are those of `sharpest`. Costs of gaits are compared at last, in closed form.
    Raises SolveError if no motion is found.
    """
    known = has_cost_columns(task)  # else trials are merely fast
    trials, ended, error = list(survey.trials), survey.ended, np.nan
    solved, error_of_solved = None, np.nan
    try:
        if ended == "searched" and is_energy(task):
            trials, error = _resolved(task, settings, trials, report)
        if ended == "searched" or not known:
            report("solving for the cost", 0.9)
            solved, error_of_solved = _solved(task, trials[:_POLISHED], error, ended)
    except KeyboardInterrupt:
        ended = "interrupted"
    found = []
    if solved is not None:
        found.append(_of_solved(task, solved, survey, bound, error_of_solved, ended))
    if known:
        found.append(of_trial(task, trials[0], error, bound, survey, ended))
    if found:
        return min(found, key=_cost)
    if ended == "interrupted":
        raise KeyboardInterrupt
    raise SolveError("no motion was found for this cost", "try another search.seed")


def _cost(found: Design) -> float:
    """Smooth cost of a gait; infinite where it keeps its limits worse than solvers do."""
    if max(found.violations.values()) > _KEPT:
        return np.inf
    return objective_of(found.motion, found.task.objective.minimise)


def _resolved(
    task: Task, settings: Search, trials: list[Trial], report: Report
) -> tuple[list[Trial], float]:
    """Halve arcs of the best trials while that helps; best first, and its last relative gain."""
    trier, found = Trier(task), []
    for trial in trials[: 4 * effort_of(settings).width]:
        report("resolving the best orders", 0.85)
        gained = np.inf
        for _ in range(_MOST_HALVINGS):
            if len(trial.point.x) > _MOST_UNKNOWNS / 4:
                break
            finer = trier.finer(trial, 1e-6)
            trial, gained = finer, (finer.value - trial.value) / abs(finer.cost)
            if gained <= _GAINED:
                break
        found.append((trial, gained))
    found.sort(key=lambda one: -one[0].value)
    return [trial for trial, _ in found], found[0][1]


def _solved(
    task: Task, trials: list[Trial], error: float, ended: str
) -> tuple[Solved | None, float]:
    """The best solution from some trials, refined where those are not resolved, and its error."""
    from wormopt.systems.spiked.design.smooth import (  # a solver that few designs need
        refine_cost,
        solve_cost,
    )

    resolved = is_energy(task)
    found = [s for trial in trials[: 1 if resolved else None] if (s := solve_cost(task, trial))]
    best = min(found, key=lambda s: s.objective, default=None)
    if best is None or resolved or ended != "searched":
        return best, error
    return refine_cost(best)


def _of_solved(
    task: Task, best: Solved, survey: Survey, bound: float, error: float, ended: str
) -> Design:
    from wormopt.systems.spiked.design.smooth import gait_of_arcs

    mesh = best.program.mesh
    durations = np.bincount(mesh.phase, weights=best.arcs.duration)
    sequence, lasting_durations = lasting(best.trial.sequence, durations.tolist())
    return Design(
        task=task,
        gait=gait_of_arcs(best.arcs, mesh, task.worm.links),
        cycles=best.trial.cycles,
        sequence=sequence,
        durations=lasting_durations,
        ceiling=bound,
        error=error,
        survey=survey,
        solver={
            "status": best.solution.status,
            "violation": best.solution.violation,
            "arcs_per_phase": mesh.counts,
            "degree": mesh.collocation.degree,
        },
        timings_s={},
        ended=ended,
    )
