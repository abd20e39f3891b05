"""Bodies in the plane with prescribed shape over time, and how they stop on dry ground.

Three degrees of freedom remain. A stop is found in a transformed time, in which it never comes.
With dt = psi dT, where psi is the power of the ground by the velocity v, the force is at most
linear in v: m dv/dT = f psi - (Ft² v_t, Fn² v_n). For the law of unit directions |v| replaces psi,
and F replaces F². The direction of v then has an equation of its own and tends to a fixed one,
along which the speed falls as exp(-cT): the remaining time and displacement have a closed form. The
stop at a finite time t is at T = infinity. No event is located.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from wormopt.control.loop import Reference, gait_reference
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.model.values import numbers_of
from wormopt.systems.planar.dynamics.chain import Ground, ground_laws, pairs, touch
from wormopt.systems.planar.shape import Shape
from wormopt.systems.shared.parameters import parameter

Course = Gait | Callable[[ca.SX], ca.SX]
"""Shape variables over time: a periodic gait, or a function of the symbol of time."""


def driven_shape(
    shape: Shape,
    course: Course | None = None,
    *,
    mass: ArrayLike,
    inertia: float = 0.0,
    law: Ground | Sequence[Ground | None] | None = None,
    pull: ArrayLike = (0.0, 0.0),
    center: ArrayLike = (0.0, 0.0),
    angle: float = 0.0,
    velocity: ArrayLike = (0.0, 0.0),
    turning: float = 0.0,
    length_nominal: float = 1.0,
    time_nominal: float = 1.0,
) -> Model:
    """Build a body with prescribed shape whose points touch the ground.

    With c the centre of mass, V its velocity, and omega the angular velocity of the frame of the
    body, m V' = sum (F_i + g_i) and (I omega + h)' = sum (r_i - c) x (F_i + g_i), where h is the
    angular momentum of the change of shape in the body's frame. Actuators enforce the shape: their
    loads follow from the head down, and are 0 behind the tail.

    Theory: docs/theory-planar.md, section 2.

    Parameters
    ----------
    shape : Shape
        Points of the body; those of a chain are its masses, head first.
    course : Gait or callable, optional
        Shape variables over time: a periodic Gait with one row for each, or a function from the
        symbol of time to a column of them. It must be smooth except at breaks of a Gait, where
        accelerations may jump. Not for shapes without variables.
    mass : array_like, shape (points,)
        Masses of the points, positive. For all array_like parameters a single value holds for all.
    inertia : float, optional
        Moment of inertia of the head about itself, not negative: it turns with the body's frame.
    law : Elliptic, AnisotropicCoulomb, Axes, or sequence of these or None, optional
        Friction law under each point; None for no ground.
    pull : array_like, shape (2,) or (points, 2), optional
        Constant force on each point.
    center, velocity : array_like, shape (2,), optional
        Initial place and velocity of the centre of mass.
    angle, turning : float, optional
        Initial angle of the body's frame from x, in rad, and its angular velocity.
    length_nominal, time_nominal : float, optional
        Usual sizes of the body and of a period, by which solvers scale.

    Returns
    -------
    Model
        States are ``center``, ``angle``, ``center_velocity``, ``turning``. Outputs are ``position``
        and ``velocity`` of the points (x and y of one after the other), ``heading``, ``shape``,
        ``shape_rate``, ``ground_force`` in the plane, ``kinetic_energy`` and the powers
        ``ground_power``, ``pull_power`` and ``actuator_power``. A chain also has ``input`` (forces
        that push the masses of a link apart), ``torque`` (torques that turn the front of a joint to
        the left), and ``left_over``: force (2) and moment behind the tail, which are 0.

    Raises
    ------
    ArgumentError
        If sizes or values do not fit, a shape with variables has no course, or a body with all
        points in one place has no moment of inertia.

    Examples
    --------
    >>> from wormopt.systems.planar.shape import rigid_shape
    >>> rod = driven_shape(rigid_shape([(1.0, 0.0), (-1.0, 0.0)]), mass=1.0, turning=1.0)
    >>> [signal.name for signal in rod.x]
    ['center', 'angle', 'center_velocity', 'turning']
    """
    points, t = shape.n_points, ca.SX.sym("t")
    speed = length_nominal / time_nominal
    force_size = float(np.mean(numbers_of("mass", mass, points))) * speed / time_nominal
    given = [
        parameter("mass", mass, points, "mass"),
        Signal("pull", ca.SX.sym("pull", 2 * points), "force", value=pairs("pull", pull, points)),
        parameter("inertia", inertia, 1, "1"),
    ]
    reference = _reference(shape, course, t)
    body = _Body(shape, reference, *(signal.symbol for signal in given))
    body.check(given)

    ground = touch(ground_laws(law, points), body.seen, force_size, speed)
    motion = body.pushed(ground.forces)
    states = body.states(length_nominal, speed)
    values = pairs("center", center, 1), angle, pairs("velocity", velocity, 1), turning
    return Model(
        name=f"driven body of {points} points",
        x=[replace(s, value=value) for s, value in zip(states, values, strict=True)],
        ode=body.put(motion.ode),
        p=[*given, *ground.parameters],
        t=t,
        outputs=[replace(o, expression=body.put(o.expression)) for o in motion.outputs()],
        contacts=[replace(x, velocity=body.put(x.velocity)) for x in ground.contacts],
        schedules=reference.schedules,
    )  # fmt: skip


class _Body:
    """Kinematics of the points, by the shape's own symbols, which `put` replaces at the end."""

    def __init__(self, shape: Shape, course: Reference, m: ca.SX, pull: ca.SX, own: ca.SX) -> None:
        self.shape, self.mass, self.pull, self.own = shape, m, pull, own
        self._course = course
        self.center, self.velocity = ca.SX.sym("c", 2), ca.SX.sym("V", 2)
        self.angle, self.turning = ca.SX.sym("angle"), ca.SX.sym("omega")
        self._acceleration = ca.SX.sym("s_ddot", shape.s.numel())
        self.x = ca.vertcat(self.center, self.angle, self.velocity, self.turning)
        self.inner = shape.points - ca.repmat(shape.points @ m / ca.sum1(m), 1, shape.n_points)

    def states(self, length: float, speed: float) -> list[Signal]:
        """Return the states, with usual sizes."""
        return [
            Signal("center", self.center, "length", length),
            Signal("angle", self.angle, "angle"),
            Signal("center_velocity", self.velocity, "speed", speed),
            Signal("turning", self.turning, "angular_frequency", speed / length),
        ]

    def by_shape(self, expression: ca.SX) -> ca.SX:
        """Return the part of the time derivative due to the change of shape."""
        shape = self.shape
        by_place = ca.jtimes(expression, shape.s, shape.rates)
        return by_place + ca.jtimes(expression, shape.rates, self._acceleration)

    def put(self, expression: ca.SX) -> ca.SX:
        """Return the expression with the shape as a function of time."""
        old = ca.vertcat(self.shape.s, self.shape.rates, self._acceleration)
        new = ca.vertcat(self._course.value, self._course.rate, self._course.acceleration)
        return ca.substitute(expression, old, ca.densify(new)) if old.numel() else expression

    def check(self, given: Sequence[Signal]) -> None:
        """Refuse a rigid body with all points in one place and no moment of inertia."""
        if self.shape.s.numel():
            return
        symbols = [signal.symbol for signal in given]
        inertia = ca.Function("inertia", symbols, [self.inertia])
        if not float(inertia(*(np.asarray(signal.value, float) for signal in given))) > 0:
            raise ArgumentError("all points of the body are in one place; give an inertia")

    @cached_property
    def looks(self) -> ca.SX:
        """Headings of the points."""
        return self.angle + self.shape.headings

    @cached_property
    def arms(self) -> ca.SX:
        """From the centre of mass to the points, (2, points)."""
        return _rotated(self.angle, self.inner)

    @cached_property
    def velocities(self) -> ca.SX:
        """Velocities of the points, (2, points)."""
        turned = self.turning * ca.vertcat(-self.arms[1, :], self.arms[0, :])
        moved = ca.reshape(self.by_shape(ca.vec(self.arms)), 2, self.shape.n_points)
        return ca.repmat(self.velocity, 1, self.shape.n_points) + turned + moved

    @cached_property
    def seen(self) -> ca.SX:
        """Velocities along the headings and to their left, (2, points)."""
        return _rotated(-self.looks.T, self.velocities)

    @cached_property
    def inertia(self) -> ca.SX:
        """Moment of inertia about the centre of mass."""
        return ca.dot(self.mass, ca.sum1(self.inner**2).T) + self.own

    @cached_property
    def spin(self) -> ca.SX:
        """Angular momentum of the change of shape in the body's frame."""
        moved = ca.reshape(self.by_shape(ca.vec(self.inner)), 2, self.shape.n_points)
        return ca.dot(self.mass, _cross(self.inner, moved).T)

    def pushed(self, ground: ca.SX) -> _Pushed:
        """Return the motion under ground forces (2, points) along and across headings."""
        return _Pushed(self, _rotated(self.looks.T, ground))


