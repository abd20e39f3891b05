# pyright: strict, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Tables of user input, in a scene or from Python: declared once, read and checked in one way.

A `Given` is a table of a scene whose fields say their quantity, meaning, bounds and default:

>>> class Spring(Given):
...     "A spring."
...
...     length: float = positive("length", "length without load")
...     stiffness: float = positive("stiffness", "force per elongation", default=100.0)
>>> Spring(length="60 mm").length
0.06
>>> Spring(length=-1)
Traceback (most recent call last):
wormopt.study.given.RefusedError: Spring: length: -1 is not allowed; write a finite number above 0
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from inspect import cleandoc
from pathlib import Path
from textwrap import fill, indent
from types import NoneType, SimpleNamespace, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
from msgspec import NODEFAULT, Meta, Struct, StructMeta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.quantities import ABSOLUTE, UNITS, bare_number, has_unit, to_number
from wormopt.study.toml import Overrides, as_toml, override

_LARGEST = sys.float_info.max
_SMALL, _LARGE = 1e-30, 1e30
# Other names of keys, former ones among them, and those meant: the first that a table has.
_MEANT = {
    "aim": ("objective",),
    "course": ("time", "route", "start"),
    "duration": ("end",),
    "force": ("actuator_force",),
    "grid": ("mesh",),
    "inner": ("inner_radius",),
    "modulus": ("youngs_modulus",),
    "outer": ("outer_radius",),
    "pace": ("rate",),
    "points": ("samples",),
    "rate": ("frequency",),
    "rates": ("frequencies",),
    "time": ("end",),
    "tube": ("pipe",),
}


class RefusedError(SceneError, ArgumentError):
    """Input from Python is invalid: all faults, key by key."""


def _parameters(table: Any) -> str:
    """Section of a docstring with the meaning of each key of a table."""
    text = "\n\nParameters\n----------"
    for field in _fields(table):
        optional = "" if field.required else ", optional"
        text += f"\n{field.name} : {describe(field.type)}{optional}\n"
        text += indent(fill(meaning(field.type)[1], 92), " " * 4)
    return text


def check_quantity(quantity: str) -> None:
    """Raise TypeError for a quantity without a unit, while the class is made."""
    if quantity and quantity not in UNITS and quantity not in ABSOLUTE:
        raise TypeError(f"{quantity!r} is not a quantity; wormopt.quantities.UNITS lists them")


def says(quantity: str, meaning: str, usual: tuple[float, float] | None = None) -> Meta:
    """Meaning of a key, in Markdown, and its quantity: a name of `wormopt.quantities`, or "".

    `usual`: sizes in SI without a warning, if not those of the quantity.
    """
    return Meta(extra={"quantity": quantity, "meaning": meaning, "usual": usual})


def said_of(kind: Any) -> dict[str, Any]:
    """The declaration `says` in the type of a key; empty if there is none."""
    if get_origin(kind) is not Annotated:
        return {}
    declared = [meta.extra for meta in get_args(kind)[1:] if meta.extra]
    return declared[-1] if declared else {}


def meaning(kind: Any) -> tuple[str, str]:
    """Quantity and meaning of a key, by its type; "" if there is none."""
    declared = said_of(kind)
    return declared.get("quantity", ""), declared.get("meaning", "")


def default_of(field: Any, table: Given | None = None) -> Any:
    """Default value of a key, NODEFAULT if it is required.

    `table` is the default of the table with the key, whose values replace those of its class.
    """
    if table is not None:
        return getattr(table, field.name)
    made = field.default_factory
    return field.default if made is NODEFAULT else made()


