# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Keys of a scene as TOML, written out or changed by ``--set`` and by tables from Python."""

from __future__ import annotations

import json
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
    if not isinstance(overrides, Iterable):  # pyright: ignore[reportUnnecessaryIsInstance]  from Python
        raise ArgumentError(f'overrides must be texts "key=value" or dicts, not {overrides!r}')
    several: Iterable[Any] = [overrides] if isinstance(overrides, str | Mapping) else overrides
    for one in several:
        if isinstance(one, Mapping):
            for path, value in _leaves(one):
                yield from _set_at(raw, path, value)
        elif isinstance(one, str):
            yield from _override_by_text(raw, one)
        else:
            raise ArgumentError(f'an override must be a text "key=value" or a dict, not {one!r}')


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
        yield "--set", f"{text!r} is not of the form key=value; write for example worm.links=3"
        return
    try:
        value.encode()  # arguments may be invalid text, which cannot be saved
        parsed = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        parsed = {}
    if parsed.keys() != {"value"}:
        parsed = {"value": value.strip()}  # a text without quotes
        if not re.match(r"[^\[{\"']", parsed["value"]) or not value.isprintable():
            yield path, f"{value!r} is not a TOML value; close its brackets, or put text in quotes"
            return
    yield from _set_at(raw, path, parsed["value"])


def _set_at(raw: dict[str, Any], path: str, value: Any) -> Iterator[Fault]:
    keys = re.sub(r"\[(\d+)\]", r".\1", path).split(".")  # tracker[0].gain or tracker.0.gain
    if not all(keys):
        yield path or "--set", f"{path!r} is not a key; write key=value, for example worm.links=3"
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
        what = f"{name} is not a table or list; write it as a whole: {name}=[...]"
        raise ValueError(what)  # noqa: TRY004  a fault of the user's
    if not rest:
        inside[place] = value
        return
    if isinstance(inside, dict):
        inside.setdefault(place, {})
    _set(inside[place], rest, value, f"{name}.{key}" if name else key)


def toml_text(table: Mapping[str, Any]) -> str:
    """Write a table: its own keys first, then its tables and lists of tables."""
    # Keys without a value are left out; lists contain no such values.
    return "\n".join(_lines(_without_none(table), "")).strip() + "\n"


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


def _lines(table: Mapping[str, Any], path: str) -> Iterator[str]:
    below = {key: value for key, value in table.items() if holds_tables(value)}
    yield from (f"{_key(k)} = {toml_value(v)}" for k, v in table.items() if k not in below)
    for key, value in below.items():
        where = f"{path}.{_key(key)}" if path else _key(key)
        for part in value if isinstance(value, list) else [value]:
            yield ""
            yield f"[[{where}]]" if isinstance(value, list) else f"[{where}]"
            yield from _lines(part, where)


def holds_tables(value: Any) -> bool:
    """Whether a value is a table, or a list of tables only."""
    listed = value if isinstance(value, list) else [value]
    return bool(listed) and all(isinstance(item, Mapping) for item in listed)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)


def toml_value(value: Any) -> str:
    """Format a value after its key."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_key(k)} = {toml_value(v)}' for k, v in value.items())}}}"
    # JSON writes numbers, booleans and texts as TOML reads them, except for one letter
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
