"""Scenes of kind "peristaltic-switching": optimal times of coils that are on or off."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, says, whole
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Pair, SceneTable, Seed, wrong_order
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

# Fewer segments than for other kinds, because the number of orders grows with (2 N - 1)!
Coils = Annotated[int, Meta(ge=2, le=10, description="a whole number from 2 to 10")]
# Limits beyond which the best times are not determined: longest period per segment over the longer
# time constant, largest ratio of both time constants, and shortest period over the longer time
# constant, below which lengths hardly change.
_LONGEST_PER_SEGMENT, _LARGEST_RATIO, _SHORTEST = 12.0, 30.0, 1e-4
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, at most 1")]


class SwitchedWormTable(Given):
    """Segments that relax to one length with their coil on, and to another with it off."""

    segments: int = whole(2, 10, "number of segments and of coils")
    length_on: float = positive("length", "length of a segment whose coil stays on")
    length_off: float = positive("length", "length of a segment whose coil stays off")
    time_on: float = positive("time", "time constant while the coil is on", default=1.0)
    time_off: float | None = positive(
        "time", "time constant while the coil is off; `time_on` if left out", default=None
    )
    power: float = positive("power", "power of a coil that is on", default=1.0)


class DragGround(Given, tag_field="kind", tag="drag"):
    """Linear drag on each segment, proportional to (*l*/*L*)<sup>*a*</sup>."""

    exponent: float = number(
        "1", "exponent *a*: 1 for drag per present length, below 0 if thick segments grip"
    )


class TubeGround(Given, tag_field="kind", tag="tube"):
    """A tube: a segment as short as `contact` rests on the wall until its coil goes off."""

    contact: float = positive(
        "length", "length at which a segment touches, from `length_on` to `length_off`"
    )


class SwitchLimitsTable(Given):
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


class SwitchAimTable(Given):
    """Objective of the switching; one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry("mean speed", default=None)
    minimise: Literal["energy_per_distance"] | None = entry(
        "energy of the coils per distance", default=None
    )
    speed: float | None = positive("speed", "least mean speed, only with `minimise`", default=None)


class SwitchSearchTable(Given):
    """Starting points of the search; with up to three segments all orders are tried."""

    starts: int = whole(1, 100, "initial orders, the best of waves and of random orders", default=8)
    seed: Seed = entry("seed of the random orders", default=0)


class PeristalticSwitchingScene(SceneTable):
    """The best order and times of switching, with each coil on once in a period.

    Lengths relax by *l*′ = (target − *l*)/*τ*, so all arcs between switches are known in closed
    form. The search for the best order uses these. The times are then optimised again as phases of
    free duration. See [theory](../theory-peristaltic.md#5-switching).

    `timings_s`: `search`, `build` and `solve` (of the phases' programs), `optimise`, `recheck`.
    """

    headline: ClassVar = ("speed", "energy_per_distance", "time", "on_time", "on_start")
    scalars: ClassVar = {
        "speed": ("speed", "mean speed"),
        "energy_per_distance": ("energy_per_distance", "energy of the coils per distance"),
        "distance": ("length", "displacement per period"),
        "on_time": ("time", "time that each coil is on in a period"),
        "on_start": ("time", "time at which each coil goes on; coil 0 at 0"),
        "duty": ("share", "largest share of the period that a coil is on"),
        "together": ("count", "largest number of coils on at a time"),
        "coil_states": (
            "count",
            "states of all coils, arc by arc: 1 on, 2 on with its segment at rest on the wall",
        ),
        "orders_tried": ("count", "number of orders whose times were optimised"),
        "length_min": ("length", "least length of a segment"),
        "length_max": ("length", "largest"),
        **OPTIMUM,
        "objective": (
            "1",
            "minimised value: negative `speed`, or negative displacement per time that coils are "
            "on, scaled by the stroke of a segment over the sum of both time constants",
        ),
        "input_rms": ("share", "root of the mean number of coils on"),
        "input_peak": ("share", "1"),
        "time": ("time", "period"),
    }
    variables: ClassVar = INSTANT | {
        "length": ("length", ("segment", "instant"), "length of the segment"),
        "coil": ("share", ("segment", "instant"), "1 while the coil is on, else 0"),
        "anchored": ("share", ("segment", "instant"), "1 while the segment rests on the wall"),
        "position": ("length", ("ring", "instant"), "position of the ring"),
        "velocity": ("speed", ("instant",), "velocity of the mean of all segment centres"),
    }

    kind: Literal["peristaltic-switching"]
    want: tuple[Literal["switching", "body", "animation"], ...] = entry(
        "`switching`: coils, lengths and velocity over a period; `body`: the worm over a "
        "period, from top to bottom; `animation`: the moving worm",
        default=(),
    )
    worm: SwitchedWormTable = entry("the worm")
    ground: DragGround | TubeGround = entry('the ground, with `kind = "drag"` or `kind = "tube"`')
    limits: SwitchLimitsTable = entry("limits of the switching times")
    aim: SwitchAimTable = entry("objective")
    search: SwitchSearchTable = entry("starting points of the search", default=SwitchSearchTable)
    mesh: Annotated[
        MeshTable,
        says("", "discretisation of a phase; 2 arcs of degree 8 at Legendre points"),
    ] = field(default_factory=lambda: MeshTable(arcs=2, degree=8, scheme="legendre"))

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("limits.period", self.limits.period, may_be_equal=True)
        if self.worm.length_on == self.worm.length_off:
            yield "worm.length_on", "equals length_off, so coils have no effect; write another"
        yield from self._faults_of_ground()
        yield from self._faults_of_times()
        yield from self._faults_of_limits()
        yield from self._faults_of_aim()

    def _faults_of_ground(self) -> Iterator[Fault]:
        ground, worm = self.ground, self.worm
        if isinstance(ground, DragGround):
            if ground.exponent == 0:
                yield (
                    "ground.exponent",
                    "if drag does not depend on length there is no net displacement; write 1.0, or "
                    "-1.0 for thick segments that grip",
                )
            return
        if not worm.length_on < ground.contact < worm.length_off:
            yield (
                "ground.contact",
                f"is not between worm.length_on and worm.length_off: write a number above "
                f"{worm.length_on:g} and below {worm.length_off:g}, with the larger length_off",
            )
        if worm.segments < 3:
            yield "worm.segments", "two alternating anchors have no net displacement; write 3"

    def _faults_of_times(self) -> Iterator[Fault]:
        """Yield times at which lengths rest or hardly change, whenever coils are switched."""
        worm, limits = self.worm, self.limits
        on, off = worm.time_on, worm.time_on if worm.time_off is None else worm.time_off
        slow, fast = max(on, off), min(on, off)
        if slow > _LARGEST_RATIO * fast:
            key = "worm.time_on" if on < off else "worm.time_off"
            yield (
                key,
                f"is {fast / slow:.3g} of the other time constant, and such fast relaxation is not "
                f"resolved; write at least {slow / _LARGEST_RATIO:.4g}",
            )
            return
        longest = _LONGEST_PER_SEGMENT * worm.segments * slow
        for key, least, most in (
            ("limits.period", limits.period[0], longest),
            ("limits.dwell", 2 * limits.dwell, longest / 2),
        ):
            if least > longest:
                shortest = "a shortest period of " if key == "limits.period" else ""
                yield (
                    key,
                    f"the period is too long: with a time constant of {slow:g} lengths rest long "
                    "before it ends, and switching times have no effect; write "
                    f"{shortest}at most {most:.4g}",
                )
        if limits.period[1] < _SHORTEST * slow:
            yield (
                "limits.period",
                f"the period is too short: with a time constant of {slow:g} lengths hardly change; "
                f"write a longest period of at least {_SHORTEST * slow:g}, better {slow:g}",
            )

    def _faults_of_limits(self) -> Iterator[Fault]:
        limits = self.limits
        if 2 * limits.dwell > limits.period[1]:
            yield (
                "limits.dwell",
                f"{limits.dwell:g} on and {limits.dwell:g} off exceed the longest period; write at "
                f"most {limits.period[1] / 2:g}",
            )
        elif limits.dwell > limits.duty * limits.period[1]:
            yield (
                "limits.duty",
                f"limits.dwell = {limits.dwell:g} exceeds this share of the longest period; write "
                f"at least {limits.dwell / limits.period[1]:.3g}",
            )
        if limits.together is not None and limits.together > self.worm.segments:
            yield "limits.together", f"there are only {self.worm.segments} coils; leave it out"

    def _faults_of_aim(self) -> Iterator[Fault]:
        aim = self.aim
        if (aim.maximise is None) == (aim.minimise is None):
            yield "aim", 'exactly one of maximise = "speed" and minimise is required'
        if aim.speed is not None and aim.minimise is None:
            yield "aim.speed", 'needs minimise = "energy_per_distance"; leave it out'
