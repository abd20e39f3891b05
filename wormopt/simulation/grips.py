"""All contacts that may rest, those with equal laws as one grip; results row by row."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, is_dataclass, replace
from numbers import Real
from typing import Any

import casadi as ca
import numpy as np

from wormopt.model.friction import Expression, Law, symbols_of
from wormopt.model.given import fields_of
from wormopt.model.model import Contact
from wormopt.simulation.grip import ENTRIES, LineGrip, PlaneGrip


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

    def tells(self, acceleration: ca.SX, forces: ca.SX, delassus: ca.SX) -> ca.SX:
        """Values that decide modes: five columns, see `Grip.tells`, one below the other."""
        columns = [
            g.tells(acceleration[g.rows], forces[g.rows], delassus[g.rows, g.rows])
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
        """Insert the values of each, and arguments for symbols: a column, or one for all.

        Other symbols, such as those of a law that is no dataclass, are the same for all.
        """
        count, symbols = self.numbers.size2(), [self.symbols, *(symbol for symbol, _ in given)]
        others = ca.Function("law", symbols, [expression], {"allow_free": True}).free_sx()
        function = ca.Function("law", [*symbols, ca.vertcat(*others)], [expression])
        columns = [ca.SX(value) for _, value in given]
        rows = (ca.repmat(v, 1, count) if v.is_scalar() else v.T for v in columns)
        return function.map(count)(self.numbers, *rows, ca.repmat(ca.vertcat(*others), 1, count)).T
