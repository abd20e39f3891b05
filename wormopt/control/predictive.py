"""Predictive control: an optimal motion over a horizon, recomputed at every decision.

Every decision takes steps of sequential quadratic programming on the arcs of one transcription,
starting from the motion of the last decision: one step is the real-time iteration [1]_, many reach
convergence. The cost beyond the horizon is the second-order expansion about a plan of the whole
motion. Therefore decisions repeat the plan, however short the horizon, if the plan is optimal and
the worm follows the model.

.. [1] M. Diehl, H. G. Bock, J. P. Schloeder, "A real-time iteration scheme for nonlinear
   optimization in optimal feedback control", SIAM J. Control Optim. 43 (2005) 1714-1736.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from wormopt.control.estimation import Estimation, Estimator
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal
from wormopt.model.values import signal_values
from wormopt.ocp.contact import Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion, sample
from wormopt.ocp.nlp import Bounds
from wormopt.ocp.problem import Problem
from wormopt.ocp.stages import Given, Linearised, StageProgram, Stages, Tail
from wormopt.ocp.transcription import Transcription
from wormopt.progress import Report, silent
from wormopt.simulation.options import Exact, Tolerance, Treatment
from wormopt.simulation.simulate import simulate


@dataclass(frozen=True, eq=False)
class CostToGo:
    """Least cost from each node on as a function of the change dx, g dx + dx P dx / 2 + const."""

    gradient: np.ndarray  # (N + 1, n_x) g, 0 at the end
    hessian: np.ndarray  # (N + 1, n_x, n_x) P, 0 at the end
    feedback: np.ndarray  # (N, n_u, n_x) the best du = -feedback dx - ahead
    ahead: np.ndarray  # (N, n_u)


def cost_to_go(
    dynamics: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, n_x: int
) -> CostToGo:
    """Compute it for stages dx_{k+1} = dynamics_k (dx_k, du_k).

    The cost of a stage is g v + v H v / 2 for v = (dx, du); shapes (N, n_x, n_v), (N, n_v) and
    (N, n_v, n_v). H is positive definite in du.
    """
    n, n_v = gradient.shape
    g, P = np.zeros((n + 1, n_x)), np.zeros((n + 1, n_x, n_x))
    feedback, ahead = np.zeros((n, n_v - n_x, n_x)), np.zeros((n, n_v - n_x))
    for k in range(n - 1, -1, -1):
        F = dynamics[k]
        M, m = hessian[k] + F.T @ P[k + 1] @ F, gradient[k] + F.T @ g[k + 1]
        found = np.linalg.solve(M[n_x:, n_x:], np.column_stack([M[n_x:, :n_x], m[n_x:]]))
        feedback[k], ahead[k] = found[:, :n_x], found[:, n_x]
        P[k] = M[:n_x, :n_x] - M[:n_x, n_x:] @ feedback[k]
        P[k] = (P[k] + P[k].T) / 2
        g[k] = m[:n_x] - M[:n_x, n_x:] @ ahead[k]
    return CostToGo(g, P, feedback, ahead)


# A plan has converged when no scaled variable changes by more, in at most so many steps a level;
# tolerance before the last level.
_PLANNED, _NEAR, _MOST_STEPS = 1e-7, 1e-3, 300
_LEAST_SHARE = 0.05  # of a step
# Inputs within this distance of a limit, in nominal sizes, are at it.
_AT_LIMIT = 1e-5


@dataclass(frozen=True)
class MpcOptions:
    """Options of predictive control.

    Parameters
    ----------
    horizon : int
        Number of arcs in the horizon; the cost beyond it is approximated to second order.
    steps : int
        Largest number of SQP steps of a decision; 1 is the real-time iteration.
    tolerance : float
        Largest change of a variable, in nominal sizes, that ends a decision.

    Raises
    ------
    ArgumentError
        If a number is not positive.

    Examples
    --------
    >>> MpcOptions(horizon=10).steps
    1
    """

    horizon: int = 25
    steps: int = 1
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if self.horizon < 1 or self.steps < 1 or not self.tolerance > 0:
            raise ArgumentError("horizon and steps must be at least 1, and tolerance above 0")


@dataclass(frozen=True, eq=False)
class Course:
    """A motion arc by arc, as in the nonlinear program, scaled."""

    rows: np.ndarray  # (N, n_y) variables of the arcs
    end: np.ndarray  # (n_x,) state at the end of the last


@dataclass(frozen=True, eq=False)
class MpcPlan:
    """The optimal motion over the whole time, and the cost of deviations."""

    stages: Stages
    given: Given
    bounds: Bounds
    course: Course
    objective: float
    steps: int  # of sequential quadratic programming
    violation: float  # largest residual of any equation, scaled

    @cached_property
    def beyond(self) -> CostToGo:
        """Cost from every node to the end, to second order; inputs at a limit stay there."""
        stages, rows = self.stages, self.course.rows
        arcs = stages.linearise(rows, self.given)
        low, high = stages.input_limits
        inputs = rows[:, stages.inputs]
        held = np.zeros((len(rows), stages.n_v), dtype=bool)
        held[:, stages.n_x :] = (inputs - low < _AT_LIMIT) | (high - inputs < _AT_LIMIT)
        either = held[:, :, None] | held[:, None, :]
        return cost_to_go(
            np.where(held[:, None, :], 0.0, arcs.dynamics),
            np.where(held, 0.0, arcs.gradient),
            np.where(either, np.eye(stages.n_v), arcs.hessian),
            stages.n_x,
        )

    @property
    def times(self) -> np.ndarray:
        """Times of the nodes, (N + 1,)."""
        durations = self.course.rows[:, 0] * self.stages.arc.time_nominal
        return np.concatenate([[0.0], np.cumsum(durations)])

    @property
    def inputs(self) -> np.ndarray:
        """Inputs on every arc, (N, n_u), in the model's units."""
        return self.course.rows[:, self.stages.inputs] * self.stages.arc.u_nominal

    @cached_property
    def motion(self) -> Motion:
        """The motion as the result of an optimisation."""
        program = self.stages.program
        arcs = program.unpack(self.course.rows.ravel())
        return Motion.of(program, program.pack(arcs, self.bounds), self.bounds)


