"""The sequences of resting masses among which the best gait of a task is sought."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np

from wormopt.systems.spiked.ceiling import ceiling
from wormopt.systems.spiked.programs.scaled_limits import scaled
from wormopt.systems.spiked.search.sequences import Resting, Sequence_, sequences
from wormopt.systems.spiked.task import Task


def all_sequences(task: Task, phases: int) -> list[Sequence_]:
    """List sequences of 2 to `phases` phases such that every gait has one of them, short first.

    A pause of all masses is a set of its own only where no fewer spikes can hold the worm.
    Of mirror images there is one only where limits are symmetric.
    """
    letters, limits = letters_of(task), scaled(task)
    if task.loads_matter and not any(map(limits.admits_rest, letters)):
        letters.append(tuple(range(task.worm.links + 1)))
    masses, mirror = task.worm.links + 1, is_mirror_symmetric(task)
    return [s for p in range(2, phases + 1) for s in sequences(masses, letters, p, mirror=mirror)]


def is_mirror_symmetric(task: Task) -> bool:
    """Whether i -> n - i with l_j -> shortest + longest - l_{n+1-j} maps gaits on gaits."""
    n, limits = task.worm.links, task.limits
    contraction, extension = limits.rate_bounds(n)
    per_thing = [
        task.worm.masses,
        contraction,
        np.broadcast_to(limits.acceleration or 0.0, n),
        np.broadcast_to(limits.spike_load or 0.0, n + 1),
        np.broadcast_to(limits.actuator_force or 0.0, n),
        np.ptp(np.array(limits.length_ranges(n)), axis=1),
    ]
    return np.array_equal(contraction, extension) and all(
        np.array_equal(v, np.asarray(v)[::-1]) for v in per_thing
    )


def ceiling_of(task: Task, sequence: Sequence_) -> float:
    """Bound on the speed by rates and the resting sets of a sequence, see `ceiling`."""
    return _ceiling_of_sets(task, frozenset(sequence))


@lru_cache(maxsize=4096)
def _ceiling_of_sets(task: Task, sets: frozenset[Resting]) -> float:
    contraction, extension = task.limits.rate_bounds(task.worm.links)
    return ceiling(contraction, extension, task.limits.resting, sets)


def letters_of(task: Task) -> list[Resting]:
    """Sets of resting masses that may occur."""
    masses = range(task.worm.links + 1)
    return [s for size in task.resting_sizes for s in combinations(masses, size)]
