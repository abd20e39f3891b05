"""The ground below each mass, as arrays of resistances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import Elliptic, PlanarLaw


@dataclass(frozen=True, eq=False)
class Ground:
    """Resistances of the masses, each an array (m,), or (G, m) if bodies differ."""

    forward: np.ndarray
    backward: np.ndarray
    sideways: np.ndarray

    def squares(self, v: np.ndarray) -> np.ndarray:
        """Return squared resistances for velocities or forces of the worm (..., m, 2)."""
        along = np.where(v[..., 0] >= 0, self.forward, self.backward)
        return np.stack([along, np.broadcast_to(self.sideways, along.shape)], axis=-1) ** 2

    def power(self, v: np.ndarray) -> np.ndarray:
        """Return the power of each mass (..., m) that slides with velocity `v` (..., m, 2)."""
        return np.sqrt((self.squares(v) * v**2).sum(axis=-1))

    def gauge(self, push: np.ndarray) -> np.ndarray:
        """Return the pushes (..., m) on the ground relative to their limit."""
        return np.sqrt((push**2 / self.squares(push)).sum(axis=-1))

    def of(self, index: np.ndarray | tuple[np.ndarray | slice | None, ...]) -> Ground:
        """Return the ground below some of the masses, or of some of the bodies."""
        return Ground(self.forward[index], self.backward[index], self.sideways[index])

    def of_bodies(self, points: np.ndarray) -> Ground:
        """Return the ground of some of the bodies, if they differ."""
        return self.of(points) if self.forward.ndim == 2 else self

    def by(self, force: float) -> Ground:
        """Return the ground in units of a force."""
        return Ground(self.forward / force, self.backward / force, self.sideways / force)

    @property
    def one_sided(self) -> np.ndarray:
        """Masses with unequal forward and backward resistances."""
        return self.forward != self.backward


def ground_of(laws: PlanarLaw | Sequence[PlanarLaw], n_points: int) -> Ground:
    """Return resistances of one law for all masses, or of one for each; refuse other laws."""
    each = [laws] * n_points if isinstance(laws, PlanarLaw) else list(laws)
    if len(each) != n_points:
        raise ArgumentError(f"{len(each)} laws for {n_points} masses; give one, or one for each")
    for law in each:
        if not isinstance(law, Elliptic):
            raise ArgumentError(
                f"{type(law).__name__} has no principle of least power, so the velocity of a slow "
                "crawl need not be unique nor exist; use Elliptic with the same parameters"
            )
    names = ("forward", "backward", "sideways")
    return Ground(*(np.array([float(getattr(law, name)) for law in each]) for name in names))
