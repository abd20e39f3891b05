"""The loop of a lambda-tracker with frozen gain around a linear plant: poles and margins.

With constant gain k, (13) is u = -k (1 + s) e, and (14) u = -k (1 + s) k^2 / (s + k^2) e. Outputs
have relative degree two, so that y' is C A x.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from wormopt.analysis.linearise import LinearModel
from wormopt.analysis.pencil import without_shifts
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
        """Split the inputs of a LinearModel: the first `inputs` are u, the others ground forces.

        Raises ArgumentError unless u acts on the second derivatives of as many outputs.
        """
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
