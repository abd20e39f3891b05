"""Cyclic sequences of resting masses: all of them once, and the neighbours of one.

Sequences are one if rotation in time maps them on each other, or, where the limits are symmetric,
the mirror image.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

__all__ = ["Resting", "Sequence_", "canonical", "is_gait", "mirrored", "neighbours", "sequences"]

Resting = tuple[int, ...]
Sequence_ = tuple[Resting, ...]


def sequences(
    masses: int, letters: Sequence[Resting], phases: int, *, mirror: bool
) -> list[Sequence_]:
    """List the cyclic sequences of resting sets, each class once.

    Parameters
    ----------
    masses : int
        Number of masses.
    letters : sequence of tuple of int
        Resting sets that may occur.
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
    >>> sequences(3, [(0,), (1,), (2,)], 3, mirror=True)
    [((0,), (1,), (2,))]
    """
    found = set()
    for word in product(letters, repeat=phases):
        if word[0] == min(word) and is_gait(word):
            found.add(canonical(word, masses, mirror=mirror))
    return sorted(found)


def is_gait(word: Sequence_) -> bool:
    """Whether neighbouring sets differ and no mass rests for ever.

    Parameters
    ----------
    word : tuple of tuple of int
        Resting masses, phase after phase.
    """
    changes = all(word[i] != word[i - 1] for i in range(len(word)))
    return changes and not set.intersection(*(set(s) for s in word))


def canonical(word: Sequence_, masses: int, *, mirror: bool) -> Sequence_:
    """Pick the one sequence that stands for all its rotations, and mirror images if asked.

    Parameters
    ----------
    word : tuple of tuple of int
        Resting masses, phase after phase.
    masses : int
        Number of masses.
    mirror : bool
        Whether i -> n - i gives the same gait.

    Examples
    --------
    >>> canonical(((2,), (1,), (0,)), 3, mirror=True)
    ((0,), (1,), (2,))
    """
    images = [word]
    if mirror:
        images.append(mirrored(word, masses))
    return min(image[k:] + image[:k] for image in images for k in range(len(word)))


def mirrored(word: Sequence_, masses: int) -> Sequence_:
    """Exchange head and tail.

    Parameters
    ----------
    word : tuple of tuple of int
        Resting masses, phase after phase.
    masses : int
        Number of masses.

    Examples
    --------
    >>> mirrored(((0,), (0, 1)), 3)
    ((2,), (1, 2))
    """
    return tuple(tuple(sorted(masses - 1 - i for i in s)) for s in word)


def neighbours(
    word: Sequence_, letters: Sequence[Resting]
) -> Iterator[tuple[Sequence_, list[int | None]]]:
    """Drop, exchange or insert one resting set.

    Parameters
    ----------
    word : tuple of tuple of int
        Resting masses, phase after phase.
    letters : sequence of tuple of int
        Resting sets that may come in.

    Yields
    ------
    word : tuple of tuple of int
    origin : list of (int or None)
        Which phase of the given word each of its phases is; None for what came in.

    Examples
    --------
    >>> next(neighbours(((0,), (2,)), [(1,)]))
    (((1,), (0,), (2,)), [None, 0, 1])
    """
    every: list[int | None] = list(range(len(word)))
    for k in range(len(word)):
        edits = [
            edit
            for letter in letters
            for edit in (
                ((*word[:k], letter, *word[k:]), [*every[:k], None, *every[k:]]),
                ((*word[:k], letter, *word[k + 1 :]), every),
            )
        ]
        edits.append((word[:k] + word[k + 1 :], every[:k] + every[k + 1 :]))
        yield from (e for e in edits if len(e[0]) >= 2 and is_gait(e[0]))
