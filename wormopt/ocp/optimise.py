"""The verb `optimise`: from Problem, mesh and contact treatment to a checked Optimum."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.modes import ModeSequence
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised
from wormopt.ocp.diagnostics import FEASIBLE, failure
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion, sample
from wormopt.ocp.nlp import Bounds, Ipopt, Solution, Solver
from wormopt.ocp.problem import Problem
from wormopt.ocp.transcription import Prices, Transcription
from wormopt.progress import Report, silent
from wormopt.shown import html, lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def defects(motion: Motion) -> np.ndarray:
    """Local error (N,) of every arc: the integral of |x' - f(x, u, ...)| over it, scaled."""
    # Largest over the states. With prescribed modes a sliding force follows its law; others are
    # interpolated. J. T. Betts, Practical Methods for Optimal Control, 4.7 (SIAM 2010).
    arc, mesh = motion.program.arc, motion.mesh
    nodes, weights = np.polynomial.legendre.leggauss(12)
    s, weights = (nodes + 1) / 2, weights / 2
    values = motion.arcs.states
    slopes = np.einsum("sk,rkn->rsn", _slopes(mesh.collocation.nodes, s), values)
    t = motion.breaks[:-1] + np.multiply.outer(s, motion.arcs.duration)
    # just inside the arcs, so that each point belongs to its own
    rates = motion.observe(arc.lawful_ode, t.ravel(order="F"))
    rates = rates.reshape(len(values), len(s), mesh.total, order="F")
    wrong = np.abs(slopes - rates * motion.arcs.duration)
    return np.max(np.einsum("s,rsn->rn", weights, wrong) / arc.x_nominal[:, None], axis=0)


