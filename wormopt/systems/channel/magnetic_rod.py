"""A magnetisable rod in the field of blocks of coils: forces on its nodes, and when coils are on.

A body of susceptibility chi that hardly changes the field is pulled towards strong fields with the
force (mu0 chi / 2) grad H² per volume. It acts on the centre line, lumped at the nodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.magnetics.blocks import BlockField
from wormopt.magnetics.material import MU0
from wormopt.model.model import Schedule
from wormopt.systems.channel.rod import Rod

__all__ = [
    "Blocks",
    "block_energy",
    "block_load",
    "block_schedule",
    "magnetic_strength",
    "switched_blocks",
]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which coils are on when: one block of neighbours, repeated along the row.

    Parameters
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Times from 0 on, in s; the last is the period.
    first, count : ndarray of int, shape (pieces,)
        First coil of the block and number of its coils, on each piece.
    """

    breaks: np.ndarray
    first: np.ndarray
    count: np.ndarray

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of coils that occur, ascending."""
        return tuple(int(k) for k in np.unique(self.count))


def switched_blocks(every: int, rate: float, duration: float = 3.0, shift: float = 0.0) -> Blocks:
    """Switch coils on in turn, each for so long.

    Parameters
    ----------
    every : int
        The pattern repeats after so many coils along the row.
    rate : float
        Switches per second.
    duration : float, optional
        How long each coil is on, in switches, at least 1.
    shift : float, optional
        By how much every second switch comes late, in switches.

    Returns
    -------
    Blocks
        Of the period 2 ``every`` / rate, since the sides of the coils may have changed after one
        repeat. Coil k lies at k pitches, on the positive side if k is even.

    Raises
    ------
    ArgumentError
        If numbers are out of range, or more coils would be on than the pattern has.

    Examples
    --------
    >>> blocks = switched_blocks(7, rate=10.0)
    >>> blocks.first[:3].tolist(), blocks.counts
    ([-2, -1, 0], (3,))
    >>> switched_blocks(7, rate=10.0, duration=2.5).counts
    (2, 3)
    """
    if not (0 < rate < math.inf and duration >= 1 and abs(shift) < 1):
        raise ArgumentError("rate must be positive, duration at least 1, shift between -1 and 1")
    if duration + abs(shift) + 1 > every:
        raise ArgumentError(f"coils on for {duration:g} switches do not fit into {every} coils")
    # coil k goes on at k, the odd ones later by the shift; some from before time 0 are on then
    coils = np.arange(-every, 2 * every)
    on = coils + shift * (coils % 2)
    events = np.concatenate([[0.0, 2 * every], on, on + duration])
    events = np.unique(np.round(events[(events >= 0) & (events <= 2 * every)], 12))
    middle = (events[:-1] + events[1:]) / 2
    lit = (on[:, None] <= middle) & (middle < on[:, None] + duration)
    return Blocks(events / rate, coils[np.argmax(lit, axis=0)], lit.sum(axis=0))


def magnetic_strength(rod: Rod, susceptibility: float, ampere_turns: float) -> float:
    """Force along the rod over the gradient of H² per squared ampere-turn.

    Parameters
    ----------
    rod : Rod
        For its cross section.
    susceptibility : float
        Magnetisation over the field without the rod.
    ampere_turns : float
        Of every coil that is on, in A.

    Returns
    -------
    float
        mu0 chi A N² / 2, in N m² (the gradient is in 1/m³, the force per length in N/m).
    """
    return MU0 * susceptibility / 2 * rod.area * ampere_turns**2


def block_schedule(blocks: Blocks, pitch: float, strength: float) -> Schedule:
    """Say when which block is on, for the function of `block_load`.

    Parameters
    ----------
    blocks : Blocks
        Which coils are on.
    pitch : float
        Of the coils, in m.
    strength : float
        From `magnetic_strength`.

    Returns
    -------
    Schedule
        Middle of a block, side of its first coil, strength, and which of the fields.
    """
    which = np.searchsorted(blocks.counts, blocks.count)
    middle = pitch * (blocks.first + (blocks.count - 1) / 2)
    side = 1.0 - 2.0 * (blocks.first % 2)
    values = np.stack([middle, side, np.full(len(middle), strength), which], axis=1)
    return Schedule(
        "coils", ca.SX.sym("coils", 4), ca.SX.sym("begin"), blocks.breaks, values, periodic=True
    )


def block_load(rod: Rod, fields: Sequence[BlockField]) -> ca.Function:
    """Forces on the nodes of a rod.

    Parameters
    ----------
    rod : Rod
        Whose nodes.
    fields : sequence of BlockField
        Of blocks of the numbers of coils that occur, in that order.

    Returns
    -------
    casadi.Function
        From the places of the nodes (x, y, angle) and the values of `block_schedule` to the
        forces along and across, in N.
    """
    place, coils, weight = ca.MX.sym("place", 2), ca.MX.sym("coils", 4), ca.MX.sym("weight")
    seen = ca.vertcat(place[0] - coils[0], coils[1] * place[1])
    several = [field.gradient for field in fields]
    if len(several) > 1:
        slope = ca.Function.conditional("which", several[:-1], several[-1])(coils[3], seen)
    else:
        slope = several[0](seen)
    force = coils[2] * weight * ca.vertcat(slope[0], coils[1] * slope[1])
    one = ca.Function("pull", [place, coils, weight], [force])
    q, n = ca.MX.sym("q", 3 * rod.count), rod.count
    places = ca.horzcat(q[:n], q[n : 2 * n]).T
    forces = one.map(n)(places, ca.repmat(coils, 1, n), ca.DM(rod.weights).T)
    return ca.Function("load", [q, coils], [ca.vec(forces.T)])


def block_energy(rod: Rod, field: BlockField) -> ca.Function:
    """Magnetic energy of a rod in the field of a block: the potential of `block_load`'s forces.

    Parameters
    ----------
    rod : Rod
        Whose nodes.
    field : BlockField
        Of the block.

    Returns
    -------
    casadi.Function
        From the places of the nodes (x, y, angle) and a column of values as in `block_schedule`
        (the last one is not looked at) to the energy -(mu0 chi A / 2) times the integral of H²
        along the rod, by the lengths that the nodes stand for, in J.
    """
    place = ca.SX.sym("place", 2)
    square = ca.Function("square", [place], [field.expression(place[0], place[1])], {"cse": True})
    q, coils, n = ca.MX.sym("q", 3 * rod.count), ca.MX.sym("coils", 4), rod.count
    seen = ca.horzcat(q[:n] - coils[0], coils[1] * q[n : 2 * n]).T
    energy = -coils[2] * (square.map(n)(seen) @ ca.DM(rod.weights))
    return ca.Function("energy", [q, coils], [energy])
