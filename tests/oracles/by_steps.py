"""Delay equations without remembering anything: all stretches at once, none interpolated.

With z_j(s) = y(j h + s) the equation y' = f(t, y(t), y(t - h)) is z_j' = f(j h + s, z_j, z_{j-1}),
an ordinary one on 0 <= s <= h once z_0(0) to z_j(0) are known. Each round adds one stretch, and
integrates those before it again. Shares nothing with the package.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.by_hand import Chain, fast_gait

Array = np.ndarray


def solve_smooth(
    f: Callable[[float, Array, Array], Array],
    y0: Array,
    lag: float,
    stretches: int,
    past: Callable[[float], Array],
) -> Array:
    """y at 0, lag, 2 lag, ..., (stretches + 1, n); `past` is y before 0."""
    found = [np.asarray(y0, dtype=float)]
    n = len(found[0])
    for _ in range(stretches):
        m = len(found)

        def rhs(s: float, z: Array, m: int = m) -> Array:
            blocks = [past(s - lag), *z.reshape(m, n)]
            return np.concatenate([f(j * lag + s, blocks[j + 1], blocks[j]) for j in range(m)])

        part = solve_ivp(rhs, (0.0, lag), np.concatenate(found), "DOP853", rtol=1e-13, atol=1e-14)
        found.append(part.y[-n:, -1])
    return np.array(found)


class DelayedTracker:
    """Three masses on dry ground follow gait (15) of period 1 by (13) with a delayed difference."""

    def __init__(self, lag: float, gamma: float, lam: float, slips: tuple[float, float]) -> None:
        self.lag, self.gamma, self.lam, self.past = lag, gamma, lam, np.zeros(2)
        self.chain = Chain(self.control, c=10, d=5, l0=2, slips=slips, holds=slips)

    def control(self, t: float, length: Array, rate: Array, extra: Array) -> tuple[Array, Array]:
        e, k = self.error(t, length), extra[0]
        growth = self.gamma * max(np.sqrt(e @ e) - self.lam, 0.0) ** 2
        return -(k * e + growth * e + k * (e - self.past) / self.lag), np.array([growth])

    def error(self, t: float, length: Array) -> Array:
        return length - fast_gait(t, 1.0)[0]

    def run(self, y0: Sequence[float], stretches: int) -> tuple[Array, int]:
        """State at the end, and the number of events on the last round."""
        starts = [np.array(y0, dtype=float)]
        self.first = self.error(0.0, starts[0][:2] - starts[0][1:3])
        self.past = self.first
        modes = [self.chain.decide(0.0, starts[0], np.sign(starts[0][3:6]))]
        count = 0
        for _ in range(stretches):
            y, mode, count = self._round(starts, [m.copy() for m in modes])
            starts.append(y)
            modes.append(mode)
        return starts[-1], count

    def _round(self, starts: list[Array], modes: list[Array]) -> tuple[Array, Array, int]:
        m, n, s, count = len(starts), len(starts[0]), 0.0, 0
        z = np.concatenate(starts)
        blocks = z.reshape(m, n)
        times = np.arange(m) * self.lag
        thirds = np.arange(1, 3 * m * self.lag + 2) / 3
        inner = {round(b - t, 12) for b in thirds for t in times if 1e-9 < b - t < self.lag - 1e-9}
        stops = [*sorted(inner), self.lag]
        while stops:
            events = [self._event(j, i, modes[j][i], n) for j in range(m) for i in range(3)]
            part = solve_ivp(
                lambda s, z: self._rhs(s, z.reshape(m, n), modes),
                (s, stops[0]),
                z,
                "DOP853",
                rtol=1e-13,
                atol=1e-14,
                events=events,
            )
            s, z = float(part.t[-1]), part.y[:, -1].copy()
            fired = [divmod(k, 3) for k in range(3 * m) if len(part.t_events[k])]
            if not fired:
                stops.pop(0)
            count += len(fired)
            blocks = z.reshape(m, n)
            for j, i in fired:
                self._happen(j, i, s, blocks, modes)
            if not fired and stops:
                for j in range(m):
                    self._recall(j, s, blocks)
                    modes[j] = self.chain.decide(times[j] + s, blocks[j], modes[j])
        return blocks[-1].copy(), modes[-1], count

    def _recall(self, j: int, s: float, blocks: Array) -> None:
        before = blocks[j - 1]
        self.past = (
            self.first if j == 0 else self.error((j - 1) * self.lag + s, before[:2] - before[1:3])
        )

    def _rhs(self, s: float, blocks: Array, modes: list[Array]) -> Array:
        parts = []
        for j, block in enumerate(blocks):
            self._recall(j, s, blocks)
            parts.append(self.chain.rhs(j * self.lag + s, block, modes[j]))
        return np.concatenate(parts)

    def _happen(self, j: int, i: int, s: float, blocks: Array, modes: list[Array]) -> None:
        before, t = modes[j][i], j * self.lag + s
        self._recall(j, s, blocks)
        blocks[j, 3 + i] = 0.0
        modes[j] = self.chain.decide(t, blocks[j], modes[j])
        if before == 0 and modes[j][i] == 0:  # at its bound, rounding decides
            push = self.chain.push(t, blocks[j])[0][i]
            modes[j][i] = 1 if -push < sum(self.chain.holds) / 2 else -1

    def _event(self, j: int, i: int, mode: float, n: int) -> Callable[[float, Array], float]:
        inner = self.chain._event(i, mode)

        def event(s: float, z: Array) -> float:
            blocks = z.reshape(-1, n)
            self._recall(j, s, blocks)
            return inner(j * self.lag + s, blocks[j], np.zeros(3))

        event.terminal, event.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
        return event
