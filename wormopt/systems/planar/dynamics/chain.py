"""The planar chain: masses or uniform rods, extensible links, joints that bend; its contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.planar_friction import PlanarLaw
from wormopt.model.schedule import ParameterPath, Schedule
from wormopt.model.values import numbers, numbers_of
from wormopt.systems.planar.obstacles import Disc, Wall
from wormopt.systems.planar.shape import Heading
from wormopt.systems.shared.parameters import first_numbers, parameter, varied_parameter


@dataclass(frozen=True, eq=False)
class RodMasses:
    """Constant mass matrix of a chain: diagonal, with rods tridiagonal in each component.

    A rod of mass m whose ends move with v_a and v_b has the kinetic energy
    m (|v_a|² + v_a v_b + |v_b|²) / 6, also while it stretches evenly.
    """

    points: ca.SX  # (n + 1,) masses
    rods: ca.SX | None = None  # (n,)

    def solve(self, forces: ca.SX) -> ca.SX:
        """Accelerations from forces, both stacked by mass."""
        if self.rods is None:
            return forces / ca.vec(ca.repmat(self.points.T, 2, 1))
        F = ca.horzsplit(ca.reshape(forces, 2, self.points.numel()))
        pivots, shares = self._factors(self.rods)
        for i, share in enumerate(shares, start=1):
            F[i] = F[i] - share * F[i - 1]
        last = len(F) - 1
        a = [F[last] / pivots[last]]
        for i in range(last - 1, -1, -1):
            a.insert(0, F[i] / pivots[i] - shares[i] * a[0])
        return ca.vertcat(*a)

    def _factors(self, rods: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
        """Pivots, and shares of the row above that are taken off."""
        thirds = rods / 3
        diagonal = ca.vertsplit(self.points + ca.vertcat(thirds, 0) + ca.vertcat(0, thirds))
        pivots, shares = [diagonal[0]], []
        for own, off in zip(diagonal[1:], ca.vertsplit(rods / 6), strict=True):
            shares.append(off / pivots[-1])
            pivots.append(own - off * shares[-1])
        return pivots, shares

    def kinetic(self, v: ca.SX) -> ca.SX:
        """Kinetic energy."""
        columns = ca.reshape(v, 2, self.points.numel())
        energy = ca.dot(self.points, ca.sum1(columns**2).T) / 2
        if self.rods is None:
            return energy
        a, b = columns[:, :-1], columns[:, 1:]
        return energy + ca.dot(self.rods, ca.sum1(a**2 + a * b + b**2).T) / 6

    def center(self, stacked: ca.SX) -> ca.SX:
        """Mean (2) over all mass of what changes linearly along the rods."""
        shares = self.points
        if self.rods is not None:
            shares = shares + (ca.vertcat(self.rods, 0) + ca.vertcat(0, self.rods)) / 2
        columns = ca.reshape(stacked, 2, self.points.numel())
        return columns @ shares / ca.sum1(shares)


@dataclass(frozen=True)
class Axes:
    """Ground with independent friction laws along a point's heading and across it.

    Two `Viscous` laws are linear drag, two `Coulomb` laws a box of forces. `NoSlip` across is a
    skid or a wheel, a `Spike` along is a spike, both are a skid with spikes, and two `NoSlip` laws
    are a pin.

    Parameters
    ----------
    along, across : Law, optional
        Laws; None for no resistance.

    Raises
    ------
    ArgumentError
        If a law is no friction law of a single direction.

    Examples
    --------
    >>> from wormopt.model.friction import Coulomb, NoSlip
    >>> skid = Axes(along=Coulomb(0.1, 0.1), across=NoSlip())
    >>> skid.across
    NoSlip(scale=1.0)
    """

    along: Law | None = None
    across: Law | None = None

    def __post_init__(self) -> None:
        for name in ("along", "across"):
            law = getattr(self, name)
            if law is not None and (not isinstance(law, Law) or isinstance(law, type)):
                raise ArgumentError(f"{name} must be Coulomb(1, 2) or the like, not {law!r:.60}")

    @property
    def laws(self) -> tuple[Law | None, Law | None]:
        """Along and across."""
        return self.along, self.across


Ground = Axes | PlanarLaw
"""Law of one point in the plane."""


@dataclass(frozen=True, eq=False)
class Touching:
    """Contacts of all points with the ground."""

    contacts: list[Contact]
    forces: ca.SX  # (2, points) of the ground, along the headings and to their left
    parameters: tuple[Signal, ...]

    @property
    def symbols(self) -> ca.SX:
        """Column of the forces' symbols, in the contacts' order."""
        return ca.vertcat(ca.SX(0, 1), *(contact.force for contact in self.contacts))


def ground_laws(law: Any, points: int) -> list[Ground | None]:
    """Return the law of every point, from one for all or a sequence; else raise ArgumentError."""
    laws: list[Any] = (
        [*law] if isinstance(law, Sequence) and not isinstance(law, str) else [law] * points
    )
    if len(laws) != points:
        raise ArgumentError(f"law must be one or {points}, not {len(laws)}")
    for each in laws:
        known = isinstance(each, Axes | PlanarLaw) and not isinstance(each, type)
        if each is not None and not known:
            raise ArgumentError(
                f"law must be Elliptic(1, 2, sideways=3), Axes(along, across) or the like, "
                f"not {each!r:.60}"
            )
    return laws


def touch(laws: Sequence[Ground | None], velocities: ca.SX, force: float, speed: float) -> Touching:
    """Return contacts of points with `velocities` (2, points) along and across their headings.

    `force` and `speed` are usual sizes. Values of the laws become parameters.
    """
    named = [*_named(laws)]
    lifted, parameters = lift([law for *_, law in named])
    forces, contacts = ca.SX.zeros(2, len(laws)), []
    for (name, i, rows, _), law in zip(named, lifted, strict=True):
        symbol = ca.SX.sym(f"force_{len(contacts)}", len(rows))
        forces[rows, i] = symbol
        contacts.append(Contact(name, velocities[rows, i], symbol, law, force, speed))
    return Touching(contacts, forces, parameters)


def _named(laws: Sequence[Ground | None]) -> Iterator[tuple[str, int, list[int], Any]]:
    """Yield name, point, components and law of every contact."""
    for i, law in enumerate(laws):
        if not isinstance(law, Axes):
            if law is not None:
                yield f"mass {i}", i, [0, 1], law
            continue
        for row, (word, one) in enumerate(zip(("along", "across"), law.laws, strict=True)):
            if one is not None:
                yield f"mass {i} {word}", i, [row], one


# -- obstacles -------------------------------------------------------------------------------------


def press(
    obstacles: Sequence[Wall | Disc], places: ca.SX, velocities: ca.SX, force: float, speed: float
) -> tuple[list[Contact], ca.SX]:
    """Return contacts of points with obstacles, and their forces (2, points)."""
    contacts, forces = [], ca.SX.zeros(2, places.size2())
    for k, obstacle in enumerate(obstacles):
        if not isinstance(obstacle, Wall | Disc):
            raise ArgumentError(f"obstacles must be Wall or Disc, not {obstacle!r:.60}")
        for i in range(places.size2()):
            normal = obstacle.normal(places[:, i])
            aside = ca.vertcat(-normal[1], normal[0])
            pressed, rubbed = ca.SX.sym(f"pressed_{k}_{i}"), ca.SX.sym(f"rubbed_{k}_{i}")
            law = Coulomb(obstacle.friction * pressed, obstacle.friction * pressed)
            forces[:, i] += pressed * normal + rubbed * aside
            contact = Contact(
                f"mass {i} at obstacle {k}",
                ca.dot(aside, velocities[:, i]),
                rubbed,
                law,
                force,
                speed,
                gap=obstacle.gap(places[:, i]),
                normal_force=pressed,
            )
            contacts.append(contact)
    return contacts, forces


POWERS = ("input", "torque", "damping", "ground", "pull")
"""Names of works, from outputs ``<name>_power``."""


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
    """Build a chain of n+1 point masses in the plane with n visco-elastic, actuated links.

    Masses have the numbers 0 (head) to n. With d_j = r_{j-1} - r_j, lengths l_j = |d_j| and joint
    angles phi_j from the link behind to the one in front (positive: the front is turned to the
    left), m_i r_i'' = F_i + g_i - (dy/dr_i)^T mu, where y = (l, phi) and
    mu = (c (l - l0) + d l' - u, kappa (phi - phi0) + delta phi' - w). Angles are in [-pi, pi]: a
    joint must not bend so far that it folds.

    Theory: docs/theory-planar.md, section 2.

    Parameters
    ----------
    links : int
        Number of links n.
    mass : array_like, shape (n+1,)
        Point masses, positive. For all array_like parameters a single value holds for all.
    stiffness, damping : array_like or ParameterPath, shape (n,)
        Spring constants c and dashpot constants d of the links, not negative.
    rest_length : array_like or ParameterPath, shape (n,)
        Lengths l0 of the links without force.
    bending_stiffness, bending_damping : array_like or ParameterPath, shape (n-1,), optional
        Joint stiffness kappa, torque per angle (rad), and joint damping delta.
    rest_angle : array_like or ParameterPath, shape (n-1,), optional
        Joint angles phi0 without torque, in rad.
    rod_mass : array_like, shape (n,), optional
        Masses of uniform rods along the links, which stretch uniformly and couple all masses.
    law : Elliptic, AnisotropicCoulomb, Axes, or sequence of these or None, optional
        Friction law under each mass; None for no ground.
    pull : array_like, shape (2,) or (n+1, 2), optional
        Constant force on each mass, for example the weight along a slope.
    heading : {"bisector", "front", "rear"}, optional
        Heading of an inner mass: between its links, or along the link in front or in the rear.
    obstacles : sequence of Wall or Disc, optional
        Obstacles that masses cannot enter. Simulate such a model after `smooth_walls`, or with
        Moreau-Jean time stepping.
    position, velocity : array_like, shape (n+1, 2), optional
        Initial places and velocities of the masses (shape (2,): one for all). By default all links
        and joints are at rest, the tail is at the origin, and its link is along x.
    length_nominal, time_nominal : float, optional
        Usual sizes of a link length and of a period, by which solvers scale.

    Returns
    -------
    Model
        States are ``position`` and ``velocity``, x and y of one mass after the other. Inputs are
        ``input`` (n forces u that push the masses of a link apart) and ``torque`` (n-1 torques w
        that turn the front of a joint to the left). Outputs are ``length``, ``angle`` and their
        rates ``rate`` and ``turning``, ``link_force`` and ``joint_torque`` mu, ``heading`` of the
        masses, ``ground_force`` in the plane, ``speed``, ``energy`` (kinetic and elastic),
        ``kinetic_energy``, ``center_of_mass``, ``center_velocity``, ``power`` of each actuator
        (links, then joints) and the powers ``input_power``, ``torque_power``, ``damping_power``,
        ``ground_power`` and ``pull_power`` that act on the worm.

    Raises
    ------
    ArgumentError
        If links is not a whole number above 0, a value or length of a sequence is wrong, or a law
        is no law of the plane.

    Examples
    --------
    >>> from wormopt.model.friction import Viscous
    >>> from wormopt.systems.planar.dynamics.chain import Axes
    >>> drag = Axes(Viscous(0.5), Viscous(5.0))
    >>> worm = planar_chain(2, mass=1.0, stiffness=10.0, damping=1.0, rest_length=1.0, law=drag)
    >>> worm.n_x, [s.name for s in worm.u], len(worm.contacts), worm.x[0].value
    (12, ['input', 'torque'], 6, (2.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    """
    if not isinstance(links, Integral) or links < 1:
        raise ArgumentError(f"links must be a whole number above 0, not {links!r}")
    t = ca.SX.sym("t")
    size = float(np.mean(numbers_of("mass", mass, links + 1)))
    units = _Units(length_nominal, time_nominal, size)
    springs = _Springs(
        {
            "stiffness": varied_parameter("stiffness", stiffness, links, "stiffness", t),
            "damping": varied_parameter("damping", damping, links, "drag", t),
            "rest_length": varied_parameter("rest_length", rest_length, links, "length", t),
            **{
                name: varied_parameter(name, given, links - 1, unit, t, "joints")
                for name, given, unit in (
                    ("bending_stiffness", bending_stiffness, "1"),
                    ("bending_damping", bending_damping, "1"),
                    ("rest_angle", rest_angle, "angle"),
                )
            },
        }
    )
    weights = [parameter("mass", mass, links + 1, "mass"), _pull(pull, links + 1)]
    if rod_mass is not None:
        weights.append(parameter("rod_mass", rod_mass, links, "mass"))
    if position is None:
        position = _relaxed(rest_length, rest_angle, links)
    chain = _Chain(links, heading, springs, weights)
    ground = touch(ground_laws(law, links + 1), chain.seen, units.force, units.speed)
    pressed = press(obstacles, *chain.in_plane, units.force, units.speed)
    states = [
        Signal("position", chain.r, "length", length_nominal,
               value=pairs("position", position, links + 1)),
        Signal("velocity", chain.v, "speed", units.speed,
               value=pairs("velocity", velocity, links + 1)),
    ]  # fmt: skip
    return chain.model(t, states, units, ground, pressed)


@dataclass(frozen=True)
class _Units:
    length: float
    time: float
    mass: float

    @property
    def speed(self) -> float:
        return self.length / self.time

    @property
    def force(self) -> float:
        return self.mass * self.speed / self.time


@dataclass(frozen=True, eq=False)
class _Springs:
    """Springs and dashpots of links and joints: expressions, parameters and schedules."""

    found: dict[str, tuple[ca.SX, Signal | Schedule]]

    def _both(self, link: str, joint: str) -> ca.SX:
        return ca.vertcat(self.found[link][0], self.found[joint][0])

    @property
    def stiffness(self) -> ca.SX:
        """Stiffness of links, then of joints."""
        return self._both("stiffness", "bending_stiffness")

    @property
    def damping(self) -> ca.SX:
        """Damping of links, then of joints."""
        return self._both("damping", "bending_damping")

    @property
    def rest(self) -> ca.SX:
        """Lengths and angles at rest."""
        return self._both("rest_length", "rest_angle")

    @property
    def parameters(self) -> list[Signal]:
        """Constant parameters."""
        return [s for _, s in self.found.values() if isinstance(s, Signal) and s.size]

    @property
    def schedules(self) -> list[Schedule]:
        """Parameters that vary in time."""
        return [s for _, s in self.found.values() if isinstance(s, Schedule)]


class _Chain:
    """Masses joined by springs, dashpots and actuators."""

    def __init__(
        self, links: int, heading: Heading, springs: _Springs, weights: list[Signal]
    ) -> None:
        self._links, self._springs, self._weights = links, springs, weights
        self.r, self.v = ca.SX.sym("r", 2 * links + 2), ca.SX.sym("v", 2 * links + 2)
        self.u, self.w = ca.SX.sym("u", links), ca.SX.sym("w", links - 1)
        self.geometry = Geometry(self.r, self.v, heading)
        self.inertia = RodMasses(weights[0].symbol, *(rods.symbol for rods in weights[2:]))
        self._stretch = ca.vertcat(self.geometry.lengths, self.geometry.angles) - springs.rest
        self._damped = springs.damping * self.geometry.rates
        driven = ca.vertcat(self.u, self.w)
        self.mu = springs.stiffness * self._stretch + self._damped - driven

    @property
    def in_plane(self) -> tuple[ca.SX, ca.SX]:
        """Places and velocities, (2, masses)."""
        return self.geometry.plane(self.r), self.geometry.plane(self.v)

    @property
    def seen(self) -> ca.SX:
        """Velocities along the headings and to their left, (2, masses)."""
        return self.geometry.along(self.v)

    def model(
        self,
        t: ca.SX,
        states: list[Signal],
        units: _Units,
        ground: Touching,
        against: tuple[list[Contact], ca.SX],
    ) -> Model:
        """Return the model under forces of ground and obstacles."""
        geometry, springs, (walls, pressed) = self.geometry, self._springs, against
        grounded = ca.vec(geometry.turned(ground.forces))
        outer = self._weights[1].symbol + grounded + ca.vec(pressed)
        acceleration = self.inertia.solve(outer - geometry.pulled(self.mu))
        inputs = [
            Signal("input", self.u, "force", units.force, value=(0.0,) * self._links),
            Signal("torque", self.w, "energy", units.force * units.length,
                   value=(0.0,) * (self._links - 1)),
        ]  # fmt: skip
        return Model(
            name=f"planar chain of {self._links} links",
            x=states,
            ode=ca.vertcat(self.v, acceleration),
            u=inputs[: 1 + (self._links > 1)],
            p=[*self._weights, *springs.parameters, *ground.parameters],
            t=t,
            outputs=[*self._shape(grounded), *self._energies(), *self._powers(grounded)],
            contacts=[*ground.contacts, *walls],
            schedules=springs.schedules,
        )

    def _shape(self, grounded: ca.SX) -> list[Output]:
        """Return outputs of shape, loads and headings."""
        geometry, n = self.geometry, self._links
        return [
            Output("length", geometry.lengths, "length"),
            Output("angle", geometry.angles, "angle"),
            Output("rate", geometry.rates[:n], "speed"),
            Output("turning", geometry.rates[n:], "angular_frequency"),
            Output("link_force", self.mu[:n], "force"),
            Output("joint_torque", self.mu[n:], "energy"),
            Output("heading", geometry.headings, "angle"),
            Output("ground_force", grounded, "force"),
            Output("speed", ca.sqrt(ca.sum1(geometry.plane(self.v) ** 2)).T, "speed"),
        ]

    def _energies(self) -> list[Output]:
        kinetic = self.inertia.kinetic(self.v)
        stored = ca.dot(self._springs.stiffness, self._stretch**2) / 2
        return [
            Output("kinetic_energy", kinetic, "energy"),
            Output("energy", kinetic + stored, "energy"),
            Output("center_of_mass", self.inertia.center(self.r), "length"),
            Output("center_velocity", self.inertia.center(self.v), "speed"),
        ]

    def _powers(self, grounded: ca.SX) -> list[Output]:
        rate, turning = ca.vertsplit(self.geometry.rates, [0, self._links, 2 * self._links - 1])
        powers = {
            "power": ca.vertcat(self.u * rate, self.w * turning),
            "input_power": ca.dot(self.u, rate),
            "torque_power": ca.dot(self.w, turning),
            "damping_power": -ca.dot(self._damped, self.geometry.rates),
            "ground_power": ca.dot(grounded, self.v),
            "pull_power": ca.dot(self._weights[1].symbol, self.v),
        }
        return [Output(name, power, "power") for name, power in powers.items()]


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
        """Return one column (2) for each mass."""
        return ca.reshape(stacked, 2, stacked.numel() // 2)

    @property
    def headings(self) -> ca.SX:
        """Headings of the masses, in [-pi, pi]."""
        return ca.atan2(self._looks[1, :], self._looks[0, :]).T

    def pulled(self, mu: ca.SX) -> ca.SX:
        """Return forces (dy/dr)^T mu, stacked."""
        return ca.jtimes(self._y, self._r, mu, True)

    def along(self, v: ca.SX) -> ca.SX:
        """Return components (2, masses) of vectors along the headings and to their left."""
        looks, vectors = self._looks, self.plane(v)
        left = ca.vertcat(-looks[1, :], looks[0, :])
        return ca.vertcat(ca.sum1(looks * vectors), ca.sum1(left * vectors))

    def turned(self, components: ca.SX) -> ca.SX:
        """Return vectors in the plane (2, masses) from components along the headings and left."""
        looks, left = self._looks, ca.vertcat(-self._looks[1, :], self._looks[0, :])
        ahead, aside = (ca.repmat(components[k, :], 2, 1) for k in range(2))
        return ahead * looks + aside * left


def _looks(along: ca.SX, heading: Heading) -> ca.SX:
    """Return unit headings (2, masses) of masses from those of the links, head first."""
    front, behind = along[:, :-1], along[:, 1:]
    middle = front + behind  # their sum bisects them, without an angle
    size = ca.sqrt(ca.sum1(middle**2))
    inner = {"front": front, "rear": behind, "bisector": middle / ca.repmat(size, 2, 1)}
    if heading not in inner:
        raise ArgumentError(f"heading must be one of front, rear, bisector, not {heading!r}")
    return ca.horzcat(along[:, 0], inner[heading], along[:, -1])


def _pull(given: ArrayLike, masses: int) -> Signal:
    size = 2 * masses
    return Signal("pull", ca.SX.sym("pull", size), "force", value=pairs("pull", given, masses))


def pairs(name: str, given: ArrayLike, masses: int) -> tuple[float, ...]:
    """Return pairs of numbers, one for all masses or one for each, stacked."""
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
    """Return places (n+1, 2) with all links and joints at rest, the tail at 0, its link along x."""
    lengths = first_numbers("rest_length", rest_length, links)
    angles = first_numbers("rest_angle", rest_angle, links - 1)
    return chain_places(lengths, angles)


def chain_places(lengths: ArrayLike, angles: ArrayLike) -> np.ndarray:
    """Return places (n+1, 2) from lengths (n,) and angles (n-1,): tail at 0, its link along x."""
    sizes, bends = np.asarray(lengths, dtype=float), np.asarray(angles, dtype=float)
    psi = np.append(np.cumsum(bends[::-1])[::-1], 0.0)
    steps = sizes[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
    return np.vstack([np.cumsum(steps[::-1], axis=0)[::-1], np.zeros(2)])
