"""Two masses on a magneto-elastic link under a pulsating field, (16).

The link is a spring of which the rest length follows the square of the field: it pushes its masses
apart with the force P G(t). One of them is in front of the other by choice of names only; friction
that is weaker forward than backward is what moves them.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from wormopt.model.friction import Law
from wormopt.model.model import Model, Output, Signal
from wormopt.systems.pair.pair_parts import pair_parts


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
    >>> import math
    >>> from wormopt.model.friction import Coulomb
    >>> eps = 0.0355
    >>> law = Coulomb(0.5 * eps, 1.0 * eps)
    >>> pair = magnetic_pair(law=law, push=eps, frequency=math.sqrt(2) + 0.5 * eps)
    >>> pair.n_x, [contact.name for contact in pair.contacts]
    (4, ['mass 1', 'mass 2'])
    """
    parts = pair_parts(
        law=law,
        mass=mass,
        stiffness=stiffness,
        push=push,
        frequency=frequency,
        cosines=cosines,
    )
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
        contacts=parts.contacts(v, push),
    )
