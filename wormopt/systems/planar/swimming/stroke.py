"""Displacement and cost of a stroke of a body on viscous ground.

A body without inertia does not depend on time: displacement and the length of the stroke in the
metric of power are integrals over its phase. At constant power the work in a given time is least.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.strokes import Stroke
from wormopt.systems.planar.body.travel import travel
from wormopt.systems.planar.swimming.swimmer import Swimmer

# Initial panels of the quadrature, its target, and its required accuracy.
_PANELS, _ROUNDING, _LOOSE = 2, 1e-14, 1e-6
STRAIGHT = 1e-9
"""Turn below which a stroke counts as straight, with a distance independent of the frame."""


@dataclass(frozen=True, eq=False)
class Swim:
    """Result of `swim`: the effect of one stroke.

    Parameters
    ----------
    displacement : ndarray, shape (3,)
        Displacement and rotation of the body's frame, in the frame at the start.
    length : float
        Length of the stroke in the metric of power: in time T the work is at least length^2 / T.
    phase : ndarray, shape (m,)
        Phases of the following arrays.
    shapes : ndarray, shape (m, n_s)
        Shapes.
    poses : ndarray, shape (m, 3)
        Poses of the frame, from the start.
    travelled : ndarray, shape (m,)
        Length of the stroke up to the phase.
    drag : float
        Towing force of the straight body over velocity.
    error : float
        Change of displacement and length when panels were halved.
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
        """Distance of the frame; independent of frame and start if the stroke does not turn."""
        return float(np.hypot(*self.displacement[:2]))

    @property
    def turn(self) -> float:
        """Rotation of the body, in rad."""
        return float(self.displacement[2])

    @property
    def action(self) -> float:
        """Least product of work and time, at constant power."""
        return self.length**2

    @property
    def efficiency(self) -> float:
        """Work to tow the straight body as far in the same time, over that of the stroke.

        drag distance^2 / action; NaN if the stroke turns the body or nothing moves.
        """
        if abs(self.turn) > STRAIGHT or not self.length > 0:
            return float("nan")
        return self.drag * self.distance**2 / self.action

    def work(self, duration: float) -> float:
        """Return the least work for a duration.

        Parameters
        ----------
        duration : float
            Duration of the stroke.

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
    """Return the displacement and work of a stroke of a body on viscous ground.

    Theory: docs/theory-planar.md, section 5.

    Parameters
    ----------
    swimmer : Swimmer
        The body.
    stroke : Stroke
        Its shape over a phase: `Harmonics`, `Polygon`, or any object with their methods.

    Returns
    -------
    Swim
        Displacement, work, and poses over the stroke.

    Raises
    ------
    ArgumentError
        If the stroke has another number of shape variables, or passes too near a shape with
        infinite drag: a link of length 0.

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
            raise ArgumentError("the stroke passes a shape at which drag is not finite")
        return found

    course = travel(rates, stroke.breaks, panels=_PANELS, accuracy=_ROUNDING)
    length = float(course.sums[-1, 0])
    if not course.error <= _LOOSE * (1 + length):
        raise ArgumentError("the stroke passes too near a shape at which a link has no length")
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
