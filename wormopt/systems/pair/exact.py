"""Two masses on a magneto-elastic link in a pulsating field (eq. 16 of Zimmermann et al. 2007).

The link is a spring whose rest length follows the square of the field: it pushes its masses apart
with the force P G(t). The order of the two masses is arbitrary. The pair moves because friction is
weaker forward than backward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.given import fields_of
from wormopt.model.lift import QUANTITIES, lift
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.values import numbers
from wormopt.systems.shared.parameters import laws_of_each, parameter, positive_parameter


def magnetic_pair(
    *,
    law: Law | Sequence[Law],
    push: float,
    frequency: float,
    mass: float = 1.0,
    stiffness: float = 1.0,
    damping: float = 0.0,
    cosines: Sequence[float] | None = (1.0, 1.0),
) -> Model:
    """Build the model of two masses on a magneto-elastic link in a pulsating field.

    This is eq. 16 of Zimmermann et al. 2007: m x_1'' = c (x_2 - x_1) + F_1 - P G and m x_2'' = c
    (x_1 - x_2) + F_2 + P G. A dashpot beside the spring adds d (x_2' - x_1') to the force c (x_2 -
    x_1) that pulls both masses together; eq. 16 has d = 0. Positions are displacements from the
    rest state without field.

    In the dimensionless form of that text, mass and stiffness are 1, and the push P and the factor
    of the friction are eps. SI units are possible too, see `PairScales`.

    Parameters
    ----------
    law : Law or sequence of Law
        Friction of both masses on the ground, in units of force.
    push : float
        Force P, positive: eps, or half the field's strain u0 times stiffness and length.
    frequency : float
        Angular frequency nu of the field, positive.
    mass : float, optional
        Mass m of each mass, positive.
    stiffness : float, optional
        Spring constant c in force per length, positive.
    damping : float, optional
        Dashpot constant d in force per speed, not negative.
    cosines : sequence of float, optional
        Dimensionless field G(t) = sum_k cosines[k] cos(k nu t). None makes G the input ``field``,
        which can be driven by a Gait or optimised.

    Returns
    -------
    Model
        States ``position`` and ``velocity`` (2 each), outputs ``center``, ``center_velocity``,
        ``stretch`` x_2 - x_1, ``stretch_rate``, ``field``, ``push_force`` P G and its ``power``.

    Raises
    ------
    ArgumentError
        If a value is not positive and finite, damping is negative, or the law is not a friction
        law.

    Examples
    --------
    >>> import math
    >>> from wormopt.model.friction import Coulomb
    >>> eps = 0.0355
    >>> law = Coulomb(0.5 * eps, 1.0 * eps)
    >>> pair = magnetic_pair(law=law, push=eps, frequency=math.sqrt(2) + 0.5 * eps)
    >>> pair.n_x, [contact.name for contact in pair.contacts]
    (4, ['mass 0', 'mass 1'])
    """
    parts = pair_parts(law, mass, stiffness, push, frequency, cosines)
    x, v = ca.SX.sym("x", 2), ca.SX.sym("v", 2)
    stretch, rate = x[1] - x[0], v[1] - v[0]
    dashpot = parameter("damping", damping, 1, "drag")
    pull = parts.stiffness * stretch + dashpot.symbol * rate - parts.push * parts.field
    acceleration = (parts.forces + ca.vertcat(pull, -pull)) / parts.mass
    return Model(
        "magneto-elastic pair",
        x=[
            Signal("position", x, "length", value=(0.0, 0.0)),
            Signal("velocity", v, "speed", value=(0.0, 0.0)),
        ],
        ode=ca.vertcat(v, acceleration),
        u=parts.inputs,
        p=[*parts.parameters, dashpot],
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
        contacts=parts.contacts(v, push),
    )


# -- what all forms of the pair share --------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PairParts:
    """Symbols and expressions that all forms of the pair share."""

    t: ca.SX  # time
    mass: ca.SX
    stiffness: ca.SX
    push: ca.SX
    frequency: ca.SX
    field: ca.SX  # G(t), an expression or the symbol of an input
    harmonics: ca.SX  # coefficients of its cosines, empty for an input
    inputs: tuple[Signal, ...]
    parameters: tuple[Signal, ...]
    laws: tuple[Law, ...]  # friction of both masses, with parameters for numbers
    forces: ca.SX  # (2, 1) friction forces

    @property
    def natural_frequency(self) -> ca.SX:
        """Natural frequency of the free masses against each other, sqrt(2) in eq. 17."""
        return ca.sqrt(2 * self.stiffness / self.mass)

    def contacts(self, velocities: ca.SX, nominal_force: float) -> list[Contact]:
        """Contacts of both masses, with velocities (2, 1), on the ground."""
        return [
            Contact(f"mass {i}", velocities[i], self.forces[i], law, nominal_force)
            for i, law in enumerate(self.laws)
        ]


def pair_parts(
    law: Law | Sequence[Law],
    mass: float,
    stiffness: float,
    push: float,
    frequency: float,
    cosines: Sequence[float] | None,
) -> PairParts:
    """Make the symbols that all forms of the pair share, from arguments of `magnetic_pair`."""
    t = ca.SX.sym("t")
    sizes = [
        positive_parameter("mass", mass, "mass"),
        positive_parameter("stiffness", stiffness, "stiffness"),
        positive_parameter("push", push, "force"),
        positive_parameter("frequency", frequency, "angular_frequency"),
    ]
    m, c, p, nu = (signal.symbol for signal in sizes)
    if cosines is None:
        field = ca.SX.sym("field")
        inputs, shape = (Signal("field", field, value=0.0),), ()
        harmonics = ca.SX(0, 1)
    else:
        inputs, shape = (), (_harmonics(cosines),)
        harmonics = shape[0].symbol
        orders = ca.DM(np.arange(harmonics.numel()))
        field = ca.dot(harmonics, ca.cos(nu * t * orders))
    laws, friction = lift(laws_of_each(law, 2))
    ground, known = ca.SX.sym("friction", 2), (*sizes, *shape, *friction)
    return PairParts(t, m, c, p, nu, field, harmonics, inputs, known, laws, ground)


def _harmonics(cosines: Sequence[float]) -> Signal:
    values = numbers("cosines", cosines).ravel()
    if not (values.size and np.all(np.isfinite(values))):
        raise ArgumentError("cosines must be finite numbers, with the mean first")
    return Signal("cosines", ca.SX.sym("cosines", values.size), value=tuple(values.tolist()))


def scaled_law(law: Law, push: float, speed: float = 1.0) -> Law:
    """Friction law with forces times the push and velocities times the speed."""
    sizes = {"force": push, "speed": speed, "drag": push / speed}
    scaled = {
        name: sizes[QUANTITIES[name]] * value
        for name, value in fields_of(law).items()
        if value is not None
    }
    return replace(law, **scaled)  # type: ignore[type-var]
