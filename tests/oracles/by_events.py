"""Chains of any number of links in NumPy, each mass on ground of its own, with scipy's events.

Shares nothing with the package. A law is (force while sliding forward, the same backward, least
and largest force at rest); one without forces at rest is drag alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
Slip = Callable[[float], float]


@dataclass
class Ground:
    """Forces on one mass."""

    ahead: Slip
    behind: Slip
    least: float
    most: float

    @property
    def dry(self) -> bool:
        return self.least < self.most

    def at_rest(self, needed: float) -> int:
        """Direction in which a mass goes that `needed` would hold."""
        return 1 if needed < self.least else -1 if needed > self.most else 0

    def nearer(self, needed: float) -> int:
        """Direction of the bound that has just been reached."""
        return 1 if abs(needed - self.least) < abs(needed - self.most) else -1


def coulomb(forward: float, backward: float, excess: float = 1.0) -> Ground:
    return Ground(lambda v: -forward, lambda v: backward, -forward * excess, backward * excess)


def stribeck(forward: float, backward: float, excess: float, scale: float) -> Ground:
    def slip(force: float, v: float) -> float:
        return force * (1 + (excess - 1) * np.exp(-((v / scale) ** 2)))

    return Ground(
        lambda v: -slip(forward, v), lambda v: slip(backward, v),
        -forward * excess, backward * excess,
    )  # fmt: skip


def viscous(drag: float) -> Ground:
    return Ground(lambda v: -drag * v, lambda v: -drag * v, 0.0, 0.0)


def spike() -> Ground:
    return Ground(lambda v: 0.0, lambda v: 0.0, 0.0, np.inf)


class Trials:
    """Gains that jump, in the words of the docstring: trial i and its bound on |e|."""

    def __init__(self, e: float, lam: float, settling: float, overshoot: float, factor: float):
        self.lam, self.factor, self.gain = lam, factor, 1.0
        self.q = factor**-0.5
        self.time, self.margin = settling * (1 - self.q), overshoot * (1 - self.q)
        self.end, self.bound = self.time, max(e, lam) + self.margin

    def happen(self, t: float, e: float, settles: bool) -> None:
        if settles:
            self.bound, self.end = self.lam, np.inf
        if not settles or e > self.lam:
            self.time, self.margin = self.q * self.time, self.q * self.margin
            self.gain *= self.factor
            self.end, self.bound = t + self.time, max(e, self.lam) + self.margin


Control = Callable[[float, Array, Array, Array, Array], tuple[Array, Array]]
"""u and the rates of the controller's states, from t, e, e', these states and e(t - lag)."""


@dataclass
class Followed:
    """m, c, d, l0, drag of the worm, its ground, and a loop closed around it."""

    numbers: dict[str, Any]
    ground: Sequence[Ground]
    reference: Callable[[float], tuple[Array, Array]]
    control: Control
    by_springs: bool = False  # u moves rest lengths
    lag: float = np.inf
    trials: Trials | None = None
    past: list[tuple[float, Any]] = field(default_factory=list)

    def error(self, t: float, y: Array) -> tuple[Array, Array]:
        aim, speed = self.reference(t)
        x, v = np.split(y[: 2 * len(self.ground)], 2)
        return -np.diff(x) - aim, -np.diff(v) - speed

    def before(self, t: float) -> Array:
        for begin, course in reversed(self.past):
            if begin <= t - self.lag:
                return self.error(t - self.lag, course(t - self.lag))[0]
        return self.first

    def push(self, t: float, y: Array) -> tuple[Array, Array]:
        """Force on each mass but the ground's, and rates of the controller's states."""
        c, d, rest = (self.numbers[name] for name in ("stiffness", "damping", "rest_length"))
        x, v = np.split(y[: 2 * len(self.ground)], 2)
        e, rate = self.error(t, y)
        u, rates = self.control(t, e, rate, y[2 * len(self.ground) :], self.before(t))
        mu = c * (-np.diff(x) - rest) - d * np.diff(v) - (c * u if self.by_springs else u)
        return np.append(0, mu) - np.append(mu, 0) - self.numbers["drag"] * v, rates

    def rhs(self, t: float, y: Array) -> Array:
        push, rates = self.push(t, y)
        v = y[len(self.ground) : 2 * len(self.ground)]
        force = [
            g.ahead(s) if way > 0 else g.behind(s) if way < 0 else -p
            for g, s, way, p in zip(self.ground, v, self.ways, push, strict=True)
        ]
        return np.concatenate([v, (push + force) / self.numbers["mass"], rates])

    def run(self, y: Array, end: float) -> Array:
        """State at the end; `count` holds how often masses stick or turn."""
        t, self.count, masses = 0.0, 0, len(self.ground)
        self.first = self.error(0.0, y)[0]
        self.ways = np.where(y[masses : 2 * masses] < 0, -1, 1)
        self._decide(t, y, ())
        while t < end:
            events = self._events()
            part = solve_ivp(
                self.rhs, (t, min(t + self.lag, end)), y, "DOP853", rtol=1e-12, atol=1e-13,
                max_step=0.03, events=list(events.values()), dense_output=True,
            )  # fmt: skip
            self.past.append((t, part.sol))
            t, y = float(part.t[-1]), part.y[:, -1].copy()
            fired = [k for k, at in zip(events, part.t_events, strict=True) if len(at)]
            for k in fired:
                if isinstance(k, int):
                    y[masses + k] = 0.0
                elif self.trials is not None:
                    size = float(np.linalg.norm(self.error(t, y)[0]))
                    self.trials.happen(t, size, k == "settles")
            moved = [k for k in fired if isinstance(k, int)]
            let_go = [k for k in moved if self.ways[k] == 0]
            self.count += len(moved) - len(let_go)
            self._decide(t, y, let_go)
        return y

    def _decide(self, t: float, y: Array, let_go: Sequence[int]) -> None:
        needed = -self.push(t, y)[0]
        for i, ground in enumerate(self.ground):
            if ground.dry and y[len(self.ground) + i] == 0:
                self.ways[i] = ground.at_rest(needed[i])
                if self.ways[i] == 0 and i in let_go:  # at its bound rounding decides
                    self.ways[i] = ground.nearer(needed[i])

    def _events(self) -> dict[Any, Any]:
        found: dict[Any, Any] = {
            i: self._event(i, g, self.ways[i]) for i, g in enumerate(self.ground) if g.dry
        }
        if (trials := self.trials) is not None:
            found["fails"] = lambda t, y: trials.bound - np.linalg.norm(self.error(t, y)[0])
            found["settles"] = lambda t, y: trials.end - t
        for event in found.values():
            event.terminal, event.direction = True, -1
        return found

    def _event(self, i: int, ground: Ground, way: int) -> Any:
        def slides(t: float, y: Array) -> float:
            return way * y[len(self.ground) + i]

        def rests(t: float, y: Array) -> float:
            needed = -self.push(t, y)[0][i]
            return min(needed - ground.least, ground.most - needed)

        return slides if way else rests