def _slopes(nodes: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Matrix from values at nodes to slopes of the interpolating polynomial at targets."""
    degree = len(nodes) - 1
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, degree)
    primed = np.polynomial.legendre.legder(np.eye(degree + 1)) * 2
    slopes = np.polynomial.legendre.legval(2 * targets - 1, primed)
    return np.linalg.solve(basis.T, slopes).T


def finer(mesh: Mesh, defect: np.ndarray, tolerance: float, most: int = 5) -> Mesh:
    """Split the arcs that err by more than the tolerance into at most `most` parts each.

    `defect` (N,) is from `defects`; the same mesh is returned if no arc errs.
    """
    if mesh.shares is None:
        raise ArgumentError("arcs of free duration cannot be split; use Mesh.even")
    # an arc's own error decreases with one power more than the sum over all arcs
    order = mesh.collocation.degree + 1
    parts = np.clip(np.ceil((defect / tolerance) ** (1 / order)), 1, most).astype(int)
    shares = np.repeat(np.array(mesh.shares) / parts, parts)
    counts = np.bincount(mesh.phase, weights=parts).astype(int)
    return replace(mesh, arcs=tuple(counts.tolist()), shares=tuple(shares.tolist()))


Contacts = Regularised | Complementarity | FixedModes

# Programs of at most this many variables are finished by linear programs: a vertex, as in most
# minimum-time problems, is then found to the last digits. Larger ones cost more than they gain.
_FINISHED = 200

# Box, in nominal sizes, for the first-order test of an optimum.
_NEAR = 1e-3

# A solve from the solution of a neighbouring level starts with a small barrier.
_WARM_BARRIER = 1e-3
# Number of restarts of a solve, and the largest violation for them.
_RESTARTS, _NEARLY = 3, 1e-3


@dataclass(frozen=True, eq=False)
class Optimum:
    """Result of `optimise`, with measures of its quality.

    Parameters
    ----------
    motion : Motion
        The motion.
    solution : Solution
        Solution of the last nonlinear program.
    levels : tuple of Solution
        All solves, in order; variables and multipliers of the last only.
    treatment : Regularised, Complementarity or FixedModes
        Treatment of contacts.
    build_s : float
        Seconds to build the program and its derivatives.
    bounds : Bounds
        Bounds and parameters of the last solve.

    Examples
    --------
    A block that resists with 1 forward and 2 backward, pushed with at most 3, slides a unit way
    from rest to rest in sqrt(3/2) at least:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> block = wo.Model(
    ...     "block",
    ...     x=[wo.Signal("position", x), wo.Signal("velocity", v)],
    ...     ode=ca.vertcat(v, u + f),
    ...     u=[wo.Signal("drive", u, lower=-3.0, upper=3.0)],
    ...     contacts=[wo.Contact("sole", v, f, wo.Coulomb(1.0, 2.0))],
    ... )
    >>> ends = wo.Ends.of(block)
    >>> start = wo.Constraint("start", ends.start, 0, 0)
    >>> rest = wo.Constraint("end", ends.end, [1, 0], [1, 0])
    >>> time = ends.duration
    >>> problem = wo.Problem(block, ends, time, (0.1, 10.0), boundary_constraints=[start, rest])
    >>> guess = wo.Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.7]))
    >>> mesh = wo.Mesh.even(2, 1, wo.Collocation(2))
    >>> slides = wo.FixedModes(wo.ModeSequence(((1,), (1,))))
    >>> found = wo.optimise(problem, mesh, slides, guess)
    >>> round(found.objective**2, 9), found.solution.success
    (1.5, True)
    """

    motion: Motion
    solution: Solution
    levels: tuple[Solution, ...]
    treatment: Contacts
    build_s: float
    bounds: Bounds

    def __repr__(self) -> str:
        return lines(f"Optimum: {self._summary}", repr(self.motion).partition("\n")[0])

    @property
    def _summary(self) -> str:
        how = type(self.treatment).__name__
        ended = f"{self.solution.status}, {self.iterations} iterations"
        return f"objective {self.objective:.9g} ({ended}; contacts: {how})"

    def _repr_html_(self) -> str:
        return html(f"Optimum: {self._summary}", [self.motion.overview()])

    def plot(self, *names: str) -> Figure:
        """Draw signals of the motion over time, see `SampledMotion.plot`."""
        return self.motion.plot(*names)

    @property
    def objective(self) -> float:
        """Minimised value."""
        return self.solution.objective

    @property
    def solve_s(self) -> float:
        """Seconds in the solver, over all levels."""
        return sum(level.seconds for level in self.levels)

    @property
    def iterations(self) -> int:
        """Iterations over all levels."""
        return sum(level.iterations for level in self.levels)

    @property
    def functions_s(self) -> dict[str, float]:
        """Seconds in the program's functions by their names, over all levels."""
        return _sum_by_name(*(level.functions_s for level in self.levels))

    @cached_property
    def gain(self) -> float:
        """First-order bound on the remaining decrease of the objective nearby.

        Predicted by the program linearised at the solution in a box of a thousandth of the nominal
        sizes; 0 at a point that satisfies the Karush-Kuhn-Tucker conditions, NaN if the linear
        program is not solved.
        """
        radius = np.full(self.solution.w.shape, _NEAR)
        step = self.motion.program.nlp.linear_step(self.solution.w, self.bounds, radius)
        size = self.motion.program.problem.nominal
        return np.nan if step is None else size * max(0.0, -step[1])

    @cached_property
    def prices(self) -> Prices:
        """Derivatives of the objective by lower and upper bounds, by their names.

        Names are those of constraints and inputs, and ``duration``; bounds that do not hold back
        the objective have 0.
        """
        motion, solution = self.motion, self.solution
        size = motion.program.problem.nominal
        prices = motion.program.prices(solution.w, self.bounds, solution.multipliers)
        return {name: (size * low, size * high) for name, (low, high) in prices.items()}

    @cached_property
    def defects(self) -> np.ndarray:
        """Local error of each arc, see `defects`."""
        return defects(self.motion)

    @cached_property
    def complementarity(self) -> float:
        """Largest product |w (force - force of sliding)| at the collocation points, scaled.

        Zero for an exact set-valued law; for treatments other than complementarity it is computed
        from velocities and forces.
        """
        motion = self.motion
        model, tau = motion.program.problem.model, motion.mesh.collocation.tau
        tau = np.minimum(tau, 1 - 1e-10)  # an arc's end is the next arc's start
        t = (motion.breaks[:-1] + np.multiply.outer(tau, motion.arcs.duration)).ravel()
        worst = 0.0
        for c in model.contacts:
            for d in c.law.directions:
                slip = motion.observe(c.force - c.law.slip_force(c.velocity, d), t)
                part = np.maximum(d * motion.observe(c.velocity, t), 0.0)
                product = np.abs(slip * part) / (c.nominal_force * c.nominal_speed)
                worst = max(worst, float(np.max(product)))
        return worst


