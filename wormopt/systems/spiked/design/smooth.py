"""Gaits of least energy or effort, by IPOPT.

These costs are neither linear nor a peak. The collocated optimal-control problem is solved with the
cost itself, from the motion of a trial.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
from msgspec import structs

from wormopt.model.gait import Gait
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation, bernstein_matrix
from wormopt.ocp.mesh import Arcs, Mesh, on_finer_mesh
from wormopt.ocp.nlp import Bounds, Ipopt, Solution
from wormopt.ocp.transcription import Transcription
from wormopt.progress import Report
from wormopt.systems.shared.sequences import SHORTEST, Sequence_, lasting_arcs
from wormopt.systems.spiked.design.design import Design, objective_of, of_trial
from wormopt.systems.spiked.dynamics import gait_problem
from wormopt.systems.spiked.gait_problem import GaitProblem, Search
from wormopt.systems.spiked.programs.gait_rows import is_energy
from wormopt.systems.spiked.search.search import DONE, Survey, effort_of
from wormopt.systems.spiked.search.trial import Trial, Trier
from wormopt.systems.spiked.verify import ACCEPTED

# Refinement ends when halving every arc changes the cost by less than this share.
_RESOLVED = 1e-6
# Arcs shorter than this share of the cycle are omitted.
_SHORT = 1e-6
# Scaled constraints: a solution below the first violation is as feasible as its start, below the
# second it is accepted.
_FEASIBLE, _ACCEPTED = 1e-10, 1e-8
_POLISH = Ipopt(tolerance=1e-8, mu_init=1e-2, iterations=120)
# Largest number of arcs.
_MOST_UNKNOWNS, _MOST_HALVINGS = 1000, 5
# Number of best trials of the energy that are refined; share of the cost within which costs are
# minimised from other trials too: on arcs as coarse as theirs values differ by as much.
_POLISHED, _NEAR = 2, 0.01
# Refinement of the energy ends below this gain, as a share.
_GAINED = 3e-7


def smoothest(
    task: GaitProblem, settings: Search, survey: Survey, bound: float, report: Report
) -> Design:
    """Refine the best trials, minimise the smooth cost from them, and take the best gait.

    Parameters are those of `sharpest`. Costs of the gaits are finally compared in closed form.
    """
    trials, ended, error = list(survey.trials), survey.ended, np.nan
    solved, error_of_solved = None, np.nan
    try:
        if ended in DONE:
            if is_energy(task):
                trials, error = _resolved(task, settings, trials, report)
            report("solving for the cost", 0.9)
            solved, error_of_solved = _solved(task, settings, trials, error)
    except KeyboardInterrupt:
        ended = "interrupted"
    own = [of_trial(task, t, error, bound, survey, ended) for t in trials[: 2 * _POLISHED]]
    found = next((one for one in own if _cost(one) < np.inf), own[0])
    if solved is None:
        return found
    return min(_of_solved(task, solved, survey, bound, error_of_solved, ended), found, key=_cost)


def _cost(found: Design) -> float:
    """Smooth cost of a gait; infinite if it violates limits by more than solvers do."""
    if max(found.violations.values()) > ACCEPTED:
        return np.inf
    return objective_of(found.motion, found.task.objective.minimise)


def _resolved(
    task: GaitProblem, settings: Search, trials: list[Trial], report: Report
) -> tuple[list[Trial], float]:
    """Halve arcs of the best trials while that helps; best first, with its last relative gain.

    All trials with few unknowns first, then the best of them, which take longer.
    """
    trier = Trier(task)
    report("resolving the best orders", 0.85)
    few = ((trial, np.inf) for trial in trials[: 4 * effort_of(settings).width])
    found = [_halved(trier, *one, _MOST_UNKNOWNS / 4) for one in few]
    found.sort(key=lambda one: -one[0].value)
    # finer trials may violate limits by the solver's error: keep coarse ones too
    found += [_halved(trier, *one, _MOST_UNKNOWNS) for one in found[:_POLISHED]]
    found.sort(key=lambda one: -one[0].value)
    return [trial for trial, _ in found], found[0][1]


def _halved(trier: Trier, trial: Trial, gained: float, most: float) -> tuple[Trial, float]:
    """Halve arcs until the gain is small or there are more than `most` unknowns.

    Also returns the last relative gain, `gained` if there is none.
    """
    for _ in range(_MOST_HALVINGS):
        if gained <= _GAINED or len(trial.point.x) > most:
            break
        finer = trier.finer(trial, 1e-6)
        trial, gained = finer, (finer.value - trial.value) / abs(finer.cost)
    return trial, gained


def _solved(
    task: GaitProblem, settings: Search, trials: list[Trial], error: float
) -> tuple[Solved | None, float]:
    """The best solution from some trials, refined if these are not resolved, and its error."""
    width, best = effort_of(settings).width, trials[0].value
    if is_energy(task):  # resolved; with more arcs it takes seconds and gains nothing
        found = [solve_cost(task, t) for t in trials[:1] if len(t.point.x) <= _MOST_UNKNOWNS]
        return (found[0] if found else None), error
    close = [trial for trial in trials if trial.value >= best - _NEAR * abs(best)]
    found = [s for trial in close[: 2 * width] if (s := solve_cost(task, trial))]
    found.sort(key=lambda s: s.objective)
    return refined(found[:width]) if found else (None, error)


def _of_solved(
    task: GaitProblem, best: Solved, survey: Survey, bound: float, error: float, ended: str
) -> Design:
    best = _without_short_arcs(best)
    mesh = best.program.mesh
    sequence, durations, arcs = lasting_arcs(best.trial.sequence, mesh.counts, best.arcs.duration)
    return replace(
        of_trial(task, best.trial, error, bound, survey, ended),
        gait=gait_of_arcs(best.arcs, mesh, task.worm.links),
        sequence=sequence,
        durations=durations,
        solver={
            "status": best.solution.status,
            "violation": best.solution.violation,
            "arcs_per_phase": arcs,
            "degree": mesh.collocation.degree,
        },
    )


def _without_short_arcs(solved: Solved) -> Solved:
    """Omit arcs of almost no duration and solve again; unchanged if this raises the cost."""
    mesh, arcs = solved.program.mesh, solved.arcs
    long = arcs.duration > _SHORT * arcs.duration.sum()
    long |= np.bincount(mesh.phase[long], minlength=mesh.phases)[mesh.phase] == 0
    if long.all():
        return solved
    kept = {f.name: getattr(arcs, f.name)[..., long] for f in fields(arcs) if f.name != "design"}
    counts = tuple(np.bincount(mesh.phase[long]).tolist())
    program = Transcription(solved.program.problem, replace(mesh, arcs=counts))
    bounds = _bounds(program, solved.trial.sequence)
    found = _polished(program, program.pack(replace(arcs, **kept), bounds), bounds)
    dearer = found.objective > solved.objective * (1.0 + _RESOLVED)
    if dearer or found.violation > _FEASIBLE:
        return solved
    return replace(solved, program=program, bounds=bounds, solution=found)


@dataclass(frozen=True, eq=False)
class Solved:
    """The solution for one order of rest on one mesh."""

    trial: Trial  # initial gait, of the same order and number of cycles
    program: Transcription
    bounds: Bounds  # bounds of the program for this order
    solution: Solution

    @property
    def objective(self) -> float:
        """Scaled cost."""
        return self.solution.objective

    @property
    def arcs(self) -> Arcs:
        """The motion on the arcs."""
        return self.program.unpack(self.solution.w)


@lru_cache(maxsize=16)
def _program(task: GaitProblem, mesh: Mesh) -> Transcription:
    return Transcription(gait_problem(task), mesh)


def _bounds(program: Transcription, sequence: Sequence_) -> Bounds:
    masses = len(program.problem.model.contacts)
    return program.bounds(ModeSequence.of_resting(sequence, masses))


def solve_cost(task: GaitProblem, trial: Trial) -> Solved | None:
    """Solve for a smooth cost, started from a trial that is fast enough; None: no motion found."""
    cycle = structs.replace(task, limits=task.limits.without_ticks(trial.program.period))
    # rates are linear along an arc
    mesh = Mesh(len(trial.sequence), tuple(trial.program.arcs.tolist()), Collocation(2), 0)
    program = _program(cycle, mesh)
    bounds = _bounds(program, trial.sequence)
    start = program.nlp.start(program.pack(arcs_of(trial, program), bounds), bounds)
    # removes residues of the linear programs on very short arcs
    start = program.nlp.restore(start, bounds)
    found = _polished(program, start.w, bounds)
    better = found.violation <= _FEASIBLE and found.objective < start.objective
    if start.violation <= _FEASIBLE and not better:
        found = start
    return Solved(trial, program, bounds, found) if found.violation <= _ACCEPTED else None


def _polished(program: Transcription, w: np.ndarray, bounds: Bounds) -> Solution:
    return program.nlp.restore(program.nlp.solve(w, bounds, _POLISH), bounds)


def arcs_of(trial: Trial, program: Transcription) -> Arcs:
    """Motion of a trial on a program's mesh with as many arcs, with linear velocities.

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
    """Loads of the spikes and power of the actuators, each (mass or link, place, arc)."""
    of, worm = trial.program, trial.program.task.worm
    mass, load = np.array(worm.masses), worm.load_range[1] + np.array(worm.beyond)
    rests = np.array([[i in resting for i in range(len(mass))] for resting in of.sequence])
    rests = np.repeat(rests, of.arcs, axis=0)[:, None]  # as below: (arc, place, mass)
    velocity = v[:, :1] + (v[:, 1:] - v[:, :1]) * tau[:, None]
    needed = mass * slopes[:, None] + worm.drag * velocity + load
    whole = needed.sum(axis=2, keepdims=True)
    forces = rests * (whole / rests.sum(axis=2, keepdims=True))
    pull = np.cumsum(forces - needed, axis=2)[:, :, :-1]
    return forces.T, np.maximum(pull * np.diff(velocity, axis=2), 0.0).T


