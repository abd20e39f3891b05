"""Changes of a scene before it is checked: texts of ``--set``, and tables from Python."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from wormopt.errors import ArgumentError, Fault

Overrides = str | Mapping[str, Any] | Iterable[str | Mapping[str, Any]]
"""One text "dotted.key=value", a table whose keys may be dotted and nested, or several of them."""


def override(raw: dict[str, Any], overrides: Overrides) -> Iterator[Fault]:
    """Change raw tables in place, and yield faults."""
    if not isinstance(overrides, Iterable):
        raise ArgumentError(f'overrides are texts "key=value" or dicts, not {overrides!r}')
    several: Iterable[Any] = [overrides] if isinstance(overrides, str | Mapping) else overrides
    for one in several:
        if isinstance(one, Mapping):
            for path, value in _leaves(one):
                yield from _set_at(raw, path, value)
        elif isinstance(one, str):
            yield from _override_by_text(raw, one)
        else:
            raise ArgumentError(f'an override is a text "key=value" or a dict, not {one!r}')


def as_toml(value: Any) -> Any:
    """Convert a value from Python to TOML types: lists, numbers, texts, tables."""
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): as_toml(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_toml(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def _leaves(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Key paths and values of a table, including those of tables in it, which are merged."""
    for key, value in table.items():
        inside = f"{path}.{key}" if path else str(key)
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, inside)
        else:
            yield inside, as_toml(value)


def _override_by_text(raw: dict[str, Any], text: str) -> Iterator[Fault]:
    path, equals, value = text.partition("=")
    path = path.strip()
    if not equals:
        yield "--set", f"{text!r} does not read key=value, worm.links=3 say"
        return
    try:
        value.encode()  # arguments may be invalid text, which cannot be saved
        parsed = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        parsed = {}
    if parsed.keys() != {"value"}:
        parsed = {"value": value.strip()}  # a text without quotes
        if not re.match(r"[^\[{\"']", parsed["value"]) or not value.isprintable():
            yield path, f"{value!r} is no TOML value; close its brackets, or put text in quotes"
            return
    yield from _set_at(raw, path, parsed["value"])


def _set_at(raw: dict[str, Any], path: str, value: Any) -> Iterator[Fault]:
    keys = re.sub(r"\[(\d+)\]", r".\1", path).split(".")  # tracker[0].gain or tracker.0.gain
    if not all(keys):
        yield path or "--set", f"{path!r} is no key; write key=value with one, worm.links=3 say"
        return
    try:
        _set(raw, keys, value)
    except ValueError as error:
        yield path, str(error)
    except RecursionError:
        yield path, "is nested too deeply"


def _set(inside: Any, keys: list[str], value: Any, name: str = "") -> None:
    """Set the value at a path of keys and list indices; makes missing tables."""
    key, *rest = keys
    place: Any = key
    if isinstance(inside, list):
        place = int(key) if key.isdecimal() else len(inside)
        if place >= len(inside):
            raise ValueError(f"{name} is a list; its entries are {name}.0 to {len(inside) - 1}")
    elif not isinstance(inside, dict):
        what = f"{name} is not a table or list; give all of it: {name}=[...]"
        raise ValueError(what)  # noqa: TRY004  a fault of the user's
    if not rest:
        inside[place] = value
        return
    if isinstance(inside, dict):
        inside.setdefault(place, {})
    _set(inside[place], rest, value, f"{name}.{key}" if name else key)
