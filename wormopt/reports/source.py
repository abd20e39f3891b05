"""Origin of a result: its file, and its scene with units and meanings of keys."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from msgspec.structs import fields

from wormopt.files import RESULT_FILE, SUMMARY_FILE
from wormopt.kinds import KINDS
from wormopt.quantities import ABSOLUTE, UNITS, unit_of
from wormopt.reports.parts import (
    code,
    details,
    escaped,
    marked,
    public,
    scrolled,
    table,
    unit_text,
    value_text,
)
from wormopt.result import Result
from wormopt.runner import result_at
from wormopt.study.given import default_of, meaning, read_table
from wormopt.study.toml import toml_text
from wormopt.version import VERSION


@dataclass(frozen=True, eq=False)
class Source:
    """A result. folder: that of its further files, None for a result without files."""

    result: Result
    version: str = VERSION
    computed: str = ""
    folder: Path | None = None


def source_of(given: Result | str | Path) -> Source:
    """Find a result; ArgumentError, which names the file, if there is none."""
    if isinstance(given, Result):
        return Source(given)
    path = Path(given)
    result, file = result_at(path), path / RESULT_FILE if path.is_dir() else path
    computed = datetime.fromtimestamp(file.stat().st_mtime, UTC)
    return Source(result, _version(file), f"{computed:%Y-%m-%d %H:%M} UTC", file.parent)


def _version(file: Path) -> str:
    """Version that computed a result, from the file or the summary beside it."""
    from scipy.io import netcdf_file

    try:
        with netcdf_file(file, "r", mmap=False) as stored:
            return getattr(stored, "source", b"").decode().removeprefix("wormopt ")
    except (OSError, ValueError):
        summary = json.loads((file.parent / SUMMARY_FILE).read_text("utf-8"))
        return str(summary.get("wormopt", ""))


_ELSEWHERE = ("schema", "kind", "title", "units", "want")  # shown elsewhere, or not of interest

_SHORT = 16


@dataclass(frozen=True)
class Key:
    """A key with a value in the scene."""

    path: str
    value: Any
    unit: str
    meaning: str


def scene_of(result: Result) -> dict[str, Any]:
    """Every key of the scene of a result, empty if unknown; without paths of the machine."""
    try:
        found = json.loads(result.scene_text)
    except ValueError:
        return {}
    return _public(found) if isinstance(found, dict) else {}


def all_keys(result: Result) -> dict[str, Any]:
    """Value of every key of the scene of a result, by dotted path."""
    return {key.path: key.value for key in _flat(scene_of(result), "")}


def asked_html(result: Result) -> str:
    """Table of the given keys, and the scene as a file."""
    raw = scene_of(result)
    if not raw:
        return "<p>The result does not hold its scene.</p>"
    keys = keys_set(result.kind, raw)
    rows = (
        (f"<code>{escaped(k.path)}</code>", escaped(_kept(value_text(k.value))),
         escaped(unit_text(k.unit)), marked(k.meaning))
        for k in keys
    )  # fmt: skip
    whole = table("keys", ("key", "value", "unit", "meaning"), rows)
    note = (
        "<p>Keys that are not listed have their defaults.</p>" if raw.get("kind") in KINDS else ""
    )
    return scrolled("Keys that were set", whole) + note


def again_html(result: Result) -> str:
    """Instructions to compute the result again: the scene to save and the command."""
    raw = scene_of(result)
    if not raw:
        return ""
    text, name = toml_text(raw), re.sub(r"[^\w-]+", "_", result.scene, flags=re.ASCII) or "scene"
    link = base64.b64encode(text.encode()).decode()
    verb = "sweep" if result.kind == "sweep" else "run"
    beside = sorted(set(re.findall(r"[\w.-]+\.(?:py|nc|csv|txt|tsv|dat|toml)\b", json.dumps(raw))))
    needs = f" Beside it must lie {escaped(', '.join(beside))}." if beside else ""
    return (
        f'<p>Save the scene as <a download="{name}.toml" href="data:application/toml;base64,'
        f'{link}">{name}.toml</a>.{needs} Then run</p>{code(f"wormopt {verb} {name}.toml")}'
        + details(
            "The scene in full, defaults included",
            code(escaped(text)),
        )
    )


def _kept(text: str) -> str:
    """Write short tables on one line."""
    return text.replace(" ", "\u00a0") if len(text) <= _SHORT else text


def keys_set(kind: str, raw: dict[str, Any]) -> list[Key]:
    """Keys of a scene that differ from their defaults; all of them if the kind is unknown."""
    swept = raw.get("sweep", {})  # its keys belong to no kind
    raw = {key: value for key, value in raw.items() if key != "sweep"}
    kind = kind if kind in KINDS else raw.get("kind", "")
    units = raw.get("units", "dimensionless")
    known = read_table(raw, KINDS[kind].load(), "", units, []) if kind in KINDS else None
    if known is None:
        return list(_flat(raw | {"sweep": swept} if swept else raw, ""))
    own = [key for key in _set(known, "", units) if key.path not in swept.get("over", {})]
    return [*_flat(swept, "sweep"), *own]


def _set(table: Any, path: str, units: str) -> Iterator[Key]:
    tag = table.__struct_config__
    if tag.tag_field and tag.tag_field not in _ELSEWHERE[:1] and path:
        yield Key(f"{path}{tag.tag_field}", tag.tag, "1", (table.__doc__ or "").partition("\n")[0])
    for field in fields(type(table)):
        value, name = getattr(table, field.name), field.encode_name
        if (not path and name in _ELSEWHERE) or value is None:
            continue
        if not field.required and value == default_of(field):
            continue
        parts = value if isinstance(value, tuple) else (value,)
        if parts and all(hasattr(part, "__struct_fields__") for part in parts):
            for i, part in enumerate(parts):
                at = f"{name}[{i}]" if isinstance(value, tuple) else name
                yield from _set(part, f"{path}{at}.", units)
            continue
        quantity, what = meaning(field.type) or ("", "")
        unit = unit_of(quantity, units) if quantity in {*UNITS, *ABSOLUTE} else "1"
        yield Key(f"{path}{name}", value, unit, what)


def _flat(raw: Any, path: str) -> Iterator[Key]:
    if isinstance(raw, dict):
        for name, value in raw.items():
            if path or name not in _ELSEWHERE:
                yield from _flat(value, f"{path}.{name}" if path else name)
    elif raw is None:
        return
    elif isinstance(raw, list) and any(isinstance(item, dict) for item in raw):
        for i, item in enumerate(raw):
            yield from _flat(item, f"{path}[{i}]")
    else:
        yield Key(path, raw, "1", "")


def _public(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _public(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_public(item) for item in value]
    return public(value) if isinstance(value, str) else value
