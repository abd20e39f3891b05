"""Gaits of a worm that anchors: a segment rests on the wall of its tube while it is short.

Segments are numbered from 0 at the head; rings 0 to N bound them; forward is positive. Lengths are
relative to the shortest, at which a segment touches the wall. Without inertia a worm that slides as
a whole has the velocity of least dissipation: dry friction at all contacts balances its force. With
contact velocities known except for a common velocity V, this is the optimality condition of the
convex function sum F+ [v + V]+ + F- [-v - V]+ - force V. Without a force V is a weighted median of
the -v. Where the function is flat at its minimum, statics does not determine the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.systems.shared.sequences import Sequence_

# Share of the cycle below which a phase counts as having no duration.
_NOTHING = 1e-9
# Share of the largest displacement below which one counts as none.
_STILL = 1e-8


@dataclass(frozen=True, eq=False)
class AnchoredGait:
    """One cycle in phases, with constant rates of the lengths in each of them.

    Segments that rest in a phase are anchored: short all the time, with both rings at rest.
    """

    order: Sequence_  # segments anchored in each phase, ascending
    durations: np.ndarray  # (phases,)
    lengths: np.ndarray  # (phases, N) above the shortest, at the start of each phase
    displacements: np.ndarray  # (phases, N + 1) of the rings in each phase

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
        """Displacement per cycle, the same for every ring."""
        return float(self.displacements[:, 0].sum())

    @property
    def speed(self) -> float:
        """Mean speed."""
        return self.advance / self.period

    @property
    def changes(self) -> np.ndarray:
        """Changes of the lengths in each phase, (phases, N)."""
        return -np.diff(self.displacements, axis=1)

    @cached_property
    def anchored(self) -> np.ndarray:
        """Whether a segment is anchored in a phase, (phases, N)."""
        return table_of(self.order, self.segments)

    @property
    def lasting(self) -> np.ndarray:
        """Whether a phase has a duration, (phases,); one without is a touch of the wall."""
        return self.durations > _NOTHING * self.period

    def of_phases(self, kept: np.ndarray) -> AnchoredGait:
        """Return the gait with the selected phases alone, (phases,) true or false."""
        order = tuple(rest for rest, keep in zip(self.order, kept, strict=True) if keep)
        return AnchoredGait(
            order, self.durations[kept], self.lengths[kept], self.displacements[kept]
        )

    def faults(self) -> np.ndarray:
        """Return the mismatch of lengths and displacements, and the fault of anchored segments.

        Both numbers are 0 except for round-off.
        """
        course = np.roll(self.lengths, -1, axis=0) - self.lengths - self.changes
        moved = [
            self.displacements[:, :-1],
            self.displacements[:, 1:],
            self.lengths,
            np.roll(self.lengths, -1, 0),
        ]
        return np.array([np.abs(course).max(), np.abs(np.where(self.anchored, moved, 0)).max()])

    def clearances(self) -> np.ndarray:
        """Return the largest length of each flight, the time between two rests, (flights,).

        Lengths are above the shortest; for a segment that never rests, its least length.
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
                    tops.append(float(length))  # 0, at the start of the flight
                else:
                    tops[-1] = max(tops[-1], float(length))
        return np.array(tops)

    def reserves(self, hold: float, drag: float, load: float = 0.0) -> np.ndarray:
        """Return the holding reserve of each phase, (phases,); NaN for phases of no duration.

        The reserve is the friction limit of the anchors over drag of moving segments plus load, as
        in `anchors_needed`.
        """
        moved = (
            np.abs(self.displacements[:, :-1] + self.displacements[:, 1:])
            > _STILL * np.abs(self.displacements).max()
        )
        needed = load + drag * moved.sum(axis=1)
        holds = hold * self.anchored.sum(axis=1)
        lasts = self.lasting & (needed > 0)
        return np.divide(holds, needed, out=np.full(len(holds), np.nan), where=lasts)

    def pushes(self, drag: float) -> np.ndarray:
        """Return the drag ahead of the segment that grows at the foremost resting ring, (phases,).

        This segment must push with it; 0 for phases of no duration.
        """
        rests = np.abs(self.displacements) <= _STILL * np.abs(self.displacements).max()
        ahead = np.maximum(np.argmax(rests, axis=1) - 1, 0)
        return np.where(self.lasting & rests.any(axis=1), drag * ahead, 0.0)

    def gait(self, shortest: float) -> Gait:
        """Return the cycle as lengths of all segments over time, without empty phases."""
        kept = self.of_phases(self.lasting)
        rates = kept.changes / kept.durations[:, None]
        pieces = np.stack([kept.lengths + shortest, rates], axis=2)
        return Gait(np.concatenate([[0.0], np.cumsum(kept.durations)]), pieces)


def table_of(order: Sequence_, segments: int) -> np.ndarray:
    """Return whether a segment rests in a phase, (phases, N)."""
    return np.array([[j in rest for j in range(segments)] for rest in order])


def order_of(table: np.ndarray) -> Sequence_:
    """Return the segments that rest in each phase of a table (phases, N)."""
    return tuple(tuple(np.flatnonzero(row).tolist()) for row in table)


def running_block(segments: int, block: int) -> np.ndarray:
    """Return block membership at the start of each step, (N, N); it runs from head to tail."""
    steps = np.arange(segments)
    return (steps - steps[:, None]) % segments < block


def wave_order(segments: int, short: int) -> Sequence_:
    """Return the resting segments in each step of a wave from head to tail."""
    block = running_block(segments, short)
    return order_of(block & np.roll(block, -1, axis=0))


