"""Design a gait: search the sequence, polish it, and refine it until halving arcs changes nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wormopt.core.gait import Gait
from wormopt.core.modes import ModeSequence, ceiling
from wormopt.errors import SolveError
from wormopt.gaits.problem import gait_problem, rate_bounds
from wormopt.gaits.search import (
    Candidate,
    Job,
    Sequence_,
    Survey,
    Task,
    attempts,
    effort_of,
    mesh_of,
    program_of,
    search,
    start_of,
    workers_of,
)
from wormopt.optimal.collocation import Collocation, bernstein_matrix
from wormopt.optimal.elastic import elastic
from wormopt.optimal.nlp import Bounds, Ipopt, Solution
from wormopt.optimal.phases import Arcs, Mesh, PhaseProgram
from wormopt.progress import Report
from wormopt.scenes.gait_design import Search

__all__ = ["Design", "design", "gait_of_arcs"]

# Refinement stops when halving every arc changes the objective by less than this, relatively.
_RESOLVED = 3e-8


@dataclass(frozen=True)
class Design:
    """A designed gait with what is known of its quality.

    Parameters
    ----------
    gait : Gait
        The gait.
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    ceiling : float
        Bound on the speed by rates and modes alone.
    relative_error : float
        Relative change of the objective when every arc is halved and the gait optimised again.
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
    ceiling: float
    relative_error: float
    survey: Survey
    solution: Solution
    mesh: Mesh
    timings_s: dict[str, float]
    interrupted: bool = False


