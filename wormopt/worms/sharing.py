"""How resting masses share the spike load: a rule for what statics leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

__all__ = ["Sharing", "share_load"]

Sharing = Literal["equal", "least_actuation"]


def share_load(
    total: np.ndarray, unloaded: np.ndarray, resting: Sequence[int], sharing: Sharing
) -> np.ndarray:
    """Split the total spike load over the resting masses.

    Parameters
    ----------
    total : ndarray, shape (m,)
        Sum of all spike loads at each instant.
    unloaded : ndarray, shape (n+1, m)
        Actuator forces mu_1..mu_{n+1} by the recursion from the head if no spike carried anything.
    resting : sequence of int
        Resting masses, ascending.
    sharing : {"equal", "least_actuation"}
        Same load on each, or the split with loads >= 0 that minimises the sum of squared
        actuator forces. The latter is a bounded isotonic regression of the cumulative load.

    Returns
    -------
    ndarray, shape (n+1, m)
        Load of every mass, 0 for those that move.

    Examples
    --------
    >>> import numpy as np
    >>> share_load(np.array([6.0]), np.zeros((3, 1)), [0, 2], "equal").ravel()
    array([3., 0., 3.])
    """
    loads = np.zeros_like(unloaded)
    if sharing == "equal" or len(resting) == 1:
        loads[list(resting)] = total / len(resting)
        return loads
    # Behind resting mass k and before the next, every actuator force is unloaded + carried[k].
    spans = list(pairwise(resting))
    sums = np.array([unloaded[i:j].sum(axis=0) for i, j in spans])
    counts = np.array([j - i for i, j in spans])
    carried = np.full_like(sums, -np.inf)
    for k in range(len(spans)):
        for first in range(k + 1):
            means = [
                -sums[first : last + 1].sum(axis=0) / counts[first : last + 1].sum()
                for last in range(k, len(spans))
            ]
            carried[k] = np.maximum(carried[k], np.min(means, axis=0))
    carried = np.clip(carried, 0.0, np.maximum(total, 0.0))
    loads[list(resting)] = np.diff(carried, axis=0, prepend=0.0 * total[None], append=total[None])
    return loads
