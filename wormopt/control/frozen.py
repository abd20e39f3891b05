"""The loop of a lambda-tracker with frozen gain around a linear plant: poles, margins, error.

With constant gain k, (13) is u = -k (1 + s) e, and (14) u = -k (1 + s) k^2 / (s + k^2) e. Outputs
have relative degree two, so that y' is C A x.

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
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from wormopt.analysis.linearise import LinearModel, without_shifts
from wormopt.control.lambda_tracker import Feedback
from wormopt.errors import ArgumentError
from wormopt.model.explicit import import_control

Complex = NDArray[np.complex128]

LARGEST_FACTOR = 1e6  # gain margins are searched up to here
_FACTORS, _PHASES, _OMEGAS = 61, 91, 400


@dataclass(frozen=True, eq=False)
class Plant:
    """x' = A x + B u + F f, y = C x, without uncontrollable and unobservable parts."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    F: np.ndarray

    @classmethod
    def of(cls, linear: LinearModel, inputs: int) -> Plant:
        """Split the inputs of a LinearModel: the first `inputs` are u, the others ground forces."""
        matrices, shifts = (linear.A, linear.B, linear.C, linear.D), 1
        while shifts:
            matrices, shifts = without_shifts(matrices)
        a, b, c, d = matrices
        if len(c) != inputs or np.any(d) or np.abs(c @ b).max() > 1e-12 * np.abs(c @ a @ b).max():
            raise ArgumentError(f"{linear.name}: outputs must have relative degree two")
        return cls(a, b[:, :inputs], c, b[:, inputs:])

    def response(self, omega: np.ndarray) -> Complex:
        """G(i omega), shape (frequencies, outputs, inputs)."""
        points = 1j * omega[:, None, None] * np.eye(len(self.A)) - self.A
        inputs = np.broadcast_to(self.B, (len(omega), *self.B.shape))
        return (self.C @ np.linalg.solve(points, inputs)).astype(complex, copy=False)


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop.

    `gain`: factor common to all inputs up to which it is stable, inf beyond 1e6; `phase`: common
    phase lag of all inputs in radians; `disk`: 1 / max |S - I/2| (spectral norm), inputs
    independent; `peak`: max |S|. All 0 (peak inf) if the loop is unstable.
    """

    gain: float
    phase: float
    disk: float
    peak: float


@dataclass(frozen=True, eq=False)
class FrozenLoop:
    """A plant under a lambda-tracker with the constant gain `gain`."""

    plant: Plant
    gain: float
    feedback: Feedback

    @cached_property
    def opened(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C of the loop cut at the plant's inputs, from u to minus the tracker's command."""
        plant, k = self.plant, self.gain
        a, b, c = plant.A, plant.B, plant.C
        if self.feedback == "derivative":
            return a, b, k * (c + c @ a)
        unit, n = np.eye(len(c)), len(a)
        whole = np.block([[a, np.zeros((n, len(c)))], [k**2 * c, -(k**2) * unit]])
        enters = np.vstack([b, np.zeros((len(c), b.shape[1]))])
        return whole, enters, np.hstack([k**3 * c, (k - k**3) * unit])

    @cached_property
    def closed(self) -> np.ndarray:
        """A of the closed loop."""
        a, b, c = self.opened
        return a - b @ c

    @property
    def poles(self) -> Complex:
        """Poles of the closed loop, sorted by real part."""
        found: Complex = np.linalg.eigvals(self.closed).astype(np.complex128)
        return found[np.lexsort((found.imag, found.real))]

    @property
    def stable(self) -> bool:
        """Whether all poles lie to the left of the imaginary axis."""
        return bool(self.poles.real.max() < 0)

    def compensator(self, omega: np.ndarray) -> Complex:
        """Factor of -e in u at frequencies, shape (frequencies,)."""
        s, k = 1j * omega, self.gain
        return k * (1 + s) * (k**2 / (s + k**2) if self.feedback == "filter" else 1.0)

    def sensitivity(self, omega: np.ndarray, response: Complex | None = None) -> Complex:
        """S(i omega) = (I + G K)^-1; `response` is the plant's, if known."""
        g = self.plant.response(omega) if response is None else response
        returned = np.eye(g.shape[1]) + self.compensator(omega)[:, None, None] * g
        return np.linalg.inv(returned).astype(np.complex128)

    def margins(self) -> Margins:
        """Stability margins of the loop."""
        if not self.stable:
            return Margins(0.0, 0.0, 0.0, np.inf)
        factors = np.logspace(0, np.log10(LARGEST_FACTOR), _FACTORS)
        angles = np.linspace(0, np.pi, _PHASES)
        gain = self._first(lambda f: f + 0j, factors)
        phase = self._first(lambda angle: np.exp(-1j * angle), angles)
        unit = np.eye(self.plant.C.shape[0])
        return Margins(
            np.inf if gain is None else gain,
            np.pi if phase is None else phase,
            1 / self._largest(unit / 2, 0.5),
            self._largest(0 * unit, 1.0),
        )

    def _abscissa(self, factors: Any) -> np.ndarray:
        """Largest real part of the poles with complex factors at all inputs."""
        a, b, c = self.opened
        closed = a - np.atleast_1d(factors)[:, None, None] * (b @ c)
        return np.linalg.eigvals(closed).real.max(axis=1)

    def _first(self, factor: Any, grid: np.ndarray) -> float | None:
        """First point of a grid, refined, at which the loop with a factor is unstable."""
        unstable = np.flatnonzero(self._abscissa(factor(grid)) >= 0)
        if not unstable.size:
            return None
        at = int(unstable[0])
        if at == 0:  # unstable at the first point
            return float(grid[0])
        ends = grid[at - 1], grid[at]
        found: Any = brentq(lambda z: self._abscissa(factor(z))[0], *ends, xtol=1e-13)
        return float(found)

    def _largest(self, less: np.ndarray, at_infinity: float) -> float:
        """Largest singular value of S - `less` over all frequencies."""
        corners = np.abs(np.append(self.poles, np.linalg.eigvals(self.plant.A)))
        scales = np.log10(corners[corners > 1e-9 * corners.max()])
        grid = np.linspace(scales.min() - 2, scales.max() + 2, _OMEGAS)

        def size(logarithm: Any) -> np.ndarray:
            omega = 10.0 ** np.atleast_1d(logarithm)
            return np.linalg.norm(self.sensitivity(omega) - less, ord=2, axis=(1, 2))

        at = int(np.argmax(size(grid)))
        ends = grid[max(at - 1, 0)], grid[min(at + 1, _OMEGAS - 1)]
        found: Any = minimize_scalar(
            lambda z: -size(z)[0], bounds=ends, method="bounded", options={"xatol": 1e-9}
        )
        return max(-float(found.fun), float(size(grid).max()), at_infinity)

    def by_control(self) -> tuple[Complex, float]:
        """Poles and disk margin by python-control's own feedback and frequency response."""
        control = import_control()
        opened = control.ss(*self.opened, np.zeros((len(self.plant.C),) * 2))
        unit = control.ss([], [], [], np.eye(len(self.plant.C)))
        sensitivity = control.feedback(unit, opened)
        poles = np.asarray(sensitivity.poles(), dtype=complex)
        sizes = np.log10(np.abs(poles))
        omega = np.logspace(sizes.min() - 2, sizes.max() + 2, 10 * _OMEGAS)
        response = np.moveaxis(sensitivity(1j * omega, squeeze=False), -1, 0)
        less = np.linalg.norm(response - np.eye(len(self.plant.C)) / 2, ord=2, axis=(1, 2))
        return poles, float(1 / max(less.max(), 0.5))


_INSTANTS = 20_000  # number of times of impulse responses, even in the logarithm of time


@dataclass(frozen=True, eq=False)
class Task:
    """Reference and disturbance of a loop."""

    plant: Plant  # the worm, dry friction as an outside force
    period: float  # period of the reference
    # (m, N) reference less rest lengths, at N equidistant times of a period, the end left out
    reference: np.ndarray
    load: np.ndarray  # (n + 1,) constant forces that are known, forward positive
    force: np.ndarray  # (n + 1,) mean of the outside forces
    range: np.ndarray  # (n + 1,) largest deviations from it, inf where they are unknown

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

    def error_over_period(self, loop: FrozenLoop, *, pushed: bool) -> np.ndarray:
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
        return float(np.linalg.norm(self.error_over_period(loop, pushed=False), axis=0).max())

    def bound(self, loop: FrozenLoop) -> float:
        """Upper bound of the steady-state error for any dry friction in its range."""
        if not loop.stable or not np.all(np.isfinite(self.range)):
            return np.inf
        spread = peak_gains(loop) @ self.range
        error = np.abs(self.error_over_period(loop, pushed=True))
        return float(np.linalg.norm(error + spread[:, None], axis=0).max())


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
