"""The motion of a worm with stepped links and bristles that slip back a little.

It models the prototype in section 2.5 of Zimmermann et al. 2007. Lengths are prescribed, so the
only unknown is the position of the whole worm. A bristle lets its mass slip back by `backslip` from
its foremost position and then holds. The worm is never ahead of where the bristles hold it, which
is w = 0 in eq. 7 under a sufficient load: x_0 = max over i of (S_i + h_i), where h_i is the
position at which mass i is held.

While all lengths change linearly, velocities never decrease (x_0 is a maximum of linear functions),
so no mass moves back after it moved forward. The positions at the end of such a piece are therefore
exact without intermediate points. The motion is a linear map over (max, +), and the mean speed is
its largest mean weight of a cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import add

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.spiked.stepper.steps import Steps

_TOGETHER = 1e-9  # of the period: steps closer than this are one move
_BATCH = 4096


@dataclass(frozen=True, eq=False)
class BristleMotion:
    """Periodic motion of a stepped worm, up to its advance."""

    time: np.ndarray  # (m,) times from 0 to the period: the start, and the end of each move
    position: np.ndarray  # (n+1, m) positions of the masses; the head starts at 0
    speed: float  # mean speed, from the largest cycle mean
    # difference of the motion over a period from its advance by `speed`, a length
    period_error: float

    @property
    def advance(self) -> float:
        """Distance travelled per period, from the motion itself."""
        return float(self.position[0, -1] - self.position[0, 0])


def ratchet(steps: Steps, backslip: float, settle_time: float = 0.0) -> BristleMotion:
    """Compute the motion of a worm on bristles under the steps of its motors.

    Parameters
    ----------
    steps : Steps
        Steps of one period, which repeats.
    backslip : float
        Distance that a mass slips back before its bristles hold.
    settle_time : float, optional
        Time that a link takes for a step at a constant rate; 0 is immediate. Steps that follow
        each other faster add up.

    Returns
    -------
    BristleMotion
        The periodic motion.

    Raises
    ------
    ArgumentError
        If `backslip` or `settle_time` is negative or not finite, or if `settle_time` is not below
        the period.

    Notes
    -----
    Steps of several motors less than 1e-9 of a period apart are one linear move.

    Examples
    --------
    Two masses: in every stroke both handovers cost one backslip.

    >>> import numpy as np
    >>> once = np.arange(1, 9) / 10
    >>> zigzag = np.repeat([1, -1], 4)
    >>> steps = Steps(1.0, 1.0, np.array([10.0]), once, np.zeros(8, int), zigzag)
    >>> [ratchet(steps, slip).speed for slip in (0.0, 0.5, 3.0)]
    [4.0, 3.0, 0.0]
    """
    if not 0 <= backslip < np.inf:
        raise ArgumentError(f"backslip must be finite and not negative, not {backslip!r}")
    if not 0 <= settle_time < steps.period:
        raise ArgumentError(
            f"settle_time must be at least 0 and below the period {steps.period:g}, not "
            f"{settle_time!r}"
        )
    # in microsteps, so that counts are whole numbers
    slip = backslip / steps.travel
    time, counts = _ramped(steps, settle_time) if settle_time else _held(steps)
    spans = np.vstack([np.zeros(len(time)), np.cumsum(counts, axis=0)])
    mean, held = _cycle_mean(_period_map(spans[:, 1:], slip))
    place, left = _follow(spans, held, slip, mean)
    start = np.concatenate([[0.0], np.cumsum(steps.start)])
    return BristleMotion(
        time,
        steps.travel * place - start[:, None],
        steps.travel * mean / steps.period,
        steps.travel * left,
    )


def _held(steps: Steps) -> tuple[np.ndarray, np.ndarray]:
    """Times, and the counts of all motors from then on; simultaneous steps are joined."""
    moves = np.zeros((steps.links, len(steps.time)))
    moves[steps.motor, np.arange(len(steps.time))] = steps.direction
    counts = np.cumsum(moves, axis=1)
    last = np.append(np.diff(steps.time) > _TOGETHER * steps.period, True)[: len(steps.time)]
    none = np.zeros((steps.links, 1))
    return (
        np.concatenate([[0.0], steps.time[last], [steps.period]]),
        np.hstack([none, counts[:, last], counts[:, -1:] if len(steps.time) else none]),
    )


def _ramped(steps: Steps, settle_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of lengths with ramped steps, and the lengths there."""
    period, sign = steps.period, steps.direction.astype(float)
    begin, end = steps.time, steps.time + settle_time
    over = end > period
    corners = np.unique(np.concatenate([[0.0, period], begin, np.where(over, end - period, end)]))
    corners = corners[np.append(np.diff(corners) > 1e-14 * period, True)]
    corners[-1] = period
    rows = []
    for j in range(steps.links):
        own = steps.motor == j
        if not own.any():
            rows.append(np.zeros(len(corners)))
            continue
        # a ramp from the period before is partly done at 0, and continues
        first = np.concatenate([begin[own] - period, begin[own]])
        rows.append(_ramps(first, np.tile(sign[own], 2), settle_time, corners))
    return corners, np.array(rows)