@dataclass(frozen=True, eq=False)
class _Pushed:
    """Motion of a body under forces of the ground, (2, points) in the plane."""

    body: _Body
    ground: ca.SX

    @cached_property
    def outer(self) -> ca.SX:
        """All outer forces (2, points)."""
        return self.ground + ca.reshape(self.body.pull, 2, self.body.shape.n_points)

    @cached_property
    def spun(self) -> ca.SX:
        """Angular acceleration."""
        body = self.body
        moment = ca.sum2(_cross(body.arms, self.outer))
        changed = body.by_shape(body.inertia) * body.turning + body.by_shape(body.spin)
        return (moment - changed) / body.inertia

    @cached_property
    def ode(self) -> ca.SX:
        """Rates of the states."""
        body = self.body
        pushed = ca.sum2(self.outer) / ca.sum1(body.mass)
        return ca.vertcat(body.velocity, body.turning, pushed, self.spun)

    def outputs(self) -> list[Output]:
        """Return the outputs."""
        body, stacked = self.body, ca.vec(self.body.velocities)
        places = ca.repmat(body.center, 1, body.shape.n_points) + body.arms
        kinetic = ca.dot(body.mass, ca.sum1(body.velocities**2).T)
        kinetic = (kinetic + body.own * body.turning**2) / 2
        found = [
            Output("position", ca.vec(places), "length"),
            Output("velocity", stacked, "speed"),
            Output("heading", body.looks, "angle"),
            Output("shape", body.shape.s),
            Output("shape_rate", body.shape.rates),
            Output("ground_force", ca.vec(self.ground), "force"),
            Output("kinetic_energy", kinetic, "energy"),
            Output("ground_power", ca.dot(ca.vec(self.ground), stacked), "power"),
            Output("pull_power", ca.dot(body.pull, stacked), "power"),
        ]
        return found + (self._loads(places) if _is_chain(body.shape) else [])

    def _loads(self, places: ca.SX) -> list[Output]:
        """Return actuator loads of a chain: those that the part in front of a cut needs."""
        body, n = self.body, self.body.shape.n_points - 1
        a = ca.jtimes(ca.vec(body.velocities), body.x, self.ode)
        a = ca.reshape(a + body.by_shape(ca.vec(body.velocities)), 2, n + 1)
        needed = ca.repmat(body.mass.T, 2, 1) * a - self.outer
        links = places[:, :-1] - places[:, 1:]
        force, moment = ca.SX.zeros(2), body.own * self.spun
        inputs, torques = [], []
        for j in range(n + 1):
            if 0 < j < n:
                torques.append(moment)  # about mass j, of all in front of it
            force = force + needed[:, j]
            if j < n:
                inputs.append(ca.dot(links[:, j], force) / ca.norm_2(links[:, j]))
                moment = moment + _cross(links[:, j], force)
        u, w = ca.vertcat(*inputs), ca.vertcat(ca.SX(0, 1), *torques)
        lengths = ca.sqrt(ca.sum1(links**2)).T
        power = ca.dot(u, body.by_shape(lengths))
        if torques:
            power += ca.dot(w, body.shape.rates[-len(torques) :])
        return [
            Output("input", u, "force"),
            Output("torque", w, "energy"),
            Output("left_over", ca.vertcat(force, moment)),
            Output("actuator_power", power, "power"),
        ]


