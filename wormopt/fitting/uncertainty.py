"""Covariances from a Jacobian, infinite along unidentifiable directions."""

from __future__ import annotations

import numpy as np

# Relative singular values that are errors of a Jacobian of unknown error: motions are simulated to
# 1e-8 and their derivatives slightly less accurately.
TOLD = 1e-7
_BLOCK = 256  # rows of a matrix processed at once
# Shares of an unknown in unidentifiable directions that are round-off, and that never are.
_ROUND, _SURELY = 1e-9, 0.1


def triangle(matrix: np.ndarray) -> np.ndarray:
    """R (n, n) of the QR decomposition of a matrix (rows, n), block by block.

    Threads of a linear algebra library slow each other down on tall thin matrices.
    """
    n = matrix.shape[1]
    block = max(_BLOCK, 4 * n)
    while len(matrix) > block:
        whole = np.vstack([matrix, np.zeros((-len(matrix) % block, n))])
        matrix = np.asarray(np.linalg.qr(whole.reshape(-1, block, n), mode="r")).reshape(-1, n)
    return np.asarray(np.linalg.qr(np.vstack([matrix, np.zeros((n, n))]), mode="r"))


def spectrum(jacobian: np.ndarray, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values (n,) and right singular vectors (n, n) of jacobian * nominal."""
    _, s, rows = np.linalg.svd(triangle(jacobian * nominal))
    return s, rows.T


def identified_by(
    spectrum: tuple[np.ndarray, np.ndarray], error: float | None = None
) -> tuple[int, np.ndarray, np.ndarray]:
    """Number of identifiable singular values, with errors up to `error`, and unknowns.

    Also returns the standard error of each unknown from identifiable directions, and the unknowns
    that take part in the others: with a larger share than the error mixes in (Wedin).
    """
    s, v = spectrum
    error = TOLD * float(s.max(initial=0.0)) if error is None else error
    rank = int(np.sum(s > error))
    errors = np.linalg.norm(v[:, :rank] / s[:rank], axis=1)
    shares = np.linalg.norm(v[:, rank:], axis=1)
    return rank, errors, shares > np.clip(error * errors, _ROUND, _SURELY)


def _parts(
    spectrum: tuple[np.ndarray, np.ndarray], error: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Finite part of the scaled covariance, and the projector on unidentifiable directions."""
    s, v = spectrum
    rank, _, lost = identified_by(spectrum, error)
    finite = (v[:, :rank] / s[:rank] ** 2) @ v[:, :rank].T
    open_ = v[:, rank:] @ v[:, rank:].T
    apart = np.abs(open_) <= _ROUND * np.sqrt(np.outer(np.diag(open_), np.diag(open_)))
    return finite, np.where(np.outer(lost, lost) & ~apart, open_, 0.0)


def covariance_of(
    spectrum: tuple[np.ndarray, np.ndarray], sizes: np.ndarray, error: float | None = None
) -> np.ndarray:
    """Covariance (n, n), infinite along unidentifiable directions; `error` of the spectrum."""
    finite, open_ = _parts(spectrum, error)
    with np.errstate(invalid="ignore"):
        return np.where(open_ != 0, np.sign(open_) * np.inf, finite * np.outer(sizes, sizes))


def correlation_of(
    spectrum: tuple[np.ndarray, np.ndarray], error: float | None = None
) -> np.ndarray:
    """Correlation (n, n), its limit where variances are infinite."""
    finite, open_ = _parts(spectrum, error)
    unknown = np.diag(open_) > 0
    size = np.sqrt(np.where(unknown, np.diag(open_), np.diag(finite)))
    both, neither = np.outer(unknown, unknown), np.outer(~unknown, ~unknown)
    shared = np.where(both, open_, np.where(neither, finite, 0.0))
    return np.clip(shared / np.outer(size, size), -1.0, 1.0)


def held_at(
    bounds: tuple[np.ndarray, np.ndarray], theta: np.ndarray, gradient: np.ndarray
) -> np.ndarray:
    """Which coordinates are at an active bound, (n,)."""
    lower, upper = bounds
    near = 1e-8 * np.maximum(1.0, np.abs(theta))
    return ((theta - lower < near) & (gradient >= 0)) | ((upper - theta < near) & (gradient <= 0))


def offset_of(residuals: np.ndarray, jacobian: np.ndarray, free: np.ndarray) -> float:
    """Length of the next step along free coordinates, in standard errors, over sqrt(n).

    The measure of Bates and Watts (1981): the part of the residuals in the tangent space.
    """
    if not free.any():
        return 0.0
    n = int(free.sum())
    small = triangle(np.column_stack([jacobian[:, free], residuals]))
    size = np.linalg.norm(small[:n, :n], axis=0)
    basis, s, _ = np.linalg.svd(small[:n, :n] / np.where(size > 0, size, 1.0))
    identified = s > TOLD * s.max()
    return float(np.linalg.norm(basis[:, identified].T @ small[:n, n]) / np.sqrt(n))


def leverages(jacobian: np.ndarray) -> np.ndarray:
    """Share of each row's residual that the unknowns absorb, (rows,)."""
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    s, v = spectrum(scaled, np.ones(len(size)))
    identified = s > TOLD * s.max(initial=0.0)
    return np.sum((scaled @ (v[:, identified] / s[identified])) ** 2, axis=1)