class Key(NamedTuple):
    """Declaration of a field."""

    quantity: str
    meaning: str
    default: Any
    bounds: Mapping[str, Any] = {}  # of msgspec.Meta
    words: str = ""  # description of allowed values in messages
    per: str = ""  # parts for which a list has one entry each
    usual: tuple[float, float] | None = None  # see `says`

    def typed(self, kind: Any) -> Any:
        """Type of the field with its declaration, for the reader and for schemas."""
        words = [Meta(description=self.words)] if self.words else []
        declared = says(self.quantity, self.meaning, self.usual).extra or {}
        return Annotated[self._bounded(kind), *words, Meta(extra={**declared, "per": self.per})]

    def _bounded(self, kind: Any) -> Any:
        if kind in (int, float):
            return Annotated[kind, Meta(**self.bounds)] if self.bounds else kind
        if get_origin(kind) in (Union, UnionType):
            return Union[tuple(map(self._bounded, get_args(kind)))]  # noqa: UP007
        if get_origin(kind) is tuple and self.bounds:
            listed = tuple[self._bounded(get_args(kind)[0]), ...]
            ends = Meta(min_length=2, max_length=2)
            return Annotated[listed, ends] if self.per == "ends" else listed
        return kind


def number(
    quantity: str,
    meaning: str,
    *,
    default: Any = NODEFAULT,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    per: str = "",
    usual: tuple[float, float] | None = None,
) -> Any:
    """A number within bounds.

    With `per` a list is allowed too, with one number for each of these parts (such as "links");
    with ``per="ends"`` a range [smallest, largest].
    """
    bounds: dict[str, float] = {"gt": above} if above is not None else {}
    bounds |= {"ge": -_LARGEST if least is None else least} if above is None else {}
    bounds |= {"lt": below} if below is not None else {"le": _LARGEST if most is None else most}
    words = _words(above, least, below, most)
    if per:
        part = "mass" if per == "masses" else per.removesuffix("s")
        listed = f"a list of such numbers, one per {part}"
        words += f", or {'a range [smallest, largest]' if per == 'ends' else listed}"
    return Key(quantity, meaning, default, bounds, words, per, usual)


def _words(
    above: float | None, least: float | None, below: float | None, most: float | None
) -> str:
    """Describe the numbers that bounds allow."""
    if least is not None and most is not None:
        return f"a number from {least:g} to {most:g}"
    if least is not None and below is not None:
        return f"a number from {least:g} to below {below:g}"
    low = [] if above is None else [f"above {above:g}"]
    high = [] if below is None else [f"below {below:g}"]
    high += [] if most is None else [f"at most {most:g}"]
    if low or high:
        return ("a number " if high else "a finite number ") + " and ".join(low + high)
    return "a finite number" if least is None else f"a finite number, {least:g} or above"


def positive(
    quantity: str,
    meaning: str,
    *,
    default: Any = NODEFAULT,
    per: str = "",
    usual: tuple[float, float] | None = None,
) -> Any:
    """A number above 0."""
    return number(quantity, meaning, default=default, above=0, per=per, usual=usual)


def whole(
    low: int, high: int, meaning: str, *, quantity: str = "count", default: Any = NODEFAULT
) -> Any:
    """A whole number from `low` to `high`."""
    words = f"a whole number from {low} to {high}"
    return Key(quantity, meaning, default, {"ge": low, "le": high}, words)


def entry(meaning: str, *, quantity: str = "", default: Any = NODEFAULT, per: str = "") -> Any:
    """A key with the values of its annotation: a choice, a flag, text, a list, a table."""
    return Key(quantity, meaning, default, per=per)


def words_of_pictures(pictures: Mapping[str, str | tuple[str, str]]) -> str:
    """Meaning of the key `want`: what each picture of a kind shows."""
    shown: dict[str, list[str]] = {}
    for name, said in pictures.items():
        meaning = said if isinstance(said, str) else said[0]
        shown.setdefault(meaning, []).append(f"`{name}`")
    return "; ".join(f"{', '.join(names)}: {meaning}" for meaning, names in shown.items())


