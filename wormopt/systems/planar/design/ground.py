"""Potentials of the ground whose minimum is the motion of a changing shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.swimming.swimmer import Swimmer


@dataclass(frozen=True, eq=False)
class Dry:
    """Dry friction with maximal dissipation on every mass.

    Parameters
    ----------
    laws : tuple of Elliptic
        Laws of the masses, head first, or one for all.

    Examples
    --------
    >>> from wormopt.model.planar_friction import Elliptic
    >>> Dry((Elliptic(1.0, 1.0, sideways=3.0),)).most
    3.0
    """

    laws: tuple[Elliptic, ...]

    def potential(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return the sum of sqrt(psi² + width²) less the width, which the twist minimises.

        Parameters
        ----------
        shape : Shape
            The body.
        width : casadi.SX
            Power below which friction is smooth.

        Returns
        -------
        casadi.SX
            Expression in the shape, its rates and the twist.
        """
        laws = self.each_law(shape)
        squares = [_squared(law, shape.velocities[:, i]) for i, law in enumerate(laws)]
        return sum((ca.sqrt(one + width**2) - width for one in squares), start=ca.SX(0))

    def power(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return the power dissipated by the ground, up to the width; smooth at rest.

        Parameters
        ----------
        shape : Shape
            The body.
        width : casadi.SX
            Power below which friction is smooth.

        Returns
        -------
        casadi.SX
        """
        return self.potential(shape, width)

    def each_law(self, shape: Shape) -> list[Elliptic]:
        """Return the law of every mass.

        Parameters
        ----------
        shape : Shape
            The body.

        Returns
        -------
        list of Elliptic
        """
        if len(self.laws) not in (1, shape.n_points):
            raise ArgumentError(f"{shape.n_points} masses need as many laws, not {len(self.laws)}")
        return list(self.laws) * (shape.n_points if len(self.laws) == 1 else 1)

    def least_each(self, shape: Shape) -> np.ndarray:
        """Return the least resistance of every mass.

        Parameters
        ----------
        shape : Shape
            The body.

        Returns
        -------
        ndarray, shape (m,)
        """
        laws = self.each_law(shape)
        return np.array([min(_numbers(law)) for law in laws])

    def anchor(self, shape: Shape) -> int | None:
        """Return the mass that holds the pull of all others together and never moves, or None.

        With this mass at rest the body turns about it so that moments balance, and it carries the
        forces of the others, which it can. This motion has least power for any change of shape.

        Parameters
        ----------
        shape : Shape
            The body.

        Returns
        -------
        int or None
        """
        laws = self.each_law(shape)
        least, most = self.least_each(shape), np.array([max(_numbers(law)) for law in laws])
        found = np.flatnonzero(least >= most.sum() - most)
        return int(found[0]) if len(found) else None

    @property
    def most(self) -> float:
        """Largest resistance."""
        return max(max(_numbers(law)) for law in self.laws)

    @property
    def mean(self) -> float:
        """Mean resistance of the masses, forward, backward and to both sides."""
        return float(np.mean([(*_numbers(law), float(law.sideways)) for law in self.laws]))

    @property
    def symmetric(self) -> bool:
        """Whether a reversed stroke returns the body."""
        return all(float(law.forward) == float(law.backward) for law in self.laws)


@dataclass(frozen=True, eq=False)
class Viscous:
    """Linear drag on rods and masses.

    Parameters
    ----------
    swimmer : Swimmer
        The body with its drags.

    Raises
    ------
    ArgumentError
        If the shape is not that of the swimmer.

    Examples
    --------
    >>> from wormopt.systems.planar.body.shape import chain_shape
    >>> Viscous(Swimmer(chain_shape(2), masses=(1.0, 3.0))).symmetric
    True
    """

    swimmer: Swimmer

    def potential(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return half the power, which the twist minimises.

        Parameters
        ----------
        shape : Shape
            The swimmer's shape.
        width : casadi.SX
            Has no effect.

        Returns
        -------
        casadi.SX
        """
        return self.power(shape, width) / 2

    def power(self, shape: Shape, width: ca.SX) -> ca.SX:
        """Return the power dissipated by the ground.

        Parameters
        ----------
        shape : Shape
            The swimmer's shape.
        width : casadi.SX
            Has no effect.

        Returns
        -------
        casadi.SX
        """
        if shape is not self.swimmer.shape:
            raise ArgumentError("the shape is not that of the swimmer; give the same one")
        return self.swimmer.power

    symmetric: ClassVar = True
    """Whether a reversed stroke returns the body."""


Ground = Dry | Viscous


def ground_of(given: Ground | Swimmer | Elliptic | Sequence[Elliptic]) -> Ground:
    """Return the ground from a law for all masses, one for each, or a body with its drags."""
    if isinstance(given, Dry | Viscous):
        return given
    if isinstance(given, Swimmer):
        return Viscous(given)
    return Dry((given,) if isinstance(given, Elliptic) else tuple(given))


def _squared(law: Elliptic, v: ca.SX) -> ca.SX:
    """Return the squared power of the law, which is differentiable at rest."""
    return (law.along(v[0]) * v[0]) ** 2 + (law.sideways * v[1]) ** 2


def _numbers(law: Elliptic) -> tuple[float, float, float]:
    return float(law.forward), float(law.backward), float(law.sideways)
