"""Loads of pins and skids while a body moves slowly, and the work of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.planar.body.shape import Shape
from wormopt.systems.planar.kinematic.constraints import Constraints, kinematics_at
from wormopt.systems.planar.kinematic.motion import KinematicMotion, _held, _which

_RESTS = 1e-11  # over the fastest mass; slower ones rest, where dry friction is not determined


class Slips(Protocol):
    """A law of the ground with a force of sliding: dry or viscous."""

    def slip_force(self, v: ca.SX) -> ca.SX:
        """Return the force of sliding with velocity ``v`` (2)."""
        ...


Ground = Slips | Sequence[Slips | None] | None
"""Law of all masses, or of each; None if the ground does not resist."""


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces of the ground on the masses of a body that moves without inertia.

    Parameters
    ----------
    tau : ndarray, shape (m,)
        Phases of the stroke.
    force : ndarray, shape (m, n, 2)
        Force on every mass along its heading and to its left. If loads are not determined, the
        balanced ones with the least sum of squares; NaN if none balance.
    determined : ndarray, shape (m,)
        Whether balance alone determines the loads of pins and skids.
    power : ndarray, shape (m,)
        Power dissipated by sliding, by the phase.
    velocity : ndarray, shape (m, n, 2)
        Velocities of the masses along their headings and to their left, by the phase.
    pinned : ndarray, shape (m, n)
        Which masses are pins.
    """

    tau: np.ndarray
    force: np.ndarray
    determined: np.ndarray
    power: np.ndarray
    velocity: np.ndarray
    pinned: np.ndarray

    @property
    def pin_load(self) -> float:
        """Largest force on a pin; 0 without pins."""
        size = np.hypot(self.force[..., 0], self.force[..., 1])
        return float(size[self.pinned].max()) if self.pinned.any() else 0.0


def loads(motion: KinematicMotion, ground: Ground, tau: np.ndarray | None = None) -> Loads:
    """Return the loads of pins and skids, for given friction of sliding masses.

    Parameters
    ----------
    motion : KinematicMotion
        The motion.
    ground : law, sequence of laws or None
        Resistance to sliding of all masses, or of each; None for no resistance. A pin has no
        friction beside its load; a skid has that along its heading.
    tau : ndarray, shape (m,), optional
        Phases; those of the quadrature if left out, with which ``power`` integrates to the work.

    Returns
    -------
    Loads

    Raises
    ------
    ArgumentError
        If the number of laws is not that of the masses.

    Notes
    -----
    Force and moment balance without inertia. Three rows of constraints are statically determined;
    each further one leaves a load undetermined. The force on a mass that rests on dry ground
    without a pin is undetermined too; it counts as none, and the instant as not determined.
    """
    shape = motion.shape
    tau = motion.course.nodes if tau is None else np.asarray(tau, dtype=float)
    laws = _laws(shape, ground)
    found, s = _held(shape, motion.stroke, motion.phases, tau)
    at, rates = kinematics_at(shape, s), motion.stroke.at(tau)[1]
    v = np.einsum("mrj,mj->mr", at.J, found.twist) + np.einsum("mrs,ms->mr", at.B, rates)
    m, n = len(tau), shape.n_points
    v = v.reshape(m, n, 2)
    force, known = np.zeros((m, n, 2)), np.ones(m, bool)
    pinned = np.zeros((m, n), bool)
    which = _which(motion.phases, tau)
    fastest = np.abs(v).max() if v.size else 0.0
    for k in np.unique(which):
        mine, constraints = which == k, motion.phases[k].constraints
        _slide(force, known, v, mine, constraints, laws, _RESTS * fastest)
    power = -np.sum(force * v, axis=(1, 2))
    for k in np.unique(which):
        mine, constraints = which == k, motion.phases[k].constraints
        pinned[np.ix_(mine, list(constraints.pins))] = True
        reactions = _balance(at.J[mine], at.scaling[mine], force[mine], constraints)
        flat = force[mine].reshape(mine.sum(), -1)
        flat[:, constraints.rows] += reactions
        force[mine] = flat.reshape(-1, n, 2)
        known[mine] &= constraints.count == 3
    return Loads(tau, force, known, power, v, pinned)


def _slide(
    force: np.ndarray,
    known: np.ndarray,
    v: np.ndarray,
    mine: np.ndarray,
    constraints: Constraints,
    laws: Sequence[ca.Function | None],
    least: float,
) -> None:
    """Add the friction of sliding masses in place."""
    for i, law in enumerate(laws):
        if law is None or i in constraints.pins:
            continue
        own = v[mine, i].copy()
        if i in constraints.skids:
            own[:, 1] = 0.0
        moves = np.hypot(own[:, 0], own[:, 1]) > least
        slip = np.zeros_like(own)
        if moves.any():
            slip[moves] = np.asarray(law(own[moves].T)).T
        force[mine, i] = slip
        if i in constraints.skids:
            force[mine, i, 1] = 0.0
        known[mine] &= moves


def _balance(
    J: np.ndarray, T: np.ndarray, force: np.ndarray, constraints: Constraints
) -> np.ndarray:
    """Return least reactions (m, r) of constraints that balance forces (m, n, 2)."""
    C = J[:, constraints.rows] @ T
    on = np.einsum("mrj,mr->mj", J @ T, force.reshape(len(force), -1))
    return -np.einsum("mrj,mj->mr", np.linalg.pinv(np.swapaxes(C, 1, 2)), on)


def _laws(shape: Shape, ground: Ground) -> list[ca.Function | None]:
    n = shape.n_points
    laws = list(ground) if isinstance(ground, Sequence) else [ground] * n
    if len(laws) != n:
        raise ArgumentError(f"{len(laws)} laws for {n} masses; give one, or one for each")
    return [None if law is None else _function(law) for law in laws]


def _function(law: Slips) -> ca.Function:
    v = ca.SX.sym("v", 2)
    return ca.Function("slip", [v], [law.slip_force(v)])


def spike_margins(motion: KinematicMotion, found: Loads) -> tuple[float, float]:
    """Return the least velocity of free spikes along their heading, by the phase, and least hold.

    The hold is the forward force on spikes that are pins. Spikes fail if a value is negative beyond
    round-off; it is inf without such spikes.
    """
    which = _which(motion.phases, found.tau)
    slip, pull = np.inf, np.inf
    for k in np.unique(which):
        mine, constraints = which == k, motion.phases[k].constraints
        for i in constraints.spikes:
            if i in constraints.pins:
                pull = min(pull, float(found.force[mine, i, 0].min()))
            else:
                slip = min(slip, float(found.velocity[mine, i, 0].min()))
    return slip, pull
