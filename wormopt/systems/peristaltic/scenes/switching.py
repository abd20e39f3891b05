"""Scenes of kind "peristaltic-switching": when to switch coils that are on or off."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import MeshTable
from wormopt.scene.types import (
    Finite,
    NonNegative,
    Pair,
    Positive,
    SceneTable,
    Seed,
    Table,
    says,
    wrong_order,
)
from wormopt.systems.shared.declared import INSTANT, OPTIMUM

# Fewer segments than the kind of scene without switches takes: orders grow with (2 N - 1)!
Coils = Annotated[int, Meta(ge=2, le=10, description="a whole number from 2 to 10")]
# Beyond these the best times are not determined: for each segment a period takes so many of the
# longer time constant at most, both differ by such a factor at most, and in periods of a smaller
# part of the longer one lengths hardly change.
_LONGEST_PER_SEGMENT, _LARGEST_RATIO, _SHORTEST = 12.0, 30.0, 1e-4
Share = Annotated[float, Meta(gt=0, le=1, description="a number above 0, at most 1")]


class SwitchedWormTable(Table, frozen=True, kw_only=True):
    """Segments that relax to one length in the field of their coil, to another without it."""

    segments: Annotated[Coils, says("count", "number of segments, and of coils")]
    length_on: Annotated[Positive, says("length", "of a segment whose coil stays on")]
    length_off: Annotated[Positive, says("length", "of a segment whose coil stays off")]
    time_on: Annotated[Positive, says("time", "time constant while the coil is on")] = 1.0
    time_off: Annotated[
        Positive | None, says("time", "and while it is off; the same if left out")
    ] = None
    power: Annotated[Positive, says("power", "that a coil takes while it is on")] = 1.0


class DragGround(Table, frozen=True, kw_only=True, tag_field="kind", tag="drag"):
    """Linear drag on each segment, as (*l*/*L*)<sup>*a*</sup>."""

    exponent: Annotated[
        Finite,
        says("1", "*a*: 1 for drag by present length, below 0 where thick segments grip"),
    ]


class TubeGround(Table, frozen=True, kw_only=True, tag_field="kind", tag="tube"):
    """A tube: a segment that is as short as `contact` rests on the wall until its coil is off."""

    contact: Annotated[
        Positive,
        says("length", "at which a segment touches the wall, between `length_on` and `length_off`"),
    ]


class SwitchLimitsTable(Table, frozen=True, kw_only=True):
    """What times of switching must keep to."""

    period: Annotated[Pair, says("time", "[shortest, longest] period")]
    duty: Annotated[Share, says("share", "most of the period that a coil is on")] = 1.0
    dwell: Annotated[
        NonNegative, says("time", "shortest time that a coil stays on, and that it stays off")
    ] = 0.0
    together: Annotated[
        Annotated[int, Meta(ge=1, description="a whole number, 1 or above")] | None,
        says("count", "most coils on at a time; all if left out"),
    ] = None


class SwitchAimTable(Table, frozen=True, kw_only=True):
    """What switching is to be good at; one of `maximise` and `minimise`."""

    maximise: Annotated[Literal["speed"] | None, says("", "the mean speed")] = None
    minimise: Annotated[
        Literal["energy_per_distance"] | None, says("", "power of the coils, by distance")
    ] = None
    speed: Annotated[Positive | None, says("speed", "least mean speed, with `minimise` only")] = (
        None
    )


class SwitchSearchTable(Table, frozen=True, kw_only=True):
    """Where to begin; worms of up to three segments have all orders tried."""

    starts: Annotated[
        int,
        Meta(ge=1, le=100, description="a whole number from 1 to 100"),
        says("count", "orders from which to search, the best of waves and of random ones"),
    ] = 8
    seed: Annotated[Seed, says("", "of the random orders")] = 0


class PeristalticSwitchingScene(SceneTable, frozen=True, kw_only=True):
    """The best order and times of switching, each coil on once in a period.

    Lengths relax, *l*′ = (target − *l*)/*τ*, so that all arcs between switches are known in closed
    form. The best order is searched for with these; its times are then optimised anew, as phases of
    free duration. See [theory](../theory-peristaltic.md#5-switching).

    `timings_s`: `search`, `build` and `solve` (of the phases' programs), `optimise`, `recheck`.
    """

    headline: ClassVar = ("speed", "energy_per_distance", "time", "on_time", "on_start")
    scalars: ClassVar = {
        "speed": ("speed", "mean speed"),
        "energy_per_distance": ("energy_per_distance", "that the coils take"),
        "distance": ("length", "way in a period"),
        "on_time": ("time", "how long each coil is on in a period"),
        "on_start": ("time", "when each coil goes on, coil 0 at 0"),
        "duty": ("share", "largest part of the period that a coil is on"),
        "together": ("count", "most coils on at a time"),
        "coil_states": (
            "count",
            "states of all coils arc by arc: 1 on, 2 on with its segment at rest on the wall",
        ),
        "orders_tried": ("count", "orders of which the best times were looked for"),
        "length_min": ("length", "least length of a segment"),
        "length_max": ("length", "largest"),
        **OPTIMUM,
        "objective": (
            "1",
            "what was minimised: negative `speed`, or negative way by time that coils are on, over "
            "the stroke of a segment by the sum of both time constants",
        ),
        "input_rms": ("share", "root of the mean of the number of coils on"),
        "input_peak": ("share", "1"),
        "time": ("time", "period"),
    }
    variables: ClassVar = INSTANT | {
        "length": ("length", ("segment", "instant"), "length of the segment"),
        "coil": ("share", ("segment", "instant"), "whether its coil is on"),
        "anchored": ("share", ("segment", "instant"), "whether the segment rests on the wall"),
        "position": ("length", ("ring", "instant"), "position of the ring"),
        "velocity": ("speed", ("instant",), "velocity of the mean of all centres"),
    }

    kind: Literal["peristaltic-switching"]
    want: Annotated[
        tuple[Literal["switching", "body", "animation"], ...],
        says(
            "",
            "`switching`: coils, lengths and velocity over a period; `body`: the worm as it swells "
            "and thins, from top to bottom; `animation`: the same, moving",
        ),
    ] = ()
    worm: Annotated[SwitchedWormTable, says("", "the worm")]
    ground: Annotated[
        DragGround | TubeGround, says("", 'the ground, with `kind = "drag"` or `kind = "tube"`')
    ]
    limits: Annotated[SwitchLimitsTable, says("", "what times of switching must keep to")]
    aim: Annotated[SwitchAimTable, says("", "what it is to be good at")]
    search: Annotated[SwitchSearchTable, says("", "where to begin")] = field(
        default_factory=SwitchSearchTable
    )
    mesh: Annotated[
        MeshTable,
        says("", "how finely a phase is resolved; 2 arcs of degree 8 at Legendre's points"),
    ] = field(default_factory=lambda: MeshTable(arcs=2, degree=8, scheme="legendre"))

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows."""
        yield from super().faults(folder)
        yield from wrong_order("limits.period", self.limits.period, may_be_equal=True)
        if self.worm.length_on == self.worm.length_off:
            yield "worm.length_on", "is length_off: coils change nothing; write another length"
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
                    "with drag that does not hang on length nothing goes anywhere; write 1.0, or "
                    "-1.0 for thick segments that grip",
                )
            return
        if not worm.length_on < ground.contact < worm.length_off:
            yield (
                "ground.contact",
                f"is not between worm.length_on and worm.length_off: write a number above "
                f"{worm.length_on:g} and below {worm.length_off:g}, length_off the larger",
            )
        if worm.segments < 3:
            yield "worm.segments", "two that are anchored in turn go nowhere in a tube; write 3"

    def _faults_of_times(self) -> Iterator[Fault]:
        """Yield what lets lengths rest, or all but rest, whenever coils are switched."""
        worm, limits = self.worm, self.limits
        on, off = worm.time_on, worm.time_on if worm.time_off is None else worm.time_off
        slow, fast = max(on, off), min(on, off)
        if slow > _LARGEST_RATIO * fast:
            key = "worm.time_on" if on < off else "worm.time_off"
            yield (
                key,
                f"is a part of {fast / slow:.3g} of the other time constant; lengths that relax so "
                f"fast are not resolved: write at least {slow / _LARGEST_RATIO:.4g}",
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
                    f"lengths with a time constant of {slow:g} rest long before so long a period "
                    "ends, and nothing hangs on when coils are switched; write "
                    f"{shortest}at most {most:.4g}",
                )
        if limits.period[1] < _SHORTEST * slow:
            yield (
                "limits.period",
                f"lengths with a time constant of {slow:g} hardly change in so short a period; "
                f"write a longest period of at least {_SHORTEST * slow:g}, better {slow:g}",
            )

    def _faults_of_limits(self) -> Iterator[Fault]:
        limits = self.limits
        if 2 * limits.dwell > limits.period[1]:
            yield (
                "limits.dwell",
                f"a coil that is on and off for {limits.dwell:g} each needs longer than the "
                f"longest period; write at most {limits.period[1] / 2:g}",
            )
        elif limits.dwell > limits.duty * limits.period[1]:
            yield (
                "limits.duty",
                f"{limits.dwell:g} on is more than this part of the longest period; write at least "
                f"{limits.dwell / limits.period[1]:.3g}",
            )
        if limits.together is not None and limits.together > self.worm.segments:
            yield "limits.together", f"there are only {self.worm.segments} coils; leave it out"

    def _faults_of_aim(self) -> Iterator[Fault]:
        aim = self.aim
        if (aim.maximise is None) == (aim.minimise is None):
            yield "aim", 'exactly one of maximise = "speed" and minimise must be given'
        if aim.speed is not None and aim.minimise is None:
            yield "aim.speed", 'is for minimise = "energy_per_distance"; leave it out'
