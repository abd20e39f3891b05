"""Rules by which several resting masses share the spike load, which statics leaves open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from wormopt.systems.spiked.limits import Sharing


def share_load(
    total: np.ndarray,
    unloaded: np.ndarray,
    resting: Sequence[int],
    sharing: Sharing,
    most: Sequence[float] | np.ndarray | float | None = None,
) -> np.ndarray:
    """Split the total spike load (m,) over the resting masses: (n+1, m), 0 for moving masses.

    `unloaded` is mu_1..mu_{n+1} (n+1, m) from the head without spike loads. "least_actuation"
    minimises the sum of mu² with loads from 0 to `most`, or with equal overloads if that is
    infeasible; "equal" ignores `most`.
    """
    loads, masses = np.zeros_like(unloaded), list(resting)
    if sharing == "equal" or len(masses) == 1:
        loads[masses] = total / len(masses)
        return loads
    caps = np.broadcast_to(np.inf if most is None else most, len(unloaded))[masses]
    pushed = np.maximum(total, 0.0)
    excess = np.maximum(pushed - caps.sum(), 0.0) / len(masses)
    caps = np.minimum(caps[:, None], pushed) + excess
    # Behind resting mass k and before the next, every actuator force is unloaded + carried[k].
    spans = list(pairwise(masses))
    sums = np.array([unloaded[i:j].sum(axis=0) for i, j in spans])
    counts = [j - i for i, j in spans]
    carried = [pushed]
    wanted = list(_wanted(sums, counts, caps))
    for want, cap in zip(reversed(wanted), caps[:0:-1], strict=True):
        carried.append(np.clip(want, carried[-1] - cap, carried[-1]))
    inner = np.array(carried[:0:-1])
    loads[masses] = np.diff(inner, axis=0, prepend=0.0 * total[None], append=total[None])
    return loads


def _wanted(sums: np.ndarray, counts: Sequence[int], caps: np.ndarray) -> Iterator[np.ndarray]:
    """Loads that the first resting masses together would carry without bounds behind them."""
    # The least sum of squares ahead is a convex function of the load carried so far. Its slope is
    # piecewise linear, given by knots. One more spike, which carries 0 to its cap, splits the slope
    # at its root and moves the part behind by the cap.
    zero = np.zeros(sums.shape[1])
    place = slope = np.zeros((0, len(zero)))
    for total, count, cap in zip(sums, counts, caps[:-1], strict=True):
        place = np.vstack([place + np.where(slope > 0, cap, 0.0), zero, zero + cap])
        slope = np.vstack([slope, np.zeros((2, len(zero)))])
        order = np.lexsort((slope, place), axis=0)
        place, slope = (np.take_along_axis(knots, order, axis=0) for knots in (place, slope))
        slope = slope + count * place + total
        zero = _zero_of(place, slope)
        yield zero


def _zero_of(place: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Root of ascending piecewise linear functions, or the end of their range nearest to it."""
    last = len(place) - 1
    above = np.minimum((slope < 0).sum(axis=0), last)
    below = np.maximum(above - 1, 0)
    x0, x1, y0, y1 = (
        np.take_along_axis(knots, at[None], axis=0).ravel()
        for knots in (place, slope)
        for at in (below, above)
    )
    rise = np.where(y1 > y0, y1 - y0, 1.0)
    return np.clip(x0 - y0 * (x1 - x0) / rise, x0, x1)
