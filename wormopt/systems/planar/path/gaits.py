"""Families of steps whose changes of shape grow in proportion to an amplitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.body.strokes import Polygon
from wormopt.systems.planar.crawling.crawl import crawl
from wormopt.systems.planar.kinematic.constraints import Constraints
from wormopt.systems.planar.kinematic.loads import Ground
from wormopt.systems.planar.kinematic.motion import Phase, kinematic_motion
from wormopt.systems.planar.path.steps import Family, GaitStep, crawl_step, kinematic_step


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
    stroke = _strokes(rest, changes)

    def make(amplitude: float) -> GaitStep:
        motion = kinematic_motion(shape, stroke(amplitude), phases)
        return kinematic_step(name, motion, amplitude=amplitude, ground=ground, rates=rates)

    return Family(name, make, tuple(amplitudes))


def crawled_family(
    name: str,
    shape: Shape,
    rest: ArrayLike,
    changes: ArrayLike,
    ground: PlanarLaw | Sequence[PlanarLaw],
    amplitudes: Sequence[float],
    *,
    rates: Sequence[float] | float = 1.0,
) -> Family:
    """Family of strokes from rest through shapes and back, crawled so slowly that friction tells.

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
    ground : Elliptic, or sequence of Elliptic
        Friction of all masses, or of each.
    amplitudes : sequence of float
        Those that a search may use, ascending.
    rates : float or sequence of float, optional
        Largest rates of the shape variables, for the time.

    Returns
    -------
    Family

    Examples
    --------
    Two links stretch, one after the other; the ground resists more the way back.

    >>> import wormopt as wo
    >>> worm, law = wo.planar.chain_shape(2), wo.Elliptic(1.0, 3.0, 2.0)
    >>> pull = [[0.4, 0.0, 0.0], [0.4, 0.4, 0.0], [0.0, 0.4, 0.0]]
    >>> ahead = wo.planar.crawled_family("ahead", worm, (0.6, 0.6, 0.4), pull, law, (0.5, 1.0))
    >>> bool(ahead.make(1.0).displacement[0] > 0.1)
    True
    """
    stroke = _strokes(rest, changes)

    def make(amplitude: float) -> GaitStep:
        found = crawl(shape, ground, stroke(amplitude))
        return crawl_step(name, found, amplitude=amplitude, rates=rates)

    # phases come and go with the amplitude: a polynomial is no better of many points
    return Family(name, make, tuple(amplitudes), degree=6)


def _strokes(rest: ArrayLike, changes: ArrayLike) -> Callable[[float], Polygon]:
    """Strokes by their amplitude, from rest through other shapes and back."""
    start, way = np.asarray(rest, dtype=float), np.atleast_2d(np.asarray(changes, dtype=float))
    return lambda amplitude: Polygon(np.vstack([start, start + amplitude * way]))
