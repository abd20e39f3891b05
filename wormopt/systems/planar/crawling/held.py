"""Least power where some masses are held at rest, and whether the ground can hold them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.reactions import split_pair

_FITS = 1e-10  # rates at which masses part that can rest together
_BALANCED = 1e-9  # forces that are left
_RANK, _ROUNDING, _SLOWEST = 1e-9, 1e-14, 1e-9
_NARROW = 10.0 ** -np.arange(0, 12)


@dataclass(frozen=True, eq=False)
class Held:
    """Bodies of which some masses are held."""

    x: np.ndarray  # (G, n)
    fits: np.ndarray  # (G,), whether these masses can rest at once
    balances: np.ndarray  # (G,), whether the others, all moving, balance
    push: np.ndarray  # (G, m, 2), what each mass pushes against the ground with
    hold: np.ndarray  # (G,), least largest gauge of the pushes of the masses held
    slips: np.ndarray  # (G, m), which of them slip when the ground cannot hold all
    stiffness: np.ndarray  # (G,), least curvature where unknowns are left, infinite where none


def held(body: LeastPower, x: np.ndarray, rest: np.ndarray, *, careful: bool = True) -> Held:
    """Least power where the masses `rest` (m,) are held, begun at `x` (G, n).

    `careful`: where the others do not balance at once, they are approached by smoothing.
    """
    G, n = x.shape
    if not rest.any():
        every, none = np.tile(np.eye(n), (G, 1, 1)), np.zeros((G, 0, n))
        return _free(body, x, rest, every, none, careful)
    JS = body.J[:, rest].reshape(G, -1, n)
    _, sizes, rows = np.linalg.svd(JS)
    ranks = (sizes > _RANK * sizes[:, :1]).sum(axis=1)
    off = body.velocities(x)[:, rest].reshape(G, -1)
    x = x - (np.linalg.pinv(JS, rcond=_RANK) @ off[..., None])[..., 0]
    parts = [np.flatnonzero(ranks == rank) for rank in np.unique(ranks)]
    found = []
    for part, rank in zip(parts, np.unique(ranks), strict=True):
        free, hindered = rows[part, rank:].transpose(0, 2, 1), rows[part, :rank]
        found.append(_free(body.of(part), x[part], rest, free, hindered, careful))
    return _joined(found, np.concatenate(parts))


def _joined(found: list[Held], order: np.ndarray) -> Held:
    """Bodies in their order again."""
    back = np.argsort(order)
    return Held(
        *(np.concatenate([getattr(one, f.name) for one in found])[back] for f in fields(Held))
    )


def _free(
    body: LeastPower, x: np.ndarray, rest: np.ndarray, N: np.ndarray, Q: np.ndarray, careful: bool
) -> Held:
    """Let the other masses move along N (G, n, k), free of those held, whose rows Q span."""
    G, go = len(x), ~rest
    fits = np.abs(body.velocities(x)[:, rest]).max(axis=(1, 2), initial=0.0) < _FITS
    balances, stiffness = np.ones(G, bool), np.full(G, np.inf)
    if N.shape[2] and go.any():
        free = body.restricted(x, go, N)
        z, balances = free.sharp(np.zeros((G, N.shape[2])))
        if careful and not balances.all():  # a mass that hardly moves needs a careful approach
            bad = free.of(~balances)
            z[~balances], balances[~balances] = bad.sharp(bad.smoothed(_NARROW))
        _, left, curvature = free.slopes(z)
        # The direction of a mass that hardly moves is known no better than its velocity.
        slowest = np.maximum(free.powers(z).min(axis=1), _SLOWEST)
        balances &= np.abs(left).max(axis=1) < np.maximum(_BALANCED, _ROUNDING / slowest)
        stiffness = np.linalg.eigvalsh(np.nan_to_num(curvature))[:, 0]
        x = x + (N @ z[..., None])[..., 0]
    v = body.velocities(x)
    power = np.maximum(body.ground.power(v), 1e-300)
    push = np.where(rest[:, None], 0.0, body.ground.squares(v) * v / power[..., None])
    hold, slips = np.zeros(G), np.zeros((G, len(rest)), bool)
    if rest.any():
        slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
        push[:, rest], hold, slips[:, rest] = reactions(body, rest, Q, slope)
    return Held(x, fits, balances, push, hold, slips, stiffness)


def reactions(
    body: LeastPower, rest: np.ndarray, Q: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pushes (G, k, 2) of least largest gauge that balance `slope`, that gauge, and who slips.

    Q (G, r, n) spans what resting masses hinder.
    """
    G, n = slope.shape
    k, ground, JS = int(rest.sum()), body.ground.of(rest), body.J[:, rest]
    rows = JS.reshape(G, 2 * k, n)
    if k == 1 or (k == 2 and Q.shape[1] == 3):
        across = rows.transpose(0, 2, 1)
        push = (np.linalg.pinv(across) @ -slope[..., None]).reshape(G, k, 2)
        if k == 2:
            return split_pair(push, np.linalg.svd(across)[2][:, -1].reshape(G, 2, 2), ground)
        return push, ground.gauge(push)[:, 0], np.ones((G, 1), bool)
    g = (Q @ slope[..., None])[..., 0]
    some = np.flatnonzero(np.linalg.norm(g, axis=1) > 1e-13)
    push, hold, slips = np.zeros((G, k, 2)), np.zeros(G), np.zeros((G, k), bool)
    if some.size:
        reduced = LeastPower(
            (rows[some] @ Q[some].transpose(0, 2, 1)).reshape(len(some), k, 2, -1),
            np.zeros((len(some), k, 2)),
            -g[some],
            ground,
        )
        push[some], hold[some], slips[some] = load_gauge(reduced)
    return push, hold, slips


def load_gauge(body: LeastPower) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How much of what all masses at rest can hold a load is, by duality.

    It is the largest load.x among motions x that take the power 1. Gives the pushes (G, m, 2),
    the gauge (G,), and which masses slip first (G, m).
    """
    from wormopt.systems.planar.crawling.least_power import least_power  # it asks for gauges too

    size = np.linalg.norm(body.load, axis=1)
    along = body.load / size[:, None] ** 2
    M = np.linalg.svd(body.load[:, None, :])[2][:, 1:].transpose(0, 2, 1)
    inner = body.restricted(along, np.ones(body.J.shape[1], bool), M)
    # Motions along the load alone, and its unit, as they are for a body without load.
    b = np.einsum("gmcn,gn->gmc", body.J, along)
    scale = np.abs(b).max(axis=(1, 2))
    inner = LeastPower(inner.J, b / scale[:, None, None], np.zeros_like(inner.load), body.ground)
    least = least_power(inner)
    worth = inner.powers(least.x).sum(axis=1) * scale
    return least.push / worth[:, None, None], 1 / worth, ~least.rest
