"""Bodies on dry ground for which least power is sought, and the slopes of their power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.numerics.newton import newton
from wormopt.systems.planar.crawling.ground import Ground

_WIDTHS = 10.0 ** -np.arange(0, 9)
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class LeastPower:
    """Least of sum psi_i(b_i + J_i x) - load.x over x (n,), for G bodies at a time.

    Numbers are of the usual size 1.
    """

    J: np.ndarray  # (G, m, 2, n)
    b: np.ndarray  # (G, m, 2)
    load: np.ndarray  # (G, n)
    ground: Ground

    def of(self, points: np.ndarray) -> LeastPower:
        """Some of the bodies."""
        return LeastPower(self.J[points], self.b[points], self.load[points], self.ground)

    def velocities(self, x: np.ndarray) -> np.ndarray:
        """Velocities (G, m, 2) of the masses."""
        return self.b + np.einsum("gmcn,gn->gmc", self.J, x)

    def powers(self, x: np.ndarray) -> np.ndarray:
        """Powers (G, m) that the ground takes."""
        return self.ground.power(self.velocities(x))

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slope (G, n) and curvature (G, n, n) of the power, where every mass moves."""
        balance = _Balance(*self.J.shape[1::2], self.ground)
        p = balance.pack(self, 0.0)
        return balance(x, p), balance.slopes(x, p)

    def restricted(self, x: np.ndarray, masses: np.ndarray, N: np.ndarray) -> LeastPower:
        """Of some masses, with what is left free: the columns of N (G, n, k) from `x` on."""
        return LeastPower(
            np.einsum("gmcn,gnk->gmck", self.J[:, masses], N),
            self.velocities(x)[:, masses],
            np.einsum("gnk,gn->gk", N, self.load),
            self.ground.of(masses),
        )

    def smoothed(self, widths: np.ndarray = _WIDTHS) -> np.ndarray:
        """Least of sum sqrt(psi_i^2 + width^2) - load.x, by ever smaller widths."""
        balance, x = _Balance(*self.J.shape[1::2], self.ground), self._squares()
        for width in widths:
            x = newton(balance, x, balance.pack(self, width), last_step=1e-9)[0]
        return x

    def sharp(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least power without smoothing from `x` on, and whether it was found: masses all move."""
        balance = _Balance(*self.J.shape[1::2], self.ground)
        return newton(balance, x, balance.pack(self, 0.0), last_step=1e-13)

    def _squares(self) -> np.ndarray:
        """Least sum of squared powers, where ahead is as back."""
        weights = self.ground.squares(np.ones((*self.b.shape[:2], 2)))
        H = np.einsum("gmcn,gmc,gmck->gnk", self.J, weights, self.J)
        g = np.einsum("gmcn,gmc,gmc->gn", self.J, weights, self.b)
        return -np.linalg.solve(H, g[..., None])[..., 0]


class _Balance:
    """Slope of the smoothed power, for `newton`; its parameters are a body and a width."""

    def __init__(self, masses: int, unknowns: int, ground: Ground) -> None:
        self.m, self.n, self.ground = masses, unknowns, ground
        self.nominal = np.ones(unknowns)

    def pack(self, body: LeastPower, width: float) -> np.ndarray:
        """Parameters (G, n_p)."""
        G = len(body.b)
        flat = [body.J.reshape(G, -1), body.b.reshape(G, -1), body.load, np.full((G, 1), width)]
        return np.concatenate(flat, axis=1)

    def _parts(self, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
        G, m, n = len(x), self.m, self.n
        J = p[:, : 2 * m * n].reshape(G, 2 * m, n)
        v = p[:, 2 * m * n : 2 * m * (n + 1)] + (J @ x[:, :, None])[..., 0]
        v = v.reshape(G, m, 2)
        squares = self.ground.squares(v)
        push = squares * v
        size = np.sqrt((push * v).sum(axis=-1) + p[:, -1:] ** 2)[..., None]
        size = np.maximum(size, _TINY)
        return J, squares / size, push / size, size

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        J, _, push, _ = self._parts(x, p)
        return (push.reshape(len(x), 1, -1) @ J)[:, 0] - p[:, -1 - self.n : -1]

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        J, weights, push, size = self._parts(x, p)
        G = len(x)
        pull = (push[..., None] * J.reshape(G, self.m, 2, self.n)).sum(axis=2)
        first = (weights.reshape(G, -1, 1) * J).transpose(0, 2, 1) @ J
        return first - pull.transpose(0, 2, 1) @ (pull / size)
