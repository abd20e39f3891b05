"""The best field of a magneto-elastic pair over time, by optimal control and exact simulation.

The search starts from the motion in a harmonic field. Phases between switches are then exact, and
an exact simulation checks the result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from wormopt.simulation.simulate import simulate
from wormopt.systems.pair.driven_pair import (
    FieldAim,
    FieldLimits,
    Harmonic,
    Orbit,
    best_harmonic,
    from_origin,
    named,
    orbit_from,
    push_left,
    relative,
    settle,
)

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


def waveform_problem(pair: Model, limits: FieldLimits, aim: FieldAim) -> Problem:
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


def _limited(pair: Model, limits: FieldLimits) -> Model:
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


def check_strain(limits: FieldLimits, push: float, forward: float) -> None:
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


def first_field(given: Model, limits: FieldLimits, harmonic: Harmonic, report: Report) -> Harmonic:
    """The harmonic field, or a lower one if the strain leaves none that moves the pair."""
    if limits.strain is None or (harmonic.kept and harmonic.orbit.moves):
        return harmonic
    (low, high), nu = limits.field, harmonic.frequency
    lower = [
        replace(limits, field=(low, low + top * (high - low)), frequency=(nu, nu)) for top in _TOPS
    ]
    found = [best_harmonic(given, part, FieldAim(), report) for part in lower]
    kept = [lowered for lowered in found if lowered.kept]
    return max(kept, key=lambda lowered: lowered.orbit.speed, default=harmonic)


def guesses(
    free: Model, limits: FieldLimits, first: Harmonic, push: float, *, starts: int, seed: int
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


def _rests(limits: FieldLimits, first: Harmonic, push: float) -> SolveError:
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
