"""Kind "track-predictive": a chain whose links follow a gait by model predictive control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import ArgumentError, Fault, SceneError, SolveError
from wormopt.result import NOT_RECHECKED, Check
from wormopt.study import (
    array,
    arrays,
    attributes,
    check,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.study.numerics import ToleranceTable
from wormopt.systems.chain.predictive import (
    DrawnPlants,
    ParameterEstimation,
    PredictiveControl,
    refused_of_nominal,
)
from wormopt.systems.chain.tables import ChainTable, Tube
from wormopt.systems.chain.tracking import Tracking
from wormopt.systems.shared.declared import (
    GAIT,
    JUDGED,
    LOOP_SIGNALS,
    TIME,
    Variables,
    gait_arrays,
    over,
)

with on_use():
    import numpy as np

    from wormopt.control.drive import drive
    from wormopt.control.estimation import places
    from wormopt.control.loop import with_reference
    from wormopt.control.lqr import lqr
    from wormopt.control.predictive import MpcOptions, MpcPlan, MpcRun, run_mpc
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.model.values import nominal_of
    from wormopt.numerics.workers import each
    from wormopt.progress import silent
    from wormopt.simulation.options import Exact, Smooth, Treatment
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.chain.controllers import numbers_on
    from wormopt.systems.chain.copies import Draw, numbers_of
    from wormopt.systems.chain.drawn import Drawn, markdown_table, text_of
    from wormopt.systems.chain.measured import balance, chain_checks, judged, judged_numbers
    from wormopt.systems.chain.predictive import (
        inputs_of,
        limited,
        loose_tolerance,
        period_in_seconds,
        plan_tracking,
    )
    from wormopt.systems.shared.proof import CrossCheck, accepted_error, cross_check
    from wormopt.systems.shared.signals import fitted, sample, simulate_whole

OPEN, LQR = "open-loop optimum", "LQR, feed-forward"
REAL_TIME, CONVERGED = "predictive, real time", "predictive, converged"
LEARNING = f"{REAL_TIME}, with estimation"
KNOWN = (f"{OPEN}, plant known", f"{REAL_TIME}, plant known")
"""Names of the controllers, for tables and pictures."""
SHOWN = ("error_norm", "length", "input", "position")
"""Signals that are kept of every controller; the last one of chains only."""

# Accepted relative excess of the cost of predictive control over the open loop with a true model.
_AS_GOOD = 1e-6
_SIGNALS: Variables = {
    **TIME,
    "reference": ("length", ("link", "time"), "reference of the link length"),
    **over({name: LOOP_SIGNALS[name] for name in SHOWN}, "controller"),
    **GAIT,
}
_DRAWN: Variables = {
    "drawn_cost": ("length_squared_time", ("controller", "member"), "cost on the plant"),
    "drawn_error_peak": (
        "length",
        ("controller", "member"),
        "largest |e| after capture on the plant",
    ),
    "drawn_distance": ("length", ("controller", "member"), "distance of the plant"),
}
_COLUMNS = {
    "cost": "∫\\|e\\|² + ρ\\|u\\|²",
    "error_integral": "∫\\|e\\|²",
    "error_peak": "largest \\|e\\|",
    "input_rms": "u rms",
    "distance": "distance",
}


@dataclass(frozen=True, eq=False)
class Controlled:
    """Motion of the nominal plant under one controller."""

    motion: Trajectory
    second: CrossCheck | None
    numbers: dict[str, Any]
    run: MpcRun | None  # None for controllers that make no decisions


@dataclass(frozen=True, eq=False)
class OnPlants:
    """One controller, which does not know the drawn plants, on each of them."""

    drawn: Drawn
    runs: list[MpcRun]  # without those that failed


@dataclass(frozen=True)
class Decisions:
    """Numbers and durations of decisions; lists have an entry for each controller."""

    decisions: int = value("count", "decisions in each motion")
    decisions_unsolved: list[int | None] = value(
        "count", "decisions whose quadratic program failed; the previous plan continues"
    )
    decision_period: float = value(
        "s",
        "shortest time between decisions, converted by `predictive.seconds`",
        headline=True,
    )
    decision_median: list[float | None] = value(
        "s",
        "median duration of a decision on this machine, with estimation, for the nominal plant",
        headline=True,
    )
    decision_most: list[float | None] = value("s", "95 % quantile of these durations")
    decision_worst: list[float | None] = value("s", "largest of these durations")
    decision_processor: list[float | None] = value(
        "s", "median processor time of a decision: its cost on a machine without other load"
    )
    decision_steps: list[float | None] = value("count", "mean number of solver steps per decision")
    decision_time: np.ndarray = signal("time", "decision", "time of the decision")
    decision_seconds: np.ndarray = signal(
        "s", "controller decision", "wall-clock duration of the decision"
    )


class TrackPredictive(Tracking, kind="track-predictive"):
    """Track a gait by model predictive control, with measured computing times.

    Predictive control is compared with the open-loop optimum and LQR. The optimal motion over the
    whole time is planned with the smooth friction law, with one arc per decision, and applied in
    open loop. The predictive controller makes a new plan at every decision from the measured state.
    In real time it makes one step of sequential quadratic programming from the previous plan; the
    converged controller iterates until the steps end. The chain is simulated exactly between
    decisions. All decisions are then simulated again as one motion, from which all results come.
    Decisions take no time in the simulation; their duration on this machine is measured and
    compared with their period.

    Each controller is applied to the nominal plant and, except for the converged one, to the plants
    of `[plants]`, which it does not know. `[estimation]` adds a real-time controller that estimates
    their parameters during the motion. The controller "plant known" plans with the true parameters.

    `[model]` is a plant of your own in place of the chain; it needs linear equations between its
    input and output, but for contacts, for the LQR. If the plant has the same smooth law as the
    controller's model, the controller must match the open loop to 1e-6 of its cost: check `as good
    as the open loop`.

    Attributes: `controllers`, `parameters` (estimated, by name and number), and `table`, the text
    of `table.md`. Scalars that are lists have an entry for each controller.
    """

    pictures: ClassVar = {
        "predictive": "error over time, costs on all plants, duration of decisions",
        "estimates": "estimated parameters over the plants' true values",
    }
    table_file: ClassVar = True
    refuses: ClassVar = refused_of_nominal("plants")

    tube: Tube = entry("tube that all controllers are judged by")
    predictive: PredictiveControl = entry("predictive controller")
    estimation: ParameterEstimation | None = entry(
        "estimation of parameters during the motion; default: none", default=None
    )
    plants: DrawnPlants | None = entry("plants with drawn parameters; default: none", default=None)
    tolerance: ToleranceTable = entry("tolerance of the simulations", default=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.predictive.faults_in(self.time.end, self.units)
        if self.estimation is not None and self.model is not None:
            yield "estimation", "estimates parameters of chains; leave the table out"
        yield from self.tube.faults_in(self.time.end)

    def faults_of_worm(self, worm: ChainTable) -> Iterator[Fault]:
        if self.estimation is not None:
            yield from self.estimation.faults_in(worm)

    # -- plants and controllers --------------------------------------------------------------------

    @cached_property
    def plant(self) -> Model:
        """Nominal plant with the limits of its inputs."""
        plant, force = self.plant_for(self.gait), self.predictive.force
        return plant if force is None else limited(plant, force)

    @cached_property
    def draws(self) -> Sequence[Draw]:
        """Parameters of the drawn plants."""
        try:
            return self.plants.of(self.plant) if self.plants else []
        except ArgumentError as error:
            raise SceneError(self.name, [("plants.parameters", str(error))]) from None

    @cached_property
    def options(self) -> Mapping[str, MpcOptions | None]:
        """Options of the controllers by name; None for those that make no decisions."""
        control = self.predictive
        learning = {LEARNING: control.real_time} if self.estimation else {}
        decide = {REAL_TIME: control.real_time, **learning, CONVERGED: control.converged}
        return {OPEN: None, LQR: None, **decide}

    def driven(self, inputs: Gait | None) -> Model:
        """Plant with inputs over time, or with LQR."""
        if inputs is None:
            weight = 1 / self.predictive.input_weight
            return lqr(self.plant, self.followed, error_weight=weight)
        return drive(with_reference(self.plant, self.followed), inputs)

    def cost_of(self, numbers: Mapping[str, Any]) -> Any:
        """Integral of |e|^2 + rho |u|^2 of one or several motions."""
        weight = self.predictive.input_weight
        return numbers["error_integral"] + weight * numbers["input_integral"]

    def decide(
        self,
        name: str,
        *,
        draw: Draw | None = None,
        contact: Treatment | None = None,
        plan: MpcPlan | None = None,
    ) -> MpcRun:
        """Let a controller decide, for the nominal plant or a drawn one; contact is exact if None.

        Raises SolveError if the simulation between decisions fails.
        """
        options, learned = self.options[name], self.estimation
        assert options is not None
        return run_mpc(
            self.plant,
            plan or self.plan,
            options,
            estimation=learned.settings(self.predictive) if learned and name == LEARNING else None,
            p=draw,
            contact=contact or Exact(),
            tolerance=self.tolerance.options if draw is None else loose_tolerance(),
        )

    def replay(self, model: Model, contact: Treatment) -> Trajectory:
        """Simulate a controlled nominal plant as one motion."""
        end, samples, model = self.time.end, self.time.samples, judged(model, self.tube)
        return simulate_whole(model, end, samples, contact, self.tolerance.options, silent)

    # -- motions -----------------------------------------------------------------------------------

    @stage
    def plan(self) -> MpcPlan:
        """Optimal motion over the whole time, with the smooth friction law."""
        return plan_tracking(self.plant, self.followed, self.time.end, self.predictive)

    @stage
    def true_model(self) -> Sequence[float]:
        """Costs on a plant with the model's friction law: open loop, in real time, converged."""
        smooth = Smooth(self.predictive.v_reg)

        def cost(inputs: Gait) -> float:
            motion = self.replay(self.driven(inputs), smooth)
            return self.cost_of(judged_numbers(motion, self.tube))

        decided = (self.decide(name, contact=smooth) for name in (REAL_TIME, CONVERGED))
        return [cost(inputs_of(self.plan)), *(cost(run.inputs) for run in decided)]

    @stage
    def motions(self) -> Mapping[str, Controlled]:
        """Motion of the nominal plant under each controller, by name."""
        return {name: self._controlled(name) for name in self.options}

    def _controlled(self, name: str) -> Controlled:
        self.report(f"simulating {name}")
        run = self.decide(name) if self.options[name] else None
        inputs = run.inputs if run else inputs_of(self.plan) if name == OPEN else None
        model, again = self.driven(inputs), self.tolerance.recheck and inputs is not None
        motion = self.replay(model, Exact())
        second = cross_check(model, motion, self.tolerance.options, recheck=again, report=silent)
        return Controlled(motion, second, judged_numbers(motion, self.tube), run)

    @stage
    def on_plants(self) -> Mapping[str, OnPlants]:
        """Drawn plants under the controllers, which do not know them, by name.

        The converged controller is left out: it takes ten times as long, and does not learn either.
        """
        names = [name for name in self.options if name != CONVERGED]
        # those of one controller together, since each process makes the plan for itself; the
        # longest first
        todo = names[::-1]
        done = dict(each(self.on_all, todo, self.report, "controllers on other plants"))
        return {name: done[todo.index(name)] for name in names}

    def on_all(self, name: str) -> OnPlants:
        """All drawn plants under a controller."""
        numbers: list[dict[str, Any] | None] = []
        runs: list[MpcRun] = []
        for draw in self.draws:
            inputs = inputs_of(self.plan) if name == OPEN else None
            if self.options[name]:
                try:
                    runs.append(self.decide(name, draw=draw))
                except SolveError:
                    numbers.append(None)
                    continue
                inputs = runs[-1].inputs
            numbers.append(self._simulated(inputs, draw))
        return OnPlants(Drawn.of(numbers), runs)

    def _simulated(self, inputs: Gait | None, draw: Draw) -> dict[str, Any] | None:
        """Quantities of a drawn plant with inputs over time, or with LQR."""
        return numbers_on(draw, self.driven(inputs), self.tube, self.time.end)

    @stage
    def known(self) -> Mapping[str, Drawn]:
        """Drawn plants under the open-loop optimum and real-time control for their parameters."""
        done = dict(each(self.on_known, self.draws, self.report, "plans for other plants"))
        rows = [done[k] for k in range(len(self.draws))]
        return {name: Drawn.of([row[k] for row in rows]) for k, name in enumerate(KNOWN)}

    def on_known(self, draw: Draw) -> list[dict[str, Any] | None]:
        """A drawn plant under the two controllers that know it; None where there is no plan."""
        end = self.time.end
        try:
            plan = plan_tracking(self.plant, self.followed, end, self.predictive, p=draw)
            run = self.decide(REAL_TIME, draw=draw, plan=plan)
        except SolveError:
            return [None, None]
        return [self._simulated(inputs, draw) for inputs in (inputs_of(plan), run.inputs)]

    # -- results -----------------------------------------------------------------------------------

    @scalars(
        JUDGED
        | {"cost": ("length_squared_time", "∫(|*e*|² + *ρ*|*u*|²) d*t* of the exact simulation")},
        headline=("cost", "distance"),
    )
    def numbers(self) -> dict[str, Any]:
        rows = [each.numbers for each in self.motions.values()]
        cost = {"cost": [self.cost_of(row) for row in rows]}
        return {name: [row[name] for row in rows] for name in JUDGED} | cost

    @scalar("length", "*λ*")
    def tube_radius(self) -> float:
        return self.tube.radius

    @scalar("length_squared_time", "∫(|*e*|² + *ρ*|*u*|²) d*t* of the plan")
    def objective_found(self) -> float:
        return self.plan.objective

    @scalar("count", "steps of sequential quadratic programming for the plan")
    def plan_steps(self) -> int:
        return self.plan.steps

    @scalar(
        "length_squared_time",
        "cost on a plant with the smooth friction law of the model: open loop, in real time, "
        "converged",
    )
    def right_cost(self) -> Sequence[float]:
        return self.true_model

    @scalar(
        "share",
        "relative excess of the larger of the last two costs over the first",
        headline=True,
    )
    def excess(self) -> float:
        open_loop, *decided = self.true_model
        return max(decided) / open_loop - 1

    @parts(Decisions)
    def timing(self) -> Decisions:
        return decisions_of(
            self.plan, self.predictive, [each.run for each in self.motions.values()]
        )

    @scalar("share", "error of the second route, largest over the controllers without gains")
    def recheck_error(self) -> float | None:
        found = [each.second.error for each in self.motions.values() if each.second]
        return max((error for error in found if error is not None), default=None)

    @arrays(_SIGNALS)
    def signals(self) -> dict[str, Any]:
        motions = [each.motion for each in self.motions.values()]
        models = [motion.system.model for motion in motions]
        names = SHOWN if self.own is None else SHOWN[:-1]
        sampled = [
            sample(motion, {name: model[name] for name in names})
            for motion, model in zip(motions, models, strict=True)
        ]
        rows = {name: np.array([each[name] for each in sampled]) for name in names}
        own: dict[str, Any] = self.own_arrays(motions, "controller")
        own |= {"time": motions[0].time, "reference": motions[0]["reference"]}
        return own | fitted(rows, _SIGNALS) | gait_arrays(self.gait)

    @arrays(_DRAWN, when="plants")
    def drawn(self) -> dict[str, Any]:
        """Quantities of the drawn plants; NaN for the converged controller."""
        rows = [found.drawn.values for found in self.on_plants.values()]
        rows.append(Drawn.of([None] * len(self.draws)).values)
        names = ("error_peak", "distance")
        return {
            "drawn_cost": np.array([self.cost_of(row) for row in rows]),
            **{f"drawn_{name}": np.array([row[name] for row in rows]) for name in names},
        }

    @cached_property
    def parameter_names(self) -> Sequence[str]:
        """Names of estimated parameters, with numbers."""
        sizes = {signal.name: signal.size for signal in self.plant.p}
        names = self.estimation.parameters if self.estimation else ()
        return [f"{n} {k}" if sizes[n] > 1 else n for n in names for k in range(sizes[n])]

    @array(
        "share",
        "parameter member decision",
        "estimated parameter over the plant's true value",
    )
    def estimated(self) -> np.ndarray | None:
        """Estimated parameters; None without estimation, or where a plant was lost."""
        if not self.estimation or not self.draws:
            return None
        names, runs = self.estimation.parameters, self.on_plants[LEARNING].runs
        if len(runs) < len(self.draws):
            return None
        own, chosen = numbers_of(self.plant), places(self.plan.stages, names)
        true = [np.concatenate([draw.get(n, own[n]) for n in names]) for draw in self.draws]
        found = [
            run.parameters[chosen] / values[:, None] for run, values in zip(runs, true, strict=True)
        ]
        return np.array(found).transpose(1, 0, 2)

    @scalar(
        "share",
        "error of the estimated parameters of the plants, root mean square of the logarithms: "
        "a list for each of `estimation.parameters`, before estimation and at the end",
    )
    def parameter_error(self) -> list[list[float]] | None:
        if self.estimated is None or not self.estimation:
            return None
        off = np.log(self.estimated[:, :, [0, -1]]) ** 2
        kinds = np.array([name.split(" ")[0] for name in self.parameter_names])
        return [
            np.sqrt(off[kinds == kind].mean(axis=(0, 1))).tolist()
            for kind in self.estimation.parameters
        ]

    @attributes
    def names(self) -> dict[str, Any]:
        return {
            "controllers": [*self.motions],
            "parameters": self.parameter_names,
            "table": "\n".join([*self._tables(), ""]),
        }

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_motions(self) -> Iterator[Check]:
        for name, each in self.motions.items():
            yield from chain_checks(each.second, balance(each.motion), self.tolerance.options, name)
            if each.run is not None:
                yield self._replayed(name, each.motion, each.run)

    def _replayed(self, name: str, motion: Trajectory, run: MpcRun) -> Check:
        whole = motion.states[: self.plant.n_x, -1]
        size = np.maximum(nominal_of(self.plant.x), np.abs(whole))
        error = float(np.max(np.abs(run.states[:, -1] - whole) / size))
        accepted = accepted_error(self.tolerance.options)
        advice = (
            f"{name}: the decisions simulated as one motion end elsewhere, by {error:.2g} "
            f"of the states' size, where {accepted:.2g} is accepted; write a smaller "
            "tolerance.relative"
        )
        return Check(f"{name}: decisions replayed", error, accepted, advice)

    @check(
        _AS_GOOD,
        "with a true model, predictive control costs more than the open loop, by a share "
        "of {excess:.2g}: arcs of {predictive.period:g} do not resolve the smooth law of "
        "v_reg = {predictive.v_reg:g} (a simulation differs from the plan's own cost by "
        "{plan_error:.1g}); write a smaller predictive.period, or a larger predictive.v_reg",
        name="as good as the open loop where the model is right",
    )
    def as_good(self) -> float:
        return max(self.excess, 0.0)

    @property
    def plan_error(self) -> float:
        """Relative difference between the costs of the plan and of its simulation."""
        return abs(self.plan.objective / self.true_model[0] - 1)

    @facts
    def computed_by(self) -> dict[str, Any]:
        return {
            "treatment": "smooth law in the optimiser, exact in every simulation",
            "recheck": {
                "error": {n: each.second and each.second.error for n, each in self.motions.items()},
                "accepted": accepted_error(self.tolerance.options),
            },
            "plan": {"violation": self.plan.violation, "steps": self.plan.steps},
        }

    @warnings
    def doubts(self) -> Iterator[str]:
        for name, each in self.motions.items():
            if each.run is None:
                continue
            yield from self._slow(name, each.run)
            others = self.on_plants.get(name)
            elsewhere = sum(run.unsolved for run in others.runs) if others else 0
            for count, where in ((each.run.unsolved, ""), (elsewhere, " for other plants")):
                if count:
                    yield f"{name}: {count} decisions{where} failed; the previous plan continued"
            if others and others.drawn.failed:
                yield f"{name}: the simulation of {others.drawn.failed} plants failed"
        if not self.tolerance.recheck:
            yield NOT_RECHECKED

    def _slow(self, name: str, run: MpcRun) -> Iterator[str]:
        period = period_in_seconds(self.predictive, self.plan)
        seconds, processor = float(np.median(run.seconds)), float(np.median(run.processor))
        if seconds > period:
            busy = f"; its processor time is {processor:.3g} s, so the machine is busy"
            yield (
                f"{name}: the median decision takes {seconds:.3g} s on this machine, longer than "
                f"the {period:.3g} s between decisions" + busy * (processor < period)
            )

    # -- table file --------------------------------------------------------------------------------

    def _tables(self) -> Iterator[str]:
        """Lines of Markdown: the nominal plant, durations of decisions, the drawn plants."""
        yield from ("## The nominal plant", "", *self._nominal_table())
        yield ""
        yield (
            f"Decisions: {self.timing.decisions}, one in "
            f"{1000.0 * self.timing.decision_period:.3g} ms or more. One simulator with exact "
            "contact computes all motions. Processor time is the cost of decisions on a machine "
            "without other load; the other durations are wall-clock times."
        )
        yield from ("", "## A plant with the smooth law of the model", "")
        costs = dict(zip((OPEN, REAL_TIME, CONVERGED), self.true_model, strict=True))
        yield from markdown_table(
            ["", "cost", "excess over the open loop"],
            [[name, f"{c:.8g}", f"{c / costs[OPEN] - 1:.2g}"] for name, c in costs.items()],
        )
        if self.plants is not None:
            title = f"## {self.plants.members} plants, ±{self.plants.spread:.0%}"
            yield from ("", title, "", *self._plants_table())
        if self.estimation is not None and self.parameter_error is not None:
            errors = zip(self.estimation.parameters, self.parameter_error, strict=True)
            yield ""
            yield from markdown_table(
                ["estimated", "error before estimation", "error at the end"],
                [[n.replace("_", " "), f"{first:.1%}", f"{end:.1%}"] for n, (first, end) in errors],
            )
            mean = "root mean squares of logarithms over plants, and over masses or links"
            yield from ("", f"Errors are {mean}.")

    def _nominal_table(self) -> Iterator[str]:
        timing = self.timing
        times = {
            "processor, median": timing.decision_processor,
            "median": timing.decision_median,
            "95 %": timing.decision_most,
            "worst": timing.decision_worst,
        }
        head = ["", *_COLUMNS.values(), *(f"decision, {words}" for words in times), "steps"]

        def row(k: int, name: str) -> Iterator[str]:
            yield name
            yield from (_digits(self.numbers[key][k]) for key in _COLUMNS)
            yield from (_milliseconds(durations[k]) for durations in times.values())
            steps = timing.decision_steps[k]
            yield "–" if steps is None else f"{steps:.2g}"

        yield from markdown_table(head, [[*row(k, name)] for k, name in enumerate(self.motions)])

    def _plants_table(self) -> Iterator[str]:
        rows = {name: found.drawn for name, found in self.on_plants.items()}
        rows |= self.known

        def row(name: str, values: Mapping[str, np.ndarray]) -> Iterator[str]:
            cost, peak, distance = self.cost_of(values), values["error_peak"], values["distance"]
            shown = (cost.mean(), cost.min(), cost.max(), peak.max(), distance.mean())
            yield from (name, *map(_digits, shown))

        yield from markdown_table(
            ["", "cost, mean", "least", "most", "largest \\|e\\|", "distance, mean"],
            [[*row(name, drawn.values)] for name, drawn in rows.items()],
        )


def decisions_of(
    plan: MpcPlan, control: PredictiveControl, runs: Sequence[MpcRun | None]
) -> Decisions:
    """Count and time the decisions of each controller; None, or NaN, for those without any."""
    none = np.full(len(plan.times) - 1, np.nan)

    def quantile(share: float) -> list[float | None]:
        return [run and float(np.quantile(run.seconds, share)) for run in runs]

    return Decisions(
        decisions=len(none),
        decisions_unsolved=[run and run.unsolved for run in runs],
        decision_period=period_in_seconds(control, plan),
        decision_median=quantile(0.5),
        decision_most=quantile(0.95),
        decision_worst=quantile(1.0),
        decision_processor=[run and float(np.median(run.processor)) for run in runs],
        decision_steps=[
            run and float(np.mean([each.steps for each in run.decisions])) for run in runs
        ],
        decision_time=plan.times[:-1],
        decision_seconds=np.array([run.seconds if run else none for run in runs]),
    )


def _digits(value: float | None) -> str:
    return text_of(value) if value is None or not np.isfinite(value) else f"{value:.4g}"


def _milliseconds(value: float | None) -> str:
    if value is None:
        return "–"
    digits = 1 if value < 0.01 else 0
    return f"{1e3 * value:.{digits}f} ms"
