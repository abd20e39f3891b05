"""Solve the best sequences to the last digits, and refine until halving arcs changes nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wormopt.core.modes import ModeSequence
from wormopt.gaits.attempt import Candidate, Job, Task, attempts, program_of
from wormopt.gaits.search import Survey, effort_of, workers_of
from wormopt.gaits.sequences import Sequence_
from wormopt.optimal.collocation import Collocation
from wormopt.optimal.mesh import Mesh, on_finer_mesh
from wormopt.optimal.nlp import Bounds, Ipopt, Solution
from wormopt.optimal.transcription import Transcription
from wormopt.scenes.gait_search import Search

__all__ = ["Solved", "as_found", "polish", "refine"]

# Refinement stops when halving every arc changes the objective by less than this, relatively.
_RESOLVED = 1e-7

# A solution counts as feasible if its scaled constraints are violated by no more.
_FEASIBLE = 1e-10


@dataclass(frozen=True)
class Solved:
    """A sequence solved on some mesh.

    Parameters
    ----------
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    program : Transcription
        The program solved.
    bounds : Bounds
        Its bounds for this sequence.
    solution : Solution
        What was found.
    """

    sequence: Sequence_
    program: Transcription
    bounds: Bounds
    solution: Solution

    @property
    def objective(self) -> float:
        """Scaled objective."""
        return self.solution.objective


def polish(task: Task, settings: Search, survey: Survey) -> Solved:
    """Try the best sequences again with more arcs, and solve each to the end.

    Taken are sequences within 1 % of the best, at most as many as the effort allows.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    settings : Search
        Seed and effort.
    survey : Survey
        From the search, with candidates.

    Returns
    -------
    Solved
        The best, on a mesh of degree 2; of sequences that tie to 1e-7, the shortest.
    """
    effort = effort_of(settings)
    record = survey.candidates[0].objective
    reach = record + 1e-2 * abs(record)
    best = [c for c in survey.candidates[: effort.polished] if c.objective <= reach]
    jobs = [
        Job(task, c.sequence, (settings.seed, 1000 + k), 8)
        for c in best
        for k in range(effort.starts + 1)
    ]
    again = attempts(jobs, workers_of(settings, task.worm.links))
    solved = []
    for coarse in best:
        fine = again[coarse.sequence]
        better = fine is not None and fine.objective < coarse.objective + 1e-3 * abs(record)
        solved.append(_solve(task, fine if fine is not None and better else coarse))
    # A sequence that contains another ties with it: the shorter is the plainer answer.
    least = min(s.objective for s in solved)
    return min(
        (s for s in solved if s.objective <= least + 1e-7 * abs(least)),
        key=lambda s: len(s.sequence),
    )


def as_found(task: Task, candidate: Candidate) -> Solved:
    """Bring a candidate onto its limits without optimising on.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    candidate : Candidate
        From the search.

    Returns
    -------
    Solved
        After Newton steps onto the constraints, see `NonlinearProgram.restore`.
    """
    program, bounds, start = _start(task, candidate)
    return Solved(candidate.sequence, program, bounds, program.nlp.restore(start, bounds))


def refine(task: Task, solved: Solved) -> tuple[Solved, float]:
    """Raise the degree, then halve arcs, until halving every arc gains less than 1e-7.

    A finer mesh is kept only if it lowers the objective.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    solved : Solved
        On a mesh of degree 2.

    Returns
    -------
    solved : Solved
        On the last mesh.
    error : float
        Relative gain that is left, to first order, when every arc is halved; infinite where the
        linear program that tells has no solution.
    """
    error = _left_by_halving(task, solved)
    for mesh in _finer(task, solved.program.mesh):
        if error <= _RESOLVED:
            break
        finer = _optimise_on(task, solved, mesh)
        if finer.objective < solved.objective and finer.solution.violation <= _FEASIBLE:
            solved, error = finer, _left_by_halving(task, finer)
    return solved, error


def _finer(task: Task, mesh: Mesh) -> Iterator[Mesh]:
    """Higher degrees, then for the speed also more arcs: costs converge slowly at their kinks."""
    for degree in (3, 5):
        yield replace(mesh, collocation=Collocation(degree), input_degree=degree - 2)
    if task.objective.minimise is None:
        yield replace(mesh, arcs=2 * mesh.arcs, collocation=Collocation(5), input_degree=3)


def _left_by_halving(task: Task, solved: Solved) -> float:
    """Relative gain that is left when every arc is halved.

    The solution is carried over and the program linearised there: the best step of the linear
    program within a box shows, to first order, what another optimisation could still gain. An
    interior-point solver's own noise is larger than that.
    """
    mesh = replace(solved.program.mesh, arcs=2 * solved.program.mesh.arcs)
    program, bounds, start = _carry(task, solved, mesh)
    step = program.nlp.linear_step(start.w, bounds, np.full(start.w.shape, 1e-2))
    return np.inf if step is None else abs(step[1] / solved.objective)


def _optimise_on(task: Task, solved: Solved, mesh: Mesh) -> Solved:
    """Carry a solution to a finer mesh and optimise on from there."""
    program, bounds, start = _carry(task, solved, mesh)
    return Solved(solved.sequence, program, bounds, _optimise(program, start, bounds))


def _carry(task: Task, solved: Solved, mesh: Mesh) -> tuple[Transcription, Bounds, Solution]:
    fine = program_of(task, mesh)
    bounds = fine.bounds(ModeSequence.of_resting(solved.sequence, task.worm.links + 1))
    coarse = solved.program
    arcs = on_finer_mesh(coarse.unpack(solved.solution.w), coarse.mesh, mesh)
    w = fine.pack(arcs, bounds)
    return fine, bounds, fine.nlp.start(w, bounds)


def _start(task: Task, candidate: Candidate) -> tuple[Transcription, Bounds, Solution]:
    program = program_of(task, candidate.mesh)
    bounds = program.bounds(ModeSequence.of_resting(candidate.sequence, task.worm.links + 1))
    return program, bounds, program.nlp.start(program.pack(candidate.arcs, bounds), bounds)


def _solve(task: Task, candidate: Candidate) -> Solved:
    program, bounds, start = _start(task, candidate)
    return Solved(candidate.sequence, program, bounds, _optimise(program, start, bounds))


def _optimise(program: Transcription, start: Solution, bounds: Bounds) -> Solution:
    """Solve from a near solution and remove the interior point's bias.

    On arcs of constant acceleration the optimum is mostly a vertex, which linear programs find
    exactly; on arcs of higher degree a smaller barrier does as well, and is faster.
    """
    nlp = program.nlp
    if program.mesh.collocation.degree == 2:
        options = Ipopt(tolerance=1e-8, mu_init=1e-6, warm=True, iterations=300)
        return nlp.finish(nlp.solve(start.w, bounds, options), bounds)
    for tolerance, barrier in ((1e-10, 1e-6), (1e-9, 1e-6), (1e-8, 1e-4)):
        options = Ipopt(tolerance=tolerance, mu_init=barrier, warm=True, iterations=300)
        solution = nlp.restore(nlp.solve(start.w, bounds, options), bounds)
        if solution.violation <= _FEASIBLE:
            break
    return solution
