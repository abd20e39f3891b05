"""Studies whose values are in SI units."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from wormopt.errors import Fault
from wormopt.study import Study


class SIStudy(Study):
    """A study whose values are in SI units."""

    why_si: ClassVar[str] = (
        'the permeability of vacuum has units; write units = "SI", with A/m, Pa and m'
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        if self.units != "SI":
            yield "units", self.why_si
