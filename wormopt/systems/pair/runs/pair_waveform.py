"""Run scenes of kind ``pair-waveform``: the field that moves a magneto-elastic pair best."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Motion
from wormopt.ocp.optimise import Optimum
from wormopt.progress import Report
from wormopt.result import Check, Result, Unchecked
from wormopt.study.scene import Scene
from wormopt.systems.chain import law_of
from wormopt.systems.pair.driven_pair import (
    FADED,
    MOST_PERIODS,
    FieldAim,
    FieldLimits,
    Harmonic,
    best_harmonic,
)
from wormopt.systems.pair.exact import magnetic_pair, scaled_law
from wormopt.systems.pair.scenes.pair_waveform import DrivenPairTable, PairWaveformScene
from wormopt.systems.pair.waveform import (
    PERIODS,
    Proof,
    best_field,
    check_strain,
    field_course,
    first_field,
    first_harmonic,
    guesses,
    prove,
    scaled,
    waveform_problem,
)
from wormopt.systems.shared.optimum import (
    ACCEPTED,
    conclude_optimum,
    cross_check,
    refused,
    sample_motion,
    warnings_of_optimum,
    warnings_of_reading,
)

# Strain above which the model of the link is not valid.
_WIDE = 1.0


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[PairWaveformScene], report: Report) -> Result:
    """Find the best periodic field, and simulate it beside the harmonic one.

    The result is "failed" if a simulation with the field found ends elsewhere. Raises SolveError if
    no field exists, or none is found.
    """
    table, begin = scene.table, time.perf_counter()
    given, aim = table.limits, FieldAim(table.aim.maximise, table.aim.speed)
    low, high = given.field
    limits = FieldLimits((low, high), given.frequency_range, given.slope, given.strain)
    pair = _pair(table.pair, limits.frequency[0], (1.0, 1.0))
    mesh = Mesh.even(1, table.mesh.arcs, Collocation(table.mesh.degree, table.mesh.scheme))
    push, search, law = table.pair.eps, table.search, law_of(table.pair.friction, 0)
    assert isinstance(law, Coulomb)
    try:
        check_strain(limits, push, float(law.forward))
        harmonic = best_harmonic(pair, limits, aim, report)
        first = first_field(pair, limits, harmonic, report)
        searched = time.perf_counter()
        free = _pair(table.pair, harmonic.frequency, None)
        starts = guesses(free, limits, first, push, starts=search.starts, seed=search.seed)
        problem = waveform_problem(scaled(free, first), limits, aim)
        stages, tries = best_field(problem, mesh, starts, table.mesh.tolerance, report)
        motion, solved = stages["phases"].motion, time.perf_counter()
        proof = prove(free, motion, report)
    except SolveError as error:
        raise refused(scene, error) from None
    second = cross_check(motion, report=report)
    return conclude_optimum(
        scene,
        stages,
        second,
        _scalars(aim, motion, proof, harmonic),
        _variables(motion, harmonic),
        objective=None if aim.maximise else "energy_per_distance",
        checks=[_check(motion, proof)],
        facts={"starts": tries},
        warnings=_warnings(table, stages, proof, harmonic),
        timings={
            "harmonic": searched - begin,
            "optimise": solved - searched,
            "check": time.perf_counter() - solved,
        },
        shown=("field", "stretch", "velocity"),
    )


def _pair(table: DrivenPairTable, frequency: float, cosines: tuple[float, ...] | None) -> Model:
    """The dimensionless pair; forces of the table are over the push."""
    laws = [scaled_law(law_of(table.friction, mass), table.eps) for mass in range(2)]
    return magnetic_pair(law=laws, push=table.eps, frequency=frequency, cosines=cosines)


# -- results ---------------------------------------------------------------------------------------


def _check(motion: Motion, proof: Proof) -> Check:
    found, kept = _speed(motion), proof.speed
    off = abs(kept - found) / max(abs(found), abs(kept), 1e-300)
    advice = f"after {PERIODS} periods the simulated speed is {kept:.6g}, not {found:.6g}"
    return Check("speed by simulation", off, ACCEPTED, advice)


def _speed(motion: Motion) -> float:
    ends = motion.states(np.array([0.0, motion.duration]))
    return float(ends[0, 1] - ends[0, 0]) / motion.duration


def _gain(aim: FieldAim, proof: Proof, harmonic: Harmonic) -> float | None:
    """Ratio of speeds, or of works per distance, above 1 if the waveform is better."""
    if aim.maximise:
        still = 1e-9 * harmonic.orbit.strain * harmonic.frequency
        return proof.speed / harmonic.orbit.speed if harmonic.orbit.speed > still else None
    spent, least = harmonic.orbit.work_per_distance, proof.orbit.work_per_distance
    return spent / least if harmonic.reached and spent and least else None


def _scalars(aim: FieldAim, motion: Motion, proof: Proof, harmonic: Harmonic) -> dict[str, Any]:
    course, orbit = field_course(motion), proof.orbit
    stretch = motion.output("stretch", np.linspace(0, motion.duration, 2001))
    return {
        "speed": _speed(motion),
        "speed_simulated": proof.speed,
        "speed_harmonic": harmonic.orbit.speed,
        "gain": _gain(aim, proof, harmonic),
        "frequency": 2 * math.pi / motion.duration,
        "frequency_harmonic": harmonic.frequency,
        "first_harmonic": first_harmonic(course)[0],
        "amplitude_harmonic": harmonic.amplitude,
        "strain_max": orbit.strain,
        "strain_max_harmonic": harmonic.orbit.strain,
        "swing": float(np.ptp(stretch)) / 2,
        "work_per_distance": orbit.work_per_distance,
        "work_per_distance_harmonic": harmonic.orbit.work_per_distance,
        "drift": orbit.drift,
        "drift_harmonic": harmonic.orbit.drift,
        "periods_harmonic": harmonic.orbit.periods,
        "push_left": proof.left,
    }


def _variables(motion: Motion, harmonic: Harmonic) -> dict[str, np.ndarray]:
    model = motion.program.problem.model
    expressions: dict[str, ca.SX] = {
        "position": model["position"],
        "velocity": model["velocity"],
        "contact_force": model.forces,
        "stretch": model["stretch"],
        "field": model["field"],
    }
    sampled = sample_motion(motion, expressions)
    course = field_course(motion)
    # The harmonic field is shifted so its crest is that of the waveform's first harmonic.
    share = sampled.time / motion.duration - first_harmonic(course)[1] / (2 * math.pi)
    dense = harmonic.orbit.motion.dense
    assert dense is not None
    at = np.mod(share, 1.0) * harmonic.course.period
    x = dense(at)
    return sampled.arrays(PairWaveformScene.variables) | {
        "field_harmonic": harmonic.course(at)[0],
        "stretch_harmonic": x[1] - x[0],
        "gait_breaks": course.breaks,
        "gait_polynomial": course.polynomial,
    }


def _warnings(
    table: PairWaveformScene, stages: Mapping[str, Optimum], proof: Proof, harmonic: Harmonic
) -> Iterator[str]:
    relaxed, exact = (stages[name] for name in stages)
    yield from warnings_of_optimum(exact, table.mesh.tolerance)
    yield from warnings_of_reading(relaxed, exact)
    yield from _of_harmonic(table, proof, harmonic)
    if proof.left >= FADED:
        yield (
            f"a small push does not decay: {proof.left:.2g} of it remains after {MOST_PERIODS} "
            "periods, so the motion may be unstable"
        )
    if proof.orbit.strain >= _WIDE:
        yield Unchecked(
            f"the link changes its length by {100 * proof.orbit.strain:.3g} %, but the law of its "
            "material is for small strains, and at zero length the masses would pass each other; "
            "write limits.strain"
        )
    if table.search.starts == 1:
        yield "the result is a local optimum from a single start; write search.starts to try more"


def _of_harmonic(table: PairWaveformScene, proof: Proof, harmonic: Harmonic) -> Iterator[str]:
    """Warn if the waveform is not better than the harmonic field, or there is none to compare."""
    orbit = harmonic.orbit
    if not orbit.settled:
        yield (
            f"in the harmonic field the motion still changes by {orbit.drift:.2g} after "
            f"{orbit.periods} periods; its speed is that of the last period"
        )
    if not harmonic.kept:
        yield (
            f"the middle of limits.field alone stretches the link by {orbit.strain:.6g}, beyond "
            "limits.strain; so there is no harmonic field about it, and gain is unknown"
        )
        return
    if table.aim.maximise and not proof.speed > orbit.speed:
        yield (
            "in the simulation the waveform is not faster than the harmonic field: "
            f"{proof.speed:.6g} against {orbit.speed:.6g}; write search.starts to try more"
        )
    if table.aim.minimise and not harmonic.reached:
        yield (
            "no harmonic field within the limits reaches aim.speed; the best has "
            f"{orbit.speed:.6g}, and gain is unknown"
        )
    spent, least = orbit.work_per_distance, proof.orbit.work_per_distance
    if table.aim.minimise and harmonic.reached and spent and least and not least < spent:
        yield (
            "in the simulation the waveform does not need less work than the harmonic field: "
            f"{least:.6g} against {spent:.6g}; write search.starts to try more"
        )
