"""Kind "compare-tracking": several controllers of one chain, on its nominal and on drawn plants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, ClassVar, TypeVar

from msgspec import structs

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import arrays, attributes, entry, facts, on_use, scalars, stage, warnings, whole
from wormopt.systems.chain.compare import Rivals
from wormopt.systems.chain.controllers import (
    Crawl,
    DesignedShape,
    LqrWeights,
    NamedReference,
    OptimalTracking,
)
from wormopt.systems.chain.hardware import faults_of_hardware
from wormopt.systems.chain.predictive import (
    ParameterEstimation,
    PredictiveControl,
    refused_of_nominal,
)
from wormopt.systems.chain.tables import (
    ChainTable,
    FunnelTracker,
    Grid,
    LeastError,
    LeastInput,
    Relaxation,
    Tracker,
    faults_of_lag,
)
from wormopt.systems.shared.declared import JUDGED, Scalars, Variables

with on_use():
    import numpy as np

    from wormopt.control.drive import drive
    from wormopt.control.loop import gait_reference, with_reference
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.numerics.workers import each
    from wormopt.ocp.optimise import Optimum
    from wormopt.systems.chain.controllers import Controller, Plan, Planned, make_plans, numbers_on
    from wormopt.systems.chain.copies import Draw
    from wormopt.systems.chain.drawn import Drawn, known_table
    from wormopt.systems.chain.loops import labels
    from wormopt.systems.chain.optimal_tracking import optimal_input
    from wormopt.systems.chain.predictive import Decided, decide

T = TypeVar("T")

TRACKING, TUBE, CRAWL = "optimal tracking", "optimal tube", "fastest crawl"
REAL_TIME, LEARNING = "predictive", "predictive + estimation"
LQR = "LQR, feed-forward"
"""Names of plans and controllers, for tables and pictures."""
_COUNTS: Scalars = {
    "known_plants": ("count", "plants with new plans made for their true parameters"),
    "known_failed": ("count", "new plans that failed, in the order of the attribute `known`"),
    "solve_iterations": ("count", "iterations of the plans for the nominal plant"),
}
_KNOWN: Variables = {
    f"known_{name}": (
        quantity,
        ("plan", "known_member"),
        f"{name} of the plant with known parameters",
    )
    for name, (quantity, _) in JUDGED.items()
}


class CompareTracking(Rivals, kind="compare-tracking"):
    """Compare adaptive trackers, LQR and optimal inputs, also with model errors.

    One exact simulator evaluates all controllers: adaptive trackers, LQR with feed-forward, optimal
    tracking, the least input that stays in the tube, and the fastest crawl, which has no reference.
    Plans are applied in open loop and with LQR around them. `[model]` is a plant of your own in
    place of the chain; the same from Python is `wo.compare`. `[predictive]` adds predictive control
    in real time, as in scenes of [kind `track-predictive`](track-predictive.md). `[draws]` applies
    the same controllers, which do not know the parameters, to plants with drawn parameters, and
    makes new plans for the first of these plants. `[hardware]` gives all controllers the same
    sensors, actuators and clock. With noise, delay or a clock a motion ends when its error exceeds
    ten radii of the tube, and its plant counts as lost. The file `table.md` beside the result holds
    all figures; [comparison.md](../comparison.md) discusses them.

    Not allowed: a tracker with another tube radius; `draws.known` above `draws.members`; a list
    of friction tables, or none.

    Intervals over the plants are exact and assume no distribution: Clopper-Pearson intervals for
    the share that leaves the tube, order statistics for medians. Plants that are lost, or whose
    simulation fails, rank below all others. With fewer than six plants, medians have no bounds.

    Scalars are lists of lists, by reference and controller. In the trust report, `recheck` is the
    second route for the first reference, without trackers. Attributes: `references`, `rivals` (the
    controllers), `known` (names), and `table`, the text of `table.md`.
    """

    pictures: ClassVar = {
        "comparison": "error over time, and largest error against input",
        "draws": "box plots over the plants",
    }
    refuses: ClassVar = refused_of_nominal("draws")

    reference: tuple[NamedReference, ...] = entry(
        "tables `[[reference]]`: gaits to follow; known plants use the first"
    )
    tracker: tuple[Tracker, ...] = entry(
        "tables `[[tracker]]`: controllers that do not know the plant; `tube_radius` of each must "
        "equal `tube.radius`"
    )
    lqr: LqrWeights | None = entry(
        "LQR with feed-forward, also around the optimal inputs; default: none", default=None
    )
    optimal: OptimalTracking | None = entry(
        "optimal tracking and the optimal tube; default: neither", default=None
    )
    crawl: Crawl | None = entry("the crawl without reference; default: none", default=None)
    predictive: PredictiveControl | None = entry(
        "predictive control in real time; default: none", default=None
    )
    estimation: ParameterEstimation | None = entry(
        "adds predictive control with parameter estimation; default: none", default=None
    )
    mesh: Grid = entry("mesh of the optimiser", default=Grid)
    relaxation: Relaxation = entry("relaxation of contact in the optimiser", default=Relaxation)
    workers: int = whole(1, 64, "number of processes for the optimisation", default=2)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if not self.reference:
            yield "reference", "has no entries; write at least one [[reference]]"
        yield from self._faults_of_trackers()
        if self.draws.known and self.optimal is None and self.crawl is None:
            yield "draws.known", "needs plans; write 0, or add [optimal] or [crawl]"
        if self.crawl is not None and self.model is not None:
            yield "crawl", "needs a chain, which has a centre of mass; leave the table out"
        yield from self._faults_of_decisions()
        yield from faults_of_hardware(self.hardware, self.time.end, self.tracker)

    def faults_of_worm(self, worm: ChainTable) -> Iterator[Fault]:
        """Yield what is not supported of a chain."""
        if worm.friction is None or isinstance(worm.friction, tuple):
            what = "is a list" if worm.friction else "missing"
            yield "worm.friction", f'{what}; write one table with kind = "coulomb" for all masses'
        if self.estimation is not None:
            yield from self.estimation.faults_in(worm)

    def faults_of_sizes(self, links: int) -> Iterator[Fault]:
        """Yield gaits and trackers that do not fit the number of links."""
        for k, reference in enumerate(self.reference):
            yield from self.faults_of_gait(reference.gait, links, f"reference[{k}].gait")
        for k, tracker in enumerate(self.tracker):
            yield from tracker.faults(f"tracker[{k}]", links)

    def _faults_of_trackers(self) -> Iterator[Fault]:
        for k, tracker in enumerate(self.tracker):
            yield from faults_of_lag(f"tracker[{k}]", tracker, self.time.end)
            free = isinstance(tracker, FunnelTracker) and tracker.tube_radius is None
            if not free and tracker.tube_radius != self.tube.radius:
                yield (
                    f"tracker[{k}].tube_radius",
                    f"differs from tube.radius = {self.tube.radius:g}, which judges all "
                    "controllers; write the same",
                )

    def _faults_of_decisions(self) -> Iterator[Fault]:
        if self.predictive is None:
            if self.estimation is not None:
                yield "estimation", "needs predictive control; add [predictive]"
            return
        yield from self.predictive.faults_in(self.time.end, self.units)
        if self.estimation is not None and self.model is not None:
            yield "estimation", "estimates parameters of chains; leave the table out"
        if not self.hardware.ideal:
            yield (
                "hardware",
                "does not apply to [predictive], which measures states and has a period of its "
                "own, but for input_limit; leave out one of them",
            )
        if self.hardware.input_limit is not None and self.predictive.force is not None:
            yield "predictive.force", "is that of hardware.input_limit here; leave it out"

    # -- references and plants ---------------------------------------------------------------------

    @stage
    def gaits(self) -> Sequence[Gait]:
        """Gait of each reference, some of which are designed."""
        return [
            each.gait.gait(self.links)
            if isinstance(each.gait, DesignedShape)
            else self.gait_of(each.gait, f"reference[{k}].gait")
            for k, each in enumerate(self.reference)
        ]

    @property
    def references(self) -> Sequence[str]:
        return [each.name for each in self.reference]

    def plant(self, gait: Gait) -> Model:
        """Nominal plant with the limits of its inputs, scaled by a reference gait."""
        return self.hardware.limited(self.plant_for(gait))

    def drawn(self) -> Sequence[Draw]:
        """Parameters of the drawn plants, which do not depend on the gait."""
        try:
            return self.draws.of(self.plant(self.gaits[0]))
        except ArgumentError as error:
            raise SceneError(self.name, [("draws.parameters", str(error))]) from None

    # -- plans and decisions -----------------------------------------------------------------------

    @cached_property
    def plan_names(self) -> Sequence[str]:
        """Plans of this scene."""
        tracking = () if self.optimal is None else (TRACKING, TUBE)
        return tracking if self.crawl is None else (*tracking, CRAWL)

    @cached_property
    def decision_names(self) -> Sequence[str]:
        """Predictive controllers of this scene."""
        real_time = () if self.predictive is None else (REAL_TIME,)
        return real_time if self.estimation is None else (*real_time, LEARNING)

    @stage
    def plans(self) -> Sequence[Mapping[str, Planned]]:
        """Plans by reference and name."""
        _ = self.feedback_loops  # a tracker that cannot start is refused before long solves
        known = self.trial.draws[: self.draws.known]
        others: list[Sequence[Draw]] = [()] * (len(self.gaits) - 1)
        return self._in_processes(self.make_plan, self.plan_names, [known, *others])

    def make_plan(self, job: tuple[str, Gait, Sequence[Draw]]) -> Planned:
        """Make plans of a name for a reference, also for the known plants; it raises nothing."""
        name, gait, known = job
        periodic = name == CRAWL
        return make_plans(
            partial(self._optimum, name, gait),
            known,
            periodic=periodic,
            seconds=None if periodic else self.relaxation.time_limit,
        )

    def _optimum(self, name: str, gait: Gait) -> Optimum:
        plant, optimal = self.plant(gait), self.optimal
        if name == CRAWL and self.crawl:
            return self.crawl.optimum(plant)
        assert optimal is not None
        return optimal_input(
            plant,
            gait_reference(gait, plant.t),
            self.time.end,
            LeastError(input_weight=optimal.input_weight)
            if name == TRACKING
            else LeastInput(margin=optimal.margin),
            self.tube,
            self.mesh,
            self.relaxation,
            period=gait.period,
        )

    @stage
    def decisions(self) -> Sequence[Mapping[str, Decided]]:
        """Decisions of the predictive controllers, by reference and name."""
        draws = [self.trial.draws] * len(self.gaits)
        return self._in_processes(self.make_decisions, self.decision_names, draws)

    def make_decisions(self, job: tuple[str, Gait, Sequence[Draw]]) -> Decided:
        """Decide for the nominal plant and the drawn plants; it raises nothing."""
        name, gait, draws = job
        assert self.predictive is not None
        learned = self.estimation if name == LEARNING else None
        plant, control = self.plant(gait), self.predictive
        reference = gait_reference(gait, plant.t)
        if (limit := self.hardware.input_limit) is not None:
            control = structs.replace(control, force=limit)
        return decide(plant, reference, self.time.end, control, learned, draws)

    def _in_processes(
        self, work: Callable[[Any], T], names: Sequence[str], draws: Sequence[Sequence[Draw]]
    ) -> Sequence[Mapping[str, T]]:
        """Do the work of each name for each reference and its `draws`, the longest first."""
        several = range(len(self.gaits))
        jobs = [(n, k) for k in several for n in reversed(names) if not k or n != CRAWL]
        todo = [(name, self.gaits[k], draws[k]) for name, k in jobs]
        done = each(work, todo, self.report, "computed", self.workers)
        made = {jobs[place]: found for place, found in done}
        return [{n: made[n, 0 if n == CRAWL else k] for n in names} for k in several]

    # -- controllers -------------------------------------------------------------------------------

    @cached_property
    def feedback_loops(self) -> Sequence[Sequence[Controller]]:
        """Trackers and LQR, by reference; SceneError if one cannot start at the initial state."""
        return [
            [*self._trackers(gait), *([self._lqr(LQR, gait, None)] if self.lqr else [])]
            for gait in self.gaits
        ]

    def _trackers(self, gait: Gait) -> Iterator[Controller]:
        for k, (name, tracker) in enumerate(zip(labels(self.tracker), self.tracker, strict=True)):
            plant = self.plant(gait)
            loop = self.closed(plant, gait_reference(gait, plant.t), tracker, f"tracker[{k}]")
            yield Controller(name, self.by_hardware(plant, loop))

    def _lqr(self, name: str, gait: Gait, plan: Plan | None) -> Controller:
        """LQR on the reference, or around a plan, whose inputs are fed forward."""
        assert self.lqr is not None
        plant = self.plant(gait)
        reference = gait_reference(gait, plant.t)
        try:
            if plan is None:
                loop = self.lqr.close(plant, reference)
            else:
                lengths = gait_reference(plan.lengths, plant.t, periodic=plan.periodic, name="plan")
                loop = with_reference(self.lqr.close(plant, lengths, plan.inputs), reference)
        except ArgumentError as error:
            raise SceneError(self.name, [("lqr", f"{error}; or leave the table out")]) from None
        return Controller(name, self.by_hardware(plant, loop))

    def by_hardware(self, plant: Model, loop: Model) -> Model:
        try:
            return super().by_hardware(plant, loop)
        except ArgumentError as error:
            raise SceneError(self.name, [("hardware", str(error))]) from None

    def driven(self, gait: Gait, inputs: Gait, *, periodic: bool = False) -> Model:
        """Plant with inputs over time, judged by the reference `gait`."""
        plant = self.plant(gait)
        compared = with_reference(plant, gait_reference(gait, plant.t))
        return self.by_hardware(plant, drive(compared, inputs, periodic=periodic))

    def controllers(self, index: int) -> Iterator[Controller]:
        """All controllers for a reference: first feedback, then plans, without and with LQR."""
        gait = self.gaits[index]
        yield from self.feedback_loops[index]
        found = {name: made.nominal for name, made in self.plans[index].items() if made.nominal}
        for name, plan in found.items():
            yield Controller(name, self.driven(gait, plan.inputs, periodic=plan.periodic))
        for name, plan in found.items() if self.lqr else ():
            yield self._lqr(f"{name} + LQR", gait, plan)
        for name, decided in self.decisions[index].items():
            if decided.nominal is not None:
                yield Controller(name, self.driven(gait, decided.nominal), decided.others)

    # -- motions -----------------------------------------------------------------------------------

    @stage
    def known(self) -> Mapping[str, Drawn]:
        """First plants under the plans made with their true parameters, by name of the plan."""
        return {
            name: Drawn.of([*map(self._on_known, made.known, self.trial.draws)])
            for name, made in self.plans[0].items()
        }

    def _on_known(self, plan: Plan | None, draw: Draw) -> dict[str, Any] | None:
        """Quantities of a drawn plant under a plan made for it; None without plan or motion."""
        if plan is None:
            return None
        model = self.driven(self.gaits[0], plan.inputs, periodic=plan.periodic)
        return numbers_on(draw, model, self.tube, self.time.end)

    # -- results -----------------------------------------------------------------------------------

    @scalars(_COUNTS)
    def plans_made(self) -> dict[str, Any]:
        """Numbers of plans and iterations; the crawl's iterations count once."""
        crawls_once = [
            made
            for k, row in enumerate(self.plans)
            for name, made in row.items()
            if not k or name != CRAWL
        ]
        return {
            "known_plants": self.draws.known,
            "known_failed": [each.failed for each in self.known.values()],
            "solve_iterations": sum(made.iterations for made in crawls_once),
        }

    @arrays(_KNOWN, when="draws.known")
    def on_known(self) -> dict[str, Any]:
        known = self.known.values()
        return {f"known_{name}": np.array([d.values[name] for d in known]) for name in JUDGED}

    @attributes
    def plants_known(self) -> dict[str, Any]:
        return {"known": [*self.known]}

    def tables(self) -> Iterator[str]:
        yield from super().tables()
        draws = self.draws
        if draws.known:
            which = f"plans with the true parameters of {draws.known} of these plants"
            yield from ("", f"## {self.reference[0].name}: {which}", "")
            plants = {one.name: one.drawn for one in self.runs[0]}
            weight = self.optimal.input_weight if self.optimal else 0.0
            yield from known_table(plants, self.known, draws.known, weight)

    # -- trust -------------------------------------------------------------------------------------

    @facts
    def computed_by(self) -> dict[str, Any]:
        return {
            "treatment": "complementarity in the optimiser, exact in every simulation",
            "plans": [{n: made.numbers for n, made in row.items()} for row in self.plans],
            "decisions": [{n: each.numbers for n, each in row.items()} for row in self.decisions],
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        for reference, row in zip(self.references, self.decisions, strict=True):
            for name, decided in row.items():
                if decided.nominal is None:
                    yield f"{reference}: no plan for {name}: {decided.numbers['reason']}"
                if decided.unsolved:
                    what = f"{decided.unsolved} decisions failed; the previous plan continued"
                    yield f"{reference}, {name}: {what}"
        for reference, row in zip(self.references, self.plans, strict=True):
            for name, made in row.items():
                if made.nominal is None:
                    yield f"{reference}: no plan for {name}: {made.numbers['reason']}"
        for name, each in self.known.items():
            if each.failed:
                yield f"{name}: no plan was found for {each.failed} of the known plants"
