"""Kind "compare-tracking": several controllers of one chain, on its nominal and on drawn plants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, ClassVar, Literal, TypeVar

from wormopt.errors import ArgumentError, Fault, SceneError, SolveError
from wormopt.result import NOT_RECHECKED, Check, Unchecked
from wormopt.study import (
    Study,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    scalar,
    scalars,
    stage,
    warnings,
    whole,
)
from wormopt.study.numerics import Horizon, Start, ToleranceTable
from wormopt.systems.chain.controllers import (
    Crawl,
    DesignedShape,
    Draws,
    LqrWeights,
    Measurement,
    NamedReference,
    OptimalTracking,
)
from wormopt.systems.chain.predictive import (
    ParameterEstimation,
    PredictiveControl,
    faults_of_nominal,
)
from wormopt.systems.chain.tables import (
    ChainTable,
    CoulombFriction,
    FunnelTracker,
    Grid,
    LeastError,
    LeastInput,
    Relaxation,
    Tracker,
    Tube,
    faults_of_lag,
)
from wormopt.systems.shared.declared import JUDGED, LOOP_SIGNALS, TIME, Scalars, Variables, over

with on_use():
    import numpy as np

    from wormopt.control.drive import drive
    from wormopt.control.loop import gait_reference, with_reference
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.numerics.workers import each
    from wormopt.ocp.optimise import Optimum
    from wormopt.systems.chain.controllers import (
        Controller,
        Judged,
        Plan,
        Planned,
        Trial,
        make_plans,
        numbers_on,
    )
    from wormopt.systems.chain.copies import Draw, drawn_plants
    from wormopt.systems.chain.drawn import (
        Drawn,
        drawn_table,
        interval_table,
        known_table,
        less,
        nominal_table,
    )
    from wormopt.systems.chain.loops import chain_for, close_loop, draw_links, labels
    from wormopt.systems.chain.optimal_tracking import optimal_input
    from wormopt.systems.chain.predictive import Decided, decide
    from wormopt.systems.shared.proof import accepted_error
    from wormopt.systems.shared.signals import fitted
    from wormopt.systems.spiked import gait_of_shape

T = TypeVar("T")

TRACKING, TUBE, CRAWL = "optimal tracking", "optimal tube", "fastest crawl"
REAL_TIME, LEARNING = "predictive", "predictive + estimation"
LQR = "LQR, feed-forward"
"""Names of plans and controllers, for tables and pictures."""
COMPARED = ("error_norm", "length", "input", "position")
"""Signals that are kept of every controller."""
RANKED = ("time_outside_tube", "error_peak", "error_integral", "input_integral", "distance")
"""Quantities that are reported as medians over the plants with intervals, and compared between
controllers.
"""

_RIVALS = ("reference", "rival")
_COUNTS: Scalars = {
    "tube_radius": ("length", "*λ*"),
    "draws": ("count", "number of drawn plants"),
    "draws_failed": ("count", "plants whose simulation failed"),
    "draws_outside": ("count", "plants that leave the tube after the time of capture"),
    "known_plants": ("count", "plants with new plans made for their true parameters"),
    "known_failed": ("count", "new plans that failed, in the order of the attribute `known`"),
    "solve_iterations": ("count", "iterations of the plans for the nominal plant"),
}
_SIGNALS: Variables = {
    **TIME,
    **over({name: LOOP_SIGNALS[name] for name in COMPARED}, *_RIVALS),
    "aim": ("length", ("reference", "link", "time"), "reference of the link length"),
}
_DRAWN: Variables = {
    f"drawn_{name}": (quantity, (*_RIVALS, "member"), f"{name} of the plant")
    for name, (quantity, _) in JUDGED.items()
}
_KNOWN: Variables = {
    f"known_{name}": (
        quantity,
        ("plan", "known_member"),
        f"{name} of the plant with known parameters",
    )
    for name, (quantity, _) in JUDGED.items()
}
_INTERVALS: Variables = {
    "outside_share": (
        "share",
        (*_RIVALS, "bound"),
        "exact 95 % interval of the share of plants that leave the tube",
    ),
    **{
        f"median_{name}": (
            JUDGED[name][0],
            (*_RIVALS, "bound"),
            f"interval of at least 95 % for the median of {name} over the plants",
        )
        for name in RANKED
    },
    **{
        f"less_{name}": (
            "count",
            (*_RIVALS, "other"),
            f"plants on which {name} is lower than with the other controller",
        )
        for name in RANKED
    },
}


class CompareTracking(Study, kind="compare-tracking"):
    """Compare adaptive trackers, LQR and optimal inputs, also with model errors.

    One exact simulator evaluates all controllers: adaptive trackers, LQR with feed-forward, optimal
    tracking, the least input that stays in the tube, and the fastest crawl, which has no reference.
    Plans are applied in open loop and with LQR around them. `[predictive]` adds predictive control
    in real time, as in scenes of [kind `track-predictive`](track-predictive.md). `[draws]` applies
    the same controllers, which do not know the parameters, to plants with drawn parameters, and
    makes new plans for the first of these plants. `[measurement]` gives the feedback noisy and
    delayed lengths. A motion then ends when its error exceeds ten radii of the tube, and its plant
    counts as lost. The file `table.md` beside the result holds all figures;
    [comparison.md](../comparison.md) discusses them.

    Not allowed: a tracker with another tube radius; `draws.known` above `draws.members`; friction
    other than one `coulomb` table; `worm.random`.

    Intervals over the plants are exact and assume no distribution: Clopper-Pearson intervals for
    the share that leaves the tube, order statistics for medians. Plants that are lost, or whose
    simulation fails, rank below all others. With fewer than six plants, medians have no bounds.

    Scalars are lists of lists, by reference and controller. In the trust report, `recheck` is the
    second route for the first reference, without trackers. Attributes: `references`, `rivals` (the
    controllers), `known` (names), and `table`, the text of `table.md`.
    """

    pictures: ClassVar = {
        name: f"wormopt.systems.chain.pictures:{name}" for name in ("comparison", "draws")
    }
    table_file: ClassVar = True

    want: tuple[Literal["comparison", "draws"], ...] = entry(
        "`comparison`: error over time, and largest error against input; `draws`: box plots "
        "over the plants",
        default=(),
    )
    worm: ChainTable = entry("the chain, with one `coulomb` table of friction, without `random`")
    start: Start = entry("initial state", default=Start)
    reference: tuple[NamedReference, ...] = entry(
        "tables `[[reference]]`: gaits to follow; known plants use the first"
    )
    tube: Tube = entry("tube that all controllers are judged by, from the time of capture on")
    tracker: tuple[Tracker, ...] = entry(
        "tables `[[tracker]]`: controllers that do not know the plant; their `tube_radius` is "
        "`tube.radius`"
    )
    lqr: LqrWeights = entry("LQR with feed-forward, also around the optimal inputs")
    optimal: OptimalTracking | None = entry(
        "optimal tracking and the optimal tube; default: neither", default=None
    )
    crawl: Crawl | None = entry("the crawl without reference; default: none", default=None)
    measurement: Measurement | None = entry(
        "noise and delay of the measurements; default: exact measurements", default=None
    )
    predictive: PredictiveControl | None = entry(
        "predictive control in real time; default: none", default=None
    )
    estimation: ParameterEstimation | None = entry(
        "adds predictive control with parameter estimation; default: none", default=None
    )
    draws: Draws = entry("plants with drawn parameters")
    mesh: Grid = entry("mesh of the optimiser", default=Grid)
    relaxation: Relaxation = entry("relaxation of contact in the optimiser", default=Relaxation)
    workers: int = whole(1, 64, "number of processes for the optimisation", default=2)
    time: Horizon
    tolerance: ToleranceTable = entry(
        "tolerance of the simulation of the nominal plant", default=ToleranceTable
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what no single key shows."""
        links, end = self.worm.links, self.time.end
        yield from self.worm.faults(end, self.units)
        yield from self.start.faults(links)
        if not self.reference:
            yield "reference", "has no entries; write at least one [[reference]]"
        for k, reference in enumerate(self.reference):
            yield from reference.gait.faults(links, self.folder, f"reference[{k}].gait")
        yield from self._faults_of_trackers()
        yield from self._faults_of_plants()
        if self.predictive is not None:
            yield from self.predictive.faults_in(end, self.units)
        if self.estimation is not None:
            yield from self.estimation.faults_in(self.worm)
            if self.predictive is None:
                yield "estimation", "needs predictive control; add [predictive]"
        if self.measurement is not None:
            yield from self.measurement.faults_in(end, self.tracker)
            if self.predictive is not None and not self.measurement.exact:
                yield (
                    "measurement",
                    "does not apply to [predictive], which measures states; leave out one of them",
                )
        if self.tube.capture >= end:
            yield "tube.capture", f"is not before time.end = {end:g}; write less"

    def _faults_of_trackers(self) -> Iterator[Fault]:
        for k, tracker in enumerate(self.tracker):
            yield from tracker.faults(f"tracker[{k}]", self.worm.links)
            yield from faults_of_lag(f"tracker[{k}]", tracker, self.time.end)
            free = isinstance(tracker, FunnelTracker) and tracker.tube_radius is None
            if not free and tracker.tube_radius != self.tube.radius:
                yield (
                    f"tracker[{k}].tube_radius",
                    f"differs from tube.radius = {self.tube.radius:g}, which judges all "
                    "controllers; write the same",
                )

    def _faults_of_plants(self) -> Iterator[Fault]:
        yield from faults_of_nominal(self.worm, "draws")
        if not isinstance(self.worm.friction, CoulombFriction):
            yield (
                "worm.friction",
                'is not supported; write one table with kind = "coulomb" for all masses',
            )
        if self.draws.known and self.optimal is None and self.crawl is None:
            yield "draws.known", "needs plans; write 0, or add [optimal] or [crawl]"

    # -- references and plants ---------------------------------------------------------------------

    @stage
    def gaits(self) -> Sequence[Gait]:
        """Gait of each reference, some of which are designed."""
        return [
            each.gait.gait(self.worm.links)
            if isinstance(each.gait, DesignedShape)
            else gait_of_shape(each.gait, self.scene, f"reference[{k}].gait")
            for k, each in enumerate(self.reference)
        ]

    def plant(self, gait: Gait) -> Model:
        """Nominal plant, scaled by a reference gait."""
        return chain_for(self.worm, self.start, draw_links(self.worm, self.time.end), gait)

    def plants(self, gait: Gait) -> list[Draw]:
        """Parameters of the drawn plants, which do not depend on the gait."""
        drawn = self.draws
        return drawn_plants(self.plant(gait), drawn.spread, drawn.seed, drawn.members)

    @property
    def sensors(self) -> Measurement | None:
        """Noise and delay of measurements; None where these are exact."""
        return None if self.measurement is None or self.measurement.exact else self.measurement

    @cached_property
    def trial(self) -> Trial:
        """Plants and conditions for all controllers."""
        draws = self.plants(self.gaits[0])
        return Trial(self.tube, self.time, self.tolerance, self.sensors, draws)

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
        plant = self.plant(gait)
        reference = gait_reference(gait, plant.t)
        return decide(plant, reference, self.time.end, self.predictive, learned, draws)

    def _in_processes(
        self, work: Callable[[Any], T], names: Sequence[str], draws: Sequence[Sequence[Draw]]
    ) -> Sequence[Mapping[str, T]]:
        """Do the work of each name for each reference and its `draws`, the longest first.

        The crawl has no reference, so it is the same for all.
        """
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
        try:
            return [[*self._trackers(gait), self._lqr(LQR, gait, None)] for gait in self.gaits]
        except ArgumentError as error:
            raise SceneError(self.name, [("tracker", str(error))]) from None

    def _trackers(self, gait: Gait) -> Iterator[Controller]:
        for name, tracker in zip(labels(self.tracker), self.tracker, strict=True):
            plant = self.plant(gait)
            loop = close_loop(plant, gait_reference(gait, plant.t), tracker, self.worm)
            yield Controller(name, self._measured(plant, loop))

    def _lqr(self, name: str, gait: Gait, plan: Plan | None) -> Controller:
        """LQR on the reference, or around a plan, whose inputs are fed forward."""
        plant = self.plant(gait)
        reference = gait_reference(gait, plant.t)
        if plan is None:
            loop = self._measured(plant, self.lqr.close(plant, reference))
        else:
            lengths = gait_reference(plan.lengths, plant.t, periodic=plan.periodic, name="plan")
            loop = self.lqr.close(plant, lengths, plan.inputs)
            loop = self._measured(plant, with_reference(loop, reference))
        return Controller(name, loop)

    def _measured(self, plant: Model, loop: Model) -> Model:
        """A closed loop whose controller has the scene's measurements."""
        return self.sensors.feeding(plant, loop, self.time.end) if self.sensors else loop

    def _planned(self, gait: Gait, plan: Plan) -> Model:
        return self.driven(gait, plan.inputs, periodic=plan.periodic)

    def driven(self, gait: Gait, inputs: Gait, *, periodic: bool = False) -> Model:
        """Plant with inputs over time, judged by the reference `gait`."""
        plant = self.plant(gait)
        compared = with_reference(plant, gait_reference(gait, plant.t))
        return drive(compared, inputs, periodic=periodic)

    def controllers(self, index: int) -> Iterator[Controller]:
        """All controllers for a reference: first feedback, then plans, without and with LQR.

        Plans that were not found are left out.
        """
        gait = self.gaits[index]
        yield from self.feedback_loops[index]
        found = {name: made.nominal for name, made in self.plans[index].items() if made.nominal}
        for name, plan in found.items():
            yield Controller(name, self._planned(gait, plan))
        for name, plan in found.items():
            yield self._lqr(f"{name} + LQR", gait, plan)
        for name, decided in self.decisions[index].items():
            if decided.nominal is not None:
                yield Controller(name, self.driven(gait, decided.nominal), decided.others)

    # -- motions -----------------------------------------------------------------------------------

    @stage
    def runs(self) -> Sequence[Sequence[Judged]]:
        """Every controller on all plants, by reference."""
        found = [
            [self._judged(each, again=not k) for each in self.controllers(k)]
            for k in range(len(self.gaits))
        ]
        if all(each.motion is None for row in found for each in row):
            raise SolveError(
                "no controller keeps the nominal plant near the tube; reduce measurement.noise or "
                "measurement.delay"
            )
        return found

    def _judged(self, controller: Controller, *, again: bool) -> Judged:
        self.report(f"simulating {controller.name}")
        return self.trial.judge(controller, again=again)

    @stage
    def known(self) -> Mapping[str, Drawn]:
        """First plants under the plans made with their true parameters, by name of the plan."""
        return {
            name: Drawn.of([*map(self._on_known, made.known, self.trial.draws)])
            for name, made in self.plans[0].items()
        }

    def _on_known(self, plan: Plan | None, draw: Draw) -> dict[str, Any] | None:
        """Quantities of a drawn plant under a plan made for it; None without plan or motion."""
        model = plan and self._planned(self.gaits[0], plan)
        return model and numbers_on(draw, model, self.tube, self.time.end)

    # -- results -----------------------------------------------------------------------------------

    @cached_property
    def rivals(self) -> Sequence[str]:
        """Names of all controllers; a plan that was not found may be missing for a reference."""
        longest_first = sorted(self.runs, key=len)[::-1]
        return [*dict.fromkeys(each.name for row in longest_first for each in row)]

    @cached_property
    def rows(self) -> Sequence[Sequence[Judged | None]]:
        """Runs by reference, with an entry for every name."""
        rows = [{each.name: each for each in row} for row in self.runs]
        return [[row.get(name) for name in self.rivals] for row in rows]

    @scalars(_COUNTS, headline=("tube_radius", "draws", "draws_failed", "draws_outside"))
    def totals(self) -> dict[str, Any]:
        """Numbers of plants and iterations; the crawl's iterations count once."""
        crawls_once = [
            made
            for k, row in enumerate(self.plans)
            for name, made in row.items()
            if not k or name != CRAWL
        ]
        return {
            "tube_radius": self.tube.radius,
            "draws": self.draws.members,
            "draws_failed": [[each and each.drawn.failed for each in row] for row in self.rows],
            "draws_outside": [[each and each.drawn.outside for each in row] for row in self.rows],
            "known_plants": self.draws.known,
            "known_failed": [each.failed for each in self.known.values()],
            "solve_iterations": sum(made.iterations for made in crawls_once),
        }

    @scalars(JUDGED, headline=("distance",))
    def numbers(self) -> dict[str, Any]:
        """Quantities of the nominal plant."""
        return {
            name: [[each and each.numbers[name] for each in row] for row in self.rows]
            for name in JUDGED
        }

    @scalar("share", "error of the second route for the first reference, without trackers")
    def recheck_error(self) -> float | None:
        """Largest error of the second routes."""
        found = [each.second.error for each in self.runs[0] if each.second]
        return max((error for error in found if error is not None), default=None)

    @arrays(_SIGNALS)
    def signals(self) -> dict[str, Any]:
        """Signals of the nominal plant; NaN where it is lost or a plan was not found."""
        sampled = [[each and each.signals(COMPARED) for each in row] for row in self.rows]
        one = next(signals for row in sampled for signals in row if signals)
        lost = {name: np.full_like(values, np.nan) for name, values in one.items()}
        rows = {
            name: np.array([[(each or lost)[name] for each in row] for row in sampled])
            for name in COMPARED
        }
        aims = [
            next((e.motion["reference"] for e in row if e.motion), lost["length"])
            for row in self.runs
        ]
        times = np.linspace(0.0, self.time.end, self.time.samples)
        return {"time": times, **fitted(rows, _SIGNALS), "aim": np.array(aims)}

    @cached_property
    def drawn_rows(self) -> Sequence[Sequence[Drawn]]:
        """Quantities of the drawn plants by reference and name; NaN without a plan."""
        none = Drawn.of([None] * self.draws.members)
        return [[each.drawn if each else none for each in row] for row in self.rows]

    @arrays(_DRAWN)
    def on_drawn(self) -> dict[str, Any]:
        """Quantities of the drawn plants."""
        return {
            f"drawn_{name}": np.array([[d.values[name] for d in row] for row in self.drawn_rows])
            for name in JUDGED
        }

    @arrays(_KNOWN, when="draws.known")
    def on_known(self) -> dict[str, Any]:
        """Quantities of plants with known parameters."""
        known = self.known.values()
        return {f"known_{name}": np.array([d.values[name] for d in known]) for name in JUDGED}

    @arrays(_INTERVALS)
    def intervals(self) -> dict[str, Any]:
        """Intervals of quantities over the plants, and numbers of plants with the lower value."""
        rows = self.drawn_rows
        found = {"outside_share": np.array([[d.outside_share for d in row] for row in rows])}
        for name in RANKED:
            found[f"median_{name}"] = np.array([[d.median(name) for d in row] for row in rows])
            ranks = [less(np.array([d.values[name] for d in row])) for row in rows]
            found[f"less_{name}"] = np.array(ranks)
        return found

    @attributes
    def names(self) -> dict[str, Any]:
        """Names, and the text of the table file."""
        return {
            "references": [each.name for each in self.reference],
            "rivals": self.rivals,
            "known": [*self.known],
            "table": "\n".join([*self._tables(), ""]),
        }

    def _tables(self) -> Iterator[str]:
        """Lines of Markdown with all figures."""
        end, capture, draws = self.time.end, self.tube.capture, self.draws
        yield (
            f"λ = {self.tube.radius:g}, time 0 to {end:g}. Time outside the tube and the "
            f"largest |e| count from t = {capture:g} on. Work spent is the positive power of each "
            "actuator over time, without recovery; net work includes the power that flows back. "
            "Cost of transport is work spent over total mass and distance. One simulator with "
            "exact contact computes all motions."
        )
        if self.sensors:
            yield ""
            yield (
                f"Measurements have a delay of {self.sensors.delay:g} and noise of "
                f"{self.sensors.noise:g} on samples every {self.sensors.interval:g}."
            )
        for each, row in zip(self.reference, self.runs, strict=True):
            plants = {one.name: one.drawn for one in row}
            nominal = {one.name: one.numbers for one in row}
            drawn = f"{draws.members} plants, ±{draws.spread:.0%}"
            yield from ("", f"## {each.name}: the nominal plant", "", *nominal_table(nominal))
            yield from ("", f"## {each.name}: {drawn}", "", *drawn_table(plants))
            intervals = interval_table(plants, RANKED)
            yield from ("", f"## {each.name}: intervals over the plants", "", *intervals)
        if draws.known:
            which = f"plans with the true parameters of {draws.known} of these plants"
            yield from ("", f"## {self.reference[0].name}: {which}", "")
            plants = {one.name: one.drawn for one in self.runs[0]}
            weight = self.optimal.input_weight if self.optimal else 0.0
            yield from known_table(plants, self.known, draws.known, weight)

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_motions(self) -> Iterator[Check]:
        """Second routes, energies and funnels of the nominal plant."""
        for reference, row in zip(self.reference, self.runs, strict=True):
            for each in row:
                yield from each.checks(self.tolerance.options, f"{reference.name}, {each.name}")

    @facts
    def computed_by(self) -> dict[str, Any]:
        """How motions, plans and decisions were computed, and how well the motions agree."""
        first = self.runs[0]
        residuals = [abs(each.energy.residual) for row in self.runs for each in row if each.energy]
        return {
            "treatment": "complementarity in the optimiser, exact in every simulation",
            "recheck": {
                "route": next((each.second.route for each in first if each.second), None),
                "error": {each.name: each.second and each.second.error for each in first},
                "accepted": accepted_error(self.tolerance.options),
            },
            "energy_balance": max(residuals, default=None),
            "plans": [{n: made.numbers for n, made in row.items()} for row in self.plans],
            "decisions": [{n: each.numbers for n, each in row.items()} for row in self.decisions],
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        """Warnings of missing plans, failed decisions and simulations, and missing rechecks."""
        names = [each.name for each in self.reference]
        for reference, row in zip(names, self.decisions, strict=True):
            for name, decided in row.items():
                if decided.nominal is None:
                    yield f"{reference}: no plan for {name}: {decided.numbers['reason']}"
                if decided.unsolved:
                    what = f"{decided.unsolved} decisions failed; the previous plan continued"
                    yield f"{reference}, {name}: {what}"
        for reference, row in zip(names, self.plans, strict=True):
            for name, made in row.items():
                if made.nominal is None:
                    yield f"{reference}: no plan for {name}: {made.numbers['reason']}"
        for reference, row in zip(names, self.runs, strict=True):
            for each in row:
                yield from each.warnings(f"{reference}, {each.name}")
        for name, each in self.known.items():
            if each.failed:
                yield f"{name}: no plan was found for {each.failed} of the known plants"
        yield from self._not_rechecked()

    def _not_rechecked(self) -> Iterator[str]:
        """Warn of motions of the first reference without a second route."""
        moved = [each for each in self.runs[0] if each.motion]
        alone = [each.name for each in moved if not each.second]
        if not self.tolerance.recheck:
            yield NOT_RECHECKED
        elif len(alone) == len(moved):
            yield Unchecked(
                "no second route rechecks a motion here: those of trackers and of delayed "
                'measurements take too long; scenes of kind "track" recheck trackers'
            )
        elif alone:
            yield f"no second route rechecks {', '.join(alone)}"
