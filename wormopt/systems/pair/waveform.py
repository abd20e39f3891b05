"""The best field of a magneto-elastic pair over time, by optimal control and exact simulation.

The search starts from the motion in a cosine field, of which two parameters are optimised by exact
simulations of the periodic motion. Phases between switches are then exact, and an exact simulation
checks the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.optimise import Optimum, optimise_multistart
from wormopt.ocp.problem import Constraint, Ends, Problem, ramped
from wormopt.ocp.switching import optimise_switching_times
from wormopt.progress import Report
from wormopt.simulation.options import Exact
from wormopt.simulation.simulate import Values, simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.pair.tables import Aim, Limits

FADED = 0.5
"""Largest share of a small push that may remain."""

MOST_PERIODS = 1200
"""Periods after which the push must have decayed."""

# Size of the push, relative to the motion, its direction, and periods between two checks.
_PUSH, _DIRECTION, _LOOK = 1e-3, np.array([1.0, -0.7, 0.4]), 20
# Periods of the first block of a simulation, and of all blocks together; the last during a search.
_BLOCK, _MOST, _MOST_SOON = 20, 20_000, 5000
# Change over a block, relative to the motion, below which it counts as periodic.
_SETTLED = 1e-10
# Way of a mass in a period, relative to the stretch, above which it moves.
_MOVES = 1e-5
# A swing that exceeds the allowed strain by this factor does not return.
_LOST = 3.0
# Number of amplitudes, until a limit is met to this share; during a search the tolerance is larger.
_TRIALS, _MET, _SOON = 14, 1e-6, 1e-8
# Number of frequencies, then number of refinements and frequencies in each.
_FREQUENCIES, _ROUNDS, _NEARER = 9, 4, 4


@dataclass(frozen=True, eq=False)
class Orbit:
    """One period of a motion, from exact simulation."""

    start: np.ndarray  # (4,) positions and velocities; mass 0 is at 0
    speed: float  # advance over period
    strain: float  # largest |x_2 - x_1|
    work: float  # net work of the field
    drift: float  # largest change of stretch and velocities over the last block of periods
    periods: int  # simulated before
    motion: Trajectory  # the period

    @property
    def settled(self) -> bool:
        """Whether the motion has become periodic."""
        return self.drift <= _SETTLED

    @property
    def moves(self) -> bool:
        """Whether any mass moves by more than an orbit that dies out, or hardly slips, does."""
        dense = self.motion.dense
        assert dense is not None
        way = np.max(np.abs(dense(dense.time)[2:])) * self.motion.end_time
        return bool(way > _MOVES * self.strain)

    @property
    def work_per_distance(self) -> float | None:
        """Work over advance, None without advance."""
        advance = self.speed * self.motion.end_time
        return self.work / advance if advance > 1e-9 * self.strain else None


@dataclass(frozen=True, eq=False)
class Harmonic:
    """A field mean + amplitude cos(frequency t), and the motion of the pair in it."""

    frequency: float
    mean: float
    amplitude: float
    orbit: Orbit  # the motion
    reached: bool = True  # whether it has the required speed, if any
    kept: bool = True  # within the strain; if not, its mean alone exceeds it

    @property
    def course(self) -> Gait:
        """Field over one period."""
        breaks = np.array([0.0, 2 * math.pi / self.frequency])
        mean, wave = np.array([[[self.mean]]]), np.array([[self.amplitude]])
        return Gait(breaks, mean, np.array([self.frequency]), wave, 0 * wave)


def relative(state: np.ndarray) -> np.ndarray:
    """Stretch and velocities (3, ...), which are periodic, of states (4, ...)."""
    return np.array([state[1] - state[0], state[2], state[3]])


def from_origin(state: np.ndarray) -> np.ndarray:
    """The state (4,) shifted so that mass 0 is at 0."""
    return np.concatenate([state[:2] - state[0], state[2:]])


def named(state: np.ndarray) -> dict[str, np.ndarray]:
    """Positions and velocities of a state (4,) by name."""
    return {"position": state[:2], "velocity": state[2:]}


def orbit_from(
    plant: Model,
    period: float,
    start: np.ndarray,
    *,
    p: Values | None = None,
    drift: float = 0.0,
    periods: int = 0,
) -> Orbit:
    """Simulate one period of a driven `magnetic_pair` from `start` (4,), and measure it.

    `p`: parameters that differ from the model's; `drift`, `periods`: results of the previous
    blocks.
    """
    motion = simulate(plant, period, contact=Exact(), x0=named(start), p=p, dense=True)
    assert motion.dense is not None
    edges = motion.dense.time
    s, weights = np.polynomial.legendre.leggauss(8)
    spans = np.diff(edges)[:, None] / 2
    t = (edges[:-1, None] + spans * (s + 1)).ravel()
    power = motion.at(t).observe(plant["power"]).reshape(spans.size, -1)
    return Orbit(
        start,
        float(motion.end[0] - start[0]) / period,
        motion.largest(plant["stretch"]),
        float(np.sum(power * weights * spans)),
        drift,
        periods,
        motion,
    )


def settle(
    plant: Model,
    period: float,
    start: np.ndarray,
    *,
    p: Values | None = None,
    strain: float | None = None,
    soon: bool = False,
) -> Orbit:
    """Simulate a driven `magnetic_pair` until the ``drift`` of its orbit is small.

    `strain`: stop where the stretch is far beyond it; `soon`: use a larger tolerance.
    """
    total, block, drift = 0, _BLOCK, math.inf
    enough, most = (_SOON, _MOST_SOON) if soon else (_SETTLED, _MOST)
    while drift > enough and total < most:
        run = simulate(plant, block * period, contact=Exact(), x0=named(start), p=p, times=[])
        before, after = relative(start), relative(run.end)
        size = max(float(np.max(np.abs(after))), 1e-300)
        drift = float(np.max(np.abs(after - before))) / size
        start = from_origin(run.end)
        total, block = total + block, min(2 * block, most - total - block)
        if strain is not None and size > _LOST * strain:
            break
    return orbit_from(plant, period, start, p=p, drift=drift, periods=total)


def push_left(driven: Model, period: float, start: np.ndarray, size: float) -> float:
    """Perturb a periodic motion, and return the least share of the perturbation that remains.

    Ends once that is below `FADED`; `size`: of the motion's stretch and velocities.
    """
    push = _PUSH * size * _DIRECTION
    state, least = start + np.concatenate([[0.0], push]), math.inf
    for _ in range(MOST_PERIODS // _LOOK):
        state = simulate(driven, _LOOK * period, contact=Exact(), x0=named(state), times=[]).end
        left = np.linalg.norm(relative(state) - relative(start)) / np.linalg.norm(push)
        least = min(least, float(left))
        if least < FADED or left > 1 / _PUSH:
            break
    return least


def best_harmonic(pair: Model, limits: Limits, aim: Aim, report: Report) -> Harmonic:
    """Find the best harmonic field within the limits of a waveform.

    Mean: the middle of the range; amplitude: the largest allowed, or the smallest with the required
    speed; frequency: the best. Not ``kept``, with amplitude 0, if the mean alone, applied at rest,
    exceeds the strain.
    """
    least, most = limits.frequencies
    grid = np.linspace(least, most, 1 if least == most else _FREQUENCIES)
    found = [_at(pair, limits, aim, float(nu)) for nu in grid]
    if least < most:
        step = (most - least) / (_FREQUENCIES - 1)
        for k in range(_ROUNDS):
            report("the best harmonic field", k / _ROUNDS)
            best = max(found, key=lambda h: _merit(h, aim))
            near = best.frequency + step * np.linspace(-1, 1, _NEARER + 2)[1:-1]
            step *= 2 / (_NEARER + 1)
            found += [_at(pair, limits, aim, float(nu)) for nu in near if least <= nu <= most]
    best = max(found, key=lambda h: _merit(h, aim))
    p = {"frequency": best.frequency, "cosines": [best.mean, best.amplitude]}
    last = settle(pair, best.course.period, best.orbit.start, p=p)
    return replace(best, orbit=replace(last, periods=last.periods + best.orbit.periods))


def _at(pair: Model, limits: Limits, aim: Aim, frequency: float) -> Harmonic:
    """The best amplitude at one frequency."""
    low, high = limits.field
    mean, whole = (low + high) / 2, (high - low) / 2
    if limits.slope is not None:
        whole = min(whole, limits.slope / frequency)

    def moved(amplitude: float) -> Harmonic:
        p = {"frequency": frequency, "cosines": [mean, amplitude]}
        period, strain = 2 * math.pi / frequency, limits.strain
        orbit = settle(pair, period, np.zeros(4), p=p, strain=strain, soon=True)
        fast = aim.speed is None or orbit.speed >= aim.speed
        return Harmonic(frequency, mean, amplitude, orbit, fast)

    def too_wide(harmonic: Harmonic) -> float:
        if limits.strain is None:
            return -1.0
        excess = harmonic.orbit.strain / limits.strain - 1
        return excess if harmonic.orbit.drift <= _SOON else max(excess, 1.0)

    def too_slow(harmonic: Harmonic) -> float:
        return 1 - harmonic.orbit.speed / (aim.speed or math.inf)

    best = moved(whole)
    if too_wide(best) > 0:
        still = moved(0.0)
        if too_wide(still) > 0:
            return replace(still, reached=False, kept=False)
        best = _edge(moved, too_wide, still, best)
    if aim.maximise or not best.reached:
        return best
    return _edge(moved, too_slow, best, moved(0.0))


def _edge(
    moved: Callable[[float], Harmonic],
    excess: Callable[[Harmonic], float],
    holds: Harmonic,
    fails: Harmonic,
) -> Harmonic:
    """Amplitude at which a limit is just kept, by false position between kept and exceeded."""
    kept, inside, outside, before = excess(holds), excess(holds), excess(fails), 0
    for _ in range(_TRIALS):
        if kept >= -_MET:
            break
        share = float(np.clip(inside / (inside - outside), 0.02, 0.98))
        middle = moved(holds.amplitude + share * (fails.amplitude - holds.amplitude))
        found = excess(middle)
        side = 1 if found > 0 else -1
        if side > 0:
            fails, outside = middle, found
        else:
            holds, kept, inside = middle, found, found
        if side == before:  # an end that stays for long would slow the search down
            inside, outside = (inside / 2, outside) if side > 0 else (inside, outside / 2)
        before = side
    return holds


def _merit(harmonic: Harmonic, aim: Aim) -> float:
    if not harmonic.kept:
        return -math.inf
    if aim.maximise:
        return harmonic.orbit.speed
    work = harmonic.orbit.work_per_distance
    return -work if harmonic.reached and work is not None else harmonic.orbit.speed - 1e9


PERIODS = 20
"""Periods of the simulation that checks the speed."""
# Number of harmonics of random fields, and of their corners as polylines.
_HARMONICS, _CORNERS = 3, 96
# Widths of the smoothed law, in usual velocities. The masses reverse more often than they rest, and
# a steep law shows the reversals with a third of the iterations of complementarity.
_WIDTHS = (0.6, 0.01, 0.3)
_RELAXED = Complementarity(residual=1e-4, first=1.0)
# State polynomials between switches.
_EXACT = Collocation(7)
_REST = "the pair rests in the harmonic field, so there is no motion to start from"
# Tops of fields lower than the harmonic one, as shares of the range, and number of random fields
# that are tried before a pair counts as resting.
_TOPS, _OTHERS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1), 4


# -- the problem -----------------------------------------------------------------------------------


def waveform_problem(pair: Model, limits: Limits, aim: Aim) -> Problem:
    """State the periodic motion of a pair in the best field, with mass 0 at 0 at the start.

    Velocities repeat, positions repeat up to the advance. Net work of the field: friction's loss.
    The phase is free; with a slope limit the field is a state and its rate the input.
    """
    plant = _limited(pair, limits)
    ends = Ends.of(plant, 1)
    advance = ends.end[0] - ends.start[0]
    speed = advance / ends.duration
    at_ends = [Constraint("start", ends.start[0], 0.0, 0.0, plant.x[0].nominal)]
    if aim.speed is not None:
        at_ends.append(Constraint("objective.speed", speed, aim.speed, nominal=plant.x[1].nominal))
    along = []
    if limits.strain is not None:
        stretch, most = plant["stretch"], limits.strain
        along.append(Constraint("limits.strain", stretch, -most, most, nominal=most))
    least = (aim.speed or 0.0) / 2  # keeps the quotient finite during the search
    work = ends.integrals[0] / (ends.duration * ca.fmax(speed, least))
    return Problem(
        model=plant,
        ends=ends,
        minimise=-speed if aim.maximise else work,
        duration=limits.period,
        periodic=[signal.name for signal in plant.x if signal.name != "position"],
        displaced=["position"],
        integrands=plant["power"],
        path_constraints=along,
        boundary_constraints=at_ends,
    )


def _limited(pair: Model, limits: Limits) -> Model:
    """Pair whose field keeps to its limits, including its slope."""
    if [signal.name for signal in pair.u] != ["field"]:
        raise ArgumentError(f"{pair.name} has no input field; build it with cosines=None")
    least, most = limits.field
    size = max(abs(least), abs(most))
    field = replace(pair.u[0], lower=least, upper=most, nominal=size, value=(least + most) / 2)
    plant = replace(pair, u=[field])
    return plant if limits.slope is None else ramped(plant, limits.slope)


# -- courses of the field --------------------------------------------------------------------------


def field_course(motion: Motion) -> Gait:
    """The field over one period as piecewise polynomials of time, one row, for `drive`.

    A field with a slope limit is its rate integrated exactly, piece after piece.
    """
    course = motion.input_course()
    if motion.program.problem.model.u[0].name == "field":
        return course
    rates = course.polynomial[:, 0, :]
    rising = rates / np.arange(1, rates.shape[1] + 1)
    spans = np.diff(course.breaks)
    gained = np.sum(rising * spans[:, None] ** np.arange(1, rates.shape[1] + 1), axis=1)
    first = float(motion.state("field", np.zeros(1))[0, 0])
    levels = first + np.concatenate([[0.0], np.cumsum(gained)[:-1]])
    return Gait(course.breaks, np.column_stack([levels, rising])[:, None, :])


def chance_field(
    limits: tuple[float, float], frequency: float, random: np.random.Generator
) -> Gait:
    """Random periodic field of some harmonics, clipped to its range: a polyline in one row.

    `limits`: least and largest G; `frequency`: angular.
    """
    low, high = limits
    t = np.linspace(0, 2 * math.pi / frequency, _CORNERS + 1)
    wave = sum(
        random.normal() * np.cos(k * frequency * t - random.uniform(0, 2 * math.pi))
        for k in range(1, _HARMONICS + 1)
    )
    level = np.clip((low + high) / 2 + (high - low) / 2 * wave, low, high)
    slopes = np.diff(level) / np.diff(t)
    return Gait(t, np.column_stack([level[:-1], slopes])[:, None, :])


def first_harmonic(field: Gait) -> tuple[float, float]:
    """Amplitude g_1 and phase phi of a waveform's first harmonic, g_1 cos(2 pi t / T - phi)."""
    s, weights = np.polynomial.legendre.leggauss(24)
    total, turn = 0.0 + 0.0j, 2 * np.pi / field.period
    for piece, (begin, end) in enumerate(zip(field.breaks[:-1], field.breaks[1:], strict=True)):
        at = (end - begin) * (s + 1) / 2
        wave = np.exp(1j * turn * (begin + at))
        total += np.sum(weights * field.on_piece(piece, at)[0] * wave) * (end - begin) / 2
    found = 2 * total / field.period
    return float(abs(found)), float(np.angle(found))


