"""Search for the best crawl of a chain: starts, a coarse solve of each, and sharper ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.numerics.workers import each
from wormopt.ocp.contact import Complementarity, Regularised, SwitchDetection
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Curve, Guess, Motion
from wormopt.ocp.nlp import Bounds, Ipopt, Solution
from wormopt.ocp.optimise import Contacts, Optimum, optimise
from wormopt.ocp.switching import optimise_switching_times, structure_of
from wormopt.ocp.transcription import Transcription
from wormopt.progress import Report, silent
from wormopt.study.types import per
from wormopt.systems.chain.crawl_study import USUAL_SIZES, CrawlStudy
from wormopt.systems.chain.dynamic import sine_guess
from wormopt.systems.chain.loops import laws_of
from wormopt.systems.spiked import GaitProblem, Limits, Objective, Search, Worm, designed

# Samples of a motion that determine its size and its score.
_SAMPLES = 512
# Arcs of the first solves, and their relaxations of contact.
_COARSE, _RELAXED = 20, Complementarity(1e-2, first=1.0, ratio=0.03)
_FEW = Ipopt(tolerance=1e-8, iterations=250)
# Relaxations that find switches, and shortest and longest arcs as shares of the mean one.
_DETECTED, _SPANS = SwitchDetection(1e-4, first=0.1, ratio=0.03), (0.2, 4.0)
_FINE = Complementarity(1e-3, first=1e-2)
_LAST = Ipopt(tolerance=1e-8, mu_init=1e-3, iterations=150)
_HALVED = SwitchDetection(1e-4, first=1e-3, ratio=0.1)
# Largest local error of an arc, in usual sizes of the states, that is not halved.
_ROUGH = 3e-3
_NEARBY = Ipopt(tolerance=1e-8, mu_init=1e-2, iterations=300)
# Grids begin at a sharp optimum, not far from their own.
_CLOSE = Ipopt(mu_init=1e-4)
# State polynomials between switches, and the solver of phases: a wrong reading is left soon.
_PHASE, _POLISH = Collocation(7), Ipopt(tolerance=1e-10, mu_init=1e-4, iterations=80)
# Coarse optima whose objectives differ by a smaller share are the same one.
_ALIKE = 1e-3
# Arcs that a phase has at least, on average: the reading of more phases seldom leads to a motion.
_ARCS_A_PHASE = 1.5
# Exact optima worse by more than this share than that of the switches have other phases.
_MISREAD = 1e-3
# Relaxation that is small against the error of a grid.
_TIGHT = Complementarity(1e-5, first=1e-2, ratio=0.03)
# Forces of waves as shares of the largest: the first two, and all if actuators are stronger than
# needed.
_SHARES = (1.0, 0.3, 0.1, 0.03, 0.01)
# Durations of cycles that are simulated at least and at most, each half the one before.
_LEAST, _MOST = 7, 16
# Largest changes of the duration of a cycle in a coarse and in a sharp solve.
_WIDE, _NARROW = 4.0, 2.0


# -- optima between processes ----------------------------------------------------------------------


@dataclass(frozen=True)
class Solved:
    """An optimum without its program, which other processes cannot be sent."""

    speed: float  # usual size of velocities in the program
    duration: tuple[float, float]
    mesh: Mesh
    treatment: Contacts
    solution: Solution
    bounds: Bounds
    levels: tuple[Solution, ...]
    build_s: float

    def optimum(self, study: CrawlStudy) -> Optimum:
        """Return the optimum with its program."""
        problem = replace(study.problem(self.speed), duration=self.duration)
        program = Transcription(problem, self.mesh, self.treatment)
        motion = Motion.of(program, self.solution.w, self.bounds)
        return Optimum(
            motion, self.solution, self.levels, self.treatment, self.build_s, self.bounds
        )

    @property
    def objective(self) -> float:
        """Minimised value."""
        return self.solution.objective


def _sent(found: Optimum) -> Solved:
    problem, mesh = found.motion.program.problem, found.motion.mesh
    return Solved(
        problem.model.contacts[0].nominal_speed,
        problem.duration,
        mesh,
        found.treatment,
        found.solution,
        found.bounds,
        found.levels,
        found.build_s,
    )


# -- starts ----------------------------------------------------------------------------------------


class Start(Protocol):
    """Recipe of a first guess."""

    def guess(self, study: CrawlStudy) -> Guess:
        """Make the guess; SolveError if this is impossible."""
        ...


@dataclass(frozen=True)
class Wave:
    """Forces that are sines of one frequency, with a phase for each link."""

    duration: float
    force: float
    phase: tuple[float, ...]

    def guess(self, study: CrawlStudy) -> Guess:
        """Return the last of several simulated cycles."""
        phase = np.array(self.phase)
        return sine_guess(study.plant, self.duration, self.force, phase, len(study.draws))


@dataclass(frozen=True)
class Earlier:
    """The crawl of an earlier result."""

    time: np.ndarray  # (m,)
    states: np.ndarray  # (n_x, m)
    inputs: np.ndarray  # (n_u, m)
    forces: np.ndarray  # (contacts, m)

    def guess(self, study: CrawlStudy) -> Guess:
        """Interpolate it."""
        states, inputs, forces = (
            polyline(self.time, rows) for rows in (self.states, self.inputs, self.forces)
        )
        return Guess(float(self.time[-1]), states, inputs, forces)


@dataclass(frozen=True)
class Smoothed:
    """Optimum with smoothed friction from another start."""

    start: Start

    def guess(self, study: CrawlStudy) -> Guess:
        """Return the smooth optimum."""
        near = self.start.guess(study)
        speed = study.sized(speed_of(study, near)).x[1].nominal
        widths = Regularised(0.1 * speed, speed)
        return _coarse(study, near, widths).motion.guess


@dataclass(frozen=True)
class Spiked:
    """The fastest gait of a worm with spikes, whose resting masses do not slide back."""

    duration: float

    def guess(self, study: CrawlStudy) -> Guess:
        """Return the designed motion with the actuator forces that it needs."""
        worm, limits, links = study.worm, study.limits, study.worm.links
        masses = np.array(per(worm.mass, links + 1))
        needed = study.needed(2 * math.pi * study.reach / self.duration)
        force = np.minimum(per(limits.actuator_force, links), needed)
        rest = np.array(per(worm.rest_length, links))
        ranges = limits.length_ranges(links) or tuple((0.7 * r, 1.3 * r) for r in rest.tolist())
        ranges = tuple((low, min(high, low + 4 * study.reach)) for low, high in ranges)
        swing = np.array([high - low for low, high in ranges])
        fast, strong = 2 * swing / self.duration, force / masses.mean()
        most = per(limits.acceleration or strong.tolist(), links)
        rate = per(limits.rate or fast.tolist(), links)
        most = tuple(np.minimum(most, USUAL_SIZES * strong).tolist())
        rate = tuple(np.minimum(rate, USUAL_SIZES * fast).tolist())
        ahead = [max(0.0, -float(law.slip_force(1.0, 1))) for law in laws_of(worm)]
        load, least = np.array(per(worm.pull, links + 1)) + ahead, 1e-9 * float(force.max())
        problem = GaitProblem(
            Worm(links, mass=float(masses.mean()), load=max(float(load.mean()), least)),
            Limits(period=self.duration, length=ranges, rate=rate, acceleration=most),
            Objective(),
        )
        motion = designed(problem, Search(effort="quick", workers=1), silent).motion
        t, v, length = motion.time, motion["velocity"], motion["length"]
        stiffness = np.array(per(worm.stiffness, links))[:, None]
        damping = np.array(per(worm.damping, links))[:, None]
        u = stiffness * (length - rest[:, None]) + damping * motion["rate"]
        u = np.clip(u - motion["actuator_force"], -force[:, None], force[:, None])
        tail = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[-1, 1:] + v[-1, :-1]) / 2)])
        above = np.vstack([np.cumsum(length[::-1], axis=0)[::-1], np.zeros_like(t)])
        return Guess(float(t[-1]), polyline(t, np.vstack([above + tail, v])), polyline(t, u))


def polyline(t: np.ndarray, rows: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Interpolate rows of samples linearly."""
    return lambda at: np.array([np.interp(at, t, row) for row in rows])


