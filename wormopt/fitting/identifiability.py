"""Identifiability: which unknowns and combinations a fit determines.

A direction of the null space of a Jacobian is unidentifiable at one point. Residuals at a distance
test whether it continues along products or along sums.

The singular values of the Jacobian, its columns scaled by the sizes of the unknowns, are changes of
residuals, in standard deviations, by combinations of relative changes. If the error of the Jacobian
is E, that of every singular value is at most E (Weyl): values up to E are 0. E is measured by
derivatives with looser tolerances (`Fit.error`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from scipy.optimize import linprog

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.estimate import Fit, check_fit
from wormopt.fitting.information import identified_by, spectrum
from wormopt.fitting.task import FitTask
from wormopt.shown import lines

Form = Literal["product", "sum", "here"]
# Trial moves, in sizes, and largest share of the single effects that may remain: about half the
# move for directions at one point only, round-off for others.
_MOVES, _LEFT = (0.1, -0.1, 0.01, -0.01), 1e-3
_FAR_FROM_ZERO = 0.01  # closer to 0, in its size, there is no relative change
_MANY = 3  # unknowns, of which not every ratio is listed
_NICE, _NEAR = 6, 1e-3  # largest denominator of exponents as fractions, and their tolerance


@dataclass(frozen=True)
class Combination:
    """Unknowns that can change together while every reading stays explained as it was."""

    names: tuple[str, ...]  # names of the unknowns
    # whether it leads on along factors, along sums, or holds to first order at this point
    form: Form
    changes: tuple[float, ...]  # change of each unknown, the largest 1
    relative: bool  # whether changes are relative, or in the units of the unknowns

    def __str__(self) -> str:
        """Describe the unidentifiable change, and the remaining known combinations."""
        if len(self.names) == 1:
            return f"{self.names[0]} has no effect on the measurements"
        pairs = list(zip(self.names, self.changes, strict=True))
        if self.form == "here":
            unit = " %" if self.relative else ""
            moved = _listed([f"{name} by {c:+.3g}{unit}" for name, c in pairs])
            return f"{moved} together have no effect, to first order"
        least = np.copysign(min(map(abs, self.changes)), self.changes[0])
        pairs = [(name, change / least) for name, change in pairs]
        if self.form == "product" and len(pairs) > _MANY and all(_nice(c) == "1" for _, c in pairs):
            return f"{_listed(list(self.names))} scale alike: only their ratios are known"
        letter = next(c for c in "cqsz" if c not in self.names)
        word = _factor if self.form == "product" else _summand
        kept = list(_products(pairs) if self.form == "product" else _sums(pairs))
        is_known = "is known" if len(kept) == 1 else "are known"
        moved = _listed([word(name, change, letter) for name, change in pairs])
        return f"{moved} change nothing: only {_listed(kept)} {is_known}"


def combination(
    direction: np.ndarray, task: FitTask, theta: np.ndarray, sizes: np.ndarray, effects: np.ndarray
) -> Combination:
    """Find how far a direction of the null space continues.

    `direction` (n,) is in `sizes` of the coordinates `theta`; `effects` (n,) are the norms of the
    effects of such changes on the residuals.
    """
    logs = np.array([c.log for c in task.coordinates])
    there = direction != 0
    # a change of a logarithm is a relative one
    shares = np.where(logs, 1.0, theta / sizes)
    relative = bool(np.all(np.abs(shares[there]) > _FAR_FROM_ZERO))
    factors = np.divide(direction, shares, out=np.zeros(len(theta)), where=there)
    factors = factors / np.abs(factors).max() if relative else factors
    slopes = direction * sizes * task.slopes(theta)

    def leads_on(moved: Callable[[float], np.ndarray], moves: np.ndarray) -> bool:
        alone = np.linalg.norm(effects * moves)
        for amount in _MOVES:
            try:
                change = task.misfit(moved(amount)) - task.misfit(theta)
            except (SolveError, ArgumentError):
                continue
            return bool(np.linalg.norm(change) <= _LEFT * abs(amount) * alone)
        return False

    def along_factors(amount: float) -> np.ndarray:
        return np.where(logs, theta + amount * factors, theta * np.exp(amount * factors))

    def along_sums(amount: float) -> np.ndarray:
        logarithms = theta + np.log1p(np.where(logs, amount * direction, 0.0))
        return np.where(logs, logarithms, theta + amount * direction * sizes)

    form: Form = "here"
    if relative and leads_on(along_factors, factors * shares):
        form = "product"
    elif leads_on(along_sums, direction):
        form = "sum"
    relative = relative and form != "sum"
    changes = factors if relative else slopes / np.abs(slopes).max()
    names = tuple(name for name, is_in in zip(task.names, there, strict=True) if is_in)
    return Combination(names, form, tuple(changes[there].tolist()), relative)


def sparse_basis(null: np.ndarray, zero: float) -> np.ndarray:
    """Directions (k, n) that span the columns of `null` (n, k), with few entries each.

    For every row the vector of least sum of sizes with 1 there, by linear programs; of these the
    shortest that are independent. Entries up to `zero` are 0; the largest of each is 1.
    """
    n, k = null.shape
    found = [_sparsest(null, row) for row in range(n) if np.linalg.norm(null[row]) > zero]
    for each in found:
        each /= each[np.argmax(np.abs(each))]
        each[np.abs(each) <= zero] = 0.0
    found.sort(key=lambda each: (np.count_nonzero(each), np.abs(each).sum()))
    chosen = np.zeros((0, n))
    for each in found:
        tried = np.vstack([chosen, each / np.linalg.norm(each)])
        if len(chosen) < k and np.linalg.svd(tried, compute_uv=False)[-1] > np.sqrt(zero):
            chosen = tried
    return chosen / np.abs(chosen).max(axis=1, keepdims=True)


def _sparsest(null: np.ndarray, row: int) -> np.ndarray:
    n, k = null.shape
    cost = np.concatenate([np.zeros(k), np.ones(n)])
    sides = np.block([[null, -np.eye(n)], [-null, -np.eye(n)]])
    at = np.concatenate([null[row], np.zeros(n)])[None] / np.linalg.norm(null[row])
    found = linprog(
        cost, A_ub=sides, b_ub=np.zeros(2 * n), A_eq=at, b_eq=[1.0], bounds=(None, None)
    )
    return null @ (found.x[:k] if found.success else null[row])


def _nice(value: float) -> str:
    near = Fraction(value).limit_denominator(_NICE)
    return str(near) if abs(value - near) <= _NEAR * abs(value) else f"{value:.3g}"


def _power(name: str, exponent: float) -> str:
    number = _nice(exponent)
    return name if number == "1" else f"{name}^({number})" if "/" in number else f"{name}^{number}"


def _factor(name: str, exponent: float, letter: str) -> str:
    return f"{name} {'times' if exponent > 0 else 'over'} {_power(letter, abs(exponent))}"


def _summand(name: str, slope: float, letter: str) -> str:
    return f"{name} {_term(slope, letter)}"


def _term(slope: float, name: str) -> str:
    number = _nice(abs(slope))
    return f"{'-' if slope < 0 else '+'} {name if number == '1' else f'{number} {name}'}"


def _products(pairs: Sequence[tuple[str, float]]) -> Iterator[str]:
    """Monomials that stay constant, of the first unknown with each of the others."""
    (one, first), *others = pairs
    for name, power in others:
        # both exponents at least 1, that of the first positive
        a, b = (1.0, -first / power) if abs(first) >= abs(power) else (-power / first, 1.0)
        sign = np.sign(a)
        yield _monomial((one, sign * a), (name, sign * b))


def _monomial(*factors: tuple[str, float]) -> str:
    over = " * ".join(_power(name, e) for name, e in factors if e > 0)
    under = "".join(f" / {_power(name, -e)}" for name, e in factors if e < 0)
    return f"{over}{under}"


def _sums(pairs: Sequence[tuple[str, float]]) -> Iterator[str]:
    """Sums that stay constant, of the first unknown with each of the others."""
    (one, first), *others = pairs
    for name, slope in others:
        yield f"{one} {_term(-first / slope, name)}"


def _listed(words: Sequence[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last


# Shares that are round-off of linear programs and decompositions, and that never are.
_ROUND, _SURELY = 1e-9, 0.1


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Identifiable and unidentifiable unknowns of a fit."""

    names: tuple[str, ...]  # unknowns
    # (n,) singular values of the scaled Jacobian of the readings, largest first: changes of
    # residuals, in standard deviations, for changes of unknowns by their sizes
    singular_values: np.ndarray
    # (n, n) the combinations that belong to them, in shares of the sizes, row by row
    directions: np.ndarray
    error: float  # error bound of the singular values
    rank: int  # number of singular values above it
    # (n,) standard error of each unknown by the readings alone, in shares of its size; infinite for
    # unidentifiable ones
    errors: np.ndarray
    by_prior: tuple[str, ...]  # unknowns that only their priors determine
    lost: tuple[Combination, ...]  # combinations without effect on any reading
    # unknowns that the readings determine, but with an error as large as the value
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
            *(f"{name} is known from its prior only" for name in self.by_prior),
            *(f"{name} is known only to {100 * shares[name]:.0f} %" for name in self.weak),
        )


def identifiability(found: Fit) -> Identifiability:
    """Find which unknowns the readings of a fit identify, and which combinations they do not.

    Parameters
    ----------
    found : Fit
        The fit. Its priors are left out and reported separately.

    Returns
    -------
    Identifiability
        All combinations of unknowns without effect. Each holds globally along products or sums, as
        distant simulations confirm, or only to first order.

    Raises
    ------
    ArgumentError
        If `found` is not a Fit.

    Notes
    -----
    Structural: a singular value that is not above its error, by Weyl's inequality. Practical: an
    error as large as the unknown. Both are local; `profile` is not. L. Ljung, System
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
