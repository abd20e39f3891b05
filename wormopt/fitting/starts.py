"""Starts of a fit: the given one, and others spread around it within the bounds."""

from __future__ import annotations

import numpy as np

from wormopt.fitting.coordinates import Coordinate
from wormopt.fitting.task import FitTask

# Without bounds, numbers are searched within this factor around starts; starts of motions, which
# readings determine, within this share of their nominal size.
_FACTOR, _SHARE = 5.0, 0.1
_HARDLY = 1e-9  # distance of a start from its bounds as a share of its range


def starts_of(task: FitTask, count: int, seed: int) -> np.ndarray:
    """The given start, then a Latin hypercube around it, (count, n)."""
    from scipy.stats.qmc import LatinHypercube

    n = len(task.coordinates)
    if count == 1 or n == 0:
        return task.start[None]
    share = LatinHypercube(n, rng=np.random.default_rng(seed)).random(count - 1)
    states = {state.name for state in task.model.x}
    spread = [
        [_spread(c, s, states) for c, s in zip(task.coordinates, row, strict=True)] for row in share
    ]
    return np.vstack([task.start, spread])


def _spread(coordinate: Coordinate, share: float, states: set[str]) -> float:
    lower, upper, start = coordinate.lower, coordinate.upper, coordinate.start
    if states & set(coordinate.directions):
        found = start + (2 * share - 1) * _SHARE * coordinate.nominal
    elif coordinate.log:
        found = start + (2 * share - 1) * np.log(_FACTOR)
    elif start > 0 and lower >= 0:
        found = start * _FACTOR ** (2 * share - 1)
    else:
        found = start + (2 * share - 1) * _FACTOR * coordinate.nominal
    inside = _HARDLY * min(upper - lower, 1.0)
    return float(np.clip(found, lower + inside, upper - inside))
