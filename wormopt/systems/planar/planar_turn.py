"""Kind "planar-turn": a worm of two links turns in place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
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
    from wormopt.systems.planar.body.se2 import rotate
    from wormopt.systems.planar.body.shape import chain_shape
    from wormopt.systems.planar.crawling.crawl import Crawl, crawl
    from wormopt.systems.planar.turning import TurnInPlace, heading_rate_bound

_ANGLES = 201


class Turner(Given):
    """A worm of two links that exchange lengths, on ground with equal resistance everywhere."""

    end_friction: float = positive("force", "friction *F* of masses 0 and 2")
    middle_friction: float = positive("force", "friction *F*<sub>1</sub> of mass 1")
    short: float = positive("length", "length *l*<sub>2</sub> of the link that swings")
    long: float = positive("length", "length *l*<sub>1</sub> of the link that rests")
    straight: float = number("rad", "joint angle at which the swing begins, within ±π")
    bent: float = number("rad", "joint angle at which the swing ends, within ±π")

    def gait(self) -> TurnInPlace:
        """Return the gait of this worm."""
        return TurnInPlace(**{name: getattr(self, name) for name in self.__struct_fields__})

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield lengths that are too close, angles beyond ±π, and a swing that does not move."""
        if not self.short < self.long:
            yield (
                "short",
                f"{self.short:g} is not below worm.long, {self.long:g}; with equal links the "
                "swinging link is not determined; write a smaller number",
            )
        elif self.long - self.short < 1e-6 * self.long:
            yield (
                "short",
                "too close to worm.long to determine numerically which link swings; "
                f"write {0.999 * self.long:g}, say",
            )
        for name in ("straight", "bent"):
            if abs(getattr(self, name)) >= math.pi:
                yield name, "beyond the range of a joint; write an angle within ±π"
        if self.straight == self.bent:
            yield "bent", "equals worm.straight, so the joint does not swing; write another"


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
        "crawl": "wormopt.systems.planar.pictures:crawl",
        "turning": "wormopt.systems.planar.pictures:turning",
        "forces": "wormopt.systems.planar.pictures:crawl_forces",
        "animation": "wormopt.systems.planar.pictures:animation",
    }
    headline: ClassVar = ("heading_rate", "heading_rate_bound", "gap", "turn", "work")

    worm: Turner = entry("the worm and its gait")
    rate: Rate = entry("largest rates of the shape")
    cycles: int = whole(1, 100, "number of gaits shown", default=2)

    # -- computing ---------------------------------------------------------------------------------

    @cached_property
    def gait(self) -> TurnInPlace:
        """The gait of the worm."""
        return self.worm.gait()

    @property
    def durations(self) -> tuple[float, float]:
        """Durations of a swing and of a swap."""
        worm = self.worm
        return abs(worm.bent - worm.straight) / self.rate.joint, (
            (worm.long - worm.short) / self.rate.link
        )

    @property
    def duration(self) -> float:
        """Duration of a gait."""
        return 2 * sum(self.durations)

    def follow(self) -> Crawl:
        """Return the crawl over a gait."""
        ends, middle = self.worm.end_friction, self.worm.middle_friction
        laws = [Elliptic(f, f, f) for f in (ends, middle, ends)]
        return crawl(chain_shape(2), laws, self.gait.stroke)

    # -- results -----------------------------------------------------------------------------------

    @parts(Turned)
    def turned(self) -> Turned:
        gait, done = self.gait, self.crawl
        turn, middle = done.displacement[2], np.array([-gait.long, 0.0])
        drift = float(np.hypot(*(done.displacement[:2] + rotate(turn, middle) - middle)))
        rate, bound = abs(float(turn)) / self.duration, heading_rate_bound(self.rate.joint)
        off = abs(turn - gait.turn), abs(done.work / gait.work - 1), drift / gait.long
        return Turned(
            heading_rate=rate,
            heading_rate_bound=bound,
            gap=1 - rate / bound if gait.holds else None,
            cycle_time=self.duration,
            swap_time=self.durations[1],
            swing_hold=float(self.hold_by_angle.max()),
            swap_hold=float(gait.swap_hold(np.array([gait.straight, gait.bent])).max()),
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
        return self.gait.swing_hold(self.swing_angle)

    # -- the trust report --------------------------------------------------------------------------

    @property
    def holds(self) -> bool:
        """Whether the conditions of rest hold during the whole gait."""
        return self.gait.holds

    @check(
        1e-8,
        "turn, work or drift differ from the conditions of rest",
        when="holds",
        name="turn, work and place promised",
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
