"""The race of orders of rest: the best trial of each, what is close to the best, side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wormopt.numerics.workers import Workers
from wormopt.progress import Report
from wormopt.systems.shared.sequences import Sequence_, canonical
from wormopt.systems.spiked.gait_problem import GaitProblem
from wormopt.systems.spiked.programs.gait_rows import is_energy
from wormopt.systems.spiked.programs.scaled_limits import scaled
from wormopt.systems.spiked.search.orders import ceiling_of, is_mirror_symmetric
from wormopt.systems.spiked.search.trial import Trial, Trier

Better = Callable[[Trial], None]

# What is within this share of the best of its level is looked at with more arcs; of the energy
# that is absorbed, a small part of what is spent, few arcs tell little.
_MARGINS, _MARGINS_OF_ENERGY = (0.08, 0.01), (0.5, 0.15)
# Share of the value within which another local optimum of an order is kept; and of the cycle,
# within which the phases of two gaits last as long.
_CLOSE, _ALIKE = 1e-3, 1e-2
# Shares of the cycle up to which a phase is nothing, and short.
_SIZES = 5e-3, 5e-2
# Energy absorbed per distance, in units of force, that counts as none.
_NONE = 1e-10
# Links up to which ceilings cost less than a first look at an order.
_CHEAP_CEILINGS = 8


class Start(NamedTuple):
    """An order of rest with what to begin with."""

    sequence: Sequence_  # resting masses of a cycle
    durations: np.ndarray | None = None  # of its phases; None: short ones
    cycles: int = 0  # how many nearly fill a period; 0: not known


@dataclass(eq=False)
class Race:
    """Best trial of every order so far, others that may end higher, each level's best value."""

    task: GaitProblem
    trier: Trier
    workers: int  # processes
    report: Report
    better: Better  # given every trial better than all before it
    places: int  # first looks that do not reach so many different values before are given up
    # best of each canonical order; None: it has none
    trials: dict[Sequence_, Trial | None] = field(default_factory=dict)
    # local optima next to the best of their order
    others: list[Trial] = field(default_factory=list)
    varied: int = 0  # how many orders are variations of others
    enough: float = np.inf  # a value near enough to a proven bound of all

    def __post_init__(self) -> None:
        self._best: Trial | None = None
        self._records: dict[int, float] = {}
        self._values = set[float]()  # of first looks, to four digits
        self._workers = Workers(self.workers)
        self.long = self.task.worm.links > _CHEAP_CEILINGS
        self.mirror = is_mirror_symmetric(self.task)
        self._energy, self._force = is_energy(self.task), scaled(self.task).force
        self.margins = _MARGINS_OF_ENERGY if self._energy else _MARGINS

    def close(self) -> None:
        """Let the processes go."""
        self._workers.close()

    def tell(self, stage: str, fraction: float) -> str:
        """Say what is done next, and the best so far; give the stage back.

        `fraction` is how much of the search is done.
        """
        best = f", best so far {self.ranking[0].cost:.6g}" if self._records else ""
        self.report(stage + best, fraction)
        return stage

    def canonical(self, sequence: Sequence_) -> Sequence_:
        """Representative of all equivalent sequences."""
        return canonical(sequence, self.task.worm.links + 1, mirror=self.mirror)

    def _each(self, work: Callable[[Trier, Any], Trial | None], jobs: Sequence) -> Iterator:
        """Try the same with every job, side by side, and count what it took."""
        for found, programs, pivots in self._workers.map(partial(_tried, self.trier, work), jobs):
            self.trier.programs += programs
            self.trier.work += pivots
            yield found

    def enter(self, starts: Iterable[Start]) -> list[Trial]:
        """Try orders for the first time; gives what was found."""
        starts, found = [s for s in starts if self.can_win(s.sequence)], list[Trial]()
        usual = None if self._best is None else self._best.durations
        places = sorted(self._values)[-self.places :]
        least = places[0] if len(places) == self.places else -np.inf
        first = partial(_first, enough=max(self._close(0), least), usual=usual)
        for start, fitted in zip(starts, self._each(first, starts), strict=True):
            self.trials.setdefault(self.canonical(start.sequence), None)
            if fitted is not None:
                self.keep(fitted)
                self._values.add(float(f"{fitted.value:.4g}"))
                found.append(fitted)
        return found

    def can_win(self, sequence: Sequence_) -> bool:
        """Whether the ceiling of an order is above the best."""
        required = self.task.objective.speed
        bound = self.value if required is None else required
        return self.long or ceiling_of(self.task, sequence) > bound

    def keep(self, trial: Trial) -> None:
        """Enter a trial, fitted to a period, if it is the best of its order."""
        if trial.value > self.value:
            self._best = trial
            self.better(trial)
        self._records[trial.level] = max(self.record(trial.level), trial.value)
        key = self.canonical(trial.sequence)
        old = self.trials.get(key)
        if old is None or trial.value >= old.value:
            self.trials[key] = trial

    @property
    def value(self) -> float:
        """Best value."""
        return max(self._records.values(), default=-np.inf)

    @property
    def is_over(self) -> bool:
        """Whether no gait can be better: nothing is spent but the work against the load."""
        return self._energy and self.value >= -_NONE * self._force

    @property
    def is_proven(self) -> bool:
        """Whether no gait can be better by more than is wanted."""
        return self.value >= self.enough

    def record(self, level: int) -> float:
        """Best value at a level (number of halvings of arcs), -inf before there is one."""
        return self._records.get(level, -np.inf)

    def _close(self, level: int) -> float:
        record = self.record(level)
        return record - self.margins[level] * abs(record) if np.isfinite(record) else -np.inf

    @property
    def ranking(self) -> list[Trial]:
        """Best trials first; of those that tie, short cycles."""
        return sorted((t for t in self.trials.values() if t is not None), key=rank)

    def restart(self, width: int, random: Sequence[int], share: float = 1e9) -> None:
        """Try the best orders with arcs drawn at random, as fine as they are.

        At most `width` orders, within `share` of the best; `random` is the seed.
        """
        enough = self.value - share * abs(self.value)
        best = [t for t in self.ranking[:width] if t.value >= enough]
        reached = -np.inf if self._energy else self._close(0)  # few arcs tell little of energy
        again = partial(_again, seed=random, enough=reached)
        for trial, other in zip(best, self._each(again, best), strict=True):
            if other is not None:
                self.keep(other)
                lower, higher = sorted((trial, other), key=lambda t: t.value)
                close = abs(higher.value - lower.value) < _CLOSE * abs(higher.value)
                if close and not _alike(lower, higher):  # more arcs will tell which ends higher
                    self.others.append(lower)

    def promote(self, level: int, most: int) -> None:
        """Try with more arcs up to `most` orders that are close to the best of their level.

        `level` is how often arcs have been halved.
        """
        while most > 0:
            close = [t for t in self.ranking if t.level == level]
            close = [t for t in close if t.value >= self._close(level)][: min(4, most)]
            if not close:
                return
            self.refine(close)
            most -= len(close)

    def refine(self, trials: list[Trial]) -> list[Trial]:
        """Try again with more arcs; gives what was found."""
        found = list(self._each(Trier.finer, trials))
        for trial in trials:
            self.trials[self.canonical(trial.sequence)] = None  # some phases may last no time
        for finer in found:
            self.keep(finer)
        return found


