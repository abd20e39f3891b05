"""Kind "peristaltic-switching": optimal times of coils that are on or off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    attributes,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Pair, Seed, wrong_order
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.optimise import Optimum
    from wormopt.systems.peristaltic.drag import rings
    from wormopt.systems.peristaltic.switching import (
        OFF,
        Aim,
        Drag,
        SwitchedWorm,
        SwitchingProgram,
        SwitchLimits,
        Tube,
        polish,
        walk,
    )
    from wormopt.systems.peristaltic.switching_orders import Search, search

# Limits beyond which the best times are not determined: longest period per segment over the longer
# time constant, largest ratio of both time constants, and shortest period over the longer time
# constant, below which lengths hardly change.
_LONGEST_PER_SEGMENT, _LARGEST_RATIO, _SHORTEST = 12.0, 30.0, 1e-4
# Accepted relative difference of both routes to the displacement per period.
_AGREED = 1e-8
# Useful periods have at most this number of time constants per segment.
_USED = 3.0
# A limit approached within this share counts as reached.
_REACHED = 1e-6


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
        """Yield a fault if coils have no effect."""
        if self.length_on == self.length_off:
            yield "length_on", "equals length_off, so coils have no effect; write another"

    @property
    def times(self) -> tuple[float, float]:
        """Time constants with the coil on and off."""
        return self.time_on, self.time_on if self.time_off is None else self.time_off


class DragGround(Given, tag_field="kind", tag="drag"):
    """Linear drag on each segment, proportional to (*l*/*L*)<sup>*a*</sup>."""

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

    def law(self) -> Drag:
        """Return the ground."""
        return Drag(self.exponent)


class TubeGround(Given, tag_field="kind", tag="tube"):
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

    def law(self) -> Tube:
        """Return the tube."""
        return Tube(self.contact)


class Limits(Given):
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

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults of times that do not fit into the longest period."""
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
        on, off = worm.times
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


class Objective(Given):
    """Objective of the switching; one of `maximise` and `minimise`."""

    maximise: Literal["speed"] | None = entry("mean speed", default=None)
    minimise: Literal["energy_per_distance"] | None = entry(
        "energy of the coils per distance", default=None
    )
    speed: float | None = positive("speed", "least mean speed, only with `minimise`", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield a fault unless there is one objective."""
        if (self.maximise is None) == (self.minimise is None):
            yield "", 'no objective or two are given; write maximise = "speed" or minimise'
        if self.speed is not None and self.minimise is None:
            yield "speed", 'needs minimise = "energy_per_distance"; leave it out'


class Starts(Given):
    """Starting points of the search; with up to three segments all orders are tried."""

    starts: int = whole(1, 100, "initial orders, the best of waves and of random orders", default=8)
    seed: Seed = entry("seed of the random orders", default=0)


@dataclass(frozen=True)
class Signals:
    """The motion over a period."""

    instant: np.ndarray = signal("time", "instant", "time")
    length: np.ndarray = signal("length", "segment instant", "length of the segment")
    coil: np.ndarray = signal("share", "segment instant", "1 while the coil is on, else 0")
    anchored: np.ndarray = signal(
        "share", "segment instant", "1 while the segment rests on the wall"
    )
    position: np.ndarray = signal("length", "ring instant", "position of the ring")
    velocity: np.ndarray = signal("speed", "instant", "velocity of the mean of all segment centres")


@dataclass(frozen=True)
class Switched:
    """Switching times of the coils."""

    on_time: np.ndarray = value("time", "time that each coil is on in a period")
    on_start: np.ndarray = value("time", "switch-on time of each coil; 0 for coil 0")
    duty: float = value("share", "largest share of the period that a coil is on")
    together: int = value("count", "largest number of coils on at a time")


class PeristalticSwitching(OptimalMotion, kind="peristaltic-switching"):
    """Optimise the switching times of the coils of a peristaltic worm.

    Each coil is on once in a period; their order is optimised too. Lengths relax by
    *l*′ = (target − *l*)/*τ*, so all arcs between switches are known in closed form. The search for
    the best order uses these. The times are then optimised again as phases of free duration. See
    [theory](../theory-peristaltic.md#5-switching).
    """

    pictures: ClassVar = {
        "switching": "coils, lengths and velocity over a period",
        "body": "the worm over a period, from top to bottom",
        "animation": "the moving worm",
    }
    headline: ClassVar = ("speed", "energy_per_distance", "time", "on_time", "on_start")

    worm: Worm = entry("the worm")
    ground: DragGround | TubeGround = entry('the ground, with `kind = "drag"` or `kind = "tube"`')
    limits: Limits = entry("limits of the switching times")
    objective: Objective = entry("objective")
    search: Starts = entry("starting points of the search", default=Starts)
    mesh: MeshTable = entry(
        "discretisation of a phase",
        default=MeshTable(arcs=2, degree=8, scheme="legendre"),
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.ground.faults_in(self.worm)
        yield from self.limits.faults_in(self.worm)

    # -- solving -----------------------------------------------------------------------------------

    @cached_property
    def switched_worm(self) -> SwitchedWorm:
        """The worm on its ground."""
        worm = self.worm
        return SwitchedWorm(
            worm.segments, worm.length_on, worm.length_off, *worm.times, self.ground.law()
        )

    @property
    def sought(self) -> Aim:
        """The maximised quantity."""
        return "speed" if self.objective.maximise else "thrift"

    @cached_property
    def useful(self) -> SwitchLimits:
        """Limits without periods longer than the worm can use."""
        given, (low, high) = self.limits, self.limits.period
        limits = SwitchLimits(
            (low, high), given.duty, given.dwell, given.together, self.objective.speed
        )
        return limits.that_count(self.switched_worm)

    @stage
    def orders(self) -> Search:
        worm, tries = self.switched_worm, self.search
        return search(
            worm, self.sought, self.useful, starts=tries.starts, seed=tries.seed,
            report=self.report,
        )  # fmt: skip

    def solve(self) -> dict[str, Optimum]:
        """Find the best order, and optimise its times."""
        mesh, worm = self.mesh, self.switched_worm
        even = Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme))
        try:
            found = self.orders.best
            best = polish(worm, self.sought, self.useful, found, even, mesh.tolerance, self.report)
        except SolveError as error:
            if error.code == "not_solved":
                raise SolveError(error.reason, self.remedy, error.partial, error.code) from None
            raise
        return {"phases": best}

    @property
    def remedy(self) -> str:
        """Advice if the best times are not determined well enough."""
        slow = max(self.worm.times)
        return (
            f"write limits.period within [{slow:g}, {_USED * self.worm.segments * slow:g}], where "
            "lengths change much and do not rest, or another search.seed"
        )

    @property
    def defect(self) -> float:
        return self.mesh.tolerance

    # -- the motion --------------------------------------------------------------------------------

    def expressions(self) -> dict[str, ca.SX]:
        """Return the signals to sample."""
        model = self.motion.program.problem.model
        return {
            "length": model["length"],
            "coil": model["coil"],
            "anchored": model["resting"],
            "velocity": model["speed"],
            "position": rings(model["position"], model["length"]),
        }

    @parts(Signals)
    def signals(self) -> Signals:
        return Signals(**self.sampled)

    @attributes
    def shown(self) -> dict[str, list[str]]:
        return {"signals": ["coil", "length", "velocity"]}

    @scalar(
        "count", "states of all coils, arc by arc: 1 on, 2 on with its segment at rest on the wall"
    )
    def coil_states(self) -> np.ndarray:
        return self.orders.best.lasting[0]

    @cached_property
    def durations(self) -> np.ndarray:
        """Durations of the arcs."""
        return np.diff(self.motion.phase_breaks())

    @scalar("length", "displacement per period")
    def distance(self) -> float:
        ends = self.motion.state("position", np.array([0.0, self.motion.duration]))[0]
        return float(ends[1] - ends[0])

    @scalar("speed", "mean speed")
    def speed(self) -> float:
        return self.distance / self.motion.duration

    @scalar("energy_per_distance", "energy of the coils per distance")
    def energy_per_distance(self) -> float:
        return self.worm.power * float(self.switched.on_time.sum()) / self.distance

    @parts(Switched)
    def switched(self) -> Switched:
        durations, period = self.durations, self.motion.duration
        coils = (self.coil_states != OFF).astype(int)
        on, begins = durations @ coils, np.concatenate([[0.0], np.cumsum(durations)[:-1]])
        goes_on = coils > np.roll(coils, 1, axis=0)
        start = np.array([begins[np.argmax(column)] for column in goes_on.T])
        return Switched(
            on_time=on,
            on_start=np.mod(start - start[0], period),
            duty=float(on.max()) / period,
            together=int(coils.sum(axis=1).max()),
        )

    @scalar("count", "number of orders whose times were optimised")
    def orders_tried(self) -> int:
        return self.orders.tried

    @cached_property
    def lengths(self) -> np.ndarray:
        """Lengths over the period, (N, m)."""
        return self.motion.state("length", np.linspace(0.0, self.motion.duration, 2001))

    @scalar("length", "least length of a segment")
    def length_min(self) -> float:
        return float(self.lengths.min())

    @scalar("length", "largest")
    def length_max(self) -> float:
        return float(self.lengths.max())

    @scalar("time", "period", name="time")
    def duration(self) -> float:
        return self.numbers.duration

    @scalar(
        "1",
        "minimised value: negative `speed`, or negative displacement per time that coils are "
        "on, scaled by the stroke of a segment over the sum of both time constants",
        name="objective",
    )
    def minimised(self) -> float:
        return self.numbers.minimised

    @scalar("share", "root of the mean number of coils on")
    def input_rms(self) -> float | None:
        return self.numbers.input_rms

    @scalar("share", "1")
    def input_peak(self) -> float | None:
        return self.numbers.input_peak

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def against_closed_form(self) -> Iterator[Check]:
        """Check the times by closed arcs, and in a tube by a walk of the coils."""
        worm, order, durations = self.switched_worm, self.coil_states, self.durations
        found = SwitchingProgram(worm, len(durations), self.sought).at(order, durations)
        worth = found.worth / worm.speed
        advice = f"by closed-form arcs the objective is {-worth:.9g}; {self.remedy}"
        error = abs(worth / self.optimum.objective + 1)
        yield Check("arcs in closed form", error, _AGREED, advice)
        if worm.ground.contact is None:
            return
        walked = walk(worm, order != OFF, durations, found.start)
        wrong = max(abs(walked.displacement - found.displacement), walked.slip) / found.displacement
        advice = (
            f"by the coils alone the displacement is {walked.displacement:.9g}, the slip "
            f"{walked.slip:.3g}; {self.remedy}"
        )
        error = max(wrong, walked.loose / found.period)
        yield Check("walk by the coils alone", error, _AGREED, advice)

    @facts
    def searched(self) -> dict[str, Any]:
        return {
            "search": {"orders_tried": self.orders.tried, "all_orders": self.orders.complete},
            "assumptions": ["each coil is switched on once and off once per period"],
        }

    @warnings
    def of_times(self) -> Iterator[str]:
        if not self.orders.complete:
            yield (
                f"{self.orders.tried} orders of switching were tried, not all; write another "
                "search.starts or search.seed to try others"
            )
        period, (low, high) = self.motion.duration, self.useful.period
        if low < high and period > high * (1 - _REACHED):
            if high < self.limits.period[1]:
                yield f"periods above {high:.4g} were not tried: all lengths rest before they end"
            else:
                yield "the best period is the longest one allowed; limits.period may be too narrow"
        if low < high and period < low * (1 + _REACHED):
            yield "the best period is the shortest one allowed; limits.period may be too narrow"
