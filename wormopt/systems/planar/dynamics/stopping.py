"""How a block comes to rest on dry ground, by a time in which it never does.

With dt = psi dT, psi being the power that the ground takes by the velocity v, the force is no more
than linear in v: m dv/dT = f psi - (Ft² v_t, Fn² v_n). The stop at a finite time t lies at
T = infinity, which v approaches exponentially, and t and the way are integrals over T. No event
is located. For the law of unit directions |v| takes the place of psi, and F that of F².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from wormopt.errors import SolveError
from wormopt.model.planar_friction import Elliptic, Unit

_SMALL, _FAST = 1e-14, 1e6  # shares of the speed at which it rests, or runs away
_LONGEST = 1e6  # T in units of mass over resistance, squared or not


@dataclass(frozen=True)
class Stop:
    """Where and when a block stops."""

    time: float
    place: tuple[float, float]  # from where it started, along its heading and to its left


def stop_of(
    law: Elliptic | Unit, mass: float, velocity: tuple[float, float], pull: tuple[float, float]
) -> Stop:
    """Stop of a block that starts with a velocity not 0 under a constant pull.

    Parameters
    ----------
    law : Elliptic or Unit
        Friction, of numbers.
    mass : float
        Its mass.
    velocity, pull : (float, float)
        Along its heading, which stays, and to its left.

    Returns
    -------
    Stop

    Raises
    ------
    SolveError
        If the pull outruns friction: it does not stop.

    Examples
    --------
    A block thrown across a pull of half of what holds it, isotropic friction 2:

    >>> stop = stop_of(Elliptic(2.0, 2.0, 2.0), 1.0, (0.0, 1.0), (1.0, 0.0))
    >>> round(stop.time, 10), [round(x, 10) for x in stop.place]
    (0.6666666667, [0.0833333333, 0.2666666667])
    """
    start, f = np.array(velocity, dtype=float), np.array(pull, dtype=float)
    speed = float(np.linalg.norm(start))
    square = 2 if isinstance(law, Elliptic) else 1
    ahead, back, aside = float(law.forward), float(law.backward), float(law.sideways)
    largest = max(ahead, back, aside)

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        v = state[:2]
        resistance = np.array([ahead if v[0] >= 0 else back, aside])
        psi = np.linalg.norm(resistance * v if square == 2 else v)
        change = (f * psi - resistance**square * v) / mass
        return np.concatenate([change, v * psi, [psi]])

    def left(_: float, state: np.ndarray) -> float:
        return float(np.linalg.norm(state[:2])) - _SMALL * speed

    def runs(_: float, state: np.ndarray) -> float:
        return float(np.linalg.norm(state[:2])) - _FAST * speed

    left.terminal = runs.terminal = True  # type: ignore[attr-defined]
    length = mass / largest**square
    found = solve_ivp(
        rate, (0.0, _LONGEST * length), np.concatenate([start, np.zeros(3)]), "DOP853",
        rtol=1e-13, atol=1e-16 * speed, events=[left, runs], first_step=1e-3 * length,
    )  # fmt: skip
    if not len(found.t_events[0]):
        raise SolveError(
            "the block does not come to rest", "write a smaller pull, or more friction"
        )
    x, y, t = found.y[2:, -1].tolist()
    return Stop(t, (x, y))
