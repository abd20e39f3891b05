"""A kind of scene: which table it is read into, which study computes it, what is drawn of it.

Modules are named as text and loaded on use, so that reading or checking a scene loads no
numerics and running one loads those of its own kind only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from wormopt.progress import Report


@dataclass(frozen=True)
class Kind:
    """One kind of scene."""

    summary: str  # what such a scene computes, in one line
    table: str  # "module:Class" of the typed table of its scenes
    study: str  # module whose ``run(scene, report)`` computes the Result
    # word of ``want`` -> "module:function" that composes the picture of a result; of a function
    # first_frame the module moves it by ``pose``, over so many FRAMES
    pictures: Mapping[str, str]
    wanted: tuple[str, ...] = ()  # words of ``want`` by which the study computes more
    table_file: bool = False  # whether results have a table file of their own
    # file name -> "module:function" giving its text of the result, or None
    exports: Mapping[str, str] = field(default_factory=dict)

    def load_table(self) -> Any:
        """Load the class that scenes of this kind are read into."""
        module, name = self.table.split(":")
        return getattr(import_module(module), name)

    def load_study(self) -> Any:
        """Load the module that computes scenes of this kind."""
        return import_module(self.study)

    def run(self, scene: Any, report: Report) -> Any:
        """Compute the Result of a scene."""
        return self.load_study().run(scene, report)

    def models_of(self, scene: Any) -> dict[str, Any] | None:
        """Models that a scene simulates, by label; None if the kind has none."""
        models = getattr(self.load_study(), "models_of", None)
        return None if models is None else models(scene)

    def load_exports(self) -> dict[str, Callable[[Any], str | None]]:
        """Load the functions that make the texts of further files."""
        parts = {name: text.split(":") for name, text in self.exports.items()}
        return {name: getattr(import_module(m), f) for name, (m, f) in parts.items()}


@dataclass(frozen=True)
class StudyKind:
    """A kind that is one class, see `wormopt.study`; the class is loaded on use."""

    summary: str
    table: str  # "module:Class"

    def load_table(self) -> Any:
        """Load the class."""
        module, name = self.table.split(":")
        return getattr(import_module(module), name)

    load_study = load_table

    @property
    def study(self) -> str:
        """Module of the class."""
        return self.table.partition(":")[0]

    @property
    def pictures(self) -> Mapping[str, str]:
        """Pictures by name, see `Kind`."""
        return self.load_table().pictures

    @property
    def wanted(self) -> tuple[str, ...]:
        """Pictures for which the study computes more."""
        return self.load_table().wanted

    @property
    def table_file(self) -> bool:
        """Whether results have a table file of their own."""
        return self.load_table().table_file

    @property
    def exports(self) -> Mapping[str, str]:
        """Further files by name, see `Kind`."""
        return self.load_table().exports

    def run(self, scene: Any, report: Report) -> Any:
        """Compute the Result of a scene."""
        return scene.table.result(report)

    def models_of(self, scene: Any) -> dict[str, Any] | None:
        """Models that a scene simulates, by label; None if the kind has none."""
        return scene.table.models()

    load_exports = Kind.load_exports
