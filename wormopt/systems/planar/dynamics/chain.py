"""The planar chain: point masses in the plane, links that change length, joints that bend."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, Signal
from wormopt.model.path import ParameterPath
from wormopt.model.schedule import Schedule
from wormopt.model.values import numbers
from wormopt.systems.planar.body.obstacles import Disc, Wall
from wormopt.systems.planar.body.shape import Heading
from wormopt.systems.planar.dynamics.ground import Ground, ground_laws, press, touch
from wormopt.systems.planar.dynamics.rods import RodMasses
from wormopt.systems.shared.parameters import (
    first_numbers,
    numbers_of,
    parameter,
    varied_parameter,
)

POWERS = ("input", "torque", "damping", "ground", "pull")
"""What works are told of: outputs ``<name>_power``."""


def planar_chain(
    links: int,
    *,
    mass: ArrayLike,
    stiffness: ArrayLike | ParameterPath,
    damping: ArrayLike | ParameterPath,
    rest_length: ArrayLike | ParameterPath,
    bending_stiffness: ArrayLike | ParameterPath = 0.0,
    bending_damping: ArrayLike | ParameterPath = 0.0,
    rest_angle: ArrayLike | ParameterPath = 0.0,
    rod_mass: ArrayLike | None = None,
    law: Ground | Sequence[Ground | None] | None = None,
    pull: ArrayLike = (0.0, 0.0),
    heading: Heading = "bisector",
    obstacles: Sequence[Wall | Disc] = (),
    position: ArrayLike | None = None,
    velocity: ArrayLike = (0.0, 0.0),
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build n+1 point masses in the plane that n visco-elastic links with actuators join.

    Masses have the numbers 0 (head) to n. With d_j = r_{j-1} - r_j, lengths l_j = |d_j| and angles
    phi_j of the joints from the link behind to the one in front (positive: the front is turned to
    the left), m_i r_i'' = F_i + g_i - (dy/dr_i)^T mu, where y = (l, phi) and
    mu = (c (l - l0) + d l' - u, kappa (phi - phi0) + delta phi' - w). Angles are told from -pi to
    pi: a joint must not bend so far that it folds.

    Parameters
    ----------
    links : int
        Number of links n.
    mass : array_like, shape (n+1,)
        Point masses, positive. One number serves for all, here as below.
    stiffness, damping : array_like or ParameterPath, shape (n,)
        Spring constants c and dashpot constants d of the links, not negative.
    rest_length : array_like or ParameterPath, shape (n,)
        Lengths l0 of the links without force.
    bending_stiffness, bending_damping : array_like or ParameterPath, shape (n-1,), optional
        The same of the joints: kappa, torque per angle, and delta.
    rest_angle : array_like or ParameterPath, shape (n-1,), optional
        Angles phi0 of the joints without torque.
    rod_mass : array_like, shape (n,), optional
        Masses of uniform rods along the links, which stretch evenly; then all masses are coupled.
    law : Elliptic, Unit, Axes, or sequence of these or None, optional
        Ground under each mass; none where there is none.
    pull : array_like, shape (2,) or (n+1, 2), optional
        Constant force on each mass, the weight along a slope for instance.
    heading : {"bisector", "front", "rear"}, optional
        Along what an inner mass looks: between its links, or along the one in front or behind.
    obstacles : sequence of Wall or Disc, optional
        What stands in the plane; masses do not pass. Such a model is simulated after
        `smooth_walls`, or by steps of Moreau and Jean.
    position, velocity : array_like, shape (n+1, 2), optional
        Where the masses start and how fast (one for all: shape (2,)). By default all links and
        joints are at rest, the tail is at the origin and its link looks along x.
    length_nominal, time_nominal : float, optional
        Usual size of a link length and of a period; solvers scale by them.

    Returns
    -------
    Model
        States ``position`` and ``velocity``, x and y of one mass after the other; inputs ``input``
        (n forces u that push the masses of a link apart) and ``torque`` (n-1 torques w that turn
        the front of a joint to the left). Outputs ``length``, ``angle`` and their rates ``rate``
        and ``turning``, ``link_force`` and ``joint_torque`` mu, ``heading`` of the masses,
        ``ground_force`` in the plane, ``speed``, ``energy`` (kinetic and elastic),
        ``kinetic_energy``, ``center_of_mass``, ``center_velocity``, ``power`` of each actuator
        (links, then joints) and powers ``input_power``, ``torque_power``, ``damping_power``,
        ``ground_power`` and ``pull_power`` that the worm takes up.

    Raises
    ------
    ArgumentError
        If links is no whole number from 1 on, a number or length of a sequence wrong, or a law no
        law of the plane.

    Examples
    --------
    >>> from wormopt.model.friction import Viscous
    >>> from wormopt.systems.planar.dynamics.ground import Axes
    >>> drag = Axes(Viscous(0.5), Viscous(5.0))
    >>> worm = planar_chain(2, mass=1.0, stiffness=10.0, damping=1.0, rest_length=1.0, law=drag)
    >>> worm.n_x, [s.name for s in worm.u], len(worm.contacts), worm.x[0].value
    (12, ['input', 'torque'], 6, (2.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    """
    if not isinstance(links, Integral) or links < 1:
        raise ArgumentError(f"a chain has at least one link, and whole ones, not {links!r}")
    masses, joints, t = links + 1, links - 1, ca.SX.sym("t")
    speed = length_nominal / time_nominal
    force_size = float(np.mean(numbers_of("mass", mass, masses))) * speed / time_nominal
    r, v = ca.SX.sym("r", 2 * masses), ca.SX.sym("v", 2 * masses)
    u, w = ca.SX.sym("u", links), ca.SX.sym("w", joints)

    springs = [
        varied_parameter("stiffness", stiffness, links, "stiffness", t),
        varied_parameter("damping", damping, links, "drag", t),
        varied_parameter("rest_length", rest_length, links, "length", t),
        varied_parameter("bending_stiffness", bending_stiffness, joints, "1", t, "joints"),
        varied_parameter("bending_damping", bending_damping, joints, "1", t, "joints"),
        varied_parameter("rest_angle", rest_angle, joints, "angle", t, "joints"),
    ]
    c, d, l0, kappa, delta, phi0 = (expression for expression, _ in springs)
    weighed = [parameter("mass", mass, masses, "mass"), _pull(pull, masses)]
    if rod_mass is not None:
        weighed.append(parameter("rod_mass", rod_mass, links, "mass"))
    inertia = RodMasses(weighed[0].symbol, weighed[2].symbol if rod_mass is not None else None)

    geometry = Geometry(r, v, heading)
    length, angle = geometry.lengths, geometry.angles
    rate, turning = ca.vertsplit(geometry.rates, [0, links, links + joints])
    elastic = ca.vertcat(c * (length - l0), kappa * (angle - phi0))
    damped = ca.vertcat(d * rate, delta * turning)
    mu = elastic + damped - ca.vertcat(u, w)

    ground = touch(ground_laws(law, masses), geometry.along(v), force_size, speed)
    grounded = ca.vec(geometry.turned(ground.forces))
    walls, pressed = press(obstacles, geometry.plane(r), geometry.plane(v), force_size, speed)
    outer = weighed[1].symbol + grounded + ca.vec(pressed)
    acceleration = inertia.solve(outer - geometry.pulled(mu))
    if position is None:
        position = _relaxed(rest_length, rest_angle, links)
    kinetic = inertia.kinetic(v)
    stored = (ca.dot(c, (length - l0) ** 2) + ca.dot(kappa, (angle - phi0) ** 2)) / 2
    return Model(
        name=f"planar chain of {links} links",
        x=[
            Signal("position", r, "length", length_nominal,
                   value=pairs("position", position, masses)),
            Signal("velocity", v, "speed", speed, value=pairs("velocity", velocity, masses)),
        ],
        ode=ca.vertcat(v, acceleration),
        u=[
            Signal("input", u, "force", force_size, value=(0.0,) * links),
            Signal("torque", w, "energy", force_size * length_nominal, value=(0.0,) * joints),
        ][: 1 + (joints > 0)],
        p=[*weighed, *(s for _, s in springs if isinstance(s, Signal) and s.size),
           *ground.parameters],
        t=t,
        outputs=[
            Output("length", length, "length"),
            Output("angle", angle, "angle"),
            Output("rate", rate, "speed"),
            Output("turning", turning, "angular_frequency"),
            Output("link_force", mu[:links], "force"),
            Output("joint_torque", mu[links:], "energy"),
            Output("heading", geometry.headings, "angle"),
            Output("ground_force", grounded, "force"),
            Output("speed", ca.sqrt(ca.sum1(geometry.plane(v) ** 2)).T, "speed"),
            Output("kinetic_energy", kinetic, "energy"),
            Output("energy", kinetic + stored, "energy"),
            Output("center_of_mass", inertia.center(r), "length"),
            Output("center_velocity", inertia.center(v), "speed"),
            Output("power", ca.vertcat(u * rate, w * turning), "power"),
            Output("input_power", ca.dot(u, rate), "power"),
            Output("torque_power", ca.dot(w, turning), "power"),
            Output("damping_power", -ca.dot(damped, geometry.rates), "power"),
            Output("ground_power", ca.dot(grounded, v), "power"),
            Output("pull_power", ca.dot(weighed[1].symbol, v), "power"),
        ],
        contacts=[*ground.contacts, *walls],
        schedules=[s for _, s in springs if isinstance(s, Schedule)],
    )  # fmt: skip


