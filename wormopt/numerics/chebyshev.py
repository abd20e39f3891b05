"""Smooth functions of one variable as Chebyshev series: their roots, extrema and integrals.

Roots come from the colleague matrix, all of them at once, so that none between samples is missed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

# Share of a function below which its total slope is rounding.
_CONSTANT = 1e-14

Vectorised = Callable[[np.ndarray], np.ndarray]


@lru_cache(maxsize=16)
def _nodes_and_transform(degree: int) -> tuple[np.ndarray, np.ndarray]:
    nodes = chebyshev.chebpts1(degree + 1)
    return nodes, np.linalg.inv(chebyshev.chebvander(nodes, degree)).T


@lru_cache(maxsize=16)
def _integration(degree: int) -> np.ndarray:
    """Coefficients of the integral from -1, without the highest, of a series."""
    return chebyshev.chebint(np.eye(degree + 1), lbnd=-1, axis=0)[:-1]


@dataclass(frozen=True)
class Series:
    """Several functions on [a, b] as Chebyshev series, one row of coefficients each."""

    a: float  # left end, a < b
    b: float
    coefficients: np.ndarray  # (rows, degree + 1)

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Evaluate all rows at times ``s``; shape (rows, len(s))."""
        return chebyshev.chebval(self._local(np.asarray(s, dtype=float)), self.coefficients.T)

    def derivative(self) -> Series:
        """Derivative of every row."""
        inner = chebyshev.chebder(self.coefficients, axis=1) * 2 / (self.b - self.a)
        return Series(self.a, self.b, inner)

    def primitive(self) -> Series:
        """Integral of every row from ``a``."""
        inner = chebyshev.chebint(self.coefficients, lbnd=-1, axis=1) * (self.b - self.a) / 2
        return Series(self.a, self.b, inner)

    def integral(self) -> np.ndarray:
        """Integral of every row over [a, b], shape (rows,)."""
        return self.primitive()(np.array([self.b]))[:, 0]

    def roots(self, row: int = 0, zero: float = 0.0) -> np.ndarray:
        """Roots of one row in [a, b], ascending; none if all its coefficients are below `zero`."""
        # A multiple root appears at most as often as its multiplicity, at least once if the sign
        # changes; otherwise it may be lost in round-off.
        c = self.coefficients[row]
        size = np.abs(c).max()
        if size <= zero:
            return np.zeros(0)
        keep = np.flatnonzero(np.abs(c) > 1e-15 * size)
        c = c[: keep[-1] + 1]
        if len(c) < 2 or abs(c[0]) > np.abs(c[1:]).sum():  # |T_k| <= 1: no sign change possible
            return np.zeros(0)
        found = chebyshev.chebroots(c)
        real = found.real[(np.abs(found.imag) < 1e-7) & (np.abs(found.real) < 1 + 1e-9)]
        real = self._polish(np.clip(real, -1, 1), c)
        return np.sort(self.a + (real + 1) / 2 * (self.b - self.a))

    def extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value of every row on [a, b], (rows,) each."""
        ends = self(np.array([self.a, self.b]))
        low, high = ends.min(axis=1), ends.max(axis=1)
        slope = self.derivative()
        size = np.abs(slope.coefficients)
        # see roots; a row constant but for rounding takes its ends
        turns = size[:, 0] <= size[:, 1:].sum(axis=1)
        most = size.max(axis=1, initial=0.0) * (self.b - self.a)
        turns &= most > _CONSTANT * np.abs(self.coefficients).max(axis=1)
        for row in np.flatnonzero(turns).tolist():
            inside = Series(self.a, self.b, self.coefficients[row : row + 1])(slope.roots(row))
            low[row] = inside.min(initial=low[row])
            high[row] = inside.max(initial=high[row])
        return low, high

    def _local(self, s: np.ndarray) -> np.ndarray:
        return 2 * (s - self.a) / (self.b - self.a) - 1

    @staticmethod
    def _polish(x: np.ndarray, c: np.ndarray) -> np.ndarray:
        slope = chebyshev.chebval(x, chebyshev.chebder(c))
        safe = np.abs(slope) > 1e-9 * np.abs(c).max()
        step = np.where(safe, chebyshev.chebval(x, c) / np.where(safe, slope, 1.0), 0.0)
        return np.clip(x - np.where(np.abs(step) < 1e-6, step, 0.0), -1, 1)


def resolve(function: Vectorised, a: float, b: float, degree: int | None = None) -> Series:
    """Interpolate a vector function on [a, b], to round-off where it is smooth.

    It maps times (m,) to (rows, m). Give the `degree` of a polynomial; else it is doubled, up
    to 257 coefficients a row.
    """
    if degree is not None:
        return _interpolate(function, a, b, max(degree, 1))
    return _refined(lambda n: _interpolate(function, a, b, n))


def relaxed(forcing: Vectorised, rate: float, start: float, a: float, b: float) -> Series:
    """Solve w' + rate w = forcing from w(a) = start, to round-off where it is smooth.

    By its integral over [a, s], accurate for any rate >= 0, however large. A layer at `a` is
    resolved as far as `resolve` goes, for rate (b - a) up to some hundred.
    """

    def of_degree(n: int) -> Series:
        integral = (b - a) / 2 * _integration(n)
        rows = integral @ _interpolate(forcing, a, b, n).coefficients[0]
        rows[0] += start
        return Series(a, b, np.linalg.solve(np.eye(n + 1) + rate * integral, rows)[None])

    return _refined(of_degree)


def _refined(of_degree: Callable[[int], Series]) -> Series:
    """Double the degree, up to 256, until the last coefficients are rounding."""
    for n in (16, 32, 64, 128):
        series = of_degree(n)
        tail = np.abs(series.coefficients[:, -2:]).max(initial=0.0)
        if tail <= 1e-14 * np.abs(series.coefficients).max(initial=1e-300):
            return series
    return of_degree(256)


def _interpolate(function: Vectorised, a: float, b: float, degree: int) -> Series:
    nodes, transform = _nodes_and_transform(degree)
    return Series(a, b, function(a + (nodes + 1) / 2 * (b - a)) @ transform)
