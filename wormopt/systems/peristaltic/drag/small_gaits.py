"""The best small gaits of a worm on drag: an eigenvalue problem, and its closed forms.

With strains e_j of period T, to second order in them, the displacement of a worm per period is
(a L / N) times the integral of e^T K e'. For a given cost, the integral of e'^T M e', the best gait
is one harmonic: e = Re(v exp(2 pi i t / T)), with the eigenvector v of i K v = k M v for the
largest k (its conjugate if a < 0). The displacement is |a| L T k / (2 pi N) times the cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.systems.peristaltic.drag.worm import centres

Cost = Literal["strain_rate", "dissipation"]


def area_matrix(segments: int) -> np.ndarray:
    """Return the matrix K (N, N) of the displacement: (sgn(j-k) - (j-k)/N) / 2."""
    j = np.arange(segments)
    apart = j[:, None] - j
    return (np.sign(apart) - apart / segments) / 2


def cost_matrix(segments: int, cost: Cost) -> np.ndarray:
    """Return the matrix M (N, N) of a cost: squared strain rates, or dissipation over c0 L^2."""
    if cost == "strain_rate":
        return np.eye(segments)
    S = centres(segments)
    return S.T @ S + np.eye(segments) / 12


def strain_rate_gain(segments: int, *, fixed_total: bool = False) -> float:
    """Return the gain k for the cost of strain rates in closed form: cot(phi / 2) / 2.

    phi is 2 pi / N for a constant total length, which is a wave, else the root of
    tan(N phi / 2) = -(N / 3) tan(phi / 2) between pi / N and 2 pi / N.
    """
    N = segments

    def off(phi: float) -> float:
        return 3 * np.sin(N * phi / 2) * np.cos(phi / 2) + N * np.cos(N * phi / 2) * np.sin(phi / 2)

    whole = 2 * np.pi / N
    phi = whole if fixed_total else float(brentq(off, np.pi / N, whole, xtol=1e-16, rtol=1e-15))  # pyright: ignore[reportArgumentType]
    return float(1 / np.tan(phi / 2) / 2)


def mean_step(mode: np.ndarray) -> float:
    """Return the mean phase step of a harmonic (N,) between segments; weak ones count less."""
    return float(np.angle(np.sum(mode[1:] * mode[:-1].conj())))


@dataclass(frozen=True, eq=False)
class SmallGait:
    """A harmonic gait that is locally optimal."""

    gain: float  # k
    mode: np.ndarray  # (N,) complex amplitudes v of strains, of cost 1: v^H M v = 1

    @property
    def steps(self) -> np.ndarray:
        """Phase (N - 1,) of each segment less that of the segment before, in (-pi, pi]."""
        return np.angle(self.mode[1:] / self.mode[:-1])

    @property
    def step(self) -> float:
        """Mean of `steps`, by `mean_step`."""
        return mean_step(self.mode)

    @property
    def amplitudes(self) -> np.ndarray:
        """Amplitudes (N,) over the largest."""
        size = np.abs(self.mode)
        return size / size.max()

    def way(self, exponent: float, effort: float, length: float = 1, period: float = 1) -> float:
        """Return the displacement per period at a cost: integral of e'^T M e'."""
        N = len(self.mode)
        return abs(exponent) * length * period * self.gain * effort / (2 * np.pi * N)

    def scaled(self, effort: float, period: float) -> np.ndarray:
        """Return complex amplitudes (N,) of the strains at a cost per period."""
        return self.mode * np.sqrt(2 * effort * period) / (2 * np.pi)

    def gait(self, effort: float, length: float = 1.0, period: float = 1.0) -> Gait:
        """Return the lengths over a period at a cost."""
        v = length * self.scaled(effort, period)
        return Gait(
            np.array([0.0, period]),
            np.full((1, len(v), 1), length),
            np.array([2 * np.pi / period]),
            v.real[None],
            -v.imag[None],
        )


def small_gaits(
    segments: int, exponent: float, cost: Cost = "strain_rate", *, fixed_total: bool = False
) -> list[SmallGait]:
    """Return the harmonic gaits that go forward, the best first; later ones are no optima.

    Theory: docs/theory-peristaltic.md, section 4.

    Parameters
    ----------
    segments : int
        Number of segments N.
    exponent : float
        Exponent a of the drag law.
    cost : {"strain_rate", "dissipation"}, optional
        Kind of effort to minimise.
    fixed_total : bool, optional
        Whether the total length of the worm is constant.

    Returns
    -------
    list of SmallGait
        Each has ``gain``, ``way(exponent, effort)`` and ``gait(effort)``.

    Raises
    ------
    ArgumentError
        If no gait has a net displacement: exponent 0, or a single free segment.

    Examples
    --------
    >>> round(small_gaits(3, 1.0)[0].gain, 9)
    0.5
    """
    if exponent == 0 or segments < 2 + fixed_total:
        raise ArgumentError(
            "no gait has a net displacement: give an exponent other than 0, and more segments"
        )
    K, M = np.sign(exponent) * area_matrix(segments), cost_matrix(segments, cost)
    basis = np.eye(segments)
    if fixed_total:
        basis = np.linalg.qr(np.column_stack([np.ones(segments), basis[:, 1:]]))[0][:, 1:]
    gains, modes = eigh(1j * basis.T @ K @ basis, basis.T @ M @ basis)
    forward = np.flatnonzero(gains > 1e-9)[::-1]
    return [SmallGait(float(gains[k]), basis @ modes[:, k]) for k in forward]
