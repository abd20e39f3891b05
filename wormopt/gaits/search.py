"""Search over the order in which masses rest: enumerate, bound, try, and vary the best.

The order decides the optimum and local optimisation does not change it. Sequences are one if
rotation in time maps them on each other, or, where the limits are symmetric, the mirror image.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from wormopt.core.modes import ModeSequence, ceiling
from wormopt.gaits.construct import block_wave_sequence
from wormopt.gaits.problem import gait_problem, loads_matter, rate_bounds
from wormopt.optimal.collocation import Collocation
from wormopt.optimal.nlp import Bounds, Ipopt
from wormopt.optimal.phases import Arcs, Mesh, PhaseProgram
from wormopt.progress import Report
from wormopt.scenes.gait_design import GaitLimits, Objective, Search
from wormopt.scenes.worm import WormTable

__all__ = [
    "Candidate",
    "Effort",
    "Job",
    "Survey",
    "Task",
    "attempts",
    "effort_of",
    "mesh_of",
    "program_of",
    "search",
    "sequences",
    "start_of",
    "workers_of",
]

Resting = tuple[int, ...]
Sequence_ = tuple[Resting, ...]


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
class Effort:
    """How much is tried.

    Parameters
    ----------
    enumerated : int
        Most sequences tried in the systematic part, best ceilings first.
    starts : int
        Random starts of each, and as many again of those that come close to the best.
    rounds : int
        Rounds in which the best sequences are varied.
    varied : int
        Most variations tried in a round.
    polished : int
        Sequences handed on to be polished.
    """

    enumerated: int
    starts: int
    rounds: int
    varied: int
    polished: int


_EFFORTS = {
    "quick": Effort(enumerated=12, starts=1, rounds=0, varied=0, polished=1),
    "normal": Effort(enumerated=36, starts=2, rounds=2, varied=10, polished=2),
    "thorough": Effort(enumerated=300, starts=6, rounds=4, varied=40, polished=4),
}


def workers_of(settings: Search, links: int) -> int:
    """Number of processes: as asked for, else one per processor where that pays.

    Up to two links a whole search takes about as long as starting processes.

    Parameters
    ----------
    settings : Search
        With or without ``workers``.
    links : int
        Number of links n.

    Returns
    -------
    int
        At least 1.
    """
    return settings.workers or (1 if links <= 2 else os.cpu_count() or 1)


def effort_of(settings: Search) -> Effort:
    """Effort that a scene's search table asks for.

    Parameters
    ----------
    settings : Search
        Its ``effort`` is "quick", "normal" or "thorough".

    Returns
    -------
    Effort

    Examples
    --------
    >>> effort_of(Search(effort="quick")).starts
    2
    """
    return _EFFORTS[settings.effort]


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


@dataclass(frozen=True)
class Survey:
    """What a search found and how much of the space it saw.

    Parameters
    ----------
    candidates : tuple of Candidate
        Best of each sequence, best first.
    phases : int
        Sequences of 2 to so many phases were enumerated.
    space : int
        How many there are, up to rotation (and mirror image).
    excluded : int
        Of these, proven not to be best by their ceiling.
    tried : int
        Of these, tried.
    varied : int
        Variations tried beyond them.
    starts : int
        Optimisations in all.
    interrupted : bool
        Whether the user stopped the search.
    """

    candidates: tuple[Candidate, ...]
    phases: int
    space: int
    excluded: int
    tried: int
    varied: int
    starts: int
    interrupted: bool = False


def sequences(masses: int, resting: int, phases: int, *, mirror: bool) -> list[Sequence_]:
    """List the cyclic sequences of resting sets, each class once.

    Parameters
    ----------
    masses : int
        Number of masses.
    resting : int
        Masses in each set.
    phases : int
        Length of the sequences.
    mirror : bool
        Whether i -> n - i gives the same gait.

    Returns
    -------
    list of tuple of tuple of int
        Neighbouring sets differ, and no mass rests for ever.

    Examples
    --------
    >>> sequences(3, 1, 3, mirror=True)
    [((0,), (1,), (2,))]
    """
    letters = list(combinations(range(masses), resting))
    found = set()
    for word in product(letters, repeat=phases):
        if word[0] == min(word) and _is_gait(word):
            found.add(_canonical(word, masses, mirror=mirror))
    return sorted(found)


def _is_gait(word: Sequence_) -> bool:
    changes = all(word[i] != word[i - 1] for i in range(len(word)))
    return changes and not set.intersection(*(set(s) for s in word))


def _canonical(word: Sequence_, masses: int, *, mirror: bool) -> Sequence_:
    images = [word]
    if mirror:
        images.append(tuple(tuple(sorted(masses - 1 - i for i in s)) for s in word))
    return min(image[k:] + image[:k] for image in images for k in range(len(word)))


def _is_mirror_symmetric(task: Task) -> bool:
    """Whether i -> n - i with l_j -> shortest + longest - l_{n+1-j} maps gaits on gaits."""
    n, limits = task.worm.links, task.limits
    contraction, extension = rate_bounds(limits, n)
    per_thing = [
        task.worm.masses,
        contraction,
        np.broadcast_to(limits.acceleration or 0.0, n),
        np.broadcast_to(limits.spike_load or 0.0, n + 1),
        np.broadcast_to(limits.actuator_force or 0.0, n),
        np.ptp(np.array(limits.length_ranges(n)), axis=1),
    ]
    return np.array_equal(contraction, extension) and all(
        np.array_equal(v, np.asarray(v)[::-1]) for v in per_thing
    )


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
def program_of(task: Task, mesh: Mesh) -> PhaseProgram:
    """Program of a task on a mesh, built once per process and kept.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    mesh : Mesh
        The mesh; sequences of as many phases share a program.

    Returns
    -------
    PhaseProgram
    """
    return PhaseProgram(gait_problem(task.worm, task.limits, task.objective), mesh)


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
    """

    task: Task
    sequence: Sequence_
    seed: tuple[int, ...]
    arcs: int


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


