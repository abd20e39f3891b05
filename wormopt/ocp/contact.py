"""Contact forces in a nonlinear program: prescribed modes, smoothed, complementary."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.given import check_kind, check_number, make_plain
from wormopt.model.model import Contact, Model
from wormopt.model.modes import ModeSequence
from wormopt.model.planar_friction import PlanarLaw


def _column(*entries: ca.SX | float) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *entries)


@dataclass(frozen=True, eq=False)
class Closure:
    """Contact forces of a model at one instant, and the conditions that determine them."""

    forces: ca.SX  # (n_c, 1) by states, unknowns and level
    unknowns: ca.SX = field(default_factory=_column)  # besides states and inputs
    nominal: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n_unknowns,) usual sizes
    lower: ca.SX = field(default_factory=_column)  # (n_unknowns, 1) by the model's parameters
    upper: ca.SX = field(default_factory=_column)  # (n_unknowns, 1) by the model's parameters
    # parameters that may differ from arc to arc: a width, a relaxation, modes
    level: ca.SX = field(default_factory=_column)
    # vanish, scaled; without the model's own force symbols
    equal: ca.SX = field(default_factory=_column)
    small: ca.SX = field(default_factory=_column)  # scaled, of size at most level[0]
    # scaled speeds in the directions of sliding, and distances from sliding: on an arc no product
    # of a speed, at its start or at a point, and the sum of distances exceeds level[0]
    speeds: ca.SX = field(default_factory=_column)
    gaps: ca.SX = field(default_factory=_column)


class Treatment(Protocol):
    """Treatment of a Model's contacts in a nonlinear program."""

    def close(self, model: Model) -> Closure:
        """Conditions that determine the contact forces of a model.

        Parameters
        ----------
        model : Model
            Any model.
        """
        ...


@dataclass(frozen=True)
class FixedModes(Treatment):
    """Prescribes which contact sticks or slides in each phase; switching times are free.

    Between switches everything is smooth, so that collocation keeps its full order. A contact may
    leave rest before its force reaches stiction: a simulation shows whether it does.

    Parameters
    ----------
    modes : ModeSequence, optional
        The phases; `Transcription.bounds` can be given others.
    active : tuple of tuple of int, optional
        Per phase and input: -1 holds it at its lower limit, +1 at its upper one, 0 leaves it free.

    Examples
    --------
    A contact that slides forward, then sticks:

    >>> import wormopt as wo
    >>> FixedModes(wo.ModeSequence(((1,), (0,)))).modes.phases
    ((1,), (0,))
    """

    modes: ModeSequence | None = None
    active: tuple[tuple[int, ...], ...] | None = None

    def __post_init__(self) -> None:
        if self.modes is not None:
            check_kind("modes", self.modes, ModeSequence)

    def close(self, model: Model) -> Closure:
        # Forces are unknowns; their conditions depend on the mode, see `Arc`. The level holds, by
        # contact: sticks (0 or 1), direction of sliding (+-1), and whether the motion leaves its
        # force open (0 or 1).
        _refuse_planar(model, "FixedModes")
        n = len(model.contacts)
        nominal = np.array([c.nominal_force for c in model.contacts])
        free = ca.SX.inf(n)
        level = ca.SX.sym("modes", 3 * n)
        return Closure(model.forces, model.forces, nominal, -free, free, level)


@dataclass(frozen=True)
class Regularised(Treatment):
    """The law is smoothed over the width ``v_reg``, narrowed from solve to solve.

    Parameters
    ----------
    v_reg : float, optional
        Last width, in the model's unit of speed.
    first : float, optional
        First width.
    ratio : float, optional
        Each width over the one before, below 1.
    active : tuple of tuple of int, optional
        Per phase and input: -1 holds it at its lower limit, +1 at its upper one, 0 leaves it free.

    Raises
    ------
    ArgumentError
        If the width is not positive and finite or the ratio not between 0 and 1.

    Examples
    --------
    >>> Regularised(v_reg=0.01, first=0.1, ratio=0.25).levels
    (0.1, 0.025, 0.01)
    """

    v_reg: float = 0.01
    first: float = 0.1
    ratio: float = 0.4
    active: tuple[tuple[int, ...], ...] | None = None

    def __post_init__(self) -> None:
        _check_levels(self, "v_reg")

    @property
    def levels(self) -> tuple[float, ...]:
        """Widths in the order of solving."""
        return _levels(self.first, self.v_reg, self.ratio)

    def close(self, model: Model) -> Closure:
        # forces are the smooth laws, without further unknowns
        v_reg = ca.SX.sym("v_reg")
        forces = _column(*(c.law.smooth(c.velocity, v_reg) for c in model.contacts))
        return Closure(forces, level=v_reg)