# -- where to start --------------------------------------------------------------------------------


def check_strain(limits: Limits, push: float, forward: float) -> None:
    """Refuse a strain at which the link cannot pull mass 0, of friction `forward`, forward.

    The pull must exceed the friction of mass 0 plus the field that pushes it back, since otherwise
    mass 0 never gains forward speed. Raises SolveError; friction is over the push.
    """
    strain, least = limits.strain, push * (limits.field[0] + forward)
    if strain is not None and strain <= least:
        raise SolveError(
            f"limits.strain {strain:.6g} allows no motion: the link pulls mass 0 forward, against "
            f"friction and the least field, only at strains above {least:.6g}",
            f"write limits.strain above {least:.6g}, or weaker friction forward",
        )


def first_field(given: Model, limits: Limits, harmonic: Harmonic, report: Report) -> Harmonic:
    """The harmonic field, or a lower one if the strain leaves none that moves the pair."""
    if limits.strain is None or (harmonic.kept and harmonic.orbit.moves):
        return harmonic
    (low, high), nu = limits.field, harmonic.frequency
    lower = [limits.vary(field=(low, low + top * (high - low)), frequency=nu) for top in _TOPS]
    found = [best_harmonic(given, part, Aim(maximise="speed"), report) for part in lower]
    kept = [lowered for lowered in found if lowered.kept]
    return max(kept, key=lambda lowered: lowered.orbit.speed, default=harmonic)


