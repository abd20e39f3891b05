"""Search over the order in which masses rest: enumerate, bound, try, and vary the best.

The order decides the optimum and local optimisation does not change it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from wormopt.gaits.attempt import Candidate, Job, Task, attempts
from wormopt.gaits.construct import block_wave_sequence
from wormopt.gaits.sequences import Sequence_, canonical, neighbours
from wormopt.gaits.space import (
    ceiling_of,
    is_mirror_symmetric,
    letters_of,
    sequences_of,
    sizes_of,
)
from wormopt.progress import Report
from wormopt.scenes.gait_search import Search

if TYPE_CHECKING:
    from wormopt.gaits.tree import Branch

__all__ = ["Effort", "Survey", "constructed_sequences", "effort_of", "search", "workers_of"]


@dataclass(frozen=True)
class Effort:
    """How much is tried.

    Parameters
    ----------
    enumerated : int
        Most sequences tried in the systematic part, best ceilings first.
    starts : int
        Random starts, after a first look, of each sequence that comes close to the best.
    rounds : int
        Rounds in which the best sequences are varied.
    varied : int
        Most variations tried in a round.
    polished : int
        Sequences handed on to be polished.
    clearly : float
        By which share a gait counts as clearly faster: sequences whose relaxation has none such
        are left out, where that is quick to see. With 0 none are.
    """

    enumerated: int
    starts: int
    rounds: int
    varied: int
    polished: int
    clearly: float


_EFFORTS = {
    "quick": Effort(enumerated=12, starts=1, rounds=0, varied=0, polished=1, clearly=0.0),
    "normal": Effort(enumerated=36, starts=2, rounds=2, varied=10, polished=2, clearly=3e-3),
    "thorough": Effort(enumerated=300, starts=6, rounds=4, varied=40, polished=4, clearly=0.0),
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
    >>> effort_of(Search(effort="thorough")).starts
    6
    """
    return _EFFORTS[settings.effort]


# The record of a search is known to about three digits only.
_MARGIN = 5e-3


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
        Of these, proven not to be clearly faster than the best found by then.
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


@dataclass
class _Trials:
    """Best candidate of every sequence tried so far, and how to try more."""

    task: Task
    effort: Effort
    seed: int
    workers: int
    best: dict[Sequence_, Candidate | None] = field(default_factory=dict)
    ruled_out: set[Sequence_] = field(default_factory=set)
    starts: int = 0

    def run(self, batch: list[Sequence_], seeds: Sequence[int]) -> None:
        """Try every sequence of a batch from random starts of these seeds."""
        self._run([Job(self.task, s, (self.seed, k), 6) for s in batch for k in seeds])

    def run_from(self, branch: Branch) -> None:
        """Try a sequence from the middle of a box of durations."""
        durations = np.mean(branch.durations, axis=1) * self.task.limits.period_range[1]
        self._run([Job(self.task, branch.sequence, (self.seed,), 6, tuple(durations.tolist()))])

    def _run(self, jobs: list[Job]) -> None:
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

    @property
    def cutoff(self) -> float:
        """Speed above which a gait would be clearly faster than the fastest one found."""
        return -self.record * self.task.speed_nominal * (1 + self.effort.clearly)

    def close(self, share: float) -> list[Sequence_]:
        """Sequences whose objective comes within this share of the best."""
        reach = self.record + share * abs(self.record)
        return [c.sequence for c in self.ranking if c.objective <= reach]

    def cannot_win(self, sequence: Sequence_) -> bool:
        """Whether the ceiling of a sequence rules it out, which is noted."""
        bound, required = ceiling_of(self.task, sequence), self.task.objective.speed
        # the record is known to about three digits only: leave it a margin
        record = -self.record * self.task.speed_nominal * (1 - _MARGIN)
        beaten = bound < required if required is not None else bound <= record
        if beaten:
            self.ruled_out.add(sequence)
        return beaten


