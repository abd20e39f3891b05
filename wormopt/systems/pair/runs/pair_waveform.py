"""Scenes of kind ``pair-waveform``: the field that moves a magneto-elastic pair best."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.control.drive import drive
from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementary, Smoothed
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.optimise import Optimum, best_of
from wormopt.ocp.polish import polish
from wormopt.ocp.problem import Problem
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.options import Exact
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.runs.chains import law_of
from wormopt.systems.pair.magnetic_pair import magnetic_pair
from wormopt.systems.pair.runs.driven_pair import (
    FADED,
    MOST_PERIODS,
    Harmonic,
    Orbit,
    best_harmonic,
    orbit_from,
    push_left,
    relative,
    settle,
)
from wormopt.systems.pair.scenes.pair_waveform import DrivenPairTable, PairWaveformScene
from wormopt.systems.pair.waveform import (
    FieldAim,
    FieldLimits,
    chance_field,
    field_course,
    first_harmonic,
    waveform_problem,
)
from wormopt.systems.shared.optimum import (
    ACCEPTED,
    conclude,
    recheck,
    refused,
    sample_motion,
    warnings_of_optimum,
    warnings_of_reading,
)
from wormopt.systems.shared.signals import Kind, symbol

_SIGNALS: dict[str, Kind] = {
    "position": ("length", ("mass",), "position of the mass"),
    "velocity": ("speed", ("mass",), "velocity of the mass"),
    "contact_force": ("force", ("mass",), "force of the ground"),
    "stretch": ("length", (), "stretch x_2 - x_1"),
    "field": ("share", (), "field G"),
}
# Widths of the smoothed law, in usual velocities: the masses turn more often than they rest, and a
# steep law shows the turns with a third of the iterations that complementarity takes.
_WIDTHS = (0.6, 0.01, 0.3)
_RELAXED = Complementary(residual=1e-4, first=1.0)
# State polynomials between switches.
_EXACT = Collocation(7)
# Periods of the simulation by which the speed is checked.
_PERIODS = 20
_REST = "the pair rests under the harmonic field, so that there is no motion to start from"
# Tops of fields lower than the harmonic one, as shares of the range, and fields by chance that are
# tried before a pair is said to rest.
_TOPS, _OTHERS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1), 4
# Strain from which on the model of the link says nothing any more.
_WIDE = 1.0


@dataclass(frozen=True, eq=False)
class _Proof:
    """What exact simulation says of the waveform found."""

    orbit: Orbit  # its last period
    speed: float  # over all periods simulated
    left: float  # share of a push left, the least over blocks simulated


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[PairWaveformScene], report: Report) -> Result:
    """Find the best periodic field, and simulate it beside the harmonic one.

    Status "failed" where a simulation with the field found ends elsewhere. Raises SolveError
    if there is no such field, or it is not found.
    """
    table, begin = scene.table, time.perf_counter()
    limits, aim = _limits(table), FieldAim(table.aim.maximise, table.aim.speed)
    given = _pair(table.pair, limits.frequency[0], (1.0, 1.0))
    try:
        _check_strain(table)
        harmonic = best_harmonic(given, limits, aim, report)
        first = _first(given, limits, harmonic, report)
        searched = time.perf_counter()
        free = _pair(table.pair, harmonic.frequency, None)
        guesses, scaled = _guesses(table, free, first), _scaled(free, first)
        stages, tries = _solve(table, waveform_problem(scaled, limits, aim), guesses, report)
        optimum, solved = stages["phases"], time.perf_counter()
        proof = _prove(free, optimum.motion, report)
    except SolveError as error:
        raise refused(scene, error) from None
    second = recheck(optimum.motion, report=report)
    result = conclude(
        scene,
        stages,
        second,
        objective="speed" if aim.maximise else "energy_per_distance",
        scalars=_scalars(aim, optimum.motion, proof, harmonic),
        variables=_variables(optimum.motion, harmonic),
        warnings=[*_warnings(table, stages, proof, harmonic)],
        timings={
            "harmonic": searched - begin,
            "optimise": solved - searched,
            "check": time.perf_counter() - solved,
        },
        faults=[*_strays(optimum.motion, proof)],
        shown=("field", "stretch", "velocity"),
    )
    return replace(result, trust={**result.trust, "starts": [*tries]})


def _limits(table: PairWaveformScene) -> FieldLimits:
    low, high = table.limits.field
    return FieldLimits(
        (low, high), table.limits.frequency_range, table.limits.slope, table.limits.strain
    )


def _pair(table: DrivenPairTable, frequency: float, cosines: tuple[float, ...] | None) -> Model:
    """The pair without units; forces of the table are over the push."""
    laws = []
    for mass in range(2):
        law = law_of(table.friction, mass)
        assert isinstance(law, Coulomb)
        names = ("forward", "backward", "stick_forward", "stick_backward")
        given = {name: getattr(law, name) for name in names if getattr(law, name) is not None}
        laws.append(Coulomb(**{name: table.eps * value for name, value in given.items()}))
    return magnetic_pair(law=laws, push=table.eps, frequency=frequency, cosines=cosines)


def _scaled(pair: Model, harmonic: Harmonic) -> Model:
    """Pair with the sizes that motions under the harmonic field have."""
    orbit = harmonic.orbit
    velocity = max(orbit.strain * harmonic.frequency / 2, 1e-12)
    sizes = {"position": max(orbit.strain / 2, 1e-12), "velocity": velocity}
    return replace(
        pair,
        x=[replace(signal, nominal=sizes[signal.name]) for signal in pair.x],
        contacts=[replace(contact, nominal_speed=velocity) for contact in pair.contacts],
    )


# -- solving ---------------------------------------------------------------------------------------


def _check_strain(table: PairWaveformScene) -> None:
    """Refuse a strain at which the link cannot draw mass 1 forward.

    To gather speed forward it must be drawn with more than its friction and the field that pushes
    it back; and if it never gathers any, these are what the mean force of the link makes up for.
    """
    law, strain = law_of(table.pair.friction, 0), table.limits.strain
    assert isinstance(law, Coulomb)
    least = table.pair.eps * (table.limits.field[0] + float(law.forward))
    if strain is not None and strain <= least:
        raise SolveError(
            f"limits.strain {strain:.6g} lets nothing move: the link draws mass 1 forward, against "
            f"friction and the least field, only at strains above {least:.6g}",
            f"write limits.strain above {least:.6g}, or weaker friction forward",
        )


def _first(given: Model, limits: FieldLimits, harmonic: Harmonic, report: Report) -> Harmonic:
    """The harmonic field, or where the strain leaves it none that moves the pair, a lower one."""
    if limits.strain is None or (harmonic.kept and harmonic.orbit.moves):
        return harmonic
    (low, high), nu = limits.field, harmonic.frequency
    lower = [
        replace(limits, field=(low, low + top * (high - low)), frequency=(nu, nu)) for top in _TOPS
    ]
    found = [best_harmonic(given, part, FieldAim(), report) for part in lower]
    kept = [lowered for lowered in found if lowered.kept]
    return max(kept, key=lambda lowered: lowered.orbit.speed, default=harmonic)


def _guesses(table: PairWaveformScene, free: Model, first: Harmonic) -> list[Guess]:
    """The settled motion under a harmonic field, then those under fields by chance."""
    steep, starts = table.limits.slope is not None, table.search.starts
    (low, high), found = table.limits.field, []
    lowered = (low, min(high, 2 * first.mean - low))
    for k in range(starts if first.orbit.moves else max(starts, 1 + _OTHERS)):
        random = np.random.default_rng([table.search.seed, k])
        course = chance_field(lowered, first.frequency, random) if k else first.course
        driven = drive(free, course, periodic=True)
        orbit = settle(driven, course.period, first.orbit.start, strain=table.limits.strain)
        if orbit.moves:
            found.append(_guess(orbit, course, steep))
    if not found:
        raise _rests(table, first)
    return found


def _rests(table: PairWaveformScene, first: Harmonic) -> SolveError:
    """Say what holds the pair: the strain, if it cut the harmonic field down, or friction."""
    (low, high), strain = table.limits.field, table.limits.strain
    slope = table.limits.slope or math.inf
    whole = min((high - low) / 2, slope / first.frequency)
    if strain is None or first.amplitude >= whole:
        return SolveError(_REST, "write weaker friction, or a wider limits.field")
    return SolveError(
        f"limits.strain {strain:.6g} leaves no field that was tried and moves the pair; the steady "
        f"field {(low + high) / 2:.6g} alone stretches it by about "
        f"{table.pair.eps * (low + high) / 2:.6g}",
        "write a larger limits.strain, or weaker friction",
    )


def _guess(orbit: Orbit, course: Gait, steep: bool) -> Guess:
    dense = orbit.motion.dense
    assert dense is not None

    def states(t: np.ndarray) -> np.ndarray:
        return np.vstack([dense(t), course(t)]) if steep else dense(t)

    return Guess(course.period, states, lambda t: course(t, int(steep)))


def _solve(
    table: PairWaveformScene, problem: Problem, guesses: Sequence[Guess], report: Report
) -> tuple[dict[str, Optimum], tuple[float, ...]]:
    """Steep friction first, and complementary contact where its phases lead nowhere."""
    mesh = Mesh.even(1, table.mesh.arcs, Collocation(table.mesh.degree, table.mesh.scheme))
    speed = problem.model.contacts[0].nominal_speed
    first, last, ratio = _WIDTHS
    steep = Smoothed(last * speed, first * speed, ratio)
    lost: SolveError | None = None
    for name, treatment in (("smooth", steep), ("complementarity", _RELAXED)):
        try:
            relaxed, tries = best_of(problem, mesh, treatment, guesses, report=report)
            report("polishing", 0.6)
            exact = polish(
                relaxed, collocation=_EXACT, tolerance=table.mesh.tolerance, report=report
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


def _prove(free: Model, motion: Motion, report: Report) -> _Proof:
    """Simulate the waveform over many periods, from the optimal start and from beside it."""
    report("simulating the field found", 0.95)
    course = field_course(motion)
    driven, period = drive(free, course, periodic=True), course.period
    start = motion.states(np.zeros(1))[:4, 0]
    run = simulate(driven, _PERIODS * period, contact=Exact(), x0=_named(start))
    speed = float(run.end[0] - start[0]) / (_PERIODS * period)
    size = float(np.max(np.abs(relative(motion.states(np.linspace(0, motion.duration, 200))))))
    drift = float(np.max(np.abs(relative(run.end) - relative(start)))) / size
    last = np.concatenate([run.end[:2] - run.end[0], run.end[2:]])
    orbit = orbit_from(driven, period, last, drift=drift, periods=_PERIODS)
    return _Proof(orbit, speed, push_left(driven, period, start, size))


def _named(state: np.ndarray) -> dict[str, np.ndarray]:
    return {"position": state[:2], "velocity": state[2:]}


def _strays(motion: Motion, proof: _Proof) -> Iterator[str]:
    found, kept = _speed(motion), proof.speed
    if not abs(kept - found) <= ACCEPTED * max(abs(found), abs(kept)):
        yield f"after {_PERIODS} periods the simulated speed is {kept:.6g}, not {found:.6g}"


def _speed(motion: Motion) -> float:
    ends = motion.states(np.array([0.0, motion.duration]))
    return float(ends[0, 1] - ends[0, 0]) / motion.duration


# -- what is told ----------------------------------------------------------------------------------


def _gain(aim: FieldAim, proof: _Proof, harmonic: Harmonic) -> float | None:
    """Ratio of speeds, or of works per distance, above 1 where the waveform is better."""
    if aim.maximise:
        still = 1e-9 * harmonic.orbit.strain * harmonic.frequency
        return proof.speed / harmonic.orbit.speed if harmonic.orbit.speed > still else None
    spent, least = harmonic.orbit.work_per_distance, proof.orbit.work_per_distance
    return spent / least if harmonic.reached and spent and least else None


def _scalars(aim: FieldAim, motion: Motion, proof: _Proof, harmonic: Harmonic) -> dict[str, Scalar]:
    course, orbit = field_course(motion), proof.orbit
    stretch = motion.output("stretch", np.linspace(0, motion.duration, 2001))
    return {
        "speed": Scalar(_speed(motion)),
        "speed_simulated": Scalar(proof.speed),
        "speed_harmonic": Scalar(harmonic.orbit.speed),
        "gain": Scalar(_gain(aim, proof, harmonic)),
        "frequency": Scalar(2 * math.pi / motion.duration),
        "frequency_harmonic": Scalar(harmonic.frequency),
        "first_harmonic": Scalar(first_harmonic(course)[0]),
        "amplitude_harmonic": Scalar(harmonic.amplitude),
        "strain_max": Scalar(orbit.strain),
        "strain_max_harmonic": Scalar(harmonic.orbit.strain),
        "swing": Scalar(float(np.ptp(stretch)) / 2),
        "work_per_distance": Scalar(orbit.work_per_distance),
        "work_per_distance_harmonic": Scalar(harmonic.orbit.work_per_distance),
        "drift": Scalar(orbit.drift),
        "drift_harmonic": Scalar(harmonic.orbit.drift),
        "periods_harmonic": Scalar(harmonic.orbit.periods),
        "push_left": Scalar(proof.left),
    }


def _variables(motion: Motion, harmonic: Harmonic) -> list[Variable]:
    model = motion.program.problem.model
    expressions: dict[str, ca.SX] = {
        "position": symbol(model, "position"),
        "velocity": symbol(model, "velocity"),
        "contact_force": model.forces,
        "stretch": model.output("stretch"),
        "field": model.output("field"),
    }
    sampled = sample_motion(motion, expressions)
    course = field_course(motion)
    # the harmonic field begins where its crest stands as that of the waveform's first harmonic
    share = sampled.time / motion.duration - first_harmonic(course)[1] / (2 * math.pi)
    dense = harmonic.orbit.motion.dense
    assert dense is not None
    at = np.mod(share, 1.0) * harmonic.course.period
    x = dense(at)
    return [
        *sampled.variables(_SIGNALS, "dimensionless"),
        Variable("field_harmonic", "1", ("instant",), harmonic.course(at)[0], "harmonic field"),
        Variable("stretch_harmonic", "1", ("instant",), x[1] - x[0], "stretch under it"),
        Variable("gait_breaks", "1", ("gait_break",), course.breaks, "times of the field's pieces"),
        Variable(
            "gait_polynomial",
            "1",
            ("gait_piece", "link", "gait_power"),
            course.polynomial,
            "field, coefficients of s^k, s the time since the piece began",
        ),
    ]


def _warnings(
    table: PairWaveformScene, stages: Mapping[str, Optimum], proof: _Proof, harmonic: Harmonic
) -> Iterator[str]:
    relaxed, exact = (stages[name] for name in stages)
    yield from warnings_of_optimum(exact, table.mesh.tolerance)
    yield from warnings_of_reading(relaxed, exact)
    yield from _of_harmonic(table, proof, harmonic)
    if proof.left >= FADED:
        yield (
            f"a small push does not fade: {proof.left:.2g} of it is left after "
            f"{MOST_PERIODS} periods; the motion found may not be stable"
        )
    if proof.orbit.strain >= _WIDE:
        yield (
            f"the link changes its length by {100 * proof.orbit.strain:.3g} %: the law of its "
            "material is for small strains, and below no length masses would pass each other; "
            "write limits.strain"
        )
    if table.search.starts == 1:
        yield "a local optimum from one start; write search.starts to try more"


def _of_harmonic(table: PairWaveformScene, proof: _Proof, harmonic: Harmonic) -> Iterator[str]:
    """Say where the comparison with the harmonic field is lost, or none."""
    orbit = harmonic.orbit
    if not orbit.settled:
        yield (
            f"under the harmonic field the motion still changes by {orbit.drift:.2g} after "
            f"{orbit.periods} periods; its speed is that of the last one"
        )
    if not harmonic.kept:
        yield (
            f"the middle of limits.field alone stretches the link by {orbit.strain:.6g}, beyond "
            "limits.strain: no harmonic field about it to compare with, and no gain to tell"
        )
        return
    if table.aim.maximise and not proof.speed > orbit.speed:
        yield (
            f"simulated, the waveform is not faster than the harmonic field: {proof.speed:.6g} "
            f"against {orbit.speed:.6g}; write search.starts to try more"
        )
    if table.aim.minimise and not harmonic.reached:
        yield (
            f"no harmonic field within the limits reaches aim.speed; the best one has "
            f"{orbit.speed:.6g}, and there is no gain to tell"
        )
    spent, least = orbit.work_per_distance, proof.orbit.work_per_distance
    if table.aim.minimise and harmonic.reached and spent and least and not least < spent:
        yield (
            f"simulated, the waveform takes no less work than the harmonic field: {least:.6g} "
            f"against {spent:.6g}; write search.starts to try more"
        )
