"""Pushes of resting masses on the ground, distributed as evenly as the ground allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.ground import Ground
from wormopt.systems.planar.crawling.pivots import pivots

RANK = 1e-9
_SAME = 1e-9  # gauges closer than this count as equal
_TINY = 1e-100


def reactions(body: LeastPower, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pushes (G, k, 2) of least largest gauge that carry a load, that gauge, who slips.

    The rows of Q (G, n, n) span the directions that the masses, all at rest, block.
    """
    G, k, _, n = body.J.shape
    rows = body.J.reshape(G, 2 * k, n)
    ranks = (np.abs(Q).max(axis=2) > 0).sum(axis=1)
    push, hold, slips = np.zeros((G, k, 2)), np.zeros(G), np.zeros((G, k), bool)
    for rank in np.unique(ranks):
        some = np.flatnonzero(ranks == rank)
        ground = body.ground.of_bodies(some)
        if k == 1 or (k == 2 and rank == 3):
            across = rows[some].transpose(0, 2, 1)
            pushes = np.linalg.pinv(across, rcond=RANK) @ body.load[some, :, None]
            pushes = pushes.reshape(-1, k, 2)
            if k == 2:
                way = np.linalg.svd(across)[2][:, -1].reshape(-1, 2, 2)
                push[some], hold[some], slips[some] = split_pair(pushes, way, ground)
            else:
                push[some], hold[some], slips[some] = pushes, ground.gauge(pushes)[:, 0], True
            continue
        span = Q[some][:, :rank]  # singular values fall
        load = (span @ body.load[some, :, None])[..., 0]
        borne = np.linalg.norm(load, axis=1) > 1e-13
        some, span, load = some[borne], span[borne], load[borne]
        if some.size:
            J = (rows[some] @ span.transpose(0, 2, 1)).reshape(len(some), k, 2, rank)
            resting = LeastPower(J, np.zeros((len(some), k, 2)), load, ground.of_bodies(borne))
            push[some], hold[some], slips[some], _ = load_gauge(resting)
    return push, hold, slips


def load_gauge(body: LeastPower) -> tuple[np.ndarray, ...]:
    """Return the load relative to the largest that all masses at rest can hold, by duality.

    It is the largest load.x among motions x of power 1. Returns the pushes (G, m, 2), the gauge
    (G,), which masses slip first (G, m), and their motion (G, n).
    """
    size = np.linalg.norm(body.load, axis=1)
    along = body.load / size[:, None] ** 2
    M = np.linalg.svd(body.load[:, None, :])[2][:, 1:].transpose(0, 2, 1)
    inner = body.restricted(along, np.ones(body.b.shape[:2], bool), M)
    inner = replace(inner, b=np.einsum("gmcn,gn->gmc", body.J, along), load=0 * inner.load)
    # Motions along the load alone, and its unit, as for a body without load.
    scale = np.abs(inner.b).max(axis=(1, 2))
    scale[scale == 0] = 1.0
    inner = replace(inner, b=inner.b / scale[:, None, None])
    push, slips, worth, z = (_across if M.shape[2] == 2 else _on_a_line)(inner)
    worth = np.maximum(worth * scale, _TINY)
    way = along + scale[:, None] * (M @ z[..., None])[..., 0]
    return push / worth[:, None, None], 1 / worth, slips, way


def _on_a_line(body: LeastPower) -> tuple[np.ndarray, ...]:
    """Return pushes, slipping masses, power and z, with one direction of motion or none."""
    z = np.zeros(body.load.shape)
    if z.size:
        z[:, 0] = body.along(z, np.ones(z.shape)).least()
    power = body.powers(z)
    return _pushes(body, body.velocities(z)), power > 0, power.sum(axis=1), z


