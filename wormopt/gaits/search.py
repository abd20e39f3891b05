"""Search over the order in which masses rest: enumerate, race, vary the best.

The order decides the optimum and local optimisation does not change it. Every order is first
tried with few arcs; what is close to the best at its level is looked at with more. A period is
filled by as many cycles as suit the order, and several different cycles may be joined.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import islice, product
from time import monotonic
from typing import NamedTuple

import numpy as np

from wormopt.core.task import Search, Task
from wormopt.gaits.costs import is_energy
from wormopt.gaits.orders import first_orders, plain_orders, search_letters
from wormopt.gaits.scaled_limits import scaled
from wormopt.gaits.sequences import Sequence_, canonical, is_gait, lasting, mirrored, neighbours
from wormopt.gaits.space import ceiling_of, is_mirror_symmetric
from wormopt.gaits.trial import Trial, Trier
from wormopt.progress import Report

__all__ = ["Effort", "Survey", "effort_of", "search"]


Better = Callable[[Trial], None]


@dataclass(frozen=True)
class Effort:
    """How much is tried.

    Parameters
    ----------
    enumerated : int
        Most orders tried in the systematic part, best ceilings first.
    width : int
        Orders that are varied in each round, and share of what is promoted.
    rounds : int
        Most rounds in which the best orders are varied.
    varied : int
        Most variations tried in a round.
    work : float
        Pivots times rows and columns after which no more variations are tried; long worms need
        more for each.
    starts : int
        Random starts of the best orders where a cost is sought.
    """

    enumerated: int
    width: int
    rounds: int
    varied: int
    work: float
    starts: int


_EFFORTS = {
    "quick": Effort(enumerated=16, width=1, rounds=1, varied=8, work=3e8, starts=1),
    "normal": Effort(enumerated=160, width=3, rounds=8, varied=120, work=1e9, starts=3),
    "thorough": Effort(enumerated=1000, width=6, rounds=16, varied=400, work=6e9, starts=8),
}
# What is within this share of the best of its level is looked at with more arcs; of the energy
# that is absorbed, a small part of what is spent, few arcs tell little.
_MARGINS, _MARGINS_OF_ENERGY = (0.08, 0.01), (0.5, 0.15)
# Shares of the work that one climb may take, and that the last restarts may where nothing is left.
_OF_ONE_CLIMB, _OF_RESTARTS = 0.1, 0.2
# Share of the value within which another local optimum of an order is kept; and of the cycle,
# within which the phases of two gaits last as long.
_CLOSE, _ALIKE = 1e-3, 1e-2
# Pivots of its programs take longer: they are denser.
_WORK_OF_ENERGY = 0.3
# Energy absorbed per distance, in units of force, that counts as none.
_NONE = 1e-10
# Gain, as a share, by which variations begin anew.
_BETTER = 1e-3
_BATCH = 8


def effort_of(settings: Search) -> Effort:
    """Effort that is asked for.

    Parameters
    ----------
    settings : Search
        How to search.

    Examples
    --------
    >>> effort_of(Search(effort="quick")).rounds
    1
    """
    return _EFFORTS[settings.effort]


@dataclass(frozen=True)
class Survey:
    """What a search found and how much it saw.

    Parameters
    ----------
    trials : tuple of Trial
        Best of each order, and what other optima of an order are close; best first.
    tried : int
        Orders tried.
    varied : int
        Of these, variations of others.
    programs : int
        Linear programs solved.
    ended : str
        "searched", "time limit" or "interrupted".
    seconds : dict of str to float
        Seconds of each stage.
    """

    trials: tuple[Trial, ...]
    tried: int
    varied: int
    programs: int
    ended: str
    seconds: dict[str, float] = field(default_factory=dict)


class _Start(NamedTuple):
    """An order with durations to begin with, and cycles where they nearly fit into a period."""

    sequence: Sequence_
    durations: np.ndarray | None = None
    cycles: int = 0


@dataclass(eq=False)
class _Race:
    """Best trial of every order so far, others that may end higher, and each level's best value."""

    task: Task
    trier: Trier
    workers: int
    report: Report
    better: Better
    trials: dict[Sequence_, Trial | None] = field(default_factory=dict)
    others: list[Trial] = field(default_factory=list)
    records: dict[int, float] = field(default_factory=dict)
    varied: int = 0

    def __post_init__(self) -> None:
        self._best: Trial | None = None
        self._pool = ThreadPoolExecutor(self.workers) if self.workers > 1 else None
        self.mirror = is_mirror_symmetric(self.task)
        self._energy, self._force = is_energy(self.task), scaled(self.task).force
        self.margins = _MARGINS_OF_ENERGY if self._energy else _MARGINS

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def tell(self, stage: str, fraction: float) -> str:
        """Say what is done next, and the best so far; give the stage back."""
        best = f", best so far {self.ranking[0].cost:.6g}" if self.records else ""
        self.report(stage + best, fraction)
        return stage

    def canonical(self, sequence: Sequence_) -> Sequence_:
        return canonical(sequence, self.task.worm.links + 1, mirror=self.mirror)

    def each(self, work: Callable, jobs: Sequence) -> Iterator:
        """Do the same with every job, side by side where there are threads."""
        return self._pool.map(work, jobs) if self._pool is not None else map(work, jobs)

    def enter(self, starts: Iterable[_Start]) -> None:
        """Try orders for the first time."""
        starts = [start for start in starts if self.can_win(start.sequence)]
        for start, fitted in zip(starts, self.each(self._first, starts), strict=True):
            key = self.canonical(start.sequence)
            self.trials.setdefault(key, None)
            if fitted is not None:
                self.keep(key, fitted)

    def _first(self, start: _Start) -> Trial | None:
        enough = self._close(0)
        if self.records and self.trier.stopped():
            return None
        sequence, durations, cycles = start
        if durations is not None and cycles:
            return self.trier.near(sequence, durations, cycles, enough)
        best, others = self._best, [durations]
        if durations is None and best is not None:
            others.append(np.full(len(sequence), best.durations.sum() / len(sequence)))
        for durations in others:
            free = self.trier.free(sequence, durations, enough)
            # a free period does no worse than any number of cycles
            if free is not None and free.value >= enough:
                return self.trier.fit(free)
        return None

    def can_win(self, sequence: Sequence_) -> bool:
        required = self.task.objective.speed
        bound = self.value if required is None else required
        return self.task.worm.links > _CHEAP_CEILINGS or ceiling_of(self.task, sequence) > bound

    def keep(self, key: Sequence_, trial: Trial) -> None:
        if trial.value > self.value:
            self._best = trial
            self.better(trial)
        record = self.records.get(trial.level, -np.inf)
        self.records[trial.level] = max(record, trial.value)
        old = self.trials.get(key)
        if old is None or trial.value >= old.value:
            self.trials[key] = trial

    @property
    def value(self) -> float:
        return max(self.records.values(), default=-np.inf)

    @property
    def is_over(self) -> bool:
        """Whether no gait can be better: nothing is spent but the work against the load."""
        return self._energy and self.value >= -_NONE * self._force

    def _close(self, level: int) -> float:
        record = self.records.get(level, -np.inf)
        return record - self.margins[level] * abs(record) if np.isfinite(record) else -np.inf

    @property
    def ranking(self) -> list[Trial]:
        """Best trials first; of those that tie, short cycles."""
        found = [t for t in self.trials.values() if t is not None]
        return sorted(found, key=lambda t: (-t.value, len(t.sequence), t.sequence))

    def restart(self, width: int, random: Sequence[int], share: float = 1e9) -> None:
        """Try the best orders with arcs drawn at random, as fine as they are.

        They are within a share of the best.
        """
        enough = self.value - share * abs(self.value)
        best = [t for t in self.ranking[:width] if t.value >= enough]

        def again(trial: Trial) -> Trial | None:
            free = self.trier.free(trial.sequence, None, random=np.random.default_rng(random))
            other = free and self.trier.fit(free)
            while other and other.level < max(1, trial.level):
                other = self.trier.finer(other)
            return other

        for trial, other in zip(best, self.each(again, best), strict=True):
            if other is not None:
                self.keep(self.canonical(other.sequence), other)
                lower, higher = sorted((trial, other), key=lambda t: t.value)
                close = abs(higher.value - lower.value) < _CLOSE * abs(higher.value)
                if close and not _alike(lower, higher):  # more arcs will tell which ends higher
                    self.others.append(lower)

    def promote(self, level: int, most: int) -> None:
        """Look at what is close to the best of its level with more arcs."""
        while most > 0:
            close = [t for t in self.ranking if t.level == level]
            close = [t for t in close if t.value >= self._close(level)][: min(4, most)]
            if not close:
                return
            for trial, finer in zip(close, self.each(self.trier.finer, close), strict=True):
                self.trials[self.canonical(trial.sequence)] = None  # some phases may last no time
                self.keep(self.canonical(finer.sequence), finer)
            most -= len(close)


