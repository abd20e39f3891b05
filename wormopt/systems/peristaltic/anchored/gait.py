"""Gaits of a worm that anchors: a segment rests on the wall of its tube while it is short.

Segments are counted from 0 at the head, rings 0 to N bound them, forward is positive. Lengths are
counted from the shortest, at which a segment touches the wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.systems.shared.sequences import Sequence_

# Phases of a smaller share of the cycle last no time.
_NOTHING = 1e-9
# Ways of a smaller part of the largest are none.
_STILL = 1e-8


@dataclass(frozen=True, eq=False)
class AnchoredGait:
    """One cycle in phases; in each of them lengths change at constant rates.

    Segments that rest in a phase are anchored: short all the time, both of their rings at rest.
    """

    order: Sequence_  # segments anchored in each phase, ascending
    durations: np.ndarray  # (phases,)
    lengths: np.ndarray  # (phases, N) above the shortest, as each phase begins
    ways: np.ndarray  # (phases, N + 1) of the rings in each phase

    @property
    def segments(self) -> int:
        """Number of segments."""
        return self.lengths.shape[1]

    @property
    def period(self) -> float:
        """Duration of the cycle."""
        return float(self.durations.sum())

    @property
    def advance(self) -> float:
        """Way per cycle, of every ring the same."""
        return float(self.ways[:, 0].sum())

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.advance / self.period

    @property
    def changes(self) -> np.ndarray:
        """What lengths change by in each phase, (phases, N)."""
        return -np.diff(self.ways, axis=1)

    @cached_property
    def anchored(self) -> np.ndarray:
        """Whether a segment is anchored in a phase, (phases, N)."""
        return table_of(self.order, self.segments)

    @property
    def lasting(self) -> np.ndarray:
        """Whether a phase lasts, (phases,); one that does not is a touch of the wall."""
        return self.durations > _NOTHING * self.period

    def of_phases(self, kept: np.ndarray) -> AnchoredGait:
        """These phases alone, (phases,) true or false."""
        order = tuple(rest for rest, keep in zip(self.order, kept, strict=True) if keep)
        return AnchoredGait(order, self.durations[kept], self.lengths[kept], self.ways[kept])

    def faults(self) -> np.ndarray:
        """By how much lengths do not follow from the ways, and anchored segments move or are long.

        Two numbers that are 0 but for rounding.
        """
        course = np.roll(self.lengths, -1, axis=0) - self.lengths - self.changes
        moved = [self.ways[:, :-1], self.ways[:, 1:], self.lengths, np.roll(self.lengths, -1, 0)]
        return np.array([np.abs(course).max(), np.abs(np.where(self.anchored, moved, 0)).max()])

    def clearances(self) -> np.ndarray:
        """Greatest length of each flight, the time between two rests of a segment, (flights,).

        Above the shortest; of a segment that never rests, its least length.
        """
        tops: list[float] = []
        for lengths, rests in zip(self.lengths.T, self.anchored.T, strict=True):
            if not rests.any():
                tops.append(float(lengths.min()))
                continue
            begin = -int(np.argmax(rests))
            landed = False
            for length, rest in zip(np.roll(lengths, begin), np.roll(rests, begin), strict=True):
                if rest:
                    landed = True
                elif landed:
                    landed = False
                    tops.append(float(length))  # 0, as the flight begins
                else:
                    tops[-1] = max(tops[-1], float(length))
        return np.array(tops)

    def reserves(self, hold: float, drag: float, load: float = 0.0) -> np.ndarray:
        """By how many times anchors hold what they must, (phases,); NaN where one lasts no time.

        Friction of an anchored segment, drag of one that moves, load on the worm, as in
        `anchors_needed`.
        """
        moved = np.abs(self.ways[:, :-1] + self.ways[:, 1:]) > _STILL * np.abs(self.ways).max()
        needed = load + drag * moved.sum(axis=1)
        holds = hold * self.anchored.sum(axis=1)
        lasts = self.lasting & (needed > 0)
        return np.divide(holds, needed, out=np.full(len(holds), np.nan), where=lasts)

    def pushes(self, drag: float) -> np.ndarray:
        """Drag of the segments ahead of the one that grows at the foremost ring at rest, (phases,).

        What that one must push with; 0 where a phase lasts no time.
        """
        rests = np.abs(self.ways) <= _STILL * np.abs(self.ways).max()
        ahead = np.maximum(np.argmax(rests, axis=1) - 1, 0)
        return np.where(self.lasting & rests.any(axis=1), drag * ahead, 0.0)

    def gait(self, shortest: float) -> Gait:
        """The cycle as lengths of all segments over time; phases of no duration are left out."""
        kept = self.of_phases(self.lasting)
        rates = kept.changes / kept.durations[:, None]
        pieces = np.stack([kept.lengths + shortest, rates], axis=2)
        return Gait(np.concatenate([[0.0], np.cumsum(kept.durations)]), pieces)


def table_of(order: Sequence_, segments: int) -> np.ndarray:
    """Whether a segment rests in a phase, (phases, N)."""
    return np.array([[j in rest for j in range(segments)] for rest in order])


def order_of(table: np.ndarray) -> Sequence_:
    """Segments that rest in each phase of a table (phases, N)."""
    return tuple(tuple(np.flatnonzero(row).tolist()) for row in table)


def running_block(segments: int, block: int) -> np.ndarray:
    """Whether a segment belongs to a block as a step begins, (N, N); it runs from head to tail."""
    steps = np.arange(segments)
    return (steps - steps[:, None]) % segments < block


def wave_order(segments: int, short: int) -> Sequence_:
    """Segments that rest in each step of the wave of so many short ones; from head to tail."""
    block = running_block(segments, short)
    return order_of(block & np.roll(block, -1, axis=0))


def anchored_wave(segments: int, short: int, stroke: float, step: float) -> AnchoredGait:
    """Wave of a block of short segments that runs from head to tail, one segment per step.

    In each of N steps the foremost of the block extends while the one behind it contracts; the
    others of the block rest, and with them the ring behind the one that extends. With one short
    segment that ring is all that rests: nothing holds it but what is outside this model.

    Parameters
    ----------
    segments : int
        Number of segments N.
    short : int
        Short ones m between steps, 1 to N - 1.
    stroke : float
        By what a segment changes its length, D; the worm advances (N - m) D per cycle.
    step : float
        Duration of a step.

    Returns
    -------
    AnchoredGait
        Of N phases.

    Raises
    ------
    ArgumentError
        If there are not 1 to N - 1 short segments.

    Examples
    --------
    >>> wave = anchored_wave(5, 2, stroke=1.0, step=0.5)
    >>> wave.advance, wave.speed, wave.order
    (3.0, 1.2, ((1,), (2,), (3,), (4,), (0,)))
    """
    if not 1 <= short < segments:
        raise ArgumentError(f"{short} of {segments} segments short; write 1 to {segments - 1}")
    steps = np.arange(segments)
    changes = np.zeros((segments, segments))
    changes[steps, steps] = stroke
    changes[steps, (steps + short) % segments] = -stroke
    behind = np.concatenate([np.zeros((segments, 1)), np.cumsum(changes, axis=1)], axis=1)
    return AnchoredGait(
        wave_order(segments, short),
        np.full(segments, float(step)),
        np.where(running_block(segments, short), 0.0, float(stroke)),
        behind[steps, steps + 1][:, None] - behind,
    )


def anchors_needed(
    segments: int, hold: float, drag: float, load: float = 0.0, reserve: float = 1.0
) -> int:
    """Least number k of anchors that hold while all others move, with k `hold` >= reserve times.

    Parameters
    ----------
    segments : int
        Number of segments N.
    hold : float
        Largest friction of an anchored segment on the wall, mu N_w.
    drag, load : float
        Drag of each of the N - k that move; load on the worm against its advance.
    reserve : float, optional
        By how many times anchors hold more than they must.

    Returns
    -------
    int
        Number of anchors k.

    Raises
    ------
    ArgumentError
        If more than N - 2 are needed, which leave nothing to move; it tells what would do.

    Examples
    --------
    Five segments: two anchors of 1 hold the drag 0.5 of the three that move, and one would not.

    >>> anchors_needed(5, hold=1.0, drag=0.5)
    2
    """
    for anchors in range(1, segments - 1):
        if anchors * hold >= reserve * (load + drag * (segments - anchors)):
            return anchors
    least = reserve * (load + 2 * drag) / (segments - 2) if segments > 2 else np.inf
    raise ArgumentError(
        f"{segments} segments that hold {hold:g} each do not move {reserve:g} times the load "
        f"{load:g} and the drag {drag:g} of each of the others; {least:.6g} each would do"
    )
