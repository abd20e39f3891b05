"""Paths of parameters that vary in time, random ones above all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import Schedule

__all__ = ["ParameterPath", "ornstein_uhlenbeck", "piecewise_constant"]


@dataclass(frozen=True, eq=False)
class ParameterPath:
    """A column of parameters as polynomials in the time since each piece began.

    Parameters
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Times at which pieces begin, from 0 on, ascending, and the end of the last. The last
        piece goes on for ever, and so does the first one before 0.
    coefficients : ndarray, shape (pieces, n, degree + 1)
        By ascending power.

    Raises
    ------
    ArgumentError
        If shapes disagree or the breaks do not ascend from 0.

    Examples
    --------
    >>> ramp = ParameterPath(np.array([0.0, 1.0, 2.0]), np.array([[[9.0, 2.0]], [[11.0, 0.0]]]))
    >>> ramp(np.array([0.5, 1.5]))
    array([[10., 11.]])
    """

    breaks: np.ndarray
    coefficients: np.ndarray

    def __post_init__(self) -> None:
        if self.coefficients.ndim != 3 or self.breaks.shape != (len(self.coefficients) + 1,):
            raise ArgumentError("coefficients must have the shape (pieces, n, degree + 1)")
        ascending = np.all(np.isfinite(self.breaks)) and np.all(np.diff(self.breaks) > 0)
        if self.breaks[0] != 0 or not ascending:
            raise ArgumentError("breaks must ascend from 0, one more than there are pieces")

    @property
    def size(self) -> int:
        """Number of parameters n."""
        return self.coefficients.shape[1]

    @property
    def values(self) -> np.ndarray:
        """Coefficients as the `Schedule` wants them, shape (pieces, n (degree + 1)).

        Paths drawn alike share one compiled model: only these numbers differ.
        """
        return self.coefficients.transpose(0, 2, 1).reshape(len(self.coefficients), -1)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Evaluate; at a break the later piece counts.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times.

        Returns
        -------
        ndarray, shape (n, m)
        """
        t = np.asarray(t, dtype=float)
        last = len(self.coefficients) - 1
        piece = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, last)
        s, values = t - self.breaks[piece], np.zeros((self.size, len(t)))
        for column in self.coefficients[piece].T[::-1]:
            values = values * s + column
        return values

    def schedule(self, name: str, time: ca.SX) -> tuple[ca.SX, Schedule]:
        """Turn the path into what a Model takes.

        Parameters
        ----------
        name : str
            What is scheduled, for instance ``"stiffness"``.
        time : casadi.SX
            The model's symbol of time.

        Returns
        -------
        expression : casadi.SX, shape (n, 1)
            The parameters.
        schedule : Schedule
            Gives the symbols in ``expression`` their values.

        Examples
        --------
        >>> import casadi as ca
        >>> steps = ParameterPath(np.array([0.0, 1.0]), np.full((1, 2, 1), 9.0))
        >>> steps.schedule("stiffness", ca.SX.sym("t"))[0]
        SX([stiffness_0, stiffness_1])
        """
        symbol, begin = ca.SX.sym(name, self.values.shape[1]), ca.SX.sym(f"{name}_begin")
        powers = ca.vertsplit(symbol, self.size)
        expression = powers[-1]
        for power in powers[-2::-1]:
            expression = expression * (time - begin) + power
        return expression, Schedule(name, symbol, begin, self.breaks, self.values)


