"""Noise of readings, estimated from what a fit leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wormopt.fitting.losses import robust
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import leverages

# Readings cannot be told to be better than motions are simulated.
_ERRORS = 100.0
MEDIAN = 0.6745
"""Of the size of normal noise, in standard deviations."""


def noise_of(task: FitTask, theta: np.ndarray, signals: Sequence[str]) -> dict[str, float]:
    """Standard deviations of signals; what the unknowns take from the residuals is counted.

    Of a robust fit by the median, so that outliers do not count.
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
    """Rows of a signal in the runs that do not say its noise."""
    blocks = [b for b in task.blocks if b.signal == signal]
    open_ = [b for b in blocks if signal not in (task.recordings[b.run].noise or {})]
    return np.concatenate([np.arange(b.rows.start, b.rows.stop) for b in open_])


def _least(task: FitTask, signal: str) -> float:
    readings = [run.readings[signal] for run in task.recordings if signal in run.readings]
    largest = max(float(np.nanmax(np.abs(rows))) for rows in readings)
    return _ERRORS * task.precision.relative * largest
