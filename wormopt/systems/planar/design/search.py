"""Search from random strokes, with increasingly steep friction, to the best polygon nearby."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wormopt.errors import SolveError
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.ocp.problem import Problem
from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.ground import Dry
from wormopt.systems.planar.design.starts import guess_from

# Widths of the smoothed potential, in resistances times the widest range of shape.
_WIDTHS = (1.0, 0.3, 0.1, 0.03, 0.01)
_ITERATIONS = 200
_DEGREE = 4


@dataclass(frozen=True, eq=False)
class Relaxed:
    """Result of the programs of one start."""

    corners: np.ndarray  # (k, n_s)
    objective: float  # of the last solved program, NaN if none
    optimum: Optimum | None


def relaxed(aim: PlanarAim, problem: Problem, first: np.ndarray) -> Relaxed:
    """Return the best corners near `first` by smoothed friction, at the last solved width."""
    mesh = Mesh.even(1, aim.corners, Collocation(_DEGREE))
    guess, best = guess_from(aim, first), None
    dry = isinstance(aim.ground, Dry)
    size = float(aim.reaches.max())
    for width in _WIDTHS if dry else (1.0,):
        solver = Ipopt(
            tolerance=1e-8, iterations=_ITERATIONS, mu_init=0.1 if best is None else 1e-3
        )
        given = {"width": width * size * aim.ground.mean} if isinstance(aim.ground, Dry) else None
        try:
            best = optimise(problem, mesh, FixedModes(), guess, p=given, solver=solver)
        except SolveError as error:
            if error.code == "infeasible" and best is None:
                raise
            break
        guess = best.motion.guess
    if best is None:
        return Relaxed(first, float("nan"), None)
    edges = best.motion.breaks if aim.closed is False else best.motion.breaks[:-1]
    corners = best.motion.states(edges)[: len(aim.shape.names)].T
    return Relaxed(corners, best.objective, best)
