"""Fastest velocities of a chain while some masses rest, and the sets that rest best for weights.

Between two neighbouring masses at rest nothing depends on the rest of the worm, so that choosing
where masses rest is a longest path along the chain.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np


class Chain:
    """Velocities that link rates allow; `rates` (2, n) are of contraction and extension.

    Nodes are the masses, numbered from 1, and an imagined one at rest at either end, whose
    link is too fast to matter; so everything lies between two nodes at rest.
    """

    def __init__(self, rates: np.ndarray) -> None:
        self.masses = rates.shape[1] + 1
        self._rates, self.slowest = rates, rates.min()
        self._fast = rates.sum()  # no mass is faster while one rests
        ends = np.full((2, 1), self._fast)
        self._contraction, self._extension = np.hstack([ends, rates, ends])
        behind = np.concatenate([[0.0], np.cumsum(rates[0])])
        ahead = np.concatenate([[0.0], np.cumsum(rates[1])])
        # A mass behind a resting one is no faster than the links between contract, one ahead no
        # faster than they extend.
        self._reach = np.maximum(behind - behind[:, None], ahead[:, None] - ahead)

    def fastest_of_all(self, resting: tuple[int, ...]) -> np.ndarray:
        """Largest velocity of every mass; all are possible at the same time."""
        return self._reach[list(resting)].min(axis=0)

    def fastest(self, weights: np.ndarray, resting: tuple[int, ...]) -> np.ndarray:
        """Velocities with the largest sum, weighted by `weights` (n + 1,), head first.

        Dynamic programming from the head: the largest sum over a mass and those ahead is a
        concave function of its velocity, from 0 on, kept as segments in order of slope.
        """
        ahead = np.concatenate([[0.0], np.cumsum(weights)]).tolist()
        levels: list[float] = []  # slope = sum of weights so far - level
        lengths: list[float] = []
        best, most = np.zeros(self.masses), np.zeros(self.masses)
        links = zip(self._contraction, self._extension, strict=True)
        for i, (c, e) in zip(range(self.masses), links, strict=False):  # links ahead of masses
            place = bisect_right(levels, ahead[i])
            levels.insert(place, ahead[i])
            lengths.insert(place, float(c + e))
            _shorten(levels, lengths, float(e))
            if i in resting:
                levels.clear()
                lengths.clear()
            best[i] = sum(lengths[: bisect_right(levels, ahead[i + 1])])
            most[i] = sum(lengths)
        velocities = best.copy()
        for i in range(self.masses - 2, -1, -1):  # as near to the best as the mass behind lets it
            least = max(0.0, velocities[i + 1] - self._rates[0, i])
            largest = min(most[i], velocities[i + 1] + self._rates[1, i])
            velocities[i] = min(max(best[i], least), largest)
        return velocities

    def gains(self, weights: np.ndarray) -> np.ndarray:
        """Largest weighted velocity sums between nodes ahead and behind, both at rest, or -inf.

        (n + 3, n + 3). The dual, flows g_j of cost c_j [g]+ + e_j [-g]+, is an isotonic
        regression in u_j = g_j + (weights ahead of link j), solved for all pairs by link.
        """
        ahead = np.concatenate([[0.0], np.cumsum(weights)])
        levels = np.sort(ahead)
        flow = levels - ahead[:, None]
        cost = np.maximum(self._contraction[:, None] * flow, -self._extension[:, None] * flow)
        nodes = self.masses + 2
        lowest, gains = np.zeros((nodes, nodes - 1)), np.full((nodes, nodes), -np.inf)
        for j in range(nodes - 1):
            open_ = lowest[: j + 1]  # one row for every node ahead
            open_[:] = np.minimum.accumulate(open_[:, ::-1], axis=1)[:, ::-1] + cost[j]
            gains[: j + 1, j + 1] = open_.min(axis=1)
        return gains


def _shorten(levels: list[float], lengths: list[float], by: float) -> None:
    """Take a length off the front of segments."""
    while lengths and lengths[0] <= by:
        by -= lengths.pop(0)
        levels.pop(0)
    if lengths:
        lengths[0] -= by


def offer_of(chain: Chain, resting: int, sets: list[tuple[int, ...]] | None) -> Any:
    """Callable that turns `Chain.gains` into the largest sums and their resting sets.

    `sets` are those that may rest; None: the best of all.
    """
    if sets is None:
        return lambda gains: _best_sets(gains, resting)
    last = chain.masses + 1
    nodes = np.full((len(sets), max(map(len, sets)) + 2), last)
    nodes[:, 0] = 0
    for row, z in zip(nodes, sets, strict=True):
        row[1 : len(z) + 1] = np.array(z) + 1

    def offer(gains: np.ndarray) -> tuple[np.ndarray, list[tuple[int, ...]]]:
        gains[last, last] = 0.0
        return gains[nodes[:, :-1], nodes[:, 1:]].sum(axis=1), sets

    return offer


def _best_sets(gains: np.ndarray, resting: int) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Find, for every mass, the best set of so many resting masses that contains it.

    More resting masses are never better. Longest paths from either end: by the number of resting
    masses up to a node, that node included, the largest gain and the node before it.
    """
    nodes = len(gains)
    ahead, before = longest_paths(gains, resting)
    behind, after = longest_paths(gains[::-1, ::-1].T, resting)
    behind, after = behind[:, ::-1], nodes - 1 - after[:, ::-1]
    total = (ahead[1:] + behind[:0:-1])[:, 1:-1]  # place of a mass in its set, mass
    places = total.argmax(axis=0)
    sets = []
    for mass, place in enumerate(places):
        path = [mass + 1]
        for k in range(place + 1, 1, -1):
            path.insert(0, int(before[k, path[0]]))
        for k in range(resting - place, 1, -1):
            path.append(int(after[k, path[-1]]))
        sets.append(tuple(node - 1 for node in path))
    return total.max(axis=0), sets


def longest_paths(gains: np.ndarray, resting: int) -> tuple[np.ndarray, np.ndarray]:
    """Best choice of at most `resting` resting masses up to every node, from `Chain.gains`.

    Returns the largest sums by number at rest and last of them, and the one before; both
    of shape (resting + 1, n + 3).
    """
    value = np.full((resting + 1, len(gains)), -np.inf)
    value[0, 0] = 0.0
    before = np.zeros(value.shape, int)
    for k in range(1, resting + 1):
        through = value[k - 1][:, None] + gains
        before[k], value[k] = through.argmax(axis=0), through.max(axis=0)
        value[k, [0, -1]] = -np.inf  # the imagined nodes do not count
    return value, before
