"""Quasi-static motion: the worm slides as a whole at the velocity of least dissipation.

Without inertia, dry friction at all contacts balances the force on the worm. With contact
velocities known except for a common velocity V, this is the optimality condition of the convex
function sum F+ [v + V]+ + F- [-v - V]+ - force V. Without a force V is a weighted median of the -v.
Where the function is flat at its minimum, statics does not determine the motion.
"""

from __future__ import annotations

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.peristaltic.anchored.gait import AnchoredGait

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
    >>> from wormopt.systems.peristaltic.anchored.gait import anchored_wave
    >>> wave = anchored_wave(5, 2, stroke=1.0, step=1.0)
    >>> wave.advance + slides(wave, 1.0, 1.0).sum(axis=0)
    array([0.5, 0.5])
    """
    middles = (gait.ways[:, :-1] + gait.ways[:, 1:]) / 2
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
    ways = np.where(least * most <= 0, 0.0, np.minimum(np.abs(least), np.abs(most)))
    return float(ways.max())
