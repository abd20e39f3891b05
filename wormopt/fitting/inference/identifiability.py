"""Identifiability: which unknowns and combinations a fit determines.

The singular values of the Jacobian, its columns scaled by the sizes of the unknowns, are changes of
residuals, in standard deviations, by combinations of relative changes. If the error of the Jacobian
is E, that of every singular value is at most E (Weyl): values up to E are 0. E is measured by
derivatives with looser tolerances (`Fit.error`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.fitting.estimate import Fit
from wormopt.fitting.inference.asked import check_fit
from wormopt.fitting.inference.combination import Combination, combination, sparse_basis
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import identified_by, spectrum
from wormopt.shown import lines

# Shares that are round-off of linear programs and decompositions, and that never are.
_ROUND, _SURELY = 1e-9, 0.1


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Identifiable and unidentifiable unknowns of a fit.

    Parameters
    ----------
    names : tuple of str
        Unknowns.
    singular_values : ndarray, shape (n,)
        Of the scaled Jacobian of the readings, largest first: standard deviations of noise by
        which residuals move when unknowns change by their sizes.
    directions : ndarray, shape (n, n)
        The combinations that belong to them, in shares of the sizes, row by row.
    error : float
        How wrong singular values may be.
    rank : int
        How many singular values are larger.
    errors : ndarray, shape (n,)
        Standard error of each unknown by the readings alone, in shares of its size; infinite for
        what cannot be told.
    by_prior : tuple of str
        Unknowns that only their priors make known.
    lost : tuple of Combination
        What changes no reading.
    weak : tuple of str
        Unknowns that the readings tell, but with an error as large as they are themselves.
    """

    names: tuple[str, ...]
    singular_values: np.ndarray
    directions: np.ndarray
    error: float
    rank: int
    errors: np.ndarray
    by_prior: tuple[str, ...]
    lost: tuple[Combination, ...]
    weak: tuple[str, ...]

    def __repr__(self) -> str:
        summary = f"Identifiability: {self.rank} of {len(self.names)} combinations are identifiable"
        return lines(summary, *self.words)

    @property
    def gap(self) -> float:
        """Least nonzero singular value over the largest zero one, or over the error."""
        if self.rank == 0:
            return 0.0
        beyond = self.singular_values[self.rank :]
        return float(self.singular_values[self.rank - 1] / max((self.error, *beyond)))

    @property
    def words(self) -> tuple[str, ...]:
        """Statements about unknowns that are not known."""
        shares = dict(zip(self.names, self.errors, strict=True))
        return (
            *map(str, self.lost),
            *(f"{name} is known by its prior only" for name in self.by_prior),
            *(f"{name} is known to {100 * shares[name]:.0f} % only" for name in self.weak),
        )


def identifiability(found: Fit) -> Identifiability:
    """Find which unknowns the readings of a fit identify, and which combinations they do not.

    Parameters
    ----------
    found : Fit
        Numbers found. What its priors say is left aside, and told apart.

    Returns
    -------
    Identifiability
        What cannot be told is named: how unknowns change together without any effect, and whether
        so along products or sums (tried by simulations some way off), or to first order only.

    Raises
    ------
    ArgumentError
        If it is no fit.

    Notes
    -----
    Structural: a singular value that is not above its error, by Weyl's inequality. Practical: an
    error as large as the unknown. Both are of one point; `profile` looks farther. L. Ljung, System
    Identification, 2nd ed., 1999, section 4; A. Raue et al., Bioinformatics 25 (2009) 1923.

    Examples
    --------
    A mass on a spring, of which only the place is measured:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, m, k = (ca.SX.sym(name) for name in ("x", "v", "mass", "stiffness"))
    >>> states = [wo.Signal("place", x, value=1.0), wo.Signal("velocity", v, value=0.0)]
    >>> numbers = [wo.Signal("mass", m, value=2.0), wo.Signal("stiffness", k, value=3.0)]
    >>> worm = wo.Model("mass on a spring", states, ca.vertcat(v, -k / m * x), p=numbers)
    >>> t = np.linspace(0.0, 5.0, 21)
    >>> run = wo.Recording(t, {"place": np.cos(1.2 * t)}, noise={"place": 0.01})
    >>> task = wo.FitTask(worm, [run], [wo.Unknown("mass"), wo.Unknown("stiffness")])
    >>> known = identifiability(wo.fit(task, seeds=1))
    >>> print(*known.words)
    mass times c and stiffness times c change nothing: only mass / stiffness is known
    """
    check_fit(found)
    task, theta = found.task, found.theta
    sizes, error = found.sizes, found.error
    scaled = found.jacobian[: task.count] * sizes
    values, columns = by_readings = spectrum(scaled, np.ones(len(sizes)))
    rank, _, _ = identified_by(by_readings, error)
    # directions on both sides of the gap mix by error over gap (Wedin)
    zero = float(np.clip(error / values[rank - 1] if rank else 0.0, _ROUND, _SURELY))
    effects = np.linalg.norm(scaled, axis=0)
    basis = sparse_basis(columns[:, rank:], zero)
    errors = _errors(by_readings, error)
    weak = errors >= 1
    held = weak & (_errors(found.singular, error) < 1)
    return Identifiability(
        task.names,
        values,
        columns.T,
        error,
        rank,
        errors,
        _named(task, held),
        tuple(combination(each, task, theta, sizes, effects) for each in basis),
        _named(task, weak & ~held & np.isfinite(errors)),
    )


def _named(task: FitTask, which: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, is_it in zip(task.names, which, strict=True) if is_it)


def _errors(spectrum: tuple[np.ndarray, np.ndarray], error: float) -> np.ndarray:
    """Standard errors (n,) in sizes, infinite with a share in unidentifiable directions."""
    _, errors, lost = identified_by(spectrum, error)
    return np.where(lost, np.inf, errors)
