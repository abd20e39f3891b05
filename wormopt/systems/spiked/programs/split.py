"""The split of the load among resting masses in a gait program: that of least actuation.

The program has columns for the load that the first resting masses carry together, times the
duration of an arc. These columns alone allow every split. The split of least actuation is piecewise
linear in the forces: a pattern gives the spikes that are unloaded or full, and for a given pattern
the conditions for the least sum of squares are linear. Let P_b be the sum of the actuator forces
from the first resting mass to the b-th. P_b is equal for all spikes that are neither unloaded nor
full, not larger for unloaded spikes, and not smaller for full ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wormopt.systems.shared.sequences import Resting
from wormopt.systems.spiked.gait_problem import GaitProblem
from wormopt.systems.spiked.sharing import share_load

# For each resting mass, ascending: -1 where its spike is unloaded, 1 where it is full, else 0.
Pattern = tuple[int, ...]


def split_matters(task: GaitProblem, resting: Resting) -> bool:
    """Whether limits or cost depend on a split of the load that statics leaves open."""
    peaks = ("peak_spike_load", "peak_actuator_force")
    limited = task.limits.actuator_force is not None or task.objective.minimise in peaks
    return limited and len(resting) > 1 and task.limits.sharing == "least_actuation"


def lines_of(count: int, resting: Resting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Actuator forces, loads of the resting masses, and P_b of each, as rows of coefficients.

    The first `count` coefficients multiply the force on each mass (m a + k v + load). The others
    multiply the load carried by the first resting mass, the first two, and so on.
    """
    rest, links = len(resting), count - 1
    carried = np.zeros((rest + 1, count + rest - 1))
    carried[1:rest, count:] = np.eye(rest - 1)
    carried[rest, :count] = 1.0
    held = [sum(i < j for i in resting) for j in range(1, count)]
    forces = carried[held]
    forces[:, :count] -= np.tril(np.ones((links, count)))
    sums = np.vstack([np.zeros(forces.shape[1]), np.cumsum(forces, axis=0)])
    return forces, np.diff(carried, axis=0), sums[list(resting)]


def simple_patterns(resting: Resting) -> list[Pattern]:
    """All resting spikes loaded at all times; or only the first; or only the last."""
    patterns = np.full((3, len(resting)), -1)
    patterns[0] = patterns[1, 0] = patterns[2, -1] = 0
    return [tuple(pattern) for pattern in patterns.tolist()]


def least_patterns(
    needed: np.ndarray,
    resting: Resting,
    full: np.ndarray,
    tie: float,
    olds: Sequence[Pattern] | None,
) -> list[Pattern]:
    """Patterns of the least split for the forces `needed` (arcs, n + 1) on the masses.

    With `olds`, masses for which two patterns hold get the other one. `full`: largest load of each
    spike.
    """
    bare, total, held = -np.cumsum(needed, axis=1).T, needed.sum(axis=1), list(resting)
    loads = share_load(total, bare, resting, "least_actuation", full)
    sums = np.cumsum(bare + np.cumsum(loads, axis=0), axis=0)  # P_b behind each mass
    sums = np.vstack([np.zeros(len(total)), sums[:-1]])[held].T
    loads, full = loads[held].T, full[held]
    if olds is None:
        return [_pattern(load, full, p, tie) for load, p in zip(loads, sums, strict=True)]
    arcs = zip(olds, loads, sums, strict=True)
    return [_flipped(old, load, full, p, tie) for old, load, p in arcs]


def _pattern(load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float) -> Pattern:
    signs = np.where(load <= tie, -1, np.where(load >= full - tie, 1, 0))
    if not np.any(signs == 0):
        # The full spikes carry exactly the total: the next to change counts as in between.
        is_full = signs == 1
        key = np.where(is_full, sums, np.inf) if is_full.any() else -sums
        signs[int(np.argmin(key))] = 0
    return tuple(signs.tolist())


def _flipped(
    old: Pattern, load: np.ndarray, full: np.ndarray, sums: np.ndarray, tie: float
) -> Pattern:
    """The pattern in which every mass with two valid patterns has the other one."""
    first = old.index(0)
    new = list(old)
    for b, sign in enumerate(old):
        if b == first or abs(sums[b] - sums[first]) > tie:
            continue
        if sign != 0:
            new[b] = 0
        elif load[b] <= tie:
            new[b] = -1
        elif load[b] >= full[b] - tie:
            new[b] = 1
    if 0 in new[first + 1 :]:
        new[first] = -1 if load[first] <= tie else int(load[first] >= full[first] - tie)
    return tuple(new)
