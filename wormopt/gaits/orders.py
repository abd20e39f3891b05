"""Orders of rest to begin a search with, and the resting sets that they are made of."""

from __future__ import annotations

from itertools import combinations
from math import comb

from wormopt.core.task import Task
from wormopt.gaits.construct import block_wave_sequence
from wormopt.gaits.sequences import Resting, Sequence_, sequences
from wormopt.gaits.space import ceiling_of, is_mirror_symmetric, sizes_of

__all__ = ["first_orders", "letters_of", "plain_orders"]

# Sets are all listed up to so many, words of them up to so many.
_MOST_SETS, _MOST_WORDS = 64, 4000


def first_orders(task: Task) -> list[Sequence_]:
    """Orders of constructed gaits, which no search should fall behind.

    Block-rest waves, of more resting masses too where those share a load, and for one resting
    mass accordions: head and tail in turn, without and with a mass between.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.

    Examples
    --------
    >>> from wormopt.core.task import Limits, Worm
    >>> limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> first_orders(Task(Worm(links=1), limits))
    [((0,), (1,)), ((1,), (0,))]
    """
    n = task.worm.links
    found = [tuple(block_wave_sequence(n, a)) for a in sizes_of(task)] if n <= 12 else []
    if task.limits.resting == 1:
        between = sorted({n // 2, n // 3, n - n // 3} - {0, n})
        found = [((0,), (n,)), *(((0,), (i,), (n,)) for i in between), *found]
    return found


def letters_of(task: Task) -> list[Resting]:
    """Sets of resting masses that orders are made of.

    All sets, where they are few; else blocks of neighbours round the ends.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    """
    masses, sizes = task.worm.links + 1, sizes_of(task)
    if sum(comb(masses, size) for size in sizes) <= _MOST_SETS:
        return [s for size in sizes for s in combinations(range(masses), size)]
    least = [size for size in sizes if comb(masses, size) <= _MOST_SETS]
    found = {s for size in least for s in combinations(range(masses), size)}
    found |= {s for size in sizes for s in block_wave_sequence(task.worm.links, size)}
    return sorted(found, key=lambda s: (len(s), s))


def plain_orders(task: Task, phases: int | None = None) -> list[Sequence_]:
    """Orders of few phases, the highest ceilings first, then the shortest.

    Of exactly as many resting masses as asked for, and of more in short orders only.

    Parameters
    ----------
    task : Task
        Worm, limits, objective.
    phases : int, optional
        Most phases of a cycle.
    """
    masses, mirror = task.worm.links + 1, is_mirror_symmetric(task)
    letters = letters_of(task)
    exact = [s for s in letters if len(s) == task.limits.resting]
    found: set[Sequence_] = set()
    for sets, most in ((exact, phases or 4), (letters, min(phases or 3, 3))):
        for count in range(2, most + 1):
            if len(sets) ** count <= _MOST_WORDS * count:
                found |= set(sequences(masses, sets, count, mirror=mirror))
    return sorted(found, key=lambda s: (-_rounded(ceiling_of(task, s)), len(s), s))


def _rounded(value: float) -> float:
    """Ceilings are equal if they are to six digits."""
    return float(f"{value:.6g}")