def plan_mpc(
    problem: Problem,
    mesh: Mesh,
    contact: Regularised,
    guess: Guess,
    *,
    p: Mapping[str, ArrayLike] | None = None,
) -> MpcPlan:
    """Find the optimal motion over the whole time, for all widths of the smoothed law in turn.

    Parameters
    ----------
    problem : Problem
        Problem of given duration, whose objective is a weighted sum of integrals, with limits
        of inputs only.
    mesh : Mesh
        With shares (``Mesh.even``), inputs constant on each arc: an arc is a decision.
    contact : Regularised
        Widths of the smooth law, from the first to the last.
    guess : Guess
        A motion to start from.
    p : mapping of str to array_like, optional
        Parameters where they are not the model's own.

    Returns
    -------
    MpcPlan
        The motion, its `inputs` at `times`, its `objective`, and the cost of deviations from it.

    Raises
    ------
    ArgumentError
        If the problem or the mesh has another form.
    SolveError
        If the iteration does not converge.

    Examples
    --------
    A block on the ground is pushed to 1 and back in 2 s:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> states = [wo.Signal("x", x, value=0), wo.Signal("v", v, value=0)]
    >>> sole = wo.Contact("sole", v, f, wo.Coulomb(0.5, 2.0))
    >>> block = wo.Model("block", states, ca.vertcat(v, u + f),
    ...     u=[wo.Signal("u", u, value=0)], contacts=[sole])
    >>> ends = wo.Ends.of(block, 1)
    >>> error = x - ca.sin(ca.pi / 2 * block.t)
    >>> problem = wo.Problem(block, ends, ends.integrals[0], (2.0, 2.0),
    ...     integrands=error**2 + 1e-3 * u**2,
    ...     boundary_constraints=[wo.Constraint("start", ends.start, [0, 0], [0, 0])])
    >>> mesh = wo.Mesh.even(1, 40, wo.Collocation(2, "radau"))
    >>> guess = wo.Guess(2.0, lambda t: np.zeros((2, len(t))))
    >>> plan = plan_mpc(problem, mesh, wo.Regularised(0.1, 0.2), guess)
    >>> receded = wo.run_mpc(block, plan, MpcOptions(horizon=10), contact=wo.Smooth(0.1))
    >>> receded.unsolved
    0
    >>> float(round(receded.states[0, 20], 1))
    1.0
    """
    program = Transcription(problem, mesh, contact)
    stages, levels = Stages(program), contact.levels
    bounds = program.bounds(levels[0], p=p)
    rows = stages.rows(sample(program, guess, bounds))
    course, count = Course(rows, rows[-1, stages.arc.layout.points][-stages.n_x :]), 0
    quadratic = stages.quadratic(len(rows))
    tail, first = Tail.none(stages.n_x), rows[0, stages.start].copy()
    step, given = Step(np.inf, np.inf, np.inf, solved=True), stages.given(bounds)
    for level in levels:
        bounds = program.bounds(level, p=p)
        given = stages.given(bounds)
        small, share = _PLANNED if level == levels[-1] else _NEAR, 1.0
        for _ in range(_MOST_STEPS):
            before = step.size
            course, step = improved(stages, quadratic, course, given, first, tail, share)
            count += 1
            if not step.solved or step.size <= small:
                break
            share = _damped(share, step.size, before)
        if not step.size <= small:
            last = f"was {step.size:.2g} in nominal sizes" if step.solved else "is not solved"
            raise SolveError(
                f"no plan is found at v_reg = {level:.3g}: the last of {count} steps {last}",
                "use a larger v_reg, or shorter arcs",
                code="not_solved",
            )
    return MpcPlan(stages, given, bounds, course, step.cost, count, step.violation)


