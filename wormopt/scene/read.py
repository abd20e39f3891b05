"""Raw TOML into typed tables, key by key, so that all faults of a scene are found at once."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec

from wormopt.errors import Fault
from wormopt.study.given import Given, meaning
from wormopt.units import bare_number, has_unit, to_number

T = TypeVar("T", bound=msgspec.Struct)
_fields = cache(msgspec.structs.fields)

_MANY_DEGREES = 1e9  # nobody means so many; a whole number may be too large to be turned
_WORDS: dict[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text in quotes",
}


def read_table(
    raw: Mapping[str, Any], table: type[T], path: str, units: str, faults: list[Fault]
) -> T | None:
    """Convert a raw table to a struct; every fault is added to `faults`, and gives None.

    `path` is the key path of the table, "" for the whole scene; `units` those of the scene, "SI"
    or not.
    """
    known = {item.name: item for item in _fields(table)}
    tag_key = table.__struct_config__.tag_field
    before = len(faults)
    faults += (
        (_join(path, key), _unknown(key, table, list(known)))
        for key in raw
        if key not in known and key != tag_key
    )
    values = {}
    for key, item in known.items():
        if key in raw:
            values[key] = _read_key(raw[key], item.type, _join(path, key), units, faults)
        elif item.required:
            faults.append((_join(path, key), f"missing; write {describe(item.type)}"))
    if len(faults) > before:
        return None
    made = msgspec.StructMeta.__call__(table, **values)  # read here, not by the class
    if isinstance(made, Given):
        faults += ((f"{path}.{key}" if path and key else path or key, w) for key, w in made.wrong())
    return made if len(faults) == before else None


def _read_key(raw: Any, kind: Any, path: str, units: str, faults: list[Fault]) -> Any:
    """Read a value, of which numbers may be written with a unit where the key has a quantity."""
    before, (quantity, _), given = len(faults), meaning(kind), raw
    if quantity:
        raw = _without_units(raw, quantity, path, units, faults)
    value = read_value(raw, kind, path, units, faults) if len(faults) == before else None
    if isinstance(given, str) and raw is not given and len(faults) > before:
        faults[-1] = (path, faults[-1][1].replace(_shown(raw), _shown(given), 1))  # with its unit
    bare = given if type(given) in (int, float) and not isinstance(given, str) else math.inf
    if quantity == "rad" and abs(bare) < _MANY_DEGREES and len(faults) > before:
        wrong: list[Fault] = []
        read_value(math.radians(raw), kind, path, units, wrong)
        faults[-1] = (path, faults[-1][1] + ("" if wrong else f', "{raw} deg" say'))
    return value


def _without_units(raw: Any, quantity: str, path: str, units: str, faults: list[Fault]) -> Any:
    if isinstance(raw, list):
        return [
            _without_units(item, quantity, f"{path}[{i}]", units, faults)
            for i, item in enumerate(raw)
        ]
    if not isinstance(raw, str) or not has_unit(raw):
        return raw
    try:
        return to_number(raw, quantity, units)
    except ValueError as error:
        faults.append((path, f"{_shown(raw)} {error}"))
        return raw


def read_value(raw: Any, kind: Any, path: str, units: str, faults: list[Fault]) -> Any:
    """Convert a raw value to a type; every fault is added to `faults`, and gives None."""
    kind = bare(kind)
    tables = tables_in(kind)
    if isinstance(raw, Given) and isinstance(raw, tuple(tables)):  # made in Python, checked there
        if raw.has_units and units != "SI":
            faults.append((path, 'was made with units; write units = "SI", or numbers alone'))
        return raw
    if isinstance(raw, Mapping) and tables:
        table = _chosen(raw, tables, path, faults)
        return table and read_table(raw, table, path, units, faults)
    listed = _listed_in(kind)
    if isinstance(raw, list) and listed is not None:
        if not _may_hold(kind, len(raw)):
            what = "1 entry is" if len(raw) == 1 else f"{len(raw)} entries are"
            faults.append((path, f"{what} not allowed; write {describe(kind)}"))
        return tuple(
            read_value(item, listed, f"{path}[{i}]", units, faults) for i, item in enumerate(raw)
        )
    keyed = _keyed_in(kind)
    if isinstance(raw, dict) and keyed is not None:
        return {
            name: read_value(item, keyed, f"{path}.{name}", units, faults)
            for name, item in raw.items()
        }
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        place = re.search(r"at `\$(.*)`$", str(error))
        indices = re.findall(r"\[(\d+)\]", place[1]) if place else []
        for index in indices:
            raw = raw[int(index)]
        path += "".join(f"[{index}]" for index in indices)
        meant = get_close_matches(raw, _words_in(kind), n=1) if isinstance(raw, str) else []
        hint = f"did you mean {_shown(meant[0])}? Else write" if meant else "write"
        if isinstance(raw, str) and has_unit(raw) and _holds_numbers(kind):
            faults.append((path, f"{_shown(raw)} has a unit, not taken here; {bare_number(raw)}"))
            return None
        faults.append((path, f"{_shown(raw)} is not allowed; {hint} {describe(kind)}"))
        return None


def _chosen(
    raw: Mapping[str, Any], tables: list[type[msgspec.Struct]], path: str, faults: list[Fault]
) -> type[msgspec.Struct] | None:
    """Pick the table a raw table is meant to be, by its tag key where there are several."""
    if len(tables) == 1:
        return tables[0]
    tag_key = tables[0].__struct_config__.tag_field or ""
    by_tag = {table.__struct_config__.tag: table for table in tables}
    tag = raw.get(tag_key)
    if isinstance(tag, str) and tag in by_tag:
        return by_tag[tag]
    what = f"{_shown(tag)} is not allowed" if tag_key in raw else "missing"
    faults.append((_join(path, tag_key), f"{what}; write {_one_of(list(by_tag))}"))
    return None


def describe(kind: Any) -> str:
    """Say in plain words what values a type of a scene field allows."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        words = [meta.description for meta in arguments[1:] if getattr(meta, "description", None)]
        return words[-1] if words else describe(arguments[0])
    if origin is Literal:
        return _one_of(list(arguments))
    if origin in (Union, UnionType):
        parts = [a for a in arguments if a is not NoneType and a not in tables_in(kind)]
        words = [*_tables(tables_in(kind)), *map(describe, parts)]
        again = f"a list of {_many(words[0])}"
        return ", or ".join(dict.fromkeys("a list of such" if w == again else w for w in words))
    if origin is dict:
        return "a table"
    if origin is tuple:
        return f"a list of {_many(describe(arguments[0]))}"
    return "".join(_tables(tables_in(kind))) or _WORDS[kind]