def speed_of(study: CrawlStudy, near: Guess) -> float:
    """Root mean square of the velocities of a motion."""
    masses = study.worm.links + 1
    states = near.states(np.linspace(0.0, near.duration, _SAMPLES))
    return float(np.sqrt(np.mean(states[masses : 2 * masses] ** 2)))


def starts(study: CrawlStudy, earlier: Earlier | None) -> list[Start]:
    """Return the best waves, a designed spiked gait, a smooth optimum, and random waves."""
    ways: list[Start] = [] if earlier is None else [earlier]
    waves = _waves(study)
    ways.append(waves[0])
    if study.single_chain:
        ways += [Smoothed(waves[0]), Spiked(waves[0].duration)]
    ways += waves[1:]
    random = np.random.default_rng(study.search.seed)
    while len(ways) < study.search.starts:
        near = waves[len(ways) % 2]
        phase = random.uniform(0, 2 * np.pi, study.worm.links)
        duration, share = near.duration * random.uniform(0.6, 1.6), random.uniform(0.3, 1.0)
        ways.append(Wave(duration, share * near.force, tuple(phase.tolist())))
    return ways[: study.search.starts]


def _waves(study: CrawlStudy) -> list[Wave]:
    """Simulate waves of several durations, strengths and phases; the best two, unlike ones."""
    links, most = study.worm.links, min(per(study.limits.actuator_force, study.worm.links))
    along = 2 * np.pi / (links + 1) * np.arange(links)
    scored: list[tuple[float, Wave]] = []

    def tried(duration: float, force: float, phase: np.ndarray) -> float:
        duration = float(np.clip(duration, *study.limits.durations_near(duration, 1.0)))
        wave = Wave(duration, force, tuple(phase.tolist()))
        scored.append((_score(study, wave), wave))
        return scored[-1][0]

    def forces(duration: float) -> Iterator[float]:
        needed = study.needed(2 * np.pi * study.reach / duration)
        shares = _SHARES[:2] if most <= needed else _SHARES
        return (share * min(most, needed) for share in shares)

    duration, best = study.limits.period_range[1], -math.inf
    for k in range(_MOST):
        score = max(tried(duration, force, along) for force in forces(duration))
        if k >= _LEAST and score < best:
            break
        best, duration = max(best, score), duration / 2
    best_of_all = max(scored, key=lambda one: one[0])[1]
    for scale in (0.7, 1.0, 1.4):
        for phase in (along, -along, np.pi * np.arange(links)):
            tried(scale * best_of_all.duration, best_of_all.force, phase)
    ranked = [wave for _, wave in sorted(scored, key=lambda one: -one[0])]
    first = ranked[0]
    unlike = (first.duration / 2, first.duration * 2)
    others = (w for w in ranked if w.phase != first.phase or not unlike[0] < w.duration < unlike[1])
    return [first, next(others, first)]


