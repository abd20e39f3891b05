"""What resting masses push against the ground with, where a rigid link leaves their split open."""

from __future__ import annotations

import numpy as np

from wormopt.systems.planar.crawling.ground import Ground

_SAME = 1e-9  # gauges nearer than this are the same


def split_pair(
    push: np.ndarray, way: np.ndarray, ground: Ground
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the pushes (G, 2, 2) of two masses along a line, those whose larger gauge is least.

    All pushes that balance are `push` + a `way`. Each gauge squared is made of parabolas in a,
    one for each side of the ground ahead and back, so that the best a is the lowest point of one
    of them, or where two cross. Gives the pushes, the gauge, and which masses are at it (G, 2).
    """
    turns = np.divide(
        -push[..., 0], way[..., 0], out=np.zeros_like(push[..., 0]), where=way[..., 0] != 0
    )
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
    gauges = ground.gauge(push[:, None] + a[..., None, None] * way[:, None])
    worst = gauges.max(axis=-1)
    best = np.nanargmin(worst, axis=1)
    rows = np.arange(len(a))
    hold = worst[rows, best]
    at_it = gauges[rows, best] > hold[:, None] * (1 - _SAME)
    return push + a[rows, best][:, None, None] * way, hold, at_it


def _crossings(c2: np.ndarray, c1: np.ndarray, c0: np.ndarray) -> list[np.ndarray]:
    """Both roots of parabolas, NaN where there are none."""
    with np.errstate(all="ignore"):
        root = np.sqrt(c1**2 - 4 * c2 * c0)
        q = -(c1 + np.where(c1 >= 0, root, -root)) / 2
        return [q / c2, c0 / q]
