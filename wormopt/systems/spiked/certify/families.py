"""Families of sequences: in each phase at least certain masses rest, whatever else does.

Where loads matter there are thousands of sequences, most of which differ in masses that rest
besides others. What is true of all sequences of a family need not be proven for each.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations, product

from wormopt.systems.spiked.search.sequences import Sequence_, canonical

# Sequences of as many phases, in phases of one order.
Family = tuple[Sequence_, ...]


def families(words: Sequence[Sequence_]) -> dict[Sequence_, Family]:
    """Sort sequences by the smallest sets of masses that rest in their phases.

    Each sequence occurs once, in some rotation, with those that share the same sets.
    """
    size = min((len(resting) for word in words for resting in word), default=0)
    found: dict[Sequence_, list[Sequence_]] = defaultdict(list)
    for word in words:
        common = _common(word, size)
        turned = canonical(common, 0, mirror=False)
        k = next(k for k in range(len(word)) if common[k:] + common[:k] == turned)
        found[turned].append(word[k:] + word[:k])
    return {common: tuple(family) for common, family in found.items()}


def _common(word: Sequence_, size: int) -> Sequence_:
    """Sets of so many masses of each phase's, neighbours different; else the word itself."""
    for choice in product(*(combinations(resting, size) for resting in word)):
        if all(choice[k] != choice[k - 1] for k in range(len(choice))):
            return choice
    return word


def parts(family: Family, phase: int) -> list[Family]:
    """Divide a family by what rests in a phase."""
    found: dict[tuple[int, ...], list[Sequence_]] = defaultdict(list)
    for word in family:
        found[word[phase]].append(word)
    return [tuple(part) for part in found.values()]
