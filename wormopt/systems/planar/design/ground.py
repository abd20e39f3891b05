"""What the ground takes for the motion of a shape: potentials whose minimum is the motion."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.body.shape import Shape, turned


@dataclass(frozen=True, eq=False)
class Dry:
    """Dry friction on every mass, that of most power.

    Parameters
    ----------
    laws : tuple of Elliptic
        Laws of the masses, head first, or one for all.
    """

    laws: tuple[Elliptic, ...]

    def potential(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Sum of sqrt(psi² + width²) less the width: what the twist makes least."""
        powers = [_squared(law, v) for law, v in self.each(shape)]
        return sum(
            (ca.sqrt(power + width**2) - width for power in powers), start=ca.SX(0)
        )

    def power(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Power that the ground takes, up to the width; smooth at rest."""
        return self.potential(shape, width)

    def each(self, shape: Shape) -> list[tuple[Elliptic, ca.SX]]:
        """Law and velocity of every mass."""
        if len(self.laws) not in (1, shape.n_points):
            raise ArgumentError(f"{shape.n_points} masses need as many laws, not {len(self.laws)}")
        laws = self.laws * (shape.n_points if len(self.laws) == 1 else 1)
        return [(law, shape.velocities[:, i]) for i, law in enumerate(laws)]

    @property
    def least(self) -> float:
        """Least resistance of any mass in any direction."""
        return min(
            float(part) for law in self.laws for part in (law.forward, law.backward, law.sideways)
        )

    @property
    def most(self) -> float:
        """Largest."""
        return max(
            float(part) for law in self.laws for part in (law.forward, law.backward, law.sideways)
        )

    @property
    def symmetric(self) -> bool:
        """Whether a reversed stroke goes back the same way."""
        return all(float(law.forward) == float(law.backward) for law in self.laws)


@dataclass(frozen=True)
class Viscous:
    """Linear drag on rods, by slender-body theory, or on masses.

    Parameters
    ----------
    along, across : float
        Drag along and across, per unit length of a rod or of a mass.
    on : {"rods", "masses"}
        What it acts on.
    """

    along: float
    across: float
    on: str = "rods"

    def potential(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Half the power: the twist makes it least."""
        return self.power(shape, width) / 2

    def power(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Power that the fluid takes."""
        if self.on == "masses":
            v = shape.velocities
            return self.along * ca.sumsqr(v[0, :]) + self.across * ca.sumsqr(v[1, :])
        return sum((self._rod(shape, j) for j in range(shape.n_points - 1)), start=ca.SX(0))

    def _rod(self, shape: Shape, j: int) -> ca.SX:
        """Power on rod j, whose parts move as its ends do, linearly between them."""
        link = shape.points[:, j] - shape.points[:, j + 1]
        length = ca.norm_2(link)
        angle = ca.atan2(link[1], link[0])
        head, tail = (
            turned(shape.headings[i] - angle, shape.velocities[:, i]) for i in (j, j + 1)
        )
        mean, apart = (head + tail) / 2, (head - tail) ** 2 / 12
        taken = mean**2 + apart
        return length * (self.along * taken[0] + self.across * taken[1])

    symmetric = True


Ground = Dry | Viscous


def _squared(law: Elliptic, v: ca.SX) -> ca.SX:
    """The law's power squared, without the root that has no slope at rest."""
    return (law.along(v[0]) * v[0]) ** 2 + (law.sideways * v[1]) ** 2
