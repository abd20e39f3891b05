"""Parameters that vary in time, in particular at random."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.schedule import Schedule


@dataclass(frozen=True, eq=False)
class ParameterPath:
    """A column of parameters as polynomials in the time since each piece began.

    The first and last piece go on for ever. Raises ArgumentError if shapes disagree or
    breaks do not ascend from 0.
    """

    breaks: np.ndarray  # (pieces + 1,) from 0, ascending, with the last end
    coefficients: np.ndarray  # (pieces, n, degree + 1) by ascending power

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
        """Evaluate at times (m,), giving (n, m); at a break the later piece applies."""
        t = np.asarray(t, dtype=float)
        last = len(self.coefficients) - 1
        piece = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, last)
        s, values = t - self.breaks[piece], np.zeros((self.size, len(t)))
        for column in self.coefficients[piece].T[::-1]:
            values = values * s + column
        return values

    def schedule(self, name: str, time: ca.SX) -> tuple[ca.SX, Schedule]:
        """Convert the path for use in a Model.

        Returns the parameters (n, 1) and the Schedule of their symbols. `name`: the scheduled
        quantity, such as "stiffness"; `time`: the model's symbol of time.
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
    """Draw parameters that take new, independent values after every interval.

    Uniform on mean ± spread, (n,), 0 <= spread < mean, so positive; the last stays after
    `horizon`. Raises ArgumentError if a parameter might not be positive, or a time is not.
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
    """Draw mean exp(s z - s²/2), s² = log(1 + (deviation/mean)²), z a unit-variance OU process.

    Covariance over a time h is mean² (exp(s² exp(-h/correlation_time)) - 1), exact on the
    grid (Gillespie, Phys. Rev. E 54, 2084, 1996); linear between, constant after `horizon`.
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
    # rounding must not add a step to a horizon of whole steps
    return step * np.arange(math.ceil(horizon / step * (1 - 1e-12)) + 1)