def _start(job: Job, program: PhaseProgram, bounds: Bounds) -> np.ndarray | None:
    """Where to start: for a cost, at a fast gait of the same sequence; None if it is too slow."""
    required = job.task.objective.speed
    if required is None:
        return _linear_start(job, program, bounds)
    fastest = replace(job.task, objective=Objective(maximise="speed"))
    fast = attempt(replace(job, task=fastest))
    if fast is None or -fast.objective * job.task.speed_nominal < required * (1 - 1e-3):
        return None
    return program.pack(replace(fast.arcs, **program.nominal_extras()))


def _linear_start(job: Job, program: PhaseProgram, bounds: Bounds) -> np.ndarray | None:
    """Best motion with durations drawn at random, to first order from rest; None if none fits."""
    random = np.random.default_rng(job.seed)
    mesh = program.mesh
    for _ in range(6):
        phases = random.dirichlet(np.full(mesh.phases, 8.0))
        durations = np.repeat(phases, job.arcs) * random.uniform(0.7, 1.3, mesh.total)
        durations *= random.uniform(*job.task.limits.period_range) / durations.sum()
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


@dataclass
class _Trials:
    """Best candidate of every sequence tried so far, and how to try more."""

    task: Task
    effort: Effort
    seed: int
    workers: int
    best: dict[Sequence_, Candidate | None] = field(default_factory=dict)
    starts: int = 0

    def run(self, batch: list[Sequence_], first: int = 0) -> None:
        """Try every sequence of a batch from the effort's number of starts."""
        seeds = range(first, first + self.effort.starts)
        jobs = [Job(self.task, s, (self.seed, k), 6) for s in batch for k in seeds]
        self.starts += len(jobs)
        for sequence, found in attempts(jobs, self.workers).items():
            old = self.best.get(sequence)
            if old is None or (found is not None and found.objective < old.objective):
                self.best[sequence] = found

    @property
    def ranking(self) -> list[Candidate]:
        found = [c for c in self.best.values() if c is not None]
        return sorted(found, key=lambda c: (c.objective, len(c.sequence), c.sequence))

    @property
    def record(self) -> float:
        return self.ranking[0].objective if self.ranking else np.inf

    def close(self, share: float) -> list[Sequence_]:
        """Sequences whose objective comes within this share of the best."""
        reach = self.record + share * abs(self.record)
        return [c.sequence for c in self.ranking if c.objective <= reach]

    def cannot_win(self, bound: float) -> bool:
        """Whether a ceiling on the speed rules a sequence out."""
        if self.task.objective.speed is not None:
            return bound < self.task.objective.speed
        return bound <= -self.record * self.task.speed_nominal


