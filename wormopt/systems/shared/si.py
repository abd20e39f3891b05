"""Scenes and studies whose values are in SI units."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from wormopt.errors import Fault
from wormopt.study import SceneTable, Study

_WHY_SI = 'the permeability of vacuum has units; write units = "SI", with A/m, Pa and m'


class SIScene(SceneTable):
    """A scene whose values are in SI units."""

    why_si: ClassVar[str] = _WHY_SI

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if self.units != "SI":
            yield "units", self.why_si


class SIStudy(Study):
    """A study whose values are in SI units."""

    why_si: ClassVar[str] = _WHY_SI

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        if self.units != "SI":
            yield "units", self.why_si
