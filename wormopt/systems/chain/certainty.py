"""Exact intervals for randomly drawn plants, and comparisons of controllers on the same plants.

No distribution is assumed. Failed simulations rank below all others.
"""

from __future__ import annotations

import numpy as np
import scipy.stats

LEVEL = 0.95
"""Least probability that an interval contains its quantity."""


def share_interval(count: int, members: int) -> tuple[float, float]:
    """Clopper-Pearson interval of a share, from `count` of `members` observed."""
    low, high = scipy.stats.binomtest(count, members).proportion_ci(LEVEL, method="exact")
    return float(low), float(high)


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Interval of the median between two of the values, by order statistics.

    A bound is NaN if there are too few values, or if its value is unknown.
    """
    known = np.where(np.isnan(values), np.inf, values)
    found = scipy.stats.quantile_test(known, q=0, p=0.5).confidence_interval(LEVEL)
    ends = np.array([found.low, found.high])
    low, high = np.where(np.isinf(ends), np.nan, ends).tolist()
    return low, high


def less(rows: np.ndarray) -> np.ndarray:
    """Number of members on which each row is lower than each other row.

    `rows` has the shape (rivals, members), the result (rivals, rivals).
    """
    known = np.where(np.isnan(rows), np.inf, rows)
    return np.sum(known[:, None, :] < known[None, :, :], axis=2)