def _score(study: CrawlStudy, wave: Wave) -> float:
    """Objective of a wave, larger is better, less what exceeds the limits of lengths."""
    try:
        near = wave.guess(study)
    except SolveError:
        return -math.inf
    masses, aim = study.worm.links + 1, study.objective
    t = np.linspace(0.0, near.duration, _SAMPLES)
    x = near.states(t)
    if not np.all(np.isfinite(x)):
        return -math.inf
    speed = float(x[0, -1] - x[0, 0]) / near.duration
    size = float(np.sqrt(np.mean(x[masses : 2 * masses] ** 2)))
    score = speed - aim.effort * study.worm.links * wave.force**2 / 2
    if aim.speed is not None:
        score = min(speed, aim.speed)
    if (ranges := study.limits.length_ranges(study.worm.links)) is not None:
        low, high = np.array(ranges).T
        length = x[: masses - 1] - x[1:masses]
        over = np.maximum(low - length.min(axis=1), length.max(axis=1) - high) / (high - low)
        score -= size * float(np.maximum(over, 0.0).max())
    return score


# -- solving ---------------------------------------------------------------------------------------


def _solved(
    study: CrawlStudy,
    near: Guess,
    mesh: Mesh,
    treatment: Contacts,
    solver: Ipopt,
    ratio: float,
    *,
    explain: bool = False,
) -> Optimum:
    """Solve near a motion, with a cycle of a duration at most a ratio from its own."""
    duration = (near.duration, near.duration)
    if ratio > 1.0:
        duration = study.limits.durations_near(near.duration, ratio)
    problem = replace(study.problem(speed_of(study, near)), duration=duration)
    return optimise(problem, mesh, treatment, near, solver=solver, explain=explain)


