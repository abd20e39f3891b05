"""A rod in a channel: the Model of its motion between two walls, and the pull of coils on it.

The walls are straight, along x. Every node has a disc of the rod's diameter that turns with the
node's cross section. The disc touches a wall where its rim does, and its rim slides there by the
motion and the rotation of the node. Friction is Coulomb's, with the normal force of the disc on the
wall.

Blocks of coils pull the rod: a body of susceptibility chi that hardly changes the field has the
force (mu0 chi / 2) grad H² per volume, towards strong fields. It acts on the centre line, lumped at
the nodes.
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
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.model.schedule import Schedule
from wormopt.numerics.expressions import AtPlaces
from wormopt.systems.channel.rod import Rod

WALLS = (("upper", 1.0), ("lower", -1.0))
"""The walls, and the sign of their y."""

# Usual speed of a node in m/s, by which solvers scale.
_SPEED = 0.1


def channel_rod(rod: Rod, channel: float, friction: float) -> Model:
    """Build the Model of a rod in a channel.

    Theory: docs/theory-channel.md, section 3.

    Parameters
    ----------
    rod : Rod
        The rod.
    channel : float
        Distance of the walls, in m; the middle between them is y = 0.
    friction : float
        Coefficient of dry friction on the walls.

    Returns
    -------
    Model
        States are ``along``, ``across`` (places of the nodes), ``angle``, and their rates; inputs
        are ``force_along`` and ``force_across`` on the nodes, in N; parameters are
        ``youngs_modulus``, ``density``, ``damping_time``, ``friction``; outputs are
        ``strain_energy``, ``kinetic_energy``, ``damping_power``, ``load_power``, ``centre``,
        ``mean_velocity``. There are two contacts per node, with gaps. All are in SI units.

    Raises
    ------
    ArgumentError
        If the rod is thicker than the channel, or friction is not positive.

    Examples
    --------
    >>> rod = Rod(length=48e-3, diameter=4e-3, youngs_modulus=5e4, density=1100.0, elements=12)
    >>> worm = channel_rod(rod, channel=11e-3, friction=0.5)
    >>> worm.n_x, len(worm.contacts), worm.contacts[0].name
    (150, 50, 'node 0, upper wall')
    """
    if not rod.diameter < channel < math.inf:
        raise ArgumentError(
            f"the rod of diameter {rod.diameter:g} m does not fit into a channel of {channel:g} m"
        )
    if not 0 < friction < math.inf:
        raise ArgumentError(f"friction must be positive, not {friction:g}")
    n = rod.count
    places, rates = _states(rod)
    loads = tuple(
        Signal(name, ca.SX.sym(name, n), "force", 1e-3, value=0.0)
        for name in ("force_along", "force_across")
    )
    p = _parameters(rod, friction)
    x, y, angle = (signal.symbol for signal in places)
    v, w, spin = (signal.symbol for signal in rates)
    contacts = _contacts(rod, channel, y, v, spin, p["friction"].symbol)

    strains = rod.strains(x, y, angle)
    q, speeds = ca.vertcat(x, y, angle), ca.vertcat(v, w, spin)
    stiffness = rod.stiffness(p["youngs_modulus"].symbol)
    stored = rod.energy(strains, stiffness)
    strain_rates = [ca.jtimes(strain, q, speeds) for strain in strains]
    damped = p["damping_time"].symbol * rod.energy(strain_rates, stiffness)
    mass, turning = (p["density"].symbol / rod.density * ca.DM(part) for part in rod.inertia)
    inertia = ca.vertcat(mass, mass, turning)
    driven = ca.vertcat(*(signal.symbol for signal in loads), ca.DM.zeros(n))
    walls = ca.densify(_push(contacts, q, speeds))
    forces = driven + walls - ca.gradient(stored, q) - ca.gradient(damped, speeds)

    outputs = {
        "strain_energy": (stored, "energy"),
        "kinetic_energy": (ca.dot(inertia, speeds * speeds) / 2, "energy"),
        "damping_power": (-2 * damped, "power"),
        "load_power": (ca.dot(driven, speeds), "power"),
        "centre": (ca.dot(ca.DM(rod.weights), x) / rod.length, "length"),
        "mean_velocity": (ca.dot(ca.DM(rod.weights), v) / rod.length, "speed"),
    }
    return Model(
        "rod in a channel",
        x=[*places, *rates],
        u=loads,
        p=list(p.values()),
        ode=ca.vertcat(speeds, forces / inertia),
        outputs=[Output(name, found, unit) for name, (found, unit) in outputs.items()],
        contacts=contacts,
    )


def straight(rod: Rod, along: float = 0.0) -> dict[str, np.ndarray]:
    """Return the state of a straight rod at rest in the middle of the channel, by signal names.

    Its first end is at `along`, in m.
    """
    rest = np.zeros(rod.count)
    names = "across angle along_rate across_rate angle_rate".split()
    return {"along": along + rod.nodes, **dict.fromkeys(names, rest)}


def _states(rod: Rod) -> tuple[tuple[Signal, ...], tuple[Signal, ...]]:
    """Return places of the nodes and angles of their sections, and the rates of these."""
    sizes = {
        "along": ("length", rod.length, "speed", _SPEED),
        "across": ("length", rod.diameter, "speed", _SPEED),
        "angle": ("angle", 1.0, "angular_frequency", _SPEED / rod.diameter),
    }
    places, rates = [], []
    for name, (unit, size, rate, speed) in sizes.items():
        columns = ca.SX.sym(name, rod.count), ca.SX.sym(f"{name}_rate", rod.count)
        rest = tuple(rod.nodes.tolist()) if name == "along" else 0.0
        places.append(Signal(name, columns[0], unit, size, value=rest))
        rates.append(Signal(f"{name}_rate", columns[1], rate, speed, value=0.0))
    return tuple(places), tuple(rates)


def _parameters(rod: Rod, friction: float) -> dict[str, Signal]:
    """Return the parameters that may change without a new Model."""
    numbers = {
        "youngs_modulus": (rod.youngs_modulus, "stress", TINY),
        "density": (rod.density, "density", TINY),
        "damping_time": (rod.damping_time, "time", 0.0),
        "friction": (friction, "count", TINY),
    }
    return {
        name: Signal(name, ca.SX.sym(name), unit, lower=lower, value=value)
        for name, (value, unit, lower) in numbers.items()
    }


def _contacts(
    rod: Rod, channel: float, y: ca.SX, v: ca.SX, spin: ca.SX, friction: ca.SX
) -> tuple[Contact, ...]:
    """Return one contact per node and wall."""
    radius, room = rod.diameter / 2, (channel - rod.diameter) / 2
    found = []
    for i in range(rod.count):
        for wall, side in WALLS:
            name = f"node {i}, {wall} wall"
            pressed = ca.SX.sym(f"pressed[{name}]")
            held = friction * pressed
            found.append(
                Contact(
                    name,
                    velocity=v[i] - side * radius * spin[i],
                    force=ca.SX.sym(f"rubbed[{name}]"),
                    law=Coulomb(held, held),
                    nominal_force=1e-2,
                    nominal_speed=_SPEED,
                    gap=room - side * y[i],
                    normal_force=pressed,
                )
            )
    return tuple(found)


def _push(contacts: Sequence[Contact], q: ca.SX, speeds: ca.SX) -> ca.SX:
    """Return generalised forces of contacts, by virtual work along their gaps and sliding."""
    gaps, pressed = ([getattr(c, name) for c in contacts] for name in ("gap", "normal_force"))
    slides, rubbed = ([getattr(c, name) for c in contacts] for name in ("velocity", "force"))
    normal = ca.jacobian(ca.vertcat(*gaps), q).T @ ca.vertcat(*pressed)
    return normal + ca.jacobian(ca.vertcat(*slides), speeds).T @ ca.vertcat(*rubbed)


# -- coils -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Blocks:
    """Sequence of active coils: one block of neighbours, repeated along the row."""

    breaks: np.ndarray  # (pieces + 1,) times from 0 to the period, s
    first: np.ndarray  # (pieces,) first coil of the block
    count: np.ndarray  # (pieces,) number of its coils

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of coils that occur, ascending."""
        return tuple(int(k) for k in np.unique(self.count))


