"""Periodic shapes of a film of magnetic fluid, by quadrature: C, mean flow, field of eq. 30.

The equations are those of Zimmermann et al. 2007. Sums over equidistant points are exact for
periodic functions up to unresolved harmonics. `flow_constant` and `field_function` take values on
an equidistant grid, numbers or CasADi expressions. `FourierWave` is a shape by its harmonics that
chooses a fine enough grid itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.values import numbers
from wormopt.systems.film.cosine import CosineWave, Shape
from wormopt.systems.film.lubrication import Expression, library_of, symbolic

# Harmonics of 1 / h² and 1 / h³ beyond the grid must be below this share of the largest.
_RESOLVED, _LEAST, _MOST = 1e-16, 32, 1 << 16
_CANDIDATES = 8


def grid(nodes: int) -> np.ndarray:
    """Equidistant phases of a period from 0 on, without its end.

    Parameters
    ----------
    nodes : int
        Number of phases.

    Returns
    -------
    ndarray, shape (nodes,)
        Phases in rad.

    Examples
    --------
    >>> (grid(4) / np.pi).tolist()
    [0.0, 0.5, 1.0, 1.5]
    """
    return 2 * np.pi * np.arange(nodes) / nodes


def flow_constant(h: Expression) -> Expression:
    """Constant C = -int h^-2 / int h^-3 with which the field is periodic; -C lies within h.

    `h`: positive thickness on `grid`, (nodes,) or casadi (nodes, 1).
    """
    if isinstance(h, np.ndarray):
        return -np.sum(h**-2) / np.sum(h**-3)
    library = library_of(h)
    square = h * h
    return -library.sum1(1 / square) / library.sum1(1 / (square * h))


def field_function(h: Expression, tension: Expression = 0.0) -> Expression:
    """Field (mu - 1) D / (8 pi) on the grid, with mean 0, that holds a shape h > 0 (eq. 30).

    W h'' + 3 int d xi (1 / h² + C / h³); `h` (nodes,) or casadi (nodes, 1) on `grid`, best with an
    odd number of nodes, or one whose highest harmonic is not in h.
    """
    C = flow_constant(h)
    slope = 3 * (h + C) / (h * h * h)
    if isinstance(h, np.ndarray):
        return _differentiate(slope, -1) + tension * _differentiate(h, 2)
    second, integral = _matrices(h.numel())
    return integral @ slope + tension * (second @ h)


def harmonics_of(values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Cosines and sines ((nodes - 1) // 2,), over the mean, of thickness (nodes,) on `grid`.

    The first harmonic comes first, as for `FourierWave`.
    """
    found = np.fft.rfft(numbers("values", values))
    kept = 2 * found[1 : (np.size(values) + 1) // 2] / found[0].real
    return kept.real, -kept.imag


class FourierWave(Shape):
    """Wave of any shape, h = 1 + sum_k (cosines[k-1] cos(k xi) + sines[k-1] sin(k xi)).

    Parameters
    ----------
    cosines : array_like, shape (n,)
        Cosine amplitudes over the mean thickness, from the first harmonic on.
    sines : array_like, shape (n,), optional
        Sine amplitudes; the shorter of both is padded with 0. h must be positive.

    Raises
    ------
    ArgumentError
        If a harmonic is not a number, all are 0, or h is not positive everywhere, or so small that
        no grid resolves it.

    Examples
    --------
    >>> wave = FourierWave([0.5])
    >>> round(wave.constant, 12), round(wave.peak().value, 6)
    (-0.666666666667, 1.86339)
    >>> FourierWave([1.2])
    Traceback (most recent call last):
        ...
    wormopt.errors.ArgumentError: the thickness falls to -0.2 at xi = 3.14...
    """

    def __init__(self, cosines: ArrayLike = (), sines: ArrayLike = ()) -> None:
        given = [numbers(*pair).ravel() for pair in (("cosines", cosines), ("sines", sines))]
        count = max(each.size for each in given)
        a, b = (np.append(each, np.zeros(count - each.size)) for each in given)
        if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
            raise ArgumentError("harmonics must be finite numbers")
        if not (a.any() or b.any()):
            raise ArgumentError(
                "all harmonics are 0, so there is no wave; write cosines = [0.5], for example"
            )
        self.cosines, self.sines = a, b
        self._check_thickness()

    def _check_thickness(self) -> None:
        xi = grid(64 * len(self.cosines) + 1024)
        h = self.height(xi)
        least = int(np.argmin(h))
        if not h[least] > 0:
            raise ArgumentError(
                f"the thickness falls to {h[least]:.6g} at xi = {xi[least]:.6g}; it must stay "
                "above 0, write smaller harmonics"
            )

    def _height(self, xi: Expression, order: int) -> Expression:
        return (0.0 if order else 1.0) + _series(self.cosines, self.sines, xi, order)

    @cached_property
    def nodes(self) -> int:
        """Points of the grid that resolves 1 / h² and 1 / h³ to round-off."""
        nodes = max(_LEAST, 1 << (4 * len(self.cosines)).bit_length())
        while nodes <= _MOST:
            h = self.height(grid(nodes))
            size = np.abs(np.fft.rfft(h**-3))
            if np.all(h > 0) and size[-nodes // 8 :].max() <= _RESOLVED * size.max() * nodes**0.5:
                return 2 * nodes
            nodes *= 2
        raise ArgumentError(
            f"the thickness falls to {self.height(grid(_MOST)).min():.3g}, too small for "
            f"quadrature over {_MOST} points; write smaller harmonics"
        )

    @cached_property
    def constant(self) -> float:  # pyright: ignore[reportIncompatibleMethodOverride]
        """C = -int h^-2 / int h^-3."""
        return float(flow_constant(self.height(grid(self.nodes))))

    @cached_property
    def _inverse(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Mean and harmonics of 1 / h."""
        found = np.fft.rfft(1 / self.height(grid(self.nodes))) / self.nodes
        return float(found[0].real), *_kept(2 * found[1:-1])

    def _mean_inverse(self, xi: Expression, length: float) -> Expression:
        mean, cosines, sines = self._inverse
        smooth = np.sinc(np.arange(1, len(cosines) + 1) * length / (2 * np.pi))
        return mean + _series(cosines * smooth, sines * smooth, xi)

    @cached_property
    def _pressures(self) -> tuple[np.ndarray, np.ndarray]:
        """Harmonics of the pressure, without those of the size of round-off."""
        h = self.height(grid(self.nodes))
        slope = 3 * (h + self.constant) / h**3
        found = 2 * np.fft.rfft(slope)[1:-1] / self.nodes
        return _kept(found / (1j * np.arange(1, len(found) + 1)))

    def _pressure(self, xi: Expression) -> Expression:
        return _series(*self._pressures, xi)

    def _summits(self, tension: float) -> Iterable[float]:
        xi = grid(4 * self.nodes)
        values = field_function(self.height(xi), tension)
        hills = np.flatnonzero((values >= np.roll(values, 1)) & (values >= np.roll(values, -1)))
        best = hills[np.argsort(values[hills])[-_CANDIDATES:]]
        return xi[best].tolist()


Wave = CosineWave | FourierWave
"""A shape of the surface."""


def _series(cosines: np.ndarray, sines: np.ndarray, xi: Expression, order: int = 0) -> Expression:
    """Fourier series or a derivative of it, at numbers or for an expression."""
    k = np.arange(1, len(cosines) + 1)
    turned = (cosines - 1j * sines) * (1j * k) ** order  # of exp(i k xi), real part
    if symbolic(xi):
        library = library_of(xi)
        parts = zip(k.tolist(), turned.real.tolist(), turned.imag.tolist(), strict=True)
        return sum((a * library.cos(n * xi) - b * library.sin(n * xi) for n, a, b in parts), 0 * xi)
    angle = np.asarray(xi, dtype=float)
    value = np.zeros(angle.shape)
    for n, a, b in zip(k.tolist(), turned.real.tolist(), turned.imag.tolist(), strict=True):
        value = value + a * np.cos(n * angle) - b * np.sin(n * angle)
    return float(value) if not angle.ndim else value


def _kept(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """Cosines and sines of complex harmonics, without those far below round-off at the end."""
    kept = np.flatnonzero(np.abs(found) > 1e-18 * np.abs(found).max())
    found = found[: kept[-1] + 1]
    return found.real, -found.imag


def _differentiate(values: np.ndarray, order: int) -> np.ndarray:
    """Derivative on the grid, or for order -1 the integral of mean 0."""
    nodes = len(values)
    k = np.arange(nodes // 2 + 1)
    factor = np.zeros(len(k), dtype=complex)
    factor[1:] = (1j * k[1:]) ** order
    if not nodes % 2 and order % 2:
        factor[-1] = 0.0  # a wave of two points per period has no slope on the grid
    return np.fft.irfft(factor * np.fft.rfft(values), nodes)


@lru_cache(maxsize=16)
def _matrices(nodes: int) -> tuple[Any, Any]:
    """Second derivative and integral of mean 0, as matrices on the grid."""
    import casadi as ca

    unit = np.eye(nodes)
    return tuple(
        ca.DM(np.stack([_differentiate(row, order) for row in unit], axis=1)) for order in (2, -1)
    )  # type: ignore[return-value]
