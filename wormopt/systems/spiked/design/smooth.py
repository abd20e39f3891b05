"""Costs that are neither linear nor a peak: energy and effort, by IPOPT from a searched gait.

The collocated problem of optimal control is solved with the cost itself: from the motion of a
trial, or where velocities may jump from the fastest motion with its durations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from wormopt.model.gait import Gait
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation, bernstein_matrix
from wormopt.ocp.mesh import Arcs, Mesh, on_finer_mesh
from wormopt.ocp.nlp import Bounds, Ipopt, Solution
from wormopt.ocp.transcription import Transcription
from wormopt.systems.spiked.design.problem import gait_problem
from wormopt.systems.spiked.programs.costs import has_cost_columns
from wormopt.systems.spiked.search.sequences import Sequence_
from wormopt.systems.spiked.search.trial import Trial
from wormopt.systems.spiked.task import Objective, Task

# Refinement stops when halving every arc changes the cost by less than this, relatively.
_RESOLVED = 1e-6
# A solution is as feasible as its start if its scaled constraints are violated by no more, and is
# accepted up to the second.
_FEASIBLE, _ACCEPTED = 1e-10, 1e-8
_ARCS = 6
_POLISH = Ipopt(tolerance=1e-8, mu_init=1e-2, iterations=120)


@dataclass(frozen=True, eq=False)
class Solved:
    """An order of rest solved for a cost on some mesh."""

    trial: Trial  # the start: a gait of the same order and cycle count
    program: Transcription
    bounds: Bounds  # of the program, for this order
    solution: Solution

    @property
    def objective(self) -> float:
        """Scaled cost."""
        return self.solution.objective

    @property
    def arcs(self) -> Arcs:
        """The motion."""
        return self.program.unpack(self.solution.w)


def mesh_of(sequence: Sequence_, arcs: int) -> Mesh:
    """Mesh with a sequence's phases, `arcs` in each, on which rates are linear along an arc."""
    return Mesh(len(sequence), arcs, Collocation(2), 0)


def resting_state(task: Task) -> np.ndarray:
    """State of `spiked_worm` at rest, links in the middle of their ranges, shape (2n + 2,)."""
    lengths = np.mean(task.limits.length_ranges(task.worm.links), axis=1)
    return np.concatenate([[0.0], lengths, [0.0], 0.0 * lengths])


@lru_cache(maxsize=16)
def _program(task: Task, mesh: Mesh) -> Transcription:
    return Transcription(gait_problem(task.worm, task.limits, task.objective), mesh)


def solve_cost(task: Task, trial: Trial) -> Solved | None:
    """Solve for a smooth cost, started from a trial that is fast enough; None: no motion found."""
    cycle = replace(task, limits=replace(task.limits, period=trial.program.period))
    mesh = replace(mesh_of(trial.sequence, _ARCS), arcs=tuple(trial.program.arcs.tolist()))
    program = _program(cycle, mesh)
    bounds = program.bounds(ModeSequence.of_resting(trial.sequence, task.worm.links + 1))
    if has_cost_columns(task):
        begin = program.pack(arcs_of(trial, program), bounds)
    else:
        fast = _fast(replace(cycle, objective=Objective()), trial, mesh)
        if fast is None:
            return None
        begin = program.pack(replace(fast, **program.nominal_extras()), bounds)
    start = program.nlp.start(begin, bounds)
    if has_cost_columns(task):  # what the linear programs leave on very short arcs
        start = program.nlp.restore(start, bounds)
    found = program.nlp.restore(program.nlp.solve(start.w, bounds, _POLISH), bounds)
    if start.violation <= _FEASIBLE and not _better(found, start):
        found = start
    return Solved(trial, program, bounds, found) if found.violation <= _ACCEPTED else None


def _better(one: Solution, other: Solution) -> bool:
    return one.violation <= _FEASIBLE and one.objective < other.objective


def _fast(task: Task, trial: Trial, mesh: Mesh) -> Arcs | None:
    """The fastest motion with the durations of a trial, whose velocities may jump."""
    program = _program(task, mesh)
    rest = program.rest(trial.program.widths(trial.point), resting_state(task))
    own = program.bounds(ModeSequence.of_resting(trial.sequence, task.worm.links + 1))
    step = program.nlp.linear_step(rest, own, program.hold_durations())
    return None if step is None else program.unpack(step[0])