def _across(body: LeastPower) -> tuple[np.ndarray, ...]:
    """Return these for two directions: one mass rests and the others turn about it, or none."""
    G, m = body.b.shape[:2]
    z, value = pivots(body)
    i, every = value.argmin(axis=1), np.arange(G)
    z, rests = z[every, i], np.isfinite(value[every, i])
    push = _pushes(body, body.velocities(z) * (np.arange(m) != i[:, None])[..., None])
    push[every, i], way = turned_out(body, push, i)
    rests &= body.ground.gauge(push)[every, i] <= 1
    go = np.flatnonzero(~rests)
    if go.size:
        moving, way = body.of(go), way[go]
        start = z[go] + moving.along(z[go], way).least()[:, None] * way
        z[go], v, found = moving.sharp(start)
        if (lost := np.flatnonzero(~found)).size:
            z[go[lost]], v[lost], _ = moving.of(lost).sharp(moving.of(lost).smoothed())
        push[go] = _pushes(moving, v)
    slips = np.ones((G, m), bool)
    slips[rests, i[rests]] = False
    return push, slips, body.powers(z).sum(axis=1), z


def _pushes(body: LeastPower, v: np.ndarray) -> np.ndarray:
    """Return pushes of masses with velocities `v` (G, m, 2), 0 for resting ones."""
    power = body.ground.power(v)
    return body.ground.squares(v) * v / np.maximum(power, _TINY)[..., None]


def turned_out(body: LeastPower, push: np.ndarray, i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the push (G, 2) of a resting mass i (G,) from the others', and its slip (G, n)."""
    every = np.arange(len(i))
    slope = np.einsum("gmcn,gmc->gn", body.J, push) - body.load
    back = np.linalg.pinv(body.J[every, i], rcond=RANK)
    own = -(back.transpose(0, 2, 1) @ slope[..., None])[..., 0]
    ground = body.ground
    ground = ground.of((every, i) if ground.forward.ndim == 2 else i)
    return own, (back @ (own / ground.squares(own))[..., None])[..., 0]


def split_pair(
    push: np.ndarray, way: np.ndarray, ground: Ground
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pushes (G, 2, 2) of two masses along a line with the least larger gauge.

    All pushes that balance are `push` + a `way`. Each squared gauge consists of parabolas in a, one
    for each of forward and backward resistance. The best a is therefore the minimum of one of them,
    or a crossing of two. Returns the pushes, the gauge, and which masses are at it (G, 2).
    """
    ahead = np.abs(way[..., 0]) > _TINY  # others do not turn, however far
    turns = np.divide(-push[..., 0], way[..., 0], out=np.zeros_like(push[..., 0]), where=ahead)
    turns = np.sort(turns, axis=1)
    gap = 1 + np.abs(turns).max(axis=1)
    inside = [turns[:, 0] - gap, turns.mean(axis=1), turns[:, 1] + gap]
    tried = [turns[:, 0], turns[:, 1]]
    for a in inside:
        squares = ground.squares(push + a[:, None, None] * way)
        c2, c1 = (way**2 / squares).sum(-1), 2 * (push * way / squares).sum(-1)
        c0 = (push**2 / squares).sum(-1)
        tried += [-c1[:, 0] / (2 * c2[:, 0]), -c1[:, 1] / (2 * c2[:, 1])]
        tried += _crossings(c2[:, 0] - c2[:, 1], c1[:, 0] - c1[:, 1], c0[:, 0] - c0[:, 1])
    a = np.stack(tried, axis=1)
    a[~(np.abs(a) < 1 / _TINY)] = 0.0
    wide = ground.of((slice(None), None))
    gauges = wide.gauge(push[:, None] + a[..., None, None] * way[:, None])
    worst = gauges.max(axis=-1)
    best = np.nanargmin(worst, axis=1)
    rows = np.arange(len(a))
    hold = worst[rows, best]
    at_it = gauges[rows, best] > hold[:, None] * (1 - _SAME)
    return push + a[rows, best][:, None, None] * way, hold, at_it


def _crossings(c2: np.ndarray, c1: np.ndarray, c0: np.ndarray) -> list[np.ndarray]:
    """Return both roots of parabolas, NaN if there are none."""
    with np.errstate(all="ignore"):
        root = np.sqrt(c1**2 - 4 * c2 * c0)
        q = -(c1 + np.where(c1 >= 0, root, -root)) / 2
        return [q / c2, c0 / q]
