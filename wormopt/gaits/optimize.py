"""Design a gait: search the sequence of resting masses, polish it, refine it; or say why not."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.core.ceiling import ceiling
from wormopt.core.gait import Gait
from wormopt.core.modes import ModeSequence
from wormopt.errors import SolveError
from wormopt.gaits.attempt import Task, mesh_of
from wormopt.gaits.polish import as_found, polish, refine
from wormopt.gaits.problem import gait_problem, rate_bounds
from wormopt.gaits.search import Survey, constructed_sequences, search
from wormopt.gaits.sequences import Sequence_
from wormopt.optimal.collocation import bernstein_matrix
from wormopt.optimal.elastic import elastic
from wormopt.optimal.mesh import Arcs, Mesh
from wormopt.optimal.nlp import Ipopt, Solution
from wormopt.optimal.transcription import Transcription
from wormopt.progress import Report
from wormopt.scenes.gait_search import Search

__all__ = ["Design", "design", "gait_of_arcs"]


@dataclass(frozen=True)
class Design:
    """A designed gait with what is known of its quality.

    Parameters
    ----------
    gait : Gait
        The gait.
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    durations : tuple of float
        How long each phase is.
    ceiling : float
        Bound on the speed by rates and modes alone, for any sequence.
    relative_error : float
        Relative gain in the objective that is left, to first order, when every arc is halved;
        NaN if that was not reached.
    survey : Survey
        What was searched.
    solution : Solution
        How the last nonlinear program ended.
    mesh : Mesh
        The final mesh.
    timings_s : dict of str to float
        Seconds of each stage.
    interrupted : bool
        Whether the user stopped it before it was done.
    """

    gait: Gait
    sequence: Sequence_
    durations: tuple[float, ...]
    ceiling: float
    relative_error: float
    survey: Survey
    solution: Solution
    mesh: Mesh
    timings_s: dict[str, float]
    interrupted: bool = False


def design(task: Task, settings: Search, report: Report, hints: Sequence[Sequence_] = ()) -> Design:
    """Design the best gait that a scene asks for.

    Search, polish and refinement in turn. A required speed above the ceiling of rates and modes
    is refused at once; where nothing is found, `elastic` names the limits in conflict.

    Parameters
    ----------
    task : Task
        Worm, limits and objective.
    settings : Search
        How to search.
    report : callable
        Told what goes on.
    hints : sequence of sequences, optional
        Sequences of resting masses to try first.

    Returns
    -------
    Design
        Optimal for its sequence of resting masses, the best of those searched.

    Raises
    ------
    SolveError
        If no gait meets the limits; the message names those in conflict.
    KeyboardInterrupt
        If the user stops it before the search found a gait.

    Examples
    --------
    >>> from wormopt.progress import silent
    >>> from wormopt.scenes.gait_design import GaitLimits, Objective
    >>> from wormopt.scenes.worm import WormTable
    >>> worm = WormTable(links=2, mass=1.0, load=5.0)
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> fastest = Task(worm, limits, Objective(maximise="speed"))
    >>> found = design(fastest, Search(effort="quick"), silent)  # doctest: +SKIP
    >>> too_fast = Task(worm, limits, Objective(minimise="peak_spike_load", speed=2.0))
    >>> design(too_fast, Search(effort="quick"), silent)
    Traceback (most recent call last):
    wormopt.errors.SolveError: objective.speed = 2 is above the ceiling 1 that ...
    """
    bound = _ceiling(task)
    required = task.objective.speed
    if required is not None and required > bound:
        raise SolveError(
            f"objective.speed = {required:g} is above the ceiling {bound:.9g} that gait.rate, "
            "gait.acceleration and gait.resting put on any gait",
            f"require less than {bound:.6g}, or raise gait.rate",
        )
    clock = time.perf_counter()
    survey = search(task, settings, report, hints)
    if not survey.candidates:
        report("looking for the limits in conflict", 0.8)
        own = settings.sequence and tuple(tuple(sorted(s)) for s in settings.sequence)
        raise _conflict(task, [own] if own else constructed_sequences(task))
    searched = time.perf_counter()
    interrupted, error = survey.interrupted, np.nan
    found = as_found(task, survey.candidates[0]) if interrupted else None
    try:
        if found is None:
            report("polishing", 0.8)
            found = polish(task, settings, survey)
            report("refining", 0.9)
            found, error = refine(task, found)
    except KeyboardInterrupt:
        found = found or as_found(task, survey.candidates[0])
        interrupted = True
    mesh = found.program.mesh
    arcs = found.program.unpack(found.solution.w)
    durations = np.array(np.split(arcs.duration, mesh.phases)).sum(axis=1)
    return Design(
        gait=gait_of_arcs(arcs, mesh, task.worm.links),
        sequence=found.sequence,
        durations=tuple(durations.tolist()),
        ceiling=bound,
        relative_error=error,
        survey=survey,
        solution=found.solution,
        mesh=mesh,
        timings_s={
            "search": searched - clock,
            "polish_and_refine": time.perf_counter() - searched,
        },
        interrupted=interrupted,
    )


def _ceiling(task: Task) -> float:
    contraction, extension = rate_bounds(task.limits, task.worm.links)
    return ceiling(contraction.tolist(), extension.tolist(), task.limits.resting)


def gait_of_arcs(arcs: Arcs, mesh: Mesh, links: int) -> Gait:
    """Integrate link accelerations twice, arc by arc, into a Gait.

    Parameters
    ----------
    arcs : Arcs
        Motion of the model of `spiked_worm`.
    mesh : Mesh
        Its mesh.
    links : int
        Number of links n.

    Returns
    -------
    Gait
        Piecewise polynomial; arcs without duration are left out.
    """
    kept = np.flatnonzero(arcs.duration > 1e-15 * arcs.duration.sum())
    nodes, m = mesh.input_nodes, mesh.input_degree
    to_powers = np.linalg.inv(nodes[:, None] ** np.arange(m + 1)) @ np.linalg.inv(
        bernstein_matrix(nodes)
    )
    pieces = np.zeros((len(kept), links, m + 3))
    k = np.arange(m + 1)
    for row, arc in enumerate(kept):
        h = arcs.duration[arc]
        pieces[row, :, 0] = arcs.start[1 : links + 1, arc]
        pieces[row, :, 1] = arcs.start[links + 2 :, arc]
        power = arcs.inputs[:, :, arc] @ to_powers.T / h**k
        pieces[row, :, 2:] = power / ((k + 1) * (k + 2))
    return Gait(np.concatenate([[0.0], np.cumsum(arcs.duration[kept])]), pieces)


def _conflict(task: Task, sequences: Sequence[Sequence_]) -> SolveError:
    """Say which limits stand against each other, by the least slack that lets a gait exist."""
    rigid = gait_problem(task.worm, task.limits, task.objective)
    problem = elastic(rigid)
    least, slack = np.inf, np.zeros(len(problem.design))
    for sequence in sequences:
        program = Transcription(problem, mesh_of(sequence, 4))
        bounds = program.bounds(ModeSequence.of_resting(sequence, task.worm.links + 1))
        total = program.mesh.total
        w = program.rest(np.full(total, np.mean(task.limits.period_range) / total), task.rest)
        w[-len(slack) :] = 10.0
        answer = program.nlp.solve(w, bounds, Ipopt(tolerance=1e-7))
        if answer.violation < 1e-5 and answer.objective < least:
            least, slack = answer.objective, program.unpack(answer.w).design
    nominal = {b.name: b.nominal for b in (*rigid.along, *rigid.at_ends)}
    given = [
        f"{name} by {size * nominal[name]:.4g}"
        for signal, size in zip(problem.design, slack, strict=True)
        if (name := signal.name.removeprefix("slack ")) in nominal and size > 1e-5
    ]
    if not given:
        return SolveError(
            "no sequence of resting masses was solved, though the limits do not seem to conflict",
            'try search.effort = "thorough" or another search.seed',
        )
    return SolveError(
        "no gait meets these limits together; the least that has to give way is "
        + " and ".join(given),
        "relax that, or what stands against it",
    )
