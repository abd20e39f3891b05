"""A linear plant under a controller that decides at samples, from one to the next by SciPy."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
Law = Callable[[float, Array, float], float]
"""Value at a time, for what is seen (output, rate) and a gain."""


@dataclass(frozen=True)
class Sampled:
    """Plant x' = states x + push u, whose output is its first state and the rate the second.

    The gain has the rate `growth` of what was seen last; the force is held from sample to sample.
    """

    states: Array  # (n, n)
    push: Array  # (n,)
    start: Array  # (n,)
    force: Law
    growth: Law
    period: float
    bound: float = np.inf
    rate: float = np.inf
    output_step: float = 0.0
    input_step: float = 0.0
    delay: float = 0.0

    def run(self, end: float, gain: float = 1.0) -> Array:
        """States and gain at the samples, (n + 1, samples + 1)."""
        z, u, seen = np.append(self.start, gain), 0.0, np.zeros(0)
        past: list[tuple[float, float, Any]] = []
        found = [z]
        for k in range(round(end / self.period)):
            t = k * self.period
            y = self._measured(t, z, past)
            if step := self.output_step:
                rounded = step * np.floor(y[0] / step + 0.5)
                y = np.array([rounded, (rounded - seen[0]) / self.period if k else 0.0])
            seen = y
            wanted = float(np.clip(self.force(t, seen, z[-1]), -self.bound, self.bound))
            if step := self.input_step:
                wanted = step * np.floor(wanted / step + 0.5)
            ramp = min(abs(wanted - u) / self.rate, self.period)  # until the actuator is there
            slope = np.sign(wanted - u) * self.rate if ramp else 0.0
            if ramp:
                z = self._between(t, t + ramp, z, u, slope, seen, past)
            u = u + slope * ramp if ramp else wanted
            if ramp < self.period:
                z = self._between(t + ramp, t + self.period, z, wanted, 0.0, seen, past)
            found.append(z)
        return np.array(found).T

    def _between(
        self,
        begin: float,
        end: float,
        z: Array,
        u: float,
        slope: float,
        seen: Array,
        past: list[tuple[float, float, Any]],
    ) -> Array:
        def rhs(t: float, z: Array) -> Array:
            force = u + slope * (t - begin)
            return np.append(self.states @ z[:-1] + self.push * force, self.growth(t, seen, z[-1]))

        found = solve_ivp(
            rhs, (begin, end), z, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True
        )
        past.append((begin, end, found.sol))
        return found.y[:, -1]

    def _measured(self, t: float, z: Array, past: list[tuple[float, float, Any]]) -> Array:
        then = t - self.delay
        if not self.delay:
            return z[:2]
        if then <= 0:
            return self.start[:2]
        return next(sol(then)[:2] for begin, end, sol in past if begin <= then <= end)
