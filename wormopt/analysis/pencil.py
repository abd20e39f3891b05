"""Invariant zeros of x' = A x + B u, y = C x + D u: points s where the pencil loses rank.

The pencil is [[A - s I, B], [C, D]] (Rosenbrock). As a generalised eigenvalue problem it has
infinite eigenvalues in blocks, which rounding turns into large finite ones. They are removed
first, by orthogonal transformations and rank decisions [1]_; this works for any number of inputs
and outputs, including redundant ones.

References
----------
.. [1] A. Emami-Naeini and P. Van Dooren, "Computation of zeros of linear multivariable systems",
   Automatica 18 (1982) 415-430.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A (n, n), B (n, m), C (p, n) and D (p, m)."""


# Tolerance of rank decisions, in rounding errors of whole matrices. It allows for entries with own
# rounding errors: 10 is too small for four states mixed by a matrix of condition 100, 1000 loses
# weak couplings of a chain.
_ROUNDINGS = 100.0


@dataclass(frozen=True)
class _Rank:
    """Singular values up to ``least`` are zero."""

    least: float

    @classmethod
    def of(cls, matrices: Matrices) -> _Rank:
        return cls(_ROUNDINGS * _rounding(matrices))

    def split(self, matrix: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Rank, left and right singular vectors; those of the null spaces are last."""
        rows, columns = matrix.shape
        if matrix.size == 0:
            return 0, np.eye(rows), np.eye(columns)
        left, values, right = scipy.linalg.svd(matrix)
        return int(np.sum(values > self.least)), left, right.T


def _rounding(matrices: Matrices) -> float:
    """Rounding error of a zero in matrices of this size."""
    a, b, c, d = matrices
    whole = np.block([[a, b], [c, d]])
    return max(*whole.shape, 1) * np.finfo(float).eps * float(np.linalg.norm(whole))


def balanced(matrices: Matrices) -> Matrices:
    """Scale states, inputs and outputs by powers of 2 to similar sizes; zeros stay."""
    a, b, c, d = matrices
    n, size = len(a), len(a) + max(b.shape[1], c.shape[0])
    square = np.zeros((size, size))
    square[:n, :n], square[:n, n : n + b.shape[1]] = a, b
    square[n : n + len(c), :n], square[n : n + len(c), n : n + b.shape[1]] = c, d
    if size == 0:
        return matrices
    even = np.asarray(scipy.linalg.matrix_balance(square, permute=False)[0])
    rows, columns = slice(n, n + len(c)), slice(n, n + b.shape[1])
    return even[:n, :n], even[:n, columns], even[rows, :n], even[rows, columns]


def without_shifts(matrices: Matrices) -> tuple[Matrices, int]:
    """Remove, and count, the shifts: directions of states changing neither rates nor outputs.

    A shift, such as a worm's position, is a pole and a zero at 0 that cancel.
    Their number is the dimension of the common null space of A and C.
    """
    a, b, c, d = matrices
    # stricter than for zeros: a weakly damped motion must not pass for a shift
    rank, _, right = _Rank(_rounding(matrices)).split(np.vstack([a, c]))
    keep = right[:, :rank]
    return (keep.T @ a @ keep, keep.T @ b, c @ keep, d), len(a) - rank


def _row_full(matrices: Matrices, rank: _Rank) -> Matrices:
    """Equivalent system whose D has full row rank: outputs of higher relative degree drop out.

    An output without feed-through must stay zero, which constrains states; its rate must be 0 too,
    and is an output of the reduced system. Each round removes one order of infinite zeros.
    """
    a, b, c, d = matrices
    while True:
        through, left, _ = rank.split(d)
        d, c = (left.T @ d)[:through], left.T @ c
        c, silent = c[:through], c[through:]
        tied, _, right = rank.split(silent)
        if tied == 0:
            return a, b, c, d
        bound, free = right[:, :tied], right[:, tied:]
        d = np.vstack([bound.T @ b, d])
        c = np.vstack([bound.T @ a @ free, c @ free])
        a, b = free.T @ a @ free, free.T @ b


def _dual(matrices: Matrices) -> Matrices:
    a, b, c, d = matrices
    return a.T, c.T, b.T, d.T


def invariant_zeros(matrices: Matrices) -> tuple[NDArray[np.complex128], np.ndarray]:
    """Find the finite invariant zeros (k,), and bounds of their rounding errors (k,).

    They are the transmission zeros and the hidden modes (uncontrollable or unobservable).
    Sorted by real, then imaginary part; bounds are first-order. Apply `balanced` first.
    """
    rounding, rank = _rounding(matrices), _Rank.of(matrices)
    a, b, c, d = _dual(_row_full(_dual(_row_full(matrices, rank)), rank))
    n = len(a)
    if n == 0:
        return np.zeros(0, dtype=complex), np.zeros(0)
    # D is square and regular now: n numbers parametrise the null space of [C, D]
    kernel = np.linalg.qr(np.hstack([c, d]).T, mode="complete")[0][:, len(d) :]
    stiff, mass = np.hstack([a, b]) @ kernel, kernel[:n]
    found: Any = scipy.linalg.eig(stiff, mass, left=True, right=True)
    zeros, left, right = found
    weight = np.abs(np.sum(left.conj() * (mass @ right), axis=0))
    norms = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=0)
    with np.errstate(divide="ignore"):
        uncertainty = norms / weight * (rounding + np.abs(zeros) * n * np.finfo(float).eps)
    order = np.lexsort((zeros.imag, zeros.real))
    return zeros[order].astype(complex), uncertainty[order]
