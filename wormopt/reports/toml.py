"""A scene's table as TOML, to be read and saved."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any


def as_toml(table: Mapping[str, Any]) -> str:
    """Write a table: its own keys first, then its tables and lists of tables.

    Keys without a value are left out; a list holds none.
    """
    return "\n".join(_lines(_told(table), "")).strip() + "\n"


def _told(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _told(item) for key, item in value.items() if item is not None}
    return [_told(item) for item in value] if isinstance(value, list) else value


def _lines(table: Mapping[str, Any], path: str) -> Iterator[str]:
    below = {key: value for key, value in table.items() if _is_table(value) or _are_tables(value)}
    yield from (f"{_key(k)} = {_value(v)}" for k, v in table.items() if k not in below)
    for key, value in below.items():
        where = f"{path}.{_key(key)}" if path else _key(key)
        for part in [value] if _is_table(value) else value:
            yield ""
            yield f"[{where}]" if _is_table(value) else f"[[{where}]]"
            yield from _lines(part, where)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(map(_is_table, value))


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_key(k)} = {_value(v)}' for k, v in value.items())}}}"
    # JSON writes numbers, truth values and texts as TOML reads them, but for one letter
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
