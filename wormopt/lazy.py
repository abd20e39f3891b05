"""Names that are loaded on first use: public names of a package, and imports of a file.

A package declares its public names once, in its stub. Imports of a file wait in a block, so that
checking a scene loads no numerics:

>>> with on_use():
...     from decimal import Decimal
>>> Decimal("0.1")  # imported here; from now on the name is the class itself
Decimal('0.1')

Python's own LazyLoader takes whole modules only, and loads them when another module imports them.
`lazy import` of Python 3.15 will replace this file.
"""

from __future__ import annotations

import builtins
import re
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
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
    """Text that lists the public names of a package in the groups of its stub."""
    # A line ``# Group: title`` in the stub heads the names below it.
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


_WAITING = "_waiting_imports"  # attribute of a module: its pending imports


class _Later:
    """Placeholder of an imported name until it is used, which then replaces itself."""

    def __init__(self, module: str, name: str, where: dict[str, Any]) -> None:
        self._module, self._name, self._where = module, name, where

    def _load(self) -> Any:
        module = import_module(self._module) if self._module else None
        if module is not None and hasattr(module, self._name):
            found = getattr(module, self._name)
        else:
            found = import_module(f"{self._module}.{self._name}".lstrip("."))
        for key in [key for key, value in self._where.items() if value is self]:
            self._where[key] = found
        return found

    def __getattr__(self, name: str) -> Any:
        return getattr(self._load(), name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._load()(*args, **kwargs)

    def __getitem__(self, key: Any) -> Any:
        return self._load()[key]

    def __instancecheck__(self, value: object) -> bool:
        return isinstance(value, self._load())

    def __subclasscheck__(self, kind: type) -> bool:
        return issubclass(kind, self._load())

    def __mro_entries__(self, bases: tuple[Any, ...]) -> tuple[type, ...]:
        raise TypeError(f"{self._name} is the base of a class; import it outside on_use()")


class _Source:
    """Source of the names of `from module import name`."""

    def __init__(self, module: str, where: dict[str, Any]) -> None:
        self._module, self._where = module, where

    def __getattr__(self, name: str) -> _Later:
        later = _Later(self._module, name, self._where)
        self._where.setdefault(_WAITING, []).append(later)
        return later


@contextmanager
def on_use() -> Generator[None]:
    """Delay the imports of the block. For use at the top level of a module."""
    real, where = builtins.__import__, sys._getframe(2).f_globals  # pyright: ignore[reportPrivateUsage] # noqa: SLF001

    def wait(
        name: str,
        space: Any = None,
        local: Any = None,
        names: Sequence[str] | None = (),
        level: int = 0,
    ) -> Any:
        if space is not where or level:
            return real(name, space, local, names or (), level)
        if names:
            return _Source(name, where)
        if "." in name:
            raise ImportError(f"write from {name.rpartition('.')[0]} import ... in this block")
        return getattr(_Source("", where), name)

    builtins.__import__ = wait
    try:
        yield
    finally:
        builtins.__import__ = real


def load(module: str) -> None:
    """Make the pending imports of a module.

    Code that compares or stores its imports then never meets a placeholder.
    """
    for later in vars(sys.modules[module]).pop(_WAITING, ()):
        later._load()  # noqa: SLF001 - of this file
