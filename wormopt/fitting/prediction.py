"""Validation: a run left out is predicted from the others, with its uncertainty, and tested."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, fdtrc, ndtri

from wormopt.errors import ArgumentError
from wormopt.fitting.estimate import Fit, check_fit, check_level
from wormopt.fitting.information import DETERMINED, spectrum
from wormopt.fitting.noise import rows_estimated
from wormopt.fitting.profile import refit
from wormopt.fitting.recording import Recording
from wormopt.fitting.task import FitTask
from wormopt.shown import SHORT, lines, text

_DOUBTED = 0.01  # p below which a prediction is doubted
_SETTLED = 1e-4  # share of the squares that a fit of the run's own unknowns may leave


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction of a run that the fit did not use."""

    recording: Recording  # the run
    # (size, m) signals predicted, at the times of the readings, gaps included
    values: Mapping[str, np.ndarray]
    # (size, m) standard deviation of these by the errors of the estimates; infinite where
    # unidentifiable parameters affect them
    model_error: Mapping[str, np.ndarray]
    # (size, m) standard deviation of readings around `values`: of model and noise together
    error: Mapping[str, np.ndarray]
    level: float  # share of readings that shall lie in the band
    coverage: float  # share of readings that do
    # squares of the differences over what they should be, with what they have in common
    chi2: float
    freedom: int  # expectation of `chi2`: readings less the number of values fitted to them
    p: float  # probability of a deviation at least as large under a true model

    def __repr__(self) -> str:
        summary = (
            f"Prediction of {self.recording.name}: {100 * self.coverage:.1f} % of the readings in "
            f"the band of {100 * self.level:g} %, chi² {text(self.chi2, SHORT)} of {self.freedom}"
        )
        return lines(summary, *self.words)

    def band(self, signal: str) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the band that shall hold the readings of a signal.

        Parameters
        ----------
        signal : str
            Its name.

        Returns
        -------
        lower, upper : ndarray, shape (size, m)
        """
        half = ndtri(0.5 + self.level / 2) * self.error[signal]
        return self.values[signal] - half, self.values[signal] + half

    @property
    def words(self) -> tuple[str, ...]:
        """Statements about anomalies."""
        name = self.recording.name
        unknown = [s for s, sd in self.model_error.items() if np.isinf(sd).any()]
        statements = [f"{signal} in {name} depends on unidentified unknowns" for signal in unknown]
        if self.p < _DOUBTED:
            statements.append(
                f"{name} differs from the prediction (p = {self.p:.1g}): the model or the given "
                "noise does not describe this recording"
            )
        return tuple(statements)


def predict(found: Fit, recording: Recording, *, level: float = 0.95) -> Prediction:
    """Predict a run that the fit did not use, and compare it with its recording.

    Parameters
    ----------
    found : Fit
        Fit to other runs.
    recording : Recording
        The run. Unknowns with ``per_run`` are fitted to it; all others keep their estimates.
    level : float, optional
        Share of the readings that the band should contain.

    Returns
    -------
    Prediction
        Prediction with first-order bands, from the covariance of the fit and the noise.

    Raises
    ------
    ArgumentError
        If the level is not between 0 and 1, the run does not fit the model, or it has too few
        readings.
    SolveError
        If the motion cannot be simulated.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x,
    ...                  p=[wo.Signal("rate", rate, value=1.0)])
    >>> first = wo.Recording([0.0, 0.5], {"x": [1.0, 0.6]}, noise={"x": 0.02})
    >>> found = wo.fit(wo.FitTask(decay, [first], [wo.Unknown("rate")]), seeds=1)
    >>> kept = wo.Recording([0.0, 1.0], {"x": [1.01, 0.37]}, noise={"x": 0.02}, name="kept")
    >>> ahead = predict(found, kept)
    >>> ahead.values["x"].round(3), ahead.model_error["x"].round(3)  # 0.6², 2 * 0.6 * 0.02
    (array([[1.  , 0.36]]), array([[0.   , 0.024]]))
    """
    check_fit(found)
    check_level(level)
    if not isinstance(recording, Recording):
        raise ArgumentError(f"recording must be a Recording, not {type(recording).__name__}")
    noise = {signal: sd for signal, sd in found.noise.items() if signal in recording.values}
    task = replace(found.task, recordings=[recording], noise=noise)
    own = np.array([c.run is not None for c in task.coordinates])
    theta = _with_own(found, task, own)
    r, jacobian = _rows(task, own, theta)
    spread, open_ = _spread(found, task, own, jacobian)
    unbounded = jacobian @ open_
    moves = np.linalg.norm(unbounded, axis=0) > DETERMINED * np.linalg.norm(jacobian * task.nominal)
    taken = _basis(np.hstack([jacobian[:, own], unbounded[:, moves]]))
    chi2, sd = _judged(r, jacobian @ spread, taken)
    freedom = len(r) - taken.shape[1]
    if freedom < 1:
        raise ArgumentError(f"{recording.name}: too few readings for its own unknowns")
    within = np.abs(r) <= ndtri(0.5 + level / 2) * sd
    values, model = _bands(task, theta, spread, open_[:, moves])
    return Prediction(
        recording,
        values,
        model,
        {signal: np.hypot(model[signal], task.deviation(0, signal)) for signal in values},
        level,
        float(np.mean(within[: task.count])),
        chi2,
        freedom,
        _p(found, chi2, freedom),
    )


def _with_own(found: Fit, task: FitTask, own: np.ndarray) -> np.ndarray:
    """Coordinates of the run: estimates, and its own unknowns fitted to it."""
    known = dict(zip(found.names, found.theta, strict=True))
    theta = task.start
    theta[~own] = [known[name] for name, is_own in zip(task.names, own, strict=True) if not is_own]
    if not own.any():
        return theta

    return refit(task, theta, own, None, _SETTLED).theta


def _rows(task: FitTask, own: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Plain residuals of readings and of the priors of the run's own unknowns, with slopes."""
    r, jacobian = task.plain(theta)
    priors = [
        is_own for c, is_own in zip(task.coordinates, own, strict=True) if c.prior is not None
    ]
    kept = np.append(np.ones(task.count, bool), np.array(priors, bool))
    return r[kept], jacobian[kept]


