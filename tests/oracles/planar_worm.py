"""Masses in the plane, told twice: with forces by hand, and as a Model.

The Model has its forces from derivatives of lengths and angles; those by hand are from drawings.
They share the numbers and nothing else.
"""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.model.friction import Coulomb, Spike
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.planar_friction import Elliptic

Ground = Literal["elliptic", "box", "spike"]


@dataclass(frozen=True, eq=False)
class Drive:
    """Actuators: sum over h of cosine_h cos(h omega t) + sine_h sin(h omega t) for each."""

    cosine: np.ndarray  # (H, actuators)
    sine: np.ndarray  # (H, actuators)
    omega: float = 1.0

    @classmethod
    def none(cls, actuators: int) -> Drive:
        """No force at any time."""
        return cls(np.zeros((0, actuators)), np.zeros((0, actuators)))

    @cached_property
    def _harmonics(self) -> list[list[tuple[int, complex]]]:
        """Number and amplitude of the harmonics of each actuator."""
        amplitudes = (self.cosine - 1j * self.sine).T.tolist()
        return [list(enumerate(own, start=1)) for own in amplitudes]

    def at(self, t: float) -> list[float]:
        """Forces at a time."""
        angle = self.omega * t
        return [
            sum((c * cmath.rect(1.0, h * angle)).real for h, c in own) for own in self._harmonics
        ]

    def symbolic(self, t: ca.SX) -> ca.SX:
        """The same as an expression."""
        total = ca.SX.zeros(self.cosine.shape[1])
        for h in range(len(self.cosine)):
            angle = (h + 1) * self.omega * t
            total += ca.DM(self.cosine[h]) * ca.cos(angle) + ca.DM(self.sine[h]) * ca.sin(angle)
        return total