def optimise(
    problem: Problem,
    mesh: Mesh,
    treatment: Contacts,
    guess: Guess,
    *,
    p: Mapping[str, ArrayLike] | None = None,
    pins: Mapping[int, float] | None = None,
    solver: Solver | None = None,
    report: Report = silent,
    explain: bool = True,
) -> Optimum:
    """Find a local optimum, level after level of the contact treatment.

    Parameters
    ----------
    problem : Problem
        The problem.
    mesh : Mesh
        Phases, arcs and polynomials.
    treatment : Regularised, Complementarity or FixedModes
        Treatment of contacts, with its levels.
    guess : Guess
        From where to start: a `Motion.guess`, a simulation's curves, or any.
    p : mapping of str to array_like, optional
        Parameters by name that differ from those of the model.
    pins : mapping of int to float, optional
        Times at which phases begin, see `Transcription.bounds`.
    solver : Solver, optional
        Default: IPOPT.
    report : callable, optional
        Receives the progress.
    explain : bool, optional
        Whether limits in conflict are sought where a solve fails, which takes longer than the
        solve.

    Returns
    -------
    Optimum
        Its violation is at most `FEASIBLE`.

    Raises
    ------
    ArgumentError
        If the treatment of contact is not one of an optimisation.
    SolveError
        If a level is not solved; the message names the limits in conflict, or the remedy, and
        ``code`` is the reason: "infeasible", "unbounded", "bad_guess", "late" or "not_solved".
    KeyboardInterrupt
        If the user stops it.

    Examples
    --------
    The shortest time in which a block with F+ = 1, F- = 2 and |u| <= 3 slides a unit way from
    rest to rest is sqrt(3/2).

    >>> import casadi as ca
    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.model.model import Contact, Model, Signal
    >>> from wormopt.numerics.collocation import Collocation
    >>> from wormopt.ocp.problem import Constraint, Ends
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> block = Model(
    ...     "block",
    ...     x=[Signal("position", x), Signal("velocity", v)],
    ...     ode=ca.vertcat(v, u + f),
    ...     u=[Signal("drive", u, lower=-3.0, upper=3.0)],
    ...     contacts=[Contact("sole", v, f, Coulomb(1.0, 2.0))],
    ... )
    >>> ends = Ends.of(block)
    >>> start = Constraint("start", ends.start, 0, 0)
    >>> rest = Constraint("end", ends.end, [1, 0], [1, 0])
    >>> time = ends.duration
    >>> problem = Problem(block, ends, time, (0.1, 10.0), boundary_constraints=[start, rest])
    >>> slides = FixedModes(ModeSequence(((1,), (1,))))
    >>> guess = Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.7]))
    >>> found = optimise(problem, Mesh.even(2, 1, Collocation(2)), slides, guess)
    >>> round(found.objective**2, 9)
    1.5
    """
    if not isinstance(treatment, Contacts):
        raise ArgumentError(
            f"treatment must be Regularised, Complementarity or FixedModes, not {treatment}"
        )
    solver = solver or Ipopt()
    begin = time.perf_counter()
    program = Transcription(problem, mesh, treatment)
    build = time.perf_counter() - begin
    held = None if isinstance(treatment, Complementarity) else treatment.active
    targets = _targets(treatment)
    steps = [program.bounds(target, p=p, pins=pins, active=held) for target in targets]
    w = sample(program, guess, steps[0])
    solutions: list[Solution] = []
    for k, (target, bounds) in enumerate(zip(targets, steps, strict=True)):
        solution = _solve(program, w, bounds, solver, warm=k > 0)
        if not (solution.violation <= FEASIBLE and _ended_well(solution)):
            seconds = solver.seconds if isinstance(solver, Ipopt) else None
            raise failure(program, solution, bounds, w, target, seconds, explain=explain)
        w = solution.w
        level = 0.0 if isinstance(target, ModeSequence) else target
        objective = solution.objective * problem.nominal
        solution = replace(solution, objective=objective, level=level)
        solutions.append(solution)
        report(f"objective {solution.objective:.6g}", (k + 1) / len(targets))
    motion = Motion.of(program, w, steps[-1])
    build += sum(solution.build_s for solution in solutions)
    # of earlier levels only figures are kept
    bare = [replace(one, w=one.w[:0], multipliers=one.multipliers[:0]) for one in solutions[:-1]]
    return Optimum(motion, solutions[-1], (*bare, solutions[-1]), treatment, build, steps[-1])


def _targets(treatment: Contacts) -> Sequence[ModeSequence | float]:
    if not isinstance(treatment, FixedModes):
        return treatment.levels
    return (treatment.modes if treatment.modes is not None else ModeSequence(((),)),)


