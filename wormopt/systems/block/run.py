"""Scenes of kind ``slide``: a block on the ground goes somewhere in the best way."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.friction import Law
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementary, Smoothed
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise, refine
from wormopt.ocp.polish import polish
from wormopt.ocp.problem import Bound, Ends, Problem
from wormopt.ocp.sequence import structure_of
from wormopt.progress import Report
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.scene.numerics import SmoothContact
from wormopt.scene.scene import Scene
from wormopt.systems.block.block import block
from wormopt.systems.block.scenes import SlideScene
from wormopt.systems.chain.runs.chains import law_of, treatment_of
from wormopt.systems.shared.optimum import (
    ACCEPTED,
    conclude,
    recheck,
    refused,
    sample_motion,
    warnings_of_optimum,
    warnings_of_reading,
)
from wormopt.systems.shared.proof import warnings_of_contact
from wormopt.systems.shared.signals import Kind, symbol

_SIGNALS: dict[str, Kind] = {
    "position": ("length", (), "position of the block"),
    "velocity": ("speed", (), "velocity of the block"),
    "force": ("force", (), "drive"),
    "contact_force": ("force", (), "force of the ground"),
}
# Of a solve that only has to show the phases.
_RELAXED = Complementary(residual=1e-3, first=1e-1)
# First width of the smooth law, in usual speeds, and how often the mesh is refined.
_WIDE, _ROUNDS = 0.1, 8
# A simulation may end elsewhere by so many defects of a single arc.
_DEFECTS = 1e2
# No motion takes longer than so many times a plain one, see `_plain_time`.
_LONGEST = 10.0


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[SlideScene], report: Report) -> Result:
    """Find the best way of a block; "failed" where a simulation of the inputs ends elsewhere.

    Raises SolveError if there is no such way, or it is not found.
    """
    table, begin = scene.table, time.perf_counter()
    try:
        stages = _solve(table, report)
    except SolveError as error:
        partial = error.partial
        found = _variables(partial, table.units) if isinstance(partial, Motion) else ()
        raise refused(scene, error, found) from None
    optimum, solved = [*stages.values()][-1], time.perf_counter()
    accepted = max(ACCEPTED, _DEFECTS * table.mesh.tolerance)
    second = recheck(optimum.motion, treatment_of(table.contact), accepted=accepted, report=report)
    return conclude(
        scene,
        stages,
        second,
        objective="time" if table.minimise == "time" else "effort",
        scalars={},
        variables=_variables(optimum.motion, table.units),
        warnings=[
            *warnings_of_optimum(optimum, table.mesh.tolerance),
            *warnings_of_reading(next(iter(stages.values())), optimum),
            *warnings_of_contact(treatment_of(table.contact), [law_of(table.block.friction)]),
        ],
        timings={"optimise": solved - begin, "recheck": time.perf_counter() - solved},
    )


def _solve(table: SlideScene, report: Report) -> dict[str, Optimum]:
    problem, mesh = problem_of(table), table.mesh
    plain = Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme))
    if not isinstance(table.contact, SmoothContact):
        relaxed = optimise(problem, plain, _RELAXED, _guess(table), report=report)
        return {"relaxed": relaxed, "phases": polish(relaxed, tolerance=mesh.tolerance)}
    width, size = table.contact.v_reg, problem.model.x[1].nominal
    smoothed = Smoothed(width, max(width, _WIDE * size))
    coarse = optimise(problem, plain, smoothed, _guess(table), report=report)
    return {"smooth": coarse, "switched": _switched(coarse, mesh.tolerance, report)}


def _switched(coarse: Optimum, tolerance: float, report: Report) -> Optimum:
    """Let the drive switch at any time: phases end where it reaches or leaves a limit."""
    motion, solver = coarse.motion, Ipopt(tolerance=1e-11, mu_init=1e-2)
    found = structure_of(motion, speed=None, least=2)
    phases, arcs = len(found.durations), motion.mesh.total
    counts = tuple(max(2, round(arcs * d / motion.duration)) for d in found.durations)
    assert isinstance(coarse.treatment, Smoothed)
    width = coarse.treatment.v_reg
    again = optimise(
        motion.program.problem,
        Mesh.even(phases, counts, motion.mesh.collocation),
        Smoothed(width, width, active=found.active),
        replace(motion.guess, phases=found.durations),
        solver=solver,
        report=report,
    )
    return refine(again, tolerance, rounds=_ROUNDS, solver=solver, report=report)


def problem_of(table: SlideScene) -> Problem:
    """What to optimise; names of bounds are keys of the scene."""
    slow = _plain_time(table)
    model = _model(table, slow)
    effort = table.minimise == "effort"
    ends = Ends.of(model, int(effort))
    sizes = np.array([s.nominal for s in model.x])
    at_ends = [
        Bound(f"{name}.{signal.name}", state[k] / sizes[k], value / sizes[k], value / sizes[k])
        for name, place, state in (("start", table.start, ends.start), ("end", table.end, ends.end))
        for k, signal, value in zip(
            range(2), model.x, (place.position, place.velocity), strict=False
        )
    ]
    longest = _LONGEST * slow
    if table.time is not None:
        at_ends.append(Bound("time", ends.duration, upper=table.time, nominal=table.time))
        longest = max(longest, 2 * table.time)
    return Problem(
        model,
        ends,
        ends.integrals[0] if effort else ends.duration,
        (1e-6 * slow, longest),
        integrands=ca.sumsqr(symbol(model, "force")) if effort else ca.SX(0, 1),
        at_ends=at_ends,
    )


def _model(table: SlideScene, slow: float) -> Model:
    way = abs(table.end.position - table.start.position)
    speeds = abs(table.start.velocity) + abs(table.end.velocity)
    return block(
        law_of(table.block.friction),
        mass=table.block.mass,
        force=table.block.force,
        length_nominal=max(way, speeds * slow / 4),
        time_nominal=slow,
    )


def _plain_time(table: SlideScene) -> float:
    """Time of a plain way: stop, go from rest to rest, gather speed; none is much slower."""
    weakest = _least_net_force(law_of(table.block.friction), table.block.force)
    a, b = weakest / table.block.mass, table.block.force / table.block.mass
    v0, v1 = table.start.velocity, table.end.velocity
    way = abs(table.end.position - table.start.position) + v0**2 / (2 * b) + v1**2 / (2 * a)
    return abs(v0) / b + abs(v1) / a + math.sqrt(2 * way * (1 / a + 1 / b))


def _least_net_force(law: Law, force: float) -> float:
    """Least of what is left of the drive against friction, of the directions where any is."""
    left = (force - abs(float(law.slip_force(0.0, d))) for d in law.directions)
    return min((net for net in left if net > 0), default=force)


def _guess(table: SlideScene) -> Guess:
    """Cubic from one place and velocity to the other."""
    duration = _plain_time(table) if table.time is None else table.time
    start, end = table.start, table.end
    way = end.position - start.position
    p, q = duration * start.velocity, duration * end.velocity
    cubic = np.polynomial.Polynomial([start.position, p, 3 * way - 2 * p - q, p + q - 2 * way])
    slope = cubic.deriv()
    return Guess(
        duration, lambda t: np.vstack([cubic(t / duration), slope(t / duration) / duration])
    )


def _variables(motion: Motion, units: str) -> list[Variable]:
    model = motion.program.problem.model
    expressions = {name: symbol(model, name) for name in ("position", "velocity", "force")}
    sampled = sample_motion(motion, {**expressions, "contact_force": model.forces})
    return sampled.variables(_SIGNALS, units)