def _is_chain(shape: Shape) -> bool:
    """Whether the points are the masses of a chain, as `chain_shape` makes them."""
    n = shape.n_points - 1
    names = tuple(f"length {j + 1}" for j in range(n))
    names += tuple(f"angle {j + 1}" for j in range(n - 1))
    return bool(shape.names) and shape.names in (names, names[n:])


def _reference(shape: Shape, course: Course | None, t: ca.SX) -> Reference:
    """Return the shape variables over time, with two derivatives."""
    size = shape.s.numel()
    if course is None:
        if size:
            raise ArgumentError(f"a shape of {size} variables needs a course; give one")
        nothing = ca.SX(0, 1)
        return Reference(nothing, nothing, nothing)
    if isinstance(course, Gait):
        found = gait_reference(course, t, name="shape")
    else:
        value = ca.SX(course(t))
        rate = ca.jacobian(value, t)
        found = Reference(value, rate, ca.jacobian(rate, t))
    if found.value.shape != (size, 1):
        raise ArgumentError(f"the course has {found.value.numel()} rows, but the shape {size}")
    return found


def _rotated(angles: ca.SX, vectors: ca.SX) -> ca.SX:
    """Return columns (2, m) rotated to the left, by one angle or by one each (1, m)."""
    c, s = ca.cos(angles), ca.sin(angles)
    x, y = vectors[0, :], vectors[1, :]
    return ca.vertcat(c * x - s * y, s * x + c * y)


