"""Predictive control of a chain: its tables, plans, and decisions for nominal and drawn plants."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from wormopt.errors import Fault, SolveError
from wormopt.study import Given, entry, number, on_use, positive, whole
from wormopt.study.types import Seed, Title
from wormopt.systems.chain.tables import ChainTable, LeastError, Tube

with on_use():
    import numpy as np
    from numpy.typing import ArrayLike

    from wormopt.control.estimation import Estimation
    from wormopt.control.loop import Reference
    from wormopt.control.predictive import MpcOptions, MpcPlan, MpcRun, plan_mpc, run_mpc
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.contact import Regularised
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Guess
    from wormopt.simulation.options import Tolerance
    from wormopt.systems.chain.copies import Draw, drawn_plants
    from wormopt.systems.chain.measured import is_chain
    from wormopt.systems.chain.optimal_tracking import followed_by_lqr, tracking_problem

Estimated = Literal["mass", "stiffness", "damping", "friction_forward", "friction_backward"]
ESTIMATED: tuple[Estimated, ...] = ("mass", "friction_forward", "friction_backward")

_MOST_DECISIONS = 20_000
# Ratio of the first to the last width of the smooth law: the guess is close to the optimum.
_WIDER = 2.0
# Collocation points on each arc.
_DEGREE = 2


class DrawnPlants(Given):
    """Plants with drawn parameters.

    Each parameter is drawn independently from a uniform distribution around its nominal value.
    """

    members: int = whole(1, 1000, "number of drawn plants")
    spread: float = number("share", "parameters are drawn within ± this share", least=0, below=1)
    parameters: tuple[Title, ...] | None = entry(
        "parameters that are drawn; default: every mass, stiffness, damping and friction force of "
        "a chain, every parameter of the Model of a plant of your own",
        default=None,
    )
    seed: Seed = entry("seed of the drawn plants", default=0)

    def of(self, plant: Model) -> list[Draw]:
        """Draw the parameters of plants around those of this one."""
        names = self.parameters
        if names is None and not is_chain(plant):
            names = tuple(s.name for s in plant.p if s.value is not None)
        spread = self.spread if names is None else dict.fromkeys(names, self.spread)
        return drawn_plants(plant, spread, self.seed, self.members)


def refused_of_nominal(drawn: str) -> dict[str, str]:
    """Keys that a nominal chain must not have; `drawn`: key of the table of drawn plants."""
    weight = "is not allowed, since drawn masses would change the weights; write worm.load"
    return {
        "worm.random": f"is not allowed, since [{drawn}] varies the plants; leave the table out",
        "worm.slope": weight,
        "worm.gravity": weight,
        **{
            f"worm.friction.{law}": f'kind = "{law}" is not supported; write kind = "coulomb"'
            for law in ("stribeck", "viscous", "spike")
        },
    }


class PredictiveControl(Given):
    """Predictive control of ∫(|*e*|² + *ρ*|*u*|²) d*t*, with a new decision every `period`.

    The controller's model has the smooth law of friction. Its terminal cost is, to second order,
    the cost of a deviation from the plan for the whole motion.
    """

    period: float = positive(
        "time", "longest time between decisions; it is shorter before a corner of the reference"
    )
    horizon: float = positive("time", "prediction horizon")
    input_weight: float = positive("", "*ρ*")
    v_reg: float = positive(
        "speed", "width of velocities over which the model's friction law is steep"
    )
    steps: int = whole(
        1,
        1000,
        "upper limit of the solver steps per decision of the converged controller; the "
        "real-time controller makes one step",
        default=20,
    )
    force: float | None = positive(
        "force", "upper limit of |*u*<sub>j</sub>|; default: no limit", default=None
    )
    seconds: float = positive(
        "s",
        "seconds per unit of the scene's time, to which the duration of decisions is "
        "compared; 1 with SI units",
        default=1.0,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.horizon < self.period:
            yield "horizon", f"is below predictive.period = {self.period:g}; write more"

    def faults_in(self, end: float, units: str) -> Iterator[Fault]:
        """Yield what is invalid for a motion from 0 to `end` in a scene with these units."""
        if self.period > end:
            yield "predictive.period", f"is above time.end = {end:g}; write less"
        if end / self.period > _MOST_DECISIONS:
            least = end / _MOST_DECISIONS
            yield (
                "predictive.period",
                f"makes over {_MOST_DECISIONS} decisions; write at least {least:.3g}",
            )
        if units == "SI" and self.seconds != 1.0:
            yield "predictive.seconds", "is 1 with SI units; leave it out"

    def arcs(self, time: float) -> int:
        """Number of decisions in a time, at least 1."""
        return max(1, round(time / self.period))

    @property
    def real_time(self) -> MpcOptions:
        """Decisions of one solver step."""
        return MpcOptions(self.arcs(self.horizon))

    @property
    def converged(self) -> MpcOptions:
        """Decisions that iterate until they converge."""
        return MpcOptions(self.arcs(self.horizon), self.steps)


class ParameterEstimation(Given):
    """Moving-horizon estimation of the parameters that explain the recent motion best.

    States are measured at every decision. The parameters of each link and each mass are estimated
    separately. The estimate minimises the squared residuals of the measurements in the window plus
    the squared logarithmic deviations of the parameters from their prior. Measurements that leave
    the window update the prior.
    """

    parameters: tuple[Estimated, ...] = entry(
        "parameters to estimate; the others keep the model's values", default=ESTIMATED
    )
    window: float = positive("time", "length of the window")
    noise: float = positive(
        "share", "standard deviation of a measured state, in usual sizes", default=0.01
    )
    spread: float = positive("share", "standard deviation of a parameter's prior", default=0.2)
    memory: float | None = positive(
        "time",
        "time after which the information of past measurements decays to 1/e; default: no decay",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if not self.parameters:
            yield "parameters", "names no parameter; leave [estimation] out"
        if len(set(self.parameters)) < len(self.parameters):
            yield "parameters", "names a parameter twice; write each once"

    def faults_in(self, worm: ChainTable) -> Iterator[Fault]:
        """Yield parameters that this chain does not have: the estimate is of logarithms."""
        for name in self.parameters:
            if not all(value > 0 for value in _values(worm, name)):
                yield (
                    "estimation.parameters",
                    f"contains {name}, which is not above 0 in this worm; leave it out",
                )

    def settings(self, control: PredictiveControl) -> Estimation:
        """Settings of the estimator, which counts decisions instead of time."""
        return Estimation(
            self.parameters,
            control.arcs(self.window),
            self.noise,
            self.spread,
            np.inf if self.memory is None else self.memory / control.period,
        )


def _values(worm: ChainTable, name: str) -> Iterator[float]:
    """Values of a parameter, or a single 0 if the worm does not have it."""
    side = name.removeprefix("friction_")
    given = [getattr(worm, name)] if side == name else [getattr(g, side, 0.0) for g in worm.ground]
    for each in given or [0.0]:
        yield from each if isinstance(each, tuple) else (each,)


# -- plans -----------------------------------------------------------------------------------------


def plan_tracking(
    plant: Model,
    reference: Reference,
    end: float,
    control: PredictiveControl,
    *,
    p: Mapping[str, ArrayLike] | None = None,
) -> MpcPlan:
    """Plan the motion from 0 to `end` on arcs of one decision each; `p` are other parameters."""
    weight = control.input_weight
    bounded, free = limited(plant, control.force) if control.force else plant, limited(plant)
    objective = LeastError(input_weight=weight)
    problem = tracking_problem(bounded, reference, end, objective, Tube(radius=1.0))
    breaks = problem.model.breaks(end)
    mesh = Mesh.over(breaks, control.period, Collocation(_DEGREE, "radau"))
    guess = Guess.of(followed_by_lqr(free, reference, end, 1 / weight))
    contact = Regularised(control.v_reg, _WIDER * control.v_reg, ratio=1 / _WIDER)
    return plan_mpc(problem, mesh, contact, guess, p=p)


def limited(plant: Model, force: float = math.inf) -> Model:
    """The plant with a limit on the size of its inputs, or without one."""
    return replace(plant, u=[replace(u, lower=-force, upper=force) for u in plant.u])


def inputs_of(plan: MpcPlan) -> Gait:
    """Inputs of a plan as a function of time."""
    return Gait(plan.times, plan.inputs[:, :, None])


def loose_tolerance() -> Tolerance:
    """Tolerance of simulations of drawn plants, which differ by far more."""
    return Tolerance(relative=1e-8, absolute=1e-9)


def period_in_seconds(control: PredictiveControl, plan: MpcPlan) -> float:
    """Shortest time between the decisions of a plan."""
    return control.seconds * float(np.diff(plan.times).min())


# -- decisions in a comparison ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Decided:
    """Inputs that predictive control decided, over time; None where a simulation failed."""

    nominal: Gait | None  # None: there is no plan
    others: tuple[Gait | None, ...]  # of the drawn plants
    unsolved: int = 0  # decisions, of all plants, whose quadratic program was not solved
    # time that decisions take, in s, the time between them, or why there is no plan
    numbers: dict[str, float | str] = field(default_factory=dict)


def decide(
    plant: Model,
    reference: Reference,
    end: float,
    control: PredictiveControl,
    estimation: ParameterEstimation | None,
    draws: Sequence[Draw],
) -> Decided:
    """Plan, then decide in real time for the nominal plant and each drawn plant.

    It raises no exception.
    """
    learns = None if estimation is None else estimation.settings(control)

    def decided(draw: Draw | None) -> MpcRun:
        options, tolerance = control.real_time, loose_tolerance()
        return run_mpc(plant, plan, options, estimation=learns, p=draw, tolerance=tolerance)

    def on_other(draw: Draw) -> MpcRun | None:
        try:
            return decided(draw)
        except SolveError:
            return None

    try:
        plan = plan_tracking(plant, reference, end, control)
        nominal = decided(None)
    except SolveError as error:
        return Decided(None, (None,) * len(draws), numbers={"reason": str(error)})
    others = [on_other(draw) for draw in draws]
    median, most, worst = np.quantile(nominal.seconds, (0.5, 0.95, 1.0)).tolist()
    return Decided(
        nominal.inputs,
        tuple(each and each.inputs for each in others),
        sum(each.unsolved for each in (nominal, *others) if each),
        {
            "decision_median_s": median,
            "decision_95_s": most,
            "decision_worst_s": worst,
            "decision_processor_s": float(np.median(nominal.processor)),
            "decision_period_s": period_in_seconds(control, plan),
        },
    )
