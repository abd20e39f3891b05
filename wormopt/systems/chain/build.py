"""Model of a chain of point masses on visco-elastic links with actuators."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.schedule import ParameterPath, Schedule
from wormopt.model.values import numbers_of
from wormopt.systems.shared.parameters import (
    first_numbers,
    laws_of_each,
    parameter,
    varied_parameter,
)


def chain(
    links: int,
    *,
    mass: ArrayLike,
    stiffness: ArrayLike | ParameterPath,
    damping: ArrayLike | ParameterPath,
    rest_length: ArrayLike | ParameterPath,
    law: Law | Sequence[Law] | None = None,
    drag: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    position: ArrayLike | None = None,
    velocity: ArrayLike = 0.0,
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build the model of a chain of n+1 point masses joined by n visco-elastic links.

    This is the worm of eqs. 8 to 12 of Zimmermann et al. 2007. Mass 0 is the head. With the lengths
    l_j = x_j - x_{j+1} (eq. 12), the link forces are mu_j = c_j (l_j - l0_j) + d_j l_j' - u_j, and
    mu_{-1} = mu_n = 0. The equation of motion is m_i x_i'' = F_i - k_i x_i' - Gamma_i + mu_{i-1} -
    mu_i, with the contact force F_i. A link pulls its two masses together where mu_j > 0.

    The rate of the stored (kinetic and elastic) energy is the power of the inputs, sum_j u_j l_j',
    minus sum_j d_j l_j'^2, plus the power of contacts, drag and load. Parameters that vary in time
    add the power that changes the springs.

    All values are parameters of the model, so one compiled model serves every chain of n links.
    Units are consistent: SI, or any units of length, mass and time.

    Parameters
    ----------
    links : int
        Number of links n, at least 1.
    mass : array_like, shape (n+1,)
        Point masses m_i, positive. Here and below, a scalar applies to all masses or links.
    stiffness : array_like or ParameterPath, shape (n,)
        Spring constants c_j in force per length, not negative.
    damping : array_like or ParameterPath, shape (n,)
        Dashpot constants d_j in force per speed, not negative.
    rest_length : array_like or ParameterPath, shape (n,)
        Lengths l0_j of the links without force.
    law : Law or sequence of Law, optional
        Friction law of all masses, or of each mass. Default: no friction.
    drag : array_like, shape (n+1,), optional
        Viscous drag k_i in force per speed, not negative.
    load : array_like, shape (n+1,), optional
        Load Gamma_i, a force against forward motion, for example the weight along a slope.
    position : array_like, shape (n+1,), optional
        Initial positions. Default: links at rest length, tail at 0.
    velocity : array_like, shape (n+1,), optional
        Initial velocities. Default: 0.
    length_nominal : float, optional
        Usual size of a link length; solvers scale by it.
    time_nominal : float, optional
        Usual size of a period; solvers scale by it.

    Returns
    -------
    Model
        States: ``position`` and ``velocity`` (n+1 each). Inputs: ``input``, the forces u_j (n).
        Parameters: ``mass``, ``stiffness``, ``damping``, ``rest_length``, ``drag``, ``load`` and
        those of the laws, for example ``friction_forward``. A ParameterPath gives a schedule
        instead of a parameter; that of the stiffness is also an output.
        Outputs: ``length``, ``rate``, ``spring_force`` c (l - l0) + d l', ``link_force`` mu,
        ``power`` u l' of each actuator (n each), ``energy``, ``center_of_mass`` and
        ``center_velocity``.

    Raises
    ------
    ArgumentError
        If `links` is not a positive integer, a sequence has the wrong length, a mass is not
        positive, a stiffness, damping or drag is negative, a value is not finite, or `law` is not a
        friction law.

    Examples
    --------
    Three masses with dry friction:

    >>> from wormopt.model.friction import Coulomb
    >>> worm = chain(
    ...     2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=Coulomb(1.0, 10.0)
    ... )
    >>> worm.n_x, [s.name for s in worm.u], len(worm.contacts), worm.x[0].value
    (6, ['input'], 3, (4.0, 2.0, 0.0))
    """
    if not isinstance(links, Integral) or links < 1:
        raise ArgumentError(f"links is {links!r}, not a positive integer; write at least 1")
    masses = links + 1
    speed = length_nominal / time_nominal
    t = ca.SX.sym("t")
    x, v, u = ca.SX.sym("x", masses), ca.SX.sym("v", masses), ca.SX.sym("u", links)

    parameters = [
        parameter("mass", mass, masses, "mass"),
        parameter("drag", drag, masses, "drag"),
        parameter("load", load, masses, "force"),
    ]
    m, k, gamma = (p.symbol for p in parameters)

    c, elastic = varied_parameter("stiffness", stiffness, links, "stiffness", t)
    d, damped = varied_parameter("damping", damping, links, "drag", t)
    rest, resting = varied_parameter("rest_length", rest_length, links, "length", t)
    springs = (elastic, damped, resting)
    parameters += [s for s in springs if isinstance(s, Signal)]

    laws, friction = lift([] if law is None else laws_of_each(law, masses))
    force = ca.SX.sym("friction", len(laws))
    ground = force if laws else ca.SX(masses, 1)

    length, rate = x[:-1] - x[1:], v[:-1] - v[1:]
    spring = c * (length - rest) + d * rate
    link_force = spring - u  # (8)
    net = ca.vertcat(0, link_force) - ca.vertcat(link_force, 0)
    acceleration = (ground - k * v - gamma + net) / m  # (10)

    if position is None:
        position = _stretched(rest_length, links)
    force_nominal = float(np.mean(numbers_of("mass", mass, masses))) * speed / time_nominal
    total = ca.sum1(m)
    return Model(
        name=f"chain of {links} links",
        x=[
            Signal(
                "position",
                x,
                "length",
                length_nominal,
                value=numbers_of("position", position, masses),
            ),
            Signal("velocity", v, "speed", speed, value=numbers_of("velocity", velocity, masses)),
        ],
        ode=ca.vertcat(v, acceleration),
        u=[Signal("input", u, "force", force_nominal, value=(0.0,) * links)],
        p=[*parameters, *friction],
        t=t,
        outputs=[
            Output("length", length, "length"),
            Output("rate", rate, "speed"),
            Output("spring_force", spring, "force"),
            Output("link_force", link_force, "force"),
            Output("power", u * rate, "power"),
            # Parameters already have their names.
            *([] if isinstance(elastic, Signal) else [Output("stiffness", c, "stiffness")]),
            Output("energy", (ca.dot(m, v**2) + ca.dot(c, (length - rest) ** 2)) / 2, "energy"),
            Output("center_of_mass", ca.dot(m, x) / total, "length"),
            Output("center_velocity", ca.dot(m, v) / total, "speed"),
        ],
        contacts=[
            Contact(f"mass {i}", *own, force_nominal, speed)
            for i, own in enumerate(zip(ca.vertsplit(v), ca.vertsplit(force), laws, strict=False))
        ],
        schedules=[s for s in springs if isinstance(s, Schedule)],
    )


def _stretched(rest_length: ArrayLike | ParameterPath, links: int) -> np.ndarray:
    """Positions with all links at rest length and the tail at 0."""
    lengths = first_numbers("rest_length", rest_length, links)
    return np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
