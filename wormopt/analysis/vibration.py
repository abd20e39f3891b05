"""Small free vibrations of a Model about a state at rest: natural frequencies and their shapes.

The elastic energy's second derivatives by the places are the stiffness K, the kinetic energy's by
the rates the mass M; frequencies are square roots of the eigenvalues of K s = w² M s. Neither
damping nor loads nor friction take part: what a wall does is told by coordinates that are held.

Source: L. Meirovitch, Fundamentals of Vibrations (2001), chapter 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.model import Model, Signal, pack
from wormopt.model.values import by_name, check_names, signal_values

# Eigenvalues below so many roundings of the largest one are those of rigid motions.
_ROUNDINGS = 100.0


@dataclass(frozen=True, eq=False)
class VibrationModes:
    """Natural vibrations, slow ones first.

    Parameters
    ----------
    frequencies : ndarray, shape (count,)
        In Hz if the model is in SI units; 0 of motions that nothing resists, or so little that
        rounding hides it.
    shapes : dict of str to ndarray, shape (size, count)
        By the names of the places; one column per frequency, of unit modal mass.
    residual : float
        Largest |K s - w² M s| over the size of K and s, of all of them.
    rounding : float
        Frequency below which rounding hides everything. One of f may be off by a share of
        (rounding / f)²: slender bodies, far stiffer along than across, ask for that look.
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
    """Find the slowest natural vibrations.

    Parameters
    ----------
    model : Model
        Its states are places and then their rates; its outputs ``strain_energy`` and
        ``kinetic_energy`` say how it resists and how heavy it is.
    held : mapping of str to sequence of int, optional
        Which entries of which places do not move: of a rod ``{"across": [0, -1]}`` pins both ends.
    x0 : mapping of str to array_like, optional
        State about which it vibrates, where it is not the model's own; at rest, and such that no
        elastic force is left but on what is held.
    p : mapping of str to array_like, optional
        Parameters by name, where they are not the model's own.
    count : int, optional
        How many; fewer if there are fewer.
    rigid : int, optional
        How many motions nothing resists, where that is known: of a free rod in the plane 3. Then
        vibrations that rounding hides among them are refused.

    Returns
    -------
    VibrationModes

    Raises
    ------
    ArgumentError
        If the states are not places and rates, something held does not exist, a place has no mass,
        or the state is not a stable one.
    UnknownNameError
        If the model has no such outputs.
    SolveError
        If more motions than `rigid` are not told from rest ("hidden").

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
    K, M = (matrix[np.ix_(free, free)] for matrix in _matrices(model, x0, p))
    if not np.all(np.isfinite(K)) or not np.all(np.isfinite(M)):
        raise ArgumentError(f"{model.name}: the energies have no second derivatives at this state")
    try:
        squares, vectors = scipy.linalg.eigh(K, M)
    except np.linalg.LinAlgError:
        raise ArgumentError(f"{model.name}: some places have no mass of their own") from None
    smallest = _ROUNDINGS * np.finfo(float).eps * np.abs(squares).max()
    if squares[0] < -smallest:
        raise ArgumentError(f"{model.name} is not stable at this state: it would buckle")
    rounding = float(np.sqrt(smallest)) / (2 * np.pi)
    if rigid is not None and np.sum(squares <= smallest) > rigid:
        raise SolveError(
            f"{model.name}: rounding hides the slowest vibrations, those below {rounding:.3g}, "
            f"among the {rigid} motions that nothing resists",
            "take a less slender body, or fewer elements",
            code="hidden",
        )
    squares, vectors = squares[:count], vectors[:, :count]
    squares = np.where(np.abs(squares) <= smallest, 0.0, squares)
    shapes = np.zeros((sum(s.size for s in places), len(squares)))
    shapes[free] = vectors
    residual = _residual(K, M, squares, vectors)
    found = np.sqrt(squares) / (2 * np.pi)
    return VibrationModes(found, by_name(places, shapes), residual, rounding)


def _free(places: Sequence[Signal], held: Mapping[str, Sequence[int]]) -> np.ndarray:
    """Numbers of the coordinates that are not held."""
    check_names(held, [s.name for s in places], "place")
    columns = by_name(places, np.arange(sum(s.size for s in places)))
    fixed: list[int] = []
    for name, entries in held.items():
        size = len(columns[name])
        if not all(-size <= entry < size for entry in entries):
            raise ArgumentError(f"{name} has {size} entries; {list(entries)} are not among them")
        fixed.extend(columns[name][list(entries)].tolist())
    free = np.setdiff1d(np.concatenate(list(columns.values())), fixed)
    if not len(free):
        raise ArgumentError("all places are held: nothing vibrates")
    return free


def _matrices(
    model: Model, x0: Mapping[str, ArrayLike] | None, p: Mapping[str, ArrayLike] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass."""
    x, half = pack(model.x), model.n_x // 2
    stiffness = ca.hessian(model["strain_energy"], x[:half])[0]
    mass = ca.hessian(model["kinetic_energy"], x[half:])[0]
    both = [ca.densify(stiffness), ca.densify(mass)]
    function = ca.Function("matrices", [x, pack(model.p)], both)
    state = signal_values(model.x, x0, "state", fill=0.0)
    K, M = (np.array(part) for part in function(state, signal_values(model.p, p, "parameter")))
    return K, M


def _residual(K: np.ndarray, M: np.ndarray, squares: np.ndarray, vectors: np.ndarray) -> float:
    """How well eigenvalues and their vectors fit the matrices."""
    apart = np.linalg.norm(K @ vectors - (M @ vectors) * squares, axis=0)
    size = np.linalg.norm(K, 2) * np.linalg.norm(vectors, axis=0)
    return float((apart / np.where(size > 0, size, 1.0)).max())