def _alike(one: Trial, other: Trial) -> bool:
    """Whether two trials are the same gait, as far as their phases tell."""
    if one.sequence != other.sequence or one.cycles != other.cycles:
        return False
    apart = np.abs(one.durations - other.durations).max()
    return bool(apart < _ALIKE * one.durations.sum())


def search(
    task: Task,
    settings: Search,
    report: Report,
    hints: Iterable[Sequence_] = (),
    better: Better = lambda _: None,
) -> Survey:
    """Search the orders of rest, and the number of cycles, that give the best gait.

    Constructed orders come first, then plain ones by the ceilings that their resting sets put on
    the speed, then variations of the best: a set of resting masses inserted, dropped or
    exchanged, two cycles joined.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    settings : Search
        Effort, phases, the user's own sequence, time limit, threads.
    report : callable
        Told what goes on: text and the fraction done.
    hints : iterable of sequences, optional
        Tried first, with those of the constructed gaits.
    better : callable, optional
        Given every trial that is better than all before it.

    Returns
    -------
    Survey
        The same for any number of threads, but for time limits.

    Examples
    --------
    One link and two masses that rest in turn. Without the time that acceleration takes the speed
    would be half the rate.

    >>> from wormopt.core.limits import Limits
    >>> from wormopt.core.task import Worm
    >>> from wormopt.progress import silent
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> survey = search(Task(Worm(1, load=5.0), limits), Search(), silent)
    >>> round(survey.trials[0].value, 3), survey.trials[0].sequence
    (0.425, ((0,), (1,)))
    """
    until = np.inf if settings.time_limit is None else monotonic() + settings.time_limit
    over = threading.Event()
    work = effort_of(settings).work * _OF_ONE_CLIMB
    trier = Trier(task, stop=lambda: over.is_set() or monotonic() > until, work=work)
    links = task.worm.links
    workers = settings.workers or (1 if links <= 2 else os.cpu_count() or 1)
    race = _Race(task, trier, workers, report, better)
    ended, seconds, since = "searched", dict[str, float](), monotonic()
    try:
        for stage in _steps(race, settings, hints):
            now = monotonic()
            seconds[stage] = seconds.get(stage, 0.0) + now - since
            since = now
            if race.is_over:
                break
            if now > until:
                ended = "time limit"
                break
    except KeyboardInterrupt:
        ended = "interrupted"
    finally:
        over.set()
        race.close()
    ranking = sorted([*race.ranking, *race.others], key=lambda t: -t.value)
    return Survey(tuple(ranking), len(race.trials), race.varied, trier.programs, ended, seconds)


