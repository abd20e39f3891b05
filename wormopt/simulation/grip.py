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

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property
from numbers import Real
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.friction import Expression, Law, symbols_of
from wormopt.model.given import fields_of
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
        """Forces on contacts that act on no other; `response`: acceleration by force of each."""
        if self.prescribed:
            return self.slip
        choose = ca.if_else if self.geared else weighted  # avoids multiplying by infinity
        return choose(self.mode**2, self.slip, -free / response)

    def equations(self, free: ca.SX, response: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rows of the equations for all forces, and right-hand side; `response`: Delassus rows."""
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

    def deciding(self, acceleration: ca.SX, force: ca.SX, own: ca.SX) -> tuple[ca.SX, ...]:
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

    def deciding(self, acceleration: ca.SX, force: ca.SX, own: ca.SX) -> tuple[ca.SX, ...]:
        """Velocity, acceleration, force, least and largest force by which modes are decided."""
        # Its speed, and its force relative to the holding force; in onset its velocity along d, and
        # its error so far.
        v, ahead = self.contact.velocity, self._ahead
        speed = ca.if_else(self._begins, ca.dot(self.direction, v), ca.norm_2(v))
        faster = ca.dot(ahead, acceleration) / ca.norm_2(ahead)
        size = ca.if_else(self._begins, self._lacks(force, own), self.law.gauge(force))
        return speed, faster, -size, ca.SX(-1.0), ca.SX.inf()

    def _lacks(self, force: ca.SX, own: ca.SX) -> ca.SX:
        """Error of onset so far: the angle error shifts it sideways, and its square slows it."""
        friction = ca.norm_2(self.slip)
        nominal = self.contact.nominal_speed
        spent = (self.t - self.onset[3]) * friction * ca.trace(own) / 2 / nominal
        angle = ca.fabs(self._off(force)) / friction
        return spent * angle * ca.fmax(ca.norm_2(self.contact.velocity) / nominal, angle)

    @property
    def bends(self) -> ca.SX:
        """Kink of its force: velocity along the heading, and speed."""
        # Both 0 where forward and backward resistance are the same.
        v = self.contact.velocity
        ahead, back = (ca.SX(getattr(self.law, n, 0.0)) for n in ("forward", "backward"))
        return ca.SX(2, 1) if ca.is_equal(ahead, back) else ca.vertcat(v[0], ca.norm_2(v))

    def _off(self, force: ca.SX) -> ca.SX:
        return ca.dot(self._across, force - self.slip)

    def aims(self, force: ca.SX) -> ca.SX:
        """Direction in which slip begins from rest, and error of the force of onset."""
        # The error is 0 in the direction in which the contact accelerates.
        return ca.vertcat(self.law.slip_direction(force), self._off(force))


@dataclass(frozen=True, eq=False)
class Grips:
    """Grips of a system's contacts."""

    each: list[LineGrip | PlaneGrip]

    @classmethod
    def of(
        cls,
        contacts: Sequence[Contact],
        t: ca.SX,
        s: ca.SX,
        prescribed: Sequence[int] = (),
        geared: Sequence[int] = (),
    ) -> Grips:
        """Grips of contacts: their modes come first in s, then their onsets.

        `prescribed`: those whose velocity no force changes; `geared`: those with none somewhere.
        """
        alike = defaultdict[Hashable, list[int]](list)
        for i, contact in enumerate(contacts):
            kind = i if contact.planar else (i in prescribed, i in geared, _kind(contact.law))
            alike[kind].append(i)
        first = np.cumsum([0, *(contact.force.numel() for contact in contacts)]).tolist()
        found: list[LineGrip | PlaneGrip] = []
        place = len(contacts)
        for group in alike.values():
            contact, row = contacts[group[0]], first[group[0]]
            if contact.planar:
                onset = s[place : place + ENTRIES]
                law, mode = contact.law, s[group]
                found.append(PlaneGrip(group, [row, row + 1], contact, law, mode, onset, t))
                place += ENTRIES
            else:
                velocity = ca.vertcat(*(contacts[i].velocity for i in group))
                law = _Several.of([contacts[i].law for i in group])
                rows, kind = [first[i] for i in group], (group[0] in prescribed, group[0] in geared)
                found.append(LineGrip(group, rows, law, velocity, s[group], *kind))
        return cls(found)

    def _by_rows(self, parts: Iterable[ca.SX]) -> ca.SX:
        return _sorted(parts, [row for grip in self.each for row in grip.rows])

    def _by_contacts(self, parts: Iterable[ca.SX]) -> ca.SX:
        return _sorted(parts, [contact for grip in self.each for contact in grip.contacts])

    @property
    def _planar(self) -> list[PlaneGrip]:
        return [grip for grip in self.each if isinstance(grip, PlaneGrip)]

    @property
    def bilateral(self) -> bool:
        """Whether a contact on a line holds without ever sliding."""
        return any(isinstance(grip, LineGrip) and not grip.law.directions for grip in self.each)

    @property
    def rests(self) -> ca.SX:
        """1 or 0."""
        return self._by_rows(grip.rests for grip in self.each)

    @property
    def begun(self) -> ca.SX:
        """Forces of sliding in onset, else 0."""
        return self._by_rows(grip.begun for grip in self.each)

    def smooth(self, v_reg: ca.SX) -> ca.SX:
        """Forces by the smooth law."""
        return self._by_rows(grip.smooth(v_reg) for grip in self.each)

    def slip(self, forces: ca.SX) -> ca.SX:
        """Forces of sliding contacts on a line; `forces` of the others."""
        return self._by_rows(
            grip.slip if isinstance(grip, LineGrip) else forces[grip.rows] for grip in self.each
        )

    def alone(self, free: ca.SX, delassus: ca.SX) -> ca.SX:
        """Forces of contacts that do not act on each other."""
        response = ca.diag(delassus)
        return self._by_rows(g.alone(free[g.rows], response[g.rows]) for g in self.each)

    def equations(self, free: ca.SX, delassus: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Matrix and right-hand side of the equations for forces that act on one another."""
        full = ca.densify(delassus)
        pairs = [g.equations(free[g.rows], full[g.rows, :]) for g in self.each]
        return self._by_rows(a for a, _ in pairs), self._by_rows(b for _, b in pairs)

    def gives(self, rest: float, onset: float) -> ca.SX:
        """Compliance matrix, at rest and in onset across the direction."""
        rows = sum(len(grip.rows) for grip in self.each)
        found = ca.SX(rows, rows)
        for grip in self.each:
            found[grip.rows, grip.rows] = grip.gives(rest, onset)
        return found

    def deciding(self, acceleration: ca.SX, forces: ca.SX, delassus: ca.SX) -> ca.SX:
        """Values that decide modes: five columns, see `LineGrip.deciding`, one below the other."""
        columns = [
            g.deciding(acceleration[g.rows], forces[g.rows], delassus[g.rows, g.rows])
            for g in self.each
        ]
        return ca.vertcat(*(self._by_contacts(column) for column in zip(*columns, strict=True)))

    def aims(self, forces: ca.SX) -> ca.SX:
        """`PlaneGrip.aims` of every contact in the plane."""
        return ca.vertcat(*(grip.aims(forces[grip.rows]) for grip in self._planar))

    @property
    def bends(self) -> ca.SX:
        """`PlaneGrip.bends` of every contact in the plane."""
        return ca.vertcat(*(grip.bends for grip in self._planar))


def _sorted(parts: Iterable[ca.SX], places: list[int]) -> ca.SX:
    """Rows of parts, each at its place."""
    return ca.vertcat(*parts)[np.argsort(places).tolist(), :] if places else ca.SX(0, 1)


def _kind(law: Any) -> Hashable:
    """Key of laws that differ in scalar symbols only."""
    if not is_dataclass(law):
        return id(law)
    values = fields_of(law) | dict.fromkeys(symbols_of(law), ca.SX)
    return type(law), *(
        v if v is None or v is ca.SX or isinstance(v, Real) else id(v) for v in values.values()
    )


@dataclass(frozen=True, eq=False)
class _Several:
    """Equal laws as one Law of columns, which returns an entry for each law."""

    law: Law
    symbols: ca.SX  # (k, 1) its values
    numbers: ca.SX  # (k, contacts) those of all

    @classmethod
    def of(cls, laws: Sequence[Any]) -> Law:
        """One law for several; a single one stays as it is."""
        first: Any = laws[0]
        if len(laws) == 1:
            return first
        names = list(symbols_of(first))
        symbols = ca.SX.sym("number", len(names))
        own = dict(zip(names, ca.vertsplit(symbols), strict=True)) if names else {}
        rows = [ca.horzcat(*(getattr(law, name) for law in laws)) for name in names]
        numbers = ca.vertcat(ca.SX(0, len(laws)), *rows)
        law: Any = replace(first, **own) if own else first  # type: ignore[type-var]
        return cls(law, symbols, numbers)

    @property
    def directions(self) -> tuple[int, ...]:
        """Of each."""
        return self.law.directions

    @property
    def stick_interval(self) -> tuple[ca.SX, ca.SX]:
        """Columns."""
        low, high = self.law.stick_interval
        return self._each(low), self._each(high)

    def slip_force(self, v: Expression, direction: int) -> ca.SX:
        """Column."""
        one = ca.SX.sym("v")
        return self._each(self.law.slip_force(one, direction), (one, v))

    def smooth(self, v: Expression, v_reg: Expression) -> ca.SX:
        """Column."""
        one, width = ca.SX.sym("v"), ca.SX.sym("v_reg")
        return self._each(self.law.smooth(one, width), (one, v), (width, v_reg))

    def _each(self, expression: Expression, *given: tuple[ca.SX, Expression]) -> ca.SX:
        """Insert the values of each, and arguments for symbols: a column, or one for all."""
        # Other symbols, such as those of a law that is no dataclass, are the same for all.
        count, symbols = self.numbers.size2(), [self.symbols, *(symbol for symbol, _ in given)]
        others = ca.Function("law", symbols, [expression], {"allow_free": True}).free_sx()
        function = ca.Function("law", [*symbols, ca.vertcat(*others)], [expression])
        columns = [ca.SX(value) for _, value in given]
        rows = (ca.repmat(v, 1, count) if v.is_scalar() else v.T for v in columns)
        return function.map(count)(self.numbers, *rows, ca.repmat(ca.vertcat(*others), 1, count)).T


# Relative compliance of contacts at rest and in onset that decides how they share a load, and
# number of iterations that remove its effect.
RESTING, TURNING = 1e-6, 1e-3
_REFINEMENTS = 5
# Largest number of equations written out for the compiler.
_WRITTEN_OUT = 8


@dataclass(frozen=True, eq=False)
class Equations:
    """Linear equations for forces or impulses, perhaps singular."""

    matrix: ca.SX
    right: ca.SX
    gives: ca.SX  # compliance added to the matrix to decide, relative to `size`
    near: ca.SX  # the solution nearest to it is chosen
    size: ca.SX  # of the matrix's entries


def solver(name: str, symbols: Sequence[ca.SX], equations: Equations) -> ca.Function:
    """Solve by loops unless equations are few: written out, a dozen contacts take half a minute.

    Returns the solution, then 1 if it is unique, else 0.
    """
    given: Any = list(symbols)
    e = equations
    parts: Any = [ca.densify(p) for p in (e.matrix, e.right, e.size * e.gives, e.near, e.size)]
    few = e.right.numel() <= _WRITTEN_OUT
    if not few:
        read = ca.Function("parts", given, parts)
        given = read.mx_in()
        parts = read(*given)
    A, b, softened, found, size = parts
    how = () if few else ("qr",)
    inverse: Any = ca.solve(A + softened, ca.DM.eye(b.numel()), *how)
    for _ in range(_REFINEMENTS):
        found = found + inverse @ (b - A @ found)
    weakest = ca.mmax(ca.fabs(inverse)) * size
    return ca.Function(name, given, [ca.vertcat(found, weakest < 0.1 / RESTING)])


def determined(matrix: ca.SX) -> ca.SX:
    """Determinant relative to the sizes of the rows: 1 well determined, 0 not at all."""
    # From factors: an expression by minors grows like Fibonacci's numbers for a chain.
    size = ca.fabs(_product(ca.diag(ca.qr(matrix)[1])))
    return size / ca.sqrt(_product(ca.sum2(matrix**2)))


def _product(column: ca.SX) -> ca.SX:
    product = ca.SX(1)
    for i in range(column.numel()):
        product *= column[i]
    return product
