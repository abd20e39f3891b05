"""The averaged magneto-elastic pair in closed form (eq. 18), and its steady motion (eq. 19)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model
from wormopt.systems.pair.exact import pair_parts
from wormopt.systems.pair.slow import slow_outputs, slow_states


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
