"""Scenes of kinds "gait-design" and "gait-pareto": optimal gaits within limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, whole
from wormopt.study.types import SceneTable
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.declared import MOTION_SCALARS, MOTION_VARIABLES
from wormopt.systems.spiked.design_tables import (
    COST_WORDS,
    LimitTable,
    SearchTable,
    in_scene,
)
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.scenes.stepper import MotorTable
from wormopt.systems.spiked.tables import WormTable
from wormopt.systems.spiked.task import Cost, GaitProblem, Objective

Points = Annotated[int, Meta(ge=3, le=50, description="a whole number from 3 to 50")]

# For all designs; quantities that depend on the objective are declared as those of a speed.
DESIGN_SCALARS = MOTION_SCALARS | {
    "recheck_speed_error": ("speed", "difference in speed between the two routes"),
    "period": ("time", "period of one cycle, after which the motion repeats"),
    "advance": ("length", "distance travelled per cycle"),
    "cycles": ("count", "smallest number of cycles that fills a period allowed by `gait.period`"),
    "mode_sequence": (
        "count",
        "resting masses in each phase of a cycle. The prescribed sequence is in the trust report "
        "under `solver.sequence`; more masses may rest than it prescribes",
    ),
    "load_range": (
        "force",
        "[smallest, largest], if `worm.load` is a range; loads, forces and energies are those at "
        "the largest load",
    ),
    "ceiling": ("speed", "upper bound on the mean speed from link rates and resting masses"),
    "discretisation_error": (
        "speed",
        "gain in the objective from the last halving of all arcs. For energy and effort: a "
        "first-order estimate of the gain from one more halving. Unknown for an interrupted design",
    ),
    "ticks": ("count", "with `gait.tick`: number of ticks per cycle"),
    "tick_loss": (
        "share",
        "with `gait.tick`: relative loss in the objective compared with a free period",
    ),
    "free_period": ("time", "with `gait.tick`: optimal period of a cycle without `gait.tick`"),
    "free_speed": ("speed", "with `gait.tick`: mean speed at `free_period`"),
    "length_step": ("length", "`gait.length_step`, if given"),
    "step_loss": (
        "share",
        "with `gait.length_step`: relative loss of speed if lengths move in straight lines "
        "between rounded ticks and a mass always rests; negative if rounding gains speed",
    ),
    "worst_violation": ("share", "largest violation of a limit, relative to the limit"),
    "rate_limit_from": (
        "1",
        "with `[motor]`: for each link the source of the smaller rate limit, `gait` or `motor`",
    ),
    "acceleration_limit_from": ("1", "the same for the limit on acceleration"),
    "motor_rate_share": (
        "share",
        "with `[motor]`: largest link rate as a share of the motor's limit",
    ),
    "motor_acceleration_share": ("share", "the same for the acceleration"),
    "length_limits": ("length", "[shortest, longest] of each link"),
    "rate_limit": (
        "speed",
        "if `gait.rate` or `[motor]` is given: limits on the contraction of every link, then on "
        "its extension",
    ),
    "acceleration_limit": ("acceleration", "limit on |*l*″|, for all links or for each"),
    "spike_load_limit": ("force", "`gait.spike_load`, if given"),
    "actuator_force_limit": ("force", "`gait.actuator_force`, if given"),
}


class DesignTable(SceneTable):
    """Tables shared by all scenes that design gaits."""

    worm: WormTable = entry("the worm")
    gait: LimitTable = entry("the limits")
    search: SearchTable = entry("how to search", default=SearchTable)
    motor: MotorTable | None = entry(
        "a stepping motor with a threaded rod on each link; none by default. |*l*′| ≤ `lead` "
        "· `rate_max` and |*l*″| ≤ `lead` · `acceleration_max` hold in addition to the limits "
        "in `[gait]`, which then need no `rate` or `acceleration`. Other keys of this table "
        "have no effect on the design; the limits also hold below `start_rate`. Refused: "
        "`gait.impulses`",
        default=None,
    )

    @property
    def limits(self) -> Limits:
        """The limits, including those of the motors."""
        own, motor = self.gait.limits, self.motor
        if motor is None:
            return own
        return own.within(motor.length_rate, motor.length_acceleration, self.worm.links)

    def task(self, objective: Objective) -> GaitProblem:
        """The design problem for the given objective."""
        return GaitProblem(self.worm.worm, self.limits, objective)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_design()

    def faults_of_design(self) -> Iterator[Fault]:
        """Yield what is wrong between worm, limits, motor and search."""
        yield from self.worm.faults(self.units, loads=True)
        yield from self._faults_of_limits()
        if self.motor is not None:
            yield from self.motor.faults()
        yield from self.search.faults(self.worm.links, self.gait.resting)

    def _faults_of_limits(self) -> Iterator[Fault]:
        limits = self.gait.limits
        if self.motor is not None:
            if limits.impulses:
                yield (
                    "gait.impulses",
                    "true, but motor.acceleration_max forbids jumps of velocity; remove the key",
                )
                return
            given = {name: getattr(limits, name) or 1.0 for name in ("rate", "acceleration")}
            limits = replace(limits, **given)  # the motor gives the missing ones
        for key, message in limits.faults(self.worm.links, "gait."):
            yield f"gait.{key}".removesuffix("."), message

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if the cost at `key` cannot be minimised in this scene."""
        for message in Objective(cost).faults_within(self.worm.worm, self.gait.limits):
            yield key, in_scene(message)