def search(task: Task, settings: Search, report: Report, hints: Sequence[Sequence_] = ()) -> Survey:
    """Find the sequences that are worth polishing.

    Sequences of constructed gaits are tried first, then those with the highest `ceiling`. One
    whose ceiling is below the best speed found is left out: it cannot win. Where relaxations are
    faster than trying they rule out what cannot be clearly faster than the best found.
    Then the best sequences are varied by inserting, dropping and exchanging resting sets.

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
    >>> from wormopt.scenes.gait_design import GaitLimits, Objective
    >>> from wormopt.scenes.worm import WormTable
    >>> worm = WormTable(links=1, mass=1.0, load=5.0)
    >>> limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> task = Task(worm, limits, Objective(maximise="speed"))
    >>> settings = Search(sequence=((0,), (1,)), effort="quick", workers=1)
    >>> survey = search(task, settings, silent)
    >>> round(-survey.candidates[0].objective, 2), survey.starts
    (0.42, 1)
    """
    effort, masses = effort_of(settings), task.worm.links + 1
    trials = _Trials(task, effort, settings.seed, workers_of(settings, task.worm.links))
    if settings.sequence is not None:
        own = tuple(tuple(sorted(s)) for s in settings.sequence)
        trials.run([own], range(effort.starts))
        return Survey(tuple(trials.ranking), len(own), 1, 0, 1, 0, trials.starts)
    mirror = is_mirror_symmetric(task)
    phases = _enumerated_phases(len(letters_of(task)), settings.phases)
    space = sequences_of(task, phases)
    # Constructed gaits first, so that none of them is ever better; then the highest ceilings.
    first = [canonical(s, masses, mirror=mirror) for s in (*hints, *constructed_sequences(task))]
    order = sorted(set(space) - set(first), key=lambda s: (-ceiling_of(task, s), len(s), s))
    tried, varied, interrupted = 0, 0, False
    try:
        report("searching mode sequences", 0.0)
        trials.run(list(dict.fromkeys(first)), [0])
        if _bounds_are_quick(trials):
            order = _rule_out(trials, order, report)
        _try_out(trials, order, report)
        trials.run(trials.close(0.02), range(1, 1 + effort.starts))
        tried = len(trials.best)
        varied = _vary(trials, settings, report, mirror=mirror)
    except KeyboardInterrupt:
        if not trials.ranking:
            raise
        tried, interrupted = tried or len(trials.best), True
    everything = {*space, *first}
    return Survey(
        candidates=tuple(trials.ranking),
        phases=phases,
        space=len(everything),
        excluded=len((trials.ruled_out & everything) - trials.best.keys()),
        tried=tried,
        varied=varied,
        starts=trials.starts,
        interrupted=interrupted,
    )


def _bounds_are_quick(trials: _Trials) -> bool:
    """Whether relaxations rule sequences out faster than they could be tried."""
    task = trials.task
    shortest, longest = task.limits.period_range
    speed = task.objective.maximise == "speed" and task.limits.acceleration is not None
    plain = shortest == longest and task.worm.links <= 2 and task.worm.drag == 0
    return speed and plain and trials.effort.clearly > 0


def _rule_out(trials: _Trials, sequences: list[Sequence_], report: Report) -> list[Sequence_]:
    """Rule out what cannot win by its relaxation; give what is left."""
    from wormopt.gaits.exclusion import rule_out  # loads a solver that few searches need

    def start(branch: Branch) -> None:
        report("trying relaxed durations", None)
        trials.run_from(branch)

    report("ruling out mode sequences", None)
    possible = [s for s in sequences if s not in trials.best and not trials.cannot_win(s)]
    beaten = rule_out(trials.task, possible, lambda: trials.cutoff, start)
    trials.ruled_out |= beaten
    return [s for s in possible if s not in beaten]


def _try_out(trials: _Trials, sequences: list[Sequence_], report: Report) -> None:
    """Try sequences in turn from a random start; what comes close gets more starts later."""
    most = trials.effort.enumerated
    while sequences and len(trials.best) < most:
        possible = [s for s in sequences if not trials.cannot_win(s)]
        batch, sequences = possible[:6], possible[6:]
        report("searching mode sequences", 0.6 * len(trials.best) / most)
        trials.run(batch, [0])


def _enumerated_phases(letters: int, asked: int | None) -> int:
    """Phases up to which enumeration stays small; longer sequences are left to variation."""
    phases = asked or (4 if letters <= 7 else 3 if letters <= 21 else 2)
    while phases > 2 and letters**phases > 1_000_000:
        phases -= 1
    return phases


def constructed_sequences(task: Task) -> list[Sequence_]:
    """Sequences of the constructed gaits that keep enough masses at rest.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.

    Returns
    -------
    list of sequences
        Block-rest waves, of more resting masses too where those share a load, and the accordion.
    """
    n = task.worm.links
    found = [tuple(block_wave_sequence(n, a)) for a in sizes_of(task)]
    if task.limits.resting == 1:
        found.append(((0,), (n,)))
    return found


def _vary(trials: _Trials, settings: Search, report: Report, *, mirror: bool) -> int:
    """Insert, drop and exchange resting sets in the best sequences while that helps."""
    task, effort, varied = trials.task, trials.effort, 0
    masses = task.worm.links + 1
    most = settings.phases or 2 * masses
    letters = letters_of(task)
    for turn in range(effort.rounds):
        record = trials.record
        words = {
            canonical(word, masses, mirror=mirror)
            for sequence in trials.close(0.02)[:3]
            for word in neighbours(sequence, letters, most)
        }
        fresh = sorted(words - trials.best.keys() - trials.ruled_out)
        order = np.random.default_rng((settings.seed, turn)).permutation(len(fresh))
        chosen = [fresh[k] for k in order[: effort.varied]]
        report("varying the best sequences", 0.6 + 0.2 * turn / effort.rounds)
        batch = [s for s in chosen if not trials.cannot_win(s)]
        trials.run(batch, range(effort.starts))
        varied += len(batch)
        if trials.record >= record - 1e-4 * abs(record):
            break
    return varied