def _ended_well(solution: Solution) -> bool:
    """Whether a solver found an optimum; some stop when they make no more progress."""
    return solution.success or solution.status in ("Solved_To_Acceptable_Level",)


def _solve(
    program: Transcription, w: np.ndarray, bounds: Bounds, solver: Solver, *, warm: bool
) -> Solution:
    """Solve one level; if a large barrier fails, with guarded durations."""
    lost = None
    if warm and isinstance(solver, Ipopt):
        near = replace(solver, mu_init=min(solver.mu_init, _WARM_BARRIER))
        lost = program.nlp.solve(w, bounds, near)
        if lost.late or (lost.violation <= FEASIBLE and _ended_well(lost)):
            return lost
    solution = _after(lost, program.nlp.solve(w, bounds, solver))
    if not (warm or solution.late or solution.violation <= FEASIBLE):
        guarded = program.guarded(bounds)
        # with fixed durations guarding changes nothing: it would be the same solve
        if np.any(guarded.lbw != bounds.lbw) or np.any(guarded.ubw != bounds.ubw):
            solution = _after(solution, program.nlp.solve(w, guarded, solver))
    for _ in range(_RESTARTS):
        stalled = solution.violation <= _NEARLY and not _ended_well(solution)
        if solution.late or not stalled or not isinstance(solver, Ipopt):
            break
        solver = replace(solver, mu_init=0.1 * solver.mu_init)
        solution = _after(solution, program.nlp.solve(solution.w, bounds, solver))
    if program.arc.modal and len(w) <= _FINISHED and solution.violation <= _NEARLY:
        return program.nlp.finish(solution, bounds)
    return solution


def _after(lost: Solution | None, solution: Solution) -> Solution:
    """Add the cost of a failed solve."""
    if lost is None:
        return solution
    return replace(
        solution,
        iterations=solution.iterations + lost.iterations,
        seconds=solution.seconds + lost.seconds,
        build_s=solution.build_s + lost.build_s,
        functions_s=_sum_by_name(lost.functions_s, solution.functions_s),
    )


def _sum_by_name(*parts: Mapping[str, float]) -> dict[str, float]:
    total: dict[str, float] = {}
    for part in parts:
        for name, seconds in part.items():
            total[name] = total.get(name, 0.0) + seconds
    return total


def refine(
    optimum: Optimum,
    tolerance: float,
    *,
    rounds: int = 5,
    most_arcs: int = 2000,
    p: Mapping[str, ArrayLike] | None = None,
    pins: Mapping[int, float] | None = None,
    solver: Solver | None = None,
    report: Report = silent,
) -> Optimum:
    """Refine the mesh where its error exceeds the tolerance, and solve again.

    Parameters
    ----------
    optimum : Optimum
        Optimum on a mesh with shares.
    tolerance : float
        Local error allowed on each arc, in nominal sizes of states, see `defects`.
    rounds : int, optional
        Largest number of solves.
    most_arcs : int, optional
        Largest mesh.
    p, pins : mapping, optional
        As given to `optimise`.
    solver : Solver, optional
        As given to `optimise`.
    report : callable, optional
        Receives the progress.

    Returns
    -------
    Optimum
        The last one; its ``defects`` show whether it reached the tolerance.

    Raises
    ------
    SolveError
        If a problem on a finer mesh cannot be solved.

    Examples
    --------
    A block that resists with 1 forward and 2 backward, pushed with at most 3, slides a unit way
    from rest to rest in sqrt(3/2) at least:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> block = wo.Model(
    ...     "block",
    ...     x=[wo.Signal("position", x), wo.Signal("velocity", v)],
    ...     ode=ca.vertcat(v, u + f),
    ...     u=[wo.Signal("drive", u, lower=-3.0, upper=3.0)],
    ...     contacts=[wo.Contact("sole", v, f, wo.Coulomb(1.0, 2.0))],
    ... )
    >>> ends = wo.Ends.of(block)
    >>> start = wo.Constraint("start", ends.start, 0, 0)
    >>> rest = wo.Constraint("end", ends.end, [1, 0], [1, 0])
    >>> time = ends.duration
    >>> problem = wo.Problem(block, ends, time, (0.1, 10.0), boundary_constraints=[start, rest])
    >>> guess = wo.Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.7]))
    >>> mesh = wo.Mesh.even(1, 20, wo.Collocation(2, "radau"))
    >>> relaxed = wo.optimise(problem, mesh, wo.Complementarity(1e-3), guess)
    >>> finer = wo.refine(relaxed, 1e-7)
    >>> bool(finer.defects.max() < 1e-7), finer.motion.mesh.total > mesh.total
    (True, True)
    """
    p = optimum.motion.parameters if p is None else p
    worst, arcs = list[float](), list[int]()
    for k in range(rounds):
        worst.append(float(optimum.defects.max()))
        arcs.append(optimum.motion.mesh.total)
        far = worst[-1] > 10 * tolerance
        # a few more arcs may miss where the error is
        of_no_use = len(worst) > 2 and far and not worst[-1] < worst[-2] / 3
        of_no_use = of_no_use and arcs[-1] > 1.5 * arcs[-2]
        mesh = finer(optimum.motion.mesh, optimum.defects, tolerance)
        if mesh.total == optimum.motion.mesh.total or mesh.total > most_arcs or of_no_use:
            break
        report(f"refining to {mesh.total} arcs", k / rounds)
        last = optimum.treatment
        if not isinstance(last, FixedModes):
            last = replace(last, first=last.levels[-1])
        motion = optimum.motion
        problem = motion.program.problem
        again = optimise(
            problem,
            mesh,
            last,
            motion.guess,
            p=p,
            pins=pins,
            solver=solver,
            explain=False,  # limits do not conflict: the coarser mesh met them
        )
        optimum = replace(
            again,
            levels=(*optimum.levels, *again.levels),
            treatment=optimum.treatment,
            build_s=optimum.build_s + again.build_s,
        )
    return optimum


