"""Friction laws of one contact: smooth forces for ODE solvers, set-valued laws for others.

Values of a law may be CasADi symbols, so that one compiled model serves many values; symbols
are not checked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Protocol, runtime_checkable

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.given import fields_of, make_plain

Expression = ca.SX | float


@runtime_checkable
class Law(Protocol):
    """Friction law as solvers use it; forces act on the worm, velocities are those of the contact.

    A law has two forms: ``smooth`` is the regularised force, ``slip_force``
    and ``stick_interval`` are the set-valued law itself. Each is the limit of the other as
    ``v_reg`` tends to 0.

    Examples
    --------
    Coulomb friction that resists with 1 forward and with 2 backward:

    >>> import wormopt as wo
    >>> law = wo.Coulomb(1.0, 2.0)
    >>> isinstance(law, Law), law.directions, law.stick_interval, law.slip_force(0.5, 1)
    (True, (1, -1), (-1.0, 2.0), -1.0)
    """

    @property
    def directions(self) -> tuple[int, ...]:
        """Signs of the velocities at which the contact may slide."""
        ...

    @property
    def stick_interval(self) -> tuple[Expression, Expression]:
        """Smallest and largest force that the contact can hold at rest."""
        ...

    def slip_force(self, v: Expression, direction: int) -> Expression:
        """Force while sliding with velocity ``v`` in ``direction`` (+1 or -1).

        Parameters
        ----------
        v : casadi.SX or float
            Velocity.
        direction : {+1, -1}
            Forward or backward.

        Returns
        -------
        casadi.SX or float
            Force on the worm.
        """
        ...

    def smooth(self, v: Expression, v_reg: Expression) -> Expression:
        """Regularised force at velocity ``v``, steep over the width ``v_reg``.

        Parameters
        ----------
        v : casadi.SX or float
            Velocity.
        v_reg : float or casadi.SX
            Width of the steep part, positive.

        Returns
        -------
        casadi.SX or float
            Force on the worm.
        """
        ...


def _ascend(*values: Expression) -> bool:
    """Whether the numbers among the values ascend, weakly; False for NaN."""
    last = -math.inf
    for value in values:
        if not isinstance(value, ca.SX):
            if not last <= value:
                return False
            last = value
    return True


def positive(value: Expression) -> bool:
    """Whether a number is positive; symbols pass."""
    return True if isinstance(value, ca.SX) else value > 0


class _TwoWay(Law):
    """Common part of laws that let a contact slide in both directions."""

    forward: Expression
    backward: Expression

    @property
    def directions(self) -> tuple[int, ...]:
        """Directions in which the force is finite."""
        pairs = ((1, self.forward), (-1, self.backward))
        return tuple(sign for sign, force in pairs if isinstance(force, ca.SX) or force < math.inf)

    def smooth(self, v: Expression, v_reg: Expression) -> Expression:
        # a blend of both sliding forces by tanh, as in chapter 2.4; stiction is lost
        if len(self.directions) < 2:
            raise ArgumentError(
                f"smooth contact needs finite friction, not {self}; write a finite force, or treat "
                "contact as exact"
            )
        ahead, behind = self.slip_force(v, 1), self.slip_force(v, -1)
        return (ahead + behind) / 2 + (ahead - behind) / 2 * ca.tanh(v / v_reg)


def symbols_of(law: object) -> dict[str, ca.SX]:
    """Fields of a law that are symbolic scalars."""
    return {
        name: value
        for name, value in fields_of(law).items()
        if isinstance(value, ca.SX) and value.numel() == 1
    }


def check_numbers(law: Any, optional: Sequence[str] = ()) -> None:
    """Refuse fields that are neither numbers nor symbols, a list for instance.

    Names in `optional` may be None.
    """
    for name, value in fields_of(law).items():
        if isinstance(value, float) or (value is None and name in optional):  # the usual case first
            continue
        if getattr(value, "ndim", None) == 0:
            make_plain(law, name)
            value = getattr(law, name)
        scalar = value.is_scalar() if isinstance(value, ca.SX) else isinstance(value, Real)
        if not scalar or isinstance(value, bool):
            raise ArgumentError(
                f"{name} must be a number, not {value!r:.60}; write one law "
                "per mass for masses that differ"
            )


def _check_forces(slide: Expression, stick: Expression | None) -> None:
    """Refuse sliding forces above the stiction force of the same direction."""
    if not _ascend(0.0, slide, *(() if stick is None else (stick,))):
        raise ArgumentError("friction forces must satisfy 0 <= sliding force <= stiction force")


@dataclass(frozen=True)
class Coulomb(_TwoWay):
    """Anisotropic dry friction with stiction, equation (9).

    Parameters
    ----------
    forward : float or casadi.SX
        Sliding force F+ that opposes forward motion, in force units, not negative. With
        ``math.inf`` it never slides forward; this takes exact contact.
    backward : float or casadi.SX
        Sliding force F- that opposes backward motion, likewise.
    stick_forward, stick_backward : float or casadi.SX, optional
        Largest resistance at rest against being moved forward and backward (stiction). They
        default to the sliding forces.

    Raises
    ------
    ArgumentError
        If a force is negative or a stiction force is below its sliding force.

    Examples
    --------
    >>> law = Coulomb(forward=1.0, backward=10.0)
    >>> law.slip_force(0.3, +1), law.slip_force(-0.3, -1), law.stick_interval
    (-1.0, 10.0, (-1.0, 10.0))
    """

    forward: Expression
    backward: Expression
    stick_forward: Expression | None = None
    stick_backward: Expression | None = None

    def __post_init__(self) -> None:
        check_numbers(self, optional=("stick_forward", "stick_backward"))
        _check_forces(self.forward, self.stick_forward)
        _check_forces(self.backward, self.stick_backward)

    @property
    def stick_interval(self) -> tuple[Expression, Expression]:
        """Forces from ``-stick_forward`` to ``+stick_backward``."""
        ahead = self.forward if self.stick_forward is None else self.stick_forward
        behind = self.backward if self.stick_backward is None else self.stick_backward
        return -ahead, behind

    def slip_force(self, v: Expression, direction: int) -> Expression:
        return -self.forward if direction > 0 else self.backward


@dataclass(frozen=True)
class Stribeck(_TwoWay):
    """Dry friction whose sliding force falls from stiction to Coulomb's value.

    The force in a direction is F + (Fs - F) exp(-(v / v_stribeck)^2).

    Parameters
    ----------
    forward, backward : float or casadi.SX
        Sliding forces F+ and F- at high speed.
    stick_forward, stick_backward : float or casadi.SX
        Stiction forces, at least the sliding forces.
    v_stribeck : float or casadi.SX
        Velocity over which the force falls, positive.

    Raises
    ------
    ArgumentError
        If the forces are out of order or ``v_stribeck`` is not positive.

    Examples
    --------
    >>> law = Stribeck(1.0, 2.0, stick_forward=1.5, stick_backward=4.0, v_stribeck=0.1)
    >>> float(law.slip_force(0.0, 1)), round(float(law.slip_force(-9.0, -1)), 12)
    (-1.5, 2.0)
    """

    forward: Expression
    backward: Expression
    stick_forward: Expression
    stick_backward: Expression
    v_stribeck: Expression

    def __post_init__(self) -> None:
        check_numbers(self)
        _check_forces(self.forward, self.stick_forward)
        _check_forces(self.backward, self.stick_backward)
        if not positive(self.v_stribeck):
            raise ArgumentError("v_stribeck must be positive")

    @property
    def stick_interval(self) -> tuple[Expression, Expression]:
        """Forces from ``-stick_forward`` to ``+stick_backward``."""
        return -self.stick_forward, self.stick_backward

    def slip_force(self, v: Expression, direction: int) -> Expression:
        decay = ca.exp(-((v / self.v_stribeck) ** 2))
        if direction > 0:
            return -(self.forward + (self.stick_forward - self.forward) * decay)
        return self.backward + (self.stick_backward - self.backward) * decay


@dataclass(frozen=True)
class Viscous(_TwoWay):
    """Linear drag -k v, which never sticks.

    Parameters
    ----------
    drag : float or casadi.SX
        Coefficient k in force per velocity, not negative.

    Raises
    ------
    ArgumentError
        If ``drag`` is negative.

    Examples
    --------
    >>> Viscous(2.0).slip_force(0.5, 1)
    -1.0
    """

    drag: Expression

    def __post_init__(self) -> None:
        check_numbers(self)
        if not _ascend(0.0, self.drag):
            raise ArgumentError("drag must not be negative")

    @property
    def directions(self) -> tuple[int, ...]:
        """Both directions are possible."""
        return (1, -1)

    @property
    def stick_interval(self) -> tuple[float, float]:
        """At rest the force is zero."""
        return 0.0, 0.0

    def slip_force(self, v: Expression, direction: int) -> Expression:
        return -self.drag * v

    def smooth(self, v: Expression, v_reg: Expression) -> Expression:
        return -self.drag * v


class _Holding(Law):
    """Common part of laws that hold without limit; `scale` is the size of their smooth force."""

    scale: Expression

    def __post_init__(self) -> None:
        check_numbers(self)
        if not positive(self.scale):
            raise ArgumentError("scale must be positive")

    def slip_force(self, v: Expression, direction: int) -> Expression:
        if direction not in self.directions:
            where = "" if not self.directions else " backward"
            raise ArgumentError(f"a {type(self).__name__} does not slide{where}")
        return 0.0


@dataclass(frozen=True)
class Spike(_Holding):
    """Unilateral spike, equation (4): v >= 0, load >= 0, v * load = 0.

    It is the limit of dry friction without forward resistance as F- grows beyond bounds.

    Parameters
    ----------
    scale : float or casadi.SX, optional
        Load that the smooth stand-in carries at v = -3/4 v_reg; a size, not a limit. At rest it
        carries half of it.

    Raises
    ------
    ArgumentError
        If ``scale`` is not positive.

    Examples
    --------
    >>> Spike().directions, Spike().stick_interval
    ((1,), (0.0, inf))
    """

    scale: Expression = 1.0

    @property
    def directions(self) -> tuple[int, ...]:
        """Only forward."""
        return (1,)

    @property
    def stick_interval(self) -> tuple[float, float]:
        """Any force that pushes forward."""
        return 0.0, math.inf

    def smooth(self, v: Expression, v_reg: Expression) -> Expression:
        # a hyperbola, steep for v < 0 and never negative
        return self.scale * (ca.sqrt(v**2 + v_reg**2) - v) / (2 * v_reg)


@dataclass(frozen=True)
class NoSlip(_Holding):
    """A contact never slides: a pin along one direction, a skid or wheel across it.

    Parameters
    ----------
    scale : float or casadi.SX, optional
        Force of the smooth stand-in at v = v_reg; a size, not a limit.

    Raises
    ------
    ArgumentError
        If ``scale`` is not positive.

    Examples
    --------
    >>> NoSlip().directions, NoSlip().stick_interval
    ((), (-inf, inf))
    """

    scale: Expression = 1.0

    @property
    def directions(self) -> tuple[int, ...]:
        """No direction: it never slides."""
        return ()

    @property
    def stick_interval(self) -> tuple[float, float]:
        """Any force."""
        return -math.inf, math.inf

    def smooth(self, v: Expression, v_reg: Expression) -> Expression:
        return -self.scale * v / v_reg
