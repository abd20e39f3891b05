"""Numbers of friction laws that parameters and inputs decide: each law looks at its own."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, pack


@dataclass(frozen=True, eq=False)
class LawNumbers:
    """Laws of a model's contacts with fields that are symbols."""

    model: Model

    def check(self, fixed: np.ndarray) -> None:
        """Let each law see its numbers together: stiction below sliding friction, say.

        `fixed` are values of parameters and inputs. Laws that are alike but for these fields, and
        equal in them, are asked once. Raises ArgumentError if a law refuses.
        """
        values = self._values(fixed).full().ravel().tolist() if self._decided else []
        numbers = defaultdict[int, dict[str, float]](dict)
        for (i, name), value in zip(self._decided, values, strict=True):
            numbers[i][name] = value
        asked = set[tuple[object, ...]]()
        for i, own in numbers.items():
            contact = self.model.contacts[i]
            asking = (*_kept(contact.law, own), *own.values())
            if asking in asked:
                continue
            asked.add(asking)
            try:
                replace(contact.law, **own)
            except ValueError as error:
                said = ", ".join(f"{name} = {value:g}" for name, value in own.items())
                raise ArgumentError(f"{contact.name} with {said}: {error}") from None

    @property
    def _symbols(self) -> ca.SX:
        return ca.vertcat(pack(self.model.p), pack(self.model.u))

    @cached_property
    def _symbolic(self) -> list[tuple[int, str]]:
        """Contacts, and fields of their laws that are scalar expressions."""
        laws = enumerate(contact.law for contact in self.model.contacts)
        named = [
            (i, law, item.name) for i, law in laws if is_dataclass(law) for item in fields(law)
        ]
        return [(i, name) for i, law, name in named if _is_scalar(getattr(law, name))]

    @cached_property
    def _decided(self) -> list[tuple[int, str]]:
        """Those that parameters and inputs alone decide."""
        column = self._column(self._symbolic)
        told = ca.Function("told", [self._symbols], [column], {"allow_free": True})
        others = told.free_sx()
        if not others:
            return self._symbolic
        open_ = ca.which_depends(column, ca.vertcat(*others), 1, True)
        return [place for place, is_open in zip(self._symbolic, open_, strict=True) if not is_open]

    @cached_property
    def _values(self) -> ca.Function:
        return ca.Function("law_numbers", [self._symbols], [self._column(self._decided)])

    def _column(self, places: list[tuple[int, str]]) -> ca.SX:
        values = [getattr(self.model.contacts[i].law, name) for i, name in places]
        return ca.densify(ca.vertcat(ca.SX(0, 1), *values))


def _is_scalar(value: object) -> bool:
    return isinstance(value, ca.SX) and value.is_scalar()


def _kept(law: Any, numbers: dict[str, float]) -> tuple[object, ...]:
    """The law's kind, and which other fields it has."""
    others = (item.name for item in fields(law) if item.name not in numbers)
    return type(law), *numbers, *((name, id(getattr(law, name))) for name in others)