def refined(found: list[Solved]) -> tuple[Solved, float]:
    """Raise the degree of some solutions, and that of the best until it is resolved.

    It is if halving every arc gains less than 1e-6. Also returns a first-order estimate of this
    relative gain; infinite if its linear program has no solution.
    """
    best = min((_raised(solved, 3) for solved in found), key=lambda s: s.objective)
    error = _left_by_halving(best)
    if error > _RESOLVED and (better := _raised(best, 5)) is not best:
        return better, _left_by_halving(better)
    return best, error


def _raised(solved: Solved, degree: int) -> Solved:
    """The solution with states of a higher degree, itself if that costs no less."""
    mesh = solved.program.mesh
    mesh = replace(mesh, collocation=Collocation(degree), input_degree=degree - 2)
    program, bounds, start = _carry(solved, mesh)
    found = _polished(program, start.w, bounds)
    if found.objective < solved.objective and found.violation <= _FEASIBLE:
        return replace(solved, program=program, bounds=bounds, solution=found)
    return solved


def _left_by_halving(solved: Solved) -> float:
    """Relative gain by halving every arc: the best step of the linear program.

    The error of an interior-point solver would be larger than the gain.
    """
    counts = tuple(2 * n for n in solved.program.mesh.counts)
    mesh = replace(solved.program.mesh, arcs=counts)
    program, bounds, start = _carry(solved, mesh)
    step = program.nlp.linear_step(start.w, bounds, np.full(start.w.shape, 1e-2))
    return np.inf if step is None else abs(step[1] / solved.objective)


