"""Covariances from a Jacobian: infinite along what the data do not tell, never small by mistake."""

from __future__ import annotations

import numpy as np

# Singular values below this share of the largest are errors of the Jacobian: motions are simulated
# to 1e-8 and their derivatives to little less.
TOLD = 1e-7
# An unknown takes part in what cannot be told if its share of such a direction is larger.
_TAKES_PART = 1e-6


def spectrum(jacobian: np.ndarray, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values (n,) and right singular vectors (n, n) of jacobian * nominal."""
    n = len(nominal)
    triangle = np.linalg.qr(np.vstack([jacobian * nominal, np.zeros((n, n))]), mode="r")
    _, s, rows = np.linalg.svd(triangle)
    return s, rows.T


def _parts(spectrum: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Finite part of the scaled covariance, and the projector on what cannot be told."""
    s, v = spectrum
    told = s > TOLD * s.max(initial=0.0)
    finite = (v[:, told] / s[told] ** 2) @ v[:, told].T
    open_ = v[:, ~told] @ v[:, ~told].T
    return finite, np.where(np.abs(open_) > _TAKES_PART**2, open_, 0.0)


def covariance_of(spectrum: tuple[np.ndarray, np.ndarray], nominal: np.ndarray) -> np.ndarray:
    """Covariance (n, n), infinite along what cannot be told."""
    finite, open_ = _parts(spectrum)
    with np.errstate(invalid="ignore"):
        return np.where(open_ != 0, np.sign(open_) * np.inf, finite * np.outer(nominal, nominal))


def correlation_of(spectrum: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Correlation (n, n), its limit where variances are infinite."""
    finite, open_ = _parts(spectrum)
    unknown = np.diag(open_) > 0
    size = np.sqrt(np.where(unknown, np.diag(open_), np.diag(finite)))
    both, neither = np.outer(unknown, unknown), np.outer(~unknown, ~unknown)
    shared = np.where(both, open_, np.where(neither, finite, 0.0))
    return np.clip(shared / np.outer(size, size), -1.0, 1.0)


def held_at(
    bounds: tuple[np.ndarray, np.ndarray], theta: np.ndarray, gradient: np.ndarray
) -> np.ndarray:
    """Which coordinates lie at a bound that pushes back, (n,)."""
    lower, upper = bounds
    near = 1e-8 * np.maximum(1.0, np.abs(theta))
    return ((theta - lower < near) & (gradient >= 0)) | ((upper - theta < near) & (gradient <= 0))


def offset_of(residuals: np.ndarray, jacobian: np.ndarray, free: np.ndarray) -> float:
    """Length of the next step along free coordinates, in standard errors, over sqrt(n).

    The measure of Bates and Watts (1981): the part of the residuals that the tangent space holds.
    """
    if not free.any():
        return 0.0
    columns = jacobian[:, free]
    size = np.linalg.norm(columns, axis=0)
    basis, s, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    told = s > TOLD * s.max()
    return float(np.linalg.norm(basis[:, told].T @ residuals) / np.sqrt(free.sum()))
