"""Noise of readings, estimated from residuals of a fit, which may or may not be noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import chdtr, chdtrc, ndtr

from wormopt.fitting.estimate import Fit, check_fit, check_level
from wormopt.fitting.information import leverages
from wormopt.fitting.task import Block, FitTask, robust
from wormopt.lazy import on_use
from wormopt.shown import lines

with on_use():  # slow to import, and many fits test no residuals
    from scipy.stats import jarque_bera, shapiro

# Most lags tested, at most a fifth of the readings (R. Hyndman, 2014), and fewest readings.
_LAGS, _SHARE = 10, 5
_FEWEST = 8  # readings that are tested
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
    """Standard deviations of signals, corrected for the degrees of freedom of the unknowns."""
    # For a robust fit by the median, which ignores outliers.
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
    sizes = [_size_of(task, left[rows]) for rows in task.groups.values()]
    if max(sizes) > _EXPLAINED:
        which = "given noise" if not asked.estimated else "scatter of the readings"
        yield f"residuals are {max(sizes):.2g} times the {which}"
    chances = [p for block in task.blocks for p in _chances(block, left)]
    if min(chances, default=1.0) < _LACKING:
        yield f"residuals are correlated, unlike noise (p = {min(chances):.1g})"


def excess(found: Fit) -> float:
    """Largest size of the residuals of a signal, over the noise given for it; 0 if none is."""
    task, left = found.task, found.plain[0]
    given = [rows for signal, rows in task.groups.items() if signal not in found.estimated]
    return max((_size_of(task, left[rows]) for rows in given), default=0.0)


def _size_of(task: FitTask, left: np.ndarray) -> float:
    """Standard deviation of residuals; by the median where the loss expects outliers."""
    if task.loss == "linear":
        return float(np.sqrt(np.mean(left**2)))
    return float(np.median(np.abs(left))) / MEDIAN


def _chances(block: Block, left: np.ndarray) -> Iterator[float]:
    rows = np.full(block.there.shape, np.nan)
    rows[block.there] = left[block.rows]
    for row in rows:
        there = row[np.isfinite(row)]
        if len(there) >= _FEWEST and np.ptp(there) > 0 and np.mean(there**2) > _LOST:
            yield ljung_box(row)[1]


def ljung_box(row: np.ndarray, lags: int | None = None) -> tuple[float, float]:
    """Statistic of correlations up to some lag, and p; NaN in `row` (m,) are gaps."""
    there = np.isfinite(row)
    n = int(there.sum())
    r = np.where(there, row - row[there].mean(), 0.0)
    lags = lags or min(_LAGS, n // _SHARE)
    pairs = np.array([np.sum(there[k:] & there[:-k]) for k in range(1, lags + 1)])
    products = np.array([r[k:] @ r[:-k] for k in range(1, lags + 1)])[pairs > 0]
    squares = (products / (r @ r)) ** 2 / pairs[pairs > 0]
    statistic = float(n * (n + 2) * squares.sum())
    return statistic, float(chdtrc(len(squares), statistic))


TestName = Literal["correlation", "runs", "normal", "size"]
_SHAPIRO = 5000  # most readings for which its p-values are valid
_SAYS = {
    "correlation": "the residuals of {0} are correlated in time: the model lacks an effect that "
    "is slower than the sampling",
    "runs": "the residuals of {0} change their sign too rarely or too often",
    "normal": "the residuals of {0} are not normal: there are outliers, or the sensor is coarse",
    "size": "the residuals of {0} are {1} than the given noise",
}


@dataclass(frozen=True)
class ResidualTest:
    """One test of one row of residuals."""

    test: TestName  # Ljung and Box; signs in a row; Shapiro and Wilk, of many Jarque and Bera; chi²
    run: str  # in which it was tested
    signal: str  # what was tested; of several entries as "position[0]"
    statistic: float  # of the test: for "size" the mean square over what it should be
    # probability of a deviation at least as large for white normal noise of the given size
    p: float


@dataclass(frozen=True)
class Whiteness:
    """Tests of the residuals of a fit."""

    tests: tuple[ResidualTest, ...]  # all of them
    level: float  # chance that noise of the given size fails any of them

    def __repr__(self) -> str:
        summary = f"Whiteness: {len(self.suspects)} of {len(self.tests)} tests failed"
        return lines(summary, *self.words)

    @property
    def suspects(self) -> tuple[ResidualTest, ...]:
        """Failed tests, unlikely for noise: p below the level over the number of tests."""
        return tuple(each for each in self.tests if each.p * len(self.tests) < self.level)

    @property
    def words(self) -> tuple[str, ...]:
        """Statements about failed tests."""
        return tuple(
            _SAYS[each.test].format(
                f"{each.signal} in {each.run}", "larger" if each.statistic > 1 else "smaller"
            )
            + f" (p = {each.p:.1g})"
            for each in self.suspects
        )


def whiteness(found: Fit, *, level: float = 0.05) -> Whiteness:
    """Test whether the residuals of a fit are white normal noise of the stated size.

    Parameters
    ----------
    found : Fit
        The fit. Residuals are taken without the loss.
    level : float, optional
        Probability of a false alarm over all tests (Bonferroni).

    Returns
    -------
    Whiteness
        Rows with fewer than eight readings are left out, and the size where the noise was
        estimated. Gaps are no readings; lags count samples.

    Raises
    ------
    ArgumentError
        If `found` is not a Fit, or the level is not between 0 and 1.

    Notes
    -----
    Correlations over gaps as D. Stoffer and C. Toloi, Statistics & Probability Letters 13 (1992)
    391; without gaps they are those of Ljung and Box, Biometrika 65 (1978) 297. Sizes have the
    degrees of freedom that the fit left to them.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x,
    ...                  p=[wo.Signal("rate", rate, value=1.0)])
    >>> t = np.linspace(0.0, 3.0, 40)
    >>> swings = np.exp(-t) + 0.1 * np.sin(2 * t)  # what the model cannot do
    >>> run = wo.Recording(t, {"x": swings}, noise={"x": 0.05})
    >>> found = wo.fit(wo.FitTask(decay, [run], [wo.Unknown("rate")]), seeds=1)
    >>> "correlation" in {each.test for each in whiteness(found).suspects}
    True
    """
    check_fit(found)
    check_level(level)
    task = found.task
    r, jacobian = found.plain
    free = 1 - leverages(jacobian)
    tests: list[ResidualTest] = []
    for block in task.blocks:
        run, known = task.runs[block.run], found.task.recordings[block.run].noise or {}
        judged = block.signal in known or block.signal not in found.estimated
        rows, shares = np.full((2, *block.there.shape), np.nan)
        rows[block.there], shares[block.there] = r[block.rows], free[block.rows]
        for k, row in enumerate(rows):
            name = block.signal if len(rows) == 1 else f"{block.signal}[{k}]"
            tests += _tests(run.name, name, row, shares[k] if judged else None)
    return Whiteness(tuple(tests), level)


def _tests(
    run: str, signal: str, row: np.ndarray, free: np.ndarray | None
) -> Iterator[ResidualTest]:
    there = row[np.isfinite(row)]
    if len(there) < _FEWEST or not np.ptp(there):
        return
    yield ResidualTest("correlation", run, signal, *ljung_box(row))
    yield ResidualTest("runs", run, signal, *runs_test(there))
    yield ResidualTest("normal", run, signal, *_normal(there))
    if free is not None:
        yield ResidualTest("size", run, signal, *_size(there, float(np.nansum(free))))


def runs_test(r: np.ndarray) -> tuple[float, float]:
    """Number of runs above and below the median, in standard deviations, and p."""
    # A. Wald and J. Wolfowitz, Annals of Mathematical Statistics 11 (1940) 147.
    signs = np.sign(r - np.median(r))
    above = signs[signs != 0] > 0
    n, high = len(above), int(above.sum())
    low = n - high
    if min(high, low) < 2:  # all values but one are equal
        return 0.0, 1.0
    runs = 1 + int(np.sum(above[1:] != above[:-1]))
    mean = 1 + 2 * high * low / n
    variance = (mean - 1) * (mean - 2) / (n - 1)
    statistic = (runs - mean) / np.sqrt(variance)
    return float(statistic), float(2 * ndtr(-abs(statistic)))


def _normal(r: np.ndarray) -> tuple[float, float]:
    found: Any = shapiro(r) if len(r) <= _SHAPIRO else jarque_bera(r)
    return float(found.statistic), float(found.pvalue)


def _size(r: np.ndarray, freedom: float) -> tuple[float, float]:
    squares = float(r @ r)
    if freedom <= 0:
        return 1.0, 1.0
    least = min(chdtr(freedom, squares), chdtrc(freedom, squares))
    return squares / freedom, float(min(1.0, 2 * least))
