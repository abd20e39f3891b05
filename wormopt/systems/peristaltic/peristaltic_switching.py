"""Kind "peristaltic-switching": optimal times of coils that are on or off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from msgspec import structs

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Seed
from wormopt.systems.peristaltic.switched import (
    DragGround,
    Limits,
    Objective,
    SwitchedWorm,
    TubeGround,
    Worm,
)
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.optimise import Optimum
    from wormopt.systems.peristaltic.drag import rings
    from wormopt.systems.peristaltic.switching import OFF, SwitchingProgram, polish, walk
    from wormopt.systems.peristaltic.switching_orders import Search, search

# Accepted relative difference of both routes to the displacement per period.
_AGREED = 1e-8
# Useful periods have at most this number of time constants per segment.
_USED = 3.0
# A limit approached within this share counts as reached.
_REACHED = 1e-6


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
        return SwitchedWorm(**structs.asdict(self.worm), ground=self.ground)

    @cached_property
    def useful(self) -> Limits:
        """Limits without periods longer than the worm can use."""
        return self.limits.that_count(self.switched_worm)

    @stage
    def orders(self) -> Search:
        worm, tries = self.switched_worm, self.search
        return search(
            worm, self.objective, self.useful, starts=tries.starts, seed=tries.seed,
            report=self.report,
        )  # fmt: skip

    def solve(self) -> dict[str, Optimum]:
        """Find the best order, and optimise its times."""
        mesh, worm = self.mesh, self.switched_worm
        even = Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme))
        try:
            found = self.orders.best
            best = polish(
                worm, self.objective, self.useful, found, even, mesh.tolerance, self.report
            )
        except SolveError as error:
            if error.code == "not_solved":
                raise SolveError(error.reason, self.remedy, error.partial, error.code) from None
            raise
        return {"phases": best}

    @property
    def remedy(self) -> str:
        """Advice if the best times are not determined well enough."""
        slow = max(self.worm.time_on, self.worm.tau_off)
        return (
            f"write limits.period within [{slow:g}, {_USED * self.worm.segments * slow:g}], where "
            "lengths change much and do not rest, or another search.seed"
        )

    # -- the motion --------------------------------------------------------------------------------

    def expressions(self) -> dict[str, ca.SX]:
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
        found = SwitchingProgram(worm, len(durations), self.objective).at(order, durations)
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