@dataclass(frozen=True, eq=False)
class PlanarWorm:
    """Point masses in the plane, springs between some of them, joints between neighbours.

    Links are mass 0 to 1, 1 to 2 and so on, head first. Angles at the joints are positive where
    the link in front is turned to the left.
    """

    mass: np.ndarray  # (m,)
    place: np.ndarray  # (m, 2) at the start
    velocity: np.ndarray  # (m, 2) at the start
    forward: np.ndarray  # (m,) resistance F+
    backward: np.ndarray  # (m,) F-
    sideways: np.ndarray  # (m,) Fn
    pairs: Sequence[tuple[int, int]] = ()  # what a spring joins
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (pairs,)
    damping: np.ndarray = field(default_factory=lambda: np.zeros(0))
    length: np.ndarray = field(default_factory=lambda: np.zeros(0))  # at rest
    drive: Drive = field(default_factory=lambda: Drive.none(0))  # pushes the pairs apart
    bending: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (joints,) stiffness
    bending_damping: np.ndarray = field(default_factory=lambda: np.zeros(0))
    angle: np.ndarray = field(default_factory=lambda: np.zeros(0))  # at rest
    torque: Drive = field(default_factory=lambda: Drive.none(0))  # opens the joints
    load: np.ndarray | None = None  # (m, 2) constant forces
    drag: tuple[float, float] = (0.0, 0.0)  # viscous, along the heading and across
    heading: float = 0.0  # of all masses where there are no joined neighbours
    looks: bool = True  # whether masses look along their links, or along `heading`
    ground: Ground = "elliptic"

    @property
    def n(self) -> int:
        """Number of masses."""
        return len(self.mass)

    @property
    def start(self) -> np.ndarray:
        """Places, then velocities, (4 m,)."""
        return np.concatenate([self.place.ravel(), self.velocity.ravel()])

    # -- by hand: vectors of the plane as complex numbers, which for few masses beat arrays --------

    @cached_property
    def _loads(self) -> list[complex]:
        return [0j] * self.n if self.load is None else plane(self.load).tolist()

    @cached_property
    def _springs(self) -> list[list[float]]:
        """Stiffness, damping and length of each."""
        return np.stack([self.stiffness, self.damping, self.length], axis=1).tolist()

    @cached_property
    def _joints(self) -> list[list[float]]:
        """Stiffness, damping and angle of each."""
        return np.stack([self.bending, self.bending_damping, self.angle], axis=1).tolist()

    def look(self, r: Sequence[complex], v: Sequence[complex]) -> tuple[list[complex], list[float]]:
        """Headings of the masses as unit vectors, and how fast they turn."""
        if not self.looks:
            return [cmath.rect(1.0, self.heading)] * self.n, [0.0] * self.n
        links = [front - rear for front, rear in pairwise(r)]
        e = [link / abs(link) for link in links]
        omega = _turning(links, v)
        inner = [b * cmath.sqrt(a * b.conjugate()) for a, b in pairwise(e)]
        between = [0.5 * (a + b) for a, b in pairwise(omega)]
        return [e[0], *inner, e[-1]], [omega[0], *between, omega[-1]]

    def pull(self, t: float, r: Sequence[complex], v: Sequence[complex]) -> list[complex]:
        """All forces on masses at places `r` with velocities `v` but dry friction."""
        force = self._loads.copy()
        pushes = self.drive.at(t) if self.pairs else []
        for (i, j), (stiff, damp, rest), push in zip(
            self.pairs, self._springs, pushes, strict=True
        ):
            length = abs(r[i] - r[j])
            e = (r[i] - r[j]) / length
            rate = ((v[i] - v[j]) * e.conjugate()).real
            tension = (stiff * (length - rest) + damp * rate - push) * e
            force[i] -= tension
            force[j] += tension
        if self._joints:
            self._bend(t, r, v, force)
        if any(self.drag):
            for i, h in enumerate(self.look(r, v)[0]):
                own = v[i] * h.conjugate()
                force[i] -= h * complex(self.drag[0] * own.real, self.drag[1] * own.imag)
        return force

    def _bend(
        self, t: float, r: Sequence[complex], v: Sequence[complex], force: list[complex]
    ) -> None:
        """Add the forces of joints."""
        links = [front - rear for front, rear in pairwise(r)]
        omega = _turning(links, v)
        turn = [0.0] * len(links)  # moment that turns each link to the left
        for j, ((stiff, damp, rest), push) in enumerate(
            zip(self._joints, self.torque.at(t), strict=True)
        ):
            bent = cmath.phase(links[j] * links[j + 1].conjugate())
            moment = stiff * (bent - rest) + damp * (omega[j] - omega[j + 1]) - push
            turn[j] -= moment
            turn[j + 1] += moment
        for j, link in enumerate(links):
            across = turn[j] * 1j / link.conjugate()
            force[j] += across
            force[j + 1] -= across

    # -- CasADi ----------------------------------------------------------------------------------

    def model(self) -> Model:
        """Build the Model: states are the places x0, y0, x1, ... and the velocities."""
        t, m = ca.SX.sym("t"), self.n
        r, v = ca.SX.sym("r", 2, m), ca.SX.sym("v", 2, m)
        place, speed = ca.vec(r), ca.vec(v)
        force = ca.SX.zeros(2, m) if self.load is None else ca.SX(ca.DM(self.load.T))
        total = ca.vec(force) - self._generalised(t, r, place, speed)
        theta = self._headings(r)
        contacts, friction = [], []
        for i in range(m):
            e = ca.vertcat(ca.cos(theta[i]), ca.sin(theta[i]))
            n = ca.vertcat(-e[1], e[0])
            local = ca.vertcat(ca.dot(e, v[:, i]), ca.dot(n, v[:, i]))
            found, own = self._contacts(i, local)
            contacts += found
            own -= ca.DM(self.drag) * local
            friction.append(own[0] * e + own[1] * n)
        total += ca.vertcat(*friction)
        return Model(
            "planar masses",
            x=[
                Signal("position", place, "length", value=self.place.ravel().tolist()),
                Signal("velocity", speed, "speed", value=self.velocity.ravel().tolist()),
            ],
            ode=ca.vertcat(speed, total / ca.DM(np.repeat(self.mass, 2))),
            t=t,
            contacts=contacts,
        )

    def _contacts(self, i: int, local: ca.SX) -> tuple[list[Contact], ca.SX]:
        """Contacts of a mass, and their force along the heading and across."""
        if self.ground == "elliptic":
            force = ca.SX.sym(f"f{i}", 2)
            law = Elliptic(self.forward[i], self.backward[i], self.sideways[i])
            return [Contact(f"mass {i}", local, force, law)], force + 0
        along, across = ca.SX.sym(f"f{i}"), ca.SX.sym(f"g{i}")
        ahead = Spike() if self.ground == "spike" else Coulomb(self.forward[i], self.backward[i])
        beside = Coulomb(self.sideways[i], self.sideways[i])
        found = [
            Contact(f"mass {i} along", local[0], along, ahead),
            Contact(f"mass {i} across", local[1], across, beside),
        ]
        return found, ca.vertcat(along, across)

    def _headings(self, r: ca.SX) -> list[ca.SX]:
        if not self.looks:
            return [ca.SX(self.heading)] * self.n
        d = [r[:, j] - r[:, j + 1] for j in range(self.n - 1)]
        psi = [ca.atan2(one[1], one[0]) for one in d]
        inner = [psi[j] + 0.5 * _turn(d[j - 1], d[j]) for j in range(1, len(d))]
        return [psi[0], *inner, psi[-1]]

    def _generalised(self, t: ca.SX, r: ca.SX, place: ca.SX, speed: ca.SX) -> ca.SX:
        """Forces of springs and joints that act against the places."""
        total, m = ca.SX.zeros(2 * self.n), self.n
        if self.pairs:
            y = ca.vertcat(*(ca.norm_2(r[:, i] - r[:, j]) for i, j in self.pairs))
            pull = _viscoelastic(y, place, speed, self.stiffness, self.length, self.damping)
            pull -= self.drive.symbolic(t)
            total += ca.jtimes(y, place, pull, True)
        if len(self.bending):
            d = [r[:, j] - r[:, j + 1] for j in range(m - 1)]
            phi = ca.vertcat(*(_turn(front, rear) for front, rear in pairwise(d)))
            pull = _viscoelastic(phi, place, speed, self.bending, self.angle, self.bending_damping)
            total += ca.jtimes(phi, place, pull - self.torque.symbolic(t), True)
        return total


