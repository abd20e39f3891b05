"""One attempt: a sequence of resting masses, optimised from a random start; many in processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from wormopt.core.modes import ModeSequence
from wormopt.gaits.problem import gait_problem, rate_bounds
from wormopt.gaits.sequences import Sequence_
from wormopt.optimal.collocation import Collocation
from wormopt.optimal.mesh import Arcs, Mesh
from wormopt.optimal.nlp import Bounds, Ipopt
from wormopt.optimal.transcription import Transcription
from wormopt.scenes.gait_design import GaitLimits, Objective
from wormopt.scenes.worm import WormTable

__all__ = ["Candidate", "Job", "Task", "attempt", "attempts", "mesh_of", "program_of"]


@dataclass(frozen=True)
class Task:
    """The part of a scene that the search needs; hashable, so that programs are cached by it.

    Parameters
    ----------
    worm : WormTable
        Masses, drag, load.
    limits : GaitLimits
        What the gait must keep to.
    objective : Objective
        What to seek.
    """

    worm: WormTable
    limits: GaitLimits
    objective: Objective

    @property
    def speed_nominal(self) -> float:
        """Usual size of the speed, by which the objective is scaled."""
        return float(np.max(rate_bounds(self.limits, self.worm.links)))

    @property
    def rest(self) -> np.ndarray:
        """State of `spiked_worm` at rest, links in the middle of their ranges, shape (2n + 2,)."""
        lengths = np.mean(self.limits.length_ranges(self.worm.links), axis=1)
        return np.concatenate([[0.0], lengths, [0.0], 0.0 * lengths])


@dataclass(frozen=True)
class Candidate:
    """A gait found for one sequence on the search's coarse mesh.

    Parameters
    ----------
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    objective : float
        Scaled objective as minimised; of a speed, minus speed / largest rate.
    arcs : Arcs
        The motion.
    mesh : Mesh
        Its mesh.
    """

    sequence: Sequence_
    objective: float
    arcs: Arcs
    mesh: Mesh


def mesh_of(sequence: Sequence_, arcs: int, degree: int = 2) -> Mesh:
    """Mesh with as many phases as the sequence.

    Parameters
    ----------
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    arcs : int
        Arcs per phase.
    degree : int, optional
        Degree of the states. Accelerations have degree - 2, so that lengths are exact; 2 makes
        them piecewise constant.

    Returns
    -------
    Mesh

    Examples
    --------
    >>> mesh_of(((0,), (2,), (1,)), arcs=6).total
    18
    """
    return Mesh(len(sequence), arcs, Collocation(degree), degree - 2)


@lru_cache(maxsize=32)
def program_of(task: Task, mesh: Mesh) -> Transcription:
    """Program of a task on a mesh, built once per process and kept.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    mesh : Mesh
        The mesh; sequences of as many phases share a program.

    Returns
    -------
    Transcription
    """
    return Transcription(gait_problem(task.worm, task.limits, task.objective), mesh)


@dataclass(frozen=True)
class Job:
    """One optimisation: a sequence from one random start.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    sequence : tuple of tuple of int
        Resting masses, phase after phase.
    seed : tuple of int
        Seeds the start's durations, whichever process runs the job.
    arcs : int
        Arcs per phase.
    durations : tuple of float, optional
        Durations of the phases to start with; drawn at random if left out.
    """

    task: Task
    sequence: Sequence_
    seed: tuple[int, ...]
    arcs: int
    durations: tuple[float, ...] | None = None


def attempt(job: Job) -> Candidate | None:
    """Optimise one sequence from one random start.

    With durations fixed at random the program is linear, but for drag and power: its linear
    solution is a far better start than any guess.

    Parameters
    ----------
    job : Job
        What to optimise.

    Returns
    -------
    Candidate or None
        Optimal to about three digits; None where no durations tried admit a motion, or
        constraints stay violated by more than 1e-3.
    """
    mesh = mesh_of(job.sequence, job.arcs)
    program = program_of(job.task, mesh)
    bounds = program.bounds(ModeSequence.of_resting(job.sequence, job.task.worm.links + 1))
    start = _start(job, program, bounds)
    if start is None:
        return None
    # Loose: ranking needs three digits, the polish finds the rest.
    found = program.nlp.solve(start, bounds, Ipopt(tolerance=1e-4, mu_init=1e-2, iterations=200))
    if found.violation > 1e-3:
        return None
    return Candidate(job.sequence, found.objective, program.unpack(found.w), mesh)


def _start(job: Job, program: Transcription, bounds: Bounds) -> np.ndarray | None:
    """Where to start: for a cost, at a fast gait of the same sequence; None if it is too slow."""
    required = job.task.objective.speed
    if required is None:
        return _linear_start(job, program, bounds)
    fastest = replace(job.task, objective=Objective(maximise="speed"))
    fast = attempt(replace(job, task=fastest))
    if fast is None or -fast.objective * job.task.speed_nominal < required * (1 - 1e-3):
        return None
    return program.pack(replace(fast.arcs, **program.nominal_extras()), bounds)


def _linear_start(job: Job, program: Transcription, bounds: Bounds) -> np.ndarray | None:
    """Best motion with durations drawn at random, to first order from rest; None if none fits."""
    random = np.random.default_rng(job.seed)
    mesh = program.mesh
    for _ in range(6):
        phases = job.durations or random.dirichlet(np.full(mesh.phases, 8.0))
        durations = np.repeat(phases, job.arcs) * random.uniform(0.7, 1.3, mesh.total)
        shortest, longest = job.task.limits.period_range
        drawn = random.uniform(shortest, longest)
        period = np.clip(sum(job.durations), shortest, longest) if job.durations else drawn
        durations *= period / durations.sum()
        w = program.rest(durations, job.task.rest)
        linear = program.nlp.linear_step(w, bounds, program.hold_durations())
        if linear is not None:
            return linear[0]
    return None


def attempts(jobs: Sequence[Job], workers: int) -> dict[Sequence_, Candidate | None]:
    """Best candidate of every sequence, from jobs run in so many processes.

    Parameters
    ----------
    jobs : sequence of Job
        Several of one sequence compete.
    workers : int
        Number of processes; 1 runs the jobs here.

    Returns
    -------
    dict of sequence to Candidate or None
        In the order of the jobs and the same for any number of workers; None where every start
        failed.

    Raises
    ------
    KeyboardInterrupt
        If the user stops it; worker processes are ended.
    """
    best: dict[Sequence_, Candidate | None] = dict.fromkeys(job.sequence for job in jobs)
    for job, candidate in zip(jobs, _run(jobs, workers), strict=True):
        record = best[job.sequence]
        if candidate and (record is None or candidate.objective < record.objective):
            best[job.sequence] = candidate
    return best


def _run(jobs: Sequence[Job], workers: int) -> Iterator[Candidate | None]:
    if workers == 1 or len(jobs) <= 1:
        yield from map(attempt, jobs)
        return
    # CasADi holds the interpreter's lock, so threads would not help; loky's processes need no
    # main guard in the user's script.
    from loky import get_reusable_executor

    executor = get_reusable_executor(max_workers=workers, timeout=20)
    try:
        yield from executor.map(attempt, jobs)
    except KeyboardInterrupt:
        executor.shutdown(wait=False, kill_workers=True)
        raise