def _tables(tables: list[type[msgspec.Struct]]) -> list[str]:
    """Tell one table by its keys, several by the key that parts them."""
    if len(tables) < 2:
        return [f"a table with {', '.join(table.__struct_fields__)}" for table in tables]
    tags = [table.__struct_config__.tag for table in tables]
    return [f"a table with {tables[0].__struct_config__.tag_field} = {_one_of(tags)}"]


def _many(words: str) -> str:
    """Several of what words tell, where they begin as "a finite number above 0" does."""
    return re.sub(r"^an? ((?:(?:finite|whole) )?)(number|list|angle|table)\b", r"\1\2s", words)


def _holds_numbers(kind: Any) -> bool:
    """Whether numbers may stand in a value of a type."""
    parts = get_args(kind)
    return kind is float or any(_holds_numbers(part) for part in parts if part is not Ellipsis)


def bare(kind: Any) -> Any:
    """Type without what `wormopt.scene.types.says` says of it."""
    if get_origin(kind) is not Annotated:
        return kind
    inner, *metas = get_args(kind)
    kept = [meta for meta in metas if not meta.extra]
    return Annotated[inner, *kept] if kept else inner


def tables_in(kind: Any) -> list[type[msgspec.Struct]]:
    """Tables that a value of a type may be."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return [kind]
    if get_origin(kind) in (Union, UnionType):
        return [table for part in get_args(kind) for table in tables_in(part)]
    return []


def _words_in(kind: Any) -> list[str]:
    """Texts that a type names one by one."""
    if get_origin(kind) is Literal:
        return [word for word in get_args(kind) if isinstance(word, str)]
    return [word for part in get_args(kind) for word in _words_in(part)]


def _keyed_in(kind: Any) -> Any:
    """Type of the values of a table with free keys; None for others, and where all is allowed."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    values = get_args(kind)[1] if get_origin(kind) is dict else Any
    return None if values is Any else values


def _may_hold(kind: Any, count: int) -> bool:
    """Whether a list of so many entries is of a type that may bound their number."""
    metas = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    bounds = [meta for meta in metas if isinstance(meta, msgspec.Meta)]
    return all((m.min_length or 0) <= count <= (m.max_length or count) for m in bounds)


def _listed_in(kind: Any) -> Any:
    """Type of the tables in a list, None where there is no list of tables."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else [kind]
    for part in parts:
        if get_origin(part) is tuple and tables_in(get_args(part)[0]):
            return get_args(part)[0]
    return None


def _unknown(key: str, table: type[msgspec.Struct], known: list[str]) -> str:
    config = table.__struct_config__
    where = f' with {config.tag_field} = "{config.tag}"' if config.tag_field else ""
    close = get_close_matches(key, known, n=1)
    below = [] if close else list(_paths_to(key, table))
    if close or len(below) == 1:
        return f"unknown key{where}; did you mean {(close or below)[0]}?"
    return f"unknown key{where}; allowed here: {', '.join(known)}"


def _paths_to(key: str, table: type[msgspec.Struct], path: str = "") -> Iterator[str]:
    """Key paths in the single tables below a table that end with a key."""
    for item in msgspec.structs.fields(table):
        for part in tables_in(bare(item.type)):
            inside = _join(path, item.name)
            if key in part.__struct_fields__:
                yield _join(inside, key)
            yield from _paths_to(key, part, inside)


def _one_of(values: list[Any]) -> str:
    shown = [_shown(value) for value in values]
    return " or ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def _shown(value: Any) -> str:
    """Write a value as the scene does, cut short where it is long."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = f'"{value}"'
    elif isinstance(value, Mapping):
        text = "a table"
    else:
        text = _digits(value)
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= 60 else text[:57] + "..."


def _digits(value: Any) -> str:
    try:
        return repr(value)
    except ValueError:  # Python refuses to write out whole numbers of thousands of digits
        return "so large a number"


def _join(path: str, key: str) -> str:
    """Key path, in which a key that TOML has in quotes is in quotes."""
    key = key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _shown(key)
    return f"{path}.{key}" if path else key
