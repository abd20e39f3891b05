"""A kind of scene: which table it is read into, which study computes it, what is drawn of it.

Modules are named as text and loaded on use, so that reading or checking a scene loads no
numerics and running one loads those of its own kind only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any


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

    def load_exports(self) -> dict[str, Callable[[Any], str | None]]:
        """Load the functions that make the texts of further files."""
        parts = {name: text.split(":") for name, text in self.exports.items()}
        return {name: getattr(import_module(m), f) for name, (m, f) in parts.items()}