def _damped(share: float, size: float, before: float) -> float:
    """Share of the next step: reduced if steps do not shrink but oscillate across a steep law."""
    return max(share / 2, _LEAST_SHARE) if size > before else min(1.3 * share, 1.0)


@dataclass(frozen=True)
class Step:
    """One step of sequential quadratic programming."""

    size: float  # largest change of a scaled variable
    cost: float  # of the motion before the step
    violation: float  # of its equations, scaled
    solved: bool  # whether the quadratic program was


def improved(
    stages: Stages,
    quadratic: StageProgram,
    course: Course,
    given: Given,
    first: np.ndarray,
    tail: Tail,
    share: float = 1.0,
) -> tuple[Course, Step]:
    """Take a step, or a share of it, for a motion that starts at `first` (n_x,).

    None if it is not solved. `tail` is the cost of the end as a function of its change.
    """
    rows = course.rows
    arcs = stages.linearise(rows, given)
    gaps = arcs.end - np.concatenate([rows[1:, stages.start], course.end[None]])
    inputs = rows[:, stages.inputs]
    low, high = stages.input_limits
    v, end, solved = quadratic.solve(
        first - rows[0, stages.start], arcs, gaps, tail, (low - inputs, high - inputs)
    )
    cost, violation = float(arcs.cost.sum()), max(arcs.defect, float(np.abs(gaps).max()))
    if not solved:
        return course, Step(np.inf, cost, violation, solved=False)
    moved = rows.copy()
    moved[:, stages.v] += share * v
    inner = _inside(arcs, v)
    moved[:, stages.inner] += share * inner
    size = float(max(np.abs(v).max(), np.abs(inner).max()))
    return Course(moved, course.end + share * end), Step(size, cost, violation, solved=True)


def _tail(beyond: CostToGo, node: int, off: np.ndarray) -> Tail:
    """Cost beyond a node as a function of the change of its state, `off` (n_x,) from the plan."""
    P = beyond.hessian[node]
    return Tail(beyond.gradient[node] + P @ off, P)


def _inside(arcs: Linearised, v: np.ndarray) -> np.ndarray:
    return arcs.inner + (arcs.inner_by @ v[:, :, None])[:, :, 0]


@dataclass(frozen=True, eq=False)
class Decision:
    """Decision at one node."""

    input: np.ndarray  # (n_u,) until the next node, in the model's units
    steps: int
    size: float  # of the last step
    clock: np.ndarray  # (2,) wall-clock time it took, and time of the processor, in s


def clock() -> np.ndarray:
    """Wall-clock time and processor time of this thread, in s."""
    return np.array([time.perf_counter(), time.thread_time()])


