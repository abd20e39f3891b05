"""Simulation of a worm under predictive control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from wormopt.control.estimation import Estimation, Estimator
from wormopt.control.predictive import (
    Decision,
    MpcOptions,
    MpcPlan,
    PredictiveController,
    clock,
)
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.options import Exact, Tolerance, Treatment
from wormopt.simulation.simulate import simulate


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
    """Let a worm of parameters `p`, which the plan need not know, move by decisions.

    States are measured as they are, at every node of the plan; the input changes at once, and is
    cut to the bounds that the worm's inputs have.

    Parameters
    ----------
    worm : Model
        Whose inputs, in order, are those of the plan's model.
    plan : MpcPlan
        Of :func:`plan_mpc`.
    decisions : MpcOptions
        How decisions are made.
    estimation : Estimation, optional
        What is learnt on the way; nothing if left out.
    p : mapping of str to array_like, optional
        Parameters of the worm where they are not its own.
    contact : Treatment
        How the worm's contact is simulated, exactly or smoothly.
    tolerance : Tolerance
        Of the simulation.
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