def anchored_wave(segments: int, short: int, stroke: float, step: float) -> AnchoredGait:
    """Return the wave of a block of short segments from head to tail, one segment per step.

    In each of N steps the foremost segment of the block extends while the one behind the block
    contracts. The others of the block rest, as does the ring behind the segment that extends. With
    one short segment only this ring rests; nothing within this model holds it.

    Parameters
    ----------
    segments : int
        Number of segments N.
    short : int
        Number of short segments m between steps, 1 to N - 1.
    stroke : float
        Change of length D of a segment; the worm advances (N - m) D per cycle.
    step : float
        Duration of a step.

    Returns
    -------
    AnchoredGait
        A gait of N phases.

    Raises
    ------
    ArgumentError
        If the number of short segments is not 1 to N - 1.

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
    """Return the least number k of anchors that hold while all others move.

    k `hold` is at least `reserve` times load plus (N - k) `drag`.

    Parameters
    ----------
    segments : int
        Number of segments N.
    hold : float
        Friction limit of an anchored segment on the wall, mu N_w.
    drag, load : float
        Drag of each of the N - k moving segments; load on the worm against its advance.
    reserve : float, optional
        Least ratio of friction limit to required force.

    Returns
    -------
    int
        Number of anchors k.

    Raises
    ------
    ArgumentError
        If more than N - 2 are needed, which leave none to move; the message gives the friction
        limit that suffices.

    Examples
    --------
    >>> anchors_needed(5, hold=3.0, drag=1.0)
    2
    """
    for anchors in range(1, segments - 1):
        if anchors * hold >= reserve * (load + drag * (segments - anchors)):
            return anchors
    least = reserve * (load + 2 * drag) / (segments - 2) if segments > 2 else np.inf
    raise ArgumentError(
        f"{segments} segments with a hold of {hold:g} each cannot carry {reserve:g} times the load "
        f"{load:g} and the drag {drag:g} of each of the others; a hold of {least:.6g} suffices"
    )


# Share of all friction below which a slope counts as 0.
_TIE = 1e-12


def common_velocity(
    velocities: np.ndarray,
    forward: np.ndarray | float,
    backward: np.ndarray | float,
    force: float = 0.0,
) -> tuple[float, float]:
    """Return the least and largest common velocity that dry friction allows.

    They differ if statics does not determine the motion.

    Parameters
    ----------
    velocities : ndarray, shape (contacts,)
        Velocities of the contacts without the common one, forward positive.
    forward, backward : float or ndarray, shape (contacts,)
        Friction F+ against forward and F- against backward motion, not negative.
    force : float, optional
        Outer force on the worm, forward positive.

    Returns
    -------
    (float, float)
        Infinite if the force equals all the friction.

    Raises
    ------
    ArgumentError
        If friction cannot hold the force.

    Examples
    --------
    >>> import numpy as np
    >>> common_velocity(np.array([0.0, 1.0, 1.0]), 1.0, 3.0)
    (0.0, 0.0)
    >>> common_velocity(np.array([0.0, 1.0]), 1.0, 1.0)
    (-1.0, 0.0)
    """
    forward, backward = (np.broadcast_to(f, np.shape(velocities)) for f in (forward, backward))
    resists = float((backward if force < 0 else forward).sum())
    if abs(force) > resists:
        raise ArgumentError(
            f"the force {force:g} exceeds the friction, at most {resists:g}; give a smaller force"
        )
    order = np.argsort(-velocities, kind="stable")
    stops = np.concatenate([[-np.inf], -velocities[order], [np.inf]])
    slopes = np.cumsum(np.append(-backward.sum() - force, (forward + backward)[order]))
    tie = _TIE * float((forward + backward).sum())
    rises = np.append(slopes, np.inf)  # after each of the stops
    low, high = (stops[np.argmax(rises >= -tie)], stops[np.argmax(rises > tie)])
    return float(low) + 0.0, float(high) + 0.0  # no -0.0


def slides(
    gait: AnchoredGait,
    forward: np.ndarray | float,
    backward: np.ndarray | float,
    force: float = 0.0,
) -> np.ndarray:
    """Return the slip of the whole worm in each phase, least and largest.

    The slip adds to the displacements of the gait. Friction acts at the middles of the segments.

    Parameters
    ----------
    gait : AnchoredGait
        Gait with the displacements of all rings.
    forward, backward : float or ndarray, shape (phases, N) or (N,)
        Friction against forward and backward motion.
    force : float, optional
        Outer force on the worm, forward positive.

    Returns
    -------
    ndarray, shape (phases, 2)
        0 where anchors hold; the two differ where statics does not determine the motion.

    Examples
    --------
    >>> from wormopt.systems.peristaltic.anchored import anchored_wave
    >>> wave = anchored_wave(5, 2, stroke=1.0, step=1.0)
    >>> wave.advance + slides(wave, 1.0, 1.0).sum(axis=0)
    array([0.5, 0.5])
    """
    middles = (gait.displacements[:, :-1] + gait.displacements[:, 1:]) / 2
    forces = (np.broadcast_to(f, middles.shape) for f in (forward, backward))
    phases = zip(middles, *forces, strict=True)
    return np.array([common_velocity(v, ahead, back, force) for v, ahead, back in phases])


def slip(gait: AnchoredGait, hold: float, drag: float, load: float = 0.0) -> float:
    """Return the largest slip of anchors in a phase, the least that statics allows.

    `hold` is the friction limit of an anchored segment, `drag` that of a moving one.
    """
    lasting = gait.of_phases(gait.lasting)
    friction = np.where(lasting.anchored, hold, drag)
    least, most = slides(lasting, friction, friction, -load).T
    displacements = np.where(least * most <= 0, 0.0, np.minimum(np.abs(least), np.abs(most)))
    return float(displacements.max())
