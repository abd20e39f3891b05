"""Checks values of friction laws that parameters and inputs determine."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import symbols_of
from wormopt.model.given import fields_of
from wormopt.model.model import Model

_HUGE = 1e100


@dataclass(frozen=True, eq=False)
class _Alike:
    """Contacts whose laws differ in values only."""

    names: list[str]  # fields that are determined
    contacts: list[int]
    entries: list[list[int]]  # for each contact and field the index of its value


@dataclass(frozen=True, eq=False)
class LawNumbers:
    """Laws of a model's contacts with fields that are symbols."""

    model: Model
    fixed: ca.SX  # symbols of parameters and inputs

    def check(self, fixed: np.ndarray) -> None:
        """Let each law check its values together, such as stiction against sliding friction.

        `fixed` are values of the symbols. Laws with equal values are checked once.
        Raises ArgumentError if a law refuses.
        """
        if not self._alike:
            return
        values = self._values(fixed).full().ravel()
        for alike in self._alike:
            rows = map(tuple, values[alike.entries].tolist())
            first: dict[tuple[float, ...], int] = {}
            for numbers, contact in zip(rows, alike.contacts, strict=True):
                first.setdefault(numbers, contact)
            for numbers, contact in first.items():
                self._ask(contact, dict(zip(alike.names, numbers, strict=True)))

    def finite(self, fixed: np.ndarray) -> np.ndarray:
        """Values with infinity replaced by a huge number, since 0 times infinity is NaN."""
        column = self._column(self._decided[0])[0]
        used = np.array(ca.which_depends(column, self.fixed, 1, False), dtype=bool)
        return np.where(np.isinf(fixed) & used, np.copysign(_HUGE, fixed), fixed)

    def _ask(self, i: int, numbers: dict[str, float]) -> None:
        contact = self.model.contacts[i]
        try:
            replace(contact.law, **numbers)
        except ValueError as error:
            shown = ", ".join(f"{name} = {value:g}" for name, value in numbers.items())
            raise ArgumentError(f"{contact.name} with {shown}: {error}") from None

    @cached_property
    def _alike(self) -> list[_Alike]:
        """Contacts with fields of their laws that parameters and inputs alone determine."""
        own = defaultdict[int, dict[str, int]](dict)
        for entry, (i, name) in enumerate(self._decided[0]):
            own[i][name] = entry
        groups = defaultdict[tuple[object, ...], list[int]](list)
        for i, entries in own.items():
            groups[_kind(self.model.contacts[i].law, list(entries))].append(i)
        return [
            _Alike(list(own[group[0]]), group, [list(own[i].values()) for i in group])
            for group in groups.values()
        ]

    @property
    def _values(self) -> ca.Function:
        return self._decided[1]

    @cached_property
    def _decided(self) -> tuple[list[tuple[int, str]], ca.Function]:
        """Contacts and fields, and their values by parameters and inputs."""
        laws = enumerate(contact.law for contact in self.model.contacts)
        places = [(i, name) for i, law in laws for name in symbols_of(law)]
        column, function = self._column(places)
        others = function.free_sx()
        if others:
            open_ = ca.which_depends(column, ca.vertcat(*others), 1, True)
            places = [place for place, other in zip(places, open_, strict=True) if not other]
            _, function = self._column(places)
        return places, function

    def _column(self, places: list[tuple[int, str]]) -> tuple[ca.SX, ca.Function]:
        values = [getattr(self.model.contacts[i].law, name) for i, name in places]
        column = ca.densify(ca.vertcat(ca.SX(0, 1), *values))
        return column, ca.Function("law_numbers", [self.fixed], [column], {"allow_free": True})


def _kind(law: Any, decided: list[str]) -> tuple[object, ...]:
    """Key of laws that differ only in the fields `decided`."""
    others = [(name, id(v)) for name, v in fields_of(law).items() if name not in decided]
    return type(law), *decided, *others