def arcs_of(trial: Trial, program: Transcription) -> Arcs:
    """Motion of a trial, velocities linear on its arcs, on a program's mesh of as many arcs.

    The program is that of `gait_problem`, with states of degree 2 and inputs of degree 0.
    """
    of, worm = trial.program, trial.program.task.worm
    widths, v, first = of.motion(trial.point)
    widths, v = widths * of.limits.time, v * of.limits.speed
    lengths = first * of.limits.speed * of.limits.time
    lengths = lengths + np.array(of.task.limits.length_ranges(worm.links))[:, 0]
    rates = -np.diff(v, axis=2)
    states = np.concatenate([v[:, :, :1], rates], axis=2)  # of the head and of the links
    ways = np.concatenate([[0.0], lengths])  # of the head, and lengths
    whole = states.mean(axis=1) * widths[:, None]
    begins = ways + np.cumsum(whole, axis=0) - whole

    def at(s: float) -> np.ndarray:
        change = states[:, 0] * s + (states[:, 1] - states[:, 0]) * s**2 / 2
        velocity = states[:, 0] + (states[:, 1] - states[:, 0]) * s
        return np.concatenate([begins + change * widths[:, None], velocity], axis=1).T

    tau = program.mesh.collocation.tau
    long = widths > 1e-12 * widths.sum()
    slopes = np.diff(v, axis=1)[:, 0] / np.where(long, widths, 1.0)[:, None]
    slopes[~long] = 0.0
    forces, spent = _loads(trial, v, slopes, tau)
    energy = of.task.objective.minimise == "energy_per_distance"
    count = len(widths)
    return Arcs(
        duration=widths,
        start=at(0.0),
        points=np.stack([at(s) for s in tau], axis=1),
        inputs=-np.diff(slopes, axis=1).T[:, None],
        slacks=spent if energy else np.zeros((0, len(tau), count)),
        algebraic=np.zeros((0, len(tau), count)),
        unknowns=forces,
        jumps=np.zeros((0, count)),
        design=np.zeros(0),
    )


def _loads(
    trial: Trial, v: np.ndarray, slopes: np.ndarray, tau: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Loads of the spikes and power that is spent, each (mass or link, place, arc)."""
    of, worm = trial.program, trial.program.task.worm
    mass, load = np.array(worm.masses), worm.load_range[1]
    forces = np.zeros((worm.links + 1, len(tau), len(v)))
    spent = np.zeros((worm.links, len(tau), len(v)))
    sets = [resting for resting, n in zip(of.sequence, of.arcs, strict=True) for _ in range(n)]
    for k, resting in enumerate(sets):
        for m, s in enumerate(tau):
            velocity = v[k, 0] + (v[k, 1] - v[k, 0]) * s
            needed = mass * slopes[k] + worm.drag * velocity + load
            forces[list(resting), m, k] = needed.sum() / len(resting)
            pull = np.cumsum(forces[:, m, k] - needed)[:-1]
            spent[:, m, k] = np.maximum(pull * np.diff(velocity), 0.0)
    return forces, spent


def refine_cost(solved: Solved) -> tuple[Solved, float]:
    """Raise the degree until halving every arc gains less than 1e-6, or costs no longer fall.

    Also returns the relative gain left, to first order, when every arc is halved; infinite
    where the linear program that tells has no solution.
    """
    error = _left_by_halving(solved)
    for mesh in _finer(solved.program.mesh):
        if error <= _RESOLVED:
            break
        program, bounds, start = _carry(solved, mesh)
        found = program.nlp.restore(program.nlp.solve(start.w, bounds, _POLISH), bounds)
        if found.objective < solved.objective and found.violation <= _FEASIBLE:
            solved = replace(solved, program=program, bounds=bounds, solution=found)
            error = _left_by_halving(solved)
    return solved, error


def _finer(mesh: Mesh) -> Iterator[Mesh]:
    for degree in (3, 5):
        yield replace(mesh, collocation=Collocation(degree), input_degree=degree - 2)


def _left_by_halving(solved: Solved) -> float:
    """Relative gain that is left when every arc is halved: the best step of the linear program.

    An interior-point solver's own noise is larger than that.
    """
    counts = tuple(2 * n for n in solved.program.mesh.counts)
    mesh = replace(solved.program.mesh, arcs=counts)
    program, bounds, start = _carry(solved, mesh)
    step = program.nlp.linear_step(start.w, bounds, np.full(start.w.shape, 1e-2))
    return np.inf if step is None else abs(step[1] / solved.objective)


def _carry(solved: Solved, mesh: Mesh) -> tuple[Transcription, Bounds, Solution]:
    fine = Transcription(solved.program.problem, mesh)
    sequence = ModeSequence.of_resting(
        solved.trial.sequence, solved.trial.program.task.worm.links + 1
    )
    bounds = fine.bounds(sequence)
    w = fine.pack(on_finer_mesh(solved.arcs, solved.program.mesh, mesh), bounds)
    return fine, bounds, fine.nlp.start(w, bounds)


def gait_of_arcs(arcs: Arcs, mesh: Mesh, links: int) -> Gait:
    """Integrate link accelerations twice, arc by arc; arcs without duration are left out."""
    kept = np.flatnonzero(arcs.duration > 1e-15 * arcs.duration.sum())
    nodes, m = mesh.input_nodes, mesh.input_degree
    to_powers = np.linalg.inv(nodes[:, None] ** np.arange(m + 1)) @ np.linalg.inv(
        bernstein_matrix(nodes)
    )
    pieces = np.zeros((len(kept), links, m + 3))
    k = np.arange(m + 1)
    for row, arc in enumerate(kept):
        h = arcs.duration[arc]
        pieces[row, :, 0] = arcs.start[1 : links + 1, arc]
        pieces[row, :, 1] = arcs.start[links + 2 :, arc]
        power = arcs.inputs[:, :, arc] @ to_powers.T / h**k
        pieces[row, :, 2:] = power / ((k + 1) * (k + 2))
    return Gait(np.concatenate([[0.0], np.cumsum(arcs.duration[kept])]), pieces)