def _coarse(
    study: CrawlStudy, near: Guess, treatment: Contacts = _RELAXED, *, explain: bool = False
) -> Optimum:
    arcs = min(_COARSE, study.mesh.arcs)
    mesh = Mesh.even(1, arcs, Collocation(2, "radau"))
    return _solved(study, near, mesh, treatment, _FEW, _WIDE, explain=explain)


def _whole(found: Optimum) -> Guess:
    """The motion of an optimum without its phases."""
    return replace(found.motion.guess, phases=None)


def coarse(study: CrawlStudy, start: Start) -> Solved | None:
    """Solve with relaxed contact on a coarse mesh; None if this fails."""
    return _found(lambda: _coarse(study, start.guess(study)))


def _found(solve: Callable[[], Optimum]) -> Solved | None:
    """Send an optimum; None if there is no solution."""
    try:
        return _sent(solve())
    except SolveError:
        return None


def _stretched(near: Guess, duration: float) -> Guess:
    """The same motion over another duration."""
    scale = near.duration / duration

    def over(curve: Curve) -> Curve:
        return lambda t: curve(t * scale)

    return replace(
        near,
        duration=duration,
        states=over(near.states),
        inputs=near.inputs and over(near.inputs),
        forces=near.forces and over(near.forces),
    )


def _sharp(
    study: CrawlStudy,
    near: Guess,
    arcs: int,
    duration: float | None = None,
    treatment: SwitchDetection = _DETECTED,
) -> Optimum:
    """Let arcs end where contacts switch; with a duration, a cycle of that one."""
    mesh = Mesh(
        arcs,
        1,
        Collocation(study.mesh.degree, study.mesh.scheme),
        max(0, study.mesh.degree - 2),
        spans=(_SPANS[0] * near.duration / arcs, _SPANS[1] * near.duration / arcs),
    )
    if duration is not None:
        near = _stretched(near, duration)
    ratio = _NARROW if duration is None else 1.0
    solver = _NEARBY if treatment is _DETECTED else _LAST
    return _solved(study, near, mesh, treatment, solver, ratio)


def sharp(study: CrawlStudy, first: Solved) -> Solved | None:
    """Sharpen a coarse optimum; None if this fails."""
    return _found(lambda: _sharp(study, _whole(first.optimum(study)), study.mesh.arcs))


def polished(study: CrawlStudy, found: Solved, report: Report) -> Solved | None:
    """Solve with the phases that the switches show, exactly; None if this fails."""
    detected = found.optimum(study)
    phases = structure_of(detected.motion, speed=None).durations
    if len(phases) > study.mesh.arcs / _ARCS_A_PHASE:
        return None
    return _found(
        lambda: optimise_switching_times(
            detected,
            collocation=_PHASE,
            tolerance=study.mesh.tolerance,
            solver=_POLISH,
            report=report,
        )
    )


def _halved(study: CrawlStudy, found: Solved, report: Report) -> Solved | None:
    """Solve with arcs halved; None if this fails."""
    motion = found.optimum(study).motion
    halves = np.repeat(motion.arcs.duration / 2, 2)
    report(f"solving with {len(halves)} arcs", None)
    near = replace(motion.guess, phases=halves)
    fixed = found.duration[0] == found.duration[1]
    duration = motion.duration if fixed else None
    return _found(lambda: _sharp(study, near, len(halves), duration, _HALVED))