def guesses(
    free: Model, limits: Limits, first: Harmonic, push: float, *, starts: int, seed: int
) -> list[Guess]:
    """The periodic motion in a harmonic field, then those in random fields.

    `free`: the pair with the field as its input. Raises SolveError if it always rests.
    """
    (low, high), found = limits.field, []
    lowered = (low, min(high, 2 * first.mean - low))
    for k in range(starts if first.orbit.moves else max(starts, 1 + _OTHERS)):
        random = np.random.default_rng([seed, k])
        course = chance_field(lowered, first.frequency, random) if k else first.course
        driven = drive(free, course, periodic=True)
        orbit = settle(driven, course.period, first.orbit.start, strain=limits.strain)
        if orbit.moves:
            found.append(_guess(orbit, course, steep=limits.slope is not None))
    if not found:
        raise _rests(limits, first, push)
    return found


def _guess(orbit: Orbit, course: Gait, *, steep: bool) -> Guess:
    dense = orbit.motion.dense
    assert dense is not None

    def states(t: np.ndarray) -> np.ndarray:
        return np.vstack([dense(t), course(t)]) if steep else dense(t)

    return Guess(course.period, states, lambda t: course(t, int(steep)))


def _rests(limits: Limits, first: Harmonic, push: float) -> SolveError:
    """Reason why the pair rests: the strain, if it limits the harmonic field, or friction."""
    (low, high), strain = limits.field, limits.strain
    whole = min((high - low) / 2, (limits.slope or math.inf) / first.frequency)
    if strain is None or first.amplitude >= whole:
        return SolveError(_REST, "write weaker friction, or a wider limits.field")
    return SolveError(
        f"no field that was tried moves the pair within limits.strain {strain:.6g}; the steady "
        f"field {(low + high) / 2:.6g} alone stretches it by about {push * (low + high) / 2:.6g}",
        "write a larger limits.strain, or weaker friction",
    )