def optimise_multistart(
    problem: Problem,
    mesh: Mesh,
    treatment: Contacts,
    guesses: Iterable[Guess],
    *,
    p: Mapping[str, ArrayLike] | None = None,
    solver: Solver | None = None,
    report: Report = silent,
) -> tuple[Optimum, tuple[float, ...]]:
    """Optimise from several starts and keep the best.

    Parameters
    ----------
    problem : Problem
        The problem.
    mesh : Mesh
        Phases, arcs and polynomials.
    treatment : Regularised, Complementarity or FixedModes
        Treatment of contacts.
    guesses : iterable of Guess
        Where to start.
    p : mapping of str to array_like, optional
        Parameters of the model by name.
    solver : Solver, optional
        Default: IPOPT.
    report : callable, optional
        Receives the progress.

    Returns
    -------
    best : Optimum
        The optimum with the smallest objective.
    objectives : tuple of float
        Objective of every start, NaN where it failed.

    Raises
    ------
    SolveError
        If every start failed: the last one's.

    Examples
    --------
    A block that resists with 1 forward and 2 backward, pushed with at most 3, slides a unit way
    from rest to rest in sqrt(3/2) at least:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> block = wo.Model(
    ...     "block",
    ...     x=[wo.Signal("position", x), wo.Signal("velocity", v)],
    ...     ode=ca.vertcat(v, u + f),
    ...     u=[wo.Signal("drive", u, lower=-3.0, upper=3.0)],
    ...     contacts=[wo.Contact("sole", v, f, wo.Coulomb(1.0, 2.0))],
    ... )
    >>> ends = wo.Ends.of(block)
    >>> start = wo.Constraint("start", ends.start, 0, 0)
    >>> rest = wo.Constraint("end", ends.end, [1, 0], [1, 0])
    >>> time = ends.duration
    >>> problem = wo.Problem(block, ends, time, (0.1, 10.0), boundary_constraints=[start, rest])
    >>> guess = wo.Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.7]))
    >>> mesh = wo.Mesh.even(2, 1, wo.Collocation(2))
    >>> slides = wo.FixedModes(wo.ModeSequence(((1,), (1,))))
    >>> slow = wo.Guess(3.0, lambda t: np.vstack([t / 3, 0 * t + 0.3]))
    >>> best, objectives = wo.optimise_multistart(problem, mesh, slides, [guess, slow])
    >>> round(best.objective**2, 9), len(objectives)
    (1.5, 2)
    """
    best, objectives, error = None, [], None
    for k, guess in enumerate(guesses):
        report(f"start {k}", None)
        try:
            found = optimise(problem, mesh, treatment, guess, p=p, solver=solver)
        except SolveError as failed:
            objectives.append(np.nan)
            error = failed
            continue
        objectives.append(found.objective)
        if best is None or found.objective < best.objective:
            best = found
    if best is None:
        raise error or SolveError("no start was given", "give at least one")
    return best, tuple(objectives)
