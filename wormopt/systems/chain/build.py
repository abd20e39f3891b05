"""The chain of point masses on visco-elastic links with actuators, (8)-(12)."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Law
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.path import ParameterPath
from wormopt.model.schedule import Schedule
from wormopt.model.values import numbers_of
from wormopt.systems.shared.parameters import (
    first_numbers,
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
    """Build n+1 point masses in a row that n visco-elastic links with actuators join, (8)-(12).

    With l_j = x_j - x_{j+1} and mu_j = c_j (l_j - l0_j) + d_j l_j' - u_j, mu_{-1} = mu_n = 0,
    m_i x_i'' = F_i - k_i x_i' - Gamma_i + mu_{i-1} - mu_i, where F_i is the contact's force and
    the head has the number 0. Link forces pull their two masses together where mu_j > 0.

    Stored energy (kinetic and elastic) changes by the power of the inputs, sum_j u_j l_j', less
    sum_j d_j l_j'^2, the power of contacts, drag and load, and, for parameters that vary in time,
    by what changes the springs.

    All numbers are parameters of the model, so that one compiled model serves every worm of n
    links.

    Parameters
    ----------
    links : int
        Number of links n.
    mass : array_like, shape (n+1,)
        Point masses m_i, positive. One number serves for all, here as below.
    stiffness, damping : array_like or ParameterPath, shape (n,)
        Spring constants c_j and dashpot constants d_j, not negative.
    rest_length : array_like or ParameterPath, shape (n,)
        Lengths l0_j of the links without force.
    law : Law or sequence of Law, optional
        Friction of each mass on the ground; none where there is none.
    drag : array_like, shape (n+1,), optional
        Viscous drag k_i, force per velocity, not negative.
    load : array_like, shape (n+1,), optional
        Slope or load Gamma_i, a force against forward motion.
    position, velocity : array_like, shape (n+1,), optional
        Where the masses start and how fast. By default all links have their rest length and the
        tail is at 0, at rest.
    length_nominal, time_nominal : float, optional
        Usual size of a link length and of a period; solvers scale by them.

    Returns
    -------
    Model
        States ``position`` and ``velocity`` (n+1 each); inputs ``input`` (n); parameters ``mass``,
        ``stiffness``, ``damping``, ``rest_length``, ``drag``, ``load`` and those of the laws,
        ``friction_forward`` say; a ParameterPath makes a schedule instead of a parameter, of the
        stiffness with an output of that name. Outputs
        ``length`` (12), ``rate``, ``spring_force`` c (l - l0) + d l', ``link_force`` mu, ``power``
        u l' of each actuator (n each), ``energy``, ``center_of_mass`` and ``center_velocity``.

    Raises
    ------
    ArgumentError
        If links is no whole number from 1 on, a length of a sequence wrong, a mass not positive, a
        stiffness, damping or drag negative, anything not finite, or the law no friction law.

    Examples
    --------
    The chapter's worm of three masses:

    >>> from wormopt.model.friction import Coulomb
    >>> worm = chain(
    ...     2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0, law=Coulomb(1.0, 10.0)
    ... )
    >>> worm.n_x, [s.name for s in worm.u], len(worm.contacts), worm.x[0].value
    (6, ['input'], 3, (4.0, 2.0, 0.0))
    """
    if not isinstance(links, Integral) or links < 1:
        raise ArgumentError(f"a chain has at least one link, and whole ones, not {links!r}")
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

    laws, friction = lift(_laws(law, masses))
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
            # what is a parameter has its name already
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


def _laws(law: Law | Sequence[Law] | None, masses: int) -> Sequence[Law]:
    if law is None:
        return ()
    laws: list[Any] = [law] * masses
    if isinstance(law, Sequence) and not isinstance(law, str):
        laws = [*law]
    if len(laws) != masses:
        raise ArgumentError(f"law must be one or {masses}, not {len(laws)}")
    for each in {type(each): each for each in laws}.values():
        if not isinstance(each, Law) or isinstance(each, type):
            raise ArgumentError(f"law must be Coulomb(forward, backward) or the like, not {each!r}")
    return laws


def _stretched(rest_length: ArrayLike | ParameterPath, links: int) -> np.ndarray:
    """Positions with all links at rest length and the tail at 0."""
    lengths = first_numbers("rest_length", rest_length, links)
    return np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
