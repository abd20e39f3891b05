"""Which unknowns a fit knows, and which it cannot tell apart.

The singular values of the Jacobian, its columns scaled by the sizes of the unknowns, say how much
each combination of relative changes moves the residuals, in standard deviations. Computed
derivatives are wrong by E, and so every singular value by as much at most (Weyl): what is not
larger than E is none. E is measured, by derivatives computed anew, less exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wormopt.fitting.estimate import Fit
from wormopt.fitting.inference.combination import Combination, combination, sparse_basis
from wormopt.fitting.task import FitTask
from wormopt.fitting.uncertainty import spectrum
from wormopt.shown import lines

# Derivatives are computed anew with tolerances so many times larger: their difference is about
# the error of those, an upper bound for the better ones.
_COARSER = 10.0
_ROUND = 1e-9  # shares that are round-off of linear programs and decompositions


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What a fit can tell of its unknowns, and what not.

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
        told = f"Identifiability: {self.rank} of {len(self.names)} combinations can be told"
        return lines(told, *self.words)

    @property
    def gap(self) -> float:
        """Least singular value that counts over the largest that does not, or over the error."""
        if self.rank == 0:
            return 0.0
        beyond = self.singular_values[self.rank :]
        return float(self.singular_values[self.rank - 1] / max(self.error, *beyond))

    @property
    def words(self) -> tuple[str, ...]:
        """What is not known, sentence by sentence."""
        shares = dict(zip(self.names, self.errors, strict=True))
        return (
            *map(str, self.lost),
            *(f"{name} is known by its prior only" for name in self.by_prior),
            *(f"{name} is known to {100 * shares[name]:.0f} % only" for name in self.weak),
        )


def identifiability(found: Fit) -> Identifiability:
    """Find out which unknowns the readings of a fit tell, and which combinations they do not.

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
    SolveError
        If the motions cannot be followed a second time, less exactly.

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
    task, theta = found.task, found.theta
    sizes = np.maximum(np.abs(theta), task.nominal)
    sizes[[c.log for c in task.coordinates]] = 1.0
    scaled = found.jacobian[: task.count] * sizes
    error = _error(task, theta, scaled, sizes)
    values, directions, rank, zero = told = _told(scaled, error)
    effects = np.linalg.norm(scaled, axis=0)
    basis = sparse_basis(directions[rank:].T, zero)
    errors = _errors(*told)
    weak = errors >= 1
    held = weak & (_errors(*_told(found.jacobian * sizes, error)) < 1)
    return Identifiability(
        task.names,
        values,
        directions,
        error,
        rank,
        errors,
        _named(task, held),
        tuple(combination(each, task, theta, sizes, effects) for each in basis),
        _named(task, weak & ~held & np.isfinite(errors)),
    )


def _named(task: FitTask, which: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, is_it in zip(task.names, which, strict=True) if is_it)


def _errors(values: np.ndarray, directions: np.ndarray, rank: int, zero: float) -> np.ndarray:
    """Standard errors (n,) in sizes, infinite for what has a share in what cannot be told."""
    errors = np.linalg.norm(directions[:rank] / values[:rank, None], axis=0)
    lost = np.linalg.norm(directions[rank:], axis=0) > zero
    return np.where(lost, np.inf, errors)


def _told(scaled: np.ndarray, error: float) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Singular values (n,), directions, rank, and shares in a direction that are none."""
    values, columns = spectrum(scaled, np.ones(scaled.shape[1]))
    rank = int(np.sum(values > error))
    # directions on both sides of the gap mix by error over gap (Wedin)
    return values, columns.T, rank, max(error / values[rank - 1] if rank else 0.0, _ROUND)


def _error(task: FitTask, theta: np.ndarray, scaled: np.ndarray, sizes: np.ndarray) -> float:
    """How wrong singular values may be: as much as the derivatives, by their change.

    At least by what simulations promise, and by rounding.
    """
    fine = task.precision
    less = replace(fine, relative=_COARSER * fine.relative, absolute=_COARSER * fine.absolute)
    _, jacobian = replace(task, tolerance=less).residuals(theta)
    apart = np.linalg.norm(jacobian[: task.count] * sizes - scaled, 2)
    promised = fine.relative + max(scaled.shape) * np.finfo(float).eps
    return float(apart + promised * np.linalg.norm(scaled, 2))