@dataclass_transform(
    frozen_default=True,
    kw_only_default=True,
    field_specifiers=(number, positive, whole, entry, msgspec.field),
)
class GivenMeta(StructMeta):
    """Makes types from declarations of fields, and reads arguments of the class."""

    def __new__(
        mcs,
        name: str,
        bases: tuple[type, ...],
        space: dict[str, Any],
        *,
        kind: str = "",
        **config: Any,
    ) -> Any:
        declared = {field: one for field, one in space.items() if isinstance(one, Key)}
        for field in declared:
            for base in bases:
                if hasattr(base, field) and field not in getattr(base, "__struct_fields__", ()):
                    raise TypeError(f"{name}.{field} is a name of {base.__name__}; choose another")
        notes = space.get("__annotations__", {})
        for field in notes:
            if hasattr(space.get(field), "__set_name__"):
                raise TypeError(f"{name}.{field} is a key and a member")
        own = SimpleNamespace(__annotations__={field: notes[field] for field in declared})
        scope = {**vars(sys.modules[space["__module__"]])}
        types = get_type_hints(own, scope, include_extras=True)
        for field, one in declared.items():
            check_quantity(one.quantity)
            notes[field] = one.typed(types[field])
            table = isinstance(one.default, type)
            space[field] = msgspec.field(default_factory=one.default) if table else one.default
            if one.default is NODEFAULT:
                del space[field]
        if kind:  # of a study
            notes["kind"], space["kind"] = Literal[kind], kind
            if pictures := space.get("pictures", {}):
                wanted = Key("", words_of_pictures(pictures), ())
                notes["want"] = wanted.typed(tuple[Literal[tuple(pictures)], ...])
                space["want"] = ()
        config.setdefault("kw_only", True)
        made: Any = super().__new__(
            mcs,
            name,
            bases,
            space,
            frozen=True,
            dict=True,
            forbid_unknown_fields=True,
            **config,
        )
        made.check_class()
        # Python 3.13 removes the indentation of docstrings itself
        text = cleandoc(made.__doc__ or "")
        before, examples, shown = text.partition("\n\nExamples\n--------\n")
        if examples:  # for use from Python
            made.__doc__ = f"{before}{_parameters(made)}{examples}{shown}"
        return made

    if not TYPE_CHECKING:  # type checkers know the fields

        def __call__(cls, /, *values: Any, **given: Any) -> Any:  # noqa: N805
            names = cls.__match_args__[: len(values)]  # none, unless kw_only=False
            if len(names) < len(values) or given.keys() & set(names):
                known = ", ".join(f"{name}=..." for name in cls.__struct_fields__)
                raise ArgumentError(f"{cls.__name__}: name each argument once, as in {known}")
            return cls.made(dict(zip(names, values, strict=True)) | given)