class PredictiveController:
    """Determines the input at the nodes of a plan, one after the other, until the next node."""

    def __init__(self, plan: MpcPlan, decisions: MpcOptions) -> None:
        self.plan, self.decisions = plan, decisions
        self.course, self.given = plan.course, plan.given
        stages, n = plan.stages, len(plan.course.rows)
        for size in range(1, min(decisions.horizon, n) + 1):  # made before they are timed
            stages.quadratic(size)
            stages.linearise(plan.course.rows[:size], plan.given.part(slice(size)))

    def believe(self, p: np.ndarray) -> None:
        """Use other parameters (n_p,) of the model from now on."""
        self.given = replace(self.given, p=p)

    def decide(self, k: int, state: np.ndarray) -> Decision:
        """Decide at node k in `state` (n_x,); ArgumentError if that is no state."""
        if np.shape(state) != (self.plan.stages.n_x,) or not np.all(np.isfinite(state)):
            raise ArgumentError(f"state must be {self.plan.stages.n_x} finite numbers, not {state}")
        begin = clock()
        stages, plan = self.plan.stages, self.plan
        n = len(plan.course.rows)
        last = min(k + self.decisions.horizon, n)
        program, given = stages.quadratic(last - k), self.given.part(slice(k, last))
        seen = Course(self.course.rows[k:last], self._state(self.course, last))
        planned, x = self._state(plan.course, last), state / stages.arc.x_nominal
        count, share, step = 0, 1.0, Step(np.inf, 0.0, np.inf, solved=True)
        while count < self.decisions.steps and step.solved and step.size > self.decisions.tolerance:
            tail, before = _tail(plan.beyond, last, seen.end - planned), step.size
            seen, step = improved(stages, program, seen, given, x, tail, share)
            share, count = _damped(share, step.size, before), count + 1
        self._keep(seen, k, last)
        input_ = seen.rows[0, stages.inputs] * stages.arc.u_nominal
        return Decision(input_, count, step.size, clock() - begin)

    def _state(self, course: Course, node: int) -> np.ndarray:
        at_end = node == len(course.rows)
        return course.end if at_end else course.rows[node, self.plan.stages.start]

    def _keep(self, seen: Course, k: int, last: int) -> None:
        rows, end = self.course.rows.copy(), self.course.end
        rows[k:last] = seen.rows
        if last == len(rows):
            end = seen.end
        else:
            rows[last, self.plan.stages.start] = seen.end
        self.course = Course(rows, end)


def parameters(plan: MpcPlan, p: Mapping[str, ArrayLike] | None) -> np.ndarray:
    """Parameters (n_p,) of a plan's model, with those given by name."""
    return signal_values(plan.stages.program.problem.parameters, p, "parameter")


@dataclass(frozen=True, eq=False)
class MpcRun:
    """Result of a predictive controller."""

    times: np.ndarray  # (N + 1,) of decisions, and the end
    states: np.ndarray  # (n_x, N + 1) of the worm at these times
    decisions: tuple[Decision, ...]
    clocks: np.ndarray  # (2, N) as in `Decision`, estimation included
    parameters: np.ndarray  # (n_p, N) as estimated at each decision
    saturated: np.ndarray  # (N,) share of the inputs at a bound for each decision

    @property
    def seconds(self) -> np.ndarray:
        """Wall-clock time of each decision, (N,)."""
        return self.clocks[0]

    @property
    def processor(self) -> np.ndarray:
        """Processor time of each decision, (N,)."""
        return self.clocks[1]

    @property
    def inputs(self) -> Gait:
        """Inputs over time."""
        values = np.array([each.input for each in self.decisions])
        return Gait(self.times, values[:, :, None])

    @property
    def unsolved(self) -> int:
        """Decisions whose quadratic program was not solved, so that the last motion continued."""
        return sum(not np.isfinite(each.size) for each in self.decisions)


