"""Turning in place: two links of which one always rests, and the bound on how fast it can be.

Three masses on isotropic dry ground, F at the ends and F1 in the middle. While the joint swings by
phi', the longer link can rest and the shorter turns about the middle mass; while the links swap
their lengths with the middle mass fixed, nothing turns. Swing, swap, swing back, swap turns the
body by minus the swing, and takes it nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.strokes import Polygon


@dataclass(frozen=True)
class TurnInPlace:
    """A worm of two links that turns where it is.

    Parameters
    ----------
    end_friction, middle_friction : float
        Resistances F of masses 0 and 2, and F1 of mass 1, alike all ways.
    short, long : float
        Lengths of the link that swings and of the one that rests.
    straight, bent : float
        Angles of the joint between which it swings, within half a turn to either side.

    Raises
    ------
    ArgumentError
        If a number is not positive, the long link is the shorter one, or an angle is too large.

    Examples
    --------
    >>> gait = TurnInPlace(1.0, 2.0, short=0.5, long=1.0, straight=0.2, bent=1.2)
    >>> gait.holds, gait.turn, gait.work
    (True, -1.0, 3.0)
    """

    end_friction: float  # F of masses 0 and 2
    middle_friction: float  # F1
    short: float
    long: float
    straight: float  # angle of the joint at which the swing begins
    bent: float  # and at which it ends

    def __post_init__(self) -> None:
        if min(self.end_friction, self.middle_friction, self.short) <= 0:
            raise ArgumentError("resistances and lengths must be positive")
        if self.long < self.short:
            raise ArgumentError(f"the long link, {self.long:g}, is shorter than {self.short:g}")
        if not max(abs(self.straight), abs(self.bent)) < np.pi:
            raise ArgumentError("the joint must keep within half a turn to either side")

    @property
    def stroke(self) -> Polygon:
        """Lengths of both links and angle: swing, swap, swing back, swap."""
        a, b, one, two = self.long, self.short, self.straight, self.bent
        return Polygon(np.array([[a, b, one], [a, b, two], [b, a, two], [b, a, one]]))

    @property
    def turn(self) -> float:
        """By which the heading turns in a gait whose masses rest as they must."""
        return self.straight - self.bent

    @property
    def work(self) -> float:
        """Work of a gait: each swing turns the short link, each swap slides both ends."""
        swing = self.end_friction * self.short * abs(self.bent - self.straight)
        swap = 2 * self.end_friction * (self.long - self.short)
        return 2 * (swing + swap)

    def swing_hold(self, phi: np.ndarray | float) -> np.ndarray:
        """What the longer link at rest needs of what the ground holds; it rests up to 1.

        Parameters
        ----------
        phi : float or ndarray
            Angles of the joint.
        """
        return swing_hold(phi, self.short / self.long, self.middle_friction / self.end_friction)

    def swap_hold(self, phi: np.ndarray | float) -> np.ndarray:
        """What the middle mass needs of what the ground holds while lengths are swapped.

        Parameters
        ----------
        phi : float or ndarray
            Angles of the joint.
        """
        bend = 2 * np.abs(np.cos(np.asarray(phi, dtype=float) / 2))
        return bend * self.end_friction / self.middle_friction

    @property
    def holds(self) -> bool:
        """Whether masses rest as they must all through the gait."""
        angles = np.linspace(self.straight, self.bent, 257)
        swings = bool((self.swing_hold(angles) <= 1).all())
        return swings and bool((self.swap_hold(angles[[0, -1]]) <= 1).all())


def swing_hold(phi: np.ndarray | float, ratio: float, grip: float) -> np.ndarray:
    """Least largest share of the ground's hold that a resting link needs while the other swings.

    The swinging link pulls the middle mass sideways with F by its end. `ratio` k is its length
    over the resting one's, at most 1, and `grip` F1/F. Across the resting link the middle mass
    takes F (cos phi + k) and the far end F k, which the moments tell; along it they share
    F |sin phi|, as evenly in what they can hold as possible.
    """
    across = np.abs(np.cos(np.asarray(phi, dtype=float)) + ratio)
    along = np.abs(np.sin(np.asarray(phi, dtype=float)))

    def excess(hold: np.ndarray) -> np.ndarray:
        far = np.sqrt(np.maximum(hold**2 - ratio**2, 0.0))
        near = np.sqrt(np.maximum((grip * hold) ** 2 - across**2, 0.0))
        return along - far - near

    least = np.maximum(ratio, across / grip)
    low, high = least, least + along + 1.0
    for _ in range(60):  # bisection: the excess falls with the hold
        middle = (low + high) / 2
        more = excess(middle) > 0
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.where(excess(least) <= 0, least, high)


def heading_rate_bound(rate: float) -> float:
    """Largest mean rate of the heading at which a worm of two links turns, one at rest always.

    The heading of the chord of both links' directions is their mean; with one link at rest it
    turns at half the rate of the other, which is that of the joint.

    Parameters
    ----------
    rate : float
        Largest size of the joint's rate.

    Returns
    -------
    float
        In the unit of `rate`.

    Examples
    --------
    >>> heading_rate_bound(1.0)
    0.5
    """
    return abs(rate) / 2
