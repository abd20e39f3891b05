"""Initial strokes of the search for gaits: random strokes within the limits, and their motion."""

from __future__ import annotations

import numpy as np

from wormopt.ocp.motion import Guess
from wormopt.systems.planar.body.se2 import compose, rotate
from wormopt.systems.planar.body.strokes import Harmonics
from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.ground import Dry
from wormopt.systems.planar.design.polygons import Steps

_HARMONICS = 2
_INSIDE = 0.9
# Where in their ranges angles of an inchworm are: off the middle, straight bodies may be open.
_BENT = 0.55


def chance_corners(aim: PlanarAim, random: np.random.Generator) -> np.ndarray:
    """Return corners (k, n_s) of a random stroke of a few harmonics, within the limits."""
    ranges = aim.ranges
    n_s = len(ranges)
    orders = 1.0 / np.arange(1, _HARMONICS + 1)[:, None] ** 2
    wave = Harmonics(
        np.zeros(n_s),
        random.normal(size=(_HARMONICS, n_s)) * orders,
        random.normal(size=(_HARMONICS, n_s)) * orders,
    )
    swing = wave.at(np.linspace(0, 1, 65))[0]
    swing /= np.abs(swing).max(axis=0)
    half = (ranges[:, 1] - ranges[:, 0]) / 2
    size = half * random.uniform(0.3, _INSIDE, n_s)
    middle = ranges.mean(axis=1) + (half - size) * random.uniform(-_INSIDE, _INSIDE, n_s)
    tau = np.arange(aim.corners) / aim.corners
    table = np.linspace(0, 1, 65)
    shape = np.stack([np.interp(tau, table, swing[:, i]) for i in range(n_s)], axis=1)
    corners = middle + size * shape
    if aim.start is not None:
        corners[0] = aim.start
    return corners


def first_corners(aim: PlanarAim, seed: int, k: int) -> np.ndarray:
    """Return corners (k, n_s) of start k: first a wave of lengths, if it moves forward.

    Further starts are random, from a seed.
    """
    lengths = np.char.startswith(np.array(aim.shape.names), "length")
    ahead = aim.purpose == "speed" and isinstance(aim.ground, Dry) and aim.start is None
    if k == 0 and ahead and lengths.sum() > 1 and aim.corners > lengths.sum():
        return _wave(aim, np.flatnonzero(lengths))
    return chance_corners(aim, np.random.default_rng([seed, k]))


def _wave(aim: PlanarAim, lengths: np.ndarray) -> np.ndarray:
    """Return an inchworm, slightly bent: one long link runs from head to tail, the rest short."""
    low, high = aim.ranges.T
    middle = low + _BENT * (high - low)
    table = np.tile(middle, (len(lengths) + 2, 1))
    table[:, lengths] = low[lengths]
    table[1 + np.arange(len(lengths)), lengths] = high[lengths]
    at = np.linspace(0, len(table) - 1, aim.corners, endpoint=False)
    rows = np.arange(len(table))
    return np.stack([np.interp(at, rows, column) for column in table.T], axis=1)


def guess_from(aim: PlanarAim, corners: np.ndarray) -> Guess:
    """Return the motion along a polygon at the highest rates, or uniform if time is irrelevant."""
    steps = Steps(aim.shape, aim.ground, parts=1, points=4)
    ends = np.roll(corners, -1, axis=0) if aim.closed else np.vstack([corners[1:], corners[-1:]])
    k = len(corners)
    way = ends - corners
    # poses at the corners and a few places between, by small straight steps
    parts = 8
    tau = (np.arange(k * parts) % parts / parts)[:, None]
    fine = np.repeat(corners, parts, axis=0) + tau * np.repeat(way, parts, axis=0)
    sides = steps.sides(np.vstack([fine, ends[-1:]]), closed=False)
    poses = [np.zeros(3)]
    for pose in sides.pose:
        poses.append(compose(poses[-1], pose))
    poses = np.array(poses)
    if aim.purpose == "speed":
        x, y, _ = poses[-1]
        ahead = -np.arctan2(y, x)
        drift = poses[-1, 2] * np.linspace(0, 1, len(poses))
        poses = np.column_stack([rotate(ahead, poses[:, :2]), poses[:, 2] + ahead - drift])
    t, breaks = np.linspace(0, 1, k * parts + 1), np.linspace(0, 1, k + 1)
    table = np.hstack([np.vstack([fine, ends[-1:]]), poses])
    inputs, twists = k * way, k * parts * sides.pose
    if aim.timed:
        pace = k * np.maximum(np.abs(way / aim.rates).max(axis=1), 1e-3 * aim.duration_usual)
        inputs = np.column_stack([inputs, pace])
        table = np.column_stack([table, np.interp(t, breaks, np.append(0, np.cumsum(pace) / k))])

    def side(at: np.ndarray, edges: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(edges) - 2)

    def states(at: np.ndarray) -> np.ndarray:
        return np.array([np.interp(at, t, column) for column in table.T])

    return Guess(
        1.0,
        states,
        lambda at: inputs[side(at, breaks)].T,
        algebraic=(lambda at: twists[side(at, t)].T) if isinstance(aim.ground, Dry) else None,
    )