class Geometry:
    """Lengths, angles and headings of a chain of masses at `r` that move with `v`, both stacked."""

    def __init__(self, r: ca.SX, v: ca.SX, heading: Heading) -> None:
        self._r, places = r, self.plane(r)
        links = places[:, :-1] - places[:, 1:]
        front, behind = links[:, :-1], links[:, 1:]
        self.lengths = ca.sqrt(ca.sum1(links**2)).T
        cross = behind[0, :] * front[1, :] - behind[1, :] * front[0, :]
        self.angles = ca.atan2(cross, ca.sum1(front * behind)).T
        self._y = ca.vertcat(self.lengths, self.angles)
        self.rates = ca.jtimes(self._y, r, v)
        self._looks = _looks(links / ca.repmat(self.lengths.T, 2, 1), heading)

    @staticmethod
    def plane(stacked: ca.SX) -> ca.SX:
        """One column (2) for each mass."""
        return ca.reshape(stacked, 2, stacked.numel() // 2)

    @property
    def headings(self) -> ca.SX:
        """Angles from -pi to pi along which the masses look."""
        return ca.atan2(self._looks[1, :], self._looks[0, :]).T

    def pulled(self, mu: ca.SX) -> ca.SX:
        """Forces (dy/dr)^T mu, stacked."""
        return ca.jtimes(self._y, self._r, mu, True)

    def along(self, v: ca.SX) -> ca.SX:
        """Components (2, masses) of vectors along the headings and to their left."""
        looks, vectors = self._looks, self.plane(v)
        left = ca.vertcat(-looks[1, :], looks[0, :])
        return ca.vertcat(ca.sum1(looks * vectors), ca.sum1(left * vectors))

    def turned(self, components: ca.SX) -> ca.SX:
        """Vectors in the plane (2, masses) by their components along the headings and left."""
        looks, left = self._looks, ca.vertcat(-self._looks[1, :], self._looks[0, :])
        ahead, aside = (ca.repmat(components[k, :], 2, 1) for k in range(2))
        return ahead * looks + aside * left


def _looks(along: ca.SX, heading: Heading) -> ca.SX:
    """Unit vectors (2, masses) along which masses look, by those of the links, head first."""
    front, behind = along[:, :-1], along[:, 1:]
    middle = front + behind  # no angle is needed: their sum bisects them
    size = ca.sqrt(ca.sum1(middle**2))
    inner = {"front": front, "rear": behind, "bisector": middle / ca.repmat(size, 2, 1)}
    if heading not in inner:
        raise ArgumentError(f"heading must be one of front, rear, bisector, not {heading!r}")
    return ca.horzcat(along[:, 0], inner[heading], along[:, -1])


def _pull(given: ArrayLike, masses: int) -> Signal:
    size = 2 * masses
    return Signal("pull", ca.SX.sym("pull", size), "force", value=pairs("pull", given, masses))


def pairs(name: str, given: ArrayLike, masses: int) -> tuple[float, ...]:
    """Pairs of numbers, one for all masses or one for each, stacked."""
    values = numbers(name, given)
    if values.shape == (2 * masses,) and masses > 1:
        values = values.reshape(masses, 2)  # as the model itself has them
    if values.shape not in ((2,), (masses, 2)) or not np.all(np.isfinite(values)):
        raise ArgumentError(
            f"{name} must be one finite pair of numbers or {masses}, not of the shape "
            f"{values.shape}"
        )
    return tuple(np.broadcast_to(values, (masses, 2)).ravel().tolist())


def _relaxed(rest_length: Any, rest_angle: Any, links: int) -> np.ndarray:
    """Places (n+1, 2) with all links and joints at rest, the tail at 0 and its link along x."""
    lengths = first_numbers("rest_length", rest_length, links)
    angles = first_numbers("rest_angle", rest_angle, links - 1)
    return chain_places(lengths, angles)


def chain_places(lengths: ArrayLike, angles: ArrayLike) -> np.ndarray:
    """Places (n+1, 2) of masses by lengths (n,) and angles (n-1,): tail at 0, its link along x."""
    sizes, bends = np.asarray(lengths, dtype=float), np.asarray(angles, dtype=float)
    psi = np.append(np.cumsum(bends[::-1])[::-1], 0.0)
    steps = sizes[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
    return np.vstack([np.cumsum(steps[::-1], axis=0)[::-1], np.zeros(2)])
