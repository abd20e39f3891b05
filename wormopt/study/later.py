# pyright: strict
"""Imports that wait until a name is used, so that checking a scene loads no numerics.

>>> with on_use():
...     from decimal import Decimal
>>> Decimal("0.1")  # imported here; from now on the name is the class itself
Decimal('0.1')

Python's own LazyLoader takes whole modules only, and loads them when another module imports them.
`lazy import` of Python 3.15 will replace this file.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

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
