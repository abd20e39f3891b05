"""Quasi-static motion: the worm slides as a whole at the velocity of least dissipation.

Where inertia does not count, dry friction at all contacts adds up to the force on the worm. Given
the velocities of the contacts but for a common one V, this is the condition for the least of the
convex function sum F+ [v + V]+ + F- [-v - V]+ - force V: without a force V is a weighted median of
the -v. Where the function is flat at its least, statics does not tell the motion.
"""

from __future__ import annotations

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.peristaltic.anchored.gait import AnchoredGait

# Slopes below this share of all friction are none.
_TIE = 1e-12


def common_velocity(
    velocities: np.ndarray,
    forward: np.ndarray | float,
    backward: np.ndarray | float,
    force: float = 0.0,
) -> tuple[float, float]:
    """Least and largest common velocity that dry friction allows; they differ where it is not told.

    Parameters
    ----------
    velocities : ndarray, shape (contacts,)
        Velocities of the contacts but for the common one, forward positive.
    forward, backward : float or ndarray, shape (contacts,)
        Friction F+ against motion forward, F- backward, not negative.
    force : float, optional
        Outer force on the worm, forward positive.

    Returns
    -------
    (float, float)
        Infinite where the force is just all the friction there is.

    Raises
    ------
    ArgumentError
        If friction does not hold the force.

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
            f"the force {force:g} pulls the worm away: friction resists {resists:g} at most"
        )
    order = np.argsort(-velocities, kind="stable")
    stops = np.concatenate([[-np.inf], -velocities[order], [np.inf]])
    slopes = np.cumsum(np.append(-backward.sum() - force, (forward + backward)[order]))
    tie = _TIE * float((forward + backward).sum())
    rises = np.append(slopes, np.inf)  # behind each of the stops
    low, high = (stops[np.argmax(rises >= -tie)], stops[np.argmax(rises > tie)])
    return float(low) + 0.0, float(high) + 0.0  # no -0.0


def slides(
    gait: AnchoredGait,
    forward: np.ndarray | float,
    backward: np.ndarray | float,
    force: float = 0.0,
) -> np.ndarray:
    """By what the whole worm slides in each phase besides the ways of the gait, least and largest.

    Friction acts at the middles of the segments.

    Parameters
    ----------
    gait : AnchoredGait
        With the ways of all rings.
    forward, backward : float or ndarray, shape (phases, N) or (N,)
        Friction against motion forward and backward.
    force : float, optional
        Outer force on the worm, forward positive.

    Returns
    -------
    ndarray, shape (phases, 2)
        Nothing where anchors hold; the two differ where statics does not tell.

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
    """Largest way that anchors slip in a phase; as little of it as statics allows.

    `hold` is the friction of an anchored segment, `drag` of one that moves.
    """
    lasting = gait.of_phases(gait.lasting)
    friction = np.where(lasting.anchored, hold, drag)
    least, most = slides(lasting, friction, friction, -load).T
    ways = np.where(least * most <= 0, 0.0, np.minimum(np.abs(least), np.abs(most)))
    return float(ways.max())
