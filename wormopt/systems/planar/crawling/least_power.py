"""The velocity of a body that takes the least power from dry ground, for many bodies at a time.

Masses move with v_i = b_i + J_i x; sought is the least of sum psi_i(v_i) - load.x, psi being the
norms of `Ground`. Where masses rest the sum has no slope: they are found by smoothed norms, and
then held exactly. By convexity a set of resting masses is the right one if the ground can hold it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.newton import newton
from wormopt.systems.planar.crawling.ground import Ground

_WIDTHS = 10.0 ** -np.arange(0, 9)
_NARROW = 10.0 ** -np.arange(0, 12)
_STILL = 1e-6  # slower than this against the fastest, a mass may be at rest
_HELD = 1e-10  # residual of what holds a set of masses
_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class LeastPower:
    """Bodies for which least power is sought, G at a time."""

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

    def power(self, x: np.ndarray) -> np.ndarray:
        """Power (G,) that the ground takes less what the load gives."""
        return self.ground.power(self.velocities(x)).sum(axis=1) - (self.load * x).sum(axis=1)


@dataclass(frozen=True, eq=False)
class Least:
    """Velocities of least power."""

    x: np.ndarray  # (G, n)
    rest: np.ndarray  # (G, m), whether a mass rests
    push: np.ndarray  # (G, m, 2), what each mass pushes against the ground with
    hold: np.ndarray  # (G,), least largest gauge of the pushes of resting masses
    stiffness: np.ndarray  # (G,), least curvature where unknowns are left, infinite where none


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
        J = p[:, : 2 * m * n].reshape(G, m, 2, n)
        b = p[:, 2 * m * n : 2 * m * (n + 1)].reshape(G, m, 2)
        v = b + np.einsum("gmcn,gn->gmc", J, x)
        squares = self.ground.squares(v)
        size = np.sqrt((squares * v**2).sum(axis=-1) + p[:, -1:] ** 2)
        size = np.maximum(size, 1e-300)
        return J, squares, squares * v / size[..., None], size

    def __call__(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        J, _, push, _ = self._parts(x, p)
        return np.einsum("gmcn,gmc->gn", J, push) - p[:, -1 - self.n : -1]

    def slopes(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        J, squares, push, size = self._parts(x, p)
        pull = np.einsum("gmcn,gmc->gmn", J, push)
        first = np.einsum("gmcn,gmc,gmck->gnk", J, squares / size[..., None], J)
        return first - np.einsum("gmn,gm,gmk->gnk", pull, 1 / size, pull)


def least_power(body: LeastPower) -> Least:
    """Find the velocities of least power; SolveError where the load outruns the ground."""
    G, m, _, n = body.J.shape
    balance = _Balance(m, n, body.ground)
    x = _first(body)
    for width in _WIDTHS:
        x = newton(balance, x, balance.pack(body, width), last_step=1e-9)[0]
    size = np.abs(body.ground.power(body.velocities(x)))
    usual = np.maximum(body.ground.power(body.b).max(axis=1), 1e-300)
    return settle(body, x, size <= _STILL * usual[:, None])


def _by_widths(balance: _Balance, body: LeastPower) -> tuple[np.ndarray, np.ndarray]:
    """Least power without smoothing, by ever less of it, and whether it was found."""
    x = _first(body)
    for width in _NARROW:
        x = newton(balance, x, balance.pack(body, width), last_step=1e-9)[0]
    return newton(balance, x, balance.pack(body, 0.0), last_step=1e-13)


def _first(body: LeastPower) -> np.ndarray:
    """Velocities of the least sum of squared powers, where ahead is as back."""
    weights = body.ground.squares(np.ones((*body.b.shape[:2], 2)))
    H = np.einsum("gmcn,gmc,gmck->gnk", body.J, weights, body.J)
    g = np.einsum("gmcn,gmc,gmc->gn", body.J, weights, body.b)
    return -np.linalg.solve(H, g[..., None])[..., 0]


def settle(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> Least:
    """Hold the masses that seem to rest, exactly, and change the set until the ground agrees."""
    G, m, _, n = body.J.shape
    x, rest = x.copy(), rest.copy()
    push, hold, stiffness = np.zeros((G, m, 2)), np.zeros(G), np.full(G, np.inf)
    open_ = np.arange(G)
    for _ in range(3 * m):
        again: list[int] = []
        for pattern in np.unique(rest[open_], axis=0):
            group = open_[(rest[open_] == pattern).all(axis=1)]
            found = held(body.of(group), x[group], pattern)
            good = found.fits & (found.hold <= 1 + 1e-9)
            x[group[found.fits]] = found.x[found.fits]
            push[group], hold[group], stiffness[group] = found.push, found.hold, found.stiffness
            rest[group[~good]] = found.next_rest[~good]
            again += group[~good].tolist()
        open_ = np.array(sorted(again), dtype=int)
        if not open_.size:
            return Least(x, rest, push, hold, stiffness)
    raise SolveError("no set of resting masses was found that the ground can hold")


@dataclass(frozen=True, eq=False)
class Held:
    """Least power with some masses held at rest."""

    x: np.ndarray
    fits: np.ndarray  # whether they can rest, and the others balance
    push: np.ndarray
    hold: np.ndarray
    stiffness: np.ndarray
    next_rest: np.ndarray  # (G, m), what to try instead


def held(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> Held:
    """Least power where the masses `rest` (m,) are held, begun at `x` (G, n)."""
    G, m, _, n = body.J.shape
    if not rest.any():
        N = np.broadcast_to(np.eye(n), (G, n, n))
        return _moving(body, x, rest, N, np.zeros((G, 0, n)), np.zeros(G))
    JS, bS = body.J[:, rest].reshape(G, -1, n), body.b[:, rest].reshape(G, -1)
    _, sizes, rows = np.linalg.svd(JS)
    ranks = (sizes > _RANK * sizes[:, :1]).sum(axis=1)
    fixed = np.linalg.pinv(JS, rcond=_RANK)
    x = x - np.einsum("gnk,gk->gn", fixed, np.einsum("gkn,gn->gk", JS, x) + bS)
    off = np.abs(np.einsum("gkn,gn->gk", JS, x) + bS).max(axis=1)
    found: list[tuple[np.ndarray, Held]] = []
    for rank in np.unique(ranks):
        part = np.flatnonzero(ranks == rank)
        N, Q = rows[part, rank:].transpose(0, 2, 1), rows[part, :rank]
        found.append((part, _moving(body.of(part), x[part], rest, N, Q, off[part])))
    joined: list[np.ndarray] = []
    for k in range(6):
        pieces = [_fields(one)[k] for _, one in found]
        whole = np.empty((G, *pieces[0].shape[1:]), pieces[0].dtype)
        for (part, _), piece in zip(found, pieces, strict=True):
            whole[part] = piece
        joined.append(whole)
    return Held(*joined)


def _fields(one: Held) -> tuple[np.ndarray, ...]:
    return one.x, one.fits, one.push, one.hold, one.stiffness, one.next_rest


def _moving(
    body: LeastPower,
    x: np.ndarray,
    rest: np.ndarray,
    N: np.ndarray,
    Q: np.ndarray,
    off: np.ndarray,
) -> Held:
    """Let the others move by what is left free, the columns of N (G, n, n_free)."""
    G, m, _, n = body.J.shape
    free, go = N.shape[2], ~rest
    fits, stiffness = off < _HELD, np.full(G, np.inf)
    if free and go.any():
        J = np.einsum("gmcn,gnf->gmcf", body.J[:, go], N)
        b, load = body.velocities(x)[:, go], np.einsum("gnf,gn->gf", N, body.load)
        reduced = LeastPower(J, b, load, body.ground.of(go))
        balance = _Balance(int(go.sum()), free, reduced.ground)
        p = balance.pack(reduced, 0.0)
        z, found = newton(balance, np.zeros((G, free)), p, last_step=1e-13)
        if not found.all():
            z[~found], found[~found] = _by_widths(balance, reduced.of(~found))
        left = np.abs(balance(z, p)).max(axis=1)
        fits &= found & (left < 1e-9)
        stiffness = np.linalg.eigvalsh(np.nan_to_num(balance.slopes(z, p)))[:, 0]
        x = x + np.einsum("gnf,gf->gn", N, z)
    v = body.velocities(x)
    power = body.ground.power(v)
    push = np.where(
        rest[:, None], 0.0, body.ground.squares(v) * v / np.maximum(power, 1e-300)[..., None]
    )
    slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
    hold, next_rest = np.zeros(G), np.tile(rest, (G, 1))
    if rest.any():
        pushes, hold, releases = _reactions(body, rest, Q, slope)
        push[:, rest] = pushes
        next_rest[:, rest] = ~releases
    slowest = np.where(rest, np.inf, power).argmin(axis=1)
    stuck = (off < _HELD) & ~fits
    next_rest[stuck] = rest
    next_rest[stuck, slowest[stuck]] = True
    wrong = off >= _HELD
    if wrong.any():
        next_rest[wrong] = rest
        next_rest[wrong, np.flatnonzero(rest)[-1]] = False
    return Held(x, fits, push, hold, stiffness, next_rest)


def _reactions(
    body: LeastPower, rest: np.ndarray, Q: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pushes (G, k, 2) of least largest gauge that balance `slope`, that gauge, who slips first."""
    G, _, _, n = body.J.shape
    k, ground = int(rest.sum()), body.ground.of(rest)
    JS = body.J[:, rest]
    if k == 1:
        push = np.linalg.pinv(JS[:, 0].transpose(0, 2, 1)) @ -slope[..., None]
        push = push[:, None, :, 0]
        return push, ground.gauge(push)[:, 0], np.ones((G, 1), bool)
    g = np.einsum("grn,gn->gr", Q, slope)
    size = np.linalg.norm(g, axis=1)
    push, hold, releases = np.zeros((G, k, 2)), np.zeros(G), np.ones((G, k), bool)
    some = np.flatnonzero(size > 1e-13)
    if not some.size:
        return push, hold, releases
    # Least power of the resting masses among motions against the slope of power 1.
    g, size, Q, JS = g[some], size[some], Q[some], JS[some]
    y = -g / size[:, None] ** 2
    M = np.linalg.svd(g[:, None, :])[2][:, 1:].transpose(0, 2, 1)
    JQ = np.einsum("gkcn,grn->gkcr", JS, Q)
    b = np.einsum("gkcr,gr->gkc", JQ, y)
    scale = np.abs(b).max(axis=(1, 2))
    inner = LeastPower(
        np.einsum("gkcr,gru->gkcu", JQ, M), b / scale[:, None, None], np.zeros(M.shape[::2]), ground
    )
    least = least_power(inner)
    worth = inner.power(least.x) * scale
    hold[some] = 1 / worth
    push[some] = least.push / worth[:, None, None]
    releases[some] = ~least.rest
    return push, hold, releases