def _tried(
    trier: Trier, work: Callable[[Trier, Any], Trial | None], job: Any
) -> tuple[Trial | None, int, int]:
    """What a job comes to, and how many programs and how much work that was."""
    trier = copy(trier)
    trier.programs = trier.work = 0
    found = work(trier, job)
    if found is not None:
        _ = found.value  # goes with it, so that its program is made anew only if it is needed
        found.program.forget()
    return found, trier.programs, trier.work


def _first(trier: Trier, start: Start, enough: float, usual: np.ndarray | None) -> Trial | None:
    """Try an order for the first time, also with a period like that of the best so far."""
    if usual is not None and trier.stopped():
        return None
    sequence, durations, cycles = start
    if durations is not None and cycles:
        return trier.near(sequence, durations, cycles, enough)
    others = [durations]
    if durations is None and usual is not None:
        others.append(np.full(len(sequence), usual.sum() / len(sequence)))
    for durations in others:
        free = trier.free(sequence, durations, enough)
        # a free period does no worse than any number of cycles
        if free is not None and free.value >= enough:
            return trier.fit(free)
    return None


def _again(trier: Trier, trial: Trial, seed: Sequence[int], enough: float) -> Trial | None:
    """Try an order with arcs drawn at random, as fine as they are if it reaches `enough`."""
    free = trier.free(trial.sequence, None, enough, np.random.default_rng(seed))
    other = trier.fit(free) if free and free.value >= enough else None
    if other is None or other.value < enough:
        return None
    while other and other.level < max(1, trial.level):
        other = trier.finer(other)
    return other


def rank(trial: Trial) -> tuple[float, int, Sequence_]:
    """Key that sorts the best first, and of those that tie but for rounding, short cycles."""
    return -float(f"{trial.value:.11g}"), len(trial.sequence), trial.sequence


def apart(trials: Iterable[Trial]) -> list[Trial]:
    """The best of the trials whose phases are alike in being long, short or nothing, best first."""
    found = dict[Any, Trial]()
    for trial in sorted(trials, key=rank):
        lengths = np.digitize(trial.durations / trial.durations.sum(), _SIZES)
        found.setdefault((trial.cycles, *lengths.tolist()), trial)
    return list(found.values())


def _alike(one: Trial, other: Trial) -> bool:
    """Whether two trials have the same phases."""
    if one.sequence != other.sequence or one.cycles != other.cycles:
        return False
    apart = np.abs(one.durations - other.durations).max()
    return bool(apart < _ALIKE * one.durations.sum())
