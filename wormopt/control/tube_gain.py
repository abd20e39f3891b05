"""Error of a loop with frozen gain, and the least gain for a given tube.

Dry friction is an external force f of which only the range is known. Then the plant is linear, and
the steady-state error is e = S (H f - r), with r the reference minus the rest lengths: computed
harmonic by harmonic for r and the mean of f, and by the peak-to-peak gains (integrals of absolute
impulse responses) for any deviation of f from its mean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from wormopt.control.frozen import Complex, FrozenLoop, Plant
from wormopt.errors import ArgumentError

_INSTANTS = 20_000  # number of times of impulse responses, even in the logarithm of time


@dataclass(frozen=True, eq=False)
class Task:
    """Reference and disturbance of a loop.

    Parameters
    ----------
    plant : Plant
        The worm, dry friction as an outside force.
    period : float
        Period of the reference.
    reference : ndarray, shape (m, N)
        Reference less rest lengths, at N equidistant times of a period, the end left out.
    load : ndarray, shape (n + 1,)
        Constant forces that are known, forward positive.
    force : ndarray, shape (n + 1,)
        Mean of the outside forces.
    range : ndarray, shape (n + 1,)
        How far they may depart from it, inf where nothing is known.
    """

    plant: Plant
    period: float
    reference: np.ndarray
    load: np.ndarray
    force: np.ndarray
    range: np.ndarray

    @cached_property
    def omega(self) -> np.ndarray:
        """Angular frequencies of the harmonics."""
        count = self.reference.shape[1] // 2 + 1
        return 2 * np.pi / self.period * np.arange(count)

    @cached_property
    def harmonics(self) -> Complex:
        """Fourier coefficients of the reference, shape (harmonics, m)."""
        return np.fft.rfft(self.reference, axis=1).T

    @cached_property
    def response(self) -> Complex:
        """The plant's G at the harmonics."""
        if not np.linalg.cond(self.plant.A) < 1e14:
            raise ArgumentError("links without stiffness have no rest length to return to")
        return self.plant.response(self.omega)

    def course(self, loop: FrozenLoop, *, pushed: bool) -> np.ndarray:
        """Error over a period, shape (m, N); `pushed`: also under the mean forces."""
        acting = self.load + self.force if pushed else self.load
        still = -np.linalg.solve(self.plant.A, self.plant.F @ acting)
        harmonics = -self.harmonics
        harmonics[0] += self.reference.shape[1] * (self.plant.C @ still)
        s = loop.sensitivity(self.omega, self.response)
        error = (s @ harmonics[:, :, None])[:, :, 0]
        return np.fft.irfft(error.T, self.reference.shape[1], axis=1)

    def error(self, loop: FrozenLoop) -> float:
        """Largest steady-state error without dry friction, inf if the loop is unstable."""
        if not loop.stable:
            return np.inf
        return float(np.linalg.norm(self.course(loop, pushed=False), axis=0).max())

    def bound(self, loop: FrozenLoop) -> float:
        """Upper bound of the steady-state error for any dry friction in its range."""
        if not loop.stable or not np.all(np.isfinite(self.range)):
            return np.inf
        spread = peak_gains(loop) @ self.range
        course = np.abs(self.course(loop, pushed=True))
        return float(np.linalg.norm(course + spread[:, None], axis=0).max())


def peak_gains(loop: FrozenLoop) -> np.ndarray:
    """Integrals over time of |impulse response| from forces to errors, shape (m, n + 1)."""
    times, responses = _impulse(loop)
    return np.trapezoid(np.abs(responses), times, axis=0)


def static_gains(loop: FrozenLoop) -> tuple[np.ndarray, np.ndarray]:
    """Integrals of the impulse responses themselves, by the same quadrature and in closed form."""
    times, responses = _impulse(loop)
    force, seen = _ends(loop)
    return np.trapezoid(responses, times, axis=0), -seen @ np.linalg.solve(loop.closed, force)


def _ends(loop: FrozenLoop) -> tuple[np.ndarray, np.ndarray]:
    """Inputs of forces and outputs of errors of the closed loop."""
    more, plant = len(loop.closed) - len(loop.plant.A), loop.plant
    force = np.vstack([plant.F, np.zeros((more, plant.F.shape[1]))])
    return force, np.hstack([plant.C, np.zeros((len(plant.C), more))])


def _impulse(loop: FrozenLoop) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) and impulse responses (k, m, n + 1), by eigenvectors of the closed loop."""
    found: Any = np.linalg.eig(loop.closed)
    poles, modes = found
    force, seen = _ends(loop)
    last, first = 40 / -poles.real.max(), 1e-4 / np.abs(poles).max()
    times = np.append(0.0, np.geomspace(first, last, _INSTANTS))
    into, out = np.linalg.solve(modes, force.astype(complex)), seen @ modes
    decay = np.exp(times[:, None] * poles)
    return times, np.einsum("tq,jq,qi->tji", decay, out, into, optimize=True).real


def least_gain(size: Callable[[float], float], gains: np.ndarray, wanted: float) -> float | None:
    """Least gain from which on, within the range of `gains`, sizes are at most `wanted`.

    `gains` ascend. Returns the least gain if all satisfy it, None if the largest does not.
    """
    sizes = np.array([size(gain) for gain in gains])
    above = np.flatnonzero(~(sizes <= wanted))
    if not above.size:
        return float(gains[0])
    at = int(above[-1])
    if at == len(gains) - 1:
        return None
    if not np.isfinite(sizes[at]):
        return float(gains[at + 1])
    found: Any = brentq(lambda k: size(k) - wanted, gains[at], gains[at + 1])
    return float(found)