def piecewise_constant(
    rng: np.random.Generator,
    mean: ArrayLike,
    spread: ArrayLike,
    interval: float,
    horizon: float,
) -> ParameterPath:
    """Draw parameters that take new values after every interval, independent of all others.

    Values are uniform between mean - spread and mean + spread, so that they stay positive.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of chance; the same seed gives the same path.
    mean, spread : array_like, shape (n,)
        Middle and half width of the range of each parameter, 0 <= spread < mean. At least one of
        both tells n.
    interval : float
        Time between two changes.
    horizon : float
        How long it goes on; afterwards the last value stays.

    Returns
    -------
    ParameterPath

    Raises
    ------
    ArgumentError
        If a parameter might not be positive, or a time is not.

    Examples
    --------
    >>> path = piecewise_constant(np.random.default_rng(1), [10.0, 10.0], 2.0, 0.5, 3.0)
    >>> path.coefficients.shape
    (6, 2, 1)
    """
    mean, spread = _columns(mean, spread)
    if not np.all((spread >= 0) & (spread < mean) & np.isfinite(mean)):
        raise ArgumentError("a random parameter stays positive only with 0 <= spread < mean")
    breaks = _grid(interval, horizon, "interval")
    values = rng.uniform(mean - spread, mean + spread, (len(breaks) - 1, len(mean)))
    return ParameterPath(breaks, values[:, :, None])


def ornstein_uhlenbeck(
    rng: np.random.Generator,
    mean: ArrayLike,
    deviation: ArrayLike,
    correlation_time: float,
    step: float,
    horizon: float,
) -> ParameterPath:
    """Draw parameters whose logarithms are stationary Ornstein-Uhlenbeck processes.

    A parameter is mean exp(s z - s^2/2) with s^2 = log(1 + (deviation/mean)^2), where z is an
    Ornstein-Uhlenbeck process of unit variance, so it is positive, has this mean and deviation at
    any time, and mean^2 (exp(s^2 exp(-h/correlation_time)) - 1) as its covariance over a time h.
    This is exact at the points of the grid (Gillespie, Phys. Rev. E 54, 2084, 1996); between them
    the parameters are linear in time, so that they are continuous.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of chance; the same seed gives the same path.
    mean, deviation : array_like, shape (n,)
        Mean, positive, and standard deviation of each parameter. At least one of both tells n.
    correlation_time : float
        Time after which the correlation of the logarithms has fallen to 1/e.
    step : float
        Distance of the grid's points in time.
    horizon : float
        How long it goes on; afterwards the last value stays.

    Returns
    -------
    ParameterPath
        With one piece more than steps, constant, for all time after the horizon.

    Raises
    ------
    ArgumentError
        If a mean is not positive, a deviation negative, or a time not positive.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> path = ornstein_uhlenbeck(rng, [10.0, 10.0], 2.0, correlation_time=1, step=0.25, horizon=3)
    >>> path.coefficients.shape
    (13, 2, 2)
    """
    mean, deviation = _columns(mean, deviation)
    if not np.all((mean > 0) & (deviation >= 0) & np.isfinite(mean + deviation)):
        raise ArgumentError("a random parameter needs mean > 0 and deviation >= 0")
    if not 0 < correlation_time < math.inf:
        raise ArgumentError("correlation_time must be positive and finite")
    breaks = _grid(step, horizon, "step")
    breaks = np.append(breaks, breaks[-1] + step)
    kept = math.exp(-step / correlation_time)
    fresh = math.sqrt(-math.expm1(-2 * step / correlation_time))
    z = rng.standard_normal((len(breaks) - 1, len(mean)))
    for k in range(1, len(z)):
        z[k] = kept * z[k - 1] + fresh * z[k]
    s = np.sqrt(np.log1p((deviation / mean) ** 2))
    values = mean * np.exp(s * z - s**2 / 2)
    slopes = np.diff(values, axis=0, append=values[-1:]) / np.diff(breaks)[:, None]
    return ParameterPath(breaks, np.stack([values, slopes], axis=2))


def _columns(mean: ArrayLike, spread: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    mean, spread = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(a, float)) for a in (mean, spread))
    )
    return mean, spread


def _grid(step: float, horizon: float, name: str) -> np.ndarray:
    """Multiples of ``step`` up to the first that reaches the horizon."""
    if not (0 < step < math.inf and 0 < horizon < math.inf):
        raise ArgumentError(f"{name} and horizon must be positive and finite")
    # A horizon of whole steps shall not get one more by rounding.
    return step * np.arange(math.ceil(horizon / step * (1 - 1e-12)) + 1)
