"""Power of bodies on dry ground as functions to minimise, with their slopes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wormopt.systems.planar.crawling.ground import Ground
from wormopt.systems.planar.crawling.line import Line

WIDTHS = 10.0 ** -np.arange(0, 9)
_TINY, _FARTHEST = 1e-100, 1e3
_STOPPED = 1e-13  # powers of masses that do not move
# Residual forces, residual steps, and speeds below which directions are smoothed.
_BALANCED, _NEAR, _SLOW = 1e-9, 1e-11, 1e-6
_STEPS, _SHORTENED, _SHARP, _SHARPENED, _ROUNDING, _LEVEL = 60, 40, 25, 12, 1e-13, 3e-15


@dataclass(frozen=True, eq=False)
class LeastPower:
    """Problem of G bodies: minimise sum psi_i(b_i + J_i x) - load.x over x (n,).

    Values are scaled to size 1.
    """

    J: np.ndarray  # (G, m, 2, n)
    b: np.ndarray  # (G, m, 2)
    load: np.ndarray  # (G, n)
    ground: Ground

    def of(self, points: np.ndarray) -> LeastPower:
        """Return some of the bodies."""
        ground = self.ground.of_bodies(points)
        return LeastPower(self.J[points], self.b[points], self.load[points], ground)

    def velocities(self, x: np.ndarray) -> np.ndarray:
        """Return velocities (G, m, 2) of the masses."""
        return self.b + np.einsum("gmcn,gn->gmc", self.J, x)

    def powers(self, x: np.ndarray) -> np.ndarray:
        """Return powers (G, m) dissipated by the ground."""
        return self.ground.power(self.velocities(x))

    def slopes(
        self, x: np.ndarray, width: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return value (G,), slope (G, n) and curvature (G, n, n) of the smoothed sum."""
        G, m, _, n = self.J.shape
        v = self.velocities(x)
        squares = self.ground.squares(v)
        push = squares * v
        size = np.maximum(np.sqrt((push * v).sum(axis=-1) + width**2), _TINY)[..., None]
        push = push / size
        value = size.sum(axis=(1, 2)) - (self.load * x).sum(axis=1)
        J = self.J.reshape(G, 2 * m, n)
        slope = (push.reshape(G, 1, -1) @ J)[:, 0] - self.load
        pull = (push[..., None] * self.J).sum(axis=2)
        first = ((squares / size).reshape(G, -1, 1) * J).transpose(0, 2, 1) @ J
        return value, slope, first - pull.transpose(0, 2, 1) @ (pull / size)

    def smooth_value(self, x: np.ndarray, width: float) -> np.ndarray:
        """Return the value of the smoothed sum."""
        v = self.velocities(x)
        size = np.sqrt((self.ground.squares(v) * v**2).sum(axis=-1) + width**2)
        return size.sum(axis=1) - (self.load * x).sum(axis=1)

    def restricted(self, x: np.ndarray, go: np.ndarray, N: np.ndarray) -> LeastPower:
        """Return the problem of masses that `go` (G, m), for x plus N (G, n, k) times unknowns."""
        of = go[..., None]
        return LeastPower(
            np.einsum("gmcn,gnk->gmck", self.J * of[..., None], N),
            self.velocities(x) * of,
            np.einsum("gnk,gn->gk", N, self.load),
            self.ground,
        )

    def along(self, x: np.ndarray, way: np.ndarray) -> Line:
        """Return the problem on lines from `x` (G, n) along `way`."""
        v, by = self.velocities(x), np.einsum("gmcn,gn->gmc", self.J, way)
        ground = self.ground
        ahead, back, aside = (
            np.broadcast_to(f, v.shape[:2]).T
            for f in (ground.forward, ground.backward, ground.sideways)
        )
        return Line(
            v[..., 0].T, aside * v[..., 1].T, by[..., 0].T, aside * by[..., 1].T,
            ahead, back, (self.load * way).sum(axis=1),
        )  # fmt: skip

    def smoothed(self, widths: np.ndarray = WIDTHS, x: np.ndarray | None = None) -> np.ndarray:
        """Minimise sum sqrt(psi_i^2 + width^2) - load.x for decreasing widths, from `x` on."""
        x = self._squares() if x is None else x
        for width in widths:
            x = self.descended(x, float(width), 1e-9)
        return x

    def sharp(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Minimise the power without smoothing from `x` on; flag where no mass stops.

        The second of three results has velocities (G, m, 2) in balance, which round-off of `x`
        would blur.
        """
        x, found = _sharpened(self, x)
        v = self.velocities(x)
        free = np.abs(self.J).max(axis=(2, 3), initial=0.0) > 0
        slowest = np.where(free, self.powers(x), 1.0).min(axis=1)
        left = np.flatnonzero(~found & (slowest < _SLOW))
        if left.size:
            # Round-off blurs the direction of a mass that hardly moves; relative to x it does not.
            bad = self.of(left).seen_from(x[left], np.zeros((len(left), self.b.shape[1]), bool))
            z, found[left] = _sharpened(bad, np.zeros(bad.load.shape))
            x[left] += z
            v[left] = bad.velocities(z)
            slowest[left] = np.where(free[left], bad.powers(z), 1.0).min(axis=1)
        return x, v, found & (slowest > _STOPPED)  # pushes of resting masses may balance as well

    def seen_from(self, x: np.ndarray, rest: np.ndarray) -> LeastPower:
        """Return the problem for changes of `x` (G, n), with the masses `rest` (G, m) at rest."""
        return replace(self, b=self.velocities(x) * ~rest[..., None])

    def descended(self, x: np.ndarray, width: float, last: float) -> np.ndarray:
        """Minimise a convex sum by Newton's steps, each shortened until it descends.

        `numerics.newton` reduces the slope, which is bounded far out, so it would diverge.
        """
        x = x.copy()
        free = np.abs(self.J).max(axis=(2, 3), initial=0.0) > 0
        open_ = np.arange(len(x))
        for _ in range(_STEPS if width else _SHARP):
            body = self.of(open_)
            value, slope, curvature = body.slopes(x[open_], width)
            step = _step(slope, curvature)
            # Between kinks a sum along one line is linear: the step would diverge.
            most = _FARTHEST * (1 + np.abs(x[open_]).max(axis=1))
            step *= np.minimum(1, most / np.maximum(np.abs(step).max(axis=1), _TINY))[:, None]
            small = np.abs(step).max(axis=1) < last * (1 + np.abs(x[open_]).max(axis=1))
            if not width:  # the direction of a slow mass depends on equally small steps
                slow = np.where(free[open_], body.powers(x[open_]), 1.0).min(axis=1) / _SLOW
                small &= np.abs(step).max(axis=1) < last * np.minimum(1, slow)
            # With little curvature, round-off of the slope moves the minimum by more than that.
            small |= np.abs(slope).max(axis=1) < _LEVEL
            x[open_[small]] += step[small]
            body, open_, step = body.of(~small), open_[~small], step[~small]
            if not open_.size:
                break
            factor = body.shortened(x[open_], step, value[~small], slope[~small], width)
            x[open_] += factor[:, None] * step
            open_ = open_[factor > 0]
            if not open_.size:
                break
        return x

    def shortened(
        self, x: np.ndarray, step: np.ndarray, value: np.ndarray, slope: np.ndarray, width: float
    ) -> np.ndarray:
        """Return the factor of each step; 0 if none descends.

        Values are less accurate than slopes: near the minimum they differ by round-off only.
        """
        falls = (slope * step).sum(axis=1)
        level = _ROUNDING * np.abs(value)
        factor, worse = np.ones(len(x)), np.arange(len(x))
        for _ in range(_SHORTENED if width else _SHARPENED):
            part = self.of(worse)
            by = factor[worse, None] * step[worse]
            tried = part.smooth_value(x[worse] + by, width)
            clear = -factor[worse] * falls[worse] > level[worse]
            good = clear & (tried <= value[worse] + 1e-4 * factor[worse] * falls[worse])
            doubt = ~good & (tried <= value[worse] + level[worse])
            if doubt.any():
                some = worse[doubt]
                after = self.of(some).slopes(x[some] + by[doubt], width)[1]
                good[doubt] = np.abs((after * step[some]).sum(axis=1)) <= -falls[some] / 2
            worse = worse[~good]
            if not worse.size:
                return factor
            factor[worse] /= 2
        factor[worse] = 0.0
        return factor

    def _squares(self) -> np.ndarray:
        """Minimise the sum of squared powers, with equal resistance forward and backward."""
        weights = self.ground.squares(np.ones((*self.b.shape[:2], 2)))
        H = np.einsum("gmcn,gmc,gmck->gnk", self.J, weights, self.J)
        g = np.einsum("gmcn,gmc,gmc->gn", self.J, weights, self.b)
        return _step(g, H)


def _step(slope: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """Return Newton's step, with minimal added curvature where there might be none."""
    n = slope.shape[1]
    usual = np.trace(curvature, axis1=1, axis2=2)[:, None, None]
    ridge = (1e-15 * usual + _TINY) * np.eye(n)
    try:
        return -np.linalg.solve(curvature + ridge, slope[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one is so steep that round-off absorbs the added curvature
        return -(np.linalg.pinv(curvature, hermitian=True) @ slope[..., None])[..., 0]


def _sharpened(body: LeastPower, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimise the power by Newton's steps from `x` (G, n), and flag those ended in balance."""
    x = body.descended(x, 0.0, 1e-13)
    _, slope, curvature = body.slopes(x)
    step = np.abs(_step(slope, np.nan_to_num(curvature))).max(axis=1, initial=0.0)
    near = step < _NEAR * (1 + np.abs(x).max(axis=1, initial=0.0))
    return x, near & (np.abs(slope).max(axis=1, initial=0.0) < _BALANCED)
