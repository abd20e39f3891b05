"""Room of a body across its displacement, and its derivatives by the corners of a stroke."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import casadi as ca
import numpy as np

from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.design.aim import PlanarAim
from wormopt.systems.planar.design.polygons import Sides


@dataclass(frozen=True, eq=False)
class Room:
    """Distances of a body across its displacement at the ends of parts of the sides."""

    aim: PlanarAim
    ends: np.ndarray  # (e, n_s)
    sides: Sides

    @property
    def across(self) -> np.ndarray:
        """Distances across the displacement, of all masses at all ends."""
        along = self._along[0]
        return (along[0] * self._places[..., 1] - along[1] * self._places[..., 0]).ravel()

    @property
    def across_by(self) -> np.ndarray:
        """Derivatives of these distances, (distances, ends, n_s)."""
        along, along_by = self._along
        places, by = self._places, self._places_by
        aside = along[0] * by[:, :, 1] - along[1] * by[:, :, 0]
        aside += np.einsum("em,kn->emkn", places[..., 1], along_by[0])
        aside -= np.einsum("em,kn->emkn", places[..., 0], along_by[1])
        return aside.reshape(-1, *aside.shape[2:])

    @cached_property
    def _along(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction of the displacement or of the first heading, and its derivatives."""
        by = self.sides.gradient(self.aim.closed)[:2]
        if self.aim.purpose != "speed":
            return np.array([1.0, 0.0]), 0 * by
        way = self.sides.total[:2]
        size = max(float(np.hypot(*way)), 1e-300)
        along = way / size
        return along, np.einsum("ij,jkn->ikn", np.eye(2) - np.outer(along, along), by) / size

    @cached_property
    def _own(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (e, masses, 2) in the body's frame, and derivatives (e, masses, 2, n_s)."""
        shape, (e, n_s) = self.aim.shape, self.ends.shape
        places, slopes = _points(shape).map(e)(self.ends.T)
        m = shape.n_points
        own = np.asarray(places).reshape(2, e, m).transpose(1, 2, 0)
        by = np.asarray(slopes).reshape(m, 2, e, n_s).transpose(2, 0, 1, 3)
        return own, by

    @cached_property
    def _poses(self) -> np.ndarray:
        return np.array(list(self.sides.running))[: len(self.ends)]

    @cached_property
    def _places(self) -> np.ndarray:
        poses = self._poses
        return poses[:, None, :2] + rotate(poses[:, None, 2], self._own[0])

    @cached_property
    def _places_by(self) -> np.ndarray:
        """Derivatives (e, masses, 2, ends, n_s)."""
        poses, (own, slopes) = self._poses, self._own
        by = np.array(list(self.sides.gradients(self.aim.closed)))[: len(self.ends)]
        turned = rotate(poses[:, None, 2], own)
        sideways = np.stack([-turned[..., 1], turned[..., 0]], axis=-1)
        found = by[:, None, :2] + sideways[..., None, None] * by[:, None, 2:3]
        turn = rotate(poses[:, None, 2, None], np.moveaxis(slopes, 2, -1))
        for i in range(len(self.ends)):
            found[i, :, :, i] += np.moveaxis(turn[i], -1, 1)
        return found


@cache
def _points(shape: Shape) -> ca.Function:
    slopes = ca.jacobian(ca.vec(shape.points), shape.s)
    return ca.Function("points", [shape.s], [ca.densify(shape.points), ca.densify(slopes)])
