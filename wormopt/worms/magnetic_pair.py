"""Two masses on a magneto-elastic link under a pulsating field, (16) and (17).

The link is a spring of which the rest length follows the square of the field: it pushes its masses
apart with the force P G(t). One of them is in front of the other by choice of names only; friction
that is weaker forward than backward is what moves them.

(16) stands in two forms. `magnetic_pair` has positions and velocities; `slow_pair` the variables
of (17), which change slowly where friction and field are small against the spring. Their Models
tell the same motions, exactly; `to_slow` and `from_slow` go from one to the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.core.friction import Law
from wormopt.core.lift import lift
from wormopt.core.model import TINY, Contact, Model, Output, Signal
from wormopt.core.values import numbers
from wormopt.errors import ArgumentError

__all__ = [
    "PairParts",
    "from_slow",
    "magnetic_pair",
    "pair_parts",
    "slow_outputs",
    "slow_pair",
    "slow_states",
    "to_slow",
]


@dataclass(frozen=True, eq=False)
class PairParts:
    """What all forms of the pair share.

    Parameters
    ----------
    t, mass, stiffness, push, frequency : casadi.SX
        Symbols of time and of the parameters.
    field : casadi.SX
        G(t), an expression or the symbol of an input.
    harmonics : casadi.SX
        Coefficients of its cosines, empty for an input.
    inputs, parameters : tuple of Signal
        Of the models.
    laws : tuple of Law
        Friction of both masses, with parameters for numbers.
    forces : casadi.SX, shape (2, 1)
        Friction forces.
    """

    t: ca.SX
    mass: ca.SX
    stiffness: ca.SX
    push: ca.SX
    frequency: ca.SX
    field: ca.SX
    harmonics: ca.SX
    inputs: tuple[Signal, ...]
    parameters: tuple[Signal, ...]
    laws: tuple[Law, ...]
    forces: ca.SX

    @property
    def natural_frequency(self) -> ca.SX:
        """Frequency of the free masses against each other, the square root of 2 in (17)."""
        return ca.sqrt(2 * self.stiffness / self.mass)


def pair_parts(
    law: Law | Sequence[Law],
    mass: float,
    stiffness: float,
    push: float,
    frequency: float,
    cosines: Sequence[float] | None,
) -> PairParts:
    """Make the symbols that all forms of the pair share, and refuse numbers that cannot be.

    Parameters
    ----------
    law, mass, stiffness, push, frequency, cosines : object
        As for `magnetic_pair`.

    Returns
    -------
    PairParts

    Raises
    ------
    ArgumentError
        As `magnetic_pair`.
    """
    t = ca.SX.sym("t")
    given = (
        ("mass", mass, "mass"),
        ("stiffness", stiffness, "stiffness"),
        ("push", push, "force"),
        ("frequency", frequency, "angular_frequency"),
    )
    parameters = []
    for name, value, unit in given:
        signal = Signal(name, ca.SX.sym(name), unit, lower=TINY, value=float(numbers(name, value)))
        signal.check(np.array([signal.value]))
        parameters.append(signal)
    m, c, p, nu = (signal.symbol for signal in parameters)
    inputs: tuple[Signal, ...] = ()
    harmonics = ca.SX(0, 1)
    if cosines is None:
        field = ca.SX.sym("field")
        inputs = (Signal("field", field, value=0.0),)
    else:
        values = numbers("cosines", cosines).ravel()
        if not (values.size and np.all(np.isfinite(values))):
            raise ArgumentError("cosines must be finite numbers, the mean first")
        harmonics = ca.SX.sym("cosines", values.size)
        field = ca.dot(harmonics, ca.cos(nu * t * ca.DM(np.arange(values.size))))
        parameters.append(Signal("cosines", harmonics, value=tuple(values.tolist())))
    laws: list[Any] = list(law) if isinstance(law, Sequence) else [law, law]
    if len(laws) != 2 or not all(isinstance(each, Law) for each in laws):
        raise ArgumentError(f"law must be one friction law or two, not {law!r}")
    lifted, friction = lift(laws)
    ground = ca.SX.sym("friction", 2)
    return PairParts(
        t, m, c, p, nu, field, harmonics, inputs, (*parameters, *friction), lifted, ground
    )  # fmt: skip


def magnetic_pair(
    *,
    law: Law | Sequence[Law],
    push: float,
    frequency: float,
    mass: float = 1.0,
    stiffness: float = 1.0,
    cosines: Sequence[float] | None = (1.0, 1.0),
) -> Model:
    """Build m x_1'' = c (x_2 - x_1) + F_1 - P G, m x_2'' = c (x_1 - x_2) + F_2 + P G, (16).

    Places are displacements from where the link is at rest without field. In the chapter's
    dimensionless form mass and stiffness are 1, the push P is eps and so is the factor in front of
    the friction; forces in newton and times in seconds do as well, see `PairScales`.

    Parameters
    ----------
    law : Law or sequence of Law
        Friction of both masses on the ground, in units of force.
    push : float
        Force P, positive: eps, or half the field's strain u0 times stiffness and length.
    frequency : float
        Angular frequency nu of the field, positive.
    mass, stiffness : float, optional
        Each mass m, spring constant c, positive.
    cosines : sequence of float, optional
        G(t) = sum_k cosines[k] cos(k nu t). None makes G the input ``field``: drive it by a Gait,
        or optimise it.

    Returns
    -------
    Model
        States ``position`` and ``velocity`` (2 each), outputs ``center``, ``center_velocity``,
        ``stretch`` x_2 - x_1, ``stretch_rate``, ``field``, ``push_force`` P G and its ``power``.

    Raises
    ------
    ArgumentError
        If a number is not positive and finite, or the law no friction law.

    Examples
    --------
    >>> from wormopt.core.friction import Coulomb
    >>> eps = 0.0355
    >>> law = Coulomb(0.5 * eps, 1.0 * eps)
    >>> pair = magnetic_pair(law=law, push=eps, frequency=math.sqrt(2) + 0.5 * eps)
    >>> pair.n_x, [contact.name for contact in pair.contacts]
    (4, ['mass 1', 'mass 2'])
    """
    parts = pair_parts(law, mass, stiffness, push, frequency, cosines)
    x, v = ca.SX.sym("x", 2), ca.SX.sym("v", 2)
    stretch, rate = x[1] - x[0], v[1] - v[0]
    pull = parts.stiffness * stretch - parts.push * parts.field
    acceleration = (parts.forces + ca.vertcat(pull, -pull)) / parts.mass
    return Model(
        "magneto-elastic pair",
        x=[
            Signal("position", x, "length", value=(0.0, 0.0)),
            Signal("velocity", v, "speed", value=(0.0, 0.0)),
        ],
        ode=ca.vertcat(v, acceleration),
        u=parts.inputs,
        p=parts.parameters,
        t=parts.t,
        outputs=[
            Output("center", ca.sum1(x) / 2, "length"),
            Output("center_velocity", ca.sum1(v) / 2, "speed"),
            Output("stretch", stretch, "length"),
            Output("stretch_rate", rate, "speed"),
            Output("field", parts.field),
            Output("push_force", parts.push * parts.field, "force"),
            Output("power", parts.push * parts.field * rate, "power"),
        ],
        contacts=_contacts(parts, v, push),
    )


def slow_pair(
    *,
    law: Law | Sequence[Law],
    push: float,
    frequency: float,
    mass: float = 1.0,
    stiffness: float = 1.0,
    cosines: Sequence[float] | None = (1.0, 1.0),
) -> Model:
    """Build the same pair in slow variables, (17) with the phase lag of (18).

    Half the stretch is z = a cos(nu t - xi), its rate z' = -a Omega sin(nu t - xi) with
    Omega = sqrt(2 c / m). The states are the velocity V of the center and, since amplitude a and
    lag xi are no coordinates at a = 0, the components a cos(xi) and a sin(xi):

    V' = (F_1 + F_2) / (2 m),
    p' = -(nu - Omega) q - h sin(nu t) / Omega,   q' = (nu - Omega) p + h cos(nu t) / Omega,
    h = (P G + (F_2 - F_1) / 2) / m.

    Nothing is left out: with x_1' = V - z', x_2' = V + z' this is (16), less its place.

    Parameters
    ----------
    law : Law or sequence of Law
        Friction of both masses, as for `magnetic_pair`, and so are the others.
    push, frequency : float
        Force P and angular frequency nu; the latter is the frame's too.
    mass, stiffness : float, optional
        Each mass, spring constant.
    cosines : sequence of float, optional
        Harmonics of the field, or None for an input.

    Returns
    -------
    Model
        States ``center_velocity`` and ``swing`` (p, q), outputs ``amplitude`` a, ``lag`` xi and
        ``speed_share`` V / (a Omega). In standard form for `average` where law, push and
        frequency - Omega are small.

    Raises
    ------
    ArgumentError
        As `magnetic_pair`.

    Examples
    --------
    >>> from wormopt.core.friction import Coulomb
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
        contacts=_contacts(parts, ca.vertcat(V - rate, V + rate), push),
    )


