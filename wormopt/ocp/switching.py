"""From a relaxed optimum to an exact one: extract its phases, free their durations, solve again.

The structure of a motion is which contacts rest, and which inputs are at limits, in each phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import SolveError
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised, SwitchDetection
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Motion
from wormopt.ocp.nlp import Ipopt, Solver
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.progress import Report, silent


@dataclass(frozen=True)
class Structure:
    """Phases of a motion: contact modes, and inputs at their limits."""

    modes: ModeSequence  # by phase; neighbours may differ in inputs only
    durations: np.ndarray  # (phases,)
    active: tuple[tuple[int, ...], ...]  # per phase and input: -1 lower limit, +1 upper, 0 else


def structure_of(motion: Motion, *, speed: float | None, least: int = 1) -> Structure:
    """Extract phases from a motion with smoothed or complementary contact on a fine mesh.

    A contact slower than `speed` rests; if None, only inputs make phases. With switch detection
    each arc has the modes that its forces show. Runs of fewer than
    `least` arcs are noise and join their longer neighbour.
    """
    modes = np.zeros((0, motion.mesh.total), dtype=int)
    if isinstance(motion.program.treatment, SwitchDetection):
        modes = _detected_modes(motion)
    elif speed is not None:
        modes = _contact_modes(motion, speed)
    active = _active_inputs(motion)
    keys = [(tuple(m), tuple(a)) for m, a in zip(modes.T.tolist(), active.T.tolist(), strict=True)]
    runs = _merged(_joined((key, 1) for key in keys), least)
    edges = np.cumsum([0, *(length for _, length in runs)])
    durations = np.diff(motion.breaks[edges])
    return Structure(
        ModeSequence(tuple(key[0] for key, _ in runs)),
        durations,
        tuple(key[1] for key, _ in runs),
    )


def _contact_modes(motion: Motion, speed: float) -> np.ndarray:
    """Mode of every contact on every arc, shape (n_c, N)."""
    model, tau = motion.program.problem.model, motion.mesh.collocation.tau
    t = motion.breaks[:-1] + np.multiply.outer(tau, motion.arcs.duration)
    v = motion.observe(model.contact_velocities, t.ravel()).reshape(-1, *t.shape)
    rests = np.median(np.abs(v), axis=1) <= speed
    directions = np.where(v.mean(axis=1) >= 0, 1, -1)
    for i, contact in enumerate(model.contacts):
        if len(contact.law.directions) == 1:
            directions[i] = contact.law.directions[0]
    return np.where(rests, 0, directions)


def _detected_modes(motion: Motion) -> np.ndarray:
    """Mode of every contact on every arc with switch detection, shape (n_c, N)."""
    model, tau = motion.program.problem.model, motion.mesh.collocation.tau
    t = (motion.breaks[:-1] + np.multiply.outer(tau, motion.arcs.duration)).ravel()
    rows = []
    for c in model.contacts:
        v = motion.observe(c.velocity, t).reshape(len(tau), -1).mean(axis=0)
        mode = np.zeros(motion.mesh.total, dtype=int)
        for d in c.law.directions:
            gap = motion.observe(c.force - c.law.slip_force(c.velocity, d), t)
            gap = np.abs(gap).reshape(len(tau), -1).mean(axis=0) / c.nominal_force
            mode[d * v / c.nominal_speed > gap] = d
        rows.append(mode)
    return np.array(rows, dtype=int).reshape(len(rows), motion.mesh.total)


def _active_inputs(motion: Motion) -> np.ndarray:
    """Active limit of every input on every arc, shape (n_u, N)."""
    rows = []
    middle = (motion.breaks[:-1] + motion.breaks[1:]) / 2
    values, at = motion.inputs(middle), 0
    for signal in motion.program.problem.model.u:
        for u in values[at : at + signal.size]:
            width = signal.upper - signal.lower
            near = 1e-3 * (width if np.isfinite(width) else np.ptp(u))
            rows.append((u >= signal.upper - near).astype(int) - (u <= signal.lower + near))
        at += signal.size
    return np.array(rows, dtype=int).reshape(len(rows), motion.mesh.total)


Run = tuple[tuple[tuple[int, ...], tuple[int, ...]], int]


def _joined(runs: Iterable[Run]) -> list[Run]:
    """Runs without neighbours of equal key."""
    joined: list[Run] = []
    for key, length in runs:
        if joined and joined[-1][0] == key:
            joined[-1] = (key, joined[-1][1] + length)
        else:
            joined.append((key, length))
    return joined


def _merged(runs: list[Run], least: int) -> list[Run]:
    """Give runs shorter than ``least`` to their longer neighbour, the shortest first."""
    while len(runs) > 1:
        k = min(range(len(runs)), key=lambda i: runs[i][1])
        if runs[k][1] >= least:
            break
        left = runs[k - 1][1] if k > 0 else -1
        right = runs[k + 1][1] if k + 1 < len(runs) else -1
        heir = k - 1 if left >= right else k + 1
        runs[heir] = (runs[heir][0], runs[heir][1] + runs[k][1])
        runs = _joined(runs[:k] + runs[k + 1 :])
    return runs


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
    phase may shrink to nothing. If the objective is worse than the relaxed one by more than 1 %,
    other mode sequences are tried; the best one is refined.

    Parameters
    ----------
    relaxed : Optimum
        With smoothed or complementary contact, on a mesh fine enough to show the phases.
    collocation : Collocation, optional
        Collocation on each phase. Default: Gauss-Legendre of degree 5.
    tolerance : float, optional
        Local error allowed on each arc, see `refine`.
    p : mapping of str to array_like, optional
        Parameters of the model by name. Default: those of the relaxed motion.
    solver : Solver, optional
        Default: IPOPT with a tolerance of 1e-10 and a small barrier parameter.
    report : callable, optional
        Receives the progress.

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
            "the contact modes of the relaxed motion do not lead to an exact motion",
            "use more arcs (mesh.arcs) or a smaller last level of the relaxed solve",
            None if error is None else error.partial,
            "no_phases",
        )
    near = replace(solver, mu_init=1e-8, warm=True) if isinstance(solver, Ipopt) else solver
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
    detected = isinstance(relaxed.treatment, SwitchDetection)
    for least in (1, 2) if detected else (2, 3, 1, 5):
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