class ParetoTable(Given):
    """The Pareto front to compute."""

    against: Cost = entry(f"the cost to trade against speed: {COST_WORDS}")
    points: int = whole(
        3,
        50,
        "number of designed gaits: the fastest, and the cheapest at equidistant lower speeds",
        default=9,
    )


class GaitParetoScene(DesignTable):
    """The Pareto front of optimal gaits between speed and a cost.

    Kind [`gait-design`](gait-design.md) explains `[gait]`, `[search]`, `[motor]` and the trust
    report. All points are searched with the same effort. Each point tries the resting sequence of
    the previous point first. `search.time_limit` applies to each point.

    Refused: costs that are refused in `[objective]` of a design; `[search.certify]`.

    Points are numbered from 0, the slowest. The front is printed as a table, which is also in
    `table.md`. The table gives the cost of each point, its resting masses in order, the limits that
    bind, and the knee of the front. It also marks points whose resting sequence differs from that
    of the point before. There the front jumps, and the picture `front` draws no line.

    The gait of every point is saved. Load it with `load_gait(path, point=2)` in Python, or with
    `file = "result.nc"` and `point = 2` in a scene. Signals, the trust report and all scalars
    except those of the front belong to the gait at the knee. In the trust report, `dominated` is
    the number of points that a faster gait dominates. Its warnings include those of other points
    and list points for which no gait was found. The cost is also a scalar (`spike_load_max`,
    `actuator_force_max`, `energy_per_distance` or `acceleration_effort`), and `front_value` has its
    quantity. Timing: `front`.
    """

    headline: ClassVar = (
        "front_objective",
        "front_points",
        "speed_max",
        "speed",
        "period",
        "mode_sequence",
    )
    scalars: ClassVar = DESIGN_SCALARS | {
        "acceleration_effort": ("acceleration_squared", "acceleration effort, if it is the cost"),
        "front_objective": ("1", "the cost, as given in `pareto.against`"),
        "front_points": ("count", "number of points on the front"),
        "front_knee": ("count", "index of the knee; points are numbered from 0, the slowest"),
        "front_jumps": (
            "count",
            "neighbouring points on the front with different resting sequences",
        ),
        "front_speeds": ("speed", "mean speed of each point"),
        "front_values": ("force", "cost of each point, in its quantity"),
        "front_counted": ("1", "whether each point is on the front: accepted and not dominated"),
        "front_sequences": ("count", "resting masses of each point, phase by phase"),
        "front_resting": ("count", "smallest number of resting masses of each point"),
        "front_binding": ("1", "limits of `[gait]` that bind at each point"),
        "speed_max": ("speed", "mean speed of the fastest gait"),
    }
    variables: ClassVar = {
        **MOTION_VARIABLES,
        **GAIT,
        "front_speed": ("speed", ("point",), "mean speed"),
        "front_value": ("force", ("point",), "cost"),
        "front_accepted": ("1", ("point",), "1 if the point is on the front"),
        "front_order": ("count", ("point",), "number that identifies the resting sequence"),
        "front_gait_breaks": (
            "time",
            ("point", "front_gait_break"),
            "times at which pieces of the point's gait begin, NaN after the last",
        ),
        "front_gait_polynomial": (
            "length",
            ("point", "front_gait_piece", "link", "front_gait_power"),
            "coefficients of s^k, s the time since the piece began, NaN after the last piece",
        ),
    }

    kind: Literal["gait-pareto"]
    want: tuple[Literal["front", "gait", "motion", "spikes"], ...] = entry(
        "`front`: the front; `gait`, `motion`, `spikes`: the gait at its knee", default=()
    )
    pareto: ParetoTable = entry("the front")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_cost("pareto.against", self.pareto.against)
        if self.search.certify is not None:
            yield (
                "search.certify",
                "a front has no certificate; remove the table and certify single gaits in scenes "
                'of kind = "gait-design"',
            )
