"""Noise of readings, estimated from residuals of a fit, and tests whether residuals are noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from wormopt.fitting.losses import robust
from wormopt.fitting.task import Block, FitTask
from wormopt.fitting.uncertainty import leverages

# Most lags tested, at most a fifth of the readings (R. Hyndman, 2014), and fewest readings.
_LAGS, _SHARE, _FEWEST = 10, 5, 8
# Ratio of mean residuals to the given noise that is no chance; probability of a correlation of
# white noise that is too small.
_EXPLAINED, _LACKING = 1.5, 1e-6
# Mean squares below this share of the noise are ignored, whatever their correlation.
_LOST = 1e-2
# Estimated noise is at least the simulation error.
_ERRORS = 100.0
MEDIAN = 0.6745
"""Factor from the median size of normal noise to its standard deviation."""


def noise_of(task: FitTask, theta: np.ndarray, signals: Sequence[str]) -> dict[str, float]:
    """Standard deviations of signals, corrected for the degrees of freedom of the unknowns.

    For a robust fit by the median, which ignores outliers.
    """
    r, jacobian = task.plain(theta)
    _, steep = robust(r[: task.count], task.loss)
    weights = np.append(steep, np.ones(len(r) - task.count))
    leverage = leverages(weights[:, None] * jacobian)
    found = {}
    for signal in signals:
        rows = rows_estimated(task, signal)
        free = max(1.0 - float(leverage[rows].sum()) / len(rows), 1.0 / len(rows))
        if task.loss == "linear":
            size = float(np.sqrt(np.mean(r[rows] ** 2) / free))
        else:
            size = float(np.median(np.abs(r[rows])) / MEDIAN / np.sqrt(free))
        found[signal] = max(size * task.level(signal), _least(task, signal))
    return found


def rows_estimated(task: FitTask, signal: str) -> np.ndarray:
    """Rows of a signal in the runs with unknown noise."""
    blocks = [b for b in task.blocks if b.signal == signal]
    open_ = [b for b in blocks if signal not in (task.recordings[b.run].noise or {})]
    return np.concatenate([np.arange(b.rows.start, b.rows.stop) for b in open_])


def _least(task: FitTask, signal: str) -> float:
    readings = [run.readings[signal] for run in task.recordings if signal in run.readings]
    largest = max(float(np.nanmax(np.abs(rows))) for rows in readings)
    return _ERRORS * task.precision.relative * largest


def unexplained(asked: FitTask, task: FitTask, plain: np.ndarray) -> Iterator[str]:
    """Yield reasons why residuals `plain` (rows,) are no noise: their size or correlation.

    Unknown noise is compared with the scatter of successive readings, which `asked` contains.
    """
    left = plain[: task.count] * task.deviations / asked.deviations
    if task.loss == "linear":
        sizes = [float(np.sqrt(np.mean(left[rows] ** 2))) for rows in task.groups.values()]
    else:
        sizes = [float(np.median(np.abs(left[rows]))) / MEDIAN for rows in task.groups.values()]
    if max(sizes) > _EXPLAINED:
        which = "noise said" if not asked.estimated else "scatter of the readings"
        yield f"residuals are {max(sizes):.2g} times the {which}"
    chances = [p for block in task.blocks for p in _chances(block, left)]
    if min(chances, default=1.0) < _LACKING:
        yield f"residuals are correlated, unlike noise (p = {min(chances):.1g})"


def _chances(block: Block, left: np.ndarray) -> Iterator[float]:
    rows = np.full(block.there.shape, np.nan)
    rows[block.there] = left[block.rows]
    for row in rows:
        there = row[np.isfinite(row)]
        if len(there) >= _FEWEST and np.ptp(there) > 0 and np.mean(there**2) > _LOST:
            yield ljung_box(row)[1]


def ljung_box(row: np.ndarray, lags: int | None = None) -> tuple[float, float]:
    """Statistic of correlations up to some lag, and p; NaN in `row` (m,) are gaps."""
    from scipy.special import chdtrc

    there = np.isfinite(row)
    n = int(there.sum())
    r = np.where(there, row - row[there].mean(), 0.0)
    lags = lags or min(_LAGS, n // _SHARE)
    pairs = np.array([np.sum(there[k:] & there[:-k]) for k in range(1, lags + 1)])
    products = np.array([r[k:] @ r[:-k] for k in range(1, lags + 1)])[pairs > 0]
    squares = (products / (r @ r)) ** 2 / pairs[pairs > 0]
    statistic = float(n * (n + 2) * squares.sum())
    return statistic, float(chdtrc(len(squares), statistic))