def search(task: Task, settings: Search, report: Report, hints: Sequence[Sequence_] = ()) -> Survey:
    """Find the sequences that are worth polishing.

    Sequences are tried in order of their `ceiling`, those of constructed gaits first. One whose
    ceiling is below the best speed found is left out: it cannot win. Then the best ones are
    varied by inserting, dropping and exchanging resting sets.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    settings : Search
        Seed, effort, phases, the user's own sequence, processes.
    report : callable
        Told what goes on: text and the fraction done.
    hints : sequence of sequences, optional
        Tried first, with those of the constructed gaits.

    Returns
    -------
    Survey
        The same for any number of workers.

    Raises
    ------
    KeyboardInterrupt
        If the user stops it before anything is found; later the survey is marked interrupted.

    Examples
    --------
    One link and two masses that rest in turn. Without the time that acceleration takes the speed
    would be half the rate.

    >>> from wormopt.progress import silent
    >>> worm = WormTable(links=1, mass=1.0, load=5.0)
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> task = Task(worm, limits, Objective(maximise="speed"))
    >>> settings = Search(sequence=((0,), (1,)), effort="quick", workers=1)
    >>> survey = search(task, settings, silent)
    >>> round(-survey.candidates[0].objective, 2), survey.starts
    (0.42, 2)
    """
    effort, masses = effort_of(settings), task.worm.links + 1
    trials = _Trials(task, effort, settings.seed, workers_of(settings, task.worm.links))
    if settings.sequence is not None:
        own = tuple(tuple(sorted(s)) for s in settings.sequence)
        trials.run([own])
        return Survey(tuple(trials.ranking), len(own), 1, 0, 1, 0, trials.starts)
    mirror = _is_mirror_symmetric(task)
    phases = settings.phases or _default_phases(masses, task.limits.resting)
    space = [
        s
        for p in range(2, phases + 1)
        for s in sequences(masses, task.limits.resting, p, mirror=mirror)
    ]
    # Constructed gaits first, so that none of them is ever better; then the highest ceilings.
    first = [_canonical(s, masses, mirror=mirror) for s in (*hints, *start_of(task))]
    order = sorted(set(space) - set(first), key=lambda s: (-_ceiling_of(task, s), len(s), s))
    order = [*dict.fromkeys(first), *order]
    head, excluded, varied, interrupted = len(set(first)), 0, 0, False
    try:
        while order and len(trials.best) < effort.enumerated:
            possible = [s for s in order if not trials.cannot_win(_ceiling_of(task, s))]
            excluded += len(order) - len(possible)
            size = head if not trials.best else 6
            batch, order = possible[:size], possible[size:]
            report("searching mode sequences", 0.6 * len(trials.best) / effort.enumerated)
            trials.run(batch)
        trials.run(trials.close(0.01), first=effort.starts)
        tried = len(trials.best)
        varied = _vary(trials, settings, report, mirror=mirror)
    except KeyboardInterrupt:
        if not trials.ranking:
            raise
        tried, interrupted = len(trials.best), True
    excluded += sum(trials.cannot_win(_ceiling_of(task, s)) for s in order)
    ranking, space_size = tuple(trials.ranking), len(set(space) | set(first))
    return Survey(ranking, phases, space_size, excluded, tried, varied, trials.starts, interrupted)


def _default_phases(masses: int, resting: int) -> int:
    """Phases up to which enumeration stays small; the rest is left to variation."""
    letters = len(list(combinations(range(masses), resting)))
    return 4 if letters <= 7 else 3 if letters <= 21 else 2


def _ceiling_of(task: Task, sequence: Sequence_) -> float:
    return _ceiling_of_sets(task, frozenset(sequence))


@lru_cache(maxsize=4096)
def _ceiling_of_sets(task: Task, sets: frozenset[Resting]) -> float:
    contraction, extension = rate_bounds(task.limits, task.worm.links)
    return ceiling(contraction.tolist(), extension.tolist(), task.limits.resting, sets)


def start_of(task: Task) -> list[Sequence_]:
    """Sequences of the constructed gaits that keep enough masses at rest.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.

    Returns
    -------
    list of tuple of tuple of int
        That of `block_wave`, and of `accordion` where one mass at rest is enough.
    """
    n, a = task.worm.links, task.limits.resting
    found = [tuple(block_wave_sequence(n, a))]
    if a == 1:
        found.append(((0,), (n,)))
    return found


def _vary(trials: _Trials, settings: Search, report: Report, *, mirror: bool) -> int:
    """Insert, drop and exchange resting sets in the best sequences while that helps."""
    task, effort, varied = trials.task, trials.effort, 0
    masses = task.worm.links + 1
    most = settings.phases or 2 * masses
    for turn in range(effort.rounds):
        record = trials.record
        words = {
            _canonical(word, masses, mirror=mirror)
            for sequence in trials.close(0.02)[:3]
            for word in _neighbours(sequence, task, most)
        }
        fresh = sorted(words - trials.best.keys())
        order = np.random.default_rng((settings.seed, turn)).permutation(len(fresh))
        chosen = [fresh[k] for k in order[: effort.varied]]
        batch = [s for s in chosen if not trials.cannot_win(_ceiling_of(task, s))]
        report("varying the best sequences", 0.6 + 0.2 * turn / effort.rounds)
        trials.run(batch)
        varied += len(batch)
        if trials.record >= record - 1e-4 * abs(record):
            break
    return varied


def _neighbours(word: Sequence_, task: Task, most: int) -> Iterable[Sequence_]:
    masses, a = task.worm.links + 1, task.limits.resting
    # More resting masses than asked for only help where they share a load.
    sizes = range(a, masses) if loads_matter(task.limits, task.objective) else [a]
    letters = [s for size in sizes for s in combinations(range(masses), size)]
    for k in range(len(word)):
        edits = [word[:k] + word[k + 1 :]]
        for letter in letters:
            edits.append((*word[:k], letter, *word[k + 1 :]))
            edits.append((*word[:k], letter, *word[k:]))
        yield from (e for e in edits if 2 <= len(e) <= most and _is_gait(e))
