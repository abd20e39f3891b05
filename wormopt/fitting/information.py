"""Information about unknowns, from Jacobians: triangular factors and covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from wormopt.errors import ArgumentError
from wormopt.model.values import numbers

# Relative singular values that are errors of a Jacobian of unknown error: motions are simulated to
# 1e-8 and their derivatives slightly less accurately.
DETERMINED = 1e-7
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
    error = DETERMINED * float(s.max(initial=0.0)) if error is None else error
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
    """Mask of coordinates at an active bound, (n,)."""
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
    identified = s > DETERMINED * s.max()
    return float(np.linalg.norm(basis[:, identified].T @ small[:n, n]) / np.sqrt(n))


def leverages(jacobian: np.ndarray) -> np.ndarray:
    """Share of each row's residual that the unknowns absorb, (rows,)."""
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    s, v = spectrum(scaled, np.ones(len(size)))
    identified = s > DETERMINED * s.max(initial=0.0)
    return np.sum((scaled @ (v[:, identified] / s[identified])) ** 2, axis=1)


# Least share of an unknown in an unseen direction that involves it.
_INVOLVED = 1e-3


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Knowledge of unknowns, as if from independent measurements with Gaussian noise.

    Kept as a factor R of the Fisher information R'R, which is never formed: squared, half the
    digits would be lost.

    Raises
    ------
    ArgumentError
        If the shape is another, or something is not finite.

    Examples
    --------
    A straight line through the origin, measured at 1 and 2 with a deviation of 0.1:

    >>> line = Knowledge.nothing(["slope"]).after(np.array([[1.0], [2.0]]) / 0.1)
    >>> line.errors.round(6)
    array([0.044721])
    """

    names: tuple[str, ...]  # the n unknowns
    # (r, n) derivatives of what was measured, over its standard deviation, by the unknowns; any
    # rows with the same information do
    root: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        root = numbers("root", self.root)
        if root.ndim != 2 or root.shape[1] != len(self.names):
            raise ArgumentError(f"root must have {len(self.names)} columns, not {root.shape}")
        object.__setattr__(self, "root", root)

    @classmethod
    def nothing(cls, names: Sequence[str]) -> Knowledge:
        """No information about the unknowns `names`."""
        return cls(tuple(names), np.zeros((0, len(names))))

    @classmethod
    def from_covariance(cls, names: Sequence[str], covariance: ArrayLike) -> Knowledge:
        """Information of a fit with covariance (n, n); infinite variances give none.

        Raises ArgumentError if it is not symmetric and positive definite where it is finite.
        """
        given = np.array(covariance, dtype=float)
        if given.shape != (len(names), len(names)) or np.any(np.isnan(given)):
            raise ArgumentError(f"covariance must have the shape ({len(names)}, {len(names)})")
        finite = np.isfinite(np.diag(given))
        inner = given[np.ix_(finite, finite)]
        root = np.zeros((finite.sum(), len(names)))
        root[:, finite] = _inverse_root(inner)
        return cls(tuple(names), root)

    def after(self, jacobian: ArrayLike) -> Knowledge:
        """Add measurements: their derivatives (r, n) over their standard deviations."""
        stacked = np.vstack([self.root, numbers("jacobian", jacobian)])
        return replace(self, root=triangle(stacked))

    @cached_property
    def _factors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Lengths of columns, singular values and right vectors of the rest, and the rank."""
        length = np.linalg.norm(self.root, axis=0)
        length[length == 0] = 1.0
        values, right = spectrum(self.root, 1 / length)
        return length, values, right.T, int(np.sum(values > DETERMINED * max(values[0], 1e-300)))

    @property
    def rank(self) -> int:
        """Number of combinations of the unknowns that are seen."""
        return self._factors[3]

    @property
    def unseen(self) -> tuple[dict[str, float], ...]:
        """Combinations without effect on measurements, unknown by unknown."""
        length, _, right, rank = self._factors
        found = []
        for vector in right[rank:]:
            direction = vector / length
            kept = np.abs(vector) > _INVOLVED
            size = direction[kept][np.argmax(np.abs(direction[kept]))]
            pairs = zip(np.array(self.names)[kept], direction[kept] / size, strict=True)
            found.append({str(name): float(share) for name, share in pairs})
        return tuple(found)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (n, n); infinite variances, and no correlation, for unseen unknowns."""
        _, _, right, rank = self._factors
        found = self.axes @ self.axes.T
        lost = np.any(np.abs(right[rank:]) > _INVOLVED, axis=0)
        found[lost, :] = found[:, lost] = 0.0
        found[lost, lost] = np.inf
        return found

    @property
    def axes(self) -> np.ndarray:
        """Principal axes of the confidence ellipsoid (n, rank), one standard deviation long."""
        length, values, right, rank = self._factors
        return right[:rank].T / values[:rank] / length[:, None]

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (n,) of the unknowns, infinite for unseen ones."""
        return np.sqrt(np.diag(self.covariance))

    def spread(self, rows: np.ndarray) -> np.ndarray:
        """Factor B (n, q) of the covariance B'B of combinations `rows` (q, n) of the unknowns.

        Infinite for an unseen combination.
        """
        length, values, right, rank = self._factors
        seen = right @ (rows / length).T
        size = np.linalg.norm(seen, axis=0)
        half = seen[:rank] / values[:rank, None]
        lost = np.linalg.norm(seen[rank:], axis=0) > _INVOLVED * size
        return np.where(lost, np.inf, half)


