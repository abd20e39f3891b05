"""Stop of a block on dry ground, by a transformed time in which it never stops.

With dt = psi dT, where psi is the power of the ground by the velocity v, the force is at most
linear in v: m dv/dT = f psi - (Ft² v_t, Fn² v_n). For the law of unit directions |v| replaces psi,
and F replaces F². The direction of v then has an equation of its own and tends to a fixed one,
along which the speed falls as exp(-cT): the remaining time and displacement have a closed form. The
stop at a finite time t is at T = infinity. No event is located.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from wormopt.errors import SolveError
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic

_SMALL = 1e-14  # share of the speed that counts as none
_LONGEST = 1e12  # T in units of mass over the largest resistance, squared or not
_NEWTON = 3  # Newton steps to the fixed direction


@dataclass(frozen=True)
class Stop:
    """Place and time of a stop."""

    time: float
    place: tuple[float, float]  # from the start, along its heading and to its left


def stop_of(
    law: Elliptic | AnisotropicCoulomb,
    mass: float,
    velocity: tuple[float, float],
    pull: tuple[float, float],
) -> Stop:
    """Return the stop of a block that starts with a velocity other than 0 under a constant pull.

    Parameters
    ----------
    law : Elliptic or AnisotropicCoulomb
        Friction law with numbers.
    mass : float
        Mass of the block.
    velocity, pull : (float, float)
        Components along its heading, which is constant, and to its left.

    Returns
    -------
    Stop

    Raises
    ------
    SolveError
        If the pull exceeds friction, so that it does not stop.

    Examples
    --------
    A block is thrown across a pull of half its friction limit, with isotropic friction 2:

    >>> stop = stop_of(Elliptic(2.0, 2.0, 2.0), 1.0, (0.0, 1.0), (1.0, 0.0))
    >>> round(stop.time, 10), [round(x, 10) for x in stop.place]
    (0.6666666667, [0.0833333333, 0.2666666667])
    """
    f, speed = pull, math.hypot(*velocity)
    square = 2 if isinstance(law, Elliptic) else 1
    ahead, back, aside = float(law.forward), float(law.backward), float(law.sideways)
    largest = max(ahead, back, aside)

    def rates(angle: float) -> tuple[float, float, float, float, float]:
        """Psi over the speed; growth of the speed, turning, and their slopes over the angle."""
        c, s, first = math.cos(angle), math.sin(angle), ahead
        if c < 0:
            first = back
        p, q = first**square / mass, aside**square / mass
        psi, steeper = 1.0, 0.0
        if square == 2:
            psi = math.hypot(first * c, aside * s)
            steeper = (aside**2 - first**2) * s * c / psi
        along, across = (f[0] * c + f[1] * s) / mass, (f[1] * c - f[0] * s) / mass
        return (
            psi,
            psi * along - p * c * c - q * s * s,
            psi * across - (q - p) * s * c,
            steeper * along + psi * across - 2 * (q - p) * s * c,
            steeper * across - psi * along - (q - p) * (c * c - s * s),
        )

    def rate(_: float, state: np.ndarray) -> tuple[float, ...]:
        angle, logarithm = float(state[0]), float(state[1])
        psi, growth, turning, _, _ = rates(angle)
        v = speed * math.exp(logarithm)
        return turning, growth, v**2 * psi * math.cos(angle), v**2 * psi * math.sin(angle), v * psi

    def left(_: float, state: np.ndarray) -> float:
        return state[1] - math.log(_SMALL)

    def turned(_: float, state: np.ndarray) -> float:
        """Remaining change of the speed's logarithm by the turn, minus a negligible share."""
        _, _, turning, slope, steep = rates(float(state[0]))
        if turning == 0:
            return -_SMALL
        if steep >= 0:
            return 1.0
        off = turning / steep
        return -(abs(slope * off) + 4 * largest**square / mass * off**2) / steep - _SMALL

    left.terminal = turned.terminal = True  # type: ignore[attr-defined]
    state = np.array([math.atan2(velocity[1], velocity[0]), 0.0, 0.0, 0.0, 0.0])
    longest = mass / largest**square
    if turned(0.0, state) > 0:
        scale = np.array([1.0, 1.0, *(2 * [speed**2 * mass / largest]), speed * mass / largest])
        found = solve_ivp(
            rate, (0.0, _LONGEST * longest), state, "DOP853", rtol=1e-13, atol=1e-18 * scale,
            events=[left, turned], first_step=1e-3 * longest,
        )  # fmt: skip
        state = found.y[:, -1]
    angle, logarithm, x, y, t = state.tolist()
    for _ in range(_NEWTON):
        _, _, turning, _, steep = rates(angle)
        angle -= turning / steep if steep < 0 else 0.0
    psi, growth, *_ = rates(angle)
    if growth >= 0:
        raise SolveError(
            "the block does not come to rest", "write a smaller pull, or more friction"
        )
    v = speed * math.exp(logarithm)
    rest = -psi * v**2 / growth / 2
    return Stop(t - psi * v / growth, (x + rest * math.cos(angle), y + rest * math.sin(angle)))
