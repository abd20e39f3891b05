"""What force gauges would see of worms with spikes that crawl with gait (15), by scipy alone.

Shares nothing with the package: equations (3), (7) and (15) are typed in again.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from tests.oracles.by_recordings import Array, Seen, disturb


@dataclass(frozen=True)
class FastGait:
    """Gait (15) of two links."""

    period: float
    rest_length: float = 1.0
    elongation: float = 0.15

    def derivatives(self, t: float, third: int) -> tuple[Array, Array, Array]:
        """Lengths, their rates and accelerations by the formulas of one third."""
        w, way = 3 * np.pi / self.period, self.elongation * self.rest_length
        c, s = np.cos(w * (t % self.period)), np.sin(w * (t % self.period))
        wave = np.array([c, -w * s, -(w**2) * c])
        first = (-way * wave, -way * wave, 0 * wave)[third]
        second = (way * wave, 0 * wave, -way * wave)[third]
        e = self.elongation
        means = ((1 + e, 1 - e), (1 + e, 1 - 2 * e), (1.0, 1 - e))[third]
        lengths, rates, accelerations = np.stack([first, second]).T
        return self.rest_length * np.array(means) + lengths, rates, accelerations

    def third(self, t: float) -> int:
        return int(3 * (t % self.period) / self.period)


@dataclass(frozen=True)
class Crawler:
    """Three masses under a gait, with spikes; it starts at rest."""

    gait: FastGait
    mass: Array
    drag: float
    load: float

    def held(self, t: float, third: int) -> tuple[Array, Array, int]:
        """Velocities and accelerations of the masses while one rests, and which that is."""
        _, rates, accelerations = self.gait.derivatives(t, third)
        span = np.append(0.0, np.cumsum(rates))
        bend = np.append(0.0, np.cumsum(accelerations))
        rests = (1, 0, 2)[third]
        return span[rests] - span, bend[rests] - bend, rests

    def needed(self, t: float, w: float, third: int) -> float:
        """Force of all spikes that keeps the common velocity as it is."""
        v, a, _ = self.held(t, third)
        return float(self.mass @ a + self.drag * np.sum(v + w) + 3 * self.load)

    def forces(self, t: float, w: float, third: int) -> tuple[Array, float]:
        """Force of each actuator, and of all spikes."""
        v, a, rests = self.held(t, third)
        spikes, needed = 0.0, self.needed(t, w, third)
        if w == 0 and needed > 0:
            spikes = needed
        slope = (spikes - needed) / self.mass.sum()
        surplus = -self.drag * (v + w) - self.load - self.mass * (a + slope)
        surplus[rests] += spikes
        return np.cumsum(surplus)[:2], spikes

    def watch(self, times: ArrayLike) -> Seen:
        """Place of the head, actuator forces and load of all spikes, at times from 0 on."""
        times = np.asarray(times, float)
        found = {name: np.zeros((rows, len(times))) for name, rows in _SEEN.items()}
        t, x, w, third, events = 0.0, 0.0, 0.0, 0, []
        while t < times[-1]:
            until = (np.floor(3 * t / self.gait.period + 1e-9) + 1) * self.gait.period / 3
            glides = w > 0 or self.needed(t + 1e-12, w, third) < 0
            part = self._stretch((t, min(until, times[-1])), x, w, third, glides)
            inside = np.flatnonzero((times >= t) & (times <= part.t[-1]))
            for k in inside:
                head, common = part.sol(times[k])
                found["position"][0, k] = head
                forces, spikes = self.forces(times[k], common if glides else 0.0, third)
                found["actuator_force"][:, k], found["spike_load"][0, k] = forces, spikes
            t, (x, w) = float(part.t[-1]), part.y[:, -1]
            if part.status == 1:
                w, kind = 0.0, "stop" if glides else "release"
                events.append((t, 0, kind))
            else:
                t, third = until, (third + 1) % 3
        return Seen(times, found, events)

    def _stretch(
        self, span: tuple[float, float], x: float, w: float, third: int, glides: bool
    ) -> Any:
        mass = self.mass.sum()

        def rhs(t: float, y: Array) -> list[float]:
            head = self.held(t, third)[0][0]
            return [head + y[1], -self.needed(t, y[1], third) / mass if glides else 0.0]

        def turns(t: float, y: Array) -> float:
            return y[1] if glides else self.needed(t, 0.0, third)

        vars(turns).update(terminal=True, direction=-1)
        return solve_ivp(
            rhs, span, [x, w], "DOP853", rtol=1e-12, atol=1e-13, events=turns, dense_output=True,
            max_step=self.gait.period / 30,
        )  # fmt: skip


_SEEN = {"position": 1, "actuator_force": 2, "spike_load": 1}


def recorded(
    crawler: Crawler, noise: float, seed: int, *, end: float = 10.0, rate: float = 100.0
) -> Seen:
    """Actuator forces of a crawl, read between the instants at which they jump."""
    times = (np.arange(round(end * rate)) + 0.5) / rate
    seen = crawler.watch(np.append(0.0, times))
    values = {"actuator_force": seen.values["actuator_force"][:, 1:]}
    return disturb(replace(seen, time=times, values=values), {"actuator_force": noise}, seed)
