"""Branches of steady states along a parameter, continued around folds by arc length.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977: the
parameter is an additional unknown, and the additional equation sets the length of a step along
the tangent. The parameter reverses at a fold.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wormopt.analysis.steady import ZERO, SteadyState, eigenvalues, rates_of
from wormopt.errors import ArgumentError
from wormopt.model.model import Model
from wormopt.model.values import by_name, check_names
from wormopt.numerics.newton import Equations, newton

End = Literal["range", "runaway", "lost", "steps", "closed", "stopped"]

_STEPS = 12  # of Newton's method towards the branch
_CONVERGED = 1e-11
_TURN = 0.15  # largest angle between neighbouring tangents
_SHORTEST = 1e-9
_HALVINGS = 55
# When sampling a branch, largest distance of a state from its prediction, in steps of the branch.
_FAR = 2.0


@dataclass(frozen=True, eq=False)
class Fold:
    """Point at which a branch reverses."""

    parameter: float  # value at the fold; beyond it these states do not exist
    x: np.ndarray  # (n_x,) state


@dataclass(frozen=True, eq=False)
class Branch:
    """Steady states along a parameter.

    Parameters
    ----------
    model : Model
        Model of the steady states.
    name : str
        Name of the parameter.
    parameter : ndarray, shape (m,)
        Its values, in the order of the branch.
    x : ndarray, shape (m, n_x)
        States.
    eigenvalues : ndarray of complex, shape (m, n_x)
        Eigenvalues of the Jacobian at each state, largest real part first.
    folds : tuple of Fold
        Where it turns back.
    ends : (str, str)
        Why it ends at its beginning and at its end: at the "range" of the parameter, in a
        "runaway" of a state, "lost" where no state follows, after the allowed "steps", or
        "closed" in itself.
    p : ndarray
        Parameters and inputs; the value of ``name`` is not used.

    Examples
    --------
    x' = r + x - x^3 has three steady states at r = 0, of which the middle one is unstable:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, r = ca.SX.sym("x"), ca.SX.sym("r")
    >>> states, numbers = [wo.Signal("x", x)], [wo.Signal("r", r, value=-2.0)]
    >>> cusp = wo.Model("cusp", states, r + x - x**3, p=numbers)
    >>> (low,) = wo.steady_states(cusp, {"x": (-3, 3)})
    >>> branch = wo.continue_branch(low, "r", (-2.0, 2.0))
    >>> found = branch.at([0.0])
    >>> found.x.round(9).ravel() + 0.0, found.stable
    (array([-1., 0., 1.]), array([ True, False, True]))
    """

    model: Model
    name: str
    parameter: np.ndarray
    x: np.ndarray
    eigenvalues: NDArray[np.complex128]
    folds: tuple[Fold, ...]
    ends: tuple[End, End]
    p: np.ndarray

    @property
    def stable(self) -> np.ndarray:
        """Whether each state is stable, shape (m,)."""
        return self.eigenvalues[:, 0].real < -ZERO * np.abs(self.eigenvalues).max(axis=1)

    def states(self, name: str) -> np.ndarray:
        """Samples (size, m) of a state.

        Parameters
        ----------
        name : str
            Name of a state.
        """
        check_names({name: 0}, [s.name for s in self.model.x], "state")
        return by_name(self.model.x, self.x.T)[name]

    def state(self, index: int) -> SteadyState:
        """State of the branch at an index, for example for `steady_sensitivity`.

        Parameters
        ----------
        index : int
            Index along the branch.
        """
        rates, p = rates_of(self.model), self.p.copy()
        p[rates.place(self.name)] = self.parameter[index]
        return rates.steady(self.x[index], p)

    def at(self, values: ArrayLike) -> Branch:
        """Find the states of the branch at given values of its parameter.

        Parameters
        ----------
        values : array_like, shape (k,)
            Values. A branch with folds has several states at one value. Values outside the branch
            are left out, and so are those too close to a fold for Newton's method.

        Returns
        -------
        Branch
            Branch with the states at these values only, in the order of the branch.
        """
        rates, values = rates_of(self.model), np.atleast_1d(np.asarray(values, float))
        starts, wanted, steps = [], [], []
        stretches = np.flatnonzero(np.diff(self.parameter))
        for k in stretches:
            low, high = self.parameter[k : k + 2]
            share = (values - low) / (high - low)
            # a value that ends a stretch belongs to the next one, if there is one
            last = k == stretches[-1]
            inside = np.flatnonzero((share >= 0) & ((share < 1) | (last & (share == 1))))
            inside = inside[np.argsort(share[inside])]
            starts += [self.x[k] + share[i] * (self.x[k + 1] - self.x[k]) for i in inside]
            wanted += [values[i] for i in inside]
            steps += [np.abs((self.x[k + 1] - self.x[k]) / rates.nominal).max()] * len(inside)
        x, parameter = np.array(starts).reshape(-1, self.x.shape[1]), np.array(wanted)
        p = np.tile(self.p, (len(x), 1))
        p[:, rates.place(self.name)] = parameter
        sought = x
        x, found = newton(rates, sought, p)
        # elsewhere it is another branch
        away = np.abs((x - sought) / rates.nominal).max(axis=1, initial=0.0)
        found &= away <= _FAR * np.array(steps)
        slopes = rates.slopes(x[found], p[found])
        spectra = np.array([eigenvalues(matrix) for matrix in slopes]).reshape(-1, x.shape[1])
        return replace(self, parameter=parameter[found], x=x[found], eigenvalues=spectra)


def continue_branch(
    start: SteadyState,
    parameter: str,
    span: tuple[float, float],
    *,
    largest: float = 1e3,
    max_points: int = 2000,
) -> Branch:
    """Follow a steady state along a parameter, both ways, around folds.

    Parameters
    ----------
    start : SteadyState
        On the branch.
    parameter : str
        A scalar parameter of its model.
    span : (float, float)
        Least and largest value of it.
    largest : float, optional
        Usual sizes at which a state counts as running away.
    max_points : int, optional
        Most points either way.

    Returns
    -------
    Branch

    Raises
    ------
    ArgumentError
        If the span does not hold the start, or the parameter is no scalar.
    UnknownNameError
        If there is no such parameter.

    Examples
    --------
    x' = r + x - x^3 has folds where 3 x^2 = 1:

    >>> import casadi as ca
    >>> from wormopt.analysis.steady import steady_states
    >>> from wormopt.model.model import Signal
    >>> x, r = ca.SX.sym("x"), ca.SX.sym("r")
    >>> cusp = Model("cusp", x=[Signal("x", x)], ode=r + x - x**3, p=[Signal("r", r, value=-2.0)])
    >>> (low,) = steady_states(cusp, {"x": (-3, 3)})
    >>> branch = continue_branch(low, "r", (-2.0, 2.0))
    >>> [round(fold.parameter * 27**0.5, 9) for fold in branch.folds], branch.ends
    ([2.0, -2.0], ('range', 'range'))
    """
    rates = rates_of(start.model)
    place = rates.place(parameter)
    low, high = span
    if not low <= start.p[place] <= high or not low < high:
        raise ArgumentError(
            f"{parameter} = {start.p[place]:g} of the start is not within [{low:g}, {high:g}]"
        )
    walk = Walk(rates, parameter, (low, high), start.p, largest)
    begin = np.append(start.x, start.p[place])
    tangent = walk.tangent(begin, None)
    if tangent[-1] < 0:
        tangent = -tangent
    points, folds, end = walk.go(begin, tangent, max_points)
    other = end
    if end != "closed":
        down, folds_down, other = walk.go(begin, -tangent, max_points)
        points, folds = [*down[:0:-1], *points], [*folds_down[::-1], *folds]
    y = np.array(points)
    y = y[np.append(True, np.any(np.diff(y, axis=0) != 0, axis=1))]
    p = np.tile(start.p, (len(y), 1))
    p[:, place] = y[:, -1]
    spectra = np.array([eigenvalues(matrix) for matrix in rates.slopes(y[:, :-1], p)])
    return Branch(
        start.model, parameter, y[:, -1], y[:, :-1], spectra, tuple(folds), (other, end), start.p
    )


class _Equations(Equations, Protocol):
    """Equations with named parameters."""

    def place(self, name: str) -> int:
        """Row of a parameter."""
        ...

    def slope_by(self, name: str) -> Callable[[np.ndarray, np.ndarray], Any]:
        """Derivative by a parameter, as a column; a function of unknowns and parameters."""
        ...


class Walk:
    """Steps along a branch of solutions in y = (x, parameter), in nominal sizes.

    `rates` are 0 on the branch; `parameter` stays within `span`, its entry in `p` is unused.
    `largest`: multiple of its nominal size at which an unknown diverges.
    """

    def __init__(
        self,
        rates: _Equations,
        parameter: str,
        span: tuple[float, float],
        p: np.ndarray,
        largest: float,
    ) -> None:
        self.rates, self.span, self.p = rates, span, p
        self.place, self.slope = rates.place(parameter), rates.slope_by(parameter)
        self.size = np.append(rates.nominal, span[1] - span[0])
        self.largest = largest

    def _linear(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates and their derivatives by y / size."""
        p, x = self.p.copy(), y[None, :-1]
        p[self.place] = y[-1]
        last = np.array(self.slope(x[0], p))
        return self.rates(x, p)[0], np.hstack([self.rates.slopes(x, p)[0], last]) * self.size

    def tangent(self, y: np.ndarray, along: np.ndarray | None) -> np.ndarray:
        """Unit tangent in y / size at `y` (n + 1,), on the side of `along` if given."""
        _, by_y = self._linear(y)
        if along is None:
            return np.linalg.svd(by_y)[2][-1]
        # regular at folds, and faster than all singular vectors
        matrix, last = np.vstack([by_y, along]), np.eye(len(along))[-1]
        try:
            found = np.linalg.solve(matrix, last)
        except np.linalg.LinAlgError:  # at crossings of branches
            found = np.linalg.svd(by_y)[2][-1]
            found = found if found @ along > 0 else -found
        return found / np.linalg.norm(found)

    def step(self, y: np.ndarray, tangent: np.ndarray, length: float) -> np.ndarray | None:
        """Point of the branch `length` nominal sizes along the tangent; None if none is near."""
        guess = y + length * tangent * self.size
        found = guess.copy()
        # Newton's method must not leave the neighbourhood of the step.
        far = 2 * max(self.largest, np.abs(guess / self.size).max())
        for _ in range(_STEPS):
            rates, by_y = self._linear(found)
            missing = np.append(rates, tangent @ ((found - guess) / self.size))
            matrix = np.vstack([by_y, tangent])
            if not (np.isfinite(matrix).all() and np.isfinite(missing).all()):
                return None
            try:
                change = np.linalg.solve(matrix, -missing)
            except np.linalg.LinAlgError:
                return None
            found = found + change * self.size
            reach = np.abs(found / self.size).max()
            if np.abs(change).max() < _CONVERGED * (1 + reach):
                return found
            if reach > far:
                return None
        return None

    def go(
        self,
        y: np.ndarray,
        tangent: np.ndarray,
        max_points: int,
        until: Callable[[np.ndarray, list[Fold]], bool] | None = None,
    ) -> tuple[list[np.ndarray], list[Fold], End]:
        """Walk until the branch ends; return its points, its folds, and the reason for its end.

        `until` gets every new point and the folds before it; True ends the walk as "stopped".
        """
        first, first_tangent = y, tangent
        points, folds, length = [y], [], 1e-2
        while len(points) < max_points:
            ahead = self.step(y, tangent, length)
            turned = None if ahead is None else self.tangent(ahead, tangent)
            if ahead is None or turned is None or turned @ tangent < math.cos(_TURN):
                length /= 2
                if length < _SHORTEST:
                    return points, folds, "lost"
                continue
            if not self.span[0] <= ahead[-1] <= self.span[1]:
                edge = self._edge(y, tangent, length)
                if edge is not None:
                    return [*points, edge], folds, "range"
                length /= 2
                if length < _SHORTEST:
                    return points, folds, "lost"
                continue
            if turned[-1] * tangent[-1] < 0:
                folds.append(self._fold(y, tangent, length))
                points.append(np.append(folds[-1].x, folds[-1].parameter))
            if self._passes(first, first_tangent, y, ahead) and len(points) > 2:
                return [*points, first], folds, "closed"
            y, tangent = ahead, turned
            points.append(y)
            if until is not None and until(y, folds):
                return points, folds, "stopped"
            if np.abs(y[:-1] / self.size[:-1]).max() > self.largest:
                return points, folds, "runaway"
            length = min(1.5 * length, 0.05 * (1 + np.abs(y / self.size).max()))
        return points, folds, "steps"

    def _edge(self, y: np.ndarray, tangent: np.ndarray, length: float) -> np.ndarray | None:
        """Point at which the branch leaves the span, by steps of the remaining length."""
        bound = self.span[0] if tangent[-1] < 0 else self.span[1]
        missing = np.inf
        for _ in range(_STEPS):
            missing = (bound - y[-1]) / (tangent[-1] * self.size[-1])
            ahead = self.step(y, tangent, min(missing, length))
            if ahead is None:
                return None
            y, tangent = ahead, self.tangent(ahead, tangent)
            missing = abs(y[-1] - bound) / self.size[-1]
            if missing < 1e-13:
                return np.append(y[:-1], bound)
        # only more exact steps would come nearer
        near = missing < _CONVERGED * (1 + np.abs(y / self.size).max())
        return np.append(y[:-1], bound) if near else None

    def _fold(self, y: np.ndarray, tangent: np.ndarray, length: float) -> Fold:
        """Point without tangent component along the parameter."""
        # Bisection, not a faster method: if another branch crosses, steps fail near the fold, and
        # the last point found is returned.
        before, after, at = 0.0, length, y
        for _ in range(_HALVINGS):
            ahead = self.step(y, tangent, (before + after) / 2)
            if ahead is None:
                break
            at = ahead
            if self.tangent(ahead, tangent)[-1] * tangent[-1] > 0:
                before = (before + after) / 2
            else:
                after = (before + after) / 2
        return Fold(float(at[-1]), at[:-1])

    def _passes(
        self, first: np.ndarray, tangent: np.ndarray, y: np.ndarray, ahead: np.ndarray
    ) -> bool:
        """Whether the step passes the first point in its direction."""
        before, after = ((point - first) / self.size for point in (y, ahead))
        length = np.linalg.norm(after - before)
        crosses = before @ tangent < 0 <= after @ tangent
        return bool(crosses and max(np.linalg.norm(before), np.linalg.norm(after)) < 1.5 * length)