def switched_blocks(every: int, rate: float, duration: float = 3.0, shift: float = 0.0) -> Blocks:
    """Return blocks of coils switched on in turn, `rate` per second, for `duration` switches.

    Repeats after `every` coils, with period 2 every / rate because sides may alternate; coil k is
    at k pitches, on the positive side if even. Every second switch is `shift` late. `duration` is
    at least 1. Raises ArgumentError.
    """
    if not (0 < rate < math.inf and duration >= 1 and abs(shift) < 1):
        raise ArgumentError("rate must be positive, duration at least 1, shift between -1 and 1")
    if duration + abs(shift) + 1 > every:
        raise ArgumentError(
            f"coils on for {duration:g} switches do not fit into {every} coils; give more coils"
        )
    # coil k goes on at k, odd ones later by the shift; some that went on before time 0 are on then
    coils = np.arange(-every, 2 * every)
    on = coils + shift * (coils % 2)
    events = np.concatenate([[0.0, 2 * every], on, on + duration])
    events = np.unique(np.round(events[(events >= 0) & (events <= 2 * every)], 12))
    middle = (events[:-1] + events[1:]) / 2
    lit = (on[:, None] <= middle) & (middle < on[:, None] + duration)
    return Blocks(events / rate, coils[np.argmax(lit, axis=0)], lit.sum(axis=0))