def _carry(solved: Solved, mesh: Mesh) -> tuple[Transcription, Bounds, Solution]:
    fine = Transcription(solved.program.problem, mesh)
    bounds = _bounds(fine, solved.trial.sequence)
    w = fine.pack(on_finer_mesh(solved.arcs, solved.program.mesh, mesh), bounds)
    return fine, bounds, fine.nlp.start(w, bounds)


def gait_of_arcs(arcs: Arcs, mesh: Mesh, links: int) -> Gait:
    """Integrate link accelerations twice, arc by arc; arcs without duration are left out."""
    kept = np.flatnonzero(arcs.duration > SHORTEST * arcs.duration.sum())
    nodes, m = mesh.input_nodes, mesh.input_degree
    to_powers = np.linalg.inv(nodes[:, None] ** np.arange(m + 1)) @ np.linalg.inv(
        bernstein_matrix(nodes)
    )
    pieces = np.zeros((len(kept), links, m + 3))
    k, h = np.arange(m + 1), arcs.duration[kept, None, None]
    pieces[:, :, 0] = arcs.start[1 : links + 1, kept].T
    pieces[:, :, 1] = arcs.start[links + 2 :, kept].T
    power = arcs.inputs[:, :, kept].transpose(2, 0, 1) @ to_powers.T / h**k
    pieces[:, :, 2:] = power / ((k + 1) * (k + 2))
    return Gait(np.concatenate([[0.0], np.cumsum(arcs.duration[kept])]), pieces)
