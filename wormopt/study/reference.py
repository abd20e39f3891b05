# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
"""Reference of a kind of scene: a page and a JSON Schema.

Both are made from the tables into which scenes are read, so that they are always up to date.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Container, Iterator
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import msgspec

from wormopt.kinds import KINDS
from wormopt.quantities import WITH_UNIT, unit_of
from wormopt.study.given import Given, bare, default_of, describe, meaning, tables_in
from wormopt.study.swept import Swept

_COMMON = ("schema", "kind", "title", "units")


def schema(kind: str) -> dict[str, Any]:
    """JSON Schema of the scenes of a kind, with the meaning of every key."""
    table = KINDS[kind].load()
    (found, sweep), parts = msgspec.json.schema_components(
        [table, Swept], ref_template="#/$defs/{name}"
    )
    about = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$comment": f"made by wormopt schema {kind}",
    }
    found = about | found
    parts[table.__name__]["properties"]["sweep"] = sweep
    for part in parts.values():
        part["description"] = _without_python(inspect.cleandoc(part.get("description", "")))
    for part in {*tables_below(table), Swept}:
        properties = parts[part.__name__]["properties"]
        for field in msgspec.structs.fields(part):
            quantity, what = meaning(field.type)
            if what:
                properties[field.encode_name]["description"] = what
            if quantity:
                described = _or_with_unit(properties[field.encode_name], quantity)
                properties[field.encode_name] = described | {"quantity": quantity}
    parts[table.__name__] = _taken(parts, table, "", table.refuses)
    return found | {"$defs": parts}


def _taken(
    parts: dict[str, dict[str, Any]],
    table: type[msgspec.Struct],
    path: str,
    refused: Container[str],
    default: Given | None = None,
) -> dict[str, Any]:
    """Schema of the keys of a table that a kind takes, with the values of `default`."""
    found, fields = parts[table.__name__], table.__struct_encode_fields__
    properties = {name: node for name, node in found["properties"].items() if name not in fields}
    for key, field, below in taken(table, path, refused):
        name, value = field.encode_name, default_of(field, default)
        gone = {part.__name__ for part in tables_in(single(field.type)) if part not in below}
        node = _pruned(found["properties"][name], gone)
        if default is not None:
            node |= {"default": msgspec.json.decode(msgspec.json.encode(value))}
        for part in below:
            shared = parts[part.__name__] = _taken(parts, part, key, refused)
            if type(value) is part and not part.__struct_config__.tag_field:
                own = _taken(parts, part, key, refused, value)
                node = node if own == shared else _in_place(node, part.__name__, own)
        properties[name] = node
    return found | {"properties": properties} | ({} if default is None else {"required": []})


def _in_place(node: dict[str, Any], name: str, own: dict[str, Any]) -> dict[str, Any]:
    """Schema of a key with that of its table in place of the reference to `name`."""
    if node.get("$ref") == f"#/$defs/{name}":
        return own | {key: node[key] for key in node if key != "$ref"}
    return {
        key: [_in_place(one, name, own) for one in part] if key == "anyOf" else part
        for key, part in node.items()
    }


def _pruned(node: Any, gone: Container[str]) -> Any:
    """A node of a schema without references to some tables."""

    def stays(item: Any) -> bool:
        place = item.get("$ref", "") if isinstance(item, dict) else item
        return not isinstance(place, str) or place.removeprefix("#/$defs/") not in gone

    if isinstance(node, list):
        return [_pruned(item, gone) for item in node if stays(item)]
    if isinstance(node, dict):
        return {key: _pruned(item, gone) for key, item in node.items() if stays(item)}
    return node


def _or_with_unit(node: dict[str, Any], quantity: str) -> dict[str, Any]:
    """Allow texts with a unit in place of numbers, if the quantity has a unit."""
    if unit_of(quantity, "SI") == "1" and quantity != "share":
        return node
    if node.get("type") == "number":
        bounds = {key: node[key] for key in node if key not in ("description", "default")}
        kept = {key: node[key] for key in node if key not in bounds}
        return kept | {"anyOf": [bounds, {"type": "string", "pattern": WITH_UNIT}]}
    inside: dict[str, Any] = (
        {"items": _or_with_unit(node["items"], quantity)} if "items" in node else {}
    )
    if "anyOf" in node:
        inside["anyOf"] = [_or_with_unit(one, quantity) for one in node["anyOf"]]
    return node | inside


def page(kind: str) -> str:
    """Reference of a kind in Markdown: keys, scalars and variables."""
    table = KINDS[kind].load()
    parts = [
        f"# Scenes of kind `{kind}`",
        f"{KINDS[kind].summary[0].upper()}{KINDS[kind].summary[1:]}.",
        *_prose(table),
        "`schema`, `kind`, `title`, `units` and what holds for all scenes: [scenes](../scenes.md).",
        "## Keys",
        "\n".join(_keys(table, "", table.refuses)),
        *_sections(table, "", None, table.refuses),
    ]
    if table.scalars:
        rows = [_row(f"`{name}`", _words(q), what) for name, (q, what) in table.scalars.items()]
        head = ["| scalar | quantity | meaning |", "|---|---|---|"]
        parts += ["## Scalars", "\n".join([*head, *rows])]
    if table.variables:
        rows = [
            _row(f"`{name}`", _words(q), ", ".join(dims), what)
            for name, (q, dims, what) in table.variables.items()
        ]
        head = ["| variable | quantity | over | meaning |", "|---|---|---|---|"]
        parts += ["## Variables", "\n".join([*head, *rows])]
    return "\n\n".join(parts) + "\n"


def quantity_of(table: type[msgspec.Struct], key: str) -> str:
    """Quantity of a dotted key, "" if it has none."""
    inside, quantity = [table], ""
    for name in (part for part in re.split(r"[.\[\]]+", key) if part and not part.isdecimal()):
        fields = [f for t in inside for f in msgspec.structs.fields(t) if f.encode_name == name]
        quantity = next((found for f in fields if (found := meaning(f.type)[0])), "")
        inside = [part for field in fields for part in tables_in(single(field.type))]
    return quantity


def _prose(table: type) -> list[str]:
    """Paragraphs of a docstring after its first line."""
    return [part for part in _without_python(inspect.getdoc(table) or "").split("\n\n")[1:] if part]


def _without_python(docstring: str) -> str:
    """A docstring without the parts for Python, which repeat the keys."""
    return docstring.partition("\n\nParameters\n----------\n")[0]


def taken(
    table: type[msgspec.Struct], path: str, refused: Container[str]
) -> Iterator[tuple[str, msgspec.structs.FieldInfo, list[type[Given]]]]:
    """Yield the keys of a table that a kind takes, with their fields and the tables in them."""
    for field in msgspec.structs.fields(table):
        key = f"{path}.{field.encode_name}" if path else field.encode_name
        if key not in refused:
            parts = tables_in(single(field.type))
            yield (
                key,
                field,
                [p for p in parts if f"{key}.{p.__struct_config__.tag}" not in refused],
            )


def _keys(
    table: type[msgspec.Struct], path: str, refused: Container[str], default: Given | None = None
) -> Iterator[str]:
    """Table of the keys of a table; `default` has the values of the keys that are left out."""
    yield "| key | value | quantity | default | meaning |"
    yield "|---|---|---|---|---|"
    for _, field, _ in taken(table, path, refused):
        if field.encode_name in _COMMON and hasattr(table, "members"):
            continue
        quantity, what = meaning(field.type)
        value = _default(field, default)
        yield _row(f"`{field.encode_name}`", _of(field), _words(quantity), value, what)


def _row(*cells: str) -> str:
    """Row of a table; bars in cells are escaped."""
    escaped = (re.sub(r"(?<!\\)[|]", r"\\|", cell) for cell in cells)
    return f"| {' | '.join(escaped)} |"


def _of(field: msgspec.structs.FieldInfo) -> str:
    kind = bare(field.type)
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    numbers = [part for part in parts if part is not NoneType and not tables_in(single(part))]
    words = [describe(Union[tuple(numbers)])] if numbers else []  # noqa: UP007
    tables = [bare(part) for part in parts if tables_in(single(part))]
    listed = [get_origin(part) is tuple for part in tables]
    words += ["a table"] if False in listed else []
    words += ["a list of tables"] if True in listed else []
    return re.sub(r'("[^"]*")', r"`\1`", ", or ".join(words))


def _default(field: msgspec.structs.FieldInfo, table: Given | None) -> str:
    if field.required and table is None:
        return "required"
    value = default_of(field, table)
    if value is None or isinstance(value, msgspec.Struct):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{_listed(value)}`"


def _listed(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_listed, value))}]"
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:g}" if isinstance(value, int | float) else "{}"


def _sections(
    table: type[msgspec.Struct], path: str, default: Given | None, refused: Container[str]
) -> Iterator[str]:
    """A section for every table below a table, in the order of its keys."""
    for key, field, parts in taken(table, path, refused):
        for part in parts:
            inner = default_of(field, default)
            inner = inner if type(inner) is part else None
            config = part.__struct_config__
            tagged = f' with `{config.tag_field} = "{config.tag}"`' if config.tag_field else ""
            yield f"### `[{key}]`{tagged}"
            yield (inspect.getdoc(part) or "").split("\n\n")[0].replace("\n", " ")
            yield from _prose(part)
            if part.__struct_fields__:
                yield "\n".join(_keys(part, key, refused, inner))
            yield from _sections(part, key, inner, refused)


def single(kind: Any) -> Any:
    """Type of an entry if there is a list of tables, the type itself otherwise."""
    kind = bare(kind)
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    entries = [get_args(p)[0] if get_origin(p) is tuple else p for p in parts if p is not NoneType]
    tables = [part for entry in entries for part in tables_in(bare(entry))]
    return Union[tuple(tables)] if tables else kind  # noqa: UP007


def tables_below(table: type[msgspec.Struct]) -> Iterator[type[msgspec.Struct]]:
    """A table and all tables in it."""
    yield table
    for field in msgspec.structs.fields(table):
        for part in tables_in(single(field.type)):
            yield from tables_below(part)


def _words(quantity: str) -> str:
    return quantity.replace("_", " ")
