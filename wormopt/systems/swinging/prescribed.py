"""Point masses with prescribed harmonic velocities relative to their centre.

Actuators strong enough to hold the prescribed velocities act between the masses. The remaining
unknown is the velocity V of the centre, which only the ground changes. Small friction changes it
slowly: this is the standard form for averaging.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.values import numbers
from wormopt.systems.shared.parameters import laws_of_each, positive_parameter

# Accepted sum of the relative momenta, as a share of the largest of a mass.
_BALANCED = 1e-12


def harmonic_masses(
    cosines: ArrayLike,
    sines: ArrayLike,
    *,
    law: Law | Sequence[Law],
    frequency: float = 1.0,
    mass: ArrayLike = 1.0,
    velocity: float = 0.0,
    place: bool = False,
) -> Model:
    """Build the model M V' = sum of contact forces for masses with v_i = V + w_i(t).

    The relative velocities have no momentum, sum m_i w_i = 0: w_i = scale sum_k (cosines[i, k]
    cos((k+1) omega t) + sines[i, k] sin((k+1) omega t)), with arrays (N,) or (N, K). `place`: the
    position of the centre is a state too; not for `average`, since it is not slow.
    """
    cosines, sines = _harmonics(cosines, sines)
    masses = _masses(mass, len(cosines))
    _check_balance(cosines, sines, masses)
    laws, friction = lift(laws_of_each(law, len(cosines)))
    t, V, force = ca.SX.sym("t"), ca.SX.sym("V"), ca.SX.sym("friction", len(cosines))
    sizes = [
        positive_parameter("scale", 1.0, "share"),
        positive_parameter("frequency", frequency, "angular_frequency"),
        positive_parameter("total_mass", masses.sum(), "mass"),
    ]
    scale, omega, total = (size.symbol for size in sizes)
    order = np.arange(1, cosines.shape[1] + 1)
    turn = omega * t * ca.DM(order)
    relative = scale * (ca.DM(cosines) @ ca.cos(turn) + ca.DM(sines) @ ca.sin(turn))
    speed = float(np.abs(np.hstack([cosines, sines])).max())
    v = V + relative
    states = [
        Signal("center_velocity", V, "speed", speed, value=float(numbers("velocity", velocity)))
    ]
    ode, total_force = ca.sum1(force) / total, ca.sum1(force)
    outputs = [
        Output("velocity", v, "speed"),
        Output("relative_velocity", relative, "speed"),
        Output("total_force", total_force, "force"),
        Output("power", -ca.dot(force, relative), "power"),
    ]
    if place:
        x = ca.SX.sym("x")
        way = ca.DM(cosines / order) @ ca.sin(turn) + ca.DM(sines / order) @ (1 - ca.cos(turn))
        outputs.append(Output("displacement", x + scale / omega * way, "length"))
        states.insert(0, Signal("center", x, "length", speed / float(frequency), value=0.0))
        ode = ca.vertcat(V, ode)
    return Model(
        "harmonic masses",
        x=states,
        ode=ode,
        p=[*sizes, *friction],
        t=t,
        outputs=outputs,
        contacts=[
            Contact(f"mass {i}", v[i], force[i], laws[i], nominal_speed=speed)
            for i in range(len(laws))
        ],
    )


def imbalance(cosines: ArrayLike, sines: ArrayLike, mass: ArrayLike = 1.0) -> np.ndarray:
    """Sum of the relative momenta, (K, 2), which must vanish.

    Sum over masses of m_i times cosines and sines, (N,) or (N, K), of every harmonic.
    """
    cosines, sines = _harmonics(cosines, sines)
    masses = _masses(mass, len(cosines))
    return np.stack([masses @ cosines, masses @ sines], axis=1)


def steady_masses(amplitude: ArrayLike, law: Coulomb | Sequence[Coulomb]) -> float:
    """Steady mean velocity V under small dry friction, for one harmonic, to first order.

    V is the root of the sum of (F- - F+) / 2 - (F- + F+) asin(V / A_i) / pi, with terms constant
    for |V| >= A_i. Raises ArgumentError if all masses have friction in one direction only.
    """
    sizes = numbers("amplitude", amplitude).ravel()
    if not (sizes.size and np.all((sizes > 0) & (sizes < math.inf))):
        raise ArgumentError("amplitudes must be positive and finite")
    laws = laws_of_each(law, sizes.size)
    if not all(isinstance(each, Coulomb) for each in laws):
        raise ArgumentError("the closed form needs dry friction; write Coulomb(forward, backward)")
    ahead = np.array([float(each.slip_force(0.0, 1)) for each in laws])
    behind = np.array([float(each.slip_force(0.0, -1)) for each in laws])
    if not (ahead.sum() < 0 < behind.sum()):
        raise ArgumentError(
            "friction must act in both directions; write forward and backward above 0"
        )
    if np.ptp(sizes) == 0 and np.ptp(ahead) == 0 and np.ptp(behind) == 0:
        return float(sizes[0] * math.sin(math.pi / 2 * (behind + ahead)[0] / (behind - ahead)[0]))

    def mean_force(V: float) -> float:
        turn = np.arcsin(np.clip(V / sizes, -1, 1))
        return float(((behind + ahead) / 2 - (behind - ahead) * turn / math.pi).sum())

    low, high = -sizes.max(), sizes.max()
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if mean_force(middle) > 0 else (low, middle)
    return float(middle)


def _harmonics(cosines: ArrayLike, sines: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    found = []
    for name, given in (("cosines", cosines), ("sines", sines)):
        table = numbers(name, given)
        if table.ndim not in (1, 2) or not table.size or not np.all(np.isfinite(table)):
            raise ArgumentError(f"{name} must be finite numbers, one row per mass")
        found.append(table.reshape(len(table), -1))
    if found[0].shape != found[1].shape:
        raise ArgumentError(
            f"cosines and sines must have the same shape, not {found[0].shape} and {found[1].shape}"
        )
    if not any(np.any(table) for table in found):
        raise ArgumentError("all relative velocities are 0; write others")
    return found[0], found[1]


def _masses(mass: ArrayLike, count: int) -> np.ndarray:
    masses = numbers("mass", mass).ravel()
    if masses.size not in (1, count) or not np.all((masses > 0) & (masses < math.inf)):
        raise ArgumentError(f"mass must be one positive number, or {count}, not {mass!r}")
    return np.broadcast_to(masses, count)


def _check_balance(cosines: np.ndarray, sines: np.ndarray, masses: np.ndarray) -> None:
    left = imbalance(cosines, sines, masses)
    largest = max(np.abs(masses[:, None] * table).max() for table in (cosines, sines))
    worst = int(np.argmax(np.abs(left).max(axis=1)))
    if np.abs(left[worst]).max() > _BALANCED * largest:
        raise ArgumentError(
            "velocities relative to the centre must have no total momentum, but in harmonic "
            f"{worst + 1} the masses times cosines add up to {left[worst, 0]:.6g}, times sines to "
            f"{left[worst, 1]:.6g}; change one mass's by that amount"
        )
