"""The search: from chance strokes, ever steeper friction, to the best polygon."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.progress import Report, silent
from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.ground import Dry
from wormopt.systems.planar.design.program import gait_problem
from wormopt.systems.planar.design.starts import chance_corners, guess_from

WIDTHS = (1.0, 0.1, 0.01)


def mesh_of(aim: PlanarAim) -> Mesh:
    return Mesh.even(1, aim.corners, Collocation(4))


def solve(aim: PlanarAim, corners, report: Report = silent, widths=WIDTHS):
    problem, mesh = gait_problem(aim), mesh_of(aim)
    guess = guess_from(aim, corners)
    treatment = FixedModes()
    if not isinstance(aim.ground, Dry):
        return optimise(problem, mesh, treatment, guess)
    scale = aim.ground.most * float(np.ptp(aim.ranges, axis=1).max())
    best = None
    for k, width in enumerate(widths):
        best = optimise(
            problem, mesh, treatment, guess, p={"width": width * scale},
            solver=Ipopt(tolerance=1e-7, iterations=300, mu_init=0.1 if k == 0 else 1e-3),
        )
        guess = best.motion.guess
    return best
