"""A worm whose coils are on or off, its ground, and limits and objective of the switching times."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, structs

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, positive, whole
from wormopt.study.types import Pair, wrong_order

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.model.model import Model, Output, Signal
    from wormopt.systems.peristaltic.drag import centres, drift

# Limits beyond which the best times are not determined: longest period per segment over the longer
# time constant, largest ratio of both time constants, and shortest period over the longer time
# constant, below which lengths hardly change.
_LONGEST_PER_SEGMENT, _LARGEST_RATIO, _SHORTEST = 12.0, 30.0, 1e-4
# Number of time constants after which a length has reached its target, to round-off.
_RELAXED = 37.0


class Worm(Given):
    """Segments that relax to one length with their coil on, and to another with it off."""

    # fewer segments than for other kinds, because the number of orders grows with (2 N - 1)!
    segments: int = whole(2, 10, "number of segments and of coils")
    length_on: float = positive("length", "length of a segment whose coil stays on")
    length_off: float = positive("length", "length of a segment whose coil stays off")
    time_on: float = positive("time", "time constant while the coil is on", default=1.0)
    time_off: float | None = positive(
        "time", "time constant while the coil is off; `time_on` if left out", default=None
    )
    power: float = positive("power", "power of a coil that is on", default=1.0)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.length_on == self.length_off:
            yield "length_on", "equals length_off, so coils have no effect; write another"

    @property
    def tau_off(self) -> float:
        """Time constant while the coil is off."""
        return self.time_on if self.time_off is None else self.time_off


class DragGround(Given, tag_field="kind", tag="drag", kw_only=False):
    """Linear drag on each segment, proportional to (*l*/*L*)<sup>*a*</sup>."""

    contact: ClassVar[None] = None
    exponent: float = number(
        "1", "exponent *a*: 1 for drag per present length, below 0 if thick segments grip"
    )

    def faults_in(self, worm: Worm) -> Iterator[Fault]:
        """Yield a fault if no order moves the worm."""
        if self.exponent == 0:
            yield (
                "ground.exponent",
                "if drag does not depend on length there is no net displacement; write 1.0, or "
                "-1.0 for thick segments that grip",
            )

    def holds(self, anchored: np.ndarray) -> np.ndarray:
        """True: drag needs no anchored segment."""
        return np.ones(len(anchored), dtype=bool)

    def velocity(self, lengths: ca.SX, rates: ca.SX, anchored: ca.SX) -> ca.SX:
        """Return the velocity of the mean of all centres, at which all drags sum to zero."""
        return drift((lengths / lengths[0]) ** self.exponent, rates)


class TubeGround(Given, tag_field="kind", tag="tube", kw_only=False):
    """A tube: a segment as short as `contact` rests on the wall until its coil goes off."""

    contact: float = positive(
        "length", "length at which a segment touches, from `length_on` to `length_off`"
    )

    def faults_in(self, worm: Worm) -> Iterator[Fault]:
        """Yield faults of a wall that no segment reaches, or that two segments cannot leave."""
        if not worm.length_on < self.contact < worm.length_off:
            yield (
                "ground.contact",
                f"is not between worm.length_on and worm.length_off: write a number above "
                f"{worm.length_on:g} and below {worm.length_off:g}, with the larger length_off",
            )
        if worm.segments < 3:
            yield "worm.segments", "two alternating anchors have no net displacement; write 3"

    def holds(self, anchored: np.ndarray) -> np.ndarray:
        """Return whether anchors exist and none between them moves, since else some would slip."""
        begins = np.diff(anchored, axis=1, prepend=0) > 0
        return begins.sum(axis=1) == 1

    def velocity(self, lengths: ca.SX, rates: ca.SX, anchored: ca.SX) -> ca.SX:
        """Return the velocity of the mean of all centres, at which anchored segments rest."""
        swing = ca.mtimes(ca.DM(centres(rates.numel())), rates)
        return -ca.dot(anchored, swing) / ca.sum1(anchored)


class SwitchedWorm(Worm):
    """The worm on its ground."""

    ground: DragGround | TubeGround = entry("the ground")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.ground.faults_in(self)

    def rates(self, lengths: ca.SX, coils: ca.SX, anchored: ca.SX) -> ca.SX:
        """Return rates of the lengths; coils between off (0) and on (1) interpolate."""
        return (1 - anchored) * (
            coils * (self.length_on - lengths) / self.time_on
            + (1 - coils) * (self.length_off - lengths) / self.tau_off
        )

    @property
    def time(self) -> float:
        """Usual time: the sum of both time constants."""
        return self.time_on + self.tau_off

    @property
    def speed(self) -> float:
        """Usual speed: the stroke of a segment in that time."""
        return abs(self.length_on - self.length_off) / self.time

    @cached_property
    def model(self) -> Model:
        """States ``length`` and ``position``; inputs ``coil``, in a tube ``anchored``, 0 or 1."""
        n, contact = self.segments, self.ground.contact
        lengths, x, u = ca.SX.sym("length", n), ca.SX.sym("position"), ca.SX.sym("coil", n)
        rest = ca.SX.zeros(n) if contact is None else ca.SX.sym("anchored", n)
        rates = self.rates(lengths, u, rest)
        speed = self.ground.velocity(lengths, rates, rest)
        size = max(self.length_on, self.length_off)
        inputs = [Signal("coil", u, "share", 1.0, 0.0, 1.0, value=0.0)]
        if contact is not None:
            inputs.append(Signal("anchored", rest, "share", 1.0, 0.0, 1.0, value=0.0))
        return Model(
            f"worm of {n} segments in coils",
            x=[
                Signal(
                    "length",
                    lengths,
                    "length",
                    size,
                    -np.inf if contact is None else contact,
                    value=self.length_off,
                ),
                Signal("position", x, "length", size, value=0.0),
            ],
            ode=ca.vertcat(rates, speed),
            u=inputs,
            outputs=[
                Output("speed", speed, "speed"),
                Output("rate", rates, "speed"),
                Output("resting", rest, "share"),
            ],
        )


class Limits(Given, kw_only=False):
    """Limits of the switching times."""

    period: Pair = entry("[shortest, longest] period", quantity="time")
    duty: float = number(
        "share", "largest share of the period that a coil is on", above=0, most=1, default=1.0
    )
    dwell: float = number(
        "time", "shortest time that a coil stays on, and that it stays off", least=0, default=0.0
    )
    together: Annotated[int, Meta(ge=1, description="a whole number, 1 or above")] | None = entry(
        "largest number of coils on at a time; all if left out", quantity="count", default=None
    )

    @property
    def period_range(self) -> tuple[float, float]:
        """Shortest and longest period."""
        return self.period[0], self.period[1]

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("period", self.period, may_be_equal=True)
        dwell, longest = self.dwell, self.period[1]
        if 2 * dwell > longest:
            yield (
                "dwell",
                f"{dwell:g} on and {dwell:g} off exceed the longest period; write at "
                f"most {longest / 2:g}",
            )
        elif dwell > self.duty * longest:
            yield (
                "duty",
                f"limits.dwell = {dwell:g} exceeds this share of the longest period; write "
                f"at least {dwell / longest:.3g}",
            )

    def faults_in(self, worm: Worm) -> Iterator[Fault]:
        """Yield times at which lengths rest or hardly change, whenever coils are switched."""
        on, off = worm.time_on, worm.tau_off
        slow, fast = max(on, off), min(on, off)
        if self.together is not None and self.together > worm.segments:
            yield "limits.together", f"there are only {worm.segments} coils; leave it out"
        if slow > _LARGEST_RATIO * fast:
            yield (
                "worm.time_on" if on < off else "worm.time_off",
                f"is {fast / slow:.3g} of the other time constant, and such fast relaxation is not "
                f"resolved; write at least {slow / _LARGEST_RATIO:.4g}",
            )
            return
        longest = _LONGEST_PER_SEGMENT * worm.segments * slow
        for key, least, write in (
            ("limits.period", self.period[0], f"a shortest period of at most {longest:.4g}"),
            ("limits.dwell", 2 * self.dwell, f"at most {longest / 2:.4g}"),
        ):
            if least > longest:
                yield (
                    key,
                    f"the period is too long: with a time constant of {slow:g} lengths rest long "
                    f"before it ends, and switching times have no effect; write {write}",
                )
        if self.period[1] < _SHORTEST * slow:
            yield (
                "limits.period",
                f"the period is too short: with a time constant of {slow:g} lengths hardly change; "
                f"write a longest period of at least {_SHORTEST * slow:g}, better {slow:g}",
            )

    def that_count(self, worm: SwitchedWorm) -> Limits:
        """Return limits without periods longer than a worm can use.

        If all arcs last until all lengths rest, and as long as coils must dwell, longer periods add
        no displacement. A far longest period would make programs badly scaled.
        """
        arcs = 3 * worm.segments if worm.ground.contact is not None else 2 * worm.segments
        arc = max(_RELAXED * max(worm.time_on, worm.tau_off), self.dwell)
        least, most = self.period
        return structs.replace(self, period=(least, min(most, max(least, arcs * arc / self.duty))))


class Objective(Given):
    """Objective of the switching; one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry("mean speed", default=None)
    minimise: Literal["energy_per_distance"] | None = entry(
        "energy of the coils per distance", default=None
    )
    speed: float | None = positive("speed", "least mean speed, only with `minimise`", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        if (self.maximise is None) == (self.minimise is None):
            yield "", 'no objective or two are given; write maximise = "speed" or minimise'
        if self.speed is not None and self.minimise is None:
            yield "speed", 'needs minimise = "energy_per_distance"; leave it out'
