"""Contact forces in exact treatment, by modes; a row for each component.

Contacts on a line with equal laws are treated together, in columns. A contact in the plane has
four more entries in s: the direction of onset, half the rate at which it turns, and the time when
it began. They are 0 except for a contact just released: at velocity 0 the direction of slip is
singular, and for long after it follows the forces so closely that explicit steps would be short.
So it moves along the given direction d first: it does not move across d, and its force lies on the
tangent, at sliding along d, to the set of sliding forces. The error is quadratic in the angle
between d and the slip; the onset ends when the error matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca

from wormopt.model.friction import Law
from wormopt.model.model import Contact
from wormopt.model.planar_friction import PlanarLaw

ENTRIES = 4
"""Entries in s of the onset of a contact in the plane."""


def never_rests(contact: Contact) -> bool:
    """Whether a contact is only a force that depends smoothly on velocity."""
    law = contact.law
    if contact.planar:
        return False
    low, high = law.stick_interval
    if isinstance(low, ca.SX) or isinstance(high, ca.SX) or low != 0 or high != 0:
        return False
    forces = [ca.SX(law.slip_force(contact.velocity, d)) for d in law.directions]
    return all(ca.is_equal(force, forces[0], 20) for force in forces)


def weighted(weight: ca.SX, a: ca.SX | float, b: ca.SX | float) -> ca.SX:
    """First or second, for weight 1 or 0."""
    return weight * a + (1 - weight) * b


class Grip(Protocol):
    """One contact, or several with equal laws, and their modes."""

    contacts: list[int]
    rows: list[int]
    rests: ca.SX  # row by row 1 or 0

    @property
    def slip(self) -> ca.SX:
        """Forces while they slide."""
        ...

    def alone(self, free: ca.SX, response: ca.SX) -> ca.SX:
        """Forces on contacts that act on no other.

        Arguments: accelerations without force, and acceleration by force of each component.
        """
        ...

    def equations(self, free: ca.SX, response: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rows of the equations for all forces, and their right-hand side.

        `response`: their rows of the Delassus matrix.
        """
        ...

    def gives(self, rest: float, onset: float) -> ca.SX:
        """Diagonal block of compliance, at rest and in onset across the direction."""
        ...

    @property
    def begun(self) -> ca.SX:
        """Force of sliding in onset, else 0."""
        ...

    def tells(self, acceleration: ca.SX, force: ca.SX, own: ca.SX) -> tuple[ca.SX, ...]:
        """Velocity, acceleration, force, least and largest force by which modes are decided.

        `own`: acceleration by force of each of their components.
        """
        ...