def _ramps(begin: np.ndarray, sign: np.ndarray, settle_time: float, t: np.ndarray) -> np.ndarray:
    """Sum of ramps of height +1 or -1 at times t; 0 before the first begins."""
    knots = np.concatenate([begin, begin + settle_time])
    slopes = np.concatenate([sign, -sign]) / settle_time
    order = np.argsort(knots, kind="stable")
    knots, rate = knots[order], np.cumsum(slopes[order])
    level = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(knots))])
    # between steps the motor is at a whole count: rounding of one ramp does not propagate
    active = np.cumsum(np.concatenate([np.ones(len(begin)), -np.ones(len(begin))])[order])
    idle = active == 0
    last = np.maximum.accumulate(np.where(idle, np.arange(len(idle)), 0))
    level = level + np.where(idle, np.rint(level) - level, 0.0)[last]
    rate = np.where(idle, 0.0, rate)
    at = np.searchsorted(knots, t, side="right") - 1
    return np.where(at >= 0, level[at] + rate[at] * (t - knots[at]), 0.0)


def _period_map(spans: np.ndarray, slip: float) -> np.ndarray:
    """Matrix over (max, +) from the held positions to those a period later."""
    # After a move the worm is at x_0 = max_k (S_k + h_k), then h_i is max(h_i, x_0 - S_i - slip).
    masses = len(spans)
    whole = np.where(np.eye(masses, dtype=bool), 0.0, -np.inf)
    for first in range(0, spans.shape[1], _BATCH):
        part = spans[:, first : first + _BATCH].T
        moves = part[:, None, :] - part[:, :, None] - slip
        diagonal = np.arange(masses)
        moves[:, diagonal, diagonal] = 0.0
        while len(moves) > 1:
            odd = moves[-1:] if len(moves) % 2 else moves[:0]
            even = moves[: len(moves) - len(odd)]
            joined = (even[1::2, :, :, None] + even[::2, None, :, :]).max(axis=2)
            moves = np.concatenate([joined, odd])
        whole = (moves[0][:, :, None] + whole[None]).max(axis=1)
    return whole


def _cycle_mean(matrix: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest mean weight of a cycle (Karp 1978), and an eigenvector: matrix v = mean + v."""
    size = len(matrix)
    walks = [np.where(np.arange(size) == 0, 0.0, -np.inf)]
    for _ in range(size):
        walks.append((matrix + walks[-1]).max(axis=1))
    ends = np.array(walks)
    with np.errstate(invalid="ignore"):
        means = (ends[-1] - ends[:-1]) / (size - np.arange(size))[:, None]
    means[np.isneginf(ends[:-1])] = np.inf
    mean = float(means.min(axis=0).max())
    # paths of any length in matrix - mean: none gains on a cycle
    paths = matrix - mean
    for k in range(size):
        paths = np.maximum(paths, paths[:, k : k + 1] + paths[k : k + 1])
    critical = int(np.diag(paths).argmax())
    return mean, paths[:, critical]


def _follow(
    spans: np.ndarray, held: np.ndarray, slip: float, mean: float
) -> tuple[np.ndarray, float]:
    """Positions of the masses after every move of a period, and the closing error."""
    hold, head = held.tolist(), []
    for span in spans.T.tolist():
        x = max(map(add, span, hold))
        head.append(x)
        hold = [max(h, x - s - slip) for h, s in zip(hold, span, strict=True)]
    x0 = np.array(head)
    left = float(np.abs(np.array(hold) - held - mean).max())
    left = max(left, abs(x0[-1] - x0[0] - mean))
    return x0 - x0[0] - spans + spans[:, :1], left