# -- solving ---------------------------------------------------------------------------------------


def scaled(pair: Model, harmonic: Harmonic) -> Model:
    """Pair with the sizes of motions in the harmonic field."""
    orbit = harmonic.orbit
    velocity = max(orbit.strain * harmonic.frequency / 2, 1e-12)
    sizes = {"position": max(orbit.strain / 2, 1e-12), "velocity": velocity}
    return replace(
        pair,
        x=[replace(signal, nominal=sizes[signal.name]) for signal in pair.x],
        contacts=[replace(contact, nominal_speed=velocity) for contact in pair.contacts],
    )


def best_field(
    problem: Problem, mesh: Mesh, starts: Sequence[Guess], tolerance: float, report: Report
) -> tuple[dict[str, Optimum], tuple[float, ...]]:
    """Solve with steep friction first, and with complementary contact where its phases fail.

    Returns both solves, that with exact phases last, and the results of the starts. `tolerance`:
    local error. Raises SolveError if neither leads to a solution.
    """
    speed = problem.model.contacts[0].nominal_speed
    first, last, ratio = _WIDTHS
    steep = Regularised(last * speed, first * speed, ratio)
    lost: SolveError | None = None
    for name, treatment in (("smooth", steep), ("complementarity", _RELAXED)):
        try:
            relaxed, tries = optimise_multistart(problem, mesh, treatment, starts, report=report)
            report("polishing", 0.6)
            exact = optimise_switching_times(
                relaxed, collocation=_EXACT, tolerance=tolerance, report=report
            )
        except SolveError as error:
            lost = lost or error
            if error.code == "infeasible":
                break
            continue
        return {name: relaxed, "phases": exact}, tries
    assert lost is not None
    raise lost


# -- exact simulation ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Proof:
    """Results of the exact simulation of a waveform."""

    orbit: Orbit  # its last period
    speed: float  # over all periods simulated
    left: float  # share of a push left, the least over blocks simulated


def prove(free: Model, motion: Motion, report: Report) -> Proof:
    """Simulate the waveform over many periods, from the optimal start and a perturbed one."""
    report("simulating the field found", 0.95)
    course = field_course(motion)
    driven, period = drive(free, course, periodic=True), course.period
    start = motion.states(np.zeros(1))[:4, 0]
    run = simulate(driven, PERIODS * period, contact=Exact(), x0=named(start), times=[])
    speed = float(run.end[0] - start[0]) / (PERIODS * period)
    size = float(np.max(np.abs(relative(motion.states(np.linspace(0, motion.duration, 200))))))
    drift = float(np.max(np.abs(relative(run.end) - relative(start)))) / size
    orbit = orbit_from(driven, period, from_origin(run.end), drift=drift, periods=PERIODS)
    return Proof(orbit, speed, push_left(driven, period, start, size))
