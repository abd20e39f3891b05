"""How far a stroke carries a body on viscous ground, and what it takes.

A body without inertia knows no time: displacement and the length of the stroke in the metric of
power are integrals over its phase. The stroke costs least work in a given time at constant power.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.body.travel import travel
from wormopt.systems.planar.swimming.swimmer import Swimmer

# Panels of the quadrature to begin with, what it shall meet, and what it must.
_PANELS, _ROUNDING, _LOOSE = 2, 1e-14, 1e-6
STRAIGHT = 1e-9
"""Turn below which a stroke counts as straight: its distance then is free of the frame."""


@dataclass(frozen=True, eq=False)
class Swim:
    """What one stroke does.

    Parameters
    ----------
    displacement : ndarray, shape (3,)
        Way of the body's frame, in the frame at the start, and the angle it turns by.
    length : float
        Of the stroke in the metric of power: in time T it takes work length^2 / T or more.
    phase : ndarray, shape (m,)
        Phases at which the rest is known.
    shapes : ndarray, shape (m, n_s)
        Shapes.
    poses : ndarray, shape (m, 3)
        Poses of the frame, from the start.
    travelled : ndarray, shape (m,)
        Length of the stroke up to there.
    drag : float
        Force by velocity that tows the straight body.
    error : float
        By how much displacement and length changed when panels were halved.
    """

    displacement: np.ndarray
    length: float
    phase: np.ndarray
    shapes: np.ndarray
    poses: np.ndarray
    travelled: np.ndarray
    drag: float
    error: float

    @property
    def distance(self) -> float:
        """How far the frame gets; free of the frame and the start where the stroke is straight."""
        return float(np.hypot(*self.displacement[:2]))

    @property
    def turn(self) -> float:
        """Angle by which the body turns."""
        return float(self.displacement[2])

    @property
    def action(self) -> float:
        """Work times time at constant power, the least there is."""
        return self.length**2

    @property
    def efficiency(self) -> float:
        """Work that tows the straight body as far in the same time, over that of the stroke.

        drag distance^2 / action; NaN where the stroke turns the body or nothing moves.
        """
        if abs(self.turn) > STRAIGHT or not self.length > 0:
            return float("nan")
        return self.drag * self.distance**2 / self.action

    def work(self, duration: float) -> float:
        """Least work in so long a time.

        Parameters
        ----------
        duration : float
            Time of the stroke.

        Returns
        -------
        float
        """
        if not duration > 0:
            raise ArgumentError(f"duration must be above 0, not {duration}")
        return self.action / duration

    @cached_property
    def time(self) -> np.ndarray:
        """Times (m,) of the phases at constant power, over the duration of the stroke."""
        return self.travelled / self.length if self.length > 0 else self.phase


def swim(swimmer: Swimmer, stroke: Stroke) -> Swim:
    """Let a body make a stroke on viscous ground.

    Parameters
    ----------
    swimmer : Swimmer
        The body.
    stroke : Stroke
        How its shape goes round: `Harmonics`, `Polygon`, or any with their methods.

    Returns
    -------
    Swim
        Displacement, work, and the way there.

    Raises
    ------
    ArgumentError
        If the stroke has another number of shape variables, or leads through or too near a shape at
        which the drags are no finite numbers: a link of length 0.

    Examples
    --------
    >>> from wormopt.systems.planar.body.shape import chain_shape
    >>> from wormopt.systems.planar.body.strokes import Polygon
    >>> purcell = Swimmer(chain_shape(3, lengths=(1.0, 1.0, 1.0)), rods=(1.0, 2.0))
    >>> square = Polygon([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    >>> round(swim(purcell, square).distance, 12)
    0.180562563321
    """
    if stroke.n_s != swimmer.shape.s.numel():
        names = ", ".join(swimmer.shape.names) or "none"
        raise ArgumentError(f"the stroke has {stroke.n_s} shape variables, the body has: {names}")

    def rates(phase: np.ndarray) -> np.ndarray:
        shapes, ds = stroke.at(phase)
        A, G = swimmer.local(shapes)
        power = np.einsum("mi,mij,mj->m", ds, G, ds)
        found = np.column_stack([np.einsum("mij,mj->mi", A, ds), np.sqrt(np.maximum(power, 0.0))])
        if not np.all(np.isfinite(found)):
            raise ArgumentError("the stroke leads through a shape at which drag is not finite")
        return found

    course = travel(rates, stroke.breaks, panels=_PANELS, accuracy=_ROUNDING)
    length = float(course.sums[-1, 0])
    if not course.error <= _LOOSE * (1 + length):
        raise ArgumentError("the stroke leads too near a shape at which a link has no length")
    phase = np.concatenate([[0.0], course.nodes, [1.0]])
    shapes = stroke.at(phase)[0]
    return Swim(
        course.displacement,
        length,
        phase,
        shapes,
        np.vstack([np.zeros(3), course.node_poses, course.displacement]),
        np.concatenate([[0.0], course.node_sums[:, 0], [length]]),
        swimmer.towing_drag(shapes),
        course.error,
    )