@dataclass(frozen=True)
class Complementarity(Treatment):
    """The set-valued law itself, by complementarity at every collocation point.

    The velocity of a contact is split into parts w >= 0, one for each direction in which it may
    slide, and w (force - force of sliding) = 0 with the force inside the interval of rest. The
    products are relaxed to |w (force - force of sliding)| <= level (Scholtes), and the level is
    lowered from solve to solve. Where stiction is larger than sliding friction, a contact may leave
    rest before its force reaches stiction: a simulation shows whether it does.

    Parameters
    ----------
    residual : float, optional
        Last level, in nominal forces times nominal speeds.
    first : float, optional
        First level.
    ratio : float, optional
        Each level over the one before, below 1.

    Raises
    ------
    ArgumentError
        If the level is not positive and finite or the ratio not between 0 and 1.

    References
    ----------
    S. Scholtes, SIAM J. Optim. 11 (2001) 918-936.

    Examples
    --------
    >>> Complementarity(residual=1e-6, first=1e-2, ratio=0.01).levels
    (0.01, 0.0001, 1e-06)
    """

    residual: float = 1e-8
    first: float = 1e-1
    ratio: float = 0.1

    def __post_init__(self) -> None:
        _check_levels(self, "residual")

    @property
    def levels(self) -> tuple[float, ...]:
        """Relaxations in the order of solving."""
        return _levels(self.first, self.residual, self.ratio)

    def close(self, model: Model) -> Closure:
        # unknowns are the forces, in their interval of rest, and the parts of the velocities
        _refuse_planar(model, "Complementarity")
        parts, equal, small, speeds, rests = [], [], [], [], []
        for c in model.contacts:
            if never_rests(c.law):
                rests.append((-ca.SX.inf(), ca.SX.inf()))
                equal.append((c.force - c.law.slip_force(c.velocity, 1)) / c.nominal_force)
                continue
            w = ca.SX.sym("w", len(c.law.directions))
            parts.append(w)
            rests.append(c.law.stick_interval)
            speeds += [c.nominal_speed] * w.numel()
            signed = ca.dot(ca.DM(c.law.directions), w)
            equal.append((c.velocity - signed) / c.nominal_speed)
            small += _products(c, w)
        forces = np.array([c.nominal_force for c in model.contacts])
        return Closure(
            forces=model.forces,
            unknowns=_column(model.forces, *parts),
            nominal=np.concatenate([forces, speeds]),
            lower=_column(*(low for low, _ in rests), ca.SX.zeros(len(speeds))),
            upper=_column(*(high for _, high in rests), ca.SX.inf(len(speeds))),
            level=ca.SX.sym("relaxation"),
            equal=_column(*equal),
            small=_column(*small),
        )


def _gap(contact: Contact, direction: int) -> ca.SX:
    """Distance of a force from sliding, scaled; its square where it may have either sign."""
    law = contact.law
    slip, held = law.slip_force(contact.velocity, direction), law.stick_interval
    gap = direction * (contact.force - slip) / contact.nominal_force
    same = ca.is_equal(ca.SX(slip), ca.SX(held[0] if direction > 0 else held[1]), 3)
    return gap if same else gap**2


@dataclass(frozen=True)
class SwitchDetection(Complementarity):
    """Complementarity that holds a contact's mode over a whole arc, so that arcs end at switches.

    The products are those of every speed on an arc with every force on it (cross complementarity).
    On a mesh whose arcs have free durations, collocation keeps its full order.

    Parameters
    ----------
    residual, first, ratio : float, optional
        As for `Complementarity`.

    References
    ----------
    A. Nurkanovic, M. Sperl, S. Albrecht, M. Diehl, Numer. Math. 156 (2024) 1115-1162.

    Examples
    --------
    Arcs of free duration, between a tenth and a half of the unit of time:

    >>> import wormopt as wo
    >>> mesh = wo.Mesh(8, 1, wo.Collocation(3, "radau"), 1, spans=(0.1, 0.5))
    >>> SwitchDetection(1e-4, first=0.1, ratio=0.04).levels
    (0.1, 0.004, 0.00016, 0.0001)
    """

    def close(self, model: Model) -> Closure:
        # unknowns are the forces, in their interval of rest
        _refuse_planar(model, "SwitchDetection")
        speeds, gaps, equal, rests = [], [], [], []
        for c in model.contacts:
            if never_rests(c.law):
                rests.append((-ca.SX.inf(), ca.SX.inf()))
                equal.append((c.force - c.law.slip_force(c.velocity, 1)) / c.nominal_force)
                continue
            rests.append(c.law.stick_interval)
            for d in c.law.directions:
                speeds.append(d * c.velocity / c.nominal_speed)
                gaps.append(_gap(c, d))
        return Closure(
            forces=model.forces,
            unknowns=model.forces,
            nominal=np.array([c.nominal_force for c in model.contacts]),
            lower=_column(*(low for low, _ in rests)),
            upper=_column(*(high for _, high in rests)),
            level=ca.SX.sym("relaxation"),
            equal=_column(*equal),
            speeds=_column(*speeds),
            gaps=_column(*gaps),
        )


def _refuse_planar(model: Model, treatment: str) -> None:
    planar = [c.name for c in model.contacts if isinstance(c.law, PlanarLaw)]
    if planar:
        raise ArgumentError(
            f"contact {planar[0]} moves in the plane, which {treatment} does not support; use "
            "Regularised(), or two contacts with laws along a line"
        )


def never_rests(law: Law) -> bool:
    """Whether a law has no holding force: viscous drag, which is smooth."""
    return all(not isinstance(end, ca.SX) and end == 0.0 for end in law.stick_interval)


def _products(contact: Contact, parts: ca.SX) -> list[ca.SX]:
    """Complementarity products of the set-valued law of one contact, scaled."""
    law, size = contact.law, contact.nominal_speed * contact.nominal_force
    return [
        parts[k] * (contact.force - law.slip_force(contact.velocity, d)) / size
        for k, d in enumerate(law.directions)
    ]


def _levels(first: float, last: float, ratio: float) -> tuple[float, ...]:
    if first <= last:
        return (last,)
    count = math.ceil(math.log(last / first) / math.log(ratio) - 1e-9)
    return (*(first * ratio**k for k in range(count)), last)


def _check_levels(treatment: Regularised | Complementarity, last: str) -> None:
    make_plain(treatment, last, "first", "ratio")
    for name in (last, "first", "ratio"):
        check_number(name, getattr(treatment, name), above=0.0)
    if treatment.ratio >= 1:
        raise ArgumentError(f"ratio must be below 1, not {treatment.ratio!r}")
