"""Kind "planar-turn": a worm of two links turns in place, with a bound on the turn rate.

Three masses are on isotropic dry ground, with friction F at the ends and F1 in the middle. While
the joint swings by phi', the longer link can rest and the shorter one turns about the middle mass.
While the links exchange lengths (swap) with the middle mass fixed, nothing turns. Swing, swap,
swing back, swap turns the body by minus the swing, without displacement. One of the links always
rests.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from wormopt.errors import Fault
from wormopt.study import (
    Given,
    array,
    check,
    entry,
    number,
    on_use,
    parts,
    positive,
    value,
    warnings,
    whole,
)
from wormopt.systems.planar.crawls import Crawling, Signals, over_cycles, signals_of

with on_use():
    import numpy as np

    from wormopt.model.planar_friction import Elliptic
    from wormopt.systems.planar.crawling.crawl import Crawl, crawl
    from wormopt.systems.planar.poses import rotate
    from wormopt.systems.planar.shape import Polygon, chain_shape


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
                f"write for example {0.999 * self.long:g}",
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
        return max(self.swing_hold_max, self.swap_hold_max) <= 1

    @property
    def swing_hold_max(self) -> float:
        """Largest `swing_hold` of a swing.

        For 0 <= phi <= pi the share falls, and may rise again near pi: it is largest at the ends,
        or at 0 if the swing passes 0.
        """
        low, high = sorted((self.straight, self.bent))
        return float(self.swing_hold(np.array([low, np.clip(0.0, low, high), high])).max())

    @property
    def swap_hold_max(self) -> float:
        """Largest `swap_hold` of both swaps."""
        return float(self.swap_hold(np.array([self.straight, self.bent])).max())


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


_ANGLES = 201


class Rate(Given):
    """Largest rates of the shape."""

    joint: float = positive("angular_frequency", "largest rate of the joint angle")
    link: float = positive("speed", "largest rate of a link length")


@dataclass(frozen=True)
class Turned:
    """How fast the worm turns, by the crawl and by the conditions of rest."""

    heading_rate: float = value("angular_frequency", "mean rate of the heading, by the crawl")
    heading_rate_bound: float = value(
        "angular_frequency",
        "bound of the mean rate for gaits in which one link does not turn at every instant",
    )
    gap: float | None = value("share", "relative gap to the bound; unknown if no link has to rest")
    cycle_time: float = value("time", "duration of a gait: two swings and two swaps")
    swap_time: float = value("time", "duration of a swap")
    swing_hold: float = value(
        "share",
        "largest share of the available friction that the long link needs; it rests up to 1",
    )
    swap_hold: float = value(
        "share",
        "largest share of the available friction that the middle mass needs while the links swap",
    )
    drift: float = value("length", "displacement of the middle mass per gait")
    turn_promised: float | None = value("angle", "turn per gait if the conditions of rest hold")
    work_promised: float | None = value("energy", "work per gait if the conditions of rest hold")
    promise_error: float | None = value(
        "share", "relative difference of turn, work and drift to the predicted values"
    )


class PlanarTurn(Crawling, kind="planar-turn"):
    """Compute how fast a two-link worm turns in place, with an upper bound.

    The joint swings, then the links exchange lengths. During a swing the longer link rests and the
    shorter one turns about the middle mass. During an exchange (swap) neither link turns. The gait
    swing, swap, swing back, swap rotates the worm by the swing angle and returns its middle mass.
    If one link rests at every instant, the mean rate of the heading is at most half the joint's
    largest rate. This bound is proven, and it is approached as swaps get shorter. See
    [theory](../theory-planar.md#4-turning-in-place). The status is `failed` if a second route finds
    another motion, forces are not balanced, or the motion differs from that predicted by the
    conditions of rest.
    """

    pictures: ClassVar = {
        "crawl": "the body at equal times of its strokes, with its mean place; resting masses "
        "are filled",
        "turning": "heading and its bound over time, resting masses, and the friction they need",
        "forces": (
            "forces of the ground, loads of the actuators and resting masses over a stroke",
            "crawl_forces",
        ),
        "animation": "the moving body, as a GIF",
    }
    headline: ClassVar = ("heading_rate", "heading_rate_bound", "gap", "turn", "work")

    worm: TurnInPlace = entry("the worm and its gait")
    rate: Rate = entry("largest rates of the shape")
    cycles: int = whole(1, 100, "number of gaits shown", default=2)

    # -- computing ---------------------------------------------------------------------------------

    @property
    def durations(self) -> tuple[float, float]:
        """Durations of a swing and of a swap."""
        worm = self.worm
        return abs(worm.bent - worm.straight) / self.rate.joint, (
            (worm.long - worm.short) / self.rate.link
        )

    @property
    def duration(self) -> float:
        return 2 * sum(self.durations)

    def follow(self) -> Crawl:
        ends, middle = self.worm.end_friction, self.worm.middle_friction
        laws = [Elliptic(f, f, f) for f in (ends, middle, ends)]
        return crawl(chain_shape(2), laws, self.worm.stroke)

    # -- results -----------------------------------------------------------------------------------

    @parts(Turned)
    def turned(self) -> Turned:
        gait, done = self.worm, self.crawl
        turn, middle = done.displacement[2], np.array([-gait.long, 0.0])
        drift = float(np.hypot(*(done.displacement[:2] + rotate(turn, middle) - middle)))
        rate = abs(float(turn)) / self.duration
        # with one link at rest the mean of both directions turns at half the rate of the joint
        bound = self.rate.joint / 2
        off = abs(turn - gait.turn), abs(done.work / gait.work - 1), drift / gait.long
        return Turned(
            heading_rate=rate,
            heading_rate_bound=bound,
            gap=1 - rate / bound if gait.holds else None,
            cycle_time=self.duration,
            swap_time=self.durations[1],
            swing_hold=gait.swing_hold_max,
            swap_hold=gait.swap_hold_max,
            drift=drift,
            turn_promised=gait.turn if gait.holds else None,
            work_promised=gait.work if gait.holds else None,
            promise_error=float(max(off)) if gait.holds else None,
        )

    @parts(Signals)
    def signals(self) -> Signals:
        tau, corners = self.rule.tau, self.crawl.course.stroke.breaks
        ends = np.cumsum([0.0, *self.durations, *self.durations])
        side = np.clip(np.searchsorted(corners, tau, side="right") - 1, 0, 3)
        pace = 1 / (4 * np.diff(ends)[side])
        times = np.interp(tau, corners, ends)
        return signals_of(self.crawl, self.rule, times, pace, self.cycles)

    @array("angle", "time", "mean angle of both links")
    def mean_heading(self) -> np.ndarray:
        return self.signals.heading - over_cycles(self.signals.shape[2], self.cycles) / 2

    @array("angle", "swing", "joint angles during a swing")
    def swing_angle(self) -> np.ndarray:
        return np.linspace(self.worm.straight, self.worm.bent, _ANGLES)

    @array("share", "swing", "share of available friction the long link needs")
    def hold_by_angle(self) -> np.ndarray:
        return self.worm.swing_hold(self.swing_angle)

    # -- the trust report --------------------------------------------------------------------------

    @property
    def holds(self) -> bool:
        """Whether the conditions of rest hold during the whole gait."""
        return self.worm.holds

    @check(
        1e-8,
        "turn, work or drift differ from the conditions of rest",
        when="holds",
        name="turn, work and drift by the conditions of rest",
    )
    def promised(self) -> float | None:
        return self.turned.promise_error

    @check(1e-9, "the rate exceeds its bound", when="holds")
    def heading_below_its_bound(self) -> float:
        return max(0.0, self.turned.heading_rate / self.turned.heading_rate_bound - 1)

    @warnings
    def slips(self) -> Iterator[str]:
        if not self.holds:
            yield (
                "the ground cannot hold the resting masses during the whole gait: they slip, and "
                "the turn and its bound are not known in advance; with worm.middle_friction of "
                f"{2 * self.worm.end_friction:g} they rest at any angle"
            )
