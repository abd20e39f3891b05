"""Small free vibrations of a Model about a state at rest: natural frequencies and modes.

Stiffness K and mass M are second derivatives of the elastic energy by the places and of the
kinetic energy by the rates; frequencies are square roots of the eigenvalues of K s = w² M s.
Damping, loads and friction are ignored; held coordinates represent walls.

With many places, matrices are sparse and few vibrations are requested: these are computed by
Lanczos' method of (K + shift M)^-1 M, and counted by the signs of pivots.

Sources: L. Meirovitch, Fundamentals of Vibrations (2001), chapter 7; R. G. Grimes, J. G. Lewis and
H. D. Simon, SIAM J. Matrix Anal. Appl. 15 (1994) 228 for the shift and the count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from scipy.sparse import csc_array
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model, Signal, pack
from wormopt.model.values import by_name, check_names, signal_values

# Eigenvalues below this many roundings of the largest one are those of rigid motions.
_ROUNDINGS = 100.0
# Up to this many places, and for a larger share of all vibrations, dense matrices are faster.
_DENSE, _FEW = 150, 0.1
# Stiffness and mass of models that are still in use.
_built: WeakKeyDictionary[Model, ca.Function] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class VibrationModes:
    """Natural vibrations, the slowest first.

    Parameters
    ----------
    frequencies : ndarray, shape (count,)
        In Hz if the model is in SI units; 0 for rigid-body motions and for stiffness below
        rounding.
    shapes : dict of str to ndarray, shape (size, count)
        By the names of the positions; one column per frequency, of unit modal mass.
    residual : float
        Largest |K s - w² M s| over the size of K and s, of all of them.
    rounding : float
        Frequency below which rounding errors dominate. The relative error of a frequency f may be
        (rounding / f)², which matters for slender bodies.

    Examples
    --------
    A mass of 1 on a spring of (2 pi)^2 swings once a second:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> q, v = ca.SX.sym("q"), ca.SX.sym("v")
    >>> energies = [
    ...     wo.Output("strain_energy", 2 * ca.pi**2 * q**2), wo.Output("kinetic_energy", v**2 / 2)
    ... ]
    >>> states = [wo.Signal("place", q, value=0.0), wo.Signal("rate", v, value=0.0)]
    >>> swing = wo.Model("swing", states, ca.vertcat(v, -4 * ca.pi**2 * q), outputs=energies)
    >>> wo.vibration_modes(swing).frequencies.round(9)
    array([1.])
    """

    frequencies: np.ndarray
    shapes: dict[str, np.ndarray]
    residual: float
    rounding: float


def vibration_modes(
    model: Model,
    held: Mapping[str, Sequence[int]] | None = None,
    *,
    x0: Mapping[str, ArrayLike] | None = None,
    p: Mapping[str, ArrayLike] | None = None,
    count: int = 8,
    rigid: int | None = None,
) -> VibrationModes:
    """Find the slowest natural vibrations of a model about a state of rest.

    Parameters
    ----------
    model : Model
        Its states are positions and then their rates; its outputs ``strain_energy`` and
        ``kinetic_energy`` give stiffness and mass.
    held : mapping of str to sequence of int, optional
        Entries of positions that are held, by name: for a rod ``{"across": [0, -1]}`` pins both
        ends.
    x0 : mapping of str to array_like, optional
        State about which it vibrates, if not that of the model. It is at rest, and elastic forces
        act only on held entries.
    p : mapping of str to array_like, optional
        Parameters by name, where they are not the model's own.
    count : int, optional
        Number of modes; fewer if the model has fewer.
    rigid : int, optional
        Number of rigid-body motions, if known: 3 for a free rod in the plane. Then
        vibrations that rounding hides among them are refused.

    Returns
    -------
    VibrationModes

    Raises
    ------
    ArgumentError
        If the states are not positions and rates, a held entry does not exist, a position has no
        mass, or the state is not stable.
    UnknownNameError
        If the model has no such outputs.
    SolveError
        If more motions than `rigid` cannot be distinguished from rest ("hidden").

    Examples
    --------
    Two equal masses on a spring; on free ground they may also move on together:

    >>> q, v = ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    >>> pull = 2 * np.pi**2 * (q[0] - q[1])
    >>> from wormopt.model.model import Output
    >>> energies = Output("strain_energy", np.pi**2 * (q[0] - q[1]) ** 2)
    >>> energies = [energies, Output("kinetic_energy", ca.dot(v, v) / 2)]
    >>> states = [Signal("place", q, value=0.0), Signal("rate", v, value=0.0)]
    >>> pair = Model("pair", states, ca.vertcat(v, -pull, pull), outputs=energies)
    >>> vibration_modes(pair).frequencies.round(12)
    array([0., 1.])
    >>> vibration_modes(pair, {"place": [0]}).frequencies.round(6)
    array([0.707107])
    """
    places = model.places()
    free = _free(places, held or {})
    if count < 1:
        raise ArgumentError(f"count must be at least 1, not {count}")
    K, M = (matrix[free][:, free] for matrix in _matrices(model, x0, p))
    if not np.all(np.isfinite(K.data)) or not np.all(np.isfinite(M.data)):
        raise ArgumentError(f"{model.name}: the energies have no second derivatives at this state")
    found = _few(K, M, max(count, rigid or 0)) or _all(K, M, model.name)
    _check_found(found, rigid, model.name)
    squares, vectors = found.squares[:count], found.vectors[:, :count]
    squares = np.where(np.abs(squares) <= found.smallest, 0.0, squares)
    shapes = np.zeros((sum(s.size for s in places), len(squares)))
    shapes[free] = vectors
    residual = _residual(K, M, squares, vectors)
    frequencies = np.sqrt(squares) / (2 * np.pi)
    return VibrationModes(frequencies, by_name(places, shapes), residual, found.rounding)


def _check_found(found: _Pairs, rigid: int | None, name: str) -> None:
    """Refuse unstable states, and vibrations hidden by rounding."""
    if found.squares[0] < -found.smallest:
        raise ArgumentError(f"{name} is unstable at this state: it buckles")
    if rigid is not None and np.sum(found.squares <= found.smallest) > rigid:
        raise SolveError(
            f"{name}: rounding hides the slowest vibrations, those below {found.rounding:.3g}, "
            f"among the {rigid} rigid-body motions",
            "use a less slender body, or fewer elements",
            code="hidden",
        )


def _free(places: Sequence[Signal], held: Mapping[str, Sequence[int]]) -> np.ndarray:
    """Indices of the coordinates that are not held."""
    check_names(held, [s.name for s in places], "place")
    columns = by_name(places, np.arange(sum(s.size for s in places)))
    fixed: list[int] = []
    for name, entries in held.items():
        size = len(columns[name])
        if lost := [entry for entry in entries if not -size <= entry < size]:
            raise ArgumentError(f"{name} has {size} entries; there are no {lost}")
        fixed.extend(columns[name][list(entries)].tolist())
    free = np.setdiff1d(np.concatenate(list(columns.values())), fixed)
    if not len(free):
        raise ArgumentError("all coordinates are held; leave at least one free")
    return free


def _matrices(
    model: Model, x0: Mapping[str, ArrayLike] | None, p: Mapping[str, ArrayLike] | None
) -> tuple[csc_array, csc_array]:
    """Stiffness and mass."""
    function = _built.get(model)
    if function is None:
        x, half = pack(model.x), model.n_x // 2
        stiffness = ca.hessian(model["strain_energy"], x[:half])[0]
        mass = ca.hessian(model["kinetic_energy"], x[half:])[0]
        function = ca.Function("matrices", [x, pack(model.p)], [stiffness, mass])
        _built[model] = function
    state = signal_values(model.x, x0, "state", fill=0.0)
    K, M = function(state, signal_values(model.p, p, "parameter"))
    return csc_array(K.sparse()), csc_array(M.sparse())


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Least eigenvalues, ascending, their vectors, and the size of rounding."""

    squares: np.ndarray
    vectors: np.ndarray
    smallest: float

    @property
    def rounding(self) -> float:
        """Frequency of this rounding."""
        return float(np.sqrt(self.smallest)) / (2 * np.pi)


