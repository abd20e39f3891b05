"""The magneto-elastic pair in slow variables (eq. 17 of Zimmermann et al. 2007), and averaged.

Slow variables change slowly where friction and field are small compared with the spring: the
standard form for averaging. `slow_pair` has exactly the motions of `magnetic_pair`; `to_slow` and
`from_slow` convert between them. The averaged pair (eq. 18) and its steady motion (eq. 19) have
closed forms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law
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


def averaged_pair(
    *,
    law: Coulomb,
    push: float,
    frequency: float,
    mass: float = 1.0,
    stiffness: float = 1.0,
    cosines: Sequence[float] = (1.0, 1.0),
) -> Model:
    """Build the averaged model of the pair in closed form, of first order.

    It is eq. 18 of Zimmermann et al. 2007, corrected, with dry friction averaged over a swing. With
    s = V / (a Omega) between -1 and 1, the mean friction of a mass is (F- - F+) / 2 - (F+ + F-)
    asin(s) / pi, and it subtracts (F+ + F-) sqrt(1 - s^2) / (pi m Omega) from the rate of a. For
    larger |s|, both masses slide in one direction all the time, and the swing has no loss. Only the
    first harmonic of the field matters.

    Parameters
    ----------
    law : Coulomb
        Friction of both masses, without stiction, in units of force.
    push : float
        Force P of the field, positive.
    frequency : float
        Angular frequency nu of the field, positive.
    mass : float, optional
        Mass m of each mass.
    stiffness : float, optional
        Spring constant c.
    cosines : sequence of float, optional
        Cosine amplitudes of the field, the mean first, as for `magnetic_pair`.

    Returns
    -------
    Model
        States and outputs of `slow_pair`; autonomous and without contacts.

    Raises
    ------
    ArgumentError
        As `magnetic_pair`, or if the law is not a Coulomb law.

    Examples
    --------
    >>> averaged_pair(law=Coulomb(0.005, 0.01), push=0.01, frequency=1.42).contacts
    ()
    """
    if not isinstance(law, Coulomb):
        raise ArgumentError(
            f"law is {law!r}, but the closed form needs dry friction; write Coulomb(forward, "
            "backward)"
        )
    parts = pair_parts(law, mass, stiffness, push, frequency, cosines)
    ahead = sum(-each.slip_force(0.0, 1) for each in parts.laws) / 2
    behind = sum(each.slip_force(0.0, -1) for each in parts.laws) / 2
    V, swing = ca.SX.sym("V"), ca.SX.sym("swing", 2)
    p, q = ca.vertsplit(swing)
    omega, m = parts.natural_frequency, parts.mass
    top, detuning = ca.sqrt(ca.sumsqr(swing)) * omega, parts.frequency - parts.natural_frequency
    # if both masses slide in one direction, asin and sqrt get 0: their derivatives stay finite
    within = ca.fabs(V) < top
    s = ca.if_else(within, V / ca.if_else(within, top, 1), 0)
    turn = ca.if_else(within, ca.asin(s), ca.pi / 2 * ca.sign(V))
    loss = ca.if_else(within, ca.sqrt(1 - s**2) / ca.if_else(within, top, 1), 0)
    loss *= (ahead + behind) / (ca.pi * m)
    harmonics = parts.harmonics
    first = harmonics[1] if harmonics.numel() > 1 else ca.SX(0)
    ode = ca.vertcat(
        ((behind - ahead) / 2 - (ahead + behind) / ca.pi * turn) / m,
        -detuning * q - loss * p,
        detuning * p - loss * q + parts.push * first / (2 * m * omega),
    )
    return Model(
        "magneto-elastic pair, averaged in closed form",
        x=slow_states(V, swing),
        ode=ode,
        p=parts.parameters,
        outputs=slow_outputs(V, swing, omega),
    )


@dataclass(frozen=True)
class SteadyPair:
    """Steady motion of the dimensionless pair (eq. 19 of Zimmermann et al. 2007)."""

    velocity: float  # V
    amplitude: float  # a, of half the stretch
    lag: float  # xi, from 0 to pi


def steady_pair(forward: float, backward: float, detuning: float) -> SteadyPair:
    """Steady motion of the averaged pair in the field G = 1 + cos(nu t), in closed form.

    Source: eq. 19 of Zimmermann et al. 2007, with nu = sqrt(2) + eps detuning. With E = (F- + F+) /
    pi, Phi = (pi / 2) (F- - F+) / (F- + F+) and R = sqrt(1/4 - E^2 cos^2 Phi): V = R sin(Phi) /
    |Delta|, a = R / (sqrt(2) |Delta|), cos(xi) = -2 R sign(Delta). All quantities are
    dimensionless.

    Parameters
    ----------
    forward : float
        Friction F+ against forward motion over eps, not negative.
    backward : float
        Friction F- against backward motion over eps, not negative; not both 0.
    detuning : float
        Detuning Delta.

    Returns
    -------
    SteadyPair
        Velocity V, amplitude a of half the stretch, and phase xi in rad.

    Raises
    ------
    ArgumentError
        If no steady motion exists: E cos(Phi) is 1/2 or more, so friction takes more than the field
        supplies, or Delta is 0, where the swing grows without bound. Also if an argument is out of
        its range.

    Examples
    --------
    >>> round(steady_pair(0.5, 1.0, 0.5).velocity, 8)
    0.28110586
    """
    if not (0 <= forward < math.inf and 0 <= backward < math.inf and forward + backward > 0):
        raise ArgumentError(
            "friction must be finite and not negative, with at least one value above 0"
        )
    if not math.isfinite(detuning):
        raise ArgumentError(f"detuning must be a finite number, not {detuning!r}")
    taken = _taken(forward, backward)
    if taken >= 0.5:
        raise ArgumentError(
            f"no steady motion exists: friction takes E cos(Phi) = {taken:.6g} of the swing, and "
            "the field supplies at most 1/2; write smaller friction"
        )
    if detuning == 0:
        raise ArgumentError(
            "no steady motion exists at detuning 0, where the swing grows without bound; write "
            "another detuning"
        )
    return SteadyPair(*(float(part) for part in steady_form(forward, backward, detuning)))


def steady_form(forward: Any, backward: Any, detuning: Any) -> tuple[Any, Any, Any]:
    """V, a and xi of eq. 19, for numbers or CasADi expressions, without checks."""
    taken = _taken(forward, backward)
    rest = ca.sqrt((0.5 - taken) * (0.5 + taken))
    size = rest / ca.fabs(detuning)
    lag = ca.acos(-2 * ca.sign(detuning) * rest)
    return ca.sin(_phi(forward, backward)) * size, size / math.sqrt(2), lag


def _phi(forward: Any, backward: Any) -> Any:
    return ca.pi / 2 * (backward - forward) / (backward + forward)


def _taken(forward: Any, backward: Any) -> Any:
    """E cos(Phi) of eq. 19, the share of the swing that friction takes."""
    return (backward + forward) / ca.pi * ca.cos(_phi(forward, backward))