def _turning(links: Sequence[complex], v: Sequence[complex]) -> list[float]:
    """Rates at which links turn to the left."""
    return [((v[j] - v[j + 1]) / link).imag for j, link in enumerate(links)]


def _turn(front: ca.SX, rear: ca.SX) -> ca.SX:
    """Angle by which a link is turned to the left of the one behind it."""
    return ca.atan2(rear[0] * front[1] - rear[1] * front[0], ca.dot(front, rear))


def _viscoelastic(
    y: ca.SX, place: ca.SX, speed: ca.SX, stiff: np.ndarray, rest: np.ndarray, damping: np.ndarray
) -> ca.SX:
    rate = ca.jtimes(y, place, speed)
    return ca.DM(stiff) * (y - ca.DM(rest)) + ca.DM(damping) * rate


def block(
    velocity: Sequence[float] | np.ndarray,
    resistance: Sequence[float],
    *,
    load: Sequence[float] | np.ndarray = (0.0, 0.0),
    heading: float = 0.0,
    mass: float = 1.0,
    ground: Ground = "elliptic",
) -> PlanarWorm:
    """One mass that looks along `heading`; `resistance`: forward, backward, sideways."""
    ahead, back, beside = (np.array([value]) for value in resistance)
    return PlanarWorm(
        np.array([mass]),
        np.zeros((1, 2)),
        np.array([velocity], dtype=float),
        ahead,
        back,
        beside,
        load=np.array([load], dtype=float),
        heading=heading,
        looks=False,
        ground=ground,
    )


def flat(vectors: Sequence[complex]) -> np.ndarray:
    """Vectors of the plane as numbers, x and y of one after the other."""
    return np.array(vectors, dtype=complex).view(float)


def plane(pairs: np.ndarray) -> np.ndarray:
    """Vectors of the plane, x and y of one after the other, as complex numbers (m,)."""
    return np.ascontiguousarray(pairs, dtype=float).ravel().view(complex)