def to_slow(
    t: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    *,
    frequency: float,
    natural_frequency: float = math.sqrt(2),
) -> dict[str, np.ndarray]:
    """Go from the states of `magnetic_pair` to those of `slow_pair`.

    Parameters
    ----------
    t : array_like, shape (m,)
        Times.
    position, velocity : array_like, shape (2, m)
        States then.
    frequency : float
        Frequency nu of the frame.
    natural_frequency : float, optional
        Omega.

    Returns
    -------
    dict of str to ndarray
        ``center_velocity`` (m,), ``swing`` (2, m) and, so that nothing is lost, ``center`` (m,).

    Examples
    --------
    >>> slow = to_slow(0.0, [-0.1, 0.3], [0.0, 0.0], frequency=1.5)
    >>> slow["swing"].round(12), float(slow["center"].round(12))
    (array([0.2, 0. ]), 0.1)
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
    """Go back from the states of `slow_pair` to those of `magnetic_pair`.

    Parameters
    ----------
    t : array_like, shape (m,)
        Times.
    center_velocity : array_like, shape (m,)
        V.
    swing : array_like, shape (2, m)
        a cos(xi), a sin(xi).
    center : array_like, shape (m,), optional
        Place of the center, which `slow_pair` does not know.
    frequency : float
        Frequency nu of the frame.
    natural_frequency : float, optional
        Omega.

    Returns
    -------
    dict of str to ndarray
        ``position`` and ``velocity``, shape (2, m).

    Examples
    --------
    >>> from_slow(0.0, 0.0, [0.2, 0.0], center=0.1, frequency=1.5)["position"].round(12)
    array([-0.1,  0.3])
    """
    V, (p, q), psi = np.asarray(center_velocity), np.asarray(swing), frequency * np.asarray(t)
    c, s = np.cos(psi), np.sin(psi)
    z, rate = p * c + q * s, natural_frequency * (q * c - p * s)
    return {
        "position": np.array([center - z, center + z]),
        "velocity": np.array([V - rate, V + rate]),
    }


def slow_states(V: ca.SX, swing: ca.SX) -> list[Signal]:
    """List the states of `slow_pair` and of its averages.

    Parameters
    ----------
    V : casadi.SX
        Velocity of the center.
    swing : casadi.SX, shape (2, 1)
        a cos(xi), a sin(xi).

    Returns
    -------
    list of Signal
    """
    return [
        Signal("center_velocity", V, "speed", value=0.0),
        Signal("swing", swing, "length", value=(0.0, 0.0)),
    ]


def slow_outputs(V: ca.SX, swing: ca.SX, natural_frequency: ca.SX) -> list[Output]:
    """List the outputs of `slow_pair` and of its averages.

    Parameters
    ----------
    V : casadi.SX
        Velocity of the center.
    swing : casadi.SX, shape (2, 1)
        a cos(xi), a sin(xi).
    natural_frequency : casadi.SX
        Omega.

    Returns
    -------
    list of Output
    """
    a = ca.sqrt(ca.sumsqr(swing))
    return [
        Output("amplitude", a, "length"),
        Output("lag", ca.atan2(swing[1], swing[0]), "angle"),
        Output("speed_share", V / (a * natural_frequency), "share"),
    ]


def _contacts(parts: PairParts, velocity: ca.SX, push: float) -> list[Contact]:
    return [
        Contact(f"mass {i + 1}", velocity[i], parts.forces[i], parts.laws[i], nominal_force=push)
        for i in range(2)
    ]
