"""Fit: the estimates and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.information import (
    DETERMINED,
    correlation_of,
    covariance_of,
    held_at,
    spectrum,
    triangle,
)
from wormopt.fitting.stretches import continuity
from wormopt.fitting.task import FitTask
from wormopt.shown import SHORT, lines, text
from wormopt.simulation.trajectory import NonsmoothEvent

# Factor of the tolerances of a second evaluation of derivatives: the difference is about the error
# of these, an upper bound for the more accurate ones.
_COARSER = 10.0
_LINES = 20  # of numbers in a repr


@dataclass(frozen=True)
class Attempt:
    """Result from one start.

    Parameters
    ----------
    start : ndarray, shape (n,)
        Coordinates at the start.
    theta : ndarray, shape (n,)
        Coordinates at the end.
    cost : float
        Half the sum of squares at the end, infinite if the start cannot be simulated.
    offset : float
        Distance from the minimum, in standard errors: length of the next step over sqrt(n).
    evaluations : int
        Number of simulations of all runs, with derivatives or without.
    agrees : bool
        Whether it ended at the best fit, within a tenth of the standard errors.

    Examples
    --------
    The only start ends where the best one does:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x,
    ...                  p=[wo.Signal("rate", rate, value=1.0)])
    >>> run = wo.Recording([0.0, 0.5], {"x": [1.0, 0.6]}, noise={"x": 0.02})
    >>> found = wo.fit(wo.FitTask(decay, [run], [wo.Unknown("rate")]), seeds=1)
    >>> found.starts[0].agrees, found.starts[0].theta.round(3)  # -log(0.6) / 0.5
    (True, array([1.022]))
    """

    start: np.ndarray
    theta: np.ndarray
    cost: float
    offset: float
    evaluations: int
    agrees: bool = False


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimates and their uncertainty.

    Parameters
    ----------
    task : FitTask
        The fitted task, with the noise found if it was estimated.
    theta : ndarray, shape (n,)
        Coordinates found, in the order of ``names``.
    residuals : ndarray, shape (rows,)
        Residuals of `FitTask.residuals` at the estimate.
    jacobian : ndarray, shape (rows, n)
        Likewise.
    offset : float
        Distance from the minimum, in standard errors: length of the next step over sqrt(n).
    converged : bool
        Whether `offset` is negligible and more than one start reached the minimum.
    reason : str
        Reason if the search has not converged; empty otherwise.
    starts : tuple of Attempt
        Results from all starts, the best first.
    estimated : tuple of str
        Signals with estimated noise.
    warnings : tuple of str
        Warnings about recordings and result.

    Examples
    --------
    The decay exp(-rate t) falls to 0.6 within 0.5, measured with an error of 0.02:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x,
    ...                  p=[wo.Signal("rate", rate, value=1.0)])
    >>> run = wo.Recording([0.0, 0.5], {"x": [1.0, 0.6]}, noise={"x": 0.02})
    >>> found = wo.fit(wo.FitTask(decay, [run], [wo.Unknown("rate")]), seeds=1)
    >>> found.names, found.values.round(3)  # -log(0.6) / 0.5
    (('rate',), array([1.022]))
    >>> found.standard_errors.round(3)  # 0.02 / (0.5 * 0.6)
    array([0.067])
    """

    task: FitTask
    theta: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    offset: float
    converged: bool
    reason: str
    starts: tuple[Attempt, ...]
    estimated: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        found = [
            f"{name} {text(float(value), SHORT)} ± {text(float(error), 2)}"
            for name, value, error in zip(
                self.names, self.values, self.standard_errors, strict=True
            )
        ]
        if len(found) > _LINES:
            found[_LINES - 1 :] = [f"and {len(found) - _LINES + 1} more"]
        state = "converged" if self.converged else f"not converged: {self.reason}"
        return lines(f"Fit of {self.task.model.name} ({state})", *found)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, entry by entry."""
        return self.task.names

    @property
    def values(self) -> np.ndarray:
        """Estimates, (n,): coordinates, or their exponentials for logarithms."""
        return self.task.values(self.theta)

    @property
    def cost(self) -> float:
        """Half the sum of squares of the residuals."""
        return float(self.residuals @ self.residuals) / 2

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviation of the readings of each signal, of the last run that has it."""
        return {b.signal: self.task.deviation(b.run, b.signal) for b in self.task.blocks}

    @cached_property
    def plain(self) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of `FitTask.plain` at the estimate, (rows,), and their Jacobian, (rows, n)."""
        return self.task.plain(self.theta)

    def continuity(self, nodes: int = 6) -> float:
        """Return the largest jump between simulations that are restarted along the fitted motion.

        Parameters
        ----------
        nodes : int, optional
            Number of readings at which each run is restarted.

        Returns
        -------
        float
            Largest jump between stretches that start on the fitted motion, in nominal sizes of the
            states. It shows how far simulation errors grow within a stretch. If it is large,
            neighbouring motions separate quickly: use more nodes, and do not rely on the standard
            errors.

        Raises
        ------
        ArgumentError
            If the model has delays.
        """
        return continuity(self.task, self.theta, nodes)

    @cached_property
    def nonsmooth_events(self) -> tuple[tuple[str, NonsmoothEvent], ...]:
        """Run and event at which derivatives do not exist or are one-sided."""
        return tuple(
            (shooting.run.name, doubt)
            for shooting in self.task.shootings
            for doubt in shooting.motion(self.theta, derivatives=True).nonsmooth_events
        )

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of unknowns at a bound that is active."""
        held = held_at(self.task.bounds, self.theta, self.jacobian.T @ self.residuals)
        return tuple(name for name, stuck in zip(self.names, held, strict=True) if stuck)

    @cached_property
    def singular(self) -> tuple[np.ndarray, np.ndarray]:
        """Singular values (n,) and right singular vectors (n, n), in columns.

        Of the Jacobian by coordinates over their ``sizes``: a change by v sizes along a column
        changes the residuals by s v standard deviations.
        """
        return spectrum(self.jacobian, self.sizes)

    @cached_property
    def sizes(self) -> np.ndarray:
        """Sizes of the coordinates, (n,), to compare their effects; 1 for a logarithm."""
        sizes = np.maximum(np.abs(self.theta), self.task.nominal)
        return np.where([c.log for c in self.task.coordinates], 1.0, sizes)

    @cached_property
    def error(self) -> float:
        """Error of singular values: the change of derivatives with looser tolerances.

        At least the tolerance of simulations, and rounding.
        """
        task, fine = self.task, self.task.precision
        less = replace(fine, relative=_COARSER * fine.relative, absolute=_COARSER * fine.absolute)
        scaled = self.jacobian[: task.count] * self.sizes
        promised = fine.relative + max(scaled.shape) * np.finfo(float).eps
        try:
            _, jacobian = replace(task, tolerance=less).residuals(self.theta)
        except SolveError:
            promised, jacobian = DETERMINED, self.jacobian
        apart = np.linalg.norm(triangle(jacobian[: task.count] * self.sizes - scaled), 2)
        return float(apart + promised * self.singular[0].max(initial=0.0))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates, (n, n), infinite along unidentifiable directions.

        Bounds are ignored: an unknown at one is not known better for it.
        """
        return covariance_of(self.singular, self.sizes, self.error)

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard errors of the estimates, (n,)."""
        return np.sqrt(np.diag(self.covariance)) * np.abs(self.task.slopes(self.theta))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation of the coordinates, (n, n)."""
        return correlation_of(self.singular, self.error)


def check_fit(found: object) -> None:
    """Raise ArgumentError for anything but the result of `fit`."""
    if not isinstance(found, Fit):
        raise ArgumentError(f"found must be the result of fit, not {type(found).__name__}")


def check_level(level: object) -> None:
    """Raise ArgumentError for a level not between 0 and 1."""
    if not (isinstance(level, int | float) and 0 < level < 1):
        raise ArgumentError(f"level must be between 0 and 1, not {level!r}")