def _all(K: csc_array, M: csc_array, name: str) -> _Pairs:
    try:
        squares, vectors = scipy.linalg.eigh(K.toarray(), M.toarray())
    except np.linalg.LinAlgError:
        raise ArgumentError(f"{name}: some coordinates have no mass") from None
    return _Pairs(squares, vectors, _rounded(np.abs(squares).max()))


def _few(K: csc_array, M: csc_array, count: int) -> _Pairs | None:
    """The `count` least eigenvalues; None if another method is better or some may be missing."""
    # A shift far below the wanted ones costs accuracy, one far above them iterations: it is set to
    # the middle of those that are no rigid motions, which is estimated first.
    n = K.indptr.size - 1
    if n <= _DENSE or count > _FEW * n:
        return None
    begin = np.random.default_rng(0).standard_normal(n)
    look: Any = partial(eigsh, v0=begin)
    operator: Any = LinearOperator
    try:
        unweigh = operator((n, n), splu(M).solve, dtype=float)
        top = look(K, 1, M, Minv=unweigh, tol=1e-3, return_eigenvectors=False)
        smallest = _rounded(abs(float(top[0])))
        if _negative(M) or _negative(K + smallest * M):
            return None
        rough = look(K, count, M, -smallest, tol=1e-2, return_eigenvectors=False)
        shift = float(np.median(rough[rough > smallest])) if rough.max() > smallest else smallest
        squares, vectors = look(K, count + 1, M, -shift)
        order = np.argsort(squares)
        found = _Pairs(squares[order], vectors[:, order], smallest)
        return found if _complete(found, K, M) else None
    except (RuntimeError, np.linalg.LinAlgError):  # ARPACK's errors are of the first kind
        return None


def _complete(found: _Pairs, K: csc_array, M: csc_array) -> bool:
    """Whether no others are below the last gap: Lanczos' method may miss multiple ones."""
    squares = found.squares
    wide = np.flatnonzero(np.diff(squares) > max(1e-9 * squares[-1], found.smallest))
    if not len(wide):
        return False
    below = wide[-1] + 1
    return _negative(K - squares[below - 1 : below + 1].mean() * M) == below


def _negative(matrix: csc_array) -> int:
    """Number of negative eigenvalues: that of negative pivots, by Sylvester's law of inertia."""
    options = {"SymmetricMode": True}
    found = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    if not np.array_equal(found.perm_r, found.perm_c):
        raise np.linalg.LinAlgError("pivots off the diagonal")
    return int(np.sum(found.U.diagonal() < 0))


def _rounded(largest: float) -> float:
    """Size of an eigenvalue that is rounding."""
    return _ROUNDINGS * np.finfo(float).eps * largest


def _residual(K: csc_array, M: csc_array, squares: np.ndarray, vectors: np.ndarray) -> float:
    apart = np.linalg.norm(K @ vectors - (M @ vectors) * squares, axis=0)
    size = abs(K).sum(axis=0).max() * np.linalg.norm(vectors, axis=0)
    return float((apart / np.where(size > 0, size, 1.0)).max())