def _steps(race: _Race, settings: Search, hints: Iterable[Sequence_]) -> Iterator[str]:
    """Search in steps of some seconds at most; after each, the stage that it belongs to."""
    effort, task = effort_of(settings), race.task
    if settings.sequence is not None:
        stage = race.tell("your sequence", 0.0)
        race.enter([_Start(tuple(tuple(sorted(s)) for s in settings.sequence))])
        yield stage
        race.promote(0, 1)
        race.promote(1, 1)
        yield stage
        return
    first = [race.canonical(s) for s in (*hints, *first_orders(task))]
    first = [s for s in dict.fromkeys(first) if len(s) <= (settings.phases or len(s))]
    for batch in _batches(first):
        stage = race.tell("constructed orders", 0.0)
        race.enter(map(_Start, batch))
        yield stage
    race.promote(0, 1)
    yield "constructed orders"
    orders = [s for s in plain_orders(task, settings.phases) if s not in race.trials]
    for k, batch in enumerate(_batches(islice(orders, effort.enumerated))):
        stage = race.tell("plain orders", 0.5 * k * _BATCH / effort.enumerated)
        race.enter(map(_Start, batch))
        yield stage
        if race.trier.work > effort.work / 2:
            break
    race.promote(0, 3 * effort.width)
    yield "plain orders"
    # the speed climbs to the same top from almost anywhere at first, costs do not
    speed = task.objective.minimise is None
    starts, width = (1, 1) if speed else (effort.starts, 4)
    for start in range(starts):
        stage = race.tell("other starts", 0.5)
        race.restart(width * effort.width, (settings.seed, start))
        yield stage
    for _ in _vary(race, settings):
        yield "variations"
    stage = race.tell("finer arcs", 0.8)
    race.promote(1, effort.width)
    yield stage
    most = max(effort.work, race.trier.work + _OF_RESTARTS * effort.work)
    for start in range(effort.starts):
        stage = race.tell("other starts", 0.9)
        race.restart(2, (settings.seed, 1 + start), race.margins[1])
        yield stage
        if race.trier.work > most:
            return