def design(task: Task, settings: Search, report: Report) -> Design:
    """Design the best gait that a scene asks for.

    Parameters
    ----------
    task : Task
        Worm, limits and objective.
    settings : Search
        How to search.
    report : callable
        Told what goes on.

    Returns
    -------
    Design
        Optimal for its sequence of resting masses, the best of those searched.

    Raises
    ------
    SolveError
        If no gait meets the limits; the message names those in conflict.
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
    survey = search(task, settings, report)
    if not survey.candidates:
        report("looking for the limits in conflict", 0.8)
        raise _conflict(task, settings)
    searched = time.perf_counter()
    candidate, interrupted = survey.candidates[0], survey.interrupted
    try:
        if not interrupted:
            report("polishing", 0.8)
            candidate = _polish(task, settings, survey)
            report("refining", 0.9)
            program, solution, error = _refine(task, candidate)
    except KeyboardInterrupt:
        interrupted = True
    if interrupted:
        program, solution = _as_found(task, candidate)
        error = np.nan
    refined = time.perf_counter()
    return Design(
        gait=gait_of_arcs(program.unpack(solution.w), program.mesh, task.worm.links),
        sequence=candidate.sequence,
        ceiling=bound,
        relative_error=error,
        interrupted=interrupted,
        survey=survey,
        solution=solution,
        mesh=program.mesh,
        timings_s={"search": searched - clock, "polish_and_refine": refined - searched},
    )


def _ceiling(task: Task) -> float:
    contraction, extension = rate_bounds(task.limits, task.worm.links)
    return ceiling(contraction.tolist(), extension.tolist(), task.limits.resting)


def _polish(task: Task, settings: Search, survey: Survey) -> Candidate:
    """Try the best sequences again, with more arcs and more starts."""
    effort = effort_of(settings)
    close = survey.candidates[0].objective + 1e-2 * abs(survey.candidates[0].objective)
    best = [c for c in survey.candidates[: effort.polished] if c.objective <= close]
    jobs = [
        Job(task, c.sequence, (settings.seed, 1000 + k), 8)
        for c in best
        for k in range(effort.starts + 1)
    ]
    found = [c for c in attempts(jobs, workers_of(settings)).values() if c is not None]
    # Coarse and fine candidates carry the barrier's bias; a tie goes to the finer mesh.
    return min([*found, *best], key=lambda c: (round(c.objective, 4), -c.mesh.arcs, c.objective))


def _bounds(task: Task, program: PhaseProgram, sequence: Sequence_) -> Bounds:
    return program.bounds(ModeSequence.of_resting(sequence, task.worm.links + 1))


def _refine(task: Task, candidate: Candidate) -> tuple[PhaseProgram, Solution, float]:
    """Raise the degree, then halve arcs, until halving every arc changes nothing."""
    program = program_of(task, candidate.mesh)
    bounds = _bounds(task, program, candidate.sequence)
    start = program.nlp.start(program.pack(candidate.arcs), bounds)
    solution = program.nlp.improve(start, bounds)
    for mesh in _finer(candidate.mesh):
        halved = replace(program.mesh, arcs=2 * program.mesh.arcs)
        fine, better = _transfer(task, candidate.sequence, program, solution, halved)
        error = abs(better.objective - solution.objective) / abs(better.objective)
        if error <= _RESOLVED or mesh is None:
            break
        program, solution = _transfer(task, candidate.sequence, program, solution, mesh)
    if better.objective < solution.objective - 1e-12:
        program, solution = fine, better
    return program, solution, error


def _as_found(task: Task, candidate: Candidate) -> tuple[PhaseProgram, Solution]:
    """Bring a candidate onto its limits without optimising on."""
    program = program_of(task, candidate.mesh)
    bounds = _bounds(task, program, candidate.sequence)
    start = program.nlp.start(program.pack(candidate.arcs), bounds)
    return program, program.nlp.finish(start, bounds, radius=1e-7)


def _finer(mesh: Mesh) -> Iterator[Mesh | None]:
    """Meshes to go to one after another; None ends the list."""
    for degree in (4, 6):
        yield replace(mesh, collocation=Collocation(degree), input_degree=degree - 2)
    yield replace(mesh, arcs=2 * mesh.arcs, collocation=Collocation(6), input_degree=4)
    yield None


def _transfer(
    task: Task, sequence: Sequence_, program: PhaseProgram, solution: Solution, mesh: Mesh
) -> tuple[PhaseProgram, Solution]:
    """Carry a solution to a finer mesh and optimise on from there."""
    fine = program_of(task, mesh)
    bounds = _bounds(task, fine, sequence)
    w = fine.pack(program.refine(program.unpack(solution.w), mesh))
    return fine, fine.nlp.improve(fine.nlp.start(w, bounds), bounds)


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
    kept = np.flatnonzero(arcs.duration > 1e-12 * arcs.duration.sum())
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


def _conflict(task: Task, settings: Search) -> SolveError:
    """Say which limits stand against each other, by the least slack that lets a gait exist."""
    problem = elastic(gait_problem(task.worm, task.limits, task.objective))
    n = len(problem.design)
    least, where = np.inf, np.zeros(n)
    for sequence in start_of(task):
        program = PhaseProgram(problem, mesh_of(sequence, 4))
        bounds = _bounds(task, program, sequence)
        total = program.mesh.total
        w = program.rest(np.full(total, np.mean(task.limits.period_range) / total), task.rest)
        w[-n:] = 10.0
        answer = program.nlp.solve(w, bounds, Ipopt(tolerance=1e-7))
        if answer.violation < 1e-5 and answer.objective < least:
            least, where = answer.objective, program.unpack(answer.w).design
    names = {s.name: k for k, s in enumerate(problem.design) if s.name.startswith("slack ")}
    nominal = {b.name: b.nominal for b in (*problem.along, *problem.at_ends)}
    del nominal
    given = [
        f"{name.removeprefix('slack ')} (by {where[k]:.3g} of its size)"
        for name, k in names.items()
        if where[k] > 1e-5
    ]
    if not given:
        return SolveError(
            "no sequence of resting masses was solved, though the limits do not seem to conflict",
            'try search.effort = "thorough" or another search.seed',
        )
    return SolveError(
        "no gait meets these limits together; the least that has to give way is "
        + ", ".join(given),
        "relax one of them, or lower objective.speed or gait.resting",
    )
