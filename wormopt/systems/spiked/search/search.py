"""Search over the order in which masses rest: enumerate, race, vary the best.

The order decides the optimum and local optimisation does not change it. Every order is first
tried with few arcs; what is close to the best at its level is looked at with more. A period is
filled by as many cycles as suit the order, and several different cycles may be joined.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, cycle, islice, product
from time import monotonic

import numpy as np

from wormopt.progress import Report
from wormopt.systems.shared.sequences import (
    Sequence_,
    ascending,
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
from wormopt.systems.spiked.gait_problem import GaitProblem, Search
from wormopt.systems.spiked.programs.gait_rows import is_energy
from wormopt.systems.spiked.search.orders import first_orders, plain_orders, search_letters
from wormopt.systems.spiked.search.race import Better, Race, Start, apart, rank
from wormopt.systems.spiked.search.trial import Trial, Trier


@dataclass(frozen=True)
class Effort:
    """How much is tried."""

    enumerated: int  # most orders of the systematic part, best ceilings first
    width: int  # orders varied at a time, doubled after a round in vain; share of what is promoted
    varied: int  # most variations tried in a round
    patience: int  # rounds in a row that bring nothing before they end
    # pivots × rows and columns after which no more are varied; long worms need more each
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
# Shares of the work that one climb may take, and that the last restarts may where nothing is left.
_OF_ONE_CLIMB, _OF_RESTARTS = 0.1, 0.2
# Share of it that the variations of a long worm may take.
_OF_LONG = 0.3
# Pivots of its programs take longer: they are denser.
_WORK_OF_ENERGY = 0.3
# Gain, as a share, by which variations begin anew, and draws of durations, and those of long worms.
_BETTER, _GAIN = 1e-3, 1e-4
# Share of the mean duration of a phase that is short.
_BRIEF = 0.05
_BATCH = 8
# Most joined cycles in a round.
_JOINED = 100
# First looks that are worth going on with, for each order that is varied at a time.
_PLACES = 6
# Variations of the best for each insertion into a wave, or variation of the best of a niche.
_OF_THE_BEST = 3
# Masses that come in are no farther from those at rest than the links of a long worm by this.
_NEAR = 4
# Links up to which sets come in at both ends at once: the phases are more, and take longer.
_BOTH_ENDS = 12
# Masses of change that outweigh being the next better parent.
_RANK = 0.5
# Phases of a cycle up to which orders are varied.
_MOST_PHASES = 12


def effort_of(settings: Search) -> Effort:
    """Effort that the settings ask for."""
    return _EFFORTS[settings.effort]


# How a search ends that was not cut short.
DONE = ("searched", "proven")


@dataclass(frozen=True)
class Survey:
    """What a search found and how much it saw."""

    task: GaitProblem  # that was searched
    trials: tuple[Trial, ...]  # best of each order and its close optima, best first
    tried: int  # orders
    varied: int  # of these, variations of others
    programs: int  # linear programs solved
    ended: str  # "searched", "proven", "time limit" or "interrupted"
    seconds: dict[str, float] = field(default_factory=dict)  # of each stage
    bounded: Bounded | None = None  # what no gait is faster than, if the search made use of it


def search(
    task: GaitProblem,
    settings: Search,
    report: Report,
    hints: Iterable[Sequence_] = (),
    better: Better = lambda _: None,
) -> Survey:
    """Search the orders of rest, and the number of cycles, that give the best gait.

    First `hints` and constructed orders, then plain ones by their ceilings, then variations, until
    no gait can be better by more than the wanted gap. The same for any number of processes, but
    for time limits; `better` gets each new best.
    """
    until = np.inf if settings.time_limit is None else monotonic() + settings.time_limit
    work = effort_of(settings).work * _OF_ONE_CLIMB
    trier = Trier(task, until=until, work=work)
    links = task.worm.links
    workers = settings.workers or (1 if links <= 2 else os.cpu_count() or 1)
    race = Race(task, trier, workers, report, better, _PLACES * effort_of(settings).width)
    ended, seconds, since = "searched", dict[str, float](), monotonic()
    bounded = at_once(task) if settings.sequence is None else None
    if bounded is not None:
        race.enough = bounded.bound / (1.0 + settings.gap)
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
        race.close()
    ranking = sorted([*race.ranking, *race.others], key=rank)
    if ended == "searched" and race.is_proven:
        ended = "proven"
    tried = len(race.trials)
    return Survey(task, tuple(ranking), tried, race.varied, trier.programs, ended, seconds)


def _effort(race: Race, settings: Search) -> Effort:
    """Effort that the settings ask for; each look at a long worm takes more, so there are fewer."""
    effort = effort_of(settings)
    return replace(effort, width=(effort.width + 1) // 2, starts=0) if race.long else effort


def _steps(race: Race, settings: Search, hints: Iterable[Sequence_]) -> Iterator[str]:
    """Search in steps of some seconds at most; after each, the stage that it belongs to."""
    effort, task = _effort(race, settings), race.task
    if settings.sequence is not None:
        for _ in _prescribed(race, ascending(settings.sequence), settings):
            yield "your sequence"
        return
    first = [race.canonical(s) for s in (*hints, *first_orders(task))]
    first = [s for s in dict.fromkeys(first) if len(s) <= (settings.phases or len(s))]
    for batch in _batches(first):
        stage = race.tell("constructed orders", 0.0)
        race.enter(map(Start, batch))
        yield stage
    race.promote(0, 1)
    yield "constructed orders"
    if not race.long:  # too many, and their ceilings too expensive, to come upon good ones
        yield from _until_proven(race, _plain(race, settings))
    yield from _until_proven(race, _vary(race, settings))
    stage = race.tell("finer arcs", 0.8)
    race.promote(1, effort.width)
    yield stage
    if race.is_proven:
        return
    most = max(effort.work, race.trier.work + _OF_RESTARTS * effort.work)
    for start in range(effort.starts):
        stage = race.tell("other starts", 0.9)
        race.restart(2, (settings.seed, 1 + start), race.margins[1])
        yield stage
        if race.trier.work > most:
            return


def _until_proven(race: Race, stages: Iterator[str]) -> Iterator[str]:
    while not race.is_proven and (stage := next(stages, None)):
        yield stage


def _plain(race: Race, settings: Search) -> Iterator[str]:
    """Plain orders by their ceilings, and the best of all so far from other starts."""
    effort, task = effort_of(settings), race.task
    orders = [s for s in plain_orders(task, settings.phases) if s not in race.trials]
    for k, batch in enumerate(_batches(islice(orders, effort.enumerated))):
        stage = race.tell("plain orders", 0.5 * k * _BATCH / effort.enumerated)
        race.enter(map(Start, batch))
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


def _prescribed(race: Race, order: Sequence_, settings: Search) -> Iterator[None]:
    """Climb with one order from durations drawn at random, then from those near the best.

    Where a climb ends depends on them. What is best with few arcs need not be with more, so that
    several go on.
    """
    effort, random, phases = effort_of(settings), np.random.default_rng(settings.seed), len(order)
    longest = min(race.trier.longest, 2 * race.trier.phase_guess() * phases)
    times = longest * random.uniform(0.5, 1, (effort.timed, 1))
    drawn = times * random.dirichlet(np.ones(phases), effort.timed)
    found = race.enter([Start(order)])
    while len(drawn):
        before = race.value
        for batch in _batches(Start(order, durations) for durations in drawn):
            race.tell("your sequence", 0.5)
            found += race.enter(batch)
            yield
            if race.trier.work > effort.work / 2:
                break
        if race.trier.work > effort.work / 2 or not race.value > before + _GAIN * abs(before):
            break
        near = [t.durations for t in apart(found)[: effort.width] if t.sequence == order]
        drawn = np.concatenate([np.zeros((0, phases)), *map(_moved, near)])
    for _ in range(2):
        race.tell("your sequence, finer arcs", 0.8)
        found = race.refine(apart(found)[: 2 * effort.width])
        yield
    race.others += apart(found)[1 : effort.width]


def _moved(durations: np.ndarray) -> np.ndarray:
    """Durations with each phase in turn made long where it is short, or short where it is long."""
    usual = durations.mean()
    others = np.where(durations < usual / 2, usual, _BRIEF * usual)
    return np.where(np.eye(len(durations), dtype=bool), others, durations)


def _vary(race: Race, settings: Search) -> Iterator[str]:
    """Vary the best orders as long as that helps; begin anew with every order that is better."""
    effort, task = _effort(race, settings), race.task
    most = effort.work * (_WORK_OF_ENERGY if is_energy(task) else 1.0)
    if race.long:
        most = race.trier.work + _OF_LONG * most
    in_vain, gain = 0, _GAIN if race.long else _BETTER
    while in_vain < effort.patience:
        enough = race.record(0) + gain * abs(race.record(0))
        width = effort.width << in_vain  # where the best lead nowhere, others may
        for batch in _batches(islice(_variations(race, settings, width), effort.varied)):
            stage = race.tell("variations", 0.5 + 0.3 * min(1.0, race.trier.work / most))
            race.enter(batch)
            race.varied += len(batch)
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
    """Neighbours and joined cycles of the best orders, each once, and a share for other niches."""
    seen, most = set(race.trials), settings.phases or _MOST_PHASES

    def fresh(starts: Iterable[Start]) -> Iterator[Start]:
        for start in starts:
            # of a worm that hardly moves a single phase may last
            if 2 <= len(start.sequence) <= most and is_gait(start.sequence):
                key = race.canonical(start.sequence)
                if key not in seen:
                    seen.add(key)
                    yield start

    niches = _niches(race, width)
    best = niches if race.long else list(enumerate(_parents(race, width)))
    joined = islice(_joined(race, [parent for _, parent in best]), _JOINED)
    # waves of many phases take long to try
    waves = [] if race.long else _waves(race)
    inserted = fresh(_edited(race, waves, inserted=True))
    others = cycle([inserted, fresh(_edited(race, niches))])
    for k, start in enumerate(fresh(chain(joined, _edited(race, best))), start=2):
        yield start
        if k % _OF_THE_BEST == 0:
            yield from islice(next(others), 1)
    yield from inserted


_Parent = tuple[Sequence_, np.ndarray, int]  # phases that last, their durations, and cycles


def _parent(trial: Trial) -> _Parent:
    sequence, durations = lasting(trial.sequence, trial.durations.tolist())
    return sequence, np.array(durations), trial.cycles


def _parents(race: Race, width: int) -> list[_Parent]:
    """The best `width` orders, and twice as many that are best of a length and number of cycles."""
    ranking = race.ranking
    of_each = {(t.cycles, len(t.sequence)): t for t in reversed(ranking)}
    close = sorted((t for t in of_each.values() if t.value >= _hopeful(race)), key=rank)
    found = dict[Sequence_, _Parent]()
    for trial in dict.fromkeys([*ranking[:width], *close[: 2 * width]]):
        parent = _parent(trial)
        found.setdefault(race.canonical(parent[0]), parent)
    return list(found.values())


def _hopeful(race: Race) -> float:
    """Value from which orders are varied."""
    return race.value - race.margins[0] * abs(race.value)


def _niches(race: Race, width: int) -> list[tuple[int, _Parent]]:
    """The best orders of each direction of travel in turn, ranked in each, first of each niche.

    A niche has the same resting sets but for those that contain another, phases and cycles.
    """
    masses = race.task.worm.links + 1
    found = dict[Sequence_, _Parent]()
    for place, trial in enumerate(race.ranking):
        if place < width or trial.value >= _hopeful(race):
            parent = _parent(trial)
            found.setdefault(race.canonical(parent[0]), parent)
    seen = set[tuple]()
    ways = defaultdict[int, tuple[list[_Parent], list[_Parent]]](lambda: ([], []))
    for word, parent in found.items():
        way = travel(word, masses)
        way = abs(way) if race.mirror else way
        niche = way, minimal(word), len(word), parent[2]
        ways[way][niche in seen].append(parent)
        seen.add(niche)
    ranked = (each for best, others in ways.values() for each in enumerate((*best, *others)))
    return sorted(ranked, key=lambda each: each[0])[: width + (width + 1) // 2]


def _waves(race: Race) -> list[tuple[int, _Parent]]:
    """The constructed waves that are gaits, in both directions, ranked."""
    links = race.task.worm.links
    waves = wave_orders(links, race.task.limits.resting)
    both = {race.canonical(w) for wave in waves for w in (wave, mirrored(wave, links + 1))}
    trials = [t for t in race.ranking if race.canonical(t.sequence) in both]
    return list(enumerate(map(_parent, trials)))


def _edited(
    race: Race, ranked: list[tuple[int, _Parent]], *, inserted: bool = False
) -> Iterator[Start]:
    """One resting set inserted, exchanged, dropped or moved; what changes least first.

    `inserted`: into each parent in turn, nothing else. Of a long worm only what is near, at both
    ends where these are alike, and parents of few phases, which take less, more often.
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
        found.sort(key=lambda each: (each[0], -len(each[1]) * race.long))  # most gain amid a phase
        for k, (change, edited, kept) in enumerate(found):
            cost = len(word) ** 2 * (1 + place) * (1 + k) if race.long else change + _RANK * place
            edits.append((cost, edited, kept, parent))
    for _, word, kept, (old, durations, cycles) in sorted(edits, key=lambda edit: edit[0]):
        fresh = float(durations.mean()) / 2
        times = [fresh if k is None else durations[k] / kept.count(k) for k in kept]
        yield Start(word, np.array(times), cycles if len(word) >= len(old) else 0)


def _joined(race: Race, parents: list[_Parent]) -> Iterator[Start]:
    """Two cycles in one, where a period has room: the same, its mirror image, or another."""
    masses, longest = race.task.worm.links + 1, race.task.limits.period_range[1]
    pairs = sorted(product(range(len(parents)), repeat=2), key=lambda pair: (sum(pair), pair))
    for (one, first, _), (two, second, _) in ((parents[i], parents[j]) for i, j in pairs):
        if longest < 0.7 * (first.sum() + second.sum()):
            continue
        for word in (two, mirrored(two, masses)) if race.mirror else (two,):
            for k in range(len(word)):
                times = np.concatenate([first, np.roll(second, -k)])
                cycles = max(1, round(longest / times.sum()))
                yield Start((*one, *word[k:], *word[:k]), times, cycles)