class Given(Struct, metaclass=GivenMeta):
    """Base of user input: immutable, compared by its fields, checked on creation."""

    units_of_texts: ClassVar[str] = "SI"
    """Units of texts such as "60 mm" in a table made from Python."""

    @classmethod
    def made(cls, given: Mapping[str, Any]) -> Self:
        """Make one from keys and values; RefusedError lists all faults."""
        optional = {f.encode_name for f in _fields(cls) if f.default is None}
        raw = {k: as_toml(v) for k, v in given.items() if v is not None or k not in optional}
        faults: list[Fault] = []
        found = read_table(raw, cls, "", raw.get("units", cls.units_of_texts), faults)
        if found is None or faults:
            raise RefusedError(cls.__name__, faults)
        vars(found)["_has_units"] = _has_units(list(raw.values()))
        return found

    @property
    def has_units(self) -> bool:
        """Whether Python code gave texts with units."""
        return vars(self).get("_has_units", False)

    @classmethod
    def check_class(cls) -> None:
        """Raise TypeError for wrong declarations of a class, on its creation."""

    @classmethod
    def of_checked(cls, fields: Mapping[str, Any]) -> Self:
        """Make one from fields that were checked before."""
        return StructMeta.__call__(cls, **fields)

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of links, masses and other parts, for lists with one entry for each."""
        return {}

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield faults between keys of this table: key and message."""
        yield from ()

    def wrong(self) -> Iterator[Fault]:
        """Yield faults between keys that are valid individually."""
        extreme = [
            fault
            for name in self.__struct_fields__
            if not isinstance(value := getattr(self, name), Given)
            for fault in _extreme_numbers(value, name)
        ]
        yield from extreme or list(_wrong_lists(self, self.counts, "")) or self.faults_of_keys()

    @property
    def facts(self) -> dict[str, Any]:
        """Entries of trust reports about the table, besides results."""
        below = (getattr(self, name) for name in self.__struct_fields__)
        tables = [table for table in below if isinstance(table, Given)]
        return {key: fact for table in tables for key, fact in table.facts.items()}

    def file_warnings(self, folder: Path, units: str) -> Iterator[str]:
        """Yield warnings about the files that the table and tables in it name."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            for table in value if isinstance(value, tuple) else (value,):
                if isinstance(table, Given):
                    yield from table.file_warnings(folder, units)

    def vary(self, *changes: Overrides, **tables: Any) -> Self:
        """Make the same with other keys, which may be dotted: ``vary({"film.depth": "5 mm"})``."""
        raw = plain(self)
        faults = [fault for change in (*changes, tables) for fault in override(raw, change)]
        if faults:
            raise RefusedError(type(self).__name__, faults)
        varied = type(self).made(raw)
        vars(varied)["_has_units"] = self.has_units or varied.has_units
        return varied

    def __reduce__(self) -> Any:  # only fields are pickled: caches are dropped
        fields = {name: getattr(self, name) for name in self.__struct_fields__}
        return type(self).of_checked, (fields,)


def _has_units(value: Any) -> bool:
    if isinstance(value, list | dict):
        return any(map(_has_units, value.values() if isinstance(value, dict) else value))
    return value.has_units if isinstance(value, Given) else (
        isinstance(value, str) and has_unit(value)
    )  # fmt: skip


def plain(value: Any) -> Any:
    """Input as tables, lists and numbers, as in a TOML file."""
    if isinstance(value, Struct):
        config = value.__struct_config__
        tag = {config.tag_field: config.tag} if config.tag_field else {}
        found = {name: plain(getattr(value, name)) for name in value.__struct_fields__}
        return tag | {name: item for name, item in found.items() if item is not None}
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def _wrong_lists(made: Any, counts: Mapping[str, int], path: str) -> Iterator[Fault]:
    """Yield lists whose length differs from the number of parts, in a table and below it."""
    for field in _fields(type(made)) if counts else ():
        value, name = getattr(made, field.name), f"{path}.{field.name}" if path else field.name
        things: Any = said_of(field.type).get("per", "")
        if things in counts:
            yield from wrong_count(name, value, counts[things], things)
        if isinstance(value, Given) and not value.counts.keys() & counts.keys():
            yield from _wrong_lists(value, counts, name)


def _extreme_numbers(value: object, key: str = "") -> Iterator[Fault]:
    """Yield a fault for each number so extreme that products of a few of them overflow."""
    if isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _extreme_numbers(item, f"{key}[{index}]")
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from _extreme_numbers(item, f"{key}.{name}")
    elif isinstance(value, float) and not (value == 0.0 or _SMALL <= abs(value) <= _LARGE):
        if not math.isfinite(value):
            yield key, f"{value} is not allowed; write a finite number"
            return
        size = "small" if abs(value) < 1 else "large"
        yield (
            key,
            f"{value:g} is too {size} for computing; choose units in which it is closer to 1",
        )


def wrong_count(
    key: str,
    value: object,
    count: int,
    things: Literal["links", "masses", "joints"],
    entry: Literal["number", "table"] = "number",
) -> Iterator[Fault]:
    """Yield a fault unless a list has one entry per link or per mass.

    Other values than lists pass.
    """
    if isinstance(value, tuple) and len(value) != count:
        yield (
            key,
            (
                f"{_entries(len(value))} for {count} {things}; write one {entry} for all {things}, "
                f"or a list of {count}"
            ),
        )


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"


# -- the reader: raw TOML into tables, key by key, so that all faults are found at once ------------

T = TypeVar("T", bound=Given)
_fields = cache(msgspec.structs.fields)

_MANY_DEGREES = 1e9  # not intended; a whole number may be too large to convert
_WORDS: dict[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text in quotes",
}


def read_table(
    raw: Mapping[str, Any], table: type[T], path: str, units: str, faults: list[Fault]
) -> T | None:
    """Convert a raw table to a struct; every fault is added to `faults`, and returns None.

    `path` is the key path of the table, "" for the whole scene; `units`: "SI" or other units of
    the scene.
    """
    known = {item.name: item for item in _fields(table)}
    tag_key = table.__struct_config__.tag_field
    before = len(faults)
    faults += (
        (_join(path, key), _unknown(key, raw[key], table, list(known)))
        for key in raw
        if key not in known and key != tag_key
    )
    values = {}
    for key, item in known.items():
        if key in raw:
            given = _completed(raw[key], default_of(item))
            values[key] = _read_key(given, item.type, _join(path, key), units, faults)
        elif item.required:
            faults.append((_join(path, key), f"missing; write {describe(item.type)}"))
    if len(faults) > before:
        return None
    made = table.of_checked(values)
    faults += ((f"{path}.{key}" if path and key else path or key, w) for key, w in made.wrong())
    return made if len(faults) == before else None


def _completed(raw: Any, default: Any) -> Any:
    """A raw table with the keys that it lacks from the default of its key, unless it has kinds."""
    if not isinstance(raw, Mapping) or not isinstance(default, Given):
        return raw
    return raw if default.__struct_config__.tag_field else {**plain(default), **raw}


def _read_key(raw: Any, kind: Any, path: str, units: str, faults: list[Fault]) -> Any:
    """Read a value; its numbers may have units if the key has a quantity."""
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
        faults[-1] = (path, faults[-1][1] + ("" if wrong else f', for example "{raw} deg"'))
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
    """Convert a raw value to a type; every fault is added to `faults`, and returns None."""
    kind, given = bare(kind), raw
    tables = tables_in(kind)
    if isinstance(given, Given):  # made and checked in Python
        if given.has_units and units != "SI":
            faults.append((path, 'was made with units; write units = "SI", or bare numbers'))
        if isinstance(given, tuple(tables)):
            return given
        if any(issubclass(table, type(given)) for table in tables):
            raw = plain(given)  # of a base of the table
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
        allowed = describe(kind)
        meant = _meant(raw, _words_in(kind)) if isinstance(raw, str) else ""
        hint = f"did you mean {meant}? Otherwise write" if meant not in ("", allowed) else "write"
        if isinstance(raw, str) and has_unit(raw) and _holds_numbers(kind):
            faults.append((path, f"{_shown(raw)} has a unit, not allowed here; {bare_number(raw)}"))
            return None
        faults.append((path, f"{_shown(raw)} is not allowed; {hint} {allowed}"))
        return None


def _meant(raw: str, words: Iterable[str]) -> str:
    """Suggest one of some words, in any letter case, or a list of the word itself; "" for none."""
    folded = {word.casefold(): word for word in words}
    if raw in folded.values():
        return f"[{_shown(raw)}]"
    close = get_close_matches(raw.casefold(), folded, n=1)
    return _shown(folded[close[0]]) if close else ""


def _chosen(
    raw: Mapping[str, Any], tables: list[type[Given]], path: str, faults: list[Fault]
) -> type[Given] | None:
    """Select the type of a raw table, by its tag key if it has one."""
    tag_key = tables[0].__struct_config__.tag_field or ""
    by_tag = {table.__struct_config__.tag: table for table in tables}
    if len(tables) == 1 and not tag_key:
        return tables[0]
    tag = raw.get(tag_key)
    if isinstance(tag, str) and tag in by_tag:
        return by_tag[tag]
    what = f"{_shown(tag)} is not allowed" if tag_key in raw else "missing"
    faults.append((_join(path, tag_key), f"{what}; write {_one_of(list(by_tag))}"))
    return None


def describe(kind: Any) -> str:
    """Describe the values that a type of a scene field allows."""
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


def _tables(tables: list[type[Given]]) -> list[str]:
    """Describe one table by its keys, several by the key that distinguishes them."""
    if len(tables) < 2:
        return [f"a table with {', '.join(table.__struct_fields__)}" for table in tables]
    tags = [table.__struct_config__.tag for table in tables]
    return [f"a table with {tables[0].__struct_config__.tag_field} = {_one_of(tags)}"]


def _many(words: str) -> str:
    """Plural of words that begin as "a finite number above 0" does."""
    return re.sub(r"^an? ((?:(?:finite|whole) )?)(number|list|angle|table)\b", r"\1\2s", words)


def _holds_numbers(kind: Any) -> bool:
    """Whether a value of a type may contain numbers."""
    parts = get_args(kind)
    return kind is float or any(_holds_numbers(part) for part in parts if part is not Ellipsis)


def bare(kind: Any) -> Any:
    """Type without the declaration of `wormopt.study.types.says`."""
    if get_origin(kind) is not Annotated:
        return kind
    inner, *metas = get_args(kind)
    kept = [meta for meta in metas if not meta.extra]
    return Annotated[inner, *kept] if kept else inner


def tables_in(kind: Any) -> list[type[Given]]:
    """Tables among the values of a type."""
    if isinstance(kind, type) and issubclass(kind, Given):
        return [kind]
    if get_origin(kind) in (Union, UnionType):
        return [table for part in get_args(kind) for table in tables_in(part)]
    return []


def _words_in(kind: Any) -> list[str]:
    """Texts that a type lists."""
    if get_origin(kind) is Literal:
        return [word for word in get_args(kind) if isinstance(word, str)]
    return [word for part in get_args(kind) for word in _words_in(part)]


def _keyed_in(kind: Any) -> Any:
    """Type of the values of a table with free keys; None for others, and if all is allowed."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    values = get_args(kind)[1] if get_origin(kind) is dict else Any
    return None if values is Any else values


