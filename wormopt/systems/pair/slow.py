"""The magneto-elastic pair in slow variables (eq. 17 of Zimmermann et al. 2007).

They change slowly where friction and field are small compared with the spring: the standard form
for averaging. `slow_pair` has exactly the motions of `magnetic_pair`; `to_slow` and `from_slow`
convert between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.model.friction import Law
from wormopt.model.model import Model, Output, Signal
from wormopt.systems.pair.exact import pair_parts


def slow_pair(
    *,
    law: Law | Sequence[Law],
    push: float,
    frequency: float,
    mass: float = 1.0,
    stiffness: float = 1.0,
    cosines: Sequence[float] | None = (1.0, 1.0),
) -> Model:
    """Build the model of the pair in slow variables: amplitude and lag of the swing.

    Source: eq. 17 of Zimmermann et al. 2007 with the phase lag of eq. 18. Half the stretch is z = a
    cos(nu t - xi), its rate z' = -a Omega sin(nu t - xi) with Omega = sqrt(2 c / m). The states are
    the velocity V of the centre and the components p = a cos(xi) and q = a sin(xi), since amplitude
    a and lag xi are no coordinates at a = 0:

    V' = (F_1 + F_2) / (2 m), p' = -(nu - Omega) q - h sin(nu t) / Omega,   q' = (nu - Omega) p + h
    cos(nu t) / Omega, h = (P G + (F_2 - F_1) / 2) / m.

    The transformation is exact: with x_1' = V - z', x_2' = V + z' this is eq. 16 without the
    position.

    Parameters
    ----------
    law : Law or sequence of Law
        Friction of both masses, as for `magnetic_pair`.
    push : float
        Force P of the field, positive.
    frequency : float
        Angular frequency nu of the field and of the rotating frame, positive.
    mass : float, optional
        Mass m of each mass.
    stiffness : float, optional
        Spring constant c.
    cosines : sequence of float, optional
        Cosine amplitudes of the field, the mean first, or None for an input.

    Returns
    -------
    Model
        States ``center_velocity`` and ``swing`` (p, q); outputs ``amplitude`` a, ``lag`` xi and
        ``speed_share`` V / (a Omega). It is in standard form for `average` where law, push and
        frequency - Omega are small.

    Raises
    ------
    ArgumentError
        As `magnetic_pair`.

    Examples
    --------
    >>> from wormopt.model.friction import Coulomb
    >>> slow = slow_pair(law=Coulomb(0.005, 0.01), push=0.01, frequency=1.42)
    >>> [signal.name for signal in slow.x]
    ['center_velocity', 'swing']
    """
    parts = pair_parts(law, mass, stiffness, push, frequency, cosines)
    V, swing = ca.SX.sym("V"), ca.SX.sym("swing", 2)
    p, q = ca.vertsplit(swing)
    omega, nu, psi = parts.natural_frequency, parts.frequency, parts.frequency * parts.t
    rate = omega * (q * ca.cos(psi) - p * ca.sin(psi))
    difference = (parts.forces[1] - parts.forces[0]) / 2
    kick = (parts.push * parts.field + difference) / (parts.mass * omega)
    ode = ca.vertcat(
        ca.sum1(parts.forces) / (2 * parts.mass),
        -(nu - omega) * q - kick * ca.sin(psi),
        (nu - omega) * p + kick * ca.cos(psi),
    )
    return Model(
        "magneto-elastic pair, slow",
        x=slow_states(V, swing),
        ode=ode,
        u=parts.inputs,
        p=parts.parameters,
        t=parts.t,
        outputs=slow_outputs(V, swing, omega),
        contacts=parts.contacts(ca.vertcat(V - rate, V + rate), push),
    )


def to_slow(
    t: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    *,
    frequency: float,
    natural_frequency: float = math.sqrt(2),
) -> dict[str, np.ndarray]:
    """Convert states of `magnetic_pair`, (2, m) at times t (m,), to those of `slow_pair`.

    Returns ``center_velocity`` (m,), ``swing`` (2, m), and ``center`` (m,), which `slow_pair` does
    not have. `frequency`: nu of the frame; `natural_frequency`: Omega.
    """
    x, v, psi = np.asarray(position), np.asarray(velocity), frequency * np.asarray(t)
    z, rate = (x[1] - x[0]) / 2, (v[1] - v[0]) / (2 * natural_frequency)
    c, s = np.cos(psi), np.sin(psi)
    return {
        "center_velocity": (v[0] + v[1]) / 2,
        "swing": np.array([z * c - rate * s, z * s + rate * c]),
        "center": (x[0] + x[1]) / 2,
    }


def from_slow(
    t: ArrayLike,
    center_velocity: ArrayLike,
    swing: ArrayLike,
    *,
    center: ArrayLike = 0.0,
    frequency: float,
    natural_frequency: float = math.sqrt(2),
) -> dict[str, np.ndarray]:
    """Convert states of `slow_pair` to ``position`` and ``velocity`` (2, m) of the pair.

    `center_velocity` (m,): V; `swing` (2, m): a cos(xi), a sin(xi); `center`: position of the
    centre, which `slow_pair` does not have; `frequency`: nu of the frame; `natural_frequency`:
    Omega.
    """
    V, (p, q), psi = np.asarray(center_velocity), np.asarray(swing), frequency * np.asarray(t)
    c, s = np.cos(psi), np.sin(psi)
    z, rate = p * c + q * s, natural_frequency * (q * c - p * s)
    return {
        "position": np.array([center - z, center + z]),
        "velocity": np.array([V - rate, V + rate]),
    }


def slow_states(V: ca.SX, swing: ca.SX) -> list[Signal]:
    """States of `slow_pair` and its averages: V of the centre, swing (a cos(xi), a sin(xi))."""
    return [
        Signal("center_velocity", V, "speed", value=0.0),
        Signal("swing", swing, "length", value=(0.0, 0.0)),
    ]


def slow_outputs(V: ca.SX, swing: ca.SX, natural_frequency: ca.SX) -> list[Output]:
    """Outputs of `slow_pair` and its averages.

    `V`: velocity of the centre; `swing` (2, 1): a cos(xi), a sin(xi).
    """
    a = ca.sqrt(ca.sumsqr(swing))
    return [
        Output("amplitude", a, "length"),
        Output("lag", ca.atan2(swing[1], swing[0]), "angle"),
        Output("speed_share", V / (a * natural_frequency), "share"),
    ]