@dataclass(frozen=True, eq=False)
class LineGrip:
    """Contacts on lines with equal laws; columns, an entry for each."""

    contacts: list[int]
    rows: list[int]
    law: Law
    velocity: ca.SX
    mode: ca.SX
    prescribed: bool = False  # no force changes their velocity: they slide at all times
    geared: bool = False  # none does in some places

    @cached_property
    def rests(self) -> ca.SX:
        """1 or 0."""
        return ca.SX.zeros(len(self.rows)) if self.prescribed else 1 - self.mode**2

    @cached_property
    def slip(self) -> ca.SX:
        """Forces while they slide."""
        both = [ca.SX(self.law.slip_force(self.velocity, d)) for d in self.law.directions]
        if len(both) < 2:
            return both[0] if both else self.begun
        return weighted((1 + self.mode) / 2, both[0], both[1])

    def smooth(self, v_reg: ca.SX) -> ca.SX:
        """Forces by the smooth law."""
        return ca.SX(self.law.smooth(self.velocity, v_reg))

    def alone(self, free: ca.SX, response: ca.SX) -> ca.SX:
        """Forces on contacts that act on no other."""
        if self.prescribed:
            return self.slip
        choose = ca.if_else if self.geared else weighted  # avoids multiplying by infinity
        return choose(self.mode**2, self.slip, -free / response)

    def equations(self, free: ca.SX, response: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rows of the equations for all forces, and their right-hand side."""
        slides = ca.SX.ones(len(self.rows)) if self.prescribed else self.mode**2
        matrix = ca.repmat(1 - slides, 1, response.size2()) * response
        for k, row in enumerate(self.rows):
            matrix[k, row] += slides[k]
        return matrix, weighted(slides, self.slip, -free)

    def gives(self, rest: float, onset: float) -> ca.SX:
        """Diagonal block of compliance at rest."""
        return ca.diag(rest * self.rests)

    @property
    def begun(self) -> ca.SX:
        """Zero: they have no onset."""
        return ca.SX.zeros(len(self.rows))  # type: ignore[no-any-return]

    def tells(self, acceleration: ca.SX, force: ca.SX, own: ca.SX) -> tuple[ca.SX, ...]:
        """Velocity, acceleration, force, least and largest force by which modes are decided."""
        return self.velocity, acceleration, force, *map(ca.SX, self.law.stick_interval)


@dataclass(frozen=True, eq=False)
class PlaneGrip:
    """A contact in the plane: its mode is +1 or 0."""

    contacts: list[int]
    rows: list[int]
    contact: Contact
    law: PlanarLaw
    mode: ca.SX
    onset: ca.SX  # initial direction, half the rate at which it turns, initial time
    t: ca.SX

    @cached_property
    def rests(self) -> ca.SX:
        """1 or 0, twice."""
        return ca.repmat(1 - self.mode**2, 2, 1)

    def smooth(self, v_reg: ca.SX) -> ca.SX:
        """Force by the smooth law."""
        return self.law.smooth(self.contact.velocity, v_reg)

    @cached_property
    def _begins(self) -> ca.SX:
        """1 in onset, else 0, and 1 only while it slides."""
        return ca.logic_or(self.onset[0] != 0, self.onset[1] != 0)

    @cached_property
    def _half(self) -> ca.SX:
        """Tangent of half the angle by which the direction has turned."""
        return self.onset[2] * (self.t - self.onset[3])

    @cached_property
    def direction(self) -> ca.SX:
        """Direction of onset now, else 0."""
        first, q = self.onset[:2], self._half
        return ((1 - q**2) * first + 2 * q * ca.vertcat(-first[1], first[0])) / (1 + q**2)

    @cached_property
    def _curves(self) -> ca.SX:
        """Acceleration across the direction of onset that keeps the velocity along it."""
        turning = 2 * self.onset[2] / (1 + self._half**2)
        return turning * ca.dot(self._along, self.contact.velocity)

    @cached_property
    def _ahead(self) -> ca.SX:
        """Direction of motion; along the heading at rest, where it does not matter."""
        nowhere = ca.SX([1.0, 0.0])
        moving = ca.if_else(self.mode != 0, self.contact.velocity, nowhere)
        return ca.if_else(self._begins, self.direction, moving)

    @cached_property
    def _along(self) -> ca.SX:
        return ca.if_else(self._begins, self.direction, ca.SX([1.0, 0.0]))

    @property
    def _across(self) -> ca.SX:
        return ca.vertcat(-self._along[1], self._along[0])

    @cached_property
    def slip(self) -> ca.SX:
        """Force while it slides, or of sliding along the direction of onset."""
        return self.law.slip_force(self._ahead)

    @cached_property
    def _tangent(self) -> ca.SX:
        """How the force of sliding along d changes as d turns."""
        w = ca.SX.sym("w", 2)
        slope = ca.jtimes(self.law.slip_force(w), w, ca.vertcat(-w[1], w[0]))
        return ca.substitute(slope, w, self._along)

    def alone(self, free: ca.SX, response: ca.SX) -> ca.SX:
        """Force on a contact that acts on no other."""
        across, tangent = self._across, self._tangent
        stop = self._curves - ca.dot(across, free + response * self.slip)
        begun = self.slip + tangent * stop / ca.dot(across, response * tangent)
        moving = weighted(self._begins, begun, self.slip)
        return weighted(self.mode**2, moving, -free / response)

    def equations(self, free: ca.SX, response: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rows of the equations for all forces, and their right-hand side."""
        begins, slides = self._begins, self.mode**2 - self._begins
        across = self._across
        normal = ca.vertcat(self._tangent[1], -self._tangent[0])
        onset = ca.vertcat(ca.SX(1, response.size2()), across.T @ response)
        onset[0, self.rows] = normal.T
        matrix = self.rests[0] * response + begins * onset
        for i in range(2):
            matrix[i, self.rows[i]] += slides
        begun = ca.vertcat(ca.dot(normal, self.slip), self._curves - ca.dot(across, free))
        return matrix, slides * self.slip + begins * begun - self.rests * free

    def gives(self, rest: float, onset: float) -> ca.SX:
        """Diagonal block of compliance, at rest and in onset across the direction."""
        turning = ca.vertcat(ca.SX(1, 2), self._across.T)
        return rest * self.rests[0] * ca.SX.eye(2) + onset * self._begins * turning

    @property
    def begun(self) -> ca.SX:
        """Force of sliding in onset, else 0."""
        return self._begins * self.slip

    def tells(self, acceleration: ca.SX, force: ca.SX, own: ca.SX) -> tuple[ca.SX, ...]:
        """Velocity, acceleration, force, least and largest force by which modes are decided.

        Its speed, and its force relative to the holding force; in onset its velocity along d, and
        its error so far.
        """
        v, ahead = self.contact.velocity, self._ahead
        speed = ca.if_else(self._begins, ca.dot(self.direction, v), ca.norm_2(v))
        faster = ca.dot(ahead, acceleration) / ca.norm_2(ahead)
        size = ca.if_else(self._begins, self._lacks(force, own), self.law.gauge(force))
        return speed, faster, -size, ca.SX(-1.0), ca.SX.inf()

    def _lacks(self, force: ca.SX, own: ca.SX) -> ca.SX:
        """Error of onset so far: the angle error shifts it sideways, and its square slows it.

        In units of the nominal speed, and of the distance in which friction would stop that.
        """
        friction = ca.norm_2(self.slip)
        nominal = self.contact.nominal_speed
        spent = (self.t - self.onset[3]) * friction * ca.trace(own) / 2 / nominal
        angle = ca.fabs(self._off(force)) / friction
        return spent * angle * ca.fmax(ca.norm_2(self.contact.velocity) / nominal, angle)

    @property
    def bends(self) -> ca.SX:
        """Kink of its force: velocity along the heading, and speed.

        Both 0 where forward and backward resistance are the same.
        """
        v = self.contact.velocity
        ahead, back = (ca.SX(getattr(self.law, n, 0.0)) for n in ("forward", "backward"))
        return ca.SX(2, 1) if ca.is_equal(ahead, back) else ca.vertcat(v[0], ca.norm_2(v))

    def _off(self, force: ca.SX) -> ca.SX:
        return ca.dot(self._across, force - self.slip)

    def aims(self, force: ca.SX) -> ca.SX:
        """Direction in which slip begins from rest, and error of the force of onset.

        The error is 0 in the direction in which the contact accelerates.
        """
        return ca.vertcat(self.law.slip_direction(force), self._off(force))