def _may_hold(kind: Any, count: int) -> bool:
    """Whether a list of this length is of a type that may bound its length."""
    metas = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    bounds = [meta for meta in metas if isinstance(meta, msgspec.Meta)]
    return all((m.min_length or 0) <= count <= (m.max_length or count) for m in bounds)


def _listed_in(kind: Any) -> Any:
    """Type of the tables in a list, None for other types."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else [kind]
    for part in parts:
        if get_origin(part) is tuple and tables_in(get_args(part)[0]):
            return get_args(part)[0]
    return None


def _unknown(key: str, value: Any, table: type[Given], known: list[str]) -> str:
    config = table.__struct_config__
    where = f' with {config.tag_field} = "{config.tag}"' if config.tag_field else ""
    near = [new for new in _MEANT.get(key, ()) if new in known]
    if isinstance(value, Mapping):  # the table that has its keys
        has = {path.split(".")[0] for name in value for path in _paths_to(name, table)}
        near.sort(key=lambda new: new not in has)
    near = near or get_close_matches(key, known, n=1)
    below = [] if near else list(dict.fromkeys(_paths_to(key, table)))
    if near or len(below) == 1:
        return f"unknown key{where}; did you mean {(near or below)[0]}?"
    return f"unknown key{where}; allowed here: {', '.join(known)}"


def _paths_to(key: str, table: type[Given], path: str = "") -> Iterator[str]:
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
    """Format a value as in the scene, shortened if long."""
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
    except ValueError:  # Python refuses to format integers of thousands of digits
        return "so large a number"


def _join(path: str, key: str) -> str:
    """Key path; a key with quotes in TOML has quotes."""
    key = key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _shown(key)
    return f"{path}.{key}" if path else key
