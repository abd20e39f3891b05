"""Orders of rest: the first ones of a search, and their ceilings."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import combinations, permutations
from math import comb

from wormopt.systems.shared.sequences import (
    Resting,
    Sequence_,
    block_wave_sequence,
    is_gait,
    mirrored,
    sequences,
    wave_orders,
)
from wormopt.systems.spiked.ceiling import best_modes, ceiling
from wormopt.systems.spiked.gait_problem import GaitProblem

# Largest numbers of sets, and of sequences of them, that are all listed.
_MOST_SETS, _MOST_WORDS = 64, 4000
# Number of solutions of the ceiling's linear program from which orders are made.
_MIXES = 3


def is_mirror_symmetric(task: GaitProblem) -> bool:
    """Whether i -> n - i with l_j -> shortest + longest - l_{n-1-j} maps gaits on gaits."""
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    of_each = [*task.of_each, task.worm.beyond if task.loads_matter else (0.0,)]
    return contraction == extension and all(values == values[::-1] for values in of_each)


def letters_of(task: GaitProblem) -> list[Resting]:
    """Sets of masses that may rest together."""
    masses = range(task.worm.links + 1)
    return [s for size in task.resting_sizes for s in combinations(masses, size)]


def first_orders(task: GaitProblem) -> list[Sequence_]:
    """First orders of every search, for any number of links.

    Head and tail in turn, with and without a block between; the ceiling's resting sets in every
    order; travelling waves, also of more resting masses if these share a load.
    """
    n, fewest = task.worm.links, task.limits.resting
    found = [*_ends_in_turn(n, fewest), *_best_sets_in_turn(task)]
    found += [tuple(block_wave_sequence(n, a)) for a in task.resting_sizes]
    waves = wave_orders(n, fewest)
    if not is_mirror_symmetric(task):
        waves += [mirrored(wave, n + 1) for wave in waves]
    return [s for s in dict.fromkeys([*found, *waves]) if is_gait(s)]


def _ends_in_turn(links: int, resting: int) -> Iterator[Sequence_]:
    """Accordions: a block at the head in turn with one at the tail, also with one between."""
    head, tail = tuple(range(resting)), tuple(range(links + 1 - resting, links + 1))
    yield (head, tail)
    spare = links + 1 - resting
    for start in sorted({spare // 2, spare // 3, spare - spare // 3} - {0, spare}):
        yield (head, tuple(range(start, start + resting)), tail)


def _best_sets_in_turn(task: GaitProblem) -> Iterator[Sequence_]:
    """All cyclic orders of the resting sets in the ceiling's solutions, if these are few."""
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    count = _MIXES if task.worm.links <= 12 else 1
    for mix in best_modes(contraction, extension, task.limits.resting, count=count):
        first, *others = (tuple(sorted(s)) for s in mix.sets)
        if len(others) <= 3:
            yield from ((first, *order) for order in permutations(others))


def search_letters(task: GaitProblem) -> list[Resting]:
    """Sets of resting masses from which orders are made.

    All sets if they are few, else those of sizes with few sets, and blocks of neighbours that wrap
    round.
    """
    masses, sizes = task.worm.links + 1, task.resting_sizes
    if task.count_of_sets <= _MOST_SETS:
        return letters_of(task)
    least = [size for size in sizes if comb(masses, size) <= _MOST_SETS]
    found = {s for size in least for s in combinations(range(masses), size)}
    found |= {s for size in sizes for s in block_wave_sequence(task.worm.links, size)}
    return sorted(found, key=lambda s: (len(s), s))


def plain_orders(task: GaitProblem, phases: int | None = None) -> list[Sequence_]:
    """Orders of at most `phases` phases, the highest ceilings first, then the shortest.

    Only short orders have more resting masses than required.
    """
    masses, mirror = task.worm.links + 1, is_mirror_symmetric(task)
    letters = search_letters(task)
    exact = [s for s in letters if len(s) == task.limits.resting]
    found: set[Sequence_] = set()
    for sets, most in ((exact, phases or 4), (letters, min(phases or 3, 3))):
        for count in range(2, most + 1):
            if len(sets) ** count <= _MOST_WORDS * count:
                found |= set(sequences(masses, sets, count, mirror=mirror))
    return sorted(found, key=lambda s: (-_rounded_ceiling(task, s), len(s), s))


def _rounded_ceiling(task: GaitProblem, sequence: Sequence_) -> float:
    """Ceiling of an order to six digits; 0 for long worms, where it takes too long."""
    return float(f"{ceiling_of(task, sequence):.6g}") if task.worm.links <= 8 else 0.0


def ceiling_of(task: GaitProblem, sequence: Sequence_ | None = None) -> float:
    """Bound on the speed by rates and the resting sets of a sequence, or of any, see `ceiling`."""
    return _ceiling_of_sets(task, sequence and frozenset(sequence))


@lru_cache(maxsize=4096)
def _ceiling_of_sets(task: GaitProblem, sets: frozenset[Resting] | None) -> float:
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    return ceiling(contraction, extension, task.limits.resting, sets)