def search(
    study: CrawlStudy, earlier: Earlier | None, report: Report
) -> tuple[dict[str, Solved], list[float]]:
    """Solve from all starts; the optima of each stage, and the coarse objectives of all starts."""
    report("simulating waves", None)
    first = starts(study, earlier)
    found: list[Solved | None] = [None] * len(first)
    for k, one in each(partial(coarse, study), first, report, "starts"):
        found[k] = one
    objectives = [math.nan if one is None else one.objective for one in found]
    ranked = sorted((one for one in found if one is not None), key=lambda one: one.objective)
    if not ranked:
        ranked = [_sent(_coarse(study, first[0].guess(study), explain=True))]
    if not study.single_chain:
        near = ranked[0].optimum(study).motion.guess
        mesh = Mesh.even(1, study.mesh.arcs, Collocation(study.mesh.degree, study.mesh.scheme))
        fine = _solved(study, near, mesh, _FINE, _NEARBY, _NARROW)
        return {"complementarity": _sent(fine)}, objectives
    begun, best = _sharpest(study, ranked, report)
    if study.limits.tick is not None:
        best = _ticked(study, best)
    stages = {"complementarity": begun, "switches": best}
    exact = polished(study, best, report)
    if exact is not None and exact.objective <= best.objective + _MISREAD * abs(best.objective):
        return stages | {"phases": exact}, objectives
    rough = float(best.optimum(study).defects.max()) > _ROUGH
    if rough and (finer := _halved(study, best, report)) is not None:
        stages["halves"] = finer
    return stages, objectives


def _sharpest(study: CrawlStudy, ranked: Sequence[Solved], report: Report) -> tuple[Solved, Solved]:
    """Sharpen the best optima, or the next ones if this fails; the best, coarse and sharp."""
    best: tuple[Solved, Solved] | None = None
    for pair in _hopeful(ranked):
        for k, one in each(partial(sharp, study), pair, report, "switches"):
            if one is not None and (best is None or one.objective < best[1].objective):
                best = pair[k], one
        if best is not None:
            break
    if best is None:
        near = _whole(ranked[0].optimum(study))
        return ranked[0], _sent(_sharp(study, near, study.mesh.arcs))
    return best


def _ticked(study: CrawlStudy, best: Solved) -> Solved:
    """Solve again with cycles of whole ticks next to the best one; the better of the two."""
    limits, guess = study.limits.ticked, best.optimum(study).motion.guess
    durations = [limits.whole_ticks(k) for k in limits.ticks_of(guess.duration)]
    found = [_sent(_sharp(study, guess, study.mesh.arcs, one)) for one in durations]
    return min(found, key=lambda one: one.objective)


def _hopeful(ranked: Sequence[Solved]) -> Iterator[Sequence[Solved]]:
    """Yield unlike optima two by two, the best first."""
    unlike: list[Solved] = []
    for one in ranked:
        apart = (abs(one.objective - other.objective) for other in unlike)
        if all(gap > _ALIKE * abs(one.objective) for gap in apart):
            unlike.append(one)
    for k in range(0, len(unlike), 2):
        yield unlike[k : k + 2]


# -- convergence of relaxed contact ----------------------------------------------------------------


def converging(study: CrawlStudy, near: Solved, report: Report) -> Iterator[Solved]:
    """Solve with smoothed friction of several widths, then on finer grids; yields both in order."""
    arcs = study.mesh.arcs
    jobs: list[tuple[int, Contacts]] = [(5 * arcs, _narrower(near.speed))]
    jobs += [(round(n * arcs), _TIGHT) for n in (5, 2.5, 1.25, 0.625)]
    found = dict(each(partial(_from_sharp, study, near), jobs, report, "convergence"))
    yield found[0]
    yield from (found[k] for k in (4, 3, 2, 1))


def _narrower(speed: float) -> Regularised:
    return Regularised(v_reg=0.4**6 * speed, first=speed, ratio=0.4)


def _from_sharp(study: CrawlStudy, near: Solved, job: tuple[int, Contacts]) -> Solved:
    """Solve on a grid with a treatment of contact, from a sharp optimum."""
    arcs, treatment = job
    degree = 3 if isinstance(treatment, Regularised) else 2
    mesh = Mesh.even(1, arcs, Collocation(degree, "radau"))
    return _sent(_solved(study, _whole(near.optimum(study)), mesh, treatment, _CLOSE, _NARROW))
