"""Chains written out by hand in NumPy with an event loop over scipy, for checks of scenes.

Shares nothing with the package: equations (9) to (15) are typed in again.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray


def fast_gait(t: float, period: float, l0: float = 2.0, e: float = 0.15) -> tuple[Array, Array]:
    """Gait (15) and its rate."""
    s = (t / period) % 1.0
    w = 3 * np.pi / period
    c, n = np.cos(3 * np.pi * s), np.sin(3 * np.pi * s)
    first = (l0 * (1 - e * (-1 + c)), l0 * e * w * n) if s < 2 / 3 else (l0, 0.0)
    if s < 1 / 3:
        second = l0 * (1 - e * (1 - c)), -l0 * e * w * n
    elif s < 2 / 3:
        second = l0 * (1 - 2 * e), 0.0
    else:
        second = l0 * (1 - e * (1 + c)), l0 * e * w * n
    return np.array([first[0], second[0]]), np.array([first[1], second[1]])


class Chain:
    """Equal numbers for all masses and links; ``control`` gives u and the rates of its states.

    The ground holds a resting mass by any force in ``holds`` and resists a sliding one with
    ``slips`` (force on a mass that slides forward, backward).
    """

    def __init__(
        self,
        control: Callable[[float, Array, Array, Array], tuple[Array, Array]],
        *,
        c: float,
        d: float,
        l0: float,
        slips: tuple[float, float],
        holds: tuple[float, float],
        drag: float = 0.0,
        load: float = 0.0,
    ) -> None:
        self.control, self.c, self.d, self.l0 = control, c, d, l0
        self.slips, self.holds, self.drag, self.load = slips, holds, drag, load

    def push(self, t: float, y: Array) -> tuple[Array, Array]:
        """Force on each mass but the ground's, and the rates of the control's states."""
        x, v, extra = y[:3], y[3:6], y[6:]
        length, rate = x[:-1] - x[1:], v[:-1] - v[1:]
        u, rates = self.control(t, length, rate, extra)
        mu = self.c * (length - self.l0) + self.d * rate - u
        net = np.array([-mu[0], mu[0] - mu[1], mu[1]])
        return net - self.drag * v - self.load, rates

    def rhs(self, t: float, y: Array, modes: Array) -> Array:
        push, rates = self.push(t, y)
        ground = np.where(modes > 0, self.slips[0], np.where(modes < 0, self.slips[1], -push))
        return np.concatenate([y[3:6], np.where(modes == 0, 0.0, push + ground), rates])

    def decide(self, t: float, y: Array, modes: Array) -> Array:
        """Modes of masses without velocity."""
        push, _ = self.push(t, y)
        modes = modes.copy()
        for i in np.flatnonzero(y[3:6] == 0):
            low, high = self.holds
            modes[i] = 1 if -push[i] < low else -1 if -push[i] > high else 0
        return modes

    def run(self, y0: Sequence[float], end: float, breaks: Sequence[float]) -> tuple[Array, int]:
        """State at the end, and the number of sticks, releases and reversals."""
        y, t, count = np.array(y0, dtype=float), 0.0, 0
        modes = self.decide(t, y, np.sign(y[3:6]))
        stops = [*(b for b in breaks if 0 < b < end), end]
        while stops:
            found = solve_ivp(
                self.rhs,
                (t, stops[0]),
                y,
                "DOP853",
                args=(modes,),
                rtol=1e-12,
                atol=1e-13,
                events=[self._event(i, modes[i]) for i in range(3)],
            )
            t, y = found.t[-1], found.y[:, -1].copy()
            fired = [i for i in range(3) if len(found.t_events[i])]
            if not fired:
                stops.pop(0)
                modes = self.decide(t, y, modes)
                continue
            count += len(fired)
            before = modes.copy()
            for i in fired:
                y[3 + i] = 0.0
            modes = self.decide(t, y, modes)
            for i in fired:  # at its bound, rounding decides: what was let go goes
                if before[i] == 0 and modes[i] == 0:
                    push = self.push(t, y)[0][i]
                    middle = sum(np.clip(self.holds, -1e6, 1e6)) / 2
                    modes[i] = 1 if -push < middle else -1
        return y, count

    def _event(self, i: int, mode: float) -> Callable[[float, Array, Array], float]:
        def slides(t: float, y: Array, modes: Array) -> float:
            return mode * y[3 + i]

        def rests(t: float, y: Array, modes: Array) -> float:
            ground = -self.push(t, y)[0][i]
            return min(ground - self.holds[0], self.holds[1] - ground)

        event = slides if mode else rests
        event.terminal, event.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
        return event


def commanded(c: float, period: float, l0: float = 2.0) -> Callable[..., tuple[Array, Array]]:
    """Rest lengths commanded to follow gait (15), (11)."""
    return lambda t, length, rate, extra: (c * (fast_gait(t, period)[0] - l0), np.zeros(0))


def tracked(
    gamma: float, lam: float, ahead: Callable[[Array, Array], Array] | None = None
) -> Callable[..., tuple[Array, Array]]:
    """Tracker (13) of gait (15) with period 1; its state is k."""

    def control(t: float, length: Array, rate: Array, extra: Array) -> tuple[Array, Array]:
        reference, speed = fast_gait(t, 1.0)
        k, e, e_rate = extra[0], length - reference, rate - speed
        growth = gamma * max(np.sqrt(e @ e) - lam, 0.0) ** 2
        u = -(k * e + growth * e + k * e_rate)
        return u + (ahead(reference, speed) if ahead else 0.0), np.array([growth])

    return control


def thirds(period: float, end: float) -> list[float]:
    """Times at which the pieces of gait (15) meet."""
    return [k * period / 3 for k in range(1, int(3 * end / period) + 1)]
