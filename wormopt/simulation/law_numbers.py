"""Numbers of friction laws that parameters and inputs decide: each law looks at its own."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Contact, Model, pack


@dataclass(frozen=True, eq=False)
class LawNumbers:
    """Laws of a model's contacts with fields that are symbols."""

    model: Model

    def check(self, fixed: np.ndarray) -> None:
        """Let each law see its numbers together: stiction below sliding friction, say.

        `fixed` are values of parameters and inputs. Raises ArgumentError if a law refuses.
        """
        if not self._decided:
            return
        numbers = self._values(fixed).full().ravel()
        for contact, names in self._decided:
            own, numbers = numbers[: len(names)].tolist(), numbers[len(names) :]
            try:
                replace(contact.law, **dict(zip(names, own, strict=True)))  # type: ignore[type-var]
            except ValueError as error:
                said = ", ".join(f"{n} = {v:g}" for n, v in zip(names, own, strict=True))
                raise ArgumentError(f"{contact.name} with {said}: {error}") from None

    @property
    def _symbols(self) -> ca.SX:
        return ca.vertcat(pack(self.model.p), pack(self.model.u))

    @cached_property
    def _decided(self) -> list[tuple[Contact, list[str]]]:
        """Contacts with fields of their laws that parameters and inputs alone decide."""
        known = {symbol.element_hash() for symbol in ca.symvar(self._symbols)}

        def decided(value: object) -> bool:
            symbols = ca.symvar(value) if isinstance(value, ca.SX) else []
            return len(symbols) > 0 and all(s.element_hash() in known for s in symbols)

        laws = [(c, fields(c.law)) for c in self.model.contacts if is_dataclass(c.law)]
        found = [(c, [i.name for i in own if decided(getattr(c.law, i.name))]) for c, own in laws]
        return [(c, names) for c, names in found if names]

    @cached_property
    def _values(self) -> ca.Function:
        values = [getattr(c.law, name) for c, names in self._decided for name in names]
        found = ca.densify(ca.vertcat(ca.SX(0, 1), *values))
        return ca.Function("law_numbers", [self._symbols], [found])
