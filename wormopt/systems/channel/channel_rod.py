"""A rod in a channel: the Model of its motion between two walls that it touches and rubs.

The walls are straight, along x. Round every node lies a disc of the rod's diameter that belongs
to the node's cross section: it touches a wall where its rim does, and its rim slides there by the
motion of the node and by its own turning. Friction is Coulomb's, with the force that presses the
disc on the wall.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.systems.channel.rod import Rod

WALLS = (("upper", 1.0), ("lower", -1.0))
"""The walls, and the sign of y at which they are."""

# Usual speed of a node in m/s, by which solvers scale.
_SPEED = 0.1


def channel_rod(rod: Rod, channel: float, friction: float) -> Model:
    """Build the Model of a rod in a channel.

    Parameters
    ----------
    rod : Rod
        What moves.
    channel : float
        Distance of the walls, in m; the middle between them is y = 0.
    friction : float
        Coefficient of the dry friction on the walls.

    Returns
    -------
    Model
        States ``along``, ``across`` (places of the nodes), ``angle``, and their rates; inputs
        ``force_along`` and ``force_across`` on the nodes, in N; parameters ``youngs_modulus``,
        ``density``, ``damping_time``, ``friction``; outputs ``strain_energy``,
        ``kinetic_energy``, ``damping_power``, ``load_power``, ``centre``, ``mean_velocity``. Two
        contacts per node, with gaps.

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
    walls = sum((_push(contact, q, speeds) for contact in contacts), ca.SX.zeros(3 * n))
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
    """State of a straight rod at rest in the middle of the channel, by the names of its signals.

    Its first end lies at `along`, in m.
    """
    rest = np.zeros(rod.count)
    names = "across angle along_rate across_rate angle_rate".split()
    return {"along": along + rod.nodes, **dict.fromkeys(names, rest)}


def _states(rod: Rod) -> tuple[tuple[Signal, ...], tuple[Signal, ...]]:
    """Places of the nodes and angles of their sections, and the rates of these."""
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
    """Numbers that may change without a new Model."""
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
    """One contact per node and wall."""
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


def _push(contact: Contact, q: ca.SX, speeds: ca.SX) -> ca.SX:
    """Generalised forces of a contact: by virtual work along its gap and its sliding."""
    assert contact.gap is not None
    assert contact.normal_force is not None
    normal = ca.gradient(contact.gap, q) * contact.normal_force
    return normal + ca.gradient(contact.velocity, speeds) * contact.force
