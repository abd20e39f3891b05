"""Least power with some masses held, and their pushes on the ground."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.reactions import RANK, reactions

FITS = 1e-12  # residual velocities of masses that can rest together
_NARROW = 10.0 ** -np.arange(0, 12)


@dataclass(frozen=True, eq=False)
class Held:
    """Bodies with some masses held."""

    x: np.ndarray  # (G, n)
    rest: np.ndarray  # (G, m), the masses held
    fits: np.ndarray  # (G,), whether these masses can rest at once
    balances: np.ndarray  # (G,), whether the others, all moving, balance
    v: np.ndarray  # (G, m, 2), velocities
    push: np.ndarray  # (G, m, 2), push of each mass on the ground
    hold: np.ndarray  # (G,), least possible largest gauge of the held masses' pushes
    slips: np.ndarray  # (G, m), which of them slip if the ground cannot hold all
    stiffness: np.ndarray  # (G,), least curvature in remaining unknowns, infinite without any

    def put(self, where: np.ndarray, other: Held) -> None:
        """Replace some bodies by others."""
        for field in fields(Held):
            getattr(self, field.name)[where] = getattr(other, field.name)

    def of(self, points: np.ndarray) -> Held:
        """Return some of the bodies."""
        return Held(*(getattr(self, field.name)[points] for field in fields(Held)))


def freedom(body: LeastPower, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the nearest `x` (G, n) with masses `rest` (G, m) at rest, free and fixed directions.

    Both directions are square (G, n, n), in columns and in rows, padded with zeros.
    """
    G, n = x.shape
    near, free, hindered = x.copy(), np.tile(np.eye(n), (G, 1, 1)), np.zeros((G, n, n))
    some = np.flatnonzero(rest.any(axis=1))
    if some.size:
        of = rest[some, :, None]
        JS = (body.J[some] * of[..., None]).reshape(len(some), -1, n)
        off = (body.velocities(x)[some] * of).reshape(len(some), -1)
        if JS.shape[1] < n:  # a single mass
            JS = np.concatenate([JS, np.zeros((len(some), n - JS.shape[1], n))], axis=1)
            off = np.concatenate([off, np.zeros((len(some), JS.shape[1] - off.shape[1]))], axis=1)
        columns, sizes, rows = np.linalg.svd(JS, full_matrices=False)
        in_way = sizes > RANK * sizes[:, :1]
        parts = np.einsum("gkn,gk->gn", columns, off)
        parts = np.divide(parts, sizes, np.zeros_like(parts), where=in_way)
        near[some] -= np.einsum("gnk,gn->gk", rows, parts)
        hindered[some] = rows * in_way[..., None]
        free[some] = (rows * ~in_way[..., None]).transpose(0, 2, 1)
    return near, free, hindered


def held(body: LeastPower, x: np.ndarray, rest: np.ndarray, *, careful: bool = True) -> Held:
    """Minimise the power with the masses `rest` (G, m) held, starting at `x` (G, n).

    `careful`: if the others do not balance at once, smoothing is used.
    """
    G, n = x.shape
    x, N, Q = freedom(body, x, rest)
    go = ~rest
    fits = np.abs(body.velocities(x) * rest[..., None]).max(axis=(1, 2), initial=0.0) < FITS
    balances, stiffness, v = np.ones(G, bool), np.full(G, np.inf), body.velocities(x)
    loose = np.flatnonzero((np.abs(N).max(axis=(1, 2), initial=0.0) > 0) & go.any(axis=1))
    if loose.size:
        free = body.of(loose).restricted(x[loose], go[loose], N[loose])
        z, v[loose], found = _from_lines(free, N[loose])
        if careful and not found.all():  # a mass that hardly moves needs a careful approach
            bad = free.of(~found)
            again = np.flatnonzero(~found)
            z[again], v[loose[again]], found[again] = bad.sharp(bad.smoothed(_NARROW))
        curvature = np.nan_to_num(free.slopes(z)[2])
        absent = np.eye(n) * (np.abs(N[loose]).max(axis=1) == 0)[:, None]
        most = np.trace(curvature, axis1=1, axis2=2)[:, None, None]
        stiffness[loose] = np.linalg.eigvalsh(curvature + (1 + most) * absent)[:, 0]
        balances[loose] = found
        x[loose] += (N[loose] @ z[..., None])[..., 0]
    power = np.maximum(body.ground.power(v), 1e-100)
    push = np.where(rest[..., None], 0.0, body.ground.squares(v) * v / power[..., None])
    slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
    hold, slips = np.zeros(G), np.zeros(rest.shape, bool)
    counts = rest.sum(axis=1)
    for k in np.unique(counts[counts > 0]):
        some = np.flatnonzero(counts == k)
        which = np.argsort(~rest[some], axis=1, kind="stable")[:, :k]
        at = (some[:, None], which)
        ground = body.ground
        ground = ground.of(which if ground.forward.ndim == 1 else at)
        resting = LeastPower(body.J[at], body.b[at], -slope[some], ground)
        push[at], hold[some], slips[at] = reactions(resting, Q[some])
    return Held(x, rest.copy(), fits, balances, v, push, hold, slips, stiffness)


def _from_lines(body: LeastPower, N: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return least power (G, n) in the directions N (G, n, n), its velocities, and a flag.

    In a single direction, and where Newton's steps end at a kink, bisection is used.
    """
    z, v, found = body.sharp(np.zeros(body.load.shape))
    ways = np.abs(N).max(axis=1) > 0
    one = np.flatnonzero(~found & (ways.sum(axis=1) == 1))
    if one.size:
        line = body.of(one)
        way = ways[one].astype(float)
        start = line.along(0 * way, way).least()[:, None] * way
        z[one], v[one], found[one] = line.sharp(start)
    return z, v, found
