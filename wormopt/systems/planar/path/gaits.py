"""Families of steps whose changes of shape are proportional to an amplitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Polygon
from wormopt.systems.planar.crawling.crawl import crawl
from wormopt.systems.planar.kinematic.constraints import Constraints
from wormopt.systems.planar.kinematic.loads import Ground
from wormopt.systems.planar.kinematic.motion import Phase, kinematic_motion
from wormopt.systems.planar.path.steps import Family, GaitStep, crawl_step, kinematic_step


def gait_family(
    name: str,
    shape: Shape,
    rest: ArrayLike,
    changes: ArrayLike,
    amplitudes: Sequence[float],
    *,
    ground: Ground = None,
    held: Constraints | Sequence[Phase] | None = None,
    rates: Sequence[float] | float = 1.0,
) -> Family:
    """Return a family of strokes from a rest shape through others and back, by an amplitude.

    With pins and skids the shape determines the motion. Without them the body crawls slowly, and
    friction determines the motion.

    Parameters
    ----------
    name : str
        Name of the gait.
    shape : Shape
        The body.
    rest : array_like, shape (n_s,)
        Shape at the start and end of the stroke.
    changes : array_like, shape (k, n_s)
        Shapes in between, less the rest shape, at amplitude 1.
    amplitudes : sequence of float
        Amplitudes that a search may use, ascending.
    ground : law, sequence of laws or None, optional
        Friction of all masses, or of each: `Elliptic` for a crawl; with constraints the resistance
        to sliding, for the work.
    held : Constraints or sequence of Phase, optional
        Constraints; none if left out.
    rates : float or sequence of float, optional
        Largest rates of the shape variables, for the duration.

    Returns
    -------
    Family

    Raises
    ------
    ArgumentError
        If there are neither constraints nor ground.

    Examples
    --------
    Two links stretch, one after the other; the ground resists backward motion more.

    >>> import wormopt as wo
    >>> worm, law = wo.planar.chain_shape(2), wo.Elliptic(1.0, 3.0, 2.0)
    >>> pull = [[0.4, 0.0, 0.0], [0.4, 0.4, 0.0], [0.0, 0.4, 0.0]]
    >>> ahead = wo.planar.gait_family("ahead", worm, (0.6, 0.6, 0.4), pull, (0.5, 1.0), ground=law)
    >>> bool(ahead.make(1.0).displacement[0] > 0.1)
    True
    """
    stroke = _strokes(rest, changes)
    if held is None and ground is None:
        raise ArgumentError("without constraints and ground the body does not move; give a ground")

    def make(amplitude: float) -> GaitStep:
        if held is not None:
            motion = kinematic_motion(shape, stroke(amplitude), held)
            return kinematic_step(name, motion, amplitude=amplitude, ground=ground, rates=rates)
        found = crawl(shape, cast("PlanarLaw", ground), stroke(amplitude))
        return crawl_step(name, found, amplitude=amplitude, rates=rates)

    if held is not None:
        return Family(name, make, tuple(amplitudes))
    # phases appear and vanish with the amplitude: more points do not improve a polynomial
    return Family(name, make, tuple(amplitudes), degree=6)


def _strokes(rest: ArrayLike, changes: ArrayLike) -> Callable[[float], Polygon]:
    """Return strokes by their amplitude, from rest through other shapes and back."""
    start, way = np.asarray(rest, dtype=float), np.atleast_2d(np.asarray(changes, dtype=float))
    return lambda amplitude: Polygon(np.vstack([start, start + amplitude * way]))
