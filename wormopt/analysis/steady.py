"""Steady states of an autonomous Model in a box: their stability, and derivatives by parameters.

By the implicit function theorem, 0 = f(x, p) gives dx/dp = -f_x^-1 f_p wherever f_x is regular; a
simple eigenvalue of f_x, with the left vector w and the right vector v, changes by
w' df_x v / (w' v).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wormopt.errors import ArgumentError, SolveError
from wormopt.lazy import on_use
from wormopt.model.model import Model, pack
from wormopt.model.values import by_name, check_names, nominal_of, signal_values
from wormopt.numerics.newton import newton
from wormopt.simulation.functions import System
from wormopt.simulation.options import Exact
from wormopt.simulation.variation import Sensitivities, directions

with on_use():  # slow to import, and most states need no derivatives of eigenvalues
    from scipy.linalg import eig

Values = Mapping[str, ArrayLike]

_SCALES = np.array([1.0, 0.25, 0.0625])  # of the boxes of starts
ZERO = 1e-10  # relative eigenvalue that is 0
_EQUAL = 1e-6  # states that differ by less are equal


@dataclass(frozen=True, eq=False)
class SteadyState:
    """A steady state, and the motion near it.

    Parameters
    ----------
    model : Model
        Model of the steady state.
    x : ndarray, shape (n_x,)
        State.
    residual : float
        Largest remaining rate, relative to the nominal size of its state.
    eigenvalues : ndarray of complex, shape (n_x,)
        Eigenvalues of the Jacobian of the rates, largest real part first.
    p : ndarray
        Parameters and inputs of the steady state.

    Examples
    --------
    x' = x - x^3 rests at -1, 0 and 1; near 1 deviations decay at the rate 2:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x = ca.SX.sym("x")
    >>> pitchfork = wo.Model("pitchfork", [wo.Signal("x", x)], x - x**3)
    >>> last = wo.steady_states(pitchfork, {"x": (-2, 2)})[-1]
    >>> last.x.round(9), last.eigenvalues.real.round(9), last.stable
    (array([1.]), array([-2.]), True)
    """

    model: Model
    x: np.ndarray
    residual: float
    eigenvalues: NDArray[np.complex128]
    p: np.ndarray

    @property
    def stable(self) -> bool:
        """Whether nearby states converge to it: real parts are below 0 by more than round-off."""
        return bool(self.eigenvalues[0].real < -ZERO * np.abs(self.eigenvalues).max())

    @property
    def states(self) -> dict[str, np.ndarray]:
        """States by name."""
        return by_name(self.model.x, self.x)

    def __getitem__(self, name: str) -> np.ndarray:
        """Value (size,) of a state or an output of the model; UnknownNameError if there is none."""
        fixed = ca.vertcat(pack(self.model.p), pack(self.model.u))
        at = ca.Function(name, [pack(self.model.x), fixed], [self.model[name]])
        return np.array(at(self.x, self.p)).ravel()


class Rates:
    """Rates of an autonomous Model and their derivatives, many states at a time.

    Raises ArgumentError for contacts, schedules, switches, algebraic variables or time.
    """

    def __init__(self, model: Model) -> None:
        model.refuse_delays("the search for steady states")
        if model.contacts or model.schedules or model.switches or model.z:
            raise ArgumentError(
                f"{model.name} has contacts, schedules, switches or algebraic variables; steady "
                "states are those of an autonomous model: average it first"
            )
        if ca.depends_on(model.ode, model.t):
            raise ArgumentError(f"{model.name} depends on time; average it first")
        self.model = model
        self.nominal = nominal_of(model.x)
        self._fixed = (*model.p, *model.u)
        self._symbols = [pack(model.x), pack(self._fixed)]
        self._rates = ca.Function("rates", self._symbols, [model.ode])
        slopes = ca.densify(ca.jacobian(model.ode, self._symbols[0]))
        self._slopes = ca.Function("slopes", self._symbols, [slopes])

    def parameters(self, given: Values | None) -> np.ndarray:
        """Stack parameters and inputs: the given ones, else the model's own."""
        return signal_values(self._fixed, given, "parameter")

    def place(self, name: str) -> int:
        """Row of a scalar parameter in the result of `parameters`.

        Raises ArgumentError if it is not scalar, UnknownNameError if there is none.
        """
        names = [signal.name for signal in self._fixed]
        check_names({name: 0}, names, "parameter")
        sizes = [signal.size for signal in self._fixed]
        which = names.index(name)
        if sizes[which] != 1:
            raise ArgumentError(f"{name} has {sizes[which]} entries; name a parameter with one")
        return sum(sizes[:which])

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Rates (m, n_x) at m states `x` (m, n_x); `p` is (n_p,) for all, or (m, n_p)."""
        return np.array(self._rates(x.T, _each(p, x).T)).T

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Jacobians (m, n_x, n_x) at m states `x` (m, n_x); `p` is (n_p,) or (m, n_p)."""
        m, n = x.shape
        if m == 0:
            return np.zeros((0, n, n))
        found = np.array(self._slopes(x.T, _each(p, x).T))
        return found.reshape(n, m, n).transpose(1, 0, 2)

    def slope_by(self, name: str) -> ca.Function:
        """Derivative of the rates by a scalar parameter, as (x, p) -> column."""
        symbol = self._symbols[1][self.place(name)]
        slope = ca.densify(ca.jacobian(self.model.ode, symbol))
        return ca.Function("slope", self._symbols, [slope])

    def steady(self, x: np.ndarray, p: np.ndarray) -> SteadyState:
        """Describe the steady state `x` (n_x,) at the parameters `p` (n_p,)."""
        residual = float(np.abs(self(x[None], p) / self.nominal).max())
        return SteadyState(self.model, x, residual, eigenvalues(self.slopes(x[None], p)[0]), p)


