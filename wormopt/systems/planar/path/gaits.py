"""Families of steps whose changes of shape grow in proportion to an amplitude."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Polygon
from wormopt.systems.planar.kinematic.constraints import Constraints
from wormopt.systems.planar.kinematic.loads import Ground
from wormopt.systems.planar.kinematic.motion import Phase, kinematic_motion
from wormopt.systems.planar.path.steps import Family, GaitStep, kinematic_step


def held_family(
    name: str,
    shape: Shape,
    rest: ArrayLike,
    changes: ArrayLike,
    phases: Constraints | Sequence[Phase],
    amplitudes: Sequence[float],
    *,
    ground: Ground = None,
    rates: Sequence[float] | float = 1.0,
) -> Family:
    """Family of strokes from rest through shapes and back, held by pins and skids.

    Parameters
    ----------
    name : str
        Of the gait.
    shape : Shape
        The body.
    rest : array_like, shape (n_s,)
        Shape that the stroke begins and ends with.
    changes : array_like, shape (k, n_s)
        Shapes in between, less that at rest, at amplitude 1.
    phases : Constraints or sequence of Phase
        What holds.
    amplitudes : sequence of float
        Those that a search may use, ascending.
    ground : law, sequence of laws or None, optional
        What resists sliding, for the work.
    rates : float or sequence of float, optional
        Largest rates of the shape variables, for the time.

    Returns
    -------
    Family
    """
    start, way = np.asarray(rest, dtype=float), np.atleast_2d(np.asarray(changes, dtype=float))

    def make(amplitude: float) -> GaitStep:
        stroke = Polygon(np.vstack([start, start + amplitude * way]))
        motion = kinematic_motion(shape, stroke, phases)
        return kinematic_step(name, motion, amplitude=amplitude, ground=ground, rates=rates)

    return Family(name, make, tuple(amplitudes))
