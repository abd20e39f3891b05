"""Variations of the best orders of rest: a set more, fewer or another; two cycles joined."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, product

import numpy as np

from wormopt.systems.spiked.search.orders import search_letters
from wormopt.systems.spiked.search.race import Race, Start
from wormopt.systems.spiked.search.sequences import (
    Sequence_,
    is_gait,
    lasting,
    mirrored,
    neighbours,
)
from wormopt.systems.spiked.task import Search

# Most joined cycles in a round.
_JOINED = 100
# Masses of change that outweigh being the next better parent.
_RANK = 0.5
# Phases of a cycle up to which orders are varied.
_MOST_PHASES = 12


def variations(race: Race, settings: Search, width: int) -> Iterator[Start]:
    """Neighbours and joined cycles of the best orders, each once.

    Of `width` orders, and twice as many of other lengths and numbers of cycles.
    """
    seen, most = set(race.trials), settings.phases or _MOST_PHASES
    parents = _parents(race, width)
    for start in (*islice(_joined(race, parents), _JOINED), *_edited(race, parents)):
        key = race.canonical(start.sequence)
        if 2 <= len(start.sequence) <= most and is_gait(start.sequence) and key not in seen:
            seen.add(key)
            yield start


_Parent = tuple[Sequence_, np.ndarray, int]  # phases that last, their durations, and cycles


def _parents(race: Race, width: int) -> list[_Parent]:
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


def _edited(race: Race, parents: list[_Parent]) -> Iterator[Start]:
    """One resting set inserted, exchanged, dropped or moved; what changes least first."""
    letters = search_letters(race.task)
    edits = [
        (change + _RANK * rank, word, kept, parent)
        for rank, parent in enumerate(parents)
        for change, word, kept in neighbours(parent[0], letters)
    ]
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