def _spread(
    found: Fit, task: FitTask, own: np.ndarray, jacobian: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Factor (n, k) of the covariance of all coordinates, and unidentifiable directions (n, l)."""
    s, v = found.singular
    identified = s > found.error
    rows = [found.names.index(n) for n, is_own in zip(task.names, own, strict=True) if not is_own]
    directions = (found.sizes[:, None] * v)[rows]
    spread = np.zeros((len(own), len(s)))
    spread[~own] = directions
    if own.any():  # these compensate the others, and the run's noise determines their own part
        columns = jacobian[:, own]
        spread[own] = -np.linalg.lstsq(columns, jacobian @ spread, rcond=DETERMINED)[0]
        noise = np.zeros((len(own), own.sum()))
        size, turns = spectrum(columns, np.ones(own.sum()))
        noise[own] = turns / np.maximum(size, DETERMINED * size[0])
        return np.hstack([spread[:, identified] / s[identified], noise]), spread[:, ~identified]
    return spread[:, identified] / s[identified], spread[:, ~identified]


def _basis(columns: np.ndarray) -> np.ndarray:
    if columns.shape[1] == 0:
        return columns
    s, v = spectrum(columns, np.ones(columns.shape[1]))
    identified = s > DETERMINED * s.max(initial=0.0)
    return columns @ (v[:, identified] / s[identified])


def _judged(r: np.ndarray, effects: np.ndarray, taken: np.ndarray) -> tuple[float, np.ndarray]:
    """Squares of the residuals over their covariance, and the deviation of each (rows,)."""
    # Residuals are noise and `effects` times unit normals, without their part in `taken`.
    r = r - taken @ (taken.T @ r)
    effects = effects - taken @ (taken.T @ effects)
    inner = np.eye(effects.shape[1]) + effects.T @ effects
    common = effects.T @ r
    chi2 = float(r @ r - common @ np.linalg.solve(inner, common))
    variance = 1 - np.sum(taken**2, axis=1) + np.sum(effects**2, axis=1)
    return chi2, np.sqrt(np.maximum(variance, 0.0))


def _bands(
    task: FitTask, theta: np.ndarray, spread: np.ndarray, open_: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Signals and their standard deviations by the model's numbers, (size, m) each."""
    motion, slopes = task.shootings[0].derivatives(theta)
    sizes = {}
    for signal, slope in slopes.items():
        variance = np.sum(np.einsum("skm,kj->sjm", slope, spread) ** 2, axis=1)
        moved = np.linalg.norm(np.einsum("skm,kj->sjm", slope, open_), axis=1)
        usual = np.linalg.norm(slope * task.nominal[:, None], axis=1).max(initial=0.0)
        sizes[signal] = np.where(moved > DETERMINED * usual, np.inf, np.sqrt(variance))
    return {signal: motion[signal] for signal in slopes}, sizes


def _p(found: Fit, chi2: float, freedom: int) -> float:
    """P-value for a true model; the noise is as uncertain as its estimate."""
    if not found.estimated:
        return float(chdtrc(freedom, chi2))
    readings = sum(len(rows_estimated(found.task, signal)) for signal in found.estimated)
    left = max(readings - len(found.theta), 1)
    return float(fdtrc(freedom, left, chi2 / freedom))