def _inverse_root(covariance: np.ndarray) -> np.ndarray:
    """Triangle R such that R'R is the inverse; ArgumentError if there is none."""
    variances = np.diag(covariance)
    try:
        if np.all(variances > 0) and np.allclose(covariance, covariance.T, rtol=1e-8, atol=0.0):
            size = np.sqrt(variances)
            factor = np.linalg.cholesky(covariance / np.outer(size, size))
            return solve_triangular(factor, np.diag(1 / size), lower=True)
    except np.linalg.LinAlgError:
        pass
    what = "covariance must be symmetric and positive definite"
    raise ArgumentError(f"{what}; pass the covariance of the fit")


@dataclass(frozen=True, eq=False)
class Criterion:
    """Purpose of a measurement: small errors of combinations of the unknowns.

    Raises
    ------
    ArgumentError
        If the kind is another, or the rows are not independent where a volume is asked for.
    """

    # volume of the confidence region of the combinations, or the sum of their variances
    kind: Literal["D", "A"]
    rows: np.ndarray  # (q, n) the combinations

    def __post_init__(self) -> None:
        rows = np.atleast_2d(numbers("rows", self.rows))
        object.__setattr__(self, "rows", rows)
        if self.kind not in ("D", "A"):
            raise ArgumentError(f'kind must be "D" or "A", not {self.kind!r}')
        if self.kind == "D" and np.linalg.matrix_rank(rows) < len(rows):
            raise ArgumentError("the combinations of criterion D must be linearly independent")

    @classmethod
    def of(
        cls,
        kind: Literal["D", "A"],
        names: Sequence[str],
        wanted: Sequence[str],
        sizes: ArrayLike,
    ) -> Criterion:
        """Criterion for some unknowns, relative to their sizes (n,); the others are nuisances."""
        lost = [name for name in wanted if name not in names]
        if lost or not wanted:
            raise ArgumentError(f"wanted must be some of {', '.join(names)}, not {lost}")
        rows = np.diag(1 / np.abs(numbers("sizes", sizes)))
        return cls(kind, rows[[list(names).index(name) for name in wanted]])

    def __call__(self, known: Knowledge) -> float:
        """Logarithm of the mean error of a combination; infinite if one is unseen.

        D: the q-th root of the volume over that of the unit ball. A: the root of the mean
        variance.
        """
        spread = known.spread(self.rows)
        if not np.all(np.isfinite(spread)):
            return np.inf
        if self.kind == "A":
            return float(np.log(np.sum(spread**2) / len(self.rows)) / 2)
        pivots = np.abs(np.diag(triangle(spread)))
        return float(np.sum(np.log(pivots)) / len(pivots)) if np.all(pivots > 0) else np.inf