def _cross(a: ca.SX, b: ca.SX) -> ca.SX:
    return a[0, :] * b[1, :] - a[1, :] * b[0, :]


_SMALL = 1e-14  # share of the speed that counts as none
_LONGEST = 1e12  # T in units of mass over the largest resistance, squared or not
_NEWTON = 3  # Newton steps to the fixed direction


@dataclass(frozen=True)
class Stop:
    """Place and time of a stop."""

    time: float
    place: tuple[float, float]  # from the start, along its heading and to its left


def stop_of(
    law: Elliptic | AnisotropicCoulomb,
    mass: float,
    velocity: tuple[float, float],
    pull: tuple[float, float],
) -> Stop:
    """Return the stop of a block that starts with a velocity other than 0 under a constant pull.

    `velocity` and `pull` are components along its heading, which is constant, and to its left.
    """
    f, speed = pull, math.hypot(*velocity)
    square = 2 if isinstance(law, Elliptic) else 1
    ahead, back, aside = float(law.forward), float(law.backward), float(law.sideways)
    largest = max(ahead, back, aside)

    def rates(angle: float) -> tuple[float, float, float, float, float]:
        """Psi over the speed; growth of the speed, turning, and their slopes over the angle."""
        c, s, first = math.cos(angle), math.sin(angle), ahead
        if c < 0:
            first = back
        p, q = first**square / mass, aside**square / mass
        psi, steeper = 1.0, 0.0
        if square == 2:
            psi = math.hypot(first * c, aside * s)
            steeper = (aside**2 - first**2) * s * c / psi
        along, across = (f[0] * c + f[1] * s) / mass, (f[1] * c - f[0] * s) / mass
        return (
            psi,
            psi * along - p * c * c - q * s * s,
            psi * across - (q - p) * s * c,
            steeper * along + psi * across - 2 * (q - p) * s * c,
            steeper * across - psi * along - (q - p) * (c * c - s * s),
        )

    def rate(_: float, state: np.ndarray) -> tuple[float, ...]:
        angle, logarithm = float(state[0]), float(state[1])
        psi, growth, turning, _, _ = rates(angle)
        v = speed * math.exp(logarithm)
        return turning, growth, v**2 * psi * math.cos(angle), v**2 * psi * math.sin(angle), v * psi

    def left(_: float, state: np.ndarray) -> float:
        return state[1] - math.log(_SMALL)

    def turned(_: float, state: np.ndarray) -> float:
        """Remaining change of the speed's logarithm by the turn, minus a negligible share."""
        _, _, turning, slope, steep = rates(float(state[0]))
        if turning == 0:
            return -_SMALL
        if steep >= 0:
            return 1.0
        off = turning / steep
        return -(abs(slope * off) + 4 * largest**square / mass * off**2) / steep - _SMALL

    left.terminal = turned.terminal = True  # type: ignore[attr-defined]
    state = np.array([math.atan2(velocity[1], velocity[0]), 0.0, 0.0, 0.0, 0.0])
    longest = mass / largest**square
    if turned(0.0, state) > 0:
        scale = np.array([1.0, 1.0, *(2 * [speed**2 * mass / largest]), speed * mass / largest])
        found = solve_ivp(
            rate, (0.0, _LONGEST * longest), state, "DOP853", rtol=1e-13, atol=1e-18 * scale,
            events=[left, turned], first_step=1e-3 * longest,
        )  # fmt: skip
        state = found.y[:, -1]
    angle, logarithm, x, y, t = state.tolist()
    for _ in range(_NEWTON):
        _, _, turning, _, steep = rates(angle)
        angle -= turning / steep if steep < 0 else 0.0
    psi, growth, *_ = rates(angle)
    if growth >= 0:
        raise SolveError(
            "the block does not come to rest", "write a smaller pull, or more friction"
        )
    v = speed * math.exp(logarithm)
    rest = -psi * v**2 / growth / 2
    return Stop(t - psi * v / growth, (x + rest * math.cos(angle), y + rest * math.sin(angle)))
