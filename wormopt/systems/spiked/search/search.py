"""Search over the order in which masses rest: enumerate, select, vary the best.

The order determines the optimum, and local optimisation does not change it. Every order is first
tried with few arcs; orders close to the best at the same number of arcs are tried with more. A
period contains the number of cycles that suits the order, and different cycles may be joined.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, cycle, islice, product
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from wormopt.numerics.workers import Workers
from wormopt.progress import Report
from wormopt.systems.shared.sequences import (
    Sequence_,
    ascending,
    canonical,
    is_gait,
    lasting,
    minimal,
    mirrored,
    neighbours,
    neighbours_at_both_ends,
    travel,
    wave_orders,
)
from wormopt.systems.spiked.certify.bound import Bounded, at_once
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Search
from wormopt.systems.spiked.programs.gait_rows import is_energy
from wormopt.systems.spiked.programs.scaled_limits import scaled
from wormopt.systems.spiked.search.orders import (
    ceiling_of,
    first_orders,
    is_mirror_symmetric,
    plain_orders,
    search_letters,
)
from wormopt.systems.spiked.search.trial import Trial, Trier

Better = Callable[[Trial], None]

# Trials within this share of the best with as many arcs are tried with more. The absorbed energy is
# a small part of the total, so few arcs say little about it.
_MARGINS, _MARGINS_OF_ENERGY = (0.08, 0.01), (0.5, 0.15)
# Share of the value within which another local optimum of an order is kept; share of the cycle
# within which the phases of two gaits are equally long.
_CLOSE, _ALIKE = 1e-3, 1e-2
# Shares of the cycle below which a phase counts as absent, and as short.
_SIZES = 5e-3, 5e-2
# Absorbed energy per distance, in units of force, that counts as zero.
_NONE = 1e-10
# Largest number of links for which ceilings cost less than a first trial of an order.
_CHEAP_CEILINGS = 8


class Start(NamedTuple):
    """An order of rest with starting values."""

    sequence: Sequence_  # resting masses of a cycle
    durations: np.ndarray | None = None  # of its phases; None: short ones
    cycles: int = 0  # cycles that nearly fill a period; 0: unknown


@dataclass(frozen=True, eq=False)
class Known:
    """Result of the search of a similar task: orders to try first, and variations not to try."""

    good: tuple[Start, ...] = ()  # best first
    poor: frozenset[Sequence_] = frozenset()  # canonical


@dataclass(eq=False)
class Race:
    """The best trial of every order, other promising trials, and the best value of every level."""

    task: GaitProblem
    trier: Trier
    workers: int  # processes
    report: Report
    better: Better  # given every trial better than all before it
    places: int  # first trials are given up below this many best values
    # best of each canonical order; None: no gait
    trials: dict[Sequence_, Trial | None] = field(default_factory=dict)
    # local optima next to the best of their order
    others: list[Trial] = field(default_factory=list)
    poor: frozenset[Sequence_] = frozenset()  # canonical orders that are not tried as variations
    varied: int = 0  # number of orders that are variations of others
    enough: float = np.inf  # value close enough to a proven bound
    too_fast: Bounded | None = None  # bound on the speed, if it is below the required one

    def __post_init__(self) -> None:
        self._best: Trial | None = None
        self._records: dict[int, float] = {}
        self._values = set[float]()  # of first trials, to four digits
        self._workers = Workers(self.workers)
        self.long = self.task.worm.links > _CHEAP_CEILINGS
        self.mirror = is_mirror_symmetric(self.task)
        self._energy, self._force = is_energy(self.task), scaled(self.task).force
        self.margins = _MARGINS_OF_ENERGY if self._energy else _MARGINS

    def close(self) -> None:
        """Release the processes."""
        self._workers.close()

    def announce(self, stage: str, fraction: float) -> str:
        """Report the next stage with the best cost so far; return the stage."""
        best = f", best so far {self.ranking[0].cost:.6g}" if self._records else ""
        self.report(stage + best, fraction)
        return stage

    def canonical(self, sequence: Sequence_) -> Sequence_:
        """Representative of all equivalent sequences."""
        return canonical(sequence, self.task.worm.links + 1, mirror=self.mirror)

    def _each(self, work: Callable[[Trier, Any], Trial | None], jobs: Sequence) -> Iterator:
        """Apply `work` to every job in parallel, and count its programs and work."""
        for found, programs, pivots in self._workers.map(partial(_tried, self.trier, work), jobs):
            self.trier.programs += programs
            self.trier.work += pivots
            yield found

    def enter(self, starts: Iterable[Start]) -> list[Trial]:
        """Try orders for the first time; return the trials that have a gait."""
        starts = [s for s in starts if self.can_win(s.sequence)]
        usual = None if self._best is None else self._best.durations
        places = sorted(self._values)[-self.places :]
        least = places[0] if len(places) == self.places else -np.inf
        first = partial(_first, enough=max(self._close(0), least), usual=usual)
        found = self._fitted(starts, first)
        if not found and self._best is None and self.task.objective.speed is not None:
            # durations of first starts may be far from those of the required speed
            found = self._fitted(starts, partial(first, patient=True))
        return found

    def _fitted(self, starts: list[Start], first: Callable) -> list[Trial]:
        found = list[Trial]()
        for start, fitted in zip(starts, self._each(first, starts), strict=True):
            self.trials.setdefault(self.canonical(start.sequence), None)
            if fitted is not None:
                self.keep(fitted)
                self._values.add(float(f"{fitted.value:.4g}"))
                found.append(fitted)
        return found

    def can_win(self, sequence: Sequence_) -> bool:
        """Whether the ceiling of an order is above the best value."""
        required = self.task.objective.speed
        bound = self.value if required is None else required
        return self.long or ceiling_of(self.task, sequence) > bound

    def keep(self, trial: Trial) -> None:
        """Record a trial fitted to a period, and keep it if it is the best of its order."""
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
        """Whether no gait can be better, because no energy is absorbed."""
        return self._energy and self.value >= -_NONE * self._force

    @property
    def is_proven(self) -> bool:
        """Whether no gait can be better by more than the wanted gap."""
        return self.value >= self.enough

    def record(self, level: int) -> float:
        """Best value at a level (number of halvings of arcs), -inf before there is one."""
        return self._records.get(level, -np.inf)

    def _close(self, level: int) -> float:
        record = self.record(level)
        return record - self.margins[level] * abs(record) if np.isfinite(record) else -np.inf

    @property
    def ranking(self) -> list[Trial]:
        """Trials, best first; short cycles first among ties."""
        return sorted((t for t in self.trials.values() if t is not None), key=rank)

    def restart(self, width: int, random: Sequence[int], share: float = 1e9) -> None:
        """Try the best orders again from random arcs, with as many arcs as they have.

        At most `width` orders within `share` of the best; `random` is the seed.
        """
        enough = self.value - share * abs(self.value)
        best = [t for t in self.ranking[:width] if t.value >= enough]
        reached = -np.inf if self._energy else self._close(0)  # few arcs say little about energy
        again = partial(_again, seed=random, enough=reached)
        for trial, other in zip(best, self._each(again, best), strict=True):
            if other is not None:
                self.keep(other)
                lower, higher = sorted((trial, other), key=lambda t: t.value)
                close = abs(higher.value - lower.value) < _CLOSE * abs(higher.value)
                if close and not _alike(lower, higher):  # more arcs decide which is better
                    self.others.append(lower)

    def promote(self, level: int, most: int) -> None:
        """Try up to `most` orders close to the best of their level with more arcs."""
        while most > 0:
            close = [t for t in self.ranking if t.level == level]
            close = [t for t in close if t.value >= self._close(level)][: min(4, most)]
            if not close:
                return
            self.refine(close)
            most -= len(close)

    def refine(self, trials: list[Trial]) -> list[Trial]:
        """Try again with more arcs; return the new trials."""
        found = list(self._each(Trier.finer, trials))
        for trial in trials:
            self.trials[self.canonical(trial.sequence)] = None  # some phases may vanish
        for finer in found:
            self.keep(finer)
        return found


def _tried(
    trier: Trier, work: Callable[[Trier, Any], Trial | None], job: Any
) -> tuple[Trial | None, int, int]:
    """Result of a job, with the number of its programs and its work."""
    trier = copy(trier)
    trier.programs = trier.work = 0
    found = work(trier, job)
    if found is not None:
        _ = found.value  # computed here, so that the receiver needs no program
        found.program.forget()
    return found, trier.programs, trier.work


def _first(
    trier: Trier, start: Start, enough: float, usual: np.ndarray | None, *, patient: bool = False
) -> Trial | None:
    """Try an order for the first time, also with a period like that of the best trial."""
    if usual is not None and trier.stopped():
        return None
    sequence, durations, cycles = start
    if durations is not None and cycles:
        return trier.near(sequence, durations, cycles, enough)
    others = [durations]
    if durations is None and usual is not None:
        others.append(np.full(len(sequence), usual.sum() / len(sequence)))
    for durations in others:
        free = trier.free(sequence, durations, enough, patient=patient)
        # a free period is at least as good as any number of cycles
        if free is not None and free.value >= enough:
            return trier.fit(free)
    return None


def _again(trier: Trier, trial: Trial, seed: Sequence[int], enough: float) -> Trial | None:
    """Try an order from random arcs, and refine it to as many arcs if it reaches `enough`."""
    free = trier.free(trial.sequence, None, enough, np.random.default_rng(seed))
    other = trier.fit(free) if free and free.value >= enough else None
    if other is None or other.value < enough:
        return None
    while other and other.level < max(1, trial.level):
        other = trier.finer(other)
    return other


def rank(trial: Trial) -> tuple[float, int, Sequence_]:
    """Sorting key: best first, and short cycles first among ties up to rounding."""
    return -float(f"{trial.value:.11g}"), len(trial.sequence), trial.sequence


def apart(trials: Iterable[Trial]) -> list[Trial]:
    """The best trial of each pattern of long, short and absent phases, best first."""
    found = dict[Any, Trial]()
    for trial in sorted(trials, key=rank):
        lengths = np.digitize(trial.durations / trial.durations.sum(), _SIZES)
        found.setdefault((trial.cycles, *lengths.tolist()), trial)
    return list(found.values())


def _alike(one: Trial, other: Trial) -> bool:
    """Whether two trials have the same sequence, cycles and nearly the same durations."""
    if one.sequence != other.sequence or one.cycles != other.cycles:
        return False
    apart = np.abs(one.durations - other.durations).max()
    return bool(apart < _ALIKE * one.durations.sum())


@dataclass(frozen=True)
class Effort:
    """Settings of the extent of a search."""

    enumerated: int  # most plain orders, highest ceilings first
    width: int  # orders varied at a time, doubled after a round without gain
    varied: int  # most variations in a round
    patience: int  # rounds without gain before variations end
    # pivots × (rows + columns) after which variations end; long worms need more each
    work: float
    starts: int  # random starts of the best orders, for a cost
    timed: int  # starts of a prescribed order from random durations


_EFFORTS = {
    "quick": Effort(enumerated=16, width=1, varied=8, patience=1, work=3e8, starts=1, timed=8),
    "normal": Effort(enumerated=160, width=4, varied=240, patience=2, work=7e8, starts=3, timed=32),
    "thorough": Effort(
        enumerated=1000, width=8, varied=800, patience=2, work=6e9, starts=8, timed=128
    ),
}
# Shares of the work for one climb, for plain orders and their other starts (variations need the
# rest), and for the last restarts at the end of the work.
_OF_ONE_CLIMB, _OF_PLAIN, _OF_RESTARTS = 0.1, 0.5, 0.2
# Share of the work for variations of a long worm.
_OF_LONG = 0.3
# Factor on the work for energy: its programs are denser, so a pivot takes longer.
_WORK_OF_ENERGY = 0.3
# Relative gains after which variations begin again: in general; for durations and long worms.
_BETTER, _GAIN = 1e-3, 1e-4
# Duration of a short phase, as a share of the mean.
_BRIEF = 0.05
_BATCH = 8
# Largest number of joined cycles in a round.
_JOINED = 100
# Share by which phases of a cycle that is joined with itself change: from equal cycles a climb sees
# no gain in making them differ.
_UNEVEN = 0.25
# First trials that are pursued, for each order that is varied at a time.
_PLACES = 6
# Variations of the best orders for each insertion into a wave or variation of a niche.
_OF_THE_BEST = 3
# For long worms, a mass comes in only within this share of the links of a resting mass.
_NEAR = 4
# Up to this number of links, sets come in at both ends at once; longer worms take too long.
_BOTH_ENDS = 12
# Weight of a parent's rank against the number of changed masses.
_RANK = 0.5
# Largest number of phases of varied orders.
_MOST_PHASES = 12


def effort_of(settings: Search) -> Effort:
    """Extent of the search by its settings."""
    return _EFFORTS[settings.effort]


# Endings of complete searches.
DONE = ("searched", "proven")


@dataclass(frozen=True)
class Survey:
    """Result of a search, with counts of its work."""

    task: GaitProblem
    trials: tuple[Trial, ...]  # best of each order and its other optima, best first
    tried: frozenset[Sequence_]  # canonical orders
    varied: int  # of these, variations of others
    programs: int  # linear programs solved
    ended: str  # "searched", "proven", "time limit" or "interrupted"
    seconds: dict[str, float] = field(default_factory=dict)  # of each stage
    bounded: Bounded | None = None  # bound on the speed, also where none reaches a required one

    def known(self, width: int) -> Known:
        """Knowledge for the search of a similar task: the best `width` orders are good ones."""
        best = self.trials[:width]
        mirror, masses = is_mirror_symmetric(self.task), self.task.worm.links + 1
        kept = {canonical(trial.sequence, masses, mirror=mirror) for trial in best}
        good = [Start(trial.sequence, trial.durations, trial.cycles) for trial in best]
        return Known((*map(Start, [best[0].sequence]), *good), self.tried - kept)


def search(
    task: GaitProblem,
    settings: Search,
    report: Report,
    known: Known | None = None,
    better: Better = lambda _: None,
) -> Survey:
    """Search the orders of rest, and numbers of cycles, for the best gait.

    The stages are: `known` and constructed orders; plain orders by their ceilings; variations. The
    search ends when no gait can be better by more than the wanted gap. Apart from time limits, the
    result does not depend on the number of processes. `better` is called with each new best.
    """
    known = known or Known()
    until = np.inf if settings.time_limit is None else monotonic() + settings.time_limit
    work = effort_of(settings).work * _OF_ONE_CLIMB
    trier = Trier(task, until=until, work=work)
    links = task.worm.links
    workers = settings.workers or (1 if links <= 2 else os.cpu_count() or 1)
    places = _PLACES * effort_of(settings).width
    race = Race(task, trier, workers, report, better, places, poor=known.poor)
    ended, seconds, since = "searched", dict[str, float](), monotonic()
    bounded = at_once(task) if settings.sequence is None else None
    if bounded is not None:
        race.enough = bounded.bound / (1.0 + settings.gap)
    try:
        for stage in _steps(race, settings, known.good):
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
        race.close()
    ranking = tuple(sorted([*race.ranking, *race.others], key=rank))
    if ended == "searched" and (race.is_proven or race.too_fast):
        ended = "proven"
    tried = frozenset(race.trials)
    counts = race.varied, trier.programs
    return Survey(task, ranking, tried, *counts, ended, seconds, bounded or race.too_fast)


def _effort(race: Race, settings: Search) -> Effort:
    """Extent of the search; smaller for long worms, whose trials take longer."""
    effort = effort_of(settings)
    return replace(effort, width=(effort.width + 1) // 2, starts=0) if race.long else effort


def _steps(race: Race, settings: Search, good: Sequence[Start]) -> Iterator[str]:
    """Search in steps of a few seconds; yield the stage of each."""
    effort, task = _effort(race, settings), race.task
    if settings.sequence is not None:
        for _ in _prescribed(race, ascending(settings.sequence), settings):
            yield "your sequence"
        return
    first = [race.canonical(s) for s in first_orders(task)]
    first = [s for s in dict.fromkeys(first) if len(s) <= (settings.phases or len(s))]
    for batch in _batches((*good, *map(Start, first))):
        stage = race.announce("constructed orders", 0.0)
        race.enter(batch)
        yield stage
    race.promote(0, 1)
    yield "constructed orders"
    if not race.ranking and task.objective.speed is not None:
        bounded = at_once(structs.replace(task, objective=Objective()))
        if bounded and bounded.bound < task.objective.speed:
            race.too_fast = bounded
            return
    if not race.long:  # their orders are too many and their ceilings too expensive
        yield from _until_proven(race, _plain(race, settings))
    yield from _until_proven(race, _vary(race, settings))
    stage = race.announce("finer arcs", 0.8)
    race.promote(1, effort.width)
    yield stage
    if race.is_proven:
        return
    most = max(effort.work, race.trier.work + _OF_RESTARTS * effort.work)
    for start in range(effort.starts):
        stage = race.announce("other starts", 0.9)
        race.restart(2, (settings.seed, 1 + start), race.margins[1])
        yield stage
        if race.trier.work > most:
            return


def _until_proven(race: Race, stages: Iterator[str]) -> Iterator[str]:
    while not race.is_proven and (stage := next(stages, None)):
        yield stage


def _plain(race: Race, settings: Search) -> Iterator[str]:
    """Try plain orders by their ceilings, then the best of all orders from other starts."""
    effort, task = effort_of(settings), race.task
    orders = [s for s in plain_orders(task, settings.phases) if s not in race.trials]
    for k, batch in enumerate(_batches(islice(orders, effort.enumerated))):
        stage = race.announce("plain orders", 0.5 * k * _BATCH / effort.enumerated)
        race.enter(map(Start, batch))
        yield stage
        if race.trier.work > _OF_PLAIN * effort.work:
            break
    race.promote(0, 3 * effort.width)
    yield "plain orders"
    # climbs of the speed mostly reach the same optimum, climbs of costs do not
    speed = task.objective.minimise is None
    starts, width = (1, 1) if speed else (1 if race.poor else effort.starts, 4)
    for start in range(starts):
        stage = race.announce("other starts", 0.5)
        race.restart(width * effort.width, (settings.seed, start))
        yield stage
        if race.trier.work > _OF_PLAIN * effort.work:
            break


def _prescribed(race: Race, order: Sequence_, settings: Search) -> Iterator[None]:
    """Climb with one order from random durations, then from variations of the best ones.

    The result of a climb depends on its start. The best trial with few arcs need not be the best
    with more, so several are refined.
    """
    effort, random, phases = effort_of(settings), np.random.default_rng(settings.seed), len(order)
    longest = min(race.trier.longest, 2 * race.trier.phase_guess() * phases)
    times = longest * random.uniform(0.5, 1, (effort.timed, 1))
    drawn = times * random.dirichlet(np.ones(phases), effort.timed)
    found = race.enter([Start(order)])
    while len(drawn):
        before = race.value
        for batch in _batches(Start(order, durations) for durations in drawn):
            race.announce("your sequence", 0.5)
            found += race.enter(batch)
            yield
            if race.trier.work > effort.work / 2:
                break
        if race.trier.work > effort.work / 2 or not race.value > before + _GAIN * abs(before):
            break
        near = [t.durations for t in apart(found)[: effort.width] if t.sequence == order]
        drawn = np.concatenate([np.zeros((0, phases)), *map(_moved, near)])
    for _ in range(2):
        race.announce("your sequence, finer arcs", 0.8)
        found = race.refine(apart(found)[: 2 * effort.width])
        yield
    race.others += apart(found)[1 : effort.width]


def _moved(durations: np.ndarray) -> np.ndarray:
    """Change one phase at a time: short phases become long, long phases short."""
    usual = durations.mean()
    others = np.where(durations < usual / 2, usual, _BRIEF * usual)
    return np.where(np.eye(len(durations), dtype=bool), others, durations)


def _vary(race: Race, settings: Search) -> Iterator[str]:
    """Vary the best orders while that helps; begin again after every better order."""
    effort, task = _effort(race, settings), race.task
    most = effort.work * (_WORK_OF_ENERGY if is_energy(task) else 1.0)
    if race.long:
        most = race.trier.work + _OF_LONG * most
    in_vain, gain = 0, _GAIN if race.long else _BETTER
    # the search of a similar task varied before
    varied, patience = (effort.varied // 3, 1) if race.poor else (effort.varied, effort.patience)
    while in_vain < patience:
        enough = race.record(0) + gain * abs(race.record(0))
        width = effort.width << in_vain  # if variations of the best fail, those of others may not
        for batch in _batches(islice(_variations(race, settings, width), varied)):
            stage = race.announce("variations", 0.5 + 0.3 * min(1.0, race.trier.work / most))
            orders = [race.canonical(start.sequence) for start in batch]
            hopeful = [s for s, order in zip(batch, orders, strict=True) if order not in race.poor]
            race.trials |= dict.fromkeys(race.poor.intersection(orders))
            race.enter(hopeful)
            race.varied += len(hopeful)
            yield stage
            if race.trier.work > most:
                return
            if race.record(0) > enough:
                break
        in_vain = 0 if race.record(0) > enough else in_vain + 1
        race.promote(0, (1 if race.long else 2) * effort.width)
        yield "variations"


def _batches(items: Iterable) -> Iterator[list]:
    items = iter(items)
    while batch := list(islice(items, _BATCH)):
        yield batch


def _variations(race: Race, settings: Search, width: int) -> Iterator[Start]:
    """Neighbours and joined cycles of the best orders, and some of other niches, each once."""
    seen, most = set(race.trials), settings.phases or _MOST_PHASES

    def fresh(starts: Iterable[Start]) -> Iterator[Start]:
        for start in starts:
            # a worm that hardly moves may have a single lasting phase
            if 2 <= len(start.sequence) <= most and is_gait(start.sequence):
                key = race.canonical(start.sequence)
                if key not in seen:
                    seen.add(key)
                    yield start

    niches = _niches(race, width)
    best = niches if race.long else list(enumerate(_parents(race, width)))
    joined = islice(_joined(race, [parent for _, parent in best]), _JOINED)
    # trials of waves with many phases take long
    waves = [] if race.long else _waves(race)
    inserted = fresh(_edited(race, waves, inserted=True))
    others = cycle([inserted, fresh(_edited(race, niches))])
    for k, start in enumerate(fresh(chain(joined, _edited(race, best))), start=2):
        yield start
        if k % _OF_THE_BEST == 0:
            yield from islice(next(others), 1)
    yield from inserted


_Parent = tuple[Sequence_, np.ndarray, int]  # lasting phases, their durations, number of cycles


def _parent(trial: Trial) -> _Parent:
    sequence, durations = lasting(trial.sequence, trial.durations.tolist())
    return sequence, np.array(durations), trial.cycles


def _parents(race: Race, width: int) -> list[_Parent]:
    """The best `width` orders, and twice as many best ones of a length and number of cycles."""
    ranking = race.ranking
    of_each = {(t.cycles, len(t.sequence)): t for t in reversed(ranking)}
    close = sorted((t for t in of_each.values() if t.value >= _hopeful(race)), key=rank)
    found = dict[Sequence_, _Parent]()
    for trial in dict.fromkeys([*ranking[:width], *close[: 2 * width]]):
        parent = _parent(trial)
        found.setdefault(race.canonical(parent[0]), parent)
    return list(found.values())


def _hopeful(race: Race) -> float:
    """Smallest value of an order that is varied."""
    return race.value - race.margins[0] * abs(race.value)


def _niches(race: Race, width: int) -> list[tuple[int, _Parent]]:
    """The best orders, by direction of travel and rank, the best of each niche first."""
    masses = race.task.worm.links + 1
    found = dict[Sequence_, _Parent]()
    for place, trial in enumerate(race.ranking):
        if place < width or trial.value >= _hopeful(race):
            parent = _parent(trial)
            found.setdefault(race.canonical(parent[0]), parent)
    seen = set[tuple]()
    directions = defaultdict[int, tuple[list[_Parent], list[_Parent]]](lambda: ([], []))
    for word, parent in found.items():
        direction = travel(word, masses)
        direction = abs(direction) if race.mirror else direction
        niche = direction, minimal(word), len(word), parent[2]
        directions[direction][niche in seen].append(parent)
        seen.add(niche)
    ranked = (each for best, others in directions.values() for each in enumerate((*best, *others)))
    return sorted(ranked, key=lambda each: each[0])[: width + (width + 1) // 2]


def _waves(race: Race) -> list[tuple[int, _Parent]]:
    """Constructed waves with a gait, in both directions, with their ranks."""
    links = race.task.worm.links
    waves = wave_orders(links, race.task.limits.resting)
    both = {race.canonical(w) for wave in waves for w in (wave, mirrored(wave, links + 1))}
    trials = [t for t in race.ranking if race.canonical(t.sequence) in both]
    return list(enumerate(map(_parent, trials)))


def _edited(
    race: Race, ranked: list[tuple[int, _Parent]], *, inserted: bool = False
) -> Iterator[Start]:
    """Insert, exchange, drop or move one resting set; smallest changes first.

    `inserted`: only insertions, into each parent in turn. Long worms have only near changes, at
    both ends if these are alike, and more often parents with few phases, which take less time.
    """
    letters, links = search_letters(race.task), race.task.worm.links
    edits, reach = [], links // _NEAR if race.long else np.inf
    for place, parent in ranked:
        word = parent[0]
        found = list(neighbours(word, letters, reach))
        if race.long and race.mirror and links <= _BOTH_ENDS:
            found = list(neighbours_at_both_ends(word, letters, reach, links + 1)) or found
        if inserted:
            found = [each for each in found if len(each[1]) == len(word) + 1]
        # insertions in the middle of a phase gain most
        found.sort(key=lambda each: (each[0], -len(each[1]) * race.long))
        for k, (change, edited, kept) in enumerate(found):
            cost = len(word) ** 2 * (1 + place) * (1 + k) if race.long else change + _RANK * place
            edits.append((cost, edited, kept, parent))
    for _, word, kept, (old, durations, cycles) in sorted(edits, key=lambda edit: edit[0]):
        fresh = float(durations.mean()) / 2
        times = [fresh if k is None else durations[k] / kept.count(k) for k in kept]
        yield Start(word, np.array(times), cycles if len(word) >= len(old) else 0)


def _joined(race: Race, parents: list[_Parent]) -> Iterator[Start]:
    """Join two cycles where a period has room: the same twice, its mirror image, or another."""
    masses, longest = race.task.worm.links + 1, race.task.limits.period_range[1]
    pairs = sorted(product(range(len(parents)), repeat=2), key=lambda pair: (sum(pair), pair))
    for (one, first, _), (two, second, _) in ((parents[i], parents[j]) for i, j in pairs):
        if longest < 0.7 * (first.sum() + second.sum()):
            continue
        for word in (two, mirrored(two, masses)) if race.mirror else (two,):
            for k in range(len(word)):
                joined = (*one, *word[k:], *word[:k])
                times = np.concatenate([first, np.roll(second, -k)])
                if joined[len(one) :] == one:
                    change = _UNEVEN * (-1.0) ** np.arange(len(one))
                    times *= 1.0 + np.concatenate([change, -change])
                cycles = max(1, round(longest / times.sum()))
                yield Start(joined, times, cycles)
