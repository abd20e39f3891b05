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


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which coils are on when: one block of neighbours, repeated along the row."""

    breaks: np.ndarray  # (pieces + 1,) times from 0 to the period, s
    first: np.ndarray  # (pieces,) first coil of the block
    count: np.ndarray  # (pieces,) number of its coils

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of coils that occur, ascending."""
        return tuple(int(k) for k in np.unique(self.count))


def switched_blocks(every: int, rate: float, duration: float = 3.0, shift: float = 0.0) -> Blocks:
    """Switch coils on in turn, `rate` per second, each for `duration` >= 1 switches.

    Repeats after `every` coils, with period 2 every / rate as sides may alternate; coil k is at
    k pitches, positive side if even. Every second switch is `shift` late. May ArgumentError.
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
    """Axial force on the rod over the gradient of H² per squared ampere-turn: mu0 chi A N² / 2.

    In N m² (gradient in 1/m³, force per length in N/m); `ampere_turns` of each coil on.
    """
    return MU0 * susceptibility / 2 * rod.area * ampere_turns**2


def block_schedule(blocks: Blocks, pitch: float, strength: float) -> Schedule:
    """Schedule of the blocks, as the function of `block_load` takes it.

    Values: middle of the block, side of its first coil, `strength`, and index of the field.
    """
    which = np.searchsorted(blocks.counts, blocks.count)
    middle = pitch * (blocks.first + (blocks.count - 1) / 2)
    side = 1.0 - 2.0 * (blocks.first % 2)
    values = np.stack([middle, side, np.full(len(middle), strength), which], axis=1)
    return Schedule(
        "coils", ca.SX.sym("coils", 4), ca.SX.sym("begin"), blocks.breaks, values, periodic=True
    )


def block_load(rod: Rod, fields: Sequence[BlockField]) -> ca.Function:
    """Forces along and across on the nodes of a rod, in N, as a CasADi function.

    Takes the nodes' places (x, y, angle) and the values of `block_schedule`; `fields` are of
    blocks of the numbers of coils that occur, in that order.
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
    """Magnetic energy of a rod in a block's field, in J: potential of `block_load`'s forces.

    From places (x, y, angle) and a column as in `block_schedule` (last value unused) to
    -(mu0 chi A / 2) times the integral of H² along the rod, by the lengths of the nodes.
    """
    place = ca.SX.sym("place", 2)
    square = ca.Function("square", [place], [field.expression(place[0], place[1])], {"cse": True})
    q, coils, n = ca.MX.sym("q", 3 * rod.count), ca.MX.sym("coils", 4), rod.count
    seen = ca.horzcat(q[:n] - coils[0], coils[1] * q[n : 2 * n]).T
    energy = -coils[2] * (square.map(n)(seen) @ ca.DM(rod.weights))
    return ca.Function("energy", [q, coils], [energy])
