"""Run scenes of kind ``slide``: the optimal motion of a block on the ground."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, FixedModes, Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.problem import Problem
from wormopt.ocp.structure import structure_of
from wormopt.ocp.switching import optimise_switching_times
from wormopt.progress import Report
from wormopt.result import Result
from wormopt.study.numerics import SmoothContact
from wormopt.study.scene import Scene
from wormopt.systems.block.block import Phases, cubic_guess, phases_of, problem_of
from wormopt.systems.block.scenes import SlideScene
from wormopt.systems.chain import law_of
from wormopt.systems.shared.optimum import (
    ACCEPTED,
    conclude_optimum,
    cross_check,
    refused,
    sample_motion,
    warnings_of_optimum,
    warnings_of_reading,
)
from wormopt.systems.shared.proof import warnings_of_contact
from wormopt.systems.shared.settings import treatment_of

# Settings of a solve that only has to show the phases.
_RELAXED = Complementarity(residual=1e-3, first=1e-1)
# If less of the drive than this share accelerates the block, relaxed contact hides the phases: it
# allows friction to be smaller by a thousandth of the drive and more.
_RELAXED_BELOW = 0.05
# A smaller share of the objective is no improvement.
_SAME = 1e-9
# First width of the smooth law, in usual speeds, and number of mesh refinements.
_WIDE, _ROUNDS = 0.1, 8
# Accepted end error of a simulation, in defects of a single arc.
_DEFECTS = 1e2
# Keys of the scene by the optimiser's names.
_KEYS = {"force": "block.force", "arcs": "mesh.arcs"}


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[SlideScene], report: Report) -> Result:
    """Find the best motion of a block; "failed" where a simulation of the inputs ends elsewhere.

    Raises SolveError if no such motion exists, or none is found.
    """
    table, begin = scene.table, time.perf_counter()
    try:
        stages = _solve(table, report)
    except SolveError as error:
        found = error.partial
        reached = _signals(found) if isinstance(found, Motion) else ()
        raise refused(scene, error, reached, _KEYS) from None
    optimum, solved = [*stages.values()][-1], time.perf_counter()
    accepted = max(ACCEPTED, _DEFECTS * table.mesh.tolerance, _rounding(optimum.motion))
    treatment = treatment_of(table.contact)
    second = cross_check(optimum.motion, treatment, accepted=accepted, report=report)
    return conclude_optimum(
        scene,
        stages,
        second,
        {},
        _signals(optimum.motion),
        objective=table.minimise,
        warnings=[
            *warnings_of_optimum(optimum, table.mesh.tolerance),
            *warnings_of_reading(next(iter(stages.values())), optimum),
            *warnings_of_contact(treatment, [law_of(table.block.friction)]),
        ],
        timings={"optimise": solved - begin, "recheck": time.perf_counter() - solved},
    )


def _signals(motion: Motion) -> dict[str, np.ndarray]:
    model = motion.program.problem.model
    signals = {name: model[name] for name in ("position", "velocity", "force")}
    return sample_motion(motion, {**signals, "contact_force": model.forces}).arrays(
        SlideScene.variables
    )


def _rounding(motion: Motion) -> float:
    """Effect of rounding the duration of the motion on the states, in usual sizes."""
    arc = motion.program.arc
    rates = np.abs(motion.observe(arc.lawful_ode, motion.time)).max(axis=1) / arc.x_nominal
    return 4 * np.finfo(float).eps * motion.duration * float(rates.max())


def _solve(table: SlideScene, report: Report) -> dict[str, Optimum]:
    problem, mesh, known = problem_of(table), table.mesh, phases_of(table)
    plain = Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme))
    if not isinstance(table.contact, SmoothContact):
        if known is not None and known.excess < _RELAXED_BELOW:
            return {"phases": _in_phases(table, problem, known, report)}
        try:
            relaxed = optimise(problem, plain, _RELAXED, cubic_guess(table), report=report)
            phases = optimise_switching_times(relaxed, tolerance=mesh.tolerance)
        except SolveError as error:
            if known is None or error.code in ("bad_guess", "unbounded", "late"):
                raise
            return {"phases": _in_phases(table, problem, known, report)}
        return {"relaxed": relaxed, "phases": _better(table, problem, known, phases, report)}
    if known is not None and table.minimise == "time":
        guess, active = known.guess, known.active
        return {"phases": _switched(problem, table, table.contact, guess, active, report)}
    width, size = table.contact.v_reg, problem.model.x[1].nominal
    smoothed = Regularised(width, max(width, _WIDE * size))
    coarse = optimise(problem, plain, smoothed, cubic_guess(table), report=report)
    found = structure_of(coarse.motion, speed=None, least=2)
    guess = replace(coarse.motion.guess, phases=found.durations)
    switched = _switched(problem, table, table.contact, guess, found.active, report)
    return {"smooth": coarse, "switched": switched}


def _better(
    table: SlideScene, problem: Problem, known: Phases | None, read: Optimum, report: Report
) -> Optimum:
    """The better of the local optimum from relaxed contact and the one from known phases."""
    if known is None:
        return read
    try:
        found = _in_phases(table, problem, known, report)
    except SolveError:
        return read
    gained = read.objective - found.objective
    return found if gained > _SAME * abs(read.objective) else read


def _in_phases(table: SlideScene, problem: Problem, known: Phases, report: Report) -> Optimum:
    """Solve with known phases, from a motion near the best one."""
    near = table.minimise == "time"  # the guess is then the best motion
    if near and not isinstance(law_of(table.block.friction), Coulomb):
        mesh = _mesh(table, known.guess)
    else:
        mesh = Mesh.even(len(known.modes.phases), 1, Collocation(5), 3)
    solver = Ipopt(tolerance=1e-10, mu_init=1e-5 if near else 1e-2, warm=near, rescale=False)
    contact = FixedModes(known.modes, known.active)
    found = optimise(problem, mesh, contact, known.guess, solver=solver, report=report)
    return refine(found, table.mesh.tolerance, solver=solver, report=report)


def _mesh(table: SlideScene, guess: Guess) -> Mesh:
    """Mesh of a scene on the phases of a guess."""
    assert guess.phases is not None
    mesh, shares = table.mesh, guess.phases / np.sum(guess.phases)
    arcs = tuple(max(2, round(mesh.arcs * float(share))) for share in shares)
    return Mesh.even(len(arcs), arcs, Collocation(mesh.degree, mesh.scheme))


def _switched(
    problem: Problem,
    table: SlideScene,
    contact: SmoothContact,
    guess: Guess,
    active: tuple[tuple[int, ...], ...],
    report: Report,
) -> Optimum:
    """Let the drive switch at any time: phases end where it reaches or leaves a limit."""
    solver = Ipopt(tolerance=1e-11, mu_init=1e-2)
    found = optimise(
        problem,
        _mesh(table, guess),
        Regularised(contact.v_reg, contact.v_reg, active=active),
        guess,
        solver=solver,
        report=report,
    )
    return refine(found, table.mesh.tolerance, rounds=_ROUNDS, solver=solver, report=report)
