"""Turning in place: one of two links always rests, with a bound on the turn rate.

Three masses are on isotropic dry ground, with friction F at the ends and F1 in the middle. While
the joint swings by phi', the longer link can rest and the shorter one turns about the middle mass.
While the links exchange lengths (swap) with the middle mass fixed, nothing turns. Swing, swap,
swing back, swap turns the body by minus the swing, without displacement.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from wormopt.errors import Fault
from wormopt.study import Given, number, on_use, positive

with on_use():
    import numpy as np

    from wormopt.systems.planar.shape import Polygon


class TurnInPlace(Given, kw_only=False):
    """A worm of two links that exchange lengths, on ground with equal resistance everywhere.

    Examples
    --------
    >>> gait = TurnInPlace(1.0, 2.0, short=0.5, long=1.0, straight=0.2, bent=1.2)
    >>> gait.holds, gait.turn, gait.work
    (True, -1.0, 3.0)
    """

    end_friction: float = positive("force", "friction *F* of masses 0 and 2")
    middle_friction: float = positive("force", "friction *F*<sub>1</sub> of mass 1")
    short: float = positive("length", "length *l*<sub>2</sub> of the link that swings")
    long: float = positive("length", "length *l*<sub>1</sub> of the link that rests")
    straight: float = number("rad", "joint angle at which the swing begins, within ±π")
    bent: float = number("rad", "joint angle at which the swing ends, within ±π")

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield lengths that are too close, angles beyond ±π, and a swing that does not move."""
        if not self.short < self.long:
            yield (
                "short",
                f"{self.short:g} is not below long, {self.long:g}; with equal links the "
                "swinging link is not determined; write a smaller number",
            )
        elif self.long - self.short < 1e-6 * self.long:
            yield (
                "short",
                "too close to long to determine numerically which link swings; "
                f"write {0.999 * self.long:g}, say",
            )
        for name in ("straight", "bent"):
            if abs(getattr(self, name)) >= math.pi:
                yield name, "beyond the range of a joint; write an angle within ±π"
        if self.straight == self.bent:
            yield "bent", "equals straight, so the joint does not swing; write another"

    @property
    def stroke(self) -> Polygon:
        """Lengths of both links and angle: swing, swap, swing back, swap."""
        a, b, one, two = self.long, self.short, self.straight, self.bent
        return Polygon(np.array([[a, b, one], [a, b, two], [b, a, two], [b, a, one]]))

    @property
    def turn(self) -> float:
        """Rotation per gait if the conditions of rest hold, in rad."""
        return self.straight - self.bent

    @property
    def work(self) -> float:
        """Work per gait: each swing turns the short link, each swap slides both ends."""
        swing = self.end_friction * self.short * abs(self.bent - self.straight)
        swap = 2 * self.end_friction * (self.long - self.short)
        return 2 * (swing + swap)

    def swing_hold(self, phi: np.ndarray | float) -> np.ndarray:
        """Return the share of available friction that the longer link needs; it rests up to 1.

        Parameters
        ----------
        phi : float or ndarray
            Joint angles in rad.
        """
        return swing_hold(phi, self.short / self.long, self.middle_friction / self.end_friction)

    def swap_hold(self, phi: np.ndarray | float) -> np.ndarray:
        """Return the share of available friction that the middle mass needs during a swap.

        Parameters
        ----------
        phi : float or ndarray
            Joint angles in rad.
        """
        bend = 2 * np.abs(np.cos(np.asarray(phi, dtype=float) / 2))
        return bend * self.end_friction / self.middle_friction

    @property
    def holds(self) -> bool:
        """Whether the conditions of rest hold during the whole gait."""
        angles = np.linspace(self.straight, self.bent, 257)
        swings = bool((self.swing_hold(angles) <= 1).all())
        return swings and bool((self.swap_hold(angles[[0, -1]]) <= 1).all())


def swing_hold(phi: np.ndarray | float, ratio: float, grip: float) -> np.ndarray:
    """Return the least share of friction that a resting link needs while the other swings.

    The swinging link pulls the middle mass sideways with F by its end. `ratio` k is its length over
    that of the resting one, at most 1, and `grip` is F1/F. Across the resting link the middle mass
    carries F (cos phi + k) and the far end F k, by the balance of moments. Along it they share
    F |sin phi| as evenly as their limits allow.
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
    """Return the largest mean turn rate of a worm of two links, one of which always rests.

    The heading is the mean of the directions of both links. With one link at rest it turns at half
    the rate of the other, which is that of the joint.

    Parameters
    ----------
    rate : float
        Largest absolute rate of the joint.

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