def magnetic_strength(rod: Rod, susceptibility: float, ampere_turns: float) -> float:
    """Return the axial force over the gradient of H² per squared ampere-turn: mu0 chi A N² / 2.

    In N m² (gradient in 1/m³, force per length in N/m); `ampere_turns` of each active coil.
    """
    return MU0 * susceptibility / 2 * rod.magnetised_area * ampere_turns**2


def block_schedule(blocks: Blocks, pitch: float, strength: float) -> Schedule:
    """Return the schedule of the blocks, as the function of `block_load` takes it.

    Values: middle of the block, side of its first coil, `strength`, and index of the field.
    """
    which = np.searchsorted(blocks.counts, blocks.count)
    middle = pitch * (blocks.first + (blocks.count - 1) / 2)
    side = 1.0 - 2.0 * (blocks.first % 2)
    values = np.stack([middle, side, np.full(len(middle), strength), which], axis=1)
    return Schedule(
        "coils", ca.SX.sym("coils", 4), ca.SX.sym("begin"), blocks.breaks, values, periodic=True
    )


def block_pull(rod: Rod, fields: Sequence[BlockField]) -> AtPlaces:
    """Return the forces along and across on the nodes of a rod, in N.

    Their common column are the values of `block_schedule`; `fields` are those of blocks with the
    numbers of coils that occur, in that order.
    """
    place, coils, weight = ca.MX.sym("place", 2), ca.MX.sym("coils", 4), ca.MX.sym("weight")
    seen = ca.vertcat(place[0] - coils[0], coils[1] * place[1])
    several = [field.gradient for field in fields]
    if len(several) > 1:
        slope = ca.Function.conditional("which", several[:-1], several[-1])(coils[3], seen)
    else:
        slope = several[0](seen)
    force = coils[2] * weight * ca.vertcat(slope[0], coils[1] * slope[1])
    return AtPlaces(ca.Function("pull", [place, coils, weight], [force]), rod.weights)


def block_load(rod: Rod, fields: Sequence[BlockField]) -> ca.Function:
    """Return the forces of `block_pull` from all places (x, y, angle) and the column."""
    pull = block_pull(rod, fields).function
    q, coils, n = ca.MX.sym("q", 3 * rod.count), ca.MX.sym("coils", 4), rod.count
    return ca.Function("load", [q, coils], [pull(q[: 2 * n], coils)])


def block_energy(rod: Rod, field: BlockField) -> ca.Function:
    """Return the magnetic energy of a rod in a block's field, in J: potential of `block_load`.

    From places (x, y, angle) and a column as in `block_schedule` (last value unused) to
    -(mu0 chi A / 2) times the integral of H² along the rod, by the lengths of the nodes.
    """
    place = ca.SX.sym("place", 2)
    square = ca.Function("square", [place], [field.expression(place[0], place[1])], {"cse": True})
    q, coils, n = ca.MX.sym("q", 3 * rod.count), ca.MX.sym("coils", 4), rod.count
    seen = ca.horzcat(q[:n] - coils[0], coils[1] * q[n : 2 * n]).T
    energy = -coils[2] * (square.map(n)(seen) @ ca.DM(rod.weights))
    return ca.Function("energy", [q, coils], [energy])
