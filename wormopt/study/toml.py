"""Tables and values of a scene as TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any


def toml_text(table: Mapping[str, Any]) -> str:
    """Write a table: its own keys first, then its tables and lists of tables.

    Keys without a value are left out; lists contain no such values.
    """
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
