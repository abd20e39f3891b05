"""Second route to slow crawls: smoothed laws, a frame at the tail, a product of exponentials.

It finds neither resting masses nor their breaks, and uses nothing of `Shape` or `Travel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.body.shape import Heading
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.crawling.balance import LeastPower
from wormopt.systems.planar.crawling.ground import Ground

_BEHIND = {"bisector": 0.5, "front": 1.0, "rear": 0.0}
_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3) / 6


def simulate_crawled(
    places: np.ndarray,
    stroke: Stroke,
    ground: Ground,
    lengths: Sequence[float] | None = None,
    heading: Heading = "bisector",
    looks: int = 64,
    *,
    steps: int = 256,
) -> tuple[np.ndarray, np.ndarray]:
    """Return places of the masses of a chain over one stroke, by steps of order 4.

    Across a break the order is 2. `places` (n + 1, 2) are the start; `lengths` are those of links
    that do not stretch (the stroke then has angles only). Returns phases (m,) and places
    (m, n + 1, 2): `looks` for each smooth part of the stroke, which takes at least `steps` steps.
    """
    dx, dy = places[-2] - places[-1]
    pose = np.array([*places[-1], np.arctan2(dy, dx)])
    tau, course = [np.zeros(1)], [places[None]]
    for a, b in pairwise(stroke.breaks):
        each = -(-steps // looks)
        ends = np.linspace(a, b, looks * each + 1)
        h = np.diff(ends)[:, None]
        inner = (ends[:-1, None] + h * _GAUSS).ravel()
        first, second = np.moveaxis(_twists(stroke, inner, lengths, heading, ground), 1, 0)
        # the logarithm of a step, to order 4
        moves = h / 2 * (first + second) + np.sqrt(3) / 12 * h**2 * _bracket(first, second)
        poses = _multiplied(pose, _exponential(moves))[each - 1 :: each]
        phases = ends[each::each]
        # at the end of a part the shape is that of this part, not of the next one
        shape = _chain(stroke.at(phases)[0], None, lengths)[0]
        tau.append(phases)
        course.append(poses[:, None, :2] + rotate(poses[:, None, 2], shape))
        pose = poses[-1]
    return np.concatenate(tau), np.concatenate(course)


def _twists(
    stroke: Stroke, tau: np.ndarray, lengths: Sequence[float] | None, heading: Heading,
    ground: Ground,
) -> np.ndarray:  # fmt: skip
    """Return velocities (G, 2, 3) of the tail's frame, by the phase, at pairs of phases (2 G,)."""
    s, ds = stroke.at(tau)
    places, rates, links, bends = _chain(s, ds, lengths)
    angle = np.concatenate(
        [links[:, :1], links[:, 1:] + _BEHIND[heading] * bends, links[:, -1:]], axis=1
    )
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    speed = np.maximum(np.abs(rates).max(axis=(1, 2)), 1e-300)
    size = np.sqrt((places**2).sum(axis=-1).mean(axis=-1))
    lever = np.stack([-places[..., 1], places[..., 0]], axis=-1) / size[:, None, None]

    def own(v: np.ndarray) -> np.ndarray:
        """Return components along and across the headings."""
        return np.stack([(along * v).sum(axis=-1), (across * v).sum(axis=-1)], axis=-1)

    J = np.stack([along, across], axis=-2)
    J = np.concatenate([J, own(lever)[..., None]], axis=-1)
    force = float(ground.sideways.mean())
    unit = Ground(ground.forward / force, ground.backward / force, ground.sideways / force)
    body = LeastPower(J, own(rates) / speed[:, None, None], np.zeros((len(tau), 3)), unit)
    twist = body.smoothed() * speed[:, None]
    twist[:, 2] /= size
    return twist.reshape(-1, 2, 3)


def _chain(
    s: np.ndarray, ds: np.ndarray | None, lengths: Sequence[float] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return places, velocities (G, n + 1, 2) from the tail, angles (G, n) of links and joints."""
    ds = np.zeros_like(s) if ds is None else ds
    n = s.shape[1] + 1 if lengths is not None else (s.shape[1] + 1) // 2
    joints = s.shape[1] - (n - 1)
    size = s[:, :joints] if lengths is None else np.tile(np.asarray(lengths), (len(s), 1))
    stretch = ds[:, :joints] if lengths is None else np.zeros_like(size)
    links, turning = (_summed(x[:, joints:]) for x in (s, ds))
    e = np.stack([np.cos(links), np.sin(links)], axis=-1)
    normal = np.stack([-e[..., 1], e[..., 0]], axis=-1)
    places = _summed(size[..., None] * e)
    rates = _summed(stretch[..., None] * e + (size * turning)[..., None] * normal)
    return places, rates, links, s[:, joints:]


def _summed(values: np.ndarray) -> np.ndarray:
    """Return cumulative sums (G, n + 1, ...) from the tail, starting at 0, of n terms."""
    sums = np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
    return np.concatenate([sums, np.zeros_like(values[:, :1])], axis=1)


def _bracket(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x = b[:, 1] * -a[:, 2] + a[:, 1] * b[:, 2]
    y = b[:, 0] * a[:, 2] - a[:, 0] * b[:, 2]
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def _exponential(moves: np.ndarray) -> np.ndarray:
    """Return displacements (G, 3) by constant twists."""
    half = moves[:, 2] / 2
    chord = np.sinc(half / np.pi)
    return np.column_stack([rotate(half, chord[:, None] * moves[:, :2]), moves[:, 2]])


def _multiplied(start: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return poses (G, 3) after successive displacements."""
    angles = start[2] + np.cumsum(moves[:, 2])
    before = np.append(start[2], angles[:-1])
    places = start[:2] + np.cumsum(rotate(before, moves[:, :2]), axis=0)
    return np.column_stack([places, angles])
