"""The shortest slides of a block over dry ground: F+ = 1, F- = 2, |u| <= 3."""

import numpy as np

from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.ocp.motion import Guess
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.systems.block.block import block

BLOCK = block(Coulomb(1.0, 2.0), force=3.0)
LINE = Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.6]))


def slide(
    start: tuple[float, float] = (0.0, 0.0),
    end: float = 1.0,
    model: Model = BLOCK,
    size: float = 1.0,
) -> Problem:
    """Shortest time, times a size."""
    ends = Ends.of(model)
    at_ends = [
        Constraint("start", ends.start, start, start),
        Constraint("end", ends.end, [end, 0], [end, 0]),
    ]
    cost = size * ends.duration
    return Problem(model, ends, cost, (0.01, 10.0), boundary_constraints=at_ends, nominal=size)
