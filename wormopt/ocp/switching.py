"""From a relaxed optimum to an exact one: extract its phases, free their durations, solve again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.nlp import Ipopt, Solver
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.structure import Structure, structure_of
from wormopt.progress import Report, silent

# An exact optimum worse than the relaxed one by more than the first share of the objective may have
# wrong phases, so that others are tried; by more than the second it is rejected.
_ALIKE, _FAMILIAR = 0.01, 0.1
# Most structures tried.
_READINGS = 6


def optimise_switching_times(
    relaxed: Optimum,
    *,
    collocation: Collocation | None = None,
    tolerance: float = 1e-10,
    p: Mapping[str, ArrayLike] | None = None,
    solver: Solver | None = None,
    report: Report = silent,
) -> Optimum:
    """Solve with the contact modes of a relaxed optimum, switching times left free.

    Phases are runs of arcs with the same contact modes and the same inputs at their limits. A
    phase may shrink to nothing. Other readings are tried where the objective comes out worse than
    the relaxed one by more than 1 %; the best one is refined.

    Parameters
    ----------
    relaxed : Optimum
        With smoothed or complementary contact, on a mesh fine enough to show the phases.
    collocation : Collocation, optional
        On each phase; Gauss-Legendre of degree 5 where nothing is said.
    tolerance : float, optional
        Local error allowed on each arc, see `refine`.
    p : mapping of str to array_like, optional
        Parameters of the model by name; those of the relaxed motion where nothing is said.
    solver : Solver, optional
        IPOPT with a tolerance of 1e-10 and a small barrier where nothing is said.
    report : callable, optional
        Told how far it is.

    Returns
    -------
    Optimum
        With prescribed modes.

    Raises
    ------
    SolveError
        If no reading leads to a motion near the relaxed one.

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
    >>> round(wo.optimise_switching_times(relaxed).objective**2, 9)
    1.5
    """
    collocation = collocation or Collocation(5)
    solver = solver or Ipopt(tolerance=1e-10, mu_init=1e-4, iterations=150)
    p = relaxed.motion.parameters if p is None else p
    found: list[Optimum] = []
    error: SolveError | None = None
    for k, structure in enumerate(islice(_readings(relaxed), _READINGS)):
        report(f"solving with {len(structure.durations)} phases", k / (_READINGS + 1))
        try:
            found.append(_solve(relaxed, structure, collocation, p, solver))
        except SolveError as failed:
            error = failed
            continue
        if _loss(found[-1], relaxed) <= _ALIKE:
            break
    found = sorted((f for f in found if _loss(f, relaxed) <= _FAMILIAR), key=lambda f: f.objective)
    if not found:
        raise SolveError(
            "the contact modes read off the relaxed motion do not lead to an exact one",
            "use more arcs (mesh.arcs) or a smaller last level of the relaxed solve",
            None if error is None else error.partial,
            "no_phases",
        )
    near = replace(solver, mu_init=1e-5, warm=True) if isinstance(solver, Ipopt) else solver
    try:
        refined = refine(found[0], tolerance, p=p, solver=near, report=report)
    except SolveError:  # its defects show how exact it is
        return found[0]
    return refined if _loss(refined, relaxed) <= _FAMILIAR else found[0]


def _loss(exact: Optimum, relaxed: Optimum) -> float:
    """Relative loss of the exact objective to the relaxed one."""
    size = max(abs(relaxed.objective), abs(exact.objective), 1e-300)
    return (exact.objective - relaxed.objective) / size


def _readings(relaxed: Optimum) -> Iterator[Structure]:
    """Different structures by thresholds of rest and noise, the simplest first."""
    seen = set()
    for least in (2, 3, 1, 5):
        for speed in resting_speeds(relaxed):
            structure = structure_of(relaxed.motion, speed=speed, least=least)
            key = (structure.modes.phases, structure.active)
            if key not in seen:
                seen.add(key)
                yield structure


def resting_speeds(relaxed: Optimum) -> tuple[float, ...]:
    """Speeds below which a contact may rest, the likeliest first.

    `relaxed` has smoothed or complementary contact.
    """
    motion = relaxed.motion
    t = np.linspace(0.0, motion.duration, 4 * motion.mesh.total)
    v = motion.observe(motion.program.problem.model.contact_velocities, t)
    largest = float(np.max(np.abs(v), initial=0.0))
    treatment = relaxed.treatment
    if isinstance(treatment, Regularised):
        return (3 * treatment.v_reg, treatment.v_reg, 10 * treatment.v_reg)
    assert isinstance(treatment, Complementarity)
    return (1e-2 * largest, 1e-3 * largest, 5e-2 * largest)


def _solve(
    relaxed: Optimum,
    structure: Structure,
    collocation: Collocation,
    p: Mapping[str, ArrayLike] | None,
    solver: Solver,
) -> Optimum:
    mesh = Mesh.even(len(structure.durations), 1, collocation, max(0, collocation.degree - 2))
    guess = replace(relaxed.motion.guess, phases=structure.durations)
    problem = relaxed.motion.program.problem
    return optimise(
        problem,
        mesh,
        FixedModes(structure.modes, structure.active),
        guess,
        p=p,
        solver=solver,
        explain=False,  # a wrong phase is no conflict of limits
    )
