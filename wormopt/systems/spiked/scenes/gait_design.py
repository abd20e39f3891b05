"""Scenes of kinds "gait-design" and "gait-pareto": the best gaits within limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.model.given import per
from wormopt.scene.types import SceneTable, Table, says
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.scenes.design_tables import (
    COST_WORDS,
    LimitTable,
    ObjectiveTable,
    SearchTable,
    in_scene,
)
from wormopt.systems.spiked.scenes.gait import MOTION_SCALARS, MOTION_VARIABLES, WormTable
from wormopt.systems.spiked.scenes.stepper import MotorTable
from wormopt.systems.spiked.task import Cost, GaitProblem, Objective

Points = Annotated[int, Meta(ge=3, le=50, description="a whole number from 3 to 50")]

# Of all designs; quantities that depend on the objective stand here as those of a speed.
DESIGN_SCALARS = MOTION_SCALARS | {
    "period": ("time", "the shortest after which the motion repeats: of one cycle"),
    "advance": ("length", "of one cycle"),
    "cycles": ("count", "the fewest that together last a period that `gait.period` allows"),
    "mode_sequence": (
        "count",
        "resting masses of a cycle of the motion, phase after phase; the order that was prescribed "
        "stands in the trust report under `solver.sequence`: more masses may rest than it asks for",
    ),
    "load_range": (
        "force",
        "[smallest, largest], where `worm.load` is a range; loads, forces and energies are those "
        "under the largest",
    ),
    "ceiling": ("speed", "upper bound on the mean speed by link rates and resting masses"),
    "discretisation_error": (
        "speed",
        "gain in the objective, in its quantity, that the last halving of every arc brought; of "
        "energy and effort what another halving could bring, to first order. Unknown for an "
        "interrupted design",
    ),
    "ticks": ("count", "with `gait.tick`: ticks of a cycle"),
    "tick_loss": (
        "share",
        "with `gait.tick`: by how much the objective is worse than that of `free_period`",
    ),
    "free_period": ("time", "with `gait.tick`: the best period of a cycle without it"),
    "free_speed": ("speed", "with `gait.tick`: mean speed of that gait"),
    "length_step": ("length", "as given in the scene, where given"),
    "step_loss": (
        "share",
        "with `gait.length_step`: of the speed, lost where lengths go straight from one rounded "
        "tick to the next, some mass always at rest; negative where rounding gains",
    ),
    "worst_violation": ("share", "largest excess over any limit, relative to its size"),
    "rate_limit_from": (
        "1",
        "with `[motor]`: for each link whose limit is the smaller, `gait` or `motor`",
    ),
    "acceleration_limit_from": ("1", "the same of accelerations"),
    "motor_rate_share": (
        "share",
        "with `[motor]`: largest share of the motor's limit that the gait uses",
    ),
    "motor_acceleration_share": ("share", "the same of accelerations"),
    "length_limits": ("length", "[shortest, longest] of each link"),
    "rate_limit": (
        "speed",
        "where `gait.rate` or `[motor]` is given: limits on contraction of every link, then on "
        "extension",
    ),
    "acceleration_limit": ("acceleration", "where there is one: on |*l*″|, for all or each link"),
    "spike_load_limit": ("force", "as given in the scene, where given"),
    "actuator_force_limit": ("force", "as given in the scene, where given"),
}


class DesignTable(SceneTable, frozen=True, kw_only=True):
    """What all scenes that design gaits share."""

    worm: Annotated[WormTable, says("", "the worm")]
    gait: Annotated[LimitTable, says("", "the limits")]
    search: Annotated[SearchTable, says("", "how to search")] = field(default_factory=SearchTable)
    motor: Annotated[
        MotorTable | None,
        says(
            "",
            "none if left out. A stepping motor on a threaded rod sets each link: |*l*′| ≤ `lead` "
            "· `rate_max` and |*l*″| ≤ `lead` · `acceleration_max` hold besides the limits in "
            "`[gait]`, which need give none of their own then. Keys that do not concern rates are "
            "not used, nor is `start_rate`: limits hold below it too. Refused: `gait.impulses`",
        ),
    ] = None

    @property
    def limits(self) -> Limits:
        """The limits, those of the motors among them."""
        own, motor = self.gait.limits, self.motor
        if motor is None:
            return own
        return own.within(motor.length_rate, motor.length_acceleration, self.worm.links)

    def task(self, objective: Objective) -> GaitProblem:
        """The problem of design with the given objective."""
        return GaitProblem(self.worm.worm, self.limits, objective)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.worm.faults(self.units, loads=True)
        yield from self._faults_of_limits()
        if self.motor is not None:
            yield from self.motor.faults()
        yield from self.search.faults(self.worm.links, self.gait.resting)

    def _faults_of_limits(self) -> Iterator[Fault]:
        limits = self.gait.limits
        if self.motor is not None:
            if limits.impulses:
                yield "gait.impulses", "motor.acceleration_max forbids jumps; leave it out"
                return
            given = {name: getattr(limits, name) or 1.0 for name in ("rate", "acceleration")}
            limits = replace(limits, **given)  # what is left out is the motor's
        for key, message in limits.faults(self.worm.links, "gait."):
            yield f"gait.{key}".removesuffix("."), message

    def faults_of_cost(self, key: str, cost: Cost | None) -> Iterator[Fault]:
        """Yield a fault if the cost at `key` cannot be sought in this scene."""
        for message in Objective(cost).faults_within(self.worm.worm, self.gait.limits):
            yield key, in_scene(message)


class GaitDesignScene(DesignTable, frozen=True, kw_only=True):
    """The best gait within limits.

    Scalars and variables are explained with kind [`gait`](gait.md); signals, and the gait that is
    saved with them, are one cycle, `period` long. Quantities of `objective`, `bound`,
    `discretisation_error` and of the variables `proof_bound`, `proof_value` are those of the
    objective. Timings: `search`, `polish_and_refine`, `prove`, and `sensitivity`, `certify`, `verify`
    where there are. Attribute `limits`: the lists `name`, `value`, `unit` and `one_sided` in the order of
    `limit_elasticity` (per cent of the objective per per cent of each limit; 0 for a limit of 0),
    and `objective`, what they count for.

    **Sensitivities.** What binds a designed gait: the scalars `sensitivity.KEY`, in objective per
    limit, are the change of the objective per unit of each number in `[gait]`, `[worm]` and
    `objective.speed`: `sensitivity.period`, `.length.shortest`, `.length.longest`, `.rate` (or
    `.rate.contraction`, `.rate.extension`), `.acceleration`, `.spike_load`, `.actuator_force`,
    `.sigma_margin`, `.speed` (the required one), `.mass`, `.drag`, `.load`, as far as the scene
    gives them. A range has `.shortest` and `.longest`, of the load `.smallest` and `.largest`; a
    key with one number per link or mass has a list. A limit that does not bind has 0. On a
    slope, `.load` is by the whole load, weight included, and `.slope` by the load that it makes;
    `.mass` leaves the load as it is.

    - It is the derivative of the best objective of this order of rest and number of cycles. Should
      another order become better, more can be gained than it says, never less.
    - It counts in the direction in which the objective gets better: of limits, when they are
      relaxed. A limit of 0 can only be raised: `sensitivity.sigma_margin` is the price of a
      margin, in the first instance.
    - Where raising and lowering count differently, by more than 1 %, another limit takes over at
      this very place; the trust report names these limits under `sensitivity.one_sided`. Where
      several limits bind together, so that no single one of them helps, it is 0 for each. Programs
      of more than 400 unknowns are not solved again to tell this from a family of gaits that are
      best alike: there a limit of one link or mass among many may be worth more than it says, and
      `scaling_error` is not small.
    - With `[motor]`, `rate` and `acceleration` are the limits that hold, one per link, be they the
      scene's or the motor's.
    - `sensitivity.scaling_error` in the trust report: the same worm in other units of mass, length
      and time has the same gait, so certain sums of per cents are known; this is how far they are
      off. Near 0, unless something counts differently to both sides.
    - With `gait.tick` they are those of the best gait without it: the best objective of whole ticks
      moves in jumps.
    - Unknown for `energy_per_distance` and `acceleration_effort`, for an interrupted design, and,
      unless `want` has `limits`, for programs of more than 3000 unknowns; the trust report says
      so.

    **The trust report** holds besides `violations`, the balances and the second route
    ([quick start](../quickstart.md#3-the-trust-report)):

    | key | meaning |
    | --- | --- |
    | `solver.status` | `sharpened`: arcs halved until that gains nothing, then taken to rounding; `cut short` after a time limit or Ctrl-C; IPOPT's word where it solved for a smooth cost |
    | `solver.violation` | largest excess over any row of the last program, in its own units |
    | `solver.arcs_per_phase`, `solver.degree` | arcs of the gait in each phase of `solver.sequence`; degree of the lengths on an arc |
    | `solver.sequence`, `solver.durations`, `solver.cycles` | the order that was prescribed, without phases that shrank to nothing; how long each phase lasts; cycles in a period |
    | `search.ended` | `searched`; `proven`, where no gait can be better by more than `search.gap`; `time limit` or `interrupted` |
    | `search.tried`, `search.variations_tried` | orders of rest that were tried; variations that were made, those passed over for their ceilings included |
    | `search.linear_programs` | linear programs solved in the search |
    | `search.stages_s` | seconds of each stage |
    | `search.best` | the best five orders with their cycles and objective, before they are sharpened |
    | `sensitivity` | how sensitivities were found, or why they are unknown |
    | `certificate` | of a speed, or with `[search.certify]`: to which gaits the proof applies, how it was found, how many inequalities were verified exactly, why a longer proof ended |

    The proof is written to the file `certificate.json`, unless rates and resting masses alone give a smaller bound. `wormopt verify certificate.json` verifies it.
    """  # noqa: E501

    headline: ClassVar = (
        "speed",
        "objective",
        "bound",
        "gap_certified",
        "period",
        "cycles",
        "tick_loss",
        "mode_sequence",
    )
    scalars: ClassVar = DESIGN_SCALARS | {
        "objective": ("speed", "value reached, in its quantity, recomputed from the gait"),
        "bound": (
            "speed",
            "of a speed, or with `[search.certify]`: proven, no gait of any phases and cycles is "
            "faster, or cheaper; never above the ceiling, which it is (for a cost 0) before "
            "anything better is proven",
        ),
        "gap_certified": (
            "share",
            "with `bound`: by how much any gait could be better at most, as a share of `objective`",
        ),
        "certified_seconds": ("s", "with `[search.certify]`: time spent on the proof"),
    }
    variables: ClassVar = {
        **MOTION_VARIABLES,
        **GAIT,
        "proof_time": ("s", ("proof",), "time spent on the proof"),
        "proof_bound": ("speed", ("proof",), "proven bound"),
        "proof_value": ("speed", ("proof",), "of the gait"),
        "limit_elasticity": (
            "1",
            ("limit",),
            "per cent of the objective per per cent of the limit",
        ),
    }

    kind: Literal["gait-design"]
    want: Annotated[
        tuple[Literal["gait", "motion", "spikes", "limits", "certificate", "animation"], ...],
        says(
            "",
            "`gait`, `motion`, `spikes` as for kind [`gait`](gait.md), of one cycle, `animation` "
            "of two; `limits`: which limit to relax first, per cent speed, or cost, per per cent "
            "of each limit (not for `energy_per_distance` and `acceleration_effort`); "
            "`certificate`: bound over time (with a table `[search.certify]`)",
        ),
    ] = ()
    objective: Annotated[ObjectiveTable, says("", "what to seek")]

    def _faults_of_loads(self) -> Iterator[Fault]:
        """Whether spikes can bear what they bear on average over a cycle: at least all loads."""
        limit, masses = self.gait.spike_load, self.worm.links + 1
        load = self.worm.worm.load
        whole = masses * (max(load) if isinstance(load, tuple) else load)
        if limit is not None and sum(per(limit, masses)) <= whole:
            yield (
                "gait.spike_load",
                f"{sum(per(limit, masses)):.6g} on all {masses} spikes together is no more than "
                f"the load of the worm, {whole:.6g}, which they bear on average over a cycle: no "
                f"gait exists; write more than {whole / masses:.6g} per spike, or a smaller load",
            )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        faults = list(super().faults(folder))
        yield from faults or self._faults_of_loads()
        yield from self.objective.faults()
        yield from self.faults_of_cost("objective.minimise", self.objective.minimise)
        wanted, objective = self.search.proof, self.objective.objective
        if wanted is None:
            if "certificate" in self.want:
                yield "want", '"certificate" draws a proof; add a table [search.certify]'
            return
        if objective.is_smooth:
            yield (
                "search.certify",
                f"there is no proof for {objective.minimise}; leave it out, or seek speed, "
                "peak_spike_load or peak_actuator_force",
            )


class ParetoTable(Table, frozen=True, kw_only=True):
    """The front to compute."""

    against: Annotated[Cost, says("", f"the cost that is weighed against speed: {COST_WORDS}")]
    points: Annotated[
        Points,
        says(
            "count",
            "gaits that are designed: the fastest, and the cheapest at equidistant lower speeds",
        ),
    ] = 9


class GaitParetoScene(DesignTable, frozen=True, kw_only=True):
    """The front of the best gaits between speed and a cost.

    `[gait]`, `[search]` and `[motor]` as for kind [`gait-design`](gait-design.md), where the trust
    report is explained too. All points are searched with the same effort; each tries the order of
    the point before first. `search.time_limit` counts for each point.

    Refused: costs that are refused in `[objective]` of a design; `[search.certify]`.

    Points count from 0, the slowest. The front is printed as a table, which `table.md` holds too:
    what each point costs, which masses rest in turn, which limits bind, which point is the knee,
    and where the order of rest is another than before: there the front jumps, and the picture
    `front` joins no line.

    The gait of every point is kept: `load_gait(path, point=2)` from Python, `file = "result.nc"`
    with `point = 2` in a scene. All scalars but those of the front, and the signals, belong to the
    gait at its knee, and so does the trust report, with `dominated` (points that a faster one
    beats) and, among its warnings, those of other points and points for which no gait was found.
    The cost itself is a scalar too (`spike_load_max`, `actuator_force_max`, `energy_per_distance`,
    or `acceleration_effort`), and `front_value` is in its quantity. Timing: `front`.
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
        "acceleration_effort": ("acceleration_squared", "where it is the cost"),
        "front_objective": ("1", "the cost, as in `pareto.against`"),
        "front_points": ("count", "points that count"),
        "front_knee": ("count", "which point the knee is; points count from 0, the slowest"),
        "front_jumps": (
            "count",
            "neighbouring points that count and differ in the order in which masses rest",
        ),
        "front_speeds": ("speed", "mean speed of each point"),
        "front_values": ("force", "the cost of each point, in its quantity"),
        "front_counted": ("1", "whether each point counts: accepted, and no faster one costs less"),
        "front_sequences": ("count", "of each point the masses that rest, phase after phase"),
        "front_resting": ("count", "of each point the smallest number of masses at rest"),
        "front_binding": ("1", "of each point the limits of `[gait]` that leave it no room"),
        "speed_max": ("speed", "of the fastest gait"),
    }
    variables: ClassVar = {
        **MOTION_VARIABLES,
        **GAIT,
        "front_speed": ("speed", ("point",), "mean speed"),
        "front_value": ("force", ("point",), "the cost"),
        "front_accepted": ("1", ("point",), "1 where the point counts"),
        "front_order": ("count", ("point",), "number of the order of rest, alike where that is"),
        "front_gait_breaks": (
            "time",
            ("point", "front_gait_break"),
            "times at which pieces of the point's gait begin, NaN behind the last",
        ),
        "front_gait_polynomial": (
            "length",
            ("point", "front_gait_piece", "link", "front_gait_power"),
            "coefficients of s^k, s the time since the piece began, NaN behind the last piece",
        ),
    }

    kind: Literal["gait-pareto"]
    want: Annotated[
        tuple[Literal["front", "gait", "motion", "spikes"], ...],
        says("", "`front`; `gait`, `motion`, `spikes` show the gait at the knee of the front"),
    ] = ()
    pareto: Annotated[ParetoTable, says("", "the front")]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_cost("pareto.against", self.pareto.against)
        if self.search.certify is not None:
            yield (
                "search.certify",
                "one design is certified at a time; leave it out, and certify the gaits that "
                'matter in scenes of kind = "gait-design"',
            )