def run_mpc(
    worm: Model,
    plan: MpcPlan,
    decisions: MpcOptions,
    *,
    estimation: Estimation | None = None,
    p: Mapping[str, ArrayLike] | None = None,
    contact: Treatment = Exact(),  # noqa: B008  frozen
    tolerance: Tolerance = Tolerance(),  # noqa: B008  frozen
    report: Report = silent,
) -> MpcRun:
    """Simulate a worm under predictive control; its parameters may differ from those of the plan.

    States are measured exactly at every node of the plan. The input changes immediately and is
    clipped to the bounds of the worm's inputs.

    Parameters
    ----------
    worm : Model
        Worm whose inputs, in order, are those of the plan's model.
    plan : MpcPlan
        Plan from :func:`plan_mpc`.
    decisions : MpcOptions
        Options of the decisions.
    estimation : Estimation, optional
        Parameter estimation during the motion; none if left out.
    p : mapping of str to array_like, optional
        Parameters of the worm that differ from those of its model.
    contact : Treatment
        Treatment of the worm's contact in the simulation, exact or smooth.
    tolerance : Tolerance
        Tolerance of the simulation.
    report : callable
        Gets the progress.

    Returns
    -------
    MpcRun
        States at `times`, `inputs` that were decided, the time that each decision took, how many
        were `unsolved`.

    Raises
    ------
    SolveError
        If the worm cannot be simulated.

    Examples
    --------
    A block on the ground is pushed to 1 and back in 2 s:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> states = [wo.Signal("x", x, value=0), wo.Signal("v", v, value=0)]
    >>> sole = wo.Contact("sole", v, f, wo.Coulomb(0.5, 2.0))
    >>> block = wo.Model("block", states, ca.vertcat(v, u + f),
    ...     u=[wo.Signal("u", u, value=0)], contacts=[sole])
    >>> ends = wo.Ends.of(block, 1)
    >>> error = x - ca.sin(ca.pi / 2 * block.t)
    >>> problem = wo.Problem(block, ends, ends.integrals[0], (2.0, 2.0),
    ...     integrands=error**2 + 1e-3 * u**2,
    ...     boundary_constraints=[wo.Constraint("start", ends.start, [0, 0], [0, 0])])
    >>> mesh = wo.Mesh.even(1, 40, wo.Collocation(2, "radau"))
    >>> guess = wo.Guess(2.0, lambda t: np.zeros((2, len(t))))
    >>> plan = wo.plan_mpc(problem, mesh, wo.Regularised(0.1, 0.2), guess)
    >>> run = run_mpc(block, plan, wo.MpcOptions(horizon=10), contact=wo.Smooth(0.1))
    >>> run.unsolved, float(run.states[0, 20].round(1))
    (0, 1.0)
    """
    control = PredictiveController(plan, decisions)
    stages = plan.stages
    estimator = Estimator(stages, plan.given, estimation) if estimation else None
    times, x = plan.times, signal_values(worm.x, None, "state")
    states, made, clocks, believed, at_bound = [x], [], [], [], []
    low, high = _bounds(worm)
    for k in range(len(times) - 1):
        spent = np.zeros(2)
        if estimator and k:
            begin = clock()
            control.believe(estimator.see(control.course.rows[k - 1], states[-2], x))
            spent = clock() - begin
        decision = control.decide(k, x)
        cut = np.clip(decision.input, low, high)
        at_bound.append(np.mean((cut <= low) | (cut >= high)))
        decision = replace(decision, input=cut)
        made.append(decision)
        clocks.append(spent + decision.clock)
        believed.append(control.given.p)
        x = _move(worm, (times[k], times[k + 1]), x, decision.input, p, contact, tolerance)
        states.append(x)
        report("deciding", (k + 1) / (len(times) - 1))
    columns, spent, known = (np.array(part).T for part in (states, clocks, believed))
    return MpcRun(times, columns, tuple(made), spent, known, np.array(at_bound))


def _bounds(worm: Model) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest value of each scalar input."""
    sizes = [u.size for u in worm.u]
    low, high = ([getattr(u, name) for u in worm.u] for name in ("lower", "upper"))
    return np.repeat(low, sizes), np.repeat(high, sizes)


def _move(
    worm: Model,
    span: tuple[float, float],
    x: np.ndarray,
    input_: np.ndarray,
    p: Mapping[str, ArrayLike] | None,
    contact: Treatment,
    tolerance: Tolerance,
) -> np.ndarray:
    """State at the end of a span in which the input is held."""
    held = {**(p or {}), **_by_name(worm.u, input_)}
    motion = simulate(
        worm, span, contact=contact, x0=_by_name(worm.x, x), p=held, times=[], tolerance=tolerance
    )
    return motion.end


def _by_name(signals: Sequence[Signal], values: np.ndarray) -> dict[str, np.ndarray]:
    parts = np.split(values, np.cumsum([s.size for s in signals])[:-1])
    return {s.name: part for s, part in zip(signals, parts, strict=True)}
