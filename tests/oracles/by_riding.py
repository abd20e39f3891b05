"""A stiff float on a film by another route: from where it sits, in Fourier series, by SciPy.

The equations of `docs/theory-film.md`, 5.6, on a film that repeats, in the float's own frame. There
its ends stay where they are, so that no cell is passed and nothing can stick; no energy is
differentiated, and nothing of the package is used.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.80665


@dataclass(frozen=True)
class Ride:
    """A float, `fade` long at its ends, on a film of length `period`, in SI units by metre across.

    `pull(x, t)` draws the film up, in Pa.
    """

    pull: Callable[[np.ndarray, float], np.ndarray]
    density: float
    surface_tension: float
    viscosity: float
    depth: float
    period: float
    length: float
    fade: float
    mass: float
    stiffness: float

    def after(self, end: float, start: float, nodes: int, tolerance: float = 1e-7) -> float:
        """Place of its middle at the end, both at rest and the film flat at first."""
        nominal = np.concatenate([np.full(nodes, self.depth), [self.length, self.length]])
        state = np.concatenate([np.full(nodes, self.depth), [start, 0.0]])
        found = solve_ivp(
            self._rate(nodes), (0.0, end), state, method="Radau", vectorized=True,
            rtol=tolerance, atol=tolerance * nominal,
        )  # fmt: skip
        assert found.success
        return float(found.y[-2, -1])

    def _rate(self, nodes: int) -> Callable[[float, np.ndarray], np.ndarray]:
        step = self.period / nodes
        xi = step * np.arange(nodes)[:, None] - self.period / 2
        waves = 2j * np.pi * np.fft.rfftfreq(nodes, step)[:, None]
        waves[-1] = 0.0

        def by_xi(values: np.ndarray) -> np.ndarray:
            return np.fft.irfft(waves * np.fft.rfft(values, axis=0), nodes, axis=0)

        u = np.clip((self.length / 2 - np.abs(xi)) / self.fade + 0.5, 0, 1)
        inward = -np.sign(xi) / self.fade * ((u > 0) & (u < 1))
        c, c_slope = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2 * inward
        B = self.stiffness * u**9 * (55 - 99 * u + 45 * u**2)
        B_slope = self.stiffness * 495 * u**8 * (1 - u) ** 2 * inward
        load = self.mass / self.length * GRAVITY

        def rate(t: float, state: np.ndarray) -> np.ndarray:
            h, X, V = state[:nodes], state[-2], state[-1]
            slope = by_xi(h)
            bend = by_xi(slope)
            root = np.sqrt(1 + slope**2)
            tension = by_xi(self.surface_tension * (1 - c) * slope / root)
            moment = by_xi(by_xi(B * bend))
            P = self.density * GRAVITY * h - tension + c * load + moment - self.pull(xi + X, t)
            G = by_xi(P)
            Q = -(h**3) / (3 * self.viscosity) * (1 - 0.75 * c) * G + c * h * V / 2
            surface = -self.surface_tension * (root - 1)
            pushed = c_slope * (surface + load * (h - self.depth)) + B_slope * bend**2 / 2
            dragged = c * (self.viscosity * V / h + h * G / 2)
            force = step * (pushed - dragged).sum(axis=0)
            return np.vstack([V * slope - by_xi(Q), V, force / self.mass])

        return rate
