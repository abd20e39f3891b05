"""Cyclic sequences of resting masses: enumeration, travelling waves, neighbours of a sequence.

Two sequences are equivalent if a rotation in time maps one to the other, or, with symmetric limits,
the mirror image.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

# Phases of a smaller share of the cycle have no duration.
_NOTHING = 1e-9
SHORTEST = 1e-14
"""Arcs with a smaller share of the cycle are left out."""

Resting = tuple[int, ...]
Sequence_ = tuple[Resting, ...]


def sequences(
    masses: int, sets: Sequence[Resting], phases: int, *, mirror: bool
) -> list[Sequence_]:
    """List the cyclic sequences of `phases` resting sets (`sets`), each class once.

    Neighbouring sets differ, and no mass rests forever; `mirror`: i -> n - i is the same.
    """
    found = set()
    for sequence in product(sets, repeat=phases):
        if sequence[0] == min(sequence) and is_gait(sequence):
            found.add(canonical(sequence, masses, mirror=mirror))
    return sorted(found)


def is_gait(sequence: Sequence_) -> bool:
    """Whether neighbouring sets differ and no mass rests forever."""
    changes = all(sequence[i] != sequence[i - 1] for i in range(len(sequence)))
    return changes and not set.intersection(*(set(s) for s in sequence))


def canonical(sequence: Sequence_, masses: int, *, mirror: bool) -> Sequence_:
    """Representative of all rotations of a sequence, and of its mirror images if asked.

    `mirror`: whether i -> n - i gives the same gait.
    """
    images = [sequence]
    if mirror:
        images.append(mirrored(sequence, masses))
    return min(image[k:] + image[:k] for image in images for k in range(len(sequence)))


def ascending(sequence: Sequence[Sequence[int]]) -> Sequence_:
    """Sort the resting masses of each phase in ascending order."""
    return tuple(tuple(sorted(resting)) for resting in sequence)


def mirrored(sequence: Sequence_, masses: int) -> Sequence_:
    """Exchange head and tail."""
    return ascending([[masses - 1 - i for i in resting] for resting in sequence])


def block_wave_sequence(links: int, resting: int) -> list[tuple[int, ...]]:
    """Resting masses of the block-rest wave: a block of neighbours moves from tail to head.

    n+1 phases of ascending indices for n links; a block of `resting` ≤ n masses wraps round.
    """
    masses = links + 1
    tails = range(links, -1, -1)
    return [tuple(sorted((tail - b) % masses for b in range(resting))) for tail in tails]


def wave_orders(links: int, resting: int) -> list[Sequence_]:
    """Sequences in which equidistant blocks of resting masses move from tail to head.

    One for each number of phases q, with the shortest blocks that keep `resting` masses at rest.
    """
    masses, found = links + 1, []
    for phases in range(2, masses + 1):
        for block in range(1, phases):
            sets = [
                tuple(i for i in range(masses) if (i + p) % phases < block) for p in range(phases)
            ]
            if min(map(len, sets)) >= resting:
                found.append(tuple(sets))
                break
    return found


def wave_direction(sequence: Sequence_, masses: int) -> int:
    """Direction in which masses rest one after another, each a phase after its neighbour.

    1 from tail to head, -1 from head to tail, 0 if it is no wave.
    """
    phases = len(sequence)
    for direction in (1, -1):
        classes = {direction * i % phases for i in sequence[0]}
        if phases <= masses and all(
            set(resting) == {i for i in range(masses) if (direction * i + p) % phases in classes}
            for p, resting in enumerate(sequence)
        ):
            return direction
    return 0


def travel(sequence: Sequence_, masses: int) -> int:
    """Direction in which rest travels in any sequence, as `wave_direction`; 0 if balanced.

    The sign of how often a mass, across the ends too, rests a phase after its neighbour.
    """
    steps = sum(
        ((i - 1) % masses in after) - ((i + 1) % masses in after)
        for now, after in zip(sequence, (*sequence[1:], sequence[0]), strict=True)
        for i in now
    )
    return (steps > 0) - (steps < 0)


def minimal(sequence: Sequence_) -> frozenset[Resting]:
    """Resting sets that contain no other set."""
    return frozenset(s for s in sequence if not any({*s} > {*other} for other in sequence))


def neighbours(
    sequence: Sequence_, sets: Sequence[Resting], reach: float = np.inf
) -> Iterator[tuple[int, Sequence_, list[int | None]]]:
    """Drop, replace or insert one resting set, also within a phase, or exchange two neighbours.

    Yields the smallest number of masses by which the new set differs from its neighbours, the new
    sequence, and for each of its phases the index in the given sequence, None for a new phase.
    `reach` is the largest distance of a new resting mass from those at rest.
    """
    every: list[int | None] = list(range(len(sequence)))
    for k, here in enumerate(sequence):
        for new in sets:
            last = sequence[k - 1]
            from_here, from_last = (len({*new} ^ {*s}) for s in (here, last))
            if _distance(new, here) <= reach:
                yield from_here, (*sequence[:k], new, *sequence[k + 1 :]), every
                amid = [*every[: k + 1], None, *every[k:]]
                yield from_here, (*sequence[: k + 1], new, *sequence[k:]), amid
            if min(_distance(new, here), _distance(new, last)) <= reach:
                least = min(from_here, from_last)
                yield least, (*sequence[:k], new, *sequence[k:]), [*every[:k], None, *every[k:]]
        yield 1, sequence[:k] + sequence[k + 1 :], every[:k] + every[k + 1 :]
        turn = [*range(len(sequence))]
        turn[k - 1], turn[k] = k, (k - 1) % len(sequence)
        yield 1, tuple(sequence[i] for i in turn), list(turn)


def _distance(resting: Resting, other: Resting) -> int:
    """Largest distance of a resting mass from the nearest other one."""
    return max(min(abs(i - j) for j in other) for i in resting)


def neighbours_at_both_ends(
    sequence: Sequence_, sets: Sequence[Resting], reach: float, masses: int
) -> Iterator[tuple[int, Sequence_, list[int | None]]]:
    """Changes as in `neighbours`, each with its mirror image half a cycle later.

    Empty for a sequence whose second half is not the mirror image of the first.
    """
    half = len(sequence) // 2
    if sequence[half:] != mirrored(sequence[:half], masses):
        return
    for change, edited, kept in neighbours(sequence, sets, reach):
        first, second = kept[:-half], kept[-half:]
        early = all(k is None or k < half for k in first) and second == [*range(half, 2 * half)]
        if early and edited[-half:] == sequence[half:]:
            later = [None if k is None else k + half for k in first]
            yield change, edited[:-half] + mirrored(edited[:-half], masses), first + later


def lasting_phases(
    sequence: Sequence_, durations: Sequence[float], share: float = _NOTHING
) -> list[list[int]]:
    """Group the phases that have a duration; each group is one phase, given by its indices.

    Phases of at most `share` of the cycle are dropped. Equal phases on either side of a dropped
    one, also across the end of the period, are merged.
    """
    found: list[list[int]] = []
    for k, duration in enumerate(durations):
        if duration <= share * sum(durations):
            continue
        if found and sequence[found[-1][0]] == sequence[k]:
            found[-1].append(k)
        else:
            found.append([k])
    if len(found) > 1 and sequence[found[0][0]] == sequence[found[-1][0]]:
        found[0] = found.pop() + found[0]
    return found


def lasting(sequence: Sequence_, durations: Sequence[float]) -> tuple[Sequence_, tuple[float, ...]]:
    """Phases with a duration, and their durations, see `lasting_phases`; some may be 0."""
    phases = lasting_phases(sequence, durations)
    sets = tuple(sequence[phase[0]] for phase in phases)
    return sets, tuple(sum(durations[k] for k in phase) for phase in phases)


def lasting_arcs(
    sequence: Sequence_, arcs: Sequence[int] | np.ndarray, widths: np.ndarray
) -> tuple[Sequence_, tuple[float, ...], list[int]]:
    """Phases with a duration, their durations, and their numbers of arcs with a duration.

    `arcs` of each phase of the sequence; `widths` are their durations.
    """
    begins = np.cumsum([0, *arcs[:-1]])
    durations = np.add.reduceat(widths, begins)
    counts = np.add.reduceat((widths > SHORTEST * widths.sum()).astype(int), begins)
    phases = lasting_phases(sequence, durations.tolist())
    return (
        tuple(sequence[phase[0]] for phase in phases),
        tuple(float(durations[phase].sum()) for phase in phases),
        [int(counts[phase].sum()) for phase in phases],
    )


def repetition(sequence: Sequence_) -> int:
    """Number of phases after which a cycle repeats its resting masses; all if it does not."""
    count = len(sequence)
    parts = (k for k in range(2, count) if count % k == 0)
    return next((k for k in parts if sequence[k:] + sequence[:k] == sequence), count)
