"""Derivatives of a steady state and its eigenvalues by parameters: the implicit function theorem.

0 = f(x, p) gives dx/dp = -f_x^-1 f_p wherever f_x is regular; a simple eigenvalue of f_x, with the
left vector w and the right vector v, changes by w' df_x v / (w' v).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from wormopt.analysis.steady import SteadyState
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model, pack
from wormopt.model.values import nominal_of
from wormopt.simulation.functions import System
from wormopt.simulation.options import Exact
from wormopt.simulation.variation import Sensitivities, directions

# If the ratio of the least to the largest singular value of the Jacobian is smaller, the state is
# no more accurate than its distance to the fold.
_SINGULAR = 1e-7
# Distance of simple eigenvalues, relative to the largest; cosine of the angle between left and
# right vector below which it is a Jordan block up to rounding.
_APART, _DEFECTIVE = 1e-7, 1e-7


@dataclass(frozen=True, eq=False)
class SteadySensitivity:
    """Derivatives of a steady state along directions of its parameters.

    Parameters
    ----------
    state : SteadyState
        Whose they are.
    directions : tuple of str
        Labels of the k columns.
    x : ndarray, shape (n_x, k)
        Derivatives of the state.
    eigenvalues : ndarray of complex, shape (n_x, k)
        Derivatives of ``state.eigenvalues``, in their order; NaN where an eigenvalue is not
        simple, which then has no derivative of its own.
    p : ndarray, shape (n_p, k)
        The directions, in ``state.p``.

    Examples
    --------
    x' = r - x^2 rests at x = sqrt(r), whose derivative at r = 4 is 1/4:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, r = ca.SX.sym("x"), ca.SX.sym("r")
    >>> states, numbers = [wo.Signal("x", x)], [wo.Signal("r", r, value=4.0)]
    >>> fold = wo.Model("fold", states, r - x**2, p=numbers)
    >>> found = wo.steady_sensitivity(wo.steady_states(fold, {"x": (0.0, 5.0)})[0])
    >>> found.directions, found.x.round(9)
    (('r',), array([[0.25]]))
    """

    state: SteadyState
    directions: tuple[str, ...]
    x: np.ndarray
    eigenvalues: NDArray[np.complex128]
    p: np.ndarray

    def derivative(self, name: str) -> np.ndarray:
        """Derivative of a state or an output of the model.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        ndarray, shape (size, k)

        Raises
        ------
        UnknownNameError
            If the model has no such signal.
        """
        model = self.state.model
        x, p = _symbols(model)
        slopes = [ca.densify(ca.jacobian(ca.vec(model[name]), symbol)) for symbol in (x, p)]
        by_x, by_p = ca.Function("slopes", [x, p], slopes)(self.state.x, self.state.p)
        return np.array(by_x) @ self.x + np.array(by_p) @ self.p


def _symbols(model: Model) -> tuple[ca.SX, ca.SX]:
    return pack(model.x), pack((*model.p, *model.u))


@lru_cache(maxsize=32)
def _derivatives(model: Model) -> tuple[ca.Function, ca.Function]:
    """Jacobians of the rates by state and parameters; change of the former along a direction."""
    x, p = _symbols(model)
    dx, dp = ca.SX.sym("dx", x.numel()), ca.SX.sym("dp", p.numel())
    by_x, by_p = (ca.densify(ca.jacobian(model.ode, symbol)) for symbol in (x, p))
    change = ca.jtimes(ca.vec(by_x), ca.vertcat(x, p), ca.vertcat(dx, dp))
    return (
        ca.Function("slopes", [x, p], [by_x, by_p]),
        ca.Function("change", [x, p, dx, dp], [ca.reshape(change, *by_x.shape)]),
    )


def steady_sensitivity(
    state: SteadyState, sensitivities: Sensitivities | None = None
) -> SteadySensitivity:
    """Differentiate a steady state and its eigenvalues by parameters and inputs.

    Parameters
    ----------
    state : SteadyState
        From `steady_states`, or `Branch.state`.
    sensitivities : sequence of str, or mapping of str to mapping, optional
        Names of parameters and inputs, of all their entries or of one ("mass", "mass[0]"); or
        directions by labels, {"all": {"mass": [1, 1]}}. All of the model's if left out.

    Returns
    -------
    SteadySensitivity

    Raises
    ------
    ArgumentError
        If a direction does not fit the model.
    UnknownNameError
        If the model has no such parameter or input.
    SolveError
        If the Jacobian is singular ("singular"), as at a fold: there is no derivative then.

    Examples
    --------
    x' = r - x^2 rests at x = sqrt(r) with the eigenvalue -2 sqrt(r); both change without bound
    towards the fold at r = 0:

    >>> from wormopt.analysis.steady import steady_states
    >>> from wormopt.model.model import Signal
    >>> x, r = ca.SX.sym("x"), ca.SX.sym("r")
    >>> fold = Model("fold", x=[Signal("x", x)], ode=r - x**2, p=[Signal("r", r, value=4.0)])
    >>> found = steady_sensitivity(steady_states(fold, {"x": (0.0, 5.0)})[0])
    >>> found.directions, found.derivative("x").round(12), found.eigenvalues.real.round(12)
    (('r',), array([[0.25]]), array([[-0.5]]))
    """
    model = state.model
    labels, columns = _columns(model, sensitivities)
    slopes, change = _derivatives(model)
    by_x, by_p = (np.array(slope) for slope in slopes(state.x, state.p))
    size = nominal_of(model.x)
    shares = np.linalg.svd(by_x * size / size[:, None], compute_uv=False)
    if not shares[-1] > _SINGULAR * shares[0]:
        raise SolveError(
            f"the steady state of {model.name} has no derivative: its Jacobian is singular, as at "
            "a fold or where branches cross",
            "move a parameter away from there",
            code="singular",
        )
    moved = -np.linalg.solve(by_x, by_p @ columns)
    changes = [
        np.array(change(state.x, state.p, dx, dp))
        for dx, dp in zip(moved.T, columns.T, strict=True)
    ]
    return SteadySensitivity(state, labels, moved, _eigenvalues(state, by_x, changes), columns)


def _columns(
    model: Model, sensitivities: Sensitivities | None
) -> tuple[tuple[str, ...], np.ndarray]:
    """Labels and columns (n_p, k) of directions in parameters and inputs."""
    signals = (*model.p, *model.u)
    asked = [signal.name for signal in signals] if sensitivities is None else sensitivities
    along = directions(System(model, Exact()), (), asked)
    if along is None:
        return (), np.zeros((pack(signals).numel(), 0))
    if np.any(along.x0):
        raise ArgumentError(
            f"a steady state of {model.name} does not depend on where states start; take "
            "directions of parameters and inputs"
        )
    return along.labels, along.p[: pack(signals).numel()]


def _eigenvalues(
    state: SteadyState, matrix: np.ndarray, changes: list[np.ndarray]
) -> NDArray[np.complex128]:
    """Derivatives of simple eigenvalues along changes of their matrix; NaN for the others."""
    vectors: Any = eig(matrix, left=True, right=True)  # its type depends on the arguments
    values, left, right = vectors
    scale = np.abs(values).max()
    found = np.full((len(values), len(changes)), np.nan, dtype=complex)
    for row, known in enumerate(state.eigenvalues):
        i = int(np.argmin(np.abs(values - known)))
        away = np.abs(np.delete(values, i) - values[i]).min(initial=np.inf)
        w, v = left[:, i].conj(), right[:, i]
        if away > _APART * scale and abs(w @ v) > _DEFECTIVE:
            found[row] = [w @ changed @ v / (w @ v) for changed in changes]
    return found
