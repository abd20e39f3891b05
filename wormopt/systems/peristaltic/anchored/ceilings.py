"""Upper bound of the mean speed by rates of lengths and the number of anchors alone.

The mode program has a share of time and a displacement of every ring for each set of anchored
segments; all rings have the same total advance. It ignores the order of the sets, the stroke and
the clearance, so it bounds gaits with any number of phases. It is the mode program of worms with
spikes with another rule of rest; `mid` lets an anchored segment change its length about its
resting middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.numerics.linear_program import LinearProgram, Rows
from wormopt.systems.peristaltic.segment.segment import Anchoring

# Largest number of sets; 12 segments with any subset at rest have fewer.
_MOST_SETS = 1000


@dataclass(frozen=True, eq=False)
class ModeBound:
    """Result of `mode_bound`: no motion of any set of anchors has a larger weighted velocity."""

    speed: float  # upper bound of the mean speed; the least bound to about 1e-9
    weights: np.ndarray  # (N + 1,) of the rings, with sum 1


def mode_bound(
    segments: int, anchors: int, rate: tuple[float, float], anchoring: Anchoring = "clamp"
) -> ModeBound:
    """Return an upper bound of the mean speed, rigorous under round-off.

    Theory: docs/theory-peristaltic.md, section 3.

    Parameters
    ----------
    segments : int
        Number of segments N.
    anchors : int
        Least number of anchored segments at any time, 1 to N.
    rate : (float, float)
        Largest rates at which a length shrinks and grows.
    anchoring : {"clamp", "mid"}, optional
        Resting part of an anchored segment: both of its rings, or its middle.

    Returns
    -------
    ModeBound
        The bound in the unit of the rates.

    Raises
    ------
    ArgumentError
        If the number of anchors is not 1 to N, or there are too many sets of them.

    Examples
    --------
    >>> bounds = [mode_bound(5, 2, (1.0, 1.0), how) for how in ("clamp", "mid")]
    >>> [round(bound.speed, 6) for bound in bounds]
    [0.666667, 1.0]
    """
    if not 1 <= anchors <= segments:
        raise ArgumentError(f"{anchors} of {segments} segments anchored; write 1 to {segments}")
    if comb(segments, anchors) > _MOST_SETS:
        raise ArgumentError(f"{segments} segments have too many sets of {anchors} anchors to list")
    unit = max(rate)
    sets = list(combinations(range(segments), anchors))
    rows, count = Rows(), len(sets)
    (speed,) = rows.columns(np.array([float(segments)]))
    shares = rows.columns(np.ones(count))
    rings = range(segments + 1)
    free = np.array([[not _rests(i, rest, anchoring) for i in rings] for rest in sets])
    ways = rows.columns(np.where(free, 1.0, 0.0))  # from -N to N, below
    for j in range(segments):
        grows = [(ways[:, j], 1.0), (ways[:, j + 1], -1.0)]
        rows.add([*grows, (shares, -rate[1] / unit)], -np.inf, 0.0)
        rows.add([*grows, (shares, rate[0] / unit)], 0.0, np.inf)
    if anchoring == "mid":
        held = np.array([(k, j) for k, rest in enumerate(sets) for j in rest])
        rows.add([(ways[held[:, 0], held[:, 1] + d], 1.0) for d in (0, 1)], 0.0, 0.0)
    alike = np.concatenate(
        [
            rows.add([*((way, 1.0) for way in ways[:, i].tolist()), (int(speed), -1.0)], 0.0, 0.0)
            for i in rings
        ]
    )
    rows.add([(share, 1.0) for share in shares.tolist()], 1.0, 1.0)
    upper = np.array(rows.upper)
    upper[ways[free]] = segments
    lower = np.where(np.isin(np.arange(len(upper)), ways[free]), -upper, 0.0)
    cost = np.zeros(len(upper))
    cost[speed] = 1.0
    found = LinearProgram(cost, rows, lower, upper).maximise()
    weights = found.row_duals[alike]
    return ModeBound(found.bound * unit, weights / weights.sum())


def _rests(ring: int, rest: tuple[int, ...], anchoring: Anchoring) -> bool:
    return anchoring == "clamp" and (ring in rest or ring - 1 in rest)