def _each(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.broadcast_to(p, (len(x), p.shape[-1]))


def eigenvalues(matrix: np.ndarray) -> NDArray[np.complex128]:
    """Eigenvalues (n,) of a Jacobian (n, n), that with the largest real part first."""
    found: NDArray[np.complex128] = np.linalg.eigvals(matrix).astype(complex)
    return found[np.lexsort((-found.imag, -found.real))]


@lru_cache(maxsize=32)
def rates_of(model: Model) -> Rates:
    """Rates of an autonomous model, cached."""
    return Rates(model)


def steady_states(
    model: Model,
    within: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    p: Values | None = None,
    starts: int = 150,
) -> tuple[SteadyState, ...]:
    """Find the steady states of an autonomous model in a box.

    Newton's method starts from many points that fill the box evenly, and smaller boxes around its
    middle (R_d sequence of M. Roberts, 2018). All results are steady states, but completeness is
    not proven. `continue_branch` finds other states that are connected to them.

    Parameters
    ----------
    model : Model
        From `average`, say.
    within : mapping of str to (array_like, array_like)
        Least and largest value of every state, by name.
    p : mapping of str to array_like, optional
        Parameters and inputs, where they are not the model's own.
    starts : int, optional
        Number of points.

    Returns
    -------
    tuple of SteadyState
        Each once, ordered by their states.

    Raises
    ------
    ArgumentError
        If the model is not autonomous, a state has no range or one that is upside down, or a state
        changes no rate, so that no steady state is isolated.

    Examples
    --------
    A pitchfork has three, of which the outer ones are stable:

    >>> from wormopt.model.model import Signal
    >>> x = ca.SX.sym("x")
    >>> pitchfork = Model("pitchfork", x=[Signal("x", x)], ode=x - x**3)
    >>> [(s.x.round(9).tolist(), s.stable) for s in steady_states(pitchfork, {"x": (-2, 2)})]
    [([-1.0], True), ([0.0], False), ([1.0], True)]
    """
    rates = rates_of(model)
    low, high = _box(model, within)
    fixed = rates.parameters(p)
    if not isinstance(starts, Integral) or starts < 1:
        raise ArgumentError(f"starts must be a whole number, 1 or above, not {starts!r}")
    _check_alone(rates, low + (high - low) * _even(5, len(low)), fixed)
    shrunk = 0.5 + (_even(starts, len(low)) - 0.5) * _SCALES[np.arange(starts) % 3, None]
    ended, found = newton(rates, low + (high - low) * shrunk, fixed)
    inside = found & np.all((low <= ended) & (ended <= high), axis=1)
    kept: list[np.ndarray] = []
    for x in ended[inside]:
        if all(np.abs((x - other) / rates.nominal).max() > _EQUAL for other in kept):
            kept.append(x)
    kept.sort(key=lambda x: tuple(np.round(x / rates.nominal, 6)))
    return tuple(rates.steady(x, fixed) for x in kept)


def _box(
    model: Model, within: Mapping[str, tuple[ArrayLike, ArrayLike]]
) -> tuple[np.ndarray, np.ndarray]:
    check_names(within, [s.name for s in model.x], "state")
    missing = [s.name for s in model.x if s.name not in within]
    if missing:
        raise ArgumentError(f"write the range of {', '.join(missing)} as (smallest, largest)")
    sides = []
    for side in (0, 1):
        given = {name: bounds[side] for name, bounds in within.items()}
        sides.append(signal_values(model.x, given, "range of"))
    if not np.all(np.isfinite(sides)) or not np.all(sides[0] < sides[1]):
        raise ArgumentError("every range must be finite, with the smaller number first")
    return sides[0], sides[1]


def _check_alone(rates: Rates, x: np.ndarray, p: np.ndarray) -> None:
    """Refuse models in which a state changes no rate: steady states are then lines."""
    slopes = np.abs(rates.slopes(x, p)).max(axis=(0, 1))
    names = [s.name for s in rates.model.x for _ in range(s.size)]
    cyclic = sorted({name for name, slope in zip(names, slopes, strict=True) if slope == 0})
    if cyclic:
        raise ArgumentError(
            f"{', '.join(cyclic)} has no effect on rates of {rates.model.name}, so no steady "
            "state is isolated; leave it out of the model"
        )


def _even(count: int, dimension: int) -> np.ndarray:
    """Points that fill the unit cube evenly, shape (count, dimension)."""
    root = 2.0
    for _ in range(60):  # of x^(d + 1) = x + 1
        root = (1 + root) ** (1 / (dimension + 1))
    steps = root ** -np.arange(1.0, dimension + 1)
    return (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0


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
        The steady state.
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
        """Derivative (size, k) of a state or an output of the model.

        Parameters
        ----------
        name : str
            Its name.

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
            "change a parameter",
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
            f"a steady state of {model.name} does not depend on initial states; name "
            "parameters and inputs"
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
