"""Scenes of kind ``capsule``: a capsule driven by the jumps of a mass inside."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Model
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Prescribed
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import optimise
from wormopt.ocp.problem import Bound, Ends, Problem
from wormopt.progress import Report
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.shared.optimum import (
    conclude,
    recheck,
    refused,
    sample_motion,
    warnings_of_optimum,
)
from wormopt.systems.shared.signals import Kind, symbol
from wormopt.systems.swinging.capsule import capsule
from wormopt.systems.swinging.scenes.internal_mass import CapsuleScene, CapsuleTable

_SIGNALS: dict[str, Kind] = {
    "position": ("length", (), "position of the body"),
    "velocity": ("speed", (), "velocity of the body"),
    "inner_position": ("length", (), "position of the inner mass in the body"),
    "inner_velocity": ("speed", (), "velocity of the inner mass relative to the body"),
    "contact_force": ("acceleration", (), "force of the ground per mass of the whole"),
}
# The body slides back while the inner mass goes ahead, and on while it returns.
_MODES = ModeSequence(((-1,), (1,)))
_DEFECT = 1e-9


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[CapsuleScene], report: Report) -> Result:
    """Find the fastest cycle of a capsule; raises SolveError if none is found."""
    table, begin = scene.table.capsule, time.perf_counter()
    problem, solver = problem_of(table), Ipopt(tolerance=1e-10)
    mesh = Mesh.even(2, 1, Collocation(2))
    try:
        optimum = optimise(
            problem, mesh, Prescribed(_MODES), _guess(table), solver=solver, report=report
        )
    except SolveError as error:
        raise refused(scene, error) from None
    solved, motion = time.perf_counter(), optimum.motion
    second, model, units = recheck(motion, report=report), problem.model, scene.table.units
    expressions = {name: symbol(model, name) for name in _SIGNALS if name != "contact_force"}
    sampled = sample_motion(motion, {**expressions, "contact_force": model.forces})
    speeds = motion.arcs.start[motion.program.rows_of("inner_velocity")[0]]
    return conclude(
        scene,
        {"phases": optimum},
        second,
        objective="speed",
        scalars={
            "speed": Scalar(-optimum.objective, unit_of("speed", units)),
            "inner_speeds": Scalar(speeds, unit_of("speed", units)),
        },
        variables=sampled.variables(_SIGNALS, units),
        warnings=list(warnings_of_optimum(optimum, _DEFECT)),
        timings={"optimise": solved - begin, "recheck": time.perf_counter() - solved},
    )


def problem_of(table: CapsuleTable) -> Problem:
    """What to optimise: the mean speed of a cycle after which all is as before.

    Relative acceleration is by impulses only. The momentum vanishes at the cycle's ends: the
    body is at rest where the inner mass is.
    """
    model, slow = _coasting(table), _slow(table)
    ends = Ends.of(model)
    sizes = [signal.nominal for signal in model.x]
    return Problem(
        model,
        ends,
        -(ends.end[0] - ends.start[0]) / ends.duration,
        (1e-3 * slow, 10 * slow),
        periodic=["velocity", "inner_position", "inner_velocity"],
        at_ends=[
            Bound("start", ends.start[0], 0.0, 0.0, sizes[0]),
            Bound("inner start", ends.start[2], 0.0, 0.0, sizes[2]),
            Bound("momentum", ends.end[1] + table.share * ends.end[3], 0.0, 0.0, sizes[1]),
        ],
        impulses=True,
    )


def _coasting(table: CapsuleTable) -> Model:
    model = capsule(share=table.share, friction=table.friction, stroke=table.stroke)
    return replace(model, u=[replace(signal, lower=0.0, upper=0.0) for signal in model.u])


def _slow(table: CapsuleTable) -> float:
    """Usual time of a cycle."""
    return 2 * math.sqrt(table.share * table.stroke / table.friction)


def _guess(table: CapsuleTable) -> Guess:
    """To and fro at constant relative velocity."""
    duration, stroke = _slow(table), table.stroke
    inner = 2 * stroke / duration
    speed = table.share * inner / 2

    def states(t: np.ndarray) -> np.ndarray:
        sign = np.where(t < duration / 2, 1, -1)
        inside = stroke - inner * np.abs(t - duration / 2)
        return np.vstack([0 * t, -speed * sign, inside, inner * sign])

    return Guess(duration, states)