def _vary(race: _Race, settings: Search) -> Iterator[None]:
    """Vary the best orders as long as that helps; begin anew with every order that is better."""
    effort, task = effort_of(settings), race.task
    most = effort.work * (_WORK_OF_ENERGY if is_energy(task) else 1.0)
    helped = True
    while helped:
        record, helped = race.value, False
        for batch in _batches(islice(_variations(race, settings, effort.width), effort.varied)):
            race.tell("variations", 0.5 + 0.3 * min(1.0, race.trier.work / most))
            race.enter(batch)
            race.varied += len(batch)
            yield
            if race.trier.work > most:
                return
            helped = race.value > record + _BETTER * abs(record)
            if helped:
                break
        race.promote(0, 2 * effort.width)
        yield


def _variations(race: _Race, settings: Search, width: int) -> Iterator[_Start]:
    """Neighbours and joined cycles of the best orders, each once."""
    seen, most = set(race.trials), settings.phases or _MOST_PHASES
    parents = _parents(race, width)
    for start in (*islice(_joined(race, parents), _JOINED), *_edited(race, parents)):
        key = race.canonical(start.sequence)
        if 2 <= len(start.sequence) <= most and is_gait(start.sequence) and key not in seen:
            seen.add(key)
            yield start


_Parent = tuple[Sequence_, np.ndarray, int]  # phases that last, their durations, and cycles


def _parents(race: _Race, width: int) -> list[_Parent]:
    """The best orders, and the best of each length and number of cycles."""
    ranking = race.ranking
    of_each = {(t.cycles, len(t.sequence)): t for t in reversed(ranking)}
    enough = ranking[0].value - race.margins[0] * abs(ranking[0].value) if ranking else 0.0
    close = sorted((t for t in of_each.values() if t.value >= enough), key=lambda t: -t.value)
    found = dict[Sequence_, _Parent]()
    for trial in dict.fromkeys([*ranking[:width], *close[: 2 * width]]):
        sequence, durations = lasting(trial.sequence, trial.durations.tolist())
        parent = sequence, np.array(durations), trial.cycles
        found.setdefault(race.canonical(sequence), parent)
    return list(found.values())


def _edited(race: _Race, parents: list[_Parent]) -> Iterator[_Start]:
    """One resting set inserted, exchanged, dropped or moved; what changes least first."""
    letters = search_letters(race.task)
    edits = [(*edit, p) for p in parents for edit in neighbours(p[0], letters)]
    for _, word, kept, (old, durations, cycles) in sorted(edits, key=lambda edit: edit[0]):
        fresh = float(durations.mean()) / 2
        times = np.array([fresh if k is None else durations[k] for k in kept])
        yield _Start(word, times, cycles if len(word) >= len(old) else 0)


def _joined(race: _Race, parents: list[_Parent]) -> Iterator[_Start]:
    """Two cycles in one, where a period has room: the same, its mirror image, or another."""
    masses, longest = race.task.worm.links + 1, race.task.limits.period_range[1]
    for (one, first, _), (two, second, _) in product(parents, repeat=2):
        if longest < 0.7 * (first.sum() + second.sum()):
            continue
        for word in (two, mirrored(two, masses)) if race.mirror else (two,):
            for k in range(len(word)):
                times = np.concatenate([first, np.roll(second, -k)])
                yield _Start((*one, *word[k:], *word[:k]), times)


def _batches(items: Iterable) -> Iterator[list]:
    items = iter(items)
    while batch := list(islice(items, _BATCH)):
        yield batch


# Links up to which ceilings cost less than a first look at an order.
_CHEAP_CEILINGS = 8
# Most joined cycles in a round.
_JOINED = 40
# Phases of a cycle up to which orders are varied.
_MOST_PHASES = 12
