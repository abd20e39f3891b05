"""What plants drawn at random tell for certain: exact intervals, and who does better on the same.

No distribution is assumed. What could not be simulated counts as worse than all others.
"""

from __future__ import annotations

import numpy as np
import scipy.stats

LEVEL = 0.95
"""Least probability that an interval holds what it is of."""


def share_interval(count: int, members: int) -> tuple[float, float]:
    """Interval of a share of which `count` of `members` were seen, by Clopper and Pearson."""
    low, high = scipy.stats.binomtest(count, members).proportion_ci(LEVEL, method="exact")
    return float(low), float(high)


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Interval of a median between two of the values, by order statistics.

    NaN at an end for which there are too few values, or that is a value that is not known.
    """
    known = np.where(np.isnan(values), np.inf, values)
    found = scipy.stats.quantile_test(known, q=0, p=0.5).confidence_interval(LEVEL)
    ends = np.array([found.low, found.high])
    low, high = np.where(np.isinf(ends), np.nan, ends).tolist()
    return low, high


def less(rows: np.ndarray) -> np.ndarray:
    """On how many members (rivals, rivals) each row (rivals, members) is less than each other."""
    known = np.where(np.isnan(rows), np.inf, rows)
    return np.sum(known[:, None, :] < known[None, :, :], axis=2)
