"""Public names of a package: declared once in its stub, loaded on first use."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import Any

_DECLARED = re.compile(r"^from (\S+) import (\w+) as (\w+)$", re.MULTILINE)
# Former public names and their present names.
_RENAMED = {
    "Decisions": "MpcOptions",
    "Doubt": "NonsmoothEvent",
    "Held": "NoSlip",
    "Unit": "AnisotropicCoulomb",
    "best_of": "optimise_multistart",
    "copies": "scenario_model",
    "plan_ahead": "plan_mpc",
    "recede": "run_mpc",
}


def names_of(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Make ``__getattr__``, ``__dir__`` and ``__all__`` of a package from its stub.

    `file` is the package's ``__file__``; the stub has lines ``from module import name as name``.
    """
    homes = {name: (module, origin) for module, origin, name in _DECLARED.findall(_stub(file))}

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
        if _RENAMED.get(name) in homes:
            return f"; it is now called {_RENAMED[name]!r}"
        # imported here because only misspelt names need it
        from difflib import get_close_matches

        close = [] if name.startswith("_") else get_close_matches(name, homes, n=1)
        return f"; did you mean {close[0]!r}?" if close else ""

    return load, lambda: sorted(homes), sorted(homes)


def grouped_names(file: str) -> str:
    """Text that lists the public names of a package in the groups of its stub.

    A line ``# Group: title`` in the stub heads the names below it.
    """
    _, *groups = re.split(r"^# Group: ", _stub(file), flags=re.MULTILINE)
    parts = []
    for group in groups:
        title, _, declared = group.partition("\n")
        names = ", ".join(name for *_, name in _DECLARED.findall(declared))
        parts.append(f"{title}\n{fill(names, 96, initial_indent='    ', subsequent_indent='    ')}")
    return "\n\n".join(parts)


def _stub(file: str) -> str:
    return Path(file).with_suffix(".pyi").read_text(encoding="utf-8")


def _american(name: str) -> str:
    """Spell a name the American way: optimize for optimise."""
    return re.sub(r"is(?=e|ing|ation)", "iz", name).replace("velling", "veling")


def above(place: str) -> Any:
    """Load "module:name" from a higher layer, which the caller's layer must not import."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
