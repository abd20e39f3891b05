"""Public names, written once: in the stub beside a package, loaded on first use."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def names_of(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Give ``__getattr__``, ``__dir__`` and ``__all__`` of a package by its stub.

    `file` is the package's ``__file__``; the stub has lines ``from module import name as name``.
    """
    text = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    homes = {
        name: (module, origin)
        for module, origin, name in re.findall(r"^from (\S+) import (\w+) as (\w+)$", text, re.M)
    }

    def load(name: str) -> Any:
        if name not in homes:
            british = next((known for known in homes if _american(known) == name), None)
            if british is None:
                raise AttributeError(f"module {package!r} has no attribute {name!r}{_hint(name)}")
            name = british
        module, origin = homes[name]
        if module == package or not hasattr(import_module(module), origin):
            return import_module(f"{module}.{origin}")  # a package of names
        return getattr(import_module(module), origin)

    def _hint(name: str) -> str:
        # loaded here: only who misspells a name needs it
        from difflib import get_close_matches

        close = [] if name.startswith("_") else get_close_matches(name, homes, n=1)
        return f"; did you mean {close[0]!r}?" if close else ""

    return load, lambda: sorted(homes), sorted(homes)


def _american(name: str) -> str:
    """Spell a name the American way: optimize for optimise."""
    return re.sub(r"is(?=e|ing|ation)", "iz", name).replace("velling", "veling")


def above(place: str) -> Any:
    """Load "module:name" of a room above: what a method offers, and its own room does without."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
