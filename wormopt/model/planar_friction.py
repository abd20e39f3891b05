"""Friction laws of a contact that slides in the plane: forward, backward and sideways.

Velocities and forces have two components in the frame of the body: along its heading and to the
left of it. The numbers of a law may be CasADi symbols, as in `wormopt.model.friction`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Expression, check_numbers, positive

# Steps of Hebden's method to find the nearest point of an ellipse to rounding.
_HEBDEN = 8


@runtime_checkable
class PlanarLaw(Protocol):
    """Friction law in the plane as solvers use it; forces act on the worm.

    `slip_force` with `gauge` is the set-valued law, `smooth` the regularised one; each is the
    limit of the other as ``v_reg`` tends to 0.

    Examples
    --------
    Ground that resists forward motion with 1, backward motion with 2 and sideways motion with 3:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> law = wo.Elliptic(1.0, 2.0, 3.0)
    >>> isinstance(law, PlanarLaw), law.slip_force(ca.SX([0.5, 0.0]))
    (True, SX([-1, 0]))
    """

    associated: bool
    """Whether slip is normal to the set of holding forces: then motion minimises a function."""

    def slip_force(self, v: ca.SX) -> ca.SX:
        """Force while sliding with velocity ``v``.

        Parameters
        ----------
        v : casadi.SX
            Velocity along the heading and to its left, not 0.

        Returns
        -------
        casadi.SX
            Force on the worm, likewise.
        """
        ...

    def gauge(self, force: ca.SX) -> ca.SX:
        """Size of a force at rest, relative to the largest force that the ground can hold.

        Parameters
        ----------
        force : casadi.SX
            Force on the worm, along the heading and to its left.

        Returns
        -------
        casadi.SX
            At most 1 where the ground can hold it.
        """
        ...

    def slip_direction(self, force: ca.SX) -> ca.SX:
        """Direction into which a contact begins to slide from ``force``.

        Parameters
        ----------
        force : casadi.SX
            Force on the worm at which the gauge is 1.

        Returns
        -------
        casadi.SX
            Direction of the velocity, of any length.
        """
        ...

    def smooth(self, v: ca.SX, v_reg: Expression) -> ca.SX:
        """Regularised force at velocity ``v``, steep over the width ``v_reg``.

        Parameters
        ----------
        v : casadi.SX
            Velocity along the heading and to its left.
        v_reg : float or casadi.SX
            Width of the steep part, positive.

        Returns
        -------
        casadi.SX
            Force on the worm.
        """
        ...


class _Ellipse(PlanarLaw):
    """Common part of laws with elliptic holding forces; F+ and F- may differ."""

    forward: Expression
    backward: Expression
    sideways: Expression

    def __post_init__(self) -> None:
        check_numbers(self)
        for name in ("forward", "backward", "sideways"):
            if not positive(getattr(self, name)):
                raise ArgumentError(
                    f"{name} must be positive; for a direction without resistance write two "
                    "contacts, one along and one across, each with Coulomb or Spike"
                )

    def along(self, v_t: ca.SX) -> ca.SX:
        """Resistance to motion along the heading with velocity ``v_t``: F+ ahead, else F-."""
        if ca.is_equal(ca.SX(self.forward), ca.SX(self.backward)):
            return ca.SX(self.forward)
        return ca.if_else(v_t >= 0, self.forward, self.backward)

    def gauge(self, force: ca.SX) -> ca.SX:
        # length of the force in units of the radius of the ellipse in its direction
        return ca.sqrt((force[0] / self.along(-force[0])) ** 2 + (force[1] / self.sideways) ** 2)

    @property
    def _largest(self) -> Expression:
        return ca.fmax(ca.fmax(self.forward, self.backward), self.sideways)


@dataclass(frozen=True)
class Elliptic(_Ellipse):
    """Dry friction with an ellipse of forces and associated slip (maximum dissipation).

    The force at velocity v is the point of the ellipse with the largest power, -(Ft² v_t, Fn²
    v_n)/psi with the power psi = sqrt(Ft² v_t² + Fn² v_n²), where Ft is F+ ahead and F- back.

    Parameters
    ----------
    forward, backward : float or casadi.SX
        Resistance F+ against motion along the heading and F- against it, positive.
    sideways : float or casadi.SX
        Resistance Fn to either side, positive.

    Raises
    ------
    ArgumentError
        If a resistance is not positive.

    Notes
    -----
    Motion straight ahead is that of `Coulomb` with the same F+ and F-; three equal numbers are
    isotropic friction.

    Examples
    --------
    >>> import casadi as ca
    >>> law = Elliptic(1.0, 3.0, sideways=2.0)
    >>> law.slip_force(ca.SX([0.5, 0.0])), law.slip_force(ca.SX([-0.5, 0.0]))
    (SX([-1, 0]), SX([3, 0]))
    >>> law.gauge(ca.SX([0.0, 1.0]))
    SX(0.5)
    """

    forward: Expression
    backward: Expression
    sideways: Expression

    associated = True

    def power(self, v: ca.SX) -> ca.SX:
        """Power psi that sliding with velocity ``v`` takes; the force is minus its gradient.

        Parameters
        ----------
        v : casadi.SX
            Velocity along the heading and to its left.

        Returns
        -------
        casadi.SX
            Convex in v, and 0 at rest.
        """
        return ca.sqrt((self.along(v[0]) * v[0]) ** 2 + (self.sideways * v[1]) ** 2)

    def slip_force(self, v: ca.SX) -> ca.SX:
        return -self._squares(v) / self.power(v)

    def slip_direction(self, force: ca.SX) -> ca.SX:
        # the normal of the ellipse
        return -ca.vertcat(force[0] / self.along(-force[0]) ** 2, force[1] / self.sideways**2)

    def nearest(self, force: ca.SX) -> ca.SX:
        """Force that the ground can hold and that is nearest to ``force``.

        Parameters
        ----------
        force : casadi.SX
            Force on the worm, along the heading and to its left.

        Returns
        -------
        casadi.SX
            `force` itself, or the point of the ellipse nearest to it.
        """
        squares = ca.vertcat(self.along(-force[0]) ** 2, ca.SX(self.sideways) ** 2)
        shift, near = ca.SX(0), force
        for _ in range(_HEBDEN):  # Newton's method for 1 / gauge = 1
            slope = ca.sum1(near**2 / squares / (squares + shift))
            size = self.gauge(near)
            shift += size**2 / slope * (size - 1)
            near = squares * force / (squares + shift)
        return ca.if_else(self.gauge(force) <= 1, force, near)

    def smooth(self, v: ca.SX, v_reg: Expression) -> ca.SX:
        # the gradient of sqrt(psi² + width²)
        width = v_reg * self._largest
        return -self._squares(v) / ca.sqrt(self.power(v) ** 2 + width**2)

    def _squares(self, v: ca.SX) -> ca.SX:
        return ca.vertcat(self.along(v[0]) ** 2 * v[0], self.sideways**2 * v[1])


@dataclass(frozen=True)
class AnisotropicCoulomb(_Ellipse):
    """Dry friction -(Ft v_t, Fn v_n)/|v|, which depends on the direction of slip; not associated.

    The law of Hu, Nirody, Scott and Shelley, PNAS 106 (2009) 10081, for snakes. It has the ellipse
    of `Elliptic` and assigns its forces to other velocities, so that no minimum principle holds
    and motions need not be unique unless the resistances are equal.

    Parameters
    ----------
    forward, backward : float or casadi.SX
        Resistance F+ against motion along the heading and F- against it, positive.
    sideways : float or casadi.SX
        Resistance Fn to either side, positive.

    Raises
    ------
    ArgumentError
        If a resistance is not positive.

    Examples
    --------
    >>> import casadi as ca
    >>> AnisotropicCoulomb(1.0, 1.0, sideways=2.0).slip_force(ca.SX([3.0, 4.0]))
    SX([-0.6, -1.6])
    """

    forward: Expression
    backward: Expression
    sideways: Expression

    associated = False

    def slip_force(self, v: ca.SX) -> ca.SX:
        return -self._products(v) / ca.norm_2(v)

    def slip_direction(self, force: ca.SX) -> ca.SX:
        return -ca.vertcat(force[0] / self.along(-force[0]), force[1] / self.sideways)

    def smooth(self, v: ca.SX, v_reg: Expression) -> ca.SX:
        return -self._products(v) / ca.sqrt(ca.sumsqr(v) + v_reg**2)

    def _products(self, v: ca.SX) -> ca.SX:
        return ca.vertcat(self.along(v[0]) * v[0], self.sideways * v[1])
