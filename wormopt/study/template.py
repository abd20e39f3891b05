# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Initial scene of each kind: every key with its meaning, as TOML with comments.

Required keys have the value of a packaged scene; all others are commented out, with their default
values.
"""

from __future__ import annotations

import json
import re
import textwrap
import tomllib
from collections.abc import Container, Iterator, Mapping
from types import NoneType
from typing import Any, get_args

import msgspec

from wormopt.kinds import KINDS
from wormopt.quantities import unit_of
from wormopt.study.given import Given, bare, default_of, describe, meaning
from wormopt.study.reference import taken
from wormopt.study.scene import packaged_scenes, times_of_scenes
from wormopt.study.toml import holds_tables, toml_value

_WIDTH = 100
_SWEEP = """

# Keys that `wormopt sweep` varies, and how; see docs/sweeps.md.
#[sweep]
#over."worm.load" = "1:10:10"  # for example; a key of this scene, and ten values or a list
#method = "grid"  # grid, zip, latin-hypercube or sobol
#points = 64  # number of points that the last two methods draw
#seed = 0
"""


def template(kind: str, schema_file: str) -> str:
    """Text of a scene of a kind; `schema_file` is its JSON Schema for editors."""
    raw = _example(kind)
    page = f"`wormopt help {kind}`"
    head = [
        f"#:schema {schema_file}",
        *_comment(f'A scene of kind "{kind}": {KINDS[kind].summary}.'),
        *_comment(f"Keys and results of this kind: {page}."),
        *_comment(
            "Keys behind a # have the value shown there (... is none); drop the # to change it."
        ),
        "",
    ]
    table, units = KINDS[kind].load(), raw.get("units", "dimensionless")
    body = _table(table, raw, "", units, None, table.refuses)
    return "\n".join([*head, *body]).rstrip() + _SWEEP


def _example(kind: str) -> dict[str, Any]:
    """Tables of the fastest, then shortest, packaged scene of a kind, untitled."""
    times, found = times_of_scenes(), []
    for name, path in packaged_scenes().items():
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        if raw["kind"] == kind and "file" not in raw.get("model", {}):
            found.append((times.get(name, 0), len(json.dumps(raw)), name, raw))
    raw = min(found)[-1] if found else {"schema": 1, "kind": kind}
    return {key: value for key, value in raw.items() if key != "title"}


def _table(
    table: type[msgspec.Struct],
    raw: Mapping[str, Any] | None,
    path: str,
    units: str,
    default: Given | None,
    refused: Container[str],
) -> Iterator[str]:
    """Keys of a table, then the tables in it; raw is None for a table that is commented out."""
    mark, below = ("#" if raw is None else ""), []
    config = table.__struct_config__
    if config.tag_field:
        yield f"{mark}{config.tag_field} = {toml_value(config.tag)}"
    for inside, field, tables in taken(table, path, refused):
        key = field.encode_name
        given, value = (raw or {}).get(key), default_of(field, default)
        if tables and (given is None or holds_tables(given)):
            below.append((inside, field, tables, given, value))
            continue
        assigned = (
            f"#{key} = {_shown(value)}" if given is None else f"{mark}{key} = {toml_value(given)}"
        )
        yield from _line(assigned, _meaning(field.type, units))
    for inside, field, tables, given, value in below:
        yield from _tables(inside, field, tables, given, units, value, refused)


def _tables(
    path: str,
    field: Any,
    tables: list[type[msgspec.Struct]],
    given: Any,
    units: str,
    default: Any,
    refused: Container[str],
) -> Iterator[str]:
    """The table or tables of a key: as given, or commented out."""
    default = default if len(tables) == 1 and type(default) is tables[0] else None
    listed = isinstance(given, list)
    words = _meaning(field.type, units)
    others = _choices(tables)
    if given is None:
        yield ""
        yield from _comment(f"{words}{f'; {others}' if others else ''}")
        yield f"#[{path}]"
        if not others:
            yield from _table(tables[0], None, path, units, default, refused)
        return
    for index, raw in enumerate(given if listed else [given]):
        yield ""
        if not index:
            yield from _comment(f"{words}{f'; {others}' if others else ''}")
        yield f"[[{path}]]" if listed else f"[{path}]"
        yield from _table(_meant(raw, tables), raw, path, units, default, refused)


def _meant(raw: Mapping[str, Any], tables: list[type[msgspec.Struct]]) -> type[msgspec.Struct]:
    """Type of a raw table, by its tag."""
    tag = raw.get(tables[0].__struct_config__.tag_field or "")
    return next((table for table in tables if table.__struct_config__.tag == tag), tables[0])


def _choices(tables: list[type[msgspec.Struct]]) -> str:
    if len(tables) == 1:
        return ""
    tags = " or ".join(toml_value(table.__struct_config__.tag) for table in tables)
    return f"{tables[0].__struct_config__.tag_field} = {tags}"


def _shown(value: Any) -> str:
    """Default value of a key; ... if there is none."""
    return "..." if value in (None, msgspec.NODEFAULT) else toml_value(msgspec.to_builtins(value))


def _meaning(kind: Any, units: str) -> str:
    """Meaning of a key in plain text, after its unit."""
    quantity, what = meaning(kind)
    what = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", what)
    what = re.sub(r"<sub>(.*?)</sub>", r"_\1", what)
    what = re.sub(r"<sup>(.*?)</sup>", r"^\1", what).replace("*", "").replace("`", "")
    unit = unit_of(quantity, units) if quantity else "1"
    words = describe(bare(kind)) if _is_choice(kind) else ""
    return "; ".join(part for part in (f"[{unit}] {what}" if unit != "1" else what, words) if part)


def _is_choice(kind: Any) -> bool:
    """Whether a key takes one of a few words, which are then listed."""
    kind = bare(kind)
    parts = [part for part in get_args(kind) if part is not NoneType]
    return len(parts) > 1 and all(isinstance(part, str) for part in parts)


def _line(key: str, words: str) -> Iterator[str]:
    """A key and its words: beside it if there is room, else above."""
    beside = f"{key}  # {words}"
    if not words or len(beside) <= _WIDTH:
        yield beside if words else key
        return
    yield from _comment(words)
    yield key


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="# ", subsequent_indent="# ")
