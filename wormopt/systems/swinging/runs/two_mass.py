"""Scenes of kind ``two-mass``: Chernousko's pair with the best ratio of masses."""

from __future__ import annotations

import math
import time
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Signal
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
from wormopt.systems.swinging.pair import pair
from wormopt.systems.swinging.scenes.internal_mass import PairTable, TwoMassScene

_SIGNALS: dict[str, Kind] = {
    "position": ("length", ("mass",), "position of the mass"),
    "velocity": ("speed", ("mass",), "velocity of the mass"),
    "force": ("force", (), "force of the actuator"),
    "contact_share": ("share", ("mass",), "force of the ground over the weight"),
}
# The big mass rests; the small one is driven forward, then braked.
_MODES = ModeSequence(((0, 1), (0, 1)))
_DEFECT = 1e-9


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[TwoMassScene], report: Report) -> Result:
    """Find the fastest cycle and ratio of masses; raises SolveError if no cycle is found.

    The result covers the slow stroke; the fast return takes no time.
    """
    table, begin = scene.table.pair, time.perf_counter()
    slow = 2 * math.sqrt(table.stroke / (table.friction * table.gravity))
    mesh = Mesh.even(2, 1, Collocation(2))
    solver = Ipopt(tolerance=1e-10)
    try:
        optimum = optimise(
            problem_of(table, slow),
            mesh,
            Prescribed(_MODES),
            _guess(table, slow),
            solver=solver,
            report=report,
        )
    except SolveError as error:
        raise refused(scene, error) from None
    solved, motion = time.perf_counter(), optimum.motion
    second, model = recheck(motion, report=report), motion.program.problem.model
    ratio = float(motion.arcs.design[0])
    expressions = {name: symbol(model, name) for name in ("position", "velocity", "force")}
    sampled = sample_motion(motion, {**expressions, "contact_share": model.forces})
    units = scene.table.units
    return conclude(
        scene,
        {"phases": optimum},
        second,
        objective="speed",
        scalars={
            "speed": Scalar(-optimum.objective, unit_of("speed", units)),
            "advance": Scalar(_advance(table, ratio), unit_of("length", units)),
            "mass_ratio": Scalar(ratio),
        },
        variables=sampled.variables(_SIGNALS, units),
        warnings=list(warnings_of_optimum(optimum, _DEFECT)),
        timings={"optimise": solved - begin, "recheck": time.perf_counter() - solved},
    )


def problem_of(table: PairTable, slow: float) -> Problem:
    """What to optimise: the mean speed of slow stroke and instantaneous return.

    Over the slow stroke, of usual time `slow`; the mode keeps the big mass at rest.
    """
    ratio, (low, high) = ca.SX.sym("ratio"), table.ratios
    model = pair(
        friction=table.friction,
        ratio=ratio,
        mass=table.mass,
        gravity=table.gravity,
        length_nominal=table.stroke,
    )
    ends, size = Ends.of(model), table.stroke
    return Problem(
        model,
        ends,
        -_advance(table, ratio) / ends.duration,
        (1e-3 * slow, 10 * slow),
        at_ends=[
            Bound("start", ends.start[:2], 0.0, 0.0, size),
            Bound("rest at the start", ends.start[3], 0.0, 0.0, model.x[1].nominal),
            Bound("stroke", ends.end[1] - ends.end[0], size, size, size),
            Bound("rest at the end", ends.end[3], 0.0, 0.0, model.x[1].nominal),
        ],
        design=[Signal("mass_ratio", ratio, "share", 0.5, low, high)],
    )


def _advance(table: PairTable, ratio: Any) -> Any:
    """Way of the big mass in the return, by which the momentum, none, is not changed."""
    return table.stroke * ratio / (1 + ratio)


def _guess(table: PairTable, slow: float) -> Guess:
    speed = table.stroke / slow
    return Guess(slow, lambda t: np.vstack([0 * t, speed * t, 0 * t, 0 * t + speed]))
