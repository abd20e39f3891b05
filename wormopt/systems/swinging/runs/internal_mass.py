"""Run scenes of the kinds ``two-mass`` and ``capsule``: the fastest cycle of an internal mass."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import optimise
from wormopt.progress import Report
from wormopt.result import Result
from wormopt.study.scene import Scene
from wormopt.systems.shared.optimum import (
    conclude_optimum,
    cross_check,
    refused,
    sample_motion,
    warnings_of_optimum,
)
from wormopt.systems.swinging.capsule import capsule_guess, capsule_problem
from wormopt.systems.swinging.pair import advance, pair_guess, pair_problem
from wormopt.systems.swinging.scenes.internal_mass import CapsuleScene, TwoMassScene

# The big mass rests; the small one is driven forward, then braked.
_STROKE = ModeSequence(((0, 1), (0, 1)))
# The body slides back while the inner mass moves forward, and forward while it returns.
_TO_AND_FRO = ModeSequence(((-1,), (1,)))
_DEFECT = 1e-9


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[TwoMassScene] | Scene[CapsuleScene], report: Report) -> Result:
    """Find the fastest cycle; raises SolveError if none is found.

    A result of kind "two-mass" covers the slow stroke; the fast return takes no time.
    """
    table, begin = scene.table, time.perf_counter()
    if isinstance(table, TwoMassScene):
        problem, guess, modes = pair_problem(table.pair), pair_guess(table.pair), _STROKE
    else:
        problem, guess = capsule_problem(table.capsule), capsule_guess(table.capsule)
        modes = _TO_AND_FRO
    try:
        optimum = optimise(
            problem,
            Mesh.even(2, 1, Collocation(2)),
            FixedModes(modes),
            guess,
            solver=Ipopt(tolerance=1e-10),
            report=report,
        )
    except SolveError as error:
        raise refused(scene, error) from None
    solved, motion = time.perf_counter(), optimum.motion
    second = cross_check(motion, report=report)
    signals = {
        name: problem.model.forces if name.startswith("contact") else problem.model[name]
        for name in table.variables
        if name != "instant"
    }
    return conclude_optimum(
        scene,
        {"phases": optimum},
        second,
        {"speed": -optimum.objective, **_numbers(table, motion)},
        sample_motion(motion, signals).arrays(table.variables),
        warnings=warnings_of_optimum(optimum, _DEFECT),
        timings={"optimise": solved - begin, "recheck": time.perf_counter() - solved},
    )


def _numbers(table: TwoMassScene | CapsuleScene, motion: Motion) -> dict[str, Any]:
    """Scalars of one of the two kinds."""
    if isinstance(table, CapsuleScene):
        inner = motion.program.rows_of("inner_velocity")[0]
        return {"inner_speeds": motion.arcs.start[inner]}
    ratio = float(motion.arcs.design[0])
    return {"advance": advance(table.pair, ratio), "mass_ratio": ratio}
